"""Image files as arrays of colours, with limits on their size."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

#: Larger pictures are refused before they are decoded.
MAX_PIXELS = 64_000_000
_GDAL_NODATA = 42113
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
    """[rows, columns] pixels that show less than half of their colour, or are no data by GDAL's tag."""
    empty = np.zeros(picture.size[::-1], bool)
    if picture.has_transparency_data:
        empty |= np.asarray(picture.convert("RGBA"))[..., 3] < 128
    with suppress(ValueError):
        nodata = float(str(getattr(picture, "tag_v2", {}).get(_GDAL_NODATA, "nan")).strip("\0 \n"))
        empty |= (np.asarray(picture).reshape(*empty.shape, -1)[..., :3] == nodata).all(axis=-1)
    return empty


def colours(picture: Image.Image) -> NDArray[np.uint8]:
    """[rows, columns, 3] RGB; see-through pixels become white, a colour that classes as coast."""
    if not picture.has_transparency_data:
        return np.asarray(picture.convert("RGB"))
    layer = picture.convert("RGBA")
    white = Image.new("RGBA", layer.size, "white")
    return np.asarray(Image.alpha_composite(white, layer).convert("RGB"))
