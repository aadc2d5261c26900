"""Why a path will not do: the limit, its value, the place and the time."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.bbo import History
from auvplan.ocean.seabed import Seabed
from auvplan.path import VIOLATIONS, PathPlan
from auvplan.path.sensitivity import Conditions
from tests.path.kernels import evaluate, through, violations

BOX = (-500.0, -500.0, 0.0), (4500.0, 2500.0, 200.0)
CONFIG = ap.PathConfig()
#: 4 km north and then, by a sharp bend, 100 m east.
BEND = np.array([[0.0, 0.0, 30.0], [4000.0, 0.0, 30.0], [4000.0, 100.0, 30.0]])


def along(corners, count=41):
    """[S, 3] m, evenly along straight lines between corners, the same number on each."""
    share = np.linspace(0.0, len(corners) - 1, (len(corners) - 1) * (count - 1) + 1)
    return np.stack(
        [np.interp(share, np.arange(len(corners)), np.asarray(corners)[:, k]) for k in range(3)], 1
    )


def followed(positions, depart=0.0, vehicle=None, leg=None, **world) -> PathPlan:
    """A plan along given positions, as it fares."""
    vehicle = vehicle or ap.Vehicle(turn_rate_max=100.0)
    current = world.pop("current", None)
    env = ap.Environment(current, **{"lower": BOX[0], "upper": BOX[1]} | world)  # type: ignore[arg-type]
    track = through(*(positions[:, k, None] for k in range(3)))
    trajectory = jax.device_get(evaluate(track, depart, env, vehicle, CONFIG))
    none = np.zeros(0)
    return PathPlan(
        float(trajectory.travel_time[0]), float(trajectory.length[0]), np.asarray(positions),
        np.asarray(trajectory.times[:, 0]), positions, np.asarray(violations(trajectory)[:, 0]),
        float(trajectory.clearance.min()), float(trajectory.altitude.min()), 0.0, jnp.zeros((0, 0)),
        History(*[none] * 6), np.stack(trajectory.excess)[:, :, 0],
        np.stack(trajectory.water, axis=-1)[:, 0], Conditions(env, vehicle, CONFIG, leg),
    )  # fmt: skip


LINE = along([[0.0, 0.0, 30.0], [4100.0, 0.0, 30.0]], 83)


def jet(strength, east=0.0):
    """A current that is strong in the segment around 2.3 km north alone."""

    def current(x, y, z, t):
        inside = jnp.abs(x - 2325.0) < 25.0
        return jnp.where(inside, strength, 0.0), jnp.where(inside, east, 0.0), 0.0 * x

    return current


def test_sway_names_value_limit_place_and_time():
    plan = followed(LINE, current=jet(0.0, 1.9))
    assert plan.broken() == ("sway",)
    # 2325 m at 2.5 m/s, of which the last 25 m are slower.
    middle = 2300.0 / 2.5 + 25.0 / np.sqrt(2.5**2 - 1.9**2)
    assert plan.reason == (
        f"cross-current 1.9 m/s over 1.5 at km 2.3 of 4.1, at {middle:,.0f} s: {ap.PathStatus.SWAY.value}"
    )
    assert plan.explain("sway") == plan.reason


def test_surge():
    plan = followed(LINE, current=jet(2.8))
    assert plan.status is ap.PathStatus.SURGE
    assert plan.reason.startswith("ground speed 5.3 m/s over 5.0 at km 2.3 of 4.1, at ")


@pytest.mark.parametrize(
    ("north", "east", "words"),
    [
        (-3.0, 0.0, "current 3.0 m/s against the track beats the vehicle's 2.5 m/s"),
        (-2.0, 1.6, "current 2.0 m/s against and 1.6 m/s across the track beats the vehicle's 2.5 m/s"),
        (0.5, -2.9, "current 0.5 m/s along and 2.9 m/s across the track beats the vehicle's 2.5 m/s"),
    ],
)
def test_current(north, east, words):
    plan = followed(LINE, vehicle=ap.Vehicle(sway_max=9.0), current=jet(north, east))
    assert plan.broken() == ("current",)
    assert plan.reason.startswith(f"{words} at km 2.3 of 4.1, at ")


def test_current_of_one_leg_of_a_batch():
    currents = [ap.UniformCurrent(*(jnp.asarray(c) for c in (u, 0.0, 0.0))) for u in (1.0, -3.0)]
    plan = followed(LINE, vehicle=ap.Vehicle(sway_max=9.0), current=currents[1])
    both = jax.tree.map(lambda *leaves: jnp.stack(leaves), *currents)
    none = jax.tree.map(lambda leaf: jnp.stack([leaf, leaf]), ap.Obstacles.none())
    env = ap.Environment(both, None, none, *BOX)  # type: ignore[arg-type]
    batched = replace(plan, conditions=replace(plan.conditions, env=env, leg=1))
    assert batched.reason == plan.reason
    assert plan.reason.startswith("current 3.0 m/s against the track")


def test_turn_rate():
    # 90 degrees between segments of 100 m and 2.5 m, so 41 s / 2 apart.
    plan = followed(along(BEND), vehicle=ap.Vehicle(turn_rate_max=np.radians(4.0)))
    rate = 90.0 / (0.5 * (100.0 + 2.5) / 2.5)
    assert plan.status is ap.PathStatus.TURN_RATE
    assert plan.reason.startswith(f"turn rate {rate:.1f} deg/s over 4.0 at km 4.0 of 4.1, at ")


DIVE = along([[0.0, 0.0, 30.0], [2000.0, 0.0, 30.0], [2100.0, 0.0, 130.0], [4100.0, 0.0, 130.0]], 21)


def test_pitch():
    plan = followed(DIVE)
    assert plan.status is ap.PathStatus.PITCH
    assert plan.reason.startswith("dives at 45.0 deg, limit 30.0 at km 2.0 of 4.1, at 80")
    assert plan.reason.endswith(ap.PathStatus.PITCH.value)
    assert followed(DIVE[::-1]).reason.startswith("climbs at 45.0 deg, limit 30.0 at km 2.0 of 4.1, at ")
    close = ap.Vehicle(turn_rate_max=100.0, pitch_max=np.radians(44.96))
    assert followed(DIVE, vehicle=close).reason.startswith("dives at 45.00 deg, limit 44.96 at ")


def test_vertical_speeds():
    plan = followed(DIVE, vehicle=ap.Vehicle(pitch_max=None, climb_rate_max=0.5, dive_rate_max=1.0))
    assert plan.broken() == ("dive",)
    assert plan.reason.startswith(f"dives at {2.5 * np.sqrt(0.5):.1f} m/s, limit 1.0 at km 2.0 of 4.1, at ")
    up = followed(DIVE[::-1], vehicle=ap.Vehicle(pitch_max=None, climb_rate_max=0.5))
    assert up.reason.startswith("climbs at 1.8 m/s, limit 0.5 at ")


def test_coast():
    water = np.ones((500, 300), bool)
    water[200:210, 53:] = False  # 30 m east of the line, from 1.5 to 1.6 km north
    plan = followed(LINE, chart=ap.Chart.from_mask(water, 10.0, BOX[0][:2]))
    least = plan.clearance
    assert 0.0 < least < 10.0
    assert plan.reason.startswith(f"clearance of the coast {least:.1f} m under 10.0 at km 1.")


def test_obstacle():
    rock = ap.Obstacles.static([[3000.0, 42.0, 30.0]], [40.0])
    plan = followed(LINE, obstacles=rock)
    assert plan.reason.startswith("clearance of the obstacles' boundaries 2.0 m under 5.0 at km 3.0 of 4.1")
    inside = followed(LINE, obstacles=ap.Obstacles.static([[3000.0, 0.0, 30.0]], [40.0]))
    assert "boundaries -40.0 m under 5.0" in inside.reason


def test_seabed():
    depth = np.full((250, 150), 80.0)
    depth[84:, :] = 33.2  # from 1.18 km north on, and around there for what looks ahead
    bed = Seabed.from_depth(depth, 20.0, BOX[0][:2], clearance=5.0)
    plan = followed(LINE, seabed=bed)
    assert plan.status is ap.PathStatus.SEABED
    assert plan.altitude == pytest.approx(3.2, abs=1e-3)
    assert plan.reason.startswith("altitude above the sea bed 3.2 m under 5.0 at km 1.")
    assert plan.reason.endswith(ap.PathStatus.SEABED.value)


def test_close_values_are_told_apart():
    plan = followed(LINE, current=jet(0.0, 1.52))
    assert plan.reason.startswith("cross-current 1.52 m/s over 1.50 at ")


def test_times_of_day():
    plan = followed(LINE, depart=3.0 * 3600.0, current=jet(0.0, 1.9))  # there after 15 min 36 s
    epoch = datetime(2024, 5, 1)
    assert "km 2.3 of 4.1, 03:15 UTC: the current" in plan.explain("sway", epoch)
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
