"""Path problems by seed in seas with depth: sheared currents, spirals, sills, spheres, and real model files.

`depth_problem(family, seed)` makes the same problem for the same arguments. Most legs are log-uniform from 1
to 10 km, a fifth of them from 20 to 50 km. Vehicles make 1.0 to 2.5 m/s, and no water is faster than 0.9 of
that; those of even seeds pitch by `PITCH` at most. Every problem has a way: a simple one that the ruler
holds feasible.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import product
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from scipy import ndimage

import auvplan as ap
from auvplan.io.currents import read_current
from auvplan.ocean.currents import Current, Velocity
from auvplan.site import Site
from benchmarks.harness import SHARED, Array, Rng
from benchmarks.paths.problems import PIXELS, PathProblem, unlimited_vehicle
from benchmarks.paths.ruler import World, evaluate, velocity_at
from benchmarks.paths.waters import tide, water_problem

T = TypeVar("T")

#: rad, most pitch of vehicles of even seeds.
PITCH = float(np.radians(30.0))

#: Sides of the box, in lengths of the leg.
ROOM = 1.6

#: m, legs and depths of boxes.
_SHORT, _LONG, _DEPTHS, _COLUMNS = (1000.0, 10_000.0), (20_000.0, 50_000.0), (30.0, 300.0), (100.0, 1000.0)

#: Shapes that problems share: obstacles in a column, sills.
SPHERES, SILLS = 12, 2

#: Least and greatest share of the vehicle's speed that the fastest water makes.
_FASTEST = 0.2, 0.9

#: m, altitude to be kept above the bed.
_ALTITUDE = 5.0

#: Slope of the ways that must exist, and points that they have.
_SLOPE, _POINTS = np.tan(np.radians(12.0)), 121

#: m/s, vehicles in real data, whose currents are slower.
_SLOW = 1.0, 1.5


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class LayeredCurrent:
    """Two layers, and water between them that passes from the one to the other."""

    upper: jax.Array  # [2] m/s, north and east
    lower: jax.Array  # [2] m/s, north and east
    interface: jax.Array  # m, depth halfway
    softness: jax.Array  # m, scale of the passage
    steady = True

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        share = 0.5 * (1.0 + jnp.tanh((z - self.interface) / self.softness)) + 0.0 * (x + y)
        u, v = (self.upper[k] + share * (self.lower[k] - self.upper[k]) for k in range(2))
        return u, v, jnp.zeros_like(u)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class EkmanCurrent:
    """A spiral under the wind, and a deep current that it fades into."""

    surface: jax.Array  # [2] m/s, north and east, of the spiral at depth 0
    deep: jax.Array  # [2] m/s
    scale: jax.Array  # m, in which the spiral fades to 1/e and turns by a radian
    sense: jax.Array  # 1 to the right with depth, -1 to the left
    steady = True

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        down = z / self.scale + 0.0 * (x + y)
        fading, cos, sin = jnp.exp(-down), jnp.cos(down), self.sense * jnp.sin(down)
        north, east = self.surface[0], self.surface[1]
        u = self.deep[0] + fading * (cos * north - sin * east)
        v = self.deep[1] + fading * (sin * north + cos * east)
        return u, v, jnp.zeros_like(u)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SillCurrent:
    """Layers that are quicker over sills."""

    layers: LayeredCurrent  # away from sills
    origin: jax.Array  # [2] m
    along: jax.Array  # [2], unit vector across the sills
    place: jax.Array  # [SILLS] m, of each sill from the origin along it
    width: jax.Array
    gain: jax.Array  # [SILLS], share by which the current is quicker in the middle of a sill
    steady = True

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        u, v, w = self.layers(x, y, z, t)
        arc = (x - self.origin[0]) * self.along[0] + (y - self.origin[1]) * self.along[1]
        factor = 1.0
        for k in range(SILLS):
            factor = factor + self.gain[k] * jnp.exp(-0.5 * ((arc - self.place[k]) / self.width[k]) ** 2)
        return factor * u, factor * v, w


@dataclass(frozen=True)
class _Leg:
    speed: float  # m/s through the water
    length: float  # m, level
    along: Array  # [2], its direction
    depth: float  # m, of the box
    start: Array  # [3] m
    goal: Array  # [3] m

    @classmethod
    def drawn(cls, rng: Rng, depths: tuple[float, float] = _DEPTHS, shallow: float = 0.75) -> "_Leg":
        """Draw a leg; so great a share of them has both ends 5 to 20 m deep."""
        speed = rng.uniform(1.0, 2.5)
        length = _log_uniform(rng, *(_SHORT if rng.random() < 0.8 else _LONG))
        heading = rng.uniform(0.0, 2.0 * np.pi)
        depth = _log_uniform(rng, *depths)
        along = np.array([np.cos(heading), np.sin(heading)])
        if rng.random() < shallow:
            ends = rng.uniform(5.0, min(20.0, 0.6 * depth), 2)
        else:
            ends = rng.uniform(5.0, 0.9 * depth, 2)
            ends[1] = np.clip(ends[1], ends[0] - 0.1 * length, ends[0] + 0.1 * length)
        middle = 0.5 * ROOM * length
        start, goal = (middle + half * length * along for half in (-0.5, 0.5))
        return cls(speed, length, along, depth, np.r_[start, ends[0]], np.r_[goal, ends[1]])

    @property
    def straight(self) -> float:
        return self.length / self.speed

    def turned(self, angle: float) -> Array:
        """Return the leg's direction turned, [2]."""
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ self.along

    def posed(
        self, current: Current, obstacles: ap.Obstacles | None = None, seabed: ap.Seabed | None = None
    ) -> PathProblem:
        side = ROOM * self.length
        corners = (0.0, 0.0, 0.0), (side, side, self.depth)
        env = ap.Environment(current, None, obstacles, *corners, seabed)
        return _problem(env, self.start, self.goal, self.speed)


