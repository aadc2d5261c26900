"""The figures of a run."""

from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any, Literal

from auvplan.plot.convergence import plot_convergence
from auvplan.plot.energy import plot_energy
from auvplan.plot.mission import plot_mission
from auvplan.plot.paths import plot_currents
from auvplan.plot.space import plot_obstacles
from auvplan.plot.style import save
from auvplan.plot.timeline import plot_timeline
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime.files import output_folder
from auvplan.view.scene import busiest_leg, done_leg

#: The figure of the mission as a whole, and that of runs whose vehicle has a power model.
MAP, ENERGY = "mission.png", "energy.png"

#: Of the whole run, by the name of their file.
_OF_RUN: dict[str, Callable[[MissionRun], Any]] = {
    MAP: plot_mission,
    "timeline.png": plot_timeline,
    ENERGY: plot_energy,
}

#: Of one leg, by the name of their file.
_OF_LEG: dict[str, Callable[[MissionRun, LegRecord], Any]] = {
    "currents.png": plot_currents,
    "obstacles.png": plot_obstacles,
    "convergence.png": plot_convergence,
}

#: Names of all files but `ENERGY`.
FIGURES = tuple(name for name in (*_OF_RUN, *_OF_LEG) if name != ENERGY)


def draw_run(
    run: MissionRun,
    folder: str | Path,
    names: Iterable[str] | None = None,
    *,
    leg: int | Literal["all"] | None = None,
    progress: Callable[[float, str], None] = lambda share, words: None,
) -> list[Path]:
    """Write the figures of a run; those of a single leg show that of `busiest_leg`, or the one asked for.

    Of a mission that ended before a path was planned there is the map alone, and of a run whose files kept
    no histories no convergence.

    Args:
        run: as executed; one that failed on the way is fine.
        folder: created if needed.
        names: of the figures, in `FIGURES`, or `ENERGY`; all of them if absent.
        leg: number of a done leg, from 1; or "all", whose figures have the number in their name.
        progress: called with the share that is done and the name of the next file.

    Raises:
        AuvplanError: there is no such leg; one line that says which there are.
        OutputError: the folder or a file cannot be written; one line that names it.
    """
    if leg == "all":
        shown = {f"-{number}": one for number, one in enumerate(run.done, start=1) if one.plans}
    else:
        one = busiest_leg(run) if leg is None else done_leg(run, leg)
        shown = {"": one} if one and one.plans else {}
    target = output_folder(folder)
    every = FIGURES if run.energy is None else (*FIGURES, ENERGY)
    wanted = list(every if names is None else names)
    if not shown:
        wanted = [name for name in wanted if name == MAP]
    drawn: dict[str, Callable[[], Any]] = {}
    for name in wanted:
        if name in _OF_RUN:
            drawn[name] = partial(_OF_RUN[name], run)
        for ending, one in shown.items() if name in _OF_LEG else ():
            if name != "convergence.png" or all(plan.history for plan in one.plans):
                drawn[name.replace(".png", f"{ending}.png")] = partial(_OF_LEG[name], run, one)
    written = []
    for number, (name, draw) in enumerate(drawn.items()):
        progress(number / len(drawn), name)
        written.append(save(draw(), target / name))
    return written
