"""The package as a person at a prompt meets it: what is where, what is given of results, clear errors."""

import copy
import math
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import auvplan as ap
from auvplan.errors import ScenarioError
from auvplan.executive.context import make_context
from auvplan.mission import random_graph
from tests.io.sample_run import make_run
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
        assert make_context(one).folder == str(site)
        assert ap.load_area(one).jobs
    with pytest.raises(ValueError, match="elsewhere"):
        ap.load_area(scenario, "elsewhere")


def test_settings_without_a_file_start_from_the_working_directory(site, monkeypatch):
    settings = ap.Scenario.model_validate(ap.load_scenario(site / "scenario.yaml").model_dump())
    with pytest.raises(ValueError, match=r"(?i)no such file"):
        ap.load_area(settings)
    monkeypatch.chdir(site)
    assert ap.load_area(settings).jobs


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


def test_places_by_degrees_stay_where_they_are_when_the_site_moves():
    def placed(longitude):
        start, goal = {"longitude": 149.0, "latitude": -20.3, "depth": 5.0}, [100.0, 200.0, 5.0]
        corners = {
            "lower": {"longitude": 148.9, "latitude": -20.4},
            "upper": {"longitude": 149.1, "latitude": -20.2},
        }
        corners["upper"]["depth"] = 30.0
        site = {"longitude": longitude, "latitude": -20.3}
        return ap.Scenario(site=site, area=corners, mission={"start": start, "goal": goal})

    scenario, expected = placed(148.99), placed(149.0)
    steps = {"vehicle.speed": 1.0}, {"site.longitude": 149.0}
    for moved in (scenario.with_(steps[0]).with_(steps[1]), scenario.with_(steps[0] | steps[1])):
        assert moved.mission.start == expected.mission.start == (0.0, 0.0, 5.0)
        assert moved.mission.goal == scenario.mission.goal, "local metres count from the site"
        assert moved.area == expected.area
    assert scenario.with_({"site.departure": "2026-03-01T05:00:00Z"}).mission == scenario.mission
    local = scenario.with_({"mission.start": [1.0, 2.0, 3.0], "site.longitude": 149.0})
    assert local.mission.start == (1.0, 2.0, 3.0)
    half = scenario.with_({"area.lower": [-9000.0, -9000.0, 0.0]})
    with pytest.raises(ScenarioError, match=r"area.lower|area.upper"):
        half.with_(steps[1])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"vehicle.sped": 2}, "vehicle.sped: unknown key 'sped', did you mean 'speed'?"),
        ({"vehicel.speed": 2}, "vehicel: unknown key 'vehicel', did you mean 'vehicle'?"),
        ({"speed": 2}, "speed: unknown key 'speed', did you mean 'vehicle.speed'?"),
        ({"vehicle.speed": -2}, "vehicle.speed: must be greater than 0, got -2"),
        ({"vehicle.speed.x": 2}, "vehicle.speed.x: unknown key"),
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


BOX = {"lower": (-500, -500, 0), "upper": (2500, 1500, 0)}
A, B = (0, 0, 0), (2000, 0, 0)
STILL = ap.Environment(None, **BOX)
KEY = jax.random.key(0)
#: A search without passages and polish: what it finds is not what is tested.
LIGHT = ap.PathConfig.quick().replace(finer=1, passages=0, refine_steps=0)


