"""GeoTIFF (OGC GeoTIFF 1.1): the tags that say where the pixels lie, and the pixels."""

import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
from defusedxml.ElementTree import fromstring
from numpy.typing import NDArray
from PIL import Image
from pyproj import CRS
from pyproj.exceptions import ProjError

from auvplan.io.geo.error import GeoError, reason
from auvplan.ocean.picture import MAX_PIXELS, hidden, opened_tiff

Affine = tuple[float, float, float, float, float, float]

_MAGIC = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
_SCALE, _TIEPOINT, _TRANSFORMATION, _KEYS = 33550, 33922, 34264, 34735
_GDAL_METADATA, _GDAL_NODATA = 42112, 42113
_MODEL, _RASTER_TYPE, _GEOGRAPHIC, _PROJECTED, _VERTICAL = 1024, 1025, 2048, 3072, 4096
_POINT, _USER_DEFINED = 2, 32767
#: Photometric interpretations, RGB and YCbCr the colours; associated and unassociated alpha.
_MINISWHITE, _PALETTE, _COLOURS = 0, 3, (2, 6)
_ALPHA = {1, 2}
_EXTRA = "pip install 'auvplan[readers]'"


@dataclass(frozen=True, eq=False)
class Tiff:
    """A TIFF file's first picture.

    Attributes:
        values: [rows, columns] or [rows, columns, 3].
        affine: from pixels, counted from the outer corner of the first, to coordinates; None without tags.
        crs: None where the file tells none.
        crs_trouble: why it tells none.
        nodata: the value that stands for none, or None.
        attributes: of the first band, by lower-case name (GDAL metadata).
        blank: [rows, columns] which pixels are hidden by a mask, and of a colour picture see-through or no
            data; None where none can be.
    """

    values: NDArray[Any]
    affine: Affine | None
    crs: CRS | None
    crs_trouble: str
    nodata: float | None
    attributes: dict[str, str] = field(default_factory=dict)
    blank: NDArray[np.bool_] | None = None


@dataclass(frozen=True)
class TiffPlace:
    """Where the tags of a TIFF file say that it lies; attributes as in `Tiff`."""

    affine: Affine | None
    crs: CRS | None
    shape: tuple[int, int]


def is_tiff(start: bytes) -> bool:
    """Return whether a file of these first four bytes is a TIFF, of either size and byte order."""
    return start in _MAGIC


def read_place(path: Path) -> TiffPlace:
    """Return where a TIFF file lies, from its tags alone.

    Raises:
        GeoError: its tags contradict the format. What else tifffile raises on a damaged file is passed on.
    """
    with opened_tiff(path) as file:
        page: Any = file.pages[0]
        tags = {int(tag.code): tag.value for tag in page.tags}
        shape = int(page.imagelength), int(page.imagewidth)
    keys = _geo_keys(path, tags.get(_KEYS))
    return TiffPlace(_affine(path, tags, keys.get(_RASTER_TYPE) == _POINT), _crs(path, keys)[0], shape)


