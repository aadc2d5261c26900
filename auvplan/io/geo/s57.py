"""S-57 electronic navigational charts (ENC): what cells close to a vehicle, and what stands in their water.

Cells are read by GDAL's S57 driver, which applies the updates (.001 and on) that it is given with a cell.
Where cells overlap, the one of the largest scale is used, as on a navigator's display, and of two editions of
a cell the later one. Depths count from the chart's datum.
"""

import shutil
import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from glob import escape
from itertools import chain
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import scipy
import shapely
from shapely.geometry import Polygon

from auvplan.errors import reason_of, warn
from auvplan.io.geo.charts import Land
from auvplan.io.geo.error import GeoError, reading
from auvplan.io.geo.features import Feature, gdal, read_layer
from auvplan.io.geo.grid import Extent, LocalGrid, areas, around, near, to_local, touched
from auvplan.ocean.chart import ChartError
from auvplan.ocean.closures import Zone
from auvplan.ocean.known import KnownObstacle
from auvplan.runtime.formatting import counted
from auvplan.site import Site, swapped_hint

#: Water that may be shallower is closed, m below the chart's datum, unless a scenario says otherwise.
SAFETY_DEPTH = 5.0
#: Radius of a hazard that is a point on the chart, m: the accuracy of places in zone of confidence B.
HAZARD_RADIUS = 50.0

_DEPTHS = ("DEPARE", "DRGARE")
_DRY = ("LNDARE", "FLODOC", "HULKES", "PONTON", "SLCONS", "CAUSWY", "DAMCON", "DYKCON", "GATCON")
_SKIN = ("LNDARE", "FLODOC", "HULKES", "PONTON", "UNSARE", *_DEPTHS)  # group 1, which covers all of a cell
_HAZARDS = {
    "UWTROC": "rock",
    "WRECKS": "wreck",
    "OBSTRN": "obstruction",
    "OFSPLF": "platform",
    "PILPNT": "pile",
    "PYLONS": "pylon",
    "MORFAC": "mooring",
    "FSHFAC": "fishing facility",
    "MARCUL": "marine farm",
}
# All classes that have the attribute RESTRN.
_RESTRICTED = (
    *("RESARE", "MIPARE", "OSPARE", "MARCUL", "ACHARE", "CBLARE", "PIPARE", "DMPGRD", "ICNARE", "SPLARE"),
    *("SUBTLN", "PRCARE", "FAIRWY", "ISTZNE", "DWRTPT", "DRGARE", "TESARE", "TSSCRS", "TSSLPT", "TSSRON"),
)
_PROHIBITED, _AVOIDED, _HINDERED = "7", "14", "8"  # values of RESTRN
# Values of WATLEV of what reaches the surface at some time; 3 is always under water.
_SHOWN = (1, 2, 4, 5, 6, 7)
_STANDING = (4, 5)  # values of CATWRK of wrecks that show mast or hull
_WGS84, _METRES = 2, 1
_HARMLESS = "Illegal feature attribute id", "not in expected schema"
#: What lies deeper than this below a vehicle's greatest depth concerns it no more, m.
_UNDER = 5.0
# Narrower gaps between areas are of rounding, m.
_GAP = 2.0
# Lines become so narrow areas, m.
_LINE = 0.01


@dataclass(frozen=True)
class _Cell:
    """A cell by its header."""

    path: Path
    source: Path  # that GDAL reads, with the updates that apply beside it
    layers: tuple[str, ...]  # classes of the objects that it holds
    scale: float  # denominator, of compilation; infinite where it is not given
    coverage: Any  # where it has data, degrees
    edition: str  # in words


