"""The paper's three path scenarios under readings of its text: does the violation fall as in Fig. 11?

``python -m benchmarks.paper_scenarios [--seeds 10]`` plans the first path of each scenario under readings
that differ in migration, mutation, elites and bounds, and prints when the mean violation of the population
falls below 1e-3.
"""

import argparse
from collections.abc import Iterator

import jax
import numpy as np

import auvplan as ap
from auvplan.executive import seed_keys
from auvplan.executive.context import Mission, SimulationContext
from auvplan.executive.legs import set_out
from auvplan.executive.loop import make_context, start_mission
from auvplan.executive.path_calls import believed
from auvplan.paper.legs import changed
from auvplan.records import LegRecord

SCENARIOS = ("scenario-1", "scenario-2", "scenario-3")

#: Mean violation of a population that counts as none.
VANISHED = 1e-3


def readings() -> dict[str, ap.PathConfig]:
    """Readings of sections 3.1 and 4.1 for the path layer, by what sets them apart from the preset."""
    paper = ap.PathConfig.paper()
    bbo = paper.bbo
    every_siv = {"mutation_genes": None, "mutation_max": 0.1}
    changed = {
        "the preset": {},
        "values drawn again within bounds": {"mutation": "uniform"},
        "m(S) for every SIV": every_siv,
        "m(S) for every SIV, drawn again": every_siv | {"mutation": "uniform"},
        "the same, migration SIV by SIV, two elites": every_siv
        | {"mutation": "uniform", "migration": "siv", "elites": 2},
        "the same, the better of habitat and candidate kept": every_siv
        | {"mutation": "uniform", "migration": "siv", "replacement": "greedy"},
        "migration SIV by SIV": {"migration": "siv"},
    }
    made = {name: paper.replace(bbo=bbo.replace(**changes)) for name, changes in changed.items()}
    for width in (0.2, 0.5):
        made[f"bounds of {width:.0%} of the distance"] = ap.PathConfig.paper(width=width)
    for points in (6, 10):
        made[f"{points} control points"] = ap.PathConfig.paper(control_points=points)
    return made


def rows(seeds: int) -> Iterator[str]:
    """A row for each scenario and reading."""
    for name in SCENARIOS:
        context, missions = first_legs(name, seeds)
        env = believed(context, missions)
        starts = np.stack([mission.active_leg.origin for mission in missions])
        goals = np.stack([mission.active_leg.target for mission in missions])
        common = {"key": seed_keys(range(seeds)), "world_per_leg": True}
        for label, config in readings().items():
            plans = ap.plan_paths(starts, goals, env, context.vehicle, config=config, **common)
            mean, best = (np.asarray(getattr(plans.history, part)) for part in ("violation_mean", "best"))
            vanished = (mean < VANISHED).any(axis=1)
            when = np.where(vanished, np.argmax(mean < VANISHED, axis=1), np.inf)
            yield (
                f"{name:12} {label:52} {vanished.sum():5}/{seeds} {np.median(when):10.0f} "
                f"{np.median(mean[:, -1]):11.1e} {plans.feasible.sum():9}/{seeds} {best[:, -1].mean():10.0f}"
            )


def first_legs(name: str, seeds: int) -> tuple[SimulationContext, list[Mission]]:
    """Missions on the first leg of a scenario, what lies ahead believed but no path planned."""
    context = make_context(changed(name, "paper"), ".")
    missions = [start_mission(context, seed, jax.random.key(seed), seed) for seed in range(seeds)]
    for mission in missions:
        set_out(context, mission, LegRecord(0, 1, 0.0, 0.0, 0.0))
    return context, missions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    options = parser.parse_args()
    print(f"{'scenario':12} {'reading':52} {'vanished':>8} {'iteration':>10} {'at the end':>11} ", end="")
    print(f"{'feasible':>12} {'cost [s]':>10}")
    for row in rows(options.seeds):
        print(row, flush=True)


if __name__ == "__main__":
    main()
