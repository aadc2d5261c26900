"""What is read of ocean files, and by other means: ``python -m benchmarks.files --out docs/files.md``.

Currents are compared with netCDF4, cftime and NumPy alone (`benchmarks.file_references`) or, of made
files, with the closed form that they stand for; sea beds and charts with rasterio, netCDF4 and shapely.
Real files lie in ``../shared/data``. The second table is that of ``python -m benchmarks.mutated_files
--out FILE``.
"""

import json
import re
import tempfile
import warnings
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from auvplan.errors import AuvplanError
from auvplan.io.currents import open_ocean, read_current
from auvplan.site import Site
from benchmarks.file_models import CUTS, REAL, Currents, made
from benchmarks.file_rasters import RASTERS, Rasters
from benchmarks.file_references import Table
from benchmarks.harness import launch, machine, markdown

COUNT = 200
#: m/s, above which a row says why.
SAME = 1e-5

WHY = {
    "dflowfm_simplebox_projected.nc": "axes are turned by true north on WGS 84, the other reading by that on "
    "the projection's Bessel ellipsoid: 1e-5 rad apart",
}
#: Columns of the tables; a row that is refused says why in the last one.
CURRENTS = "file", "model", "", "nodes", "between levels and times", "inside cells", "planner's grid", ""
PIXELS = "file", "what", "", "pixels equal", "largest difference", ""
COPIES = "file", "copies", "refused", "read right", "failed"

#: Longitude and latitude in degrees, m deep, s, and the current [2] m/s that is expected there.
Place = tuple[float, float, float, float, np.ndarray]


def places(table: Table, rng: np.random.Generator, count: int) -> np.ndarray:
    """[M, 3] frames, levels and points that have a current."""
    wet = np.argwhere(np.isfinite(table.east) & np.isfinite(table.north) & np.isfinite(table.depth))
    return wet[rng.choice(len(wet), min(count, len(wet)), replace=False)]


def node_values(table: Table, rng: np.random.Generator, count: int) -> tuple[np.ndarray, ...]:
    """Some of the file's own points, levels and times that have a current: a `Place` each, by part."""
    t, k, p = places(table, rng, count).T
    depth = np.broadcast_to(table.depth, table.east.shape)[t, k, p]
    current = np.stack([table.east[t, k, p], table.north[t, k, p]], axis=1)
    return table.longitude[p], table.latitude[p], depth, table.times[t], current


def at_nodes(table: Table, rng: np.random.Generator) -> Iterator[Place]:
    """The file's own points, levels and times."""
    yield from zip(*node_values(table, rng, COUNT), strict=True)


def between(table: Table, rng: np.random.Generator) -> Iterator[Place]:
    """The file's points between its levels and times; nowhere for one of each."""
    if len(table.times) == 1 and table.depth.shape[1] == 1:
        return
    for t, _, p in places(table, rng, 4 * COUNT):
        last = min(t + 1, len(table.times) - 1)
        span = common_depths(table, (t, last), (p, p))
        if span is not None:
            depth = float(rng.uniform(*span))
            second = float(rng.uniform(table.times[t], table.times[last]))
            value = table.at([p], [1.0], depth, second)
            yield table.longitude[p], table.latitude[p], depth, second, value


def inside(table: Table, rng: np.random.Generator) -> Iterator[Place]:
    """Inside cells or triangles all of whose corners have a current."""
    groups = table.triangles
    if table.rows is not None:
        rows = table.rows
        sides = rows[:-1, :-1], rows[:-1, 1:], rows[1:, :-1], rows[1:, 1:]
        groups = np.stack(sides, axis=-1).reshape(-1, 4)
    assert groups is not None
    groups = groups[np.isfinite(table.east[:, :, groups]).any(axis=1).all(axis=(0, 2))]
    for number in rng.choice(len(groups), 8 * COUNT):
        corners = groups[number]
        shares = rng.dirichlet(np.ones(len(corners)))
        lon = table.longitude[corners]
        lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
        place = float(shares @ lon), float(shares @ table.latitude[corners])
        mixture = table.mixture(*place)
        frame = int(rng.integers(len(table.times)))
        span = common_depths(table, [frame] * len(corners), corners)
        if mixture is not None and span is not None:
            depth = float(rng.uniform(*span))
            yield *place, depth, table.times[frame], table.at(*mixture, depth, float(table.times[frame]))


