"""Small studies with light searches: in worker processes, on a cluster, as a command that can be killed.

`python -m tests.study.light OUT COUNT [--resume] [--workers N] [--hold N]` runs in calm water. With
`--hold N` the study stands still as soon as N missions are done and waits to be killed; in worker processes,
each does so after N missions of its own. Where one stands still, a file in the folder that `HOLDS` names says
so.

A mission that was executed once in a session of tests is not executed again in the process of the study:
`run_job` takes it from disk. Worker processes run all of theirs.
"""

import argparse
import hashlib
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import xarray as xr

from auvplan.errors import ScenarioError
from auvplan.executive import context
from auvplan.scenario import Scenario
from auvplan.study import Design, load_study, run_study, runner, without_clocks, worker
from auvplan.study.worker import Done, Finished, Job, Report, UnderWay
from tests.executive.small import LIGHT, SMALL, scenario

#: Seconds until a test gives up on a process.
PATIENCE = 300.0

#: Name in the environment of the folder in which processes that stand still say so.
HOLDS = "AUVPLAN_TEST_HOLDS"

#: Name in the environment of the folder that holds the missions that were executed.
EXECUTED = "AUVPLAN_TEST_EXECUTED"

_really_run = worker.run_job


def lighten() -> None:
    """Make searches of this process light for good, and run no mission twice."""
    vars(context).update(LIGHT)
    runner.run_job = worker.run_job = run_job


def small(**sections) -> Scenario:
    """The small mission with some settings changed; searches without extras compile faster."""
    sections["planning"] = {"effort": "plain"} | sections.get("planning", {})
    return scenario(**{name: SMALL[name] | settings for name, settings in sections.items()})


def calm(count: int) -> Design:
    """Missions that compile faster still: they meet no obstacle and plan no path anew."""
    none = {"static": 0, "afloat": 0, "self_motivated": 0}
    return Design(
        small(simulation={"obstacles": none}, planning={"t_series": 1}, mission={"waypoints": 3}), count
    )


def mission(dataset: xr.Dataset, seed: int) -> xr.Dataset:
    """One mission of a dataset, as a dataset without padding, clocks and what tells of other missions."""
    one = without_clocks(dataset).isel(mission=np.flatnonzero(dataset["seed"] == seed)).drop_attrs(deep=False)
    routes = one["route_nodes"].values[0] >= 0
    return one.isel(
        leg=slice(int((one["leg_from"] >= 0).sum())),
        plan=slice(int((one["plan_leg"] >= 0).sum())),
        route=slice(int(routes.any(axis=1).sum())),
        stop=slice(int(routes.any(axis=0).sum())),
    )


def run_job(job: Job, report: Callable[[Report], None], anew: bool = False) -> None:
    """Stand in for `worker.run_job`: take missions that are on disk, unless asked for anew."""
    report(UnderWay(0.0))
    folder, cases, left = Path(os.environ[EXECUTED]), Design.of(job.design).cases, []
    folder.mkdir(exist_ok=True)

    def piece(case: int, seed: int) -> Path:
        text = f"{cases[case].model_dump_json()} {seed}"
        return folder / hashlib.sha256(text.encode()).hexdigest()

    for case, seed in job.tasks:
        if piece(case, seed).is_file() and not anew and job.saves is None:
            report(Done(case, seed, pickle.loads(piece(case, seed).read_bytes())))
        else:
            left.append((case, seed))

    def keep(stated: Report) -> None:
        if isinstance(stated, Done):
            half = folder / str(os.getpid())
            half.write_bytes(pickle.dumps(stated.row))
            half.rename(piece(stated.case, stated.seed))
        report(stated)

    if left:
        _really_run(replace(job, tasks=tuple(left)), keep)
    else:
        report(Finished(0.0))


def cache_settings(tmp_path_factory) -> dict[str, str]:
    """Environment of processes that share what they compile and run, in this session of tests."""
    base = tmp_path_factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base
    return {
        "JAX_COMPILATION_CACHE_DIR": str(base / "jax"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        EXECUTED: str(base / "executed"),
    }


def begin(tmp_path_factory, out: Path, count: int, *options: str, **settings: str) -> subprocess.Popen:
    """Start a calm study in a process of its own, with settings of its environment."""
    command = [sys.executable, "-m", "tests.study.light", str(out), str(count), *options]
    environment = os.environ | cache_settings(tmp_path_factory) | settings
    return subprocess.Popen(command, cwd=Path(__file__).parents[2], env=environment)


def unbroken(tmp_path_factory, count: int) -> xr.Dataset:
    """A calm study in one go, executed once in a session of tests."""
    out = tmp_path_factory.getbasetemp() / f"unbroken{count}"
    if not out.is_dir():
        assert begin(tmp_path_factory, out, count).wait(PATIENCE) == 0
    return without_clocks(load_study(out))


def hold() -> None:
    """Say so, and do nothing more until this process is killed."""
    (Path(os.environ[HOLDS]) / str(os.getpid())).touch()
    while True:
        time.sleep(3600.0)


class Holding:
    """A pipe that lets so many missions pass, and then holds the process that sends them."""

    def __init__(self, pipe: Connection, missions: int):
        self._pipe, self._left = pipe, missions

    def send(self, report) -> None:
        if not self._left:
            hold()
        self._pipe.send(report)
        self._left -= isinstance(report, worker.Done)


def work(job, core, settings, pipe: Connection, missions: int = sys.maxsize) -> None:
    """A worker process with light searches; every mission is executed."""
    lighten()
    worker.run_job = partial(run_job, anew=True)
    worker.work(job, core, settings, Holding(pipe, missions))


def work_and_fail(job, core, settings, pipe: Connection) -> None:
    """A worker process whose missions cannot be built."""
    worker.run_job = run_and_fail
    worker.work(job, core, settings, pipe)


def run_whole_job(job):
    """What a cluster's worker does, with light searches; every mission is executed."""
    lighten()
    worker.run_job = _really_run
    return worker.run_whole_job(job)


def run_and_die(job):
    """What a cluster's worker does that is killed."""
    os._exit(1)


def run_and_fail(job, report=None):
    """What a worker does whose missions cannot be built."""
    raise ScenarioError("mission.start (0.0, 0.0, 0.0) lies on land")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("out")
    parser.add_argument("count", type=int)
    parser.add_argument("--resume", action="store_true")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--hold", type=int, default=sys.maxsize)
    given = parser.parse_args()
    lighten()
    from tests.study import light

    runner.work = partial(light.work, missions=given.hold)

    def progress(done: int, total: int, share: float) -> None:
        if given.workers == 1 and done >= given.hold:
            hold()

    run_study(calm(given.count), given.out, resume=given.resume, workers=given.workers, progress=progress)


if __name__ == "__main__":
    main()
