"""Plans among closed areas, islands and jobs in one place, against exhaustive search over paths round them.

`python -m benchmarks.detours --cases 30 --first 7000`. Each case is a folder of files as an operator writes
them, in a tide off Hobart, Tasmania. The optimum is worked out beside the package: shortest paths over the
corners of the areas, widened by the clearance (shapely), timed along the tide in steps, and every sequence
of jobs by dynamic programming.
"""

import csv
import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import shapely
import xarray as xr
import yaml
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.executive.planning import load_area_at, plan_scenario
from auvplan.export import export, itinerary_of
from auvplan.io import save_run
from auvplan.io.restore import restore_run
from auvplan.mission.travel_times import TURN_TO
from auvplan.ocean.currents import evaluated
from auvplan.records import MissionRun
from auvplan.report.run import run_data
from auvplan.site import Site
from auvplan.view.sheet import sheet_of
from benchmarks.harness import launch

#: Off Hobart, in Storm Bay.
SITE = Site(147.55, -43.12)
HALF, SPEED, COAST = 4000.0, 1.5, 20.0
#: MAVLink's command of a waypoint, and m within which a waypoint in a file is that of the plan.
NAV_WAYPOINT, PLACE = 16, 0.05
#: Degrees, m/s east and north, and Greenwich phases of the tide.
TIDE = {"M2": (0.12, 0.22, 40.0), "K1": (0.03, 0.06, 100.0)}
Array = NDArray[np.floating]


@dataclass(frozen=True)
class Case:
    """A day's work.

    Attributes:
        jobs: name to (place [2] m north and east, priority, seconds).
        closed, islands: outlines [n, 2] m north and east, by name.
        obstacles: [n, 3] north, east and radius, m.
        start, goal: [2] m.
        available: s.
    """

    jobs: dict[str, tuple[Array, int, int]]
    closed: dict[str, Array]
    islands: dict[str, Array]
    obstacles: Array
    start: Array
    goal: Array
    available: int


def hobart() -> Case:
    """Seven jobs about a closed area of 1.6 x 2.2 km in open water, past two known obstacles."""
    north, east = (-1500, 300, 1900, 900, -300, -1600, -2800), (-1300, -1100, -400, 1000, 1500, 700, 2200)
    places, worth = zip(north, east, strict=True), [5, 4, 3, 4, 3, 4, 3]
    jobs = {
        f"station {k}": (np.array(place, float), rho, 180)
        for k, (place, rho) in enumerate(zip(places, worth, strict=True), 1)
    }
    area = np.array([(-1100, -800), (1100, -800), (1100, 800), (-1100, 800)], float)
    obstacles = np.array([(1400.0, -700.0, 60.0), (-900.0, 1150.0, 45.0)])
    ends = np.array([(-3200.0, -600.0), (-3100.0, 200.0)])
    return Case(jobs, {"exercise area": area}, {}, obstacles, *ends, 11_600)


def drawn(seed: int) -> Case:
    """A random case: one to four closed areas, up to two islands, up to two jobs in the place of another."""
    rng = np.random.default_rng(seed)
    blocks: list[Array] = []
    wanted = int(rng.integers(1, 5)), int(rng.integers(0, 3))
    while len(blocks) < sum(wanted):
        middle, size = rng.uniform(-2600.0, 2600.0, 2), rng.uniform(300.0, 1100.0, 2)
        turn, corners = rng.uniform(0.0, np.pi), int(rng.integers(4, 8))
        angle = turn + np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
        ring = middle + size * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        if all(shapely.distance(shapely.Polygon(ring), shapely.Polygon(other)) > 300.0 for other in blocks):
            blocks.append(ring)
    shapes = shapely.union_all([shapely.Polygon(ring) for ring in blocks])
    places: list[Array] = []
    while len(places) < 9:
        place = rng.uniform(-3500.0, 3500.0, 2)
        apart = min((float(np.hypot(*(place - other))) for other in places), default=np.inf)
        if shapely.distance(shapes, shapely.Point(place)) > 150.0 and apart > 500.0:
            places.append(np.round(place, 1))
    jobs = {
        f"job {k}": (place, int(rng.integers(1, 6)), int(rng.integers(1, 6)) * 60)
        for k, place in enumerate(places[2:], 1)
    }
    for k in range(int(rng.integers(1, 3))):
        place = places[2 + int(rng.integers(7))]
        jobs[f"again {k + 1}"] = place, int(rng.integers(1, 6)), int(rng.integers(1, 6)) * 60
    closed = {f"area {k}": ring for k, ring in enumerate(blocks[: wanted[0]], 1)}
    islands = {f"island {k}": ring for k, ring in enumerate(blocks[wanted[0] :], 1)}
    available = int(rng.uniform(6000.0, 16_000.0))
    return Case(jobs, closed, islands, np.zeros((0, 3)), places[0], places[1], available)