def depth_problem(family: str, seed: int) -> PathProblem:
    """Make a problem; the same one for the same family and seed."""
    rng = np.random.default_rng([zlib.crc32(family.encode()), seed])
    pitch = PITCH if seed % 2 == 0 else None
    while True:
        if (drawn := DEPTH_FAMILIES[family](rng)) is None:
            continue
        vehicle = replace(drawn.vehicle, pitch_max=pitch)
        problem = replace(drawn, name=f"{family}-{seed}", family=family, vehicle=vehicle)
        if way(problem) is not None:
            return problem


def posed(family: str, seed: int) -> PathProblem:
    """Make a problem of any family, in the plane or in depth."""
    return depth_problem(family, seed) if family in DEPTH_FAMILIES else water_problem(family, seed)


def have_levels() -> bool:
    return all((SHARED / source.path).exists() for source in _SOURCES)


def way(problem: PathProblem) -> Array | None:
    """Return some path [n, 3] m that the ruler holds feasible; None where no simple one is.

    Those that are tried keep one depth and bend to one side, both between short ramps.
    """
    world = World.of(problem)
    start, goal = np.asarray(problem.start), np.asarray(problem.goal)
    share = np.linspace(0.0, 1.0, _POINTS)
    straight = start + share[:, None] * (goal - start)
    if evaluate(problem, straight, world).feasible:
        return straight
    along = (goal - start)[:2]
    aside = np.array([-along[1], along[0]])
    arc = share * np.linalg.norm(along)
    # No steeper at either end than the ramps.
    least = np.maximum(start[2] - _SLOPE * arc, goal[2] - _SLOPE * arc[::-1])
    most = np.minimum(start[2] + _SLOPE * arc, goal[2] + _SLOPE * arc[::-1])
    depths = world.high[2] * np.array([0.02, 0.1, 0.25, 0.5, 0.75, 0.95])
    bends = 0.04, -0.04, 0.1, -0.1, 0.2, -0.2, 0.35, -0.35
    for depth, bend in product(depths, (0.0, *bends)):
        place = straight[:, :2] + (bend * np.sin(np.pi * share))[:, None] * aside
        path = np.column_stack([place, np.clip(depth, least, most)])
        if evaluate(problem, path, world).feasible:
            return path
    return None


