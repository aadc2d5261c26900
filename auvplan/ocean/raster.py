"""Rasters in local metres, and bilinear look-ups of them whose slopes cost next to nothing."""

from functools import partial
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.errors import AuvplanError
from auvplan.runtime.arguments import numbers
from auvplan.runtime.compiled import compiled
from auvplan.runtime.packed import Packable, Packed, flat, is_one, sizes
from auvplan.runtime.pytree import instantiated, is_symbolic_zero

#: Values [nx, ny] indexed [north, east], or [layers, nx, ny], packed or not; north and east of the corner of
#: pixel (0, 0) [2] m, and m of a pixel.
_Plane = tuple[Any, jax.Array, jax.Array]


@jax.custom_jvp
def _bilinear(plane: _Plane, x: jax.Array, y: jax.Array, layer: jax.Array | None = None) -> jax.Array:
    """Bilinear interpolation of a raster, held beyond the outer pixels' centres.

    Args:
        plane: of one layer, or of several where `layer` is given.
        x, y: north and east, m, of one shape.
        layer: of that shape, int32, in which layer each place is looked up.

    Returns:
        Of that shape; differentiable by `x` and `y` alone.
    """
    return _with_slopes(plane, x, y, layer)[0]


@partial(_bilinear.defjvp, symbolic_zeros=True)
def _bilinear_jvp(primals: tuple, tangents: tuple) -> tuple[jax.Array, jax.Array]:
    """Take the slopes from the four pixels that the value is from: nothing is looked up twice."""
    if not is_symbolic_zero(tangents[0]):
        return jax.jvp(lambda *given: _with_slopes(*given)[0], primals, instantiated(tangents, primals))
    value, *slopes = _with_slopes(*primals)
    dx, dy = instantiated(tangents[1:3], primals[1:3])
    return value, slopes[0] * dx + slopes[1] * dy


#: Compiled, or every call outside a compiled program would compile its loop again.
bilinear = compiled(_bilinear)


