"""Runs a study: in this process, on all cores of this machine, or on the workers of a Dask cluster."""

import multiprocessing
import os
import time
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.executive.context import make_context
from auvplan.runtime import cores
from auvplan.scenario.waypoints import make_graph
from auvplan.study.cluster import connected, run_on_cluster
from auvplan.study.design import Design, StudyError
from auvplan.study.statistics import summarise
from auvplan.study.store import RUNS, Store, load_study
from auvplan.study.table import table
from auvplan.study.worker import Done, Finished, Job, Report, UnderWay, run_job, work

#: Missions done, missions in all, and the share of the work that is done.
Progress = Callable[[int, int, float], None]

#: Settings of JAX that worker processes take over.
JAX_SETTINGS = ("jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs", "jax_enable_x64")


@dataclass
class _Collector:
    """Takes reports: writes missions to the store and keeps count."""

    store: Store
    left: int
    progress: Progress | None
    done: int = 0
    under_way: dict[Any, float] = field(default_factory=dict)
    compile_seconds: float = 0.0

    def take(self, report: Report, worker: Any = None) -> None:
        """Book a report of a worker."""
        if isinstance(report, Done):
            self.store.add(report.case, report.seed, report.row)
            self.done += 1
        elif isinstance(report, UnderWay):
            self.under_way[worker] = report.seconds
        else:
            # Workers compile side by side.
            self.compile_seconds = max(self.compile_seconds, report.compile_seconds)
            self.under_way.pop(worker, None)
        if self.progress:
            design = self.store.design
            come = sum(self.under_way.values()) / design.scenario.mission.time_available
            share = (self.done + come) / max(self.left, 1)
            before = design.count * len(design.cases) - self.left
            self.progress(before + self.done, before + self.left, min(share, 1.0))


def run_study(
    design: Design,
    out: str | Path,
    *,
    folder: str | Path | None = None,
    resume: bool = False,
    force: bool = False,
    workers: int | None = None,
    dask: str | None = None,
    save_runs: bool = False,
    progress: Progress | None = None,
) -> xr.Dataset:
    """Run the missions of a study, and write `missions.nc` and `summary.json`.

    Finished missions are on disk as they finish; their results depend on settings and seed alone, not on
    what runs beside them, on which machine's worker, or on how often the study was broken off.

    Args:
        design: what to run.
        out: folder of the study, created if needed.
        folder: that relative paths in the scenario start from; that of its file if absent.
        resume: continue the study in `out`; a finished one is extended where the design has more missions.
        force: replace the study in `out`.
        workers: processes on this machine; 1 runs in this one; None is one a core.
        dask: address of a Dask scheduler, or path of its scheduler file, whose workers do the work instead.
        save_runs: whether to save a whole result of each mission as well, in `store.RUNS` of the folder.
        progress: called with missions done, missions in all, and the share of the work that is done.

    Returns:
        The dataset, see `auvplan.study.table.VARIABLES`.

    Raises:
        StudyError: the folder holds a study that is not to be replaced, or another one than is to be resumed,
            or missions without a result that `save_runs` asks for; a worker died, Dask is not there.
        ScenarioError, ChartError: a scenario cannot be built.
        OutputError: the folder cannot be written.
    """
    folder = design.scenario.folder if folder is None else folder
    # What cannot be built or reached is reported before anything is written.
    for case in design.cases:
        make_graph(case, make_context(case, folder).area, np.random.default_rng(0))
    with connected(dask) if dask is not None else nullcontext() as client:
        store = Store(out, design, resume, force, folder, save_runs)
        if resume and store.finished:
            return load_study(out)
        tasks, started = store.missing(), time.perf_counter()
        collector = _Collector(store, len(tasks), progress)
        saves = str((Path(out) / RUNS).resolve()) if save_runs else None

        def job(chosen: list[tuple[int, int]]) -> Job:
            return Job(design.plain(), str(Path(folder).resolve()), tuple(chosen), saves)

        count = min(workers or cores.count(), len(tasks))
        if client is not None:
            run_on_cluster(client, tasks, job, collector.take)
        elif count == 1:
            run_job(job(tasks), collector.take)
        elif tasks:
            _run_on_cores([job(tasks[k::count]) for k in range(count)], collector.take)

    swept = any(sweep.field.split(".")[0] in ("chart", "area") for sweep in design.sweeps)
    dataset = table(design, store.rows(), None if swept else make_context(design.scenario, folder).area.chart)
    clock = {
        "missions": len(tasks),
        "wall_s": time.perf_counter() - started,
        "compile_s": collector.compile_seconds,
        "workers": count if dask is None else dask,
    }
    store.finish(dataset, summarise(dataset) | {"clock": clock})
    return load_study(out)


def _run_on_cores(jobs: list[Job], take: Callable[[Report, Any], None]) -> None:
    """A process a job, each on a core of its own; none outlives the call."""
    import jax

    context = multiprocessing.get_context("spawn")
    settings = {name: getattr(jax.config, name) for name in JAX_SETTINGS}
    numbers = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [None]
    processes: dict[Connection, Any] = {}  # by the pipes that their reports come through
    try:
        for number, job in enumerate(jobs):
            ours, theirs = context.Pipe(duplex=False)
            core = numbers[number % len(numbers)]
            process = context.Process(target=work, args=(job, core, settings, theirs), daemon=True)
            with cores.ignoring_interrupts():
                process.start()
            processes[ours] = process
            theirs.close()
        left = list(processes)
        while left:
            for pipe in wait(left):
                assert isinstance(pipe, Connection)
                try:
                    report = pipe.recv()
                except (EOFError, OSError):
                    line = "a worker process died (out of memory?); continue the study with --resume"
                    raise StudyError(line) from None
                if isinstance(report, Exception):
                    raise report
                take(report, pipe)
                if isinstance(report, Finished):
                    left.remove(pipe)
    finally:
        for process in processes.values():
            process.terminate()
            process.join()
