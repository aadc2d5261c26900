"""Travel times of a graph's edges in the present current: every line scored at once, the blocked ones bent.

The search for a path would cost tens of milliseconds an edge. Between waypoints with open water between them
the straight line, with the current along and across it, is as good within a fraction of a per cent; where it
is blocked the shortest path round is. Where the sea bed keeps a line out of depths with a better current the
path planner's passages are polished. Only where none of these is known, or the current closes all, is a fan
of detours scored and polished.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from typing import Any, NamedTuple, Self, TypeVar

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
from auvplan.path.ends import check_moment
from auvplan.path.kinematics import TINY, winding_length
from auvplan.path.problem import Problem
from auvplan.path.profile import compared, depths_within_reach, is_searched_in_depth, profiles
from auvplan.runtime.arguments import check_settings
from auvplan.runtime.compiled import compiled
from auvplan.runtime.pytree import row_kinds
from auvplan.runtime.rows import padded_batches
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle, along_track

T = TypeVar("T")

#: Edges that one call takes, of straight lines and paths round, and of fans: larger calls gain little, and
#: one program each serves every graph.
_LINES, _FANS = 64, 16

#: Takes two places [3] m; returns polylines [K, 3] m from the one to the other, clear of the coast, each with
#: whether it keeps clear of all areas as well that are closed at some hours.
PathsRound = Callable[
    [NDArray[np.floating], NDArray[np.floating]], Sequence[tuple[NDArray[np.floating], bool]]
]

#: Takes places [B, 3] m to start from and to go to, and departures [B] s; returns paths [B, K, S, 3] m that
#: are nearly as quick as the planner's.
Sketch = Callable[
    [NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]], Sequence[NDArray[np.floating]]
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

#: Depths evenly from top to bottom at which the current is looked up where no bed hinders.
_FREE_LEVELS = 24

#: Gradient steps that bend a line of three control points to the current.
_BEND_STEPS = 6

#: Share by which an edge takes longer than over a deep bed from which on paths are sketched, and pairs of
#: places at most between which they are, the nearest first.
_HINDERED, _MOST_SKETCHED = 0.05, 300


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
        most = float("inf")
        check_settings(self, {"steps": (0, most), "detours": (1, most), "detour_steps": (0, most)})

    def bending(self) -> Self:
        """Return settings that bend lines to the current, with as little effort as shows what it saves."""
        path = self.path.replace(control_points=3, samples=16)
        return replace(self, path=path, steps=_BEND_STEPS)


class Trips(NamedTuple):
    """E edges that are to be timed.

    Attributes:
        starts, goals: [E, 3] m, north, east, depth.
        departs: [E] s since the epoch.
    """

    starts: NDArray[np.floating]
    goals: NDArray[np.floating]
    departs: NDArray[np.floating]


class Detours(NamedTuple):
    """What is tried where a straight line breaks a limit, before a fan of paths.

    Attributes:
        around: finds paths round what is between two places.
        sketch: finds paths where the sea bed keeps edges out of depths with a better current.
    """

    around: PathsRound | None = None
    sketch: Sketch | None = None


#: Fans of paths alone.
FANS = Detours()


def travel_times(
    trips: Trips,
    env: Environment,
    vehicle: Vehicle,
    config: TravelTimeConfig,
    world: NDArray[np.int_] | None = None,
    detours: Detours | None = FANS,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Travel times of E edges in a few compiled calls.

    Args:
        trips: the edges.
        env: the world; its obstacles are left out.
        vehicle: speed and limits.
        config: effort.
        world: [E] index into the leading axis of the current's leaves; None for one current for all.
        detours: tried where the line breaks a limit; None for none at all: such an edge is not passable.

    Returns:
        ``(seconds [E], passable [E])``; an edge is not passable where no path tried keeps every limit, or
        where an end lies outside the box or the chart, or nearer to the sea bed than its clearance.

    Raises:
        ValueError: a departure is too far from the epoch for single precision.
    """
    starts, goals, departs = trips
    check_moment("depart", departs)
    inside = _inside(starts, env) & _inside(goals, env)
    timing = _Timing.of(trips, env, vehicle, config, world)
    timing.estimate(np.arange(len(starts)), _LINES, 0, config.steps)
    here = np.linalg.norm(goals - starts, axis=1) <= ONE_PLACE
    timing.seconds[here], timing.passable[here] = TURN_TO, True
    if detours is not None:
        if detours.around is not None:
            timing.go_round(np.flatnonzero(~timing.passable & inside), detours.around)
        if detours.sketch is not None and timing.world.deep and env.seabed is not None:
            timing.go_deeper(np.flatnonzero(inside & ~here), detours.sketch)
        timing.fan_out(np.flatnonzero(~timing.passable & inside))
    # Lines that are steeper than the vehicle can dive or climb take as long as that, and as winding does.
    rise, speed = goals[:, 2] - starts[:, 2], float(np.asarray(vehicle.speed))
    sine = vehicle.steepest(np.asarray(rise))
    seconds = np.maximum(timing.seconds, np.abs(rise) / (speed * sine))
    level = np.hypot(*(goals - starts)[:, :2].T)
    tightest = speed / float(np.asarray(vehicle.turn_rate_max))
    length = winding_length(level, np.abs(rise) * np.sqrt(1.0 - sine**2) / sine, tightest)
    winds = (length > level) & ~here
    seconds = np.where(winds, np.maximum(seconds, np.hypot(length, rise) / speed), seconds)
    return seconds, timing.passable & inside


