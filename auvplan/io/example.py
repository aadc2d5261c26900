"""First scenarios to change: packaged ones with the files that they name, and one at any coast there is."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import shapely
from numpy.typing import NDArray
from pyproj import Geod
from shapely.affinity import translate
from shapely.geometry import Polygon

from auvplan.errors import ScenarioError
from auvplan.io.geo.grid import to_local
from auvplan.runtime.files import OutputError, output_folder, write_atomically
from auvplan.site import Site

#: Name of the scenario's own file in the folder.
SCENARIO = "scenario.yaml"
_DATA = files("auvplan") / "data"
#: Files of the example of times, and of the plain one: its coast is real, tide and sea bed are made up.
_TIMES = (SCENARIO, "jobs.csv", "no_go.geojson", "tide.yaml")
_PLAIN = (SCENARIO, "jobs.geojson", "no_go.geojson", "obstacles.geojson", "current.nc", "bathymetry.nc")

#: What is to be known of the coast, wherever it is used.
CAUTION = (
    "the coast is Natural Earth's at 1:10,000,000, good to about a kilometre at best: no chart for "
    "navigation; put a chart of your own in its place"
)
_COAST, _JOBS = "coast.geojson", "jobs.geojson"
#: m, of that coast.
_ACCURACY = 1000.0
#: Least and greatest size of the area, km, and the latitude that its middle may lie at.
_SIZES, _FARTHEST = (2.0, 100.0), 80.0
#: m beyond the area from which the coast is written: farther than distances to it are stated.
_BEYOND = 6000.0
#: Places along a side of the area that may become jobs, the share of it that they lie in, and their number.
_ALONG, _INNER, _COUNT = 61, 0.8, 6
#: Distance of jobs to the coast, as a share of the area's side.
_OFF = 0.04
#: m/s, and how much longer than the straight line through all jobs the time available is.
_SPEED, _DETOUR = 2.0, 1.6
_DEPTHS = (5, 10, 8, 12, 6, 15)

Array = NDArray[np.float64]


def write_example(folder: str | Path, force: bool = False) -> list[Path]:
    """Write a complete scenario, with every file that it names; the same wherever and whenever.

    Returns:
        The files, the scenario first.

    Raises:
        OutputError: a file is there already, or cannot be written; one line that names it.
    """
    coast = "whitsunday_coast.geojson"
    content = {name: (_DATA / "example" / name).read_bytes() for name in _PLAIN}
    return _write(folder, content | {coast: (_DATA / coast).read_bytes(), "NOTICE.md": _notice(coast)}, force)


def write_example_of_times(folder: str | Path, force: bool = False) -> list[Path]:
    """Write a scenario with tides, time windows and an area that closes; as `write_example`."""
    return _write(folder, {name: (_DATA / "tide" / name).read_bytes() for name in _TIMES}, force)


def _write(folder: str | Path, content: Mapping[str, bytes], force: bool) -> list[Path]:
    """Write files, by name, to a folder that is made where it is missing; none where one is there already."""
    home = Path(folder)
    there = [name for name in content if (home / name).exists()]
    if there and not force:
        raise OutputError(f"{home / there[0]}: already exists: use --force to overwrite it")
    output_folder(home)
    return [
        write_atomically(home / name, lambda part, of=of: part.write_bytes(of))
        for name, of in content.items()
    ]


def _notice(name: str) -> bytes:
    """Return the part of the notice of the packaged data that concerns a file."""
    text = (_DATA / "NOTICE.md").read_text(encoding="utf-8")
    title, *parts = text.split("\n## ")
    if f"`{name}`" in title:
        return title.encode()
    part = next(part for part in parts if part.startswith(name)).partition("\n\n")[2]
    return f"# Data notice\n\n{part}".encode()


# --- at any coast of the world -----------------------------------------------------------------------


@dataclass(frozen=True)
class Beginning:
    """A scenario that was written.

    Attributes:
        paths: of the files, the scenario first.
        box: west, south, east, north of the area, degrees.
        notes: what is to be noted of it, a line each.
    """

    paths: tuple[Path, ...]
    box: tuple[float, float, float, float]
    notes: tuple[str, ...]


def write_example_at(
    folder: str | Path, latitude: float, longitude: float, size: float = 10.0, force: bool = False
) -> Beginning:
    """Write a scenario of an area around a place, `size` km wide, with the coast there and jobs in its water.

    Raises:
        ScenarioError: one line; the place is none, or has too little water around it.
        OutputError: a file is there already, or cannot be written.
    """
    if not (abs(latitude) <= _FARTHEST and -180.0 <= longitude <= 360.0):
        raise ScenarioError(
            f"--at {latitude:g},{longitude:g}: give latitude, within {_FARTHEST:g} degrees of the equator, "
            "then longitude, in [-180, 360]"
        )
    if not _SIZES[0] <= size <= _SIZES[1]:
        raise ScenarioError(f"--size {size:g}: must be between {_SIZES[0]:g} and {_SIZES[1]:g} km")
    site = Site(longitude, latitude)
    half = 500.0 * size
    shapes = land_within(*_bounds(site, half + _BEYOND))
    land = shapely.union_all([to_local(shape, site) for shape in shapes])
    places = _places(land, half)
    on_land = bool(shapely.intersects(land, shapely.Point(0.0, 0.0)))
    if places is None:
        where, hint = f"--at {latitude:g},{longitude:g}", "give a place farther off, or another --size"
        if on_land:
            far = distance_to_coast(longitude, latitude) / 1000.0
            where += f": is on land, {far:.0f} km from the sea by the packaged coast, which knows no rivers"
            hint = "give a place at sea, or a greater --size"
        raise ScenarioError(f"{where}: too little water in an area of {size:g} km: {hint}")
    notes = []
    away = float(np.hypot(*places[0]))
    if on_land:
        notes.append(f"the place itself is on land: the start is {away / 1000.0:.1f} km from it, in water")
    notes.append(CAUTION if shapes else "the packaged coast has no land in the area, which is open water")
    jobs = []
    for number, (place, depth) in enumerate(zip(places[2:], _DEPTHS, strict=True), 1):
        stated = {"name": f"job {number}", "priority": 1 + number % 3, "duration": 60, "depth": depth}
        jobs.append((stated, {"type": "Point", "coordinates": list(_place(site, place))}))
    content = {
        SCENARIO: _scenario(site, size, places, bool(shapes)),
        _JOBS: _collection(jobs),
        "NOTICE.md": _notice("world_land.npz"),
    }
    if shapes:
        rounded = shapely.get_parts([shapely.set_precision(shape, 1e-5) for shape in shapes])
        parts = [part for part in rounded if isinstance(part, Polygon) and not part.is_empty]
        ordered = sorted(parts, key=lambda part: (-part.area, *part.bounds))
        content[_COAST] = _collection(({}, json.loads(shapely.to_geojson(part))) for part in ordered)
    written = _write(folder, content, force)
    return Beginning(tuple(written), _bounds(site, half), tuple(notes))


def _bounds(site: Site, half: float) -> tuple[float, float, float, float]:
    """West, south, east, north of a square about a site, degrees; west is not less than -180."""
    side = np.linspace(-half, half, 21)
    rim = np.full_like(side, half)
    north = np.concatenate([side, side, rim, -rim])
    east = np.concatenate([rim, -rim, side, side])
    longitude, latitude = site.to_geographic(north, east)
    turned = site.longitude + np.mod(np.asarray(longitude) - site.longitude + 180.0, 360.0) - 180.0
    if turned.min() < -180.0:
        turned = turned + 360.0
    return float(turned.min()), float(latitude.min()), float(turned.max()), float(latitude.max())


def _places(land: Any, half: float) -> Array | None:
    """[2 + jobs, 2] m north, east: start, goal and jobs, far apart in one water; None where it is small."""
    axis = np.linspace(-_INNER * half, _INNER * half, _ALONG)
    north, east = np.meshgrid(axis, axis, indexing="ij")
    points = shapely.points(north, east)
    off = np.full(north.shape, np.inf) if land.is_empty else shapely.distance(land, points)
    bodies, _ = scipy.ndimage.label(off >= 2.0 * half * _OFF)
    if not bodies.any():
        return None
    middle = np.where(bodies > 0, np.hypot(north, east), np.inf)
    own = bodies == bodies.flat[middle.argmin()]
    if own.sum() < 4 * (_COUNT + 2):
        return None
    there = np.stack([north[own], east[own]], axis=1)
    start = there[np.hypot(*there.T).argmin()]
    goal = there[np.abs(np.hypot(*(there - start).T) - 0.3 * half).argmin()]
    found = [start, goal]
    while len(found) < 2 + _COUNT:
        apart = np.min([np.hypot(*(there - place).T) for place in found], axis=0)
        found.append(there[apart.argmax()])
    return np.array(found)


def _time(places: Array) -> int:
    """Return a time available, s, in which the jobs can be done: by the nearest next one, and some more."""
    left, here, length = [*places[2:]], places[0], 0.0
    while left:
        steps = [float(np.hypot(*(place - here))) for place in left]
        length += min(steps)
        here = left.pop(int(np.argmin(steps)))
    length += float(np.hypot(*(places[1] - here)))
    return int(np.ceil((_DETOUR * length / _SPEED + 60.0 * _COUNT) / 600.0)) * 600


def _place(site: Site, place: Array) -> tuple[float, float]:
    """Longitude and latitude, rounded to some metres."""
    longitude, latitude = site.to_geographic(place[0], place[1])
    return round(float(longitude), 5), round(float(latitude), 5)


def _collection(features: Iterable[tuple[dict, dict]]) -> bytes:
    """Return GeoJSON of properties and geometries, a feature a line."""
    every = ({"type": "Feature", "properties": stated, "geometry": at} for stated, at in features)
    lines = ",\n".join(f"    {json.dumps(feature)}" for feature in every)
    return f'{{\n  "type": "FeatureCollection",\n  "features": [\n{lines}\n  ]\n}}\n'.encode()


def _scenario(site: Site, size: float, places: Array, coast: bool) -> bytes:
    (start, goal) = (_place(site, place) for place in places[:2])
    land = (
        "source: polygons                    # land as GeoJSON, GeoPackage or Shapefile\n"
        f"  file: {_COAST}\n  pixel_size: {max(10, round(2.0 * size))}                      # m\n"
        f"  accuracy: {_ACCURACY:.0f}                      # m; distances to this coast are stated no finer"
    )
    values = {
        "LONGITUDE": f"{site.longitude:.7g}",
        "LATITUDE": f"{site.latitude:.7g}",
        "HALF": str(round(500.0 * size)),
        "CHART": land if coast else "source: none                        # open water",
        "BOX": ",".join(f"{round(axis, 3):.3f}" for axis in _bounds(site, 500.0 * size)),
        "START": f"{{longitude: {start[0]}, latitude: {start[1]}, depth: 5}}",
        "GOAL": f"{{longitude: {goal[0]}, latitude: {goal[1]}, depth: 5}}",
        "TIME": str(_time(places)),
        "CAUTION": CAUTION.replace("; ", ";\n# ").replace("the coast", "The coast", 1),
    }
    text = (_DATA / "example" / "scenario_at.yaml").read_text(encoding="utf-8")
    for name, value in values.items():
        text = text.replace(f"@{name}@", value)
    return text.encode()


@cache
def _world() -> NDArray:
    """[N] shapely polygons, degrees; some touch or cross themselves."""
    with np.load(str(_DATA / "world_land.npz")) as data:
        places = np.cumsum(data["steps"], axis=0) * data["scale"] + data["origin"]
        starts = [np.concatenate([[0], np.cumsum(data[name])]) for name in ("rings", "polygons")]
    return shapely.from_ragged_array(shapely.GeometryType.POLYGON, places, tuple(starts))


def land_within(west: float, south: float, east: float, north: float) -> list[Polygon]:
    """Return the land of a box, degrees, cut off at its sides.

    Args:
        west, east: longitudes, which may lie beyond -180 and 180; so do the land's then.
        south, north: latitudes.
    """
    world, found = _world(), []
    lows, lefts, highs, rights = (shapely.bounds(world)[:, k] for k in (1, 0, 3, 2))
    for turn in (-720.0, -360.0, 0.0, 360.0, 720.0):
        reaches = (lefts + turn < east) & (rights + turn > west) & (lows < north) & (highs > south)
        for polygon in world[reaches]:
            cut = shapely.clip_by_rect(polygon, west - turn, south, east - turn, north)
            if not cut.is_empty:
                found.append(translate(shapely.make_valid(cut), turn))
    parts = shapely.get_parts(shapely.union_all(found)) if found else []
    return [part for part in parts if isinstance(part, Polygon) and part.area > 0.0]


def distance_to_coast(longitude: float, latitude: float) -> float:
    """Return how far the nearest point of the world's coast is, m, to a kilometre or so."""
    east, north = shapely.get_coordinates(_world()).T
    there = np.full_like(east, longitude), np.full_like(east, latitude)
    return float(np.nanmin(Geod(ellps="WGS84").inv(*there, east, north)[2]))
