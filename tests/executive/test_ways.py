"""Jobs that land parts from each other: ways around join them."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import auvplan as ap
from auvplan.mission.jobs import JobPoint, Jobs, jobs_of
from auvplan.mission.travel_times import Detours, TravelTimeConfig, Trips, travel_times
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import UniformCurrent
from auvplan.ocean.environment import Environment
from auvplan.ocean.seabed import Seabed
from auvplan.scenario import OperatingArea, Scenario
from auvplan.scenario.detours import Clearance, DetourFinder, clear_lines
from auvplan.scenario.waypoints import lines_clear, make_graph
from benchmarks import detours

#: A bay within a spit of land with a mouth in the north: 4 km by 4 km, pixels of 20 m.
SIZE, CELLS = 20.0, 200


def bay(mouth: int) -> OperatingArea:
    """A wall from south to north at 2 km east, but for `mouth` pixels in the north."""
    water = np.ones((CELLS, CELLS), bool)
    water[: CELLS - mouth, 95:105] = False
    jobs = Jobs(points=(JobPoint("inside", (500.0, 3000.0, 5.0), 3.0, 60.0),))
    return OperatingArea(chart=Chart.from_mask(water, SIZE), jobs=jobs)


def settings() -> Scenario:
    return Scenario.model_validate(
        {
            "chart": {"source": "none"},
            "area": {"lower": [0.0, 0.0, 0.0], "upper": [4000.0, 4000.0, 20.0]},
            "mission": {
                "jobs": "jobs.csv", "start": [500.0, 500.0, 5.0], "goal": [900.0, 500.0, 5.0],
                "waypoint_clearance": 100.0, "time_available": 20000.0,
            },
            "site": {"longitude": 149.0, "latitude": -20.0},
        }
    )  # fmt: skip


@pytest.mark.parametrize("mouth", [40, 8])
def test_a_job_behind_land_is_joined_by_a_way_around(mouth):
    area, scenario = bay(mouth), settings()
    graph, names = make_graph(scenario, area, np.random.default_rng(0))
    assert names[:2] == ["start", "inside"]
    assert names[-1] == "goal"
    assert all(name.startswith("(via ") for name in names[2:-1])
    assert [job.name for job in jobs_of(area.jobs)] == ["inside"]
    free = lines_clear(np.asarray(graph.positions), scenario, area)
    assert not free[0, 1]
    assert graph.adjacency[0, 1], "the way round is an edge of its own"
    among_jobs = ~np.array([name.startswith("(via ") for name in names])
    assert (free | ~np.asarray(graph.adjacency) | np.outer(among_jobs, among_jobs)).all()
    speed = scenario.vehicle.speed
    times = graph.leg_times(speed) - graph.duration
    from_start = np.where(np.asarray(graph.adjacency), times, np.inf)
    for middle in range(graph.size):  # Floyd and Warshall
        from_start = np.minimum(from_start, from_start[:, middle, None] + from_start[None, middle])
    corner = 4000.0 - mouth * SIZE
    shortest = np.hypot(corner - 500.0, 1400.0) + np.hypot(corner - 500.0, 900.0) + 200.0
    assert shortest / speed < from_start[0, 1] < 1.02 * shortest / speed


def test_water_without_an_outlet_is_still_refused():
    with pytest.raises(ValueError, match="no clear line and no detour leads from the start to 'inside'"):
        make_graph(settings(), bay(0), np.random.default_rng(0))


def test_the_waypoints_of_a_way_see_each_other():
    area, scenario = bay(20), settings()
    ends = np.array([[500.0, 500.0, 5.0], [500.0, 3500.0, 15.0]])
    way = DetourFinder(scenario, area)(*ends)
    places = np.concatenate([ends[:1], way, ends[1:]])
    assert clear_lines(places[:-1], places[1:], scenario, area).all()
    assert ((places[:, 2] >= 5.0) & (places[:, 2] <= 15.0)).all()
    assert DetourFinder(scenario, bay(0))(*ends) is None


def exercise_area(**closed) -> OperatingArea:
    """An area of 800 m by 1200 m in open water, on the chart or closed at some hours."""
    water = np.ones((CELLS, CELLS), bool)
    water[80:120, 70:130] = False
    chart = Chart.from_mask(water, SIZE)
    return OperatingArea(closures=(Closure(chart, **closed),)) if closed else OperatingArea(chart=chart)


def round_the_corners(margin: float) -> float:
    """Length of the shortest path from 1400 m to 2600 m east of the north-western corner's outside, m."""
    corners = [(2000.0, 1000.0), (2400.0 + margin, 1400.0 - margin), (2400.0 + margin, 2600.0 + margin)]
    return float(np.linalg.norm(np.diff([*corners, (2000.0, 3000.0)], axis=0), axis=1).sum())


def test_a_path_round_an_area_in_open_water_is_taut():
    ends = np.array([[2000.0, 1000.0, 5.0], [2000.0, 3000.0, 5.0]])
    ways = DetourFinder(settings(), exercise_area())
    ((way, clear),) = ways.paths(*ends)
    assert clear
    margin = settings().safety.coast
    assert round_the_corners(0.0) < ways.length(*ends) < 1.005 * round_the_corners(margin)
    np.testing.assert_array_equal(way[[0, -1]], ends)
    share = np.linspace(0.0, 1.0, 400)[:, None, None]
    fine = (way[:-1] * (1.0 - share) + way[1:] * share).reshape(-1, 3)
    assert (
        np.asarray(exercise_area().chart.distance(fine[:, 0], fine[:, 1])).min() > margin - 0.1
    )  # lines are looked up in steps
    np.testing.assert_array_equal(ways.paths(*ends[::-1])[0][0], way[::-1])


