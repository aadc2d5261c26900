"""Small files of places that tests write."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import rasterio
from pyproj import Transformer

from auvplan.site import Site

SITE = Site(148.96, -20.34)


def write_geotiff(
    path: Path,
    values: np.ndarray,
    *,
    corner: tuple[float, float] = (148.9, -20.2),
    scale: tuple[float, float] = (0.001, 0.001),
    epsg: Any = 4326,
    point: bool = False,
    transform: Any = None,
    mask: Any = None,
    band: dict[str, Any] | None = None,
    **options: Any,
) -> Path:
    """A GeoTIFF whose first pixel's outer corner, or centre where pixels are points, lies at `corner`.

    Args:
        path: of the file.
        values: [rows, columns] or [rows, columns, bands].
        corner, scale: x and y; the second scale counts southwards.
        epsg: code of the reference system, or what else GDAL takes; None for none.
        point: whether the values are of points.
        transform: from pixels to coordinates in place of corner and scale.
        mask: [rows, columns] of what is shown.
        band: of the first band: `scales`, `offsets`, `units` and tags.
        options: of GDAL's driver.
    """
    bands = values[None] if values.ndim == 2 else np.moveaxis(values, -1, 0)
    place = rasterio.Affine(scale[0], 0.0, corner[0], 0.0, -scale[1], corner[1])
    if point:
        place = place @ rasterio.Affine.translation(-0.5, -0.5)
    options.setdefault("photometric", "RGB" if values.ndim == 3 else "MINISBLACK")
    size = {"count": len(bands), "height": bands.shape[1], "width": bands.shape[2], "dtype": bands.dtype}
    place = place if transform is None else transform
    with rasterio.open(path, "w", "GTiff", crs=epsg, transform=place, **size, **options) as file:
        file.write(bands)
        if mask is not None:
            file.write_mask(mask)
        if point:
            file.update_tags(AREA_OR_POINT="Point")
        for name, value in (band or {}).items():
            if name in ("scales", "offsets", "units"):
                setattr(file, name, (value,))
            else:
                file.update_tags(1, **{name: value})
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


def written(path: Path, content: Any) -> Path:
    """A file of bytes, of text, or of what JSON has."""
    text = content if isinstance(content, str | bytes) else json.dumps(content)
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def write_geojson(path: Path, *features: dict, **more: Any) -> Path:
    return written(path, {"type": "FeatureCollection", "features": list(features), **more})
