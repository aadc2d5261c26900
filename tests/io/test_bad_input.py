"""Files that are damaged, hostile or say something else than is meant: refused or noted, in one line each."""

import time
import warnings

import pytest

from auvplan.errors import ScenarioWarning
from auvplan.executive import loop
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.scenario.file import load_scenario
from tests.io.bad_input import DAMAGED, NOTED, REFUSED
from tests.io.small_site import SmallSite


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The folder of the site as nothing has spoilt it."""
    return SmallSite(tmp_path_factory.mktemp("sound") / "site").folder


@pytest.fixture
def spoilt(sound, tmp_path):
    """A function that spoils a copy of the site and returns the path of its scenario."""

    def spoil(change):
        site = SmallSite(tmp_path / "site", sound)
        change(site)
        return site.folder / "scenario.yaml"

    return spoil


def planned(*_):
    """Stands in for the first step of a mission."""
    raise AssertionError("bad input was planned with")


@pytest.mark.parametrize("case", DAMAGED)
def test_bad_input_is_one_line_and_status_2(case, spoilt, tmp_path, call, monkeypatch):
    change, *words = DAMAGED[case]
    path, out = spoilt(change), tmp_path / "out"
    monkeypatch.setattr(loop, "step", planned)
    # Of this process alone, whatever else the machine does: hostile files must not be worked on for long.
    begin = time.process_time()
    code, said, err = call("mission", path, "--out", out, "--quiet")
    assert (code, said) == (2, ""), err
    assert len(err.splitlines()) == 1, err
    assert err.startswith("auvplan: ")
    assert "Traceback" not in err
    assert all(word in err for word in words), err
    assert not out.exists() or not list(out.iterdir())
    assert time.process_time() - begin < 20.0


def test_unspoilt_it_is_valid(sound, call):
    path = sound / "scenario.yaml"
    code, said, err = call("validate", path)
    assert code == 0, said + err
    assert said.splitlines()[0] == f"{path}: valid"


def holding(words, lines):
    """The lines that hold all words."""
    return [line for line in lines if all(word in line for word in words)]


@pytest.mark.parametrize("case", REFUSED | NOTED)
def test_a_slip_is_refused_or_noted(case, spoilt):
    change, *words = (REFUSED | NOTED)[case]
    found = examine_scenario(spoilt(change))
    said = [*found.lines, *found.warnings, *found.notes]
    assert all(len(line.splitlines()) == 1 for line in said)
    assert case in REFUSED or not found.lines
    assert len(holding(words, found.lines if case in REFUSED else said)) == 1, said


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("case", list(NOTED)[::8])
def test_a_mission_has_the_same_note(case, spoilt):
    change, *words = NOTED[case]
    path = spoilt(change)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", ScenarioWarning)
        area = load_area(load_scenario(path), path.parent)
    said = [str(one.message) for one in heard] + list(area.notes)
    assert holding(words, said), said
