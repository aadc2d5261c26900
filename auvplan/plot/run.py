"""The figures of a run."""

from collections.abc import Iterable
from pathlib import Path

from auvplan.files import output_folder
from auvplan.plot.convergence import plot_convergence
from auvplan.plot.currents import plot_currents
from auvplan.plot.legs import busiest_leg
from auvplan.plot.mission import plot_mission
from auvplan.plot.obstacles import plot_obstacles
from auvplan.plot.style import save
from auvplan.plot.timeline import plot_timeline
from auvplan.records import MissionRun

#: The figure of the mission as a whole.
MAP = "mission.png"

#: By the name of their file.
FIGURES = {
    MAP: plot_mission,
    "timeline.png": plot_timeline,
    "currents.png": plot_currents,
    "obstacles.png": plot_obstacles,
    "convergence.png": plot_convergence,
}


def draw_run(run: MissionRun, folder: str | Path, names: Iterable[str] | None = None) -> list[Path]:
    """Write the figures of a run; those of a single leg show the one with most re-plans.

    Of a mission that ended before a path was planned there is the map alone.

    Args:
        run: as sailed; one that failed on the way is fine.
        folder: created if needed.
        names: of the figures, in `FIGURES`; all of them if absent.

    Returns:
        The paths of the pictures.

    Raises:
        OutputError: the folder or a file cannot be written; one line that names it.
    """
    target = output_folder(folder)
    wanted = FIGURES if names is None else names
    if busiest_leg(run) is None:
        wanted = [name for name in wanted if name == MAP]
    return [save(FIGURES[name](run), target / name) for name in wanted]
