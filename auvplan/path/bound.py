"""A lower bound on the time of a path: what no path of any shape can beat.

Let c be the current, V the speed through the water, u a function of place, and

    H(x) = c(x, u(x)) . grad u + V |grad u|.

Where H <= 1 wherever a path may be, no path that is at the start at u(start) reaches any place x before u(x):

1. Over ground a vehicle moves at c + V d, |d| = 1, so that u grows along its path x(t) at most at the rate
   c(x, t) . grad u + V |grad u|.
2. Let m = t - u(x(t)), zero at the start. A current changes at a finite rate, |c(x, t) - c(x, u)| <= K |m|,
   so that m' >= 1 - H - K |grad u| |m| >= -K' |m|: m stays positive or zero, and the goal is reached at
   u(goal) or later.
3. Here u is linear on each simplex of a grid, so grad u is constant there, and H is at most what it is at
   one of the corners and |grad u| times what the current departs from means of corners (`deviation`).
4. A simplex wholly within land, obstacle or bed, margins included, needs nothing: no path may be there. Nor
   does one that no path reaches in time: let e be such a function from the start, and d one backwards from
   the goal, where it is the time of a path that is known; a quicker one is nowhere before e or after d, so
   not where e > d.
5. Any u serves. Times of arrival are the best: sweeps over the grid find them from the start and to the
   goal, u is the mean of both, and level after level of it is stretched until H <= 1 holds.
6. In depth cells are coarse, and a few of them would stretch whole levels. H is convex in grad u, so that the
   greatest u(goal) - u(start) with H <= 1 is a convex problem (`_raise`); what its rounds come to is
   stretched, and so proved, like any u. They begin with times that are the same at all depths, and have
   e and d as great and small as may be in the mean over the grid, for what paths reach.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import permutations, product
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.currents import evaluated, is_steady, varies_with_depth
from auvplan.ocean.deviation import deviation
from auvplan.ocean.environment import Environment
from auvplan.path.config import PathConfig
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle

Array = NDArray[np.floating]
Mask = NDArray[np.bool_]
#: A value or a flag for each simplex: one array over the cells for each way of cutting them.
Simplices = list[Any]

#: Cells along the way and across it, and in depth where that matters.
PLANAR, DEEP = (320, 224), (64, 32, 16)

#: Share of a clearance's scale, the longest way, and of a bound, by which single precision may be off.
_ROUNDING = 1e-5

#: Share of a limit on the ground speed by which paths may break it.
_LIMIT = 0.01

#: s, a time that is never reached; and the slowest that fields reckon with, as a share of the speed.
_NEVER, _SLOWEST = 1e9, 0.05

#: Rounds of sweeps at most, and the share of the known time by which the last one still changes a field.
_ROUNDS, _SETTLED = 100, 1e-6

#: How often a field is solved where things change, each time at the times of the one before; and in depth.
_TIMES = 5, 2

#: Cells over which times are smoothed.
_SMOOTH = 0.7

#: How often levels are stretched, by how much more than is needed, and how many levels there are.
_STRETCHES, _SHRINKS, _MORE, _LEVELS = 6, 40, 1e-5, 2000

#: Boxes that are tried for one within which a vehicle stays for as long as is known.
_NEARBY = 4

#: Cells by which a grid may reach beyond the environment's box.
_BEYOND = 3.0

#: Parts along each side, at most, in which cells are searched for their most open place.
_FINER = 6

#: How often what paths can reach is narrowed down, in the plane and in depth; how often the grid is widened;
#: how often it shrinks in depth, where that leaves at most such a share of it.
_NARROWED, _WIDENED, _SHRUNK, _WORTH = (4, 2), 8, 3, 0.7

#: Rounds in which functions in depth are raised, for what paths can reach and for the bound; how stiff these
#: are, by how much they go further than asked, and steps of Newton's method in each.
_RAISED, _STIFF, _BOLD, _NEWTON = (60, 200), 15.0, 1.6, 3

#: Depths at which a current is looked up for how it changes with depth, and the share of levels that are
#: even.
_PROBES, _EVEN = 96, 0.3


@dataclass(frozen=True)
class Bound:
    """What no path can beat.

    Attributes:
        travel_time: s; infinite where no path keeps clear of coast and obstacles.
        kind: "certified": proved, but for rounding. "estimated": the current does not say how much it may
            differ between places (it has no `deviation`), and samples in each cell stand for that.
        cells: of the grid along the way, across it, and in depth where it has layers.
    """

    travel_time: float
    kind: Literal["certified", "estimated"]
    cells: tuple[int, ...]


def lower_bound(
    start: Array,
    goal: Array,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    *,
    known: float,
    depart: float = 0.0,
    fineness: float = 1.0,
) -> Bound:
    """Bound the travel time of all paths from start to goal from below, see the module.

    It holds for every path that keeps within the box, clear of coast, sea bed and obstacles, and of the
    limit on the ground speed. Limits on turns and on the current across, and areas that are closed at some
    hours, are left out, and obstacles that move are not there.

    Args:
        start, goal: [3] m, north, east, depth.
        env: the world.
        vehicle: speed and limits.
        config: margins and the reading of speed.
        known: s, time of a path that is known; the bound is no greater.
        depart: s since the epoch.
        fineness: factor on the cells along each axis.

    Raises:
        ValueError: no time of a path is known.
    """
    if not 0.0 < known < np.inf:
        raise ValueError(f"known must be the time of a path, s, got {known:g}")
    problem = _Problem.of(start, goal, env, vehicle, config, float(known), float(depart))
    cells = tuple(max(8, round(fineness * count)) for count in (DEEP if problem.deep else PLANAR))
    coarse = tuple(max(8, count // 2) for count in cells)
    box = problem.surroundings(coarse)
    for _ in range(_WIDENED):
        grid = _Cells.of(problem, box, coarse)
        reach = grid.reach()
        if reach is None or grid.holds(reach):
            break
        box = problem.clipped(_grown(box, 1.4), coarse)
    else:
        return Bound(0.0, problem.kind, cells)
    for _ in range(_SHRUNK if problem.deep else 0):
        if reach is None or not reach.any:
            break
        narrower = grid.box_of(reach.within)
        if np.prod(np.ptp(narrower, axis=0)) > _WORTH * np.prod(np.ptp(box, axis=0)):
            break
        box = narrower
        grid = _Cells.of(problem, box, coarse)
        reach = grid.reach()
    if reach is not None and reach.any:
        grid = _Cells.of(problem, grid.box_of(reach.within), cells)
        reach = grid.reach()
    if reach is None:
        return Bound(np.inf, problem.kind, cells)
    time = min(max(grid.time(reach), problem.nearby), problem.known) if reach.any else problem.known
    return Bound(float((1.0 - _ROUNDING) * time), problem.kind, cells)


def _total(parts: Iterable[Array]) -> Array:
    return reduce(np.add, parts)


def _grown(box: Array, factor: float) -> Array:
    middle = box.mean(axis=0)
    return middle + factor * (box - middle)


@dataclass(frozen=True)
class _Problem:
    """What is bounded, in axes along the way, across it, and down; their origin is the start, at no depth.

    Attributes:
        start, goal: [d] m, in these axes; d is 2 where depth does not matter.
        turn: [2, 2], from north and east to the axes along and across.
        corner: [2] m, north and east of the origin.
        begins, rise: m, depth of the start, and how much deeper the goal is.
        depths: m, least and greatest that paths may have.
        deep: whether depth matters.
        env: the world, obstacles resolved.
        speed, fastest, steepest: m/s, through the water, at most over ground, and at most up or down.
        config: margins and the reading of speed.
        known: s.
        depart: s since the epoch.
    """

    start: Array
    goal: Array
    turn: Array
    corner: Array
    begins: float
    rise: float
    depths: tuple[float, float]
    deep: bool
    env: Environment
    speed: float
    fastest: float
    steepest: float
    config: PathConfig
    known: float
    depart: float

    @classmethod
    def of(
        cls,
        start: Array,
        goal: Array,
        env: Environment,
        vehicle: Vehicle,
        config: PathConfig,
        known: float,
        depart: float,
    ) -> "_Problem":
        start, goal = np.asarray(start, float), np.asarray(goal, float)
        way = goal[:2] - start[:2]
        heading = np.arctan2(way[1], way[0])
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        speed = float(np.asarray(vehicle.speed))
        top, bottom = float(env.lower[2]), float(env.upper[2])
        if env.seabed is not None:
            bottom = min(bottom, float(np.max(env.seabed.depth)))
        # Nothing dives so far within the known time that it matters, which the edge of the grid proves.
        farthest = known * speed
        top = max(top, min(start[2], goal[2]) - farthest)
        bottom = max(min(bottom, max(start[2], goal[2]) + farthest), top)
        env = replace(env, obstacles=env.obstacles.resolved(env.current))
        sheared = config.speed_reading != "eq11" and bottom > top and varies_with_depth(env.current)
        limit = float(np.asarray(vehicle.surge_max)) if config.speed_reading == "track" else np.inf
        steepest = float(vehicle.vertical_limits.get("pitch", speed))
        flat = cls(
            np.zeros(2), turn @ way, turn, start[:2], start[2], goal[2] - start[2], (top, bottom), False, env,
            speed, (1.0 + _LIMIT) * limit, steepest, config, known, depart,
        )  # fmt: skip
        if not sheared:
            return flat
        ends = (np.append(end, depth) for end, depth in ((flat.start, start[2]), (flat.goal, goal[2])))
        return replace(flat, **dict(zip(("start", "goal"), ends, strict=True)), deep=True)

    @property
    def kind(self) -> Literal["certified", "estimated"]:
        """Whether the current says how much it differs between places."""
        place = tuple(np.zeros(1) for _ in range(4))
        found = (
            self.config.speed_reading == "eq11" or deviation(self.env.current, place, (0.0,) * 4) is not None
        )
        return "certified" if found else "estimated"

    @property
    def nearby(self) -> float:
        """Bound, s, by the currents within reach, each at most r from their mean m; zero where none is known.

        What is D away in T was gone at no more than V + r relative to m: |D - m T| <= (V + r) T, exact in a
        uniform current. Grids in the plane leave out how much deeper the goal is, and how steeply it is gone.
        """
        if self.config.speed_reading != "track" or (met := self._within_reach) is None:
            return 0.0
        mean, off = met
        way, drift = (
            np.append(self.goal[:2] - self.start[:2], self.rise),
            np.append(self.turn @ mean[:2], mean[2]),
        )
        along = way @ drift
        root = along**2 + ((self.speed + off) ** 2 - drift @ drift) * (way @ way)
        ahead = along + np.sqrt(root) if root >= 0.0 else 0.0
        straight = way @ way / ahead if ahead > 0.0 else 0.0
        return max(float(straight), abs(self.rise) / ((1.0 + _LIMIT) * self.steepest + abs(mean[2]) + off))

    @property
    def _within_reach(self) -> tuple[Array, float] | None:
        """Mean [3] m/s of the currents that may be met in the known time, and how far they are from it."""
        half = self.known * self.speed
        middle = np.array([*self.corner, self.begins, self.depart + 0.5 * self.known])
        place = [np.full(1, axis) for axis in middle]
        for _ in range(_NEARBY):
            edges = np.array([half, half, half, 0.5 * self.known])
            corners = middle + edges * np.array(list(product((-1.0, 1.0), repeat=4)))
            met = np.stack(evaluated(self.env.current, *corners.T), axis=1)
            mean = met.mean(axis=0)
            departs = deviation(self.env.current, place, tuple(2.0 * edges))
            if departs is None:
                between = np.concatenate(evaluated(self.env.current, *place))
                departs = 2.0 * np.linalg.norm(between - mean)
            off = float(np.linalg.norm(met - mean, axis=1).max() + np.max(departs))
            reach = self.known * (self.speed + np.linalg.norm(mean) + off)
            if reach <= half:
                return mean, off
            if off > self.speed:
                break
            half = 1.01 * reach
        return None

    @property
    def distance(self) -> float:
        """Level distance from start to goal, m."""
        return float(self.goal[0])

    def at(self, axes: Sequence[Array], level: bool = False) -> tuple[Array, Array, Array]:
        """Return north, east, depth of places along the axes; in the middle of all depths if `level`."""
        x = self.corner[0] + self.turn[0, 0] * axes[0] + self.turn[1, 0] * axes[1]
        y = self.corner[1] + self.turn[0, 1] * axes[0] + self.turn[1, 1] * axes[1]
        z = axes[2] if self.deep and not level else np.full(np.shape(x), 0.5 * sum(self.depths))
        return x, y, z

    def current(self, places: Sequence[Array], times: Array) -> list[Array]:
        """Return the current along the axes at places and times since departure, m/s."""
        x, y, z = places
        u, v, w = evaluated(self.env.current, x, y, z, self.depart + times)
        level = [turn[0] * u + turn[1] * v for turn in self.turn]
        return [*level, w] if self.deep else level

    def profiles(self) -> tuple[Array, Array]:
        """Return depths [n] m, and the current there [places and times, n, 3] m/s."""
        depths = np.linspace(self.depths[0], self.depths[1], _PROBES)
        shares, across, times = np.linspace(0.0, 1.0, 7), (-0.2, 0.0, 0.2), (0.0, 0.5, 1.0)
        found = []
        for share, aside, time in product(shares, across, times):
            along, aside = (np.full(_PROBES, part * self.distance) for part in (share, aside))
            x, y, _ = self.at((along, aside), level=True)
            when = np.full(_PROBES, self.depart + time * self.known)
            found.append(np.stack(evaluated(self.env.current, x, y, depths, when), axis=1))
        return depths, np.stack(found)

    def levels(self, top: float, bottom: float, count: int) -> Array:
        """Return depths [count + 1] m, the denser the more the current changes with depth."""
        depths, found = self.profiles()
        change = np.linalg.norm(np.diff(found, axis=1), axis=2).max(axis=0)
        share = _EVEN / len(change) + (1.0 - _EVEN) * change / max(change.sum(), 1e-12)
        inside = np.interp((top, bottom), depths, np.r_[0.0, np.cumsum(share)])
        levels = np.interp(np.linspace(inside[0], inside[1], count + 1), np.r_[0.0, np.cumsum(share)], depths)
        levels[[0, -1]] = top, bottom
        # Where the slope of the current with depth jumps, a level spares cells what that adds.
        jumps = np.asarray(getattr(self.env.current, "depths", ()), float).ravel()
        jumps = jumps[(jumps > top) & (jumps < bottom)]
        if 0 < len(jumps) <= count // 2:
            levels[1 + np.argmin(np.abs(levels[1:-1, None] - jumps), axis=0)] = jumps
        return (
            np.unique(levels) if len(np.unique(levels)) == count + 1 else np.linspace(top, bottom, count + 1)
        )

    def surroundings(self, cells: Sequence[int]) -> Array:
        """Return a box, [2, d] m, in which paths of the known time keep, by currents looked up in places."""
        place = np.linspace(-1.0, 1.0, 25)
        lower, upper = (np.asarray(corner, float) for corner in (self.env.lower, self.env.upper))
        half = max(self.distance, self.known * self.speed)
        low = np.maximum(lower[:2], self.corner - half)
        high = np.minimum(upper[:2], self.corner + half)
        x, y, z = np.meshgrid(*(0.5 * (a + b + place * (b - a)) for a, b in zip(low, high, strict=True)),
                              np.linspace(*self.depths, 5 if self.deep else 1), indexing="ij")  # fmt: skip
        strongest = 0.0
        for time in (0.0, 0.5, 1.0):
            u, v, _ = evaluated(self.env.current, x, y, z, np.full(x.shape, self.depart + time * self.known))
            strongest = max(strongest, float(np.hypot(u, v).max()))
        # An ellipse, and more room than it needs where it is slim: the grid has to prove that nothing leaves
        # it.
        reach = max(0.5 * self.known * min(self.speed + strongest, self.fastest), 0.65 * self.distance)
        aside = max(np.sqrt(max(reach**2 - (0.5 * self.distance) ** 2, 0.0)), 0.4 * self.distance)
        box = np.array([[0.5 * self.distance - reach, -aside], [0.5 * self.distance + reach, aside]])
        return self.clipped(_grown(box, 1.1), cells)

    def clipped(self, box: Array, cells: Sequence[int]) -> Array:
        """Return a box cut to the environment's, with all depths."""
        lower, upper = (np.asarray(corner, float)[:2] for corner in (self.env.lower, self.env.upper))
        box = box[:, :2].copy()
        if np.isfinite([lower, upper]).all():
            corners = np.array(list(product(*zip(lower, upper, strict=True)))) - self.corner
            turned = corners @ self.turn.T
            # Some cells more, so that the grid's edge is closed where it is the box's.
            beyond = _BEYOND * np.ptp(turned, axis=0) / cells[:2]
            box[0] = np.maximum(box[0], turned.min(axis=0) - beyond)
            box[1] = np.minimum(box[1], turned.max(axis=0) + beyond)
        return np.c_[box, self.depths] if self.deep else box

    @property
    def slack(self) -> float:
        """M, by which rulers let paths miss a clearance."""
        sides = np.asarray(self.env.upper, float)[:2] - np.asarray(self.env.lower, float)[:2]
        longest = max(sides[np.isfinite(sides)], default=0.0)
        return _ROUNDING * max(self.distance, longest)


