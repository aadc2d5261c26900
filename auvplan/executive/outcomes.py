"""How a plan goes in many seas, each of which may be the true one.

The vehicle keeps the tracks of its legs, at its speed through the water: what changes is when it arrives.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR
from auvplan.executive.context import Mission
from auvplan.mission.timetable import ALWAYS
from auvplan.path.outlook import Chain, Drawn, chain_times, leg_times, ruled_times
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.arrays import Array
from auvplan.runtime.intervals import wilson
from auvplan.simulation.world import drawn_seas

#: Seas that a promise is judged in.
SEAS = 1000

#: Samples of a leg's path, legs and windows that programs are made for; of the latter two multiples.
_SAMPLES, _LEGS, _WINDOWS = 33, 8, 2

#: Fields of a chain that are windows.
_WINDOWED = "opens", "closes", "enters", "until"


@dataclass(frozen=True)
class Outcomes:
    """How a plan goes in D seas.

    Attributes:
        ends: [D] s since the epoch, when the mission is over.
        stops: [D, L] s since the epoch, when each leg and its task are over, all of them done.
        done: [D, L] whether each task is in time for its window.
        used: [D] share of the time or of the energy available that it takes, whichever is more.
        members: [D], the number of the forecast's member that each was drawn from.
        latest: [D, L] s since the epoch, until when each leg and its task have to be over for those after it
            to be done as they are here, and the destination reached in time.
        past, home: [D, K] s, that it takes from one of the first K stops past the next task to the one after,
            that task included, and straight to the destination; infinite where there is no such way.
        spent: shares of the energy that may be used, where that is limited: [D] of all legs together, [D, L]
            of each more, and [D, K] on the ways past a task and to the destination.
        lost: by how much more than planned the priority of each task has fallen [D, L], and of those past a
            task [D, K], when they begin.
    """

    ends: Array
    stops: Array
    done: NDArray[np.bool_]
    used: Array
    members: NDArray[np.integer]
    latest: Array
    past: Array
    home: Array
    spent: tuple[Array, ...] = ()
    lost: tuple[Array | float, Array | float] = (0.0, 0.0)

    @property
    def in_time(self) -> NDArray[np.bool_]:
        """[D], whether the destination is reached in time, and with the energy that may be used."""
        return self.used <= 1.0

    @property
    def share(self) -> float:
        """In which it is home in time."""
        return float(self.in_time.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval of that.

        Seas of one member are alike: they count as fewer the more of what differs between seas is the
        member's (the design effect of a cluster sample; Kish, Survey Sampling, 1965, section 5.4).
        """
        count, groups = len(self.used), int(self.members.max()) + 1
        alike = 0.0
        if groups > 1:
            means = np.bincount(self.members, self.used) / np.bincount(self.members)
            within = float(((self.used - means[self.members]) ** 2).sum()) / (count - groups)
            between = max(float(means.var(ddof=1)) - within * groups / count, 0.0)
            alike = between / (between + within) if between + within > 0.0 else 1.0
        low, high = wilson(self.share, count / (1.0 + (count / groups - 1.0) * alike))
        return float(low), float(high)


class Ways(NamedTuple):
    """Legs that may be gone in place of a plan's from the first K stops; None where there is none.

    Attributes:
        past: past the next task to the one after.
        home: straight to the destination.
    """

    past: Sequence[LegRecord | None]
    home: Sequence[LegRecord | None]


class Rule(NamedTuple):
    """What a plan leaves out where it is late.

    Attributes:
        on: [K] s since the epoch, until when stops are left to go on; infinite where nothing is left out.
        past: [K] s, until when they are left past the next task; later it is straight to the destination.
    """

    on: Array
    past: Array

    def earlier(self, seconds: float) -> "Rule":
        """Return the rule by which stops are left as much earlier."""
        return Rule(self.on - seconds, self.past - seconds)


