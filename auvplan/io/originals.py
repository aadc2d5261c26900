"""The files that a saved run's scenario names, as the checker's own views of them open and place them."""

from collections.abc import Callable, Iterable
from glob import glob
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from pyproj import Transformer

from auvplan.files import ResultError, require_whole
from auvplan.io.walk import Array


def path_of(dataset: xr.Dataset, name: str) -> Path:
    """Return the path of a file, or a pattern, that the scenario of a run names."""
    return Path(str(dataset.attrs["scenario_folder"])) / Path(name).expanduser()


def matching(paths: Iterable[str]) -> list[str]:
    """Return the files that paths and patterns stand for; those that nothing matches as they are."""
    return [name for path in paths for name in (sorted(glob(path)) or [path])]


def opened(path: str, **options: Any) -> xr.Dataset:
    """Open a NetCDF file.

    Args:
        path: of the file.
        options: of `xarray.open_dataset`.

    Raises:
        ResultError: its values lie in other files, or its head goes on beyond its end.
    """
    with open(path, "rb") as file:
        engine = "scipy" if file.read(3) == b"CDF" else "h5netcdf"
    require_whole(path, ResultError)
    return xr.open_dataset(path, engine=engine, **options)


def _frame(dataset: xr.Dataset) -> Transformer:
    """Return the way from m east and north of a run's site to longitude and latitude, degrees."""
    attributes = dataset.attrs
    frame = (
        f"+proj=aeqd +lon_0={float(attributes['site_longitude'])!r} "
        f"+lat_0={float(attributes['site_latitude'])!r} +datum=WGS84 +units=m"
    )
    return Transformer.from_crs(frame, "EPSG:4326", always_xy=True)


def places_of(dataset: xr.Dataset) -> Callable[[Array, Array], tuple[Array, Array]]:
    """Return the way from m north and east of a run to longitude and latitude, degrees."""
    back, origin = _frame(dataset), np.asarray(dataset.attrs["site_origin"], float)

    def places(north: Array, east: Array) -> tuple[Array, Array]:
        longitude, latitude = back.transform(np.asarray(east) - origin[1], np.asarray(north) - origin[0])
        return np.asarray(longitude), np.asarray(latitude)

    return places


def metres_of(dataset: xr.Dataset) -> Callable[[float, float], tuple[float, float]]:
    """Return the conversion of longitude, latitude in degrees to m north, east; only calls need a site."""

    def metres(longitude: float, latitude: float) -> tuple[float, float]:
        east, north = _frame(dataset).transform(longitude, latitude, direction="INVERSE")
        origin = np.asarray(dataset.attrs["site_origin"], float)
        return float(north + origin[0]), float(east + origin[1])

    return metres