def test_an_edge_is_timed_round_an_area_while_it_is_closed_and_through_it_before():
    area = exercise_area(begins=np.array([3000.0]), ends=np.array([9000.0]))
    ends = np.array([[2000.0, 1000.0, 5.0], [2000.0, 3000.0, 5.0]])
    box = (np.asarray(corner, float) for corner in settings().box)
    env = Environment(UniformCurrent(0.0, 0.0), None, None, *box, closures=area.closures)
    vehicle, departs = ap.Vehicle(speed=2.0), np.array([0.0, 4000.0, 9500.0])
    trips = Trips(*(np.tile(end, (3, 1)) for end in ends), departs)
    detours = Detours(DetourFinder(settings(), area).paths)
    seconds, passable = travel_times(trips, env, vehicle, TravelTimeConfig(), detours=detours)
    assert passable.all()
    margin = settings().safety.coast
    assert seconds[[0, 2]] == pytest.approx(1000.0, rel=1e-3)
    assert seconds[1] == pytest.approx(0.5 * round_the_corners(margin), rel=0.005)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*lie in the same place:auvplan.errors.ScenarioWarning")
def test_plans_before_the_departure_find_the_nearer_passage_round_four_corners(tmp_path):
    """Between two closed areas; round both of them the leg takes an eighth longer."""
    row = detours.planned(detours.drawn(41001), 41001, tmp_path)
    assert row.priority == row.best
    assert row.time < 1.01 * row.least
    assert row.faults == ()


@pytest.mark.parametrize("seed", range(4))
def test_lines_are_clear_where_all_places_on_them_are(seed):
    """Lines from one to 4,000 m long, over land, closed areas and a sea bed with pits and banks."""
    rng = np.random.default_rng(seed)
    land, closed = (gaussian_filter(rng.normal(size=(80, 80)), 5.0) for _ in range(2))
    depth = 12.0 + 150.0 * gaussian_filter(rng.normal(size=(40, 40)), 2.0)
    area = OperatingArea(
        chart=Chart.from_mask(land < 0.06, 50.0),
        seabed=Seabed.from_depth(depth, 100.0, clearance=3.0),
        closures=(Closure(Chart.from_mask(closed < 0.08, 50.0), [0.0], [10.0]),),
    )
    starts = rng.uniform(0.0, 4000.0, (400, 3))
    ends = starts + rng.normal(size=(400, 3)) * 10.0 ** rng.uniform(0.0, 3.5, (400, 1))
    clearance = Clearance(settings(), area, 20.0, closed=True)
    x, y, _ = np.moveaxis(np.linspace(starts, ends, 200), -1, 0)
    gap = np.hypot(*(ends - starts).T[:2]) / 199
    clear = (clearance.room(x, y, gap) > 0.0).all(axis=0)
    assert 0.1 < clear.mean() < 0.9
    np.testing.assert_array_equal(clearance.lines(starts, ends), clear)


def test_a_way_past_a_bank_is_one_that_times_can_be_sampled_along():
    """Two banks whose tops stand out of the water: the way between them is timed without a fan of detours."""
    north, east = np.meshgrid(*(np.arange(100) * 40.0 + 20.0,) * 2, indexing="ij")
    depth = np.full(north.shape, 30.0)
    for place in ((1700.0, 1500.0), (2300.0, 2500.0)):
        depth -= 45.0 * np.exp(-(((north - place[0]) ** 2 + (east - place[1]) ** 2) / 500.0**2))
    area = OperatingArea(seabed=Seabed.from_depth(depth, 40.0, clearance=3.0))
    scenario = settings()
    ends = np.array([[1500.0, 400.0, 5.0], [2400.0, 3600.0, 5.0]])
    ways = DetourFinder(scenario, area)
    ((way, _),) = ways.paths(*ends)
    box = (np.asarray(corner, float) for corner in scenario.box)
    env = Environment(UniformCurrent(0.0, 0.0), None, None, *box, area.seabed)
    few = TravelTimeConfig(detours=1, detour_steps=0)
    asked = (Trips(*ends[:, None], np.zeros(1)), env, ap.Vehicle(speed=2.0), few)
    _, straight = travel_times(*asked, detours=None)
    seconds, passable = travel_times(*asked, detours=Detours(ways.paths))
    assert not straight[0]
    assert passable[0]
    assert seconds[0] == pytest.approx(ways.length(*ends) / 2.0, rel=0.01)
    assert ways.length(*ends) < 1.1 * np.linalg.norm(ends[1] - ends[0])
    assert len(way) > 2


def test_a_channel_of_four_pixels_through_a_shoal_is_found():
    depth = np.full((500, 500), 30.0)
    depth[:, 238:262] = 1.0
    depth[373:377, 238:262] = 30.0
    area = OperatingArea(seabed=Seabed.from_depth(depth, 8.0, clearance=3.0))
    ends = np.array([[3000.0, 500.0, 5.0], [2900.0, 3500.0, 5.0]])
    assert DetourFinder(settings(), area).length(*ends) == pytest.approx(3003.0, rel=1e-3)
