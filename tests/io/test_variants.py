"""What a hurried operator writes is refused for its cause, or accepted with a line that tells it."""

import warnings

import numpy as np
import pytest

from auvplan.errors import AuvplanError, ScenarioWarning
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.scenario.file import load_scenario
from auvplan.scenario.waypoints import make_graph
from tests.io.small_site import SmallSite
from tests.io.variants import REFUSED, VARIANTS, WARNED

#: A mission that is too short is planned, and fails for want of time.
_UNREADABLE = [name for name, (_, end, *_) in VARIANTS.items() if end == REFUSED and "seconds" not in name]


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    return SmallSite(tmp_path_factory.mktemp("sound") / "site").folder


def all_in(words, lines):
    """The lines that hold all words."""
    return [line for line in lines if all(word in line for word in words)]


@pytest.mark.parametrize("variant", VARIANTS)
def test_it_is_refused_or_stated(variant, sound, tmp_path):
    spoil, end, *words = VARIANTS[variant]
    site = SmallSite(tmp_path / "site", sound)
    spoil(site)
    found = examine_scenario(site.folder / "scenario.yaml")
    said = [*found.lines, *found.warnings, *found.notes]
    assert all(len(line.splitlines()) == 1 for line in said)
    if end == REFUSED:
        assert len(all_in(words, found.lines)) == 1, said
    else:
        assert not found.lines
        assert len(all_in(words, said)) == 1, said


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("variant", [name for name, given in VARIANTS.items() if given[1] == WARNED][::3])
def test_a_mission_is_told_the_same(variant, sound, tmp_path):
    spoil, _, *words = VARIANTS[variant]
    site = SmallSite(tmp_path / "site", sound)
    spoil(site)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always", ScenarioWarning)
        scenario = load_scenario(site.folder / "scenario.yaml")
        area = load_area(scenario, site.folder)
    said = [str(one.message) for one in heard] + list(area.notes)
    assert all_in(words, said), said


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("variant", _UNREADABLE[::5])
def test_a_mission_refuses_it_in_one_line(variant, sound, tmp_path):
    spoil, *_ = VARIANTS[variant]
    site = SmallSite(tmp_path / "site", sound)
    spoil(site)
    path = site.folder / "scenario.yaml"

    def graph():
        scenario = load_scenario(path)
        make_graph(scenario, load_area(scenario, site.folder), np.random.default_rng(0))

    with pytest.raises(AuvplanError) as caught:
        graph()
    assert len(str(caught.value).splitlines()) == 1


def test_the_corpus_is_as_large_as_it_should_be():
    assert len(VARIANTS) >= 60
    assert all(words for _, _, *words in VARIANTS.values())
