"""A current scaled, or with a uniform one added: of the same kind, so that nothing is compiled again."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvplan.ocean.currents import Current, SumCurrent
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.ocean.vortices import LambVortices


def perturbed(current: Current, factor: float = 1.0, offset: ArrayLike = (0.0, 0.0, 0.0)) -> Current:
    """Return a current `factor` times as strong, and a uniform one added to it.

    Args:
        current: of vortices, a grid or tidal constituents, or a sum, whose shared part gets the offset.
        factor: of all its velocities.
        offset: [3] m/s north, east, down; a grid without a vertical component gets none.

    Raises:
        TypeError: the current is of another kind.
    """
    step = np.asarray(offset, float)

    def scaled(values: Any, along: Any = 0.0) -> Any:
        return (values * factor + along).astype(values.dtype)

    if isinstance(current, SumCurrent):
        own = None if current.own is None else perturbed(current.own, factor)
        return replace(current, shared=perturbed(current.shared, factor, step), own=own)
    if isinstance(current, LambVortices):
        uniform = scaled(np.asarray(current.uniform), step)
        return replace(current, strength=scaled(current.strength), uniform=uniform)
    if isinstance(current, GriddedCurrent):
        w = None if current.w is None else scaled(current.w, step[2])
        return replace(current, u=scaled(current.u, step[0]), v=scaled(current.v, step[1]), w=w)
    if isinstance(current, HarmonicCurrent):
        parts = {name: scaled(getattr(current, name)) for name in ("in_phase", "quadrature", "mean")}
        return replace(current, **parts, uniform=scaled(np.asarray(current.uniform), step))
    raise TypeError(f"a current of the kind {type(current).__name__} cannot be perturbed")
