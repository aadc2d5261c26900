"""Jobs that land parts from each other: ways around join them."""

import numpy as np
import pytest

from auvplan.mission.jobs import JobPoint, Jobs, jobs_of
from auvplan.ocean.chart import Chart
from auvplan.scenario import OperatingArea, Scenario
from auvplan.scenario.waypoints import lines_clear, make_graph
from auvplan.scenario.ways import WaysAround, clear_lines

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
    assert [job.name for job in jobs_of(names)] == ["inside"]
    free = lines_clear(np.asarray(graph.positions), scenario, area)
    assert (free | ~np.asarray(graph.adjacency)).all(), "every edge is a clear straight line"
    assert not free[0, 1]
    times = graph.leg_times(2.0) - graph.duration
    from_start = np.where(np.asarray(graph.adjacency), times, np.inf)
    for middle in range(graph.size):  # Floyd and Warshall
        from_start = np.minimum(from_start, from_start[:, middle, None] + from_start[None, middle])
    corner = 4000.0 - mouth * SIZE
    shortest = np.hypot(corner - 500.0, 1400.0) + np.hypot(corner - 500.0, 900.0) + 200.0
    assert shortest / 2.0 < from_start[0, 1] < 1.25 * (shortest + 400.0) / 2.0


def test_water_without_an_outlet_is_still_refused():
    with pytest.raises(ValueError, match="no clear line and no way around leads from the start to 'inside'"):
        make_graph(settings(), bay(0), np.random.default_rng(0))


def test_the_waypoints_of_a_way_see_each_other():
    area, scenario = bay(20), settings()
    ends = np.array([[500.0, 500.0, 5.0], [500.0, 3500.0, 15.0]])
    way = WaysAround(scenario, area)(*ends)
    places = np.concatenate([ends[:1], way, ends[1:]])
    assert clear_lines(places[:-1], places[1:], scenario, area).all()
    assert ((places[:, 2] >= 5.0) & (places[:, 2] <= 15.0)).all()
    assert WaysAround(scenario, bay(0))(*ends) is None
