"""What maps show of a run: their window, legs and plans, waypoints' names, obstacles as they are sensed."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from auvplan.errors import AuvplanError
from auvplan.ocean.chart import Chart
from auvplan.ocean.currents import Current, evaluated
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import CONFIDENCE, closest_approach
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import counted
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.simulator import TIME_STEP
from auvplan.simulation.world import KNOWN

#: m; what is farther away is not there. The simulator puts obstacles that find no room out of the way.
FAR = 1e5


def window(
    points: Array,
    margin: float = 0.12,
    chart: Chart | None = None,
    slender: float = 1.0,
    least: float = 100.0,
) -> tuple[Array, Array]:
    """Return the lower and upper corner, (north, east) m, of a map around points [n, >= 2] m.

    Args:
        points: north and east first.
        margin: share of the longer edge left free on each side.
        chart: that the map does not reach beyond, or None.
        slender: least share of the longer edge that the shorter one has; 1 is a square.
        least: m, shortest length of the longer edge.
    """
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    longest = max(float((high - low).max()), least)
    half = np.maximum(0.5 * (high - low), 0.5 * slender * longest) + margin * longest
    middle = 0.5 * (low + high)
    low, high = middle - half, middle + half
    if chart is not None:
        inner = np.maximum(low, np.asarray(chart.lower)), np.minimum(high, np.asarray(chart.upper))
        if (inner[1] - inner[0] > 0.0).all():
            return inner
    return low, high


def waypoint_name(run: MissionRun, node: int) -> str:
    """Return a waypoint for people: its name, or its number where it has none."""
    if run.names:
        return run.called(node)
    return {run.start: "start", run.goal: "goal"}.get(node, f"waypoint {node}")


def short_name(run: MissionRun, node: int) -> str:
    """Return a waypoint for maps and tables: by its number without a name, where there are more than two."""
    return waypoint_name(run, node) if len(run.graph.positions) == 2 else run.called(node)


# --- legs and plans ----------------------------------------------------------------------------------


def executed_legs(run: MissionRun) -> list[LegRecord]:
    """Return the legs with a track, also one that was not finished."""
    return [leg for leg in run.legs if len(leg.times)]


def refused_legs(run: MissionRun) -> list[LegRecord]:
    """Return the legs that were planned and never executed."""
    return [leg for leg in run.legs if leg.plans and not len(leg.times)]


def busiest_leg(run: MissionRun) -> LegRecord | None:
    """Return the leg of most re-plans, and of these the one that passed an obstacle most closely.

    An executed one where there is any. None without plans.
    """
    planned = [leg for leg in run.legs if leg.plans]
    if not planned:
        return None
    return max(planned, key=lambda leg: (len(leg.times) > 0, leg.path_replans, -clearance(leg)))


def done_leg(run: MissionRun, number: int) -> LegRecord:
    """Return one of the legs whose goal was reached, by its number from 1.

    Raises:
        AuvplanError: there is none of that number; one line that says which there are.
    """
    count = len(run.done)
    if not 1 <= number <= count:
        which = f"choose 1 to {count}, or all" if count else "leave it out"
        raise AuvplanError(f"leg {number}: the run has {counted(count, 'done leg')}: {which}")
    return run.done[number - 1]


def clearance(leg: LegRecord) -> float:
    """Least distance of the executed track to a true obstacle's surface, m; infinite without obstacles."""
    tracks = np.asarray(leg.obstacle_positions, float)
    if not tracks.size:
        return float("inf")
    distance, _ = closest_approach(leg.positions[:, None] - tracks)
    return float((distance - leg.obstacle_radii).min())


def leg_title(run: MissionRun, leg: LegRecord) -> str:
    """Return which leg a figure shows, and on a second line why; the first line alone where there is one."""
    name = f"leg {run.called(leg.start)} → {run.called(leg.goal)}"
    if len(run.legs) == 1:
        return name
    if not len(leg.times):
        return f"{name}\nplanned and refused"
    number = next((k for k, one in enumerate(run.done, start=1) if one is leg), None)
    name = f"{name}, not finished" if number is None else f"leg {number} of {len(run.done)}: {name[4:]}"
    replans, distance = counted(leg.path_replans, "re-plan"), clearance(leg)
    passed = "" if np.isinf(distance) else f", {distance:,.0f} m clear of obstacles"
    if leg is not busiest_leg(run):
        return f"{name}\n{replans}{passed}"
    executed = [one for one in executed_legs(run) if one.plans]
    if sum(one.path_replans == leg.path_replans for one in executed) == 1:
        return f"{name}\nmost re-plans ({leg.path_replans}){passed}"
    closest = passed and f"; of such legs nearest to an obstacle, {distance:,.0f} m"
    return f"{name}\n{replans}, as many as any{closest}"


def chosen_plans(leg: LegRecord, most: int) -> list[int]:
    """Return indices of at most `most` plans: the first, those of the windows, then others, by time."""
    rank = {"leg": 0, "window": 1}
    first = sorted(range(len(leg.plans)), key=lambda k: (rank.get(leg.plans[k].cause, 2), k))
    return sorted(first[:most])


def plan_name(leg: LegRecord, index: int) -> str:
    """Return words for a plan: what made it necessary, and when."""
    plan = leg.plans[index]
    first = "first plan" if index == 0 else "first plan, retried"
    number = sum(one.cause != "leg" for one in leg.plans[: index + 1])
    causes = {"leg": first, "window": f"re-plan {number}, window", "hazard": f"re-plan {number}, hazard"}
    return f"{causes.get(plan.cause, plan.cause)}, t = {plan.made_at:,.0f} s"


