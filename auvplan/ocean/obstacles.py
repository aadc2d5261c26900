"""Obstacles: fixed, afloat and self-motivated spheres, known with uncertainty (section 2).

The same structure serves as the truth and as what a vehicle believes; the belief carries standard deviations
and the time of the last look, from which the collision boundary follows.
"""

from dataclasses import dataclass, replace
from typing import Any

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.currents import Current
from auvplan.ocean.raster import is_traced
from auvplan.runtime.arguments import numbers

#: What of obstacles is never below zero.
_NOT_NEGATIVE = "radii", "position_std", "radius_std", "growth", "growth_max"
#: Standard deviations that a collision boundary allows for (chosen here).
CONFIDENCE = 3.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Obstacles:
    """M spheres, padded by inactive ones.

    Attributes:
        position: Theta_p, [M, 3] m, when last observed.
        velocity: [M, 3] m/s, own velocity through the water.
        drift: [M], 1 where the current carries the obstacle, 0 where it stands.
        radius: Theta_r, [M] m.
        position_std: Theta_Ur, [M] m.
        radius_std: Theta_Ur, [M] m.
        growth: [M] m/s, growth of the collision boundary since the last look.
        growth_max: [M] m, where that growth ends.
        observed_at: [M] s, time of the last look.
        active: [M] bool.

    Differences from the paper:
        Theta_r, its "dimension (diameter)", is the radius. It says that boundaries grow with time, not how:
        the speed and the end of the growth are settings, and the errors of measurement add to it.
    """

    position: jax.Array
    velocity: jax.Array
    drift: jax.Array
    radius: jax.Array
    position_std: jax.Array
    radius_std: jax.Array
    growth: jax.Array
    growth_max: jax.Array
    observed_at: jax.Array
    active: jax.Array

    @classmethod
    def create(
        cls,
        positions: ArrayLike,
        radii: ArrayLike,
        *,
        velocity: ArrayLike = 0.0,
        drift: ArrayLike = 0.0,
        position_std: ArrayLike = 0.0,
        radius_std: ArrayLike = 0.0,
        growth: ArrayLike = 0.0,
        growth_max: ArrayLike = 60.0,
        observed_at: ArrayLike = 0.0,
    ) -> "Obstacles":
        """Any mixture of kinds; scalars are spread over the M obstacles.

        Raises:
            ValueError: shapes do not fit, a radius, a deviation or a growth is negative, or a value is not
                finite; `growth_max` alone may be infinite.
            TypeError: a value is no number.
        """
        single: dict[str, Any] = {
            "drift": drift, "radii": radii, "position_std": position_std, "radius_std": radius_std,
            "growth": growth, "growth_max": growth_max, "observed_at": observed_at,
        }  # fmt: skip
        for name, value in {"positions": positions, "velocity": velocity, **single}.items():
            found = np.zeros(0) if is_traced(value) else numbers(name, value)
            bad = np.isnan(found) if name == "growth_max" else ~np.isfinite(found)
            if bad.any():
                raise ValueError(f"{name} must be finite, got {found[bad][0]}")
            if name in _NOT_NEGATIVE and (found < 0.0).any():
                raise ValueError(f"{name} must not be negative")
        position, velocity = jnp.asarray(positions, float), jnp.asarray(velocity, float)
        if position.size % 3:
            raise ValueError(f"positions must be [M, 3] m, got shape {position.shape}")
        position = position.reshape(-1, 3)
        count = position.shape[0]
        if velocity.shape not in ((), (3,), (1, 3), (count, 3)):
            raise ValueError(f"velocity must be [3] or [{count}, 3] m/s, got shape {velocity.shape}")
        for name, value in single.items():
            array = jnp.asarray(value, float)
            if array.shape not in ((), (count,)):
                raise ValueError(f"{name} must be a number or [{count}], got shape {array.shape}")
            single[name] = jnp.broadcast_to(array, (count,))
        parts = [position, jnp.broadcast_to(velocity, (count, 3)), *single.values(), jnp.ones(count, bool)]
        return cls(*parts)

    @classmethod
    def none(cls) -> "Obstacles":
        """No obstacle at all."""
        # Put, not made there: that would be a program for each.
        plane, row, flags = jax.device_put((np.zeros((0, 3)), np.zeros(0), np.zeros(0, bool)))
        return cls(plane, plane, row, row, row, row, row, row, row, flags)

    @classmethod
    def static(cls, positions: ArrayLike, radii: ArrayLike, **uncertainty: ArrayLike) -> "Obstacles":
        """Static-uncertain obstacles: the place is fixed. `uncertainty` as in `create`."""
        return cls.create(positions, radii, **uncertainty)

    @classmethod
    def afloat(cls, positions: ArrayLike, radii: ArrayLike, **uncertainty: ArrayLike) -> "Obstacles":
        """Afloat obstacles: they drift with the local current. `uncertainty` as in `create`."""
        return cls.create(positions, radii, drift=1.0, **uncertainty)

    @classmethod
    def self_motivated(
        cls, positions: ArrayLike, radii: ArrayLike, velocity: ArrayLike, **uncertainty: ArrayLike
    ) -> "Obstacles":
        """Self-motivated obstacles: own velocity [M, 3] m/s on top of the local current."""
        return cls.create(positions, radii, velocity=velocity, drift=1.0, **uncertainty)

    def __add__(self, other: "Obstacles") -> "Obstacles":
        return jax.tree.map(lambda a, b: jnp.concatenate([a, b]), self, other)

    def __len__(self) -> int:
        return self.position.shape[0]

    def padded(self, capacity: int) -> "Obstacles":
        """Filled up with inactive obstacles, so that worlds share one shape; leaves may have leading axes.

        Raises:
            ValueError: there are more obstacles than `capacity`.
        """
        axis = np.ndim(self.radius) - 1
        count = self.radius.shape[axis]
        if count > capacity:
            raise ValueError(f"{count} obstacles exceed the capacity of {capacity}")

        def longer(leaf: ArrayLike) -> np.ndarray:
            more = [(0, capacity - count if k == axis else 0) for k in range(np.ndim(leaf))]
            # Where the last obstacle is a current is known.
            return np.pad(np.asarray(leaf), more, mode="edge" if count else "constant")

        active = longer(self.active)
        active[..., count:] = False
        return replace(jax.tree.map(longer, self), active=active)

    def resolved(self, current: Current) -> "Obstacles":
        """Obstacles whose `velocity` is all of their motion, as their present state foretells it.

        The current at the place and time of the last look is taken to carry them on ("their behaviour in one
        step forward can be estimated according to their present state", section 4.1).
        """
        x, y, z = (self.position[:, axis] for axis in range(3))
        carried = jnp.stack(current(x, y, z, self.observed_at), axis=1)
        return replace(
            self, velocity=self.velocity + self.drift[:, None] * carried, drift=jnp.zeros_like(self.drift)
        )

    def boundary(self, t: jax.Array) -> jax.Array:
        """Collision boundary [M] m at time t: radius, uncertainty, and growth since the last look."""
        chex.assert_rank(self.radius, 1)
        grown = jnp.minimum(self.growth * jnp.maximum(t - self.observed_at, 0.0), self.growth_max)
        spread = CONFIDENCE * jnp.sqrt(self.position_std**2 + self.radius_std**2 + 1e-12)
        return self.radius + spread + grown


def closest_approach(apart: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Return how near a vehicle and M obstacles come to each other between n moments of a path.

    Args:
        apart: [n, M, 3] m, from the obstacles' centres to the vehicle; all go straight between two moments.

    Returns:
        [n, M] m, least distance between each moment and the next, and [n, M] where in between, from 0 to 1;
        of the last moment its own distance.
    """
    moves = np.diff(apart, axis=0, append=apart[-1:])
    square = np.maximum((moves**2).sum(axis=-1), np.finfo(float).tiny)
    share = np.clip(-(apart * moves).sum(axis=-1) / square, 0.0, 1.0)
    return np.linalg.norm(apart + share[..., None] * moves, axis=-1), share
