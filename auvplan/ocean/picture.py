"""Image files as arrays of colours, with limits on their size."""

import logging
import re
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

#: Larger pictures are refused before they are decoded.
MAX_PIXELS = 64_000_000
_GDAL_NODATA = 42113
_MASK = 4  # bit of NewSubfileType
#: What a picture may be: Pillow hands others, such as PostScript, to programs.
_FORMATS = ("PNG", "JPEG", "TIFF", "GIF", "BMP", "WEBP", "PPM", "JPEG2000")


@contextmanager
def opened(path: str | Path, fault: type[ValueError]) -> Iterator[Image.Image]:
    """A picture that Pillow has opened; it decodes the pixels as they are asked for.

    Args:
        path: of the file.
        fault: raised with one line where the file is no picture or one of too many pixels.
    """
    limit: Any = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None  # the size is checked here, from the header, with a message of our own
    try:
        with warnings.catch_warnings():
            # Pillow warns of odd metadata, which says nothing about the pixels; damage to those it raises.
            warnings.simplefilter("ignore")
            with Image.open(path, formats=_FORMATS) as picture:
                width, height = picture.size
                if width * height > MAX_PIXELS:
                    raise fault(f"{path}: {width} x {height} pixels are more than {MAX_PIXELS}")
                yield picture
    except UnidentifiedImageError:
        raise fault(f"{path}: not a picture that can be read") from None
    finally:
        Image.MAX_IMAGE_PIXELS = limit


def blank(picture: Image.Image) -> NDArray[np.bool_]:
    """[rows, columns] pixels that show less than half of their colour, or are no data by tag or mask."""
    path = Path(picture.filename)  # type: ignore[attr-defined] - it was opened by its path
    empty = np.zeros(picture.size[::-1], bool)
    if (masked := hidden(path, empty.shape)) is not None:
        empty |= masked
    if picture.has_transparency_data:
        empty |= np.asarray(picture.convert("RGBA"))[..., 3] < 128
    with suppress(ValueError):
        nodata = float(str(getattr(picture, "tag_v2", {}).get(_GDAL_NODATA, "nan")).strip("\0 \n"))
        empty |= (np.asarray(picture).reshape(*empty.shape, -1)[..., :3] == nodata).all(axis=-1)
    return empty


#: Tags of TIFF 6.0, GeoTIFF 1.1 and GDAL without which pixels, or their places, would be others.
_NEEDED = {
    *(254, 256, 257, 258, 259, 262, 266, 273, 274, 277, 278, 279, 284, 317, 320, 322, 323, 324, 325, 338),
    *(339, 33550, 33922, 34264, 34735, 34736, 34737, 42112, 42113),
}


@contextmanager
def opened_tiff(path: Path) -> Iterator[tifffile.TiffFile]:
    """A TIFF file; what tifffile logs of damage goes nowhere: the reader says what matters, once.

    Raises:
        ValueError: tags that tell what the pixels are, or where, are damaged. tifffile does without them.
    """
    log, said = logging.getLogger("tifffile"), list[str]()

    def heard(record: logging.LogRecord) -> bool:
        said.append(record.getMessage())
        return False

    log.addFilter(heard)
    try:
        with tifffile.TiffFile(path) as file:
            lost = {int(code) for line in said for code in re.findall(r"TiffTag (\d+) ", line)} & _NEEDED
            if lost:
                raise ValueError(f"its tag {min(lost)} cannot be read")
            if any(re.search(r"incorrect Strip\w+ count", line) for line in said):
                raise ValueError("its strips are not as many as it says")
            yield file
    finally:
        log.removeFilter(heard)


def hidden(path: Path, shape: tuple[int, ...]) -> NDArray[np.bool_] | None:
    """[rows, columns] pixels that a mask in a TIFF (TIFF 6.0), or GDAL's file `.msk` beside a picture, hides.

    Args:
        path: of the picture.
        shape: its rows and columns; masks of other sizes are those of overviews.

    Returns:
        None where there is no mask.
    """
    beside = path.with_name(f"{path.name}.msk")
    with path.open("rb") as start:
        tiff = start.read(2) in (b"II", b"MM")
    for name, first in ((path, 1), (beside, 0)):
        if not (tiff if name == path else beside.exists()):
            continue
        with opened_tiff(name) as file:
            pages: list[Any] = list(file.pages)[first:]
            for page in pages:
                mask = first == 0 or int(page.subfiletype) & _MASK
                if mask and (page.imagelength, page.imagewidth) == shape:
                    return page.asarray().reshape(*shape, -1)[..., 0] == 0
    return None


def colours(picture: Image.Image) -> NDArray[np.uint8]:
    """[rows, columns, 3] RGB; see-through pixels become white, a colour that classes as coast."""
    if not picture.has_transparency_data:
        return np.asarray(picture.convert("RGB"))
    layer = picture.convert("RGBA")
    white = Image.new("RGBA", layer.size, "white")
    return np.asarray(Image.alpha_composite(white, layer).convert("RGB"))
