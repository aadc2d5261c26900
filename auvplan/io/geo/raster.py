"""Georeferenced rasters of files, by rasterio, in the form of `auvplan.io.geo.nodes`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import ParseError

import numpy as np
import xarray as xr
from defusedxml.ElementTree import fromstring
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import CRSError

from auvplan.io.currents.projection import as_crs, same_crs
from auvplan.io.geo.error import GeoError, reading
from auvplan.io.geo.nodes import agreed_crs
from auvplan.ocean.picture import opened, read_pixels
from auvplan.runtime.files import read_text

if TYPE_CHECKING:
    from rasterio import Affine
    from rasterio.io import DatasetReader


def read_raster(path: str | Path, crs: Any = None, *, numbers: bool = False) -> xr.DataArray:
    """Read a picture or grid that is georeferenced, by its own tags or by files beside it.

    GeoTIFF, PNG, JPEG, GIF, BMP, WebP and JPEG 2000, ESRI and Surfer grids, BAG, XYZ, Erdas Imagine and
    rasters in GeoPackages. Beside them world files (.pgw, .tfw, .wld), .prj and GDAL's .aux.xml and .msk are
    read.

    Args:
        crs: coordinate reference system, as pyproj takes it (32755, "EPSG:4326"), where the file has none.
        numbers: whether a band is wanted as stored, not as greys or as the colours of its table.

    Returns:
        [y, x] of one band, or [band, y, x] uint8 red, green and blue, with coordinates x and y of the pixels'
        centres (none where they are turned), `spatial_ref` with `crs_wkt` and `GeoTransform`, and `mask`,
        False where a pixel shows nothing, if any does. Attributes are those of the band: `_FillValue`,
        `units`, `positive`, `standard_name`, `scale_factor` and `add_offset`, which are not applied.

    Raises:
        GeoError: one line; the file is missing, damaged or too large, is not georeferenced, or is in another
            reference system than `crs`.
    """
    path = Path(path)
    with reading(path):
        given = None if crs is None else as_crs(crs, GeoError)
        with opened(path, GeoError) as file:
            transform, own = _place(path, file)
            if transform is None:
                missing = f"{path.stem}.wld or {path.name}w is missing"
                why = "warp it to a grid first" if file.gcps[0] else missing
                raise GeoError(f"{path}: is not georeferenced, by its own tags or by a world file: {why}")
            system = agreed_crs(path, own, given)
            if system is None:
                raise GeoError(f"{path}: has no coordinate reference system: set crs, such as EPSG:32755")
            values, shown = read_pixels(path, file, GeoError, numbers=numbers)
            name, attributes = _band(file, values.dtype)
        a, b, c, d, e, f = transform[:6]
        rows, columns = values.shape[:2]
        coordinates: dict[str, Any] = {}
        if b == d == 0.0:
            coordinates = {"x": c + a * (np.arange(columns) + 0.5), "y": f + e * (np.arange(rows) + 0.5)}
        if shown is not None:
            coordinates["mask"] = (("y", "x"), shown)
        array = xr.DataArray(values, coordinates, ("y", "x", "band")[: values.ndim], name, attributes)
        mapping = {"crs_wkt": system.to_wkt(), "GeoTransform": f"{c!r} {a!r} {b!r} {f!r} {d!r} {e!r}"}
        placed = array.assign_coords(spatial_ref=xr.Variable((), 0, mapping))
        return placed.transpose("band", "y", "x", missing_dims="ignore")


def _band(file: "DatasetReader", dtype: np.dtype) -> tuple[str | None, dict[str, Any]]:
    """Name and attributes of the first band."""
    tags = {name.lower(): text for name, text in file.tags(1).items()}
    attributes: dict[str, Any] = {k: tags[k] for k in ("standard_name", "positive") if k in tags}
    tagged = file.crs if file.driver == "GTiff" else None
    if tagged is not None and len(parts := CRS.from_user_input(tagged).sub_crs_list) > 1:
        axis = parts[1].axis_info[0]
        attributes["units"] = axis.unit_name
        # Depths are often kept in files of a system of heights, never the other way round.
        if axis.direction == "down":
            attributes["positive"] = "down"
    if unit := file.units[0] or tags.get("units"):
        attributes["units"] = unit
    if (file.scales[0], file.offsets[0]) != (1.0, 0.0):
        attributes |= {"scale_factor": file.scales[0], "add_offset": file.offsets[0]}
    if file.nodata is not None:
        with np.errstate(over="ignore"):  # in single precision -3.4e38 is not quite what the tag says
            attributes["_FillValue"] = dtype.type(file.nodata) if dtype.kind == "f" else file.nodata
    return tags.get("netcdf_varname") or file.descriptions[0], attributes


@dataclass(frozen=True)
class PixelSize:
    """How large a picture's pixels are on Earth.

    Attributes:
        metres: edge of a pixel in the middle of the picture.
        crs: whether the file has a reference system.
        notes: what was assumed, a line each.
    """

    metres: float
    crs: bool
    notes: tuple[str, ...] = ()


def pixel_size(path: str | Path) -> PixelSize | None:
    """Return the size of a picture's pixels where it is georeferenced, as by `read_raster`, else None.

    It is measured along the ellipsoid, so that degrees, and the metres of a map that is stretched towards the
    poles, come out as metres on Earth.

    Raises:
        GeoError: one line; the file cannot be read, or what should give its place makes no sense.
    """
    path = Path(path)
    with reading(path), opened(path, GeoError) as file:
        transform, crs = _place(path, file)
        return None if transform is None else _measured(path, transform, crs, file.shape)


def _measured(path: Path, transform: "Affine", crs: CRS | None, shape: tuple[int, int]) -> PixelSize:
    rows, columns = shape
    place = np.reshape(transform[:6], (2, 3))
    notes, system = [], crs
    if crs is None:
        corners = place @ [[0, columns, 0, columns], [0, 0, rows, rows], [1, 1, 1, 1]]
        x, y = np.abs(corners).max(axis=1)
        degrees = x <= 360.0 and y <= 90.0 and max(abs(transform.a), abs(transform.e)) < 1.0
        system, unit = (CRS.from_epsg(4326), "degrees") if degrees else (None, "metres")
        notes.append(f"{path} has no reference system: its coordinates are taken for {unit}")
    i, j = columns / 2, rows / 2
    x, y = place @ [[i + 0.5, i - 0.5, i, i], [j, j, j + 0.5, j - 0.5], [1.0, 1.0, 1.0, 1.0]]
    if system is None:
        across, down = np.hypot(x[::2] - x[1::2], y[::2] - y[1::2])
    else:
        longitude, latitude = Transformer.from_crs(system, "EPSG:4326", always_xy=True).transform(x, y)
        ends = longitude[::2], latitude[::2], longitude[1::2], latitude[1::2]
        across, down = Geod(ellps="WGS84").inv(*ends)[2]
    size = float(np.sqrt(across * down))
    if not (np.isfinite(size) and size > 0.0):
        raise GeoError(f"{path}: its pixels have no size: {list(transform[:6])}")
    if max(across, down) > 1.01 * min(across, down):
        notes.append(
            f"{path} has pixels of {across:.4g} m by {down:.4g} m, taken as squares of {size:.4g} m: "
            "source 'raster' takes them as they are"
        )
    return PixelSize(size, crs is not None, tuple(notes))


def _place(path: Path, file: "DatasetReader") -> tuple["Affine | None", CRS | None]:
    """Return the transformation from pixels and the horizontal reference system, each None if unknown."""
    transform = None if file.transform.is_identity else file.transform
    crs = _horizontal(file.crs)
    sidecar = path.with_name(f"{path.name}.aux.xml")
    if sidecar.exists():
        try:
            fromstring(read_text(sidecar, GeoError), forbid_dtd=True)
        except (ParseError, ValueError):  # GDAL would go on without it
            raise GeoError(f"{sidecar}: is damaged") from None
        if file.driver == "GTiff":
            with opened(path, GeoError, GEOREF_SOURCES="INTERNAL") as tagged:
                tags, own = tagged.transform, _horizontal(tagged.crs)
            if not tags.is_identity and transform is not None and not np.allclose(tags, transform, 1e-9, 0.0):
                raise GeoError(
                    f"{path}: lies elsewhere by its tags than by {sidecar.name}: remove the wrong one"
                )
            if own is not None and crs is not None and not same_crs(own, crs):
                raise GeoError(f"{path}: is in {own.name}, but by {sidecar.name} in {crs.name}")
    suffix = path.suffix.lower()
    if transform is None:
        world = _beside(path, f"{path.stem}.wld", f"{path.stem}{suffix[:2]}{suffix[-1:]}w", f"{path.name}w")
        if world is not None:
            raise GeoError(
                f"{world}: a world file holds six numbers, of which the pixels' sizes are not zero"
            )
    elif not (np.isfinite(transform[:6]).all() and abs(transform.determinant) > 0.0):
        raise GeoError(f"{path}: its pixels have no size: {list(transform[:6])}")
    if crs is None and (projection := _beside(path, f"{path.stem}.prj")) is not None:
        try:
            crs = _horizontal(read_text(projection, GeoError).strip())
        except CRSError:
            raise GeoError(f"{projection}: holds no coordinate reference system") from None
    return transform, crs


def _horizontal(stated: Any) -> CRS | None:
    """Return the horizontal part of a reference system; None without one, or where it is not on Earth."""
    if stated is None:
        return None
    system = CRS.from_user_input(stated)
    system = system.sub_crs_list[0] if system.is_compound else system
    if not (system.is_geographic or system.is_projected):
        return None
    # By its code PROJ knows the area of use, which decides on changes of datum.
    code = system.to_epsg()
    return system if code is None else CRS.from_epsg(code)


def _beside(path: Path, *names: str) -> Path | None:
    """Return the first of some files in the same folder, whichever case their names are in."""
    there = {
        entry.name.lower(): entry for entry in sorted(path.absolute().parent.iterdir()) if entry.is_file()
    }
    return next((there[name.lower()] for name in names if name.lower() in there), None)
