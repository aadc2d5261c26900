"""The waters of a scenario: what all its missions share, before chance adds the rest."""

from dataclasses import dataclass

from auvplan.mission.jobs import Jobs
from auvplan.ocean.chart import Chart
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.site import Site


@dataclass(frozen=True)
class Waters:
    """What is known of a sea area.

    Attributes:
        chart: coast and uncertain areas, or None for open water.
        seabed: or None where it is out of reach.
        site: where and when, or None for local metres alone.
        forecast: the current as planners are told it, from files; None where it is vortices.
        truth: the current that is sailed in, from files.
        jobs: from a file; None where waypoints are drawn.
        obstacles: that are known before the mission.
        notes: assumptions that were made in reading the files, a line each.
    """

    chart: Chart | None = None
    seabed: Seabed | None = None
    site: Site | None = None
    forecast: GriddedCurrent | None = None
    truth: GriddedCurrent | None = None
    jobs: Jobs | None = None
    obstacles: tuple[KnownObstacle, ...] = ()
    notes: tuple[str, ...] = ()
