"""Rules by which a plan leaves out what it no longer has the time for.

From a stop that is left late the vehicle goes past the next task to the one after, or straight to the
destination. A plan with such a rule can ask for more than it surely has the time for, and still be home in
time. Rules are found backwards from the destination, over seas that are drawn (stochastic dynamic
programming): at every stop and time that is done which wins most, less what coming late costs. The more that
is, the surer the vehicle is home.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from auvplan.errors import ScenarioError
from auvplan.executive.context import Mission
from auvplan.executive.legs import begin_legs, finish, go_as_planned, unfit
from auvplan.executive.outcomes import Outcomes, Rule, Ruled, Ways
from auvplan.records import LegRecord, MissionRun, TurnBack
from auvplan.runtime import prng
from auvplan.runtime.arrays import Array

#: What coming late costs, in shares of a plan's priority, that rules are made with.
_COSTS = tuple((0.03 * 2.0 ** np.arange(11)).tolist())

#: Shares of the time by which stops are left later or earlier than by a rule at most, and times that what
#: lies between is halved.
_LATER, _EARLIER, _HALVED = 0.1, 0.5, 12

#: The same, of rules that are close to keeping a promise.
_STEPS = 0.001, 0.002, 0.004, 0.007, 0.01, 0.015, 0.02, 0.03, 0.05, 0.07, 0.1, 0.2

#: Moments at which a stop may be left that are distinguished, and every which sea rules are made in.
_MOMENTS, _SEAS = 300, 2

#: Worth of what cannot be done; sums with it keep their digits.
_NEVER = -1e6

#: What the keys of plans of ways to the destination, and past a task, are folded with.
_HOME, _PAST = 7003, 7004


def ways_of(mission: Mission, run: MissionRun) -> Ways:
    """Plan a leg to the destination from every stop of a plan but the last two, and one past the next task.

    From the last but one the plan itself goes to the destination; past the last task that is the same.

    Args:
        mission: before the first leg of the plan, in the forecast, nothing simulated.
        run: the plan.

    Returns:
        Legs, begun when the stop is left as planned; None where there is no path.

    Raises:
        ScenarioError: the vehicle's position grows uncertain, of which such legs know nothing.
    """
    if mission.context.navigation is not None:
        reason = "is not made for a vehicle whose position grows uncertain: take vehicle.navigation away"
        raise ScenarioError(reason, field="planning.turn_back")
    legs, graph = run.done, run.graph
    home = [LegRecord(stop.goal, run.goal, np.nan, 0.0, 0.0) for stop in legs[:-2]]
    past = []
    for stop, after in zip(legs[:-3], legs[2:-1], strict=True):
        edge = stop.goal, after.goal
        task = np.asarray(graph.adjacency)[edge] and not after.revisit and after.priority > 0.0
        lasts, rho = (float(of[edge]) if task else 0.0 for of in (graph.duration, graph.priority))
        under_way = mission.context.scenario.tasks_under_way
        past.append(LegRecord(*edge, np.nan, 0.0 if under_way else lasts, rho))
    return Ways(_planned(mission, run, past, _PAST), _planned(mission, run, home, _HOME))


def _planned(mission: Mission, run: MissionRun, records: list[LegRecord], key: int) -> list[LegRecord | None]:
    """Plan legs, one from each of the first stops of a plan; None where there is no path."""
    if not records:
        return []
    keyed = prng.folded(mission.key, key)
    forks = [
        mission.fork(now=stop.ends, here=stop.goal, run=run, key=prng.folded(keyed, number))
        for number, (stop, _) in enumerate(zip(run.done, records, strict=False))
    ]
    begin_legs(forks, records)
    fit = [not unfit(fork) for fork in forks]
    go_as_planned(forks)
    for fork in forks:
        finish(fork.active_leg)
    return [record if good else None for record, good in zip(records, fit, strict=True)]


class Stakes(NamedTuple):
    """What a plan may win, and by when.

    Attributes:
        priorities: [L], of the tasks at the ends of its legs.
        past: [K], of those at the ends of the legs past a task.
        begins, available: s since the epoch, when it begins and when its time is over.
    """

    priorities: Array
    past: Array
    begins: float
    available: float

    @classmethod
    def of(cls, mission: Mission, run: MissionRun, ways: Ways) -> "Stakes":
        """Those of a planned mission."""
        priorities = np.asarray([leg.priority for leg in run.done])
        past = np.asarray([0.0 if leg is None else leg.priority for leg in ways.past])
        return cls(priorities, past, mission.now, run.t_available)


def rules(found: Outcomes, stakes: Stakes) -> list[Rule]:
    """Return rules for a plan: one by which nothing is left out, and more as coming late costs more.

    Args:
        found: outcomes of the plan, and of its ways from K stops.
        stakes: of the plan.
    """
    never = np.full(found.home.shape[1], np.inf)
    costs = _COSTS if len(never) else ()
    scale = max(float(stakes.priorities.sum()), 1.0)
    return [Rule(never, never), *(_rule(found, stakes, scale * cost) for cost in costs)]


def _rule(found: Outcomes, stakes: Stakes, cost: float) -> Rule:
    """Return the rule that wins most, less what coming late costs; from the destination backwards."""
    seas = slice(None, None, _SEAS)
    moments = np.linspace(stakes.begins, stakes.available, _MOMENTS)
    step, last = moments[1] - moments[0], found.stops.shape[1] - 1
    won, skipped = (part[seas] for part in _won(found, stakes))
    lasts, home, past = np.diff(found.stops, axis=1)[seas], found.home[seas], found.past[seas]

    def ahead(worth: Array, lasts: Array) -> Array:
        """Worth [D, M] of what comes after as long in each sea; linear, late past the last moment."""
        whole, part = np.divmod(lasts[:, None] / step, 1.0)
        index = np.minimum(np.arange(_MOMENTS) + whole.astype(int), _MOMENTS)
        late = np.concatenate([worth, np.full((len(worth), 2), -cost)], axis=1)
        near, far = (np.take_along_axis(late, index + more, axis=1) for more in (0, 1))
        return (1.0 - part) * near + part * far

    there: Array = np.zeros((len(lasts), _MOMENTS))  # worth at the destination
    nowhere: Array = np.full(there.shape, _NEVER)
    worth: dict[int, Array] = {last: there}  # at each stop, from the last on
    until = np.full((2, home.shape[1]), np.inf)
    for k in reversed(range(last)):
        on = won[:, k + 1, None] + ahead(worth[k + 1], lasts[:, k])
        if k >= home.shape[1]:
            worth[k] = on
            continue
        back, skip = nowhere, nowhere
        if np.isfinite(home[:, k]).all():
            back = ahead(there, home[:, k])
        if k < past.shape[1] and np.isfinite(past[:, k]).all():
            skip = skipped[:, k, None] + ahead(worth[k + 2], past[:, k])
        times = found.stops[seas, k]
        here = [
            nowhere[:, 0] if way is nowhere else ahead(way, times - stakes.begins)[:, 0]
            for way in (on, skip, back)
        ]
        until[:, k] = until_when(times, *here)
        goes_on, skips = np.searchsorted(moments, until[:, k], side="right")
        worth[k] = np.concatenate([on[:, :goes_on], skip[:, goes_on:skips], back[:, skips:]], axis=1)
    return Rule(*until)


def _won(found: Outcomes, stakes: Stakes) -> tuple[Array, Array]:
    """Return priorities that tasks win as they go without a rule [D, L], and those past a task [D, K]."""
    past = np.broadcast_to(stakes.past[: found.past.shape[1]] - found.lost[1], found.past.shape)
    return (stakes.priorities - found.lost[0]) * found.done, past


def until_when(times: Array, on: Array, past: Array, home: Array) -> tuple[float, float]:
    """Return until when a stop is best left to go on, and past the next task, s.

    Args:
        times: [D] s, when it is left.
        on, past, home: [D], what it is worth to go on then, past a task and to the destination.
    """
    order = np.argsort(times)
    sums = [np.concatenate([[0.0], np.cumsum(worth[order])]) for worth in (on, past, home)]
    # The first n go on, those up to the m-th past the task.
    rest = (sums[1] - sums[2])[::-1]
    best = np.maximum.accumulate(rest)[::-1]
    n = len(times) - int((sums[0] - sums[1] + best)[::-1].argmax())
    m = len(times) - int(rest[: len(times) + 1 - n].argmax())
    ordered = np.concatenate([[times.min() - 1.0], times[order], [np.inf]])
    until = [0.5 * (ordered[k] + ordered[k + 1]) for k in (n, m)]
    return until[0], until[1]


def turned(found: Outcomes, rule: Rule, stakes: Stakes) -> Ruled:
    """Apply a rule to a plan's outcomes: what comes later takes as long as it did without the rule.

    That is so but for currents that change meanwhile and windows, which `outcomes.ruled` follows too.

    Args:
        found: outcomes of the plan, and of its ways from K stops.
        rule: for it.
        stakes: of the plan.
    """
    seas, count = found.home.shape
    lasts, (won_on, skipped) = np.diff(found.stops, axis=1), _won(found, stakes)
    now, won = found.stops[:, 0].copy(), won_on[:, 0].copy()
    kinds, there = np.full((seas, count), -1), np.zeros(seas, int)
    none = np.zeros((seas, lasts.shape[1] + 1))
    energy, on, past, home = found.spent or (none[:, 0], none, none, none)
    spent = energy + on[:, 0]
    for k in range(lasts.shape[1]):
        here, kind = there == k, np.zeros(seas, int)
        if k < count:
            kind = np.where(now <= rule.on[k], 0, np.where(now <= rule.past[k], 1, 2))
            kinds[here, k] = kind[here]
        go, skip, back = (here & (kind == one) for one in range(3))
        now[go] += lasts[go, k]
        won[go] += won_on[go, k + 1]
        spent[go] += on[go, k + 1]
        there[go] = k + 1
        if k < found.past.shape[1]:
            now[skip] += found.past[skip, k]
            won[skip] += skipped[skip, k]
            spent[skip] += past[skip, k]
            there[skip] = k + 2
        if k < count:
            now[back] += found.home[back, k]
            spent[back] += home[back, k]
            there[back] = lasts.shape[1]
    used = np.maximum((now - stakes.begins) / (stakes.available - stakes.begins), spent)
    return Ruled(rule, kinds, replace(found, ends=now, used=used), float(won.mean()))


def just_keeping(rule: Rule, asked: float, stakes: Stakes, follow: Callable[[Rule], Ruled]) -> Ruled:
    """Return how a plan goes by a rule with its moments as much later or earlier as just keeps a promise.

    Where none keeps it, it is how it goes with the earliest.
    """
    if not np.isfinite(rule.on).any():
        return follow(rule)
    time = stakes.available - stakes.begins
    low, high = -_LATER * time, _EARLIER * time
    best = follow(rule.earlier(high))
    for _ in range(_HALVED if best.found.share >= asked else 0):
        middle = 0.5 * (low + high)
        found = follow(rule.earlier(middle))
        if found.found.share >= asked:
            best, high = found, middle
        else:
            low = middle
    return best


def keeping(rule: Rule, asked: float, stakes: Stakes, follow: Callable[[Rule], Ruled]) -> Ruled:
    """Return how a plan goes by a rule that is close to keeping a promise, with its moments a little earlier.

    Where none keeps it, it is the one by which it comes nearest.
    """
    best, time = follow(rule), stakes.available - stakes.begins
    for share in _STEPS if np.isfinite(rule.on).any() else ():
        if best.found.share >= asked:
            break
        best = max(best, follow(rule.earlier(share * time)), key=lambda one: one.found.share)
    return best


def turns(followed: Ruled, ways: Ways, begins: float) -> tuple[TurnBack, ...]:
    """Return a rule as it is kept with the plan, times counted from the departure."""
    kept = []
    for number, (on, past) in enumerate(zip(*followed.rule, strict=True)):
        skips = past > on
        both = ((1, ways.past[number] if skips else None, on), (2, ways.home[number], past))
        for kind, way, latest in both:
            if way is not None and np.isfinite(latest):
                points = np.asarray(way.positions, float).round(2).tolist()
                share = float((followed.kind[:, number] == kind).mean())
                leads = None if kind == 2 else number + 2
                times = max(float(latest) - begins, 0.0), share, way.t_path
                kept.append(TurnBack(number, *times, tuple(map(tuple, points)), leads))
    return tuple(kept)
