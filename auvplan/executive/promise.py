"""How sure a plan is to reach its destination in time, and plans that keep what they promise.

The legs of a plan are followed in many seas, each of which may be the true one, at the vehicle's speed
through the water: what changes is when it arrives. A plan that is to be home more surely keeps a share of the
time and of the energy back when its tasks are chosen.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR
from auvplan.executive.context import Mission
from auvplan.path.outlook import Chain, chain_times
from auvplan.records import LegRecord, MissionRun, Promise
from auvplan.runtime import prng
from auvplan.runtime.intervals import wilson
from auvplan.simulation.draws import drawn_seas

Array = NDArray[np.floating]

#: Seas that a promise is judged in.
SEAS = 1000

#: Samples of a leg's path, legs and windows that programs are made for; of the latter two multiples.
_SAMPLES, _LEGS, _WINDOWS = 33, 8, 2

#: Plans at most that a promise is looked for with, and shares kept back that are much the same.
_PLANS, _ALIKE = 6, 0.005

#: Promises that plans are looked for by where their cost is asked for.
_SHARES = 0.2, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999

#: Share of the seas in which the rest of a plan is to be done in time, where no promise is asked for.
_USUAL = 0.95

#: What the keys of drawn seas are folded with: those that plans are chosen by, and those they are judged in.
_CHOSEN_BY, _JUDGED_IN = 7001, 7002


@dataclass(frozen=True)
class Outcomes:
    """How a plan goes in D seas.

    Attributes:
        ends: [D] s since the epoch, when the mission is over.
        rest: [D, L] s, that the mission goes on for after each leg and its task.
        home: [D] whether the destination is reached in time, and with the energy that may be used.
        used: [D] share of the time or of the energy available that it takes, whichever is more.
        members: [D], the number of the forecast's member that each was drawn from.
    """

    ends: Array
    rest: Array
    home: NDArray[np.bool_]
    used: Array
    members: NDArray[np.integer]

    @property
    def share(self) -> float:
        """In which it is home in time."""
        return float(self.home.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval of that.

        Seas of one member are alike: they count as fewer the more of what differs between seas is the
        member's (the design effect of a cluster sample; Kish, Survey Sampling, 1965, section 5.4).
        """
        count, groups = len(self.home), int(self.members.max()) + 1
        alike = 0.0
        if groups > 1:
            means = np.bincount(self.members, self.used) / np.bincount(self.members)
            within = float(((self.used - means[self.members]) ** 2).sum()) / (count - groups)
            between = max(float(means.var(ddof=1)) - within * groups / count, 0.0)
            alike = between / (between + within) if between + within > 0.0 else 1.0
        low, high = wilson(self.share, count / (1.0 + (count / groups - 1.0) * alike))
        return float(low), float(high)


def outcomes(mission: Mission, legs: list[LegRecord], key: jax.Array) -> Outcomes:
    """Follow the legs of a plan in seas that are drawn.

    Besides the currents the times of tasks scatter, by `mission.duration_error`, and each leg is delayed by
    obstacles that no plan knows of: exponentially, as long in the mean as `planning.detour` says of all of
    them.

    Args:
        mission: as it is before the first of the legs, in the forecast.
        legs: that are planned, in order.
        key: PRNG key, consumed.
    """
    context, run = mission.context, mission.run
    scenario, begins = context.scenario, mission.now
    own = float(np.asarray(context.vehicle.speed))
    chain, count = _chain(mission, legs, own), len(legs)
    sea_key, chance = prng.parts(key, 2)
    rng = prng.generator(chance)
    detour = context.rules.detour * scenario.simulation.obstacles.total
    forecast = mission.sea.forecast()
    travels, overs, members = [], [], []
    common = context.vehicle.without_transit(), context.path_config.only()
    size, error = len(chain.task), scenario.mission.duration_error
    until = max(run.t_available, legs[-1].ends) if legs else begins
    for number, seas in enumerate(drawn_seas(scenario, context.area, forecast, sea_key, SEAS, begins, until)):
        factors = np.maximum(1.0 + error * rng.standard_normal((seas.count, size)), 0.0)
        delays = detour * rng.standard_exponential((seas.count, size)) * (np.arange(size) < count)
        given = (part.astype(np.float32) for part in (factors, delays))
        times = chain_times(
            chain, *given, np.float32(begins), forecast, seas.shared, seas.own, common[0], config=common[1]
        )
        travel, end = (np.asarray(part, float) for part in jax.device_get(times))
        travels.append(travel[:, :count])
        overs.append(end[:, :count] if count else np.full((seas.count, 1), begins))
        members.append(np.full(seas.count, number))
    travel, ends = np.concatenate(travels), np.concatenate(overs)
    over = ends[:, -1]
    used = (over - begins) / (run.t_available - begins)
    power = run.vehicle.power
    if power is not None and power.battery is not None and legs:
        whole = replace(run, legs=legs).energy
        assert whole is not None
        speeds = [own if leg.speed is None else leg.speed for leg in legs]
        watts = np.asarray([float(power.power(speed)) for speed in speeds])
        more = ((travel - np.asarray([leg.t_path for leg in legs])) * watts).sum(axis=1) / WATT_HOUR
        used = np.maximum(used, (whole.total + more) / max(whole.total + whole.margin, 1e-9))
    return Outcomes(over, over[:, None] - ends, used <= 1.0, used, np.concatenate(members))


