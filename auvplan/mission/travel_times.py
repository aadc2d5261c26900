"""Travel times of a graph's edges in the present current: every line scored at once, the blocked ones bent.

The search for a path would cost tens of milliseconds an edge. Between waypoints with open water between them
the straight line, with the current along and across it, is as good within a fraction of a per cent; where it
is blocked the shortest path round is. Only where neither is known, or the current closes both, is a fan of
detours scored and polished.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo.refine import refine
from auvplan.ocean.chart import Chart
from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.vortices import padded
from auvplan.path import PathConfig, habitats
from auvplan.path.cost import VIOLATIONS, Track, Trajectory, evaluate, followed, score, tracks, violations
from auvplan.path.profile import compared, is_searched_in_depth, profiles
from auvplan.runtime.compiled import compiled
from auvplan.runtime.pytree import row_kinds
from auvplan.runtime.rows import padded_batches
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle

#: Edges that one call takes, of straight lines and paths round, and of fans: larger calls gain little, and
#: one program each serves every graph.
_LINES, _FANS = 64, 16

#: Takes two places [3] m; returns polylines [K, 3] m from the one to the other, clear of the coast, each with
#: whether it keeps clear of all areas as well that are closed at some hours.
PathsRound = Callable[
    [NDArray[np.floating], NDArray[np.floating]], Sequence[tuple[NDArray[np.floating], bool]]
]

#: Waypoints no farther apart, m, are one place; s from the one's task to the other's.
ONE_PLACE, TURN_TO = 0.5, 1.0

#: Factor on the samples of detours over a sea bed: they keep along banks, and between samples a bank counts
#: as shallow as it is anywhere near.
_FINER = 4

#: Departures for which a fan is scored first, of all at which an edge is blocked.
_TRIED = 3

#: Best detours of a fan that are polished, and the first step of the polish as a share of the bounds.
_POLISHED = 4
_STEP_SIZE = 0.03

#: Stations of an edge and depths at each among which the quickest are found where the current changes with
#: depth.
_STATIONS, _LEVELS = 16, 12

#: Gradient steps that bend a line of three control points to the current.
_BEND_STEPS = 6


@dataclass(frozen=True)
class TravelTimeConfig:
    """Effort of the estimate; hashable, so that it is a static argument of `jax.jit`.

    Attributes:
        path: limits, margins, speed reading and bounds as the path planner has them; its search is not run,
            and few control points and samples do.
        steps: gradient steps that bend every line to the current; 0 keeps the straight lines.
        detours: that are tried where the line breaks a limit.
        detour_steps: gradient steps that polish the best of them.

    Raises:
        ValueError: a number is negative, or there is no detour.
    """

    path: PathConfig = field(default_factory=lambda: PathConfig(control_points=6, samples=64))
    steps: int = 0
    detours: int = 24
    detour_steps: int = 16

    def __post_init__(self) -> None:
        if self.steps < 0 or self.detour_steps < 0:
            raise ValueError("steps and detour_steps must not be negative")
        if self.detours < 1:
            raise ValueError(f"detours must be at least 1, got {self.detours}")

    def bending(self) -> Self:
        """Return settings that bend lines to the current, with as little effort as shows what it saves."""
        path = self.path.replace(control_points=3, samples=16)
        return replace(self, path=path, steps=_BEND_STEPS)


def travel_times(
    starts: NDArray[np.floating],
    goals: NDArray[np.floating],
    env: Environment,
    vehicle: Vehicle,
    depart: NDArray[np.floating],
    config: TravelTimeConfig,
    world: NDArray[np.int_] | None = None,
    detour: bool = True,
    around: PathsRound | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Travel times of E edges in a few compiled calls.

    Args:
        starts: [E, 3] m, north, east, depth.
        goals: [E, 3] m.
        env: the world; its obstacles are left out.
        vehicle: speed and limits.
        depart: [E] s since the epoch.
        config: effort.
        world: [E] index into the leading axis of the current's leaves; None for one current for all.
        detour: whether detours are tried where the line breaks a limit; else such an edge is not passable.
        around: finds paths round what is in the way, which come before detours.

    Returns:
        ``(seconds [E], passable [E])``; an edge is not passable where no path tried keeps every limit, or
        where an end lies outside the box or the chart, or nearer to the sea bed than its clearance.
    """
    sea = replace(env, current=None, obstacles=Obstacles.none())
    inside = _inside(starts, env) & _inside(goals, env)

    shared = padded(env.current)
    kind = shared if world is None else row_kinds(shared)
    deep = is_searched_in_depth(env, vehicle, kind)
    config = replace(config, path=compared(config.path, env, kind))
    leaves, tree = jax.tree.flatten(shared)
    hosted = [np.asarray(leaf) for leaf in leaves] if world is not None else []

    common = {"sea": sea, "vehicle": vehicle, "config": config, "deep": deep}
    common["world_per_edge"] = world is not None

    def current_of(edges: NDArray[np.int_]) -> Current:
        if world is None:
            return shared
        return tree.unflatten([jnp.asarray(leaf[world[edges]]) for leaf in hosted])

    def estimate(chosen: NDArray[np.int_], together: int, detours: int, steps: int) -> list[np.ndarray]:
        """Set times of edges by the straight line or by a fan; return the detours [S, 3] m of the fans."""
        found = []
        for part, real in padded_batches(len(chosen), (together,)):
            edges = chosen[part]
            ends = (np.asarray(a[edges], np.float32) for a in (starts, goals, depart))
            out = _estimate(*ends, currents=current_of(edges), detours=detours, steps=steps, **common)
            seconds[edges[:real]], passable[edges[:real]] = (np.asarray(a)[:real] for a in out[:2])
            if detours:
                found += list(np.asarray(out[2])[:real])
        return found

    def follow(chosen: NDArray[np.int_], polylines: list[np.ndarray], clear: NDArray[np.bool_]) -> None:
        """Set times of edges by polylines [K, 3] m clear of the coast, where these keep all limits."""
        count = config.path.samples * (1 if env.seabed is None else _FINER)
        tracks = [_sampled(way, count) for way in polylines]
        for part, real in padded_batches(len(chosen), (_LINES,)) if len(chosen) else ():
            edges = chosen[part]
            along = np.stack([tracks[k] for k in part]).astype(np.float32)
            departs = np.asarray(depart[edges], np.float32)
            out = _follow(along, clear[part], departs, currents=current_of(edges), **common)
            for edge, lasts, good in zip(edges[:real], *(np.asarray(a) for a in out), strict=False):
                if good and (not passable[edge] or lasts < seconds[edge]):
                    seconds[edge], passable[edge] = lasts, True

    seconds, passable = np.zeros(len(starts)), np.zeros(len(starts), bool)
    estimate(np.arange(len(starts)), _LINES, 0, config.steps)
    here = np.linalg.norm(goals - starts, axis=1) <= ONE_PLACE
    seconds[here], passable[here] = TURN_TO, True
    if detour and around is not None and (blocked := np.flatnonzero(~passable & inside)).size:
        ways = [around(starts[edge], goals[edge]) for edge in blocked]
        edges = np.repeat(blocked, [len(found) for found in ways])
        clear = np.array([always for found in ways for _, always in found], bool)
        follow(edges, [way for found in ways for way, _ in found], clear)
    blocked = np.flatnonzero(~passable & inside) if detour else np.zeros(0, int)
    while blocked.size:
        # Few fans for each pair of places: what they find for one departure mostly serves the others.
        pairs = np.concatenate([starts, goals], axis=1)[blocked]
        pair = np.unique(pairs, axis=0, return_inverse=True)[1]
        alike = [blocked[pair == number] for number in range(pair.max() + 1)]
        tried, others = [], []
        for edges in alike:
            few = np.unique(np.linspace(0, len(edges) - 1, _TRIED).round().astype(int))
            tried.append(edges[few])
            others.append(np.delete(edges, few))
        fans = iter(estimate(np.concatenate(tried), _FANS, config.detours, config.detour_steps))
        served = [
            (other, track)
            for own, rest in zip(tried, others, strict=True)
            for edge, track in zip(own, fans, strict=False)
            if passable[edge]
            for other in rest
        ]
        edges = np.array([edge for edge, _ in served], int)
        follow(edges, [track for _, track in served], np.zeros(len(edges), bool))
        blocked = np.sort(np.concatenate(others))
        blocked = blocked[~passable[blocked]]
    return np.maximum(seconds, _vertical_times(starts, goals, vehicle)), passable & inside


