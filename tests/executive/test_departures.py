"""When to leave: closed forms of tidal streams, batches against single departures, the command."""

import csv
from dataclasses import replace
from datetime import timedelta

import jax
import numpy as np
import pytest
import xarray as xr
import yaml
from scipy.optimize import brentq

from auvplan.cli.departures import departure_times
from auvplan.errors import ScenarioError
from auvplan.executive import load_area_at, plan_departures, plan_scenario, route_calls
from auvplan.executive.route_calls import effort
from auvplan.io.area import load_area
from auvplan.io.geo import GeoError
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run
from auvplan.mission.travel_times import TravelTimeConfig
from auvplan.ocean.gridded import CurrentError
from auvplan.runtime.files import ResultError
from auvplan.scenario.scenario import Scenario
from tests.executive.small import SMALL, planning, scenario
from tests.executive.tide import CHANNEL, EPOCH, PERIOD, channel, stream, tidal_area
from tests.io.currents.samples import LAT, LON, regular, write

pytestmark = pytest.mark.usefixtures("light_search")

HOUR = 3600.0
KEY = jax.random.key(3)
HOURS = np.arange(13) * HOUR

#: Without beams and local search, which take long to compile.
PLAIN = planning(effort="plain")


@pytest.fixture(scope="module")
def across(light_search):
    """A leg to the north across a stream of up to 2 m/s."""
    return plan_departures(channel(), HOURS, key=KEY, area=tidal_area(0.0, 2.0))


def test_a_leg_is_closed_at_just_the_hours_of_a_stream_that_is_too_strong(across):
    strong = np.empty(len(HOURS), bool)
    for k, depart in enumerate(HOURS):
        east = np.abs(stream(np.linspace(depart, depart + 430.0, 50), 0.0, 2.0)[1]).max()
        assert abs(east - 1.5) > 0.04, "too near to the limit to be given"
        strong[k] = east > 1.5
    assert 0 < strong.sum() < len(HOURS)
    np.testing.assert_array_equal(across.feasible, ~strong)
    assert np.isnan(across.time[strong]).all()
    assert np.isfinite(across.time[~strong]).all()


def test_reasons_name_the_cross_current_the_place_and_the_time(across):
    for feasible, reason, depart in zip(across.feasible, across.reasons, HOURS, strict=True):
        if feasible:
            assert reason == ""
            continue
        assert reason.startswith("cross-current")
        assert "over 1.5" in reason
        assert "km" in reason
        then = {EPOCH + timedelta(seconds=depart + 60.0 * k) for k in range(20)}
        assert any(f"{moment:%H:%M} UTC" in reason for moment in then)


def test_the_best_departure_is_the_fastest_feasible_one(across):
    assert across.best == np.nanargmin(across.time)
    assert across.moment(across.best) == "2026-03-01 09:00 UTC"
    np.testing.assert_allclose(across.current, np.abs(stream(HOURS, 0.0, 2.0)[1]), atol=1e-3)


def test_legs_by_energy_are_those_that_the_power_model_makes_of_their_times(across):
    power = {"hotel": 20.0, "propulsion": {"constant": 10.0, "factor": 15.0}}
    settings = channel(vehicle={"power": power})
    found = plan_departures(settings, HOURS, key=KEY, area=tidal_area(0.0, 2.0), least="energy")
    np.testing.assert_array_equal(found.time, across.time)
    speed = settings.vehicle.speed
    np.testing.assert_allclose(found.energy, found.time * (30.0 + 15.0 * speed**3) / 3600.0, rtol=1e-4)
    assert found.best == across.best  # without turning, diving and climbing, energy is power times time
    # Where it is dear to turn, a leg that takes less energy may take longer.
    swapped = replace(found, energy=np.where(np.arange(len(HOURS)) == 3, 1.0, found.energy))
    assert found.feasible[3]
    assert (swapped.best, replace(swapped, least="time").best) == (3, across.best)


POWER = {"hotel": 20.0, "propulsion": {"constant": 10.0, "factor": 15.0}}


