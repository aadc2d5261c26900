"""Timetables: how long every edge takes by the time at which it is entered, and when its task may begin.

An edge's travel time is known at evenly spaced departures and linear between them. Where the vehicle may
wait, it enters an edge later if that brings it to the end sooner: arrival functions are then first in, first
out, and an edge that is closed for some time is entered when it opens again. Between two departures an edge
is open where it is open at both.

A task at a waypoint begins in one of its windows; one along an edge, such as a part of a survey line, lies
in one of its own from the entry to the end. Priorities may fall at some moments: what counts is when the
task at a waypoint begins, and when one along an edge is at its end.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, NamedTuple, Self

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.runtime.arguments import numbers

Array = NDArray[np.floating]

#: Halvings that find the last moment at which an edge may be entered, to single precision.
_HALVINGS = 26

#: Share of a time that sums in single precision may be off by.
_ROUNDING = 8 * float(np.finfo(np.float32).eps)

#: s; no vehicle is so punctual.
_MOMENT = 1e-3

#: Fields of a timetable that go together in pairs, what they hold for none, and where all is open always.
NONE = {"opens": np.inf, "closes": -np.inf, "enters": np.inf, "until": -np.inf, "falls": np.inf, "drops": 0.0}
ALWAYS = {
    "opens": -np.inf,
    "closes": np.inf,
    "enters": -np.inf,
    "until": np.inf,
    "falls": np.inf,
    "drops": 0.0,
}


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Timetable:
    """Travel times by departure and windows of tasks, for all pairs of N waypoints.

    Attributes:
        departures: [..., M] s, evenly spaced, M at least 1. Before the first one and after the last travel
            times are as they are then.
        travel_time: [..., M, N, N] s from i to j without the task; infinite where the edge is closed.
        opens, closes: [..., N, N, W] s, the W intervals in which the task of an edge may begin, minus and
            plus infinity for one that is open always, plus and minus infinity for none. W is 0 where every
            task may begin at any time.
        enters, until: [..., N, N, V] s, the V intervals in one of which an edge is entered and its task done;
            infinite as `opens` and `closes`. V is 0 where there are none.
        falls, drops: [..., N, N, D] s and priority: a task that begins after `falls` is worth `drops` less.
            Infinite and 0 for none; D is 0 where no priority falls.
        waiting: whether the vehicle may wait, for a window at the task and for an edge before it.

    Raises:
        ValueError: a field given as a NumPy array has a wrong shape or is NaN, or departures are none or not
            evenly spaced.
        TypeError: it holds text, dates or durations in place of numbers: give seconds.
    """

    departures: Any
    travel_time: Any
    opens: Any = None
    closes: Any = None
    enters: Any = None
    until: Any = None
    falls: Any = None
    drops: Any = None
    waiting: bool = field(default=True, metadata={"static": True})

    def __post_init__(self) -> None:
        if not isinstance(self.travel_time, np.ndarray | list):
            return  # JAX rebuilds timetables from traced arrays and placeholders: nothing to check there
        travel, departures = numbers("travel_time", self.travel_time), numbers("departures", self.departures)
        if travel.ndim < 3 or travel.shape[-1] != travel.shape[-2] or not travel.shape[-3]:
            raise ValueError(f"travel_time must be [M, N, N] s, M at least 1, got shape {travel.shape}")
        if departures.shape != travel.shape[:-2]:
            raise ValueError(f"departures must be {travel.shape[:-2]}, got shape {departures.shape}")
        if not np.isfinite(departures).all():
            raise ValueError("departures must be finite, s")
        steps = np.diff(departures, axis=-1)
        even = not steps.size or ((steps > 0.0).all() and np.allclose(steps, steps[..., :1], rtol=1e-6))
        if not even:
            raise ValueError("departures must be evenly spaced and rise")
        if np.isnan(travel).any() or (travel < 0.0).any():
            raise ValueError("travel_time must not be negative or NaN; infinite where an edge is closed")
        shape = (*travel.shape[:-3], *travel.shape[-2:])
        for name in NONE:
            given = getattr(self, name)
            value = np.zeros((*shape, 0)) if given is None else numbers(name, given)
            if value.shape[:-1] != shape:
                raise ValueError(f"{name} must be [N, N, W] with N = {shape[-1]}, got shape {value.shape}")
            if np.isnan(value).any():
                raise ValueError(f"{name} must not be NaN: give {NONE[name]} for none")
            object.__setattr__(self, name, value)
        names = list(NONE)
        for first, last in zip(names[::2], names[1::2], strict=True):
            one, other = getattr(self, first).shape, getattr(self, last).shape
            if one != other:
                raise ValueError(f"{first} and {last} must be as many, got {one}, {other}")
        if not (np.isfinite(self.drops) & (self.drops >= 0.0)).all():
            raise ValueError("drops must be finite and not negative")
        object.__setattr__(self, "travel_time", travel)
        object.__setattr__(self, "departures", departures)

    @property
    def least(self) -> Array:
        """[..., N, N] s, the shortest travel time at any departure; infinite where an edge never opens."""
        return np.min(self.travel_time, axis=-3)

    @property
    def later(self) -> Array:
        """[..., M, N, N] s, when edges end at the earliest that are entered at a departure after each one.

        Infinite after the last one.
        """
        arrival = self.departures[..., None, None] + self.travel_time
        earliest = np.flip(np.minimum.accumulate(np.flip(arrival, -3), -3), -3)
        last = np.full_like(arrival[..., -1:, :, :], np.inf)
        return np.concatenate([earliest[..., 1:, :, :], last], axis=-3)

    @property
    def later_travel(self) -> Array:
        """[..., M, N, N] s under way on the edges that end at `later`: the rest is waiting."""
        arrival = self.departures[..., None, None] + self.travel_time
        found = np.full_like(arrival, np.inf)
        best = travel = found[..., -1, :, :]
        for departure in range(arrival.shape[-3] - 1, 0, -1):
            sooner = arrival[..., departure, :, :] <= best
            best = np.where(sooner, arrival[..., departure, :, :], best)
            travel = np.where(sooner, self.travel_time[..., departure, :, :], travel)
            found[..., departure - 1, :, :] = travel
        return found

    def since(self, seconds: float) -> Self:
        """Return a copy whose times count from `seconds` later."""
        moments = ("departures", "opens", "closes", "enters", "until", "falls")
        times = {name: getattr(self, name) - seconds for name in moments}
        return replace(self, **times)

    def begins(self, i: int, j: int, arrives: float) -> float:
        """Return when the task from i to j may begin after an arrival, s; infinite where it is too late."""
        opens, closes = self.opens[i, j], self.closes[i, j]
        if not len(opens):
            return arrives
        missed = arrives > closes
        if not self.waiting:
            missed |= arrives < opens
        return float(np.where(missed, np.inf, np.maximum(arrives, opens)).min())

    def padded(self, more: int) -> Self:
        """Return a copy with `more` additional waypoints, which no edge leads to.

        So that one program serves several numbers of departures and windows, there are more of these too:
        departures after the last, when travel times are as they are then, and windows that are none. Where
        there are any windows or falls, there are some of every kind: open always, and without a drop.
        """
        square = [(0, more), (0, more)]
        lead = [(0, 0)] * (self.travel_time.ndim - 3)
        parts, some = {}, any(getattr(self, name).shape[-1] for name in NONE)
        for name, none in NONE.items():
            values = getattr(self, name)
            if some and not values.shape[-1]:
                values = np.full((*values.shape[:-1], 1), ALWAYS[name])
            windows = [*lead, *square, (0, _more(values.shape[-1]))]
            parts[name] = np.pad(values, windows, constant_values=none)
        travel_time = np.pad(self.travel_time, [*lead, (0, 0), *square], constant_values=np.inf)
        departures = self.departures
        if later := more_departures(departures.shape[-1]):
            travel_time = np.pad(travel_time, [*lead, (0, later), (0, 0), (0, 0)], mode="edge")
            first = departures[..., :1]
            step = departures[..., 1:2] - first if departures.shape[-1] > 1 else np.ones_like(first)
            departures = np.concatenate(
                [departures, departures[..., -1:] + step * np.arange(1, later + 1)], -1
            )
        return replace(self, departures=departures, travel_time=travel_time, **parts)

    def without_windows(self, pairs: NDArray[np.bool_]) -> Self:
        """Return a copy in which the tasks of pairs, a mask [..., N, N], may be done at any time."""
        at = pairs[..., None]
        return replace(self, **{name: np.where(at, v, getattr(self, name)) for name, v in ALWAYS.items()})

    def lost(self, i: int, j: int, begins: float) -> float:
        """Return by how much the priority of the task from i to j has fallen when it begins."""
        return float(self.drops[i, j][begins > self.falls[i, j]].sum())

    def kept(self, i: int, j: int, leaves: float, ends: float) -> bool:
        """Return whether a task along the edge from i to j lies in one of its windows, s."""
        enters, until = self.enters[i, j], self.until[i, j]
        return not len(enters) or bool(((leaves >= enters - _MOMENT) & (ends <= until + _MOMENT)).any())


def more_departures(count: int) -> int:
    """Return how many departures a padded timetable has beside `count`."""
    return max(32, count + _more(count)) - count


def _more(count: int) -> int:
    """Return what is missing to the next power of two; nothing where there is nothing."""
    return (1 << (count - 1).bit_length()) - count if count else 0


class Stages(NamedTuple):
    """The legs of a route by the clock, each [n - 1] s; infinite from the first that cannot be done.

    Attributes:
        departs: when the leg before is done.
        leaves: when the edge is entered; what lies between is waiting for it to open.
        arrives: when the vehicle is at its end.
        begins: when its task begins; what lies between is waiting.
        ends: when its task is done.
    """

    departs: Array
    leaves: Array
    arrives: Array
    begins: Array
    ends: Array


def stages(
    timetable: Timetable,
    duration: NDArray[np.floating],
    nodes: Sequence[int] | NDArray[np.int_],
    now: float = 0.0,
) -> Stages:
    """Go through a route by the clock, in double precision.

    Args:
        timetable: of one graph of N waypoints.
        duration: [N, N] s, of the task on each edge.
        nodes: [n] the route.
        now: s, when it begins.
    """
    departures, travel = timetable.departures, timetable.travel_time
    step, final = float(departures[1] - departures[0]) if len(departures) > 1 else 1.0, len(departures) - 1

    def crossed(i: int, j: int, enters: float) -> tuple[float, float]:
        """When the edge is entered at the earliest moment from `enters` that serves, and its end reached."""
        place = max((enters - departures[0]) / step, 0.0)
        cell = min(int(place), final)
        share = min(place - cell, 1.0)
        a, b = travel[cell, i, j], travel[min(cell + 1, final), i, j]
        between = a + share * (b - a) if np.isfinite([a, b]).all() else np.inf
        leaves, arrives = enters, enters + (a if share == 0.0 else between)
        later = departures[cell + 1 :] + travel[cell + 1 :, i, j]
        if timetable.waiting and len(later) and later.min() < arrives:
            leaves, arrives = departures[cell + 1 + int(np.argmin(later))], later.min()
        return leaves, arrives

    rows, time = [], float(now)
    for i, j in pairwise(int(node) for node in nodes):
        departs = leaves = arrives = time
        if np.isfinite(departs):
            if timetable.enters.shape[-1]:
                leaves = arrives = np.inf
                for enters, until in zip(timetable.enters[i, j], timetable.until[i, j], strict=True):
                    if enters > departs and (np.isinf(enters) or not timetable.waiting):
                        continue
                    entry = crossed(i, j, max(departs, enters))
                    if entry[1] + duration[i, j] <= until and entry[1] < arrives:
                        leaves, arrives = entry
            else:
                leaves, arrives = crossed(i, j, departs)
        begins = timetable.begins(i, j, arrives)
        time = begins + float(duration[i, j])
        rows.append((departs, leaves, arrives, begins, time))
    return Stages(*np.asarray(rows, float).reshape(-1, 5).T)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Schedule:
    """A timetable by lists of the K edges from each waypoint: of neighbours in JAX, of all in NumPy.

    Attributes:
        origin: [...] s, the first departure.
        step: [...] s between departures.
        travel_time, later: [..., N, K, M] s, as in `Timetable`.
        duration: [..., N, K] s, of the task on each edge.
        opens, closes: [..., N, K, W] s.
        enters, until: [..., N, K, V] s.
        falls, drops: [..., N, K, D] s and priority.
        waiting: as in `Timetable`.
        later_travel: [..., N, K, M] s, as in `Timetable`; None where waits are not asked for.
    """

    origin: Any
    step: Any
    travel_time: Any
    later: Any
    duration: Any
    opens: Any
    closes: Any
    enters: Any
    until: Any
    falls: Any
    drops: Any
    waiting: bool = field(default=True, metadata={"static": True})
    later_travel: Any = None

    @classmethod
    def whole(cls, timetable: Timetable, duration: Array) -> "Schedule":
        """Return a timetable by lists of all N waypoints, in double precision."""
        origin, *later = np.moveaxis(timetable.departures[..., :2], -1, 0)
        step = later[0] - origin if later else np.ones_like(origin)
        planes = (np.moveaxis(values, -3, -1) for values in (timetable.travel_time, timetable.later))
        parts = [origin, step, *planes, duration, *(getattr(timetable, name) for name in NONE)]
        return cls(*parts, waiting=timetable.waiting)

    @classmethod
    def of(
        cls,
        timetable: Timetable,
        duration: Array,
        neighbours: NDArray[np.int_],
        used: NDArray[np.bool_],
        waits: bool = False,
    ) -> "Schedule":
        """Gather a timetable by neighbour lists [..., N, K], of which `used` says what is no padding.

        With `waits` it knows how long a vehicle waits.
        """
        whole = cls.whole(timetable, duration)
        if waits:
            whole = replace(whole, later_travel=np.moveaxis(timetable.later_travel, -3, -1))
        # What rounding may add up to on the way must not keep a task from being begun just in time.
        slack = timetable.travel_time.shape[-1] * float(np.finfo(np.float32).eps)

        def gathered(name: str) -> Array:
            values, filling = getattr(whole, name), NONE.get(name, 0.0 if name == "duration" else np.inf)
            if name in ("closes", "until", "falls"):
                values = np.where(np.isfinite(values), (1.0 + slack) * values, values)
            more = (...,) + (None,) * (values.ndim - neighbours.ndim)
            rows = np.take_along_axis(values, neighbours[more], axis=neighbours.ndim - 1)
            return np.where(used[more], rows, filling).astype(np.float32)

        names = "travel_time", "later", "duration", *NONE
        parts = [
            *(np.asarray(value, np.float32) for value in (whole.origin, whole.step)),
            *map(gathered, names),
        ]
        later_travel = gathered("later_travel") if waits else None
        return cls(*parts, waiting=timetable.waiting, later_travel=later_travel)

    def begins(
        self, node: Any, edge: Any, time: Any, waiting: bool | None = None
    ) -> tuple[jax.Array, jax.Array]:
        """Arrival and beginning of the task, s, where edges are entered at a time; arrays of one shape.

        Args:
            node: indices of the waypoints that edges lead from.
            edge: places of edges in their lists.
            time: s.
            waiting: instead of the timetable's own.
        """
        arrives, begins, _ = self._passed(node, edge, time, self.waiting if waiting is None else waiting)
        return arrives, begins

    def stages(self, node: Any, edge: Any, time: Any) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Seconds of waiting before edges, under way, and of waiting at the end; arguments as in `begins`."""
        arrives, begins, travel = self._passed(node, edge, time, self.waiting)
        assert travel is not None
        return self._library.maximum(arrives - time - travel, 0.0), travel, begins - arrives

    def _passed(self, node: Any, edge: Any, time: Any, waits: bool) -> tuple[Any, Any, Any]:
        """Arrival, beginning of the task, and s under way where `later_travel` is known."""
        xp = self._library
        if self.enters.shape[-1]:
            enters, until = self.enters[node, edge], self.until[node, edge]
            entered = xp.maximum(time[..., None], enters)
            ends, travel = self._crossed(node[..., None], edge[..., None], entered, waits)
            missed = ends + self.duration[node, edge][..., None] > until
            missed = missed if waits else missed | (time[..., None] < enters)
            ends = xp.where(missed, xp.inf, ends)
            arrives = ends.min(axis=-1)
            if travel is not None:
                travel = xp.take_along_axis(travel, ends.argmin(axis=-1)[..., None], axis=-1)[..., 0]
        else:
            arrives, travel = self._crossed(node, edge, time, waits)
        if not self.opens.shape[-1]:
            return arrives, arrives, travel
        opens, closes = self.opens[node, edge], self.closes[node, edge]
        late = arrives[..., None] > closes
        early = arrives[..., None] < opens
        missed = late if waits else late | early
        begins = xp.where(missed, xp.inf, xp.maximum(arrives[..., None], opens)).min(axis=-1)
        return arrives, begins, travel

    @property
    def _library(self) -> Any:
        return np if isinstance(self.travel_time, np.ndarray) else jnp

    def lost(self, node: Any, edge: Any, begins: Any) -> Any:
        """Return by how much priorities have fallen where tasks begin at times; arguments as in `begins`."""
        late = begins[..., None] > self.falls[node, edge]
        return jnp.where(late, self.drops[node, edge], 0.0).sum(axis=-1)

    def at(self, values: Any, node: Any, time: Any) -> Any:
        """Return values [N, M], known at the departures, of waypoints at times, arrays of one shape."""
        final, (cell, share) = self.travel_time.shape[-1] - 1, self._cell(time)
        a, b = values[node, cell], values[node, self._library.minimum(cell + 1, final)]
        return a + share * (b - a)

    def _cell(self, time: Any) -> tuple[Any, Any]:
        """Return the last departures before times, and the share of a step since."""
        final, xp = self.travel_time.shape[-1] - 1, self._library
        place = xp.maximum((time - self.origin) / self.step, 0.0)
        if place.dtype == np.float32:
            # A departure is one, whatever rounding adds up to: an edge may be open then and closed after it.
            near = xp.round(place)
            place = xp.where(xp.abs(place - near) <= _ROUNDING * xp.maximum(near, 1.0), near, place)
        cell = xp.clip(xp.floor(place), 0, final).astype(xp.int32)
        return cell, xp.clip(place - cell, 0.0, 1.0)

    def _crossed(self, node: Any, edge: Any, time: Any, waits: bool) -> tuple[Any, Any]:
        """When edges are at their ends that are entered at times, or later where the vehicle waits.

        And for how long it is under way, where `later_travel` is known.
        """
        final, xp = self.travel_time.shape[-1] - 1, self._library
        cell, share = self._cell(time)
        a = self.travel_time[node, edge, cell]
        b = self.travel_time[node, edge, xp.minimum(cell + 1, final)]
        shut = xp.isinf(a) | xp.isinf(b)
        between = xp.where(shut, xp.inf, a + share * xp.where(shut, 0.0, b - a))
        travel = lasts = xp.where(share == 0.0, a, between)
        ends = time + lasts
        if not waits:
            return ends, None if self.later_travel is None else travel
        later = self.later[node, edge, cell]
        if self.later_travel is not None:
            travel = xp.where(later < ends, self.later_travel[node, edge, cell], lasts)
        return xp.minimum(ends, later), None if self.later_travel is None else travel

    def lasts(self, node: Any, edge: Any, time: Any, waiting: bool | None = None) -> jax.Array:
        """Seconds from entering edges until their tasks are done; arguments as in `begins`."""
        _, begins = self.begins(node, edge, time, waiting)
        return begins + self.duration[node, edge] - time


