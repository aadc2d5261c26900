"""The paper's figures and claims are written; what is run for them is stood in for by hand-made runs."""

import json
from concurrent.futures import ThreadPoolExecutor
from functools import cache

import numpy as np
import xarray as xr

from auvplan.plot import style
from benchmarks.paper import plots, reproduce
from benchmarks.paper.legs import RATES, SCENARIOS, Legs
from tests.benchmarks.paper_evidence import calls
from tests.io.sample_run import make_run
from tests.plot.sample_study import make_study

FIGURES = [
    "fig01_clusters.png", "fig08_currents.png", "fig09_obstacles.png", "fig10_windows.png",
    "fig11_convergence.png", "fig12_time_use.png", "fig13_expected_times.png", "fig14_planning_time.png",
    "fig15_maps.png", "fig15_routes.png",
]  # fmt: skip
SENSORS = {"range": 150.0, "interval": 30.0, "growth": 0.1, "growth_max": 20.0}


def test_figures_and_claims_are_written_and_a_broken_study_is_continued(tmp_path, monkeypatch):
    asked = []

    @cache
    def one_leg(seed):
        run = make_run((0, 1))
        run.seed, run.scenario = seed, run.scenario | {"sensors": SENSORS}
        return run

    def execute_legs(preset, seeds, rate_seeds):
        runs = {name: [one_leg(seed) for seed in seeds] for name in SCENARIOS}
        return Legs(runs, runs, {rate: [one_leg(seed) for seed in rate_seeds] for rate in RATES})

    def run_study(design, out, resume, force):
        asked.append((design.scenario.planning.preset, list(design.seeds), resume))
        return make_study(design.count, first_seed=design.seed)

    stand_ins = {
        "execute_legs": execute_legs, "run_study": run_study, "run_mission": lambda *_: make_run(),
        "process_apart": lambda: ThreadPoolExecutor(1),
        "call_times": lambda scenarios, seeds: [calls(len(seeds)).assign_coords(seed=seeds)] * 2,
    }  # fmt: skip
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(reproduce, name, stand_in)
    monkeypatch.setattr(style, "DPI", 40)
    (tmp_path / "missions-paper" / "missions").mkdir(parents=True)
    effort = reproduce.Effort(2, 1, 2, seed=3)
    claims, pictures = reproduce.reproduce(tmp_path, effort)
    assert sorted(path.name for path in pictures) == FIGURES
    assert asked == [("paper", [3, 4], True), ("default", [3, 4], False)]
    assert [claim["verdict"] for claim in json.loads((tmp_path / "claims.json").read_text("utf-8"))] == [
        claim.verdict for claim in claims
    ]
    assert len((tmp_path / "claims.md").read_text(encoding="utf-8").splitlines()) == len(claims) + 2
    with xr.open_dataset(tmp_path / "legs-default.nc", decode_timedelta=False) as legs:
        assert legs.sizes["seed"] == 1
        assert legs["rate_seed"].values.tolist() == [3, 4]


def test_the_mission_shown_is_on_time_with_about_three_re_plans():
    study = make_study(8)
    one = study.isel(mission=int(np.flatnonzero(study["seed"] == plots.example_seed(study))[0]))
    replans = study["mission_replans"].values[study["success"].values == 1]
    assert int(one["success"]) == 1
    assert abs(int(one["mission_replans"]) - 3) == np.abs(replans - 3).min()
