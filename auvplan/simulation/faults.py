"""What goes wrong under way, injected on purpose to see how missions end; a list for each mission.

A fault strikes the truth, or what is forecast or measured of it; planners and executive do not know that it
was injected. Nothing is compiled again for it: faults change values, not shapes. `Obstacle` takes one of the
places that every leg then keeps for it.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import jax
import numpy as np

from auvplan.ocean.currents import Current
from auvplan.ocean.ensemble import perturbed
from auvplan.runtime.arrays import Array
from auvplan.simulation.sea import Sea
from auvplan.simulation.world import KINDS, TrueObstacles

#: Depth, m, at which obstacles wait that have not appeared yet.
_FAR_BELOW = 1e6


@dataclass(frozen=True)
class _At:
    """A fault at a time `at`, s since the epoch."""

    at: float


@dataclass(frozen=True)
class _Passing(_At):
    """A fault that lasts `seconds`."""

    seconds: float


@dataclass(frozen=True)
class _Lasting(_At):
    """A fault from then on, by a factor."""

    factor: float


@dataclass(frozen=True)
class CurrentStep(_At):
    """The true current gains a uniform one.

    Attributes:
        change: m/s north and east.
        known: whether forecasts from then on have it as well.
    """

    change: tuple[float, float]
    known: bool = True


@dataclass(frozen=True)
class Obstacle(_At):
    """An obstacle appears before a vehicle under way, and drifts with the current from then on.

    Where the vehicle is at a waypoint then, it appears as soon as it is under way again.

    Attributes:
        ahead, aside: m along the track that is followed and to starboard of it, from vehicle to centre.
        radius: m.
        velocity: m/s north and east, its own.
    """

    ahead: float
    aside: float = 0.0
    radius: float = 30.0
    velocity: tuple[float, float] = (0.0, 0.0)


class WrongForecast(_Lasting):
    """The forecast is `factor` times as strong as the current."""


class Slower(_Lasting):
    """The vehicle makes `factor` of its speed through the water."""


class SensorOut(_Passing):
    """No obstacle is seen."""


class HeldUp(_Passing):
    """The vehicle keeps station."""


class PlannerOut(_Passing):
    """The path planner answers nothing."""


class LinkOut(_Passing):
    """Nothing is heard of the vehicle, and it hears nothing."""


class GivesUp(_At):
    """The vehicle reports a fault and surfaces."""


class TakenOver(_At):
    """Somebody else stops the vehicle's plan."""


class Restarts(_At):
    """The vehicle's computer restarts, and has no plan."""


#: What strikes vehicles on a link alone.
OF_A_LINK = LinkOut, GivesUp, TakenOver, Restarts

Fault = (
    CurrentStep | WrongForecast | Obstacle | SensorOut | HeldUp | PlannerOut | Slower
    | LinkOut | GivesUp | TakenOver | Restarts
)  # fmt: skip

F = TypeVar("F", bound=Fault)


