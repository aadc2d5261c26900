"""Checks the whole track of a saved run again and adds up every time.

Visits and tasks are counted again from the track and from what the run was planned for; land, sea bed,
obstacles and closed areas are those that its file keeps. On request polygons and sea beds in the files that
its scenario names are looked at as well.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.check import inputs, kinematics, legs, navigation, tasks
from auvplan.check.saved import Leg, Saved, read_legs, require
from auvplan.check.track import Array, Bed, Coast, Mask, SampledTrack, events
from auvplan.errors import AuvplanError
from auvplan.runtime.files import MISSION, SUMMARY, ResultError, read_mission, read_summary

#: No current is faster, m/s.
CURRENT_MAX = 5.0

#: Metres by which an altitude may fall short of the clearance that was asked for: far above rounding.
ALTITUDE_TOLERANCE = 0.1

#: m; the simulator puts obstacles that find no room on a leg, or have not appeared yet, deeper than this.
NOWHERE = 1e5


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
        length: m checked.
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
            f"checked {self.length:,.0f} m on {_counted(self.legs, 'leg')}",
            f"collisions: {self.coast_hits} with the coast ({self.coast_metres:.1f} m), "
            f"{self.obstacle_hits} with obstacles ({self.obstacle_metres:.1f} m), "
            f"{self.seabed_hits} with the sea bed ({self.seabed_metres:.1f} m)",
            f"least clearance: coast {_metres(self.coast_clearance)}, "
            f"obstacles {_metres(self.obstacle_clearance)}, sea bed {_metres(self.seabed_altitude)}",
            *(f"note: {note}" for note in self.notes),
            *(f"fault: {fault}" for fault in self.faults),
            "no faults" if self.ok else _counted(len(self.faults), "fault"),
        ]
        return "\n".join(lines)


def check_run(folder: str | Path, sources: bool = False) -> CheckReport:
    """Check a saved run: coast, obstacles, sea bed, times, places, edges and tasks of every executed leg.

    Args:
        folder: that `save_run` wrote.
        sources: look also at the files of land, closed areas and sea bed that its scenario names, by code of
            its own over pyogrio, rasterio and xarray.

    Returns:
        What was found; `CheckReport.ok` is whether it is free of faults.

    Raises:
        ResultError: a file is missing, damaged or incomplete; one line that names it.
    """
    summary, dataset = read_summary(folder), read_mission(folder)
    require(summary, dataset, Path(folder))
    try:
        return check_dataset(summary, dataset, sources)
    except AuvplanError:
        raise
    except Exception as error:  # whatever values of the wrong kind lead to
        line = f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
        raise ResultError(f"{Path(folder) / MISSION}: cannot be checked ({line})") from None


def check_dataset(summary: dict[str, Any], dataset: xr.Dataset, sources: bool = False) -> CheckReport:
    """`check_run` on a summary and a dataset as `save_run` writes them."""
    report = CheckReport()
    run = Saved(summary, dataset, list(read_legs(dataset)), report.notes)
    for faults in (
        legs.site_faults, inputs.source_faults, legs.graph_faults, legs.place_faults, legs.time_faults,
        legs.speed_faults, legs.energy_faults, legs.figure_faults, legs.promise_faults, legs.route_faults,
        kinematics.motion_faults, tasks.task_faults, tasks.window_faults,
    ):  # fmt: skip
        report.faults += faults(run)
    known, closed = inputs.read_obstacles(run), inputs.read_closed_areas(run)
    files = ()
    if sources:
        from auvplan.check.sources import read_sources

        files = read_sources(run)
    places = inputs.places_of(run) if files else None
    coast = Coast.of(dataset) if "passability" in run else None
    shore = None if coast is None else Coast.beyond(dataset)
    bed = Bed.of(dataset) if "seabed_depth" in run else None
    report.faults += navigation.position_faults(run, bed)
    for leg in run.legs:
        if not leg.executed or (samples := _sampled(leg, leg.speed + CURRENT_MAX, report)) is None:
            continue
        track = _Track(leg, samples, report)
        if coast is not None:
            track.record("land", coast.on_land(samples.positions), "on land")
            track.fault("outside the chart", coast.outside(samples.positions))
        if bed is not None:
            track.pass_over(bed)
        if shore is not None:
            track.near("coast_clearance", shore.distances(leg.positions))
        for area in closed:
            track.pass_through(area)
        met = np.ones(len(leg.radii), bool)
        if "obstacle_kind" in run:
            kinds = run.data["obstacle_kind"]
            names, codes = str(kinds.attrs["flag_meanings"]).split(), kinds.values[leg.number][: len(met)]
            met = np.array([names[int(code)] != "known" for code in codes], bool)
        track.pass_by(known, met)
        if places is not None:
            here = *places(*samples.positions[:, :2].T), samples.positions[:, 2]
            for source in files:
                track.record(source.kind, source.blocked(*here), f"{_WHERE[source.kind]} of {source.name}")
    report.faults += _late_path_faults(run, coast, bed, closed)
    if summary.get("collisions", 0) and not report.collisions:
        report.faults.append(f"collisions is {summary['collisions']} in {SUMMARY}, none was found")
    return report


def _late_path_faults(
    run: Saved, coast: Coast | None, bed: Bed | None, closed: Sequence[inputs.ClosedArea]
) -> list[str]:
    """Return where paths of a plan's rule lead over land, below the sea bed or into closed areas."""
    found = []
    for turn in (run.stated("promise") or {}).get("turns", ()):
        places = np.asarray(turn["positions"], float)
        times = np.linspace(0.0, float(turn["takes"]), len(places))
        samples = SampledTrack.of(times, places, np.zeros((len(places), 0, 3)))
        where = samples.positions
        looked = [
            (f"in the closed area {area.name!r}", area.holds(where)) for area in closed if area.spans is None
        ]
        if coast is not None:
            looked += [("on land", coast.on_land(where)), ("outside the chart", coast.outside(where))]
        if bed is not None:
            looked.append(("below the sea bed", bed.altitude(where) < 0.0))
        found += [
            f"path if late after leg {turn['leg']}: {text} {samples.between(*stretch)} after it begins"
            for text, inside in looked
            for stretch in events(inside)
        ]
    return found


