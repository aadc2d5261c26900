"""Path problems by seed in six kinds of waters, and waters without a way, for a planner that never saw them.

`water_problem(family, seed)` makes the same problem for the same arguments: planar, with sides log-uniform
from 500 m to 50 km. Charts, currents and worlds are padded to one shape, so that problems share compiled
programs. Half of the vehicles are held back by nothing but their speed, the others have the limits of
`ap.Vehicle()`. Every problem has a way, found on a grid of pixels with margins and walked against the moving
obstacles.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray
from scipy import ndimage

import auvplan as ap
from auvplan.ocean.chart import INTERPOLATION_ERROR
from auvplan.ocean.currents import Current, Velocity, evaluated
from auvplan.ocean.deviation import deviation
from benchmarks.harness import Array, Rng
from benchmarks.paths import land
from benchmarks.paths.problems import (
    OBSTACLES,
    PIXELS,
    PathProblem,
    drawn_obstacles,
    drawn_vortices,
    quickest,
    unlimited_vehicle,
)

#: m, sides of the square.
SMALLEST, LARGEST = 500.0, 50_000.0

#: m, least side where a vehicle with limits meets narrow passages: its turns need room.
ROOM = 3000.0

#: Share of the seas whose current turns with a tide.
_TIDAL = 0.2

#: Share of the waters whose straight line is free of land that are kept.
_OPEN = 0.25

#: Share of the limits, and of the speed, that the way which must exist may use.
_RESERVE = 0.9

#: Least ground speed on that way, as a share of the vehicle's.
_PROGRESS = 0.15


@dataclass(frozen=True)
class Kind:
    """How the problems of a family are drawn."""

    # ``(rng, gap) -> (water, ends)`` on the unit square, see `land`
    land: Callable[[Rng, float], tuple[NDArray[np.bool_], Array]]
    narrow: bool = False
    obstacles: tuple[int, int] = (2, 10)  # least and greatest number of fixed obstacles
    radii: tuple[float, float] = (0.004, 0.03)  # least and greatest radius of these, in units of the side
    moving: bool = False  # whether obstacles move, one of them into the best passage at the time of arrival
    way: bool = True


#: The families of the benchmark.
KINDS = {
    "open": Kind(land.open_water, obstacles=(4, 15), radii=(0.004, 0.048)),
    "coast": Kind(land.coast, obstacles=(0, 10)),
    "island": Kind(land.island, obstacles=(0, 8)),
    "sounds": Kind(land.sounds, narrow=True, obstacles=(0, 6), radii=(0.003, 0.015)),
    "fjords": Kind(land.fjords, narrow=True, obstacles=(0, 3), radii=(0.003, 0.01)),
    "moving": Kind(land.gates, obstacles=(0, 4), radii=(0.004, 0.02), moving=True),
    "no-way": Kind(land.closed, obstacles=(0, 4), way=False),
}

#: Families whose problems have a way.
FAMILIES = tuple(name for name, kind in KINDS.items() if kind.way)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class TidalCurrent:
    """A steady current times mean + swing cos(2 pi t / period + phase)."""

    current: Current  # at its strongest where mean + swing is 1
    mean: ArrayLike
    swing: ArrayLike
    period: ArrayLike  # s
    phase: ArrayLike  # rad

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        u, v, w = self.current(x, y, z, t)
        factor = self.mean + self.swing * jnp.cos(2.0 * jnp.pi * t / self.period + self.phase)
        return factor * u, factor * v, factor * w

    def deviation(self, places: Sequence[Array], edges: Sequence[Any]) -> Array | None:
        """Bound the departure from means within boxes, see `auvplan.ocean.deviation`."""
        found = deviation(self.current, places, edges)
        if found is None:
            return None
        swing, rate = abs(float(self.swing)), 2.0 * np.pi / float(self.period)
        u, v, w = evaluated(self.current, *places)
        near = np.sqrt(u * u + v * v + w * w) + self._steepest * np.hypot(*edges[:2])
        dt = np.asarray(edges[3])
        of_time = 0.125 * swing * rate**2 * dt**2 * near
        mixed = 0.5 * swing * rate * dt * self._steepest * 0.5 * np.hypot(*edges[:2])
        return (abs(float(self.mean)) + swing) * found + of_time + mixed

    @property
    def _steepest(self) -> float:
        """No slope of the steady current is greater, 1/s: vortices turn fastest in their cores."""
        strength, radius = np.asarray(self.current.strength), np.asarray(self.current.radius)
        return float(np.abs(strength / (2.0 * np.pi * radius**2)).sum())

    def factor(self, t: Array) -> Array:
        """Return the factor at times t [s], in NumPy."""
        parts = self.mean, self.swing, self.period, self.phase
        mean, swing, period, phase = (np.asarray(part, float) for part in parts)
        return mean + swing * np.cos(2.0 * np.pi * t / period + phase)


def without_tide(current: Current) -> Current:
    """Return the current that a tide turns; any other as it is."""
    return current.current if isinstance(current, TidalCurrent) else current


def water_problem(family: str, seed: int) -> PathProblem:
    """Make a problem; the same one for the same family and seed."""
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    while (problem := _drawn(rng, KINDS[family], family, f"{family}-{seed}")) is None:
        pass
    return problem


def _drawn(rng: Rng, kind: Kind, family: str, name: str) -> PathProblem | None:
    """Draw a problem; None where it has no way, or has one that it should not have."""
    limited = rng.random() < 0.5
    smallest = ROOM if limited and kind.narrow else SMALLEST
    side = float(np.exp(rng.uniform(np.log(smallest), np.log(LARGEST))))
    vehicle = ap.Vehicle() if limited else unlimited_vehicle(float(np.exp(rng.uniform(0.0, np.log(3.0)))))
    # The least width of a passage has both margins, some room and five pixels.
    water, ends = kind.land(rng, (2.4 * ap.PathConfig().coast_margin + 5.0 * side / PIXELS) / side)
    ends = side * np.asarray(ends)
    pixel = side / PIXELS
    chart = None if water.all() else ap.Chart.from_mask(water, pixel)
    distance = np.full(water.shape, side) if chart is None else np.asarray(chart.signed_distance, float)
    start, goal = (_pixel_of(end, pixel) for end in ends)
    coast = distance - INTERPOLATION_ERROR * pixel - ap.PathConfig().coast_margin
    if min(coast[start], coast[goal]) < pixel:
        return None
    line = ends[0] + np.linspace(0.0, 1.0, 2 * PIXELS)[:, None] * (ends[1] - ends[0])
    blocked = min(distance[_pixel_of(place, pixel)] for place in line) < 0.0
    if chart is not None and not blocked and rng.random() > _OPEN:
        return None

    steady = _vortices(rng, side, float(vehicle.speed))
    straight = float(np.linalg.norm(ends[1] - ends[0])) / float(vehicle.speed)
    # Moving obstacles are met at the times of a steady current.
    tidal = rng.random() < _TIDAL and not kind.moving
    current, factors = tide(rng, steady, straight) if tidal else (steady, (1.0,))
    count = int(rng.integers(kind.obstacles[0], kind.obstacles[1] + 1))
    count = min(count, OBSTACLES - 6) if kind.moving else count
    anywhere = (np.argwhere(coast > 0.0) + 0.5) * side / PIXELS if kind.narrow else None
    room = 0.012 * side + ap.PathConfig().obstacle_margin
    centres, radii = drawn_obstacles(rng, count, ends, kind.radii, side, room, anywhere)
    fixed = ap.Obstacles.static(np.c_[centres, np.zeros(len(radii))], radii)
    grid = _Grid.of(coast, pixel, steady, factors, vehicle).without(centres, radii)
    route, obstacles = grid.route(start, goal), fixed
    # For a vehicle that keeps no margin.
    pools, _ = ndimage.label(distance > 0.0, np.ones((3, 3)))
    if (route is not None) != kind.way or (not kind.way and pools[start] == pools[goal]):
        return None
    if route is not None and kind.moving:
        moving = _movers(rng, pixel, route, coast, steady, float(vehicle.speed))
        if not grid.has_way_past(moving.resolved(current), start, goal):
            return None
        obstacles = fixed + moving
    corners = (0.0, 0.0, 0.0), (side, side, 0.0)
    env = ap.Environment(current, chart, obstacles.padded(OBSTACLES), *corners)
    start, goal = ((float(x), float(y), 0.0) for x, y in ends)
    return PathProblem(name, family, env, start, goal, vehicle)


def _pixel_of(place: Array, pixel: float) -> tuple[int, int]:
    i, j = np.clip((place / pixel).astype(int), 0, PIXELS - 1)
    return int(i), int(j)


def _vortices(rng: Rng, side: float, speed: float) -> ap.LambVortices:
    """Return a layer of vortices, in half of the seas on a uniform stream.

    The fastest water of the square moves at 0.2 to 1.2 of the vehicle's speed [m/s].
    """
    centres, strength, radius = drawn_vortices(rng, np.zeros(2), side)
    stream, heading = rng.uniform(0.0, 0.1) * (rng.random() < 0.5), rng.uniform(0.0, 2.0 * np.pi)
    uniform = stream * np.array([np.cos(heading), np.sin(heading), 0.0])
    field = ap.LambVortices(centres, strength, radius, uniform=uniform)
    u, v = _at_pixels(field, side / PIXELS)
    factor = speed * rng.uniform(0.2, 1.2) / np.hypot(u, v).max()
    return replace(field, strength=factor * field.strength, uniform=factor * field.uniform)


def _at_pixels(current: Current, pixel: float) -> tuple[Array, Array]:
    """Return u and v at the pixels' centres, [PIXELS, PIXELS] m/s."""
    line = pixel * (jnp.arange(PIXELS) + 0.5)
    x, y = jnp.meshgrid(line, line, indexing="ij")
    still = jnp.zeros_like(x)
    u, v, _ = current(x, y, still, still)
    return np.asarray(u, float), np.asarray(v, float)


