"""What is read of ocean files, and by other means: ``python -m benchmarks.files --out docs/files.md``.

Currents are compared with netCDF4, cftime and NumPy alone (`benchmarks.file_references`) or, of made
files, with the closed form that they stand for; sea beds and charts with rasterio, netCDF4 and shapely.
Real files lie in ``../shared/data``. The second table is that of ``python -m benchmarks.mutated_files
--json FILE``.
"""

import argparse
import json
import tempfile
import warnings
from dataclasses import dataclass
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
benchmarks.mutated_files --json FILE` and `python -m benchmarks.files --mutated FILE --out
docs/files.md`."""


@dataclass(frozen=True)
class Row:
    """A current file: largest differences, m/s; None where there is nothing to compare.

    Attributes:
        name, model, origin: as in `Currents`.
        refusal: the one line, where it is refused.
        nodes: at points, levels and times of the file.
        between: at points, between levels and times.
        inside: inside cells or triangles, at levels and times.
        local: on the grid that the planner gets.
        share: of the local grid's values that were compared; others touch land.
    """

    name: str
    model: str
    origin: str
    refusal: str | None = None
    nodes: float | None = None
    between: float | None = None
    inside: float | None = None
    local: float | None = None
    share: float | None = None


def places(table: Table, rng: np.random.Generator, count: int) -> np.ndarray:
    """[M, 3] frames, levels and points that have a current."""
    known = np.isfinite(table.east) & np.isfinite(table.north) & np.isfinite(table.depth)
    wet = np.argwhere(known)
    return wet[rng.choice(len(wet), min(count, len(wet)), replace=False)]


def at_nodes(ocean: Any, table: Table, rng: np.random.Generator, count: int = COUNT) -> float:
    """Largest difference, m/s, at the file's own points, levels and times."""
    chosen = places(table, rng, count)
    t, k, p = chosen.T
    depth = np.broadcast_to(table.depth, table.east.shape)[t, k, p]
    found = ocean.at(table.longitude[p], table.latitude[p], depth, table.times[t])
    return largest(found, (table.east[t, k, p], table.north[t, k, p]))


def between(ocean: Any, table: Table, rng: np.random.Generator, count: int = COUNT) -> float | None:
    """Largest difference at the file's points between its levels and times; None for one of each."""
    if len(table.times) == 1 and table.depth.shape[1] == 1:
        return None
    asked, expected = [], []
    for t, _, p in places(table, rng, 4 * count):
        last = min(t + 1, len(table.times) - 1)
        columns = [table.column(frame, p)[0] for frame in (t, last)]
        if not all(len(levels) for levels in columns):
            continue
        low, high = max(levels[0] for levels in columns), min(levels[-1] for levels in columns)
        depth = float(rng.uniform(low, max(low, high)))
        second = float(rng.uniform(table.times[t], table.times[last]))
        value = table.at([p], [1.0], depth, second)
        if np.isfinite(value).all():
            asked.append((table.longitude[p], table.latitude[p], depth, second))
            expected.append(value)
        if len(asked) == count:
            break
    if not asked:
        return None
    return largest(ocean.at(*np.transpose(asked)), np.transpose(expected))


def inside(ocean: Any, table: Table, rng: np.random.Generator, count: int = COUNT) -> float:
    """Largest difference inside cells or triangles all of whose corners have a current."""
    asked, expected = [], []
    groups = table.triangles
    if table.rows is not None:
        rows = table.rows
        groups = np.stack([rows[:-1, :-1], rows[:-1, 1:], rows[1:, :-1], rows[1:, 1:]], axis=-1).reshape(
            -1, 4
        )
    assert groups is not None
    wet = np.isfinite(table.east[:, :, groups]).any(axis=1).all(axis=(0, 2))
    groups = groups[wet]
    for number in rng.choice(len(groups), 8 * count):
        corners = groups[number]
        shares = rng.dirichlet(np.ones(len(corners)))
        lon = table.longitude[corners]
        lon = lon[0] + (lon - lon[0] + 180.0) % 360.0 - 180.0
        place = float(shares @ lon), float(shares @ table.latitude[corners])
        mixture = table.mixture(*place)
        frame = int(rng.integers(len(table.times)))
        levels = [table.column(frame, int(p))[0] for p in corners]
        if mixture is None or not all(len(axis) for axis in levels):
            continue
        low, high = max(axis[0] for axis in levels), min(axis[-1] for axis in levels)
        depth = float(rng.uniform(low, max(low, high)))
        value = table.at(*mixture, depth, float(table.times[frame]))
        if np.isfinite(value).all():
            asked.append((*place, depth, table.times[frame]))
            expected.append(value)
        if len(asked) == count:
            break
    return largest(ocean.at(*np.transpose(asked)), np.transpose(expected))


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
    """Largest difference of either component; infinite where one reading has a current and the other none."""
    pairs = [np.asarray(part, float) for part in found[:2]], [np.asarray(part, float) for part in expected]
    if any((np.isnan(a) != np.isnan(b)).any() for a, b in zip(*pairs, strict=True)):
        return np.inf
    return float(max(np.nanmax(np.abs(a - b), initial=0.0) for a, b in zip(*pairs, strict=True)))


def compared(case: Currents, folder: Path) -> Row:
    """The row of a file."""
    paths, options = case.prepare(folder)
    about = case.name, case.model, case.origin
    try:
        ocean = open_ocean(paths, **options)
    except AuvplanError as error:
        return Row(*about, refusal=str(error).replace(f"{folder}/", ""))
    table, rng = case.reading(paths), np.random.default_rng(0)
    with ocean:
        parts = [part(ocean, table, rng) for part in (at_nodes, between, inside)]
    local, share = on_local_grid(paths, options, table)
    return Row(*about, None, *parts, local, share)


def shown(value: float | None) -> str:
    if value is None:
        return "-"
    return "0" if value == 0.0 else f"{value:.0e}"


def table_of(rows: list[Row]) -> list[str]:
    """Markdown of the currents."""
    lines = [
        "| file | model | | nodes | between levels and times | inside cells | planner's grid | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        if row.refusal:
            lines.append(f"| {row.name} | {row.model} | {row.origin} | refused | | | | {row.refusal} |")
            continue
        values = " | ".join(shown(v) for v in (row.nodes, row.between, row.inside, row.local))
        why = WHY.get(row.name, "") if (row.nodes or 0.0) > SAME else ""
        lines.append(f"| {row.name} | {row.model} | {row.origin} | {values} | {why} |")
    return lines


@dataclass(frozen=True)
class Pixels:
    """A sea bed or a chart.

    Attributes:
        name, kind, origin: as in `Rasters`.
        refusal: the one line, where it is refused.
        equal: share of pixels that are equal.
        far: largest difference, m of a sea bed, else of passability or colour.
    """

    name: str
    kind: str
    origin: str
    refusal: str | None = None
    equal: float | None = None
    far: float | None = None


def raster(case: Rasters, folder: Path) -> Pixels:
    """The row of a sea bed or a chart."""
    path, about = case.prepare(folder), (case.name, case.kind, case.origin)
    try:
        found = np.asarray(case.read(path), float)
    except AuvplanError as error:
        return Pixels(*about, refusal=str(error).replace(f"{folder}/", ""))
    expected = np.asarray(case.expect(path), float)
    gap = np.abs(found - expected)
    equal = (gap <= case.exact) | (np.isnan(found) & np.isnan(expected))
    odd = (np.isnan(found) != np.isnan(expected)).any()
    return Pixels(*about, None, float(equal.mean()), np.inf if odd else float(np.nanmax(gap, initial=0.0)))


def raster_table(rows: list[Pixels]) -> list[str]:
    """Markdown of sea beds and charts."""
    lines = ["| file | what | | pixels equal | largest difference | |", "|---|---|---|---|---|---|"]
    for row in rows:
        about = f"| {row.name} | {row.kind} | {row.origin} |"
        if row.refusal is not None:
            lines.append(f"{about} refused | | {row.refusal} |")
        else:
            unit = " m" if row.kind == "sea bed" else ""
            lines.append(f"{about} {row.equal:.2%} | {shown(row.far)}{unit} | |")
    return lines


def mutated_table(counts: dict[str, Any]) -> list[str]:
    """Markdown of what became of damaged and altered copies."""
    lines = ["| file | copies | refused | read right | failed |", "|---|---|---|---|---|"]
    total = dict.fromkeys(("copies", "refused", "right", "failed"), 0)
    for name, kinds in counts.items():
        values = {key: kinds.get(key, 0) for key in total}
        total = {key: total[key] + values[key] for key in total}
        lines.append(f"| {name} | " + " | ".join(str(value) for value in values.values()) + " |")
    lines.append("| all | " + " | ".join(str(value) for value in total.values()) + " |")
    lines += [f"\n{name}: {line}" for name, kinds in counts.items() for line in kinds.get("failures", [])]
    return lines


def page(rows: list[Row], pixels: list[Pixels], counts: dict[str, Any]) -> str:
    """The whole page."""
    about = machine()
    real = sum(row.origin != "made" for row in [*rows, *pixels])
    head = HEAD.format(
        files=len(rows) + len(pixels), real=real, count=COUNT, same=f"{SAME:g}",
        processor=about["processor"], cores=about["cores"],
    )  # fmt: skip
    refused = ["## What is not read", "", "| what | instead |", "|---|---|"]
    refused += [f"| {what} | {then} |" for what, then in REFUSED]
    parts = [head, "\n".join(table_of(rows)), BEDS, "\n".join(raster_table(pixels)), "\n".join(refused)]
    if counts:
        parts += [MUTATED, "\n".join(mutated_table(counts))]
    return "\n\n".join(parts) + "\n"


def main() -> None:
    """Print or write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.files", description=__doc__)
    parser.add_argument("--out", type=Path, help="Markdown file to write")
    parser.add_argument("--only", help="part of the names of files")
    parser.add_argument("--mutated", type=Path, help="JSON file of benchmarks.mutated_files")
    options = parser.parse_args()
    rows: list[Row] = []
    pixels: list[Pixels] = []
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        for case in [*REAL, *CUTS, *made(folder)]:
            if not options.only or options.only in case.name:
                rows.append(compared(case, folder))
                print(table_of(rows)[-1], flush=True)
        for case in RASTERS:
            if not options.only or options.only in case.name:
                pixels.append(raster(case, folder))
                print(raster_table(pixels)[-1], flush=True)
    counts = json.loads(options.mutated.read_text()) if options.mutated else {}
    if options.out:
        options.out.write_text(page(rows, pixels, counts))


if __name__ == "__main__":
    main()
