"""Areas closed at some hours: routes wait for them, paths pass them round, the checker looks again."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.check.run import check_dataset
from auvplan.errors import ScenarioError
from auvplan.executive import load_area_at, plan_departures, plan_scenario
from auvplan.export import itinerary_of
from auvplan.io.area import load_closures
from auvplan.io.geo import GeoError
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run, to_dataset
from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure
from auvplan.path import PathConfig
from auvplan.site import Site
from auvplan.view.sheet import sheet_of
from tests.executive.tide import CHANNEL, EPOCH, channel, tidal_area

pytestmark = pytest.mark.usefixtures("light_search")

#: The whole width of the channel, from 400 to 600 m north.
NORTH = 400.0, 600.0
OPENS = 1200.0
PLANNING = {"effort": "plain", "departures": 16}


def band(folder, hours, east=(-80.0, 80.0)):
    """Write a band across the channel as a closed area, and return the name of the file."""
    site = Site(5.0, 60.0, EPOCH)
    corners = [(NORTH[k], east[m]) for k, m in ((0, 0), (0, 1), (1, 1), (1, 0), (0, 0))]
    ring = [[float(part) for part in site.to_geographic(*corner)] for corner in corners]
    area = {"type": "Polygon", "coordinates": [ring]}
    feature = {"type": "Feature", "properties": {"name": "narrows", **hours}, "geometry": area}
    (folder / "no_go.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return "no_go.geojson"


def settings_with(name, planning=None, **sections):
    chart = {"source": "none", "no_go": name, "pixel_size": 5.0}
    return channel(chart=chart, planning=PLANNING | (planning or {}), **sections)


def planned(folder, hours, jobs=None, planning=None):
    name = band(folder, hours)
    mission = CHANNEL["mission"] | ({"jobs": "jobs.csv"} if jobs else {})
    settings = settings_with(name, planning, mission=mission)
    area = replace(
        tidal_area(0.0, 0.0),
        jobs=jobs,
        closures=load_closures(settings, tidal_area(0.0, 0.0).site, folder),
    )
    return plan_scenario(settings, area=area, folder=folder)


@pytest.fixture(scope="module")
def plan(light_search, tmp_path_factory):
    """A plan that has to wait for the band to open."""
    return planned(tmp_path_factory.mktemp("closed"), {"to": "2026-03-01T06:20Z"})


def inside(run):
    """Times at which the vehicle is in the band."""
    times = np.concatenate([leg.times for leg in run.done])
    north = np.concatenate([leg.positions[:, 0] for leg in run.done])
    return times[(north > NORTH[0]) & (north < NORTH[1])]


@pytest.mark.slow
def test_a_plan_waits_until_the_area_opens(plan):
    assert plan.success
    assert inside(plan).min() > OPENS
    assert sum(leg.t_hold for leg in plan.done) > 300.0
    report = check_dataset(plan.summary(), to_dataset(plan))
    assert report.faults == []
    assert report.notes == []


@pytest.mark.slow
def test_the_sheet_and_exports_tell_the_hours(plan):
    assert "narrows" in sheet_of(plan).facts["closed areas"]
    assert "06:20" in sheet_of(plan).facts["closed areas"]
    assert any("closed at some hours have no fence: narrows" in note for note in itinerary_of(plan).notes)


@pytest.mark.slow
def test_the_checker_sees_a_vehicle_in_an_area_that_is_closed(plan):
    """The same track, two quarters of an hour earlier."""
    dataset = to_dataset(plan)
    dataset = dataset.assign_coords(time=dataset["time"].copy(data=dataset["time"].values - 1000.0))
    faults = check_dataset(plan.summary(), dataset).faults
    assert any("in the closed area 'narrows'" in fault for fault in faults)


def test_a_mission_that_would_begin_in_a_closed_area_says_until_when(tmp_path):
    """The band is closed until 06:20, and a minute more; a plan that departs then is made."""
    mission = CHANNEL["mission"] | {"start": [500, 0, 5]}
    settings = settings_with(band(tmp_path, {"to": "2026-03-01T06:20Z"}), mission=mission)
    area = tidal_area(0.0, 0.0)
    area = replace(area, closures=load_closures(settings, area.site, tmp_path))
    words = "lies in the closed area 'narrows', which opens 2026-03-01 06:21 UTC: depart later"
    refused = plan_scenario(settings, area=area, folder=tmp_path)
    assert not refused.arrived
    assert words in refused.reason
    assert not refused.legs
    later = plan_scenario(settings, area=area, folder=tmp_path, depart=1290.0)
    assert later.success, later.reason
    assert check_dataset(later.summary(), to_dataset(later)).faults == []


def test_a_path_goes_round_an_area_while_it_is_closed_and_through_it_before():
    water = np.ones((100, 100), bool)
    water[40:60, 35:65] = False
    chart = Chart.from_mask(water, 20.0, (0.0, -1000.0))
    config = PathConfig.quick().replace(finer=1, passages=0)
    lengths = []
    for begins, ends in ((0.0, 1e4), (1500.0, 1e4)):
        closure = Closure(chart, jnp.asarray([begins]), jnp.asarray([ends]))
        env = ap.Environment(None, lower=(0, -1000, 0), upper=(2000, 1000, 20), closures=(closure,))
        found = ap.plan_path(
            (100, 0, 5), (1900, 0, 5), env, ap.Vehicle(speed=2.5), key=jax.random.key(0), config=config
        )
        assert found.feasible
        lengths.append(found.length)
        within = (np.abs(found.positions[:, 0] - 1000.0) < 200.0) & (np.abs(found.positions[:, 1]) < 300.0)
        assert not (within & (found.times > begins) & (found.times < ends)).any()
    assert lengths[0] > 1.03 * lengths[1]
    assert lengths[1] == pytest.approx(1800.0, rel=0.01)


@pytest.mark.slow
def test_a_simulated_mission_keeps_out(tmp_path):
    name = band(tmp_path, {"from": 100, "to": 1500})
    settings = settings_with(name)
    sea = tidal_area(0.3, 0.0)
    area = replace(sea, closures=load_closures(settings, sea.site, tmp_path))
    run = ap.run_mission(settings, seed=0, area=area, folder=tmp_path)
    assert run.success
    assert inside(run).min() > 1500.0
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


@pytest.mark.slow
def test_a_job_in_the_area_is_done_while_it_is_open(tmp_path):
    jobs = Jobs((JobPoint("buoy", (500.0, 0.0, 5.0), 3.0, 60.0),))
    (tmp_path / "jobs.csv").write_text("name,north,east,depth,priority,duration\nbuoy,500,0,5,3,60\n")
    run = planned(tmp_path, {"windows": "0/900, 2400/.."}, jobs)
    assert run.success
    assert run.total_priority == 3.0
    assert inside(run).min() > 900.0
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_a_job_in_an_area_that_never_opens_is_stated(tmp_path):
    jobs = Jobs((JobPoint("buoy", (500.0, 0.0, 5.0), 3.0, 60.0),))
    with pytest.raises(ScenarioError, match=r"job 'buoy' lies in the closed area 'narrows': its hours"):
        planned(tmp_path, {"from": -100}, jobs)


@pytest.fixture
def early(tmp_path):
    """A scenario that departs at 06:00 with a band that is closed from 03:00 to 05:30, and its folder."""
    (tmp_path / "tide.yaml").write_text("constituents: {M2: {u: [0.02, 0], v: [0.1, 20]}}")
    tide = {"source": "harmonic", "constituents": "tide.yaml"}
    name = band(tmp_path, {"from": "2026-03-01T03:00Z", "to": "2026-03-01T05:30Z"})
    return settings_with(name, current=tide, mission=CHANNEL["mission"] | {"time_available": 5000}), tmp_path


def test_a_departure_before_the_scenarios_own_knows_what_is_closed_then(early):
    settings, folder = early
    assert load_area_at(settings, [0.0], folder).closures == ()
    area = load_area_at(settings, [-2 * 3600.0, 0.0], folder)
    (closure,) = area.closures
    assert closure.spans == [(-10_860.0, -1740.0)]
    found = plan_departures(settings, [-2 * 3600.0, 0.0], key=jax.random.key(0), area=area, folder=folder)
    assert found.feasible.tolist() == [False, True]


def test_what_is_planned_early_is_saved_checked_and_restored_with_what_is_closed_then(early, tmp_path):
    settings, folder = early
    run = plan_scenario(settings, depart=-2 * 3600.0, folder=folder)
    assert not run.success
    (closure,) = run.closures
    assert closure.spans == [(-3660.0, 5460.0)]
    (again,) = restore_run(save_run(run, tmp_path / "out")).closures
    assert again.spans == closure.spans
    opened = plan_scenario(settings, folder=folder)
    dataset = to_dataset(replace(opened, closures=run.closures))
    faults = check_dataset(opened.summary(), dataset).faults
    assert any("in the closed area 'narrows'" in fault for fault in faults)


def test_an_area_that_was_read_for_another_departure_is_refused(early):
    settings, folder = early
    area = load_area_at(settings, [0.0], folder)
    words = r"read from 2026-03-01 06:00 UTC to 2026-03-01 07:23 UTC.*load_area_at"
    for depart in (-7200.0, 7200.0):
        with pytest.raises(ScenarioError, match=words):
            plan_scenario(settings, depart=depart, area=area, folder=folder)
        with pytest.raises(ScenarioError, match=words):
            plan_departures(settings, [depart], key=jax.random.key(0), area=area, folder=folder)


@pytest.mark.parametrize(
    ("hours", "words"),
    [
        ({"from": 900, "to": 300}, "feature 1: the window from 900 to 300 ends before it begins"),
        ({"from": "2026-03-01T06:00"}, "has no time zone"),
        ({"windows": "0/600, 500/900"}, "two windows overlap"),
    ],
)
def test_slips_in_hours_are_stated(tmp_path, hours, words):
    settings = settings_with(band(tmp_path, hours))
    with pytest.raises(GeoError, match=words):
        load_closures(settings, Site(5.0, 60.0, EPOCH), tmp_path)


def test_hours_of_the_scenario_hold_where_the_file_has_none(tmp_path):
    name = band(tmp_path, {})
    chart = {"source": "none", "no_go": name, "no_go_windows": "06:10Z/06:20Z", "pixel_size": 5.0}
    (closure,) = load_closures(channel(chart=chart), Site(5.0, 60.0, EPOCH), tmp_path)
    assert closure.spans == [(540.0, 1260.0)]
    with pytest.raises(ValueError, match="no_go_windows goes with no_go alone"):
        channel(chart={"source": "none", "no_go_windows": "06:10Z/06:20Z"})
