"""Every reader of files, for `benchmarks.fuzz`: real files to give it, and a call that reads one."""

import json
import shutil
import subprocess
import zipfile
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import yaml
from PIL import Image

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.io import geo
from auvplan.io.currents import open_ocean
from auvplan.io.currents.ocean import summary_of
from auvplan.io.examine import examine_scenario
from auvplan.io.example import write_example, write_example_of_times
from auvplan.io.geo.charts import chart_from_polygons, chart_from_raster, closures_of, read_zones
from auvplan.io.geo.s57 import read_cells
from auvplan.io.restore import restore_run
from auvplan.io.tides import read_tide
from auvplan.link.notices import NoticeFile
from auvplan.ocean.chart import classify_file
from auvplan.report.departures import departures_data, read_departures
from auvplan.report.study import study_data
from auvplan.runtime.files import DEPARTED, DEPARTURES, SUMMARY
from auvplan.scenario.file import read_scenario
from auvplan.study import Design, Sweep, load_study, summarise
from auvplan.study.store import Store
from auvplan.study.table import row_of, table
from benchmarks.machine import AUVPLAN, SHARED
from tests.io.geo.enc_cells import Object, write_cell
from tests.io.geo.files import write_geotiff
from tests.io.sample_run import make_run

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "auvplan" / "data"
_SCENARIOS = *sorted((DATA / "scenarios").glob("*.yaml")), *sorted(DATA.glob("[et]*/scenario.yaml"))
RUN = "mission.nc"

