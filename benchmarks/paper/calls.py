"""How long one call of the path planner takes in a single thread (Fig. 14)."""

import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from multiprocessing import get_context
from typing import Any

import jax
import numpy as np
import xarray as xr

from auvplan.executive import seed_keys
from auvplan.executive.context import make_context
from auvplan.executive.legs import begin_legs
from auvplan.executive.loop import start_mission
from auvplan.executive.path_calls import plan_legs
from auvplan.records import LegRecord
from auvplan.scenario import Scenario
from auvplan.scenario.file import validate_scenario
from auvplan.study.runner import JAX_SETTINGS

#: Calls of which the median counts.
_REPEATS = 3


def process_apart() -> ProcessPoolExecutor:
    """Return a process beside this one, with the same settings of JAX."""
    settings = {name: getattr(jax.config, name) for name in JAX_SETTINGS}
    return ProcessPoolExecutor(1, get_context("spawn"), _set, (settings,))


def _set(settings: dict[str, Any]) -> None:
    for name, value in settings.items():
        jax.config.update(name, value)


def call_times(scenarios: Sequence[Scenario], seeds: Sequence[int]) -> list[xr.Dataset]:
    """Time single path planning calls, one for each mission, in a process on one core for each scenario.

    A process bound to one core starts no threads that could share the work. What is counted is its CPU time,
    which other processes of the machine do not lengthen.

    Args:
        scenarios: of the missions.
        seeds: of the missions, in each of which the leg from the start to its nearest neighbour is planned.

    Returns:
        For each scenario `first_cpu` [mission] s of planning the leg, and `window_cpu` [mission] s of
        planning it again.
    """
    with ExitStack() as stack:
        calls = [
            stack.enter_context(process_apart()).submit(_measure, one.model_dump(mode="json"), seeds, core)
            for core, one in enumerate(scenarios)
        ]
        found = [call.result() for call in calls]
    about = {"units": "s", "comment": "CPU time of a process on one core, host work included"}
    names = "first_cpu", "window_cpu"
    return [
        xr.Dataset(
            {name: ("mission", values, about) for name, values in zip(names, times, strict=True)},
            {"seed": ("mission", list(seeds))},
        )
        for times in found
    ]


def _measure(plain: dict[str, Any], seeds: Sequence[int], core: int) -> list[list[float]]:
    """CPU seconds of first and of window calls, [2][missions]."""
    if hasattr(os, "sched_setaffinity"):
        ours = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {ours[core % len(ours)]})
    context = make_context(validate_scenario(plain, "calls"), ".")
    times: list[list[float]] = [[], []]
    for key, seed in zip(seed_keys(seeds), seeds, strict=True):
        mission = start_mission(context, 0, key, seed)
        places = np.asarray(mission.graph.positions, float)
        away = np.linalg.norm(places - places[0], axis=1)
        nearest = int(np.argmin(np.where(np.asarray(mission.graph.adjacency)[0], away, np.inf)))
        begin_legs([mission], [LegRecord(0, nearest, np.inf, 0.0, 0.0)])
        for found, cold in zip(times, (True, False), strict=True):
            if not found:
                plan_legs([mission], "leg", cold=cold)  # compiles
            took = []
            for _ in range(_REPEATS):
                begin = time.process_time()
                plan_legs([mission], "leg", cold=cold)
                took.append(time.process_time() - begin)
            found.append(float(np.median(took)))
    return times
