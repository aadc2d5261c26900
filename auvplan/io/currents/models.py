"""Models whose components lie on the edges of cells, brought to the form of native ROMS."""

from dataclasses import replace

import numpy as np
import xarray as xr

from auvplan.io.currents.files import Array, File
from auvplan.io.currents.names import find_current
from auvplan.ocean.gridded import CurrentError

#: The middles of NEMO's cells.
NEMO = ("glamt", "gphit")


def on_middles(file: File) -> File:
    """Return a file with components on the edges of cells in the form of native ROMS; others as they are."""
    try:
        names = find_current(file)
    except CurrentError:
        return file
    if names.both is not None:
        return file
    east, north = (file.variables[name] for name in (names.east, names.north))
    if "lon_rho" in file.variables and east.dims[-2:] != north.dims[-2:]:
        return _without_spare(file, names.east, names.north)
    if east.dims[-2:] == north.dims[-2:] and all(name in file.variables for name in NEMO):
        return _nemo(file, names.east, names.north)
    if east.ndim > 2 and north.ndim > 2 and not set(east.dims[-2:]) & set(north.dims[-2:]):
        return _between_middles(file, names.east, names.north)
    return file


def _without_spare(file: File, east: str, north: str) -> File:
    """Return a native ROMS file without the last edges east and north, where it has as many as points."""
    rho, variables = file.variables["lon_rho"], dict(file.variables)
    for name, axis in ((east, -1), (north, -2)):
        edges = variables[name]
        if rho.ndim == 2 and edges.shape[-2:] == rho.shape:
            spare = {edges.dims[axis]: slice(0, -1)}
            for other, variable in variables.items():
                if edges.dims[axis] in variable.dims:
                    variables[other] = variable.isel(spare)
    return replace(file, variables=variables)


def _nemo(file: File, east: str, north: str) -> File:
    """Return NEMO's C-grid, whose components lie east and north of the middle with the same index."""
    variables = dict(file.variables)
    dims = variables[east].dims[-2:]
    places = {"lon_rho": "glamt", "lat_rho": "gphit", "mask_rho": "tmask"}
    for own, name in places.items():
        if name in variables:
            flat = variables[name].isel({dim: 0 for dim in variables[name].dims if dim not in dims})
            if flat.dims == dims:
                variables[own] = flat
    mask, level = variables.get("tmask"), variables[east].dims[-3]
    if mask is not None and mask.ndim > 2 and mask.shape[-3] == variables[east].shape[-3]:
        deep = mask.isel(dict.fromkeys(mask.dims[:-3], 0))
        renamed = {deep.dims[0]: level} if deep.dims[0] != level else {}
        variables["tmask"] = xr.Dataset({"mask": deep}).rename_dims(renamed)["mask"].variable
    for name, edge, axis in ((east, "u", 1), (north, "v", 0)):
        own = {dim: f"{dim}_{edge}" for dim in dims}
        edges = variables[name].isel({dims[axis]: slice(0, -1)})
        variables[name] = xr.Dataset({"edges": edges}).rename_dims(own)["edges"].variable
    for name in ("nav_lon", "nav_lat"):
        variables.pop(name, None)
    return replace(file, variables=variables)


def _between_middles(file: File, east: str, north: str) -> File:
    """Return a C-grid whose edges and middles have dimensions of their own, as MOM6 and MITgcm write them."""
    variables = dict(file.variables)
    u, v = variables[east], variables[north]
    rows, columns = u.dims[-2], v.dims[-1]
    found = _middles(file, str(rows), str(columns))
    if found is None:
        return file
    variables["lon_rho"] = xr.Variable((rows, columns), found[0])
    variables["lat_rho"] = xr.Variable((rows, columns), found[1])
    for name, dim, middle in ((east, u.dims[-1], columns), (north, v.dims[-2], rows)):
        size, count = variables[name].sizes[dim], len(found[0]) if middle == rows else found[0].shape[1]
        first = _first_edge(file, str(dim), str(middle), size, count)
        variables[name] = variables[name].isel({dim: slice(first, first + count - 1)})
    return replace(file, variables=variables)


def _middles(file: File, rows: str, columns: str) -> tuple[Array, Array] | None:
    """Return longitude and latitude [ny, nx] of the cells' middles, or None where the file has none."""
    for kind in (
        ("geolon", "geolat"),
        ("XC", "YC"),
        ("lon", "lat"),
        ("longitude", "latitude"),
        (columns, rows),
    ):
        pair = [file.variables.get(name) for name in kind]
        if any(variable is None for variable in pair):
            continue
        dims = [variable.dims for variable in pair if variable is not None]
        values = [file.coordinate(name, missing=True) for name in kind]
        if dims == [(rows, columns), (rows, columns)]:
            return values[0], values[1]
        if dims == [(columns,), (rows,)]:
            east, north = np.meshgrid(*values)
            return east, north
    return None


def _first_edge(file: File, edges: str, middles: str, size: int, count: int) -> int:
    """Return the index of the edge between the first two of `count` middles among `size` edges.

    Raises:
        CurrentError: the axes do not tell it.
    """
    if size == count - 1:
        return 0
    if size == count + 1:
        return 1
    if all(name in file.variables and file.variables[name].ndim == 1 for name in (edges, middles)):
        edge, middle = file.coordinate(edges), file.coordinate(middles)
        share = (edge[0] - middle[0]) / (middle[1] - middle[0])
        if size == count and abs(abs(share) - 0.5) < 0.25:
            return int(share < 0.0)
    raise file.fail(f"{size} edges along {edges} do not fit {count} middles along {middles}")
