"""What is read of ocean files, and by other means: ``python -m benchmarks.files --out docs/files.md``.

Currents are compared with netCDF4, cftime and NumPy alone (`benchmarks.file_references`) or, of made
files, with the closed form that they stand for; sea beds and charts with rasterio, netCDF4 and shapely.
Real files lie in ``../shared/data``. The second table is that of ``python -m benchmarks.mutated_files
--out FILE``.
"""

import json
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
from benchmarks.file_cases import CUTS, REAL, Currents, made
from benchmarks.file_rasters import RASTERS, Rasters
from benchmarks.file_references import Table
from benchmarks.harness import launch, markdown
from benchmarks.machine import machine

COUNT = 200
#: m/s, above which a row says why.
SAME = 1e-5

WHY = {
    "dflowfm_simplebox_projected.nc": "axes are turned by true north on WGS 84, the other reading by that on "
    "the projection's Bessel ellipsoid: 1e-5 rad apart",
}
REFUSED = (
    ("GRIB", "convert to NetCDF: the first line of the refusal says what it is"),
    ("u and v on a curvilinear grid with neither angle, grid_mapping nor standard or long names that tell",
     "refused: which way they point is not given"),
    ("winds, ice drift, Stokes drift, extremes over a time", "passed over: they are no current"),
    ("speed and direction", "refused with the formula of the components"),
    ("members of an ensemble, runs of a forecast",
     "refused until one is taken out, such as by `ncks -d member,0`"),
    ("numbers of levels, pressures, heights above the bed in place of depths", "refused"),
    ("stations, moorings, gliders", "refused: between them the current is not known"),
    ("variables in groups", "refused until one is taken out, such as by `ncks -G : -g group`"),
    ("metres of a projection that the file does not name", "refused until `current.crs` says it"),
    ("times that count from no date", "refused until `current.epoch` says it"),
    ("times that fall, depths or axes that rise and fall, grids and meshes that overlap", "refused"),
    ("components on other points than each other, but on C-grids of ROMS, NEMO, MOM6, MITgcm", "refused"),
    ("sea beds on meshes (SCHISM, FVCOM, D-Flow FM) as `bathymetry.file`", "refused; the current's own bed "
     "is used"),
    ("z-sigma levels of D-Flow FM and other mixed levels but those whose heights are given", "refused"),
    ("pictures without a place on Earth", "refused but as `chart.source: picture`"),
)  # fmt: skip


HEAD = """# Files that are read, and how well

{files} files of ocean models, sea beds and charts, {real} of them real or cuts of real ones, each
read by auvplan and by other means: netCDF4, cftime and NumPy for currents, rasterio, netCDF4,
pyogrio and shapely for the rest, or the closed form that a made file stands for. None of auvplan's
readers has a part in the other reading (`benchmarks/file_references.py`, `file_rasters.py`,
`file_models.py`). By `python -m benchmarks.files --out docs/files.md`, with the real files in
`../shared/data`; {processor}, {cores} cores. What is not read stands below.

## Currents

Largest difference, m/s, of either component at up to {count} random places: at the file's points,
levels and times; at its points between levels and times; inside its cells or triangles; and at all
nodes of the local grid that the planner gets, which is in single precision, where no corner is
land. Rows above {same} say why."""
BEDS = """## Sea beds and charts

Depths on the local grid by bilinear interpolation, m; passability of charts' pixels; colours of pictures."""
MUTATED = """## Damaged and altered copies

Copies of each real file, cut to four times and the variables of the current. Bytes: cut off,
changed, zeroed. NetCDF: attributes taken away, changed or added (units, standard_name, positive,
calendar, _FillValue, scale_factor, coordinates, grid_mapping and others); dimensions reversed,
halved or permuted; variables renamed, dropped, reversed or transposed; NaN; times doubled or
shuffled; longitudes in another turn; longitude and latitude under each other's names. Pictures:
rows from the south, coordinate systems, no-data values, tiles and compression. Polygons: rings
opened, reversed, moved by a turn, features dropped or doubled.

A copy must be refused by one line within 30 s of processor time and 4 GB, or be read right: as the
original where the change bears on nothing that is read or on bytes alone, else as the other reading
of the copy. A current is compared at 40 points, levels and times of the copy. By `python -m
benchmarks.mutated_files --out FILE` and `python -m benchmarks.files --mutated FILE --out
docs/files.md`."""