def written(case: Case, folder: Path) -> Path:
    """Write a case as a scenario and its files; return the scenario's path."""
    folder.mkdir(parents=True, exist_ok=True)

    def at(place: Array) -> list[float]:
        longitude, latitude = SITE.to_geographic(place[0], place[1])
        return [round(float(longitude), 7), round(float(latitude), 7)]

    def collection(name: str, parts: list[tuple[dict, dict]]) -> str:
        features = [{"type": "Feature", "properties": stated, "geometry": shape} for stated, shape in parts]
        (folder / name).write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        return name

    def areas(name: str, rings: dict[str, Array]) -> str:
        parts = []
        for each, ring in rings.items():
            outline = [at(place) for place in [*ring, ring[0]]]
            parts.append(({"name": each}, {"type": "Polygon", "coordinates": [outline]}))
        return collection(name, parts)

    jobs = []
    for name, (place, rho, stay) in case.jobs.items():
        stated = {"name": name, "priority": rho, "duration": stay, "depth": 10}
        jobs.append((stated, {"type": "Point", "coordinates": at(place)}))
    collection("jobs.geojson", jobs)
    chart: dict = {"source": "none", "pixel_size": 20}
    if case.islands:
        chart |= {"source": "polygons", "file": areas("coast.geojson", case.islands)}
    tide = TIDE.items()
    constituents = {name: {"u": [u, phase], "v": [v, phase]} for name, (u, v, phase) in tide}
    (folder / "tide.yaml").write_text(yaml.safe_dump({"source": "made up", "constituents": constituents}))
    content = {
        "name": "detours",
        "site": {
            "longitude": SITE.longitude, "latitude": SITE.latitude, "departure": "2026-03-10T21:00:00Z",
            "timezone": "Australia/Hobart",
        },
        "area": {"lower": [-HALF, -HALF, 0], "upper": [HALF, HALF, 30]},
        "chart": chart | {"no_go": areas("no_go.geojson", case.closed)},
        "vehicle": {"speed": SPEED, "surge_max": 3.0, "sway_max": 1.4},
        "current": {"source": "harmonic", "constituents": "tide.yaml"},
        "safety": {"coast": COAST, "obstacles": 10},
        "simulation": {"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
        "mission": {
            "jobs": "jobs.geojson",
            "start": [*case.start.tolist(), 5.0], "goal": [*case.goal.tolist(), 5.0],
            "time_available": case.available,
        },
        "planning": {"return_margin": 0.0, "reserve": 0.0},
    }  # fmt: skip
    if len(case.obstacles):
        known = [({"radius": row[2]}, {"type": "Point", "coordinates": at(row)}) for row in case.obstacles]
        content["obstacles"] = {"file": collection("obstacles.geojson", known)}
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False))
    return path


