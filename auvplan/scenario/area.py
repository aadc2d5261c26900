"""The area of a scenario: what all its missions share, before chance adds the rest."""

from dataclasses import dataclass

from auvplan.mission.jobs import Jobs
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure, Zone
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.site import Site


@dataclass(frozen=True)
class OperatingArea:
    """What is known of a sea area.

    Attributes:
        chart: coast, closed and uncertain areas, or None for open water; closed areas count as coast.
        coast: coast and uncertain areas alone, as far beyond the area as distances to it are stated; or None.
        zones: areas that are closed at all times.
        members: other forecasts of the current from files, on grids of their own.
        seabed: or None where it is out of reach.
        site: where and when, or None for local metres alone.
        forecast: the current as planners know it, from files or of tides; None where it is vortices.
        truth: the true current, from files or of tides; None where it is vortices.
        jobs: from a file; None where waypoints are drawn.
        obstacles: that are known before the mission.
        closures: areas that are closed at some hours.
        no_surfacing: areas in which no vehicle surfaces for a fix.
        notes: assumptions that were made in reading the files, a line each.
        hours: s, from when to when `closures` and the windows of `jobs` were read; None for all times.
    """

    chart: Chart | None = None
    seabed: Seabed | None = None
    site: Site | None = None
    forecast: GriddedCurrent | HarmonicCurrent | None = None
    truth: GriddedCurrent | HarmonicCurrent | None = None
    jobs: Jobs | None = None
    obstacles: tuple[KnownObstacle, ...] = ()
    closures: tuple[Closure, ...] = ()
    notes: tuple[str, ...] = ()
    coast: Chart | None = None
    zones: tuple[Zone, ...] = ()
    members: tuple[GriddedCurrent, ...] = ()
    no_surfacing: tuple[Zone, ...] = ()
    hours: tuple[float, float] | None = None
