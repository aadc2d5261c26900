"""Reading variables at the points where the current is given."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.geometry import Geometry, Window
from auvplan.io.currents.names import find_floor, standard_name
from auvplan.io.currents.opening import Pick, text
from auvplan.io.currents.series import Array, Series
from auvplan.io.currents.triangles import Triangles, cell_means
from auvplan.io.currents.units import length_factor

_SURFACES = ("zeta", "elev", "elevation", "ssh", "zos")
_SURFACE_NAMES = ("sea_surface_height_above_geoid", "sea_surface_height_above_mean_sea_level",
                  "sea_surface_height", "sea_surface_elevation")  # fmt: skip
#: No surface, nor land that models give instead, lies so far from the datum, m.
_HIGHEST = 9_000.0
#: Masks of land by name, 1 is water: ROMS, NEMO, MITgcm and MOM6; and by standard name.
MASKS = ("mask_rho", "tmask", "maskC", "hFacC", "wet")
MASK_NAMES = ("sea_binary_mask", "land_binary_mask")
#: Masks of flats that fall dry, of FVCOM, ROMS and SCHISM, and whether 1 is dry.
_WETTING = (
    ("wet_cells", False), ("wet_nodes", False), ("wetdry_mask_rho", False), ("wetdry_mask", False),
    ("dryFlagElement", True), ("dryFlagNode", True), ("wetdry_elem", True), ("wetdry_node", True),
)  # fmt: skip


@dataclass(frozen=True)
class Points:
    """The points of a series where its current is given.

    Attributes:
        series: the files.
        geometry: the places of the points.
    """

    series: Series
    geometry: Geometry

    def has(self, name: str) -> bool:
        """Return whether a variable is given at the points, or at the corners of their cells."""
        dims = set(self.series.dims(name))
        return set(self.geometry.dims) <= dims or (self._corners is not None and self._corners in dims)

    @property
    def _corners(self) -> str | None:
        """The dimension of the cells' corners, where the points are the cells' middles."""
        grid = self.geometry
        return grid.cells.dim if isinstance(grid, Triangles) and grid.in_cells and grid.cells else None

    def read(self, name: str, frames: slice, window: Window, extra: tuple[str, ...] = ()) -> Array:
        """Return values [T, *extra, P] at a window's points; T is 1 where the variable knows no time.

        What is given at nodes is the mean of a cell's corners where the points are cells.

        Raises:
            CurrentError: the variable has other dimensions, or cannot be read.
        """
        dims = self.series.dims(name)
        along = self.geometry.dims if set(self.geometry.dims) <= set(dims) else (self._corners or "",)
        if sorted(dims) != sorted((*extra, *along)):
            fitting = ", ".join((*extra, *along))
            raise self.series.fail(f"{name} has dimensions {', '.join(dims)}, not {fitting}")
        if along == self.geometry.dims:
            values = self.series.read(name, window.picks, frames, (*extra, *along))
            return values.reshape(*values.shape[: 1 + len(extra)], window.points)
        grid = self.geometry
        assert isinstance(grid, Triangles)
        assert grid.cells is not None
        nodes = self.series.read(name, {}, frames, (*extra, *along))
        return cell_means(grid.cells, nodes, np.asarray(window.picks[self.geometry.dims[0]]))

    def metres(self, name: str) -> float:
        """Return metres in a variable's unit of length; variables without units are in metres.

        Raises:
            CurrentError: the unit is no length.
        """
        units = text(self.series.attrs(name), "units")
        factor = length_factor(units) if units else 1.0
        if factor is None:
            raise self.series.fail(f"{name} has units {units!r}, which are no length: metres are needed")
        return factor

    def floor_name(self) -> str | None:
        """Return the variable that tells the depth of the sea bed, or None."""
        names = [find_floor(self.series.files[0], self.geometry.dims)]
        if self._corners is not None:
            names.append(find_floor(self.series.files[0], (self._corners,)))
        return next((name for name in names if name is not None), None)

    def floor(self, window: Window) -> Array | None:
        """Depth [P] m of the sea bed below the datum; NaN on land, None where it is not given."""
        name = self.floor_name()
        if name is None:
            return None
        depth = self.read(name, slice(0, 1), window)[0] * self.metres(name) * self._downward
        return np.where(self.water(window), depth, np.nan)

    @cached_property
    def _downward(self) -> float:
        """1, or -1 where the sea bed is told as a height: so it says, or it is negative everywhere."""
        name, file = str(self.floor_name()), self.series.files[0]
        values = file.read(name)
        up = text(self.series.attrs(name), "positive").lower() == "up" and bool((values < 0.0).any())
        below = np.fmax.reduce(values, axis=None) < 0.0
        return -1.0 if up or below or standard_name(file, name) == "altitude" else 1.0

    def rise_name(self) -> str | None:
        """Return the variable that tells the height of the surface, or None."""
        file = self.series.files[0]
        fitting = [
            name for name in file.variables if self.has(name) and len(self.series.dims(name)) in (1, 2)
        ]
        fitting = [n for n in fitting if len(self.series.dims(n)) <= len(self.geometry.dims)]
        named = [name for name in fitting if standard_name(file, name) in _SURFACE_NAMES]
        plain = [name for name in _SURFACES if name in fitting]
        return (plain + named + [None])[0]

    def rise(self, frames: slice, window: Window) -> Array:
        """Height [T, P] m of the surface above the datum; 0 where it is not given."""
        name = self.rise_name()
        if name is None:
            return np.zeros((1, window.points))
        rise = np.nan_to_num(self.read(name, frames, window) * self.metres(name))
        if (far := float(np.abs(rise).max(initial=0.0))) > _HIGHEST:
            raise self.series.fail(
                f"{name} reaches {far:g} m, where there is no sea: check _FillValue and units"
            )
        return rise

    def lowest(self, frames: slice, window: Window) -> Array | None:
        """Return the least height [P] m of the surface above the datum at some times, None if not given."""
        if self.rise_name() is None:
            return None
        low = self.rise(frames, window).min(axis=0)
        return np.where(self.water(window), low, np.nan)

    def wet(self, frames: slice, window: Window) -> NDArray[np.bool_]:
        """[T, P], False where a mask that changes in time says dry; T is 1 where there is none."""
        for name, dry in _WETTING:
            if name in self.series.variables and self.has(name):
                mask = np.nan_to_num(self.read(name, frames, window), nan=float(dry)) > 0.5
                return ~mask if dry else mask
        return np.ones((1, window.points), bool)

    def masks(self, level: str | None = None) -> list[str]:
        """Return the masks of land that the file has at the points, or at the points of all levels."""
        file, dims = self.series.files[0], {*self.geometry.dims, *([] if level is None else [level])}
        return [
            name
            for name in file.variables
            if (name in MASKS or standard_name(file, name) in MASK_NAMES)
            and set(file.variables[name].dims) == dims
        ]

    @cached_property
    def mask(self) -> str | None:
        """The mask of land; None without one, or where it says land everywhere: that was never written."""
        return self.mask_along(None)

    def mask_along(self, level: str | None) -> str | None:
        """Return `mask`, of the points of all levels where there is a dimension of them."""
        # Of many levels the first and the last tell it, one of which is the surface.
        file, picks = self.series.files[0], {}
        if level is not None:
            last = next(v.sizes[level] for v in file.variables.values() if level in v.dims) - 1
            picks = {level: np.unique([0, last])}
        found = self.masks(level)
        return next((name for name in found if self._wet(name, file.read(name, picks)).any()), None)

    def water(self, window: Window) -> NDArray[np.bool_]:
        """[P], False where a mask of the file says land."""
        if self.mask is None:
            return np.ones(window.points, bool)
        return self._wet(self.mask, self.read(self.mask, slice(0, 1), window)[0])

    def is_water(self, name: str, picks: Mapping[str, Pick], dims: tuple[str, ...]) -> NDArray[np.bool_]:
        """[*dims], where a mask says water."""
        return self._wet(name, self.series.read(name, picks, slice(0, 1), dims)[0])

    def _wet(self, name: str, values: Array) -> NDArray[np.bool_]:
        """Return where values of a mask say water; shares of cells, as MITgcm gives them, count from 0 on."""
        if standard_name(self.series.files[0], name) == "land_binary_mask":
            return np.nan_to_num(values, nan=1.0) < 0.5
        return np.nan_to_num(values) > (0.0 if name == "hFacC" else 0.5)
