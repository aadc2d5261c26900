"""The independent checker: re-checks the whole track of a saved run and re-adds every time.

It reads files and uses NumPy, and shares no code with the planners or the simulator, so that a fault of
theirs cannot hide itself here. Visits and tasks are counted again from the scenario and the track; land and
sea bed are looked up twice, in the run's own file and in those that the scenario names.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.errors import AuvplanError
from auvplan.files import MISSION, SUMMARY, ResultError, read_mission, read_summary
from auvplan.io.enc import hazards_of_cells
from auvplan.io.errands import Placing, obstacles_of
from auvplan.io.hours import window_faults
from auvplan.io.kinematics import motion_faults
from auvplan.io.ledger import (
    Leg,
    figure_faults,
    graph_faults,
    place_faults,
    read_legs,
    require,
    route_faults,
    site_faults,
    time_faults,
)
from auvplan.io.originals import metres_of, path_of, places_of
from auvplan.io.sources import Source, read_sources
from auvplan.io.tally import tally_faults
from auvplan.io.walk import Array, Bed, Coast, Mask, Walk, events
from auvplan.ocean.known import KnownObstacle
from auvplan.words import counted

#: No current is faster, m/s.
CURRENT_MAX = 5.0

#: Metres by which an altitude may fall short of the clearance that was asked for: far above rounding.
ALTITUDE_TOLERANCE = 0.1

#: s between the moments of a stay at which it is asked whether an area is closed.
_STAY = 10.0

#: s by which the last of them comes before the end.
_MOMENT = 1e-3

_BED = {"seabed_depth": ("seabed_x", "seabed_y"), "seabed_origin": ("horizontal",), "seabed_pixel_size": ()}


@dataclass
class CheckReport:
    """What the checker found.

    Attributes:
        coast_hits: separate stretches on land.
        coast_metres: m travelled on land.
        obstacle_hits: separate stretches inside a true obstacle at the true time.
        obstacle_metres: m travelled inside one.
        seabed_hits: separate stretches below the sea bed.
        seabed_metres: m travelled below it.
        coast_clearance: m, least distance to a coast pixel's edge, closed areas being none; infinite
            without a coast.
        obstacle_clearance: m, least distance to a true obstacle's surface, negative inside; infinite
            without obstacles.
        seabed_altitude: m, least altitude above the sea bed, negative below it; infinite where none is known.
        length: m walked.
        legs: executed legs.
        faults: one line each.
        notes: what could not be looked at, one line each.
    """

    coast_hits: int = 0
    coast_metres: float = 0.0
    obstacle_hits: int = 0
    obstacle_metres: float = 0.0
    seabed_hits: int = 0
    seabed_metres: float = 0.0
    coast_clearance: float = np.inf
    obstacle_clearance: float = np.inf
    seabed_altitude: float = np.inf
    length: float = 0.0
    legs: int = 0
    faults: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def collisions(self) -> int:
        """Separate stretches on land, inside an obstacle or below the sea bed."""
        return self.coast_hits + self.obstacle_hits + self.seabed_hits

    @property
    def ok(self) -> bool:
        """Whether no fault was found."""
        return not self.faults

    def __str__(self) -> str:
        lines = [
            f"walked {self.length:,.0f} m on {counted(self.legs, 'leg')}",
            f"collisions: {self.coast_hits} with the coast ({self.coast_metres:.1f} m), "
            f"{self.obstacle_hits} with obstacles ({self.obstacle_metres:.1f} m), "
            f"{self.seabed_hits} with the sea bed ({self.seabed_metres:.1f} m)",
            f"least clearance: coast {_metres(self.coast_clearance)}, "
            f"obstacles {_metres(self.obstacle_clearance)}, sea bed {_metres(self.seabed_altitude)}",
            *(f"note: {note}" for note in self.notes),
            *(f"fault: {fault}" for fault in self.faults),
            "no faults" if self.ok else counted(len(self.faults), "fault"),
        ]
        return "\n".join(lines)


def check_run(folder: str | Path) -> CheckReport:
    """Check a saved run: coast, obstacles, sea bed, times, places, edges and tasks of every executed leg.

    Args:
        folder: that `save_run` wrote.

    Returns:
        What was found; `CheckReport.ok` tells whether it is free of faults.

    Raises:
        ResultError: a file is missing, damaged or incomplete; one line that names it.
    """
    summary, dataset = read_summary(folder), read_mission(folder)
    require(summary, dataset, Path(folder))
    _require_bed(dataset, Path(folder) / MISSION)
    try:
        return check_dataset(summary, dataset)
    except AuvplanError:
        raise
    except Exception as error:  # whatever values of the wrong kind lead to
        line = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise ResultError(f"{Path(folder) / MISSION}: cannot be checked ({line})") from None


def check_dataset(summary: dict[str, Any], dataset: xr.Dataset) -> CheckReport:
    """`check_run` on a summary and a dataset as `save_run` writes them."""
    legs = list(read_legs(dataset))
    report = CheckReport()
    report.faults += site_faults(dataset)
    report.faults += graph_faults(dataset, legs)
    report.faults += place_faults(dataset, legs)
    report.faults += time_faults(dataset, summary, legs)
    report.faults += figure_faults(summary, dataset, legs)
    report.faults += route_faults(dataset, legs)
    report.faults += motion_faults(dataset, legs, report.notes)
    report.faults += tally_faults(summary, dataset, legs, report.notes)
    report.faults += window_faults(dataset, legs, report.notes)
    known = _known_obstacles(dataset, report.notes)
    sources = read_sources(dataset, report.notes)
    places = places_of(dataset) if sources else None
    coast = Coast.of(dataset) if "passability" in dataset else None
    shore = None if coast is None else Coast.beyond(dataset)
    bed = Bed.of(dataset) if "seabed_depth" in dataset else None
    for leg in legs:
        if leg.executed:
            speed = float(dataset.attrs["vehicle_speed"]) + CURRENT_MAX
            walked = _walk(leg, coast, bed, known, _met(dataset, leg), speed, report)
            if walked is not None and shore is not None:
                nearest = float(shore.distances(leg.positions).min())
                report.coast_clearance = min(report.coast_clearance, nearest)
            if walked is not None and places is not None:
                walk, booked = walked
                _look_again(leg, walk, booked, places(*walk.positions[:, :2].T), sources, report)
    if summary.get("collisions", 0) and not report.collisions:
        report.faults.append(f"collisions is {summary['collisions']} in {SUMMARY}, none was found")
    return report


def _require_bed(dataset: xr.Dataset, file: Path) -> None:
    """Raise where only parts of a sea bed are there.

    Raises:
        ResultError: one line that names the variable or attribute.
    """
    if not any(name in dataset for name in _BED):
        return
    for name, dims in _BED.items():
        if name not in dataset:
            raise ResultError(f"{file}: variable {name} is missing")
        if dataset[name].dims != dims:
            raise ResultError(f"{file}: variable {name} has dimensions {dataset[name].dims}, not {dims}")
    if "seabed_clearance" not in dataset.attrs:
        raise ResultError(f"{file}: attribute seabed_clearance is missing")


def _known_obstacles(dataset: xr.Dataset, notes: list[str]) -> tuple[KnownObstacle, ...]:
    """Obstacles of the scenario's file and chart, where they are when the run departs."""
    settings = json.loads(str(dataset.attrs["scenario"]))
    name = settings.get("obstacles", {}).get("file")
    if "site_longitude" not in dataset.attrs:
        return ()
    metres = metres_of(dataset)
    found = _charted_obstacles(dataset, settings.get("chart") or {}, metres, notes)
    if name is None:
        return found
    try:
        named = obstacles_of(path_of(dataset, name), metres)
    except Exception as error:  # whatever a damaged file leads to
        why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        notes.append(f"known obstacles of {name} were not looked at: {why}")
        return found
    departed = float(dataset.attrs.get("departed", 0.0))
    return (*found, *(obstacle.after(departed) for obstacle in named))


