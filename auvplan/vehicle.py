"""The vehicle: constant speed through the water, limits, and its kinematics (Eqs 6-8, 10)."""

import math
from dataclasses import dataclass
from functools import partial
from typing import Literal

import jax
import jax.numpy as jnp
from jax.typing import ArrayLike

SpeedReading = Literal["track", "eq8", "eq11"]

#: Least ground speed that travel times reckon with, as a share of the speed through the water. Slower
#: progress is a violation; the floor keeps times and gradients finite.
SPEED_FLOOR = 0.05


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("speed", "surge_max", "sway_max", "turn_rate_max"),
    meta_fields=(),
)
@dataclass(frozen=True)
class Vehicle:
    """A vehicle of constant thrust.

    Attributes:
        speed: |v|, m/s through the water (2.5, chosen here).
        surge_max: u_max, m/s, limit on the ground speed along the track.
        sway_max: v_max, m/s, limit on the current across the track.
        turn_rate_max: rad/s, limit on the change of yaw between samples.

    Raises:
        ValueError: a value is not positive and finite.

    Differences from the paper:
        Eq. 12 limits |psi| itself, which on a map forbids a direction; here the limit is on the turn rate.
    """

    speed: ArrayLike = 2.5
    surge_max: ArrayLike = 5.0
    sway_max: ArrayLike = 1.5
    turn_rate_max: ArrayLike = 0.1

    def __post_init__(self) -> None:
        for name in ("speed", "surge_max", "sway_max", "turn_rate_max"):
            value = getattr(self, name)
            if isinstance(value, (int, float)) and not (value > 0 and math.isfinite(value)):
                raise ValueError(f"vehicle {name} must be positive and finite, got {value}")


def orientation(dx: ArrayLike, dy: ArrayLike, dz: ArrayLike) -> tuple[jax.Array, jax.Array]:
    """Yaw psi and pitch theta of a displacement north, east, down (Eq. 10), rad; nose up is positive."""
    yaw = jnp.arctan2(dy, dx)
    pitch = jnp.arctan2(-jnp.asarray(dz), jnp.hypot(dx, dy))
    return yaw, pitch


def rotation(yaw: ArrayLike, pitch: ArrayLike) -> jax.Array:
    """Body-to-NED matrix of Eq. 7 at zero roll, [3, 3]."""
    cy, sy, cp, sp = jnp.cos(yaw), jnp.sin(yaw), jnp.cos(pitch), jnp.sin(pitch)
    zero = jnp.zeros_like(cy)
    return jnp.array([[cy * cp, -sy, cy * sp], [sy * cp, cy, sy * sp], [-sp, zero, cp]])


def ground_velocity(
    speed: ArrayLike, yaw: ArrayLike, pitch: ArrayLike, current: tuple[ArrayLike, ArrayLike, ArrayLike]
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Velocity over ground, m/s north, east, down, of a vehicle that points along (yaw, pitch) (Eq. 8).

    Differences from the paper:
        Eq. 8's third line adds |v| sin(theta) with theta positive nose up; depth is positive down, so the
        sign turns.
    """
    speed, u, v, w = (jnp.asarray(value) for value in (speed, *current))
    north = speed * jnp.cos(pitch) * jnp.cos(yaw) + u
    east = speed * jnp.cos(pitch) * jnp.sin(yaw) + v
    down = -speed * jnp.sin(pitch) + w
    return north, east, down


def along_track(
    reading: SpeedReading, speed: ArrayLike, along: jax.Array, across: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Ground speed along a track, from the current along and across it.

    "track": the vehicle crabs to hold the track, c_t + sqrt(V^2 - c_n^2). "eq8": it points along the tangent,
    V + c_t. "eq11": the current is left out, V.

    Args:
        reading: which of the three.
        speed: V, m/s through the water.
        along: c_t, m/s, current along the tangent.
        across: c_n >= 0, m/s, current across it.

    Returns:
        ``(ground_speed, shortfall)``: the speed that travel times use, at least `SPEED_FLOOR` times V, and by
        how much the current beats the vehicle, as a share of V; zero where the track can be held.
    """
    speed = jnp.asarray(speed, along.dtype)
    if reading == "eq11":
        still = jnp.broadcast_to(speed, along.shape)
        return still, jnp.zeros_like(along)
    floor = SPEED_FLOOR * speed
    if reading == "eq8":
        progress, beaten = speed + along, jnp.zeros_like(along)
    else:
        beaten = jnp.maximum(across - (1.0 - SPEED_FLOOR**2) * speed, 0.0)
        margin = jnp.maximum((speed - across) * (speed + across), floor**2)
        progress = along + jnp.sqrt(margin)
    shortfall = (jnp.maximum(floor - progress, 0.0) + beaten) / speed
    return jnp.maximum(progress, floor), shortfall
