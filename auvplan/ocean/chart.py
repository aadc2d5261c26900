"""Charts: a picture or mask to a raster of passability and the signed distance to the coast (section 2)."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import jax
import jax.numpy as jnp
import numpy as np
import scipy
import shapely
from jax.typing import ArrayLike
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from auvplan.errors import AuvplanError, ScenarioWarning, reason_of
from auvplan.ocean.classify import UNCERTAIN_MAX, Classified, classify_picture
from auvplan.ocean.palette import DEFAULT_COLOURS, ChartColours
from auvplan.ocean.picture import opened, read_pixels
from auvplan.ocean.raster import Raster, is_traced, placed
from auvplan.runtime.arguments import numbers
from auvplan.runtime.packed import sizes

#: What the raster of distances holds where there is no coast, in pixels; `Chart.distance` is infinite there.
FAR = 1e6
#: By how many pixels the interpolated distance may exceed the true one between pixel centres.
INTERPOLATION_ERROR = 0.2


class ChartError(AuvplanError):
    """A picture that is no chart; the message is one line that names it."""


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Chart(Raster):
    """Coast, uncertain area and water on a `Raster` indexed [north, east].

    Make one with `from_mask`, `from_passability`, `from_rgb` or `from_image`.

    Attributes:
        passability: [nx, ny] float32; 0 coast, (0, 0.35] uncertain, 1 water.
        signed_distance: [nx, ny] float32, m at pixel centres, positive in water; never more than the true
            distance to the nearest coast pixel's edge.
        origin: [2] m, north and east of the corner of pixel (0, 0).
        pixel_size: m.
    """

    passability: jax.Array
    signed_distance: jax.Array
    origin: jax.Array
    pixel_size: jax.Array

    @classmethod
    def from_passability(
        cls, passability: ArrayLike, pixel_size: float = 10.0, origin: tuple[float, float] = (0.0, 0.0)
    ) -> Self:
        """Return a chart from a raster [nx, ny] indexed [north, east]: 0 coast, (0, 0.35] uncertain, 1 water.

        What a NumPy mask hides is coast.

        Raises:
            ChartError: the raster is not two-dimensional, is empty, or has other values; or pixel size or
                origin are out of range.
            TypeError: what is given are no numbers.
        """
        raster = numbers("passability", passability, np.float32, hidden=0.0)
        if raster.ndim != 2 or raster.size == 0:
            raise ChartError(f"passability must be a non-empty [nx, ny] raster, got shape {raster.shape}")
        uncertain = (raster > 0.0) & (raster <= np.float32(UNCERTAIN_MAX) + 1e-6)
        if not ((raster == 0.0) | (raster == 1.0) | uncertain).all():
            raise ChartError("passability must be 0 (coast), in (0, 0.35] (uncertain) or 1 (water)")
        pixel_size, corner = placed(pixel_size, origin, ChartError)
        return cls(
            # Single precision whatever JAX's default: a chart that is kept must serve under both settings.
            jnp.asarray(raster, jnp.float32),
            jnp.asarray(_signed_distance(raster == 0.0) * pixel_size, jnp.float32),
            jnp.asarray(corner, jnp.float32),
            jnp.asarray(pixel_size, jnp.float32),
        )

    @classmethod
    def from_mask(
        cls, water: ArrayLike, pixel_size: float = 10.0, origin: tuple[float, float] = (0.0, 0.0)
    ) -> Self:
        """Return a chart from a mask [nx, ny] indexed [north, east], True in water.

        What is NaN, or hidden by a NumPy mask, is coast.
        """
        raster = numbers("water", water)
        known = ~np.isnan(raster)
        return cls.from_passability((known & (raster != 0.0)).astype(np.float32), pixel_size, origin)

    @classmethod
    def from_rgb(
        cls,
        rgb: NDArray[np.uint8],
        pixel_size: float = 10.0,
        origin: tuple[float, float] = (0.0, 0.0),
        colours: ChartColours = DEFAULT_COLOURS,
    ) -> Self:
        """A chart from a picture [rows, columns, 3] with north up, by k-means (see `classify_picture`).

        Raises:
            ChartError: which colours are water and land is in doubt, and `colours` does not settle it.
        """
        found = settled(classify_picture(rgb, colours=colours), "the picture")
        return cls.from_classified(found, pixel_size, origin)

    @classmethod
    def from_classified(
        cls, found: Classified, pixel_size: float = 10.0, origin: tuple[float, float] = (0.0, 0.0)
    ) -> Self:
        """Return a chart from the classes of a picture with north up."""
        # Here, and only here, an image's rows (from the north) become the raster's (towards the north).
        return cls.from_passability(found.passability[::-1], pixel_size, origin)

    @classmethod
    def from_image(
        cls,
        path: str | Path,
        pixel_size: float = 10.0,
        origin: tuple[float, float] = (0.0, 0.0),
        colours: ChartColours = DEFAULT_COLOURS,
    ) -> Self:
        """Return a chart from a picture file with north up: PNG, JPEG, TIFF, GIF, BMP, WebP or JPEG 2000.

        Raises:
            ChartError: the file is missing, no picture, damaged, too large, or has no colour; or which
                colours are water and land is in doubt, and `colours` does not settle it.

        Warns:
            ScenarioWarning: the picture does not look like a chart.
        """
        return cls.from_classified(settled(classify_file(path, colours), path), pixel_size, origin)

    @property
    def shape(self) -> tuple[int, int]:
        """See `Raster.shape`."""
        return sizes(self.passability, 2)  # type: ignore[return-value]

    def grids(self) -> dict[str, tuple[int, int]]:
        """See `Packable.grids`."""
        return dict.fromkeys(("passability", "signed_distance"), (2, 2))

    def distance(self, x: ArrayLike, y: ArrayLike) -> jax.Array:
        """Signed distance to the coast, m, positive in water, infinite without one; bilinear, differentiable.

        At pixel centres it never exceeds the true distance. Between them it may, by at most 0.199 pixels, the
        worst being the corner of a coast pixel that stands alone.

        Args:
            x: north, m; any shape that broadcasts with `y`.
            y: east, m.

        Returns:
            Broadcast shape, m. Outside the chart: that of the nearest point inside less the distance there.
        """
        if is_traced(self, x, y):
            return _distance(self, x, y)
        x, y = np.broadcast_arrays(x, y)
        low, high = np.asarray(self.lower), np.asarray(self.upper)
        outside = np.hypot(x - np.clip(x, low[0], high[0]), y - np.clip(y, low[1], high[1]))
        found = self.looked_up(self.signed_distance, x, y)
        far = found >= 0.5 * FAR * np.asarray(self.pixel_size)
        # Put, not converted: a conversion is a program of its own for every shape.
        return jax.device_put(np.where(far, np.inf, found - outside).astype(found.dtype))

    def passability_at(self, x: ArrayLike, y: ArrayLike) -> jax.Array:
        """Passability by bilinear interpolation, 0 to 1; arguments as `distance`."""
        return self.interpolated("passability", x, y)

    def is_water(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.bool_]:
        """Return whether positions lie on the chart and off the coast, by the pixel they are in, in NumPy."""
        size, origin = float(self.pixel_size), np.asarray(self.origin)
        inside = self.contains(x, y)
        # Positions off the chart, NaN among them, have no pixel: any will do.
        i = np.floor(np.where(inside, np.asarray(x) - origin[0], 0.0) / size).astype(int)
        j = np.floor(np.where(inside, np.asarray(y) - origin[1], 0.0) / size).astype(int)
        raster = np.asarray(self.passability)
        return inside & (raster[np.minimum(i, self.shape[0] - 1), np.minimum(j, self.shape[1] - 1)] > 0.0)

    def land(
        self, lower: Sequence[float] | None = None, upper: Sequence[float] | None = None
    ) -> BaseGeometry:
        """Return the coast as exact outlines of its pixels, (east, north) m.

        Args:
            lower, upper: [2] m, north and east; corners of a rectangle whose pixels alone are returned.
        """
        size, corner = float(self.pixel_size), np.asarray(self.origin, float)
        first = 0 if lower is None else np.floor((np.asarray(lower, float) - corner) / size).astype(int)
        last = (
            self.shape if upper is None else np.ceil((np.asarray(upper, float) - corner) / size).astype(int)
        )
        (i, j), (m, n) = np.clip(first, 0, self.shape), np.clip(last, 0, self.shape)
        land = np.asarray(self.passability)[i:m, j:n] == 0.0
        # Runs of land along each row: whole numbers of pixels join without gaps.
        edges = np.diff(np.pad(land.astype(np.int8), ((0, 0), (1, 1))), axis=1)
        (row, begin), end = np.nonzero(edges == 1), np.nonzero(edges == -1)[1]
        runs = shapely.union_all(shapely.box(begin, row, end, row + 1))
        return shapely.transform(runs, lambda place: (place + np.array([j, i])) * size + corner[::-1])

    def crop(self, i: int, j: int, north: int, east: int) -> Self:
        """Return the part of `north` by `east` pixels from pixel (i, j) on; positions keep their coordinates.

        So do distances: a coast just beyond the part's edge is as near as it was.

        Raises:
            ChartError: the part reaches beyond the chart.
        """
        if i < 0 or j < 0 or north < 1 or east < 1 or i + north > self.shape[0] or j + east > self.shape[1]:
            raise ChartError(f"a crop of {north} x {east} pixels at ({i}, {j}) reaches beyond {self.shape}")
        part = np.s_[i : i + north, j : j + east]
        corner = self.origin + self.pixel_size * jnp.asarray((i, j), self.origin.dtype)
        return type(self)(self.passability[part], self.signed_distance[part], corner, self.pixel_size)

    def shares(self) -> dict[str, float]:
        """Shares of coast, uncertain area and water."""
        raster = np.asarray(self.passability)
        coast, water = float((raster == 0.0).mean()), float((raster == 1.0).mean())
        return {"coast": coast, "uncertain": 1.0 - coast - water, "water": water}


@jax.jit
def _distance(chart: Chart, x: jax.Array, y: jax.Array) -> jax.Array:
    """`Chart.distance`."""
    low, high = chart.lower, chart.upper
    dx = x - jnp.clip(x, low[0], high[0])
    dy = y - jnp.clip(y, low[1], high[1])
    out = dx * dx + dy * dy
    outside = jnp.where(out > 0.0, jnp.sqrt(jnp.where(out > 0.0, out, 1.0)), 0.0)
    found = chart.interpolated("signed_distance", x, y)
    return jnp.where(found >= 0.5 * FAR * chart.pixel_size, jnp.inf, found - outside)


def _signed_distance(land: NDArray[np.bool_]) -> NDArray[np.floating]:
    """Signed distance to the coast in pixels: a lower bound of the distance to the land pixels' edges.

    Centres of two pixels are at most sqrt(1/2) farther apart than the one centre is from the other's edge.
    """
    if not land.any():
        return np.full(land.shape, FAR)
    if land.all():
        return np.full(land.shape, -FAR)
    water = np.asarray(scipy.ndimage.distance_transform_edt(~land)) - np.sqrt(0.5)
    inland = np.asarray(scipy.ndimage.distance_transform_edt(land)) - 0.5
    return np.where(land, -inland, water)


def classify_file(path: str | Path, colours: ChartColours = DEFAULT_COLOURS) -> Classified:
    """Return what the pixels of a picture file stand for, in doubt or not; see `classify_picture`.

    Raises:
        ChartError: the file is missing, no picture, damaged, too large, or has no colour and `colours` states
            nothing of its greys.
    """
    path = Path(path)
    try:
        with opened(path, ChartError) as file:
            values, shown = read_pixels(path, file, ChartError)
            nodata = file.nodata
    except ChartError:
        raise
    except Exception as error:  # a decoder may raise anything on a damaged file
        raise ChartError(f"{path}: {reason_of(error)}") from None
    blank = np.zeros(values.shape[:2], bool) if shown is None else ~shown
    if values.ndim == 2:
        if not colours or values.dtype != np.uint8:
            raise ChartError(
                f"{path}: a picture without colour: water and land look the same, unless chart.colours "
                "or --water and --land name the greys of both (of 256 levels)"
            )
        blank |= values == nodata
        values = np.repeat(values[..., None], 3, axis=2)
    return classify_picture(values, blank, colours=colours)


def settled(found: Classified, what: str | Path) -> Classified:
    """Return a picture's classes where they are not in doubt.

    Raises:
        ChartError: they are; one line that says why, what to do, and which colours the picture has.

    Warns:
        ScenarioWarning: the picture does not look like a chart.
    """
    if found.doubts:
        raise ChartError(
            f"{what}: what is water and what is land is in doubt: {'; '.join(found.doubts)}: name colours of "
            f"both by chart.colours or --water and --land; it has {found.listed() or 'none'}"
        )
    for line in found.warnings:
        warnings.warn(f"{what} {line}", ScenarioWarning, stacklevel=3)
    return found