#: Real files of currents and sea beds, those of them that are small enough to be changed often.
_CURRENTS = (
    "currents/norkyst_v3_800m_5h.nc", "currents/rtofs_water_u_v_washington_64x3h.nc",
    "currents/cmems_glo12_uo_vo_northsea.nc", "elsewhere/ngofs_fvcom_small.nc",
    "elsewhere/creofs_selfe_noaa.nc",
)  # fmt: skip
_LINES = (
    {"obstacle": "ferry", "longitude": 148.97, "latitude": -20.34, "radius": 80, "course": 90, "speed": 3},
    {"obstacle": "buoy", "north": 100, "east": -50, "radius": 5, "depth_min": 0, "depth_max": 12},
    {"current": [0.4, -0.1, 0], "longitude": 148.97, "latitude": -20.35, "depth": 10},
    {"current": [0.4, -0.1]},
)
_DEPARTURES = """departure_utc,departure_s,feasible,best,time_s,tasks,total_priority,waypoints,reason
2026-03-01T00:00:00Z,0.0,true,true,900.5,2,7,a > b,
2026-03-01T01:00:00Z,3600.0,false,false,,,,,too late
"""
_GPX = """<?xml version="1.0"?>
<gpx version="1.1" creator="x" xmlns="http://www.topografix.com/GPX/1/1">
<wpt lat="-20.33" lon="148.95"><ele>-5</ele><name>reef</name><desc>look</desc></wpt>
<wpt lat="-20.34" lon="148.96"><name>bay</name></wpt><rte><rtept lat="-20.34" lon="148.96"/></rte></gpx>
"""
_KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Folder>
<Placemark><name>reef</name><ExtendedData><Data name="priority"><value>3</value></Data></ExtendedData>
<Point><coordinates>148.95,-20.33,-5</coordinates></Point></Placemark>
<Placemark><name>bay</name><MultiGeometry><LineString><coordinates>148.95,-20.33 148.96,-20.34,-8
</coordinates></LineString></MultiGeometry></Placemark></Folder></Document></kml>
"""


@dataclass(frozen=True)
class Seed:
    """A folder of real files.

    Attributes:
        main: the file, or ".", the folder, that the reader is given.
        changed: the files that are changed, one at a time.
    """

    name: str
    main: str
    changed: tuple[str, ...] = ()

    @property
    def targets(self) -> tuple[str, ...]:
        return self.changed or (self.main,)


@dataclass(frozen=True)
class Reader:
    """A reader.

    Attributes:
        write: writes a reader's files below a folder, a folder each; the second folder is one of sources.
        names: whether its files may name others, anywhere.
    """

    write: Callable[[Path, Path], Iterable[Seed]]
    read: Callable[[Path], object]
    names: bool = False


def write_sources(folder: Path, planned: bool = True) -> None:
    """Write what several readers' files come from.

    Args:
        planned: whether the example is planned too, by the command, which compiles for a minute.
    """
    write_example(folder / "example")
    write_example_of_times(folder / "times")
    ap.save_run(_sample(), folder / "sample")
    # Exports need what a file keeps of the run.
    ap.export_run(restore_run(folder / "sample"), folder / "exports")
    if planned:
        scenario, out = folder / "example" / "scenario.yaml", folder / "planned"
        words = ["plan", str(scenario), "--out", str(out), "--pictures", "none", "--quiet"]
        subprocess.run([*AUVPLAN, *words], check=True)
        ap.export_run(restore_run(out), folder / "exports")


def _sample() -> Any:
    """A run with a site, names, vortices, obstacles and a sea bed."""
    run = make_run()
    scenario = ap.Scenario.model_validate({"site": {"longitude": 148.96, "latitude": -20.34}})
    run.scenario, run.names = scenario.model_dump(mode="json"), ["alpha", "bravo", "charlie", "delta"]
    run.site = ap.Site(148.96, -20.34, None, (5000.0, 3000.0))
    run.seabed = ap.Seabed.from_depth(np.full((40, 30), 300.0), 100.0, (-500.0, -400.0), clearance=7.0)
    return run


@cache
def _sea() -> ap.Scenario:
    """The shipped example, whose site and area files are read for."""
    return read_scenario(DATA / "example" / "scenario.yaml")


def _site() -> ap.Site:
    site = _sea().site
    assert site is not None
    return site.site


def _box() -> dict[str, Any]:
    lower, upper = (np.asarray(corner, float) for corner in _sea().box)
    return {"lower": lower[:2], "upper": upper[:2], "pixel_size": 20.0}


def _put(folder: Path, name: str, files: Mapping[str, Any], changed: tuple[str, ...] = ()) -> Seed:
    """Write a seed of files: texts, paths to copy, or calls that write them; the first is the main one."""
    (folder / name).mkdir(parents=True)
    for file, content in files.items():
        path = folder / name / file
        if isinstance(content, str):
            path.write_text(content, encoding="utf-8")
        elif isinstance(content, Path):
            shutil.copy(content, path)
        else:
            content(path)
    return Seed(name, next(iter(files)), changed)


def _copied(name: str, *places: Path) -> Callable[[Path, Path], list[Seed]]:
    """Seeds that are a file each, of those that are there; from the sources where a path is not absolute."""

    def write(folder: Path, sources: Path) -> list[Seed]:
        there = [(f"{number}", sources / place) for number, place in enumerate(places)]
        return [_put(folder, number, {name: path}) for number, path in there if path.is_file()]

    return write


def _stated(suffix: str, text: str) -> Callable[[Path, Path], list[Seed]]:
    """A text, and what the export of the same format wrote."""

    def write(folder: Path, sources: Path) -> list[Seed]:
        seeds = [_put(folder, "stated0", {f"jobs.{suffix}": text})]
        exported = sources / "exports" / f"itinerary.{suffix}"
        if exported.is_file():
            content = exported.read_text("utf-8")
            seeds.append(_put(folder, "exported0", {f"jobs.{suffix}": content}))
        return seeds

    return write


def _folders(folder: Path, sources: Path) -> list[Seed]:
    """Scenarios with all that they name."""
    seeds = []
    for name in ("example", "times"):
        shutil.copytree(sources / name, folder / name)
        files = sorted(path.name for path in (folder / name).iterdir() if path.suffix != ".md")
        seeds.append(Seed(name, "scenario.yaml", tuple(files)))
    return seeds


def _kmz(folder: Path, sources: Path) -> list[Seed]:
    def write(path: Path) -> None:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("doc.kml", _KML)

    return [_put(folder, "zip", {"jobs.kmz": write})]


def _picture() -> np.ndarray:
    """[rows, columns, 3] water and land with some noise."""
    values = np.full((60, 80, 3), (40, 95, 160), np.uint8)
    values[:20] = 120, 140, 80
    return values + np.random.default_rng(0).integers(0, 9, values.shape).astype(np.uint8)


def _pictures(folder: Path, sources: Path) -> list[Seed]:
    """PNG pictures with a world file and a projection."""
    pictures = {"made": _picture()}
    real = SHARED / "maps" / "whitsunday_hook_passage.png"
    if real.is_file():
        with Image.open(real) as opened:
            pictures["real"] = np.asarray(opened.convert("RGB").crop((300, 300, 400, 400)))
    placed = {"chart.pgw": "0.002\n0\n0\n-0.002\n148.9\n-20.28\n", "chart.prj": "EPSG:4326"}
    changed = "chart.png", "chart.png", "chart.pgw", "chart.prj"
    return [
        _put(folder, name, {"chart.png": Image.fromarray(values).save} | placed, changed)
        for name, values in pictures.items()
    ]


_PLACE: dict[str, Any] = {"corner": (148.9, -20.28), "scale": (0.002, 0.002), "compress": "deflate"}


def _tiffs(folder: Path, sources: Path) -> list[Seed]:
    values = _picture()
    rasters = {"colour": values, "classes": (values[..., 0] < 80).astype(np.uint8)}
    return [
        _put(folder, name, {"chart.tif": lambda path, array=array: write_geotiff(path, array, **_PLACE)})
        for name, array in rasters.items()
    ]


def _read_tiff(path: Path) -> object:
    classes = {0: 0.0, 1: 1.0} if path.parent.name == "classes" else None
    geo.pixel_size(path)
    return chart_from_raster(path, _site(), **_box(), classes=classes)


def _land(folder: Path, sources: Path) -> list[Seed]:
    """Polygons as GeoJSON, and as what else GDAL writes."""
    own = sources / "example" / "whitsunday_coast.geojson"
    world = SHARED / "elsewhere" / "natural_earth_110m_land.geojson"
    seeds = _copied("land.geojson", own, world)(folder, sources)
    if find_spec("pyogrio") is None:
        return seeds
    from pyogrio import raw

    shapes = [shapely.geometry.shape(one["geometry"]) for one in json.loads(own.read_text())["features"]]
    shapes = [part for shape in shapes for part in shapely.get_parts(shape)]
    names = np.asarray([f"part {k}" for k in range(len(shapes))], object)
    geometry = shapely.to_wkb(np.asarray(shapes, object))
    how = {"field_data": [names], "fields": ["name"], "geometry_type": "Polygon", "crs": "EPSG:4326"}
    for suffix in ("gpkg", "shp", "fgb"):
        main = f"land.{suffix}"
        _put(folder, suffix, {main: lambda path: raw.write(path, geometry=geometry, **how)})
        seeds.append(Seed(suffix, main, tuple(sorted(path.name for path in (folder / suffix).iterdir()))))
    return seeds


def _cells(folder: Path, sources: Path) -> list[Seed]:
    """A cell with land, depth areas, a wreck, a rock and a prohibited area, and an update of it."""
    west, south, east, north = 148.85, -20.45, 149.1, -20.2
    bay = shapely.box(west, south, east, north)
    objects = [
        Object("M_COVR", bay, {"CATCOV": 1}),
        Object("LNDARE", shapely.box(148.9, -20.4, 148.92, -20.38)),
        Object("DEPARE", shapely.box(west, south, 148.93, north), {"DRVAL1": 2, "DRVAL2": 5}),
        Object("DEPARE", shapely.box(148.93, south, east, north), {"DRVAL1": 20, "DRVAL2": 50}),
        Object("WRECKS", shapely.Point(148.96, -20.34), {"VALSOU": 12.5, "CATWRK": 1}),
        Object("UWTROC", shapely.Point(148.97, -20.35), {"WATLEV": 3}),
        Object("RESARE", shapely.box(149.0, -20.3, 149.02, -20.28), {"RESTRN": 7}),
    ]
    more = [Object("OBSTRN", shapely.Point(148.98, -20.33), {"VALSOU": 7}, number=99)]
    files = {
        "AU5WHIT1.000": lambda path: write_cell(path, objects),
        "AU5WHIT1.001": lambda path: write_cell(path, more, update=1, first=1000),
    }
    return [_put(folder, "cell", files, tuple(files))]


def _read_closed(path: Path) -> object:
    box = _box()
    zones = read_zones(path, _site(), lower=box["lower"], upper=box["upper"])
    return closures_of(zones, _site(), **box, margin=60.0, until=10_800.0)


def _beds(folder: Path, sources: Path) -> list[Seed]:
    places = Path("example/bathymetry.nc"), SHARED / "elsewhere" / "etopo60_rose.nc"
    values = -np.linspace(0.0, 60.0, 60 * 80).reshape(60, 80).astype(np.float32)
    write = partial(write_geotiff, values=values, band={"units": "m"}, **_PLACE)
    return [*_copied("bed.nc", *places)(folder, sources), _put(folder, "tiff", {"bed.tif": write})]


def _currents(folder: Path, sources: Path) -> list[Seed]:
    places = Path("example/current.nc"), *(SHARED / name for name in _CURRENTS)
    return _copied("current.nc", *places)(folder, sources)


def _read_currents(path: Path) -> object:
    """The summary and some values, and the box of the example where that is what the file is of."""
    with open_ocean([path]) as ocean:
        summary_of(ocean)
    if path.parent.name == "0":
        lower, upper = (np.asarray(corner, float) for corner in _sea().box)
        return ap.read_current([path], _site(), lower=lower, upper=upper, times=(0.0, 7200.0))
    return None


def _tides(folder: Path, sources: Path) -> list[Seed]:
    tide = sources / "times" / "tide.yaml"
    stated = yaml.safe_load(tide.read_text(encoding="utf-8"))
    one = {name: stated.pop(name) for name in ("constituents", "mean") if name in stated}
    places = [
        {"longitude": longitude, "latitude": latitude, **one}
        for longitude, latitude in ((148.95, -20.33), (148.97, -20.35))
    ]
    text = yaml.safe_dump(stated | {"places": json.loads(json.dumps(places))})
    return [_put(folder, "0", {"tide.yaml": tide}), _put(folder, "places", {"tide.yaml": text})]


def _design() -> Design:
    sweeps = (Sweep.parse("vehicle.speed=2,2.5"),)
    return Design(ap.Scenario.model_validate({"chart": {"source": "none"}}), 2, 0, sweeps)


def _studies(folder: Path, sources: Path) -> list[Seed]:
    """A study that is finished, and one that is not."""
    design, row = _design(), row_of(restore_run(sources / "sample"))
    seeds = []
    for name in ("finished", "unfinished"):
        store = Store(folder / name, design)
        for task in design.tasks:
            store.add(*task, row)
        if name == "finished":
            dataset = table(design, store.rows(), None)
            store.finish(dataset, summarise(dataset))
        files = [path for path in sorted((folder / name).rglob("*")) if path.is_file()]
        seeds.append(Seed(name, ".", tuple(str(path.relative_to(folder / name)) for path in files)))
    return seeds


def _read_study(folder: Path) -> object:
    store = Store(folder, _design(), resume=True)
    if not store.finished:
        design = store.design
        return [store.add(*task, row) for task, row in zip(design.tasks, store.rows(), strict=False)]
    dataset = load_study(folder)
    summarise(dataset)
    return study_data(dataset, None, [])


def _in_folder(folder: Path, name: str, files: Mapping[str, Any], *more: str) -> Seed:
    """A seed whose reader is given the folder."""
    return Seed(_put(folder, name, files).name, ".", (*files, *more))


def _runs(folder: Path, sources: Path) -> list[Seed]:
    return [
        _in_folder(folder, name, {file: sources / name / file for file in (SUMMARY, RUN)}, RUN, RUN)
        for name in ("sample", "planned")
        if (sources / name).is_dir()
    ]


def _departures(folder: Path, sources: Path) -> list[Seed]:
    stated = {"scenario": _sea().model_dump(mode="json"), "seed": 0, "notes": [], "files": [], "versions": {}}
    return [_in_folder(folder, "table", {DEPARTURES: _DEPARTURES, DEPARTED: json.dumps(stated)})]


def _notices(folder: Path, sources: Path) -> list[Seed]:
    text = "".join(json.dumps(line) + "\n" for line in _LINES)
    return [_put(folder, "lines", {"notices.jsonl": text})]


def _plan() -> str:
    """A mission of QGroundControl with waypoints and a survey."""
    items: list[dict[str, Any]] = [
        {"type": "SimpleItem", "command": 16, "frame": 3, "params": [30, 0, 0, None, -20.33, 148.95, -5]},
        {
            "type": "ComplexItem",
            "complexItemType": "survey",
            "TransectStyleComplexItem": {"VisualTransectPoints": [[-20.33, 148.95], [-20.34, 148.95]]},
        },
    ]
    mission = {"version": 2, "plannedHomePosition": [-20.33, 148.95, 0], "items": items}
    return json.dumps({"fileType": "Plan", "version": 1, "mission": mission})


def _read_jobs(path: Path) -> object:
    slack = 0.1 + 0.5 * np.sin(np.arange(1000.0) / 60.0) ** 2
    return geo.read_jobs(
        path, _site(), until=10_800.0, speed=lambda place, times: slack[(times / 60.0).astype(int) % 1000]
    )


_JOBS = {"csv": (DATA / "tide" / "jobs.csv").read_text("utf-8"), "gpx": _GPX, "kml": _KML, "plan": _plan()}

READERS: dict[str, Reader] = {
    "scenario": Reader(_copied("scenario.yaml", *_SCENARIOS), read_scenario, names=True),
    "scenario and its files": Reader(_folders, examine_scenario, names=True),
    "jobs, GeoJSON": Reader(
        _copied("jobs.geojson", DATA / "example" / "jobs.geojson", Path("exports/itinerary.geojson")),
        _read_jobs,
    ),
    **{f"jobs, {kind.upper()}": Reader(_stated(kind, text), _read_jobs) for kind, text in _JOBS.items()},
    "jobs, KMZ": Reader(_kmz, _read_jobs),
    "closed areas": Reader(
        _copied("no_go.geojson", *(DATA / name / "no_go.geojson" for name in ("example", "tide"))),
        _read_closed,
    ),
    "obstacles": Reader(
        _copied("obstacles.geojson", DATA / "example" / "obstacles.geojson"),
        lambda path: geo.read_obstacles(path, _site()),
    ),
    "land": Reader(_land, lambda path: chart_from_polygons(path, _site(), **_box(), fringe=60.0)),
    "chart, S-57": Reader(_cells, lambda path: read_cells(path, _site(), **_box(), deepest=40.0)),
    "chart, PNG": Reader(_pictures, lambda path: chart_from_raster(path, _site(), **_box())),
    "chart, GeoTIFF": Reader(_tiffs, _read_tiff),
    "picture": Reader(_pictures, classify_file),
    "bathymetry": Reader(_beds, lambda path: geo.read_bathymetry(path, _site(), **_box())),
    "currents": Reader(_currents, _read_currents),
    "tides": Reader(_tides, lambda path: read_tide(path, _site(), 10_800.0)),
    "study": Reader(_studies, _read_study),
    "saved run": Reader(_runs, restore_run, names=True),
    "saved run, checked": Reader(_runs, check_run, names=True),
    "departures": Reader(_departures, lambda path: departures_data(*read_departures(path))),
    "notices": Reader(_notices, lambda path: list(NoticeFile(path, _site()).read())),
}
