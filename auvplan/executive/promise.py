"""Plans that keep what they promise: to reach their destination in time as surely as was asked for.

A plan that is to be home more surely keeps a share of the time and of the energy back when its tasks are
chosen, or leaves out what is late.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from auvplan.executive import turning
from auvplan.executive.context import Mission
from auvplan.executive.outcomes import SEAS, Outcomes, outcomes, ruled
from auvplan.executive.turning import Stakes, turned
from auvplan.records import MissionRun, Promise
from auvplan.runtime import prng

#: Plans at most that a promise is looked for with, and shares kept back that are much the same.
_PLANS, _ALIKE = 6, 0.005

#: The same where few members decide, once a plan keeps the promise: a little less kept back gains little.
_FEW_PLANS, _MUCH_ALIKE = 4, 0.02

#: Promises that plans are looked for by where their cost is asked for.
_SHARES = 0.2, 0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.999

#: Share of the seas in which the rest of a plan is to be done in time, where no promise is asked for.
_USUAL = 0.95

#: What the keys of drawn seas are folded with: those that plans are chosen by, and those they are judged in.
_CHOSEN_BY, _JUDGED_IN = 7001, 7002


@dataclass(frozen=True, eq=False)
class Promised:
    """A plan, and what it promises.

    Attributes:
        kept: share of time and energy that it was to leave.
        unused: share that it leaves of both at least: it is the plan as long as no more is to be left.
        mission: at its end.
        found: how it goes in the seas that plans are chosen by; None where it does not reach its destination.
    """

    kept: float
    unused: float
    mission: Mission
    found: Outcomes | None

    @property
    def share(self) -> float:
        """Of the drawn seas, in which it is home in time; minus 1 where it is not even as planned."""
        return -1.0 if self.found is None else self.found.share


#: Plans a mission to its end.
Complete = Callable[[Mission], None]


def planned(mission: Mission, complete: Complete, judged: bool = False) -> Mission:
    """Plan a mission as its scenario asks, with a promise or without one; return it at its end.

    Args:
        mission, complete: as for `plan_with_promise`.
        judged: whether the plan says how sure it is also where no promise is asked for.
    """
    rules = mission.context.rules
    if judged or rules.promises:
        return plan_with_promise(mission, rules.promise, complete)
    complete(mission)
    return mission


def plan_with_promise(mission: Mission, asked: float | None, complete: Complete) -> Mission:
    """Plan a mission that keeps back as little as keeps a promise, and say how sure it is.

    Where no plan keeps it, the surest is returned. With `planning.turn_back` the promise is that of the plan
    and its rule.

    Args:
        mission: before its first leg, in the forecast, nothing simulated.
        asked: least probability to be home in time, in (0, 1); None to plan as always and see.
        complete: plans a mission to its end.

    Returns:
        The mission at its end; its run has the promise.
    """
    if mission.context.rules.turn_back:
        return _with_turning(mission, asked, complete)
    tried: list[Promised] = []
    kept: float | None = 0.0
    safely = None if asked is None else asked + _surely(asked)
    while True:
        while kept is not None and len(tried) < _PLANS:
            tried.append(planned_with(mission, kept, complete))
            kept = None if safely is None else _next(tried, safely)
        best = max(tried, key=lambda one: _worth(one.share, one.mission.run.total_priority, safely or 0.0))
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


def _with_turning(mission: Mission, asked: float | None, complete: Complete) -> Mission:
    """Plan a mission that leaves out what is late, by the rule that wins most and keeps a promise."""
    aim = _USUAL if asked is None else asked
    first = planned_with(mission, 0.0, complete)
    if first.found is None:
        return first.mission
    # A rule is made to measure: where few members decide, it has to keep more in them.
    members = int(first.found.members.max()) + 1
    safely = min(aim + _surely(aim, members if members > 1 else SEAS), 1.0 - 1.0 / SEAS)
    kept = dict.fromkeys(max(_needed(first, share), 0.0) for share in (0.5, 0.5 * (0.5 + aim), aim))
    tried = [first, *(planned_with(mission, one, complete) for one in kept if one > _ALIKE)]
    found = []
    for one in (plan for plan in tried if plan.found is not None):
        run = one.mission.run
        ways = turning.ways_of(mission, run)
        stakes = Stakes.of(mission, run, ways)
        going = outcomes(mission, run.done, prng.folded(mission.key, _CHOSEN_BY), ways)
        follow = partial(turned, going, stakes=stakes)
        for rule in turning.rules(going, stakes):
            goes = turning.just_keeping(rule, safely, stakes, follow)
            worth = _worth(goes.found.share, goes.priority, safely)
            found.append((worth, one, ways, stakes, goes.rule))
    _, best, ways, stakes, rule = max(found, key=lambda one: one[0])
    run, key = best.mission.run, prng.folded(mission.key, _JUDGED_IN)
    goes = turning.keeping(rule, aim, stakes, lambda rule: ruled(mission, run.done, key, ways, rule))
    promise = promise_of(goes.found, mission, asked, best.kept)
    on = goes.rule.on - mission.now
    until = [max(float(one), 0.0) if np.isfinite(one) else None for one in on]
    run.promise = replace(
        promise,
        latest=(*until, *_latest(best.found, mission, asked)[len(until) :]),
        priority=goes.priority,
        turns=turning.turns(goes, ways, mission.now),
    )
    if not run.promise.kept:
        run.reason += f"; planning.promise {asked:g} is not kept: {run.promise.line} at best"
    return best.mission


def _surely(asked: float, seas: int = SEAS) -> float:
    """Return by how much more a plan is to keep in the seas it is chosen by: the error of that share."""
    return math.sqrt(asked * (1.0 - asked) / seas)


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
            runs.append((run.promise.share, run.total_priority, -one.kept, run))
    runs.sort(key=lambda one: one[:3])
    return [
        run
        for number, (_, priority, _, run) in enumerate(runs)
        if all(priority > other[1] for other in runs[number + 1 :])
    ]


def planned_with(mission: Mission, kept: float, complete: Complete) -> Promised:
    """Plan a mission that leaves a share of its time and energy, and follow it in seas that are drawn."""
    begins, available = mission.now, mission.run.t_available
    one = mission.fork(energy_kept=kept * mission.energy_left if np.isfinite(mission.energy_left) else 0.0)
    one.run.t_available = available - kept * (available - begins)
    complete(one)
    one.run.t_available = available
    unused = (available - one.run.t_mission) / (available - begins)
    if np.isfinite(mission.energy_left):
        unused = min(unused, (one.energy_left + one.energy_kept) / mission.energy_left)
    if not one.run.success:
        return Promised(kept, unused, one, None)
    return Promised(kept, unused, one, outcomes(mission, one.run.done, prng.folded(mission.key, _CHOSEN_BY)))


def promise_of(found: Outcomes, mission: Mission, asked: float | None, kept: float) -> Promise:
    """Return what outcomes of a mission that is about to begin promise."""
    low, high = found.interval
    ends = np.quantile(found.ends - mission.now, [0.05, 0.5, 0.95]).tolist()
    members = int(found.members.max()) + 1
    return Promise(
        asked,
        found.share,
        low,
        high,
        len(found.in_time),
        members,
        tuple(ends),
        kept,
        _latest(found, mission, asked),
    )


def _latest(found: Outcomes, mission: Mission, asked: float | None) -> tuple[float, ...]:
    """Return s after the departure, until when legs have to be over, as `Promise` has them."""
    surely = _USUAL if asked is None else asked
    return tuple((np.quantile(found.latest, 1.0 - surely, axis=0) - mission.now).tolist())


def _worth(share: float, priority: float, asked: float) -> tuple[bool, float, float]:
    """Return what the better of two plans has more of: the promise kept, priority, and how sure it is.

    Of plans that do not keep it, the surest is best.
    """
    kept = share >= asked
    return kept, priority if kept else share, share


def _next(tried: list[Promised], asked: float) -> float | None:
    """Return the next share to keep back, or None where it is found or there is none."""
    last = tried[-1]
    short = [one.kept for one in tried if 0.0 <= one.share < asked]
    several = any(one.found is not None and one.found.members.max() for one in tried)
    if enough := [one for one in tried if one.share >= asked]:
        least = min(enough, key=lambda one: one.kept)
        if not short or (several and len(tried) >= _FEW_PLANS):
            return None
        return _between(max([_needed(least, asked), *short]), least.kept, _MUCH_ALIKE if several else _ALIKE)
    if last.found is None:
        return _between(max(short), last.kept, _ALIKE) if short else None
    # Where a few members decide, a little more time kept back changes nothing: steps grow.
    step = _ALIKE * 2.0 ** (len(short) if several else 0)
    return max(_needed(last, asked), last.kept + step, last.unused + _ALIKE)


def _needed(one: Promised, asked: float) -> float:
    """Return the share to keep back by which a plan that needs as much beyond it just keeps the promise."""
    assert one.found is not None
    return 1.0 - (1.0 - one.kept) / float(np.quantile(one.found.used, asked))


def _between(low: float, high: float, alike: float) -> float | None:
    """Return the middle of two shares that differ by more than what is much the same; else None."""
    return 0.5 * (low + high) if high - low > alike else None
