"""When a path meets a changing current: its segments executed one after the other, or all in sweeps.

``python -m benchmarks.path_arrivals`` plans the problems of the literature whose current changes, and finds
each plan's travel time by both methods. It prints how far each is off the ruler, in double precision, and
what travel times and gradients of eight paths take by it, as a polish asks for them.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from rich.table import Table

import auvplan as ap
from auvplan.compiled import compiled
from auvplan.ocean.currents import is_steady
from auvplan.path import kinematics
from auvplan.path.cost import Track, curves
from benchmarks.machine import arguments, clock, console, empty_table, write
from benchmarks.path_problems import PathProblem, literature
from benchmarks.path_ruler import evaluate

SWEEPS = (1, 3, 8, 20)
ROUNDS, PATHS = 50, 8


@dataclass(frozen=True)
class Row:
    """One method on one problem.

    Attributes:
        error: travel time of the plan over the ruler's, less one.
        seconds: median time of travel times and gradients of `PATHS` paths.
        compile_seconds: how much longer the first call took.
    """

    problem: str
    method: str
    error: float
    seconds: float
    compile_seconds: float


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

    return compiled(jax.value_and_grad(total, has_aux=True))


def rows() -> list[Row]:
    """All methods on all problems."""
    methods = {"segment by segment": None, **{f"{count} sweeps": count for count in SWEEPS}}
    changing = [problem for problem in literature() if not is_steady(problem.environment.current)]
    found = []
    for problem in changing:
        config = ap.PathConfig(**problem.changes)
        plan = problem.plan(jax.random.key(0), config)
        truth = evaluate(problem, plan.positions).travel_time
        for name, sweeps in methods.items():
            timed = partial(program(problem, config, sweeps), plan.population[:PATHS])
            first, ((_, times), _) = clock(timed)
            seconds = float(np.median([clock(timed)[0] for _ in range(ROUNDS)]))
            found.append(Row(problem.name, name, float(times[0]) / truth - 1.0, seconds, first - seconds))
    return found


def table(found: list[Row]) -> Table:
    """All rows as one table."""
    title = f"Arrival times: {PATHS} paths, travel times and gradients"
    shown = empty_table(title, ["problem", "method"], ["error", "time", "compilation"])
    for row in found:
        figures = f"{row.error:+.4%}", f"{1e3 * row.seconds:.2f} ms", f"{row.compile_seconds:.1f} s"
        shown.add_row(row.problem, row.method, *figures)
    return shown


def main() -> None:
    """Print the table and write the file."""
    parser = arguments("Arrival times in changing currents.")
    options = parser.parse_args()
    found = rows()
    console().print(table(found))
    write(options.out, {"rows": found})


if __name__ == "__main__":
    main()
