"""The land of the world at 1:10 million (Natural Earth), good to about a kilometre at best."""

from functools import cache
from importlib.resources import files

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.affinity import translate
from shapely.geometry import Polygon

#: Mean radius of the Earth, m.
_RADIUS = 6_371_000.0


@cache
def _world() -> NDArray:
    """[N] shapely polygons, degrees; some touch or cross themselves."""
    with np.load(str(files("auvplan") / "data" / "world_land.npz")) as data:
        places = np.cumsum(data["steps"], axis=0) * data["scale"] + data["origin"]
        starts = [np.concatenate([[0], np.cumsum(data[name])]) for name in ("rings", "polygons")]
    return shapely.from_ragged_array(shapely.GeometryType.POLYGON, places, tuple(starts))


def land_within(west: float, south: float, east: float, north: float) -> list[Polygon]:
    """Return the land of a box, degrees, cut off at its sides.

    Args:
        west, east: longitudes, which may lie beyond -180 and 180; so do the land's then.
        south, north: latitudes.
    """
    world, found = _world(), []
    lows, lefts, highs, rights = (shapely.bounds(world)[:, k] for k in (1, 0, 3, 2))
    for turn in (-720.0, -360.0, 0.0, 360.0, 720.0):
        reaches = (lefts + turn < east) & (rights + turn > west) & (lows < north) & (highs > south)
        for polygon in world[reaches]:
            cut = shapely.clip_by_rect(polygon, west - turn, south, east - turn, north)
            if not cut.is_empty:
                found.append(translate(shapely.make_valid(cut), turn))
    parts = shapely.get_parts(shapely.union_all(found)) if found else []
    return [part for part in parts if isinstance(part, Polygon) and part.area > 0.0]


def distance_to_coast(longitude: float, latitude: float) -> float:
    """Return how far the nearest point of the world's coast is, m, to a kilometre or so."""
    places = np.radians(shapely.get_coordinates(_world()))
    here = np.radians([longitude, latitude])
    east, north = ((places - here) / 2.0).T
    share = np.sin(north) ** 2 + np.cos(here[1]) * np.cos(places[:, 1]) * np.sin(east) ** 2
    return float(2.0 * _RADIUS * np.arcsin(np.sqrt(share.min())))
