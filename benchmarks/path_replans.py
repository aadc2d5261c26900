"""Re-planning on the way: what the kept population is worth (Fig. 5).

`python -m benchmarks.path_replans` disturbs plans under way: the current takes a step of Eq. 2, obstacles
turn out to lie elsewhere, and in half of the cases one lies across the rest of the path. It re-plans warm
from the kept population, cold, and cold with ten times the budget of a window, which the others are compared
with.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import auvplan as ap
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve
from benchmarks.harness import clock, launch, show, track
from benchmarks.paths.problems import PathProblem, random_problems

SITUATIONS = 50
#: The plan that all others are compared with has the budget of this number of windows.
TIMES = 10
#: m, standard deviation of the error with which an obstacle was known before.
SHIFT = 40.0


@dataclass(frozen=True, eq=False)
class Situation:
    """A vehicle under way in a sea that has changed."""

    problem: PathProblem  # what it set out to do
    plan: ap.PathPlan
    position: np.ndarray  # [3] m, where it is
    now: float  # s since the epoch
    env: ap.Environment


#: A row for each way to plan: excess of the travel time over that of the largest budget.
TITLE = "Re-planning on the way"
COLUMNS = {
    "how": "{name}", "mean excess": "{mean:+.2%}", "worst": "{worst:+.2%}", "feasible": "{feasible:.0%}",
    "a plan": "{milliseconds:.0f} ms", "first calls": "{first_seconds:.0f} s",
}  # fmt: skip


def situations(count: int) -> list[Situation]:
    """Disturbed plans of the random problems, several of each."""
    problems, found = random_problems(), []
    for number in track(range(count), "situations"):
        problem, rng = problems[number % len(problems)], np.random.default_rng(number)
        plan = problem.plan(jax.random.key(number), ap.PathConfig())
        reached = int(rng.uniform(0.1, 0.5) * len(plan.positions))
        env = _disturbed(rng, problem.environment, plan, reached)
        found.append(Situation(problem, plan, plan.positions[reached], float(plan.times[reached]), env))
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


def warm(situation: Situation, key: jax.Array, **changes: object) -> ap.PathPlan:
    problem = situation.problem
    config = ap.PathConfig(**problem.changes).replace(**changes)
    now = situation.position, situation.now, situation.env, problem.vehicle
    return ap.replan_path(situation.plan, *now, key=key, config=config)


def cold(situation: Situation, key: jax.Array, times: int, **changes: object) -> ap.PathPlan:
    """Plan as if for the first time, with a multiple of a window's budget."""
    problem = situation.problem
    window = ap.PathConfig(**problem.changes).replace(**changes).window()
    bbo = window.bbo.replace(iterations=times * window.bbo.iterations)
    steps = {name: times * getattr(window, name) for name in ("refine_steps", "passage_steps")}
    asked = situation.position, np.asarray(problem.goal), situation.env, problem.vehicle
    return ap.plan_path(*asked, key=key, config=window.replace(bbo=bbo, **steps), depart=situation.now)


LARGEST = f"cold, {TIMES} windows' budget, passages"
#: Ways to re-plan.
WAYS: dict[str, Callable[..., ap.PathPlan]] = {
    "warm": warm,
    "warm, no passages": partial(warm, passages=0),
    "warm, no passages, no gradient": partial(warm, passages=0, refine_steps=0),
    "warm, nothing fresh": partial(warm, fresh_share=0.0),
    "cold, a window's budget": partial(cold, times=1, passages=0),
    "cold, a window's budget, no gradient": partial(cold, times=1, passages=0, refine_steps=0),
    "cold, a window's budget, passages": partial(cold, times=1),
    LARGEST: partial(cold, times=TIMES),
}


def rows(count: int) -> list[dict[str, Any]]:
    """All ways on all situations; the first call for each family of problems compiles and counts apart."""
    all_ = situations(count)
    times, seconds = np.full((2, len(WAYS), len(all_)), np.nan)
    first, compiled = np.zeros(len(WAYS)), set()
    for k, situation in enumerate(track(all_, "re-plans")):
        for way, (name, replan) in enumerate(WAYS.items()):
            call = partial(replan, situation, jax.random.key(1000 + k))
            if (name, situation.problem.family) not in compiled:
                compiled.add((name, situation.problem.family))
                first[way] += clock(call)[0]
            seconds[way, k], plan = clock(call)
            times[way, k] = plan.travel_time if plan.feasible else np.nan
    excess = times / times[list(WAYS).index(LARGEST)] - 1.0
    found = {
        "mean": np.nanmean(excess, axis=1), "worst": np.nanmax(excess, axis=1),
        "feasible": np.isfinite(times).mean(axis=1), "first_seconds": first,
        "milliseconds": 1e3 * np.median(seconds, axis=1),
    }  # fmt: skip
    by_way = zip(WAYS, *map(np.ndarray.tolist, found.values()), strict=True)
    return [dict(zip(("name", *found), row, strict=True)) for row in by_way]


@launch(situations=(SITUATIONS, "in which plans are made anew"))
def main(situations: int) -> dict[str, Any]:
    found = rows(situations)
    show(TITLE, found, COLUMNS)
    return {"rows": found}
