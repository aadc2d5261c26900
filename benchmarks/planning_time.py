"""Compile and run times of the planners on this machine.

``python -m benchmarks.planning_time`` prints the first call (compilation and run) and the median of later
ones.
"""

import platform
import time
from collections.abc import Callable

import jax
import numpy as np

import auvplan as ap
from auvplan.mission import random_graph

START, GOAL = np.array([200.0, 300.0, 10.0]), np.array([3200.0, 3000.0, 50.0])


def world() -> ap.Environment:
    """12 vortices and 12 drifting obstacles in open water."""
    rng = np.random.default_rng(0)
    current = ap.random_vortices(jax.random.key(1), (0, 0, 0), (3500, 3500, 100), count=12)
    share = rng.uniform(0.2, 0.8, 12)[:, None]
    places = START + (GOAL - START) * share + rng.normal(0, 150, (12, 3))
    obstacles = ap.Obstacles.afloat(places, rng.uniform(30, 120, 12), growth=0.05)
    return ap.Environment(current, obstacles=obstacles, lower=(0, 0, 0), upper=(3500, 3500, 100))


def clock(name: str, call: Callable[[int], object], repeats: int, share: int = 1) -> None:
    """Time `call(k)`; `share` plans are made by each call."""
    begin = time.perf_counter()
    jax.block_until_ready(call(0))
    first = time.perf_counter() - begin
    times = []
    for k in range(1, repeats + 1):
        begin = time.perf_counter()
        jax.block_until_ready(call(k))
        times.append(time.perf_counter() - begin)
    print(f"{name:44} {first:10.2f} {1e3 * np.median(times) / share:16.1f}", flush=True)


def main() -> None:
    """Print the table."""
    env = world()
    rng = np.random.default_rng(0)
    graph = random_graph(rng, rng.uniform(0, 10_000, (40, 3)) * [1, 1, 0.1])
    starts, goals = np.tile(START, (32, 1)), np.tile(GOAL, (32, 1))
    print(f"{platform.processor() or platform.machine()}, {jax.default_backend()}, jax {jax.__version__}")
    print(f"{'what':44} {'first [s]':>10} {'then [ms/plan]':>16}")
    for name, config in (("paper", ap.PathConfig.paper()), ("default", ap.PathConfig())):
        clock(
            f"path, {name} preset",
            lambda k, c=config: ap.plan_path(START, GOAL, env, key=jax.random.key(k), config=c).population,
            9,
        )
        clock(
            f"32 paths in one call, {name} preset",
            lambda k, c=config: ap.plan_paths(starts, goals, env, key=jax.random.key(k), config=c).population,
            3,
            share=32,
        )
    plan = ap.plan_path(START, GOAL, env, key=jax.random.key(0))
    clock(
        "path re-plan from the kept population",
        lambda k: (
            ap.replan_path(plan, plan.positions[40], plan.times[40], env, key=jax.random.key(k)).population
        ),
        9,
    )
    for name, config in (("paper", ap.MissionConfig.paper()), ("default", ap.MissionConfig())):
        clock(
            f"mission of 40 waypoints, {name} preset",
            lambda k, c=config: (
                ap.plan_mission(
                    graph, 0, 39, 14_400.0, ap.Vehicle(), key=jax.random.key(k), config=c
                ).population
            ),
            5,
        )


if __name__ == "__main__":
    main()
