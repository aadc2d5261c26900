"""The black or white frame of a picture: margins of paper, and the corners of a raster that was turned."""

import numpy as np
import scipy
import shapely
from numpy.typing import NDArray

# Levels within which a shade is black or white: JPEG moves them a little.
_TOLERANCE = 4
_LEAST = 0.005  # of the picture; less is no frame
_FILLED = 0.97  # of its convex outline, which what a frame surrounds fills at least
_CORNERS = 8  # that the outline has at most: a quadrilateral, cut by the picture's edges
_EDGE = 1000  # longest edge at which outlines are looked at, pixels


def find_frame(rgb: NDArray[np.uint8], blank: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], str]:
    """Return the frame of uniform black or white around what a picture shows.

    White and black may be tones of the chart as well, of deep water above all. So they are a frame only where
    they reach the picture's edge and what they leave is one piece with straight sides.

    Returns:
        ``(frame, shade)``: [h, w] whether a pixel is of the frame, and the frame's shade in words.
    """
    edge = edge_of(blank.shape)
    for shade, uniform in _shades(rgb):
        frame = joined(uniform & ~blank, edge)
        if frame.mean() >= _LEAST and _straight(~(frame | blank)):
            return frame, shade
    return np.zeros(blank.shape, bool), ""


def edge_of(shape: tuple[int, ...]) -> NDArray[np.bool_]:
    """Return the outermost pixels of a picture [h, w]."""
    edge = np.ones(shape, bool)
    edge[1:-1, 1:-1] = False
    return edge


def shade_of(rgb: NDArray) -> str:
    """Return "black" or "white" where a colour [3] is no other, else an empty string."""
    return next((shade for shade, uniform in _shades(rgb) if uniform), "")


def joined(area: NDArray[np.bool_], seeds: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the connected parts of an area that hold a pixel of the seeds."""
    parts, count = _labelled(area)
    held = np.zeros(count + 1, bool)
    held[parts[seeds]] = True
    held[0] = False
    return held[parts]


def surround(rgb: NDArray[np.uint8]) -> str:
    """Return the shade, black or white, of all four sides of a picture.

    Empty where they have another or several.
    """
    sides = np.concatenate([rgb[0], rgb[-1], rgb[:, 0], rgb[:, -1]])
    return next((shade for shade, uniform in _shades(sides) if uniform.mean() > 0.99), "")


def _straight(content: NDArray[np.bool_]) -> bool:
    """Return whether an area is one piece, but for specks, with few and straight sides."""
    step = max(max(content.shape) // _EDGE, 1)
    parts, count = _labelled(content[::step, ::step])
    if count == 0:
        return False
    content = parts == 1 + np.argmax(np.bincount(parts.ravel())[1:])
    # The outer corners of the first and the last pixel of each row make up the convex outline.
    rows = np.flatnonzero(content.any(axis=1))
    first, last = content[rows].argmax(axis=1), content.shape[1] - content[rows, ::-1].argmax(axis=1)
    corners = [np.column_stack([x, y]) for x in (first, last) for y in (rows, rows + 1)]
    outline = shapely.MultiPoint(np.concatenate(corners).astype(float)).convex_hull
    simple = outline.simplify(0.01 * max(content.shape))
    sides = len(shapely.get_coordinates(simple)) - 1
    return bool(content.sum() >= _FILLED * outline.area and sides <= _CORNERS)


def _shades(rgb: NDArray[np.uint8]) -> tuple[tuple[str, NDArray[np.bool_]], ...]:
    """Return which of some pixels are black, and which are white."""
    black, white = rgb.max(axis=-1) <= _TOLERANCE, rgb.min(axis=-1) >= 255 - _TOLERANCE
    return ("black", np.asarray(black)), ("white", np.asarray(white))


def _labelled(area: NDArray[np.bool_]) -> tuple[NDArray[np.intp], int]:
    """The number of the connected part that each pixel is in, 0 outside the area, and how many there are."""
    parts, count = scipy.ndimage.label(area)  # type: ignore[misc]
    return np.asarray(parts, np.intp), int(count)