def _with_slopes(
    plane: _Plane, x: jax.Array, y: jax.Array, layer: jax.Array | None = None
) -> tuple[jax.Array, ...]:
    """Interpolated value, and its slopes along x and y, 1/m.

    In two halves, one after the other: what a loop finds is stored, where XLA would look the pixels up again
    for every expression that uses them, at twice the time of a whole path cost.
    """
    half = -(-x.size // 2)
    axes = (x, y) if layer is None else (x, y, layer)
    halves = [jnp.pad(jnp.ravel(axis), (0, 2 * half - x.size)).reshape(2, half) for axis in axes]
    found = jax.lax.map(lambda places: _looked_up(plane, *places), tuple(halves))
    return tuple(row.reshape(-1)[: x.size].reshape(x.shape) for row in found)


def _looked_up(
    plane: _Plane, x: jax.Array, y: jax.Array, layer: jax.Array | None = None
) -> tuple[jax.Array, ...]:
    raster, origin, pixel_size = plane
    (north, east), row = sizes(raster, 2), flat(raster)
    i, j = (x - origin[0]) / pixel_size - 0.5, (y - origin[1]) / pixel_size - 0.5
    within_i, within_j = (i > 0.0) & (i < north - 1.0), (j > 0.0) & (j < east - 1.0)
    i, j = jnp.clip(i, 0.0, north - 1.0), jnp.clip(j, 0.0, east - 1.0)
    i0 = jnp.clip(i.astype(jnp.int32), 0, 0 if is_one(north) else north - 2)
    j0 = jnp.clip(j.astype(jnp.int32), 0, 0 if is_one(east) else east - 2)
    a, b, corner = i - i0, j - j0, i0 * east + j0
    if layer is not None:
        corner = corner + layer * (raster.values.shape[-1] if isinstance(raster, Packed) else north * east)
    up, right = (0 if is_one(north) else east), (0 if is_one(east) else 1)

    def at(offset: Any) -> jax.Array:
        return row.at[corner + offset].get(mode="promise_in_bounds", wrap_negative_indices=False)

    along_south, along_north = at(right) - at(0), at(up + right) - at(up)
    south, across = at(0) + b * along_south, at(up) - at(0) + b * (along_north - along_south)
    along = along_south + a * (along_north - along_south)
    slopes = (jnp.where(within_i, across, 0.0) / pixel_size, jnp.where(within_j, along, 0.0) / pixel_size)
    return south + a * across, *slopes


class Raster(Packable):
    """Planes of pixels indexed [north, east] in local metres, with one interpolation.

    Pixel (i, j) covers origin + (i, j) * pixel_size to origin + (i + 1, j + 1) * pixel_size. Dataclasses that
    derive from it hold the planes, `origin` [2] m, the south-western corner, and `pixel_size` m.
    """

    origin: jax.Array
    pixel_size: jax.Array

    @property
    def shape(self) -> tuple[int, int]:
        """Pixels north and east; traced where the raster is packed."""
        raise NotImplementedError

    @property
    def lower(self) -> jax.Array:
        """[2] m, south-western corner."""
        return self.origin

    @property
    def upper(self) -> jax.Array:
        """[2] m, north-eastern corner; in NumPy where nothing is traced."""
        origin, size = self.origin, self.pixel_size
        if isinstance(origin, Tracer) or isinstance(size, Tracer):
            return origin + size * jnp.asarray(self.shape, jnp.result_type(origin))
        corner = np.asarray(origin)
        return corner + np.asarray(size) * np.asarray(self.shape, corner.dtype)  # type: ignore[return-value]

    def contains(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Return whether positions, north and east [m], lie on the raster, in NumPy."""
        low, high = np.asarray(self.lower), np.asarray(self.upper)
        x, y = np.asarray(x), np.asarray(y)
        return (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])

    def interpolated(
        self, plane: str, x: ArrayLike, y: ArrayLike, layer: jax.Array | None = None
    ) -> jax.Array:
        """Return a plane [nx, ny] at places, or of [layers, nx, ny] the `layer` of each; see `bilinear`.

        The plane is given by its name. Where nothing is traced, nothing is compiled.
        """
        if not is_traced(self, x, y, layer):
            x, y = np.broadcast_arrays(x, y)
            return jax.device_put(self.looked_up(getattr(self, plane), x, y, layer))
        raster = self.packed
        x, y = jnp.broadcast_arrays(jnp.asarray(x), jnp.asarray(y))
        return bilinear((getattr(raster, plane), raster.origin, raster.pixel_size), x, y, layer)

    def looked_up(
        self, plane: jax.Array, x: ArrayLike, y: ArrayLike, layer: ArrayLike | None = None
    ) -> NDArray[np.floating]:
        """Return `interpolated` in NumPy, of any number of places and without compiling."""
        chex.assert_rank(plane, 2 if layer is None else 3)
        dtype = jax.dtypes.canonicalize_dtype(float)
        x, y = np.asarray(x, dtype), np.asarray(y, dtype)
        raster, corner, size = np.asarray(plane), np.asarray(self.origin), np.asarray(self.pixel_size)
        north, east = raster.shape[-2:]
        i = np.clip((x - corner[0]) / size - dtype.type(0.5), 0, north - 1)
        j = np.clip((y - corner[1]) / size - dtype.type(0.5), 0, east - 1)
        with np.errstate(invalid="ignore"):  # what is no number has no pixel: any will do
            i0 = np.clip(i.astype(np.int32), 0, max(north - 2, 0))
            j0 = np.clip(j.astype(np.int32), 0, max(east - 2, 0))
        a, b, first = i - i0.astype(dtype), j - j0.astype(dtype), i0 * east + j0
        if layer is not None:
            first = first + np.asarray(layer) * (north * east)
        row, up, right = raster.reshape(-1), (east if north > 1 else 0), (1 if east > 1 else 0)
        south = row[first] + b * (row[first + right] - row[first])
        first = first + up
        return south + a * (row[first] + b * (row[first + right] - row[first]) - south)


def placed(pixel_size: Any, origin: Any, fault: type[AuvplanError]) -> tuple[float, NDArray[np.floating]]:
    """Return the size of a raster's pixels, m, and north and east of its corner, [2] m.

    Raises:
        AuvplanError: `fault`, where one is out of its range.
        TypeError: they are no numbers.
    """
    size, corner = numbers("pixel_size", pixel_size), numbers("origin", origin)
    if size.shape or not (np.isfinite(size) and size > 0.0):
        raise fault(f"pixel_size must be positive, m, one number for north and east, got {pixel_size}")
    if corner.shape != (2,) or not np.isfinite(corner).all():
        raise fault(f"origin must be (north, east), m, got {origin}")
    return float(size), corner


def is_traced(*trees: Any) -> bool:
    """Return whether JAX traces any array of some trees."""
    return any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(trees))
