"""Layers of Lamb-Oseen vortices, random fields of them, and how they change (Eqs 1-2)."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.currents import Velocity
from auvplan.ocean.raster import is_traced
from auvplan.runtime.arguments import check_settings, numbers
from auvplan.runtime.compiled import compiled
from auvplan.runtime.prng import as_key
from auvplan.runtime.pytree import instantiated, is_symbolic_zero, register_without_init

#: Peak of (1 - exp(-s^2)) / s over s, reached at s = 1.1209: where a Lamb-Oseen vortex turns fastest.
_LAMB_PEAK = 0.63817

#: Vortices added up in one go of the loop: fewer, longer steps; more only makes compilation longer. Their
#: number is padded to a multiple of it, so that one program serves several.
_UNROLL = 4


@register_without_init
@dataclass(frozen=True, eq=False)
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

    Raises:
        TypeError, ValueError: a field is no numbers, of another shape or out of range; one line names it.

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
        for name in ("centers", "strength", "radius", "depths", "uniform"):
            value = getattr(self, name)
            if name == "depths" and value is None:
                value = np.arange(len(self.strength))
            if not is_traced(value):
                numbers(name, value)
            object.__setattr__(self, name, jnp.asarray(value, float))
        of = (*self.centers.shape, 0, 0)[:2]
        wanted = {"centers": (*of, 2), "strength": of, "radius": of, "depths": of[:1], "uniform": (3,)}
        for name, shape in wanted.items():
            if (found := getattr(self, name).shape) != shape:
                raise ValueError(f"{name} must be of shape {shape}, with centers [L, K, 2], got {found}")
        if not is_traced(self.radius) and not (np.asarray(self.radius) > 0.0).all():
            raise ValueError("radius must be positive, m")
        if not is_traced(self.depths) and not (np.diff(np.asarray(self.depths)) > 0.0).all():
            raise ValueError("depths must rise, m")

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(y), jnp.shape(z))
        # One long row of points makes longer vector loops than a plane of short ones.
        x, y, z = (jnp.broadcast_to(axis, shape).reshape(-1) for axis in (x, y, z))
        return tuple(component.reshape(shape) for component in _compiled_velocity(self, x, y, z))  # type: ignore[return-value]

    def deviation(self, places: Sequence[Any], edges: Sequence[Any]) -> NDArray[np.floating]:
        """Bound the departure from means within boxes, see `auvplan.ocean.deviation`.

        By Taylor's formula a smooth field departs from means by half its second derivative times the mean
        square of the distances from the mean place, at most a quarter of the square of the box's diagonal.
        """
        x, y, z, _ = (np.asarray(part, float) for part in places)
        dx, dy, dz, _ = (np.asarray(edge, float) for edge in edges)
        radius = 0.5 * np.hypot(dx, dy)
        depths = np.asarray(self.depths, float)
        bends, slopes, speeds = [], [], []
        for centers, strengths, sizes in zip(self.centers, self.strength, self.radius, strict=True):
            bend, slope, speed = (np.zeros(x.shape) for _ in range(3))
            for (north, east), strength, size in zip(
                *map(np.asarray, (centers, strengths, sizes)), strict=True
            ):
                if strength == 0.0:
                    continue
                turn = abs(float(strength)) / (2.0 * np.pi * float(size) ** 2)
                away = np.maximum(np.hypot(x - north, y - east) - radius, 0.0) / float(size)
                level = [np.interp(away, _AWAY, row) for row in _ENVELOPES]
                vertical = abs(float(self.vertical_scale)) * turn  # type: ignore[arg-type]
                bend += (turn * level[2] + vertical / float(size)) / float(size)
                slope += turn * level[1] + vertical / float(size)
                speed += turn * float(size) * level[0] + vertical
            bends.append(bend)
            slopes.append(slope)
            speeds.append(speed)
        found = 0.125 * (dx**2 + dy**2) * np.maximum.reduce(bends)
        if len(bends) > 1:
            gap = float(np.diff(depths).min())
            found = found + 0.5 * radius * dz * 2.0 * np.maximum.reduce(slopes) / gap
            inside = (
                (
                    (depths[:, None] > (z - 0.5 * dz + 1e-6 * gap).ravel())
                    & (depths[:, None] < (z + 0.5 * dz - 1e-6 * gap).ravel())
                )
                .sum(axis=0)
                .reshape(z.shape)
            )
            found = found + 0.25 * inside * dz * 4.0 * np.maximum.reduce(speeds) / gap
        return found

    def padded(self, capacity: int) -> "LambVortices":
        """Return the same field padded to `capacity` vortices in each layer by ones of no strength.

        Fields share one shape so; leaves may have leading axes.

        Raises:
            ValueError: there are more vortices in a layer than `capacity`.
        """
        count = self.strength.shape[-1]
        if count > capacity:
            raise ValueError(f"{count} vortices exceed the capacity of {capacity}")
        (centers, strength, radius, *others), tree = jax.tree.flatten(self)
        more = [(0, 0)] * (np.ndim(strength) - 1) + [(0, capacity - count)]
        centers = np.pad(np.asarray(centers), [*more, (0, 0)])
        strength = np.pad(np.asarray(strength), more)
        radius = np.pad(np.asarray(radius), more, constant_values=1.0)
        return tree.unflatten([centers, strength, radius, *others])

    def first(self, count: int) -> "LambVortices":
        """Return the first vortices of each layer; leaves may have leading axes."""
        return replace(
            self,
            centers=self.centers[..., :count, :],
            strength=self.strength[..., :count],
            radius=self.radius[..., :count],
        )

    def scaled(self, factor: ArrayLike) -> "LambVortices":
        """Return the same vortices, `factor` times as strong."""
        return replace(self, strength=self.strength * factor)


def _envelopes() -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Distances from a vortex's centre, and its greatest speed, slope and second derivative there or farther.

    In units of its radius and of the turn of its core.
    The velocity is p(r) times the radius vector, turned. So its slope is at most |p| + r |p'| and its
    second derivative at most 2 |p'| + max(r |p''|, |p'|).
    """
    r = np.r_[np.linspace(1e-3, 6.0, 3000), np.geomspace(6.01, 1e5, 1500)]
    core = np.exp(-r * r)
    p = (1.0 - core) / r**2
    first = 2.0 * (core - p) / r
    second = -4.0 * core - 2.0 * (core - p) / r**2 - 2.0 * first / r
    rows = r * p, p + r * np.abs(first), 2.0 * np.abs(first) + np.maximum(r * np.abs(second), np.abs(first))
    # Greatest from there on, and of the interval below: safe where it is looked up in between.
    greatest = np.stack([np.maximum.accumulate(row[::-1])[::-1] for row in rows])
    held = np.concatenate([greatest[:, :1], greatest[:, :-1]], axis=1)
    return r, 1.001 * held