@dataclass(frozen=True)
class _Reach:
    """Where paths of the known time can be, and when.

    Attributes:
        arrivals: [nodes] s since departure, the first arrival and the last departure: in the plane as the
            sweeps found them, in depth those that are proved.
        first, last: [nodes] s since departure, between which they are there, proved.
        within: simplices that they can be in.
    """

    arrivals: tuple[Array, Array]
    first: Array
    last: Array
    within: Simplices

    @property
    def any(self) -> bool:
        """Whether they can be anywhere: if not, there is none of the known time."""
        return any(bool(chosen.any()) for chosen in self.within)


@dataclass(frozen=True)
class _Cells:
    """A grid of cells cut into simplices: along each diagonal way from the lowest to the highest corner.

    Attributes:
        problem: that it is for.
        axes: [n] m each, nodes along the axes, rising.
    """

    problem: _Problem
    axes: tuple[Array, ...]

    @classmethod
    def of(cls, problem: _Problem, box: Array, cells: Sequence[int]) -> "_Cells":
        axes = [np.linspace(box[0, k], box[1, k], cells[k] + 1) for k in range(2)]
        if problem.deep:
            slack = problem.slack
            levels = problem.levels(box[0, 2], box[1, 2], cells[2])
            levels[[0, -1]] += -slack, slack
            axes.append(levels)
        return cls(problem, tuple(axes))

    @cached_property
    def places(self) -> tuple[Array, Array, Array]:
        """North, east, depth of the nodes."""
        return self.problem.at(np.meshgrid(*self.axes, indexing="ij"))

    @cached_property
    def centres(self) -> tuple[Array, Array, Array]:
        """North, east, depth of the cells' centres."""
        middle = [0.5 * (axis[1:] + axis[:-1]) for axis in self.axes]
        return self.problem.at(np.meshgrid(*middle, indexing="ij"))

    @cached_property
    def edges(self) -> tuple[Any, Any, Any]:
        """M, how far cells reach north, east and down."""
        along, across = (axis[1] - axis[0] for axis in self.axes[:2])
        turn = np.abs(self.problem.turn)
        down = np.diff(self.axes[2]) if self.problem.deep else 0.0
        return along * turn[0, 0] + across * turn[1, 0], along * turn[0, 1] + across * turn[1, 1], down

    @property
    def dimensions(self) -> int:
        return len(self.axes)

    def corners(self, nodes: NDArray[Any]) -> Iterator[tuple[tuple[int, ...], list[Array]]]:
        """Yield, for every cut, the order of axes and the values [cells] at the corners of its simplices."""
        for order in permutations(range(self.dimensions)):
            step, values = [0] * self.dimensions, []
            for axis in (None, *order):
                if axis is not None:
                    step[axis] = 1
                values.append(nodes[tuple(slice(1, None) if s else slice(None, -1) for s in step)])
            yield order, values

    def spread(self, simplices: Simplices) -> Mask:
        """Return the nodes that are a corner of a simplex of those that are chosen."""
        nodes = np.zeros(self.places[0].shape, bool)
        for (_, views), chosen in zip(self.corners(nodes), simplices, strict=True):
            for view in views:
                view |= chosen
        return nodes

    def weights(self, place: Array) -> Array:
        """Return the weights [nodes] with which values at nodes make that at a place, [d] m."""
        index, shares = [], []
        for axis, where in zip(self.axes, place, strict=True):
            k = int(np.clip(np.searchsorted(axis, where, side="right") - 1, 0, len(axis) - 2))
            index.append(k)
            shares.append((where - axis[k]) / (axis[k + 1] - axis[k]))
        found, rest = np.zeros([len(axis) for axis in self.axes]), 1.0
        for axis in np.argsort(shares)[::-1]:
            found[tuple(index)] = rest - shares[axis]
            rest = shares[axis]
            index[axis] += 1
        found[tuple(index)] = rest
        return found

    def value(self, nodes: Array, place: Array) -> float:
        """Return a function at a place, [d] m."""
        weights = self.weights(place)
        held = weights != 0.0
        return float(weights[held] @ nodes[held])

    # What is closed

    @cached_property
    def open(self) -> Simplices:
        """Simplices that a path may be in, as far as land, bed, box and fixed obstacles say."""
        problem, env, slack = self.problem, self.problem.env, 2.0 * self.problem.slack
        x, y, z = self.places
        closed: Simplices = [np.zeros(tuple(len(axis) - 1 for axis in self.axes), bool) for _ in self._orders]

        def close(nodes: Array) -> None:
            """Close simplices at all corners of which a convex function is negative."""
            for (_, values), flags in zip(self.corners(nodes), closed, strict=True):
                flags |= np.maximum.reduce(values) < 0.0

        for axis, low, high in zip((x, y), env.lower, env.upper, strict=False):
            close(axis - float(low) + slack)
            close(float(high) - axis + slack)
        if env.chart is not None:
            margin = problem.config.coast_margin + INTERPOLATION_ERROR * float(env.chart.pixel_size)
            for flags, most in zip(closed, self._highest(env.chart, env.chart.signed_distance), strict=True):
                flags |= most < margin - slack
        if env.seabed is not None:
            # No place of a cell is shallower than its top.
            top = z[..., :-1].min(axis=(0, 1)) if problem.deep else problem.depths[0]
            least = float(env.seabed.clearance) + top - slack
            for flags, most in zip(closed, self._highest(env.seabed, env.seabed.depth), strict=True):
                flags |= most < least
        for clearance in self._standing():
            close(clearance + slack)
        return [~flags for flags in closed]

    def _highest(self, raster: Any, values: Any) -> Iterator[Array]:
        """Yield, for every cut, the most that a raster has in simplices, whatever their depth.

        It is looked up on a finer grid. What lies between rises by no more than the steepest slope around.
        """
        values, size = np.asarray(values, float), float(raster.pixel_size)
        gaps = [float(axis[1] - axis[0]) for axis in self.axes[:2]]
        diagonal = float(np.hypot(gaps[0], gaps[1]))
        parts = int(np.clip(np.ceil(2.0 * max(gaps) / size), 1, _FINER))
        fine = [np.linspace(axis[0], axis[-1], parts * (len(axis) - 1) + 1) for axis in self.axes[:2]]
        origin = np.asarray(raster.origin, float)

        def pixels(axes: Sequence[Array]) -> list[Array]:
            level = self.problem.at(np.meshgrid(*axes, indexing="ij"), level=True)
            return [(place - corner) / size - 0.5 for place, corner in zip(level, origin, strict=False)]

        found = scipy.ndimage.map_coordinates(values, pixels(fine), order=1, mode="nearest")
        north, east = (np.abs(np.diff(values, axis=axis)) for axis in (0, 1))
        steep = np.hypot(np.maximum(north[:, 1:], north[:, :-1]), np.maximum(east[1:], east[:-1])) / size
        around = 2 * int(np.ceil(0.5 * diagonal / size)) + 3
        steep = scipy.ndimage.maximum_filter(steep, around, mode="nearest")
        middle = [0.5 * (axis[1:] + axis[:-1]) for axis in self.axes[:2]]
        index = [
            np.clip(place.astype(int), 0, count - 1)
            for place, count in zip(pixels(middle), steep.shape, strict=True)
        ]
        rise = 0.5 * diagonal / parts * steep[tuple(index)]
        cells = tuple(len(axis) - 1 for axis in self.axes[:2])
        for order in self._orders:
            most = np.full(cells, -np.inf)
            for i, j in product(range(parts + 1), repeat=2):
                if (i >= j) if order.index(0) < order.index(1) else (j >= i):
                    np.maximum(most, found[i::parts, j::parts][: cells[0], : cells[1]], out=most)
            most = most + rise
            yield most[..., None] if self.dimensions == 3 else most

    @cached_property
    def _orders(self) -> list[tuple[int, ...]]:
        return list(permutations(range(self.dimensions)))

    def _standing(self) -> Iterator[Array]:
        """Yield m from the nodes to each obstacle that stands, with its margin; most over free depths."""
        found, (x, y, z) = self.problem.env.obstacles, self.places
        reach = np.asarray(found.boundary(found.observed_at), float) + self.problem.config.obstacle_margin
        stands = np.asarray(found.active) & ~np.asarray(found.velocity).any(axis=1)
        for (north, east, down), radius in zip(
            np.asarray(found.position, float)[stands], reach[stands], strict=True
        ):
            below = z - down if self.problem.deep else max(abs(end - down) for end in self.problem.depths)
            yield np.sqrt((x - north) ** 2 + (y - east) ** 2 + below**2) - radius

    @property
    def _steady(self) -> bool:
        return is_steady(self.problem.env.current) or self.problem.config.speed_reading == "eq11"

    # How fast functions grow

    def current(self, times: Array) -> list[Array]:
        """Return the current along the axes at the nodes at times [nodes] s since departure, m/s."""
        if self.problem.config.speed_reading == "eq11":
            return [np.zeros(times.shape)] * self.dimensions
        return self._still if self._steady else self.problem.current(self.places, times)

    @cached_property
    def _still(self) -> list[Array]:
        return self.problem.current(self.places, np.zeros(self.places[0].shape))

    def departure(self, times: Array) -> Array:
        """How far the current in cells may depart from means of corners, m/s, met at times [nodes] s."""
        if self.problem.config.speed_reading == "eq11":
            return np.zeros(self.centres[0].shape)
        return self._still_departure if self._steady else self._departure(times)

    @cached_property
    def _still_departure(self) -> Array:
        return self._departure(np.zeros(self.places[0].shape))

    def _departure(self, times: Array) -> Array:
        problem, steps = self.problem, list(product((0, 1), repeat=self.dimensions))
        at = [times[tuple(slice(s, s - 1 or None) for s in step)] for step in steps]
        least, most = np.minimum.reduce(at), np.maximum.reduce(at)
        # Times that matter lie within those of the known path.
        least, most = (np.clip(edge, 0.0, problem.known) for edge in (least, most))
        where = (*self.centres, problem.depart + 0.5 * (least + most))
        found = deviation(problem.env.current, where, (*self.edges, most - least))
        if found is not None:
            return np.broadcast_to(found, least.shape)
        middle = problem.current(self.centres, 0.5 * (least + most))
        mean = [
            np.mean([part[tuple(slice(s, s - 1 or None) for s in step)] for step in steps], axis=0)
            for part in self.current(times)
        ]
        return 2.0 * np.sqrt(sum((a - b) ** 2 for a, b in zip(middle, mean, strict=True)))

    def rates(self, times: Array) -> Simplices:
        """Return H of the module's text in each simplex."""
        reading, speed, fastest = (
            self.problem.config.speed_reading, self.problem.speed, self.problem.fastest,
        )  # fmt: skip
        water, departs = self.current(times), self.departure(times)
        spacing = [np.diff(axis).reshape([-1 if k == i else 1 for k in range(self.dimensions)])
                   for i, axis in enumerate(self.axes)]  # fmt: skip
        at_corners = [[values for _, values in self.corners(part)] for part in water]
        found = []
        for n, (order, values) in enumerate(self.corners(times)):
            slopes = [np.zeros(0)] * self.dimensions
            for axis, low, high in zip(order, values[:-1], values[1:], strict=True):
                slopes[axis] = (high - low) / spacing[axis]
            steep = np.sqrt(_total(slope * slope for slope in slopes))
            along = [
                _total(part[n][k] * slope for part, slope in zip(at_corners, slopes, strict=True))
                for k in range(self.dimensions + 1)
            ]
            drift = np.maximum.reduce(along) + departs * steep
            if reading == "eq8":  # (e . grad u)(V + c . e) over all headings e
                speeds = np.sqrt(np.maximum.reduce([_total(part[n][k] ** 2 for part in at_corners)
                                                    for k in range(self.dimensions + 1)]))  # fmt: skip
                drift = 0.5 * (drift + (speeds + departs) * steep)
            found.append(np.minimum(drift + speed * steep, fastest * steep))
        return found

    def proved(self, times: Array, within: Simplices, place: Array, time: float) -> Array:
        """Stretch a function until it is proved where paths may be, and has a value at a place.

        Args:
            times: [nodes] s.
            within: simplices that matter.
            place: [d] m.
            time: s, the value there.
        """
        for attempt in range(_STRETCHES + _SHRINKS):
            times = times + (time - self.value(times, place))
            rates = self.rates(times)
            worst = max(
                float(np.max(rate, where=chosen, initial=0.0))
                for rate, chosen in zip(rates, within, strict=True)
            )
            if worst <= 1.0 and attempt > 1:
                return times
            if attempt < _STRETCHES:
                times = self._stretched(times, rates, within)
            else:
                times = times / (worst * (1.0 + _MORE))
        return np.full(times.shape, time)

    def _stretched(self, times: Array, rates: Simplices, within: Simplices) -> Array:
        """Return a function of it that grows at every level as fast as all of the level allows."""
        low, high, rate = [], [], []
        for (_, values), speed, chosen in zip(self.corners(times), rates, within, strict=True):
            low.append(np.minimum.reduce(values)[chosen])
            high.append(np.maximum.reduce(values)[chosen])
            rate.append(speed[chosen])
        lows, highs, speeds = (np.concatenate(part) for part in (low, high, rate))
        marks = np.linspace(lows.min(), highs.max() + 1e-9, _LEVELS + 1)
        first, last = (
            np.clip(np.searchsorted(marks, ends, side="right") - 1, 0, _LEVELS - 1) for ends in (lows, highs)
        )
        most = _greatest_over(first, last, speeds, _LEVELS)
        grown = np.r_[0.0, np.cumsum(np.diff(marks) / (np.maximum(most, 1e-3) * (1.0 + _MORE)))]
        return np.interp(times, marks, grown)

    # Times of arrival

    def reach(self) -> _Reach | None:
        """Find where and when paths of the known time can be; None where nothing joins start and goal."""
        problem, known = self.problem, self.problem.known
        joined, _ = scipy.ndimage.label(self.spread(self.open), np.ones((3,) * self.dimensions))  # type: ignore[misc]
        ends = [self._nearest(end) for end in (problem.start, problem.goal)]
        if joined[ends[0]] == 0 or joined[ends[0]] != joined[ends[1]]:
            return None
        nodes = joined == joined[ends[0]]
        within = [
            flags & np.logical_and.reduce(values)
            for flags, (_, values) in zip(self.open, self.corners(nodes), strict=True)
        ]
        arrivals = first, last = rough = self._arrivals(nodes)
        if problem.deep:
            rough = self._smoothed((_over_depths(np.min, first), _over_depths(np.max, last)))
        for _ in range(_NARROWED[problem.deep]):
            if problem.deep:
                everywhere = self._everywhere(within)
                begin, end = (self.weights(place) for place in (problem.start, problem.goal))
                rough = (
                    self._raised(rough[0], within, everywhere - begin, _RAISED[0]),
                    self._raised(rough[1], within, end - everywhere, _RAISED[0]),
                )
            first = self.proved(rough[0], within, problem.start, 0.0)
            last = self.proved(rough[1], within, problem.goal, known)
            late = first > last
            narrower = [
                flags & ~np.logical_and.reduce(values)
                for flags, (_, values) in zip(within, self.corners(late), strict=True)
            ]
            before, after = (sum(int(flags.sum()) for flags in part) for part in (within, narrower))
            within = narrower
            if after == 0 or after > 0.97 * before:
                break
        return _Reach((first, last) if problem.deep else arrivals, first, last, within)

    def _nearest(self, place: Array) -> tuple[int, ...]:
        return tuple(
            int(np.argmin(np.abs(axis - where))) for axis, where in zip(self.axes, place, strict=True)
        )

    def _arrivals(self, nodes: Mask) -> tuple[Array, Array]:
        """Return the first arrival and the last departure at the nodes that are open, s; not proved."""
        problem, known = self.problem, self.problem.known
        along = np.meshgrid(*self.axes, indexing="ij")
        still = [
            np.sqrt(sum((axis - at) ** 2 for axis, at in zip(along, end, strict=True))) / problem.speed
            for end in (problem.start, problem.goal)
        ]
        first, last = still[0], known - still[1]
        for _ in range(1 if self._steady else _TIMES[problem.deep]):
            found = []
            for times, end, sign in ((first, problem.start, 1.0), (last, problem.goal, -1.0)):
                water = self.current(np.clip(times, 0.0, known))
                found.append(self._field([sign * part for part in water], nodes, end))
            first, last = found[0], known - found[1]
        return np.minimum(first, 1.5 * known), np.maximum(last, -0.5 * known)

    def _field(self, water: list[Array], nodes: Mask, end: Array) -> Array:
        """Return the least times [nodes] s from an end in a current; elsewhere that of the nearest node."""
        speed, near = self.problem.speed, np.ones(nodes.shape, bool)
        away = []
        for k, (axis, at) in enumerate(zip(self.axes, end, strict=True)):
            step = (
                np.diff(axis)[max(0, np.searchsorted(axis, at) - 1)] if at < axis[-1] else axis[-1] - axis[-2]
            )
            line = (axis - at).reshape([-1 if k == i else 1 for i in range(self.dimensions)])
            near = near & (np.abs(line) < 2.01 * step)
            away.append(line)
        c = [self.value(part, end) for part in water]
        square, drift = sum(a * a for a in away), sum(a * b for a, b in zip(away, c, strict=True))
        ahead = drift + np.sqrt(np.maximum(drift**2 + (speed**2 - sum(b * b for b in c)) * square, 0.0))
        times = square / np.maximum(ahead, _SLOWEST * speed * np.sqrt(square) + 1e-9)
        seeds = np.where(near & nodes, times, _NEVER)
        single = [jnp.asarray(part, jnp.float32) for part in (seeds, *water)]
        spacing = tuple(jnp.asarray(np.diff(axis), jnp.float32) for axis in self.axes)
        settled = _SETTLED * self.problem.known
        found = np.asarray(
            _swept(single[0], tuple(single[1:]), jnp.asarray(nodes), spacing, speed, settled), float
        )
        missing = found > 0.5 * _NEVER
        if missing.any():
            index = scipy.ndimage.distance_transform_edt(missing, return_distances=False, return_indices=True)
            found = found[tuple(index)]  # type: ignore[arg-type]
        return found

    # What follows

    def holds(self, reach: _Reach) -> bool:
        """Whether no path of the known time leaves the grid: none that left in time would be back in time."""
        nodes = self.spread(self.open)
        edge = np.zeros(nodes.shape, bool)
        for k in range(self.dimensions):
            sides = np.moveaxis(edge, k, 0)
            sides[[0, -1]] = True
        if self.problem.deep:
            lower, upper = (float(corner[2]) for corner in (self.problem.env.lower, self.problem.env.upper))
            top, bottom = self.problem.depths
            inner = np.moveaxis(edge, -1, 0)
            if top <= lower:
                inner[0] = edge[..., 1]
            if bottom >= upper or self.problem.env.seabed is not None:
                inner[-1] = edge[..., 1]
        edge &= nodes
        return not edge.any() or float(reach.first[edge].min()) > float(reach.last[edge].max())

    def box_of(self, within: Simplices) -> Array:
        """Return the box, [2, d] m, of some simplices."""
        cells = np.logical_or.reduce(within)
        low, high = [], []
        for k, axis in enumerate(self.axes):
            held = np.flatnonzero(cells.any(axis=tuple(i for i in range(self.dimensions) if i != k)))
            low.append(axis[held[0]])
            high.append(axis[held[-1] + 1])
        return np.array([low, high])

    def time(self, reach: _Reach) -> float:
        """Return the time that no path beats, s: the best of the proved functions at the goal."""
        goal, mean = self.problem.goal, 0.5 * _total(reach.arrivals)
        if self.problem.deep:
            load = self.weights(goal) - self.weights(self.problem.start)
            other = self._raised(mean, reach.within, load, _RAISED[1])
        else:
            other = 0.5 * _total(self._smoothed(reach.arrivals))
        proved = [self.proved(times, reach.within, self.problem.start, 0.0) for times in (mean, other)]
        return max(self.value(times, goal) for times in (reach.first, *proved))

    def _everywhere(self, within: Simplices) -> Array:
        """Return the share [nodes] of the volume that each node of some simplices stands for."""
        held = self.spread(within) * reduce(np.multiply.outer, [_lumped(axis) for axis in self.axes])
        return held / max(held.sum(), 1e-300)

    def _raised(self, times: Array, within: Simplices, load: Array, rounds: int) -> Array:
        """Return about the function with the greatest mean by some weights of those that keep H <= 1.

        Speeds over ground in a simplex are within a ball: where b is its middle and r its radius, b . grad u
        + r |grad u| <= 1 is asked.

        Args:
            times: [nodes] s, where it begins, and when currents are met.
            within: simplices that matter.
            load: [nodes], weights, zero in all.
            rounds: of `_raise`.
        """
        speed, fastest, known = self.problem.speed, self.problem.fastest, self.problem.known
        water, departs, middles, radii = self.current(times), self.departure(times), [], []
        corners = zip(*([values for _, values in self.corners(part)] for part in water), strict=True)
        for values, chosen in zip(corners, within, strict=True):
            middle = [_total(part) / len(part) for part in values]
            off = [_total((a - b) ** 2 for a, b in zip(at, middle, strict=True))
                   for at in zip(*values, strict=True)]  # fmt: skip
            radius, square = np.sqrt(np.maximum.reduce(off)) + departs, _total(part**2 for part in middle)
            if self.problem.config.speed_reading == "eq8":  # headings count by what they make good
                radius, square = radius + 0.5 * np.sqrt(square), 0.25 * square
                middle = [0.5 * part for part in middle]
            # The ball about what two balls share, this one and that of the limit.
            radius = speed + radius
            share = np.clip(0.5 + 0.5 * (fastest**2 - radius**2) / np.maximum(square, 1e-12), 0.0, 1.0)
            radius = np.where(share < 1.0, np.sqrt(fastest**2 - share**2 * square), radius)
            middles.append([np.where(chosen, share * part / speed, 0.0) for part in middle])
            radii.append(np.where(chosen, radius / speed, 0.0))
        axes = [axis / (speed * known) for axis in self.axes]
        modes, squares = zip(*map(_modes, axes), strict=True)
        square = reduce(np.add.outer, squares)
        inverse = np.where(square > 0.0, 1.0 / np.where(square > 0.0, square, 1.0), 0.0)
        area = np.prod([np.ptp(axis) for axis in axes[1:]])
        single = jax.tree.map(
            lambda part: jnp.asarray(part, jnp.float32),
            (times / known, [np.stack(part) for part in zip(*middles, strict=True)], np.stack(radii),
             [np.diff(axis) for axis in axes], list(modes), inverse, load * area / _STIFF),
        )  # fmt: skip
        return np.asarray(_raise(*single, rounds), float) * known

    def _smoothed(self, arrivals: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return times without the kinks where two ways meet: cells across them mix the slopes of both."""
        first, last = (scipy.ndimage.gaussian_filter(times, _SMOOTH, mode="nearest") for times in arrivals)
        return first, last


def _over_depths(best: Callable[..., Any], times: Array) -> Array:
    return np.broadcast_to(best(times, axis=-1, keepdims=True), times.shape)


def _lumped(axis: Array) -> Array:
    """Return the length that each node of an axis stands for."""
    return np.convolve(np.diff(axis), (0.5, 0.5))


def _modes(axis: Array) -> tuple[Array, Array]:
    """Return the functions [n, modes] that diagonalise the second differences on an axis, and -them."""
    root, slopes = np.sqrt(_lumped(axis)), np.diff(np.eye(len(axis)), axis=0)
    stiff = slopes.T @ (slopes / np.diff(axis)[:, None])
    squares, modes = np.linalg.eigh(stiff / np.outer(root, root))
    squares[0] = 0.0
    return modes / root[:, None], squares


def _greatest_over(first: NDArray[np.int_], last: NDArray[np.int_], values: Array, count: int) -> Array:
    """[count], the greatest of the values whose range, first to last, holds each index; zero without one."""
    length = last - first + 1
    power = np.floor(np.log2(length)).astype(int)
    found = np.zeros((power.max(initial=0) + 1, count))
    np.maximum.at(found, (power, first), values)
    np.maximum.at(found, (power, last - 2**power + 1), values)
    for k in range(len(found) - 1, 0, -1):
        half = 2 ** (k - 1)
        np.maximum(found[k - 1], found[k], out=found[k - 1])
        np.maximum(found[k - 1, half:], found[k, :-half], out=found[k - 1, half:])
    return found[0]


def _swept_until_settled(
    times: jax.Array,
    water: tuple[jax.Array, ...],
    nodes: jax.Array,
    spacing: tuple[jax.Array, ...],
    speed: jax.Array,
    settled: jax.Array,
) -> jax.Array:
    """Lower times [nodes] s, where they are known by some nodes, to those of the quickest ways over the grid.

    Args:
        times: `_NEVER` where not known.
        water: m/s along each axis.
        nodes: that are open.
        spacing: m along each axis.
        speed: m/s.
        settled: s, the change that ends it.
    """

    def round_(state: tuple) -> tuple:
        last, _, count = state
        found = last
        for axis in range(last.ndim):
            found = _along(found, water, nodes, spacing, speed, axis, False)
            found = _along(found, water, nodes, spacing, speed, axis, True)
        change = jnp.max(jnp.where(found < 0.5 * _NEVER, last - found, 0.0))
        return found, change, count + 1

    def going(state: tuple) -> jax.Array:
        return (state[1] > settled) & (state[2] < _ROUNDS)

    return jax.lax.while_loop(going, round_, (times, jnp.asarray(jnp.inf, times.dtype), 0))[0]


_swept = compiled(_swept_until_settled)


def _raise_in_rounds(
    times: jax.Array,
    middles: list[jax.Array],
    radii: jax.Array,
    gaps: list[jax.Array],
    modes: list[jax.Array],
    inverse: jax.Array,
    load: jax.Array,
    rounds: jax.Array,
) -> jax.Array:
    """Maximise load . u over functions with b . grad u + r |grad u| <= 1 in every simplex, about.

    Alternating directions (ADMM): the slopes nearest to those of u that are allowed, the function nearest to
    these, and multipliers, what they differ by in sum.

    Args:
        times: [nodes] u at first, in any unit.
        middles, radii: [cuts, cells] b along each axis, and r; zero where nothing is asked.
        gaps: between nodes along each axis.
        modes, inverse: that invert the Laplacian of the grid, see `_modes`.
        load: [nodes], as much greater as the rounds are bolder.
        rounds: how many.
    """
    count = times.ndim
    shaped = [gap.reshape([-1 if k == i else 1 for k in range(count)]) for i, gap in enumerate(gaps)]
    volume = reduce(jnp.multiply, shaped) / len(radii)

    def slopes(u: jax.Array) -> list[jax.Array]:
        found: list[list[jax.Array]] = [[] for _ in range(count)]
        along = [jnp.diff(u, axis=k) / shaped[k] for k in range(count)]
        for order in permutations(range(count)):
            sides = [slice(None, -1)] * count
            for axis in order:
                sides[axis] = slice(None)
                found[axis].append(along[axis][tuple(sides)])
                sides[axis] = slice(1, None)
        return [jnp.stack(part) for part in found]

    def solved(u: jax.Array) -> jax.Array:
        for mode in modes:  # each brings the next axis to the front
            u = jnp.tensordot(u, mode, axes=(0, 0))
        u = u * inverse
        for mode in modes:
            u = jnp.tensordot(u, mode, axes=(0, 1))
        return u

    _, gathered = jax.vjp(slopes, times)

    def round_(_: jax.Array, state: tuple) -> tuple:
        u, allowed, multipliers = state
        now = slopes(u)
        mixed = [_BOLD * a + (1.0 - _BOLD) * b + c for a, b, c in zip(now, allowed, multipliers, strict=True)]
        allowed = _nearest_allowed(mixed, middles, radii)
        multipliers = [a - b for a, b in zip(mixed, allowed, strict=True)]
        off = [volume * (a - b - c) for a, b, c in zip(allowed, multipliers, now, strict=True)]
        return u + solved(load + gathered(off)[0]), allowed, multipliers

    first = slopes(times)
    state = times, first, [jnp.zeros_like(part) for part in first]
    return jax.lax.fori_loop(0, rounds, round_, state)[0]


_raise = compiled(_raise_in_rounds)


def _nearest_allowed(slopes: list[jax.Array], middles: list[jax.Array], radii: jax.Array) -> list[jax.Array]:
    """Return the nearest g with b . g + r |g| <= 1, about.

    It is along w = q - m b, as long as |w| - m r, where m solves (b . w / |w| + r) (|w| - m r) = 1: by
    Newton's method, from below.
    """

    def dot(a: list[jax.Array], b: list[jax.Array]) -> jax.Array:
        return reduce(jnp.add, (x * y for x, y in zip(a, b, strict=True)))

    square, drift, water = dot(slopes, slopes), dot(middles, slopes), dot(middles, middles)

    def long(m: jax.Array) -> jax.Array:
        return jnp.sqrt(jnp.maximum(square - 2.0 * m * drift + m * m * water, 1e-12))

    m = jnp.zeros_like(radii)
    for _ in range(_NEWTON):
        length = long(m)
        ahead, rest = (drift - m * water) / length, length - m * radii
        over = (ahead + radii) * rest - 1.0
        fall = (water - ahead**2) / length * rest + (ahead + radii) ** 2
        m = jnp.maximum(m + over / jnp.maximum(fall, 1e-6), 0.0)
    share = jnp.maximum(1.0 - m * radii / long(m), 0.0)
    return [share * (a - m * b) for a, b in zip(slopes, middles, strict=True)]


def _along(
    times: jax.Array,
    water: tuple[jax.Array, ...],
    nodes: jax.Array,
    spacing: tuple[jax.Array, ...],
    speed: jax.Array,
    axis: int,
    back: bool,
) -> jax.Array:
    """Sweep the grid along an axis: each plane of nodes from the plane before."""
    order = (axis, *(k for k in range(times.ndim) if k != axis))

    def turned(plane: jax.Array) -> jax.Array:
        plane = jnp.transpose(plane, order)
        return plane[::-1] if back else plane

    ahead = -1.0 if back else 1.0
    parts = tuple(turned(water[k]) * (ahead if k == axis else 1.0) for k in order)
    steps = spacing[axis][::-1] if back else spacing[axis]
    aside = tuple(spacing[k] for k in order[1:])
    planes = turned(times)

    def step(before: tuple, here: tuple) -> tuple:
        (last, water_last), (now, water_now, open_, gap) = before, here
        found = _plane(last, water_last, now, water_now, open_, gap, aside, speed)
        return (found, water_now), found

    rows = planes[1:], tuple(part[1:] for part in parts), turned(nodes)[1:], steps
    _, found = jax.lax.scan(step, (planes[0], tuple(part[0] for part in parts)), rows)
    planes = jnp.concatenate([planes[:1], found])
    return jnp.transpose(planes[::-1] if back else planes, tuple(map(order.index, range(len(order)))))


def _plane(
    before: jax.Array,
    water_before: tuple[jax.Array, ...],
    times: jax.Array,
    water: tuple[jax.Array, ...],
    nodes: jax.Array,
    step: jax.Array,
    aside: tuple[jax.Array, ...],
    speed: jax.Array,
) -> jax.Array:
    """Return the times of a plane of nodes: straight from nodes of the plane before, or from between them.

    Between the corners of a simplex of the plane before times are linear: with their slopes aside, c . g + V
    |g| = 1 gives the slope ahead. It counts where the way that it stands for came through the simplex.
    """
    flat = times.ndim
    c = [0.5 * (a + b) for a, b in zip(water, water_before, strict=True)]
    steps = {}
    for k, gaps in enumerate(aside):
        shape = [-1 if k == i else 1 for i in range(flat)]
        steps[k, 1] = jnp.concatenate([gaps, gaps[-1:]]).reshape(shape)
        steps[k, -1] = jnp.concatenate([gaps[:1], gaps]).reshape(shape)
    around: dict[tuple[int, ...], jax.Array] = {
        offset: _shifted(before, offset) for offset in product((-1, 0, 1), repeat=flat)
    }
    margin = speed**2 - sum(part * part for part in c)
    best = times
    for offset, other in around.items():
        way = [step, *(-sign * steps[k, sign] if sign else 0.0 for k, sign in enumerate(offset))]
        square = sum(part * part for part in way)
        drift = sum(a * b for a, b in zip(c, way, strict=True))
        ahead = drift + jnp.sqrt(jnp.maximum(drift**2 + margin * square, 0.0))
        best = jnp.minimum(best, other + square / jnp.maximum(ahead, _SLOWEST * speed * jnp.sqrt(square)))
    middle = around[(0,) * flat]
    for order, signs in product(permutations(range(flat)), product((-1, 1), repeat=flat)):
        offset, last, slopes, known = (
            [0] * flat,
            middle,
            [jnp.zeros_like(middle)] * flat,
            middle < 0.5 * _NEVER,
        )
        for k in order:
            offset[k] = signs[k]
            following = around[tuple(offset)]
            slopes[k] = (following - last) / (signs[k] * steps[k, signs[k]])
            known, last = known & (following < 0.5 * _NEVER), following
        square, rest = (
            sum(s * s for s in slopes),
            1.0 - sum(a * s for a, s in zip(c[1:], slopes, strict=True)),
        )
        under = rest**2 - (speed**2 - c[0] ** 2) * square
        below = rest * c[0] + speed * jnp.sqrt(jnp.maximum(under, 0.0))
        slope = (rest**2 - speed**2 * square) / jnp.where(below > 0.0, below, 1.0)
        steep = jnp.sqrt(slope**2 + square) + 1e-12
        ahead = c[0] + speed * slope / steep
        known &= (under >= 0.0) & (below > 0.0) & (rest > 0.0) & (ahead > 0.0)
        most = 1.0 + 1e-4
        for k in order:
            foot = -signs[k] * (c[k + 1] + speed * slopes[k] / steep) * step
            foot = foot / (jnp.where(ahead > 0.0, ahead, 1.0) * steps[k, signs[k]])
            known &= (foot >= -1e-4) & (foot <= most)
            most = foot + 1e-4
        best = jnp.where(known, jnp.minimum(best, middle + step * slope), best)
    return jnp.where(nodes, best, _NEVER)


def _shifted(plane: jax.Array, offset: tuple[int, ...]) -> jax.Array:
    """Return the plane's value at an offset; `_NEVER` beyond its edge."""
    padded = jnp.pad(plane, 1, constant_values=_NEVER)
    return padded[tuple(slice(1 + k, 1 + k + n) for k, n in zip(offset, plane.shape, strict=True))]