def shortest_paths(case: Case, places: Array) -> dict[tuple[int, int], Array]:
    """Shortest polylines [K, 2] m between all pairs of places [N, 2], over corners of what is in the way."""
    rings = [*case.closed.values(), *case.islands.values()]
    widened = [shapely.buffer(shapely.Polygon(ring), COAST, quad_segs=4) for ring in rings]
    shapes = shapely.union_all(widened)
    corners = np.concatenate([shapely.get_coordinates(part)[:-1] for part in shapely.get_parts(shapes)])
    nodes, inner = np.concatenate([places, corners]), shapely.buffer(shapes, -0.05)
    shapely.prepare(inner)
    i, j = np.triu_indices(len(nodes), 1)
    clear = ~shapely.intersects(inner, shapely.linestrings(np.stack([nodes[i], nodes[j]], axis=1)))
    length = np.where(clear, np.maximum(np.hypot(*(nodes[j] - nodes[i]).T), 1e-9), 0.0)
    graph = csr_array((length[clear], (i[clear], j[clear])), shape=(len(nodes),) * 2)
    count = len(places)
    _, before = dijkstra(graph, directed=False, indices=np.arange(count), return_predecessors=True)
    found = {}
    for start, goal in np.ndindex(count, count):
        way = [goal]
        while way[-1] != start:
            way.append(int(before[start, way[-1]]))
        found[start, goal] = nodes[way[::-1]]
    return found


def seconds_along(path: Array, depart: float, stream: Callable[[float], Array]) -> float:
    """Time along a polyline in a stream that is the same everywhere, by steps of 50 m."""
    now = depart
    for begin, end in pairwise(path):
        way = float(np.hypot(*(end - begin)))
        for _ in range(steps := int(np.ceil(way / 50.0))):
            ahead, water = (end - begin) / way, stream(now)
            along = float(water @ ahead)
            across = float(np.hypot(*(water - along * ahead)))
            now += way / steps / (along + np.sqrt(SPEED**2 - across**2))
    return now - depart


def optimum(case: Case, stream: Callable[[float], Array]) -> tuple[float, float]:
    """Most priority that can be had in time, and the least time in which it can."""
    stops = list(case.jobs.values())
    places = np.array([case.start, *(place for place, _, _ in stops), case.goal])
    count, final = len(stops), len(places) - 1
    moments = np.arange(0.0, case.available + 1200.0, 600.0)
    lasts = {
        pair: np.array([max(seconds_along(path, moment, stream), TURN_TO) for moment in moments])
        for pair, path in shortest_paths(case, places).items()
        if pair[0] != pair[1] and pair[0] != final and pair[1] != 0
    }
    soonest, best = {(0, 0): 0.0}, (0.0, np.inf)
    for _ in range(count + 1):
        onward: dict[tuple[int, int], float] = {}
        for (done, here), now in soonest.items():
            home = now + float(np.interp(now, moments, lasts[here, final]))
            worth = float(sum(stops[k][1] for k in range(count) if done >> k & 1))
            if home < case.available and (worth > best[0] or (worth == best[0] and home < best[1])):
                best = worth, home
            for k in range(count):
                if not done >> k & 1:
                    then = now + float(np.interp(now, moments, lasts[here, k + 1])) + stops[k][2]
                    key = done | 1 << k, k + 1
                    if then < min(onward.get(key, np.inf), case.available):
                        onward[key] = then
        soonest = onward
    return best


