"""What is given wrongly is refused in one line that names the argument, before anything is planned."""

import datetime as dt
from dataclasses import replace

import jax
import numpy as np
import pytest

import auvplan as ap
from auvplan.energy import PowerLaw, PowerModel, PowerTable
from auvplan.mission import TravelTimeConfig, random_graph
from auvplan.mission.speeds import SpeedOptions
from auvplan.mission.timetable import Timetable
from auvplan.ocean import CurrentUpdate
from auvplan.path import Penalties
from auvplan.path.energy import plan_least_energy
from auvplan.runtime.arguments import numbers

KEY, NAN = jax.random.key(0), float("nan")
A, B = (0, 0, 0), (2000, 0, 0)
STILL = ap.Environment(None, lower=(-500, -500, 0), upper=(2500, 1500, 0))
ONES, PLANE = np.ones((2, 2)), np.zeros((1, 1, 2, 2))
GRAPH = random_graph(
    np.random.default_rng(0), np.random.default_rng(0).uniform(0, 1000, (4, 3)), neighbours=2
)
TWO = ap.MissionGraph.stack([GRAPH, GRAPH])


def refused(call, kind, words):
    with pytest.raises(kind) as found:
        call()
    assert words in str(found.value)
    assert "\n" not in str(found.value)


MOMENTS = {
    "depart of a path": ("depart", lambda t: ap.plan_path(A, B, STILL, key=KEY, depart=t)),
    "depart of paths": ("depart", lambda t: ap.plan_paths([A, A], [B, B], STILL, key=KEY, depart=t)),
    "depart of a track": ("depart", lambda t: ap.travel_time([A, B], STILL, depart=t)),
    "depart of a graph": ("depart", lambda t: GRAPH.with_travel_times(STILL, depart=t)),
    "depart of a scenario": ("depart", lambda t: ap.plan_scenario(ap.Scenario(), depart=t)),
    "now": ("now", lambda t: ap.replan_path(PLAN, A, t, STILL, key=KEY)),
    "time": ("time_available", lambda t: ap.plan_mission(GRAPH, 0, 3, t, speed=2.0, key=KEY)),
    "times": ("time_available", lambda t: ap.plan_missions(TWO, [0, 0], [3, 3], t, speed=2.0, key=KEY)),
}
PLAN = object.__new__(ap.PathPlan)


@pytest.mark.parametrize("name", MOMENTS)
@pytest.mark.parametrize(
    ("moment", "kind", "words"),
    [
        (np.timedelta64(1, "h"), TypeError, "must be given in numbers, got timedelta64: give seconds"),
        (dt.timedelta(hours=1), TypeError, "must be given in numbers, got timedelta: give seconds"),
        (np.datetime64("2024-01-01"), TypeError, "must be given in numbers, got datetime64: give seconds"),
        (dt.datetime(2024, 1, 1), TypeError, "must be given in numbers, got datetime: give seconds"),
        (None, TypeError, "must be given in numbers, got None"),
        ("3600", TypeError, "must be given in numbers, got '3600'"),
        (NAN, ValueError, "must be finite"),
        (float("inf"), ValueError, "must be finite"),
    ],
)
def test_times_are_finite_seconds(name, moment, kind, words):
    argument, call = MOMENTS[name]
    refused(lambda: call(moment), kind, f"{argument} {words}")