def _vertical_times(
    starts: NDArray[np.floating], goals: NDArray[np.floating], vehicle: Vehicle
) -> NDArray[np.float64]:
    """Return the times [E] s of dives and climbs at the vehicle's limits, for lines that are steeper."""
    limits = {name: float(limit) for name, limit in vehicle.vertical_limits.items()}
    rise = goals[:, 2] - starts[:, 2]
    most = [min(limits.get("pitch", np.inf), limits.get(name, np.inf)) for name in ("dive", "climb")]
    return np.abs(rise) / np.where(rise > 0.0, *most)


def _inside(points: np.ndarray, env: Environment) -> NDArray[np.bool_]:
    """Return whether points [E, 3] m lie in the box, on the chart and clear of the sea bed."""
    inside = ((points >= np.asarray(env.lower) - 1e-3) & (points <= np.asarray(env.upper) + 1e-3)).all(axis=1)
    if env.chart is not None:
        inside &= env.chart.contains(points[:, 0], points[:, 1])
    if env.seabed is not None:
        inside &= env.seabed.altitude(points) >= float(env.seabed.clearance)
    return np.asarray(inside)


def _sampled(way: NDArray[np.floating], count: int) -> NDArray[np.floating]:
    """Return [S, 3] m, places evenly along a polyline [K, 3] m."""
    marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way, axis=0), axis=1))])
    along = np.linspace(0.0, marks[-1], count)
    return np.stack([np.interp(along, marks, axis) for axis in way.T], axis=1)