def tide(rng: Rng, steady: Current, straight: float) -> tuple[TidalCurrent, tuple[float, float]]:
    """Return the current with a tide, and the factors between which it swings.

    Args:
        steady: current at its strongest.
        straight: s, of the straight line in still water.
    """
    mean = rng.uniform(0.3, 0.8)
    period, phase = straight * rng.uniform(0.7, 4.0), rng.uniform(0.0, 2.0 * np.pi)
    turning = TidalCurrent(steady, mean, 1.0 - mean, period, phase)
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), turning), (2.0 * mean - 1.0, 1.0)


def _movers(
    rng: Rng, pixel: float, route: tuple[Array, Array], coast: Array, current: Current, speed: float
) -> ap.Obstacles:
    """Return 2 to 5 obstacles that cross the quickest way as the vehicle does, one where it is narrowest.

    Args:
        pixel: m.
        route: positions [n, 2] m and times [n] s of the quickest way.
        coast: m beyond the margin, at the pixels.
        current: that carries some of them.
        speed: m/s, of the vehicle, which theirs are shares of.
    """
    (places, times), side = route, PIXELS * pixel
    inner = (times > 0.25 * times[-1]) & (times < 0.8 * times[-1])
    room = np.array([coast[_pixel_of(place, pixel)] for place in places])
    positions, velocities, radii = [], [], []
    for k in range(rng.integers(2, 6)):
        candidates = np.flatnonzero(inner)
        at = int(candidates[np.argmin(room[candidates])] if k == 0 else rng.choice(candidates))
        ahead = places[min(at + 3, len(places) - 1)] - places[max(at - 3, 0)]
        heading = np.arctan2(ahead[1], ahead[0]) + rng.choice([0.0, 0.5, 1.0, 1.5]) * np.pi
        heading += rng.normal(0.0, 0.3)
        velocity = speed * rng.uniform(0.1, 0.7) * np.array([np.cos(heading), np.sin(heading)])
        radius = side * rng.uniform(0.01, 0.03)
        if k == 0:
            radius = max(radius, min(0.9 * room[at], 0.12 * side))
        positions.append(places[at] - velocity * times[at])
        velocities.append(velocity)
        radii.append(radius)
    position, velocity = np.array(positions), np.array(velocities)
    x, y = (jnp.asarray(axis) for axis in position.T)
    carried = np.stack(current(x, y, jnp.zeros_like(x), jnp.zeros_like(x))[:2], axis=1)
    drift = rng.integers(0, 2, len(radii)).astype(float)
    growth_max = 0.004 * side * rng.integers(0, 2, len(radii))
    level = np.zeros(len(radii))
    own = np.c_[velocity - drift[:, None] * carried, level]
    grows = {"growth": growth_max / (0.5 * times[-1]), "growth_max": growth_max}
    return ap.Obstacles.create(np.c_[position, level], radii, velocity=own, drift=drift, **grows)


