"""Small files of places that tests write."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from pyproj import Transformer

from auvplan.site import Site

SITE = Site(148.96, -20.34)


def write_geotiff(
    path: Path,
    values: np.ndarray,
    *,
    corner: tuple[float, float] = (148.9, -20.2),
    scale: tuple[float, float] = (0.001, 0.001),
    epsg: int | None = 4326,
    point: bool = False,
    matrix: Any = None,
    nodata: str | None = None,
    metadata: str | None = None,
    **options: Any,
) -> Path:
    """A GeoTIFF whose first pixel's outer corner, or centre where pixels are points, lies at `corner`."""
    tags: list[tuple] = []
    if matrix is None:
        tags.append((33550, "d", 3, (*scale, 0.0), True))
        tags.append((33922, "d", 6, (0.0, 0.0, 0.0, *corner, 0.0), True))
    else:
        tags.append((34264, "d", 16, tuple(np.ravel(matrix)), True))
    if epsg is not None:
        geographic = 4000 <= epsg < 5000
        keys = [(1024, 0, 1, 2 if geographic else 1), (1025, 0, 1, 2 if point else 1)]
        keys.append((2048 if geographic else 3072, 0, 1, epsg))
        words = (1, 1, 0, len(keys), *(word for key in keys for word in key))
        tags.append((34735, "H", len(words), words, True))
    if nodata is not None:
        tags.append((42113, "s", 0, nodata, True))
    if metadata is not None:
        tags.append((42112, "s", 0, metadata, True))
    photometric = options.pop("photometric", "rgb" if values.ndim == 3 else "minisblack")
    tifffile.imwrite(path, values, extratags=tags, photometric=photometric, metadata=None, **options)
    return path


def geographic(north: Any, east: Any, site: Site = SITE) -> np.ndarray:
    """[..., 2] longitude and latitude of local metres, by a projection made here."""
    local = f"+proj=aeqd +lon_0={site.longitude} +lat_0={site.latitude} +datum=WGS84 +units=m"
    back = Transformer.from_crs(local, "EPSG:4326", always_xy=True)
    return np.stack(back.transform(np.asarray(east) - site.origin[1], np.asarray(north) - site.origin[0]), -1)


def ring(*corners: tuple[float, float]) -> list[list[float]]:
    """A closed ring in longitude and latitude of local (north, east) corners."""
    places = geographic(*np.array(corners, float).T).tolist()
    return [*places, places[0]]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict:
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def write_geojson(path: Path, *features: dict, **more: Any) -> Path:
    path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features), **more}))
    return path
