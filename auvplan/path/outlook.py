"""Re-evaluation of a followed plan in the current and among the obstacles known now."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import IN_CURRENT, VIOLATIONS, WITHIN, Track, evaluate
from auvplan.path.plan import PathPlan
from auvplan.path.profile import timed
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle

#: [V, 1], excess over each limit that is not a break.
_LET_PASS = np.array([[WITHIN * (name in IN_CURRENT)] for name in VIOLATIONS])


@dataclass(frozen=True)
class Outlook:
    """The rest of a plan, timed in another current.

    Attributes:
        time_left: s from the vehicle's place to the goal.
        planned: s, the same as it was planned.
        broken: whether the current breaks a limit on the way, or an area is closed by then. In the
            vertical, what a plan may exceed a limit by within its segments, `WITHIN`, is no break: stored
            positions have fewer digits than the planner's steps.
        times: [S] s since the epoch, at the samples of the plan; of those ahead they say when it is there.
    """

    time_left: float
    planned: float
    broken: bool
    times: NDArray[np.floating]

    @property
    def change(self) -> float:
        """By what share of the planned time the rest differs from it."""
        return abs(self.time_left - self.planned) / max(self.planned, 1.0)


def outlook(
    plan: PathPlan,
    sample: float,
    now: float,
    current: Current,
    vehicle: Vehicle,
    config: PathConfig,
    closures: tuple[Closure, ...] = (),
) -> Outlook:
    """Time the rest of a plan in a current; coast and obstacles are left out.

    Args:
        plan: the plan being followed.
        sample: where the vehicle is, in samples from the plan's start: in [0, S - 1], fractions between two.
        now: s since the epoch.
        current: as it is known now.
        vehicle: speed and limits.
        config: the settings that it was planned by.
        closures: areas that are closed at some hours.
    """
    sea = current, vehicle, closures
    count = np.arange(len(plan.times))
    # The vehicle may be later than planned: it is where it is now.
    depart = now - (np.interp(sample, count, plan.times) - plan.times[0])
    own = timed(config, current)
    times, excess = jax.device_get(_executed(plan.positions, np.float32(depart), *sea, config=own))
    times = np.asarray(times, float) + now - np.interp(sample, count, times)
    ahead = count[:-1] >= np.floor(sample)
    return Outlook(
        float(times[-1] - now),
        float(plan.times[-1] - np.interp(sample, count, plan.times)),
        bool((excess[:, ahead] > _LET_PASS).any()),
        times,
    )


@partial(compiled, static_argnames=("config",), quick=True)
def _executed(
    positions: jax.Array,
    depart: jax.Array,
    current: Current,
    vehicle: Vehicle,
    closures: tuple[Closure, ...],
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """Times [S] s at the samples, and excess [V, S - 1] of each segment over each limit."""
    track = Track.through(*(positions[:, axis, None] for axis in range(3)))
    box = positions.min(axis=0), positions.max(axis=0)
    bare = Environment(current, None, Obstacles.none(), *box, closures=closures)
    trajectory = evaluate(track, depart, bare, vehicle, config)
    return trajectory.times[:, 0], jnp.stack(trajectory.excess)[:, :, 0]
