"""Whether chart, sea bed and current agree on where land is, and jobs on where the area is."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.errors import ScenarioError, warn
from auvplan.io.land import Corners
from auvplan.mission.jobs import Jobs
from auvplan.ocean.chart import Chart
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site, is_place

if TYPE_CHECKING:
    from auvplan.io.currents import CurrentFile

Mask = NDArray[np.bool_]

#: Places along the longer side of the area at which two sources are compared.
_PLACES = 240
#: Accuracy of a coast, in cells of the coarser source.
_CELLS = 1.5
#: Shares of the area, and of all land in it, from which on two sources contradict each other.
_OF_AREA, _OF_LAND = 0.02, 0.1
#: Turned over, the chart agrees much better if less than this share of the contradiction is left.
_LEFT = 0.4
#: Jobs farther off than this, in diagonals of the area, are of another place, or in other units.
_AREAS = 10.0


@dataclass(frozen=True)
class _Land:
    """Where one source has land."""

    name: str  # as messages call it
    dry: Mask  # [nx, ny] land
    unsure: Mask  # [nx, ny] neither land nor open water
    corner: NDArray  # [2] m, south-west
    size: NDArray  # [2] m, of a pixel
    cell: float  # m, of the source

    def at(self, north: NDArray, east: NDArray, turned: slice | tuple[slice, slice] = slice(None)) -> Mask:
        """[2, n, m] land, and neither land nor water; of the raster turned over if so asked."""
        i, j = (
            np.clip(np.floor((axis - self.corner[k]) / self.size[k]).astype(int), 0, self.dry.shape[k] - 1)
            for k, axis in enumerate((north, east))
        )
        return np.stack([mask[turned][np.ix_(i, j)] for mask in (self.dry, self.unsure)])


#: Turns that a raster may have, and what is wrong with it then.
_TURNS: dict[str, tuple[tuple[slice, slice], str]] = {
    "north to south": ((slice(None, None, -1), slice(None)), "upside down"),
    "east to west": ((slice(None), slice(None, None, -1)), "mirrored"),
}


def warn_of_contradictions(
    scenario: Scenario, chart: Chart | None, seabed: Seabed | None, currents: "Sequence[CurrentFile | None]"
) -> None:
    """Compare where chart without closed areas, sea bed, forecast and true current have land.

    Places nearer to a coast than coarse files resolve are left out.

    Warns:
        ScenarioWarning: the share of the area on which two contradict each other, and whether the chart seems
            to be upside down or mirrored.
    """
    box = scenario.box
    low, extent = np.asarray(box[0][:2]), np.subtract(box[1][:2], box[0][:2])
    counts = np.maximum(np.ceil(_PLACES * extent / extent.max()).astype(int), 8)
    step = extent / counts
    north, east = (low[k] + step[k] * (np.arange(counts[k]) + 0.5) for k in range(2))
    first, *others = _sources(scenario, chart, seabed, currents)
    for other in others:
        room = _CELLS * max(first.cell, other.cell) / step
        theirs = other.at(north, east)
        found = _contradiction(first.at(north, east), theirs, room)
        if found is None:
            continue
        share, alone, theirs_alone = found
        hint = ""
        for axis, (turned, wrong) in _TURNS.items():
            better = _contradiction(first.at(north, east, turned), theirs, room)
            if first.dry.any() and (better[0] if better else 0.0) < _LEFT * share:
                hint = f": turned over {axis} it would agree much better, as if it was {wrong}"
                break
        warn(
            f"{first.name} and {other.name} contradict each other on {share:.0%} of the area: {alone:.0%} is "
            f"land by the first alone, {theirs_alone:.0%} by the second alone{hint}"
        )


def _sources(
    scenario: Scenario, chart: Chart | None, seabed: Seabed | None, currents: "Sequence[CurrentFile | None]"
) -> list[_Land]:
    """Return the sources that show land, each file once; the chart first, then the sea bed."""
    found, source = [], scenario.chart.source
    if chart is not None:
        passability, size = np.asarray(chart.passability), float(chart.pixel_size)
        name = f"the chart ({scenario.chart.file or scenario.chart.image or f'source {source!r}'})"
        dry, unsure = passability == 0.0, (passability > 0.0) & (passability < 1.0)
        found.append(_Land(name, dry, unsure, np.asarray(chart.lower, float), np.full(2, size), size))
    same = scenario.bathymetry.source == "chart" or scenario.bathymetry.source == source == "current"
    if seabed is not None and not same:
        depth, size = np.asarray(seabed.depth), float(seabed.pixel_size)
        name, dry = f"the sea bed ({scenario.bathymetry.file or 'of the current'})", depth <= 0.0
        corner = np.asarray(seabed.lower, float)
        found.append(_Land(name, dry, np.zeros_like(dry), corner, np.full(2, size), 2.0 * size))
    if not found:
        dry = np.zeros((1, 1), bool)
        name = "open water (chart.source 'none')"
        found.append(_Land(name, dry, dry, np.zeros(2), np.full(2, np.inf), 0.0))
    own = source == "current" or scenario.bathymetry.source == "current"
    of, settings = {}, scenario.current
    for current, files in zip(currents, (settings.files, settings.truth), strict=True):
        if current is not None and not own:
            of.setdefault(current, files or ())
    for current, files in of.items():
        name = f"the current ({files if isinstance(files, str) else ', '.join(files)})"
        size = np.asarray(current.spacing, float)
        dry = ~current.water
        corner = np.asarray(current.origin, float) - size / 2.0
        found.append(_Land(name, dry, ~current.covered, corner, size, float(size.max())))
    return found


def _contradiction(one: Mask, other: Mask, room: NDArray) -> tuple[float, float, float] | None:
    """Shares of the area that differ, that are land in one alone, and in the other; or None.

    Within `room` [2] places of a coast nothing is compared.
    """
    sampling = tuple(1.0 / np.maximum(room, 1e-9))
    far = ~(one[1] | other[1])
    for land in (one[0], other[0]):
        for side in (land, ~land):
            if side.any() and not side.all():
                far &= ~side | (np.asarray(scipy.ndimage.distance_transform_edt(side, sampling)) > 1.0)
    apart = (one[0] != other[0]) & far
    share, land = float(apart.mean()), float((one[0] | other[0]).mean())
    if share < _OF_AREA or share < _OF_LAND * land:
        return None
    return share, float((apart & one[0]).mean()), float((apart & other[0]).mean())


def check_jobs(jobs: Jobs, site: Site | None, scenario: Scenario) -> None:
    """Refuse jobs all of which are of another place, and warn of implausible ones.

    Raises:
        ScenarioError: none lies in the area, and they are far off or their coordinates seem swapped.

    Warns:
        ScenarioWarning: two jobs in one place, jobs that last longer than the time available, jobs none of
            which has a priority.
    """
    file, every = scenario.mission.jobs, [*jobs.points, *jobs.lines]
    if not every:
        return
    places = np.asarray([position for _, position in jobs.places])
    _require_about(str(file), places, site, scenario.box)
    time = scenario.mission.time_available
    long = [job for job in every if job.duration > time]
    if long:
        more = f" and {len(long) - 1} more" if len(long) > 1 else ""
        warn(
            f"{file}: job {long[0].name!r}{more} takes {long[0].duration:g} s, longer than the {time:g} s of "
            "mission.time_available: duration is in seconds"
        )
    if not any(job.priority > 0.0 for job in every):
        warn(f"{file}: no job has a priority above 0: there is nothing to be gained by visiting them")
    named: dict[tuple[float, ...], str] = {}
    twice = []
    for point in jobs.points:
        first = named.setdefault(tuple(np.round(point.position, 2)), point.name)
        if first != point.name:
            twice.append(f"{first!r} and {point.name!r}")
    if twice:
        more = f", and {len(twice) - 1} more pairs" if len(twice) > 1 else ""
        warn(f"{file}: jobs {twice[0]} lie in the same place{more}")


def warn_of_idle_obstacles(
    obstacles: tuple[KnownObstacle, ...], scenario: Scenario, chart: Chart | None
) -> None:
    """Warn where no obstacle of a file comes near the area, or one stands on the land of a chart.

    Warns:
        ScenarioWarning: none reaches into the area at any time of the mission; one lies wholly on land.
    """
    if not obstacles:
        return
    low, high = (np.asarray(corner[:2]) for corner in scenario.box)
    nearest, ashore = np.inf, []
    for obstacle in obstacles:
        reach = obstacle.radius + np.hypot(*obstacle.velocity) * scenario.mission.time_available
        beyond = np.maximum(np.maximum(low - obstacle.position, obstacle.position - high), 0.0)
        nearest = min(nearest, float(np.linalg.norm(beyond)) - reach)
        if chart is not None and not beyond.any() and not obstacle.moves:
            inland = -float(chart.distance(*np.asarray(obstacle.position)[:, None])[0])
            if inland > obstacle.radius:
                ashore.append(f"{obstacle.name!r} lies on land, {inland:,.0f} m from the water")
    if ashore:
        more = f", and {len(ashore) - 1} more" if len(ashore) > 1 else ""
        warn(f"{scenario.obstacles.file}: {ashore[0]}{more}: no path is changed by it")
    if nearest > 0.0:
        warn(
            f"{scenario.obstacles.file}: none of its obstacles reaches into the area, the nearest is "
            f"{nearest / 1000.0:,.1f} km from it"
        )


def _require_about(file: str, places: NDArray, site: Site | None, box: Corners) -> None:
    low, high = np.asarray(box[0][:2]), np.asarray(box[1][:2])

    def inside(at: NDArray) -> Mask:
        return np.asarray(((at >= low - 1e-6) & (at <= high + 1e-6)).all(axis=-1))

    flat = places[:, :2]
    if inside(flat).any():
        return
    which = "its job lies" if len(flat) == 1 else f"all its {len(flat)} places lie"
    nearest = float(np.linalg.norm(np.maximum(np.maximum(low - flat, flat - high), 0.0), axis=1).min())
    turns = {"north and east seem swapped in it": flat[:, ::-1]}
    if site is not None and (np.linalg.norm(flat, axis=1) < 1.9e7).all():
        longitude, latitude = site.to_geographic(flat[:, 0], flat[:, 1])
        if all(is_place(y, x) for x, y in zip(longitude, latitude, strict=True)):
            such = f"such as ({longitude[0]:.4f}, {latitude[0]:.4f}), or in the scenario's site"
            swapped = np.stack(site.to_local(latitude, longitude), axis=-1)
            turns = {f"longitude and latitude seem swapped in it, {such}": swapped} | turns
    for what, turned in turns.items():
        if inside(turned).mean() > 0.5:
            raise ScenarioError(f"{file}: {which} outside the area; {what}")
    if nearest > _AREAS * float(np.linalg.norm(high - low)):
        where = ""
        if site is not None and nearest < 1.9e7:
            at, middle = (np.ravel(site.to_geographic(*p)) for p in (flat[0], (low + high) / 2.0))
            where = (
                f": the first is at longitude {at[0]:.4f}, latitude {at[1]:.4f}, the area about longitude "
                f"{middle[0]:.4f}, latitude {middle[1]:.4f}"
            )
        units = "; metres of a projection such as UTM are not metres from the site" if nearest > 1e5 else ""
        raise ScenarioError(
            f"{file}: {which} {nearest / 1000.0:,.0f} km and more from the area{where}{units}"
        )
