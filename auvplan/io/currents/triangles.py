"""Unstructured grids: UGRID, FVCOM, SCHISM and SELFE, with values at nodes or in cells."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from pyproj import CRS
from scipy.spatial import ConvexHull, Delaunay

from auvplan.io.currents.files import File
from auvplan.io.currents.geometry import (
    Array,
    Coordinates,
    Curvilinear,
    Index,
    Regular,
    Weights,
    Window,
    bounds,
    edge_lengths,
    find_triangle,
    metres,
    nearest,
    offset,
    within,
)
from auvplan.io.currents.names import require_field
from auvplan.io.currents.projection import in_degrees

#: Cells that together are this many times their convex hull lie over each other.
_MORE = 1.2
#: Sides of a mesh's cells that are this many times as long as usual are none: meshes grow coarse offshore.
_TORN = 1000.0
#: Connectivity where no mesh topology names it.
_CONNECTIVITY = (
    "nv", "SCHISM_hgrid_face_nodes", "ele", "elem", "element", "tri", "element_index", "elements",
    "cells", "ikle",
)  # fmt: skip
_NODES = (
    ("lon", "lat"), ("longitude", "latitude"), ("SCHISM_hgrid_node_x", "SCHISM_hgrid_node_y"), ("x", "y"),
)  # fmt: skip


@dataclass(frozen=True)
class Cells:
    """The cells of an unstructured grid."""

    dim: str  # of the nodes and of the cells
    cell_dim: str
    longitude: Array  # [nodes] degrees
    latitude: Array
    triangles: Index  # [N, 3] nodes
    cell: Index  # [N], the cell that each triangle is of: a cell with four corners is two triangles
    corners: Index  # [cells, 3 or more] nodes, -1 where a cell has fewer
    crs: CRS | None = None  # the projection of the file's coordinates; None for degrees

    @cached_property
    def whole(self) -> NDArray[np.bool_]:
        """[N], False for triangles between nodes that lie too far apart, as where places are damaged."""
        lengths = edge_lengths(self.longitude, self.latitude, self.triangles)
        return np.asarray((lengths <= _TORN * np.median(lengths)).all(axis=1))


@dataclass(frozen=True)
class Triangles:
    """Points without rows and columns."""

    longitude: Array  # [P] degrees
    latitude: Array
    #: The grid's cells, whose nodes or middles the points are; None where the file has none.
    cells: Cells | None = None
    in_cells: bool = False  # whether the points are the cells' middles
    kind: str = "triangles"

    @property
    def dims(self) -> tuple[str, ...]:
        """The form's dimension of the points."""
        return ("face" if self.in_cells else "node",)

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of points."""
        return self.longitude.shape

    @property
    def coordinates(self) -> Coordinates:
        """The form's variables that define the places and, where they are known, the cells."""
        (dim,), cells = self.dims, self.cells
        found: Coordinates = {}
        if cells is None or self.in_cells:
            found = {
                f"{dim}_latitude": (self.dims, self.latitude),
                f"{dim}_longitude": (self.dims, self.longitude),
            }
        if cells is not None:
            found["face_nodes"] = ("face", "corner"), cells.corners.astype(np.int32)
            found |= {"node_lat": (("node",), cells.latitude), "node_lon": (("node",), cells.longitude)}
        return found

    @property
    def torn(self) -> int:
        """How many triangles of the cells have sides that are too long to be any."""
        return 0 if self.cells is None else int((~self.cells.whole).sum())

    @cached_property
    def triangles(self) -> Index:
        """[N, 3] points: the grid's triangles, or Delaunay's in metres about the middle of all points."""
        if self.cells is not None and not self.in_cells:
            return self.cells.triangles[self.cells.whole]
        return Delaunay(self._about_middle(self.longitude, self.latitude)).simplices.astype(np.int64)

    @cached_property
    def _hull(self) -> Array:
        """[H, 3] half-planes, whose first two columns point outwards, that hold all points and nodes."""
        nodes = self if self.cells is None else self.cells
        return ConvexHull(self._about_middle(nodes.longitude, nodes.latitude)).equations

    @property
    def overlaps(self) -> bool:
        """Whether the cells, of less than half the Earth, are together larger than what they lie in."""
        cells = self.cells
        if cells is None or not cells.whole.any() or bounds(cells.longitude, cells.latitude)[1].max() > 45.0:
            return False
        places = self._about_middle(cells.longitude, cells.latitude)
        corners = cells.triangles[cells.whole]
        (ax, ay), (bx, by) = ((places[corners[:, k]] - places[corners[:, 0]]).T for k in (1, 2))
        hull = ConvexHull(places[np.unique(corners)]).volume
        return bool(np.abs(ax * by - ay * bx).sum() / 2.0 > _MORE * hull)

    def _about_middle(self, longitude: Array, latitude: Array) -> Array:
        return metres(bounds(self.longitude, self.latitude)[0], longitude, latitude)

    def locate(self, longitude: Array, latitude: Array) -> Weights:
        """Linear in triangles, in metres about the places.

        Values in cells are linear between the cells' middles; at the rim, where there is no triangle of
        middles, a cell's own value holds. Where no cell is, there is land: the weights are 0. Beyond the
        convex hull of the grid the places count as not covered too.
        """
        middle, apart = bounds(longitude, latitude)
        near = _near(self, self.triangles, middle, apart)
        triangles = self.triangles[near]
        if not len(near):
            triangles = np.full((1, 3), nearest(self.longitude, self.latitude, middle))
        found = within((self.longitude, self.latitude), triangles, middle, longitude, latitude)
        index, weight, beyond = found.index.copy(), found.weight.copy(), found.beyond.copy()
        dry = found.outside
        if (cells := self.cells) is not None and self.in_cells:
            # The cell [M] that holds each place, -1 where there is none.
            held, near = np.full(len(longitude), -1), _near(cells, cells.triangles, middle, apart)
            near = near[cells.whole[near]]
            if len(near):
                used, local = np.unique(cells.triangles[near], return_inverse=True)
                points = metres(middle, cells.longitude[used], cells.latitude[used])
                places = metres(middle, longitude, latitude)
                triangle = find_triangle(points, local.reshape(-1, 3), places)
                held = np.where(triangle >= 0, cells.cell[near[triangle]], -1)
            rim = (held >= 0) & found.outside
            index[rim], weight[rim] = held[rim, None], (1.0, 0.0, 0.0)
            beyond[held >= 0] = 0.0
            dry = held < 0
        weight[dry] = 0.0
        outward = self._about_middle(longitude, latitude) @ self._hull[:, :2].T + self._hull[:, 2]
        beyond[dry & (outward <= 0.01).all(axis=1)] = 0.0
        return Weights(index, weight, beyond)

    def window(self, index: Index) -> Window:
        """Just the points."""
        used, inner = np.unique(index, return_inverse=True)
        return Window({self.dims[0]: used}, used, inner.reshape(index.shape))

    def places(self, index: Index) -> tuple[Array, Array]:
        """Longitude and latitude of points, degrees."""
        return self.longitude[index], self.latitude[index]