@pytest.mark.parametrize(
    ("vehicle", "why"),
    [
        ({"power": POWER | {"battery": {"capacity": 40.0, "reserve": 0.1}}}, "36.0 Wh are available"),
        ({"power": POWER, "speed_range": [1.5, 2.5]}, "cross-current"),
        ({"navigation": {"drift": 0.01, "most": 10.5}}, "10.5 m are asked for"),
    ],
)
def test_a_leg_with_limits_or_speeds_is_what_the_plan_of_its_departure_is(vehicle, why):
    settings, area = channel(vehicle=vehicle), tidal_area(1.2, 1.6)
    found = plan_departures(settings, HOURS[:8:2], key=KEY, area=area)
    assert 0 < found.feasible.sum() < len(found)
    assert any(why in reason for reason in found.reasons)
    for k, depart in enumerate(found.departs):
        run = plan_scenario(settings, key=KEY, depart=depart, area=area)
        assert run.success == found.feasible[k]
        assert ("" if run.success else run.reason) == found.reasons[k]
        if run.success:
            assert run.t_mission == pytest.approx(found.time[k])
            assert found.energy is None or found.energy[k] == pytest.approx(run.energy.total)


def test_departures_by_energy_need_a_power_model():
    with pytest.raises(ScenarioError, match=r"vehicle\.power"):
        plan_departures(channel(), HOURS, key=KEY, area=tidal_area(0.0, 2.0), least="energy")


def test_travel_times_with_and_against_a_stream_are_those_of_the_closed_form():
    found = plan_departures(channel(), HOURS, key=KEY, area=tidal_area(1.2, 0.0))
    rate = 2.0 * np.pi / PERIOD

    def executed(seconds, depart):
        """Metres over ground: the integral of 2.5 + 1.2 cos(rate t)."""
        return 2.5 * seconds + 1.2 / rate * (np.sin(rate * (depart + seconds)) - np.sin(rate * depart))

    exact = [brentq(lambda s, d=depart: executed(s, d) - 1000.0, 1.0, 2000.0) for depart in HOURS]
    assert found.feasible.all()
    assert np.ptp(exact) > 400.0
    np.testing.assert_allclose(found.time, exact, rtol=4e-3)


@pytest.mark.parametrize("chosen", [[2], [5, 3, 9]])
def test_legs_in_a_batch_are_those_planned_by_themselves_in_any_order(across, chosen):
    found = plan_departures(channel(), HOURS[chosen], key=KEY, area=tidal_area(0.0, 2.0))
    np.testing.assert_array_equal(found.departs, HOURS[chosen])
    np.testing.assert_array_equal(found.time, across.time[chosen])
    assert found.reasons == tuple(across.reasons[k] for k in chosen)
    np.testing.assert_array_equal(found.plans.positions, across.plans.positions[chosen])


def test_a_leg_that_takes_all_the_time_is_refused():
    short = channel(mission=CHANNEL["mission"] | {"time_available": 405})
    found = plan_departures(short, HOURS[[2, 3]], key=KEY, area=tidal_area(0.0, 2.0))
    assert found.feasible.tolist() == [False, True]
    assert "405 s are available" in found.reasons[0]


@pytest.fixture(scope="module")
def missions(light_search):
    """The small mission at three departures between which its vortices move."""
    return plan_departures(PLAIN, [0.0, 5 * HOUR, HOUR], key=KEY)


def test_missions_are_those_that_are_planned_one_by_one(missions):
    assert missions.feasible.all()
    for k, depart in enumerate(missions.departs):
        run = plan_scenario(PLAIN, key=KEY, depart=depart)
        assert run.route == missions.routes[k]
        assert run.t_mission == missions.time[k]
        assert run.total_priority == missions.priority[k]
        assert run.tasks == missions.tasks[k]


def test_the_sea_differs_by_departure_and_planning_costs_no_time(missions):
    assert len(set(missions.time)) == 3
    assert len(set(missions.current)) == 3
    charged = plan_departures(planning(effort="plain", charge_compute=True), [HOUR], key=KEY)
    np.testing.assert_array_equal(charged.time, missions.time[2:])
    rank = [(-priority, time) for priority, time in zip(missions.priority, missions.time, strict=True)]
    assert missions.best == rank.index(min(rank))
    assert missions.moment(2) == "+1.00 h"


