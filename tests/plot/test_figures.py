"""Figures exist, can be read, and say what they show in which unit."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

import auvplan as ap
from auvplan.mission.timetable import Timetable
from auvplan.plot import (
    busiest_leg,
    draw_chart,
    draw_run,
    plot_chart,
    plot_convergence,
    plot_currents,
    plot_mission,
    plot_obstacles,
    plot_path,
    plot_timeline,
    style,
)
from auvplan.plot.style import figure_of, save
from auvplan.records import RouteRecord
from auvplan.runtime.files import OutputError
from auvplan.site import Site
from auvplan.view.timeline import planned_bars
from tests.io.sample_run import WAYPOINTS, make_chart, make_closure, make_run, refused_leg

pytestmark = pytest.mark.usefixtures("coarse")

NAMES = ["mission.png", "timeline.png", "currents.png", "obstacles.png", "convergence.png"]


def data_axes(figure):
    """Axes that are no colour bar, of a figure or of that of axes."""
    figure = figure if isinstance(figure, Figure) else figure_of(figure)
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>" and axes.get_visible()]


def a_run(legs):
    """A made run of three legs, of one in open water, or with a leg that was refused among them or alone."""
    if legs == "open water":
        return make_run((0, 1), chart=False, obstacles=False)
    run = make_run()
    if legs != "three":
        run.legs = (
            [*run.legs[:1], refused_leg(run), *run.legs[1:]] if legs == "refused" else [refused_leg(run)]
        )
    return run


@pytest.mark.parametrize(
    "legs",
    [
        "three",
        *(pytest.param(rare, marks=pytest.mark.slow) for rare in ("open water", "refused", "only refused")),
    ],
)
def test_all_figures(tmp_path, legs):
    paths = draw_run(a_run(legs), tmp_path)
    assert [path.name for path in paths] == NAMES
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(NAMES)
    for path in paths:
        with Image.open(path) as picture:
            pixels = np.asarray(picture.convert("RGB"))
        assert min(pixels.shape[:2]) > 250 / 150 * style.DPI
        assert len(np.unique(pixels @ [1, 256, 256**2])) > 20, f"{path.name} is empty"


def test_mission_that_never_began(tmp_path):
    run = make_run()
    run.legs, run.routes = [], []
    assert [path.name for path in draw_run(run, tmp_path)] == ["mission.png"]
    assert "no path" in plot_currents(run)[0].texts[0].get_text()


def test_unwritable_folder(tmp_path):
    (tmp_path / "taken").touch()
    with pytest.raises(OutputError, match="taken"):
        draw_run(make_run(), tmp_path / "taken")


@pytest.mark.parametrize(
    "plot", [plot_mission, plot_timeline, plot_currents, plot_convergence, plot_obstacles]
)
def test_axes_have_labels_with_units_and_maps_east_right_and_north_up(plot):
    figure = figure_of(plot(make_run()))
    labels = [text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel()) if text]
    assert labels
    assert all("[" in label and "]" in label for label in labels), labels
    if plot is plot_obstacles:
        (axes,) = data_axes(figure)
        assert axes.get_zlim()[0] > axes.get_zlim()[1], "depth points down"
        assert axes.get_zlabel() == "depth [m]"
    if plot not in (plot_mission, plot_currents):
        return
    figure.draw_without_rendering()
    panels = [axes for axes in data_axes(figure) if axes.get_label() != "section"]
    assert {"east [m]", "north [m]"} <= set(labels)
    for axes in panels:
        assert axes.get_aspect() == 1.0
        assert axes.get_xlim()[0] < axes.get_xlim()[1]
        assert axes.get_ylim()[0] < axes.get_ylim()[1]
    if plot is plot_mission:
        assert_apart([text for text in panels[0].texts if text.get_text()], 8)


def assert_apart(texts, least):
    """No label covers another one."""
    boxes = [text.get_window_extent() for text in texts]
    assert len(boxes) >= least
    for k, box in enumerate(boxes):
        assert not any(box.overlaps(other) for other in boxes[:k])


def test_route_is_where_it_was_executed_in_kilometres_where_it_is_large():
    run = make_run()
    axes = data_axes(plot_mission(run))[0]
    lines = [line.get_xydata() for line in axes.lines if len(line.get_xydata()) == len(run.legs[0].times)]
    assert any(np.allclose(line, run.legs[0].positions[:, [1, 0]]) for line in lines)
    figure = plot_mission(make_run(chart=False, waypoints=WAYPOINTS * [5.0, 5.0, 1.0]))
    assert data_axes(figure)[0].get_xlabel() == "east [km]"


@pytest.mark.parametrize("longitude", [148.96, 179.998, -179.998])
def test_maps_have_longitudes_along_their_edges_also_across_180_degrees(longitude):
    run = make_run()
    run.site = Site(longitude, -20.34, origin=(1000.0, 1000.0))
    axes = data_axes(plot_mission(run))[0]
    figure_of(axes).draw_without_rendering()
    axis = axes.child_axes[0].xaxis
    stated = [float(text.get_text().rstrip("°")) for text in axis.get_ticklabels()]
    assert len(stated) >= 2
    middle = np.full(len(stated), 0.5 * sum(axes.get_ylim()))
    found, _ = run.site.to_geographic(middle, axis.get_ticklocs())
    np.testing.assert_allclose((found - stated + 180.0) % 360.0 - 180.0, 0.0, atol=5e-5)
    assert np.abs(stated).max() <= 180.0
    assert longitude < 179.0 or min(stated) < 0.0 < max(stated)


def test_areas_that_close_are_drawn_with_their_hours():
    run = make_run()
    run.closures = (make_closure().widened(run.safety.closing - 30.0),)
    words = "band 0 h 02 min-0 h 03 min"
    axes = data_axes(plot_mission(run))[0]
    assert words in [text.get_text() for text in axes.texts]
    axes = data_axes(plot_timeline(run))[0]
    assert words in [label.get_text() for label in axes.get_yticklabels()]
    (bar,) = (patch for patch in axes.patches if patch.get_hatch())
    assert (bar.get_x(), bar.get_width()) == (100.0, 100.0)


def test_windows_of_tasks_are_drawn_under_the_legs():
    run = make_run()
    leg = next(leg for leg in run.legs if leg.t_task)
    opens, closes = (np.full((4, 4, 1), fill) for fill in (-np.inf, np.inf))
    opens[:, leg.goal], closes[:, leg.goal] = leg.times[-1] - 5.0, leg.times[-1] + 5.0
    nothing = np.zeros((4, 4, 0))
    table = Timetable(np.zeros(1), np.ones((1, 4, 4)), opens, closes, nothing, nothing, nothing, nothing)
    run.graph = replace(run.graph, timetable=table)
    lines = [line for line in data_axes(plot_timeline(run))[0].lines if line.get_color() == style.GREEN]
    assert [leg.times[-1] - 5.0, leg.times[-1] + 5.0] in [list(line.get_xdata()) for line in lines]


def test_timeline_has_a_row_for_each_route_and_one_as_executed():
    run = make_run()
    axes = data_axes(plot_timeline(run))[0]
    rows = [label.get_text().splitlines()[0] for label in axes.get_yticklabels()]
    assert rows == ["first route", f"re-plan R1 at {run.routes[1].made_at:,.0f} s, late", "executed"]
    assert any(line.get_xdata()[0] == run.t_available for line in axes.lines)


def test_a_route_is_drawn_as_long_as_it_was_expected_to_take_whatever_was_refused_then():
    run = make_run()
    refused = refused_leg(run)
    again = RouteRecord(refused.plans[0].made_at, [1, 3, 2], 700.0, 6.0, 0.1, "refused", [300.0, 400.0])
    before = replace(again, nodes=[1, 2], leg_times=[260.0], waits=[20.0], time=260.0, cause="late")
    run.routes, run.legs = [run.routes[0], before, again], [run.legs[0], refused, *run.legs[1:]]
    for route in run.routes:
        bars = planned_bars(run, route)
        assert bars[-1].ends - route.made_at == pytest.approx(route.time)
        assert [bar.ends - bar.begin for bar in bars] == pytest.approx(route.leg_times)


def test_a_panel_for_each_plan_up_to_four():
    run = make_run()
    assert len(data_axes(plot_currents(run))) == 2
    leg = run.legs[0]
    leg.plans = leg.plans * 4
    assert busiest_leg(run) is leg
    assert len(data_axes(plot_currents(run))) == 4


def test_convergence_with_infinite_and_zero_values(tmp_path):
    run = make_run()
    history = run.legs[0].plans[0].history
    history["mean"] = np.where(np.arange(21) < 3, np.inf, history["mean"])
    history["std"] = np.where(np.arange(21) < 3, np.nan, history["std"])
    for name in ("violation_best", "violation_mean", "violation_std"):
        history[name] = np.zeros(21)
    save(plot_convergence(run, run.legs[0]), tmp_path / "figure.png")


def test_chart(tmp_path):
    chart = make_chart()
    Image.fromarray(np.full((200, 200, 3), 120, np.uint8)).save(tmp_path / "picture.png")
    assert draw_chart(chart, tmp_path / "picture.png", tmp_path).stat().st_size > 3_000
    assert draw_chart(chart, None, tmp_path).name == "chart.png"


@pytest.mark.parametrize("plot", [plot_mission, plot_timeline, plot_chart])
def test_axes_that_are_given_are_drawn_in(plot):
    figure = Figure(figsize=(14, 6), layout="constrained")
    left, right = figure.subplots(1, 2)
    shown = plot(make_chart() if plot is plot_chart else make_run(), ax=left)
    assert shown is left
    assert left.get_legend() is not None
    assert not figure.legends, "nothing is written outside the axes that were given"
    assert not right.has_data()
    figure.draw_without_rendering()


def test_spheres_need_three_dimensions():
    figure = Figure()
    deep = figure.add_subplot(projection="3d")
    assert plot_obstacles(make_run(), ax=deep) is deep
    assert deep.get_title()
    with pytest.raises(ValueError, match="three-dimensional"):
        plot_obstacles(make_run(), ax=Figure().subplots())


@pytest.mark.parametrize("plot", [plot_currents, plot_convergence])
def test_panels_take_the_place_of_the_axes_that_are_given(plot):
    figure = Figure(figsize=(14, 7), layout="constrained")
    left, right = figure.subplots(1, 2)
    panels = plot(make_run(), ax=right)
    assert right not in figure.axes
    assert all(isinstance(axes, Axes) and figure_of(axes) is figure for axes in panels)
    figure.draw_without_rendering()
    assert all(axes.get_window_extent().x0 > left.get_window_extent().x1 for axes in panels)
    with pytest.raises(ValueError, match="one of a grid"):
        plot(make_run(), ax=Figure().add_axes((0, 0, 1, 1)))


@pytest.mark.parametrize("plot", [plot_currents, plot_obstacles])
def test_nothing_of_a_plan_is_called_executed(plot):
    def words(run):
        figure = figure_of(plot(run))
        legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
        return [text.get_text() for legend in legends for text in legend.get_texts()]

    assert "executed" in words(make_run())
    plan = make_run()
    plan.simulated = False
    assert not any("executed" in text for text in words(plan))


def test_a_run_without_histories_is_stated():
    run = make_run()
    run.legs[0].plans[0].history = {}
    with pytest.raises(ValueError, match="no histories"):
        plot_convergence(run, run.legs[0])


@pytest.fixture(scope="module")
def plan():
    """A path past a drifting obstacle and one that is far off."""
    stream = ap.UniformCurrent(0.2, 0.4)
    afloat = ap.Obstacles.afloat([[1000.0, -200.0, 0.0], [9000.0, 9000.0, 0.0]], [80.0, 50.0], growth=0.02)
    env = ap.Environment(stream, obstacles=afloat, lower=(-500, -900, 0), upper=(2500, 1500, 0))
    config = ap.PathConfig.quick().replace(finer=1, passages=0, refine_steps=0)
    return ap.plan_path((0, 0, 0), (2000, 0, 0), env, key=jax.random.key(0), config=config)


def test_a_path_is_drawn_over_its_sea(plan, tmp_path):
    axes = plot_path(plan)
    assert axes.get_title().startswith(f"{plan.travel_time:,.0f} s over {plan.length:,.0f} m")
    assert any(np.allclose(line.get_xydata(), plan.positions[:, [1, 0]]) for line in axes.lines), (
        "east to the right"
    )
    assert len(axes.patches) == 2, "one obstacle in view, and its boundary"
    solid, bound = axes.patches
    assert solid.radius == pytest.approx(80.0)
    assert bound.radius > solid.radius
    clear = np.linalg.norm(plan.positions[:, [1, 0]] - np.asarray(solid.center), axis=1)
    assert clear.min() >= bound.radius - 30.0, "the path passes the boundary as it is drawn"
    assert save(axes, tmp_path / "path.png").stat().st_size > 5_000


def test_a_path_has_a_section_where_the_sea_differs_with_depth(plan):
    assert len(data_axes(plot_path(plan))) == 1, "a flat box"
    sheared = ap.Environment(
        lambda x, y, z, t: (0.5 - 0.02 * z, 0.0 * y, 0.0 * t), lower=(-500, -900, 0), upper=(2500, 1500, 60)
    )
    deep = replace(plan, conditions=replace(plan.conditions, env=sheared, leg=None))
    axes, below = data_axes(plot_path(deep))
    assert "east" in axes.get_xlabel()
    assert below.get_ylim() == (60.0, 0.0)
    north = (
        np.diff(plan.positions[:, 0]).sum() / np.linalg.norm(np.diff(plan.positions, axis=0), axis=1).sum()
    )
    found = np.asarray(below.images[0].get_array()).mean(axis=1)
    levels = (np.arange(len(found)) + 0.5) * 60.0 / len(found)
    np.testing.assert_allclose(found, north * (0.5 - 0.02 * levels), atol=1e-3)


def test_a_path_over_another_map_leaves_the_map_as_it_is(plan):
    axes = plot_mission(make_run())
    limits, count = (axes.get_xlim(), axes.get_ylim()), len(axes.images)
    assert plot_path(plan, ax=axes) is axes
    assert (axes.get_xlim(), axes.get_ylim()) == limits
    assert len(axes.images) == count
    wide = plot_mission(make_run(chart=False, waypoints=WAYPOINTS * [5.0, 5.0, 1.0]))
    plot_path(plan, ax=wide)
    assert np.allclose(wide.lines[-1].get_xydata(), plan.positions[:, [1, 0]] / 1000.0)
