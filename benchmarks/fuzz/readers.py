"""Every reader of files, for `benchmarks.fuzz`: real files to give it, and a call that reads one."""

import json
import shutil
import subprocess
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache, partial
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
from auvplan.io.geo.grid import Extent
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
from benchmarks.harness import AUVPLAN, SHARED
from tests.io.geo.enc_cells import Object, write_cell
from tests.io.geo.files import write_geotiff
from tests.io.sample_run import make_run

DATA = Path(__file__).resolve().parents[2] / "auvplan" / "data"
RUN = "mission.nc"
#: Small files of formats that have no real one.
SAMPLES = Path(__file__).with_name("samples")

#: Real files of currents, those of them that are small enough to be changed often.
_CURRENTS = (
    "currents/norkyst_v3_800m_5h.nc", "currents/rtofs_water_u_v_washington_64x3h.nc",
    "currents/cmems_glo12_uo_vo_northsea.nc", "elsewhere/ngofs_fvcom_small.nc",
    "elsewhere/creofs_selfe_noaa.nc",
)  # fmt: skip


@dataclass(frozen=True)
class Files:
    """A folder of real files."""

    # by name a text, a path - of the sources or the shared data where it is relative -, or a call that writes
    # it; the name "." stands for the folder
    files: Mapping[str, Any]
    main: str = ""  # what the reader is given; the first file if empty
    changed: tuple[str, ...] = ()  # patterns of files that are changed, one at a time; the main one if empty

    def write(self, folder: Path, sources: Path) -> "Seed | None":
        """Write them; None where what they come from is not there."""
        folder.mkdir(parents=True)
        main = self.main or next(iter(self.files))
        try:
            for name, content in self.files.items():
                path = folder / name
                if isinstance(content, str):
                    path.write_text(content, encoding="utf-8")
                elif isinstance(content, Path):
                    root = sources if (sources / content).exists() else SHARED
                    copy = partial(shutil.copytree, dirs_exist_ok=True) if name == "." else shutil.copy
                    copy(root / content, path)
                else:
                    content(path)
        except (FileNotFoundError, ModuleNotFoundError):
            shutil.rmtree(folder)
            return None
        changed = [path for pattern in self.changed or (main,) for path in sorted(folder.glob(pattern))]
        targets = tuple(str(path.relative_to(folder)) for path in changed if path.is_file())
        return Seed(folder.name, main, targets)


@dataclass(frozen=True)
class Seed:
    """A folder as it was written: what the reader is given, and the files that are changed."""

    name: str
    main: str
    targets: tuple[str, ...]


@dataclass(frozen=True)
class Reader:
    read: Callable[[Path], object]
    files: Mapping[str, Files]  # by the name of the folder
    names: bool = False  # whether its files may name others, anywhere

    def write(self, folder: Path, sources: Path) -> list[Seed]:
        """Write all that are there below a folder."""
        seeds = (files.write(folder / name, sources) for name, files in self.files.items())
        return [seed for seed in seeds if seed is not None]


def write_sources(folder: Path, planned: bool = True) -> None:
    """Write what several readers' files come from.

    Args:
        planned: whether the example is planned too, by the command, which compiles for a minute.
    """
    write_example(folder / "example")
    write_example_of_times(folder / "times")
    sample = make_run()
    place = {"longitude": 148.96, "latitude": -20.34}
    sample.scenario = ap.Scenario.model_validate({"site": place}).model_dump(mode="json")
    sample.names = ["alpha", "bravo", "charlie", "delta"]
    sample.site = ap.Site(*place.values(), None, (5000.0, 3000.0))
    sample.seabed = ap.Seabed.from_depth(np.full((40, 30), 300.0), 100.0, (-500.0, -400.0), clearance=7.0)
    ap.save_run(sample, folder / "sample")
    # Exports need what a file keeps of the run.
    ap.export_run(restore_run(folder / "sample"), folder / "exports")
    for name in ("finished", "unfinished"):
        _write_study(folder / name, folder / "sample", finished=name == "finished")
    if planned:
        scenario, out = folder / "example" / "scenario.yaml", folder / "planned"
        words = ["plan", str(scenario), "--out", str(out), "--pictures", "none", "--quiet"]
        subprocess.run([*AUVPLAN, *words], check=True)
        ap.export_run(restore_run(out), folder / "exports")