#: The places of a source's points, in degrees.
Geometry = Regular | Curvilinear | Triangles


def cell_means(cells: Cells, values: Array, index: Index) -> Array:
    """Means [..., M] of nodes' values [..., nodes] over the corners of some cells."""
    corners = cells.corners[index]
    there = corners >= 0
    return (values[..., corners] * there).sum(axis=-1) / there.sum(axis=-1)


def find_triangles(
    file: File, name: str, places: tuple[str, str] | None, notes: list[str]
) -> tuple[Triangles, str, CRS | None] | None:
    """Return the geometry of a variable along one dimension; None where the file has no places for it.

    Returns:
        The geometry; the file's dimension of the points; and the projection that its coordinates count along,
        None for degrees.

    Raises:
        CurrentError: the connectivity does not fit the nodes.
    """
    cells = _cells(file)
    if places is None:
        if cells is None or cells.cell_dim not in file.variables[name].dims:
            return None
        own = {name for name, variable in file.variables.items() if variable.dims == (cells.cell_dim,)}
        for mesh in _meshes(file):
            pair = file.text(mesh, "face_coordinates").split()
            if len(pair) == 2 and own.issuperset(pair):
                turned = _is_latitude(file, pair[0]) and "lon" in pair[1].lower()
                longitude, latitude, crs = in_degrees(file, (pair[turned], pair[not turned]))
                return Triangles(longitude, latitude, cells, True), cells.cell_dim, crs
        notes.append("the places of the cells' middles are not given: taken as the means of their corners")
        everything = np.arange(len(cells.corners))
        # As directions, longitudes on both sides of the antimeridian have a middle.
        turned = np.exp(1j * np.deg2rad(cells.longitude))
        longitude = np.rad2deg(np.angle(cell_means(cells, turned, everything)))
        latitude = cell_means(cells, cells.latitude, everything)
        return Triangles(longitude, latitude, cells, True), cells.cell_dim, cells.crs
    dim = str(file.variables[places[0]].dims[0])
    longitude, latitude, crs = in_degrees(file, places)
    if longitude.shape != latitude.shape or len(longitude) < 3:
        raise file.fail(f"{places[0]} and {places[1]} are no three places or more")
    if cells is not None and dim in (cells.dim, cells.cell_dim):
        return Triangles(longitude, latitude, cells, dim != cells.dim), dim, crs
    require_field(file)
    notes.append(
        f"the cells between the points along {dim} are not given: joined to triangles, over land too"
    )
    return Triangles(longitude, latitude), dim, crs


