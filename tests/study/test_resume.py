"""A study whose processes are killed is resumed, and ends as if nothing had been."""

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from auvplan.study import load_study, without_clocks
from tests.study import light

COUNT = 8

needs_proc = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="looks for processes in /proc")

#: Seconds that a process has to notice that nobody listens to it any more.
NOTICE = 10.0


@pytest.fixture
def begin(tmp_path_factory, tmp_path):
    """Starts the study in a process that does not outlive the test."""
    started = []

    def start(*options, **settings):
        started.append(light.begin(tmp_path_factory, tmp_path, COUNT, *options, **settings))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def done(out) -> int:
    """Missions that are on disk."""
    return len(list(out.glob("missions/0*.npz")))


def wait_for(condition, process=None, patience=light.PATIENCE):
    """Look often until something is true."""
    end = time.monotonic() + patience
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        assert process is None or process.poll() is None, "the process ended"
        time.sleep(0.002)


def kill(process):
    """End a process before it can do anything about it."""
    assert process.poll() is None, "it was done before"
    process.send_signal(signal.SIGKILL)
    assert process.wait(light.PATIENCE) == -signal.SIGKILL


def status(pid) -> list[str]:
    """State, parent and more of a process; nothing where there is none."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return []


def alive(pid) -> bool:
    return bool(status(pid)) and status(pid)[0] != "Z"


def workers_of(process) -> list[int]:
    """Processes that multiprocessing has spawned for a process."""
    children = [int(entry.name) for entry in Path("/proc").iterdir() if entry.name.isdigit()]
    children = [pid for pid in children if status(pid)[1:2] == [str(process.pid)]]
    return [pid for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def assert_gone(workers):
    """Two processes notice that nobody listens to them any more; none of them lives on, in any case."""
    try:
        assert len(workers) == 2
        wait_for(lambda: not any(alive(pid) for pid in workers), patience=NOTICE)
    finally:
        for pid in filter(alive, workers):
            os.kill(pid, signal.SIGKILL)


@needs_proc
def test_a_study_killed_three_times_ends_like_one_never_killed(begin, tmp_path_factory, tmp_path):
    """Killed before a mission is done, when some are, and while two processes sail the rest."""
    whole, rng = light.unbroken(tmp_path_factory, COUNT), np.random.default_rng(7)

    process = begin()
    wait_for((tmp_path / "study.json").is_file, process)
    time.sleep(rng.uniform(0.0, 1.0))
    kill(process)
    assert done(tmp_path) == 0

    process = begin("--resume", "--slow")
    wait_for(lambda: done(tmp_path) > 0, process)
    time.sleep(rng.uniform(0.0, 2.0 * light.PAUSE))
    kill(process)
    first = done(tmp_path)
    assert 0 < first < COUNT - 1

    process = begin("--resume", "--workers", "2")
    wait_for(lambda: done(tmp_path) > first, process)
    workers = workers_of(process)
    time.sleep(rng.uniform(0.0, light.PAUSE))
    kill(process)
    assert_gone(workers)
    assert first < done(tmp_path) < COUNT
    assert not (tmp_path / "missions.nc").exists()

    process = begin("--resume")
    assert process.wait(light.PATIENCE) == 0
    xr.testing.assert_identical(without_clocks(load_study(tmp_path)), whole)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["missions.nc", "study.json", "summary.json"]


@needs_proc
def test_processes_of_a_killed_study_do_not_compile_to_the_end(begin, tmp_path):
    """They have nothing to send then, so nothing tells them that nobody listens."""
    process = begin("--workers", "2", JAX_COMPILATION_CACHE_DIR=str(tmp_path / "empty"))
    wait_for(lambda: len(workers_of(process)) == 2, process)
    time.sleep(5.0)
    workers = workers_of(process)
    kill(process)
    assert done(tmp_path) == 0
    assert_gone(workers)
