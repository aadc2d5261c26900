"""Path problems of the benchmark: four of the literature, random ones in open water and on real coast.

All are planar, and the vehicle's limits on surge, sway and turn rate are out of reach, so that the quickest
clear path is an optimum that a reference can find on a grid. In random problems no current beats the
vehicle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import auvplan as ap
from benchmarks.harness import SHARED, Array

MAPS = SHARED / "maps"
SITES = "hook_passage", "hamilton_dent"

PRESETS = {"default": ap.PathConfig, "quick": ap.PathConfig.quick, "paper": ap.PathConfig.paper}

#: Metres, and seconds at 1 m/s, that stand for a unit of length and of time of the source papers.
SCALE = 1000.0

#: Shapes that all random problems share: vortices, obstacles, pixels of a chart to each side.
VORTICES, OBSTACLES, PIXELS = 15, 15, 400

#: Limits of a vehicle that is held back by none.
UNLIMITED = 1e6

#: m, distance of start and goal to coast and obstacles, and of some path between them.
CLEAR_ENDS, CLEAR_WAY = 120.0, 60.0

#: A random problem has some clear way that is at most so many times as long as the straight line.
LONGEST = 1.6


@dataclass(frozen=True, eq=False)
class PathProblem:
    name: str
    family: str  # problems of one family share a row of the table
    environment: ap.Environment
    start: tuple[float, float, float]  # north, east, depth, m
    goal: tuple[float, float, float]  # north, east, depth, m
    vehicle: ap.Vehicle
    depart: float = 0.0  # s since the epoch
    # of settings of `PathConfig` that the problem needs
    changes: Mapping[str, Any] = field(default_factory=dict)

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(np.subtract(self.goal, self.start)))

    def plan(self, key: jax.Array, config: ap.PathConfig) -> ap.PathPlan:
        """A plan by the package, with the settings that the problem needs."""
        asked = np.asarray(self.start), np.asarray(self.goal), self.environment, self.vehicle
        return ap.plan_path(*asked, key=key, config=config.replace(**self.changes), depart=self.depart)


# The papers' x is east and their y north; here x is north and y east, so both pairs change places.


def path_problems() -> list[PathProblem]:
    """All problems: those of the literature and random ones, as far as charts are found."""
    return literature() + random_problems()


def circular(x: Any, y: Any, z: Any, t: Any) -> tuple[Any, Any, Any]:
    """A vortex that turns like a wheel, clockwise, 0.9 m/s at 1000 m."""
    return -0.9 * y / SCALE, 0.9 * x / SCALE, 0.0


def four_vortices(x: Any, y: Any, z: Any, t: Any) -> tuple[Any, Any, Any]:
    """Ferraro et al. (2021)."""
    east, north = y / SCALE, x / SCALE
    u = v = 0.0
    for sign, a, b in ((-1.0, 2.0, 2.0), (-1.0, 4.0, 4.0), (-1.0, 2.0, 5.0), (1.0, 5.0, 1.0)):
        turn = sign * 1.7 / (3.0 * ((east - a) ** 2 + (north - b) ** 2) + 1.0)
        u, v = u - turn * (north - b), v + turn * (east - a)
    return v, u, 0.0


def double_gyre(x: Any, y: Any, z: Any, t: Any) -> tuple[Any, Any, Any]:
    """Shadden et al. (2005): two gyres side by side that swing to and fro."""
    east, north, swing = y / SCALE, x / SCALE, 0.25 * jnp.sin(t / SCALE)
    place = swing * east**2 + (1.0 - 2.0 * swing) * east
    slope = 2.0 * swing * east + 1.0 - 2.0 * swing
    u = -0.1 * jnp.pi * jnp.sin(jnp.pi * place) * jnp.cos(jnp.pi * north)
    v = 0.1 * jnp.pi * jnp.cos(jnp.pi * place) * jnp.sin(jnp.pi * north) * slope
    return v, u, 0.0


def techy(x: Any, y: Any, z: Any, t: Any) -> tuple[Any, Any, Any]:
    """Techy (2011): an inflow whose turn changes its sense half a time unit after departure."""
    east, north, turn = y / SCALE, x / SCALE, t / SCALE - 0.5
    return turn * east - 0.3 * north, -0.3 * east - turn * north, 0.0


def literature() -> list[PathProblem]:
    """Time-optimal paths of the literature at 1 m/s, a unit of length taken as `SCALE` metres.

    Their best times are 1,974.96, 8,949.6, 988.81 and 1,031.6 s; of "techy" shooting with Zermelo's equation
    finds 1,030.084 s.
    """
    slant = (np.cos(np.pi / 6), np.sin(np.pi / 6))
    cases = (
        ("circular", circular, slant, (0.0, 1.0), (-2, -2), (2, 2)),
        ("four vortices", four_vortices, (0.0, 0.0), (6.0, 2.0), (-2, -4), (8, 7)),
        ("double gyre", double_gyre, (1.5, 0.5), (0.5, 0.5), (0, 0), (2, 1)),
        ("techy", techy, slant, (0.0, 1.0), (-2, -2), (2, 2)),
    )
    problems = []
    for name, function, start, goal, low, high in cases:
        points = [
            (float(north * SCALE), float(east * SCALE), 0.0) for east, north in (start, goal, low, high)
        ]
        env = ap.Environment(function, None, None, *points[2:])
        asked = "literature", env, *points[:2], unlimited_vehicle(1.0)
        problems.append(PathProblem(name, *asked))
    return problems


def unlimited_vehicle(speed: float) -> ap.Vehicle:
    """A vehicle that is held back by nothing but its speed, m/s."""
    limits = dict.fromkeys(("surge_max", "sway_max", "turn_rate_max"), UNLIMITED)
    return ap.Vehicle(speed, **limits, pitch_max=None)


def random_problems() -> list[PathProblem]:
    """24 problems, every other one in open water, the others on real coast as far as there are charts.

    6 to 15 Lamb vortices whose fastest water moves at 0.2 to 0.9 of the vehicle's 2.5 m/s, 4 to 15 static
    obstacles of 40 to 480 m, most of them near the straight line. A clear way of at most `LONGEST` times the
    straight line always exists.
    """
    problems = []
    for k in range(24):
        rng, number = np.random.default_rng([0, k]), k // 2
        if k % 2 == 0:
            problems.append(_random_problem(rng, f"open-{number:02d}", "open water"))
        elif have_charts():
            problems.append(_random_problem(rng, f"coast-{number:02d}", "coast", number))
    return problems


def have_charts() -> bool:
    return all((MAPS / f"whitsunday_{site}_class.tif").exists() for site in SITES)


def _random_problem(rng: np.random.Generator, name: str, family: str, site: int | None = None) -> PathProblem:
    """Drawn again until start and goal are joined by a clear way."""
    while True:
        if site is None:
            chart, low, size = None, np.zeros(2), rng.uniform(3500.0, 10_000.0)
        else:
            chart = _cropped(rng, site)
            low, size = np.asarray(chart.lower, float), PIXELS * float(chart.pixel_size)
        ends = low + size * rng.uniform(0.05, 0.95, (2, 2))
        if np.linalg.norm(ends[1] - ends[0]) < 0.55 * size:
            continue
        count = rng.integers(4, OBSTACLES + 1)
        centres, radii = drawn_obstacles(rng, count, ends, (40.0, 480.0), 1.0, CLEAR_ENDS)
        # A third of the coast problems may have the straight line free of land.
        blocked = site is not None and site % 3 != 0
        if not _worth_planning(chart, low, size, ends, centres, radii, blocked):
            continue
        places = np.c_[centres, np.zeros(len(radii))]
        obstacles = ap.Obstacles.static(places, radii).padded(OBSTACLES)
        current = _vortices(rng, low, size)
        corners = (*low, 0.0), (*(low + size), 0.0)
        env = ap.Environment(current, chart, obstacles, *corners)
        start, goal = ((float(x), float(y), 0.0) for x, y in ends)
        return PathProblem(name, family, env, start, goal, unlimited_vehicle(2.5))


def drawn_obstacles(
    rng: np.random.Generator, count: int, ends: Array, radii: tuple[float, float], unit: float, room: float,
    anywhere: Array | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """Centres [M, 2] m and radii [M] m, clear of both ends [2, 2] m by some room [m].

    Args:
        radii: least and greatest, in units of `unit` [m].
        anywhere: [K, 2] m, places to choose from; most lie near the straight line where that is None.
    """
    way = ends[1] - ends[0]
    aside = np.array([-way[1], way[0]])
    centres, sizes = np.zeros((count, 2)), np.zeros(count)
    for k in range(count):
        while True:
            radius = unit * np.exp(rng.uniform(*np.log(radii)))
            if anywhere is not None:
                centre = rng.choice(anywhere)
            else:
                centre = ends[0] + rng.uniform(0.0, 1.0) * way + rng.normal(0.0, 0.15) * aside
            if np.linalg.norm(ends - centre, axis=1).min() > radius + room:
                break
        centres[k], sizes[k] = centre, radius
    return centres, sizes


def drawn_vortices(rng: np.random.Generator, low: Array, size: float) -> tuple[Array, Array, Array]:
    """Centres, strengths and radii of 6 to `VORTICES` vortices in a square, padded by ones of no strength."""
    count = rng.integers(6, VORTICES + 1)
    centres, radius, strength = np.zeros((VORTICES, 2)), np.ones(VORTICES), np.zeros(VORTICES)
    centres[:count] = low + size * rng.uniform(0.0, 1.0, (count, 2))
    radius[:count] = size * rng.uniform(0.05, 0.15, count)
    strength[:count] = radius[:count] * rng.uniform(0.5, 1.0, count) * rng.choice([-1.0, 1.0], count)
    return centres[None], strength[None], radius[None]


def _vortices(rng: np.random.Generator, low: Array, size: float) -> ap.LambVortices:
    """A layer of vortices whose fastest water is a share of the vehicle's speed."""
    field = ap.LambVortices(*drawn_vortices(rng, low, size))
    x, y = _lattice(low, size, 128)
    u, v, _ = field(jnp.asarray(x), jnp.asarray(y), jnp.zeros(x.shape), jnp.zeros(x.shape))
    fastest = float(jnp.sqrt(jnp.max(u * u + v * v)))
    return field.scaled(2.5 * rng.uniform(0.2, 0.9) / fastest)


