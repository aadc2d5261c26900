"""The fewest waypoints that stand for a planned path: vehicles take a dozen, not a hundred samples."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.compiled import compiled
from auvplan.ocean.environment import Environment
from auvplan.ocean.vortices import padded, rounded_up
from auvplan.path.clearance import bed_altitude, closed_clearance, coast_clearance, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.path.kinematics import Axes, inner, norm
from auvplan.vehicle import Vehicle, along_track

Array = NDArray[np.floating]

#: m, longest step on a straight segment at which current and clearance are looked at.
STEP = 20.0

#: Steps that one compiled call evaluates: one shape serves paths of every length.
_TOGETHER = 8192

#: s, by which arrival times may still change when a path is said to be timed; and passes at most.
_SETTLED, _PASSES = 0.01, 12

#: By how much certified distances, m, and speeds, m/s, may seem less for the steps that a line is cut into.
_BLUR = 0.1, 0.01

#: Parts of a step at whose ends the distance to the coast is looked up: it is certain to a hair then.
_LOOKS = 4

_CONFIG = PathConfig()


@dataclass(frozen=True)
class Thinned:
    """Some samples of a path, to be joined by straight lines.

    Attributes:
        indices: [K] of the samples kept, both ends among them.
        positions: [K, 3] m, north, east, depth.
        times: [K] s since the epoch, arrival along the straight lines.
        time_change: by what share the straight lines take longer than the path; negative where shorter.
        clearance: m, least certified distance of the straight lines to coast and collision boundaries.
    """

    indices: NDArray[np.intp]
    positions: Array
    times: Array
    time_change: float
    clearance: float


def thin(
    positions: ArrayLike,
    times: ArrayLike,
    env: Environment,
    vehicle: Vehicle,
    *,
    depart: float | None = None,
    tolerance: float = 0.02,
    margin: float = 10.0,
) -> Thinned:
    """Keep the fewest samples of a path whose straight lines take as long and keep as clear as the path does.

    Both the path and what is kept of it are timed anew in the current as it is on arrival, in steps of at
    most 20 m, so that their times compare. Certified distances to the coast and to the obstacles' boundaries
    are not below the smaller of `margin` and what the path itself has, altitudes above the sea bed not below
    the smaller of its clearance and the path's; where the current lets the vehicle hold the path within its
    limits, it lets it hold the straight lines too. Of each number of lines those are tried whose changes of
    time, summed without regard to sign, are least.

    Args:
        positions: [S, 3] m, samples, at least two.
        times: [S] s since the epoch, rising; only the first counts, where `depart` is not given.
        env: current, coast, obstacles and sea bed; any `Current` will do.
        vehicle: speed and limits.
        depart: s since the epoch.
        tolerance: share by which the total time may change.
        margin: m.

    Raises:
        ValueError: there are fewer than two samples, or shapes do not fit.
    """
    places = np.asarray(positions, float)
    if places.ndim != 2 or places.shape[1] != 3 or len(places) < 2 or np.shape(times) != (len(places),):
        raise ValueError(
            f"positions must be [S, 3] with S > 1 and times [S], got {places.shape} and {np.shape(times)}"
        )
    start = float(np.asarray(times)[0]) if depart is None else float(depart)
    obstacles = env.obstacles.padded(rounded_up(len(env.obstacles)))
    sea = _Sea(replace(env, current=padded(env.current), obstacles=obstacles), vehicle)
    path_times, path_room = sea.arrivals(places, start)
    distances = np.arange(len(path_room)) < _DISTANCES
    asked = np.where(distances, margin, 0.0)
    if env.seabed is not None:
        asked[_DISTANCES - 1] = float(env.seabed.clearance)
    least = np.minimum(asked, path_room) - np.where(distances, *_BLUR)
    total = path_times[-1] - path_times[0]

    i, j = np.triu_indices(len(places), 1)
    passing = path_times[j] - path_times[i]
    lines, room = sea.pass_lines(places[i], places[j], path_times[i], passing)
    admitted = (room >= least[:, None]).all(axis=0) | (j == i + 1)
    change = np.full((len(places), len(places)), np.inf)
    change[i, j] = np.where(admitted, lines - passing, np.inf)
    for chain in _chains(np.abs(change)):
        whole = len(chain) == len(places)
        estimate = abs(change[chain[:-1], chain[1:]].sum())
        if not whole and estimate > 1.5 * tolerance * total:
            continue
        arrivals, clear = sea.arrivals(places[chain], start)
        late = float((arrivals[-1] - arrivals[0]) / total - 1.0)
        if whole or (abs(late) < tolerance and (clear >= least).all()):
            return Thinned(chain, places[chain], arrivals, late, float(clear[: _DISTANCES - 1].min()))
    raise AssertionError("the path itself is among the chains")


def _chains(cost: Array) -> Iterator[NDArray[np.intp]]:
    """Cheapest ways from the first to the last sample by rising numbers of lines, as indices of samples.

    Args:
        cost: [S, S], of the line from i to j; infinite where there is none.
    """
    best, came = cost[0], []
    for _ in range(1, len(cost)):
        if np.isfinite(best[-1]):
            chain = [len(cost) - 1]
            for parents in reversed(came):
                chain.append(int(parents[chain[-1]]))
            yield np.asarray([0, *reversed(chain)])
        sums = best[:, None] + cost
        parents = sums.argmin(axis=0)
        came.append(parents)
        best = sums[parents, np.arange(len(cost))]


#: How many rows of what `_room` returns are distances: `margin` asks for all but the last, the altitude above
#: the sea bed.
_DISTANCES = 3


def _room(
    segments: tuple[Axes, Axes, jax.Array, jax.Array], speeds: Sequence[ArrayLike], env: Environment
) -> jax.Array:
    """Return how far steps keep from every limit, [limits, N]: certified distances, m, then speeds, m/s.

    Distances to whatever a vehicle may run into come first, `_DISTANCES` of them.

    Args:
        segments: first ends x, y, z and ways x, y, z, [N] m; times at the first ends and durations, [N] s.
        speeds: what is left to the vehicle's limits, [N] m/s each.
        env: the world, obstacles resolved.
    """
    starts, way, begin, duration = segments
    share = jnp.linspace(0.0, 1.0, _LOOKS + 1)[:, None]
    x, y, z = (first + share * step for first, step in zip(starts, way, strict=True))
    parts = jnp.broadcast_to(norm(way[0], way[1]) / _LOOKS, x[1:].shape)
    coast, _ = coast_clearance(x, y, parts, jnp.broadcast_to(duration / _LOOKS, parts.shape), env, _CONFIG)
    if env.closures:
        coast = jnp.minimum(coast, closed_clearance(x, y, parts, begin + share * duration, env))
    altitude = bed_altitude(x, y, z, parts, env).min(axis=0)
    return jnp.stack([coast.min(axis=0), obstacle_clearance(segments, env), altitude, *speeds])


@compiled
def _steps(
    starts: Axes, way: Axes, time: jax.Array, env: Environment, vehicle: Vehicle
) -> tuple[jax.Array, jax.Array]:
    """Durations of steps [N] s whose middles are passed at a time [N] s, and `_room`."""
    env = replace(env, obstacles=env.obstacles.resolved(env.current))
    x, y, z = (first + 0.5 * step for first, step in zip(starts, way, strict=True))
    water, gap = env.current(x, y, z, time), norm(*way)
    along = inner(water, way) / gap
    across = jnp.sqrt(jnp.maximum(inner(water, water) - along * along, 0.0))
    ground, shortfall = along_track("track", vehicle.speed, along, across)
    duration = gap / ground
    speeds = vehicle.sway_max - across, vehicle.surge_max - ground, -shortfall
    return duration, _room((starts, way, time - 0.5 * duration, duration), speeds, env)


@dataclass(frozen=True)
class _Sea:
    """What straight lines lead through.

    Attributes:
        env: the world.
        vehicle: speed and limits.
    """

    env: Environment
    vehicle: Vehicle

    def arrivals(self, places: Array, depart: float) -> tuple[Array, Array]:
        """Arrival [K] s at K places in a row, joined by straight lines, and the least room [limits]."""
        first, last = places[:-1], places[1:]
        gaps = np.linalg.norm(last - first, axis=1)
        arrivals = depart + np.concatenate([[0.0], np.cumsum(gaps / float(np.asarray(self.vehicle.speed)))])
        # Steps depend on when they are taken, and that on those before: each pass gets more of them right.
        cut = _Cut.of(first, last)
        ends = np.interp(np.arange(len(cut.line) + 1), [*cut.offsets, len(cut.line)], arrivals)
        for _ in range(_PASSES):
            duration, room = self._evaluate(cut, 0.5 * (ends[:-1] + ends[1:]))
            before, ends = ends, depart + np.concatenate([[0.0], np.cumsum(duration)])
            if np.abs(ends - before).max() < _SETTLED:
                break
        return ends[[*cut.offsets, len(cut.line)]], room.min(axis=1)

    def pass_lines(self, first: Array, last: Array, begin: Array, passing: Array) -> tuple[Array, Array]:
        """Durations [L] s of L lines, and their least room [limits, L].

        Args:
            first, last: [L, 3] m, their ends.
            begin: [L] s since the epoch, when each is begun.
            passing: [L] s that each is taken to last, which says when its steps are taken.
        """
        cut = _Cut.of(first, last)
        duration, room = self._evaluate(cut, begin[cut.line] + cut.middle * passing[cut.line])
        return np.add.reduceat(duration, cut.offsets), np.minimum.reduceat(room, cut.offsets, axis=1)

    def _evaluate(self, cut: "_Cut", time: Array) -> tuple[Array, Array]:
        """Durations [N] s of all steps, and `_room` [limits, N], in calls of one shape."""
        rows = np.concatenate([cut.start, cut.way, time[:, None]], axis=1)
        missing = -len(rows) % _TOGETHER
        # The last step, again and again, fills the last call up.
        rows = np.concatenate([rows, np.broadcast_to(rows[-1:], (missing, 7))]).astype(np.float32)
        found = []
        for part in np.split(rows, len(rows) // _TOGETHER):
            x, y, z, dx, dy, dz, when = (np.ascontiguousarray(column) for column in part.T)
            found.append(_steps((x, y, z), (dx, dy, dz), when, self.env, self.vehicle))  # type: ignore[arg-type]
        duration, room = (
            np.concatenate(parts, axis=-1) for parts in zip(*jax.device_get(found), strict=True)
        )
        return duration[: len(time)].astype(float), room[:, : len(time)].astype(float)


@dataclass(frozen=True)
class _Cut:
    """Straight lines cut into steps, one line after the other.

    Attributes:
        line: [N], which line a step belongs to.
        offsets: [L], the first step of each line.
        start: [N, 3] m, first ends.
        way: [N, 3] m, to the last ends.
        middle: [N], share of the line that is behind in the middle of a step.
    """

    line: NDArray[np.intp]
    offsets: NDArray[np.intp]
    start: Array
    way: Array
    middle: Array

    @classmethod
    def of(cls, first: Array, last: Array) -> "_Cut":
        """Cut L lines between ends [L, 3] m."""
        count = np.maximum(np.ceil(np.linalg.norm(last - first, axis=1) / STEP), 1.0).astype(int)
        offsets = np.concatenate([[0], np.cumsum(count)[:-1]])
        line = np.repeat(np.arange(len(count)), count)
        share = (np.arange(len(line)) - offsets[line]) / count[line]
        way = ((last - first) / count[:, None])[line]
        start = first[line] + share[:, None] * (last - first)[line]
        return cls(line, offsets, start, way, share + 0.5 / count[line])
