"""The true current of one mission, and its forecast."""

from collections.abc import Sequence
from functools import partial

import jax
import numpy as np

from auvplan.ocean.currents import Current, SumCurrent, combine, evaluated, partition
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve, forecast_of, padded
from auvplan.runtime import prng
from auvplan.runtime.compiled import compiled


class Sea:
    """A true current and its forecasts; as it stands, one to which nothing happens and that is foreseen.

    Attributes:
        field: the true current from now on.
    """

    def __init__(self, field: Current):
        """Start with a current."""
        self.field = field

    def advance(self, now: float) -> None:
        """Let time pass up to `now`, s."""

    def begin_window(self) -> None:
        """Take note that a window of a leg begins (3.2.2)."""

    def hold(self) -> None:
        """Change no more: plans know of nothing else."""

    def forecast(self) -> Current:
        """Return the current as planners know it now."""
        return self.field


class VortexSea(Sea):
    """Vortices that change at every update (Eq. 2); their arrays lie on the host.

    It draws from its own key by its own counts, so that no mission depends on those beside it.

    Attributes:
        field: the true current now, in NumPy.
    """

    def __init__(
        self,
        key: jax.Array,
        field: LambVortices,
        update: CurrentUpdate,
        interval: float | None,
        error: float = 0.0,
    ):
        """Start with a field that is forecast with a relative `error`.

        It changes every `interval` s, or, where that is None, at every window of a leg.
        """
        self.field: LambVortices = padded(jax.device_get(field))
        self._change_key, self._forecast_key = prng.parts(key, 2)
        self._update = update
        self._interval = interval
        self._error = error
        self.updates = 0
        self._forecasts = 0

    def advance(self, now: float) -> None:
        """Apply all updates due at `now`, s."""
        while self._interval is not None and now >= (self.updates + 1) * self._interval:
            self._change()

    def begin_window(self) -> None:
        """Apply an update where the field changes by windows."""
        if self._interval is None:
            self._change()

    def hold(self) -> None:
        """Change no more."""
        self._interval = None

    def _change(self) -> None:
        field = _changed(self._change_key, self.updates, self.field, update=self._update)
        self.field = jax.device_get(field)
        self.updates += 1

    def forecast(self) -> LambVortices:
        """Return the field as planners get it, with a new error at every call."""
        self._forecasts += 1
        return jax.device_get(_forecast_of(self._forecast_key, self._forecasts, self.field, self._error))


class ModelSea(Sea):
    """The currents of an ocean model's files, or of tides: truth, which all missions share, and forecast."""

    def __init__(self, truth: Current, forecast: Current, error: LambVortices | None = None):
        """Hold the `truth`; planners get `forecast` and this mission's `error` added to it."""
        self.field = SumCurrent(truth)
        self._forecast = SumCurrent(forecast, padded(jax.device_get(error)))

    def forecast(self) -> SumCurrent:
        """Return the forecast, the same all the time."""
        return self._forecast

    def difference(self, positions: np.ndarray, times: np.ndarray) -> float:
        """Root mean square of the forecast less the truth, m/s, at [n, 3] m and [n] s."""
        x, y, z = np.asarray(positions, float).T
        currents = self._forecast, self.field
        forecast, true = (np.stack(evaluated(current, x, y, z, times)) for current in currents)
        return float(np.sqrt(((forecast - true) ** 2).sum(axis=0).mean()))

    def along(self, positions: np.ndarray, times: np.ndarray, mean: bool = False) -> np.ndarray:
        """Return the true current [n, 2] m/s north and east along a track, at [n, 3] m and [n] s.

        `mean`: in the middle between it and the next place instead; of the last one, at its place.
        """
        places, moments = np.asarray(positions, float), np.asarray(times, float)
        if mean:
            places, moments = (
                0.5 * (part + np.concatenate([part[1:], part[-1:]])) for part in (places, moments)
            )
        return np.stack(evaluated(self.field, *places.T, moments)[:2], axis=1)


def stacked(currents: Sequence[Current]) -> Current:
    """Currents of one kind as one of batched worlds: each one's own part gets a leading axis."""
    shared, own = partition(currents[0])
    if own is not None:
        own = jax.tree.map(lambda *leaves: np.stack(leaves), *(partition(current)[1] for current in currents))
    return combine(shared, own)


@partial(compiled, static_argnames=("update",))
def _changed(key: jax.Array, count: int, field: LambVortices, update: CurrentUpdate) -> LambVortices:
    return evolve(jax.random.fold_in(key, count), field, update)


@compiled
def _forecast_of(key: jax.Array, count: int, field: LambVortices, error: float) -> LambVortices:
    return forecast_of(jax.random.fold_in(key, count), field, error)