@lru_cache(maxsize=2)
def classes_of(site: str) -> NDArray[np.uint8]:
    """Classes of a whole map, first row in the south: 0 land, 1 reef or shoal, 2 water; 10 m a pixel."""
    with Image.open(MAPS / f"whitsunday_{site}_class.tif") as picture:
        return np.asarray(picture)[::-1]


@lru_cache(maxsize=8)
def _chart(site: str, reefs: bool, coarse: bool) -> ap.Chart:
    """The whole map: 10 m a pixel, or 20 m where it is coarse; reefs are coast or water."""
    classes = classes_of(site)
    water = classes == 2 if reefs else classes > 0
    if coarse:
        north, east = water.shape[0] // 2, water.shape[1] // 2
        water = water[: 2 * north, : 2 * east].reshape(north, 2, east, 2).all(axis=(1, 3))
    return ap.Chart.from_mask(water, 20.0 if coarse else 10.0)


def _cropped(rng: np.random.Generator, number: int) -> ap.Chart:
    """A square of `PIXELS` anywhere on a map; number picks the map, its scale and whether reefs are coast."""
    chart = _chart(SITES[number % 2], reefs=number % 4 < 2, coarse=number % 3 != 1)
    i, j = (int(rng.integers(0, side - PIXELS + 1)) for side in chart.shape)
    return chart.crop(i, j, PIXELS, PIXELS)