def altered(**sections):
    """The plain small mission with some settings of sections changed."""
    given = SMALL | {"planning": SMALL["planning"] | {"effort": "plain"}}
    return Scenario.model_validate(given | {name: given[name] | new for name, new in sections.items()})


def test_a_mission_whose_legs_the_sea_closes_names_leg_limit_place_and_time(monkeypatch):
    def without_gradients(config):
        return TravelTimeConfig(path=effort(config).path, detours=4, detour_steps=0)

    monkeypatch.setattr(route_calls, "effort", without_gradients)
    strong = altered(current={"uniform": [0.0, 3.2, 0.0]})
    found = plan_departures(strong, [0.0, HOUR], key=KEY)
    assert not found.feasible.any()
    assert found.best is None
    assert found.routes == (None, None)
    for depart, reason in zip(found.departs, found.reasons, strict=True):
        assert reason.startswith("leg 0 to ")
        assert "cannot be executed" in reason
        assert any(limit in reason for limit in ("cross-current", "ground speed", "beats the vehicle"))
        assert "km" in reason
        seconds = float(reason.split(" s: ")[0].split()[-1].replace(",", ""))
        assert seconds >= depart


def test_too_little_time_is_told_in_figures():
    found = plan_departures(altered(mission={"time_available": 60}), [0.0], key=KEY)
    assert "60 s are available" in found.reasons[0]


def test_departures_that_cannot_be():
    with pytest.raises(ScenarioError, match="vortices begin"):
        plan_departures(scenario(), [-HOUR], key=KEY)
    with pytest.raises(ScenarioError, match="2026-03-01 22:00 UTC"):
        plan_departures(channel(), [15.5 * HOUR], key=KEY, area=tidal_area(0.0, 1.0))
    with pytest.raises(ScenarioError, match="departs"):
        plan_departures(scenario(), [], key=KEY)


@pytest.fixture
def dated(tmp_path):
    """A leg in the current of a file that lasts from 0 to 3 h, leaving at 1 h; the mapping and its folder."""
    write(regular().isel(depth=[0]), tmp_path / "sea.nc")
    return {
        "name": "dated",
        "site": {"longitude": LON + 0.035, "latitude": LAT + 0.025, "departure": "2020-01-01T01:00:00Z"},
        "area": {"lower": [-600, -600, 0], "upper": [600, 600, 20]},
        "chart": {"source": "none"},
        "current": {"source": "file", "files": "sea.nc"},
        "mission": {"waypoints": 2, "start": [-400, -300, 5], "goal": [500, 300, 5], "time_available": 1800},
        "planning": {"effort": "plain"},
    }, tmp_path


def test_currents_are_read_for_all_departures_and_count_from_the_scenarios_own(dated):
    settings, folder = Scenario.model_validate(dated[0]), dated[1]
    usual = load_area(settings, folder)
    early = load_area_at(settings, [-0.9 * HOUR, 1.4 * HOUR], folder)
    assert early.site == usual.site
    assert float(early.forecast.times[0]) <= -0.9 * HOUR
    assert float(early.forecast.times[-1]) >= 1.4 * HOUR + 1800.0
    for seconds in (0.0, 700.0, 1800.0):
        np.testing.assert_allclose(
            early.forecast(30.0, -50.0, 4.0, seconds), usual.forecast(30.0, -50.0, 4.0, seconds), atol=1e-5
        )
    for departs in ([-1.1 * HOUR], [1.6 * HOUR]):
        with pytest.raises(CurrentError, match=r"sea\.nc"):
            load_area_at(settings, departs, folder)


