"""A study on a Dask cluster ends like one on this machine, also when a worker is killed."""

import json
import os
import signal
import sys
from functools import partial

import pytest
import xarray as xr

from auvplan.errors import ScenarioError
from auvplan.runtime.files import read_dataset, write_dataset
from auvplan.study import StudyError, cluster, load_study, run_study, runner, without_clocks
from tests.study import light
from tests.study.light import cache_settings, calm, unbroken
from tests.tool import refused

distributed = pytest.importorskip("distributed")

COUNT = 8


@pytest.fixture(scope="module")
def workers(tmp_path_factory):
    """A cluster of two processes on this machine."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in cache_settings(tmp_path_factory).items():
            patch.setenv(name, value)
        with distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0"
        ) as found:
            yield found


@pytest.fixture(scope="module")
def thread():
    """A cluster of a thread of this process."""
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, dashboard_address=":0"
    ) as found:
        yield found


@pytest.fixture(autouse=True)
def light_job(monkeypatch):
    """Workers search lightly."""
    monkeypatch.setattr(cluster, "run_whole_job", light.run_whole_job)


@pytest.mark.slow
def test_a_study_whose_worker_is_killed_ends_like_a_local_one(
    workers, tmp_path_factory, tmp_path, monkeypatch
):
    whole, killed = unbroken(tmp_path_factory, COUNT), []
    monkeypatch.setattr(runner, "run_on_cluster", partial(cluster.run_on_cluster, chunk=1))
    with distributed.Client(workers.scheduler_address, set_as_default=False) as client:
        pids = list(client.run(os.getpid).values())
    assert len(set(pids)) == 2

    def kill_one(done, total, share):
        if not killed:
            killed.append(done)
            os.kill(pids[0], signal.SIGKILL)

    dataset = run_study(calm(COUNT), tmp_path, dask=workers.scheduler_address, progress=kill_one)
    assert killed[0] < COUNT
    xr.testing.assert_identical(without_clocks(dataset), whole)
    xr.testing.assert_identical(load_study(tmp_path), dataset)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["missions.nc", "study.json", "summary.json"]


def test_an_error_in_a_worker_reaches_the_caller(thread, tmp_path, monkeypatch):
    """The scheduler is found through its file."""
    monkeypatch.setattr(cluster, "run_whole_job", light.run_and_fail)
    (tmp_path / "scheduler.json").write_text(json.dumps({"address": thread.scheduler_address}))
    with pytest.raises(ScenarioError, match="lies on land"):
        run_study(calm(2), tmp_path / "out", dask=str(tmp_path / "scheduler.json"))


@pytest.mark.slow
def test_missions_that_kill_every_worker_are_stated(workers, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "run_whole_job", light.run_and_die)
    monkeypatch.setattr(workers.scheduler, "allowed_failures", 0)
    with refused(StudyError, "--resume"):
        run_study(calm(1), tmp_path, dask=workers.scheduler_address)


def test_a_worker_writes_datasets(thread, tmp_path):
    dataset = xr.Dataset({"depth": ("obs", [1.0, 2.0])})
    with distributed.Client(thread.scheduler_address, set_as_default=False) as client:
        client.submit(write_dataset, dataset, tmp_path / "some.nc").result()
    xr.testing.assert_identical(read_dataset(tmp_path, "some.nc"), dataset)


@pytest.mark.parametrize("address", ["nowhere://127.0.0.1:1", "no-scheduler.json"])
def test_a_scheduler_that_cannot_be_reached_is_told_and_nothing_written(tmp_path, monkeypatch, address):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cluster, "PATIENCE", "1s")
    (tmp_path / "no-scheduler.json").write_text("no file of a scheduler")
    with refused(StudyError, f"Dask scheduler {address} cannot be reached"):
        run_study(calm(1), tmp_path / "out", dask=address)
    assert not (tmp_path / "out").exists()


def test_without_dask_its_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(StudyError, match=r"pip install 'auvplan\[dask\]'"):
        run_study(calm(1), tmp_path / "out", dask="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()