def latest_entries(
    schedule: Schedule,
    neighbours: jax.Array,
    closed: jax.Array,
    goal: jax.Array,
    deadline: jax.Array,
    margin: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """When each edge must be entered at the latest so that the goal can still be reached.

    Waiting is taken to be allowed, waypoints may be passed again: no later entry helps. The path from each
    waypoint to the goal is taken to last longer by `margin`.

    Args:
        schedule: of N waypoints, lists of length K.
        neighbours: [N, K] int32.
        closed: [N, K] bool, edges that are not to be taken.
        goal: index.
        deadline: s.
        margin: share.

    Returns:
        ``(latest [N, K] s, due [N] s, following [N])``: the last moment to enter each edge with the margin,
        the last one to leave each waypoint without it, and where to go then; minus infinity where the goal is
        out of reach.
    """
    size, width = neighbours.shape
    node = jnp.broadcast_to(jnp.arange(size, dtype=jnp.int32)[:, None], (size, width))
    edge = jnp.broadcast_to(jnp.arange(width, dtype=jnp.int32), (size, width))

    def last(due: jax.Array) -> jax.Array:
        """Return the last moment at which each edge may be entered to end by `due` [N]."""
        wanted = due[neighbours]

        def in_time(moment: jax.Array) -> jax.Array:
            return (moment + schedule.lasts(node, edge, moment, waiting=True) <= wanted) & ~closed

        def halve(_: int, bounds: tuple[jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array]:
            low, high = bounds
            middle = 0.5 * (low + high)
            good = in_time(middle)
            return jnp.where(good, middle, low), jnp.where(good, high, middle)

        none = jnp.zeros((size, width), schedule.duration.dtype)
        low, _ = jax.lax.fori_loop(0, _HALVINGS, halve, (none, none + deadline))
        # Halving comes to just before a departure after which an edge is closed.
        near = schedule.origin + schedule.step * jnp.round((low - schedule.origin) / schedule.step)
        low = jnp.where((jnp.abs(near - low) <= _ROUNDING * deadline) & in_time(near), near, low)
        # An edge that can be entered at once and closes then is entered before a moment after.
        return jnp.where(in_time(none), jnp.maximum(low, _MOMENT), -jnp.inf)

    def relax(state: tuple[jax.Array, jax.Array, jax.Array]) -> tuple[jax.Array, jax.Array, jax.Array]:
        due, following, _ = state
        moments = last(due)
        best = moments.max(axis=1)
        later = best > due
        onward = neighbours[jnp.arange(size), jnp.argmax(moments, axis=1)]
        return jnp.where(later, best, due), jnp.where(later, onward, following), later.any()

    index = jnp.arange(size, dtype=jnp.int32)
    at_goal = jnp.where(index == goal, deadline, -jnp.inf).astype(schedule.duration.dtype)
    due, following, _ = jax.lax.while_loop(lambda state: state[2], relax, (at_goal, index, jnp.array(True)))
    spare = deadline - (1.0 + margin) * (deadline - due)
    latest = last(jnp.where(jnp.isfinite(due), spare, -jnp.inf))
    latest = jnp.where(jnp.isfinite(latest), latest + _ROUNDING * jnp.abs(latest), latest)
    return latest, due, following
