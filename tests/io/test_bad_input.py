"""Malformed and hostile input through the command line: status 2 and one line that names what is wrong."""

import time

import pytest

from auvplan.executive import loop
from tests.io.bad_input import CASES
from tests.io.small_site import SmallSite


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """The folder of the site as nothing has spoilt it."""
    return SmallSite(tmp_path_factory.mktemp("sound") / "site").folder


def planned(*_):
    """Stands in for the first step of a mission."""
    raise AssertionError("bad input was planned with")


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_line_and_status_2(case, sound, tmp_path, call, monkeypatch):
    spoil, *words = CASES[case]
    site, out = SmallSite(tmp_path / "site", sound), tmp_path / "out"
    spoil(site)
    monkeypatch.setattr(loop, "step", planned)
    # Of this process alone, whatever else the machine does: hostile files must not be worked on for long.
    begin = time.process_time()
    path = site.folder / "scenario.yaml"
    code, said, err = call("mission", path, "--out", out, "--quiet")
    assert code == 2, (said, err)
    assert said == ""
    assert len(err.splitlines()) == 1, err
    assert err.startswith("auvplan: ")
    assert "Traceback" not in err
    for word in words:
        assert word in err, (word, err)
    assert not out.exists() or not list(out.iterdir())
    assert time.process_time() - begin < 20.0


@pytest.mark.parametrize("case", [name for name in CASES if not name.startswith("scenario")][::5])
def test_validate_tells_the_same_faults_with_their_lines(case, sound, tmp_path, call):
    spoil, *words = CASES[case]
    site = SmallSite(tmp_path / "site", sound)
    spoil(site)
    path = site.folder / "scenario.yaml"
    code, said, err = call("validate", path)
    assert code == 2, (said, err)
    assert err == ""
    lines = said.splitlines()
    assert all(line.startswith(f"{path}:") for line in lines)
    for word in words:
        assert any(word in line for line in lines), (word, said)


def test_unspoilt_it_is_valid(sound, call):
    path = sound / "scenario.yaml"
    code, said, err = call("validate", path)
    assert code == 0, said + err
    assert said.splitlines()[0] == f"{path}: valid"


def test_the_corpus_is_as_large_as_it_should_be():
    assert len(CASES) >= 110
    assert all(words for _, *words in CASES.values())