@dataclass
class _Found:
    """Shapes in local metres (north, east) within `margin` m of a grid, and what is to be noted of them."""

    site: Site
    grid: LocalGrid
    deepest: float
    safety_depth: float
    radius: float
    low_water: float
    margin: float
    dry: list[Any] = field(default_factory=list)
    shut: list[Any] = field(default_factory=list)
    depths: dict[float, list[Any]] = field(default_factory=dict)
    hazards: list[KnownObstacle] = field(default_factory=list)
    closed: list[Zone] = field(default_factory=list)
    repaired: int = 0
    hindered: int = 0
    unknown: int = 0
    gap: float = 0.0

    def collect(self, cell: _Cell, own: Any) -> None:
        """Add what a cell has of its own part, which is in local metres."""
        box, part = around(self.site, self.grid, self.margin), own.buffer(_LINE)
        skin: list[Any] = []
        unknown: list[Any] = []
        kinds = dict.fromkeys((*_DRY, "UNSARE", *_DEPTHS, *_HAZARDS, *_RESTRICTED))
        layers = (_read(cell.path, cell.source, kind) for kind in kinds if kind in cell.layers)
        for one in chain.from_iterable(layers):
            shape = one.shape
            if not shapely.intersects(shapely.box(*shape.bounds), box):
                continue
            if not shapely.is_valid(shape):
                shape, self.repaired = shapely.make_valid(shape), self.repaired + 1
            cuts = [shapely.intersection(shape, turn) for turn in box.geoms]
            whole = shapely.union_all([to_local(cut, self.site) for cut in cuts if not shapely.is_empty(cut)])
            local = shapely.intersection(whole, part)
            if shapely.is_empty(local):
                continue
            area, least = areas(local), float(one.properties.get("DRVAL1", -np.inf))
            if one.kind in _SKIN:
                skin.append(area)
            if one.kind in _DRY:
                self.dry.append(_grown(local, self.radius, _LINE))
            elif one.kind == "UNSARE" or (one.kind in _DEPTHS and not least >= self.safety_depth):
                self.shut.append(area)
                if "DRVAL1" not in one.properties:
                    unknown.append(area)
                    self.unknown += one.kind in _DEPTHS
            elif one.kind in _HAZARDS:
                # What is of unknown depth, or may show above water, reaches up to the surface.
                shown = int(one.properties.get("WATLEV", 3)) in _SHOWN
                shown |= int(one.properties.get("CATWRK", 0)) in _STANDING
                charted = float(one.properties.get("VALSOU", -np.inf))
                top = 0.0 if shown else max(charted + self.low_water, 0.0)
                for piece in shapely.get_parts(local) if top <= self.deepest + _UNDER else ():
                    if piece.geom_type == "Point":
                        name = _name(one, _HAZARDS[one.kind])
                        self.hazards.append(KnownObstacle(name, (piece.x, piece.y), self.radius, top))
                    else:
                        self.shut.append(_grown(piece, self.radius, self.radius))
            if one.kind in _DEPTHS and "DRVAL1" in one.properties:
                self.depths.setdefault(least, []).append(area)
            stated = one.properties.get("RESTRN", ())
            stated = stated.split(",") if isinstance(stated, str) else stated
            values = {str(value).strip() for value in stated}
            if values & {_PROHIBITED, _AVOIDED} and not area.is_empty:
                self.closed.append(Zone(_name(one, one.kind), area, one.where))
            elif _HINDERED in values and not area.is_empty:
                self.hindered += 1
        gap = areas(own.difference(shapely.union_all(skin)).buffer(-_GAP / 2.0).buffer(_GAP / 2.0))
        self.depths.setdefault(0.0, []).extend([gap, *unknown])
        within = gap.intersection(self.grid.box)
        if within.area > 0.0:
            self.shut.append(gap)
            self.gap += within.area / self.grid.box.area

    def notes(self, name: str, hazards: Sequence[KnownObstacle]) -> Iterator[str]:
        """Yield what there is to be noted, with the hazards that stand in water."""
        depth = f"{self.safety_depth:g} m (chart.safety_depth)"
        yield f"{name}: water that may be shallower than {depth} is closed"
        if hazards:
            high = sum(one.depth_min == 0.0 for one in hazards)
            level = f", the water {self.low_water:+.2f} m off the chart's datum" if self.low_water else ""
            yield (
                f"{name}: {counted(len(hazards), 'obstacle')} of {self.radius:g} m radius "
                "(chart.hazard_radius), rocks, wrecks and the like; "
                f"{high} of them from the surface down{level}"
            )
        if self.closed:
            names = ", ".join(sorted({zone.name for zone in self.closed}))
            yield f"{name}: closed at all times: {names[:200]}"
        if self.hindered:
            yield f"{name}: {counted(self.hindered, 'area')} of restricted entry (RESTRN 8) left open"
        if self.unknown:
            yield f"{name}: {counted(self.unknown, 'depth area')} of unknown depth closed"
        if self.gap > 0.0:
            yield f"{name}: {self.gap:.1%} of the area is neither land nor a depth area, and closed"
        if self.repaired:
            yield f"{name}: {counted(self.repaired, 'outline')} that crossed or touched itself, repaired"