def _chain(mission: Mission, legs: list[LegRecord], speed: float) -> Chain:
    """Return planned legs for `chain_times`, padded by such as end where they begin."""
    more = -len(legs) % _LEGS
    places = np.linspace(0.0, 1.0, _SAMPLES)

    def thinned(leg: LegRecord) -> Array:
        along = np.linspace(0.0, 1.0, len(leg.positions))
        return np.stack([np.interp(places, along, axis) for axis in np.asarray(leg.positions, float).T], 1)

    table = mission.run.graph.timetable
    windows = 1 if table is None else max(table.opens.shape[-1], 1)
    opens = np.full((len(legs), -(-windows // _WINDOWS) * _WINDOWS), -np.inf)
    closes = np.full(opens.shape, np.inf)
    if table is not None and (count := table.opens.shape[-1]):
        closes[:, count:], opens[:, count:] = -np.inf, np.inf  # no windows of theirs
        for row, leg in enumerate(legs):
            opens[row, :count] = table.opens[leg.start, leg.goal]
            closes[row, :count] = table.closes[leg.start, leg.goal]
    rises = [leg.t_fix or 0.0 for leg in legs]
    waits = [leg.t_hold > rise for leg, rise in zip(legs, rises, strict=True)]
    rows: dict[str, Any] = {
        "positions": np.stack([thinned(leg) for leg in legs]) if legs else np.zeros((0, _SAMPLES, 3)),
        "departs": [float(leg.times[0]) for leg in legs],
        "takes": [leg.t_path for leg in legs],
        "speed": [speed if leg.speed is None else leg.speed for leg in legs],
        "rises": rises,
        "leaves": [float(leg.times[0]) if wait else -np.inf for leg, wait in zip(legs, waits, strict=True)],
        "opens": opens,
        "closes": closes,
        "task": [leg.t_task for leg in legs],
    }
    fill: dict[str, float] = {"speed": speed, "leaves": -np.inf, "opens": -np.inf, "closes": np.inf}
    padded: dict[str, Any] = {
        name: np.concatenate([values, np.full((more, *np.shape(values)[1:]), fill.get(name, 0.0))])
        for name, values in ((name, np.asarray(values, float)) for name, values in rows.items())
    }
    single: dict[str, Any] = {name: values.astype(np.float32) for name, values in padded.items()}
    return Chain(**single)


@dataclass(frozen=True, eq=False)
class Promised:
    """A plan, and what it promises.

    Attributes:
        kept: share of time and energy that it was to leave.
        mission: at its end.
        found: how it goes in the seas that plans are chosen by; None where it does not reach its destination.
    """

    kept: float
    mission: Mission
    found: Outcomes | None

    @property
    def share(self) -> float:
        """Of the drawn seas, in which it is home in time; minus 1 where it is not even as planned."""
        return -1.0 if self.found is None else self.found.share


#: Plans a mission to its end.
Complete = Callable[[Mission], None]


def plan_with_promise(mission: Mission, asked: float | None, complete: Complete) -> Mission:
    """Plan a mission that keeps back as little as keeps a promise, and say how sure it is.

    Where no plan keeps it, the surest is returned.

    Args:
        mission: before its first leg, in the forecast, nothing simulated.
        asked: least probability to be home in time, in (0, 1); None to plan as always and see.
        complete: plans a mission to its end.

    Returns:
        The mission at its end; its run has the promise.
    """
    tried: list[Promised] = []
    kept: float | None = 0.0
    safely = None if asked is None else asked + _surely(asked)
    while True:
        while kept is not None and len(tried) < _PLANS:
            tried.append(planned_with(mission, kept, complete))
            kept = None if safely is None else _next(tried, safely)
        best = max(tried, key=lambda one: _worth(one, safely or 0.0))
        run = best.mission.run
        if best.found is None:
            return best.mission
        judged = outcomes(mission, run.done, prng.folded(mission.key, _JUDGED_IN))
        run.promise = promise_of(judged, mission, asked, best.kept)
        if run.promise.kept:
            return best.mission
        # It was chosen for doing well in those drawn first.
        tried[tried.index(best)] = replace(best, found=judged)
        assert safely is not None
        kept = _next(tried, safely)
        if kept is None or len(tried) >= _PLANS:
            run.reason += f"; planning.promise {asked:g} is not kept: {run.promise.line} at best"
            return best.mission


def _surely(asked: float) -> float:
    """Return by how much more a plan is to keep in the seas it is chosen by: the error of that share."""
    return math.sqrt(asked * (1.0 - asked) / SEAS)


def surer_plans(
    mission: Mission, complete: Complete, progress: Callable[[int, int], None] | None = None
) -> list[MissionRun]:
    """Plan a mission more and more surely, the least sure first; plans that another one beats are left out.

    Args:
        mission, complete: as for `plan_with_promise`.
        progress: called with how many plans are made, of how many.
    """
    first = planned_with(mission, 0.0, complete)
    if first.found is None:
        return [first.mission.run]
    tried, wanted = [first], sorted({round(_needed(first, share), 4) for share in _SHARES})
    wanted = [kept for kept in wanted if kept > 0.0]
    for number, kept in enumerate(wanted):
        if progress:
            progress(number + 1, len(wanted) + 1)
        tried.append(planned_with(mission, kept, complete))
    runs = []
    for one in tried:
        if one.found is not None:
            run, key = one.mission.run, prng.folded(mission.key, _JUDGED_IN)
            run.promise = promise_of(outcomes(mission, run.done, key), mission, None, one.kept)
            runs.append((run.promise.share, run))
    runs.sort(key=lambda one: (one[0], one[1].total_priority))
    return [
        run
        for number, (_, run) in enumerate(runs)
        if all(run.total_priority > other.total_priority for _, other in runs[number + 1 :])
    ]


def planned_with(mission: Mission, kept: float, complete: Complete) -> Promised:
    """Plan a mission that leaves a share of its time and energy, and follow it in seas that are drawn."""
    begins, available = mission.now, mission.run.t_available
    one = mission.fork(energy_kept=kept * mission.energy_left if np.isfinite(mission.energy_left) else 0.0)
    one.run.t_available = available - kept * (available - begins)
    complete(one)
    one.run.t_available = available
    if not one.run.success:
        return Promised(kept, one, None)
    return Promised(kept, one, outcomes(mission, one.run.done, prng.folded(mission.key, _CHOSEN_BY)))


def promise_of(found: Outcomes, mission: Mission, asked: float | None, kept: float) -> Promise:
    """Return what outcomes of a mission that is about to begin promise."""
    low, high = found.interval
    ends = np.quantile(found.ends - mission.now, [0.05, 0.5, 0.95]).tolist()
    members, available = int(found.members.max()) + 1, mission.run.t_available - mission.now
    latest = available - np.quantile(found.rest, _USUAL if asked is None else asked, axis=0)
    return Promise(
        asked,
        found.share,
        low,
        high,
        len(found.home),
        members,
        tuple(ends),
        kept,
        tuple(latest.tolist()),
    )


def _worth(one: Promised, asked: float) -> tuple[bool, float, float]:
    """Return what the better of two plans has more of: the promise kept, priority, and how sure it is.

    Of plans that do not keep it, the surest is best.
    """
    kept = one.share >= asked
    return kept, one.mission.run.total_priority if kept else one.share, one.share


def _next(tried: list[Promised], asked: float) -> float | None:
    """Return the next share to keep back, or None where it is found or there is none."""
    last = tried[-1]
    short = [one.kept for one in tried if 0.0 <= one.share < asked]
    if enough := [one for one in tried if one.share >= asked]:
        least = min(enough, key=lambda one: one.kept)
        return _between(max([_needed(least, asked), *short]), least.kept) if short else None
    if last.found is None:
        return _between(max(short), last.kept) if short else None
    # Where a few members decide, a little more time kept back changes nothing: steps grow.
    several = bool(last.found.members.max())
    return max(_needed(last, asked), last.kept + _ALIKE * 2.0 ** (len(short) if several else 0))


def _needed(one: Promised, asked: float) -> float:
    """Return the share to keep back by which a plan that needs as much beyond it just keeps the promise."""
    assert one.found is not None
    return 1.0 - (1.0 - one.kept) / float(np.quantile(one.found.used, asked))


def _between(low: float, high: float) -> float | None:
    """Return the middle of two shares that are not much the same; else None."""
    return 0.5 * (low + high) if high - low > _ALIKE else None
