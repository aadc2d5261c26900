"""A planned and executed mission as plain data, and its waypoints: what every format is written from."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC
from importlib.metadata import version as installed_version
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray

from auvplan.errors import AuvplanError
from auvplan.export.fences import Fence, fences_around, nearest_fences
from auvplan.ocean.chart import Chart
from auvplan.path.motion import Motion
from auvplan.records import TurnBack
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import between, counted, figure, plain
from auvplan.site import Site, as_utc
from auvplan.view.timeline import END_BEHAVIOURS

#: Points of fences that autopilots hold at least: corners, and one for a circle.
FENCE_POINTS = 70

#: m within which the end of a leg and the start of the next are one waypoint.
_SAME = 1.0

#: Decimal places of degrees in files: a millimetre.
DEGREES = 8


class ExportError(AuvplanError):
    """A mission that cannot be exported; the message is one line that names the leg or field and why."""


class Track(NamedTuple):
    """An executed leg: times [n] s since the epoch, positions [n, 3] m north, east, depth, and motion [n].

    A motion of no moments is one that is not known.
    """

    times: Array
    positions: Array
    motion: Motion = Motion.none()


@dataclass(frozen=True)
class PlannedLeg:
    """The path of one leg as it was planned, and the waypoints that stand for it.

    Attributes:
        number: of the leg, from 1.
        start, goal: indices of the waypoints at its ends.
        start_name, goal_name: their names.
        positions: [n, 3] m north, east, depth, samples of the path.
        times: [n] s since the epoch.
        kept: [k] indices of the samples that are waypoints, the first and the last among them.
        kept_times: [k] s since the epoch, when they are reached along straight lines.
        motion: [n], attitude and velocities from each sample to the next, as planned; NaN where not known.
        time_change: share by which the straight lines take longer than the path.
        clearance: m, least certified distance of the straight lines to coast and obstacles, or infinite.
        hold: s at the goal, for its task and waiting; 0 where there is neither.
        priority: of the task.
        led: m/s over ground, and of it along the hull, at which the first waypoint is gone to; NaN where the
            leg begins there.
        charge: [n], share of the battery's usable energy that is left; None where it is not known.
        speed: m/s through the water; None where it is the itinerary's.
        rise: s of the hold, at its end, in which the vehicle surfaces for a fix, up and down included.
        fix: s of these at the surface.
        pace: share of the speed that the vehicle is asked for which it makes; times and motion are by it.
        wait: s of the hold, at its beginning, that pass in waiting for the task's window.
        onward: s of the hold, at its end, before the next leg: in waiting for the way to open, and the rise.
    """

    number: int
    start: int
    goal: int
    start_name: str
    goal_name: str
    positions: Array
    times: Array
    kept: NDArray[np.intp]
    kept_times: Array
    motion: Motion
    time_change: float = 0.0
    clearance: float = np.inf
    hold: float = 0.0
    priority: float = 0.0
    led: tuple[float, float] = (np.nan, np.nan)
    charge: Array | None = None
    speed: float | None = None
    rise: float = 0.0
    fix: float = 0.0
    pace: float = 1.0
    wait: float = 0.0
    onward: float = 0.0

    @classmethod
    def of(
        cls,
        number: int,
        start: int,
        goal: int,
        positions: ArrayLike,
        times: ArrayLike,
        *,
        names: Sequence[str] = (),
        hold: float = 0.0,
        priority: float = 0.0,
        motion: Motion | None = None,
    ) -> "PlannedLeg":
        """Return a leg all of whose samples are waypoints.

        Args:
            number, start, goal, positions, times, hold, priority: as the attributes.
            names: of the waypoints; those without are called by their index.
            motion: [n - 1], on the segments between the samples; None where not known.

        Raises:
            ExportError: positions or times have a wrong shape, are not finite, or times go back.
        """
        places, moments = _track(f"leg {number}", positions, times)
        if len(places) < 2:
            raise ExportError(f"leg {number}: a path has at least two samples, got {len(places)}")
        every = np.arange(len(places))
        first, last = (names[k] if k < len(names) else f"waypoint {k}" for k in (start, goal))
        known = Motion.none(len(places)) if motion is None else Motion.joined([motion, motion[-1:]])
        return cls(
            number, start, goal, first, last, places, moments, every, moments, known,
            hold=hold, priority=priority,
        )  # fmt: skip

    @property
    def waypoints(self) -> Array:
        """[k, 3] m, the samples kept."""
        return self.positions[self.kept]

    @property
    def note(self) -> str:
        """One line on the thinning."""
        return (
            f"leg {self.number}: {len(self.kept)} of {len(self.positions)} samples kept as waypoints, "
            f"which changes the travel time by {100.0 * self.time_change:+.2f} %"
            + ("" if self.speed is None else f", at {self.speed:.2f} m/s through the water")
        )


@dataclass(frozen=True)
class Itinerary:
    """A mission to be exported.

    Attributes:
        name: of the mission.
        site: where and when local coordinates are.
        speed: m/s through the water, of legs that have none of their own, and of loitering.
        legs: as planned, at least one.
        executed: the legs as executed; none where the mission was only planned.
        fences: where not to go.
        seed: that the mission was made from.
        configuration: JSON of the settings that it was made from.
        version: of auvplan.
        notes: lines for whoever exports, such as what had to be left out.
        end: what the vehicle does at the last waypoint, see `END_BEHAVIOURS`.
        sources: files of the forecast that it was planned in, with run and hash, a line each.
        warnings: what a vehicle may not be able to follow, a line each.
        fence_points: points of fences that the autopilot holds.
        assumed: what was assumed or warned of in the scenario and its files, a line each.
        turns: ways past a task, or to the destination, from stops that are left too late.
        over_ground: whether vehicles are given the speed over ground that each line is planned to make, see
            `auvplan.export.speeds`; otherwise that through the water.

    Raises:
        ExportError: there is no leg, a speed or a task's time is no number, the mission reaches beyond the
            calendar, or an executed track has a wrong shape or is not finite.
    """

    name: str
    site: Site
    speed: float
    legs: tuple[PlannedLeg, ...]
    executed: tuple[Track, ...] = ()
    fences: tuple[Fence, ...] = ()
    seed: int = 0
    configuration: str = "{}"
    version: str = ""
    notes: tuple[str, ...] = ()
    end: str = "surface"
    sources: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    fence_points: int = FENCE_POINTS
    assumed: tuple[str, ...] = ()
    turns: tuple[TurnBack, ...] = ()
    over_ground: bool = True

    def __post_init__(self) -> None:
        if not self.legs:
            raise ExportError(f"mission {self.name or 'unnamed'}: no leg was planned and executed to its end")
        whose = [("the vehicle's", self.speed), *((f"leg {leg.number}'s", leg.speed) for leg in self.legs)]
        for of, speed in whose:
            if speed is not None and not (np.isfinite(speed) and speed > 0.0):
                raise ExportError(f"{of} speed must be positive, got {speed:g}")
        legs = [
            replace(leg, start_name=plain(leg.start_name), goal_name=plain(leg.goal_name))
            for leg in self.legs
        ]
        for leg in legs:
            if not (np.isfinite(leg.hold) and leg.hold >= 0.0):
                raise ExportError(f"leg {leg.number}: a task cannot take {leg.hold:g} s")
        try:
            for seconds in (legs[0].times[0], legs[-1].times[-1]):
                self.site.utc(float(seconds))
        except OverflowError:
            line = "the mission reaches beyond the calendar: see to the departure's year"
            raise ExportError(line) from None
        object.__setattr__(self, "name", plain(self.name))
        object.__setattr__(self, "legs", tuple(legs))
        tracks = []
        for k, track in enumerate(self.executed):
            places, times = _track(f"executed track {k}", track.positions, track.times)
            known = track.motion if len(track.motion) else Motion.none(len(times))
            if len(known) != len(times):
                raise ExportError(f"executed track {k}: motion has {len(known)} moments, times {len(times)}")
            tracks.append(Track(times, places, known))
        object.__setattr__(self, "executed", tuple(tracks))

    def through_water(self, leg: PlannedLeg) -> float:
        """Return m/s through the water that a leg is gone at."""
        return self.speed if leg.speed is None else leg.speed

    @property
    def speeds(self) -> str:
        """Speeds through the water of its legs, in words; empty where none has its own."""
        own = [self.through_water(leg) for leg in self.legs]
        return f"{between(own, 2)} m/s" if any(leg.speed is not None for leg in self.legs) else ""

    @property
    def held_fences(self) -> tuple[tuple[Fence, ...], str]:
        """The fences that the autopilot has room for, and what is left out."""
        return nearest_fences(self.fences, [leg.positions for leg in self.legs], self.fence_points)

    @property
    def description(self) -> str:
        """What every file says of itself: origin, and what was kept of the paths."""
        kept = sum(len(leg.kept) for leg in self.legs)
        samples = sum(len(leg.positions) for leg in self.legs)
        worst = max((leg.time_change for leg in self.legs), key=abs)
        return (
            f"auvplan {self.version}, seed {self.seed}: {counted(len(self.legs), 'leg')}, "
            f"{kept} of {samples} samples kept as waypoints; "
            f"travel times of legs change by {100.0 * worst:+.2f} % at most; "
            f"at the end: {END_BEHAVIOURS[self.end]}"
            + "".join(f"; {line}" for line in (*self.assumed, *self.warnings, *self.sources))
        )


def itinerary_of_parts(
    name: str,
    site: Site,
    speed: float,
    legs: Sequence[PlannedLeg],
    executed: Sequence[Track] = (),
    *,
    chart: Chart | None = None,
    obstacles: Sequence[tuple[ArrayLike, float, str]] = (),
    seed: int = 0,
    configuration: str = "{}",
    version: str | None = None,
    notes: Sequence[str] = (),
    end: str = "surface",
) -> Itinerary:
    """Return an itinerary whose fences are drawn around the coast and obstacles near its legs.

    Args:
        name, site, speed, legs, executed, seed, configuration, notes, end: as in `Itinerary`.
        chart: coast, or None.
        obstacles: centres [3] m, radii, m, and names of what stands still.
        version: of the auvplan that made the mission; the installed one where not given.

    Raises:
        ExportError: as `Itinerary`.
    """
    bare = Itinerary(
        name, site, speed, tuple(legs), tuple(executed), (), seed, configuration,
        installed_version("auvplan") if version is None else version, end=end,
    )  # fmt: skip
    lines = [line for leg in bare.legs for line in (leg.positions, leg.waypoints)]
    fences, left_out = fences_around(lines, chart, obstacles)
    return replace(bare, fences=tuple(fences), notes=(*notes, *left_out))


def _track(what: str, positions: ArrayLike, times: ArrayLike) -> tuple[Array, Array]:
    """Return positions [n, 3] and times [n] in double precision.

    Raises:
        ExportError: a shape is wrong, a value is not finite, or times go back.
    """
    places, moments = np.asarray(positions, float), np.asarray(times, float)
    if places.ndim != 2 or places.shape[1] != 3 or moments.shape != places.shape[:1]:
        shapes = f"{places.shape}, {moments.shape}"
        raise ExportError(f"{what}: positions must be [n, 3] and times [n], got {shapes}")
    if not (np.isfinite(places).all() and np.isfinite(moments).all()):
        raise ExportError(f"{what}: positions and times must be finite, got NaN or infinity")
    if (np.diff(moments) < 0.0).any():
        raise ExportError(f"{what}: times must not go back")
    return places, moments


@dataclass(frozen=True)
class Waypoint:
    """A waypoint of the whole itinerary.

    Attributes:
        leg: number of the leg that ends there or passes it, from 1.
        name: of the mission's waypoint; of those between, the leg and their number on it.
        position: [3] m, north, east, depth.
        longitude, latitude: degrees.
        seconds: since the epoch, when the planned path is there, as on the mission sheet. Straight lines take
            a little more or less; by how much, the leg's note says.
        left: [3] m, where the straight line to it begins; its own place where it is the first.
        left_at, time: s since the epoch, when that is left, and planned arrival along straight lines.
        speed: m/s through the water that is planned on the line to it.
        hold: s, of the task and the waiting there, or of a rest under way; 0 where there is none.
        priority: of that task.
        ends_leg: whether the leg ends there.
        yaw, pitch: degrees, from true north and nose up, attitude that was planned for the path there; NaN
            where not known.
        body_velocity: [3] m/s, surge, sway and heave that were.
        charge: share of the battery's usable energy that is left; NaN where not known.
        wait, onward, rise: s of the hold, see `PlannedLeg`.
    """

    leg: int
    name: str
    position: Array
    longitude: float
    latitude: float
    seconds: float
    left: Array
    left_at: float
    time: float
    speed: float
    hold: float
    priority: float
    ends_leg: bool
    yaw: float
    pitch: float
    body_velocity: Array
    charge: float
    wait: float = 0.0
    onward: float = 0.0
    rise: float = 0.0

    @property
    def pace(self) -> float:
        """M/s over ground that are planned on the line to it, or through the water where that is none."""
        way, seconds = float(np.linalg.norm(self.position - self.left)), self.time - self.left_at
        return way / seconds if way > 0.0 and seconds > 0.0 else self.speed

    @property
    def key(self) -> tuple[float, ...]:
        """What distinguishes it from waypoints of other places and legs."""
        return self.leg, *self.position.tolist()

    @property
    def depth(self) -> float:
        """m, positive down, to a tenth of a millimetre and never -0."""
        return round(float(self.position[2]), 4) + 0.0

    @property
    def task(self) -> str:
        """One line on the task, and on waiting before and after it; or nothing."""
        if not self.ends_leg:
            return f"rest of {self.hold:.0f} s" if self.hold else ""
        task, later = self.hold - self.wait - self.onward, self.onward - self.rise
        parts = [
            f"wait of {self.wait:.0f} s" if self.wait else "",
            f"task of priority {figure(self.priority)}, {max(task, 0.0):.0f} s"
            if stays_for(self) == "task"
            else "",
            f"wait of {later:.0f} s" if later > 1e-3 else "",
            f"surfacing for a fix, {self.rise:.0f} s" if self.rise else "",
        ]
        return ", then ".join(filter(None, parts))


def stays_for(part: PlannedLeg | Waypoint) -> str:
    """Return what a vehicle holds for: "task", or "wait" where it waits alone."""
    return "task" if part.priority or part.hold - part.wait - part.onward > 1e-3 else "wait"


def waypoints(itinerary: Itinerary) -> list[Waypoint]:
    """Return all waypoints in order.

    Where a leg begins at the end of the one before, that place comes once.
    """
    rows: list[Waypoint] = []
    for leg in itinerary.legs:
        places, motion = geographic(itinerary.site, leg.waypoints), leg.motion[leg.kept]
        motion = by_true_north(motion, itinerary.site, places)
        last, body = len(leg.kept) - 1, motion.body_velocity
        for k, place in enumerate(leg.waypoints):
            if k == 0 and rows and np.linalg.norm(rows[-1].position - place) < _SAME:
                continue
            between = f"leg {leg.number}, {k}"
            name = leg.start_name if k == 0 else leg.goal_name if k == last else between
            longitude, latitude = places[k, :2].tolist()
            before, speed = max(k - 1, 0), itinerary.through_water(leg)
            line = leg.waypoints[before], float(leg.kept_times[before]), float(leg.kept_times[k]), speed
            hold, priority = (leg.hold, leg.priority) if k == last else (0.0, 0.0)
            if k < last and not (leg.waypoints[k + 1] - place).any():
                hold = float(leg.kept_times[k + 1] - leg.kept_times[k])
            yaw, pitch = float(np.degrees(motion.yaw[k])), float(np.degrees(motion.pitch[k]))
            seconds = float(leg.times[leg.kept[k]])
            charge = np.nan if leg.charge is None else float(leg.charge[leg.kept[k]])
            rows.append(Waypoint(
                leg.number, name, place, longitude, latitude, seconds, *line, hold, priority, k == last,
                yaw, pitch, body[k], charge, *((leg.wait, leg.onward, leg.rise) if k == last else ()),
            ))  # fmt: skip
    return rows


def geographic(site: Site, places: ArrayLike) -> Array:
    """Return [n, 3] longitude and latitude, degrees, and m above the surface, of places [n, 3] m.

    Of places without a depth, [n, 2] m, there is no height.
    """
    axes = np.asarray(places).T
    return np.stack([*site.to_geographic(axes[0], axes[1]), *-axes[2:]], axis=1)


def by_true_north(motion: Motion, site: Site, places: Array) -> Motion:
    """Return a motion [n] in the local frame as one by true north and east.

    Args:
        places: [n, 2 or 3], where: longitude and latitude, degrees, first.
    """
    return motion.turned(-site.true_north(places[:, 0], places[:, 1]))


def rings_around(corners: Array, site: Site) -> list[Array]:
    """Return a polygon by corners [k, 2] m north, east as rings [n, 2] of longitude and latitude, degrees.

    They are closed and run counter-clockwise; there are two where it lies across the antimeridian.
    """
    longitude, latitude = geographic(site, corners).T
    near = np.degrees(np.unwrap(np.radians(longitude)))
    whole = shapely.Polygon(np.stack([near, latitude], axis=1))
    rings = []
    for turn in (-360.0, 0.0, 360.0):
        world = shapely.box(turn - 180.0, -90.0, turn + 180.0, 90.0)
        parts = [whole] if whole.within(world) else shapely.get_parts(whole.intersection(world))
        for part in parts:
            if part.area > 0.0:
                rings.append(np.asarray(shapely.orient_polygons(part).exterior.coords) - (turn, 0.0))
    return rings


def moment(site: Site, seconds: float) -> str | None:
    """Time of day by ISO 8601 in UTC, to the millisecond; None where the site has no epoch."""
    then = site.utc(seconds)
    if then is None:
        return None
    return as_utc(then).astimezone(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")


def elevation(depth: float) -> float:
    """M above the surface, to a tenth of a millimetre and never -0."""
    return round(-float(depth), 4) + 0.0


def degrees(value: float) -> str:
    """Degrees in decimal notation, as XML schemas ask for it."""
    return f"{value:.{DEGREES}f}"


def metres(value: float) -> str:
    """Return metres in decimal notation, never -0."""
    return f"{round(float(value), 4) + 0.0:.4f}"