def test_members_and_windows_are_those_of_the_departure(dated):
    """A member that is the forecast is it at every departure, and windows count from the scenario's own."""
    settings, folder = dict(dated[0]), dated[1]
    jobs = "name,north,east,depth,priority,duration,from,to\nlander,100,50,5,3,60,4400,5600\n"
    (folder / "jobs.csv").write_text(jobs)
    settings["current"] = settings["current"] | {"members": {"files": "sea.nc", "error": 0.0}}
    settings["mission"] = settings["mission"] | {"jobs": "jobs.csv", "time_available": 2000}
    del settings["mission"]["waypoints"]
    area = load_area_at(Scenario.model_validate(settings), [1.2 * HOUR], folder)
    (member,) = area.members
    np.testing.assert_array_equal(member.times, area.forecast.times)
    for seconds in (1.2 * HOUR, 1.4 * HOUR):
        np.testing.assert_array_equal(
            member(30.0, -50.0, 4.0, seconds), area.forecast(30.0, -50.0, 4.0, seconds)
        )
    assert area.jobs is not None
    assert [point.name for point in area.jobs.points] == ["lander"]


def test_a_plan_whose_forecast_was_overwritten_is_not_read_with_the_new_one(dated, tmp_path):
    settings, folder = Scenario.model_validate(dated[0]), dated[1]
    here = 0.0, 0.0, 4.0, 600.0
    east = float(load_area(settings, folder).forecast(*here)[1])
    saved = save_run(plan_scenario(settings, folder=folder), tmp_path / "out")
    assert restore_run(saved).sources is not None
    sea = xr.load_dataset(folder / "sea.nc", engine="h5netcdf", decode_times=False)
    (folder / "sea.nc").unlink()
    write(sea.assign(uo=sea.uo + 0.3), folder / "sea.nc")
    with pytest.raises(
        ResultError, match=r"mission\.nc: current\.files: sea\.nc was .* put back what"
    ) as error:
        restore_run(saved)
    assert "\n" not in str(error.value)
    assert float(load_area(settings, folder).forecast(*here)[1]) == pytest.approx(east + 0.3, abs=1e-3)
    write(sea, folder / "tomorrow.nc")
    (folder / "sea.nc").unlink()
    with pytest.raises(CurrentError, match=r"sea\.nc"):
        restore_run(saved)


def test_departures_of_a_scenario_that_begins_with_its_file(dated):
    undated = {"longitude": LON + 0.035, "latitude": LAT + 0.025}
    settings = Scenario.model_validate(dated[0] | {"site": undated})
    times = departure_times(settings, dated[1], "2020-01-01T02:00+01:00", "2.5", "30min")
    np.testing.assert_allclose(times, np.arange(2, 6) * 1800.0)
    assert float(load_area_at(settings, times, dated[1]).forecast.times[-1]) >= 3.0 * HOUR - 1.0
    for departs in ([-HOUR, 0.0], [-HOUR]):
        with pytest.raises(ScenarioError, match="2019-12-31 23:00 UTC"):
            load_area_at(settings, departs, dated[1])


def test_early_windows_of_jobs_count_from_the_departure(tmp_path):
    (tmp_path / "tide.yaml").write_text("constituents: {M2: {u: [0.02, 0], v: [0.1, 20]}}")
    tide = {"source": "harmonic", "constituents": "tide.yaml"}
    mission = {"jobs": "jobs.csv", "start": [0, 0, 5], "goal": [1000, 0, 5], "time_available": 5000}
    settings = channel(current=tide, mission=mission)
    for hours in ("04:00Z,05:20Z", "2026-03-01T04:00Z,2026-03-01T05:20Z"):
        table = f"name,north,east,depth,priority,duration,from,to\nbuoy,800,0,5,3,60,{hours}\n"
        (tmp_path / "jobs.csv").write_text(table)
        (job,) = load_area_at(settings, [-2 * HOUR], tmp_path).jobs.points
        assert job.windows == ((-2 * HOUR, -2460.0),)
    with pytest.raises(GeoError, match="over at the departure, 2026-03-01 05:30 UTC"):
        load_area_at(settings, [-0.5 * HOUR], tmp_path)


def test_a_tide_of_constituents_has_no_beginning(tmp_path):
    tide = Scenario.model_validate(CHANNEL | {"current": {"source": "harmonic", "constituents": "tide.yaml"}})
    assert departure_times(tide, tmp_path, "-1h", "0", "30min") == [-3600.0, -1800.0, 0.0]


