"""Plans and sails one leg of each of B missions in lockstep, re-planning paths on the way (section 3.2.2)."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.chart import Chart
from auvplan.ocean.environment import Environment
from auvplan.path import PathConfig, PathPlan, plan_paths, replan_paths
from auvplan.vehicle import Vehicle
from auvplan.voyage.batching import Clock, chunks
from auvplan.voyage.belief import ObstacleBelief, as_obstacles
from auvplan.voyage.evasion import escape_track
from auvplan.voyage.records import LegRecord, PlanRecord
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.simulator import TIME_STEP, Sailed, TrueCurrent, over_ground, sail
from auvplan.voyage.world import TrueObstacles, draw_obstacles

Array = NDArray[np.floating]

#: Seconds ahead within which a believed collision makes the vehicle re-plan at once.
HORIZON = 180.0

#: Within this distance of its goal, m, a vehicle sails on without re-planning.
CLOSE = 40.0


@dataclass
class Fleet:
    """B missions in one sea area: what they share, and each one's clock and sources of chance.

    Attributes:
        scenario: settings.
        config: of the path planner.
        vehicle: speed and limits.
        chart: coast, or None.
        current: the truth.
        keys: [B] planner keys.
        rngs: B generators for obstacles and sensors.
        now: [B] s.
        path_calls: [B] planning calls so far, which number the keys.
    """

    scenario: Scenario
    config: PathConfig
    vehicle: Vehicle
    chart: Chart | None
    current: TrueCurrent
    keys: jax.Array
    rngs: list[np.random.Generator]
    now: Array
    path_calls: NDArray[np.int_]
    clock: Clock = field(default_factory=Clock)

    def key(self, mission: int) -> jax.Array:
        """A fresh key for the mission's next path planning call."""
        self.path_calls[mission] += 1
        return jax.random.fold_in(self.keys[mission], int(self.path_calls[mission]))


@dataclass
class Leg:
    """One vehicle on its way between two waypoints."""

    mission: int
    record: LegRecord
    origin: Array
    target: Array
    truth: TrueObstacles
    moves: Array
    belief: ObstacleBelief
    plan: PathPlan | None = None
    track: Array = field(default_factory=lambda: np.zeros((0, 3)))
    arc: float = 0.0
    moving: bool = True
    escaping: bool = False
    windows: list[float] = field(default_factory=list)
    stopped: str = ""
    stretches: list[tuple[Array, Array, Array]] = field(default_factory=list)

    @property
    def position(self) -> Array:
        """[3] m, where the vehicle is."""
        return self.stretches[-1][1][-1] if self.stretches else self.origin

    @property
    def under_way(self) -> bool:
        return not self.record.arrived and not self.stopped


def begin_legs(fleet: Fleet, missions: Sequence[int], records: Sequence[LegRecord], ends: Sequence[tuple]) -> list[Leg]:
    """Set the obstacles of each leg, believe them roughly, and plan the first path of all in one call."""
    legs = []
    sensors = fleet.scenario.sensors
    truths = [
        draw_obstacles(fleet.scenario, *end, fleet.rngs[mission]) for mission, end in zip(missions, ends, strict=True)
    ]
    moves = _over_ground(fleet, missions, truths)
    for k, (mission, record) in enumerate(zip(missions, records, strict=True)):
        record.obstacle_radii, record.obstacle_kinds = truths[k].radius, truths[k].kinds
        belief = ObstacleBelief(truths[k], moves[k], fleet.now[mission], sensors, fleet.rngs[mission])
        legs.append(Leg(mission, record, *map(np.asarray, ends[k]), truths[k], moves[k], belief))
    _plan(fleet, legs, "leg")
    again = [leg for leg in legs if leg.plan is not None and not _sailable(leg.plan)]
    if again:
        _plan(fleet, again, "leg")
    for leg in legs:
        assert leg.plan is not None
        start, share = fleet.now[leg.mission], leg.plan.travel_time / fleet.config.t_series
        leg.windows = [start + share * (k + 1) for k in range(fleet.config.t_series - 1)]
    return legs


def _sailable(plan: PathPlan) -> bool:
    """Whether nothing but obstacles, which move and are known better from near, stands against the plan."""
    return plan.feasible or plan.status.name == "OBSTACLE"


def refusal(leg: Leg) -> str:
    """Why a leg must not be begun, or an empty string."""
    assert leg.plan is not None
    return "" if _sailable(leg.plan) else leg.plan.reason