_AWAY, _ENVELOPES = _envelopes()

#: Coefficients of 2^f on [-1/2, 1/2], lowest first, fitted at Chebyshev points to within 2e-7, relative.
_COEFFICIENTS = (1.0, 0.69314695, 0.24022122, 0.05550743, 0.00967546, 0.0013267)


@jax.custom_jvp
def exponential(x: jax.Array) -> jax.Array:
    """exp(x) of numbers that are not positive.

    In single precision within 4e-7 of it, relative, and 1e-7 more for each unit of x; 1e-38 in place of
    anything less. That takes half the operations of the compiler's own, which also serves what never comes
    here. In double precision `jnp.exp`.
    """
    if x.dtype != jnp.float32:
        return jnp.exp(x)
    power = jnp.maximum(x * np.float32(1.0 / np.log(2.0)), -126.0)
    whole = jnp.round(power)
    rest, mantissa = power - whole, jnp.zeros_like(power)
    for coefficient in reversed(_COEFFICIENTS):
        mantissa = mantissa * rest + coefficient
    scale = jax.lax.bitcast_convert_type((whole.astype(jnp.int32) + 127) << 23, jnp.float32)
    return mantissa * scale


@exponential.defjvp
def _exponential_jvp(primals: tuple[jax.Array], tangents: tuple[jax.Array]) -> tuple[jax.Array, jax.Array]:
    value = exponential(primals[0])
    return value, value * tangents[0]