@pytest.mark.parametrize(
    ("settings", "field", "value", "words"),
    [
        (ap.PathConfig, "speed_reading", "eq81", "must be one of ('track', 'eq8', 'eq11'), got 'eq81'"),
        (ap.PathConfig, "speed_reading", None, "got None"),
        (ap.PathConfig, "start_shape", "smoth", "must be one of ('smooth', 'uniform'), got 'smoth'"),
        (ap.PathConfig, "samples", 160.0, "must be a whole number, got 160.0"),
        (ap.PathConfig, "samples", "160", "must be a whole number, got '160'"),
        (ap.PathConfig, "quadrature", 1.5, "must be a whole number or None, got 1.5"),
        (ap.PathConfig, "sampled", 1, "must be True or False, got 1"),
        (ap.PathConfig, "width", NAN, "must be a number, got nan"),
        (ap.PathConfig, "coast_margin", -5.0, "must be at least 0, got -5.0"),
        (ap.PathConfig, "fresh_share", 1.5, "must be in [0, 1], got 1.5"),
        (ap.PathConfig, "bbo", ap.MissionConfig(), "must be a BBOConfig"),
        (ap.PathConfig, "penalties", 10.0, "must be a Penalties"),
        (Penalties, "coast", "1000", "must be a number, got '1000'"),
        (Penalties, "coast", -1.0, "must be at least 0"),
        (ap.MissionConfig, "decoder", "rates", "must be one of ('paper', 'timely', 'rate')"),
        (ap.MissionConfig, "objective", "eq51", "must be one of ('priority', 'eq15')"),
        (ap.MissionConfig, "saves", "money", "must be one of ('time', 'energy')"),
        (ap.MissionConfig, "seeds", 2.5, "must be a whole number"),
        (ap.MissionConfig, "plant", "no", "must be True or False"),
        (ap.bbo.BBOConfig, "mutation", "cauchy", "must be one of ('uniform', 'gaussian', None)"),
        (ap.bbo.BBOConfig, "immigration", "1", "must be a number"),
        (TravelTimeConfig, "detours", 0, "must be at least 1"),
        (TravelTimeConfig, "path", ap.MissionConfig(), "must be a PathConfig"),
        (CurrentUpdate, "center_std", -1.0, "must be at least 0"),
    ],
)
def test_settings_are_of_their_kind(settings, field, value, words):
    refused(lambda: settings(**{field: value}), ValueError, f"{field} ")
    refused(lambda: settings(**{field: value}), ValueError, words)


def paths(**changes):
    given = {"starts": [A] * 3, "goals": [B] * 3, "env": STILL, "key": KEY} | changes
    return ap.plan_paths(given.pop("starts"), given.pop("goals"), given.pop("env"), **given)


def mission(*, graph=GRAPH, start=0, goal=3, time=900.0, **changes):
    return ap.plan_mission(graph, start, goal, time, **({"speed": 2.0, "key": KEY} | changes))


def missions(**changes):
    given = {"time_available": [900.0] * 2, "speed": 2.0, "key": KEY, "starts": [0, 0]} | changes
    return ap.plan_missions(TWO, goals=[3, 3], **given)


def graph(**changes):
    fields = {"positions": np.zeros((2, 3)), "adjacency": ONES, "priority": ONES, "duration": ONES}
    return ap.MissionGraph(**(fields | changes))


def timetable(count=1, **changes):
    return Timetable(**({"departures": np.zeros(count), "travel_time": np.zeros((count, 2, 2))} | changes))


def vortices(**changes):
    fields = {"centers": np.zeros((2, 1, 2)), "strength": np.ones((2, 1)), "radius": np.ones((2, 1))}
    return ap.LambVortices(**(fields | changes))


def minimize(**changes):
    return ap.bbo.minimize(*changes.pop("given", (sum, [0.0], [1.0])), **({"key": KEY} | changes))


