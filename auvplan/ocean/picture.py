"""Pixels of raster files, by rasterio: numbers or colours, and which of them show nothing."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from auvplan.errors import reason_of

if TYPE_CHECKING:
    from rasterio.io import DatasetReader

#: Larger rasters are refused before they are decoded.
MAX_PIXELS = 64_000_000
#: GDAL's drivers that are used: none of them opens other files or hosts that a file names.
DRIVERS = ("GTiff", "PNG", "JPEG", "GIF", "BMP", "WEBP", "PNM", "JP2OpenJPEG", "AAIGrid", "GSAG", "GSBG",
           "GS7BG", "BAG", "XYZ", "HFA", "EHdr", "GPKG")  # fmt: skip

#: GDAL reads cut-off PNG and JPEG files without an error unless set not to, and leaves out vertical systems.
_CONFIGURATION = {
    "GDAL_PNG_WHOLE_IMAGE_OPTIM": False,
    "GDAL_ERROR_ON_LIBJPEG_WARNING": True,
    "GTIFF_REPORT_COMPD_CS": True,
}


@contextmanager
def opened(path: Path, fault: type[ValueError], **options: Any) -> Iterator["DatasetReader"]:
    """Open a raster file; its pixels are decoded as they are asked for.

    A `fault` is raised where it is no raster, or has too many pixels; options are those of GDAL's driver.
    """
    # Imported here because GDAL takes a while to load, and only files need it.
    import rasterio
    from rasterio.errors import RasterioError
    from rasterio.io import DatasetReader

    path.open("rb").close()  # what the system says of a missing file is clearer than what GDAL says
    with rasterio.Env(**_CONFIGURATION):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # a picture need not be georeferenced
                file = DatasetReader(str(path), driver=list(DRIVERS), **options)
        except RasterioError as error:
            raise fault(f"{path}: not a picture or grid that can be read ({reason_of(error)})") from None
        with file:
            if file.width * file.height > MAX_PIXELS:
                raise fault(f"{path}: {file.width} x {file.height} pixels are more than {MAX_PIXELS}")
            yield file


def read_pixels(
    path: Path, file: "DatasetReader", fault: type[ValueError], *, numbers: bool = False
) -> tuple[NDArray[Any], NDArray[np.bool_] | None]:
    """Read the pixels of a file of one band, as `numbers` or greys, or of colours.

    Returns:
        [rows, columns] of one band, greys from black to white, or [rows, columns, 3] uint8 red, green and
        blue, on white where they are see-through. And [rows, columns] whether each pixel shows something:
        False where it is mostly see-through or masked, and of colours where it is no data; None where all do.
    """
    meanings = [meaning.name for meaning in file.colorinterp]
    bands = [number for number, meaning in enumerate(meanings, 1) if meaning != "alpha"]
    if file.driver == "BAG":
        bands = bands[:1]  # the second one is the uncertainty of the first
    flags = {flag.name for flag in file.mask_flag_enums[0]}
    alpha = _eight_bit(file.read(meanings.index("alpha") + 1)) if "alpha" in meanings else None
    shown = None if alpha is None else alpha >= 128
    coloured = len(bands) > 1 or (meanings[0] == "palette" and not numbers)
    if alpha is None and "all_valid" not in flags and (coloured or "per_dataset" in flags):
        shown = file.dataset_mask() >= 128
    if len(bands) == 1:
        values = file.read(bands[0])
        if numbers:
            return values, shown
        if meanings[0] != "palette":
            if values.dtype == np.uint8:  # levels of less than 8 bit go from 0 to 255; some count from white
                bits = int(file.tags(1, ns="IMAGE_STRUCTURE").get("NBITS", 8))
                values = values * np.uint8(255 // (2**bits - 1)) if bits < 8 else values
                inverted = file.tags(ns="IMAGE_STRUCTURE").get("MINISWHITE") == "YES"
                values = ~values if inverted else values
            return values, shown
        entries = file.colormap(1)
        table = np.array([entries.get(number, (0, 0, 0, 0)) for number in range(max(entries) + 1)], np.uint8)
        if (table[:, :3] == table[:, :1]).all():
            return table[values, 0], shown
        colours, alpha = table[values, :3], table[values, 3]
        shown = alpha >= 128 if shown is None else shown & (alpha >= 128)
    else:
        if len(bands) != 3:
            raise fault(
                f"{path}: {len(bands)} bands: neither one of values nor three of colour: gdal_translate -b N"
            )
        if [meanings[band - 1] for band in bands] != ["red", "green", "blue"]:
            raise fault(f"{path}: its bands are no red, green and blue: save it as RGB")
        if set(file.dtypes) - {"uint8", "uint16"}:
            raise fault(
                f"{path}: three bands must be colours of 8 or 16 bit, got {file.dtypes[0]}: "
                "gdal_translate -ot Byte -scale makes them so"
            )
        colours = np.ascontiguousarray(np.moveaxis(_eight_bit(file.read(bands)), 0, -1))
    if alpha is not None and alpha.min() < 255:
        opaque = alpha[..., None].astype(np.float32) / 255.0
        colours = (colours * opaque + 255.0 * (1.0 - opaque) + 0.5).astype(np.uint8)
    return colours, None if shown is None or shown.all() else shown


def _eight_bit(values: NDArray[Any]) -> NDArray[np.uint8]:
    return (values >> 8).astype(np.uint8) if values.dtype == np.uint16 else values
