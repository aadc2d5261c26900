"""Paths searched for in samples of a current that is given as a function.

The costly programs of the search are compiled for each function, but once for all samples of one shape.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.currents import FunctionCurrent, axes_used, evaluated
from auvplan.ocean.sampled import SampledCurrent, sampled
from auvplan.path.config import PathConfig
from auvplan.path.cost import IN_CURRENT, VIOLATIONS
from auvplan.path.motion import progress_along
from auvplan.path.passages import SURROUNDINGS
from auvplan.path.stages import Batch
from auvplan.vehicle import Vehicle

#: Share of the vehicle's speed by which samples may differ from the current.
_WITHIN = 0.01

#: Least time that samples cover, in times of the straight line in still water.
_LONGEST = 3.0

#: Sides of the box that are longer than the leg by this factor are none for it.
_WIDEST = 100.0


def in_samples(
    program: Callable[..., dict[str, Any]],
    keys: jax.Array,
    batch: Batch,
    *rest: Any,
    config: PathConfig,
    **settings: Any,
) -> dict[str, Any]:
    """Run a search of one leg in samples of a current that is given as a function; any other as it is.

    What is found is timed and judged in the function. Where it breaks a limit there, the search is run once
    more, in the function.

    Args:
        program: `search_legs` or `polish_finely`.
        keys, batch, config: as the program takes them.
        rest, settings: its other arguments.

    Returns:
        What the program returns, and `sampling_error` and `sampling_time_error` [B] as `PathPlan` has them.
    """
    none = np.zeros(len(batch.legs.start))

    def run(searched: Batch) -> dict[str, Any]:
        found = program(keys, searched, *rest, config=config, judging=batch, **settings)
        return found | {"sampling_error": none, "sampling_time_error": none}

    samples = samples_of(batch) if config.sampled else None
    if samples is None:
        return run(batch)
    current, error = samples
    shared, obstacles = batch.env, batch.env.obstacles
    if np.any(obstacles.drift):
        obstacles = obstacles.resolved(shared.current)
    found = run(batch.within(replace(shared, current=current, obstacles=obstacles)))
    broken = found["violations"][:, [VIOLATIONS.index(name) for name in IN_CURRENT]].any()
    if broken and settings.get("budget") is None:
        return run(batch)
    found["sampling_error"] = none + error
    found["sampling_time_error"] = _time_error(found, current, batch.vehicle, config)
    return found


def _time_error(
    found: dict[str, Any], samples: SampledCurrent, vehicle: Vehicle, config: PathConfig
) -> NDArray[np.floating]:
    """Return s, [B], by which paths take longer or shorter in samples than in the current that they met."""
    positions, times = (np.asarray(found[name], float) for name in ("positions", "times"))
    way, middle = np.diff(positions, axis=1), 0.5 * (positions[:, 1:] + positions[:, :-1])
    x, y, z = np.moveaxis(middle, -1, 0)
    sampled_water = np.stack(evaluated(samples, x, y, z, 0.5 * (times[:, 1:] + times[:, :-1])), axis=-1)
    seconds = []
    for water in (sampled_water, np.asarray(found["water"], float)):
        _, progress = progress_along(config.speed_reading, float(np.asarray(vehicle.speed)), way, water)
        seconds.append((np.linalg.norm(way, axis=-1) / progress).sum(axis=1))
    return np.abs(seconds[0] - seconds[1])


def samples_of(batch: Batch) -> tuple[SampledCurrent, float] | None:
    """Return `sampled` of the current of one leg; of other currents None.

    Samples are taken over the whole box, and over a time that begins and lasts round numbers of seconds, so
    that other legs and re-plans of a mission share them. Where the box has no sides it is the leg's
    surroundings.
    """
    legs, shared, speed = batch.legs, batch.env, float(np.asarray(batch.vehicle.speed))
    current = shared.current
    if not isinstance(current, FunctionCurrent) or len(legs.start) > 1:
        return None
    ends = np.concatenate([legs.start, legs.goal])
    distance = float(np.linalg.norm(ends[1] - ends[0]))
    lower, upper = np.asarray(shared.lower, float), np.asarray(shared.upper, float)
    wide = upper - lower > _WIDEST * distance
    reach = distance * np.array([SURROUNDINGS, SURROUNDINGS, 1.0])
    # An end may lie a rounding outside the box.
    around = ends.min(axis=0) - reach, ends.max(axis=0) + reach
    lower = np.minimum(np.where(wide, np.maximum(lower, around[0]), lower), ends.min(axis=0))
    upper = np.maximum(np.where(wide, np.minimum(upper, around[1]), upper), ends.max(axis=0))
    first, last = 0.0, 0.0
    if axes_used(current, vertical=True)[3]:
        lasts = 2.0 ** np.ceil(np.log2(_LONGEST * distance / speed))
        first = float(np.floor(legs.depart[0] / lasts) * lasts)
        last = first + 2.0 * float(lasts)
    return sampled(current, tuple(lower.tolist()), tuple(upper.tolist()), first, last, _WITHIN * speed)