@pytest.mark.parametrize(
    ("call", "kind", "words"),
    [
        (lambda: ap.plan_path(A, B, STILL, key=0), TypeError, "key must be a PRNG key, got 0: give jax.ra"),
        (lambda: ap.replan_paths([], [A], [0.0], STILL, key=np.int32(3)), TypeError, "jax.random.key(0)"),
        (lambda: ap.random_vortices(1, A, B), TypeError, "jax.random.key(0)"),
        (lambda: ap.run_mission(ap.Scenario(), key=5), TypeError, "jax.random.key(0), or seed=0"),
        (lambda: ap.run_missions(ap.Scenario(), keys=5), TypeError, "or seeds=range(B)"),
        (lambda: ap.bbo.minimize(sum, [0.0], [1.0], key=0), TypeError, "jax.random.key(0)"),
        (lambda: ap.plan_path(A, B, lambda x, y, z, t: (0, 0, 0), key=KEY), TypeError, "ap.Environment(cur"),
        (lambda: ap.plan_path(A, B, ap.UniformCurrent(), key=KEY), TypeError, "ap.Environment(current)"),
        (lambda: ap.plan_path(A, B, STILL, 2.5, key=KEY), TypeError, "ap.Vehicle(speed=2.5)"),
        (lambda: ap.plan_path((0, 0), B, STILL, key=KEY), ValueError, "start must be three numbers, north"),
        (lambda: ap.plan_path(A, [1, 2], STILL, key=KEY), ValueError, "goal must be three numbers, north"),
        (lambda: ap.plan_paths([A, A], [B], STILL, key=KEY), ValueError, "[B, 3] m, north, east and depth"),
    ],
)
def test_what_is_easily_mistaken_is_told_in_a_line(call, kind, words):
    with pytest.raises(kind) as refused:
        call()
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("current", "kind", "words"),
    [
        (lambda x, y, z, t: (np.sin(x), 0.0, 0.0), TypeError, "write it with jax.numpy, such as jnp.sin"),
        (lambda x, y, z, t: (math.sin(x), 0.0, 0.0), TypeError, "jnp.sin for math.sin"),
        (lambda x, y, z, t: (1.0 if x > 3 else 0.0, 0.0, 0.0), TypeError, "jnp.where"),
        (
            lambda x, y, z, t: (x, y),
            ValueError,
            "returns (u, v, w), m/s north, east and down; the function r",
        ),
        (lambda x, y, z, t: None, ValueError, "returned NoneType"),
        (lambda x, y, t: (0.0, 0.0, 0.0), TypeError, "(x, y, z, t) -> (u, v, w)"),
        (7, TypeError, "(x, y, z, t) -> (u, v, w)"),
    ],
)
def test_a_function_that_is_no_current_is_told_where_it_is_given(current, kind, words):
    with pytest.raises(kind) as refused:
        ap.Environment(current, **BOX)
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_functions_that_are_currents_are_taken():
    table = jnp.linspace(0.0, 1.0, 5)
    for current in (
        lambda x, y, z, t: (0.4, 0.2 * (t > 600), 0.0),
        lambda x, y, z, t: jnp.stack([x, y, z]),
        lambda x, y, z, t, scale=2.0: (scale * jnp.interp(x, jnp.arange(5.0), table), 0, 0),
        lambda *place: (0.0, 0.0, 0.0),
    ):
        u, v, w = ap.Environment(current, **BOX).current(*jnp.ones((4, 3)))
        assert u.shape == v.shape == w.shape == (3,)


def test_a_current_that_is_no_number_is_told_with_the_place():
    hole = ap.Environment(lambda x, y, z, t: (jnp.where(x > 1000.0, jnp.nan, 0.3), 0.0, 0.0), **BOX)
    with pytest.raises(ValueError, match=r"not a number \(NaN\) at \(1\d\d\d, ") as refused:
        ap.plan_path(A, B, hole, key=KEY, config=LIGHT)
    assert "\n" not in str(refused.value)


def test_old_style_keys_are_keys():
    from auvplan.runtime.prng import as_key

    for old, new in (
        (jax.random.PRNGKey(7), jax.random.key(7)),
        (jax.random.split(jax.random.PRNGKey(1)), None),
    ):
        made = as_key(old, "key" if new is not None else "keys")
        assert made.shape == old.shape[:-1]
        assert new is None or (jax.random.uniform(made) == jax.random.uniform(new))


def test_the_package_shows_its_public_names_alone():
    names = dir(ap)
    assert set(ap.__all__) <= set(names)
    assert all(name in ap.__all__ or (name.startswith("__") and name.endswith("__")) for name in names)
    assert "__version__" in ap.__all__
    assert not {"version", "lazy_loader"} & set(vars(ap))


def one_line(result):
    """The line at a prompt, which the table in a notebook agrees with."""
    line, table = repr(result), result._repr_html_()
    assert len(line) < 300
    assert "\n" not in line
    assert table.startswith("<table>")
    assert type(result).__name__ in table
    return line


def test_runs_and_what_is_in_them_are_told_in_a_line():
    run = make_run()
    line = one_line(run)
    assert "destination reached in time" in line
    assert f"{run.t_mission:,.0f} of 3,000 s" in line
    assert "legs 3" in line
    assert "0 to 1" in one_line(run.legs[0])
    assert "made for a window" in one_line(run.legs[0].plans[1])
    run.reason = "<b>&"
    assert "&lt;b&gt;&amp;" in run._repr_html_()


def test_plans_and_routes_are_told_in_a_line():
    plans = ap.plan_paths([A, A], [B, B], STILL, key=KEY, config=LIGHT)
    assert "2 of 2 plans feasible" in one_line(plans)
    assert one_line(plans[0]).startswith("<PathPlan: feasible, travel time 8")
    assert "length 2,0" in repr(plans[0])
    assert "open water" in repr(plans[0])
    rng = np.random.default_rng(0)
    graph = random_graph(rng, rng.uniform(0.0, 1000.0, (8, 3)), neighbours=3)
    route = ap.plan_mission(graph, 0, 7, 1800.0, speed=2.5, key=KEY)
    assert f"tasks {route.tasks}" in one_line(route)
    assert "waypoints 0 > " in repr(route)
    late = ap.plan_mission(graph, 0, 7, 1.0, speed=2.5, key=KEY)
    assert repr(late) == "<MissionRoute: not feasible (out of time)>"