def _charted_obstacles(
    dataset: xr.Dataset, chart: dict[str, Any], metres: Placing, notes: list[str]
) -> tuple[KnownObstacle, ...]:
    """Rocks, wrecks and obstructions of a chart's S-57 cells."""
    if chart.get("source") != "enc":
        return ()
    try:
        hazards = hazards_of_cells(str(path_of(dataset, chart["file"])))
    except Exception as error:  # whatever GDAL stumbles over
        why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        notes.append(f"obstacles of {chart['file']} were not looked at: {why}")
        return ()
    found = []
    for name, longitude, latitude, top in hazards:
        found.append(KnownObstacle(name, metres(longitude, latitude), float(chart["hazard_radius"]), top))
    return tuple(found)


def _met(dataset: xr.Dataset, leg: Leg) -> Mask:
    """[M] whether an obstacle of a leg was not known before."""
    if "obstacle_kind" not in dataset:
        return np.ones(len(leg.radii), bool)
    names = str(dataset["obstacle_kind"].attrs["flag_meanings"]).split()
    codes = dataset["obstacle_kind"].values[leg.number][: len(leg.radii)]
    return np.array([names[int(code)] != "known" for code in codes], bool)


def _walk(
    leg: Leg,
    coast: Coast | None,
    bed: Bed | None,
    known: Sequence[KnownObstacle],
    met: Mask,
    speed: float,
    report: CheckReport,
) -> tuple[Walk, dict[str, Mask]] | None:
    """Walk one leg in steps of at most a metre and book what it meets.

    Returns:
        The walk, and where it was booked as on "land" and below the "sea bed"; None where it is not finite.
    """
    report.legs += 1
    for name, values in (("time", leg.times), ("position", leg.positions), ("obstacle", leg.obstacles)):
        if not np.isfinite(values).all():
            report.faults.append(f"{leg}: a {name} is not a number")
            return None
    elapsed = np.diff(leg.times)
    gaps = np.linalg.norm(np.diff(leg.positions, axis=0), axis=1)
    if (elapsed <= 0.0).any():
        report.faults.append(f"{leg}: time does not advance after {leg.times[:-1][elapsed <= 0.0][0]:.2f} s")
    for k in np.flatnonzero(gaps > speed * np.maximum(elapsed, 0.0) + 0.01)[:1]:
        report.faults.append(
            f"{leg}: {gaps[k]:.1f} m in {elapsed[k]:.2f} s after {leg.times[k]:.2f} s is too fast"
        )
    walk = Walk.of(leg.times, leg.positions, leg.obstacles)
    report.length += float(gaps.sum())
    if (walk.positions[:, 2] < -0.01).any():
        report.faults.append(f"{leg}: above the surface by {-walk.positions[:, 2].min():.2f} m")
    booked = {kind: np.zeros(len(walk.positions), bool) for kind in ("land", "sea bed")}
    if coast is not None:
        booked["land"] = coast.on_land(walk.positions)
        _book(leg, walk, "land", booked["land"], "", report)
        for first, last in events(coast.outside(walk.positions)):
            report.faults.append(f"{leg}: outside the chart {walk.between(first, last)}")
    if bed is not None:
        booked["sea bed"] = _sound(leg, walk, bed, report)
    clearance = np.linalg.norm(walk.obstacles - walk.positions[:, None], axis=2) - leg.radii
    # What stands for a known obstacle encloses it: that itself is looked at below.
    apart = clearance[:, met] if known else clearance
    report.obstacle_clearance = min(report.obstacle_clearance, apart.min(initial=np.inf))
    report.obstacle_metres += float(walk.metres[(clearance < 0.0).any(axis=1)].sum())
    for number, inside in enumerate((clearance < 0.0).T):
        for first, last in events(inside):
            report.obstacle_hits += 1
            report.faults.append(f"{leg}: inside obstacle {number} {walk.between(first, last)}")

    for obstacle in known:
        distance = _distance(obstacle, walk)
        report.obstacle_clearance = min(report.obstacle_clearance, float(distance.min()))
        report.obstacle_metres += float(walk.metres[distance < 0.0].sum())
        for first, last in events(distance < 0.0):
            report.obstacle_hits += 1
            report.faults.append(f"{leg}: inside {obstacle.name!r} {walk.between(first, last)}")
    return walk, booked