#: North and east of the centre, strength and radius of the K vortices of a layer, [K] each.
_Vortices = tuple[jax.Array, ...]


@jax.custom_jvp
def _layer(x: jax.Array, y: jax.Array, vortices: _Vortices, gamma: jax.Array) -> Velocity:
    """Velocity of the vortices of one layer, added up, at N points; x and y [N] m."""

    # Gradients recompute the loop's body, which beats storing what every vortex would need.
    @jax.checkpoint
    def add(total: Velocity, vortex: _Vortices) -> tuple[Velocity, None]:
        found = _Vortex.at(x, y, *vortex).velocity(gamma)
        return jax.tree.map(jnp.add, total, found), None

    still = jnp.zeros_like(x)
    return jax.lax.scan(add, (still, still, still), vortices, unroll=_UNROLL)[0]


@partial(_layer.defjvp, symbolic_zeros=True)
def _layer_jvp(primals: tuple, tangents: tuple) -> tuple[Velocity, Velocity]:
    """Compute velocity and slopes in one loop where the points alone move, without a backward one."""
    dx, dy, *others = tangents
    if not is_symbolic_zero(others):
        return jax.jvp(_layer.__wrapped__, primals, instantiated(tangents, primals))
    x, y, vortices, gamma = primals

    def add(total: tuple, vortex: _Vortices) -> tuple[tuple, None]:
        one = _Vortex.at(x, y, *vortex)
        return jax.tree.map(jnp.add, total, (*one.velocity(gamma), *one.slopes(gamma))), None

    still = jnp.zeros_like(x)
    sums, _ = jax.lax.scan(add, (still,) * 8, vortices, unroll=_UNROLL)
    u, v, w, shear, u_y, v_x, w_x, w_y = sums
    dx, dy = instantiated((dx, dy), (x, y))
    return (u, v, w), (u_y * dy - shear * dx, v_x * dx + shear * dy, w_x * dx + w_y * dy)


def _velocity(field: LambVortices, x: jax.Array, y: jax.Array, z: jax.Array) -> Velocity:
    """Velocity of all layers at N points; x, y and z [N] m."""
    gamma = jnp.asarray(field.vertical_scale, x.dtype)
    north, east, down = (jnp.full_like(x, field.uniform[axis]) for axis in range(3))  # type: ignore[index]
    total = north, east, down
    layers = field.centers[..., 0], field.centers[..., 1], field.strength, field.radius
    if len(field.strength) == 1:
        return jax.tree.map(jnp.add, total, _layer(x, y, tuple(part[0] for part in layers), gamma))

    def add(total: Velocity, layer: tuple[jax.Array, _Vortices]) -> tuple[Velocity, None]:
        weight, vortices = layer
        found = _layer(x, y, vortices, gamma)
        return jax.tree.map(lambda sum_, one: sum_ + weight * one, total, found), None

    assert field.depths is not None
    above, below = field.depths[:-1, None], field.depths[1:, None]
    share = jnp.clip((z - above) / (below - above), 0.0, 1.0)
    whole = jnp.ones_like(share[:1])
    weights = jnp.concatenate([whole, share]) - jnp.concatenate([share, jnp.zeros_like(whole)])
    # One loop in place of a copy for each layer: programs ask for the current in dozens of places.
    return jax.lax.scan(add, total, (weights, layers))[0]


#: Compiled, or every call outside a compiled program would compile its loops again.
_compiled_velocity = compiled(_velocity)


