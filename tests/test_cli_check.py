"""`auvplan check` on one run and on the saved runs of a study."""

import json
import shutil
from functools import partial
from pathlib import Path

import pytest

from auvplan.io import save_run
from auvplan.runtime.files import DESIGN
from auvplan.study.store import RUNS
from tests.io.sample_run import make_run


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder with three saved runs, of which the second comes from another place at its first leg's end."""
    folder = tmp_path_factory.mktemp("study")
    (folder / DESIGN).write_text("{}")
    good, bad, same = (folder / RUNS / f"0000-{seed:08d}" for seed in range(3))
    save_run(make_run(), good)
    shutil.copytree(good, same)
    run = make_run()
    run.legs[0].positions[-1] += [60.0, 0.0, 0.0]
    save_run(run, bad)
    return folder


@pytest.fixture
def study(written, tmp_path):
    """A copy of it, to be spoiled."""
    return Path(shutil.copytree(written, tmp_path / "study"))


@pytest.fixture
def check(call):
    """A function that runs `auvplan check`."""
    return partial(call, "check")


@pytest.mark.slow
def test_every_saved_run_of_a_study_is_checked(study, check):
    code, said, err = check(study)
    assert (code, err) == (1, "")
    lines = said.splitlines()
    assert [line.split(":")[0] for line in lines[:3]] == [f"0000-{seed:08d}" for seed in range(3)]
    assert "no faults" in lines[0]
    assert "faults, first: leg 0" in lines[1]
    assert lines[3].startswith("3 runs, ")
    assert lines[3].endswith("1 run with faults")
    assert len(lines) == 4
    assert "1 legs" not in said
    assert "1 faults" not in said


def test_without_faults_the_status_is_0(study, check):
    shutil.rmtree(study / RUNS / "0000-00000001")
    code, said, _ = check(study)
    assert code == 0
    assert said.splitlines()[-1].endswith("0 runs with faults")
    assert check(study, "--quiet") == (0, "", "")


def test_a_study_without_saved_runs_is_one_line_and_status_2(tmp_path, refused):
    (tmp_path / DESIGN).write_text("{}")
    assert "--save-runs" in refused("check", tmp_path)


def test_a_damaged_run_is_named(study, refused):
    (study / RUNS / "0000-00000002" / "summary.json").unlink()
    assert "0000-00000002" in refused("check", study, "--quiet")


def test_the_result_as_one_object(study, check):
    code, said, err = check(study, "--json")
    assert (code, err) == (1, "")
    found = json.loads(said)
    assert found["ok"] is False
    assert [run["ok"] for run in found["runs"].values()] == [True, False, True]
    one = json.loads(check(study / RUNS / "0000-00000000", "--json")[1])
    assert one == found["runs"]["0000-00000000"]
    assert one["seabed_altitude"] is None, "infinities are no JSON"
    assert one["collisions"] == one["coast_hits"] == 0
