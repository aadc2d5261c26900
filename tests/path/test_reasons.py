"""Why a path will not do: the limit, its value, the place and the time."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.ocean.closures import Closure
from auvplan.ocean.seabed import Seabed
from auvplan.path import VIOLATIONS, PathPlan
from auvplan.path.sensitivity import Conditions
from tests.path.kernels import Jet, fields_of, through

BOX = (-500.0, -500.0, 0.0), (4500.0, 2500.0, 200.0)
CONFIG = ap.PathConfig()
#: 4 km north and then, by a sharp bend, 100 m east.
BEND = np.array([[0.0, 0.0, 30.0], [4000.0, 0.0, 30.0], [4000.0, 100.0, 30.0]])


def along(corners, segments=84):
    """[S, 3] m, evenly along straight lines between corners, the same number on each: one program for all."""
    share = np.linspace(0.0, len(corners) - 1, segments + 1)
    return np.stack([np.interp(share, np.arange(len(corners)), axis) for axis in np.transpose(corners)], 1)


def followed(positions, depart=0.0, vehicle=None, leg=None, current=None, **world) -> PathPlan:
    """A plan along given positions, as it fares."""
    vehicle = vehicle or ap.Vehicle(turn_rate_max=100.0)
    env = ap.Environment(current or jet(0.0), **{"lower": BOX[0], "upper": BOX[1]} | world)
    track = through(*(positions[:, k, None] for k in range(3)))
    fields = jax.device_get(fields_of(track, depart, env, vehicle, CONFIG))
    conditions = Conditions(env, vehicle, CONFIG, leg)
    return PathPlan.unsearched(conditions, fields.pop("excess"), **fields, cost=0.0, control_points=positions)


LINE = along([[0.0, 0.0, 30.0], [4200.0, 0.0, 30.0]])
DIVE = along([[0.0, 0.0, 30.0], [2000.0, 0.0, 30.0], [2100.0, 0.0, 130.0], [4100.0, 0.0, 130.0]])


def jet(strength, east=0.0):
    """A current that is strong in the segment around 2.3 km north alone."""
    return Jet((strength, east, 0.0), 2325.0, 25.0)


def vehicle(**limits):
    return ap.Vehicle(**{"turn_rate_max": 100.0} | limits)


def sphere(east):
    return ap.Obstacles.static([[3000.0, east, 30.0]], [40.0])


#: deg/s, 90 degrees between segments of 95 m and 2.4 m.
TURN = 90.0 / (0.5 * 4100.0 / 42.0 / 2.5)
SLOW = {"vehicle": vehicle(sway_max=9.0)}
STEEP = {"vehicle": vehicle(pitch_max=None, climb_rate_max=0.5, dive_rate_max=1.0)}


@pytest.mark.parametrize(
    ("path", "world", "broken", "words"),
    [
        (LINE, {"current": jet(2.8)}, "surge", "ground speed 5.3 m/s over 5.0 at km 2.3 of 4.2, at "),
        (
            LINE,
            {"current": jet(-3.0)} | SLOW,
            "current",
            "current 3.0 m/s against the track beats the vehicle's 2.5 m/s at km 2.3 of 4.2, at ",
        ),
        (
            LINE,
            {"current": jet(-2.0, 1.6)} | SLOW,
            "current",
            "current 2.0 m/s against and 1.6 m/s across the track beats the vehicle's 2.5 m/s at km 2.3",
        ),
        (
            LINE,
            {"current": jet(-2.47)} | SLOW,
            "current",
            "current 2.47 m/s against the track leaves 0.03 m/s of the vehicle's 2.50 m/s, less than 0.12",
        ),
        (
            LINE,
            {"current": jet(-2.5)} | SLOW,
            "current",
            "current 2.500 m/s against the track leaves 0.000 m/s of the vehicle's 2.500 m/s",
        ),
        (
            LINE,
            {"current": jet(0.0, 2.498)} | SLOW,
            "current",
            "current 2.50 m/s across the track leaves 0.10 m/s of the vehicle's 2.50 m/s, less than 0.12 at ",
        ),
        (LINE, {"current": jet(0.0, 1.52)}, "sway", "cross-current 1.52 m/s over 1.50 at "),
        (
            along(BEND),
            {"vehicle": vehicle(turn_rate_max=np.radians(4.0))},
            "turn_rate",
            f"turn rate {TURN:.1f} deg/s over 4.0 at km 4.0 of 4.1, at ",
        ),
        (DIVE, {}, "pitch", "dives at 45.0 deg, limit 30.0 at km 2."),
        (DIVE[::-1], {}, "pitch", "climbs at 45.0 deg, limit 30.0 at km 2."),
        (
            DIVE,
            {"vehicle": vehicle(pitch_max=np.radians(44.96))},
            "pitch",
            "dives at 45.00 deg, limit 44.96 at ",
        ),
        (DIVE, STEEP, "dive", f"dives at {2.5 * np.sqrt(0.5):.1f} m/s, limit 1.0 at km 2."),
        (DIVE[::-1], STEEP, "climb", "climbs at 1.8 m/s, limit 0.5 at "),
        (
            LINE,
            {"obstacles": sphere(42.0)},
            "obstacle",
            "clearance of the obstacles' boundaries 2.0 m under 5.0 at km 3.0 of 4.2",
        ),
        (
            LINE,
            {"obstacles": sphere(0.0)},
            "obstacle",
            "clearance of the obstacles' boundaries -40.0 m",
        ),
    ],
)
def test_the_limit_that_is_broken_is_named_with_its_value_and_place(path, world, broken, words):
    plan = followed(path, **world)
    assert plan.broken() == (broken,)
    assert plan.status is ap.PathStatus[broken.upper()]
    assert plan.reason.startswith(words)
    assert plan.reason.endswith(plan.status.value)


def test_sway_names_value_limit_place_and_time():
    plan = followed(LINE, current=jet(0.0, 1.9))
    # 2325 m at 2.5 m/s, of which the last 25 m are slower.
    middle = 2300.0 / 2.5 + 25.0 / np.sqrt(2.5**2 - 1.9**2)
    assert plan.reason == plan.explain("sway")
    assert plan.reason == (
        f"cross-current 1.9 m/s over 1.5 at km 2.3 of 4.2, at {middle:,.0f} s: {ap.PathStatus.SWAY.value}"
    )


def test_current_of_one_leg_of_a_batch():
    currents = [ap.UniformCurrent(*(jnp.asarray(c) for c in (u, 0.0, 0.0))) for u in (1.0, -3.0)]
    plan = followed(LINE, **SLOW, current=currents[1])
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *currents)
    none = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), ap.Obstacles.none())
    env = ap.Environment(both, None, none, *BOX)  # type: ignore[arg-type]
    batched = replace(plan, conditions=replace(plan.conditions, env=env, leg=1))
    assert batched.reason == plan.reason
    assert plan.reason.startswith("current 3.0 m/s against the track")


def test_waiting_is_advised_where_an_obstacle_moves():
    still, place = sphere(0.0), [[3000.0, 0.0, 30.0]]
    assert "wait" not in followed(LINE, obstacles=still).reason
    for moving in (
        ap.Obstacles.afloat(place, [400.0]),
        ap.Obstacles.self_motivated(place, [400.0], [0.0, 0.01, 0.0]),
    ):
        assert followed(LINE, obstacles=moving).reason.endswith("or wait")


def test_coast():
    water = np.ones((500, 300), bool)
    water[200:210, 53:] = False  # 30 m east of the line, from 1.5 to 1.6 km north
    plan = followed(LINE, chart=ap.Chart.from_mask(water, 10.0, BOX[0][:2]))
    least = plan.clearance
    assert 0.0 < least < 10.0
    assert plan.reason.startswith(f"clearance of the coast {least:.1f} m under 10.0 at km 1.")


@pytest.mark.parametrize(("hours", "said"), [((100.0, 900.0), True), ((-900.0, 0.0), False)])
def test_what_is_closed_on_the_straight_line_is_named_whatever_limit_is_broken(hours, said):
    """A path that circles until an area opens turns too sharply; what it waits for is said too."""
    land = np.zeros((50, 30), bool)
    land[20:25] = True
    chart = ap.Chart.from_mask(~land, 100.0, (-500.0, -500.0))
    area = Closure(chart, *(np.array([moment]) for moment in hours), name="firing range")
    plan = followed(along(BEND), vehicle=ap.Vehicle(turn_rate_max=0.1), closures=(area,))
    reason = plan.explain("turn_rate")
    assert "turn rate" in reason
    assert reason.endswith("; on the straight line firing range is closed until 900 s") == said
    assert ("firing range" in reason) == said


def test_seabed():
    depth = np.full((250, 150), 80.0)
    depth[84:, :] = 33.2  # from 1.18 km north on, and around there for what looks ahead
    bed = Seabed.from_depth(depth, 20.0, BOX[0][:2], clearance=5.0)
    plan = followed(LINE, seabed=bed)
    assert plan.status is ap.PathStatus.SEABED
    assert plan.altitude == pytest.approx(3.2, abs=1e-3)
    assert plan.reason.startswith("altitude above the sea bed 3.2 m under 5.0 at km 1.")
    assert plan.reason.endswith(ap.PathStatus.SEABED.value)


def test_times_of_day():
    plan = followed(LINE, depart=3.0 * 3600.0, current=jet(0.0, 1.9))  # there after 15 min 36 s
    epoch = datetime(2024, 5, 1)
    assert "km 2.3 of 4.2, 03:15 UTC: the current" in plan.explain("sway", epoch)
    assert "03:15 UTC" in plan.explain("sway", epoch.replace(tzinfo=UTC))
    east = datetime(2024, 5, 1, 2, 0, tzinfo=timezone(timedelta(hours=2)))
    assert ", 03:15 UTC: " in plan.explain("sway", east)
    assert "2024-05-02 00:05 UTC" in plan.explain("sway", datetime(2024, 5, 1, 20, 50))


def test_what_keeps_every_limit_says_so_and_unknown_limits_are_refused():
    plan = followed(LINE)
    assert plan.feasible
    assert plan.reason == "feasible path found"
    with pytest.raises(ValueError, match=r"limit must be one of surge, sway, .*, got 'depth'"):
        plan.explain("depth")
    assert tuple(status.name.lower() for status in ap.PathStatus)[1:-1] == VIOLATIONS
