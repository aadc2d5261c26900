"""The sea bed: depth on a raster, and the least depth that is certain between two look-ups."""

from dataclasses import dataclass
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.errors import AuvplanError
from auvplan.ocean.raster import Raster, is_traced, placed
from auvplan.runtime.arguments import numbers
from auvplan.runtime.packed import sizes

#: Depth of unknown pixels, m: dry land, above every vehicle.
UNKNOWN = -10.0
#: m that pixels are divided down to, and pixels at most.
FINE, MANY = 10.0, 1_000_000
#: The farthest that one look-up covers, in pixels; half of that is the next layer's, and so on to one.
FARTHEST = 32
#: Look-ups that are given no length are for segments of this share of the raster's diagonal.
_SHARE = 1.0 / 64.0


class SeabedError(AuvplanError):
    """A raster that is no sea bed; the message is one line."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Seabed(Raster):
    """Depth of the sea bed on a `Raster` indexed [north, east], bilinear between pixels' centres.

    Make one with `from_depth`.

    What a segment between two samples passes over follows from the layers of `shallow`: layer k holds at each
    pixel the least depth of all pixels in a window around it. Let p be a place at most reach[k] from a place
    e. Both interpolations are means over the corners of cells, with the weights that one uniform offset in
    [0, 1) by [0, 1) pixels, added to p and to e before rounding down, gives them. Under each offset the two
    corners are apart by the step from e to p, rounded up or down along both axes. The window holds every such
    step, so the least depth around e's corner is no deeper than the depth at p's; the means follow. Holding
    values beyond the outer centres moves no two corners apart. So the layer at e is no deeper than the sea
    bed at p: a look-up covers a circle of radius reach[k], and two at the ends for every segment of
    level length 2 * reach[k]. Beyond the reach of the last layer the bed rises by no more than its steepest
    slope.

    Attributes:
        depth: [nx, ny] float32, m at pixel centres, positive down; negative above the sea.
        shallow: [layers, nx, ny] float32, m, least depth in windows of rising size.
        reach: [layers] m, rising, how far each layer covers.
        steepest: m/m, greatest slope of the interpolated depth.
        origin: [2] m, north and east of the corner of pixel (0, 0).
        pixel_size: m.
        clearance: m, least altitude to be kept above the bed.
    """

    depth: jax.Array
    shallow: jax.Array
    reach: jax.Array
    steepest: jax.Array
    origin: jax.Array
    pixel_size: jax.Array
    clearance: jax.Array

    @classmethod
    def from_depth(
        cls,
        depth: ArrayLike,
        pixel_size: float,
        origin: tuple[float, ...] | NDArray[np.floating] = (0.0, 0.0),
        *,
        clearance: float = 5.0,
        reach: float | None = None,
    ) -> Self:
        """Return a sea bed from depths at pixel centres.

        Windows count whole pixels, so coarse pixels are divided into finer ones; the interpolated depth stays
        what it is.

        Args:
            depth: [nx, ny] m, positive down, indexed [north, east]; NaN or masked where unknown,
                which counts as dry.
            pixel_size: m.
            origin: north and east of the corner of pixel (0, 0), m.
            clearance: m, least altitude to be kept above the bed.
            reach: m, half the length of the longest segments between samples; None for layers from one pixel
                to `FARTHEST`, of which each segment takes the one that it needs.

        Raises:
            SeabedError: the raster is not two-dimensional, is empty, infinite or wholly unknown, or a number
                is out of its range.
            TypeError: what is given are no numbers.
        """
        raster = numbers("depth", depth)
        if raster.ndim != 2 or raster.size == 0:
            raise SeabedError(f"depth must be a non-empty [nx, ny] raster, got shape {raster.shape}")
        if np.isinf(raster).any():
            raise SeabedError("depth must be finite, or NaN where it is unknown")
        if np.isnan(raster).all():
            raise SeabedError("depth is unknown everywhere")
        pixel_size, corner = placed(pixel_size, origin, SeabedError)
        for name, least in (("clearance", clearance), ("reach", 0.0 if reach is None else reach)):
            if np.ndim(least) or not 0.0 <= numbers(name, least) < np.inf:
                raise SeabedError(f"{name} must be one number, not negative, m, got {least}")
        raster = np.where(np.isnan(raster), UNKNOWN, raster)
        parts = 1  # a side that each pixel is divided into: an odd number, so that old centres are new ones
        while pixel_size / parts > FINE and (parts + 2) ** 2 * raster.size <= MANY:
            parts += 2
        raster, size = _divided(raster, parts), float(pixel_size) / parts
        # In pixels: doubling, as far as the raster needs them.
        most = int(np.log2(min(FARTHEST, max(raster.shape))))
        reaches = 2.0 ** np.arange(most + 1) if reach is None else np.asarray([reach / size])
        return cls(
            # Single precision whatever JAX's default, as charts are.
            jnp.asarray(raster, jnp.float32),
            jnp.asarray(_shallowest(raster.astype(np.float32), reaches), jnp.float32),
            jnp.asarray(reaches * size, jnp.float32),
            jnp.asarray(_steepest(raster) / size, jnp.float32),
            jnp.asarray(corner, jnp.float32),
            jnp.asarray(size, jnp.float32),
            jnp.asarray(clearance, jnp.float32),
        )

    @property
    def shape(self) -> tuple[int, int]:
        """See `Raster.shape`."""
        return sizes(self.depth, 2)  # type: ignore[return-value]

    def grids(self) -> dict[str, tuple[int, int]]:
        """See `Packable.grids`."""
        return {"depth": (2, 2), "shallow": (3, 2)}

    def depth_at(self, x: ArrayLike, y: ArrayLike) -> jax.Array:
        """Depth of the sea bed, m, positive down; bilinear, differentiable.

        Args:
            x: north, m; any shape that broadcasts with `y`.
            y: east, m.

        Returns:
            Broadcast shape, m; beyond the raster that of its nearest point.
        """
        return self.interpolated("depth", x, y)

    def altitude(self, positions: ArrayLike) -> NDArray[np.floating]:
        """Altitude of positions [..., 3] m above the sea bed, [...] m, negative below it, in NumPy."""
        places = np.asarray(positions, float)
        pixels = (places[..., :2] - np.asarray(self.origin)) / float(self.pixel_size) - 0.5
        depth = scipy.ndimage.map_coordinates(
            np.asarray(self.depth), pixels.reshape(-1, 2).T, order=1, mode="nearest", output=float
        )
        return depth.reshape(places.shape[:-1]) - places[..., 2]

    def shallowest_at(self, x: ArrayLike, y: ArrayLike, length: ArrayLike | None = None) -> jax.Array:
        """Return a depth that the sea bed has nowhere less of within half a length around; differentiable.

        Args:
            x: north, m; any shape that broadcasts with `y` and `length`.
            y: east, m.
            length: level, m, of the longest segment between samples that begins or ends there; None for a
                64th of the raster's diagonal.

        Returns:
            Broadcast shape, m.
        """
        if length is None:
            length = _SHARE * float(np.hypot(*self.shape)) * self.pixel_size
        if is_traced(self, x, y, length):
            return _shallowest_at(self, x, y, length)
        x, y, half = np.broadcast_arrays(x, y, 0.5 * np.asarray(length))
        layer = np.searchsorted(np.asarray(self.reach)[:-1], half)
        found = self.looked_up(self.shallow, x, y, layer)
        beyond = np.maximum(half - np.asarray(self.reach)[-1], 0.0)
        return jax.device_put((found - np.asarray(self.steepest) * beyond).astype(found.dtype))


@jax.jit
def _shallowest_at(seabed: Seabed, x: ArrayLike, y: ArrayLike, length: ArrayLike) -> jax.Array:
    """`Seabed.shallowest_at`."""
    x, y, length = jnp.broadcast_arrays(*(jnp.asarray(v, float) for v in (x, y, length)))
    half = 0.5 * length
    layer = jnp.zeros(x.shape, jnp.int32)
    for k in range(seabed.reach.shape[0] - 1):
        layer = layer + (half > seabed.reach[k]).astype(jnp.int32)
    found = seabed.interpolated("shallow", x, y, layer)
    return found - seabed.steepest * jnp.maximum(half - seabed.reach[-1], 0.0)


def _divided(raster: NDArray[np.floating], parts: int) -> NDArray[np.floating]:
    """Return the raster on finer pixels, whose bilinear interpolation is the same."""
    for axis in (0, 1):
        count = raster.shape[axis]
        place = np.clip((np.arange(count * parts) + 0.5) / parts - 0.5, 0.0, count - 1.0)
        below = np.minimum(place.astype(int), max(count - 2, 0))
        share = np.expand_dims(place - below, 1 - axis)
        above = np.minimum(below + 1, count - 1)
        raster = np.take(raster, below, axis) * (1.0 - share) + np.take(raster, above, axis) * share
    return raster


def _shallowest(raster: NDArray[np.floating], reaches: NDArray[np.floating]) -> NDArray[np.floating]:
    """[layers, nx, ny], least values in windows for rising reaches, in pixels.

    A window of q steps of a square and d of a cross holds all whole steps (a, b) with |a| and |b| at most
    q + d and |a| + |b| at most 2 q + d. Ways no longer than r, their parts along both axes rounded up or
    down, are steps with |a| and |b| at most r rounded up, and |a| + |b| less than r sqrt(2) + 2.
    """
    layers, squares, crosses = [], 0, 0
    for reach in np.ceil(reaches).astype(int):
        q = min(reach, int(np.ceil(reach * np.sqrt(2.0))) + 1 - reach)
        for _ in range(q - squares):
            raster = _least(_least(raster, (0,)), (1,))
        for _ in range(reach - q - crosses):
            raster = _least(raster, (0, 1))
        squares, crosses = max(squares, q), max(crosses, reach - q)
        layers.append(raster)
    return np.stack(layers)


def _least(raster: NDArray[np.floating], axes: tuple[int, ...]) -> NDArray[np.floating]:
    """Return the least of each pixel and its neighbours along some axes."""
    least = raster.copy()
    for axis in axes:
        low, high = (slice(None),) * axis + (slice(None, -1),), (slice(None),) * axis + (slice(1, None),)
        np.minimum(least[low], raster[high], out=least[low])
        np.minimum(least[high], raster[low], out=least[high])
    return least


def _steepest(raster: NDArray[np.floating]) -> float:
    """Greatest slope of the bilinear interpolation, per pixel."""
    north, east = (np.abs(np.diff(raster, axis=axis)) for axis in (0, 1))
    if raster.shape[0] > 1 and raster.shape[1] > 1:
        north, east = np.maximum(north[:, :-1], north[:, 1:]), np.maximum(east[:-1], east[1:])
        return float(np.hypot(north, east).max())
    return float(max(north.max(initial=0.0), east.max(initial=0.0)))
