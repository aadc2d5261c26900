"""`auvplan paper` writes figures and claims; what it runs is stood in for by hand-made runs."""

import json
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from auvplan import cli
from auvplan.paper import Effort, figures, reproduce
from auvplan.paper.legs import RATES, SCENARIOS, Legs
from auvplan.plot import style
from tests.io.sample_run import make_run
from tests.plot.sample_study import make_study

FIGURES = [
    "fig01_clusters.png", "fig08_currents.png", "fig09_obstacles.png", "fig10_windows.png",
    "fig11_convergence.png", "fig12_time_use.png", "fig13_expected_times.png", "fig14_planning_time.png",
    "fig15_maps.png", "fig15_routes.png",
]  # fmt: skip
SENSORS = {"range": 150.0, "interval": 30.0, "growth": 0.1, "growth_max": 20.0}


@pytest.fixture
def asked(monkeypatch):
    """Stand-ins for everything that plans; returns what they were asked for."""
    module = sys.modules[reproduce.__module__]
    asked = {"missions": [], "seeds": [], "resume": []}

    @cache
    def one_leg(seed):
        run = make_run((0, 1))
        run.seed = seed
        run.scenario |= {"sensors": SENSORS}
        return run

    def execute_legs(preset, seeds, rate_seeds, done):
        asked["seeds"].append((preset, list(seeds), list(rate_seeds)))
        for _ in range(10):
            done("a leg")
        runs = {name: [one_leg(seed) for seed in seeds] for name in SCENARIOS}
        rates = {rate: [one_leg(seed) for seed in rate_seeds] for rate in RATES}
        return Legs(runs, runs, rates)

    def run_study(design, out, resume, force, progress):
        asked["missions"].append((design.scenario.planning.preset, list(design.seeds)))
        asked["resume"].append(resume)
        progress(design.count, design.count, 1.0)
        return make_study(design.count, first_seed=design.seed)

    def call_times(scenarios, seeds):
        values = np.full(len(seeds), 0.1)
        variables = {"first_cpu": ("mission", values), "window_cpu": ("mission", values)}
        return [xr.Dataset(variables, {"seed": ("mission", list(seeds))}) for _ in scenarios]

    @contextmanager
    def process_apart():
        with ThreadPoolExecutor(1) as pool:
            yield pool.submit

    for name, stand_in in (
        ("execute_legs", execute_legs),
        ("run_study", run_study),
        ("call_times", call_times),
        ("process_apart", process_apart),
    ):
        monkeypatch.setattr(module, name, stand_in)
    monkeypatch.setattr(module, "draw_paper", lambda legs, found, scenario, folder: [])
    return asked


@pytest.fixture
def drawn(asked, monkeypatch):
    """The figures for once, coarse."""
    monkeypatch.setattr(sys.modules[reproduce.__module__], "draw_paper", figures.draw_paper)
    monkeypatch.setattr(figures, "run_mission", lambda scenario, key, seed: make_run())
    monkeypatch.setattr(style, "DPI", 40)
    return asked


def test_figures_and_claims_are_written(drawn, tmp_path):
    out = tmp_path / "paper"
    result = CliRunner().invoke(cli.app, ["paper", "--quick", "--seed", "3", "--out", str(out)])
    assert result.exit_code == 0, result.output
    assert sorted(path.name for path in out.glob("*.png")) == FIGURES
    claims = json.loads((out / "claims.json").read_text(encoding="utf-8"))
    assert {claim["verdict"] for claim in claims} <= {"confirmed", "partly", "not confirmed"}
    assert len((out / "claims.md").read_text(encoding="utf-8").splitlines()) == len(claims) + 2
    assert drawn["missions"] == [("paper", list(range(3, 9))), ("default", list(range(3, 9)))]
    assert sorted(drawn["seeds"]) == [
        (preset, [3, 4, 5], list(range(3, 11))) for preset in ("default", "paper")
    ]
    assert "claims.md" in result.output


def test_effort_is_the_papers_unless_asked_otherwise(asked, tmp_path):
    result = CliRunner().invoke(cli.app, ["paper", "--missions", "2", "--quiet", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert asked["missions"][0] == ("paper", [0, 1])
    assert asked["seeds"][0][1] == list(range(10))
    assert (Effort().missions, Effort().seeds) == (100, 10)
    assert result.output == ""


def test_a_study_broken_off_is_continued(asked, tmp_path):
    (tmp_path / "missions-paper" / "missions").mkdir(parents=True)
    reproduce(tmp_path, Effort(2, 1, 2))
    assert asked["resume"] == [True, False]


def test_progress_rises_to_the_end(asked, tmp_path):
    shares = []
    reproduce(tmp_path, Effort(2, 1, 2), lambda words, share: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_mission_shown_is_on_time_with_about_three_re_plans():
    study = make_study(8)
    seed = figures.example_seed(study)
    one = study.isel(mission=int(np.flatnonzero(study["seed"] == seed)[0]))
    on_time = study["success"].values == 1
    nearest = np.abs(study["mission_replans"].values[on_time] - 3).min()
    assert int(one["success"]) == 1
    assert abs(int(one["mission_replans"]) - 3) == nearest
