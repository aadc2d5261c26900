"""Ocean files read by netCDF4, cftime and NumPy alone, and their currents interpolated by loops.

What `benchmarks.files` and `benchmarks.mutated_files` hold the readers of `auvplan.io` against: no code of
theirs is used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

import cftime
import netCDF4
import numpy as np
import shapely
from pyproj import Proj, Transformer
from scipy.spatial import Delaunay

SPEEDS = {
    "m s-1": 1.0, "m/s": 1.0, "m/sec": 1.0, "ms-1": 1.0, "meter second-1": 1.0, "meters s-1": 1.0, "": 1.0,
    "cm s-1": 0.01, "cm/s": 0.01, "knots": 1852.0 / 3600.0, "km h-1": 1.0 / 3.6,
}  # fmt: skip
DEGREES = {"degrees_east": 1.0, "degrees_north": 1.0, "": 1.0}
LENGTHS = {"m": 1.0, "meter": 1.0, "meters": 1.0, "": 1.0, "cm": 0.01, "km": 1000.0}


class Unreadable(Exception):
    """The file does not tell a current, or contradicts itself."""


@dataclass(frozen=True)
class Table:
    """A current at a model's own points, levels and times."""

    longitude: np.ndarray  # [P] degrees
    latitude: np.ndarray  # [P] degrees
    depth: np.ndarray  # [1 or T, K, P] m below the surface, NaN where a column has no such level
    east: np.ndarray  # [T, K, P] m/s, NaN where there is no water
    north: np.ndarray  # [T, K, P] m/s, NaN where there is no water
    times: np.ndarray  # [T] s since 1970
    floor: np.ndarray | None = None  # [1 or T, P] m below the surface; None where it is not given
    rows: np.ndarray | None = None  # [ny, nx] points of a regular grid (bilinear in degrees), or None
    triangles: np.ndarray | None = None  # [N, 3] points between which the current is linear in metres
    # shapely polygons in degrees beyond which there is land; None for everywhere within triangles
    cells: np.ndarray | None = None
    torn: float = 30.0  # sides of triangles that are so many times as long as usual are none

    def column(self, frame: int, point: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rising depths of the levels of a column that have a current, and the current east and north."""
        depth = self.depth[min(frame, len(self.depth) - 1), :, point if self.depth.shape[2] > 1 else 0]
        east, north = self.east[frame, :, point], self.north[frame, :, point]
        # Of two levels at one depth, as in a column that has run dry, a missing one counts.
        there = np.isfinite(east) & np.isfinite(north)
        known = np.flatnonzero(np.isfinite(depth) & there & ~np.isin(depth, depth[~there]))
        order = known[np.argsort(depth[known], kind="stable")]
        return depth[order], east[order], north[order]

    def at(self, corners: Sequence[int], shares: Sequence[float], depth: float, second: float) -> np.ndarray:
        """[2] m/s of a mixture of columns at a moment, linear between levels.

        The first level holds above; NaN where a column has none, and below its deepest.
        """
        after = int(np.searchsorted(self.times, second))
        if after < len(self.times) and self.times[after] == second:
            frames: list[tuple[int, float]] = [(after, 1.0)]
        else:
            share = (second - self.times[after - 1]) / (self.times[after] - self.times[after - 1])
            frames = [(after - 1, 1.0 - share), (after, share)]
        total = np.zeros(2)
        for frame, weight in frames:
            for point, part in zip(corners, shares, strict=True):
                if part > 0.0:
                    levels, *current = self.column(frame, int(point))
                    if not len(levels) or depth > levels[-1] + 1e-9:
                        return np.full(2, np.nan)
                    total += [weight * part * np.interp(depth, levels, axis) for axis in current]
        return total

    def mixture(self, longitude: float, latitude: float) -> tuple[list[int], list[float]] | None:
        """Points and shares whose mixture a place is; None beyond the grid."""
        if self.rows is not None:
            return self._bilinear(longitude, latitude)
        place = shapely.Point(self._turned(longitude), latitude)
        if self._cells is not None and not self._cells.query(place, predicate="intersects").size:
            return None
        assert self.triangles is not None
        local = Proj(proj="aeqd", lon_0=longitude, lat_0=latitude, datum="WGS84")
        near = self._corners_tree.query(place, predicate="dwithin", distance=1e-4)
        for number in near:
            corners = self.triangles[number]
            x, y = local(self.longitude[corners], self.latitude[corners])
            area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
            if abs(area) < 1e-6 or np.hypot(np.diff(x), np.diff(y)).max() > self._longest:
                continue
            b = (x[2] - x[0]) * y[0] - x[0] * (y[2] - y[0])
            c = x[0] * (y[1] - y[0]) - (x[1] - x[0]) * y[0]
            shares = np.array([1.0 - (b + c) / area, b / area, c / area])
            if (shares >= -1e-7).all():
                return corners.tolist(), np.clip(shares, 0.0, 1.0).tolist()
        return None

    def _turned(self, longitude: Any) -> Any:
        """Degrees about the middle of the grid."""
        middle = float(np.nanmedian(self.longitude))
        return middle + (np.asarray(longitude) - middle + 180.0) % 360.0 - 180.0

    @cached_property
    def _corners(self) -> np.ndarray:
        """[N, 3, 2] degrees of the triangles' corners."""
        return np.stack([self._turned(self.longitude), self.latitude], axis=-1)[self.triangles]

    @cached_property
    def _longest(self) -> float:
        """Longest side, m, of a triangle."""
        corners = self._corners * [np.cos(np.deg2rad(np.nanmedian(self.latitude))), 1.0]
        sides = np.hypot(*np.moveaxis(np.diff(corners, axis=1), 2, 0)).ravel() * 111_195.0
        return self.torn * float(np.nanmedian(sides))

    @cached_property
    def _cells(self) -> shapely.STRtree | None:
        return None if self.cells is None else shapely.STRtree(self.cells)

    @cached_property
    def _corners_tree(self) -> shapely.STRtree:
        # A place that is not given is a corner of nothing, which keeps its number.
        there = np.isfinite(self._corners).all((1, 2))
        shapes = shapely.polygons(np.where(there[:, None, None], self._corners, 0.0))
        shapes[~there] = shapely.Polygon()
        return shapely.STRtree(shapes)

    def _bilinear(self, longitude: float, latitude: float) -> tuple[list[int], list[float]] | None:
        assert self.rows is not None
        y, x = self.latitude[self.rows[:, 0]], self.longitude[self.rows[0]]
        x = x[0] + (x - x[0] + 180.0) % 360.0 - 180.0 if np.ptp(x) < 180.0 else np.unwrap(x, period=360.0)
        east = x.min() + (longitude - x.min()) % 360.0
        found = []
        for axis, value in ((y, latitude), (x, east)):
            order = np.argsort(axis)
            k = int(np.searchsorted(axis[order], value, side="right"))
            k = min(k, len(axis) - 1) if value <= axis[order][-1] + 1e-9 else k
            if not 0 < k < len(axis):
                return None
            low, high = axis[order[k - 1]], axis[order[k]]
            found.append((order[k - 1], order[k], (value - low) / (high - low)))
        (south, north, up), (west, right, over) = found
        corners = [self.rows[j, i] for j in (south, north) for i in (west, right)]
        shares = [a * b for a in (1.0 - up, up) for b in (1.0 - over, over)]
        return [int(corner) for corner in corners], shares


class Raw:
    """NetCDF files by netCDF4; where several have a variable, the first one's counts."""

    def __init__(self, *paths: Path, names: Mapping[str, str] | None = None) -> None:
        self.sets = [netCDF4.Dataset(str(path)) for path in paths]
        for part in self.sets:
            part.set_auto_maskandscale(False)
        self.names = names or {}

    def __enter__(self) -> "Raw":
        return self

    def __exit__(self, *_: object) -> None:
        for dataset in self.sets:
            dataset.close()

    def find(self, name: str) -> Any:
        name = self.names.get(name, name)
        return next((part.variables[name] for part in self.sets if name in part.variables), None)

    def variable(self, name: str) -> Any:
        found = self.find(name)
        if found is None:
            raise Unreadable(f"no {name}")
        return found

    def values(self, name: str, dims: Sequence[str] | None = None) -> np.ndarray:
        """Unpacked values, NaN for missing; dimensions in the order that is asked for."""
        variable = self.variable(name)
        raw = np.asarray(variable[...])
        if raw.dtype.kind not in "iuf":
            raise Unreadable(f"{name} holds no numbers")
        values, stated = raw.astype(float), {key: variable.getncattr(key) for key in variable.ncattrs()}
        try:
            for key in ("_FillValue", "missing_value"):
                for fill in np.ravel(stated.get(key, [])):
                    values[raw == fill] = np.nan
            values = values * float(stated.get("scale_factor", 1.0)) + float(stated.get("add_offset", 0.0))
        except (TypeError, ValueError) as error:
            raise Unreadable(f"{name}: {error}") from None
        if dims is None:
            return values
        own = list(variable.dimensions)
        if sorted(own) != sorted(dims):
            raise Unreadable(f"{name} has dimensions {own}")
        return values.transpose([own.index(dim) for dim in dims])

    def attribute(self, name: str, key: str) -> str:
        variable = self.variable(name)
        return str(variable.getncattr(key)).strip() if key in variable.ncattrs() else ""

    def factor(self, name: str, known: Mapping[str, float]) -> float:
        units = self.attribute(name, "units").lower()
        if units not in known:
            raise Unreadable(f"{name} in {units!r}")
        return known[units]

    def seconds(self, name: str) -> np.ndarray:
        """S since 1970 of a time coordinate; dates of calendars that are none stand for their fields."""
        values, units = np.atleast_1d(self.values(name)), self.attribute(name, "units")
        calendar = self.attribute(name, "calendar").lower() or "standard"
        calendar = {"gregorian_proleptic": "proleptic_gregorian"}.get(calendar, calendar)
        if "since" not in units:
            raise Unreadable(f"{name} in {units!r}")
        try:
            dates = np.atleast_1d(cftime.num2date(values, units, calendar, only_use_cftime_datetimes=True))
            if calendar == "julian":
                days = [date.toordinal(fractional=True) for date in dates]
                return (np.asarray(days) - 2440587.5) * 86400.0
            fields = [[*date.timetuple()[:6], date.microsecond] for date in dates]
            epoch = datetime(1970, 1, 1, tzinfo=UTC)
            return np.asarray([(datetime(*f, tzinfo=UTC) - epoch).total_seconds() for f in fields])
        except (ValueError, OverflowError, KeyError, AttributeError) as error:
            raise Unreadable(str(error)) from None


def components(raw: Raw, east: str, north: str) -> tuple[str, str]:
    """Names of the components: by standard name where that is given, else as given."""
    stated = {
        raw.attribute(name, "standard_name").lower(): name
        for name in (east, north)
        if raw.attribute(name, "standard_name")
    }
    pairs = [("eastward_sea_water_velocity", "northward_sea_water_velocity"),
             ("sea_water_x_velocity", "sea_water_y_velocity"),
             ("x_sea_water_velocity", "y_sea_water_velocity")]  # fmt: skip
    for first, second in pairs:
        if first in stated and second in stated:
            return stated[first], stated[second]
    if any("velocity" not in name or "sea_water" not in name for name in stated):
        raise Unreadable(f"standard names {sorted(stated)}")
    return east, north


def fixed_depths(raw: Raw, name: str) -> np.ndarray:
    """[K] m of a coordinate of depths, positive down by its signs; its attribute must not contradict."""
    depths = raw.values(name) * raw.factor(name, LENGTHS)
    positive = raw.attribute(name, "positive").lower()
    if positive not in ("", "up", "down"):
        raise Unreadable(f"positive is {positive}")
    signs = set(np.sign(depths[depths != 0.0]))
    if len(signs) > 1 or (signs and positive and (signs == {-1.0}) != (positive == "up")):
        raise Unreadable(f"{name} contradicts itself")
    return np.abs(depths)


def ordered(table: Table) -> Table:
    """The table with rising times, each once."""
    if (np.diff(table.times) < 0).any():
        raise Unreadable("times fall")
    _, first = np.unique(table.times, return_index=True)

    def cut(values: np.ndarray | None) -> Any:
        return values[first] if values is not None and len(values) == len(table.times) > 1 else values

    return replace(
        table, times=table.times[first], east=cut(table.east), north=cut(table.north),
        depth=cut(table.depth), floor=cut(table.floor),
    )  # fmt: skip


def turned(east: np.ndarray, north: np.ndarray, angle: Any) -> tuple[np.ndarray, np.ndarray]:
    """Components along axes turned from east by an angle, rad counter-clockwise, as east and north."""
    both = (east + 1j * north) * np.exp(1j * angle)
    return both.real, both.imag


def halves(count_y: int, count_x: int) -> np.ndarray:
    """[N, 3] the two triangles of each cell of a grid."""
    j, i = np.meshgrid(np.arange(count_y - 1), np.arange(count_x - 1), indexing="ij")
    first = (j * count_x + i).ravel()
    corners = np.stack([first, first + 1, first + count_x + 1, first + count_x], axis=1)
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])