def _shear(rng: Rng) -> PathProblem | None:
    """Two layers; half of the currents that run along the way have no part across it."""
    leg = _Leg.drawn(rng)
    kind = rng.choice(["opposed", "slack", "quicker", "with", "across"], p=[0.35, 0.2, 0.1, 0.1, 0.25])
    upper, lower = {
        "opposed": (-rng.uniform(0.4, 1.0), rng.uniform(0.2, 1.0)),
        "slack": (-1.0, rng.uniform(-0.2, 0.2)),
        "quicker": (rng.uniform(0.0, 0.5), 1.0),
        "with": (1.0, -rng.uniform(0.0, 1.0)),
        "across": (rng.uniform(0.3, 1.0), rng.uniform(0.0, 1.0)),
    }[str(kind)]
    if kind == "across":
        angles = rng.uniform(0.0, 2.0 * np.pi, 2)
    else:
        angles = rng.normal(0.0, 0.35, 2) * (rng.random() < 0.5)
    layers = _layers(rng, leg, upper * leg.turned(angles[0]), lower * leg.turned(angles[1]), _FASTEST)
    return leg.posed(tide(rng, layers, leg.straight)[0] if rng.random() < 0.25 else layers)


def _layers(rng: Rng, leg: _Leg, upper: Array, lower: Array, fastest: tuple[float, float]) -> LayeredCurrent:
    """Return two layers scaled so that the quicker one makes such a share of the vehicle's speed."""
    factor = leg.speed * rng.uniform(*fastest) / max(np.hypot(*upper), np.hypot(*lower))
    interface = max(leg.depth * rng.uniform(0.15, 0.7), 8.0)
    sharp = rng.random() < 0.5
    softness = max(leg.depth * (rng.uniform(0.01, 0.02) if sharp else rng.uniform(0.08, 0.2)), 0.5)
    return _single(LayeredCurrent(factor * upper, factor * lower, interface, softness))


def _ekman(rng: Rng) -> PathProblem | None:
    """A spiral that turns and fades with depth."""
    leg = _Leg.drawn(rng)
    surface = leg.turned(rng.uniform(0.0, 2.0 * np.pi))
    deep = rng.uniform(0.0, 0.6) * leg.turned(rng.uniform(0.0, 2.0 * np.pi))
    scale, sense = leg.depth * rng.uniform(0.1, 0.5), rng.choice([-1.0, 1.0])
    fastest = leg.speed * rng.uniform(*_FASTEST)
    spiral = EkmanCurrent(surface, deep, scale, sense)
    z = np.linspace(0.0, leg.depth, 200)
    u, v, _ = spiral(0.0 * z, 0.0 * z, jnp.asarray(z), 0.0 * z)
    factor = fastest / float(np.hypot(u, v).max())
    current = _single(replace(spiral, surface=factor * surface, deep=factor * deep))
    return leg.posed(tide(rng, current, leg.straight)[0] if rng.random() < 0.15 else current)


def _ridge(rng: Rng) -> PathProblem | None:
    """Sills across the way; in half of the seas they end somewhere, lie askew, and seamounts stand about."""
    leg = _Leg.drawn(rng)
    endless = rng.random() < 0.5
    count = int(rng.integers(1, SILLS + 1))
    place, width, gain = np.zeros(SILLS), np.full(SILLS, leg.length), np.zeros(SILLS)
    place[:count] = leg.length * (rng.uniform(0.25, 0.75, 1) if count == 1 else np.array([0.3, 0.7]))
    width[:count] = leg.length * rng.uniform(0.04, 0.1, count)
    gain[:count] = rng.uniform(0.0, 0.6, count)
    pixel = ROOM * leg.length / PIXELS
    line = pixel * (np.arange(PIXELS) + 0.5)
    x, y = np.meshgrid(line, line, indexing="ij")
    x, y = x - leg.start[0], y - leg.start[1]
    arc, aside = x * leg.along[0] + y * leg.along[1], y * leg.along[0] - x * leg.along[1]
    highest = leg.depth - max(15.0, 0.15 * leg.depth)
    rise = np.zeros_like(arc)
    for k in range(count):
        height = highest * rng.uniform(0.45, 1.0)
        skew, reach = (0.0, np.inf) if endless else (rng.normal(0.0, 0.3), leg.length * rng.uniform(0.1, 0.6))
        middle = 0.0 if endless else 0.2 * leg.length * rng.normal()
        across = (arc - place[k] - skew * aside) / width[k]
        rise = np.maximum(rise, height * np.exp(-0.5 * (across**2 + ((aside - middle) / reach) ** 2)))
    for _ in range(0 if endless else rng.integers(0, 4)):
        at, beside = leg.length * rng.uniform(0.2, 0.8), leg.length * rng.normal(0.0, 0.1)
        radius, height = leg.length * rng.uniform(0.03, 0.1), highest * rng.uniform(0.4, 1.0)
        rise = np.maximum(rise, height * np.exp(-0.5 * ((arc - at) ** 2 + (aside - beside) ** 2) / radius**2))
    seabed = ap.Seabed.from_depth(leg.depth - rise, pixel, clearance=_ALTITUDE)
    if min(float(seabed.altitude(end[None])[0]) for end in (leg.start, leg.goal)) < _ALTITUDE + 2.0:
        return None
    angles = rng.normal(0.0, 0.35, 2) * (not endless)
    against = rng.random() < 0.6
    strengths = (-rng.uniform(0.3, 1.0), rng.uniform(0.0, 1.0)) if against else rng.uniform(-1.0, 1.0, 2)
    upper, lower = (strength * leg.turned(angle) for strength, angle in zip(strengths, angles, strict=True))
    layers = _layers(rng, leg, upper, lower, (_FASTEST[0], _FASTEST[1] / (1.0 + gain.max())))
    current = _single(SillCurrent(layers, leg.start[:2], leg.along, place, width, gain))
    return leg.posed(current, seabed=seabed)


