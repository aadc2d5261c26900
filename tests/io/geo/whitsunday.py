"""What the picture of Hook Passage shows."""

import numpy as np
import rasterio
from pyproj import Transformer

from auvplan.site import Site
from tests.io.geo.files import geographic


def kinds(chart):
    raster = np.asarray(chart.passability)
    return np.where(raster == 0.0, 0, np.where(raster == 1.0, 2, 1))


def utm_of_centres(chart, site):
    """x and y, UTM zone 55 S, of the centres of a chart's pixels."""
    size, (south, west) = float(chart.pixel_size), np.asarray(chart.origin, float)
    north = south + (np.arange(chart.shape[0]) + 0.5) * size
    east = west + (np.arange(chart.shape[1]) + 0.5) * size
    places = geographic(*np.meshgrid(north, east, indexing="ij"), site)
    return Transformer.from_crs(4326, 32755, always_xy=True).transform(places[..., 0], places[..., 1])


def in_the_middle() -> Site:
    """A site in the middle of the picture of Hook Passage, with an origin of its own."""
    longitude, latitude = Transformer.from_crs(32755, 4326, always_xy=True).transform(702_200.0, 7_769_100.0)
    return Site(longitude, latitude, origin=(5000.0, 4000.0))


HOOK = {"lower": (700.0, 300.0), "upper": (9300.0, 7100.0)}


def truth(shared, chart, site):
    """The true classes of the picture at a chart's pixels, looked up here."""
    with rasterio.open(shared / "data" / "maps" / "whitsunday_hook_passage_class.tif") as file:
        classes = file.read(1)
    x, y = utm_of_centres(chart, site)
    return classes[np.floor((7_774_100.0 - y) / 10).astype(int), np.floor((x - 697_200.0) / 10).astype(int)]
