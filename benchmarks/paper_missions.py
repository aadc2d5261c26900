"""Readings of the paper's text, each by the claims of sections 3.3.2 and 4.2 about missions.

``python -m benchmarks.paper_missions --out DIR [--seed 7000] [-n 100] [--only NUMBER ...]`` simulates the
same missions of the Whitsunday scenario under each reading, and prints its figures and the claims that hold.
Studies on disk are not run again, broken ones are continued.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.paper.claims import MISSION_QUESTIONS, Evidence, cut_off, late_legs
from auvplan.paper.legs import changed
from auvplan.study import Design
from auvplan.study.statistics import leg_times
from benchmarks.ablations import study

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


def row(name: str, missions: xr.Dataset) -> str:
    """Figures of a study, and the claims that hold in whole or in part."""
    speed = json.loads(missions.attrs["scenario"])["vehicle"]["speed"]
    expected, executed = leg_times(missions)
    done = np.isfinite(executed)
    ends = (missions[f"leg_{end}"].values for end in ("from", "to"))
    nodes, mission = missions["waypoint_position"].values, np.nonzero(done)[0]
    first, last = (nodes[mission, end[done].astype(int)] for end in ends)
    straight = np.linalg.norm(last - first, axis=1) / speed
    late, routes = late_legs(missions)
    count = missions.sizes["mission"]
    evidence = Evidence(xr.Dataset(), missions, xr.Dataset(), 0.0)
    lines = [
        f"{name}: {(missions['success'].values == 1).sum()} of {count} on time, "
        f"{cut_off(missions).sum()} cut off under way; T_path {np.median(executed[done] / straight):.2f} of "
        f"d / |v|, {np.median(executed[done] / expected[done]):.2f} of t_ij; {late.sum()} late legs, "
        f"{routes.sum()} new routes; legs {np.median(done.sum(axis=1)):g}; priority "
        f"{missions['total_priority'].values.mean():.1f}"
    ]
    for question in MISSION_QUESTIONS:
        finding = question.ask(evidence)
        verdict = "in part" if finding.met is None else "yes" if finding.met else "no"
        lines.append(f"    {question.where}, {question.claim}: {verdict}; {finding.words}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=7000)
    parser.add_argument("-n", "--missions", type=int, default=100)
    parser.add_argument("--only", type=int, nargs="*", help="numbers of readings, from 1")
    options = parser.parse_args()
    for number, (name, changes) in enumerate(READINGS.items(), 1):
        if options.only is None or number in options.only:
            scenario = changed("whitsunday", "paper", planning=changes)
            design = Design(scenario, options.missions, options.seed)
            missions = study(options.out / f"reading-{number}", design)
            print(f"{number}. {row(name, missions)}", flush=True)


if __name__ == "__main__":
    main()
