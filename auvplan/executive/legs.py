"""Plans and executes the legs of B missions, re-planning paths on the way (section 3.2.2)."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import datetime

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.executive.belief import ObstacleBelief
from auvplan.executive.context import Leg, Mission, SimulationContext
from auvplan.executive.decide import Act, Facts, Phase, decide
from auvplan.executive.path_calls import plan_legs
from auvplan.executive.replans import Review, detours, hazard, holds, replan, review
from auvplan.mission.travel_times import ONE_PLACE
from auvplan.path.motion import Motion
from auvplan.records import LegRecord
from auvplan.runtime.rows import padded_batches
from auvplan.simulation.faults import HeldUp, Obstacle, PlannerOut, SensorOut, absent, appear
from auvplan.simulation.sea import stacked
from auvplan.simulation.simulator import TIME_STEP, WIDTH, Transit, over_ground, padded_rows, transit
from auvplan.simulation.world import TrueObstacles, draw_obstacles

Array = NDArray[np.floating]

#: Within this distance of its goal, m, a vehicle goes on without re-planning.
CLOSE = 40.0


def begin_legs(context: SimulationContext, missions: list[Mission], records: Sequence[LegRecord]) -> None:
    """Set the obstacles of each mission's leg, believe them roughly, and plan all first paths in one call."""
    for mission, record in zip(missions, records, strict=True):
        set_out(context, mission, record)
    plan_legs(context, missions, ["leg"] * len(missions), cold=True)
    again = [mission for mission in missions if refusal(mission.active_leg)]
    if again:
        plan_legs(context, again, ["leg"] * len(again), cold=True)
    for mission in missions:
        mission.active_leg.record.followed = len(mission.active_leg.record.plans) - 1
    if context.rules.second_look and context.simulated:
        _replan_optimistically(context, [mission for mission in missions if detours(mission.active_leg)])
    parts = context.path_config.t_series
    for mission in missions:
        share = mission.active_leg.followed.travel_time / parts
        mission.active_leg.windows = [mission.now + share * (k + 1) for k in range(parts - 1)]


def set_out(
    context: SimulationContext, mission: Mission, record: LegRecord, position: Array | None = None
) -> None:
    """Put a mission on a leg between two waypoints, or from a position [3] m to the second; no path yet."""
    origin, target = (np.asarray(mission.graph.positions[k]) for k in (record.start, record.goal))
    record.line = mission.parts.get((record.start, record.goal))
    encounter(context, mission, record, origin if position is None else position, target)


def encounter(
    context: SimulationContext, mission: Mission, record: LegRecord, origin: Array, target: Array
) -> None:
    """Put a mission on a leg between two places [3] m: its true obstacles, and what is believed of them."""
    mission.sea.advance(mission.now)
    truth = TrueObstacles.known(context.known_obstacles(mission.now))
    if context.simulated and float(np.linalg.norm(target - origin)) > ONE_PLACE:
        truth = draw_obstacles(context.scenario, origin, target, mission.rng) + truth
    if context.simulated:
        truth += absent(mission.faults.places)
    record.obstacle_radii, record.obstacle_kinds = truth.radius, truth.kinds
    moves = over_ground(mission.sea.field, *truth.motion, now=mission.now)
    belief = ObstacleBelief(truth, moves, mission.now, context.scenario.sensors, mission.rng)
    mission.leg = Leg(record, origin, target, truth, moves, belief)
    if context.simulated:
        look(mission)


def look(mission: Mission) -> NDArray[np.bool_]:
    """Measure the obstacles of a mission's leg that are in sight; return which they are, [M]."""
    leg, blind = mission.active_leg, mission.faults.left(SensorOut, mission.now) > 0.0
    return leg.belief.look(leg.position, leg.truth, leg.moves, mission.now, blind)


def _replan_optimistically(context: SimulationContext, missions: list[Mission]) -> None:
    """Look for a shorter path past obstacles as they will be seen from near, in boundaries that do not grow.

    On a way around an island for the sake of an obstacle that is far away, a vehicle gives up the time that
    a second look could save: what is in the way when it comes into sensor range is planned around then.
    """
    if not missions:
        return
    before = [mission.active_leg.followed for mission in missions]
    plan_legs(context, missions, ["leg"] * len(missions), cold=True, growing=False)
    for mission, plan in zip(missions, before, strict=True):
        leg = mission.active_leg
        if refusal(leg) or leg.followed.travel_time > plan.travel_time:
            leg.follow(plan)
        else:
            leg.record.followed = len(leg.record.plans) - 1


