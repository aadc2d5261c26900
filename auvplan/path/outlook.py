"""Re-evaluation of a followed plan in the sea as it is known now."""

from dataclasses import dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.compiled import compiled
from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import Track, evaluate
from auvplan.path.plan import PathPlan
from auvplan.vehicle import Vehicle


@dataclass(frozen=True)
class Outlook:
    """The rest of a plan, timed in another current.

    Attributes:
        time_left: s from the vehicle's place to the goal.
        planned: s, the same as it was planned.
        broken: whether the current breaks a limit on the way, or an area is closed by then.
    """

    time_left: float
    planned: float
    broken: bool

    @property
    def change(self) -> float:
        """By what share of the planned time the rest differs from it."""
        return abs(self.time_left - self.planned) / max(self.planned, 1.0)


def outlook(
    plan: PathPlan,
    sample: float,
    current: Current,
    vehicle: Vehicle,
    config: PathConfig,
    closures: tuple[Closure, ...] = (),
) -> Outlook:
    """Time the rest of a plan in a current; coast and obstacles are left out.

    Args:
        plan: the plan being followed.
        sample: where the vehicle is, in samples from the plan's start: in [0, S - 1], fractions between two.
        current: as it is known now.
        vehicle: speed and limits.
        config: the settings that it was planned by.
        closures: areas that are closed at some hours.
    """
    sea = current, vehicle, closures
    times, excess = jax.device_get(_executed(plan.positions, plan.times[0], *sea, config=config))
    count = np.arange(len(times))
    ahead = count[:-1] >= np.floor(sample)
    return Outlook(
        float(times[-1] - np.interp(sample, count, times)),
        float(plan.times[-1] - np.interp(sample, count, plan.times)),
        bool((excess[:, ahead] > 0.0).any()),
    )


@partial(compiled, static_argnames=("config",))
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
