"""Plans among closed areas, islands and jobs in one place, against exhaustive search over paths round them.

`python -m benchmarks.detours --cases 30 --first 7000`. Each case is a folder of files as an operator writes
them, in a tide off Hobart, Tasmania. The optimum is worked out beside the package: shortest paths over the
corners of the areas, widened by the clearance (shapely), timed along the tide in steps, and every sequence
of jobs by dynamic programming.
"""

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

import auvplan as ap
from auvplan.check.run import check_run
from auvplan.executive.planning import load_area_at, plan_scenario
from auvplan.io import save_run
from auvplan.mission.travel_times import TURN_TO
from auvplan.ocean.currents import evaluated
from auvplan.scenario.scenario import Scenario
from benchmarks.harness import SCENARIOS, Array, launch

#: m/s through the water, and m that are kept from coast and closed areas.
SPEED, COAST = 1.5, 20.0


@dataclass(frozen=True)
class Case:
    jobs: dict[str, tuple[Array, int, int]]  # name to (place [2] m north and east, priority, seconds)
    closed: dict[str, Array]  # outlines [n, 2] m north and east, by name
    islands: dict[str, Array]  # outlines [n, 2] m north and east, by name
    obstacles: Array  # [n, 3] north, east and radius, m
    start: Array  # [2] m
    goal: Array  # [2] m
    available: int  # s


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


def posed(case: Case, folder: Path) -> Scenario:
    """Return a case as a scenario, whose files are written into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario = ap.load_scenario(SCENARIOS / "detours.yaml")
    assert scenario.site is not None
    site = scenario.site.site

    def at(place: Array) -> list[float]:
        return [round(float(degrees), 7) for degrees in site.to_geographic(place[0], place[1])]

    def point(place: Array) -> dict:
        return {"type": "Point", "coordinates": at(place)}

    def collection(name: str, parts: list[tuple[dict, dict]]) -> str:
        features = [{"type": "Feature", "properties": stated, "geometry": shape} for stated, shape in parts]
        (folder / name).write_text(json.dumps({"type": "FeatureCollection", "features": features}))
        return str(folder / name)

    def areas(name: str, rings: dict[str, Array]) -> str:
        outlines = {each: [at(place) for place in [*ring, ring[0]]] for each, ring in rings.items()}
        shapes = {each: {"type": "Polygon", "coordinates": [line]} for each, line in outlines.items()}
        return collection(name, [({"name": each}, shape) for each, shape in shapes.items()])

    jobs = [
        ({"name": name, "priority": rho, "duration": stay, "depth": 10}, point(place))
        for name, (place, rho, stay) in case.jobs.items()
    ]
    changes: dict[str, Any] = {
        "vehicle.speed": SPEED, "safety.coast": COAST, "mission.time_available": case.available,
        "chart.pixel_size": 20, "chart.no_go": areas("no_go.geojson", case.closed),
        "mission.jobs": collection("jobs.geojson", jobs),
        "mission.start": [*case.start.tolist(), 5.0], "mission.goal": [*case.goal.tolist(), 5.0],
    }  # fmt: skip
    if case.islands:
        changes |= {"chart.source": "polygons", "chart.file": areas("coast.geojson", case.islands)}
    if len(case.obstacles):
        known = [({"radius": row[2]}, point(row)) for row in case.obstacles]
        changes["obstacles.file"] = collection("obstacles.geojson", known)
    return scenario.with_(changes)


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


class Row(NamedTuple):
    """How a plan fared: priority and time [s] beside the best of each, and what `auvplan check` finds."""

    seed: int | None
    priority: float
    best: float
    time: float
    least: float
    faults: tuple[str, ...]


def planned(case: Case, seed: int | None, folder: Path) -> Row:
    scenario = posed(case, folder)
    area = load_area_at(scenario, [0.0])
    run = plan_scenario(scenario, area=area)
    out = folder / "plan"
    save_run(run, out)
    every = np.arange(0.0, case.available + 2401.0, 300.0)
    water = np.stack(evaluated(area.forecast, 0.0 * every, 0.0 * every, 10.0 + 0.0 * every, every)[:2])
    best, least = optimum(case, lambda now: np.array([np.interp(now, every, axis) for axis in water]))
    faults = tuple(map(str, check_run(out).faults))
    return Row(seed, run.total_priority, best, run.t_mission, least, faults)


@launch(out=(Path, "folder to keep the cases in"), cases=(30, "drawn ones"), first=(7000, "first seed"))
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
