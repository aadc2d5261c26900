"""Random gridded currents and their NumPy twin, which several tests share."""

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean import GriddedCurrent

#: u, v, w [3, ...] of a current at x, y, z, t.
look_up = jax.jit(lambda current, *at: jnp.stack(current(*at)))

ORIGIN, SPACING = (-40.0, 75.0), (20.0, 35.0)

#: Depths and times of grids: even or not, one or several.
AXES = {
    "even": ([0.0, 10.0, 20.0, 30.0], [0.0, 600.0, 1200.0]),
    "uneven": ([0.5, 3.0, 10.0, 50.0], [-100.0, 250.0, 3600.0]),
    "two": ([5.0, 9.0], [50.0, 80.0]),
    "one level": ([7.0], [0.0, 600.0, 1200.0]),
    "one time": ([0.0, 4.0, 10.0], [30.0]),
    "one of each": ([0.0], [0.0]),
    "many uneven": ([0.0, 8.0], np.cumsum(1.0 + np.arange(60) % 3)),
}


def arrays(axes, nodes=(5, 4), seed=0):
    """u, v, w [T, Z, X, Y] drawn at random."""
    depths, times = AXES[axes]
    return np.random.default_rng(seed).normal(size=(3, len(times), len(depths), *nodes))


def grid(axes="uneven", vertical=True, nodes=(5, 4), seed=0):
    """A current with values drawn at random."""
    u, v, w = arrays(axes, nodes, seed)
    depths, times = AXES[axes]
    return GriddedCurrent.from_arrays(
        u, v, w if vertical else None, origin=ORIGIN, spacing=SPACING, depths=depths, times=times
    )


def places(field, count=200, seed=1, beyond=0.25):
    """x, y, z, t [4, count] over the grid and beyond it by that share of its extents."""
    low, high = (np.array(edge) for edge in edges(field))
    margin = beyond * np.maximum(high - low, 1.0)
    return np.random.default_rng(seed).uniform(low - margin, high + margin, (count, 4)).T


def axes_of(field):
    """Nodes north, east, in depth and in time."""
    origin, spacing = np.asarray(field.origin, float), np.asarray(field.spacing, float)
    counts = field.u.shape[2:]
    level = [origin[k] + spacing[k] * np.arange(counts[k]) for k in range(2)]
    return *level, np.asarray(field.depths, float), np.asarray(field.times, float)


def edges(field):
    """First and last node north, east, in depth and in time."""
    nodes = axes_of(field)
    return [axis[0] for axis in nodes], [axis[-1] for axis in nodes]


def naive(values, nodes, place):
    """One field [T, Z, X, Y] at one place (x, y, z, t): the sum over 16 corners, each by its weight."""
    corners = []
    for axis, at in zip(nodes, place, strict=True):
        at = min(max(at, axis[0]), axis[-1])
        low = min(int(np.searchsorted(axis, at, side="right")) - 1, max(len(axis) - 2, 0))
        high = min(low + 1, len(axis) - 1)
        share = (at - axis[low]) / (axis[high] - axis[low]) if high > low else 0.0
        corners.append(((low, 1.0 - share), (high, share)))
    north, east, depth, time = corners
    return sum(
        values[n, k, i, j] * a * b * c * d
        for n, a in time
        for k, b in depth
        for i, c in north
        for j, d in east
    )


def twin(field, points):
    """u, v, w [3, N] at x, y, z, t [4, N]."""
    components = [field.u, field.v, np.zeros(field.u.shape) if field.w is None else field.w]
    nodes = axes_of(field)
    return np.array([[naive(np.asarray(c, float), nodes, p) for p in points.T] for c in components])