#: Columns of the tables; a row that is refused says why in the last one.
CURRENTS = "file", "model", "", "nodes", "between levels and times", "inside cells", "planner's grid", ""
PIXELS = "file", "what", "", "pixels equal", "largest difference", ""
COPIES = "file", "copies", "refused", "read right", "failed"

#: Longitude and latitude in degrees, m deep, s, and the current [2] m/s that is expected there.
Place = tuple[float, float, float, float, np.ndarray]


def places(table: Table, rng: np.random.Generator, count: int) -> np.ndarray:
    """[M, 3] frames, levels and points that have a current."""
    known = np.isfinite(table.east) & np.isfinite(table.north) & np.isfinite(table.depth)
    wet = np.argwhere(known)
    return wet[rng.choice(len(wet), min(count, len(wet)), replace=False)]


def at_nodes(table: Table, rng: np.random.Generator) -> Iterator[Place]:
    """The file's own points, levels and times."""
    t, k, p = places(table, rng, COUNT).T
    depth = np.broadcast_to(table.depth, table.east.shape)[t, k, p]
    current = np.stack([table.east[t, k, p], table.north[t, k, p]], axis=1)
    yield from zip(table.longitude[p], table.latitude[p], depth, table.times[t], current, strict=True)


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
    times = {"times": (0.0, float(table.times[frames[-1]] - table.times[0]))}
    given = {"crs": options.get("crs"), "data_epoch": options.get("epoch")}
    found = read_current(
        paths, site, lower=(-half, -half, 0.0), upper=(half, half, depth), spacing=spacing / 1.5,
        outside="clamp", **times, **given,
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
    (x, y) = (np.ravel(axis) for axis in site.to_local([longitude] * 2, [latitude - 1e-3, latitude + 1e-3]))
    return float(np.arctan2(y[1] - y[0], x[1] - x[0]))


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
    path, about = case.prepare(folder), [case.name, case.kind, case.origin]
    try:
        found = np.asarray(case.read(path), float)
    except AuvplanError as error:
        return [*about, "refused", "", str(error).replace(f"{folder}/", "")]
    expected = np.asarray(case.expect(path), float)
    far = shown(largest([found], [expected])) + " m" * (case.kind == "sea bed")
    return [*about, f"{case.equal(found, expected):.2%}", far, ""]


def shown(value: float | None) -> str:
    return "-" if value is None else "0" if value == 0.0 else f"{value:.0e}"


def mutated_table(counts: dict[str, Any]) -> list[str]:
    """Markdown of what became of damaged and altered copies."""
    rows = [
        [kinds.get(key, 0) for key in ("copies", "refused", "right", "failed")] for kinds in counts.values()
    ]
    named = [*zip(counts, rows, strict=True), ("all", np.sum(rows, axis=0))]
    lines = markdown(COPIES, [[name, *map(str, row)] for name, row in named])
    return lines + [
        f"\n{name}: {line}" for name, kinds in counts.items() for line in kinds.get("failures", [])
    ]


def page(rows: list[list[str]], pixels: list[list[str]], counts: dict[str, Any]) -> str:
    about, every = machine(), [*rows, *pixels]
    head = HEAD.format(
        files=len(every), real=sum(row[2] != "made" for row in every), count=COUNT, same=f"{SAME:g}",
        processor=about["processor"], cores=about["cores"],
    )  # fmt: skip
    tables = [head, markdown(CURRENTS, rows), BEDS, markdown(PIXELS, pixels)]
    tables += ["## What is not read", markdown(("what", "instead"), REFUSED)]
    tables += [MUTATED, mutated_table(counts)] if counts else []
    texts = ("\n".join([part] if isinstance(part, str) else part) for part in tables)
    return "\n\n".join(texts).replace("|  |", "| |").replace("|  |", "| |") + "\n"


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
        out.write_text(page(*rows.values(), json.loads(mutated.read_text()) if mutated else {}))


if __name__ == "__main__":
    launch(
        main,
        out=(Path, "Markdown file to write"),
        only=("", "part of the names of files"),
        mutated=(Path, "JSON file of benchmarks.mutated_files"),
    )