def refusal(leg: Leg, epoch: datetime | None = None) -> str:
    """Return why a leg must not be begun, or an empty string; times of day count from the epoch.

    Obstacles that are not certain do not stand against it: they move, and are known better from near.
    """
    broken = [limit for limit in leg.followed.broken() if limit != "obstacle" or leg.belief.certain]
    return leg.followed.explain(broken[0], epoch) if broken else ""


def unfit(context: SimulationContext, mission: Mission, leg: Leg) -> str:
    """Return why a leg cannot be begun whatever time is left, or an empty string."""
    return refusal(leg, context.epoch) or _crossing(context, mission, leg)


def _crossing(context: SimulationContext, mission: Mission, leg: Leg) -> str:
    """Return what known obstacle comes to the goal of a leg during its task, or an empty string."""
    timetable, margin = mission.graph.timetable, context.scenario.safety.obstacles
    for obstacle in (known for known in context.area.obstacles if known.moves):
        record, arrives = leg.record, float(leg.followed.times[-1])
        begins = arrives if timetable is None else timetable.begins(record.start, record.goal, arrives)
        ends = (begins if np.isfinite(begins) else arrives) + record.t_task
        when, apart = obstacle.closest(leg.target, arrives, ends)
        if apart < margin:
            where = f"{obstacle.name} comes within {margin:g} m of its goal"
            return f"{where} {context.moment(when)}, while the vehicle is there"
    return ""


def advance(context: SimulationContext, missions: list[Mission]) -> None:
    """One stretch of every mission's leg: look, re-plan where it is due, and advance to the next look."""
    for mission in missions:
        mission.sea.advance(mission.now)
        if mission.faults and mission.active_leg.stretches:
            let_appear(mission, _tangent(mission.active_leg))
    _react(context, missions)
    steps = max(1, round(context.scenario.sensors.interval / TIME_STEP))
    for batch, real in _batches(missions):
        legs = [mission.active_leg for mission in batch]
        fields = [mission.sea.field for mission in batch]
        rows = [[padded_rows(part) for part in leg.truth.motion] for leg in legs[:real]]
        motions = zip(*rows, *rows[:1] * (len(legs) - real), strict=True)
        out: Transit = jax.device_get(
            transit(
                _stacked([leg.track for leg in legs], context.path_config.samples),
                np.asarray([leg.arc for leg in legs]),
                np.asarray([_is_moving(mission) for mission in batch]),
                np.asarray([mission.now for mission in batch]),
                stacked(fields),
                tuple(np.stack(part) for part in motions),
                context.vehicle,
                np.asarray([mission.faults.speed(mission.now) for mission in batch]),
                steps=steps,
            )
        )
        for row, mission in enumerate(batch[:real]):
            _take(context, mission, jax.tree.map(lambda a, row=row: a[row], out))
    for mission in missions:
        if mission.active_leg.under_way and mission.now >= context.scenario.mission.time_available:
            mission.active_leg.stopped = "time ran out"


def go_as_planned(context: SimulationContext, missions: list[Mission]) -> None:
    """Go every mission's leg to its end along its path, in the time that is planned for it."""
    for mission in missions:
        leg, plan = mission.active_leg, mission.active_leg.followed
        times, places = np.asarray(plan.times, float), np.asarray(plan.positions, float)
        since = (times - mission.now)[:, None, None]
        obstacles = leg.truth.position + since * leg.truth.velocity
        ground = np.diff(places, axis=0) / np.diff(times)[:, None]
        leg.stretches.append((times, places, obstacles, ground, np.asarray(plan.water, float)))
        leg.arc, leg.record.arrived = float(leg.marks[-1]), True
        mission.now = float(times[-1])


def _stacked(tracks: list[Array], samples: int) -> Array:
    """[B, S, 3] m, tracks that keep station at their ends; of few shapes, whatever detours there are."""
    most = max(len(track) for track in tracks)
    if most > samples:
        most = samples * 2 ** int(np.ceil(np.log2(most / samples)))
    return np.stack([np.pad(track, ((0, most - len(track)), (0, 0)), mode="edge") for track in tracks])


def _batches(missions: list[Mission]) -> Iterator[tuple[list[Mission], int]]:
    """Batches of one size, padded by their first mission, and how many of each are real."""
    for index, real in padded_batches(len(missions), (WIDTH,)):
        yield [missions[k] for k in index], real


