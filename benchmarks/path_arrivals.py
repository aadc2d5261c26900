"""When a path meets a changing current: its segments executed one after the other, or all in sweeps.

`python -m benchmarks.path_arrivals` plans the problems of the literature whose current changes, and finds
each plan's travel time by both methods: how far it is off the ruler, and what eight paths and gradients
take.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

import auvplan as ap
from auvplan.ocean.currents import is_steady
from auvplan.path import kinematics
from auvplan.path.cost import Track, curves
from benchmarks.harness import clock, launch, show, timed
from benchmarks.path_problems import PathProblem, literature
from benchmarks.path_ruler import evaluate

METHODS = {"segment by segment": None, **{f"{count} sweeps": count for count in (1, 3, 8, 20)}}
ROUNDS, PATHS = 50, 8
TITLE = f"Arrival times: {PATHS} paths, travel times and gradients"
COLUMNS = {
    "problem": "{problem}", "method": "{method}", "error": "{error:+.4%}", "time": "{milliseconds:.2f} ms",
    "compilation": "{compile_seconds:.1f} s",
}  # fmt: skip


def travel_time(track: Track, problem: PathProblem, config: ap.PathConfig, sweeps: int | None) -> jax.Array:
    """[P] s, by so many sweeps over the whole path; None goes segment by segment, as the package does."""
    (x, y, z), way, env = track.places, track.way, problem.environment
    middle = x[:-1] + 0.5 * way[0], y[:-1] + 0.5 * way[1], z[:-1] + 0.5 * way[2]
    gap = kinematics.norm(*way)
    vehicle, depart = problem.vehicle, jnp.asarray(problem.depart)

    def executed(time: jax.Array) -> jax.Array:
        return gap / kinematics.over_ground(env.current(*middle, time), way, gap, vehicle, config)[0]

    if sweeps is None:
        times = kinematics.middle_times(middle, way, gap, depart, env, vehicle, config)
        return executed(times).sum(axis=0)
    duration = gap / vehicle.speed
    for _ in range(sweeps):
        duration = executed(depart + kinematics.elapsed(duration)[:-1] + 0.5 * duration)
    return duration.sum(axis=0)


def program(problem: PathProblem, config: ap.PathConfig, sweeps: int | None) -> Callable:
    """The compiled function of travel times [P] of habitats [P, V], and the gradient of their sum."""
    start, goal = jnp.asarray(problem.start), jnp.asarray(problem.goal)

    def total(habitats: jax.Array) -> tuple[jax.Array, jax.Array]:
        times = travel_time(curves(habitats, start, goal, config), problem, config, sweeps)
        return times.sum(), times

    # Stored programs are told apart by name and arguments, and these by what the function encloses.
    return jax.jit(jax.value_and_grad(total, has_aux=True))


def rows() -> list[dict[str, Any]]:
    """All methods on all problems; the error is the plan's travel time over the ruler's, less one."""
    found = []
    for problem in literature():
        if is_steady(problem.environment.current):
            continue
        config = ap.PathConfig(**problem.changes)
        plan = problem.plan(jax.random.key(0), config)
        truth = evaluate(problem, plan.positions).travel_time
        for name, sweeps in METHODS.items():
            call = partial(program(problem, config, sweeps), plan.population[:PATHS])
            first, ((_, times), _) = clock(call)
            row = timed(first, [clock(call)[0] for _ in range(ROUNDS)])
            error = float(times[0]) / truth - 1.0
            found.append(row | {"problem": problem.name, "method": name, "error": error})
    return found


def main() -> dict[str, Any]:
    found = rows()
    show(TITLE, found, COLUMNS, names=2)
    return {"rows": found}


if __name__ == "__main__":
    launch(main)