@partial(compiled, static_argnames=("config", "world_per_edge", "deep"))
def _follow(
    tracks: Any,
    clear: Any,
    departs: Any,
    currents: Current,
    sea: Environment,
    vehicle: Vehicle,
    config: TravelTimeConfig,
    world_per_edge: bool,
    deep: bool,
) -> tuple[jax.Array, jax.Array]:
    """Time [E] s of tracks [E, S, 3] m that keep clear of the coast, and whether they keep every limit [E].

    Those that are `clear` [E] keep clear of closed areas as well. Their corners are rounded by a path.
    """

    def one(
        track: jax.Array, clear: jax.Array, depart: jax.Array, current: Current
    ) -> tuple[jax.Array, jax.Array]:
        env = Environment(current, None, Obstacles.none(), sea.lower, sea.upper, sea.seabed, sea.closures)
        x, y, z = (axis[:, None] for axis in track.T)
        if sea.seabed is not None:
            length = jnp.sqrt(jnp.diff(x, axis=0) ** 2 + jnp.diff(y, axis=0) ** 2).max()
            z = jnp.minimum(z, habitats.deepest(env, x, y, jnp.broadcast_to(2.0 * length, x.shape)))
        line = followed(Track.through(x, y, z), env, vehicle)
        if deep:
            line = _at_depths(line, track[0], track[-1], depart, env, vehicle, config.path)
        trajectory = evaluate(line, depart, env, vehicle, config.path)
        excess = dict(zip(VIOLATIONS, violations(trajectory), strict=True))
        broken = sum(excess[name] for name in ("surge", "sway", "current", "seabed"))
        return _quickest(trajectory, broken + jnp.where(clear, 0.0, excess["coast"]))

    return jax.vmap(one, in_axes=(0, 0, 0, 0 if world_per_edge else None))(tracks, clear, departs, currents)


def _at_depths(
    track: Track,
    start: jax.Array,
    goal: jax.Array,
    depart: jax.Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> Track:
    """Return a track, [S, 1], and the same one at the depths at which it is quickest, [S, 2] together."""
    x, y, z = track.places
    at = np.linspace(0, len(x) - 1, _STATIONS + 1).round().astype(int)
    found = profiles(x[at].T, y[at].T, start, goal, depart, env, vehicle, config, _LEVELS)[0]
    depth = jnp.interp(np.arange(len(x)), at, found)[:, None]
    return Track.through(jnp.tile(x, 2), jnp.tile(y, 2), jnp.concatenate([z, depth], axis=1))


def _quickest(trajectory: Trajectory, broken: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return the time [s] of the quickest path that breaks no limit, and whether there is one.

    Without one it is that of the first path.
    """
    lasts = jnp.where(broken == 0.0, trajectory.travel_time, jnp.inf)
    return jnp.where((broken == 0.0).any(), lasts.min(), trajectory.travel_time[0]), (broken == 0.0).any()


@partial(compiled, static_argnames=("config", "detours", "steps", "world_per_edge", "deep"))
def _estimate(
    starts: Any,
    goals: Any,
    departs: Any,
    currents: Current,
    sea: Environment,
    vehicle: Vehicle,
    config: TravelTimeConfig,
    detours: int,
    steps: int,
    world_per_edge: bool,
    deep: bool,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Time [E] s and whether it keeps every limit [E], of the straight lines or of the best detours.

    With their samples [E, S, 3] m, at the straight line's depths.
    """

    def one(
        start: jax.Array, goal: jax.Array, depart: jax.Array, current: Current, chart: Chart | None
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        box = sea.lower, sea.upper
        env = Environment(current, chart, Obstacles.none(), *box, sea.seabed, sea.closures)
        problem = (start, goal, depart, env, vehicle)
        cost = partial(score, config=config.path)
        lower, upper = habitats.bounds(start, goal, env, config.path)
        if detours:
            # The same fan for every edge: the key only shapes it.
            fan = habitats.initial(
                jax.random.key(0), detours + 1, start, goal, lower, upper, config.path, env
            )
            best = jnp.argsort(cost(fan, *problem)[0])[:_POLISHED]
            tried = fan[best]
        else:
            tried = habitats.raise_above_seabed(
                habitats.straight_line(start, goal, config.path)[None], start, goal, env, config.path
            )
        if steps:
            tried, costs, _ = refine(cost, tried, lower, upper, steps, problem, _STEP_SIZE)
            tried = tried[jnp.argmin(costs)][None]
        track = tracks(tried[:1], start, goal, env, vehicle, config.path)
        if deep:
            track = _at_depths(track, start, goal, depart, env, vehicle, config.path)
        trajectory = evaluate(track, depart, env, vehicle, config.path)
        excess = dict(zip(VIOLATIONS, violations(trajectory), strict=True))
        broken = reduce(jnp.add, (plane for name, plane in excess.items() if name not in VERTICAL_LIMITS))
        return *_quickest(trajectory, broken), jnp.stack([axis[:, 0] for axis in track.places], axis=1)

    return jax.vmap(one, in_axes=(0, 0, 0, 0 if world_per_edge else None, None))(
        starts, goals, departs, currents, sea.chart
    )
