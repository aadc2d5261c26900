"""How long one call of the path planner takes in a single thread (Fig. 14)."""

import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import xarray as xr

from auvplan.scenario import Scenario
from auvplan.study.runner import JAX_SETTINGS

#: Calls of which the median counts.
_REPEATS = 3


def call_times(scenario: Scenario, seeds: Sequence[int]) -> xr.Dataset:
    """Time single path planning calls, one for each mission, in a process of its own on one core.

    A process bound to one core starts no threads that could share the work. What is counted is its CPU time,
    which other processes of the machine do not lengthen.

    Args:
        scenario: of the missions.
        seeds: of the missions, in each of which the leg from the start to its nearest neighbour is planned.

    Returns:
        `first_cpu` [mission] s of planning the leg, and `window_cpu` [mission] s of planning it anew.
    """
    import jax

    settings = {name: getattr(jax.config, name) for name in JAX_SETTINGS}
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        found = pool.submit(_measure, scenario.model_dump(mode="json"), list(seeds), settings).result()
    attributes = {"units": "s", "comment": "CPU time of a process on one core, host work included"}
    return xr.Dataset(
        {
            "first_cpu": ("mission", found[0], attributes),
            "window_cpu": ("mission", found[1], attributes),
        },
        {"seed": ("mission", list(seeds))},
    )


def _measure(plain: dict[str, Any], seeds: list[int], settings: dict[str, Any]) -> list[list[float]]:
    """CPU seconds of first and of window calls, [2][missions]."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    import jax

    for name, value in settings.items():
        jax.config.update(name, value)
    from auvplan.executive import seed_keys
    from auvplan.executive.legs import begin_legs
    from auvplan.executive.loop import make_context, start_mission
    from auvplan.executive.path_calls import plan_legs
    from auvplan.records import LegRecord
    from auvplan.scenario.file import validate_scenario

    context = make_context(validate_scenario(plain, "calls"), ".")
    times: list[list[float]] = [[], []]
    for key, seed in zip(seed_keys(seeds), seeds, strict=True):
        mission = start_mission(context, 0, key, seed)
        places = np.asarray(mission.graph.positions, float)
        away = np.linalg.norm(places - places[0], axis=1)
        nearest = int(np.argmin(np.where(np.asarray(mission.graph.adjacency)[0], away, np.inf)))
        begin_legs(context, [mission], [LegRecord(0, nearest, np.inf, 0.0, 0.0)])
        for found, cold in zip(times, (True, False), strict=True):
            plan_legs(context, [mission], ["leg"], cold=cold)  # compiles where nothing has before
            took = []
            for _ in range(_REPEATS):
                begin = time.process_time()
                plan_legs(context, [mission], ["leg"], cold=cold)
                took.append(time.process_time() - begin)
            found.append(float(np.median(took)))
    return times