def waypoints_in_files(folder: Path, site: Site) -> dict[str, Array]:
    """Waypoints as the vehicle's files of a plan have them, by format.

    Returns:
        [n, 5] each: m north, east and deep, s since the departure, s of the task; NaN for what is not told.
    """

    def row(longitude: Any, latitude: Any, depth: Any, time: str | None, hold: Any = np.nan) -> list[float]:
        north, east = site.to_local(float(longitude), float(latitude))
        seconds = np.nan
        if time and site.epoch is not None:
            seconds = (datetime.fromisoformat(time) - site.epoch).total_seconds()
        return [float(north), float(east), float(depth), seconds, float(hold)]

    found: dict[str, list[list[float]]] = {}
    with (folder / "itinerary.csv").open(newline="") as file:
        names = ("lon", "lat", "depth", "time", "hold")
        found["csv"] = [row(*(each[name] for name in names)) for each in csv.DictReader(file)]
    found["geojson"] = []
    for each in json.loads((folder / "itinerary.geojson").read_text())["features"]:
        stated, place = each["properties"], each["geometry"]["coordinates"][:2]
        if stated["kind"] == "waypoint":
            found["geojson"].append(row(*place, stated["depth_m"], stated["time"], stated["hold_s"]))
    found["gpx"] = []
    for each in ElementTree.parse(folder / "itinerary.gpx").iterfind(".//{*}rtept"):
        depth = -float(each.findtext("{*}ele", "nan"))
        found["gpx"].append(row(each.get("lon"), each.get("lat"), depth, each.findtext("{*}time")))
    items = json.loads((folder / "itinerary.plan").read_text())["mission"]["items"]
    params = (item["params"] for item in items if item["command"] == NAV_WAYPOINT)
    found["qgc"] = [row(each[5], each[4], -each[6], None, each[0]) for each in params]
    found["kml"] = []
    for track in ElementTree.parse(folder / "itinerary.kml").iterfind(".//{*}Track"):
        longitude, latitude, height = track.findall("{*}coord")[-1].text.split()
        found["kml"].append(row(longitude, latitude, -float(height), track.findall("{*}when")[-1].text))
    with xr.open_dataset(folder / "itinerary.nc") as data:
        ends = data["row_size"].values.cumsum() - 1
        moments = np.datetime_as_string(data["time"].values[ends], unit="ms", timezone="UTC")
        places = (data[name].values[ends] for name in ("lon", "lat", "depth"))
        found["netcdf"] = [row(*each) for each in zip(*places, moments, strict=True)]
    return {name: np.array(rows) for name, rows in found.items()}


def disagreements(run: MissionRun, folder: Path) -> list[str]:
    """Say where plan, sheet, page and exports of a plan do not have the same figures.

    Args:
        folder: that `auvplan plan` wrote it to.
    """
    assert run.site is not None
    summary = json.loads((folder / "summary.json").read_text())
    sheet = summary["sheet"]
    page = run_data(restore_run(folder), summary)
    stops = [stop for stop in sheet["stops"] if stop["task"]]
    done = [task for task in page["tasks"] if task["done"]]
    legs = run.earning
    found = []

    def same(what: str, values: Sequence[float], others: Sequence[float], within: float) -> None:
        near = partial(np.allclose, rtol=0.0, atol=within, equal_nan=True)
        if len(values) != len(others) or not near(values, others):
            found.append(f"{what}: {[*map(float, values)]} and {[*map(float, others)]}")

    total = float(sum(leg.priority for leg in legs))
    for name, other in (("summary", summary), ("page", page["figures"])):
        same(f"priority, {name}", [total], [other["total_priority"]], 1e-6)
        same(f"tasks, {name}", [len(legs)], [other["tasks"]], 0.0)
        same(f"time, {name}", [run.t_mission], [other["t_mission"]], 0.01)
    ends = [leg.t_wait + float(leg.times[-1]) for leg in legs]
    holds = [leg.t_wait + leg.t_task for leg in legs]
    places = np.array([run.graph.positions[leg.goal] for leg in legs])
    rho = [leg.priority for leg in legs]
    for where, rows, arrives in (("sheet", stops, "arrival"), ("page", done, "at")):
        same(f"arrivals, {where}", ends, [row[arrives] for row in rows], 0.01)
        same(f"priorities, {where}", rho, [row["priority"] for row in rows], 1e-6)
    same("holds, sheet", holds, [stop["wait"] + stop["hold"] for stop in stops], 0.01)
    same("depths, sheet", places[:, 2], [stop["depth"] for stop in stops], 0.01)
    for axis, values in enumerate(run.site.to_geographic(*places[:, :2].T)):
        same(f"axis {axis} of places, sheet", values, [stop["place"][axis] for stop in stops], 1e-6)
    onward = [leg.t_hold for leg in run.done[1:]] + [0.0]
    stays = [leg.t_wait + leg.t_task + more for leg, more in zip(run.done, onward, strict=True)]
    goals = [run.graph.positions[leg.goal] for leg in run.done]
    expected = np.column_stack([goals, [leg.times[-1] for leg in run.done], stays])
    for name, rows in waypoints_in_files(folder, run.site).items():
        at = -1
        for leg in expected:
            near = np.linalg.norm(rows[at + 1 :, :3] - leg[:3], axis=1) < PLACE
            if not near.any():
                found.append(f"{name}: no waypoint at {leg[:3].tolist()}")
                break
            at += 1 + int(np.argmax(near))
            given = ~np.isnan(rows[at, 3:])
            what = f"{name}, time and task at {leg[:3].tolist()}"
            same(what, leg[3:][given], rows[at, 3:][given], 0.06)
    limits = {row["name"]: row["least"] for row in page["limits"]}
    for name in ("coast", "closed", "obstacle"):
        least = [stop[name] for stop in sheet["stops"] if stop[name] is not None]
        if least or limits[name] is not None:
            same(f"least distance, {name}", [min(least, default=np.nan)], [limits[name]], 0.01)
    names = sorted(run.names[leg.goal] for leg in legs)
    left = sorted(job["name"] for job in sheet["left_out"])
    every = sorted(name for name in run.names[1:-1] if not name.startswith("(via"))
    if sorted(stop["task"] for stop in stops) != names or sorted(names + left) != every:
        found.append(f"jobs: {names} done, {left} left out")
    return found