def read_cells(
    path: str | Path,
    site: Site,
    extent: Extent,
    *,
    deepest: float,
    safety_depth: float = SAFETY_DEPTH,
    hazard_radius: float = HAZARD_RADIUS,
    low_water: float = 0.0,
) -> Land:
    """Read what S-57 cells have of a local rectangle.

    Closed are land (LNDARE, and docks, hulks, pontoons, quays and dams), depth and dredged areas whose least
    depth (DRVAL1) is unknown or less than the safety depth, unsurveyed areas (UNSARE), and areas of any class
    whose restriction (RESTRN) is "entry prohibited" or "area to be avoided", at all times. Rocks, wrecks and
    obstructions are upright cylinders from their depth (VALSOU) at low water down; from the surface where the
    depth is unknown, or where they may show above water. Those that are areas or lines are closed where they
    reach up to 5 m below the deepest that the vehicle goes.

    Args:
        path: of a cell (`.000`) or of a folder with cells, at any depth in it.
        site: where local coordinates count from.
        extent: of the charts.
        deepest: m, greatest depth that the vehicle goes to.
        safety_depth: m below the chart's datum.
        hazard_radius: m, of what is a point or a line on the chart.
        low_water: m above the chart's datum, the surface at its lowest.

    Raises:
        ChartError: one line; no cell is there, one is damaged or in other units, or the rectangle reaches
            beyond what the cells cover.

    Warns:
        ScenarioWarning: an update does not apply to the cell that it lies with, or a cell is left out, for it
            is cancelled or there is a later edition.
    """
    path = Path(path)
    with reading(path, ChartError), TemporaryDirectory() as staging:
        grid = extent.grid()
        wide = grid.widened(extent.beyond)
        margin = extent.beyond + hazard_radius + grid.pixel_size
        files = sorted(entry for entry in path.rglob("*.000") if entry.is_file()) if path.is_dir() else [path]
        if not path.exists():
            raise GeoError(f"{path}: no such file or folder")
        if not files:
            raise GeoError(f"{path}: holds no S-57 cell (*.000)")
        if files[0].suffix != ".000":
            raise GeoError(f"{path}: an S-57 cell ends in .000, its updates in .001 and on lie beside it")
        cells = [_cell(*one) for one in _staged(files, Path(staging))]
        if not cells:
            raise GeoError(f"{path}: is cancelled by an update: get the cell that replaces it")
        box = around(site, grid, margin)
        reaching = [cell for cell in cells if shapely.intersects(cell.coverage, box)]
        found = _Found(site, grid, deepest, safety_depth, hazard_radius, low_water, margin)
        notes, covered = [], Polygon()
        for cell in sorted(reaching, key=lambda cell: (cell.scale, cell.path.name)):
            coverage = areas(near([cell.coverage], site, grid, margin))
            own = areas(coverage.difference(covered))
            if own.buffer(-_GAP / 2.0).is_empty:
                continue
            found.collect(cell, own)
            covered = areas(covered.union(coverage))
            notes.append(f"{cell.path.name}: {cell.edition}")
        _refuse_uncovered(path, covered, [cell.coverage for cell in cells], site, grid)
        dry = touched(shapely.union_all(found.dry), grid)
        blocked = shapely.union_all([*found.dry, *found.shut])
        shut = touched(blocked, wide)
        closed = touched(shapely.union_all([zone.polygon for zone in found.closed]), wide)
        # Of obstacles those that reach into the rectangle, and out of what is closed already.
        discs = np.array([shapely.Point(one.position).buffer(one.radius) for one in found.hazards], object)
        stands = shapely.intersects(discs, grid.box) & ~shapely.covers(blocked, discs)
        hazards = tuple(one for one, there in zip(found.hazards, stands, strict=True) if there)
        notes += found.notes(path.name, hazards)
        charts = wide.chart(~shut), wide.chart(~(shut | closed))
        # The least depth of the areas that reach into a pixel or into one beside it: interpolated between
        # pixels' centres it is to be nowhere deeper than the areas are.
        depth = np.where(dry, 0.0, np.inf)
        for least, shapes in found.depths.items():
            reached = touched(shapely.union_all(shapes), grid)
            depth[reached] = np.minimum(depth[reached], max(least, 0.0))
        depth = scipy.ndimage.minimum_filter(depth, size=3, mode="nearest")
        depth = np.where(np.isfinite(depth), depth, 0.0).astype(np.float32)
        return Land(*charts, tuple(notes), grid.chart(~dry), depth, hazards, tuple(found.closed))