@dataclass(frozen=True)
class Ruled:
    """How a plan with its rule goes in D seas.

    Attributes:
        rule: that is followed.
        kind: [D, K], what is done at each stop: 0 the plan, 1 past the next task, 2 straight to the
            destination; minus 1 where the vehicle does not come there.
        found: ends and shares of what is available, with the rule.
        priority: mean over the drawn ones.
    """

    rule: Rule
    kind: NDArray[np.integer]
    found: Outcomes
    priority: float


def outcomes(mission: Mission, legs: list[LegRecord], key: jax.Array, ways: Ways | None = None) -> Outcomes:
    """Follow the legs of a plan in seas that are drawn.

    Besides the currents the times of tasks scatter, by `mission.duration_error`, and each leg is delayed by
    obstacles that no plan knows of: exponentially, as long in the mean as `planning.detour` says of all of
    them.

    Args:
        mission: as it is before the first of the legs, in the forecast.
        legs: that are planned, in order.
        key: PRNG key, consumed.
        ways: that may be gone in place of them, followed as well.
    """
    run, count, begins = mission.run, len(legs), mission.now
    config = mission.context.path_config.only()
    parts = [_chain(mission, legs)] if ways is None else _chains(mission, legs, ways)
    rows: list[tuple[Array, ...]] = []
    members = []
    others: list[list[tuple[Array, Array]]] = [[] for _ in parts[1:]]
    for number, (seas, factors, late) in enumerate(_drawn(mission, legs, key, len(parts))):
        found = chain_times(parts[0], factors[0], late[0], np.float32(begins), seas, config=config)
        travel, end, done = (np.asarray(part, float) for part in jax.device_get(found))
        rows.append(tuple(part[:, :count] for part in (travel, end, done, factors[0] * parts[0].task)))
        members.append(np.full(len(end), number))
        leaves = np.concatenate([np.full((len(end), 1), begins), end[:, :-1]], axis=1).astype(np.float32)
        for kind, chain in enumerate(parts[1:], 1):
            lasts = np.asarray(jax.device_get(leg_times(chain, leaves, seas, config=config)), float)
            others[kind - 1].append((lasts + late[kind], factors[kind] * np.asarray(chain.task)))
    gone, stops, done, tasks = (np.concatenate(part) for part in zip(*rows, strict=True))
    done, stops = done.astype(bool), stops if count else np.full((len(stops), 1), begins)
    used = (stops[:, -1] - begins) / (run.t_available - begins)
    limit = _Limit.of(run, legs, ways)
    spent: list[Array] = []
    if limit is not None:
        on = limit.shares(0, gone, np.diff(stops, axis=1, prepend=begins), tasks, done)
        common = np.full(len(on), limit.common)
        used, spent = np.maximum(used, common + on.sum(axis=1)), [common, on]
    instead, begun = [*np.zeros((2, len(used), 0))], [*np.zeros((2, len(used), 0))]
    for kind, some in enumerate(ways or ()):
        lasts, last = (np.concatenate(part)[:, :count] for part in zip(*others[kind], strict=True))
        missing = [leg is None for leg in some]
        instead[kind] = np.where(missing, np.inf, (lasts + last)[:, 1 : len(some) + 1])
        begun[kind] = stops[:, : len(some)] + lasts[:, 1 : len(some) + 1]
        if limit is not None:
            shares = limit.shares(kind + 1, lasts, lasts + last, last, np.ones(lasts.shape, bool))
            spent.append(shares[:, 1 : len(some) + 1])
    latest = latest_stops(parts[0], gone, tasks, done, run.t_available)
    past, home = instead
    drawn = np.concatenate(members)
    skipped = () if ways is None else ways.past
    lost = _lost(run, legs, stops - tasks), _lost(run, skipped, begun[0])
    return Outcomes(stops[:, -1], stops, done, used, drawn, latest, past, home, tuple(spent), lost)


