"""Georeferenced rasters: GeoTIFF (OGC GeoTIFF 1.1), pictures with a world file, and what GDAL reads."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray
from pyproj import CRS, Geod, Transformer
from pyproj.exceptions import ProjError

from auvplan.io.geo.error import GeoError, read_text, reading, reason
from auvplan.io.geo.geotiff import Affine, is_tiff, read_geotiff, read_place
from auvplan.io.geo.grid import Nodes
from auvplan.ocean.picture import MAX_PIXELS, blank, colours, opened

_WORLD_FILES = {
    ".bmp": (".bpw", ".bmpw"),
    ".gif": (".gfw", ".gifw"),
    ".png": (".pgw", ".pngw"),
    ".jpg": (".jgw", ".jpgw"),
    ".jpeg": (".jgw", ".jpegw"),
    ".tif": (".tfw", ".tifw"),
    ".tiff": (".tfw", ".tiffw"),
}
#: GDAL's drivers of formats that are read by it alone, by the ends of names; none leads to other files.
_DRIVERS = {
    ".asc": ("AAIGrid", "GSAG"),
    ".bag": ("BAG",),
    ".csv": ("XYZ",),
    ".txt": ("XYZ", "AAIGrid"),
    ".xyz": ("XYZ",),
    ".grd": ("GSBG", "GSAG", "GS7BG"),
    ".img": ("HFA",),
    ".bil": ("EHdr",),
    ".flt": ("EHdr",),
    ".jp2": ("JP2OpenJPEG",),
    ".gpkg": ("GPKG",),
}
# Per cent of confidence with which a spelling without a code is of an EPSG system.
_CONFIDENCE = 25
_TEXT_LIMIT = 100_000
_SIDECAR_LIMIT = 50_000_000  # it may hold tables of colours and histograms


@dataclass(frozen=True, eq=False)
class Raster:
    """Values on a georeferenced raster, row 0 first in the file, which is mostly the northernmost.

    Attributes:
        values: [rows, columns], or [rows, columns, 3] uint8 of a colour picture.
        affine: (a, b, c, d, e, f): a point that lies `column` and `row` pixels from the outer corner of the
            first pixel has x = a column + b row + c and y = d column + e row + f.
        crs: of x and y, x being east or longitude.
        nodata: the value that stands for none, or None.
        attributes: what the file tells of its band (GDAL's names), lower case.
        blank: [rows, columns] which pixels are hidden by a mask, and of a colour picture see-through or no
            data; None where none can be.
    """

    values: NDArray[Any]
    affine: Affine
    crs: CRS
    nodata: float | None = None
    attributes: Any = None
    blank: NDArray[np.bool_] | None = None

    def nodes(self) -> Nodes:
        """Return where the pixels' centres lie."""
        a, b, c, d, e, f = self.affine
        inverse = np.linalg.inv([[a, b], [d, e]])
        transformer = Transformer.from_crs("EPSG:4326", self.crs, always_xy=True)
        rows, columns = self.values.shape[:2]
        degrees = self.crs.is_geographic and np.isclose(
            self.crs.axis_info[0].unit_conversion_factor, np.pi / 180
        )

        def find(longitude: NDArray, latitude: NDArray) -> tuple[NDArray, NDArray]:
            x, y = transformer.transform(longitude, latitude)
            if degrees:
                x = x + 360.0 * np.round((longitude - x) / 360.0)
            column = inverse[0, 0] * (x - c) + inverse[0, 1] * (y - f) - 0.5
            row = inverse[1, 0] * (x - c) + inverse[1, 1] * (y - f) - 0.5
            return row, column

        middle = a * columns / 2 + b * rows / 2 + c if degrees else None
        around = degrees and b == 0.0 and abs(abs(a) * columns - 360.0) < 0.01 * abs(a)
        return Nodes(find, (rows, columns), middle, bool(around))


def read_raster(path: str | Path, crs: Any = None, *, indices: bool = False) -> Raster:
    """Read a picture or grid that knows where on Earth it lies.

    GeoTIFF by its own keys; PNG, JPEG and TIFF by a world file beside it (.pgw, .jgw, .tfw, .wld), whose
    coordinates are those of `crs` or of a .prj file. A world file gives the centre of the first pixel.
    See-through pixels become white, which is noted. ESRI and Surfer grids, BAG, XYZ, Erdas Imagine, JPEG 2000
    and rasters in GeoPackages are read by rasterio.

    Args:
        path: of the file.
        crs: coordinate reference system, as pyproj takes it (32755, "EPSG:4326"), where the file tells none.
        indices: whether a picture with a table of colours is wanted as numbers, not colours.

    Raises:
        GeoError: one line; the file is missing, damaged or too large, is not georeferenced, or tells other
            coordinates than `crs`.
    """
    path = Path(path)
    with reading(path):
        wanted = None if crs is None else as_crs(crs)
        with path.open("rb") as file:
            start = file.read(4)
        if is_tiff(start):
            tiff = read_geotiff(path, indices)
            affine, own, values = tiff.affine, tiff.crs, tiff.values
            nodata, attributes, empty = tiff.nodata, tiff.attributes, tiff.blank
            trouble = tiff.crs_trouble
        elif path.suffix.lower() in _DRIVERS:
            values, empty, affine, own, nodata, attributes = _by_gdal(path, indices)
            trouble = "tells no coordinate reference system"
        else:
            (values, empty), affine, own, nodata, attributes = _picture(path, indices), None, None, None, {}
            trouble = "no coordinate reference system in a .prj file beside it"
        sidecar = _sidecar(path)
        affine, own = _place(path, affine, own, sidecar)
        nodata = sidecar.nodata if nodata is None else nodata
        attributes = sidecar.attributes | attributes
        if own is None and is_tiff(start):
            own = _system_by_gdal(path)
        if own is not None and wanted is not None and not _same(own, wanted):
            raise GeoError(f"{path}: is in {own.name}, not in {wanted.name} as crs says")
        system = own or wanted
        if system is None:
            raise GeoError(f"{path}: {trouble}: set crs, such as EPSG:32755")
        if not (system.is_geographic or system.is_projected):
            raise GeoError(f"{path}: {system.name} is neither geographic nor projected")
        determinant = affine[0] * affine[4] - affine[1] * affine[3]
        if not np.isfinite(affine).all() or not abs(determinant) > 0.0:
            raise GeoError(f"{path}: its pixels have no size: {[float(c) for c in affine]}")
        return Raster(values, affine, system, nodata, attributes, empty)


@dataclass(frozen=True)
class PixelSize:
    """How large a picture's pixels are on Earth.

    Attributes:
        metres: edge of a pixel in the middle of the picture.
        crs: whether the file tells its reference system.
        notes: what was assumed, a line each.
    """

    metres: float
    crs: bool
    notes: tuple[str, ...] = ()


def pixel_size(path: str | Path) -> PixelSize | None:
    """Return the size of a picture's pixels where its GeoTIFF tags or a world file tell it.

    None where none does.

    It is measured along the ellipsoid, so that degrees, and the metres of a map that is stretched towards the
    poles, come out as metres on Earth.

    Raises:
        GeoError: one line; the file cannot be read, or what should tell its place makes no sense.
    """
    path = Path(path)
    with reading(path):
        with path.open("rb") as file:
            tiff = is_tiff(file.read(4))
        affine = crs = None
        if tiff:
            place = read_place(path)
            affine, crs, (rows, columns) = place.affine, place.crs, place.shape
        else:
            with opened(path, GeoError) as picture:
                columns, rows = picture.size
        sidecar = _sidecar(path)
        if affine is None and sidecar.affine is None and _beside(path, _world_names(path)) is None:
            return None
        return _measured(path, *_place(path, affine, crs, sidecar), rows, columns)


def _measured(path: Path, affine: Affine, crs: CRS | None, rows: int, columns: int) -> PixelSize:
    a, b, c, d, e, f = affine
    middle = np.array([columns / 2, rows / 2])
    ends = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]]) + middle
    x, y = a * ends[:, 0] + b * ends[:, 1] + c, d * ends[:, 0] + e * ends[:, 1] + f
    notes = []
    if crs is None:
        corners = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]])
        far = abs(np.array([[a, b], [d, e]]) @ corners.T + [[c], [f]]).max(axis=1)
        degrees = far[0] <= 360.0 and far[1] <= 90.0 and max(abs(a), abs(e)) < 1.0
        crs = CRS.from_epsg(4326) if degrees else None
        unit = "degrees" if degrees else "metres"
        notes.append(f"{path} tells no reference system: its coordinates are taken for {unit}")
        known = False
    else:
        known = True
    if crs is None:
        across, down = np.hypot(x[0] - x[1], y[0] - y[1]), np.hypot(x[2] - x[3], y[2] - y[3])
    else:
        longitude, latitude = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
        _, _, lengths = Geod(ellps="WGS84").inv(
            longitude[::2], latitude[::2], longitude[1::2], latitude[1::2]
        )
        across, down = lengths
    size = float(np.sqrt(across * down))
    if not (np.isfinite(size) and size > 0.0):
        raise GeoError(f"{path}: its pixels have no size: {[float(v) for v in affine]}")
    if max(across, down) > 1.01 * min(across, down):
        notes.append(
            f"{path} has pixels of {across:.4g} m by {down:.4g} m, taken as squares of {size:.4g} m: "
            "source 'raster' takes them as they are"
        )
    return PixelSize(size, known, tuple(notes))


