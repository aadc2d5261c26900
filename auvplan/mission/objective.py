"""Objectives of routes (section 3.3.1, Eqs 14-15)."""

from typing import Literal

import jax
import jax.numpy as jnp

from auvplan.mission.decoder import Decoded
from auvplan.mission.problem import Problem
from auvplan.mission.speeds import Saved

ObjectiveName = Literal["priority", "eq15"]


def violation(routes: Decoded, problem: Problem) -> jax.Array:
    """Return how far from the goal routes end or how late they are there, [P] s.

    The time still to go, T_available where there is no path, and what the route takes beyond T_available.
    """
    unreachable = jnp.maximum(problem.time_available, 1.0)
    return jnp.where(jnp.isfinite(routes.remaining), routes.remaining, unreachable) + routes.late


def total_priority(
    routes: Decoded, problem: Problem, time_weight: float = 0.05, saves: Saved = "time"
) -> jax.Array:
    """Cost [P] of the aim of section 3.3.1: most total priority, ties to the shorter mission.

    cost = -sum(rho) + min(w rho_max, d / 2) T_Mission / T_available, d the least difference in total priority
    (`Problem.least_difference`): none is given up for time. A route that does not arrive costs N rho_max,
    more than any that does.

    Args:
        time_weight: w < 1, what the whole of T_available is worth at most, as a share of the largest
            priority.
        saves: "energy" for ties to the mission of least energy, where it is limited and speeds are free: what
            is available takes the place of T_available.

    Differences from the paper:
        Eq. 15 counts the unused time and sum(1 / rho), which grows with every task taken: its minimum is
        far from the most total priority. See `eq15`.
    """
    used, available = routes.time, problem.time_available
    if saves == "energy" and routes.energy is not None:
        used, available = routes.energy, problem.energies[1]
    cost = -routes.priority + _price(problem, time_weight, available) * used
    return jnp.where(routes.reached, cost, _largest_priority(problem) * problem.size)


def total_priority_gain(problem: Problem, time_weight: float = 0.05, saves: Saved = "time") -> jax.Array:
    """[N, K] by how much each edge lowers `total_priority`, in its least time or with its least energy."""
    used, available = problem.leg_times, problem.time_available
    if saves == "energy" and problem.levels is not None:
        used, available = problem.energies
    return problem.priority - _price(problem, time_weight, available) * _finite(used)


def eq15(routes: Decoded, problem: Problem, phi1: float = 1.0, phi2: float = 100.0) -> jax.Array:
    """Cost [P] of Eq. 15: Phi_1 |T_Mission - T_available| + Phi_2 sum(1 / rho) over the tasks.

    Differences from the paper:
        The path cost of a leg is read as its travel time. A route that does not arrive, or is late, costs
        more than any that arrives in time ("a big penalty value", section 4.2). The paper gives no values
        for Phi_1 and Phi_2; the defaults are chosen here.
    """
    size = problem.size
    cost = phi1 * jnp.abs(routes.time - problem.time_available) + phi2 * routes.inverse_priority
    least = jnp.where(problem.priority > 0.0, problem.priority, jnp.inf).min()
    worst = 1.0 + phi1 * jnp.abs(problem.time_available) + phi2 * size / least
    return cost + jnp.where(routes.reached, 0.0, worst)


def eq15_gain(problem: Problem, phi1: float = 1.0, phi2: float = 100.0) -> jax.Array:
    """[N, K] by how much each edge lowers `eq15`, as long as the mission is not late."""
    task = problem.priority > 0.0
    inverse = jnp.where(task, 1.0 / jnp.where(task, problem.priority, 1.0), 0.0)
    return phi1 * _finite(problem.leg_times) - phi2 * inverse


def _largest_priority(problem: Problem) -> jax.Array:
    largest = problem.priority.max()
    return jnp.where(largest > 0.0, largest, 1.0)


def _price(problem: Problem, time_weight: float, available: jax.Array) -> jax.Array:
    """Return what `total_priority` asks for a second, or a joule, of what is available."""
    worth = jnp.minimum(time_weight * _largest_priority(problem), 0.5 * problem.least_difference)
    return worth / jnp.where(available > 0.0, available, 1.0)


def _finite(leg_times: jax.Array) -> jax.Array:
    """Leg times with zeros off the edges."""
    return jnp.where(jnp.isfinite(leg_times), leg_times, 0.0)