def _lost(run: MissionRun, legs: Sequence[LegRecord | None], begins: Array) -> Array:
    """Return by how much more the priorities of tasks have fallen than planned [D, L].

    Args:
        run: the plan.
        legs: with the tasks at their ends; None for none.
        begins: [D, L] s since the epoch, when they begin.
    """
    lost, table = np.zeros(begins.shape), run.graph.timetable
    for number, leg in enumerate(legs):
        if table is not None and leg is not None and leg.priority > 0.0:
            edge = leg.start, leg.goal
            fallen = table.drops[edge] * (begins[:, number, None] > table.falls[edge])
            more = fallen.sum(axis=1) - table.lost(*edge, leg.ends - leg.t_task)
            lost[:, number] = np.minimum(more, leg.priority)
    return lost


def latest_stops(chain: Chain, gone: Array, tasks: Array, done: NDArray[np.bool_], available: float) -> Array:
    """Return until when legs and their tasks have to be over, see `Outcomes`; backwards from the destination.

    Waits are shortened, and windows kept that are kept here. What legs take is what it is here.

    Args:
        chain: the plan.
        gone, tasks: [D, L] s, of paths and tasks.
        done: [D, L] whether each task is in time for its window.
        available: s since the epoch, when the time is over.
    """
    latest = np.full(gone.shape, available)
    for k in reversed(range(1, gone.shape[1])):
        begins = latest[:, k] - np.where(done[:, k], tasks[:, k], 0.0)
        opens, closes, enters, until = (np.asarray(getattr(chain, name))[k] for name in _WINDOWED)
        for first, last in ((opens, closes), (enters + gone[:, k, None], until - tasks[:, k, None])):
            within = np.minimum(begins[:, None], last)
            within = np.where(within >= first, within, -np.inf).max(axis=1)
            begins = np.where(done[:, k] & np.isfinite(within), within, begins)
        latest[:, k - 1] = begins - gone[:, k] - np.asarray(chain.rises)[k]
    return latest


def ruled(mission: Mission, legs: list[LegRecord], key: jax.Array, ways: Ways, rule: Rule) -> Ruled:
    """Follow a plan by a rule in seas that are drawn; arguments as for `outcomes`."""
    run, count, begins = mission.run, len(legs), mission.now
    config = mission.context.path_config.only()
    chains: Any = jax.tree.map(lambda *leaves: np.stack(leaves), *_chains(mission, legs, ways))
    latest = np.full((len(chains.task[0]), 2), np.inf)
    latest[1 : len(rule.on) + 1] = np.stack(rule, axis=1)
    rows: list[tuple[Array, ...]] = []
    members = []
    for number, (seas, factors, late) in enumerate(_drawn(mission, legs, key, 3)):
        begun = latest.astype(np.float32), factors, late, np.float32(begins)
        found = jax.device_get(ruled_times(chains, *begun, seas, config=config))
        kind, *rest = (np.asarray(part, float)[:, :count] for part in found)
        tasks = (factors * np.asarray(chains.task)[:, None])[..., :count]
        gone = np.maximum(kind, 0.0).astype(int)[None]
        rows.append((kind, *rest, np.take_along_axis(tasks, gone, axis=0)[0]))
        members.append(np.full(len(kind), number))
    kind, travel, stops, done, tasks = (np.concatenate(part) for part in zip(*rows, strict=True))
    kind, done = kind.astype(int), done.astype(bool)
    over = stops[:, -1] if count else np.full(len(stops), begins)
    used = (over - begins) / (run.t_available - begins)
    if (limit := _Limit.of(run, legs, ways)) is not None:
        times = travel, np.diff(stops, axis=1, prepend=begins), tasks, done
        shares = [np.where(kind == one, limit.shares(one, *times), 0.0) for one in range(3)]
        used = np.maximum(used, limit.common + np.sum(shares, axis=(0, 2)))
    won = np.zeros(len(used))
    for which, some in enumerate(_by_kind(legs, ways)):
        lost = _lost(run, some, stops[:, : len(some)] - tasks[:, : len(some)])
        for number, leg in enumerate(some):
            if leg is not None:
                gained = (kind[:, number] == which) & done[:, number]
                won += (leg.priority - lost[:, number]) * gained
    none = np.zeros((len(used), 0))
    found = Outcomes(over, stops, done, used, np.concatenate(members), none, none, none)
    return Ruled(rule, kind[:, 1 : len(rule.on) + 1], found, float(won.mean()))


