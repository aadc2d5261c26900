"""Any ocean model's current as one CF data set, on the model's own points, levels and times."""

from typing import Any

import numpy as np
import xarray as xr

from auvplan.io.currents.geometry import Curvilinear, Regular
from auvplan.io.currents.ocean import MAX_VALUES, OceanData
from auvplan.io.currents.opening import text
from auvplan.io.currents.series import Array
from auvplan.io.currents.triangles import Triangles
from auvplan.scenario.provenance import ORIGIN

_LONGITUDE = {"standard_name": "longitude", "units": "degrees_east"}
_LATITUDE = {"standard_name": "latitude", "units": "degrees_north"}
_NAMES = {
    "uo": "eastward_sea_water_velocity",
    "vo": "northward_sea_water_velocity",
    "wo": "upward_sea_water_velocity",
}


def to_cf(ocean: OceanData) -> xr.Dataset:
    """Return all of a current as CF-1.11, with a mesh as UGRID-1.0.

    Args:
        ocean: as `open_ocean` returns it.

    Returns:
        `uo`, `vo` and, where the source has it, `wo` [time, level, points] m/s, NaN where there is no water;
        `deptho` [points] m where the bed is given; `zos` [time, points] m, the surface above the datum, where
        it is given. Levels are `depth` [level] m, or `zcor` [time, level, points] m above the datum
        where they follow the bed.

    Raises:
        CurrentError: values cannot be read, or are too many.
    """
    geometry, points = ocean.geometry, ocean.velocity.points
    count, levels = geometry.count, ocean.level_count
    window = geometry.window(np.arange(count)[:, None])
    frames = slice(0, len(ocean.times))
    if len(ocean.times) * levels * count > MAX_VALUES // 4:
        raise ocean.series.fail(
            f"{len(ocean.times)} times, {levels} levels and {count} points are too many to be written at "
            "once: cut what is needed out of them first, such as by ncks"
        )
    block = ocean.velocity.read(frames, window)
    order = window.index[:, 0]
    axes = _axes(geometry)
    shape = tuple(size for _, size in axes)
    names = tuple(name for name, _ in axes)

    def placed(values: Array) -> Array:
        """[..., points] in the order and shape of the geometry."""
        chosen = (
            values[..., order] if values.shape[-1] > 1 or count == 1 else np.repeat(values, count, axis=-1)
        )
        return chosen.reshape(*values.shape[:-1], *shape)

    stated: dict[str, Any] = {}
    for name, values in (("uo", block.east), ("vo", block.north), ("wo", block.up)):
        if values is not None and (name != "wo" or values.shape[1] == levels):
            attributes = {"standard_name": _NAMES[name], "units": "m s-1"} | _located(geometry)
            stated[name] = ("time", "level", *names), placed(values).astype(np.float32), attributes
    rise = points.rise(frames, window)
    if points.rise_name() is not None:
        about = {"standard_name": "sea_surface_height_above_geoid", "units": "m"}
        stated["zos"] = ("time", *names), placed(rise).astype(np.float32), about | _located(geometry)
    floor = points.floor(window)
    if floor is not None and block.floor is not None and ocean.levels is None:
        rise = block.floor - floor
    if floor is not None:
        about = {"standard_name": "sea_floor_depth_below_geoid", "units": "m"}
        stated["deptho"] = names, placed(floor), about | _located(geometry)
    coordinates = _places(geometry) | {
        "time": ("time", ocean.times, {"standard_name": "time", "units": "seconds since 1970-01-01 00:00:00"})
    }
    if ocean.levels is None:
        surface = np.broadcast_to(rise[:, None], (len(ocean.times), levels, rise.shape[-1]))
        height = surface - np.where(np.isfinite(block.depths), block.depths, np.nan)
        stated["zcor"] = ("time", "level", *names), placed(height), {"units": "m", "positive": "up"}
    else:
        about = {"standard_name": "depth", "units": "m", "positive": "down", "axis": "Z"}
        coordinates["depth"] = "level", ocean.levels, about
    notes = "; ".join(ocean.notes)
    attributes = {"Conventions": "CF-1.11 UGRID-1.0", "source": ocean.series.label, "comment": notes}
    stated_by = ocean.series.attributes
    attributes |= {name: text(stated_by, name) for name in stated_by if str(name).startswith(ORIGIN)}
    return xr.Dataset(stated, coordinates, attributes)


def _axes(geometry: Any) -> list[tuple[str, int]]:
    """Dimensions of the points, and their lengths."""
    if isinstance(geometry, Regular):
        return [("latitude", len(geometry.latitude)), ("longitude", len(geometry.longitude))]
    if isinstance(geometry, Curvilinear):
        return [("y", geometry.longitude.shape[0]), ("x", geometry.longitude.shape[1])]
    return [("face" if geometry.in_cells else "node", len(geometry.longitude))]


def _places(geometry: Any) -> dict[str, Any]:
    """Return coordinates of the points and, of a mesh, its cells."""
    if isinstance(geometry, Regular):
        return {
            "latitude": ("latitude", geometry.latitude, _LATITUDE),
            "longitude": ("longitude", geometry.longitude, _LONGITUDE),
        }
    if isinstance(geometry, Curvilinear):
        dims = ("y", "x")
        return {
            "latitude": (dims, geometry.latitude, _LATITUDE),
            "longitude": (dims, geometry.longitude, _LONGITUDE),
        }
    mesh: dict[str, Any] = {}
    own = "face" if geometry.in_cells else "node"
    if geometry.cells is not None:
        mesh["mesh"] = (
            (),
            np.int32(0),
            {
                "cf_role": "mesh_topology",
                "topology_dimension": np.int32(2),
                "node_coordinates": "node_lon node_lat",
                "face_node_connectivity": "face_nodes",
            },
        )
        mesh["node_lon"] = "node", geometry.cells.longitude, _LONGITUDE
        mesh["node_lat"] = "node", geometry.cells.latitude, _LATITUDE
        corners = geometry.cells.corners.astype(np.int32)
        about = {"cf_role": "face_node_connectivity", "start_index": np.int32(0), "_FillValue": np.int32(-1)}
        mesh["face_nodes"] = ("face", "corner"), corners, about
        if not geometry.in_cells:
            return mesh
    mesh[f"{own}_longitude"] = own, geometry.longitude, _LONGITUDE
    mesh[f"{own}_latitude"] = own, geometry.latitude, _LATITUDE
    return mesh


def _located(geometry: Any) -> dict[str, str]:
    if isinstance(geometry, Triangles) and geometry.cells is not None:
        return {"mesh": "mesh", "location": "face" if geometry.in_cells else "node"}
    return {}
