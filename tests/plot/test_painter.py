"""Pictures drawn by a process beside this one are those that are drawn here, whatever becomes of it."""

import os
from concurrent.futures import Future
from threading import current_thread, main_thread

import numpy as np
import pytest
from PIL import Image

from auvplan.plot import draw_run
from auvplan.plot.painter import Painter
from auvplan.records import MissionRun
from auvplan.runtime.files import OutputError
from tests.io.sample_run import make_run

RUN = make_run((0, 1), chart=False)
#: Of a mission that never began there is one picture.
BARE = make_run((0, 1), chart=False)
BARE.legs = []


@pytest.fixture
def two_cores(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})


def pixels(path):
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"))


def drawn(run, folder):
    """Pixels by the name of the picture."""
    return {path.name: pixels(path) for path in draw_run(run, folder)}


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    return drawn(BARE, tmp_path_factory.mktemp("here"))


def assert_drawn(paths, expected):
    assert sorted(path.name for path in paths) == sorted(expected)
    for path in paths:
        np.testing.assert_array_equal(pixels(path), expected[path.name])


@pytest.mark.parametrize("run", [BARE, pytest.param(RUN, marks=pytest.mark.slow)], ids=["one", "several"])
def test_they_are_those_drawn_here(tmp_path, two_cores, run):
    with Painter() as painter:
        painter.begin(run, tmp_path / "there")
        found = painter.finish()
    assert_drawn(found, drawn(run, tmp_path / "here"))


@pytest.mark.parametrize("begun", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_all_are_drawn_where_the_process_has_ended(tmp_path, two_cores, expected, begun):
    with Painter() as painter:
        if begun:
            painter.begin(BARE, tmp_path)
        painter.process.kill()
        painter.process.join()
        if not begun:
            painter.begin(BARE, tmp_path)
        assert_drawn(painter.finish(), expected)


@pytest.mark.parametrize(("choice", "names"), [("main", ["mission.png"]), ("none", [])])
def test_on_one_core_there_is_no_process(tmp_path, monkeypatch, expected, choice, names):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with Painter(choice) as painter:
        assert painter.process is None
        painter.begin(BARE, tmp_path)
        assert_drawn(painter.finish(), {name: expected[name] for name in names})
    assert [path.name for path in tmp_path.iterdir()] == names


def test_a_run_is_sent_by_the_thread_that_uses_it(tmp_path, two_cores, monkeypatch, expected):
    """Its cached properties are found while it is drawn here: no other thread may go through them."""
    threads = []

    def state(run):
        threads.append(current_thread())
        return dict(run.__dict__)

    monkeypatch.setattr(MissionRun, "__getstate__", state)
    with Painter() as painter:
        painter.begin(BARE, tmp_path)
        assert_drawn(painter.finish(), expected)
    assert set(threads) == {main_thread()}


def test_what_is_wrong_there_is_told_here(tmp_path, two_cores, monkeypatch):
    folder = tmp_path / "taken"
    folder.touch()
    with Painter() as painter:
        monkeypatch.setattr(Future, "cancel", lambda _: False)  # the process draws all
        painter.begin(BARE, folder)
        with pytest.raises(OutputError, match="taken"):
            painter.finish()
