"""Files are written whole or not at all, and those of one run replace those of an earlier one together."""

import os
import signal
import subprocess
import sys
import time

import pytest

from auvplan.runtime.files import MISSION, SUMMARY, OutputError, output_folder, whole_result, write_atomically
from auvplan.scenario.scenario import Scenario
from auvplan.study.design import Design
from auvplan.study.store import Store
from tests.io.refusals import refusal

OLD = {SUMMARY: "old", MISSION: "old", "itinerary.plan": "old", "mission.png": "old", "notes.txt": "mine"}
NEW = {SUMMARY: "new", MISSION: "new", "sheet.html": "new", "timeline.png": "new"}


def test_a_writer_sees_suffix_and_folder_and_leaves_nothing_behind_where_it_fails(tmp_path):
    seen, target = [], tmp_path / "picture.png"

    def write(path, fail=False):
        seen.append(path)
        path.write_text("half" if fail else "new")
        if fail:
            raise RuntimeError("stopped")

    assert write_atomically(target, write).read_text() == "new"
    assert (seen[0].suffix, seen[0].parent) == (".png", tmp_path)
    with pytest.raises(RuntimeError, match="stopped"):
        write_atomically(target, lambda path: write(path, fail=True))
    assert [path.name for path in tmp_path.iterdir()] == ["picture.png"]
    assert target.read_text() == "new"


def test_a_folder_is_made_or_refused_in_one_line(tmp_path, monkeypatch):
    folder = output_folder(tmp_path / "a" / "b")
    assert folder.is_dir()
    assert not list(folder.iterdir())
    (tmp_path / "taken").touch()
    for path in (tmp_path / "taken", tmp_path / "taken" / "below"):
        refusal(OutputError, r"cannot write to folder .*taken", output_folder, path)
    words, gone = r"cannot write .*none/file\.txt: No such file", tmp_path / "none" / "file.txt"
    refusal(OutputError, words, write_atomically, gone, lambda path: path.touch())
    words, below = r"cannot write .*taken/file\.txt: Not a directory", tmp_path / "taken" / "file.txt"
    refusal(OutputError, words, write_atomically, below, lambda path: path.write_text(""))

    # Root may write anywhere, so the system's refusal is played.
    def refuse(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("pathlib.Path.touch", refuse)
    refusal(OutputError, r"cannot write to folder .*: Permission denied$", output_folder, tmp_path)


def content(folder):
    return {file.name: file.read_text() for file in folder.iterdir()}


@pytest.fixture
def folder(tmp_path):
    target = tmp_path / "out"
    target.mkdir()
    for name, text in OLD.items():
        (target / name).write_text(text)
    return target


def test_new_files_take_the_place_of_all_old_ones_and_leave_those_of_others(folder):
    with whole_result(folder) as partial:
        for name, text in NEW.items():
            (partial / name).write_text(text)
        assert content(folder) == OLD
    assert content(folder) == NEW | {"notes.txt": "mine"}
    assert [file.name for file in folder.parent.iterdir()] == ["out"]


def test_a_run_that_fails_leaves_the_old_files_alone(folder):
    def fail():
        with whole_result(folder) as partial:
            (partial / SUMMARY).write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert content(folder) == OLD
    assert [file.name for file in folder.parent.iterdir()] == ["out"]


@pytest.mark.parametrize("moment", [0, 3])
def test_a_run_that_is_killed_leaves_the_old_or_the_new_files(folder, moment):
    code = (
        "import sys, time\nfrom auvplan.runtime.files import whole_result\n"
        f"with whole_result({str(folder)!r}) as partial:\n"
        "    print('begun', flush=True)\n"
        f"    for name in {list(NEW)!r}:\n"
        "        (partial / name).write_text('new')\n        time.sleep(0.02)\n"
        "print('done', flush=True)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert process.stdout.readline() == b"begun\n"
    time.sleep(0.02 * moment)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    process.stdout.close()
    assert content(folder) in (OLD, NEW | {"notes.txt": "mine"})
    with whole_result(folder) as partial:
        (partial / SUMMARY).write_text("next")
    assert content(folder) == {SUMMARY: "next", "notes.txt": "mine"}
    assert [file.name for file in folder.parent.iterdir()] == ["out"]


@pytest.mark.parametrize(
    ("name", "holds"), [("study.json", "a study"), ("departures.json", "a table of departures")]
)
def test_a_run_is_not_written_among_results_of_another_kind(tmp_path, name, holds):
    (tmp_path / name).write_text("{}")
    (tmp_path / SUMMARY).write_text("its own")
    with pytest.raises(OutputError, match=f"holds {holds}: choose another folder"), whole_result(tmp_path):
        raise AssertionError("nothing is made")
    assert (tmp_path / SUMMARY).read_text() == "its own"
    assert sorted(file.name for file in tmp_path.iterdir()) == sorted([name, SUMMARY])


@pytest.mark.parametrize("force", [False, True])
def test_a_study_is_not_begun_in_the_folder_of_a_run(tmp_path, force):
    (tmp_path / MISSION).write_text("a run")
    with pytest.raises(OutputError, match="holds a mission: choose another folder with --out"):
        Store(tmp_path, Design(Scenario(), 2), force=force)
    assert [file.name for file in tmp_path.iterdir()] == [MISSION]
