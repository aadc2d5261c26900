"""Vertical sections: the raster is the current along the track, cuts are chords, planes have none."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from auvplan.ocean.currents import FunctionCurrent, UniformCurrent
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.plot import plot_mission
from auvplan.plot.style import figure_of
from auvplan.report.area import section_data
from auvplan.view.section import PARTS, run_sections
from auvplan.view.sheet import sheet_of
from tests.io.sample_run import WAYPOINTS, make_run
from tests.report.test_pages import unpacked

LEVEL = WAYPOINTS * [1.0, 1.0, 0.0] + [0.0, 0.0, 20.0]


def sheared(x, y, z, t):
    """A tide that falls off with depth and turns below."""
    flow = (0.8 - 0.03 * z) * jnp.cos(t / 900.0)
    return flow + 1e-4 * y, 0.3 * flow + 1e-4 * x, 0.0 * z


def sea(run, current):
    for plan in (plan for leg in run.legs for plan in leg.plans):
        plan.current = current
    return run


@pytest.fixture
def run():
    """Three legs in a sheared tide over a sloping bed, the first one over an obstacle that drifts."""
    made = sea(make_run(), FunctionCurrent(sheared))
    depth = 120.0 - 0.03 * np.arange(40)[:, None] * 50.0 + 0.01 * np.arange(40) * 50.0
    made.seabed = Seabed.from_depth(depth, 50.0)
    leg = made.legs[0]
    middle = len(leg.times) // 2
    drift = 0.1 * (leg.times - leg.times[middle])
    leg.obstacle_positions = np.array(leg.obstacle_positions)
    leg.obstacle_positions[:, 0] = leg.positions[middle] + [5.0, 0.0, 50.0]
    leg.obstacle_positions[:, 0, 1] += drift
    return made


def test_the_raster_is_the_current_along_the_track_when_it_is_passed(run):
    for leg, section in zip(run.legs, run_sections(run), strict=True):
        step = leg.positions[-1, :2] - leg.positions[0, :2]
        course = step / np.linalg.norm(step)
        levels = 0.5 * (section.depth[1:] + section.depth[:-1])
        middle = section.time[PARTS // 2 :: PARTS]
        track = np.stack([np.interp(middle, leg.times, axis) for axis in leg.positions.T])
        met = np.stack(sheared(*track, middle)[:2], axis=1) @ course
        found = [np.interp(z, levels, column) for z, column in zip(track[2], section.along.T, strict=True)]
        np.testing.assert_allclose(found, met, atol=1e-4)
    ends = [section.distance[[0, -1]] for section in run_sections(run)]
    lengths = [np.linalg.norm(leg.positions[-1, :2] - leg.positions[0, :2]) for leg in run.legs]
    np.testing.assert_allclose(np.ravel(ends)[1:-1:2], np.ravel(ends)[2::2])
    np.testing.assert_allclose(np.diff(ends, axis=1)[:, 0], lengths)


def test_after_a_replan_the_current_is_that_of_the_replan(run):
    _, second = run.legs[0].plans
    second.current = UniformCurrent(0.5, 0.0)
    section = run_sections(run)[0]
    after = section.time[PARTS // 2 :: PARTS] > second.made_at
    north = (WAYPOINTS[1] - WAYPOINTS[0])[0] / np.linalg.norm((WAYPOINTS[1] - WAYPOINTS[0])[:2])
    np.testing.assert_allclose(section.along[:, after], 0.5 * north, atol=1e-5)
    assert np.ptp(section.along[:, ~after], axis=0).min() > 0.1
    assert len(section.earlier) == 1
    np.testing.assert_allclose(section.earlier[0][[0, -1]], section.path[[0, -1]], atol=1e-6)


def test_the_bed_line_is_the_sea_bed(run):
    for leg, section in zip(run.legs, run_sections(run), strict=True):
        x, y = (np.interp(section.time, leg.times, axis) for axis in leg.positions.T[:2])
        np.testing.assert_allclose(section.bed, run.seabed.depth_at(x, y), atol=1e-3)
        assert section.depth[0] == 0.0
        assert section.depth[-1] >= section.bed.max()


def test_a_cut_is_the_chord_of_the_sphere_when_it_is_passed(run):
    leg, section = run.legs[0], run_sections(run)[0]
    (cut,) = section.cuts
    assert cut.kind == "static"
    inside = np.flatnonzero(np.isfinite(cut.solid[0]))
    assert 4 < len(inside) < len(section.time) / 4
    for k in inside:
        x, y = (np.interp(section.time[k], leg.times, axis) for axis in leg.positions.T[:2])
        centre = [np.interp(section.time[k], leg.times, axis) for axis in leg.obstacle_positions[:, 0].T]
        for z in cut.solid[:, k]:
            assert np.linalg.norm(np.array([x, y, z]) - centre) == pytest.approx(
                leg.obstacle_radii[0], abs=0.05
            )
        assert cut.boundary[0, k] < cut.solid[0, k] < cut.solid[1, k] < cut.boundary[1, k]


def test_a_known_obstacle_is_cut_from_its_top_to_its_bottom(run):
    where = 0.5 * (run.legs[1].positions[0] + run.legs[1].positions[-1])
    run.obstacles = (KnownObstacle("wreck", (where[0], where[1]), 50.0, 60.0),)
    (cut,) = run_sections(run)[1].cuts
    width = np.isfinite(cut.solid[0]).mean() * np.ptp(run_sections(run)[1].distance)
    assert width == pytest.approx(100.0, abs=5.0)
    assert np.nanmin(cut.solid[0]) == np.nanmax(cut.solid[0]) == 60.0
    assert np.nanmin(cut.solid[1]) > 1000.0


@pytest.mark.parametrize("different", ["nothing", "box", "current", "track", "bed"])
def test_where_nothing_differs_with_depth_there_is_no_section(different):
    run = sea(make_run(waypoints=WAYPOINTS if different == "track" else LEVEL), UniformCurrent(0.3, 0.0))
    if different in ("box", "current"):
        sea(run, FunctionCurrent(sheared))
    if different == "box":
        run.scenario["area"] = {"lower": [0.0, 0.0, 20.0], "upper": [2000.0, 2000.0, 20.0]}
    if different == "bed":
        run.seabed = Seabed.from_depth(np.full((40, 40), 60.0), 50.0)
    drawn = different in ("current", "track", "bed")
    assert bool(run_sections(run)) == drawn
    assert (section_data(run) is not None) == drawn
    axes = [one for one in figure_of(plot_mission(run)).axes if one.get_label() == "section"]
    assert len(axes) == drawn
    assert ("transit, m" in sheet_of(run).table()[0]) == (different == "track")


def test_depth_points_down_and_distance_is_that_of_the_track(run):
    axes = plot_mission(run)
    (below,) = [one for one in figure_of(axes).axes if one.get_label() == "section"]
    assert axes.get_xlabel() == "east [m]"
    assert below.yaxis_inverted()
    assert not below.xaxis_inverted()
    assert below.get_ylabel() == "depth [m]"
    assert below.get_xlabel() == "distance along the path [m]"
    for image, section in zip(below.images, run_sections(run), strict=True):
        x0, x1, bottom, top = image.get_extent()
        np.testing.assert_allclose([x0, x1], section.distance[[0, -1]])
        np.testing.assert_allclose([top, bottom], section.depth[[0, -1]])
        np.testing.assert_array_equal(np.asarray(image.get_array()), section.along)
    assert [text.get_text() for text in below.texts] == ["0", "1", "3", "2"]


def test_the_page_has_the_same_section(run):
    sections, found = run_sections(run), section_data(run)
    along, times = unpacked(found["along"]), unpacked(found["times"])
    assert along.shape == (len(found["depth"]) - 1, len(times) - 1)
    columns = sections[0].along.shape[1]
    np.testing.assert_allclose(along[:, :columns], sections[0].along, atol=1e-3)
    assert (along[:, columns] < -30.0).all(), "the vehicle waits at the waypoint"
    assert (np.diff(times) >= 0.0).all()
    solid, boundary = found["outlines"]
    assert not solid["grown"]
    assert boundary["grown"]
    assert min(boundary["depths"]) < min(solid["depths"])
    assert len(found["earlier"]) == 3


def test_the_sheet_states_depths_on_the_way():
    run = make_run()
    leg = run.legs[0]
    run.legs[0] = replace(
        leg, positions=leg.positions + np.linspace(0.0, 1.0, len(leg.times))[:, None] * [0, 0, 10]
    )
    sheet = sheet_of(run)
    assert sheet.stops[0].transit is None
    assert sheet.stops[1].transit == pytest.approx((20.0, 35.0, 50.0), abs=0.5)
    headings, rows = sheet.table()
    assert rows[1][headings.index("transit, m")] == "20-50 (35)"
    assert rows[0][headings.index("transit, m")] == ""
