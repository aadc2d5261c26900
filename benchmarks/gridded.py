"""What a gridded current costs a plan: a model's field against the vortices that it was sampled from.

`python -m benchmarks.gridded` plans one leg of 8 km past three obstacles in the default scenario's vortices
and in fields sampled from them, which a tide turns about. The currents take turns in one process; ratios are
of the shortest times, compilation apart.
"""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.ocean.currents import Current
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.path import PathPlan
from benchmarks.harness import launch, show, take_turns
from benchmarks.paths.problems import PRESETS

ROUNDS = 15
SIDE, DEEPEST = 10e3, 100.0
NODES, LEVELS, HOURS = 100, 10, 24
#: Hours of the tide that turns the gridded field about.
TIDE = 12.42
START, GOAL, DEPART = np.array([1500.0, 1500.0, 30.0]), np.array([7500.0, 7000.0, 60.0]), 4000.0
LOWER, UPPER = jnp.zeros(3), jnp.array([SIDE, SIDE, DEEPEST])
OBSTACLES = np.array([[3000.0, 3000.0, 50.0], [5000.0, 5200.0, 40.0], [6000.0, 5000.0, 50.0]])
RADII = np.array([100.0, 150.0, 120.0])
ONE_LAYER, THREE_LAYERS = "vortices, 1 layer", "vortices, 3 layers"


#: A row for each preset and current: median and least time of a plan, and the latter over those in vortices.
TITLE = f"Plans in gridded currents ({NODES} x {NODES} x {LEVELS} x {HOURS}), over those in 12 vortices"
COLUMNS = {
    "preset": "{preset}", "current": "{current}", "median": "{milliseconds:.1f} ms",
    "least": "{least:.1f} ms", "to 1 layer": "{to_one_layer:.2f}", "to 3": "{to_three_layers:.2f}",
    "compiling": "{compile_seconds:.1f} s", "feasible": "{feasible:.0%}",
}  # fmt: skip


def currents() -> dict[str, Current]:
    """The vortices, and gridded fields of the three layers: in a tide, with vertical velocity, and steady."""
    one, three = (
        ap.random_vortices(jax.random.key(0), LOWER, UPPER, count=12, layers=layers, radius=(500.0, 1500.0))
        for layers in (1, 3)
    )
    along, depths = np.linspace(0.0, SIDE, NODES), np.linspace(0.0, DEEPEST, LEVELS)
    z, x, y = np.meshgrid(depths, along, along, indexing="ij")
    u, v, w = (np.asarray(component) for component in three(x, y, z, np.zeros(())))
    hours = np.arange(HOURS)
    tide = np.cos(2.0 * np.pi * hours / TIDE)[:, None, None, None]
    grid = partial(GriddedCurrent.from_arrays, spacing=SIDE / (NODES - 1), depths=depths)
    return {
        ONE_LAYER: one,
        THREE_LAYERS: three,
        "gridded": grid(u * tide, v * tide, times=hours * 3600.0),
        "gridded, u v w": grid(u * tide, v * tide, w * tide, times=hours * 3600.0),
        "gridded, steady": grid(u[None], v[None]),
    }


def _plan(current: Current, config: ap.PathConfig, seed: int) -> PathPlan:
    obstacles = ap.Obstacles.static(OBSTACLES, RADII)
    env = ap.Environment(current, obstacles=obstacles, lower=LOWER, upper=UPPER)
    return ap.plan_path(START, GOAL, env, key=jax.random.key(seed), config=config, depart=DEPART)


def rows(presets: list[str], rounds: int) -> list[dict[str, Any]]:
    known, found = currents(), []
    for preset in presets:
        calls = {name: partial(_plan, current, PRESETS[preset]()) for name, current in known.items()}
        turns = take_turns(calls, dict.fromkeys(calls, rounds), 0)
        for name, row in turns.items():
            row["feasible"] = float(np.mean([plan.feasible for plan in row.pop("results")]))
            for layers, other in (("one_layer", ONE_LAYER), ("three_layers", THREE_LAYERS)):
                row[f"to_{layers}"] = row["least_seconds"] / turns[other]["least_seconds"]
            found.append({"preset": preset, "current": name} | row)
    return found


def main(preset: list[str], rounds: int) -> dict[str, Any]:
    found = rows(preset, rounds)
    show(TITLE, found, COLUMNS, names=2, no_wrap=True)
    return {"rounds": rounds, "rows": found}


if __name__ == "__main__":
    launch(
        main,
        preset=(tuple(PRESETS), "these alone", PRESETS),
        rounds=(ROUNDS, "turns that every current takes"),
    )
