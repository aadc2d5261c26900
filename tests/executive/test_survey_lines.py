"""Survey lines in whole missions: followed within their tolerance, and only what is covered counts."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auvplan.check.run import check_dataset
from auvplan.executive import plan_scenario, run_missions
from auvplan.export import itinerary_of
from auvplan.io.restore import restore_run
from auvplan.io.results import save_run, to_dataset
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.mission.survey import LinePart
from auvplan.ocean.chart import Chart
from auvplan.ocean.known import KnownObstacle
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.lines import line_warnings
from auvplan.simulation.faults import Obstacle
from auvplan.site import Site
from auvplan.view.sheet import sheet_of
from tests.executive.small import SMALL, scenario

pytestmark = pytest.mark.usefixtures("light_search")

#: One line past a wreck; the other along a coast, through a closed area that the chart has as land.
WRECK = KnownObstacle("wreck", (1500.0, 1010.0), 60.0)
LINES = (
    JobLine("north", ((500.0, 1000.0, 5.0), (2700.0, 1000.0, 5.0)), 4.0),
    JobLine("coast", ((2700.0, 1500.0, 5.0), (900.0, 1500.0, 5.0)), 3.0),
)
JOBS = Jobs((JobPoint("buoy", (2500.0, 200.0, 5.0), 1.0, 10.0),), LINES)


def coast():
    """Land 60 m off the second line, and a spit or closed area that lies across it."""
    passability = np.ones((160, 160))
    passability[:, 63:] = 0.0
    passability[70:74, 56:] = 0.0
    return Chart.from_passability(passability, 25.0)


def settings(**mission):
    given = {"start": [200, 200, 5], "goal": [3800, 200, 5], "time_available": 5000}
    still, with_passages = SMALL["current"] | {"vortices": 0}, SMALL["planning"] | {"effort": "quick"}
    return scenario(mission=given | mission, current=still, planning=with_passages)


def area():
    site = Site(147.3, -43.0)
    return OperatingArea(chart=coast(), jobs=JOBS, obstacles=(WRECK,), site=site)


@pytest.fixture(scope="module")
def run(light_search):
    return plan_scenario(settings(), area=area())


def on_lines(run):
    return [leg for leg in run.done if leg.line is not None]


def counted_by_hand(leg):
    """Share of a part with a place of the track beside it, metre by metre."""
    start, end = np.array(leg.line.start), np.array(leg.line.end)
    unit = (end - start) / leg.line.length
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    fine = np.concatenate(
        [a + share * (b - a) for a, b in zip(leg.positions[:-1], leg.positions[1:], strict=True)]
    )
    along = (fine - start) @ unit
    off = np.linalg.norm(fine - start - along[:, None] * unit, axis=1)
    return len(np.unique(np.floor(along[off <= leg.line.tolerance]))) / leg.line.length


def test_lines_are_followed_within_the_tolerance_and_only_what_is_covered_counts(run):
    assert run.success
    north, east = (next(leg for leg in on_lines(run) if abs(leg.line.start[1] - y) < 1) for y in (1000, 1500))
    # What is blocked, and as much as the vehicle needs to turn off and on again.
    turns = 2.0 * run.vehicle.speed / run.vehicle.turn_rate_max
    for leg, line, blocked in ((north, LINES[0], 150.0), (east, LINES[1], 160.0)):
        covered, lost = leg.coverage, blocked + turns
        assert line.priority * (1.0 - lost / leg.line.length) <= leg.priority < line.priority
        assert leg.priority == pytest.approx(line.priority * covered.length / leg.line.length, rel=1e-6)
        assert covered.length / leg.line.length == pytest.approx(counted_by_hand(leg), abs=0.003)
        assert covered.worst <= leg.line.tolerance + 1e-3
        assert covered.mean < 0.1
        assert leg.t_path + leg.t_task == pytest.approx(leg.t_expected, rel=0.06)
    assert run.total_priority == pytest.approx(run.routes[0].priority, rel=0.01)
    assert run.total_priority <= run.bound + 1e-6
    assert run.tasks == 3


def test_the_sheet_says_how_much_of_each_line_is_covered_and_validate_says_why(run):
    words = sheet_of(run).facts["survey lines"]
    for leg in on_lines(run):
        assert f"{leg.coverage.length:,.0f} of {leg.line.length:,.0f} m" in words
    wreck, spit = line_warnings(settings(), area())
    assert "'north' cannot be followed whole" in wreck
    assert "'wreck'" in wreck
    assert "'coast' cannot" in spit
    assert "the coast or a closed area" in spit


def test_the_vehicles_points_cover_as_much_of_the_lines(run):
    for planned, leg in zip(itinerary_of(run).legs, run.done, strict=True):
        if leg.line is not None:
            assert len(planned.kept) >= 4
            covered = leg.line.covered(planned.waypoints)
            assert covered.length >= leg.coverage.length - 1.0
            np.testing.assert_allclose(planned.waypoints[[0, -1]], [leg.line.start, leg.line.end], atol=0.01)


def test_what_is_covered_is_saved_restored_and_measured_again(run, tmp_path):
    report = check_dataset(run.summary(), to_dataset(run))
    assert report.faults == []
    back = restore_run(save_run(run, tmp_path))
    for leg, old in zip(back.legs, run.legs, strict=True):
        assert leg.line == old.line
        assert leg.coverage == pytest.approx(old.coverage) if old.line else leg.coverage is None
    assert back.total_priority == pytest.approx(run.total_priority)


@pytest.mark.parametrize(
    ("name", "change"),
    [("covered", -5.0), ("across_worst", 3.0), ("across_mean", 1.0), ("tolerance", 40.0), ("length", 5.0)],
)
def test_the_checker_catches_another_coverage(run, name, change):
    leg = on_lines(run)[0]
    number = run.legs.index(leg)
    for where in ("file", "summary"):
        summary, dataset = json.loads(json.dumps(run.summary())), to_dataset(run)
        if where == "file":
            dataset[f"leg_line_{name}"].values[number] += change
        else:
            summary["legs"][number]["line"][name] += change
        assert any(f"line_{name}" in fault for fault in check_dataset(summary, dataset).faults) or (
            name == "tolerance" and any("line_tolerance" in f for f in check_dataset(summary, dataset).faults)
        )


def test_the_checker_catches_a_line_that_counts_in_full(run):
    number = run.legs.index(on_lines(run)[0])
    whole = replace(run, legs=[replace(leg) for leg in run.legs])
    whole.legs[number].priority = 4.0
    faults = check_dataset(whole.summary(), to_dataset(whole)).faults
    assert any("counts a priority of 4" in fault for fault in faults)


@pytest.mark.slow
def test_an_obstacle_that_appears_on_a_line_is_passed_and_the_line_taken_up_again():
    unseen = scenario(
        mission={"start": [200, 1000, 5], "goal": [3300, 1000, 5], "time_available": 3000},
        current=SMALL["current"] | {"vortices": 0},
        planning=SMALL["planning"] | {"effort": "plain"},  # it compiles faster
        simulation={"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
    )
    line = JobLine("line", ((500.0, 1000.0, 5.0), (3000.0, 1000.0, 5.0)), 4.0)
    fault = Obstacle(at=400.0, ahead=350.0, radius=40.0)
    (run,) = run_missions(unseen, seeds=[0], area=OperatingArea(jobs=Jobs((), (line,))), faults=[[fault]])
    (leg,) = on_lines(run)
    assert run.success
    assert run.collisions == 0
    assert leg.path_replans >= 1
    assert 0.85 < leg.coverage.length / leg.line.length < 0.99
    assert leg.priority == pytest.approx(4.0 * leg.coverage.length / leg.line.length)
    assert leg.coverage.worst <= leg.line.tolerance + 1e-3
    # It ends on the line again.
    late = leg.positions[leg.positions[:, 0] > 2000.0]
    np.testing.assert_allclose(late[:, 1], 1000.0, atol=0.5)
    assert check_dataset(run.summary(), to_dataset(run)).faults == []


def test_tolerances_are_those_of_the_scenario():
    assert settings().mission.line_tolerance == 10.0
    assert LinePart((0.0, 0.0, 0.0), (3.0, 4.0, 0.0), 1.0).length == 5.0


@pytest.mark.parametrize("lines", ["part", "whole"])
def test_a_part_that_is_too_steep_is_left_out_for_that(lines):
    places = (700.0, 400.0, 5.0), (1700.0, 400.0, 5.0), (1730.0, 400.0, 35.0), (2730.0, 400.0, 35.0)
    small = OperatingArea(jobs=Jobs((), (JobLine("descent", places, 4.0),)))
    stated = scenario(
        mission={"start": [200, 200, 5], "goal": [3800, 200, 5], "time_available": 5000, "lines": lines},
        current=SMALL["current"] | {"vortices": 0},
    )
    run = plan_scenario(stated, area=small)
    sheet = sheet_of(run)
    earned = run.total_priority
    assert earned == pytest.approx(4.0 * 2000.0 / (2000.0 + 30.0 * 2.0**0.5) if lines == "part" else 0.0)
    assert sheet.facts["tasks"].endswith("at most 0") == (lines == "whole")
    (left,) = sheet.left_out
    assert "part 2 is too steep, 45 degrees where vehicle.pitch_max allows 30" in left.reason
    assert ("'whole'" in left.reason) == (lines == "whole")
    (warning,) = line_warnings(stated, small)
    assert "1,000 to 1,042 m (too steep: 45 degrees" in warning
    assert ("is left out" in warning) == (lines == "whole")
    reachable = replace(small, jobs=Jobs((), (JobLine("level", places[:2], 4.0),)))
    assert line_warnings(stated, reachable) == []