@dataclass(frozen=True)
class _Vortex:
    """One vortex of Eq. 1 seen from N points, smooth everywhere.

    Attributes:
        dx, dy: [N] m, from its centre.
        inverse: 1 / l^2.
        scale: G / (2 pi l^2), 1/s, how fast its core turns.
        q: [N], r^2 / l^2.
        half: [N], exp(-q / 2), which serves both exponentials.
        profile: [N], (1 - exp(-q)) / q.
    """

    dx: jax.Array
    dy: jax.Array
    inverse: jax.Array
    scale: jax.Array
    q: jax.Array
    half: jax.Array
    profile: jax.Array

    @classmethod
    def at(cls, x: jax.Array, y: jax.Array, *vortex: jax.Array) -> "_Vortex":
        center_x, center_y, strength, radius = vortex
        dx, dy, inverse = x - center_x, y - center_y, 1.0 / (radius * radius)
        # So near the centre the profile is one, within rounding of the speed.
        q = jnp.maximum((dx * dx + dy * dy) * inverse, jnp.finfo(x.dtype).eps ** 0.5)
        half = exponential(-0.5 * q)
        scale = strength * inverse / (2.0 * jnp.pi)
        return cls(dx, dy, inverse, scale, q, half, (1.0 - half * half) / q)

    def velocity(self, gamma: jax.Array) -> Velocity:
        turn = self.scale * self.profile
        return -turn * self.dy, turn * self.dx, (self.scale * gamma) * self.half

    def slopes(self, gamma: jax.Array) -> tuple[jax.Array, ...]:
        """dv/dy = -du/dx, du/dy, dv/dx, dw/dx and dw/dy, [N] 1/s each."""
        turn = self.scale * self.profile
        # The slope of the profile is (exp(-q) - profile) / q.
        bend = 2.0 * self.inverse * self.scale * (self.half * self.half - self.profile) / self.q
        sink = -self.inverse * self.scale * gamma * self.half
        return (
            bend * self.dx * self.dy,
            -turn - bend * self.dy * self.dy,
            turn + bend * self.dx * self.dx,
            sink * self.dx,
            sink * self.dy,
        )


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
    """Return a random layered field whose fastest water moves at `peak_speed`.

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

    Differences from the paper:
        It gives neither the number of vortices nor their sizes and strengths; all are chosen here.

    Raises:
        TypeError: the key is none, such as a seed, or a value is no number.
        ValueError: corners or the range of radii are the wrong way round, or a number is out of its range.
    """
    key = as_key(key)
    if count < 0 or layers < 1:
        raise ValueError(f"count must be at least 0 and layers at least 1, got {count} and {layers}")
    if not is_traced(lower, upper, radius, peak_speed):
        low, high = numbers("lower", lower), numbers("upper", upper)
        if low.shape != (3,) or high.shape != (3,) or not (low <= high).all() or (low >= high)[:2].any():
            raise ValueError(f"lower and upper must be (x, y, z) m with lower < upper, got {lower}, {upper}")
        if not 0.0 < radius[0] <= radius[1] < np.inf or not 0.0 <= peak_speed < np.inf:
            raise ValueError(f"radius and peak_speed must be positive and rise, got {radius}, {peak_speed}")
    corners = jnp.asarray(lower, float), jnp.asarray(upper, float)
    kind = _Kind(radius, peak_speed, layer_noise, vertical_scale)
    field = _random_vortices(key, *corners, kind, count, count=rounded_up(count), layers=layers)
    if field.strength.shape[-1] == count:
        return field
    return (field if isinstance(field.strength, Tracer) else jax.device_get(field)).first(count)


class _Kind(NamedTuple):
    """What random fields have in common, as in `random_vortices`."""

    radius: Any
    peak_speed: Any
    layer_noise: Any
    vertical_scale: Any