def _same(one: CRS, other: CRS) -> bool:
    """Return whether two reference systems are the same, also where one is ESRI's spelling of it."""
    code = one.to_epsg(_CONFIDENCE)
    return one.equals(other, ignore_axis_order=True) or (
        code is not None and code == other.to_epsg(_CONFIDENCE)
    )


def as_crs(given: Any) -> CRS:
    """Return a coordinate reference system of whatever pyproj understands.

    Raises:
        GeoError: pyproj does not.
    """
    try:
        return CRS.from_user_input(given)
    except Exception as error:
        why = f"{given!r} is no coordinate reference system ({reason(error)})"
        raise GeoError(why, field="crs") from None


def is_raster(path: Path) -> bool:
    """Return whether a file's name is that of a format which GDAL reads for `read_raster`.

    NetCDF files may end in `.grd` too, and an HDF5 file of that name is one.
    """
    with path.open("rb") as file:
        start = file.read(4)
    kind = path.suffix.lower()
    return kind in _DRIVERS and (kind == ".bag" or start != b"\x89HDF")


def _system_by_gdal(path: Path) -> CRS | None:
    """Return the reference system that a GeoTIFF's keys define themselves, where rasterio is installed."""
    try:
        import rasterio
        from rasterio.errors import RasterioError
    except ImportError:
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a place on Earth that it does not find
        try:
            with rasterio.open(path, driver="GTiff") as file:
                system = None if file.crs is None else CRS.from_wkt(file.crs.to_wkt())
                return (
                    system if system is not None and (system.is_geographic or system.is_projected) else None
                )
        except (RasterioError, ProjError):
            return None


