"""The true current of one mission, and what a planner is told of it."""

from dataclasses import replace
from functools import partial

import jax

from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve


class Sea:
    """A current that changes at every update (Eq. 2); its arrays lie on the host.

    It draws from its own key by its own counts, so that no mission depends on those beside it.

    Attributes:
        field: the true current now, in NumPy.
    """

    def __init__(self, key: jax.Array, field: LambVortices, update: CurrentUpdate, interval: float):
        """Start with a field that changes every `interval` s."""
        self.field: LambVortices = jax.device_get(field)
        self._change_key, self._telling_key = jax.random.split(key, 2)
        self._update = update
        self._interval = interval
        self._updates = 0
        self._tellings = 0

    def advance(self, now: float) -> None:
        """Apply all updates due at `now`, s."""
        while now >= (self._updates + 1) * self._interval:
            self.field = jax.device_get(_changed(self._change_key, self._updates, self.field, self._update))
            self._updates += 1

    def told(self, error: float) -> LambVortices:
        """The field as a planner is told it, in error by a relative `error`, anew at every telling."""
        self._tellings += 1
        return jax.device_get(_told(self._telling_key, self._tellings, self.field, error))


@partial(jax.jit, static_argnames="update")
def _changed(key: jax.Array, count: int, field: LambVortices, update: CurrentUpdate) -> LambVortices:
    return evolve(jax.random.fold_in(key, count), field, update)


@jax.jit
def _told(key: jax.Array, count: int, field: LambVortices, error: float) -> LambVortices:
    noise = error * jax.random.normal(jax.random.fold_in(key, count), (field.strength.shape[-1], 3))
    return replace(
        field,
        centers=field.centers + noise[:, :2] * field.radius[..., None],
        strength=field.strength * (1.0 + noise[:, 2]),
    )
