"""Readings of the paper's text: by the claims about missions, and by the violation on its path scenarios.

`python -m benchmarks.paper.readings --out DIR [--seed 7000] [-n 100] [--only NUMBER ...]` simulates the same
missions of the Whitsunday scenario under each reading, and prints its figures and the claims of sections
3.3.2 and 4.2 that hold. Studies on disk are not run again, broken ones are continued. `--paths` plans the
first path of each path scenario from `-n` seeds under readings that differ in mutation, bounds and numbers
of control points, and prints when the mean violation of the population falls below 1e-3 (Fig. 11).
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jax
import numpy as np
import xarray as xr

import auvplan as ap
from auvplan.executive import seed_keys
from auvplan.executive.context import make_context
from auvplan.executive.legs import set_out
from auvplan.executive.loop import start_mission
from auvplan.executive.path_calls import believed
from auvplan.records import LegRecord
from auvplan.study import Design
from auvplan.study.statistics import leg_times
from benchmarks.ablations import study
from benchmarks.harness import launch, screen, show
from benchmarks.paper.claims import NO_VIOLATION, QUESTIONS, Evidence, cut_off, late_legs
from benchmarks.paper.legs import SCENARIOS, changed

_WHOLE = {"task_time": "whole"}

#: Settings of each reading under the paper's preset: what delta_ij counts in besides t_ij, then the rest.
READINGS: dict[str, dict[str, Any]] = {
    "T_path + delta, 10 control points": _WHOLE | {"control_points": 10},
    "T_path + delta, 6": _WHOLE | {"control_points": 6},
    "T_path + delta, 4": _WHOLE | {"control_points": 4},
    "T_path + delta, 4, most total priority": _WHOLE | {"control_points": 4, "objective": "priority"},
    "T_path + delta, 10, t_ij learnt": _WHOLE | {"control_points": 10, "travel_times": "learnt"},
    "T_path + delta, 10, Phi_2 = 1000": _WHOLE | {"control_points": 10, "phi": (1.0, 1000.0)},
    "delta charged, T_path compared, 10": {"task_time": "clock", "control_points": 10},
    "T_path alone, 10": {"control_points": 10},
    "T_path alone, 6": {"control_points": 6},
    "T_path alone, 6, bounds of 20 %": {"control_points": 6, "path_width": 0.2},
    "T_path alone, 8, bounds of 20 %": {"control_points": 8, "path_width": 0.2},
    "T_path alone, 6, Phi_2 = 1": {"control_points": 6, "phi": (1.0, 1.0)},
    "T_path alone, 6, most total priority": {"control_points": 6, "objective": "priority"},
    "T_path alone, 4 (the preset)": {},
}

_PATHS = {
    "scenario": "{scenario}", "reading": "{reading}", "vanished": "{vanished} of {seeds}",
    "iteration": "{iteration:.0f}", "at the end": "{end:.1e}", "feasible": "{feasible} of {seeds}",
    "cost": "{cost:.0f} s",
}  # fmt: skip


def said(missions: xr.Dataset) -> list[str]:
    """Figures of a study, and the claims that hold in whole or in part."""
    speed = json.loads(missions.attrs["scenario"])["vehicle"]["speed"]
    expected, executed = leg_times(missions)
    done = np.isfinite(executed)
    nodes, mission = missions["waypoint_position"].values, np.nonzero(done)[0]
    ends = (missions[f"leg_{end}"].values[done].astype(int) for end in ("from", "to"))
    first, last = (nodes[mission, end] for end in ends)
    straight = np.linalg.norm(last - first, axis=1) / speed
    late, routes = late_legs(missions)
    success, priority = (missions[name].values for name in ("success", "total_priority"))
    figures = (
        f"{(success == 1).sum()} of {missions.sizes['mission']} on time, "
        f"{cut_off(missions).sum()} cut off under way; T_path {np.median(executed[done] / straight):.2f} of "
        f"d / |v|, {np.median(executed[done] / expected[done]):.2f} of t_ij; {late.sum()} late legs, "
        f"{routes.sum()} new routes; legs {np.median(done.sum(axis=1)):g}; priority {priority.mean():.1f}"
    )
    lines, evidence = [figures], Evidence(xr.Dataset(), missions, xr.Dataset(), 0.0)
    for claim, where, _, missions_alone, ask in QUESTIONS:
        if not missions_alone:
            continue
        words, met = ask(evidence)
        lines.append(f"    {where}, {claim}: {'in part' if met is None else 'yes' if met else 'no'}; {words}")
    return lines


def path_readings() -> dict[str, ap.PathConfig]:
    """Readings of sections 3.1 and 4.1 for the path layer, by what sets them apart from the preset."""
    paper = ap.PathConfig.paper()
    every = {"mutation_genes": None, "mutation_max": 0.1}
    searches: dict[str, dict[str, Any]] = {
        "the preset": {},
        "values drawn again within bounds": {"mutation": "uniform"},
        "m(S) for every SIV": every,
        "m(S) for every SIV, drawn again": every | {"mutation": "uniform"},
    }
    made = {name: paper.replace(bbo=paper.bbo.replace(**changes)) for name, changes in searches.items()}
    made |= {
        f"bounds of {width:.0%} of the distance": ap.PathConfig.paper(width=width) for width in (0.2, 0.5)
    }
    return made | {f"{n} control points": ap.PathConfig.paper(control_points=n) for n in (6, 10)}


def path_rows(seeds: int) -> Iterator[dict[str, Any]]:
    """A row for each scenario and reading: seeds whose violation vanishes, and after which iteration."""
    for name in SCENARIOS:
        context = make_context(changed(name, "paper"), ".")
        missions = [start_mission(context, seed, jax.random.key(seed), seed) for seed in range(seeds)]
        for mission in missions:  # what lies ahead is believed, no path is planned
            set_out(mission, LegRecord(0, 1, 0.0, 0.0, 0.0))
        env = believed(missions)
        starts = np.stack([mission.active_leg.origin for mission in missions])
        goals = np.stack([mission.active_leg.target for mission in missions])
        common = {"key": seed_keys(range(seeds)), "world_per_leg": True}
        for reading, config in path_readings().items():
            plans = ap.plan_paths(starts, goals, env, context.vehicle, config=config, **common)
            mean, best = (np.asarray(getattr(plans.history, part)) for part in ("violation_mean", "best"))
            vanished = (mean < NO_VIOLATION).any(axis=1)
            when = np.where(vanished, np.argmax(mean < NO_VIOLATION, axis=1), np.inf)
            yield {
                "scenario": name, "reading": reading, "seeds": seeds, "vanished": int(vanished.sum()),
                "iteration": float(np.median(when)), "end": float(np.median(mean[:, -1])),
                "feasible": int(plans.feasible.sum()), "cost": float(best[:, -1].mean()),
            }  # fmt: skip


@launch(
    out=(Path("out/readings"), "folder of the studies"),
    seed=(7000, "first seed of the missions"),
    n=(100, "missions, or seeds of each path"),
    only=((0,), "numbers of readings, from 1; 0 for all"),
    paths=(False, "first paths of the path scenarios instead"),
)
def main(out: Path, seed: int, n: int, only: list[int], paths: bool) -> None:
    if paths:
        show("First paths under readings of the text", path_rows(n), _PATHS, names=2)
        return
    for number, (name, changes) in enumerate(READINGS.items(), 1):
        if number in only or 0 in only:
            design = Design(changed("whitsunday", "paper", planning=changes), n, seed)
            lines = said(study(out / f"reading-{number}", design))
            screen.print(f"{number}. {name}: " + "\n".join(lines), highlight=False, soft_wrap=True)