def _sampled(leg: Leg, speed: float, report: CheckReport) -> SampledTrack | None:
    """Sample one leg in steps of at most a metre, at `speed` m/s at most; None where it is not finite."""
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
    samples = SampledTrack.of(leg.times, leg.positions, leg.obstacles)
    report.length += float(gaps.sum())
    if (samples.positions[:, 2] < -0.01).any():
        report.faults.append(f"{leg}: above the surface by {-samples.positions[:, 2].min():.2f} m")
    return samples


#: What a collision with land and with the sea bed is counted as, and where it is.
_COUNTED = {"land": "coast", "sea bed": "seabed"}
_WHERE = {"land": "on land", "sea bed": "below the sea bed"}


class _Track:
    """A leg under check: what its samples meet goes into the report."""

    def __init__(self, leg: Leg, samples: SampledTrack, report: CheckReport) -> None:
        self.leg, self.samples, self.report = leg, samples, report
        # Where it is known to be on land and below the sea bed.
        self.recorded = {kind: np.zeros(len(samples.positions), bool) for kind in _COUNTED}
        # Ends of the leg, 0 or -1, at which the vehicle stays, and s from when to when.
        begins, ends = float(leg.times[0]), float(leg.times[-1])
        stays = (0, begins - leg.t_hold, begins), (-1, ends, ends + leg.t_wait + leg.t_task)
        self.stays = [stay for stay in stays if stay[2] > stay[1]]

    def fault(self, text: str, inside: Mask) -> int:
        """Report a fault for every stretch of samples [n] that is inside; return how many there are."""
        stretches = list(events(inside))
        self.report.faults += [
            f"{self.leg}: {text} {self.samples.between(first, last)}" for first, last in stretches
        ]
        return len(stretches)

    def near(self, name: str, distances: Array) -> None:
        """Take account of distances, m, in the least of this name."""
        least = min(getattr(self.report, name), float(distances.min(initial=np.inf)))
        setattr(self.report, name, least)

    def collide(self, kind: str, inside: Mask, text: str) -> None:
        """Count the stretches inside as hits of a kind, "coast", "obstacle" or "seabed"."""
        hits, metres = f"{kind}_hits", f"{kind}_metres"
        setattr(self.report, hits, getattr(self.report, hits) + self.fault(text, inside))
        metres_inside = getattr(self.report, metres) + float(self.samples.metres[inside].sum())
        setattr(self.report, metres, metres_inside)

    def record(self, kind: str, inside: Mask, text: str) -> None:
        """Count what is on "land" or below the "sea bed", and is not known to be yet."""
        self.collide(_COUNTED[kind], inside & ~self.recorded[kind], text)
        self.recorded[kind] = self.recorded[kind] | inside

    def pass_over(self, bed: Bed) -> None:
        """Look at the sea bed."""
        altitude = bed.altitude(self.samples.positions)
        self.near("seabed_altitude", altitude)
        self.record("sea bed", altitude < 0.0, "below the sea bed")
        for first, last in events((altitude < bed.clearance - ALTITUDE_TOLERANCE) & (altitude >= 0.0)):
            least = f"{altitude[first : last + 1].min():.1f} m above the sea bed, under {bed.clearance:g} m,"
            self.report.faults.append(f"{self.leg}: {least} {self.samples.between(first, last)}")
        self.fault("beyond the known sea bed", bed.outside(self.samples.positions))

    def pass_through(self, area: inputs.ClosedArea) -> None:
        """Look for the leg, and stays at its ends, in an area while it is closed."""
        inside, text = area.holds(self.samples.positions), f"in the closed area {area.name!r}"
        if area.spans is None:
            self.record("land", inside, text)
            return
        self.fault(text, inside & area.closed(self.samples.times, self.samples.times))
        for end, begins, ends in self.stays:
            if inside[end] and area.closed(np.array([begins]), np.array([ends])).any():
                stay = f"stays {text} between {begins:.0f} and {ends:.0f} s"
                self.report.faults.append(f"{self.leg}: {stay}")

    def pass_by(self, known: Sequence[inputs.Cylinder], met: Mask) -> None:
        """Look at obstacles: those of the leg, of which `met` [M] were not known before, and the known."""
        leg, samples, report = self.leg, self.samples, self.report
        clearance = np.linalg.norm(samples.obstacles - samples.positions[:, None], axis=2) - leg.radii
        clearance = np.where(samples.obstacles[:, :, 2] > NOWHERE, np.inf, clearance)
        # What stands for a known obstacle encloses it: that itself is looked at below.
        self.near("obstacle_clearance", clearance[:, met] if known else clearance)
        report.obstacle_metres += float(samples.metres[(clearance < 0.0).any(axis=1)].sum())
        for number, inside in enumerate((clearance < 0.0).T):
            report.obstacle_hits += self.fault(f"inside obstacle {number}", inside)
        for obstacle in known:
            distance = obstacle.distance(samples.positions, samples.times)
            self.near("obstacle_clearance", distance)
            self.collide("obstacle", distance < 0.0, f"inside {obstacle.name!r}")
            for end, begins, ends in self.stays:
                moments = np.linspace(begins, ends, 2 + int(ends - begins))
                places = np.broadcast_to(leg.positions[end], (len(moments), 3))
                distance = obstacle.distance(places, moments)
                self.near("obstacle_clearance", distance)
                if (inside := distance[1:-1] < 0.0).any():
                    report.obstacle_hits += 1
                    comes = f"comes over it where it stays, at {moments[1:-1][inside][0]:.0f} s"
                    report.faults.append(f"{leg}: {obstacle.name!r} {comes}")


def _counted(count: int, noun: str) -> str:
    return f"{count:,} {noun}" if count == 1 else f"{count:,} {noun}s"


def _metres(value: float) -> str:
    return "nothing nearby" if np.isinf(value) else f"{value:.1f} m"


__all__ = ["CheckReport", "ResultError", "check_dataset", "check_run"]
