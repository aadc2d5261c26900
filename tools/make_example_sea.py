"""Make `auvplan/data/example/current.nc` and `bathymetry.nc`: a tide and a sea bed off the packaged coast.

python tools/make_example_sea.py
"""

from pathlib import Path

import numpy as np
import shapely
import xarray as xr
from numpy.typing import NDArray

from auvplan.io.geo.grid import to_local
from auvplan.io.geo.polygons import read_polygons
from auvplan.ocean.whitsunday import CENTRE
from auvplan.runtime.files import write_dataset
from auvplan.site import Site

DATA = Path(__file__).parent.parent / "auvplan" / "data"
#: The corners that the two grids cover, degrees east and north.
_WEST, _SOUTH, _EAST, _NORTH = 148.90, -20.40, 149.02, -20.28
_SYNTHETIC = "synthetic: made up by a formula for trying auvplan, not for navigation"
#: First time of the current, and the number of hours that follow.
_BEGIN, _HOURS = "2026-03-01T00:00:00", 8
_DEPTHS = (0.0, 5.0, 10.0, 20.0, 30.0, 45.0)
#: Period of the tide (M2), s, and time of its strongest flood, s.
_PERIOD, _FLOOD = 44_714.0, 7200.0
#: Bearing of the flood, rad; amplitude offshore, m/s; what share of it is left between flood and ebb.
_BEARING, _FASTEST, _RATIO = np.deg2rad(330.0), 0.8, 0.15
#: Distance off the coast, m, over which the tide grows.
_SLOWED = 400.0
#: Depth far off the coast and height far inland, m, and the distances, m, over which they are come to.
_DEEP, _HIGH, _SHELF, _SLOPE = 55.0, 60.0, 500.0, 300.0

Array = NDArray[np.float64]


def main() -> None:
    write_dataset(tide(), DATA / "example" / "current.nc")
    write_dataset(sea_bed(), DATA / "example" / "bathymetry.nc")


def tide() -> xr.Dataset:
    """Return a tidal current on longitude, latitude, depth and time, by CF; NaN on land and in the sea bed.

    Flood and ebb run along one bearing and turn with the clock in between; they are slower near the coast and
    towards the bed.
    """
    longitude, latitude = _axis(_WEST, _EAST, 0.01), _axis(_SOUTH, _NORTH, 0.01)
    offing = _offing(longitude, latitude)
    floor, depth = _floor(offing), np.asarray(_DEPTHS)
    hours = np.arange(_HOURS + 1.0)
    phase = 2.0 * np.pi * (hours * 3600.0 - _FLOOD) / _PERIOD
    along, across = np.cos(phase), _RATIO * np.sin(phase)
    east = along * np.sin(_BEARING) + across * np.cos(_BEARING)
    north = along * np.cos(_BEARING) - across * np.sin(_BEARING)
    share = 1.0 - depth[:, None, None] / np.maximum(floor, 1e-6)
    with np.errstate(invalid="ignore"):
        profile = np.where((offing > 0.0) & (share > 0.0), share ** (1.0 / 7.0), np.nan)
    speed = _FASTEST * np.tanh(np.maximum(offing, 0.0) / _SLOWED) * profile
    dims = ("time", "depth", "latitude", "longitude")
    components = {}
    for name, way, share in (("uo", "eastward", east), ("vo", "northward", north)):
        stated = {"standard_name": f"{way}_sea_water_velocity", "units": "m s-1"}
        components[name] = dims, (share[:, None, None, None] * speed).astype(np.float32), stated
    axes = _axes(longitude, latitude) | {
        "time": ("time", hours, {"standard_name": "time", "units": f"hours since {_BEGIN}Z", "axis": "T"}),
        "depth": ("depth", depth, {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}),
    }
    return xr.Dataset(components, axes, _attributes("Tidal current between the Whitsunday Islands"))


def sea_bed() -> xr.Dataset:
    """Depth of a sea bed that falls off with the distance to the coast, by CF; negative on land."""
    longitude, latitude = _axis(_WEST, _EAST, 0.002), _axis(_SOUTH, _NORTH, 0.002)
    stated = {"standard_name": "sea_floor_depth_below_sea_level", "units": "m", "positive": "down"}
    depth = _floor(_offing(longitude, latitude)).astype(np.float32)
    fields = {"depth": (("latitude", "longitude"), depth, stated)}
    return xr.Dataset(fields, _axes(longitude, latitude), _attributes("Sea bed of the Whitsunday Islands"))


def _floor(offing: Array) -> Array:
    """Depth, m, at a distance off the coast, m."""
    inland = -_HIGH * (1.0 - np.exp(np.minimum(offing, 0.0) / _SLOPE))
    return np.where(offing > 0.0, _DEEP * (1.0 - np.exp(-np.maximum(offing, 0.0) / _SHELF)), inland)


def _offing(longitude: Array, latitude: Array) -> Array:
    """[latitude, longitude] m, distance to the coast, negative on land."""
    site = Site(*CENTRE)
    coast = read_polygons(DATA / "whitsunday_coast.geojson")
    land = shapely.union_all([to_local(part.shape, site) for part in coast])
    north, east = site.to_local(*np.meshgrid(longitude, latitude))
    places = shapely.points(north, east)
    distance = shapely.distance(places, land.boundary)
    return np.where(shapely.contains(land, places), -distance, distance)


def _axis(first: float, last: float, step: float) -> Array:
    return np.round(np.linspace(first, last, round((last - first) / step) + 1), 6)


def _axes(longitude: Array, latitude: Array) -> dict:
    return {
        name: (name, values, {"standard_name": name, "units": units, "axis": axis})
        for name, values, units, axis in (
            ("latitude", latitude, "degrees_north", "Y"),
            ("longitude", longitude, "degrees_east", "X"),
        )
    }


def _attributes(title: str) -> dict[str, str]:
    return {
        "Conventions": "CF-1.11",
        "title": f"{title} ({_SYNTHETIC.split(':')[0]})",
        "source": _SYNTHETIC,
        "comment": "The coast that it follows is derived from OpenStreetMap's, see NOTICE.md.",
    }


if __name__ == "__main__":
    main()
