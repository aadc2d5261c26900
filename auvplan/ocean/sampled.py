"""A current given as a function, sampled on a grid.

Every function needs programs of its own; all grids of one shape share theirs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, wraps

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.currents import FunctionCurrent, axes_used, evaluated
from auvplan.ocean.gridded import CurrentError, GriddedCurrent
from auvplan.runtime.pytree import register_without_init

#: Nodes in time, depth, north and east: of steady currents and of others, the same at all depths or not. They
#: are as many as a program takes without being slower than one of a function.
_NODES = {
    (False, False): (1, 1, 256, 256),
    (False, True): (1, 24, 128, 128),
    (True, False): (32, 1, 192, 192),
    (True, True): (16, 16, 96, 96),
}

#: Share of the nodes in depth that lie where the current bends with depth; the others lie evenly.
_BENT = 0.8

#: Depths at which the current is looked up to find where it changes, and columns in which it is.
_FINE, _COLUMNS = 400, 12

#: Places and times at which samples are held against the function.
_CHECKED = 8192


@register_without_init
@dataclass(frozen=True, eq=False)
class SampledCurrent(GriddedCurrent):
    """A function's current at the nodes of a grid; it may change as quickly in time as the function does."""

    gradual = False


_Sampled = tuple[SampledCurrent, float] | None


def _kept(sample: Callable[..., _Sampled]) -> Callable[..., _Sampled]:
    """Keep the last samples of functions by their form as a pytree, which holds the values they capture."""
    of_form = lru_cache(maxsize=4)(lambda form, *box: sample(form.unflatten(()), *box))
    return wraps(sample)(lambda current, *box: of_form(jax.tree.structure(current), *box))


@_kept
def sampled(
    current: FunctionCurrent,
    lower: tuple[float, float, float],
    upper: tuple[float, float, float],
    first: float,
    last: float,
    within: float,
) -> _Sampled:
    """Sample a function's current between two corners and two times.

    Args:
        current: the function.
        lower, upper: m, north, east and depth of the corners.
        first, last: s since the epoch.
        within: m/s, by which samples may differ from the function.

    Returns:
        The samples, linear in between, and the most by which they differ from the function at random places,
        m/s; None where that is more than allowed, or where single precision cannot hold the nodes apart.
    """
    with_depth = axes_used(current)[2] and upper[2] > lower[2]
    with_time = axes_used(current, vertical=True)[3]
    count = _NODES[with_time, with_depth]
    times = np.linspace(first, last, count[0]) if with_time else np.array([first])
    rng, corners = np.random.default_rng(0), (np.array(lower), np.array(upper))
    depths = np.array([lower[2]])
    if with_depth:
        depths = _levels(current, corners, (first, last), count[1], rng)
    north, east = (np.linspace(lower[axis], upper[axis], count[axis + 2]) for axis in (0, 1))
    t, z, x, y = np.meshgrid(times, depths, north, east, indexing="ij")
    u, v, w = evaluated(current, x, y, z, t)
    if not (np.isfinite(u) & np.isfinite(v) & np.isfinite(w)).all():
        return None  # the planner's own look will say where
    apart = north[1] - north[0], east[1] - east[0]
    down = w if w.any() else None
    try:
        grid = SampledCurrent.from_arrays(
            u, v, down, origin=(lower[0], lower[1]), spacing=apart, depths=depths, times=times
        )
    except CurrentError:
        return None
    at = corners[0] + (corners[1] - corners[0]) * rng.random((_CHECKED, 3))
    when = first + (last - first) * rng.random(_CHECKED)
    x, y, z = at.T
    both = zip(evaluated(current, x, y, z, when), evaluated(grid, x, y, z, when), strict=True)
    error = float(np.sqrt(sum((one - other) ** 2 for one, other in both)).max())
    return (grid, error) if error <= within else None


def _levels(
    current: FunctionCurrent,
    corners: tuple[NDArray[np.floating], NDArray[np.floating]],
    times: tuple[float, float],
    count: int,
    rng: np.random.Generator,
) -> NDArray[np.floating]:
    """Depths [count] m from the upper to the lower corner, denser where the current bends."""
    depth = np.linspace(corners[0][2], corners[1][2], _FINE)
    x, y = corners[0][:2, None, None] + (corners[1] - corners[0])[:2, None, None] * rng.random(
        (2, _COLUMNS, 1)
    )
    when = times[0] + (times[1] - times[0]) * rng.random((_COLUMNS, 1))
    u, v, _ = evaluated(current, x, y, depth[None], when)
    # Errors between nodes are in proportion to curvature and to the square of the distance.
    bend = np.sqrt(np.hypot(np.diff(u, 2, axis=1), np.diff(v, 2, axis=1)).max(axis=0))
    even = np.full(_FINE - 1, 1.0 / (_FINE - 1))
    density = np.convolve(bend, [0.5, 0.5]) / max(bend.sum(), 1e-9)
    density = (1.0 - _BENT) * even + _BENT * density
    marks = np.concatenate([[0.0], np.cumsum(density)])
    return np.interp(np.linspace(0.0, marks[-1], count), marks, depth)