def _spheres(rng: Rng) -> PathProblem | None:
    """Four to twelve obstacles in a column of water, a third of them on the move, in a moderate shear."""
    leg = _Leg.drawn(rng, _COLUMNS, shallow=0.5)
    angles = rng.uniform(0.0, 2.0 * np.pi, 2)
    strengths = rng.uniform(0.1, 1.0, 2)
    upper, lower = (strength * leg.turned(angle) for strength, angle in zip(strengths, angles, strict=True))
    layers = _layers(rng, leg, upper, lower, (0.05, 0.5))
    count = int(rng.integers(4, SPHERES + 1))
    size = min(leg.depth, 0.3 * leg.length)
    radius = np.exp(rng.uniform(np.log(0.08 * size), np.log(0.45 * size), count))
    share = rng.uniform(0.1, 0.9, count)
    aside = rng.normal(0.0, 1.0, count) * (0.5 * radius + 0.01 * leg.length)
    line = leg.start + share[:, None] * (leg.goal - leg.start)
    centre = line + np.outer(aside, [-leg.along[1], leg.along[0], 0.0])
    anywhere = rng.random(count) < 0.5
    centre[:, 2] = np.where(
        anywhere, rng.uniform(0.0, leg.depth, count), line[:, 2] + 0.5 * radius * rng.normal(size=count)
    )
    moves = np.arange(count) < count // 3
    bearing, speed = rng.uniform(0.0, 2.0 * np.pi, count), leg.speed * rng.uniform(0.1, 0.5, count) * moves
    rising = 0.1 * rng.normal(size=count)
    velocity = speed[:, None] * np.column_stack([np.cos(bearing), np.sin(bearing), rising])
    # They are on the way about when the vehicle is.
    centre = centre - velocity * (share * leg.straight)[:, None]
    drift = moves * rng.integers(0, 2, count).astype(float)
    x, y, z = centre.T
    own = velocity - drift[:, None] * np.stack(velocity_at(layers, x, y, z, np.zeros(count)), axis=1)
    growth_max = radius * rng.uniform(0.05, 0.3, count) * rng.integers(0, 2, count)
    obstacles = ap.Obstacles.create(
        centre, radius, velocity=own, drift=drift, position_std=rng.uniform(0.0, 0.02, count) * radius,
        radius_std=rng.uniform(0.0, 0.01, count) * radius,
        growth=growth_max / (leg.straight * rng.uniform(0.2, 1.0, count)), growth_max=growth_max,
    )  # fmt: skip
    problem = leg.posed(layers, obstacles.padded(SPHERES))
    # The start is clear at first, the goal whenever the vehicle may come.
    world, room = World.of(problem), 0.02 * size + 5.0
    when = leg.straight * np.linspace(0.4, 2.5, 40)
    x, y, z = np.tile(leg.goal, (len(when), 1)).T
    if world.spheres.clearance(x, y, z, when).min() < room:
        return None
    x, y, z = leg.start[:, None]
    return None if world.spheres.clearance(x, y, z, np.zeros(1)).min() < room else problem