def _lattice(low: Array, size: float, count: int) -> tuple[Array, Array]:
    """x, y [count, count] m over a square, edges included."""
    line = np.linspace(0.0, size, count)
    x, y = np.meshgrid(low[0] + line, low[1] + line, indexing="ij")
    return x, y


def _worth_planning(
    chart: ap.Chart | None, low: Array, size: float, ends: Array, centres: Array, radii: Array, blocked: bool
) -> bool:
    """Whether the ends have room, a way of decent length joins them, and land lies between where it must."""

    def clearance(x: Array, y: Array) -> Array:
        away = np.hypot(x[..., None] - centres[:, 0], y[..., None] - centres[:, 1]) - radii
        nearest = away.min(axis=-1)
        return nearest if chart is None else np.minimum(nearest, np.asarray(chart.distance(x, y)))

    if clearance(ends[:, 0], ends[:, 1]).min() < CLEAR_ENDS:
        return False
    straight = ends[0] + np.linspace(0.0, 1.0, 400)[:, None] * (ends[1] - ends[0])
    if blocked and chart is not None and np.asarray(chart.distance(*straight.T)).min() > 0.0:
        return False
    x, y = _lattice(low, size, 100)
    nodes = [np.unravel_index(np.argmin((x - a) ** 2 + (y - b) ** 2), x.shape) for a, b in ends]
    moves = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1) if a or b]
    lengths = {(a, b): np.full(x.shape, np.hypot(a, b) * size / 99) for a, b in moves}
    found = quickest(clearance(x, y) > CLEAR_WAY, lengths, *nodes)
    return found is not None and found[1][-1] <= LONGEST * np.linalg.norm(ends[1] - ends[0])


