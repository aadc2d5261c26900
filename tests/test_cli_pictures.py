"""`plot` and `animate` on the folder of a run."""

import pytest

from auvplan.io import save_run
from auvplan.scenario.scenario import Scenario
from tests.io.sample_run import make_run

pytestmark = pytest.mark.usefixtures("coarse")

FIGURES = ["convergence.png", "currents.png", "mission.png", "obstacles.png", "timeline.png"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    run = make_run()
    run.scenario = Scenario().model_dump(mode="json")
    return save_run(run, tmp_path_factory.mktemp("pictures") / "run")


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(
    ("options", "stated"),
    [
        (("--leg", "4"), "leg 4: the run has 3 done legs: choose 1 to 3, or all"),
        (("--leg", "0"), "choose 1 to 3"),
        (("--leg", "first"), "--leg 'first': give the number of a done leg"),
        (("--seed", "3"), "leave --seed out"),
    ],
)
def test_what_the_run_does_not_have_is_refused_in_one_line(folder, refused, options, stated):
    before = names(folder)
    assert stated in refused("plot", folder, *options, "--quiet")
    assert names(folder) == before


def test_a_leg_is_of_a_run(tmp_path, refused):
    assert "no single run" in refused("plot", tmp_path, "--leg", "1")


def test_a_run_is_drawn_into_its_folder(folder, call):
    code, out, err = call("plot", folder, "--leg", "2")
    assert code == 0, err
    assert [name for name in names(folder) if name.endswith(".png")] == FIGURES
    assert all(str(folder / name) in out for name in FIGURES)


def test_a_run_is_animated_into_its_folder(folder, call, refused):
    code, out, err = call("animate", folder, "--seconds", "0.5", "--fps", "4")
    assert code == 0, err
    assert out.strip() == f"film: {folder / 'mission.gif'}"
    assert (folder / "mission.gif").read_bytes()[:6] == b"GIF89a"
    for wrong, stated in ((("--out", folder / "film.avi"), ".gif"), (("--fps", "99"), "fps: 99")):
        before = names(folder)
        assert stated in refused("animate", folder, *wrong)
        assert names(folder) == before


@pytest.mark.parametrize("command", ["animate", "check", "export"])
def test_the_record_of_an_execution_is_refused_in_a_line_that_says_what_would_do(tmp_path, refused, command):
    (tmp_path / "execution.json").write_text("{}")
    err = refused(command, tmp_path)
    assert "record of an execution" in err
    assert "`auvplan plan`" in err
