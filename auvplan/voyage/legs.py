"""Plans and sails one leg of each of B missions in lockstep, re-planning paths on the way (section 3.2.2)."""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.voyage.batching import chunks
from auvplan.voyage.belief import ObstacleBelief
from auvplan.voyage.evasion import escape_track
from auvplan.voyage.fleet import Fleet, Leg
from auvplan.voyage.path_calls import plan_legs
from auvplan.voyage.records import LegRecord
from auvplan.voyage.simulator import TIME_STEP, Sailed, over_ground, sail
from auvplan.voyage.world import TrueObstacles, draw_obstacles

Array = NDArray[np.floating]

#: Seconds ahead within which a believed collision makes the vehicle re-plan at once.
HORIZON = 180.0

#: Within this distance of its goal, m, a vehicle sails on without re-planning.
CLOSE = 40.0


def begin_legs(
    fleet: Fleet, missions: Sequence[int], records: Sequence[LegRecord], ends: Sequence[tuple]
) -> list[Leg]:
    """Set the obstacles of each leg, believe them roughly, and plan the first path of all in one call."""
    legs = []
    fleet.current.advance(fleet.now)
    sensors = fleet.scenario.sensors
    truths = [
        draw_obstacles(fleet.scenario, end[0], end[1], fleet.rngs[mission])
        for mission, end in zip(missions, ends, strict=True)
    ]
    moves = _over_ground(fleet, missions, truths)
    for k, (mission, record) in enumerate(zip(missions, records, strict=True)):
        record.obstacle_radii, record.obstacle_kinds = truths[k].radius, truths[k].kinds
        belief = ObstacleBelief(truths[k], moves[k], fleet.now[mission], sensors, fleet.rngs[mission])
        origin, target = (np.asarray(end) for end in ends[k])
        legs.append(Leg(mission, record, origin, target, truths[k], moves[k], belief))
    plan_legs(fleet, legs, "leg", cold=True)
    again = [leg for leg in legs if refusal(leg)]
    if again:
        plan_legs(fleet, again, "leg", cold=True)
    for leg in legs:
        start, share = fleet.now[leg.mission], leg.followed.travel_time / fleet.config.t_series
        leg.windows = [start + share * (k + 1) for k in range(fleet.config.t_series - 1)]
    return legs


def refusal(leg: Leg) -> str:
    """Why a leg must not be begun, or an empty string.

    Obstacles alone do not stand against it: they move, and are known better from near.
    """
    broken = [limit for limit in leg.followed.broken() if limit != "obstacle"]
    return leg.followed.explain(broken[0]) if broken else ""


def sail_legs(
    fleet: Fleet, legs: list[Leg], deadline: float, tick: Callable[[int, float], None] | None = None
) -> None:
    """Sail until every vehicle has arrived or its time is out; records are filled in.

    Args:
        fleet: the missions.
        legs: begun legs, at most one a mission.
        deadline: s, when a mission's time is out.
        tick: called with mission and time as vehicles advance.
    """
    steps = max(1, round(fleet.scenario.sensors.interval / TIME_STEP))
    while any(leg.under_way for leg in legs):
        _react(fleet, [leg for leg in legs if leg.under_way])
        fleet.current.advance(fleet.now)
        _advance(fleet, [leg for leg in legs if leg.under_way], steps)
        for leg in legs:
            if leg.under_way and fleet.now[leg.mission] >= deadline:
                leg.stopped = "time ran out"
            if tick:
                tick(leg.mission, fleet.now[leg.mission])
    for leg in legs:
        if leg.stretches:
            parts = [np.concatenate(part) for part in zip(*leg.stretches, strict=True)]
            leg.record.times, leg.record.positions, leg.record.obstacle_positions = parts


def _advance(fleet: Fleet, legs: list[Leg], steps: int) -> None:
    """One stretch between two looks: sail, move the obstacles, look."""
    for batch, real in chunks(legs):
        index = [leg.mission for leg in batch]
        out: Sailed = jax.device_get(
            sail(
                jnp.asarray(np.stack([leg.track for leg in batch])),
                jnp.asarray([leg.arc for leg in batch], float),
                jnp.asarray([leg.moving for leg in batch]),
                jnp.asarray(fleet.now[index], float),
                fleet.current.of(index),
                _stacked([leg.truth for leg in batch]),
                fleet.vehicle,
                steps,
            )
        )
        for row, leg in enumerate(batch[:real]):
            _take(fleet, leg, jax.tree.map(lambda a, row=row: a[row], out))