def _book(leg: Leg, walk: Walk, kind: str, inside: Mask, where: str, report: CheckReport) -> None:
    """Book the stretches of a walk on land or below the sea bed; `where` names the file that tells it."""
    stretches = list(events(inside))
    metres = float(walk.metres[inside].sum())
    if kind == "land":
        report.coast_hits += len(stretches)
        report.coast_metres += metres
    else:
        report.seabed_hits += len(stretches)
        report.seabed_metres += metres
    words = "on land" if kind == "land" else "below the sea bed"
    report.faults += [f"{leg}: {words}{where} {walk.between(first, last)}" for first, last in stretches]


def _look_again(
    leg: Leg,
    walk: Walk,
    booked: dict[str, Mask],
    places: tuple[Array, Array],
    sources: Sequence[Source],
    report: CheckReport,
) -> None:
    """Book what a walk meets of land and sea bed in the scenario's files and is not booked yet."""
    for source in sources:
        blocked = source.blocked(*places, walk.positions[:, 2])
        if source.closed is not None:
            _look_at_hours(leg, walk, blocked, source, report)
            continue
        _book(leg, walk, source.kind, blocked & ~booked[source.kind], f" of {source.name}", report)
        booked[source.kind] = booked[source.kind] | blocked


def _look_at_hours(leg: Leg, walk: Walk, inside: Mask, source: Source, report: CheckReport) -> None:
    """Tell where a leg, or what is waited and done at its ends, is in an area while it is closed."""
    assert source.closed is not None
    there = inside.copy()
    there[inside] = source.closed(walk.times[inside])
    for first, last in events(there):
        report.faults.append(f"{leg}: in the closed area {source.name!r} {walk.between(first, last)}")
    stays = [(bool(inside[0]), walk.times[0] - leg.t_hold, walk.times[0])]
    stays += [(bool(inside[-1]), walk.times[-1], walk.times[-1] + leg.t_wait + leg.t_task)]
    for within, begins, ends in stays:
        moments = np.append(np.arange(begins, ends, _STAY), ends - _MOMENT)
        if within and ends > begins and source.closed(moments).any():
            report.faults.append(
                f"{leg}: stays in the closed area {source.name!r} between {begins:.0f} and {ends:.0f} s"
            )


