"""The package as a person at a prompt meets it: what is where, what is told of results, clear errors."""

import copy
import pickle

import pytest

import auvplan as ap
from auvplan.errors import ScenarioError
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


def test_changed_settings_are_validated_as_a_file_is(site):
    scenario = ap.load_scenario(site / "scenario.yaml")
    changed = scenario.with_({"vehicle.speed": 2, "mission.time_available": 1800, "name": "short"})
    assert (changed.vehicle.speed, changed.mission.time_available, changed.name) == (2.0, 1800.0, "short")
    assert changed.mission.start == scenario.mission.start, "what is not named stays"
    assert changed.folder == scenario.folder
    assert scenario.vehicle.speed == 2.5
    dated = {"longitude": 1.0, "latitude": 2.0}
    assert ap.Scenario().with_({"site.longitude": 1.0, "site.latitude": 2.0}).site.longitude == 1.0
    assert ap.Scenario().with_({"site": dated}).site.latitude == 2.0


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vehicle.sped": 2}, "vehicle.sped: unknown key 'sped', did you mean 'speed'?"),
        ({"vehicel.speed": 2}, "vehicel: unknown key 'vehicel', did you mean 'vehicle'?"),
        ({"speed": 2}, "speed: unknown key 'speed', did you mean 'vehicle.speed'?"),
        ({"vehicle.speed": -2}, "vehicle.speed: must be greater than 0, got -2"),
        ({"vehicle.speed.x": 2}, "vehicle.speed.x: unknown key 'speed.x'"),
        ({"name.x": 2}, "name.x: unknown key"),
        ({"mission.start": [1e6, 0, 0]}, "lies outside the area"),
        ({"vehicle": 3}, "vehicle: must be a section of fields"),
    ],
)
def test_what_does_not_fit_is_named(site, changes, words):
    with pytest.raises(ScenarioError, match=r"^scenario: ") as refused:
        ap.load_scenario(site / "scenario.yaml").with_(changes)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)