def _by_gdal(path: Path, indices: bool) -> tuple[Any, ...]:
    """Return values, blank, affine, reference system, no data and attributes, as `Raster` has them.

    Raises:
        GeoError: rasterio is not installed, or GDAL cannot read the file as what its name says.
    """
    try:
        import rasterio
        from rasterio.errors import RasterioError
    except ImportError:
        raise GeoError(f"{path}: needs a further package: pip install 'auvplan[readers]'") from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a place on Earth that it does not find
        file = why = None
        for driver in _DRIVERS[path.suffix.lower()]:
            try:
                file = rasterio.open(path, driver=driver)
                break
            except RasterioError as error:
                why = error
        if file is None:
            assert why is not None
            raise GeoError(f"{path}: is no {path.suffix[1:].upper()} that can be read ({reason(why)})")
    with file:
        if file.width * file.height > MAX_PIXELS:
            raise GeoError(f"{path}: {file.width} x {file.height} pixels are more than {MAX_PIXELS}")
        system = None if file.crs is None else CRS.from_wkt(file.crs.to_wkt())
        affine = None if file.transform.is_identity else tuple(file.transform)[:6]
        stated = {"scale": str(file.scales[0]), "offset": str(file.offsets[0])}
        stated |= {"units": file.units[0] or "", "description": file.descriptions[0] or ""}
        if file.count == 1 or file.driver == "BAG":  # its second band is the uncertainty
            if file.colorinterp[0].name == "palette" and not indices:
                table = np.array([file.colormap(1).get(k, (0, 0, 0, 0)) for k in range(256)], np.uint8)
                values = table[file.read(1)]
                return values[..., :3], values[..., 3] < 128, affine, system, None, stated
            return file.read(1), file.read_masks(1) == 0, affine, system, file.nodata, stated
        if file.count not in (3, 4) or set(file.dtypes) != {"uint8"}:
            raise GeoError(
                f"{path}: {file.count} bands of {file.dtypes[0]}: neither one of values nor three of colour"
            )
        return (
            np.moveaxis(file.read([1, 2, 3]), 0, -1),
            file.dataset_mask() < 128,
            affine,
            system,
            None,
            stated,
        )


def _picture(path: Path, indices: bool) -> tuple[NDArray, NDArray[np.bool_] | None]:
    """[rows, columns, 3] uint8; [rows, columns] without colour or, if asked for, with a table of it.

    The other is as `Raster.blank`.
    """
    with opened(path, GeoError) as picture:
        single = picture.mode in ("1", "L", "I", "F") or picture.mode.startswith("I;")
        if single or (indices and picture.mode == "P"):
            return np.asarray(picture), None
        if picture.mode == "LA":
            return np.asarray(picture)[..., 0], None
        return colours(picture), blank(picture)