def _take(fleet: Fleet, leg: Leg, out: Sailed) -> None:
    """Book one vehicle's stretch."""
    times = np.asarray(out.times, float)
    # Time stands still after the arrival: keep the steps that moved it.
    fresh = np.diff(times, prepend=fleet.now[leg.mission]) > 0
    if not leg.stretches:
        first = (np.asarray([fleet.now[leg.mission]]), leg.origin[None], leg.truth.position[None])
        leg.stretches.append(first)
    leg.stretches.append(
        (times[fresh], np.asarray(out.positions, float)[fresh], np.asarray(out.obstacles, float)[fresh])
    )
    leg.truth.position = np.asarray(out.obstacles[-1], float)
    leg.moves = np.asarray(out.moves, float)
    leg.arc = float(out.arc)
    fleet.now[leg.mission] = float(times[-1])
    # The end of an escape is not the goal.
    leg.record.arrived = bool(out.arrived) and not leg.escaping
    if out.shortfall > 0 and leg.moving:
        leg.stopped = f"the current beat the vehicle {leg.arc / 1000.0:.1f} km along its path"


def _react(fleet: Fleet, legs: list[Leg]) -> None:
    """Look, and re-plan where a window begins or where the belief sees a collision ahead."""
    due: dict[str, list[Leg]] = {"window": [], "hazard": []}
    for leg in legs:
        now = float(fleet.now[leg.mission])
        if leg.stretches:
            leg.belief.look(leg.position, leg.truth, leg.moves, now)
        if np.linalg.norm(leg.target - leg.position) < CLOSE and leg.moving and not leg.escaping:
            continue
        window = bool(leg.windows) and now >= leg.windows[0]
        if window:
            leg.windows = [t for t in leg.windows if t > now]
        if _hazard(fleet, leg) or not leg.moving or leg.escaping:
            due["hazard"].append(leg)
        elif window:
            due["window"].append(leg)
    for cause, chosen in due.items():
        if chosen:
            plan_legs(fleet, chosen, cause)
    # What a warm plan cannot clear, a cold one may; what neither can, the vehicle waits for.
    stuck = [leg for chosen in due.values() for leg in chosen if _hazard(fleet, leg)]
    if stuck:
        plan_legs(fleet, stuck, "hazard", cold=True)
    for leg in stuck:
        if _hazard(fleet, leg):
            _give_way(fleet, leg)


def _hazard(fleet: Fleet, leg: Leg) -> bool:
    """Whether the belief sees the followed plan inside a collision boundary within the horizon."""
    plan, now = leg.followed, float(fleet.now[leg.mission])
    gaps = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1)
    marks = np.concatenate([[0.0], np.cumsum(gaps)])
    arc = 0.0 if leg.escaping else leg.arc
    # The sea may have made the vehicle late: what counts is the time left on the plan from where it is.
    times = now + plan.times - np.interp(arc, marks, plan.times)
    ahead = (marks >= arc - 1.0) & (times <= now + HORIZON)
    if not ahead.any():
        return False
    return bool(leg.belief.clearance(plan.positions[ahead], times[ahead]).min() < 0.0)


def _give_way(fleet: Fleet, leg: Leg) -> None:
    """Keep station, or escape where something comes too near."""
    area = fleet.scenario.area
    track = escape_track(
        leg.position,
        fleet.now[leg.mission],
        fleet.scenario.sensors.interval,
        leg.belief,
        fleet.chart,
        float(fleet.vehicle.speed),  # type: ignore[arg-type]
        np.asarray(area.lower),
        np.asarray(area.upper),
        fleet.config.samples,
    )
    leg.moving, leg.escaping = track is not None, track is not None
    if track is not None:
        leg.track, leg.arc = track, 0.0


def _stacked(truths: Sequence[TrueObstacles]) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Position, own velocity and drift of B sets of obstacles."""
    position, velocity, drift = (
        jnp.asarray(np.stack([getattr(truth, name) for truth in truths]), float)
        for name in ("position", "velocity", "drift")
    )
    return position, velocity, drift


def _over_ground(fleet: Fleet, missions: Sequence[int], truths: Sequence[TrueObstacles]) -> list[Array]:
    """True velocities of each leg's obstacles over ground, [M, 3] m/s."""
    moves: list[Array] = []
    for batch, real in chunks(list(zip(missions, truths, strict=True))):
        index = [mission for mission, _ in batch]
        out = over_ground(
            fleet.current.of(index),
            *_stacked([truth for _, truth in batch]),
            jnp.asarray(fleet.now[index], float),
        )
        moves.extend(np.asarray(out, float)[:real])
    return moves