@cache
def _sea() -> ap.Scenario:
    """The shipped example, whose site and area files are read for."""
    return read_scenario(DATA / "example" / "scenario.yaml")


def _site() -> ap.Site:
    site = _sea().site
    assert site is not None
    return site.site


def _box(pixel_size: float | None = 20.0) -> Extent:
    lower, upper = (np.asarray(corner, float)[:2] for corner in _sea().box)
    return Extent(lower, upper, pixel_size)


def _zipped(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(SAMPLES / "jobs.kml", "doc.kml")


def _jobs(kind: str, *files: Any) -> dict[str, Files]:
    """Jobs in files, and what the export of the same format wrote."""
    every = *files, Path(f"exports/itinerary.{kind}")
    return {f"{number}": Files({f"jobs.{kind}": each}) for number, each in enumerate(every)}


def _read_jobs(path: Path) -> object:
    slack = 0.1 + 0.5 * np.sin(np.arange(1000.0) / 60.0) ** 2
    return geo.read_jobs(
        path, _site(), until=10_800.0, speed=lambda place, times: slack[(times / 60.0).astype(int) % 1000]
    )


def _picture() -> np.ndarray:
    """[rows, columns, 3] water and land with some noise."""
    values = np.full((60, 80, 3), (40, 95, 160), np.uint8)
    values[:20] = 120, 140, 80
    return values + np.random.default_rng(0).integers(0, 9, values.shape).astype(np.uint8)


def _real_picture(path: Path) -> None:
    with Image.open(SHARED / "maps" / "whitsunday_hook_passage.png") as opened:
        opened.convert("RGB").crop((300, 300, 400, 400)).save(path)


def _placed(picture: Any) -> Files:
    """A PNG picture with a world file and a projection."""
    placed = {"chart.pgw": "0.002\n0\n0\n-0.002\n148.9\n-20.28\n", "chart.prj": "EPSG:4326"}
    return Files({"chart.png": picture} | placed, changed=("chart.png", "chart.*"))


def _geotiff(values: np.ndarray, **more: Any) -> Callable[[Path], object]:
    where = {"corner": (148.9, -20.28), "scale": (0.002, 0.002), "compress": "deflate"}
    return lambda path: write_geotiff(path, values, **where, **more)


def _read_tiff(path: Path) -> object:
    classes = {0: 0.0, 1: 1.0} if path.parent.name == "classes" else None
    geo.pixel_size(path)
    return chart_from_raster(path, _site(), _box(), classes=classes)


def _write_vectors(path: Path) -> None:
    """Write the example's coast by the driver of GDAL that the name asks for."""
    from pyogrio import raw

    features = json.loads((DATA / "whitsunday_coast.geojson").read_text())["features"]
    shapes = shapely.get_parts([shapely.geometry.shape(one["geometry"]) for one in features])
    names = np.asarray([f"part {k}" for k in range(len(shapes))], object)
    how = {"field_data": [names], "fields": ["name"], "geometry_type": "Polygon", "crs": "EPSG:4326"}
    raw.write(path, geometry=shapely.to_wkb(shapes), **how)


def _write_cell(path: Path) -> None:
    """Write a cell with land, depth areas, a wreck, a rock and a prohibited area, or an update of it."""
    if path.suffix == ".001":
        more = [Object("OBSTRN", shapely.Point(148.98, -20.33), {"VALSOU": 7}, number=99)]
        write_cell(path, more, update=1, first=1000)
        return
    west, south, east, north = 148.85, -20.45, 149.1, -20.2
    write_cell(path, [
        Object("M_COVR", shapely.box(west, south, east, north), {"CATCOV": 1}),
        Object("LNDARE", shapely.box(148.9, -20.4, 148.92, -20.38)),
        Object("DEPARE", shapely.box(west, south, 148.93, north), {"DRVAL1": 2, "DRVAL2": 5}),
        Object("DEPARE", shapely.box(148.93, south, east, north), {"DRVAL1": 20, "DRVAL2": 50}),
        Object("WRECKS", shapely.Point(148.96, -20.34), {"VALSOU": 12.5, "CATWRK": 1}),
        Object("UWTROC", shapely.Point(148.97, -20.35), {"WATLEV": 3}),
        Object("RESARE", shapely.box(149.0, -20.3, 149.02, -20.28), {"RESTRN": 7}),
    ])  # fmt: skip


def _read_currents(path: Path) -> object:
    """The summary and some values, and the box of the example where that is what the file is of."""
    with open_ocean([path]) as ocean:
        summary_of(ocean)
    if path.parent.name == "example":
        lower, upper = (np.asarray(corner, float) for corner in _sea().box)
        return ap.read_current([path], _site(), lower=lower, upper=upper, times=(0.0, 7200.0))
    return None


def _write_places(path: Path) -> None:
    """Write the constituents of the example of times at two places."""
    stated = yaml.safe_load((DATA / "tide" / "tide.yaml").read_text(encoding="utf-8"))
    one = {name: stated.pop(name) for name in ("constituents", "mean") if name in stated}
    places = (148.95, -20.33), (148.97, -20.35)
    stated["places"] = [json.loads(json.dumps({"longitude": x, "latitude": y} | one)) for x, y in places]
    path.write_text(yaml.safe_dump(stated), encoding="utf-8")


def _design() -> Design:
    sweeps = (Sweep.parse("vehicle.speed=2,2.5"),)
    return Design(ap.Scenario.model_validate({"chart": {"source": "none"}}), 2, 0, sweeps)


def _write_study(folder: Path, run: Path, finished: bool) -> None:
    design, row = _design(), row_of(restore_run(run))
    store = Store(folder, design)
    for task in design.tasks:
        store.add(*task, row)
    if finished:
        dataset = table(design, store.rows(), None)
        store.finish(dataset, summarise(dataset))


def _read_study(folder: Path) -> object:
    store = Store(folder, _design(), resume=True)
    if not store.finished:
        design = store.design
        return [store.add(*task, row) for task, row in zip(design.tasks, store.rows(), strict=False)]
    dataset = load_study(folder)
    summarise(dataset)
    return study_data(dataset, None, [])


def _write_departed(path: Path) -> None:
    stated = {"scenario": _sea().model_dump(mode="json"), "seed": 0, "notes": [], "files": [], "versions": {}}
    path.write_text(json.dumps(stated), encoding="utf-8")


def _each(file: str, paths: Mapping[str, Path]) -> dict[str, Files]:
    """Folders of one file each, under the same name."""
    return {name: Files({file: path}) for name, path in paths.items()}


_SCENARIOS = *sorted((DATA / "scenarios").glob("*.yaml")), *sorted(DATA.glob("[et]*/scenario.yaml"))
_EXAMPLE, _TIMES = DATA / "example", DATA / "tide"
_PICTURES = {"made": _placed(Image.fromarray(_picture()).save), "real": _placed(_real_picture)}
_BED = -np.linspace(0.0, 60.0, 60 * 80).reshape(60, 80).astype(np.float32)
_RUNS = {name: Files({".": Path(name)}, changed=(RUN, RUN, SUMMARY)) for name in ("sample", "planned")}

READERS: dict[str, Reader] = {
    "scenario": Reader(
        read_scenario, _each("scenario.yaml", {f"{k}": path for k, path in enumerate(_SCENARIOS)}), names=True
    ),
    "scenario and its files": Reader(
        examine_scenario,
        {name: Files({".": Path(name)}, "scenario.yaml", ("*.[!m]*",)) for name in ("example", "times")},
        names=True,
    ),
    "jobs, GeoJSON": Reader(_read_jobs, _jobs("geojson", _EXAMPLE / "jobs.geojson")),
    "jobs, CSV": Reader(_read_jobs, _jobs("csv", _TIMES / "jobs.csv")),
    "jobs, GPX": Reader(_read_jobs, _jobs("gpx", SAMPLES / "jobs.gpx")),
    "jobs, KML": Reader(_read_jobs, _jobs("kml", SAMPLES / "jobs.kml")),
    "jobs, PLAN": Reader(_read_jobs, _jobs("plan", SAMPLES / "jobs.plan")),
    "jobs, KMZ": Reader(_read_jobs, {"zip": Files({"jobs.kmz": _zipped})}),
    "closed areas": Reader(
        lambda path: closures_of(
            read_zones(path, _site(), _box(None)), _site(), _box(), margin=60.0, until=10_800.0
        ),
        _each("no_go.geojson", {"0": _EXAMPLE / "no_go.geojson", "1": _TIMES / "no_go.geojson"})
    ),
    "obstacles": Reader(
        lambda path: geo.read_obstacles(path, _site()),
        _each("obstacles.geojson", {"0": _EXAMPLE / "obstacles.geojson"}),
    ),
    "land": Reader(lambda path: chart_from_polygons(path, _site(), _box(), fringe=60.0), {
        "0": Files({"land.geojson": DATA / "whitsunday_coast.geojson"}),
        "1": Files({"land.geojson": Path("elsewhere/natural_earth_110m_land.geojson")}),
        **{kind: Files({f"land.{kind}": _write_vectors}, changed=("*",)) for kind in ("gpkg", "shp", "fgb")},
    }),
    "chart, S-57": Reader(
        lambda path: read_cells(path, _site(), _box(), deepest=40.0),
        {"cell": Files(dict.fromkeys(("AU5WHIT1.000", "AU5WHIT1.001"), _write_cell), changed=("*",))},
    ),
    "chart, PNG": Reader(lambda path: chart_from_raster(path, _site(), _box()), _PICTURES),
    "chart, GeoTIFF": Reader(_read_tiff, {
        "colour": Files({"chart.tif": _geotiff(_picture())}),
        "classes": Files({"chart.tif": _geotiff((_picture()[..., 0] < 80).astype(np.uint8))}),
    }),
    "picture": Reader(classify_file, _PICTURES),
    "bathymetry": Reader(
        lambda path: geo.read_bathymetry(path, _site(), _box()),
        _each("bed.nc", {"0": Path("example/bathymetry.nc"), "1": Path("elsewhere/etopo60_rose.nc")})
        | {"tiff": Files({"bed.tif": _geotiff(_BED, band={"units": "m"})})},
    ),
    "currents": Reader(
        _read_currents,
        _each("current.nc", {"example": Path("example/current.nc")}
              | {f"{k}": Path(name) for k, name in enumerate(_CURRENTS)}),
    ),
    "tides": Reader(lambda path: read_tide(path, _site(), 10_800.0), {
        "0": Files({"tide.yaml": _TIMES / "tide.yaml"}), "places": Files({"tide.yaml": _write_places}),
    }),
    "study": Reader(_read_study, {
        name: Files({".": Path(name)}, changed=("**/*",)) for name in ("finished", "unfinished")
    }),
    "saved run": Reader(restore_run, _RUNS, names=True),
    "saved run, checked": Reader(check_run, _RUNS, names=True),
    "departures": Reader(
        lambda path: departures_data(*read_departures(path)),
        {"table": Files({DEPARTURES: SAMPLES / DEPARTURES, DEPARTED: _write_departed}, ".", ("*",))},
    ),
    "notices": Reader(
        lambda path: list(NoticeFile(path, _site()).read()),
        _each("notices.jsonl", {"lines": SAMPLES / "notices.jsonl"}),
    ),
}  # fmt: skip