def sail_legs(fleet: Fleet, legs: list[Leg], deadline: float, tick: Callable[[int, float], None] | None = None) -> None:
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
        index = np.asarray([leg.mission for leg in batch])
        out: Sailed = jax.device_get(
            sail(
                jnp.asarray(np.stack([leg.track for leg in batch])),
                jnp.asarray([leg.arc for leg in batch], float),
                jnp.asarray([leg.moving for leg in batch]),
                jnp.asarray(fleet.now[index], float),
                jax.tree.map(lambda a, index=index: a[index], fleet.current.field),
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
    leg.stretches.append((times[fresh], np.asarray(out.positions, float)[fresh], np.asarray(out.obstacles, float)[fresh]))
    leg.truth.position = np.asarray(out.obstacles[-1], float)
    leg.moves = np.asarray(out.moves, float)
    leg.arc = float(out.arc)
    fleet.now[leg.mission] = float(times[-1])
    # The end of an escape is not the goal.
    leg.record.arrived = bool(out.arrived) and not leg.escaping
    if out.shortfall > 0 and leg.moving:
        leg.stopped = "the current beat the vehicle"


def _react(fleet: Fleet, legs: list[Leg]) -> None:
    """Look, and re-plan where a window begins or where the belief sees a collision ahead."""
    due, causes = [], []
    for leg in legs:
        now = fleet.now[leg.mission]
        if leg.stretches:
            leg.belief.look(leg.position, leg.truth, leg.moves, now)
        if np.linalg.norm(leg.target - leg.position) < CLOSE and leg.moving and not leg.escaping:
            continue
        window = bool(leg.windows) and now >= leg.windows[0]
        if window:
            leg.windows = [t for t in leg.windows if t > now]
        if _hazard(leg, now) or not leg.moving or leg.escaping:
            due.append(leg)
            causes.append("hazard")
        elif window:
            due.append(leg)
            causes.append("window")
    for cause in ("window", "hazard"):
        chosen = [leg for leg, why in zip(due, causes, strict=True) if why == cause]
        if chosen:
            _plan(fleet, chosen, cause)
    # What a warm plan cannot clear, a cold one may; what neither can, the vehicle waits for.
    stuck = [leg for leg in due if _hazard(leg, fleet.now[leg.mission])]
    if stuck:
        _plan(fleet, stuck, "hazard", cold=True)
    for leg in stuck:
        if _hazard(leg, fleet.now[leg.mission]):
            _give_way(fleet, leg)


def _hazard(leg: Leg, now: float) -> bool:
    """Whether the belief sees the followed plan inside a collision boundary within the horizon."""
    if leg.plan is None:
        return True
    plan = leg.plan
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


def _plan(fleet: Fleet, legs: list[Leg], cause: str, cold: bool = False) -> None:
    """Plan paths from where the vehicles are: cold for a new leg, else from the kept population."""
    cold = cold or cause == "leg"
    area = fleet.scenario.area
    for batch, real in chunks(legs):
        index = [leg.mission for leg in batch]
        env = Environment(
            fleet.current.told(index, fleet.scenario.current.forecast_error),
            fleet.chart,
            as_obstacles([leg.belief for leg in batch], fleet.scenario.sensors),
            area.lower,  # type: ignore[arg-type]
            area.upper,  # type: ignore[arg-type]
        )
        fresh = {leg.mission: fleet.key(leg.mission) for leg in batch[:real]}
        keys = jnp.stack([fresh[mission] for mission in index])
        places = np.stack([np.clip(leg.position, area.lower, area.upper) for leg in batch])
        common: dict[str, Any] = {"key": keys, "config": fleet.config, "world_per_leg": True}
        if cold:
            goals = np.stack([leg.target for leg in batch])
            call = lambda: plan_paths(  # noqa: E731
                places, goals, env, fleet.vehicle, depart=fleet.now[index], **common
            )
        else:
            old = [leg.plan for leg in batch]
            call = lambda: replan_paths(  # noqa: E731
                old, places, fleet.now[index], env, fleet.vehicle, **common
            )
        signature = ("path", cold, len(batch), fleet.config, len(batch[0].truth.radius), fleet.chart is None)
        plans, seconds = fleet.clock.time(signature, call)
        for leg, plan in zip(batch[:real], plans, strict=False):
            _follow(fleet, leg, plan, cause, seconds / real)


def _follow(fleet: Fleet, leg: Leg, plan: PathPlan, cause: str, seconds: float) -> None:
    """Take a new plan unless it is worse than the one being followed."""
    history = {
        name: np.asarray(getattr(plan.history, name))
        for name in ("best", "mean", "std", "violation_best", "violation_mean", "violation_std")
    }
    now = float(fleet.now[leg.mission])
    record = PlanRecord(
        now, plan.positions, plan.times, plan.feasible, cause, seconds, history, fleet.current.at(leg.mission)
    )
    leg.record.plans.append(record)
    leg.plan, leg.track, leg.arc = plan, plan.positions, 0.0
    leg.moving, leg.escaping = True, False


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
        index = np.asarray([mission for mission, _ in batch])
        field = jax.tree.map(lambda a, index=index: a[index], fleet.current.field)
        out = over_ground(field, *_stacked([truth for _, truth in batch]), jnp.asarray(fleet.now[index], float))
        moves.extend(np.asarray(out, float)[:real])
    return moves
