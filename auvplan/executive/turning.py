"""Turning back: the rule by which a plan leaves out what it no longer has the time for.

From a stop that is left too late the vehicle goes straight to the destination. A plan with this rule can ask
for more than it surely has the time for, and still be home in time.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from auvplan.errors import ScenarioError
from auvplan.executive.context import Mission
from auvplan.executive.legs import begin_legs, finish, go_as_planned, unfit
from auvplan.executive.outcomes import Outcomes
from auvplan.records import LegRecord, MissionRun, TurnBack
from auvplan.runtime import prng

Array = NDArray[np.floating]

#: Shares of the drawn seas in which it is enough time to go on, that rules are tried with: the least that
#: keeps the promise serves.
_SHARES = (0.0, 0.3, 0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.9, 0.925, 0.95, 0.965, 0.98, 0.99, 0.995, 0.999, 1.0)

#: What the keys of plans of ways home are folded with.
_WAYS = 7003


def ways_home(mission: Mission, run: MissionRun) -> list[LegRecord | None]:
    """Plan a leg to the destination from every stop of a plan but the last two.

    From the last but one the plan itself goes there.

    Args:
        mission: before the first leg of the plan, in the forecast, nothing simulated.
        run: the plan.

    Returns:
        A leg each, begun when the stop is left as planned; None where there is no path.

    Raises:
        ScenarioError: the vehicle's position grows uncertain, of which ways home know nothing.
    """
    if mission.context.navigation is not None:
        reason = "is not made for a vehicle whose position grows uncertain: take vehicle.navigation away"
        raise ScenarioError(reason, field="planning.turn_back")
    stops = run.done[:-2]
    if not stops:
        return []
    keys = [prng.folded(prng.folded(mission.key, _WAYS), number) for number in range(len(stops))]
    forks = [
        mission.fork(now=stop.ends, here=stop.goal, run=run, key=key)
        for stop, key in zip(stops, keys, strict=True)
    ]
    records = [LegRecord(stop.goal, run.goal, np.nan, 0.0, 0.0) for stop in stops]
    begin_legs(forks, records)
    fit = [not unfit(fork) for fork in forks]
    go_as_planned(forks)
    for fork in forks:
        finish(fork.active_leg)
    return [record if good else None for record, good in zip(records, fit, strict=True)]


@dataclass(frozen=True)
class Turned:
    """How a plan with its rule goes in D seas.

    Attributes:
        latest: [K] s since the epoch, until when stops are left to go on; infinite where nothing is left out.
        at: [D] number of the leg at whose end the vehicle turns back; K where it does not.
        found: ends and shares of what is available, with the rule.
        priority: mean over the drawn ones.
    """

    latest: Array
    at: NDArray[np.integer]
    found: Outcomes
    priority: float


def turned(found: Outcomes, latest: Array, priorities: Array) -> Turned:
    """Apply a rule to a plan's outcomes.

    Args:
        found: outcomes of the plan, and of its ways home from K stops.
        latest: [K] s since the epoch, until when stops are left to go on.
        priorities: [L], of the plan's legs.
    """
    rows, count, stops = np.arange(len(found.ends)), len(latest), found.stops
    late = np.concatenate([stops[:, :count] > latest, np.ones((len(rows), 1), bool)], axis=1)
    at = late.argmax(axis=1)
    ends = np.concatenate([stops[:, :count] + found.home_travel, found.ends[:, None]], axis=1)[rows, at]
    used = np.concatenate([found.home_used, found.used[:, None]], axis=1)[rows, at]
    won = np.cumsum(priorities * found.done, axis=1)[rows, np.where(at < count, at, len(priorities) - 1)]
    return Turned(latest, at, replace(found, ends=ends, used=used), float(won.mean()))


def latest_to_go_on(found: Outcomes, share: float, available: float) -> Array:
    """Return until when stops are left to go on, [K] s since the epoch.

    Then a share of those drawn leaves the time for the next leg, its task and the way home from there; past
    a stop without a way home, for as many as it takes.

    Args:
        found: outcomes of the plan, and of its ways home from K stops.
        share: in [0, 1]; 0 always goes on.
        available: s since the epoch, when the time is over.
    """
    stops, latest = found.stops, np.full(found.home_travel.shape[1], np.inf)
    home = found.rest[:, len(latest)]  # from the stop after the last way: as planned
    for k in reversed(range(len(latest))):
        ahead = stops[:, k + 1] - stops[:, k] + home
        way = found.home_travel[:, k]
        home = ahead
        if np.isfinite(way).all():
            home = way
            if share > 0.0:
                latest[k] = available - np.quantile(ahead, share)
    return latest


def rules(found: Outcomes, available: float) -> list[Array]:
    """Return rules for a plan, those that turn back more readily later: of each until when stops are left.

    Args:
        found: outcomes of the plan, and of its ways home from K stops.
        available: s since the epoch, when the time is over.
    """
    return [latest_to_go_on(found, share, available) for share in _SHARES]


def keeping(found: Outcomes, asked: float, tried: list[Array], priorities: Array) -> tuple[int, Turned]:
    """Return the first of some rules that keeps a promise: its number, and a plan's outcomes with it.

    Where none does, it is the one that comes nearest.
    """
    with_rules = []
    for number, latest in enumerate(tried):
        with_rules.append(turned(found, latest, priorities))
        if with_rules[-1].found.share >= asked:
            return number, with_rules[-1]
    return max(enumerate(with_rules), key=lambda one: one[1].found.share)


def turns(rule: Turned, ways: list[LegRecord | None], begins: float) -> tuple[TurnBack, ...]:
    """Return a rule as it is kept with the plan, times counted from the departure."""
    kept = []
    for number, (way, latest) in enumerate(zip(ways, rule.latest, strict=True)):
        if way is not None and np.isfinite(latest):
            points = np.asarray(way.positions, float).round(2).tolist()
            kept.append(
                TurnBack(
                    number,
                    float(latest) - begins,
                    float((rule.at == number).mean()),
                    way.t_path,
                    tuple(map(tuple, points)),
                )
            )
    return tuple(kept)