@dataclass(frozen=True, eq=False)
class _Timing:
    """What is known of E edges so far.

    Attributes:
        trips: the edges.
        config: effort.
        world: that they are timed in.
        index: [E] of each edge's current among those of the world; None where there is one for all.
        seconds: [E], least time found.
        passable: [E], whether it is of a path that keeps all limits.
        taken: polylines [K, 3] m of edges that are not timed by their straight line or a fan.
    """

    trips: Trips
    config: TravelTimeConfig
    world: "_World"
    index: NDArray[np.int_] | None
    seconds: NDArray[np.float64]
    passable: NDArray[np.bool_]
    taken: dict[int, NDArray[np.floating]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, trips: Trips, env: Environment, vehicle: Vehicle, config: TravelTimeConfig, index: Any
    ) -> "_Timing":
        shared = padded(env.current)
        kind = shared if index is None else row_kinds(shared)
        config = replace(config, path=compared(config.path, env, kind))
        sea, deep = (
            replace(env, current=None, obstacles=Obstacles.none()),
            is_searched_in_depth(env, vehicle, kind),
        )
        if index is not None:
            shared = jax.tree.map(np.asarray, shared)
        path, count = config.path, len(trips.starts)
        kept = path.only("start_shape", "width", "depth_width")
        world = _World(shared, sea, vehicle, path.numbers, kept, deep, own=index is not None)
        return cls(trips, config, world, index, np.zeros(count), np.zeros(count, bool))

    def run(
        self, program: Callable, edges: NDArray[np.int_], together: int, *rows: Any, **settings: int
    ) -> list:
        """Return what a program finds for edges and their rows, taken `together` in each call."""
        parts, departs = [], np.asarray(self.trips.departs[edges], np.float32)
        for part, real in padded_batches(len(edges), (together,)):
            world = self.world
            if self.index is not None:
                chosen = self.index[edges[part]]
                currents = jax.tree.map(lambda leaf, k=chosen: jnp.asarray(leaf[k]), world.currents)
                world = replace(world, currents=currents)
            found = program(*(row[part] for row in rows), departs[part], world, **settings)
            parts.append([np.asarray(plane)[:real] for plane in found])
        return [np.concatenate(planes) for planes in zip(*parts, strict=True)]

    def estimate(self, edges: NDArray[np.int_], together: int, detours: int, steps: int) -> list[np.ndarray]:
        """Set times of edges by the straight line or by a fan; return the tracks [S, 3] m of these."""
        if not len(edges):
            return []
        ends = (np.asarray(places[edges], np.float32) for places in self.trips[:2])
        lasts, good, tracks = self.run(_estimate, edges, together, *ends, detours=detours, steps=steps)
        self.seconds[edges], self.passable[edges] = lasts, good
        return list(tracks)

    def follow(self, edges: list[int], polylines: list[np.ndarray], clear: list[bool] | None = None) -> None:
        """Set times of edges by polylines [K, 3] m clear of the coast, where these keep all limits."""
        if not edges:
            return
        finer = 1 if self.world.sea.seabed is None else _FINER
        tracks = _tracks(polylines, self.config.path.samples * finer)
        rows = tracks, np.zeros(len(edges), bool) if clear is None else np.array(clear)
        found = self.run(_follow, np.array(edges), _LINES, *rows)
        for edge, polyline, lasts, good in zip(edges, polylines, *found, strict=True):
            if good and (not self.passable[edge] or lasts < self.seconds[edge]):
                self.seconds[edge], self.passable[edge], self.taken[edge] = lasts, True, polyline

    def go_round(self, edges: NDArray[np.int_], around: PathsRound) -> None:
        """Time blocked edges by paths round what is between their ends."""
        found = [(edge, *path) for edge in edges.tolist() for path in around(*self._ends(edge))]
        self.follow(
            [edge for edge, *_ in found], [path for _, path, _ in found], [clear for *_, clear in found]
        )

    def go_deeper(self, edges: NDArray[np.int_], sketch: Sketch) -> None:
        """Time edges that the sea bed hinders by sketched paths.

        One departure of each pair of places is sketched: what is found for it mostly serves the others.
        """
        starts, goals, _ = self.trips
        alike = self._alike(edges)
        middle = np.array([edges[len(edges) // 2] for edges in alike], int)
        order = np.argsort(np.linalg.norm(goals[middle] - starts[middle], axis=1), kind="stable")
        order = order[self._hindered(middle)[order]][:_MOST_SKETCHED]
        if len(order):
            sketches = sketch(*(np.asarray(values[middle[order]], float) for values in self.trips))
            served = [
                (edge, path)
                for k, paths in zip(order, sketches, strict=True)
                for edge in alike[k].tolist()
                for path in paths
            ]
            self.follow([edge for edge, _ in served], [path for _, path in served])

    def fan_out(self, blocked: NDArray[np.int_]) -> None:
        """Time blocked edges by fans of detours, few for each pair of places: the best serve the others."""
        effort = self.config.detours, self.config.detour_steps
        while blocked.size:
            tried, others = [], []
            for edges in self._alike(blocked):
                few = np.unique(np.linspace(0, len(edges) - 1, _TRIED).round().astype(int))
                tried.append(edges[few])
                others.append(np.delete(edges, few))
            fans = iter(self.estimate(np.concatenate(tried), _FANS, *effort))
            served = [
                (other, track)
                for own, rest in zip(tried, others, strict=True)
                for edge, track in zip(own, fans, strict=False)
                if self.passable[edge]
                for other in rest.tolist()
            ]
            self.follow([edge for edge, _ in served], [track for _, track in served])
            blocked = np.sort(np.concatenate(others))
            blocked = blocked[~self.passable[blocked]]

    def _ends(self, edge: int) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
        return self.trips.starts[edge], self.trips.goals[edge]

    def _hindered(self, edges: NDArray[np.int_]) -> NDArray[np.bool_]:
        """Return whether edges would be quicker by the paths taken if the sea bed were deep."""
        if not len(edges):
            return np.zeros(0, bool)
        lines = [self.taken.get(edge, np.stack(self._ends(edge))) for edge in edges.tolist()]
        (least,) = self.run(_unhindered, edges, _LINES, _tracks(lines, _STATIONS + 1))
        return ~self.passable[edges] | (self.seconds[edges] > (1.0 + _HINDERED) * least.astype(float))

    def _alike(self, edges: NDArray[np.int_]) -> list[NDArray[np.int_]]:
        """Return edges by the places that they join."""
        ends = np.concatenate([places[edges] for places in self.trips[:2]], axis=1)
        _, pair, counts = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
        together = edges[np.argsort(pair.ravel(), kind="stable")]
        return np.split(together, np.cumsum(counts)[:-1]) if edges.size else []


def _inside(points: np.ndarray, env: Environment) -> NDArray[np.bool_]:
    """Return whether points [E, 3] m lie in the box, on the chart and clear of the sea bed."""
    inside = ((points >= np.asarray(env.lower) - 1e-3) & (points <= np.asarray(env.upper) + 1e-3)).all(axis=1)
    if env.chart is not None:
        inside &= env.chart.contains(points[:, 0], points[:, 1])
    if env.seabed is not None:
        inside &= env.seabed.altitude(points) >= float(env.seabed.clearance)
    return np.asarray(inside)


def _tracks(polylines: Sequence[NDArray[np.floating]], count: int) -> NDArray[np.float32]:
    """Return [B, S, 3] m, places evenly along polylines [K, 3] m."""

    def sampled(line: NDArray[np.floating]) -> NDArray[np.floating]:
        marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        along = np.linspace(0.0, marks[-1], count)
        return np.stack([np.interp(along, marks, axis) for axis in line.T], axis=1)

    return np.stack([sampled(line) for line in polylines]).astype(np.float32)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class _World:
    """What edges are timed in.

    Attributes:
        currents: one, or one for each edge where they are their `own`.
        sea: the rest of the world, without obstacles.
        vehicle: speed and limits.
        numbers: margins and price.
        config: settings that programs depend on.
        deep: whether the quickest depths are looked for.
    """

    currents: Current
    sea: Environment
    vehicle: Vehicle
    numbers: dict[str, Any]
    config: PathConfig = field(metadata={"static": True})
    deep: bool = field(metadata={"static": True})
    own: bool = field(metadata={"static": True})

    def over_edges(self, one: Callable[..., T], *rows: Any) -> T:
        """Return `one` of the rows and the current of each edge."""
        return jax.vmap(one, in_axes=(*(0 for _ in rows), 0 if self.own else None))(*rows, self.currents)

    @property
    def settings(self) -> PathConfig:
        """The settings of paths with their numbers."""
        return self.config.replace(**self.numbers)

    def environment(self, current: Current, chart: Chart | None) -> Environment:
        """Return the world of one edge."""
        sea = self.sea
        return Environment(current, chart, Obstacles.none(), sea.lower, sea.upper, sea.seabed, sea.closures)


@compiled
def _unhindered(tracks: Any, departs: Any, world: _World) -> tuple[jax.Array]:
    """Time [E] s over tracks [E, K + 1, 3] m at the best depths of the box, taken at will."""

    def one(track: jax.Array, depart: jax.Array, current: Current) -> jax.Array:
        step, middle = jnp.diff(track, axis=0), 0.5 * (track[1:] + track[:-1])
        gap = jnp.sqrt((step * step).sum(axis=1) + TINY)
        when = depart + (jnp.cumsum(gap) - 0.5 * gap) / world.vehicle.speed
        top, bottom = depths_within_reach(track[jnp.asarray([0, -1])], world.sea)
        depth = jnp.linspace(top, bottom, _FREE_LEVELS)[None]
        u, v, _ = current(middle[:, :1], middle[:, 1:2], depth, when[:, None])
        north, east = step[:, :1] / gap[:, None], step[:, 1:2] / gap[:, None]
        along, across = u * north + v * east, jnp.abs(u * east - v * north)
        ground, _ = along_track(world.config.speed_reading, world.vehicle.speed, along, across)
        return (gap / ground.max(axis=1)).sum()

    return (world.over_edges(one, tracks, departs),)


@compiled
def _follow(tracks: Any, clear: Any, departs: Any, world: _World) -> tuple[jax.Array, jax.Array]:
    """Time [E] s of tracks [E, S, 3] m that keep clear of the coast, and whether they keep every limit [E].

    Those that are `clear` [E] keep clear of closed areas as well. Their corners are rounded by a path.
    """
    vehicle, config = world.vehicle, world.settings

    def one(
        track: jax.Array, clear: jax.Array, depart: jax.Array, current: Current
    ) -> tuple[jax.Array, jax.Array]:
        env = world.environment(current, None)
        x, y, z = (axis[:, None] for axis in track.T)
        if env.seabed is not None:
            length = jnp.sqrt(jnp.diff(x, axis=0) ** 2 + jnp.diff(y, axis=0) ** 2).max()
            z = jnp.minimum(z, habitats.deepest(env, x, y, jnp.broadcast_to(2.0 * length, x.shape)))
        line = followed(Track.through(x, y, z), env, vehicle)
        if world.deep:
            line = _at_depths(line, Problem(track[0], track[-1], depart, env, vehicle), config)
        trajectory = evaluate(line, depart, env, vehicle, config)
        excess = dict(zip(VIOLATIONS, violations(trajectory), strict=True))
        broken = sum(excess[name] for name in ("surge", "sway", "current", "seabed"))
        return _quickest(trajectory, broken + jnp.where(clear, 0.0, excess["coast"]))

    return world.over_edges(one, tracks, clear, departs)


def _at_depths(track: Track, problem: Problem, config: PathConfig) -> Track:
    """Return a track, [S, 1], and the same one at the depths at which it is quickest, [S, 2] together."""
    x, y, z = track.places
    at = np.linspace(0, len(x) - 1, _STATIONS + 1).round().astype(int)
    found = profiles(x[at].T, y[at].T, problem, config, _LEVELS)[0]
    depth = jnp.interp(np.arange(len(x)), at, found)[:, None]
    return Track.through(jnp.tile(x, 2), jnp.tile(y, 2), jnp.concatenate([z, depth], axis=1))


def _quickest(trajectory: Trajectory, broken: jax.Array) -> tuple[jax.Array, jax.Array]:
    """Return the time [s] of the quickest path that breaks no limit, and whether there is one.

    Without one it is that of the first path.
    """
    lasts = jnp.where(broken == 0.0, trajectory.travel_time, jnp.inf)
    return jnp.where((broken == 0.0).any(), lasts.min(), trajectory.travel_time[0]), (broken == 0.0).any()


@partial(compiled, static_argnames=("detours", "steps"))
def _estimate(
    starts: Any, goals: Any, departs: Any, world: _World, detours: int, steps: int
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Time [E] s and whether it keeps every limit [E], of the straight lines or of the best detours.

    With their samples [E, S, 3] m, at the straight line's depths.
    """
    vehicle, config = world.vehicle, world.settings

    def one(
        start: jax.Array, goal: jax.Array, depart: jax.Array, current: Current
    ) -> tuple[jax.Array, jax.Array, jax.Array]:
        env = world.environment(current, world.sea.chart)
        problem, cost = Problem(start, goal, depart, env, vehicle), partial(score, config=config)
        lower, upper = habitats.bounds(problem, config)
        if detours:
            # The same fan for every edge: the key only shapes it.
            fan = habitats.initial(jax.random.key(0), detours + 1, problem, lower, upper, config)
            tried = fan[jnp.argsort(cost(fan, problem)[0])[:_POLISHED]]
        else:
            line = habitats.straight_line(start, goal, config)[None]
            tried = habitats.raise_above_seabed(line, problem, config)
        if steps:
            tried, costs, _ = refine(cost, tried, lower, upper, steps, (problem,), _STEP_SIZE)
            tried = tried[jnp.argmin(costs)][None]
        track = tracks(tried[:1], problem, config)
        if world.deep:
            track = _at_depths(track, problem, config)
        trajectory = evaluate(track, depart, env, vehicle, config)
        excess = dict(zip(VIOLATIONS, violations(trajectory), strict=True))
        broken = reduce(jnp.add, (plane for name, plane in excess.items() if name not in VERTICAL_LIMITS))
        return *_quickest(trajectory, broken), jnp.stack([axis[:, 0] for axis in track.places], axis=1)

    return world.over_edges(one, starts, goals, departs)