#: Moves from a pixel to another, and the pixels beside each that must be free as well.
_MOVES = [(a, b) for a in range(-2, 3) for b in range(-2, 3) if np.gcd(a, b) == 1]


@dataclass(frozen=True, eq=False)
class _Grid:
    """Ways over the pixels' centres, coarse but certain."""

    clear: Array  # [PIXELS, PIXELS] m, to coast, edge and fixed obstacles, beyond the margins
    pixel: float  # m
    # for each of `_MOVES`, [PIXELS, PIXELS] s from each pixel at the current's strongest; infinite where the
    # vehicle's limits forbid the move at any strength
    seconds: Mapping[tuple[int, int], Array]

    @classmethod
    def of(
        cls, coast: Array, pixel: float, current: Current, factors: tuple[float, ...], vehicle: ap.Vehicle
    ) -> "_Grid":
        """Time all moves in a steady current that may be multiplied by each of some factors."""
        u, v = _at_pixels(current, pixel)
        speed, surge, sway = map(float, (vehicle.speed, vehicle.surge_max, vehicle.sway_max))
        seconds = {}
        for a, b in _MOVES:
            steps = float(np.hypot(a, b))
            along, across = (u * a + v * b) / steps, (v * a - u * b) / steps
            forbidden = np.zeros(u.shape, bool)
            for factor in factors:
                held = np.sqrt(np.maximum(speed**2 - (factor * across) ** 2, 0.0))
                ground = factor * along + held
                forbidden |= np.abs(factor * across) > _RESERVE * min(speed, sway)
                forbidden |= (ground < _PROGRESS * speed) | (ground > _RESERVE * surge)
            # The last factor is the strongest: what is timed is the current as `current` has it.
            seconds[a, b] = np.where(forbidden, np.inf, steps * pixel / np.maximum(ground, 1e-3 * speed))
        return cls(coast, pixel, seconds)

    def without(self, centres: Array, reach: Array) -> "_Grid":
        """Return the grid without discs of centres [M, 2] m and radii [M] m, the margin added."""
        line = (np.arange(PIXELS) + 0.5) * self.pixel
        clear = self.clear.copy()
        for (x, y), radius in zip(centres, reach, strict=True):
            away = np.hypot(line[:, None] - x, line - y) - radius - ap.PathConfig().obstacle_margin
            np.minimum(clear, away, out=clear)
        return replace(self, clear=clear)

    def route(self, start: tuple[int, int], goal: tuple[int, int]) -> tuple[Array, Array] | None:
        """Return positions [n, 2] m and times [n] s of the quickest way; None without any."""
        # Both ends of a move are so clear that what lies between them is.
        found = quickest(self.clear > 0.8 * self.pixel, self.seconds, start, goal)
        return None if found is None else ((found[0] + 0.5) * self.pixel, found[1])

    def has_way_past(
        self, movers: ap.Obstacles, start: tuple[int, int], goal: tuple[int, int], tries: int = 6
    ) -> bool:
        """Whether a way is found that meets no mover (resolved), walked in time.

        Where a way meets movers, the place where they are met is taken from the grid and the next way tried.
        """
        grid = self
        centre, velocity = (np.asarray(part, float)[:, :2] for part in (movers.position, movers.velocity))
        for _ in range(tries):
            route = grid.route(start, goal)
            if route is None:
                return False
            places, times = route
            reach = np.stack([np.asarray(movers.boundary(t)) for t in times])
            met = centre + times[:, None, None] * velocity
            away = np.linalg.norm(places[:, None] - met, axis=2) - reach - ap.PathConfig().obstacle_margin
            # Between two nodes both move on by no more than this.
            lasts = np.diff(times, append=times[-1])[:, None]
            slack = 2.0 * self.pixel + lasts * np.linalg.norm(velocity, axis=1)
            struck = away < slack
            if not struck.any():
                return True
            whom = np.flatnonzero(struck.any(axis=0))
            when = [int(np.argmin(away[:, k])) for k in whom]
            grid = grid.without(met[when, whom], reach[when, whom] + slack[when, whom])
        return False
