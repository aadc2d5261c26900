"""Currents that drawn seas are made of, and which of several forecasts fits what was measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from auvplan.ocean.currents import Current, Velocity, evaluated
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve, forecast_of
from auvplan.runtime.compiled import compiled

#: Waves that a random field is made of.
_WAVES = 32

#: m/s, by which a forecast is taken to err at least, and a measured current.
_ERRS, _MEASURES = 0.05, 0.02


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


def member_weights(
    members: Sequence[Current],
    measured: ArrayLike,
    positions: ArrayLike,
    times: ArrayLike,
    error: float,
    length: float,
    duration: float,
) -> NDArray[np.floating]:
    """Return how probable each of several forecasts is after currents were measured; all were alike before.

    What was measured is a member and an error as of `random_fields`, of 0.05 m/s at least; measuring itself
    errs by 0.02 m/s. What was measured where a member is not known does
    not count.

    Args:
        members: M forecasts.
        measured: [n, 2] m/s north and east.
        positions: [n, 3] m, where.
        times: [n] s, when.
        error: m/s, root mean square by which each component errs.
        length: m, over which that is much the same.
        duration: s, the same in time.

    Returns:
        [M], of sum 1.
    """
    places, moments = np.asarray(positions, float), np.asarray(times, float)
    x, y, z = places.T
    found = (np.stack(evaluated(member, x, y, z, moments)[:2], axis=1) for member in members)
    off = np.asarray(measured, float) - np.stack(list(found))
    known = np.isfinite(off).all(axis=(0, 2))
    off, places, moments = off[:, known], places[known, :2], moments[known]
    apart = np.linalg.norm(places[:, None] - places, axis=-1) / length
    later = (moments[:, None] - moments) / duration
    covariance = max(error, _ERRS) ** 2 * np.exp(-0.5 * (apart**2 + later**2))
    factor = cho_factor(covariance + _MEASURES**2 * np.eye(len(moments)))
    misfit = np.asarray([0.5 * float((one * cho_solve(factor, one)).sum()) for one in off])
    return np.exp(-misfit - logsumexp(-misfit))


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