def extent_points(leg: LegRecord) -> Array:
    """[n, 3] m, all positions planned or executed on a leg."""
    return np.concatenate([leg.positions, *(plan.positions for plan in leg.plans)])


def as_filed(positions: ArrayLike) -> Array:
    """Return places, m, as single precision has them: files keep them so, and what is shown is the same."""
    return np.asarray(positions, np.float32).astype(float)


def current_on(current: Current, north: Array, east: Array, depth: float, time: float) -> tuple[Array, Array]:
    """Return a current over a frame, [n, m] m/s north and east, at n and m places, m, a depth and a time."""
    x, y = np.meshgrid(north, east, indexing="ij")
    u, v, _ = evaluated(current, x, y, np.full_like(x, depth), np.full_like(x, time))
    return np.asarray(u), np.asarray(v)


# --- obstacles ---------------------------------------------------------------------------------------


class PlannedObstacle(NamedTuple):
    """An obstacle as a plan reckons with it at n times: `track` [n, 3] m, `radius` m, `boundary` [n] m."""

    track: Array
    radius: float
    boundary: Array


def planned_obstacles(world: Environment, times: Array) -> list[PlannedObstacle]:
    """Return the obstacles of an environment at times [n] s, with their collision boundaries."""
    if not len(world.obstacles):
        return []
    moving = world.obstacles.resolved(world.current)
    since = times[:, None, None] - np.asarray(moving.observed_at)[:, None]
    tracks = np.asarray(moving.position) + since * np.asarray(moving.velocity)
    radii, grown = np.asarray(moving.radius), np.asarray(jax.vmap(moving.boundary)(jnp.asarray(times)))
    active = np.flatnonzero(np.asarray(moving.active))
    return [PlannedObstacle(tracks[:, m], float(radii[m]), grown[:, m]) for m in active]


def near_obstacles(leg: LegRecord) -> list[int]:
    """Numbers of a leg's obstacles that are anywhere near."""
    if not len(leg.times):
        return []
    away = np.abs(leg.obstacle_positions[0] - leg.positions[0]).max(axis=1, initial=0.0)
    return np.flatnonzero(away < FAR).tolist()


def shown_obstacles(leg: LegRecord) -> list[int]:
    """Numbers of the obstacles that were not known before and are anywhere near."""
    return [m for m in near_obstacles(leg) if leg.obstacle_kinds[m] != KNOWN]


def true_obstacles(leg: LegRecord) -> tuple[Array, Array]:
    """Return places [n, M, 3] m and radii [M] m of `shown_obstacles`, as files keep them."""
    shown = shown_obstacles(leg)
    return as_filed(leg.obstacle_positions)[:, shown], as_filed(leg.obstacle_radii)[shown]


def track_at(leg: LegRecord, track: Array, times: "Array | float") -> Array:
    """Return [..., 3] m, where a track [n, 3] m by a leg's records is at times [...] s."""
    return np.stack([np.interp(times, leg.times, axis) for axis in np.asarray(track, float).T], axis=-1)


def looks(run: MissionRun, leg: LegRecord) -> list[Array]:
    """Return the moments, s, at which the vehicle measured each obstacle within sensor range on the leg."""
    sensors = _sensors(run)
    apart = max(1, round(sensors.interval / TIME_STEP)) * TIME_STEP
    times = np.arange(leg.times[0] + apart, leg.times[-1], apart)
    vehicle, (tracks, radii) = track_at(leg, leg.positions, times), true_obstacles(leg)
    away = [np.linalg.norm(track_at(leg, track, times) - vehicle, axis=1) for track in tracks.swapaxes(0, 1)]
    return [times[gap - radius <= sensors.range] for gap, radius in zip(away, radii, strict=True)]


def sensing_data(run: MissionRun) -> dict[str, float] | None:
    """How a boundary grows between two looks; None of a plan, which no sensor went into."""
    if not run.simulated:
        return None
    sensors = _sensors(run)
    # The errors of place and radius add up.
    spread = CONFIDENCE * 2.0**0.5
    return {
        "range": sensors.range,
        "interval": sensors.interval,
        "prior": spread * sensors.prior_std,
        "seen": spread * sensors.position_std,
        "growth": sensors.growth,
        "growth_max": sensors.growth_max,
    }


def grown(run: MissionRun, leg: LegRecord, times: Array, errors: bool = True) -> Array:
    """Return by how much the boundary of each of `shown_obstacles` has grown at times [k] s: [k, M] m.

    It grows from one look to the next; before the first the obstacle counts as seen when the leg began. The
    `errors` of measurement may widen it as well.
    """
    seen, rule = looks(run, leg), sensing_data(run)
    found = np.zeros((len(times), len(seen)))
    if rule is None:
        return found
    for m, moments in enumerate(seen):
        last = np.searchsorted(moments, times, side="right") - 1
        since = times - np.where(last < 0, leg.times[0], np.append(moments, 0.0)[last])
        if errors:
            found[:, m] = np.where(last < 0, rule["prior"], rule["seen"])
        found[:, m] += np.minimum(rule["growth"] * since, rule["growth_max"])
    return found


def _sensors(run: MissionRun) -> SensorSettings:
    return SensorSettings.model_validate(run.scenario.get("sensors", {}))
