"""Where a vehicle that dead-reckons is on a planned path, and the chance that it touches something there."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.navigation import Navigation
from auvplan.ocean.environment import Environment
from auvplan.path.clearance import closed_clearance, coast_clearance, obstacle_clearance
from auvplan.path.config import PathConfig
from auvplan.path.kinematics import navigated, norm
from auvplan.path.plan import PathPlan
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle

Array = NDArray[np.floating]


@dataclass(frozen=True)
class Exposure:
    """What a planned path exposes a vehicle to whose position is uncertain.

    Attributes:
        std: [S] m, standard deviation of the position along each horizontal axis at the samples.
        clearance: [S - 1] m, certified distance of each segment to coast, areas closed then and the
            boundaries of obstacles; infinite in open water.
        risk: chance that the vehicle touches one of them on the way, at most; see `contact_bound`.
        end: its navigation at the goal.
    """

    std: Array
    clearance: Array
    risk: float
    end: Navigation


def exposed(plan: PathPlan) -> Exposure | None:
    """Return the exposure of a plan whose vehicle has navigation; None of others."""
    vehicle = plan.conditions.vehicle
    start = vehicle.navigation
    if start is None:
        return None
    positions, times = np.asarray(plan.positions, np.float32), np.asarray(plan.times, float)
    lasts = np.asarray(times - times[0], np.float32)
    depart = np.float32(times[0])
    clearance, known = jax.device_get(_exposed(positions, lasts, depart, plan.conditions.world(), vehicle))
    ahead = (known.way, known.unlocked), (start.way, start.unlocked)
    way, unlocked = (np.append(float(np.asarray(own)), part) for part, own in zip(*ahead, strict=True))
    std = np.asarray(start.since(way, unlocked).std, float)
    fix, drift, current = (float(np.asarray(part)) for part in (start.fix, start.drift, start.current_error))
    # What the biases multiply: it grows along a straight line but where bottom lock is found or lost.
    rates = np.diff(unlocked) / np.maximum(np.diff(times), 1e-9)
    turns = np.flatnonzero(np.abs(np.diff(rates)) > 0.5) + 1 if current else ()
    parts = sum(part > 0.0 for part in (fix, drift * way[-1], current * unlocked[-1]))
    risk = contact_bound(clearance, std, turns, parts)
    return Exposure(std, np.asarray(clearance, float), risk, start.since(float(way[-1]), float(unlocked[-1])))


@partial(compiled, quick=True)
def _exposed(
    positions: jax.Array, lasts: jax.Array, depart: jax.Array, env: Environment, vehicle: Vehicle
) -> tuple[jax.Array, Any]:
    """Clearance [S - 1] m of a path [S, 3] m that is at its samples after [S] s, and its navigation there."""
    x, y, z = (positions[:, axis, None] for axis in range(3))
    way = jnp.diff(x, axis=0), jnp.diff(y, axis=0), jnp.diff(z, axis=0)
    level, duration = norm(way[0], way[1]), jnp.diff(lasts)[:, None]
    times = depart + lasts[:, None]
    env = Environment(
        env.current, env.chart, env.obstacles.resolved(env.current), env.lower, env.upper, env.seabed,
        env.closures,
    )  # fmt: skip
    clear = coast_clearance(x, y, level, duration, env, PathConfig())[0]
    clear = jnp.minimum(clear, closed_clearance(x, y, level, times, env))
    segments = (x[:-1], y[:-1], z[:-1]), way, times[:-1], duration
    clear = jnp.minimum(clear, obstacle_clearance(segments, env))
    return clear[:, 0], jax.tree.map(lambda a: jnp.ravel(a), navigated((x, y, z), duration, env, vehicle))


def contact_bound(clearance: Array, std: Array, turns: Any = (), parts: int = 3) -> float:
    """Bound the chance that a vehicle touches what its planned path keeps clear of.

    Its error is the same function of a few biases all along the path, normal at each place, and between two
    places at which it does not turn (`turns`) it is a mean of the errors there: it is nowhere greater than at
    both. On a stretch between two such places it touches nothing unless its error at one of them exceeds the
    stretch's least clearance d. The chance of that is exp(-d^2 / 2 sigma^2), whatever the shape of the coast.
    By Boole's inequality chances of stretches add up; those stretches are taken whose sum is least. Nor is
    the error anywhere more than sigma times the length of all biases together, whose square has a chi-squared
    distribution: the lesser of both bounds counts.

    Args:
        clearance: [S - 1] m, of each segment.
        std: [S] m, along each horizontal axis at the ends of segments, none decreasing.
        turns: ends of segments at which the error's growth changes direction.
        parts: independent biases in the plane.
    """
    clear, std = np.maximum(np.asarray(clearance, float), 0.0), np.asarray(std, float)
    least = np.full(len(std), np.inf)
    least[0] = 0.0
    first = np.zeros(len(std), int)  # of the straight stretch that ends there
    for turn in turns:
        first[int(turn) + 1 :] = int(turn)
    for last in range(1, len(std)):
        begins = np.arange(first[last], last)
        near = np.minimum.accumulate(clear[first[last] : last][::-1])[::-1]
        both = np.exp(-0.5 * (near / std[begins]) ** 2) + np.exp(-0.5 * (near / std[last]) ** 2)
        least[last] = (least[begins] + both).min()
    whole = scipy.special.chdtrc(2 * max(parts, 1), (clear / std[1:]).min() ** 2)
    return float(min(least[-1], whole, 1.0))
