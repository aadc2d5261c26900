"""What a gridded current costs a plan: a model's field against the vortices that it was sampled from.

`python -m benchmarks.gridded` plans one leg of 8 km past three obstacles in the default scenario's vortices
and in fields sampled from them, which a tide turns about. The currents take turns in one process; ratios are
of the shortest times, compilation apart.

`--turning FIRST:END` plans instead legs of 1 to 60 km, one a seed, in tides that are the same everywhere and
have periods of 0.25 to 20 times what the leg lasts in still water. One heading is best: the gap to it is
known.
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
from benchmarks.harness import Array, figures, grouped, launch, show, take_turns, track
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


#: Periods, in the times of legs in still water; nodes and time steps of the drift.
_PERIODS, _NODES, _STEPS = (0.25, 20.0), 600, 200_001

#: A row for each preset and span of periods.
TURNING = {
    "preset": "{preset}", "period, in times of the leg": "{periods}", "mean gap": "{mean:.3%}",
    "95 %": "{p95:.3%}", "worst": "{worst:.2%}", "feasible": "{feasible} of {legs}",
}  # fmt: skip


def turning_leg(seed: int) -> tuple[ap.Environment, ap.Vehicle, Array, float, float]:
    """Return a sea, a vehicle, the goal [2] m of a leg from the origin, its least time, s, and the period.

    The period is in times of the leg in still water. The vehicle goes through the water as if that were at
    rest, and both are carried on: the least time is the first at which it could be where the goal would be.
    """
    rng = np.random.default_rng([11, seed])
    speed, length = rng.uniform(0.8, 2.0), np.exp(rng.uniform(*np.log([1e3, 60e3])))
    straight, period = length / speed, np.exp(rng.uniform(*np.log(_PERIODS)))
    turn, phases = rng.uniform(0.0, 2.0 * np.pi, 2), rng.uniform(0.0, 2.0 * np.pi, 2)
    swings = speed * rng.uniform(0.05, 0.7) * np.array([1.0, rng.uniform()])
    nodes = np.linspace(0.0, 5.0 * straight, _NODES)
    angle = 2.0 * np.pi * nodes / (period * straight)
    axes = np.array([[np.cos(turn[0]), -np.sin(turn[0])], [np.sin(turn[0]), np.cos(turn[0])]])
    water = axes @ (swings[:, None] * np.cos(angle + phases[:, None]))
    field = GriddedCurrent.from_arrays(
        *(np.broadcast_to(part[:, None, None, None], (_NODES, 1, 3, 3)) for part in water),
        origin=(-2.0 * length, -2.0 * length), spacing=2.0 * length, times=nodes,
    )  # fmt: skip
    goal = length * np.array([np.cos(turn[1]), np.sin(turn[1])])
    moments = np.linspace(0.0, nodes[-1], _STEPS)
    rates = np.stack([np.interp(moments, nodes, part) for part in water], axis=1)
    drift = np.cumsum(0.5 * (rates[1:] + rates[:-1]) * moments[1], axis=0)
    lacks = np.linalg.norm(goal - drift, axis=1) - speed * moments[1:]
    after = int(np.argmax(lacks <= 0.0))
    least = moments[after] + moments[1] * lacks[after - 1] / (lacks[after - 1] - lacks[after])
    corners = np.array([-2.0, -2.0, 0.0]) * length, np.array([2.0, 2.0, 0.0]) * length
    vehicle = ap.Vehicle(speed, surge_max=9.0, sway_max=5.0)
    return ap.Environment(field, lower=corners[0], upper=corners[1]), vehicle, goal, float(least), period


def turning_rows(presets: list[str], seeds: range) -> list[dict[str, Any]]:
    """Return a row for each preset and span of periods, of legs by seed."""
    runs, start = [], (0.0, 0.0, 0.0)
    for seed in track(seeds, "legs"):
        env, vehicle, goal, least, period = turning_leg(seed)
        for name in presets:
            key, config = jax.random.key(seed), PRESETS[name]()
            plan = ap.plan_path(start, (*goal, 0.0), env, vehicle, key=key, config=config)
            gap = float(plan.travel_time) / least - 1.0 if plan.feasible else None
            runs.append({"preset": name, "period": period, "gap": gap})
    spans = {"0.25 to 1": (0.0, 1.0), "1 to 5": (1.0, 5.0), "5 to 20": (5.0, np.inf)}

    def of(run: dict[str, Any]) -> list[tuple[str, str]]:
        return [(run["preset"], name) for name, (low, high) in spans.items() if low <= run["period"] < high]

    found = []
    for (preset, periods), members in sorted(grouped(runs, of).items()):
        gaps = [run["gap"] for run in members if run["gap"] is not None]
        counts = {"feasible": len(gaps), "legs": len(members)}
        found.append({"preset": preset, "periods": periods} | figures(gaps) | counts)
    return found


@launch(
    preset=(tuple(PRESETS), "these alone", PRESETS),
    rounds=(ROUNDS, "turns that every current takes"),
    turning=(range(0), "FIRST:END, the end left out: seeds of legs on which a tide turns"),
)
def main(preset: list[str], rounds: int, turning: range) -> dict[str, Any]:
    if turning:
        found = turning_rows(preset, turning)
        show("Legs on which a tide turns: gap to the closed form", found, TURNING, names=2)
        return {"turning": [turning.start, turning.stop], "rows": found}
    known, found = currents(), []
    for name in preset:
        calls = {current: partial(_plan, field, PRESETS[name]()) for current, field in known.items()}
        turns = take_turns(calls, dict.fromkeys(calls, rounds), 0)
        for current, row in turns.items():
            row["feasible"] = float(np.mean([plan.feasible for plan in row.pop("results")]))
            for layers, other in (("one_layer", ONE_LAYER), ("three_layers", THREE_LAYERS)):
                row[f"to_{layers}"] = row["least_seconds"] / turns[other]["least_seconds"]
            found.append({"preset": name, "current": current} | row)
    show(TITLE, found, COLUMNS, names=2, no_wrap=True)
    return {"rounds": rounds, "rows": found}
