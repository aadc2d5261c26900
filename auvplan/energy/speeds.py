"""Speeds through the water of least energy per metre over ground."""

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from auvplan.energy.power import PowerModel, PowerTable
from auvplan.vehicle import along_track

#: Speeds that are compared before the best of them is refined, and halvings of the interval around it.
_SPEEDS, _HALVINGS = 48, 40


def energy_per_metre(
    power: PowerModel,
    speed: ArrayLike,
    along: ArrayLike = 0.0,
    across: ArrayLike = 0.0,
    price: ArrayLike = 0.0,
) -> jax.Array:
    """Return (P(v) + price) / ground speed, J/m, of a vehicle that crabs to hold its track.

    Args:
        power: of the vehicle.
        speed: v, m/s through the water.
        along: c_t, m/s, current along the track.
        across: c_n, m/s, current across it.
        price: W, what a second is worth; zero where energy alone counts.
    """
    speed, along, across = (jnp.asarray(part, float) for part in (speed, along, across))
    ground, _ = along_track("track", speed, along, jnp.abs(across))
    return (power.power(speed) + price) / ground


def cubic_best_speed(constant: ArrayLike, factor: ArrayLike, along: ArrayLike = 0.0) -> jax.Array:
    """Return the speed of least energy per metre of P = H + k v^3 in a current along the track, m/s.

    It is the positive real root of 2 k v^3 + 3 k c v^2 - H = 0. Arrays broadcast.

    Args:
        constant: H > 0, W: hotel, payload, the propulsion's constant, and the price of a second.
        factor: k > 0, W s^3/m^3.
        along: c, m/s, current along the track, negative against the vehicle.

    Example:
        >>> round(float(cubic_best_speed(40.0, 20.0)), 6)  # (H / 2 k)^(1/3)
        1.0
    """
    constant, factor, along = (jnp.asarray(part, float) for part in (constant, factor, along))
    # v = y - m turns it into y^3 - 3 m^2 y = q.
    m = 0.5 * along
    q = 0.5 * constant / factor - 2.0 * m**3
    under = q * q - 4.0 * m**6
    single = under > 0.0  # one real root; else three, of which the greatest counts
    root = jnp.cbrt(0.5 * (jnp.where(single, q, 1.0) + jnp.sqrt(jnp.where(single, under, 1.0))))
    alone = root + m * m / root
    size = jnp.where(single, 1.0, jnp.abs(m))
    share = jnp.clip(jnp.where(single, 0.0, q) / (2.0 * size**3), -1.0 + 1e-7, 1.0 - 1e-7)
    return jnp.where(single, alone, 2.0 * size * jnp.cos(jnp.arccos(share) / 3.0)) - m


def best_speed(
    power: PowerModel,
    along: ArrayLike = 0.0,
    across: ArrayLike = 0.0,
    price: ArrayLike = 0.0,
    limits: tuple[ArrayLike, ArrayLike] = (0.1, 5.0),
) -> jax.Array:
    """Return the speed through the water of least (P(v) + price) / ground speed within limits, m/s.

    Speeds are compared on a grid, and the slope's change of sign beside the best of them is found by halving:
    tables, laws and anything else that JAX differentiates are taken alike. For `jax.jit`, `vmap` and `grad`;
    derivatives are those of the implicit function, zero where a corner of a table is best. Where the current
    beats the vehicle at every speed, the fastest is the best there is.

    Args:
        power: of the vehicle.
        along, across, price: as for `energy_per_metre`; arrays broadcast.
        limits: least and greatest speed, m/s; see `speed_range` for those of a table.

    Example:
        >>> from auvplan.energy import PowerLaw
        >>> model = PowerModel(hotel=30.0, propulsion=PowerLaw(10.0, 20.0))
        >>> round(float(best_speed(model)), 3), round(float(best_speed(model, along=-0.5)), 3)
        (1.0, 1.322)
    """
    parts = (*limits, along, across, price)
    low, high, along, across, price = jnp.broadcast_arrays(*(jnp.asarray(part, float) for part in parts))
    one = partial(_best, power)
    for _ in range(low.ndim):
        one = jax.vmap(one)
    return one(low, high, along, across, price)


def _best(
    power: PowerModel, low: jax.Array, high: jax.Array, along: jax.Array, across: jax.Array, price: jax.Array
) -> jax.Array:
    """`best_speed` of single numbers."""

    def cost(speed: jax.Array, *given: Any) -> jax.Array:
        model, along, across, price = given
        spent = energy_per_metre(model, speed, along, across, price)
        shortfall = along_track("track", speed, along, jnp.abs(across))[1]
        return spent * (1.0 + 1e3 * shortfall)

    given = power, along, across, price
    fixed, ends = jax.lax.stop_gradient(given), jax.lax.stop_gradient((low, high))
    slope = jax.grad(cost)
    speeds = ends[0] + (ends[1] - ends[0]) * jnp.linspace(0.0, 1.0, _SPEEDS)
    k = jnp.argmin(jax.vmap(lambda speed: cost(speed, *fixed))(speeds))
    bracket = speeds[jnp.maximum(k - 1, 0)], speeds[jnp.minimum(k + 1, _SPEEDS - 1)]

    def halve(_: Any, bracket: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
        middle = 0.5 * (bracket[0] + bracket[1])
        rises = slope(middle, *fixed) > 0.0
        return jnp.where(rises, bracket[0], middle), jnp.where(rises, middle, bracket[1])

    before, after = jax.lax.fori_loop(0, _HALVINGS, halve, bracket)
    found = 0.5 * (before + after)
    # One step of Newton's, of no length, has the derivatives of the root. A corner has none.
    bend = jax.grad(slope)(found, *fixed)
    level = jnp.abs(slope(found, *fixed)) * found < 1e-2 * cost(found, *fixed)
    smooth = level & (bend > 0.0) & (found > ends[0]) & (found < ends[1])
    change = slope(found, *given) - slope(found, *fixed)
    found = found - jnp.where(smooth, change / jnp.where(smooth, bend, 1.0), 0.0)
    near = 1e-6 * (ends[1] - ends[0])
    return jnp.where(found <= ends[0] + near, low, jnp.where(found >= ends[1] - near, high, found))


def speed_range(power: PowerModel, default: tuple[float, float] = (0.1, 5.0)) -> tuple[float, float]:
    """Return the speeds above zero, m/s, that a table of propulsion power covers; else the default."""
    if not isinstance(power.propulsion, PowerTable):
        return default
    moving = np.asarray(power.propulsion.speeds)
    moving = moving[moving > 0.0]
    return float(moving[0]), float(moving[-1])
