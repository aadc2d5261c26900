"""Currents that drawn seas are made of, and what currents that were measured say of forecasts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from auvplan.ocean.currents import Current, SumCurrent, Velocity, evaluated
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve, forecast_of
from auvplan.runtime.compiled import compiled

#: Waves that a random field is made of.
_WAVES = 32

#: m/s, by which a forecast is taken to err at least, and a measured current.
_ERRS, _MEASURES = 0.1, 0.02

#: s between measured currents that count, and how many of them do beside the last.
_OFTEN, _KEPT = 60.0, 200


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class RandomField:
    """A smooth random velocity without divergence, level and the same at all depths: a sum of K plane waves.

    Attributes:
        north, east: [K] rad/m, wave numbers.
        rate: [K] rad/s.
        phase: [K] rad.
        speed: m/s, of each wave, across its direction.
    """

    north: jax.Array
    east: jax.Array
    rate: jax.Array
    phase: jax.Array
    speed: jax.Array
    gradual = True
    barotropic = True

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        x, y, t = jnp.broadcast_arrays(x, y, t)
        size = jnp.sqrt(self.north**2 + self.east**2)
        along = x[..., None] * self.north + y[..., None] * self.east + t[..., None] * self.rate + self.phase
        waves = self.speed * jnp.cos(along) / size
        u, v = -(waves * self.east).sum(axis=-1), (waves * self.north).sum(axis=-1)
        return u, v, jnp.zeros_like(u)


def random_fields(key: jax.Array, count: int, error: float, length: float, duration: float) -> RandomField:
    """Draw errors of a forecast: leaves have a leading axis of `count`.

    A component has the root mean square `error`. Wave numbers and rates are normal, so that velocities r
    metres apart have the mean product exp(-r^2 / (2 length^2)), in shares of their mean square, and those s
    seconds apart exp(-s^2 / (2 duration^2)).

    Args:
        key: PRNG key, consumed.
        count: of fields.
        error: m/s.
        length: m.
        duration: s.
    """
    return _random_fields(key, error, length, duration, count=count)


@partial(compiled, static_argnames=("count",), quick=True)
def _random_fields(key: jax.Array, error: Any, length: Any, duration: Any, count: int) -> RandomField:
    waves, phases = jax.random.split(key)
    north, east, rate = jnp.moveaxis(jax.random.normal(waves, (count, _WAVES, 3)), -1, 0)
    phase = jax.random.uniform(phases, (count, _WAVES), maxval=2.0 * jnp.pi)
    # A wave's mean square is half of its speed's, and half of that is each component's.
    speed = jnp.full((count, 1), 2.0 * error / jnp.sqrt(float(_WAVES)))
    return RandomField(north / length, east / length, rate / duration, phase, speed)


class Measured(NamedTuple):
    """Currents that were measured: [n, 2] m/s north and east at [n, 3] m and [n] s."""

    velocities: NDArray[Any]
    positions: NDArray[Any]
    times: NDArray[Any]

    @classmethod
    def none(cls) -> "Measured":
        """Nothing."""
        return cls(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))

    def added(self, velocity: ArrayLike, position: ArrayLike, time: float) -> "Measured":
        """Return these and one more [2] m/s at [3] m and s: one a minute, and 200 beside the last."""
        end = len(self.times) - bool(len(self.times) > 1 and self.times[-1] - self.times[-2] < _OFTEN)
        parts = zip(self, (velocity, position, time), strict=True)
        return Measured(*(np.concatenate([part[:end][-_KEPT:], np.asarray([one])]) for part, one in parts))

    def off(self, forecast: Current) -> NDArray[np.floating]:
        """[n, 2] m/s, less a forecast."""
        x, y, z = self.positions.T
        return self.velocities - np.stack(evaluated(forecast, x, y, z, self.times)[:2], axis=1)


class ErrorScale(NamedTuple):
    """How a forecast errs, as `random_fields`: by m/s in each component, much the same over m and s."""

    error: float
    length: float
    duration: float

    def factor(self, measured: Measured) -> Any:
        """Return the covariance [n, n] of errors that were measured, as `cho_solve` takes it."""
        apart = [_alike(axis, axis, self.length) for axis in measured.positions.T[:2]]
        alike = apart[0] * apart[1] * _alike(measured.times, measured.times, self.duration)
        return cho_factor(self.variance * alike + _MEASURES**2 * np.eye(len(alike)))

    @property
    def variance(self) -> float:
        """(m/s)^2, of each component."""
        return max(self.error, _ERRS) ** 2


def _alike(some: ArrayLike, others: ArrayLike, scale: float) -> NDArray[np.floating]:
    """Return the share [a, b] in which errors are alike, of such as lie apart along one axis alone."""
    return np.exp(-0.5 * (np.subtract.outer(some, others) / scale) ** 2)


def member_weights(members: Sequence[Current], measured: Measured, scale: ErrorScale) -> NDArray[np.floating]:
    """Return how probable each of M forecasts is, [M] of sum 1, after currents were measured.

    All were alike before. What is measured is a member, an error of that scale, of 0.1 m/s at least, and that
    of measuring, 0.02 m/s. What was measured where a member is not known does not count.
    """
    off = np.stack([measured.off(member) for member in members])
    known = np.isfinite(off).all(axis=(0, 2))
    factor = scale.factor(Measured(*(part[known] for part in measured)))
    misfit = np.asarray([0.5 * float((one * cho_solve(factor, one)).sum()) for one in off[:, known]])
    return np.exp(-misfit - logsumexp(-misfit))


def corrected(
    forecast: GriddedCurrent, off: ArrayLike, measured: Measured, scale: ErrorScale
) -> GriddedCurrent:
    """Return a forecast and its most probable error, given what was measured.

    Where and when nothing was measured near, by the error's length and duration or two cells of the grid, it
    stays as it is. The error is the same at all depths; of a steady forecast it is that of the last moment.

    Args:
        forecast: on a grid.
        off: [n, 2] m/s, of what was measured, less the forecast.
        measured: where and when.
        scale: of the error.
    """
    cell, step = np.asarray(forecast.spacing, float), np.diff(np.asarray(forecast.times, float))
    scale = ErrorScale(
        scale.error, max(scale.length, 2.0 * cell.max()), max(scale.duration, 2.0 * step.max(initial=0.0))
    )
    corner, counts = np.asarray(forecast.origin, float), forecast.u.shape[-2:]
    times = measured.times[-1:] if forecast.steady else np.asarray(forecast.times, float)
    alike = [
        _alike(times, measured.times, scale.duration),
        *(
            _alike(corner[k] + cell[k] * np.arange(counts[k]), measured.positions[:, k], scale.length)
            for k in range(2)
        ),
    ]
    shares = scale.variance * cho_solve(scale.factor(measured), np.asarray(off, float))
    error = np.einsum("tn,xn,yn,nc->ctxy", *alike, shares, optimize=True)[:, :, None].astype(np.float32)
    return replace(forecast, u=forecast.u + error[0], v=forecast.v + error[1])


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class SteppedCurrent:
    """A current that changes at even moments, and not between them.

    Attributes:
        fields: whose leaves have a leading axis, one after the other; the first and the last hold on.
        interval: s between changes.
        begins: s, when the first takes effect.
    """

    fields: Current
    interval: jax.Array
    begins: jax.Array

    def __call__(self, x: jax.Array, y: jax.Array, z: jax.Array, t: jax.Array) -> Velocity:
        """Return u, v, w [m/s] at places [m] and times [s], elementwise."""
        shape = jnp.broadcast_shapes(*map(jnp.shape, (x, y, z, t)))
        places = [jnp.broadcast_to(axis, shape).reshape(-1) for axis in (x, y, z, t)]
        count = jax.tree.leaves(self.fields)[0].shape[0]
        steps = jnp.clip(jnp.floor((places[3] - self.begins) / self.interval), 0, count - 1).astype(int)

        def met(step: jax.Array, *place: jax.Array) -> Velocity:
            return jax.tree.map(lambda leaf: leaf[step], self.fields)(*place)

        u, v, w = jax.vmap(met)(steps, *places)
        return u.reshape(shape), v.reshape(shape), w.reshape(shape)


@partial(compiled, static_argnames=("update", "steps", "count"), quick=True)
def changing_vortices(
    key: jax.Array,
    field: LambVortices,
    error: jax.Array,
    when: tuple[jax.Array, jax.Array],
    update: CurrentUpdate,
    steps: int,
    count: int,
) -> SteppedCurrent:
    """Draw fields that change by Eq. 2, from such as a forecast with an error may stand for.

    Args:
        key: PRNG key, consumed.
        field: the forecast.
        error: of it, see `forecast_of`.
        when: s between changes, and when the first field takes effect.
        update: sizes of the changes.
        steps: changes of each.
        count: of the fields that are drawn.

    Returns:
        Currents, whose leaves have a leading axis of `count`.
    """

    def one(key: jax.Array) -> SteppedCurrent:
        first = forecast_of(jax.random.fold_in(key, 0), field, error)

        def change(field: LambVortices, key: jax.Array) -> tuple[LambVortices, LambVortices]:
            changed = evolve(key, field, update)
            return changed, changed

        later = jax.lax.scan(change, first, jax.random.split(jax.random.fold_in(key, 1), steps))[1]
        fields = jax.tree.map(lambda one, more: jnp.concatenate([one[None], more]), first, later)
        return SteppedCurrent(fields, *when)

    return jax.vmap(one)(jax.random.split(key, count))


def perturbed(current: Current, factor: float = 1.0, offset: ArrayLike = (0.0, 0.0, 0.0)) -> Current:
    """Return a current `factor` times as strong, and a uniform one added to it.

    It is of the same kind, so that nothing is compiled again.

    Args:
        current: of vortices, a grid or tidal constituents, or a sum, whose shared part gets the offset.
        factor: of all its velocities.
        offset: [3] m/s north, east, down; a grid without a vertical component gets none.

    Raises:
        TypeError: the current is of another kind.
    """
    step = np.asarray(offset, float)

    def scaled(values: Any, along: Any = 0.0) -> Any:
        return (values * factor + along).astype(values.dtype)

    if isinstance(current, SumCurrent):
        own = None if current.own is None else perturbed(current.own, factor)
        return replace(current, shared=perturbed(current.shared, factor, step), own=own)
    if isinstance(current, LambVortices):
        uniform = scaled(np.asarray(current.uniform), step)
        return replace(current, strength=scaled(current.strength), uniform=uniform)
    if isinstance(current, GriddedCurrent):
        w = None if current.w is None else scaled(current.w, step[2])
        return replace(current, u=scaled(current.u, step[0]), v=scaled(current.v, step[1]), w=w)
    if isinstance(current, HarmonicCurrent):
        parts = {name: scaled(getattr(current, name)) for name in ("in_phase", "quadrature", "mean")}
        return replace(current, **parts, uniform=scaled(np.asarray(current.uniform), step))
    raise TypeError(f"a current of the kind {type(current).__name__} cannot be perturbed")