def common_depths(table: Table, frames: Any, points: Any) -> tuple[float, float] | None:
    """The depths between which all of some columns have levels, m; None where one has none at all."""
    levels = [table.column(frame, int(p))[0] for frame, p in zip(frames, points, strict=True)]
    if not all(len(axis) for axis in levels):
        return None
    low, high = max(axis[0] for axis in levels), min(axis[-1] for axis in levels)
    return low, max(low, high)


def farthest(ocean: Any, asked: Iterator[Place]) -> float | None:
    """Largest difference, m/s, at the first `COUNT` places where a current is expected; None without any."""
    rows = list(islice((one for one in asked if np.isfinite(one[-1]).all()), COUNT))
    if not rows:
        return None
    *at, expected = (np.array(part) for part in zip(*rows, strict=True))
    return largest(ocean.at(*at), expected.T)


def box_of(table: Table) -> tuple[Site, float, float, float]:
    """A site amid water, half the side of a box, its depth and the spacing of points there, m."""
    wet = np.isfinite(table.east).all(axis=0).any(axis=0)
    local = Site(float(np.nanmedian(table.longitude)), float(np.nanmedian(table.latitude)))
    known = np.isfinite(table.longitude) & np.isfinite(table.latitude)
    xy = np.full((len(wet), 2), np.inf)
    xy[known] = np.stack(local.to_local(table.longitude[known], table.latitude[known]), axis=1)
    xy[~np.isfinite(xy).all(axis=1)] = 1e12
    tree = KDTree(xy)
    inner = np.flatnonzero(wet & (np.abs(xy) < 1e11).all(axis=1))
    far = tree.query(xy[inner], k=2)[0][:, 1]
    spacing = float(np.median(far))
    around = tree.query_ball_point(xy[inner], 3.2 * spacing)
    score = [wet[near].sum() for near in around]
    best = inner[int(np.argmax(score))]
    depths = [table.column(0, int(p))[0] for p in around[int(np.argmax(score))] if wet[p]]
    deepest = float(np.median([axis[-1] for axis in depths]))
    site = Site(float((table.longitude[best] + 180.0) % 360.0 - 180.0), float(table.latitude[best]))
    return site, 2.0 * spacing, 0.6 * deepest, spacing


