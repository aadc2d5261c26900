"""Re-planning on the way: what the kept population is worth (Fig. 5).

``python -m benchmarks.path_replans`` disturbs plans under way: the current takes a step of Eq. 2, obstacles
turn out to lie elsewhere, and in half of the cases one lies across the rest of the path. It plans anew from
where the vehicle is: warm from the kept population, cold, and cold with ten times the budget of a window. It
prints a row for each way to plan: by how much the travel time exceeds that of the largest budget, how many
plans are feasible, and the time of one.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from rich.progress import Progress
from rich.table import Table

import auvplan as ap
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve
from benchmarks.machine import arguments, bars, clock, console, empty_table, write
from benchmarks.path_problems import PathProblem, random_problems

SITUATIONS = 50
#: What a window gets, so many times: the budget of the plan that all others are held against.
TIMES = 10
#: m, standard deviation of the error with which an obstacle was known before.
SHIFT = 40.0


@dataclass(frozen=True, eq=False)
class Situation:
    """A vehicle under way in a sea that has changed.

    Attributes:
        problem: what it set out to do.
        position: [3] m, where it is.
        now: s since the epoch.
    """

    problem: PathProblem
    plan: ap.PathPlan
    position: np.ndarray
    now: float
    env: ap.Environment


@dataclass(frozen=True)
class Row:
    """One way to plan anew, over all situations.

    Attributes:
        mean: mean excess of the travel time over that of the largest budget, where both are feasible.
        seconds: median time of a plan.
        first_seconds: of the first call for each family of problems, compilation and all.
    """

    name: str
    mean: float
    worst: float
    feasible: float
    seconds: float
    first_seconds: float


def situations(count: int, progress: Progress) -> list[Situation]:
    """Disturbed plans of the random problems, several of each."""
    problems, found = random_problems(), []
    bar = progress.add_task("situations", total=count)
    for number in range(count):
        problem, rng = problems[number % len(problems)], np.random.default_rng(number)
        plan = problem.plan(jax.random.key(number), ap.PathConfig())
        reached = int(rng.uniform(0.1, 0.5) * len(plan.positions))
        env = _disturbed(rng, problem.environment, plan, reached)
        found.append(Situation(problem, plan, plan.positions[reached], float(plan.times[reached]), env))
        progress.advance(bar)
    progress.remove_task(bar)
    return found


def _disturbed(
    rng: np.random.Generator, env: ap.Environment, plan: ap.PathPlan, reached: int
) -> ap.Environment:
    """The current a step later, and obstacles elsewhere, none over the vehicle or its goal."""
    assert isinstance(env.current, LambVortices)
    current = evolve(jax.random.key(rng.integers(2**31)), env.current, CurrentUpdate())
    spheres = env.obstacles
    before = np.asarray(spheres.position, float)
    places = before + rng.normal(0.0, SHIFT, before.shape) * [1.0, 1.0, 0.0]
    radius = np.asarray(spheres.boundary(spheres.observed_at), float)
    active = np.flatnonzero(np.asarray(spheres.active))
    if len(active) and rng.random() < 0.5:
        ahead = int(rng.uniform(0.3, 0.7) * (len(plan.positions) - reached)) + reached
        places[rng.choice(active), :2] = plan.positions[ahead, :2] + rng.normal(0.0, 0.3 * SHIFT, 2)
    ends = np.stack([plan.positions[reached], plan.positions[-1]])
    near = np.linalg.norm(places[:, None, :2] - ends[:, :2], axis=2).min(axis=1) < radius + 100.0
    places[near] = before[near]
    return replace(env, current=current, obstacles=replace(spheres, position=jnp.asarray(places, float)))


def ways() -> dict[str, Callable[[Situation, jax.Array], ap.PathPlan]]:
    """Ways to plan anew."""
    return {
        "warm": _warm,
        "warm, no passages": partial(_warm, passages=0),
        "warm, no passages, no gradient": partial(_warm, passages=0, refine_steps=0),
        "warm, nothing fresh": partial(_warm, fresh_share=0.0),
        "cold, a window's budget": partial(_cold, times=1, passages=0),
        "cold, a window's budget, no gradient": partial(_cold, times=1, passages=0, refine_steps=0),
        "cold, a window's budget, passages": partial(_cold, times=1),
        f"cold, {TIMES} windows' budget, passages": partial(_cold, times=TIMES),
    }


def _config(situation: Situation, **changes: object) -> ap.PathConfig:
    return ap.PathConfig(**situation.problem.changes).replace(**changes)


def _warm(situation: Situation, key: jax.Array, **changes: object) -> ap.PathPlan:
    return ap.replan_path(
        situation.plan,
        situation.position,
        situation.now,
        situation.env,
        situation.problem.vehicle,
        key=key,
        config=_config(situation, **changes),
    )


def _cold(situation: Situation, key: jax.Array, times: int, **changes: object) -> ap.PathPlan:
    config = _config(situation, **changes)
    window = config.window()
    bbo = config.bbo.replace(iterations=times * window.bbo.iterations)
    return ap.plan_path(
        situation.position,
        np.asarray(situation.problem.goal),
        situation.env,
        situation.problem.vehicle,
        key=key,
        config=window.replace(
            bbo=bbo, refine_steps=times * window.refine_steps, passage_steps=times * window.passage_steps
        ),
        depart=situation.now,
    )


def rows(count: int, progress: Progress) -> list[Row]:
    """All ways on all situations."""
    all_, methods = situations(count, progress), ways()
    bar = progress.add_task("plans anew", total=len(all_) * len(methods))
    times = {name: np.full(len(all_), np.nan) for name in methods}
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    first: dict[str, float] = dict.fromkeys(methods, 0.0)
    compiled = set()
    for k, situation in enumerate(all_):
        for name, plan_anew in methods.items():
            key = jax.random.key(1000 + k)
            if (name, situation.problem.family) not in compiled:
                compiled.add((name, situation.problem.family))
                first[name] += clock(partial(plan_anew, situation, key))[0]
            took, plan = clock(partial(plan_anew, situation, key))
            seconds[name].append(took)
            times[name][k] = plan.travel_time if plan.feasible else np.nan
            progress.advance(bar)
    progress.remove_task(bar)
    best = times[f"cold, {TIMES} windows' budget, passages"]
    return [
        Row(
            name,
            float(np.nanmean(times[name] / best - 1.0)),
            float(np.nanmax(times[name] / best - 1.0)),
            float(np.isfinite(times[name]).mean()),
            float(np.median(seconds[name])),
            first[name],
        )
        for name in methods
    ]


def table(found: list[Row]) -> Table:
    """The ways to plan anew as a table."""
    figures = ["mean excess", "worst", "feasible", "a plan", "first calls"]
    shown = empty_table("Planning anew on the way", ["how"], figures)
    for row in found:
        shares = f"{row.mean:+.2%}", f"{row.worst:+.2%}", f"{row.feasible:.0%}"
        shown.add_row(row.name, *shares, f"{1e3 * row.seconds:.0f} ms", f"{row.first_seconds:.0f} s")
    return shown


def main() -> None:
    """Print the table and write the file."""
    parser = arguments("Warm re-plans against cold plans.")
    parser.add_argument("--situations", type=int, default=SITUATIONS)
    options = parser.parse_args()
    screen = console()
    with bars(screen) as progress:
        found = rows(options.situations, progress)
    screen.print(table(found))
    write(options.out, {"rows": found})


if __name__ == "__main__":
    main()
