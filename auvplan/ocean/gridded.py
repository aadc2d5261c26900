"""Currents on a grid, as models of the sea give them: linear in north, east, depth and time."""

from dataclasses import dataclass
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray
from scipy import ndimage

from auvplan.ocean.currents import Velocity
from auvplan.pytree import rebuilt_as_is


class CurrentError(ValueError):
    """A current that cannot be read or used; the message is one line that names what is wrong."""


@rebuilt_as_is("u", "v", "w", "water", "origin", "spacing", "depths", "times")
@dataclass(frozen=True)
class GriddedCurrent:
    """A current on a grid of even metres north and east, rising depths and rising times.

    Make one with `from_arrays`. Beyond the grid's edges the nearest edge holds.

    Attributes:
        u, v, w: [T, Z, X, Y] m/s north, east, down; w is None where there is no vertical velocity.
        water: [Z, X, Y] bool, where the data has a current; elsewhere - land, or below the sea bed - u, v and
            w hold what the nearest water of that depth has, or the water above.
        origin: [2] m, north and east of node (0, 0).
        spacing: [2] m, north and east, between nodes.
        depths: [Z] m, positive down.
        times: [T] s since the epoch.
    """

    u: jax.Array
    v: jax.Array
    w: jax.Array | None
    water: jax.Array
    origin: jax.Array
    spacing: jax.Array
    depths: jax.Array
    times: jax.Array