@pytest.mark.parametrize(
    ("begin", "end", "step", "hours"),
    [
        ("0", "2", "1h", [0, 1, 2]),
        ("+3h", "4", "1800s", [3, 3.5, 4]),
        ("2026-03-01T08:00", "2026-03-01T11:30+02:00", "0.75", [2, 2.75, 3.5]),
        ("90min", "1.6", "1h", [1.5]),
    ],
)
def test_times_in_all_spellings(tmp_path, begin, end, step, hours):
    np.testing.assert_allclose(departure_times(channel(), tmp_path, begin, end, step), np.array(hours) * HOUR)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("soon", "12", "1h"), "--from 'soon' is neither"),
        (("0", "2026-13-01", "1h"), "--to '2026-13-01' is neither"),
        (("3", "+2h", "1h"), "--from '3' must not be later than --to '+2h'"),
        (("0", "12", "0s"), "--step '0s' must be a duration above 0"),
        (("0", "12", "-1h"), "--step '-1h' must be"),
        (("0", "12", "often"), "--step 'often' must be"),
        (("0", "12", "1s"), "--step '1s' makes 43201 departures, more than 500"),
        (("-1", "12", "1h"), "--from '-1' lies before the scenario's departure"),
        (("06:00:00", "12", "1h"), "--from '06:00:00' is neither"),
        (("nan", "12", "1h"), "--from 'nan'"),
        (("0", "inf", "1h"), "--to 'inf' lies too far"),
        (("0", "9999-12-31", "1h"), "--to '9999-12-31' lies too far"),
        (("2026-12-01T00:00", "2026-12-01T04:00", "2h"), "set site.departure nearer"),
        (("2025-08-01", "0", "2h"), "--from '2025-08-01' lies too far"),
        (("0", "4660", "100h"), "--to '4660' lies too far"),  # its mission ends after 2^24 s
        (("0001-01-01T00:00+14:00", "12", "1h"), "--from '0001-01-01T00:00+14:00'"),
    ],
)
def test_bad_options_are_named(tmp_path, options, words):
    with pytest.raises(ScenarioError) as error:
        departure_times(channel(), tmp_path, *options)
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_dates_need_a_dated_scenario(tmp_path):
    with pytest.raises(ScenarioError, match=r"--to '2026-03-01': the scenario has no date.*site\.departure"):
        departure_times(scenario(), tmp_path, "0", "2026-03-01", "1h")


def departures(call, settings, folder, *options):
    """Exit status, standard output and standard error of the command."""
    path = folder / "dated.yaml"
    path.write_text(yaml.safe_dump(settings))
    return call("departures", path, "--out", folder / "out", *options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*still water:auvplan.errors.ScenarioWarning")
def test_the_command_from_a_file_of_currents(dated, call):
    settings, folder = dated
    options = ("--from", "2020-01-01T00:30", "--to", "+1.4h", "--step", "45min", "--seed", "1")
    code, out, err = departures(call, settings, folder, *options)
    assert code == 0, err
    assert out.count("best") == 1
    with (folder / "out" / "departures.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["departure_utc"][11:16] for row in rows] == ["00:30", "01:15", "02:00"]
    assert all(row["feasible"] == "true" for row in rows)
    assert all(row["departure_utc"].replace("T", " ")[:16] in out for row in rows)
    best = [row for row in rows if row["best"] == "true"]
    assert [float(row["time_s"]) for row in best] == [min(float(row["time_s"]) for row in rows)]
    assert (folder / "out" / "departures.png").stat().st_size > 10_000
    names = ["departures.csv", "departures.json", "departures.png", "report.html"]
    assert sorted(path.name for path in (folder / "out").iterdir()) == names

    settings["mission"] |= {"time_available": 60}
    code, out, err = departures(call, settings, folder, *options, "--quiet")
    assert code == 1
    assert out == ""
    assert "no departure is feasible" in err
    assert "60 s are available" in err
    assert "Traceback" not in err
