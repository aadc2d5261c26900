"""Pictures of a run, after the paper's figures. No display is needed and no global state is kept."""

from pathlib import Path

from auvplan.io.files import output_folder
from auvplan.plot.chart import draw_chart, plot_chart
from auvplan.plot.convergence import plot_convergence
from auvplan.plot.currents import plot_currents
from auvplan.plot.departures import plot_departures
from auvplan.plot.legs import busiest_leg
from auvplan.plot.mission import plot_mission
from auvplan.plot.obstacles import plot_obstacles
from auvplan.plot.study import draw_study
from auvplan.plot.style import save
from auvplan.plot.timeline import plot_timeline
from auvplan.voyage.records import MissionRun

_FIGURES = {
    "mission.png": plot_mission,
    "timeline.png": plot_timeline,
    "currents.png": plot_currents,
    "obstacles.png": plot_obstacles,
    "convergence.png": plot_convergence,
}


def draw_run(run: MissionRun, folder: str | Path) -> list[Path]:
    """Write all figures of a run; those of a single leg show the one with most re-plans.

    Args:
        run: as sailed; one that failed on the way is fine.
        folder: made where missing.

    Returns:
        The paths of the pictures.

    Raises:
        OutputError: the folder or a file cannot be written; one line that names it.
    """
    target = output_folder(folder)
    return [save(plot(run), target / name) for name, plot in _FIGURES.items()]


__all__ = [
    "busiest_leg",
    "draw_chart",
    "draw_run",
    "draw_study",
    "plot_chart",
    "plot_convergence",
    "plot_currents",
    "plot_departures",
    "plot_mission",
    "plot_obstacles",
    "plot_timeline",
]
