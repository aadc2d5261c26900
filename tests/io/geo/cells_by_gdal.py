"""S-57 cells by GDAL, an oracle of the reader: where they close the water, which rocks and wrecks they have.

It asks by attribute filters and looks up every place by itself, in the cell of the largest scale there;
it shares no code with `auvplan.io.geo.s57`.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pyproj import Transformer

from auvplan.check.track import Array, Mask

#: Classes that close the water as they are, and those that do from their depth down.
_SOLID = "LNDARE", "UNSARE", "FLODOC", "HULKES", "PONTON", "SLCONS", "CAUSWY", "DAMCON", "DYKCON", "GATCON"
_HAZARDS = "UWTROC", "WRECKS", "OBSTRN", "OFSPLF", "PILPNT", "PYLONS", "MORFAC", "FSHFAC", "MARCUL"
_FORBIDDEN = {"7", "14"}
#: Metres below a depth area's least depth that are no fault.
_BED_TOLERANCE = 0.5
#: By so much a distance may differ from that of another projection, share.
_TOLERANCE = 0.005

#: [n] where something is so, of longitude and latitude, degrees, and depth, m, [n] each.
Look = Callable[[Array, Array, Array], Mask]


def blocked_by_cells(path: str, chart: dict[str, Any]) -> Look:
    """Return where cells close the water.

    Args:
        path: of a cell or of a folder with cells.
        chart: section of the scenario, as plain data.
    """
    cells = [(_coverage(cell), _closures(cell, chart)) for cell in _by_scale(path)]

    def blocked(longitude: Array, latitude: Array, depth: Array) -> Mask:
        below, covered = _deeper(cells, longitude, latitude, depth)
        return below | ~covered  # beyond all cells nothing is known

    return blocked


def bed_of_cells(path: str, low: float) -> Look:
    """Return where places lie deeper than the least depth of the depth area around them.

    Args:
        path: of a cell or of a folder with cells.
        low: m, by which the surface lies below the chart's datum at its lowest, counted up.
    """
    cells = [
        (_coverage(cell), [(shape, least + low + _BED_TOLERANCE) for shape, least in _depth_areas(cell)])
        for cell in _by_scale(path)
    ]
    return lambda longitude, latitude, depth: _deeper(cells, longitude, latitude, depth)[0]


def _deeper(
    cells: list[tuple[Any, list[tuple[Any, float]]]], longitude: Array, latitude: Array, depth: Array
) -> tuple[Mask, Mask]:
    """Return which places are deeper than an area around them begins, and which some cell covers.

    Of each cell, finest first, there are its coverage and its areas with the depth at which they begin, m; of
    the cells around a place the first one rules.
    """
    found, covered = np.zeros(len(longitude), bool), np.zeros(len(longitude), bool)
    for coverage, areas in cells:
        rows = np.flatnonzero(~covered & shapely.contains_xy(coverage, longitude, latitude))
        covered[rows] = True
        for shape, top in areas:
            inside = shapely.contains_xy(shape, longitude[rows], latitude[rows])
            found[rows] |= inside & (depth[rows] > top)
    return found, covered


def _depth_areas(cell: str) -> Iterator[tuple[Any, float]]:
    for stated, shape in (*_rows(cell, "DEPARE"), *_rows(cell, "DRGARE")):
        if "Polygon" in shape.geom_type:
            yield _prepared(shape), max(float(stated.get("DRVAL1", 0.0)), 0.0)


def _prepared(shape: Any) -> Any:
    valid = shapely.make_valid(shape)
    shapely.prepare(valid)
    return valid


def hazards_of_cells(path: str) -> list[tuple[str, float, float, float]]:
    """Return rocks, wrecks and obstructions that are points: name, longitude, latitude, degrees, depth, m."""
    found, finer = [], shapely.Polygon()
    for cell in _by_scale(path):
        for kind in _HAZARDS:
            for stated, shape in _rows(cell, kind):
                if shape.geom_type == "Point" and not shapely.covers(finer, shape):
                    name = stated.get("OBJNAM") or f"{kind} {stated.get('FIDN')} of {Path(cell).name}"
                    found.append((str(name), shape.x, shape.y, _begins(stated)))
        finer = shapely.union(finer, _coverage(cell))
    return found


def _by_scale(path: str) -> list[str]:
    """Return the paths of cells, those of the largest scale first; the latest edition of each."""
    place = Path(path)
    latest: dict[str, tuple[tuple[int, int], float, Path]] = {}
    for cell in [place] if place.is_file() else sorted(place.rglob("*.000")):
        stated = next((stated for stated, _ in _rows(str(cell), "DSID")), {})
        edition = int(stated.get("DSID_EDTN", 1)), int(stated.get("DSID_UPDN", 0))
        known = latest.get(cell.name)
        if edition[0] > 0 and (known is None or known[0] < edition):  # that of a cancelled cell is 0
            latest[cell.name] = edition, float(stated.get("DSPM_CSCL") or np.inf), cell
    assert latest, "no S-57 cell that is not cancelled"
    return [str(cell) for _, _, cell in sorted(latest.values(), key=lambda one: (one[1], one[2].name))]


def _coverage(cell: str) -> Any:
    parts = [shapely.make_valid(shape) for _, shape in _rows(cell, "M_COVR", "CATCOV = 1 OR CATCOV IS NULL")]
    return _prepared(shapely.union_all(parts))


def _closures(cell: str, chart: dict[str, Any]) -> list[tuple[Any, float]]:
    """Return shapes in degrees that are closed, and the depth from which on each is, m."""
    least, radius = float(chart["safety_depth"]), float(chart["hazard_radius"])
    found = []
    for kind in _SOLID:
        for _, shape in _rows(cell, kind):
            found.append((_around(shape, radius) if shape.geom_type == "Point" else shape, -np.inf))
    for kind in ("DEPARE", "DRGARE"):
        shallow = _rows(cell, kind, f"DRVAL1 < {least!r} OR DRVAL1 IS NULL")
        found += [(shape, -np.inf) for _, shape in shallow]
    for kind in _HAZARDS:
        for stated, shape in _rows(cell, kind):
            if shape.geom_type != "Point":
                line = "Line" in shape.geom_type
                found.append((_around(shape, radius) if line else shape, _begins(stated)))
    for kind in _layers(cell):
        for stated, shape in _rows(cell, kind) if _may_close(cell, kind) else ():
            if _FORBIDDEN & set(str(stated.get("RESTRN", "")).split(",")) and "Polygon" in shape.geom_type:
                found.append((shape, -np.inf))
    return [(_prepared(shape), top) for shape, top in found]


def _around(shape: Any, radius: float) -> Any:
    """Return the surroundings of a point or a line, m, in degrees."""
    at = shape.centroid
    local = f"+proj=aeqd +lon_0={at.x!r} +lat_0={at.y!r} +datum=WGS84 +units=m"
    there = Transformer.from_crs("EPSG:4326", local, always_xy=True)

    def turned(shape: Any, direction: str) -> Any:
        return shapely.transform(
            shape, lambda at: np.column_stack(there.transform(*at.T, direction=direction))
        )

    return turned(turned(shape, "FORWARD").buffer(radius * (1.0 - _TOLERANCE)), "INVERSE")


def _begins(stated: dict[str, Any]) -> float:
    """Return the depth of a hazard's top, m: 0 unless it is known and always under water."""
    water, wreck, depth = stated.get("WATLEV"), stated.get("CATWRK"), stated.get("VALSOU")
    if depth is None or wreck in (4, 5) or water not in (None, 3):
        return 0.0
    return max(float(depth), 0.0)


def _layers(cell: str) -> list[str]:
    from pyogrio import list_layers

    return [str(name) for name, _ in list_layers(cell)]


def _may_close(cell: str, kind: str) -> bool:
    from pyogrio import read_info

    return "RESTRN" in set(map(str, read_info(cell, layer=kind)["fields"]))


def _rows(cell: str, kind: str, where: str | None = None) -> Iterator[tuple[dict[str, Any], Any]]:
    """Yield attributes that have a value, and shapes, of the objects of a class; none where it is absent."""
    from pyogrio import raw

    if kind not in _layers(cell):
        return
    meta, _, geometries, columns = raw.read(cell, layer=kind, where=where, LIST_AS_STRING="YES")
    for row in range(len(columns[0])):
        stated = {str(name): column[row] for name, column in zip(meta["fields"], columns, strict=True)}
        known = {name: value for name, value in stated.items() if value is not None and value == value}
        yield known, None if geometries is None else shapely.from_wkb(geometries[row])