@partial(compiled, static_argnames=("count", "layers"), quick=True)
def _random_vortices(
    key: jax.Array,
    low: jax.Array,
    high: jax.Array,
    kind: _Kind,
    present: jax.Array,
    count: int,
    layers: int,
) -> LambVortices:
    """`random_vortices` of `count` places, of which the first `present` are taken."""
    center_key, radius_key, speed_key, sign_key, layer_key = jax.random.split(key, 5)
    first = jax.random.uniform(center_key, (count, 2), minval=low[:2], maxval=high[:2])
    size = jax.random.uniform(radius_key, (count,), minval=kind.radius[0], maxval=kind.radius[1])
    speed = jax.random.uniform(speed_key, (count,), minval=0.5, maxval=1.0)
    sign = jax.random.rademacher(sign_key, (count,), float)
    strength = sign * strength_for_peak_speed(speed, size) * (jnp.arange(count) < present)

    noise = jnp.cumsum(jax.random.normal(layer_key, (layers, count, 4)).at[0].set(0.0), axis=0)
    noise = noise * kind.layer_noise
    centers = first + noise[..., :2] * size[:, None]
    radii = size * jnp.exp(noise[..., 2])
    strengths = strength * (1.0 + noise[..., 3])
    depths = jnp.linspace(low[2], high[2], layers) if layers > 1 else low[2:3]
    field = LambVortices(centers, strengths, radii, depths, kind.vertical_scale)

    axes = [jnp.linspace(low[i], high[i], 64) for i in range(2)]
    x, y = jnp.meshgrid(*axes, indexing="ij")
    u, v, _ = field(x, y, jnp.full_like(x, low[2]), jnp.zeros_like(x))
    return field.scaled(kind.peak_speed / jnp.sqrt(jnp.max(u * u + v * v)))


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

    def __post_init__(self) -> None:
        check_settings(self, {part.name: (0, np.inf) for part in fields(self)})


def evolve(key: jax.Array, vortices: LambVortices, update: CurrentUpdate) -> LambVortices:
    """One update of the field: centre, radius and strength take Gaussian steps (Eq. 2).

    The layers of a vortex move together, so that the circulation still changes gently with depth.

    Args:
        key: PRNG key, consumed.
        vortices: the field before.
        update: sizes of the steps.

    Differences from the paper:
        It gives no standard deviations; those of `CurrentUpdate` are chosen here. The step of the strength is
        a share of it, and the radius keeps above a floor, under which a vortex would become a spike.
    """
    count = vortices.strength.shape[-1]
    step = update.rate * jax.random.normal(key, (count, 4))
    return replace(
        vortices,
        centers=vortices.centers + update.center_std * step[:, :2],
        strength=vortices.strength * (1.0 + update.strength_std * step[:, 3]),
        radius=jnp.maximum(vortices.radius + update.radius_std * step[:, 2], update.radius_floor),
    )


def forecast_of(key: jax.Array, vortices: LambVortices, error: ArrayLike) -> LambVortices:
    """Return a forecast of a field: centres off by shares of the radius, strengths by shares of themselves.

    Args:
        key: PRNG key, consumed.
        vortices: the true field.
        error: standard deviation of these shares.
    """
    noise = error * jax.random.normal(key, (vortices.strength.shape[-1], 3))
    return replace(
        vortices,
        centers=vortices.centers + noise[:, :2] * vortices.radius[..., None],
        strength=vortices.strength * (1.0 + noise[:, 2]),
    )


def padded(current: Any) -> Any:
    """A current, a pytree, whose vortices, if it has any, are padded to a number that many fields share."""

    def is_field(node: Any) -> bool:
        return isinstance(node, LambVortices)

    def longer(node: Any) -> Any:
        return node.padded(rounded_up(node.strength.shape[-1])) if is_field(node) else node

    return jax.tree.map(longer, current, is_leaf=is_field)


def rounded_up(count: int) -> int:
    """Return the number that `count` vortices or obstacles are padded to."""
    return -(-count // _UNROLL) * _UNROLL