@dataclass(frozen=True)
class _Sidecar:
    """What GDAL's `.aux.xml` beside a raster tells of it and its first band; attributes as in `Raster`."""

    affine: Affine | None = None
    crs: CRS | None = None
    nodata: float | None = None
    attributes: dict[str, str] = field(default_factory=dict)


def _sidecar(path: Path) -> _Sidecar:
    """Return what the `.aux.xml` beside a raster tells; nothing where there is none.

    Raises:
        GeoError: it cannot be read.
    """
    beside = path.with_name(path.name + ".aux.xml")
    if not beside.exists():
        return _Sidecar()
    try:
        root = fromstring(read_text(beside, _SIDECAR_LIMIT), forbid_dtd=True)
        band = root.find("PAMRasterBand[@band='1']")
        stated = {
            name: text
            for name in ("NoDataValue", "UnitType", "Offset", "Scale")
            if band is not None and (text := (band.findtext(name) or "").strip())
        }
        steps = [float(word) for word in (root.findtext("GeoTransform") or "").split(",") if word.strip()]
        nodata = float(stated.pop("NoDataValue")) if "NoDataValue" in stated else None
    except (ParseError, ValueError):  # the latter also of document types and entities
        raise GeoError(f"{beside}: is damaged") from None
    system = (root.findtext("SRS") or "").strip()
    c, a, b, f, d, e = steps if len(steps) == 6 else [0.0] * 6
    return _Sidecar(
        (a, b, c, d, e, f) if len(steps) == 6 else None,
        as_crs(system) if system else None,
        nodata,
        {name.lower(): text for name, text in stated.items()},
    )


def _place(
    path: Path, affine: Affine | None, crs: CRS | None, sidecar: _Sidecar
) -> tuple[Affine, CRS | None]:
    """Return where a raster lies by its own tags, which come first, its world file, .prj and sidecar.

    Raises:
        GeoError: nothing tells it, or the sidecar contradicts the tags.
    """
    if (
        affine is not None
        and sidecar.affine is not None
        and not np.allclose(affine, sidecar.affine, 1e-9, 0.0)
    ):
        raise GeoError(
            f"{path}: lies elsewhere by its tags than by {path.name}.aux.xml: remove the wrong one"
        )
    if affine is None:
        crs = crs or _projection_file(path)
        affine = sidecar.affine or _world_file(path)
    if crs is not None and sidecar.crs is not None and not _same(crs, sidecar.crs):
        raise GeoError(f"{path}: is in {crs.name}, but by {path.name}.aux.xml in {sidecar.crs.name}")
    return affine, crs or sidecar.crs


def _world_names(path: Path) -> list[str]:
    """Return names that a picture's world file may have."""
    names = [path.stem + suffix for suffix in (*_WORLD_FILES.get(path.suffix.lower(), ()), ".wld")]
    return [*names, path.name + "w"]


def _world_file(path: Path) -> Affine:
    names = _world_names(path)
    found = _beside(path, names)
    if found is None:
        listed = ", ".join(dict.fromkeys(names))
        raise GeoError(
            f"{path}: is not georeferenced: no GeoTIFF keys, and no world file ({listed}) beside it"
        )
    words = read_text(found, _TEXT_LIMIT).split()
    try:
        a, d, b, e, x, y = (float(word) for word in words)
    except ValueError:
        raise GeoError(f"{found}: a world file holds six numbers, got {' '.join(words)[:80]!r}") from None
    # x and y are the centre of the first pixel, half a pixel from its corner.
    return a, b, x - (a + b) / 2, d, e, y - (d + e) / 2


def _projection_file(path: Path) -> CRS | None:
    found = _beside(path, [path.stem + ".prj"])
    if found is None:
        return None
    try:
        return CRS.from_user_input(read_text(found, _TEXT_LIMIT).strip())
    except GeoError:
        raise
    except Exception:
        raise GeoError(f"{found}: holds no coordinate reference system") from None


def _beside(path: Path, names: list[str]) -> Path | None:
    """Return the first of some files in the same folder, whichever case their names are in."""
    wanted = [name.lower() for name in names]
    there = {
        entry.name.lower(): entry for entry in sorted(path.absolute().parent.iterdir()) if entry.is_file()
    }
    return next((there[name] for name in wanted if name in there), None)