def quickest(
    free: NDArray[np.bool_], seconds: Mapping[tuple[int, int], Array], start: Any, goal: Any
) -> tuple[NDArray[np.integer], Array] | None:
    """Return the quickest way over free pixels, [n, 2] pixels and times [n] s; None without any.

    Args:
        free: [nx, ny]; those beside a move must be free as well as its ends.
        seconds: by move, pixels north and east, [nx, ny] s from each pixel; infinite where it is forbidden.
    """
    labels, _ = ndimage.label(free, np.ones((3, 3)))
    if not free[start] or labels[start] != labels[goal]:
        return None
    free = free & (labels == labels[start])
    index = np.full(free.shape, -1)
    index[free] = np.arange(free.sum())
    tails, heads, times = [], [], []
    for (a, b), here in seconds.items():
        there = _shifted(here, a, b, np.inf)
        joined = free & _shifted(free, a, b) & np.isfinite(here) & np.isfinite(there)
        if max(abs(a), abs(b)) == 2:
            for part in ((a - np.sign(a), b), (a, b - np.sign(b)), (np.sign(a), np.sign(b))):
                joined = joined & _shifted(free, *map(int, part))
        tails.append(index[joined])
        heads.append(_shifted(index, a, b, -1)[joined])
        times.append(0.5 * (here + there)[joined])
    count = int(free.sum())
    edges = coo_array((np.concatenate(times), (np.concatenate(tails), np.concatenate(heads))), (count, count))
    found, before = dijkstra(edges.tocsr(), indices=index[start], return_predecessors=True)
    if not np.isfinite(found[index[goal]]):
        return None
    chain = [int(index[goal])]
    while before[chain[-1]] >= 0:
        chain.append(int(before[chain[-1]]))
    return np.argwhere(free)[chain[::-1]], found[chain[::-1]]


def _shifted(plane: Any, a: int, b: int, fill: Any = False) -> Any:
    """Return the plane's value (a, b) pixels on; `fill` beyond its edge."""
    found, (nx, ny) = np.full_like(plane, fill), plane.shape
    here = np.s_[max(0, -a) : nx - max(0, a), max(0, -b) : ny - max(0, b)]
    there = np.s_[max(0, a) : nx - max(0, -a), max(0, b) : ny - max(0, -b)]
    found[here] = plane[there]
    return found