def _drawn(
    mission: Mission, legs: list[LegRecord], key: jax.Array, kinds: int
) -> Iterator[tuple[Drawn, Array, Array]]:
    """Yield the seas of each member, with factors of tasks and delays of legs.

    Of legs there are several `kinds` [kinds, D, L], with numbers of their own: those of the plan come first.
    """
    context, run, begins = mission.context, mission.run, mission.now
    scenario = context.scenario
    sea_key, chance = prng.parts(key, 2)
    rng = prng.generator(chance)
    forecast, vehicle = mission.sea.forecast(), context.vehicle.without_transit()
    detour = context.rules.detour * scenario.simulation.obstacles.total
    error, count = scenario.mission.duration_error, len(legs)
    size = count + -count % _LEGS
    until = max(run.t_available, legs[-1].ends) if legs else begins
    whole = scenario, context.area, forecast, sea_key, SEAS, begins, until
    for shared, own, seas in drawn_seas(*whole):
        factors, late = np.ones((2, kinds, seas, size), np.float32)
        for kind in range(kinds):
            factors[kind] = np.maximum(1.0 + error * rng.standard_normal((seas, size)), 0.0)
            late[kind] = detour * rng.standard_exponential((seas, size)) * (np.arange(size) < count)
        yield Drawn(forecast, shared, own, vehicle), factors, late


class _Draw(NamedTuple):
    """What legs are planned to draw, [..., L].

    Attributes:
        total: Wh, of each with its task.
        path, rest, task: s of its path, of waiting, and of its task.
        under_way, at_rest, at_task: W during these.
        start: Wh, that the task takes once where it is done.
    """

    total: Array
    path: Array
    rest: Array
    task: Array
    under_way: Array
    at_rest: Array
    at_task: Array
    start: Array

    @classmethod
    def of(cls, run: MissionRun, legs: Sequence[LegRecord | None], count: int) -> "_Draw":
        """Those of `count` legs of a run whose vehicle has a power model; of such as are none, nothing."""
        power, own = run.vehicle.power, float(np.asarray(run.vehicle.speed))
        assert power is not None

        def drawn(leg: LegRecord) -> float:
            alone = replace(run, legs=[leg]).energy
            assert alone is not None
            return alone.total

        rows = np.zeros((len(cls._fields), count))
        for number, leg in enumerate(legs):
            if leg is not None:
                total, hour = drawn(leg), WATT_HOUR
                rows[:, number] = (
                    total,
                    leg.t_path,
                    leg.t_hold + leg.t_wait,
                    leg.t_task,
                    np.asarray(power.power(own if leg.speed is None else leg.speed))
                    + np.asarray(power.task) * (leg.line is not None),
                    drawn(replace(leg, t_wait=leg.t_wait + hour)) - total,
                    drawn(replace(leg, t_task=leg.t_task + hour)) - total,
                    np.asarray(power.task_start) / hour * (leg.priority > 0.0),
                )
        return cls(*rows)

    def taken(self, gone: Array, lasts: Array, tasks: Array, done: NDArray[np.bool_]) -> Array:
        """Return Wh of legs that take other times than planned.

        Args:
            gone, lasts: s on the path, and from the end of the leg before to that of this one.
            tasks: s of the task.
            done: whether it is done.
        """
        tasks = tasks * done
        more = (gone - self.path) * self.under_way + (lasts - gone - tasks - self.rest) * self.at_rest
        more = more + (tasks - self.task) * self.at_task
        return self.total + more / WATT_HOUR - np.where(done, 0.0, self.start)