def _take(context: SimulationContext, mission: Mission, out: Transit) -> None:
    """Book one vehicle's stretch."""
    leg, times, moving = mission.active_leg, np.asarray(out.times, float), _is_moving(mission)
    # Time stands still after the arrival: keep the steps that moved it.
    fresh = np.diff(times, prepend=mission.now) > 0
    if not leg.stretches:
        start = np.asarray([mission.now]), leg.origin[None], leg.truth.position[None]
        leg.stretches.append((*start, np.zeros((0, 3)), np.zeros((0, 3))))
    present = len(leg.truth.radius)
    positions, obstacles, ground, water = (
        np.asarray(part, float)[fresh]
        for part in (out.positions, out.obstacles[:, :present], out.ground, out.water)
    )
    leg.stretches.append((times[fresh], positions, obstacles, ground, water))
    leg.truth.position = np.asarray(out.obstacles[-1, :present], float)
    leg.moves = np.asarray(out.moves[:present], float)
    leg.arc = float(out.arc)
    mission.now = float(times[-1])
    # The end of an escape is not the goal.
    leg.record.arrived = bool(out.arrived) and not leg.escaping
    if out.shortfall > 0 and moving:
        place = f"km {leg.arc / 1000.0:.1f} of {leg.marks[-1] / 1000.0:.1f}"
        leg.stopped = f"the current beat the vehicle at {place}, {context.moment(mission.now)}"


def finish(leg: Leg) -> None:
    """Write what was executed into the leg's record."""
    parts = [np.concatenate(part) for part in zip(*leg.stretches, strict=True)]
    leg.record.times, leg.record.positions, leg.record.obstacle_positions, ground, water = parts
    # The velocity of a step holds from its first record on; the arrival keeps that of the last step.
    if len(ground):
        ground, water = (np.concatenate([part, part[-1:]]) for part in (ground, water))
        leg.record.motion = Motion.through_water(ground, water)
    else:
        leg.record.motion = Motion.none(len(leg.record.times))


def _react(context: SimulationContext, missions: list[Mission]) -> None:
    """Look, and re-plan or give way where that is decided."""
    due: list[Review] = []
    for mission in missions:
        leg = mission.active_leg
        if leg.stretches:
            look(mission)
        if np.linalg.norm(leg.target - leg.position) < CLOSE and leg.moving and not leg.escaping:
            continue
        window = bool(leg.windows) and mission.now >= leg.windows[0]
        if window:
            leg.windows = [t for t in leg.windows if t > mission.now]
            mission.sea.begin_window()
        facts = _facts(mission, window)
        act = decide(facts).act
        if act is Act.GIVE_WAY:
            _give_way(context, mission)
        elif act is Act.REPLAN_LEG:
            urgent = bool(facts.hazard) or facts.held
            one = review(context, mission, "hazard" if urgent else "window")
            if urgent or not holds(context, one):
                due.append(one)
    if due:
        replan(context, due)
    for one in due:
        # What no plan can clear the vehicle waits for, or gives way to.
        if decide(replace(_facts(one.mission), planner=False)).act is Act.GIVE_WAY:
            _give_way(context, one.mission)


def _facts(mission: Mission, window: bool = False) -> Facts:
    """Return what is known of a mission on a leg that is simulated here."""
    leg = mission.active_leg
    return Facts(
        Phase.HELD if leg.escaping or not leg.moving else Phase.UNDER_WAY,
        hazard="an obstacle is ahead" if hazard(mission) else "",
        window=window,
        uploads=False,
        planner=not mission.faults.left(PlannerOut, mission.now),
    )


def let_appear(mission: Mission, tangent: Array) -> None:
    """Let the obstacles appear that are due before a vehicle that goes along a tangent [3] of its track."""
    leg = mission.active_leg
    for fault in mission.faults.due(Obstacle, mission.now):
        appear(fault, leg.truth, [part[2] for part in leg.stretches], leg.position, tangent)
        leg.record.obstacle_radii = leg.truth.radius
        leg.moves = over_ground(mission.sea.field, *leg.truth.motion, now=mission.now)


def _tangent(leg: Leg) -> Array:
    ahead, behind = (np.clip(leg.arc + way, 0.0, leg.marks[-1]) for way in (5.0, -5.0))
    ends = [np.interp([behind, ahead], leg.marks, axis) for axis in leg.followed.positions.T]
    return np.diff(ends, axis=1)[:, 0]


def _is_moving(mission: Mission) -> bool:
    """Return whether the vehicle follows its track; otherwise it keeps station."""
    return mission.active_leg.moving and not mission.faults.left(HeldUp, mission.now)


def _give_way(context: SimulationContext, mission: Mission) -> None:
    """Keep station, or escape where something comes too near."""
    leg, interval = mission.active_leg, context.scenario.sensors.interval
    track = context.escape(leg.position, mission.now, interval, leg.belief.clearance)
    leg.moving, leg.escaping = track is not None, track is not None
    if track is not None:
        leg.track, leg.arc = track, 0.0
