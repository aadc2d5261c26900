"""Bounds and initial populations of the path search, and the transfer of a population to a new start."""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.environment import Environment
from auvplan.path.bspline import basis_at, basis_matrix, fit_matrix, greville_abscissae
from auvplan.path.config import GUIDE_ALTITUDE, PathConfig
from auvplan.path.kinematics import winding_length
from auvplan.path.problem import Problem

#: Sine modes of the initial detours: the first bends the path once, the second twice, ...
_MODES = 4

#: Level length of paths that wind, over that of the steepest straight one; and their greatest width to one
#: side, as a share of the box.
_LENGTHENED, _WIDEST = 1.05, 0.2

#: Radius of circles that paths wind along, over that of the tightest: splines are no circles.
_ROUNDER = 1.15

#: m, level length of a line that is a point on the map.
_POINT = 1e-3

#: Places of the straight line at which its current is looked up.
_LOOKED_AT = 9


def straight_line(start: jax.Array, goal: jax.Array, config: PathConfig) -> jax.Array:
    """Free control points evenly along the straight line, [3 n] m as x, then y, then z."""
    share = jnp.asarray(greville_abscissae(config.control_points + 2, config.degree)[1:-1], start.dtype)
    return (start[:, None] + (goal - start)[:, None] * share).reshape(-1)


def bounds(problem: Problem, config: PathConfig) -> tuple[jax.Array, jax.Array]:
    """Inclusive bounds of the free control points (beta of section 3.2), [3 n] m each.

    Every control point may leave its place on the straight line by a share of the distance, within the box of
    the environment; the curve stays in the box because a B-spline lies in the hull of its control points.
    Over a sea bed it may rise to the top of the box, or no bank could be crossed.

    Differences from the paper:
        It gives no values for the bounds L and U; the shares are chosen here (`PathConfig.width`).
    """
    (start, goal), env = problem.ends, problem.env
    distance = jnp.sqrt(((goal - start) ** 2).sum() + 1e-8)
    half = distance * jnp.asarray([config.width, config.width, config.depth_width], start.dtype)
    line = straight_line(start, goal, config).reshape(3, -1)
    low, high = env.lower[:, None], env.upper[:, None]
    lower = jnp.clip(line - half[:, None], low, high)
    upper = jnp.clip(line + half[:, None], low, high)
    if env.seabed is not None:
        lower = lower.at[2].set(env.lower[2])
    return lower.reshape(-1), upper.reshape(-1)