@dataclass(frozen=True, order=True)
class _Identity:
    """What a cell or an update says it is (S-57 part 3, field DSID)."""

    edition: int  # 0 of an update that cancels its cell
    update: int  # the last one that is contained
    path: Path
    stated: dict[str, Any] = field(compare=False)


def _identity(path: Path, staging: Path) -> _Identity:
    """Read what a file says it is; updates by way of the folder `staging`, for GDAL opens none by itself."""
    with path.open("rb") as file:
        start = file.read(24)
    # The leader of a data descriptive record (ISO/IEC 8211): GDAL would take other files for what they are.
    if not (len(start) == 24 and start[:5].isdigit() and start[6:7] == b"L" and start[12:17].isdigit()):
        raise GeoError(f"{path}: is no S-57 cell")
    source = path if path.suffix == ".000" else shutil.copyfile(path, staging / "update.000")
    stated = _head(path, source, UPDATES="IGNORE")
    numbers = [str(stated.get(name, "")).strip() for name in ("DSID_EDTN", "DSID_UPDN")]
    if not all(map(str.isdigit, numbers)):
        raise GeoError(f"{path}: is damaged: it does not state its edition and update (DSID)")
    return _Identity(int(numbers[0]), int(numbers[1]), path, stated)


def _staged(files: Iterable[Path], staging: Path) -> Iterator[tuple[_Identity, Path]]:
    """Yield cells, and where each lies with the updates that apply to it, numbered from .001.

    Updates lie beside their cell, or in folders 1, 2 and on beside its folder. A cell that was issued again
    holds the first of them. Cells that have updates are copied to the folder `staging`.
    """
    latest: dict[str, _Identity] = {}
    for one in sorted(_identity(file, staging) for file in files):
        if (older := latest.get(one.path.name)) is not None:
            warn(f"{older.path}: is left out for {one.path}, which is edition {one.edition}")
        latest[one.path.name] = one
    for number, cell in enumerate(latest.values()):
        name = f"{escape(cell.path.stem)}.[0-9][0-9][0-9]"
        beside = {*cell.path.parent.glob(name), *cell.path.absolute().parent.parent.glob(f"[1-9]*/{name}")}
        updates = [_identity(entry, staging) for entry in beside if entry.suffix != ".000"]
        applied: list[_Identity] = []
        for update in sorted(updates, key=lambda one: one.update):
            due = cell.update + len(applied) + 1
            if update.update < due and update.edition == cell.edition:
                continue  # the cell holds it already
            if update.update == due and update.edition in (cell.edition, 0):
                applied.append(update)
            else:
                warn(
                    f"{cell.path}: {update.path.name} is not applied: it is update {update.update} of "
                    f"edition {update.edition}, and update {due} of edition {cell.edition} is wanted"
                )
        if any(update.edition == 0 for update in applied):
            warn(f"{cell.path}: is left out: {applied[-1].path.name} cancels it")
        elif not beside:
            yield cell, cell.path
        else:
            source = staging / str(number) / "0" / cell.path.name
            source.parent.mkdir(parents=True)
            shutil.copyfile(cell.path, source)
            for count, update in enumerate(applied, 1):
                shutil.copyfile(update.path, source.with_suffix(f".{count:03d}"))
            yield cell, source