WORLDS = ap.Environment(ap.UniformCurrent(*np.zeros((3, 2))), **{"lower": (-500, -500, 0)})
KEYS = jax.random.split(KEY)
AFLOAT = ap.Obstacles.afloat([(500, 0, 0)] * 3, [10.0] * 3)
STACKED = ap.UniformCurrent(*np.zeros((3, 3)))
HOURS = np.full((2, 2), np.timedelta64(1, "h"))
MASK = np.ones((5, 5), bool)


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: paths(key=KEYS), ValueError, "key must be one, or [3], one for each leg, got shape (2,)"),
        (lambda: paths(key=jax.random.split(KEY, 4)), ValueError, "one for each leg, got shape (4,)"),
        (lambda: paths(depart=[0.0, 1.0]), ValueError, "depart must be one number or [3], got shape (2,)"),
        (
            lambda: paths(env=WORLDS, world_per_leg=True),
            ValueError,
            "current must be stacked along a lea",
        ),
        (lambda: paths(env=STILL, world_per_leg=True), ValueError, "[3], one for each leg"),
        (
            lambda: paths(env=ap.Environment(STACKED), world_per_leg=True),
            ValueError,
            "obstacles must be stacked along a leading axis [3]",
        ),
        (
            lambda: paths(env=ap.Environment(STACKED, obstacles=AFLOAT), world_per_leg=True),
            ValueError,
            "obstacles must be stacked",
        ),
        (lambda: paths(starts=[("0", "0", "0")] * 3), TypeError, "starts must be given in numbers, got '0'"),
        (lambda: paths(starts=[A, A, (0, 0)]), ValueError, "starts must be an array of numbers, got rows of"),
        (lambda: paths(config=ap.MissionConfig()), TypeError, "config must be a PathConfig, got Mission"),
        (lambda: paths(budget=dt.timedelta(seconds=1)), TypeError, "budget must be given in numbers"),
        (lambda: paths(budget=float("inf")), ValueError, "budget must be positive and finite"),
        (lambda: ap.plan_path(("0", 0, 0), B, STILL, key=KEY), TypeError, "start must be given in numbers"),
        (lambda: ap.plan_path(A, B, STILL, key=KEYS), ValueError, "one for each leg, got shape (2,)"),
        (lambda: ap.replan_paths([], np.zeros((0, 3)), 0.0, STILL, key=KEY), ValueError, "at least one"),
        (lambda: ap.replan_path(3, A, 0.0, STILL, key=KEY), TypeError, "plan must be a PathPlan, got int"),
        (lambda: ap.travel_time([A, (NAN, 0, 0)], STILL), ValueError, "points must be finite"),
        (lambda: ap.travel_time([A, B], STILL, depart=[0.0, 1.0]), ValueError, "depart must be one number"),
        (
            lambda: ap.travel_time([A, B], STILL, speed_reading="eq81"),
            ValueError,
            "speed_reading must be",
        ),
        (
            lambda: plan_least_energy(
                A, B, STILL, ap.Vehicle(power=PowerModel(PowerLaw(1, 1))), key=KEY, price=-1
            ),
            ValueError,
            "price must not be negative",
        ),
        (lambda: mission(key=KEYS), ValueError, "key must be one, got shape (2,)"),
        (lambda: mission(speed="1.5"), TypeError, "speed must be given in numbers, got '1.5'"),
        (lambda: mission(graph=None), TypeError, "graph must be a MissionGraph, got NoneType"),
        (lambda: mission(config=ap.PathConfig()), TypeError, "config must be a MissionConfig, got Path"),
        (lambda: mission(method="exat"), ValueError, "method must be one of ('search', 'exact'), got 'exat'"),
        (lambda: mission(method="exact", time_limit=-1.0), ValueError, "time_limit must be positive"),
        (lambda: mission(start=[0, 1]), ValueError, "start must be one index or [1], got shape (1, 2)"),
        (lambda: mission(budget="1"), TypeError, "budget must be given in numbers, got '1'"),
        (lambda: mission(known_route=[]), ValueError, "known_route must lead from 0 to 3"),
        (lambda: mission(visited=["a"] * 4), TypeError, "visited must be given in numbers"),
        (lambda: missions(key=jax.random.split(KEY, 3)), ValueError, "one for each mission, got shape (3,)"),
        (lambda: missions(starts=[0, 0, 0]), ValueError, "start must be one index or [2], got shape (3,)"),
        (lambda: missions(time_available=[9.0] * 3), ValueError, "time_available must be one number or [2]"),
        (lambda: missions(return_margin=-0.1), ValueError, "return_margin must not be negative"),
        (lambda: ap.replan_mission(3, GRAPH, 0, 9.0, key=KEY), TypeError, "route must be a MissionRoute"),
        (lambda: ap.MissionGraph.stack([]), ValueError, "at least one graph, got []"),
        (lambda: ap.MissionGraph.stack([GRAPH, graph()]), ValueError, "got [4, 2]"),
        (lambda: GRAPH.with_travel_times(STILL, 2.5), TypeError, "give ap.Vehicle(speed=2.5)"),
        (
            lambda: TWO.with_travel_times(ap.Environment(STACKED), world_per_graph=True),
            ValueError,
            "current must be stacked along a leading axis [2], one for each graph",
        ),
        (lambda: GRAPH.with_travel_time(0, 1, HOURS[0, 0]), TypeError, "seconds must be given in numbers"),
        (lambda: GRAPH.with_timetable(3), TypeError, "timetable must be a Timetable"),
        (lambda: graph(positions=[("1", "2", "3")] * 2), TypeError, "positions must be given in numbers"),
        (lambda: graph(adjacency=np.full((2, 2), "0")), TypeError, "adjacency must be given in numbers"),
        (lambda: graph(adjacency=ONES * NAN), ValueError, "adjacency must be True or False"),
        (lambda: graph(priority=np.full((2, 2), "1")), TypeError, "priority must be given in numbers"),
        (lambda: graph(duration=HOURS), TypeError, "duration must be given in numbers, got timedelta64"),
        (lambda: graph(timetable=3), TypeError, "timetable must be a Timetable, got int"),
        (lambda: timetable(0), ValueError, "travel_time must be [M, N, N] s, M at least 1"),
        (lambda: timetable(departures=[NAN]), ValueError, "departures must be finite"),
        (lambda: timetable(departures=HOURS[0, :1]), TypeError, "departures must be given in numbers"),
        (
            lambda: timetable(opens=np.full((2, 2, 1), NAN), closes=np.ones((2, 2, 1))),
            ValueError,
            "opens must not be NaN",
        ),
        (lambda: SpeedOptions(["1"], [1.0], ONES[None], ONES), TypeError, "speeds must be given in numbers"),
        (lambda: ap.Site(0.0, 500.0), ValueError, "latitude in [-90, 90] degrees, got 0.0"),
        (lambda: ap.Site(NAN, 0.0), ValueError, "site longitude must be in"),
        (lambda: ap.Site("149", -20.0), TypeError, "site longitude and latitude must be given in numbers"),
        (lambda: ap.Site(149.0, -20.0, "2024-01-01"), TypeError, "site epoch must be a datetime or None"),
        (lambda: ap.Site(149.0, -20.0, origin=(1.0,)), ValueError, "site origin must be two finite numbers"),
        (
            lambda: ap.Environment(None, lower=("0",) * 3),
            TypeError,
            "environment lower must be given in",
        ),
        (lambda: ap.Environment(None, AFLOAT), TypeError, "chart must be a Chart, got Obstacles: give ap.Ch"),
        (lambda: ap.Environment(None, obstacles=[A]), TypeError, "obstacles must be an Obstacles, got list"),
        (lambda: ap.Environment(None, seabed=50.0), TypeError, "seabed must be a Seabed, got float"),
        (lambda: ap.Environment(None, closures=[3]), TypeError, "closures must be a tuple of Closure"),
        (lambda: ap.UniformCurrent("0.3"), TypeError, "u must be given in numbers, got '0.3'"),
        (lambda: ap.Obstacles.static([("1", "2", "3")], [1.0]), TypeError, "positions must be given in"),
        (
            lambda: ap.Obstacles.static([1, 2], [1.0]),
            ValueError,
            "positions must be [M, 3] m, got shape",
        ),
        (
            lambda: ap.Obstacles.self_motivated([A], [1.0], (1, 2)),
            ValueError,
            "velocity must be [3] or [1",
        ),
        (
            lambda: ap.Obstacles.static([A], [1.0], observed_at=HOURS[0]),
            TypeError,
            "observed_at must be",
        ),
        (lambda: ap.Chart.from_mask(MASK, origin=(1, 2, 3)), ValueError, "origin must be (north, east)"),
        (lambda: ap.Chart.from_mask(MASK, pixel_size="10"), TypeError, "pixel_size must be given in numbers"),
        (lambda: ap.Chart.from_mask(MASK, pixel_size=(9, 9)), ValueError, "one number for north and east"),
        (lambda: ap.Chart.from_mask([["w", "l"]]), TypeError, "water must be given in numbers, got 'w'"),
        (lambda: ap.Seabed.from_depth(MASK, 10, clearance="5"), TypeError, "clearance must be given in numb"),
        (lambda: ap.Seabed.from_depth(MASK, 10, clearance=NAN), ValueError, "clearance must be one number"),
        (
            lambda: ap.GriddedCurrent.from_arrays(PLANE, PLANE, spacing="100"),
            ValueError,
            "spacing must be given in numbers, got '100'",
        ),
        (
            lambda: vortices(strength=np.ones((2, 3))),
            ValueError,
            "strength must be of shape (2, 1), with c",
        ),
        (lambda: vortices(centers=np.zeros((2, 2))), ValueError, "centers must be of shape (2, 2, 2)"),
        (lambda: vortices(radius=np.zeros((2, 1))), ValueError, "radius must be positive"),
        (lambda: vortices(depths=[5.0, 0.0]), ValueError, "depths must rise, m"),
        (lambda: vortices(strength=[["1"], ["1"]]), TypeError, "strength must be given in numbers, got '1'"),
        (lambda: vortices(uniform=(1.0, 0.0)), ValueError, "uniform must be of shape (3,)"),
        (lambda: ap.random_vortices(KEY, A, B, layers=0), ValueError, "layers at least 1, got 12 and 0"),
        (
            lambda: ap.random_vortices(KEY, B, (0, 9, 0)),
            ValueError,
            "lower and upper must be (x, y, z) m",
        ),
        (
            lambda: ap.random_vortices(KEY, A, (9, 9, 0), radius=(5, 1)),
            ValueError,
            "radius and peak_speed must be",
        ),
        (lambda: ap.random_vortices(KEYS, A, (9, 9, 0)), ValueError, "key must be one, got shape (2,)"),
        (lambda: PowerTable(["0", "1"], [1, 2]), TypeError, "propulsion speeds must be given in numbers"),
        (lambda: PowerModel(40.0), TypeError, "power propulsion must be a PowerTable or PowerLaw"),
        (lambda: PowerModel(PowerLaw(1, 1), battery=900.0), TypeError, "give Battery(900.0)"),
        (lambda: minimize(given=(sum, [], [])), ValueError, "bounds must be vectors of one length, at least"),
        (lambda: minimize(config=ap.PathConfig()), TypeError, "config must be a BBOConfig, got PathConfig"),
        (
            lambda: minimize(given=(lambda x: None, [0.0], [1.0])),
            ValueError,
            "(cost [P], violation [P]), got N",
        ),
        (lambda: minimize(given=(lambda x: (x,), [0.0], [1.0])), ValueError, "got 1 values"),
        (lambda: minimize(stop=NAN), ValueError, "stop must be one number or None, got nan"),
        (lambda: minimize(args=3.0), TypeError, "args must be a tuple, got float: give (args,)"),
        (lambda: ap.run_mission("whitsunday", seed=0), TypeError, "scenario must be a Scenario, got str: gi"),
        (lambda: ap.run_mission(ap.Scenario(), seed="0"), ValueError, "a seed is a whole number"),
        (
            lambda: ap.run_missions(ap.Scenario(), seeds=3),
            ValueError,
            "seeds must be [B] whole numbers, got 3",
        ),
        (lambda: ap.run_mission(ap.Scenario(), seed=1.5), ValueError, "got 1.5"),
        (lambda: ap.run_missions(ap.Scenario(), keys=KEY), ValueError, "keys must be [B], got shape ()"),
        (lambda: ap.plan_scenario(ap.Scenario(), key=3), TypeError, "key must be a PRNG key, got 3"),
        (lambda: ap.plan_scenario({}), TypeError, "scenario must be a Scenario, got dict"),
        (lambda: ap.load_area("whitsunday"), TypeError, "scenario must be a Scenario, got str"),
        (lambda: ap.study.Design(ap.Scenario(), 2.5), ValueError, "count and seed must be whole numbers"),
        (
            lambda: ap.study.Design(ap.Scenario(), 2, 0, (ap.study.Sweep("vehicle.speed", ()),)),
            ValueError,
            "sweep of vehicle.speed: give at least one value",
        ),
    ],
)
def test_what_is_wrong_is_named(call, kind, words):
    refused(call, kind, words)