def on_local_grid(paths: list[Path], options: dict[str, Any], table: Table) -> tuple[float | None, float]:
    """Largest difference on the planner's grid, and the share of its values that were compared."""
    site, half, depth, spacing = box_of(table)
    frames = sorted({0, len(table.times) // 2})
    found = read_current(
        paths, site, lower=(-half, -half, 0.0), upper=(half, half, depth), spacing=spacing / 1.5,
        outside="clamp", times=(0.0, float(table.times[frames[-1]] - table.times[0])),
        crs=options.get("crs"), data_epoch=options.get("epoch"),
    )  # fmt: skip
    field = found.field
    found.source.close()
    u, v, depths = (np.asarray(part) for part in (field.u, field.v, field.depths))
    moments = np.asarray(field.times)
    worst, compared, total = 0.0, 0, 0
    for i, j in np.ndindex(*u.shape[2:]):
        north, east = (found.origin[k] + found.spacing[k] * (i, j)[k] for k in range(2))
        lon, lat = (float(part) for part in site.to_geographic(north, east))
        mixture = table.mixture(lon, lat)
        turn = bearing(site, lon, lat)
        for frame in frames:
            k = int(np.argmin(np.abs(moments - (table.times[frame] - table.times[0]))))
            for level, deep in enumerate(depths):
                total += 1
                if mixture is None or not found.water[i, j]:
                    continue
                # The grid's depths are in single precision.
                deep = nearest_level(table, float(deep))
                value = table.at(*mixture, deep, float(table.times[frame]))
                if not np.isfinite(value).all():
                    continue
                e, n = value
                to_north, to_east = n * np.cos(turn) - e * np.sin(turn), n * np.sin(turn) + e * np.cos(turn)
                worst = max(worst, abs(u[k, level, i, j] - to_north), abs(v[k, level, i, j] - to_east))
                compared += 1
    return (worst if compared else None), compared / max(total, 1)


def nearest_level(table: Table, depth: float) -> float:
    """A fixed level that is meant by a number in single precision; the number itself without one."""
    if table.depth.shape[0] == 1 and table.depth.shape[2] == 1:
        levels = table.depth[0, :, 0]
        near = levels[np.argmin(np.abs(levels - depth))]
        return float(near) if abs(near - depth) <= 1e-5 * max(1.0, near) else depth
    return depth


def bearing(site: Site, longitude: float, latitude: float) -> float:
    """Bearing of true north in the local frame, rad, from two places on the meridian."""
    north, east = site.to_local([longitude] * 2, [latitude - 1e-3, latitude + 1e-3])
    return float(np.arctan2(*np.diff([east, north])[:, 0]))


def largest(found: Any, expected: Any) -> float:
    """Largest difference of either component; infinite where one reading has a value and the other none."""
    far = 0.0
    for one, other in zip(found, expected, strict=False):
        one, other = np.asarray(one, float), np.asarray(other, float)
        if (np.isnan(one) != np.isnan(other)).any():
            return np.inf
        far = max(far, float(np.nanmax(np.abs(one - other), initial=0.0)))
    return far


def compared(case: Currents, folder: Path) -> list[str]:
    paths, options = case.prepare(folder)
    about = [case.name, case.model, case.origin]
    try:
        ocean = open_ocean(paths, **options)
    except AuvplanError as error:
        return [*about, "refused", "", "", "", str(error).replace(f"{folder}/", "")]
    table, rng = case.reading(paths), np.random.default_rng(0)
    with ocean:
        nodes, *parts = (farthest(ocean, asked(table, rng)) for asked in (at_nodes, between, inside))
    local, _ = on_local_grid(paths, options, table)
    why = WHY.get(case.name, "") if (nodes or 0.0) > SAME else ""
    return [*about, *map(shown, (nodes, *parts, local)), why]


def raster(case: Rasters, folder: Path) -> list[str]:
    (path,), _ = case.prepare(folder)
    about = [case.name, case.kind, case.origin]
    try:
        found = np.asarray(case.read(path), float)
    except AuvplanError as error:
        return [*about, "refused", "", str(error).replace(f"{folder}/", "")]
    expected = np.asarray(case.expect(path), float)
    far = shown(largest([found], [expected])) + " m" * (case.kind == "sea bed")
    return [*about, f"{case.equal(found, expected):.2%}", far, ""]


def shown(value: float | None) -> str:
    return "-" if value is None else "0" if value == 0.0 else f"{value:.0e}"


def copies_table(counts: dict[str, Any]) -> list[str]:
    keys = "copies", "refused", "right", "failed"
    rows = [[name, *(kinds.get(key, 0) for key in keys)] for name, kinds in counts.items()]
    every = ["all", *np.sum([row[1:] for row in rows], axis=0)]
    failures = [f"- {name}: {line}" for name, kinds in counts.items() for line in kinds.get("failures", [])]
    return markdown(COPIES, [*rows, every]) + [""] * bool(failures) + failures


def fill(page: Path, blocks: dict[str, list[str]]) -> None:
    """Put lines in the place of those below a comment with their name in a page, to the next heading."""
    text = page.read_text(encoding="utf-8")
    for name, lines in blocks.items():
        body = "\n".join(lines).replace("|  |", "| |").replace("|  |", "| |")
        block = re.compile(rf"(<!-- {name} -->\n).*?(\n+(?=## )|\n*\Z)", re.DOTALL)
        text = block.sub(lambda found, body=body: found[1] + body + found[2], text)
    page.write_text(text, encoding="utf-8")


@launch(
    out=(Path, "page whose tables are filled in"),
    only=("", "part of the names of files"),
    mutated=(Path, "JSON file of benchmarks.mutated_files"),
)
def main(out: Path | None, only: str, mutated: Path | None) -> None:
    rows: dict[Callable[..., list[str]], list[list[str]]] = {compared: [], raster: []}
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        for row_of, cases in ((compared, [*REAL, *CUTS, *made(folder)]), (raster, RASTERS)):
            for case in [case for case in cases if only in case.name]:
                rows[row_of].append(row_of(case, folder))
                print(f"| {' | '.join(rows[row_of][-1])} |", flush=True)
    if out:
        about, every = machine(), [*rows[compared], *rows[raster]]
        real = sum(row[2] != "made" for row in every)
        line = f"{len(every)} files, {real} of them real or cuts of real ones; {about['processor']}, "
        blocks = {"files": [line + f"{about['cores']} cores."]}
        blocks |= {"currents": markdown(CURRENTS, rows[compared]), "rasters": markdown(PIXELS, rows[raster])}
        counts = json.loads(mutated.read_text()) if mutated else {}
        fill(out, blocks | ({"copies": copies_table(counts)} if counts else {}))