def _distance(obstacle: KnownObstacle, walk: Walk) -> NDArray[np.float64]:
    """Return distance [n] m of a walk to the surface of an upright cylinder, negative inside."""
    centre = np.asarray(obstacle.position) + walk.times[:, None] * np.asarray(obstacle.velocity)
    level = np.linalg.norm(walk.positions[:, :2] - centre, axis=1) - obstacle.radius
    depth = walk.positions[:, 2]
    beyond = np.maximum(obstacle.depth_min - depth, depth - obstacle.depth_max)
    return np.where(beyond > 0.0, np.hypot(np.maximum(level, 0.0), beyond), level)


def _sound(leg: Leg, walk: Walk, bed: Bed, report: CheckReport) -> Mask:
    """Book what a walk meets of the sea bed, and return where it is below it."""
    altitude = bed.altitude(walk.positions)
    below = altitude < 0.0
    near = (altitude < bed.clearance - ALTITUDE_TOLERANCE) & ~below
    report.seabed_altitude = min(report.seabed_altitude, float(altitude.min()))
    _book(leg, walk, "sea bed", below, "", report)
    for first, last in events(near):
        least = f"{altitude[first : last + 1].min():.1f} m above the sea bed, under {bed.clearance:g} m,"
        report.faults.append(f"{leg}: {least} {walk.between(first, last)}")
    for first, last in events(bed.outside(walk.positions)):
        report.faults.append(f"{leg}: beyond the known sea bed {walk.between(first, last)}")
    return below


def _metres(value: float) -> str:
    return "nothing nearby" if np.isinf(value) else f"{value:.1f} m"


__all__ = ["CheckReport", "ResultError", "check_dataset", "check_run"]