def grid(
    paths: Sequence[Path], names: Sequence[str], *, depth: str | None = "depth", floor: str | None = None,
    angle: Callable[..., np.ndarray] | None = None, renamed: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """A grid with both components at its points; names: east, north, longitude, latitude, time."""
    with Raw(*paths, names=renamed) as raw:
        u, v = components(raw, *names[:2])
        time, dims = raw.variable(names[4]), raw.variable(u).dimensions
        longitude, latitude = raw.values(names[2]), raw.values(names[3])
        places = (raw.variable(names[3]).dimensions, raw.variable(names[2]).dimensions)
        regular = longitude.ndim == 1
        along = (*places[0], *places[1]) if regular else places[0]
        levels = np.zeros(1) if depth is None else fixed_depths(raw, depth)
        wanted = [*time.dimensions, *(() if depth is None else raw.variable(depth).dimensions), *along]
        extra = [dim for dim in dims if dim not in wanted]
        if extra:
            raise Unreadable(f"{u} has dimensions {dims}")
        shape = (len(np.atleast_1d(raw.values(names[4]))), len(levels), -1)
        parts = [(raw.values(name, wanted) * raw.factor(name, SPEEDS)).reshape(shape) for name in (u, v)]
        if not regular and places[1] != places[0]:
            longitude = raw.values(names[2], places[0])
        if regular:
            latitude, longitude = np.meshgrid(latitude, longitude, indexing="ij")
        flat = longitude.ravel(), latitude.ravel()
        if np.nanmax(np.abs(flat[1])) > 90.0 + 1e-6 or not np.isfinite(flat[0]).any():
            raise Unreadable("no degrees")
        if angle is not None:
            parts = list(turned(*parts, angle(raw, longitude).ravel()))
        land = ~np.isfinite(parts[0] + parts[1])
        parts = [np.where(land, np.nan, part) for part in parts]
        bed = None
        if floor is not None and raw.find(floor) is not None:
            bed = raw.values(floor, along).reshape(1, -1) * raw.factor(floor, LENGTHS)
            zero = (parts[0] == 0.0) & (parts[1] == 0.0) & (levels[:, None] > bed)
            parts = [np.where(zero, np.nan, part) for part in parts]
        count = longitude.shape
        index = np.arange(longitude.size).reshape(count)
        return ordered(Table(
            *flat, levels[None, :, None], *parts, raw.seconds(names[4]), bed,
            index if regular else None, None if regular else halves(*count),
        ))  # fmt: skip


def roms(
    paths: Sequence[Path], *, epoch: float | None = None, aligned: bool = False,
    renamed: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """Native ROMS: the mean of a cell's open faces, turned by `angle`; s-levels by Vtransform.

    Times count from `epoch`, s since 1970, where that is given; an `aligned` grid has no angle.
    """
    with Raw(*paths, names=renamed) as raw:
        times = raw.seconds("ocean_time") if epoch is None else epoch + raw.values("ocean_time")
        rho = "eta_rho", "xi_rho"
        longitude, latitude = (raw.values(name, rho) for name in ("lon_rho", "lat_rho"))
        ny, nx = longitude.shape
        mask = np.ones((ny, nx), bool)
        if raw.find("mask_rho") is not None:
            mask = np.nan_to_num(raw.values("mask_rho", rho)) > 0.5
            mask |= not mask.any()  # a mask of land alone was never written
        parts, clock = [], list(raw.variable("ocean_time").dimensions)
        level = raw.variable("s_rho").dimensions[0]
        for name, axis in (("u", 1), ("v", 0)):
            across = [dim for dim in raw.variable(name).dimensions if dim not in (*clock, level)]
            values = raw.values(name, [*clock, level, *across]) * raw.factor(name, SPEEDS)
            shape = (ny, nx - 1) if axis == 1 else (ny - 1, nx)
            values = values[..., : nx - 1] if axis == 1 else values[..., : ny - 1, :]
            if values.shape[2:] != shape:
                raise Unreadable(f"{name} does not fit the grid")
            wet = mask[:, 1:] & mask[:, :-1] if axis == 1 else mask[1:] & mask[:-1]
            faces = np.where(wet, values, np.nan)
            sides = np.full((2, *values.shape[:2], ny, nx), np.nan)
            sides[0][(..., slice(1, None)) if axis == 1 else (..., slice(1, None), slice(None))] = faces
            sides[1][(..., slice(-1)) if axis == 1 else (..., slice(-1), slice(None))] = faces
            number = np.isfinite(sides).sum(axis=0)
            total = np.nansum(sides, axis=0)
            parts.append(np.where((number > 0) & mask, total / np.maximum(number, 1), np.nan))
        angle, degrees = np.zeros((ny, nx)), False
        if aligned:
            angle = np.full((ny, nx), np.pi * (np.nanmean(np.diff(longitude, axis=1)) < 0.0))
        else:
            angle, units = raw.values("angle", rho), raw.attribute("angle", "units").lower()
            degrees = units.startswith("deg") or (not units and np.nanmax(np.abs(angle)) > 2.0 * np.pi)
        east, north = turned(*parts, np.deg2rad(angle) if degrees else angle)
        floor = raw.values("h", rho) * raw.factor("h", LENGTHS)
        rise = np.zeros((1, ny, nx))
        if raw.find("zeta") is not None:
            rise = raw.values("zeta", [*clock, *rho])
            rise = np.nan_to_num(rise * raw.factor("zeta", LENGTHS))
        s, curve = (raw.values(name)[:, None, None] for name in ("s_rho", "Cs_r"))
        critical = float(raw.values("hc"))
        transform = 1
        if raw.find("Vtransform") is not None:
            transform = int(raw.values("Vtransform"))
        elif raw.attribute("s_rho", "standard_name").endswith(("g1", "g2")):
            transform = int(raw.attribute("s_rho", "standard_name")[-1])
        elif np.nanmin(floor) < critical:
            transform = 2  # ROMS does not start with the first one there
        if transform == 2:
            share = (critical * s + floor * curve) / (critical + floor)
            depth = -share * (floor + rise[:, None])
        else:
            still = critical * s + (floor - critical) * curve
            depth = -still - rise[:, None] * still / floor
        shape = (east.shape[0], east.shape[1], ny * nx)
        return ordered(Table(
            longitude.ravel(), latitude.ravel(), depth.reshape(len(depth), shape[1], -1),
            east.reshape(shape), north.reshape(shape), times,
            np.where(mask, floor + rise, np.nan).reshape(len(rise), -1), None, halves(ny, nx),
        ))  # fmt: skip


def joined(tables: Sequence[Table]) -> Table:
    """Tables of one grid at other times, one after the other."""

    def together(name: str) -> Any:
        parts = [getattr(table, name) for table in tables]
        if parts[0] is None:
            return None
        full = [np.broadcast_to(p, (len(t.times), *p.shape[1:])) for p, t in zip(parts, tables, strict=True)]
        return np.concatenate(full)

    return replace(
        tables[0], times=np.concatenate([table.times for table in tables]),
        **{name: together(name) for name in ("east", "north", "depth", "floor")},
    )  # fmt: skip


def mesh(
    paths: Sequence[Path], names: Sequence[str], *, nodes: tuple[str, str], connectivity: str,
    in_cells: bool = False, heights: str | None = None, dry: str | None = None, crs: Any = None,
    renamed: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """A mesh; names: east, north, longitude, latitude, time. Levels by heights, or one at the surface."""
    with Raw(*paths, names=renamed) as raw:
        u, v = components(raw, *names[:2])
        time = raw.variable(names[4])
        known = LENGTHS if crs is not None else DEGREES
        x, y, corner_x, corner_y = (raw.values(n) * raw.factor(n, known) for n in (*names[2:4], *nodes))
        angle = np.zeros(len(x))
        if crs is not None:
            there, system = Transformer.from_crs(crs, 4326, always_xy=True), Proj(crs)
            factors = system.get_factors(*system(x, y, inverse=True))
            angle = -np.deg2rad(factors.meridian_convergence)
            (x, y), (corner_x, corner_y) = there.transform(x, y), there.transform(corner_x, corner_y)
        if np.abs(y).max() > 90.0:
            raise Unreadable("no degrees")
        place = raw.variable(names[2]).dimensions[0]
        level = [d for d in raw.variable(u).dimensions if d not in (*time.dimensions, place)]
        wanted = [*time.dimensions, *level, place]
        shape = (len(np.atleast_1d(time[...])), -1, len(x))
        parts = [(raw.values(name, wanted) * raw.factor(name, SPEEDS)).reshape(shape) for name in (u, v)]
        land = ~np.isfinite(parts[0] + parts[1])
        if dry is not None and raw.find(dry) is not None:
            land |= (raw.values(dry, [*time.dimensions, place]) > 0.5)[:, None]
        parts = [np.where(land, np.nan, part) for part in turned(*parts, angle)]
        depth, floor = np.zeros((1, 1, 1)), None
        if heights is not None:
            height = raw.values(heights, wanted).reshape(shape) * raw.factor(heights, LENGTHS)
            depth = np.nanmax(height, axis=1, keepdims=True, initial=-np.inf) - height
        table = raw.values(connectivity)
        table = table.T if table.shape[0] < table.shape[1] else table
        start = raw.attribute(connectivity, "start_index")
        counted = np.nanmax(table) == len(corner_x) or (
            connectivity in ("nv", "ele") and np.nanmin(table) > 0
        )
        first = float(start) if start else float(counted)
        corners = [np.asarray(row[np.isfinite(row) & (row >= first)] - first, int) for row in table]
        if max(row.max() for row in corners) >= len(corner_x):
            raise Unreadable("connectivity does not fit")
        rings = [np.stack([corner_x[row], corner_y[row]], axis=1) for row in corners]
        cells = None
        if in_cells:
            cells = np.asarray([shapely.Polygon(ring) for ring in rings], object)
            local = Proj(proj="aeqd", lon_0=float(np.mean([x.min(), x.max()])),
                         lat_0=float(np.mean([y.min(), y.max()])), datum="WGS84")  # fmt: skip
            triangles = Delaunay(np.stack(local(x, y)[::-1], axis=1)).simplices
        else:
            triangles = np.asarray([[r[0], r[k], r[k + 1]] for r in corners for k in range(1, len(r) - 1)])
        return ordered(Table(
            np.asarray(x), np.asarray(y), depth, *parts, raw.seconds(names[4]), floor, None, triangles, cells,
            1000.0,
        ))  # fmt: skip


def polar(raw: Raw, longitude: np.ndarray) -> np.ndarray:
    """The angle of a polar stereographic x axis: as far as the meridian lies from the straight one."""
    straight = float(raw.attribute("polar_stereographic", "straight_vertical_longitude_from_pole"))
    return np.deg2rad(straight - longitude)