def read_geotiff(path: Path, indices: bool = False) -> Tiff:
    """Read the first picture of a TIFF file, and the mask of a colour picture; overviews are left.

    Args:
        path: of the file.
        indices: whether a picture with a table of colours is wanted as numbers, not colours.

    Raises:
        GeoError: it is too large, cannot be decoded, or has tags that contradict the format. What else
            tifffile raises on a damaged file is passed on.
    """
    with opened_tiff(path) as file:
        page: Any = file.pages[0]
        width, height, bands = int(page.imagewidth), int(page.imagelength), int(page.samplesperpixel)
        if width * height > MAX_PIXELS:
            raise GeoError(f"{path}: {width} x {height} pixels are more than {MAX_PIXELS}")
        if max(int(page.tilewidth) * int(page.tilelength), 0) > MAX_PIXELS:
            raise GeoError(
                f"{path}: tiles of {page.tilewidth} x {page.tilelength} pixels are more than {MAX_PIXELS}"
            )
        if width < 1 or height < 1 or page.imagedepth != 1:
            raise GeoError(f"{path}: {width} x {height} x {page.imagedepth} pixels are no picture")
        if bands not in (1, 3, 4):
            raise GeoError(
                f"{path}: {bands} bands: neither one of values nor three of colour: gdal_translate -b N"
            )
        tags = {int(tag.code): tag.value for tag in page.tags}
        values = _pixels(path, page)
        table = page.colormap if page.photometric == _PALETTE and not indices else None
        see_through = bands == 4 and bool(set(page.extrasamples) & _ALPHA)
        if bands > 1 and page.photometric not in _COLOURS:
            raise GeoError(f"{path}: its bands are no red, green and blue: save it as RGB")
        if page.photometric == _MINISWHITE and not indices and values.dtype.kind in "ub":
            values = ~values if values.dtype == np.bool_ else np.iinfo(values.dtype).max - values
    keys = _geo_keys(path, tags.get(_KEYS))
    crs, trouble = _crs(path, keys)
    nodata = _nodata(tags.get(_GDAL_NODATA))
    coloured = _coloured(path, values, table, see_through)
    blank = hidden(path, values.shape[:2])
    if coloured.ndim == 3:
        empty = (values[..., :3] == (np.nan if nodata is None else nodata)).all(axis=-1)
        blank = empty if blank is None else blank | empty
        if see_through:
            blank |= values[..., 3] <= np.iinfo(values.dtype).max // 2
    return Tiff(
        coloured,
        _affine(path, tags, keys.get(_RASTER_TYPE) == _POINT),
        crs,
        trouble,
        nodata,
        _vertical(keys) | _band_attributes(tags.get(_GDAL_METADATA)),
        blank,
    )


def _pixels(path: Path, page: Any) -> NDArray:
    """[rows, columns, bands] by tifffile, else by Pillow, else by rasterio where that is installed."""
    shape = int(page.imagelength), int(page.imagewidth), int(page.samplesperpixel)
    largest = max(map(int, page.databytecounts), default=0)
    if largest > path.stat().st_size:  # a buffer of that size would be made
        raise GeoError(f"{path}: a part of {largest} bytes is larger than the file")
    try:
        values = np.asarray(page.asarray())
        if page.planarconfig == 2 and shape[2] > 1:  # band after band
            return np.moveaxis(values.reshape(shape[2], *shape[:2]), 0, -1)
        return values.reshape(shape)
    except Exception as error:
        if not isinstance(error, ImportError) and "imagecodecs" not in str(error):
            raise
    try:
        with Image.open(path) as picture:
            if picture.size == (shape[1], shape[0]) and len(picture.getbands()) == shape[2]:
                values = np.asarray(picture)
                # Pillow widens some types; a narrowing one would be no picture of the file's values.
                if np.can_cast(page.dtype, values.dtype, "safe"):
                    return values.astype(page.dtype).reshape(shape)
    except Exception:  # whatever it stumbles over, the last reader may not
        pass
    try:
        import rasterio
    except ImportError:
        name = getattr(page.compression, "name", page.compression)
        raise GeoError(f"{path}: compressed as {name}, which needs {_EXTRA}") from None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a place on Earth that it does not find
        with rasterio.open(path) as source:
            return np.moveaxis(source.read(), 0, -1)


def _coloured(path: Path, values: NDArray, table: NDArray | None, see_through: bool) -> NDArray:
    """[rows, columns] or [rows, columns, 3] uint8: colours of a table looked up, see-through pixels white."""
    if values.shape[2] == 1:
        if table is None:
            return values[..., 0]
        return (np.asarray(table).T >> 8).astype(np.uint8)[values[..., 0]]
    if values.dtype == np.uint16:
        values = (values >> 8).astype(np.uint8)
    if values.dtype != np.uint8:
        raise GeoError(
            f"{path}: three bands must be colours of 8 or 16 bit, got {values.dtype}: "
            "gdal_translate -ot Byte -scale makes them so"
        )
    if not see_through:
        return np.ascontiguousarray(values[..., :3])
    opaque = values[..., 3:].astype(np.float32) / 255.0
    return (values[..., :3] * opaque + 255.0 * (1.0 - opaque) + 0.5).astype(np.uint8)


