"""Ocean currents as pure functions of position and time (Eqs 1-2).

A current is any pytree callable ``current(x, y, z, t) -> (u, v, w)``: arrays broadcast elementwise, metres
and seconds in, m/s north, east and down out. An attribute ``steady`` that is True says that t does not
matter, which spares planners the sailing of segments one after the other.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, runtime_checkable

import chex
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

Velocity = tuple[jax.Array, jax.Array, jax.Array]

#: Peak of (1 - exp(-s^2)) / s over s, reached at s = 1.1209: where a Lamb-Oseen vortex turns fastest.
_LAMB_PEAK = 0.63817


@runtime_checkable
class Current(Protocol):
    """Velocity of the water, m/s north, east, down, at position [m] and time [s]."""

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity: ...


@partial(jax.tree_util.register_dataclass, data_fields=(), meta_fields=("function", "steady"))
@dataclass(frozen=True)
class FunctionCurrent:
    """A plain Python function as a current; compiled code is reused for the same function object."""

    function: Callable[..., Any]
    steady: bool = False

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z), jnp.shape(t))
        dtype = jnp.result_type(x)
        u, v, w = self.function(x, y, z, t)
        return (
            jnp.broadcast_to(jnp.asarray(u, dtype), shape),
            jnp.broadcast_to(jnp.asarray(v, dtype), shape),
            jnp.broadcast_to(jnp.asarray(w, dtype), shape),
        )


@partial(jax.tree_util.register_dataclass, data_fields=("u", "v", "w"), meta_fields=())
@dataclass(frozen=True)
class UniformCurrent:
    """The same velocity everywhere and always, m/s north, east, down."""

    u: ArrayLike = 0.0
    v: ArrayLike = 0.0
    w: ArrayLike = 0.0
    steady = True

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        zero = jnp.zeros(jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z)), jnp.result_type(x))
        return zero + self.u, zero + self.v, zero + self.w


def as_current(current: object) -> Current:
    """Accept a current, or a plain function of the same signature, or None for still water.

    Raises:
        TypeError: `current` cannot be called.
    """
    if current is None:
        return UniformCurrent()
    leaves = jax.tree.leaves(current)
    if len(leaves) == 1 and leaves[0] is current:
        if not callable(current):
            raise TypeError(
                f"current must be callable as (x, y, z, t) -> (u, v, w), got {type(current).__name__}"
            )
        return FunctionCurrent(current)
    return current  # type: ignore[return-value]


def is_steady(current: Current) -> bool:
    """Whether the current is known not to depend on time."""
    return bool(getattr(current, "steady", False))


@partial(
    jax.tree_util.register_dataclass,
    data_fields=("centers", "strength", "radius", "depths", "vertical_scale", "uniform"),
    meta_fields=(),
)
@dataclass(frozen=True)
class LambVortices:
    """Layers of Lamb-Oseen vortices, their fields added up and interpolated linearly in depth (Eq. 1).

    With r^2 = (x - x0)^2 + (y - y0)^2 a vortex of strength G and radius l has

        u = -G (y - y0) / (2 pi r^2) (1 - exp(-r^2 / l^2))
        v = +G (x - x0) / (2 pi r^2) (1 - exp(-r^2 / l^2))
        w = gamma G / (2 pi l^2) exp(-r^2 / (2 l^2))

    Above the first and below the last layer the nearest layer holds.

    Attributes:
        centers: [L, K, 2] m, north and east.
        strength: G, [L, K] m^2/s; zero pads.
        radius: l, [L, K] m, positive.
        depths: [L] m, rising.
        vertical_scale: gamma, m; scales the vertical component.
        uniform: [3] m/s north, east, down, added everywhere.

    Differences from the paper:
        As printed, the exponential is not multiplied by (y - y0) and the field is singular at the centre; the
        covariance of w is read as l^2 I.
    """

    centers: jax.Array
    strength: jax.Array
    radius: jax.Array
    depths: jax.Array | None = None
    vertical_scale: ArrayLike = 0.0
    uniform: ArrayLike = (0.0, 0.0, 0.0)  # type: ignore[assignment]
    steady = True

    def __post_init__(self) -> None:
        # JAX rebuilds pytrees with placeholders in place of arrays: only real arrays are completed.
        if isinstance(self.centers, (np.ndarray, list, tuple)) or (
            isinstance(self.centers, jax.Array) and (self.depths is None or isinstance(self.uniform, tuple))
        ):
            object.__setattr__(self, "centers", jnp.asarray(self.centers, float))
            object.__setattr__(self, "strength", jnp.asarray(self.strength, float))
            object.__setattr__(self, "radius", jnp.asarray(self.radius, float))
            layers = self.centers.shape[0]
            depths = (
                jnp.arange(layers, dtype=float) if self.depths is None else jnp.asarray(self.depths, float)
            )
            object.__setattr__(self, "depths", depths)
            object.__setattr__(self, "uniform", jnp.asarray(self.uniform, float))
            chex.assert_rank([self.centers, self.strength, self.radius], [3, 2, 2])
            chex.assert_shape([self.strength, self.radius], self.centers.shape[:2])
            chex.assert_shape(self.centers, (*self.strength.shape, 2))
            chex.assert_shape(depths, (layers,))

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z))
        # One long row of points makes longer vector loops than a plane of short ones.
        x, y, z = (jnp.broadcast_to(axis, shape).reshape(-1) for axis in (x, y, z))
        still = jnp.zeros(x.shape, jnp.result_type(x))
        north, east, down = (still + self.uniform[axis] for axis in range(3))  # type: ignore[index]
        total = (north, east, down)
        gamma = jnp.asarray(self.vertical_scale)

        # One small loop body whatever the number of vortices: quick to compile, and the planes stay in cache.
        # Gradients recompute it, which beats storing what every vortex would need.
        @jax.checkpoint
        def part(x: jax.Array, y: jax.Array, vortex: tuple[jax.Array, ...]) -> Velocity:
            center_x, center_y, strength, radius = vortex
            return _vortex(x - center_x, y - center_y, strength, radius, gamma)

        def add(total: Velocity, vortex: tuple[jax.Array, ...]) -> tuple[Velocity, None]:
            return jax.tree.map(jnp.add, total, part(x, y, vortex)), None

        for layer, weight in enumerate(self._layer_weights(z)):
            vortices = (
                self.centers[layer, :, 0],
                self.centers[layer, :, 1],
                self.strength[layer],
                self.radius[layer],
            )
            found, _ = jax.lax.scan(add, (still, still, still), vortices)
            total = jax.tree.map(lambda sum_, one, weight=weight: sum_ + weight * one, total, found)
        return tuple(component.reshape(shape) for component in total)  # type: ignore[return-value]

    def _layer_weights(self, z: jax.Array) -> list[ArrayLike]:
        """Linear interpolation weights of the layers at depth z; they sum to one."""
        assert self.depths is not None
        layers = self.strength.shape[0]
        if layers == 1:
            return [1.0]
        below = [
            jnp.clip((z - self.depths[k]) / (self.depths[k + 1] - self.depths[k]), 0.0, 1.0)
            for k in range(layers - 1)
        ]
        return [1.0 - below[0], *(below[k - 1] - below[k] for k in range(1, layers - 1)), below[-1]]

    def scaled(self, factor: ArrayLike) -> "LambVortices":
        """The same vortices, `factor` times as strong."""
        return replace(self, strength=self.strength * factor)


def _vortex(
    dx: jax.Array, dy: jax.Array, strength: jax.Array, radius: jax.Array, gamma: ArrayLike
) -> Velocity:
    """One vortex of Eq. 1 at offset (dx, dy) from its centre; smooth everywhere."""
    inverse = 1.0 / (radius * radius)
    q = (dx * dx + dy * dy) * inverse
    half = jnp.exp(-0.5 * q)  # serves both exponentials: exp(-q) = half^2
    near = q < 0.02
    series = 1.0 - q * (1 / 2 - q * (1 / 6 - q * (1 / 24 - q * (1 / 120 - q / 720))))
    profile = jnp.where(near, series, (1.0 - half * half) / jnp.where(near, 1.0, q))
    scale = strength * inverse / (2.0 * jnp.pi)
    turn = scale * profile
    return -turn * dy, turn * dx, (scale * gamma) * half


def strength_for_peak_speed(speed: ArrayLike, radius: ArrayLike) -> jax.Array:
    """Strength G [m^2/s] of a vortex of radius l [m] whose fastest water moves at `speed` [m/s]."""
    return jnp.asarray(speed) * 2.0 * jnp.pi * jnp.asarray(radius) / _LAMB_PEAK


def random_vortices(
    key: jax.Array,
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    count: int = 12,
    layers: int = 1,
    radius: tuple[float, float] = (150.0, 500.0),
    peak_speed: float = 1.25,
    layer_noise: float = 0.1,
    vertical_scale: float = 0.0,
) -> LambVortices:
    """A random layered field whose fastest water moves at `peak_speed`.

    Each layer is a gentle perturbation of the one above. The whole field is scaled so that the largest speed
    on a 64 x 64 grid of the first layer is `peak_speed`.

    Args:
        key: PRNG key, consumed.
        lower: (x, y, z) m, lower corner.
        upper: (x, y, z) m, upper corner; layers spread evenly from lower z to upper z.
        count: vortices a layer K.
        layers: depth layers L.
        radius: range of l, m.
        peak_speed: m/s.
        layer_noise: relative change from one layer to the next.
        vertical_scale: gamma, m.
    """
    low, high = jnp.asarray(lower, float), jnp.asarray(upper, float)
    center_key, radius_key, speed_key, sign_key, layer_key = jax.random.split(key, 5)
    first = jax.random.uniform(center_key, (count, 2), minval=low[:2], maxval=high[:2])
    size = jax.random.uniform(radius_key, (count,), minval=radius[0], maxval=radius[1])
    speed = jax.random.uniform(speed_key, (count,), minval=0.5, maxval=1.0)
    sign = jax.random.rademacher(sign_key, (count,), float)
    strength = sign * strength_for_peak_speed(speed, size)

    noise = jnp.cumsum(jax.random.normal(layer_key, (layers, count, 4)).at[0].set(0.0), axis=0) * layer_noise
    centers = first + noise[..., :2] * size[:, None]
    radii = size * jnp.exp(noise[..., 2])
    strengths = strength * (1.0 + noise[..., 3])
    depths = jnp.linspace(low[2], high[2], layers) if layers > 1 else low[2:3]
    field = LambVortices(centers, strengths, radii, depths, vertical_scale)

    axes = [jnp.linspace(low[i], high[i], 64) for i in range(2)]
    x, y = jnp.meshgrid(*axes, indexing="ij")
    u, v, _ = field(x, y, jnp.full_like(x, low[2]), jnp.zeros_like(x))
    return field.scaled(peak_speed / jnp.sqrt(jnp.max(u * u + v * v)))


@dataclass(frozen=True)
class CurrentUpdate:
    """How the vortices change from one update to the next (Eq. 2).

    Attributes:
        rate: U_R^C, scales all steps; 0 freezes the field.
        center_std: sigma_S, m.
        radius_std: sigma_l, m.
        strength_std: sigma_G as a share of each vortex's strength.
        radius_floor: least l, m.
    """

    rate: float = 1.0
    center_std: float = 50.0
    radius_std: float = 20.0
    strength_std: float = 0.05
    radius_floor: float = 50.0


def evolve(key: jax.Array, vortices: LambVortices, update: CurrentUpdate) -> LambVortices:
    """One update of the field: centre, radius and strength take Gaussian steps (Eq. 2).

    The layers of a vortex move together, so that the circulation still changes gently with depth.

    Args:
        key: PRNG key, consumed.
        vortices: the field before.
        update: sizes of the steps.
    """
    count = vortices.strength.shape[-1]
    step = update.rate * jax.random.normal(key, (count, 4))
    return replace(
        vortices,
        centers=vortices.centers + update.center_std * step[:, :2],
        strength=vortices.strength * (1.0 + update.strength_std * step[:, 3]),
        radius=jnp.maximum(vortices.radius + update.radius_std * step[:, 2], update.radius_floor),
    )
