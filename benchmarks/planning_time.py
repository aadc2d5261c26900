"""Many starts in one call of `plan_paths`: ``python -m benchmarks.planning_time [--starts 1000]``.

All go to one place through 12 vortices, past 12 obstacles that drift. The first call compiles; the time is
that of a second one with another key.
"""

from functools import partial
from typing import Any

import jax
import numpy as np

import auvplan as ap
from benchmarks.harness import clock, launch, screen

#: m; between the obstacles, which lie around the straight line from one to the other.
START, GOAL = np.array([200.0, 300.0, 10.0]), np.array([3200.0, 3000.0, 50.0])

#: m, box that starts are drawn from.
_NEAR, _FAR = np.array([100.0, 100.0, 5.0]), np.array([1500.0, 1500.0, 60.0])


def world() -> ap.Environment:
    """12 vortices and 12 drifting obstacles in open water."""
    rng = np.random.default_rng(0)
    current = ap.random_vortices(jax.random.key(1), (0, 0, 0), (3500, 3500, 100), count=12)
    share = rng.uniform(0.2, 0.8, 12)[:, None]
    places = START + (GOAL - START) * share + rng.normal(0, 150, (12, 3))
    obstacles = ap.Obstacles.afloat(places, rng.uniform(30, 120, 12), growth=0.05)
    return ap.Environment(current, obstacles=obstacles, lower=(0, 0, 0), upper=(3500, 3500, 100))


@launch(starts=(1000, "number of starts"))
def main(starts: int) -> dict[str, Any]:
    rows, env, goals = [], world(), np.tile(GOAL, (starts, 1))
    places = np.random.default_rng(5).uniform(_NEAR, _FAR, (starts, 3))
    for preset, config in (("default", ap.PathConfig()), ("quick", ap.PathConfig.quick())):
        call = partial(ap.plan_paths, places, goals, env, config=config)
        (first, _), (seconds, plans) = (clock(partial(call, key=jax.random.key(seed))) for seed in (0, 1))
        rows.append({"preset": preset, "first": first, "seconds": seconds})
        rows[-1]["feasible"] = float(np.mean(plans.feasible))
        took = "{preset}: {seconds:.1f} s, {first:.1f} s with compilation; {feasible:.1%} feasible"
        screen.print(f"{starts:,} starts, {took.format(**rows[-1])}")
    return {"starts": starts, "rows": rows}
