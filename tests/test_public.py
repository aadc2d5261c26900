"""The package as a person at a prompt meets it: what is where, what is told of results, clear errors."""

import copy
import pickle

import pytest

import auvplan as ap
from auvplan.voyage.executive import make_fleet
from tests.io.small_site import SmallSite


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A scenario file that names files beside it."""
    return SmallSite(tmp_path_factory.mktemp("site") / "here").folder


def test_a_scenario_remembers_where_its_files_are(site, tmp_path, monkeypatch):
    monkeypatch.chdir(site.parent)
    scenario = ap.load_scenario("here/scenario.yaml")
    monkeypatch.chdir(tmp_path)
    changed = scenario.model_copy(update={"name": "changed"})
    for one in (scenario, changed, copy.deepcopy(scenario), pickle.loads(pickle.dumps(scenario))):
        assert make_fleet(one).folder == str(site)
        assert ap.load_waters(one).jobs
    with pytest.raises(ValueError, match="elsewhere"):
        ap.load_waters(scenario, "elsewhere")


def test_settings_without_a_file_start_from_the_working_directory(site, monkeypatch):
    settings = ap.Scenario.model_validate(ap.load_scenario(site / "scenario.yaml").model_dump())
    with pytest.raises(ValueError, match="no such file"):
        ap.load_waters(settings)
    monkeypatch.chdir(site)
    assert ap.load_waters(settings).jobs
