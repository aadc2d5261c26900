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


@pytest.fixture
def holds(tmp_path_factory):
    """Folder in which processes that stand still, waiting to be killed, say so by their numbers."""
    return tmp_path_factory.mktemp("holds")


@pytest.fixture
def begin(tmp_path_factory, tmp_path, holds):
    """Starts the study in a process that does not outlive the test."""
    started = []

    def start(*options, **settings):
        settings |= {light.HOLDS: str(holds)}
        started.append(light.begin(tmp_path_factory, tmp_path, COUNT, *options, **settings))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def done(out) -> int:
    """Missions that are on disk."""
    return len(list(out.glob("missions/0*.npz")))


def wait_for(condition, process=None):
    """Look often until something is true; how long that takes is not what is tested."""
    end = time.monotonic() + light.PATIENCE
    while not condition():
        assert time.monotonic() < end, "nothing happened"
        assert process is None or process.poll() is None, "the process ended"
        time.sleep(0.01)


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
    """Two processes that would do nothing for ever end by themselves; none of them lives on, in any case."""
    try:
        assert len(workers) == 2
        wait_for(lambda: not any(alive(pid) for pid in workers))
    finally:
        for pid in filter(alive, workers):
            os.kill(pid, signal.SIGKILL)


@needs_proc
@pytest.mark.slow
def test_a_study_killed_three_times_ends_like_one_never_killed(begin, holds, tmp_path_factory, tmp_path):
    """Killed before a mission is done, when some are, and while two processes run the rest."""
    whole, rng = light.unbroken(tmp_path_factory, COUNT), np.random.default_rng(7)

    process = begin("--hold", "0")
    wait_for((holds / str(process.pid)).is_file, process)
    kill(process)
    assert (tmp_path / "study.json").is_file()
    assert done(tmp_path) == 0

    first = int(rng.integers(1, COUNT - 3))
    process = begin("--resume", "--hold", str(first))
    wait_for((holds / str(process.pid)).is_file, process)
    kill(process)
    assert done(tmp_path) == first

    process = begin("--resume", "--workers", "2", "--hold", "1")
    wait_for(lambda: done(tmp_path) == first + 2, process)
    workers = workers_of(process)
    wait_for(lambda: all((holds / str(pid)).is_file() for pid in workers), process)
    kill(process)
    assert_gone(workers)
    assert done(tmp_path) == first + 2 < COUNT
    assert not (tmp_path / "missions.nc").exists()

    process = begin("--resume")
    assert process.wait(light.PATIENCE) == 0
    xr.testing.assert_identical(without_clocks(load_study(tmp_path)), whole)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["missions.nc", "study.json", "summary.json"]


@pytest.mark.slow
@needs_proc
def test_processes_of_a_killed_study_do_not_go_on_when_they_have_nothing_to_send(begin, holds, tmp_path):
    """As in a compilation: no broken pipe tells them then that nobody listens."""
    process = begin("--workers", "2", "--hold", "0")
    wait_for(lambda: len(list(holds.iterdir())) == 2, process)
    workers = workers_of(process)
    assert {path.name for path in holds.iterdir()} == {str(pid) for pid in workers}
    kill(process)
    assert done(tmp_path) == 0
    assert_gone(workers)
