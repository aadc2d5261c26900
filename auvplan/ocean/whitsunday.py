"""The shipped example: a chart-like picture of the Whitsunday Islands, drawn from real coast lines.

The outlines are OpenStreetMap's (see `auvplan/data/NOTICE.md`). Colours, relief and noise are synthetic, and
so is the uncertain area: a fringe along the coast that stands in for the shoals, which the data lacks.
"""

import json
from functools import cache
from importlib.resources import files

import jax
import numpy as np
import scipy
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from auvplan.ocean.chart import Chart
from auvplan.runtime.cache import kept
from auvplan.site import Site

#: Longitude and latitude of the middle of the box, degrees.
CENTRE = (148.96, -20.34)
#: Edge of the square box, m; local coordinates run from 0 at its south-western corner.
EXTENT = 10_000.0
#: Pixels along each edge of the shipped picture.
PIXELS = 1000
#: Width of the uncertain fringe along the coast, m.
FRINGE = 80.0

_LAND, _SHOAL, _WATER = (214, 196, 146), (150, 214, 204), (70, 130, 200)


#: Where the picture lies.
SITE = Site(*CENTRE, origin=(EXTENT / 2, EXTENT / 2))


def classes(size: int = PIXELS) -> NDArray[np.uint8]:
    """Return the true classes of the picture, [size, size], row 0 in the north.

    0 coast, 1 uncertain, 2 water.
    """
    scale = size / EXTENT
    picture = Image.new("L", (size, size), 0)
    draw = ImageDraw.Draw(picture)
    for feature in json.loads(_coast())["features"]:
        for k, ring in enumerate(feature["geometry"]["coordinates"]):
            north, east = SITE.to_local(*np.asarray(ring, float).T)
            outline = [(float(e * scale), float(size - n * scale)) for n, e in zip(north, east, strict=True)]
            draw.polygon(outline, fill=1 if k == 0 else 0)
    land = np.asarray(picture) > 0
    shoal = np.asarray(scipy.ndimage.distance_transform_edt(~land)) * (EXTENT / size) <= FRINGE
    return np.where(land, 0, np.where(shoal, 1, 2)).astype(np.uint8)


def render(size: int = PIXELS, seed: int = 0) -> NDArray[np.uint8]:
    """Return the chart-like picture, [size, size, 3] RGB, row 0 in the north; the same for the same seed."""
    rng = np.random.default_rng(seed)
    kinds = classes(size)
    colours = np.asarray([_LAND, _SHOAL, _WATER], float)[kinds]
    relief = scipy.ndimage.gaussian_filter(rng.normal(size=(size, size)), 12.0)
    relief *= 10.0 / np.abs(relief).max()
    noise = rng.normal(scale=3.0, size=(size, size, 3))
    return np.clip(colours + relief[..., None] + noise, 0, 255).astype(np.uint8)


@cache
def whitsunday_chart() -> Chart:
    """Return the shipped chart: the picture, clustered as any other (section 2).

    1000 x 1000 pixels of 10 m.
    """

    def clustered() -> Chart:
        return jax.device_get(Chart.from_rgb(render(), pixel_size=EXTENT / PIXELS))

    return jax.device_put(kept("auvplan.ocean.whitsunday", clustered, _coast()))


def _coast() -> str:
    """Return the coast lines, GeoJSON."""
    return (files("auvplan") / "data" / "whitsunday_coast.geojson").read_text(encoding="utf-8")
