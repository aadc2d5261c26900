"""A worker of a study: simulate missions and return their rows."""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

from auvplan.errors import ScenarioWarning
from auvplan.study.design import Design, by_case

if TYPE_CHECKING:
    from auvplan.study.table import Row

#: Seconds between two reports of progress.
_INTERVAL = 0.5


@dataclass(frozen=True)
class Job:
    """Missions for one worker, in plain data that travels between processes and machines.

    Attributes:
        design: as `Design.plain` gives it.
        folder: that relative paths in the scenario start from.
        tasks: case and seed of each mission.
        saves: folder for a whole result of each mission, or None.
    """

    design: dict[str, Any]
    folder: str
    tasks: tuple[tuple[int, int], ...]
    saves: str | None = None


@dataclass(frozen=True)
class Done:
    """A mission that has ended."""

    case: int
    seed: int
    row: "Row"


@dataclass(frozen=True)
class UnderWay:
    """Mission time that the missions under way have come to, added up, s."""

    seconds: float


@dataclass(frozen=True)
class Finished:
    """The job is done; `compile_seconds` of it went into first calls."""

    compile_seconds: float


Report = Done | UnderWay | Finished


def run_job(job: Job, report: Callable[[Report], None]) -> None:
    """Execute the missions of a job, and report each one as it ends."""
    from auvplan.executive import execute_missions, seed_keys
    from auvplan.io.results import save_run
    from auvplan.study.table import row_of

    design, compile_seconds = Design.of(job.design), 0.0
    clocks: dict[int, float] = {}  # s, of the missions under way
    spoke = 0.0

    def watch(number: int, now: float, _: str) -> None:
        nonlocal spoke
        clocks[number] = now
        if time.monotonic() - spoke > _INTERVAL:
            spoke = time.monotonic()
            report(UnderWay(sum(clocks.values())))

    for case, seeds in by_case(job.tasks).items():
        missions = execute_missions(
            design.cases[case], keys=seed_keys(seeds), seeds=seeds, folder=job.folder, progress=watch
        )
        spent = 0.0
        for number, run in missions:
            if job.saves is not None:
                save_run(run, Path(job.saves) / f"{case:04d}-{seeds[number]:08d}")
            clocks.pop(number, None)
            spent = run.compile_seconds
            report(Done(case, seeds[number], row_of(run)))
        compile_seconds += spent
    report(Finished(compile_seconds))


def run_whole_job(job: Job) -> Sequence[Report]:
    """Run a job in one go, for workers on other machines."""
    reports: list[Report] = []
    run_job(job, reports.append)
    return [report for report in reports if not isinstance(report, UnderWay)]


def _end_with_parent() -> None:
    """End this process when the one that started it is gone, also in the middle of a compilation."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def work(job: Job, core: int | None, settings: dict[str, Any], pipe: Connection) -> None:
    """Entry point of a process on this machine: run a job on one core and send its reports.

    Args:
        job: what to run.
        core: to stay on, or None. A process a core, with JAX on that core alone, does more than the threads
            of one process: these hand small operations to and fro.
        settings: of `jax.config`.
        pipe: that reports are sent through, and an error as it is.
    """
    Thread(target=_end_with_parent, daemon=True).start()
    if core is not None and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {core})
    # What may not be meant in the scenario was reported by the process that started this one.
    warnings.simplefilter("ignore", ScenarioWarning)
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)
    try:
        run_job(job, pipe.send)
    except BrokenPipeError:  # nobody listens any more
        return
    except Exception as error:
        pipe.send(error)