def test_numbers_may_be_of_any_kind_that_is_one():
    assert numbers("times", np.array([1], "m8[h]"), durations=True).tolist() == [3600.0]
    assert numbers("mask", [True, False]).tolist() == [1.0, 0.0]
    assert numbers("half", jax.numpy.ones(2, jax.numpy.bfloat16)).tolist() == [1.0, 1.0]


@pytest.mark.parametrize("given", [np.float64(149.0), np.float32(149.0), 149])
def test_a_site_is_at_numbers_of_any_kind(given):
    site = ap.Site(given, np.float32(-20.0), dt.datetime(2024, 1, 1), origin=np.array([5.0, 0.0]))
    assert np.allclose(site.to_local(149.0, -20.0), [5.0, 0.0])
    assert site == ap.Site(149.0, -20.0, dt.datetime(2024, 1, 1), (5.0, 0.0))
    assert hash(site)
    assert site.seconds(dt.datetime(2024, 1, 1, 1, tzinfo=dt.UTC)) == 3600.0


def test_a_violation_below_zero_is_none():
    """A limit that is kept with room to spare is kept, and no better than one that is just kept."""

    def answer(violation):
        fun = lambda x: ((x[:, 0] - 3.0) ** 2, violation(x[:, 0] - 1.5))  # noqa: E731
        return minimize(given=(fun, [0.0], [4.0]), config=ap.bbo.BBOConfig(population=20, iterations=10))

    found, clipped = answer(lambda over: over), answer(lambda over: jax.numpy.maximum(over, 0.0))
    assert float(found.violation) == float(clipped.violation) == 0.0
    assert float(found.x[0]) == float(clipped.x[0]) <= 1.5
    assert float(found.state.violation.min()) >= 0.0


