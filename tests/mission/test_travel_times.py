"""Travel times of a graph's edges: closed forms, closed edges, one compilation, stacks."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.mission import MissionGraph
from auvplan.mission.travel_times import Detours, TravelTimeConfig, Trips, travel_times
from auvplan.ocean.currents import UniformCurrent
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.seabed import Seabed
from auvplan.path.planner import sketch_paths
from auvplan.runtime.compiled import compilations
from tests.path.worlds import CONFIG

BOX = {"lower": (-3000.0, -3000.0, 0.0), "upper": (3000.0, 3000.0, 50.0)}
VEHICLE = ap.Vehicle(speed=2.5)


def compass(half: float = 1000.0) -> MissionGraph:
    """South, north, west and east, all linked; tasks of 30 s."""
    places = [[-half, 0.0, 10.0], [half, 0.0, 10.0], [0.0, -half, 10.0], [0.0, half, 10.0]]
    square = (4, 4)
    return MissionGraph(places, ~np.eye(4, dtype=bool), np.ones(square), np.full(square, 30.0))


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Stream:
    """A current to the north, and one that is stronger in the east, m/s."""

    everywhere: float
    sheared: float = 0.0

    steady = True

    def __call__(self, x, y, z, t):
        return self.everywhere + self.sheared * (1.0 + jnp.tanh(y / 300.0)), 0.0 * y, 0.0 * y


def northward(speed: float) -> ap.Environment:
    return ap.Environment(Stream(speed), **BOX)


def vortices(key: int) -> ap.LambVortices:
    return ap.random_vortices(jax.random.key(key), BOX["lower"], BOX["upper"], count=5, peak_speed=0.8)


def test_times_along_against_and_across_a_uniform_current() -> None:
    times = compass().with_travel_times(northward(0.5), VEHICLE).travel_time
    assert times[0, 1] == pytest.approx(2000.0 / 3.0, rel=1e-4)
    assert times[1, 0] == pytest.approx(2000.0 / 2.0, rel=1e-4)
    across = 2000.0 / np.sqrt(2.5**2 - 0.5**2)
    assert times[2, 3] == pytest.approx(across, rel=1e-4)
    assert times[3, 2] == pytest.approx(across, rel=1e-4)
    assert np.isnan(np.diag(times)).all()


def test_edges_too_steep_for_the_vehicle_take_as_long_as_winding() -> None:
    """No arc of a circle that may be turned is longer than the minor and shorter than the major one."""
    vehicle, level = ap.Vehicle(speed=2.0, turn_rate_max=0.1), [0.0, 1.0, 10.0, 20.0, 50.0]
    starts = np.array([[0.0, 0.0, 10.0]] * 5)
    goals = starts + np.array([[0.6 * apart, 0.8 * apart, 20.0] for apart in level])
    trips = Trips(starts, goals, np.zeros(5))
    seconds, passable = travel_times(trips, northward(0.0), vehicle, TravelTimeConfig())
    assert passable.all()
    arcs = 40.0 * (np.pi - np.arcsin(np.array(level[:4]) / 40.0))
    assert seconds[:4] == pytest.approx(np.hypot(arcs, 20.0) / 2.0, rel=1e-6)
    assert seconds[4] == pytest.approx(np.hypot(50.0, 20.0) / 2.0, rel=1e-4)
    nearly = Trips(starts, starts + np.array([0.3, 0.0, 0.3]), np.zeros(5))
    assert (travel_times(nearly, northward(0.0), vehicle, TravelTimeConfig())[0] == 1.0).all()


def test_only_edges_are_timed() -> None:
    graph = compass().without_edges([(0, 1)], both_ways=False)
    known = graph.with_travel_times(northward(0.5))
    assert np.isnan(known.travel_time[0, 1])
    np.testing.assert_array_equal(known.adjacency, graph.adjacency)


def test_a_current_that_beats_the_vehicle_closes_the_way_against_it() -> None:
    vehicle = ap.Vehicle(speed=2.5, surge_max=10.0)
    known = compass().with_travel_times(northward(3.0), vehicle)
    assert known.adjacency[0, 1]
    assert not known.adjacency[1, 0]
    assert np.isnan(known.travel_time[1, 0])
    assert np.isinf(known.leg_times(2.5)[1, 0])
    assert known.travel_time[0, 1] == pytest.approx(2000.0 / 5.5, rel=1e-4)


def wall(gap: float) -> ap.Environment:
    """Land along the y axis, 100 m thick, with open water beyond `gap` m from the middle."""
    x, y = np.meshgrid(*[np.arange(-2995.0, 3000.0, 10.0)] * 2, indexing="ij")
    chart = ap.Chart.from_mask(~((np.abs(x) < 50.0) & (np.abs(y) < gap)), 10.0, origin=(-3000.0, -3000.0))
    return ap.Environment(UniformCurrent(), chart, **BOX)


def test_land_closes_an_edge_that_cannot_go_round_it() -> None:
    graph = compass(800.0).without_edges([(2, 3), (2, 0), (2, 1), (3, 0), (3, 1)])
    closed = graph.with_travel_times(wall(3000.0))
    assert not closed.adjacency.any()
    round_it = graph.with_travel_times(wall(300.0))
    assert round_it.adjacency[0, 1]
    assert 1600.0 / 2.5 < round_it.travel_time[0, 1] < 1.5 * 1600.0 / 2.5


def bank(top: float) -> ap.Environment:
    """A bank across the middle from edge to edge, 300 m wide, in water of 100 m."""
    north = np.arange(-2985.0, 3000.0, 30.0)[:, None]
    depth = np.where(np.abs(north) < 150.0, top, 100.0) + np.zeros((1, 200))
    bed = Seabed.from_depth(depth, 30.0, (-3000.0, -3000.0), clearance=5.0)
    return ap.Environment(UniformCurrent(), seabed=bed, **BOX)


def test_a_bank_is_climbed_or_closes_an_edge() -> None:
    graph = compass(800.0).without_edges([(2, 3), (2, 0), (2, 1), (3, 0), (3, 1)])
    over = graph.with_travel_times(bank(9.0))
    assert over.adjacency[0, 1]
    assert over.travel_time[0, 1] == pytest.approx(1600.0 / 2.5, rel=0.01)
    assert not graph.with_travel_times(bank(4.0)).adjacency.any()


def over_a_sill(gap: float) -> ap.Environment:
    """Two layers that run against each other, over a sill below all but `gap` m of the straight way."""
    north, east = np.meshgrid(*(np.arange(-2985.0, 3000.0, 30.0),) * 2, indexing="ij")
    sill = (np.abs(north) < 400.0) & (np.abs(east) < gap)
    bed = Seabed.from_depth(np.where(sill, 18.0, 70.0), 30.0, (-3000.0, -3000.0), clearance=5.0)
    layers = np.array([-1.0, -1.0, 1.0, 1.0])[None, :, None, None] * np.ones((1, 4, 3, 3))
    depths, low = [0.0, 20.0, 25.0, 60.0], (-3000.0, -3000.0)
    current = GriddedCurrent.from_arrays(layers, 0.0 * layers, spacing=3000.0, origin=low, depths=depths)
    return ap.Environment(current, seabed=bed, **BOX)


@pytest.mark.slow
def test_an_edge_goes_round_what_keeps_it_out_of_the_better_layer() -> None:
    env, config = over_a_sill(300.0), TravelTimeConfig(path=CONFIG.replace(control_points=6))
    ends, asked = np.array([[[-1500.0, 0.0, 30.0]], [[1500.0, 0.0, 30.0]]]), []

    def sketch(starts, goals, departs):
        asked.append((starts, goals))
        return sketch_paths(starts, goals, departs, env, VEHICLE, CONFIG)

    trips, detours = Trips(*np.repeat(ends, 3, axis=1), 600.0 * np.arange(3.0)), Detours(sketch=sketch)
    straight, passable = travel_times(trips, env, VEHICLE, config)
    round_it, open_ = travel_times(trips, env, VEHICLE, config, detours=detours)
    plan = ap.plan_path(*ends[:, 0], env, VEHICLE, key=jax.random.key(0), config=CONFIG)
    assert passable.all()
    assert open_.all()
    # One pair of places is sketched once, for three departures.
    assert [len(starts) for starts, _ in asked] == [1]
    np.testing.assert_allclose(round_it, round_it[0], rtol=1e-4)
    assert round_it[0] < 0.95 * straight[0]
    assert plan.travel_time == pytest.approx(round_it[0], rel=0.05)
    # Where the better layer is open all the way, nothing is sketched.
    deep = travel_times(trips, over_a_sill(0.0), VEHICLE, config, detours=detours)[0]
    assert len(asked) == 1
    assert deep[0] < round_it[0]


def test_waypoints_outside_box_or_chart_have_no_edges() -> None:
    graph = compass(1600.0)
    small = ap.Environment(UniformCurrent(), lower=(-2000, -500, 0), upper=(2000, 500, 50))
    known = graph.with_travel_times(small)
    assert known.adjacency[0, 1]
    assert not known.adjacency[2:].any()
    assert not known.adjacency[:, 2:].any()


def test_obstacles_are_left_out() -> None:
    blocked = ap.Obstacles.static([[0.0, 0.0, 10.0]], [200.0])
    env = ap.Environment(UniformCurrent(0.3, 0.2, 0.0), None, blocked, **BOX)
    clear = ap.Environment(UniformCurrent(0.3, 0.2, 0.0), **BOX)
    one, other = (compass().with_travel_times(world).travel_time for world in (env, clear))
    np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_bending_to_the_current_only_shortens_and_comes_near_the_planned_path() -> None:
    env = ap.Environment(vortices(1), **BOX)
    straight = compass().with_travel_times(env, config=TravelTimeConfig(steps=0))
    bent = compass().with_travel_times(env, config=TravelTimeConfig(steps=8))
    edges = straight.adjacency & bent.adjacency
    assert (bent.travel_time[edges] <= straight.travel_time[edges] + 0.1).all()
    config = CONFIG.replace(control_points=6)
    graph = compass()
    for i, j in [(0, 1), (3, 2)]:
        ends = graph.positions[i], graph.positions[j]
        plan = ap.plan_path(*ends, env, key=jax.random.key(0), config=config)
        assert bent.travel_time[i, j] == pytest.approx(plan.travel_time, rel=0.03)


def test_a_later_call_compiles_nothing_and_repeats_itself() -> None:
    box = BOX | {"upper": (3000.0, 3000.0, 40.0)}
    first = compass().with_travel_times(ap.Environment(vortices(2), **box))
    compiled = compilations()
    again = compass().with_travel_times(ap.Environment(vortices(2), **box))
    smaller = compass(700.0).without_edges([(0, 1), (2, 3)])
    smaller.with_travel_times(ap.Environment(vortices(3), **box), ap.Vehicle(speed=2.0), depart=600.0)
    assert compilations() == compiled
    np.testing.assert_array_equal(first.travel_time, again.travel_time)


def test_stacked_graphs_equal_single_ones() -> None:
    seas = [vortices(4), vortices(5)]
    graphs = [compass(), compass(1500.0).without_edges([(0, 2)])]
    stacked = MissionGraph.stack(graphs).with_travel_times(
        ap.Environment(jax.tree.map(lambda *leaves: jnp.stack(leaves), *seas), **BOX), world_per_graph=True
    )
    shared = MissionGraph.stack(graphs).with_travel_times(ap.Environment(seas[0], **BOX))
    for row, (graph, sea) in enumerate(zip(graphs, seas, strict=True)):
        single = graph.with_travel_times(ap.Environment(sea, **BOX))
        np.testing.assert_array_equal(stacked.adjacency[row], single.adjacency)
        np.testing.assert_allclose(stacked.travel_time[row], single.travel_time, rtol=1e-5)
    np.testing.assert_allclose(shared.travel_time[0], stacked.travel_time[0], rtol=1e-5)


def test_a_time_dependent_current_counts_at_departure() -> None:
    def tide(x, y, z, t):
        return jnp.where(t < 5000.0, 0.5, -0.5), 0.0, 0.0

    env = ap.Environment(tide, **BOX)
    early, late = (compass().with_travel_times(env, depart=t).travel_time[0, 1] for t in (0.0, 6000.0))
    assert early == pytest.approx(2000.0 / 3.0, rel=1e-3)
    assert late == pytest.approx(2000.0 / 2.0, rel=1e-3)


CHANNEL = ap.Environment(Stream(0.0, 0.8), **BOX)


def test_bent_lines_save_time_with_the_stream_and_against_it() -> None:
    graph, env, departures = compass(), CHANNEL, np.linspace(0.0, 4000.0, 3)
    straight = graph.times_at(env, VEHICLE, departures)
    bent = graph.times_at(env, VEHICLE, departures, bends=2)
    assert (bent <= straight).all()
    for edge in ((0, 1), (1, 0)):
        assert bent[0, *edge] < 0.98 * straight[0, *edge]
    np.testing.assert_allclose(bent, np.tile(bent[:1], (3, 1, 1)), rtol=1e-4)  # the stream is steady


@pytest.mark.slow
def test_bent_lines_save_what_a_planned_path_saves() -> None:
    graph, env, departures = compass(), CHANNEL, np.linspace(0.0, 4000.0, 3)
    straight = graph.times_at(env, VEHICLE, departures)
    bent = graph.times_at(env, VEHICLE, departures, bends=2)
    for i, j in ((0, 1), (1, 0)):  # with the stream, and against it
        ends = graph.positions[i], graph.positions[j]
        plan = ap.plan_path(*ends, env, VEHICLE, key=jax.random.key(0), config=CONFIG)
        assert straight[0, i, j] > 1.03 * plan.travel_time
        assert bent[0, i, j] == pytest.approx(plan.travel_time, rel=0.01)


@pytest.mark.slow
def test_what_bending_saves_is_linear_between_departures() -> None:
    def tide(x, y, z, t):
        strength = 0.8 + 0.2 * jnp.sin(2.0 * jnp.pi * t / 20_000.0)
        return strength * (1.0 + jnp.tanh(y / 300.0)), 0.0, 0.0

    graph, env, departures = compass(), ap.Environment(tide, **BOX), np.linspace(0.0, 8000.0, 5)
    straight, bent = (graph.times_at(env, VEHICLE, departures, bends=bends) for bends in (0, 3))
    at = departures[[0, 2, 4]]
    saved = graph.times_at(env, VEHICLE, at, bends=3)[:, 0, 1] / straight[[0, 2, 4], 0, 1]
    expected = np.interp(departures, at, saved)
    assert np.ptp(saved) > 1e-3
    np.testing.assert_allclose(bent[:, 0, 1] / straight[:, 0, 1], expected, rtol=1e-6)


def test_a_uniform_stream_leaves_lines_straight_and_closed_edges_closed() -> None:
    departures = np.linspace(0.0, 4000.0, 3)
    straight, bent = (compass().times_at(northward(0.5), VEHICLE, departures, bends=b) for b in (0, 3))
    np.testing.assert_allclose(bent, straight, rtol=1e-3)
    against = northward(3.0)
    straight, bent = (compass().times_at(against, VEHICLE, departures, bends=b) for b in (0, 3))
    np.testing.assert_array_equal(np.isinf(bent), np.isinf(straight))


@pytest.mark.parametrize(
    ("changes", "message"), [({"steps": -1}, "at least 0"), ({"detours": 0}, "at least 1")]
)
def test_bad_settings_are_refused(changes, message) -> None:
    with pytest.raises(ValueError, match=message):
        TravelTimeConfig(**changes)


def test_a_world_per_graph_needs_stacked_graphs() -> None:
    with pytest.raises(ValueError, match="stacked along one axis"):
        compass().with_travel_times(northward(0.5), world_per_graph=True)


@pytest.mark.slow
def test_a_detour_found_at_one_departure_serves_the_others() -> None:
    """Times are those of each departure by itself, where one fan of detours is scored for all of them."""
    water = np.ones((300, 300), bool)
    water[140:160, 130:185] = False
    chart = ap.Chart.from_mask(water, 20.0, origin=(-3000.0, -3000.0))

    def tide(x, y, z, t):
        return 0.0 * x, 0.5 * jnp.cos(t / 4000.0) + 0.0 * x, 0.0 * x

    env = ap.Environment(tide, chart, **BOX)
    departs = np.linspace(0.0, 12_000.0, 5)
    start, goal = (np.tile(place, (5, 1)) for place in ([-1000.0, 0.0, 10.0], [1000.0, 0.0, 10.0]))
    seconds, passable = travel_times(Trips(start, goal, departs), env, VEHICLE, TravelTimeConfig())
    assert passable.all()
    for k in range(5):
        one = Trips(start[:1], goal[:1], departs[k : k + 1])
        alone, _ = travel_times(one, env, VEHICLE, TravelTimeConfig())
        assert seconds[k] == pytest.approx(alone[0], rel=0.02)
    assert np.ptp(seconds) > 0.005 * seconds.mean()


def test_departures_that_single_precision_rounds_are_refused() -> None:
    for times in (
        compass().with_travel_times,
        lambda *world, depart: compass().times_at(*world, [0.0, depart]),
    ):
        with pytest.raises(
            ValueError, match=r"^depart of 1.7e\+09 s is rounded to 128 s in single precision"
        ):
            times(northward(0.5), VEHICLE, depart=1.7e9)