def _cells(file: File) -> Cells | None:
    found = connectivity(file)
    if found is None:
        return None
    name, places = found
    variable = file.variables[name]
    if variable.ndim != 2:
        raise file.fail(f"connectivity {name} has {variable.ndim} dimensions, not 2")
    rows, columns = variable.shape
    by_corner = rows < columns or (rows == columns and name == "nv")
    dims = [str(dim) for dim in variable.dims]
    values = file.read(name, dims=dims[::-1] if by_corner else dims)
    nodes = file.variables[places[0]].size
    finite = values[np.isfinite(values)]
    start = file.text(name, "start_index")
    # UGRID counts from 0 without word of it; models from 1, also where a cut lost the last node.
    counted = bool(len(finite)) and (finite.max() == nodes or (name in _CONNECTIVITY and finite.min() > 0))
    first = float(start) if start else float(counted)
    corners = np.where(np.isfinite(values) & (values >= first), values - first, -1.0).astype(np.int64)
    if corners.shape[1] < 3 or (corners[:, :3] < 0).any() or corners.max() >= nodes:
        raise file.fail(f"connectivity {name} does not fit the {nodes} nodes of {places[0]}")
    fans = [(k, np.flatnonzero(corners[:, k + 1] >= 0)) for k in range(1, corners.shape[1] - 1)]
    triangles = [np.stack([corners[at, 0], corners[at, k], corners[at, k + 1]], axis=1) for k, at in fans]
    node_dim, cell_dim = str(file.variables[places[0]].dims[0]), dims[1 if by_corner else 0]
    longitude, latitude, crs = in_degrees(file, places)
    cell = np.concatenate([at for _, at in fans])
    return Cells(node_dim, cell_dim, longitude, latitude, np.concatenate(triangles), cell, corners, crs)


def _meshes(file: File) -> list[str]:
    """Return UGRID's topologies of two-dimensional meshes."""
    stated = [name for name in file.variables if file.text(name, "cf_role") == "mesh_topology"]
    return [name for name in stated if file.text(name, "topology_dimension") != "1"]


def connectivity(file: File) -> tuple[str, tuple[str, str]] | None:
    """Return the connectivity, and x and y of the nodes; None without one.

    As UGRID's mesh topology names them, or by the names of FVCOM, SCHISM and SELFE.

    Raises:
        CurrentError: the mesh topology names what is not there.
    """
    for mesh in _meshes(file):
        roles = [name for name in file.variables if file.text(name, "cf_role") == "face_node_connectivity"]
        own = [name for name in roles if file.text(name, "mesh") in ("", mesh)]
        name = next(filter(None, [file.text(mesh, "face_node_connectivity"), *own]), "")
        nodes = file.text(mesh, "node_coordinates").split()
        if not name:
            raise file.fail(f"the mesh topology {mesh} names no face_node_connectivity")
        for missing in [part for part in (name, *nodes) if part not in file.variables]:
            raise file.fail(
                f"the mesh topology {mesh} names {missing}, which is missing: name the model's "
                "grid file beside it in current.files, if it has one"
            )
        if len(nodes) == 2:
            northern = [_is_latitude(file, node) for node in nodes]
            return name, (nodes[1], nodes[0]) if northern[0] and not northern[1] else (nodes[0], nodes[1])
    for name in _CONNECTIVITY:
        if name not in file.variables or file.variables[name].ndim != 2:
            continue
        for places in _NODES:
            flat = all(place in file.variables and file.variables[place].ndim == 1 for place in places)
            if flat and any(file.coordinate(place).any() for place in places):
                return name, places
    return None


def _is_latitude(file: File, name: str) -> bool:
    words = file.text(name, "standard_name") + file.text(name, "units")
    return "lat" in words or "north" in words or ("lat" in name.lower() and "lon" not in name.lower())


def _near(nodes: Triangles | Cells, triangles: Index, middle: Array, apart: Array) -> Index:
    """Triangles that may touch a box about a place."""
    near = np.ones(len(triangles), bool)
    for degrees, half in zip(offset(middle, nodes.longitude, nodes.latitude), apart, strict=True):
        corners = degrees[triangles]
        near &= (corners.min(axis=1) <= half + 1e-9) & (corners.max(axis=1) >= -half - 1e-9)
    return np.flatnonzero(near)