def timed(graph):
    return graph.with_timetable(Timetable(np.zeros(1), (graph.leg_times(2.0) - graph.duration)[None]))


def at_speeds(graph):
    times = np.stack([graph.leg_times(speed) - graph.duration for speed in (1.0, 2.0)])
    return replace(graph, options=SpeedOptions([1.0, 2.0], [10.0, 40.0], times, 0.0 * graph.duration))


@pytest.mark.parametrize("goal", [0, 3])
@pytest.mark.parametrize("of", [lambda graph: graph, timed, at_speeds])
def test_in_negative_time_no_mission_is_possible(of, goal):
    """A vehicle that is late asks as well: it is told by how much."""
    quick = ap.MissionConfig(bbo=ap.bbo.BBOConfig(population=30, iterations=1), local_rounds=0)
    changes = {} if of is not at_speeds else {"speed": None, "energy_available": 1e6}
    route = mission(graph=of(GRAPH), goal=goal, time=-5.0, config=quick, **changes)
    assert route.status.name == "OUT_OF_TIME"
    assert "-5.0 s are available" in route.reason
    assert route.bound == 0.0
    assert len(route.nodes) == 1


@pytest.mark.parametrize(
    "make",
    [
        vortices,
        graph,
        timetable,
        lambda: ap.Environment(None),
        lambda: ap.Chart.from_mask(MASK),
        lambda: ap.Seabed.from_depth(MASK, 10.0),
        lambda: ap.Obstacles.static([A], [1.0]),
        lambda: ap.GriddedCurrent.from_arrays(PLANE, PLANE, spacing=10.0),
        lambda: object.__new__(ap.PathPlan),
        lambda: object.__new__(ap.PathPlans),
        lambda: object.__new__(ap.MissionRoute),
        lambda: object.__new__(ap.MissionRun),
        lambda: object.__new__(ap.bbo.Result),
    ],
)
def test_what_holds_arrays_is_compared_by_identity(make):
    one, other = make(), make()
    assert one == one, "and not by its arrays, whose truth is ambiguous"
    assert one != other
    assert len({one, other}) == 2