class Faults:
    """The faults of one mission, in effect by its own clock.

    Attributes:
        given: all of them; more may be appended under way.
        places: obstacles that a leg keeps places for.
    """

    def __init__(self, given: Sequence[Fault] = (), places: int = 0):
        """Begin with faults that are known beforehand, and `places` for obstacles on each leg."""
        self.given = list(given)
        self.places = places
        self._taken: Counter[type] = Counter()

    def __bool__(self) -> bool:
        return bool(self.given) or self.places > 0

    def struck(self, kind: type[F], now: float) -> list[F]:
        """Return the faults of a kind that began until now."""
        return [fault for fault in self.given if isinstance(fault, kind) and fault.at <= now]

    def speed(self, now: float) -> float:
        """Return the share of its speed through the water that the vehicle makes."""
        return float(np.prod([fault.factor for fault in self.struck(Slower, now)]))

    def due(self, kind: type[F], now: float) -> list[F]:
        """Return the faults of a kind that began until now, each once."""
        found = sorted(self.struck(kind, now), key=lambda fault: fault.at)[self._taken[kind] :]
        self._taken[kind] += len(found)
        return found

    def left(self, kind: type[SensorOut | HeldUp | PlannerOut | LinkOut], now: float) -> float:
        """Return for how many more s a fault of a kind that passes is in effect; 0 where none is."""
        return max([0.0, *(fault.at + fault.seconds - now for fault in self.struck(kind, now))])

    def truth(self, current: Current, now: float) -> Current:
        """Return the true current with all steps until now."""
        return self._changed(current, 1.0, [step.change for step in self.struck(CurrentStep, now)])

    def forecast(self, current: Current, now: float) -> Current:
        """Return the forecast with the steps that are known, and its wrong strength."""
        factor = float(np.prod([fault.factor for fault in self.struck(WrongForecast, now)]))
        return self._changed(
            current, factor, [step.change for step in self.struck(CurrentStep, now) if step.known]
        )

    def _changed(self, current: Current, factor: float, changes: list[tuple[float, float]]) -> Current:
        if factor == 1.0 and not changes:
            return current
        step = np.append(np.sum(changes, axis=0) if changes else np.zeros(2), 0.0)
        return jax.device_get(perturbed(current, factor, step))


class FaultySea(Sea):
    """A sea whose current and forecasts have faults, which strike by the times that it is advanced to."""

    def __init__(self, sea: Sea, faults: Faults):
        """Wrap a sea."""
        self._sea, self._faults = sea, faults
        self._inner: Current | None = None
        self._steps = 0
        self._strike(0.0)

    def _strike(self, now: float) -> None:
        inner, steps = self._sea.field, len(self._faults.struck(CurrentStep, now))
        if self._inner is not inner or self._steps != steps:  # seldom
            self._inner, self._steps, self.field = inner, steps, self._faults.truth(inner, now)
        self._now = now

    def advance(self, now: float) -> None:
        """Let time pass up to `now`, s."""
        self._sea.advance(now)
        self._strike(now)

    def begin_window(self) -> None:
        """Take note that a window of a leg begins (3.2.2)."""
        self._sea.begin_window()
        self._strike(self._now)

    def hold(self) -> None:
        """Change no more: plans know of nothing else."""
        self._sea.hold()

    def forecast(self) -> Current:
        """Return the current as planners know it now."""
        return self._faults.forecast(self._sea.forecast(), self._now)


def absent(count: int) -> TrueObstacles:
    """Obstacles that have not appeared yet."""
    place = np.tile([0.0, 0.0, _FAR_BELOW], (count, 1))
    return TrueObstacles(place, np.zeros((count, 3)), np.ones(count), np.ones(count), [KINDS[2]] * count)


def appear(
    fault: Obstacle, truth: TrueObstacles, traces: list[Array], position: Array, tangent: Array
) -> None:
    """Let an obstacle take a free place among those of a leg, where there is one.

    Args:
        fault: which.
        truth: of the leg; changed in place.
        traces: [n, M, 3] m, where its obstacles were so far. This one was far below its place, so that
            between two records nothing meets it on its way.
        position: [3] m, of the vehicle.
        tangent: [3], along its track.
    """
    free = np.flatnonzero(truth.position[:, 2] > 0.5 * _FAR_BELOW)
    if not len(free):
        return
    level = tangent[:2] / max(float(np.linalg.norm(tangent[:2])), 1e-9)
    starboard = np.array([-level[1], level[0]])
    place = np.append(position[:2] + fault.ahead * level + fault.aside * starboard, position[2])
    row = free[0]
    for trace in traces:
        trace[:, row] = (*place[:2], _FAR_BELOW)
    if traces:
        traces[-1][-1, row] = place
    truth.position[row], truth.velocity[row], truth.radius[row] = place, (*fault.velocity, 0.0), fault.radius