@dataclass(frozen=True)
class _Limit:
    """The energy that a mission may use, and how legs take it.

    Attributes:
        most: Wh.
        common: share of it that legs have in common, such as for turns between them.
        draws: of the plan's legs, and of those that may be gone in place of them.
    """

    most: float
    common: float
    draws: list[_Draw]

    @classmethod
    def of(cls, run: MissionRun, legs: list[LegRecord], ways: Ways | None) -> "_Limit | None":
        """Those of a plan's legs; None where energy is not limited."""
        power = run.vehicle.power
        if power is None or power.battery is None or not legs:
            return None
        whole = replace(run, legs=legs).energy
        assert whole is not None
        most = max(whole.total + whole.margin, 1e-9)
        draws = [
            _Draw.of(run, some, len(legs)) for some in ([legs] if ways is None else _by_kind(legs, ways))
        ]
        return cls(most, (whole.total - draws[0].total.sum()) / most, draws)

    def shares(self, kind: int, *times: Any) -> Array:
        """Return the shares of it [D, L] that legs of a kind take; arguments as for `_Draw.taken`."""
        return self.draws[kind].taken(*times) / self.most


def _by_kind(legs: list[LegRecord], ways: Ways) -> list[list[LegRecord | None]]:
    """Return what may be gone before each leg, of the kinds of `Ruled`; before the first there is no stop."""
    return [[*legs], *([None, *some] for some in ways)]


def _chains(mission: Mission, legs: list[LegRecord], ways: Ways) -> list[Chain]:
    """Return a plan's legs, those past a task, and those to the destination; for such as lack, the plan's."""
    filled = (
        [leg if way is None else way for leg, way in zip_longest(legs, some[: len(legs)])]
        for some in _by_kind(legs, ways)
    )
    return [_chain(mission, some) for some in filled]


def _chain(mission: Mission, legs: list[LegRecord]) -> Chain:
    """Return planned legs for `chain_times`, padded by such as end where they begin."""
    speed = float(np.asarray(mission.context.vehicle.speed))
    more = -len(legs) % _LEGS
    places = np.linspace(0.0, 1.0, _SAMPLES)

    def thinned(leg: LegRecord) -> Array:
        along = np.linspace(0.0, 1.0, len(leg.positions))
        return np.stack([np.interp(places, along, axis) for axis in np.asarray(leg.positions, float).T], 1)

    table = mission.run.graph.timetable

    def windows(first: str, last: str) -> dict[str, Array]:
        """Those of each leg's task, of which no more count than there are."""
        count = 0 if table is None else getattr(table, first).shape[-1]
        pair = np.full((2, len(legs), -(-max(count, 1) // _WINDOWS) * _WINDOWS), np.inf)
        pair[0] = -np.inf
        if count:
            pair[:, :, count:] *= -1.0
            for row, leg in enumerate(legs):
                edge = leg.start, leg.goal
                pair[:, row, :count] = getattr(table, first)[edge], getattr(table, last)[edge]
        return {first: pair[0], last: pair[1]}

    rises = [leg.t_fix or 0.0 for leg in legs]
    waits = [leg.t_hold > rise for leg, rise in zip(legs, rises, strict=True)]
    rows: dict[str, Any] = {
        "positions": np.stack([thinned(leg) for leg in legs]) if legs else np.zeros((0, _SAMPLES, 3)),
        "departs": [float(leg.times[0]) for leg in legs],
        "takes": [leg.t_path for leg in legs],
        "speed": [speed if leg.speed is None else leg.speed for leg in legs],
        "rises": rises,
        "leaves": [float(leg.times[0]) if wait else -np.inf for leg, wait in zip(legs, waits, strict=True)],
        **windows("opens", "closes"),
        **windows("enters", "until"),
        "task": [leg.t_task for leg in legs],
    }
    fill: dict[str, float] = {"speed": speed, "leaves": -np.inf} | ALWAYS
    padded: dict[str, Any] = {
        name: np.concatenate([values, np.full((more, *np.shape(values)[1:]), fill.get(name, 0.0))])
        for name, values in ((name, np.asarray(values, float)) for name, values in rows.items())
    }
    single: dict[str, Any] = {name: values.astype(np.float32) for name, values in padded.items()}
    return Chain(**single)