def _cell(one: _Identity, source: Path) -> _Cell:
    """Return a cell without its objects; `source` is where it lies with its updates."""
    path, stated = one.path, one.stated if source == one.path else _head(one.path, source)
    with _unharmed(f"{path}:"):
        layers = tuple(str(name) for name, _ in gdal(path).list_layers(source))
    for name, wanted, what in (
        ("DSPM_HDAT", _WGS84, "its positions are not on WGS 84"),
        ("DSPM_DUNI", _METRES, "its depths are not in metres"),
    ):
        if int(stated.get(name, wanted)) != wanted:
            raise GeoError(f"{path}: {what} ({name} is {int(stated[name])})")
    every = _read(path, source, "M_COVR") if "M_COVR" in layers else ()
    coverage = [one.shape for one in every if int(one.properties.get("CATCOV", 1)) == 1]
    if not coverage:
        raise GeoError(f"{path}: has no coverage (M_COVR)")
    scale = float(stated.get("DSPM_CSCL") or np.inf)
    edition = f"edition {stated.get('DSID_EDTN', '?')}, update {stated.get('DSID_UPDN', '0')}"
    if issued := str(stated.get("DSID_ISDT", "")):
        edition += f" of {issued[:4]}-{issued[4:6]}-{issued[6:]}"
    if np.isfinite(scale):
        edition += f", 1:{scale:.0f}"
    return _Cell(path, source, layers, scale, shapely.union_all(shapely.make_valid(coverage)), edition)


def _head(path: Path, source: Path, **options: str) -> dict[str, Any]:
    """Return what a cell states of itself."""
    with _unharmed(f"{path}:"):
        features, _ = read_layer(path, source, "DSID", **options)
    return features[0].properties if features else {}


def _read(path: Path, source: Path, layer: str) -> Iterator[Feature]:
    """Yield the objects of a class of a cell, from the file `source`."""
    with _unharmed(f"{path}: {layer}"):
        features, _ = read_layer(path, source, layer)
    for one in features:
        where = f"{path}: {layer} {one.properties.get('FIDN', one.number)}"
        if one.shape is None or one.shape.is_empty:
            raise GeoError(f"{where}: is damaged: it has no place")
        yield replace(one, where=where)


@contextmanager
def _unharmed(what: str) -> Iterator[None]:
    """Whatever GDAL raises or warns of within becomes a `GeoError`: what it warns of, it has left out.

    Attributes that a class does not have or S-57 does not know are no loss.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            yield
        except GeoError:
            raise
        except Exception as error:
            raise GeoError(f"{what} cannot be read ({reason_of(error)})") from None
    for one in caught:
        message = " ".join(str(one.message).split())
        if not any(words in message for words in _HARMLESS):
            raise GeoError(f"{what} is damaged ({message[:200]})")


def _name(one: Feature, kind: str) -> str:
    """Return the name of an object, or what it is and its number."""
    return str(one.properties.get("OBJNAM") or f"{kind} {one.properties.get('FIDN', '')}").strip()


def _grown(local: Any, points: float, lines: float) -> Any:
    """Return areas as they are, and points and lines with an area around them, m wide on each side."""
    parts = [
        part if part.geom_type == "Polygon" else part.buffer(points if part.geom_type == "Point" else lines)
        for part in shapely.get_parts(local)
    ]
    return areas(shapely.union_all(parts))


def _refuse_uncovered(
    path: Path, covered: Any, coverages: Sequence[Any], site: Site, grid: LocalGrid
) -> None:
    """Refuse a rectangle that reaches beyond what cells cover: how much of it, on which side and how far."""
    box = grid.box
    beyond = areas(box.difference(covered).buffer(-_GAP / 2.0))
    if beyond.is_empty:
        return
    if not covered.intersects(box):
        west, south, east, north = shapely.total_bounds(np.asarray(coverages, object))
        hint = swapped_hint(site, lambda other: not shapely.is_empty(near(list(coverages), other, grid, 0.0)))
        raise GeoError(
            f"{path}: the area lies wholly beyond the cells, which cover longitudes {west:.2f} to {east:.2f} "
            f"and latitudes {south:.2f} to {north:.2f}{hint}"
        )
    south, west, north, east = beyond.buffer(_GAP).intersection(box).bounds
    raise GeoError(
        f"{path}: the area reaches beyond what the cells cover (M_COVR) with {beyond.area / box.area:.1%} of "
        f"it, between {south:.0f} and {north:.0f} m north, {west:.0f} and {east:.0f} m east of the origin"
    )