@dataclass(frozen=True)
class Row:
    """How a plan fared; priority and time [s] beside the most, and the least for that, that can be had.

    Faults are what    Faults are what `auvplan check` finds, and figures that do not agree.
    """

    seed: int | None
    priority: float
    best: float
    time: float
    least: float
    faults: tuple[str, ...]


def planned(case: Case, seed: int | None, folder: Path) -> Row:
    path = written(case, folder)
    scenario = ap.load_scenario(str(path))
    area = load_area_at(scenario, [0.0], folder)
    run = plan_scenario(scenario, area=area, folder=folder)
    out = folder / "plan"
    save_run(run, out, sheet=sheet_of(run).plain())
    export(itinerary_of(run), out)
    every = np.arange(0.0, case.available + 2401.0, 300.0)
    water = np.stack(evaluated(area.forecast, 0.0 * every, 0.0 * every, 10.0 + 0.0 * every, every)[:2])
    best, least = optimum(case, lambda now: np.array([np.interp(now, every, axis) for axis in water]))
    faults = (*check_run(out).faults, *disagreements(run, out))
    return Row(seed, run.total_priority, best, run.t_mission, least, tuple(map(str, faults)))


def main(out: Path | None, cases: int, first: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        home, rows = out or Path(scratch), []
        for seed in (None, *range(first, first + cases)):
            case = hobart() if seed is None else drawn(seed)
            rows.append(planned(case, seed, home / f"case-{'hobart' if seed is None else seed}"))
            print(rows[-1], flush=True)
    hobart_, *own = rows
    equal, sound = sum(row.priority >= row.best for row in own), sum(not row.faults for row in own)
    apart = hobart_.time / hobart_.least - 1.0
    print(f"Hobart: {hobart_.priority:g} of {hobart_.best:g}, {apart:+.1%} in time")
    print(f"{equal} of {len(own)} have the priority of the optimum, {sound} are without faults")


if __name__ == "__main__":
    launch(
        main,
        out=(Path, "folder to keep the cases in"),
        cases=(30, "drawn ones"),
        first=(7000, "first seed"),
    )