def _affine(path: Path, tags: dict[int, Any], point: bool) -> Affine | None:
    scale, ties, matrix = (
        None if tags.get(code) is None else np.ravel(tags[code]).astype(float)
        for code in (_SCALE, _TIEPOINT, _TRANSFORMATION)
    )
    if matrix is not None:
        if matrix.size != 16:
            raise GeoError(f"{path}: ModelTransformation has {matrix.size} numbers, not 16")
        a, b, c, d, e, f = (float(matrix[k]) for k in (0, 1, 3, 4, 5, 7))
    elif scale is not None and ties is not None:
        if scale.size < 2 or ties.size < 6:
            raise GeoError(f"{path}: ModelPixelScale or ModelTiepoint is too short")
        column, row, x, y = (float(ties[k]) for k in (0, 1, 3, 4))
        a, b, d, e = float(scale[0]), 0.0, 0.0, -float(scale[1])
        c, f = x - column * a, y - row * e
    elif ties is not None:
        raise GeoError(f"{path}: has tie points without a pixel scale: warp it to a north-up grid first")
    else:
        return None
    # Of a raster of points the coordinates are those of pixel centres.
    return (a, b, c - (a + b) / 2, d, e, f - (d + e) / 2) if point else (a, b, c, d, e, f)


def _geo_keys(path: Path, directory: Any) -> dict[int, int]:
    """Return the keys that hold a short number: those in other tags are not needed."""
    if directory is None:
        return {}
    words = [int(word) for word in np.ravel(directory)]
    if len(words) < 4 or len(words) < 4 + 4 * words[3]:
        raise GeoError(f"{path}: its GeoKeyDirectory is cut off")
    entries = (words[4 + 4 * k : 8 + 4 * k] for k in range(words[3]))
    return {key: value for key, location, _, value in entries if location == 0}


def _crs(path: Path, keys: dict[int, int]) -> tuple[CRS | None, str]:
    """Return the coordinate reference system, or None and the reason."""
    if not keys:
        return None, "no GeoTIFF keys tell its coordinate reference system"
    model = keys.get(_MODEL)
    code = keys.get(_GEOGRAPHIC) if model == 2 else keys.get(_PROJECTED)
    if model not in (1, 2) or code is None or code in (0, _USER_DEFINED):
        return None, "its GeoTIFF keys name no EPSG coordinate reference system"
    try:
        return CRS.from_epsg(code), ""
    except Exception as error:
        raise GeoError(f"{path}: EPSG:{code} is no coordinate reference system ({reason(error)})") from None


def _vertical(keys: dict[int, int]) -> dict[str, str]:
    """Return the unit of a vertical reference system, and that it counts down where it does."""
    try:
        axis = CRS.from_epsg(keys[_VERTICAL]).axis_info[0]
    except (KeyError, ProjError):
        return {}
    # Depths are often kept in files of a system of heights, never the other way round.
    return {"units": axis.unit_name} | ({"positive": "down"} if axis.direction == "down" else {})


def _nodata(text: Any) -> float | None:
    try:
        return None if text is None else float(str(text).strip("\0 \n"))
    except ValueError:
        return None


def _band_attributes(text: Any) -> dict[str, str]:
    """Return what GDAL keeps of the first band, such as units, UNITTYPE, SCALE, OFFSET and NETCDF_VARNAME."""
    try:
        root = fromstring(str(text), forbid_dtd=True)
    except (ParseError, ValueError):  # the latter also of document types and entities
        return {}
    items = (item for item in root.iter("Item") if item.get("sample") == "0")
    return {str(item.get("name")).lower(): (item.text or "").strip() for item in items}