@dataclass(frozen=True)
class _Source:
    path: str  # beneath the shared data
    place: tuple[float, float]  # longitude and latitude of the box's middle, degrees
    half: tuple[float, float]  # m, sides of the box are twice as long, north and east
    depth: float  # m, of the box
    distances: tuple[float, float]  # m, of the legs
    weight: float  # share of the problems


_SOURCES = (
    _Source(
        "currents/norfjords160_roms_native_24h.nc", (5.677, 59.0329), (1e3, 1100), 60.0, (800, 1800), 0.4
    ),
    _Source("elsewhere/nordic_roms_native_day1.nc", (14.022, 67.353), (25e3, 25e3), 250.0, (5e3, 45e3), 0.4),
    _Source("currents/norkyst_v3_800m_5h.nc", (5.9926, 55.950), (3e3, 4e3), 7.0, (2e3, 7e3), 0.1),
    _Source("currents/cmems_glo12_uo_vo_northsea.nc", (3.0, 54.0), (25e3, 25e3), 7.9, (10e3, 45e3), 0.1),
)

#: m, pixels of a sea bed from a file at most.
_FINE = 50.0


@lru_cache(maxsize=len(_SOURCES))
def _model(source: _Source) -> tuple[Current, ap.Seabed | None]:
    """Read a file, once; what it does not cover is dry, as land is, where it has depths of the bed."""
    north, east = source.half
    box = {"lower": (-north, -east, 0.0), "upper": (north, east, source.depth)}
    found = read_current(SHARED / source.path, Site(*source.place), **box, outside="clamp")
    if found.sea_floor is None:
        return found.field, None
    wet = np.where(found.water & np.isfinite(found.sea_floor), found.sea_floor, -10.0)
    sides = 2.0 * np.asarray(source.half)
    pixel = min(_FINE, sides.max() / 200.0)
    lines = [pixel * (np.arange(int(np.ceil(side / pixel))) + 0.5) - 0.5 * side for side in sides]
    placed = zip(lines, found.origin, found.spacing, strict=True)
    nodes = [(line - first) / apart for line, first, apart in placed]
    at = np.stack(np.meshgrid(*nodes, indexing="ij"))
    raster = ndimage.map_coordinates(wet, at, order=1, mode="nearest")
    corner = (-0.5 * sides[0], -0.5 * sides[1])
    return found.field, ap.Seabed.from_depth(raster, pixel, corner, clearance=_ALTITUDE)


def _file(rng: Rng) -> PathProblem | None:
    """A leg in a model's currents: a fjord by the hour, a shelf, and two shallow seas."""
    source = _SOURCES[rng.choice(len(_SOURCES), p=[source.weight for source in _SOURCES])]
    current, seabed = _model(source)
    half = np.asarray(source.half, float)
    speed = rng.uniform(*_SLOW)
    ends = rng.uniform(-0.9 * half, 0.9 * half, (2, 2))
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if not source.distances[0] <= length <= source.distances[1]:
        return None
    shallow = rng.random() < 0.75
    depths = rng.uniform(0.2, 0.9, 2) * (min(20.0, source.depth) if shallow else source.depth)
    depths[1] = np.clip(depths[1], depths[0] - 0.1 * length, depths[0] + 0.1 * length)
    start, goal = np.column_stack([ends, depths])
    if seabed is not None and seabed.altitude(np.stack([start, goal])).min() < _ALTITUDE + 2.0:
        return None
    times = np.asarray(current.times, float)
    spare = times[-1] - 1.5 * length / speed
    if len(times) > 1 and spare <= 0.0:
        return None
    depart = float(rng.uniform(0.0, spare)) if len(times) > 1 else 0.0
    corners = (*-half, 0.0), (*half, source.depth)
    env = ap.Environment(current, None, None, *corners, seabed)
    return _problem(env, start, goal, speed, depart)


def _problem(
    env: ap.Environment, start: Array, goal: Array, speed: float, depart: float = 0.0
) -> PathProblem:
    ends = (tuple(float(axis) for axis in end) for end in (start, goal))
    return PathProblem("", "", env, *ends, unlimited_vehicle(speed), depart)


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _single(current: T) -> T:
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, float), current)


#: The families of the benchmark in depth.
DEPTH_FAMILIES: dict[str, Callable[[Rng], PathProblem | None]] = {
    "shear": _shear, "ekman": _ekman, "ridge": _ridge, "spheres": _spheres, "file": _file
}  # fmt: skip
