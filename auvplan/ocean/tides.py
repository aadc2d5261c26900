"""Tidal currents from harmonic constituents."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.ocean.currents import Velocity
from auvplan.ocean.deviation import interpolation_deviation


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class HarmonicCurrent:
    """Sums of cosines of constant frequencies at P places, by the square of the distance in between.

    Attributes:
        places: [P, 2] m north, east.
        rate: [K] rad/s, of the constituents.
        in_phase, quadrature: [2, P, K] m/s north and east, of the cosine and the sine of rate times t, s
            since the epoch; nodal factors and phases are in them.
        mean: [2, P] m/s north and east.
        depths: [D] m, rising, and `shares` [D] of the velocities there; linear in between.
        uniform: [3] m/s north, east, down, added everywhere.
    """

    places: Any
    rate: Any
    in_phase: Any
    quadrature: Any
    mean: Any
    depths: Any
    shares: Any
    uniform: Any = field(default_factory=lambda: np.zeros(3, np.float32))
    steady = False
    gradual = True

    @property
    def barotropic(self) -> bool:
        """Whether there is one depth only."""
        return np.size(self.shares) == 1

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        x, y, z, t = jnp.broadcast_arrays(*(jnp.asarray(axis) for axis in (x, y, z, t)))
        angle = t[..., None] * self.rate
        cosine, sine = jnp.cos(angle), jnp.sin(angle)
        share = jnp.interp(z, self.depths, self.shares)
        count = self.mean.shape[-1]
        weights = [
            1.0 / ((x - self.places[p, 0]) ** 2 + (y - self.places[p, 1]) ** 2 + 1.0) for p in range(count)
        ]
        total = sum(weights)

        def component(axis: int) -> jax.Array:
            there = [
                self.mean[axis, p]
                + (cosine * self.in_phase[axis, p] + sine * self.quadrature[axis, p]).sum(axis=-1)
                for p in range(count)
            ]
            if count == 1:
                return share * there[0]
            return share * sum(w * value for w, value in zip(weights, there, strict=True)) / total

        u, v, w = self.uniform
        return component(0) + u, component(1) + v, jnp.zeros_like(share) + w

    @property
    def fastest(self) -> float:
        """m/s, no speed is greater."""
        most = np.hypot(np.asarray(self.in_phase), np.asarray(self.quadrature)).sum(axis=-1)
        level = (most + np.abs(np.asarray(self.mean))) * np.abs(np.asarray(self.shares)).max()
        return float((np.hypot(*level) + np.linalg.norm(np.asarray(self.uniform))).max())

    def deviation(self, places: Sequence[Any], edges: Sequence[Any]) -> np.ndarray | None:
        """Bound the departure from means within boxes, see `auvplan.ocean.deviation`.

        Known where there is one place: share(z) times a sum of cosines of t.
        """
        if np.shape(self.mean)[-1] > 1:
            return None
        z, t = (np.asarray(part, float) for part in places[2:])
        dz, dt = (np.asarray(edge, float) for edge in edges[2:])
        rate, mean = np.asarray(self.rate, float), np.asarray(self.mean, float)[:, 0]
        swings = np.hypot(*(np.asarray(part, float)[:, 0] for part in (self.in_phase, self.quadrature)))
        most, slope, bend = (np.linalg.norm((swings * rate**k).sum(axis=1)) for k in range(3))
        shares, depths = (
            np.atleast_1d(np.asarray(self.shares, float)),
            np.atleast_1d(np.asarray(self.depths, float)),
        )
        of_share = interpolation_deviation([shares], [depths], (z,), (dz,))
        steep = float(np.abs(np.diff(shares) / np.diff(depths)).max(initial=0.0))
        total = float(most + np.linalg.norm(mean)) * of_share
        return total + np.abs(shares).max() * 0.125 * bend * dt**2 + 0.25 * steep * slope * dz * dt + 0.0 * t

    def window(self, first: float, last: float) -> Self:
        """Return the same: it holds at all times."""
        return self

    def after(self, seconds: float) -> Self:
        """Return the same for an epoch that is later by `seconds`."""
        angle = np.asarray(self.rate, float) * seconds
        cosine, sine = np.cos(angle), np.sin(angle)
        first, second = np.asarray(self.in_phase, float), np.asarray(self.quadrature, float)
        turned = first * cosine + second * sine, second * cosine - first * sine
        dtype = np.asarray(self.in_phase).dtype
        return replace(self, in_phase=turned[0].astype(dtype), quadrature=turned[1].astype(dtype))