def widened(
    lower: jax.Array, upper: jax.Array, found: jax.Array, env: Environment
) -> tuple[jax.Array, jax.Array]:
    """Bounds [3 n] m that hold habitats [P, 3 n] m as well, as far as the box goes."""
    low, high = (jnp.repeat(corner, len(lower) // 3) for corner in (env.lower, env.upper))
    lower = jnp.minimum(lower, jnp.maximum(found.min(axis=0), low))
    return lower, jnp.maximum(upper, jnp.minimum(found.max(axis=0), high))


def initial(
    key: jax.Array, count: int, problem: Problem, lower: jax.Array, upper: jax.Array, config: PathConfig
) -> jax.Array:
    """Return a first population of `count` habitats within bounds, [count, 3 n] m.

    "uniform" draws every control point within its bounds; "smooth" is the straight line and detours of a few
    bends, of all sizes up to the bounds and to both sides. Where the world has a sea bed they rise over its
    banks.
    """
    free = config.control_points
    line = straight_line(*problem.ends, config)
    if config.start_shape == "uniform":
        population = jax.random.uniform(key, (count, 3 * free), lower.dtype, lower, upper)
    else:
        share = greville_abscissae(free + 2, config.degree)[1:-1]
        modes = np.arange(1, _MODES + 1)
        shape = np.sin(np.pi * modes[:, None] * share[None]) / modes[:, None]
        scale = 0.5 * (upper - lower).reshape(3, free)
        amplitude_key, size_key = jax.random.split(key)
        amplitude = jax.random.normal(amplitude_key, (count, 3, _MODES), lower.dtype)
        size = jax.random.uniform(size_key, (count, 1, 1), lower.dtype)
        offset = size * (amplitude @ jnp.asarray(shape, lower.dtype)) * scale
        population = (line + offset.reshape(count, 3 * free)).at[0].set(line)
    return raise_above_seabed(jnp.clip(population, lower, upper), problem, config)


def raise_above_seabed(habitats: jax.Array, problem: Problem, config: PathConfig) -> jax.Array:
    """Habitats [P, 3 n] m raised as far as their curves need it to keep the clearance above the sea bed.

    A control point rises by the most that is missing at any sample that it has weight at. Weights sum to one,
    so every sample rises by at least what it misses, and paths that follow the bed closely keep doing so.
    """
    env = problem.env
    if env.seabed is None:
        return habitats
    basis = basis_matrix(config.samples, config.control_points + 2, config.degree)
    planes = jnp.stack(jnp.split(habitats, 3, axis=1))
    first, last = (jnp.broadcast_to(end[:, None, None], (3, len(habitats), 1)) for end in problem.ends)
    polygon = jnp.concatenate([first, planes, last], axis=2)
    x, y, z = polygon @ jnp.asarray(basis.T, habitats.dtype)
    gap = jnp.sqrt(jnp.diff(x, axis=1) ** 2 + jnp.diff(y, axis=1) ** 2 + 1e-8)
    longer = jnp.maximum(jnp.pad(gap, [(0, 0), (1, 0)]), jnp.pad(gap, [(0, 0), (0, 1)]))
    missing = jnp.maximum(z - deepest(env, x, y, longer), 0.0)
    weighs = jnp.asarray(basis[:, 1:-1] > 0.0)
    rise = jnp.where(weighs, missing[:, :, None], 0.0).max(axis=1)
    return jnp.concatenate([*planes[:2], jnp.maximum(planes[2] - rise, env.lower[2])], axis=1)


def deepest(env: Environment, x: jax.Array, y: jax.Array, length: jax.Array) -> jax.Array:
    """Depth at which the clearance above the sea bed is kept with some room, m, not above the box.

    Args:
        env: a world with a sea bed.
        x, y: m, of one shape.
        length: m, of the longest segment between samples that begins or ends there.
    """
    bed = env.seabed
    assert bed is not None
    return jnp.maximum(bed.shallowest_at(x, y, length) - bed.clearance - 2.0 * GUIDE_ALTITUDE, env.lower[2])


def fitted(
    curves: Sequence[jax.Array], start: jax.Array, goal: jax.Array, config: PathConfig
) -> list[jax.Array]:
    """Fit splines to P sampled curves by least squares: inner control points [P, n] m along each axis.

    Args:
        curves: [P, S] m along north, east and, if given, down.
        start, goal: [3] m, which the splines interpolate.
        config: control points, samples and degree.
    """
    fit = fit_matrix(config.samples, config.control_points + 2, config.degree)
    planes = []
    for axis, curve in enumerate(curves):
        ends = jnp.broadcast_to(jnp.stack([start[axis], goal[axis]]), (len(curve), 2)).astype(curve.dtype)
        planes.append(jnp.concatenate([curve, ends], axis=1) @ jnp.asarray(fit, curve.dtype).T)
    return planes


def spirals(
    count: int, problem: Problem, config: PathConfig, aside: jax.Array
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Return paths that wind from start to goal where the straight line is too steep.

    The first two are bows to either side, the others turn about that line, more often where the box is
    narrow. All of them dive evenly.

    Args:
        count: of paths.
        problem: the leg, of a vehicle with limits in the vertical.
        config: static settings.
        aside: [2], direction of the first bow where the line is a point on the map.

    Returns:
        ``(habitats [count, 3 n] m, times [count] s in still water, needed [])``.
    """
    (start, goal), env, vehicle = problem.ends, problem.env, problem.vehicle
    way = goal - start
    level, rise = jnp.sqrt((way[:2] ** 2).sum() + 1e-8), jnp.abs(way[2])
    # At the steepest, for as long as the dive takes, with what the current adds along the line.
    share = jnp.linspace(0.0, 1.0, _LOOKED_AT)
    lasts = jnp.sqrt(level**2 + rise**2) / vehicle.speed
    x, y, z = (start[axis] + share * way[axis] for axis in range(3))
    u, v, _ = env.current(x, y, z, problem.depart + share * lasts)
    with_current = jnp.maximum((u * way[0] + v * way[1]).mean() / level, 0.0)
    sine = vehicle.steepest(way[2])
    speed = vehicle.speed * jnp.sqrt(1.0 - sine**2) + with_current
    wanted = _LENGTHENED * rise / (vehicle.speed * sine) * speed
    # Over ground and with the crabbing.
    fastest = vehicle.speed + jnp.sqrt(u**2 + v**2).mean()
    needed = wanted > level
    wanted = winding_length(level, wanted, _ROUNDER * fastest**2 / (vehicle.speed * vehicle.turn_rate_max))
    turns = jnp.arange(count, dtype=start.dtype) // 2
    side = jnp.where(jnp.arange(count) % 2 == 0, 1.0, -1.0)[:, None]
    share = jnp.linspace(0.0, 1.0, config.samples)
    # A bow is an arc of a circle over the line as its chord: sin(half) / half is their ratio.
    halves = jnp.linspace(0.0, jnp.pi, 257)
    half = jnp.interp(level / jnp.maximum(wanted, level), jnp.sinc(halves / jnp.pi)[::-1], halves[::-1])
    half = jnp.maximum(half, 1e-3)
    angle = half * (2.0 * share - 1.0)
    bow = 0.5 * wanted / half * jnp.stack([jnp.sin(angle) + jnp.sin(half), jnp.cos(angle) - jnp.cos(half)])
    # Turns about a centre that moves along the line add length at right angles to it, in the mean.
    around = jnp.sqrt(jnp.maximum(wanted**2 - level**2, 0.0))
    widest = _WIDEST * (env.upper - env.lower)[:2].min()
    often = jnp.maximum(turns, jnp.ceil(around / (2.0 * jnp.pi * widest)))[:, None]
    radius, angle = around / (2.0 * jnp.pi * often), 2.0 * jnp.pi * often * share
    turning = level * share + radius * jnp.sin(angle), radius * (1.0 - jnp.cos(angle))
    along, beside = (
        jnp.where(turns[:, None] == 0.0, arc, turn) for arc, turn in zip(bow, turning, strict=True)
    )
    ahead = jnp.where(level > _POINT, way[:2] / level, jnp.stack([aside[1], -aside[0]]))
    x = start[0] + along * ahead[0] - side * beside * ahead[1]
    y = start[1] + along * ahead[1] + side * beside * ahead[0]
    z = jnp.broadcast_to(start[2] + way[2] * share, x.shape)
    times = jnp.sqrt(wanted**2 + rise**2) / vehicle.speed
    habitats = jnp.stack(fitted((x, y, z), start, goal, config), axis=1).reshape(count, -1)
    return habitats, jnp.broadcast_to(times, (count,)), needed


def transfer(
    population: jax.Array,
    start: jax.Array,
    goal: jax.Array,
    progress: jax.Array,
    position: jax.Array,
    config: PathConfig,
) -> jax.Array:
    """Carry a population over to the vehicle's position: the rest of each old path, fitted again (Fig. 5).

    Each habitat's curve from parameter `progress` on is shifted so that it begins at `position` - the shift
    fades out towards the goal - and control points are fitted to it by least squares.

    Args:
        population: [P, 3 n] m, planned from `start`.
        start, goal: [3] m, ends of the old paths.
        progress: spline parameter in [0, 1) that the vehicle has reached.
        position: [3] m, where the vehicle is.
        config: static settings.

    Returns:
        [P, 3 n] m, for paths from `position` to `goal`.
    """
    free, samples = config.control_points, config.samples
    dtype = population.dtype
    ahead = jnp.linspace(0.0, 1.0, samples, dtype=dtype)
    basis = _basis_traced(progress + (1.0 - progress) * ahead, config)
    planes, curves = population.reshape(-1, 3, free), []
    for axis in range(3):
        curve = planes[:, axis] @ basis[:, 1:-1].T + start[axis] * basis[:, 0] + goal[axis] * basis[:, -1]
        curves.append(curve + (position[axis] - curve[:, :1]) * (1.0 - ahead))
    return jnp.stack(fitted(curves, position, goal, config), axis=1).reshape(-1, 3 * free)


def refitted(
    habitats: np.ndarray, start: np.ndarray, goal: np.ndarray, old: PathConfig, new: PathConfig
) -> np.ndarray:
    """Habitats [B, P, 3 n] m with the control points of other settings, by least squares along their curves.

    Args:
        habitats: [B, P, 3 m] m, of paths with the control points of `old`.
        start, goal: [B, 3] m.
        old, new: settings.
    """
    basis = basis_matrix(new.samples, old.control_points + 2, old.degree)
    fit = fit_matrix(new.samples, new.control_points + 2, new.degree)
    # Inner control points of the new splines from those of the old ones, start and goal.
    through = fit @ np.block(
        [[basis[:, 1:-1], basis[:, [0, -1]]], [np.zeros((2, old.control_points)), np.eye(2)]]
    )
    planes = habitats.reshape(*habitats.shape[:2], 3, old.control_points)
    ends = np.broadcast_to(np.stack([start, goal], axis=2)[:, None], (*planes.shape[:3], 2))
    inner = np.concatenate([planes, ends], axis=3) @ through.T
    return inner.reshape(*inner.shape[:2], -1).astype(habitats.dtype)


def without_loop(positions: np.ndarray, config: PathConfig) -> np.ndarray | None:
    """Return the habitat [3 n] m of a path less its widest loop, or None where it nowhere crosses itself.

    Args:
        positions: [S, 3] m; loops are those seen from above.
        config: control points, samples and degree.
    """
    begin, step = positions[:-1, :2], np.diff(positions[:, :2], axis=0)
    gap = begin[None] - begin[:, None]  # from segment i to segment j
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = _cross(step[:, None], step[None])
        along, other = _cross(gap, step[None]) / turn, _cross(gap, step[:, None]) / turn
        meet = (along >= 0.0) & (along <= 1.0) & (other >= 0.0) & (other <= 1.0)
    first, last = np.nonzero(np.triu(meet, k=2))
    if not len(first):
        return None
    widest = np.argmax(last - first)
    left = np.concatenate([positions[: first[widest] + 1], positions[last[widest] + 1 :]])
    run = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(left, axis=0), axis=1))])
    places = np.linspace(0.0, run[-1], config.samples)
    evenly = np.stack([np.interp(places, run, axis) for axis in left.T], axis=1)
    fit = fit_matrix(config.samples, config.control_points + 2, config.degree)
    return (fit @ np.concatenate([evenly, evenly[:1], evenly[-1:]])).T.ravel()


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Third component of the cross product of vectors [..., 2]."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _basis_traced(parameter: jax.Array, config: PathConfig) -> jax.Array:
    """Basis at traced parameters, [S, n], from a fine table by linear interpolation."""
    fine = 1024
    table = jnp.asarray(basis_at(np.linspace(0.0, 1.0, fine + 1), config.control_points + 2, config.degree))
    table = table.astype(parameter.dtype)
    place = jnp.clip(parameter, 0.0, 1.0) * fine
    left = jnp.clip(place.astype(jnp.int32), 0, fine - 1)
    part = (place - left)[:, None]
    return (1.0 - part) * table[left] + part * table[left + 1]
