"""Re-plans of paths under way (section 3.2.2): what is offered, and when it replaces the plan in hand.

A plan in hand is replaced by one that is faster by more than a share, both judged in one forecast from where
the vehicle is, or because it breaks a limit that the new one keeps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from auvplan.executive.context import HORIZON, Array, Leg, Mission
from auvplan.executive.path_calls import Offer, offered, take
from auvplan.ocean.currents import Current
from auvplan.path import PathPlan
from auvplan.path.motion import progress_along
from auvplan.path.outlook import Outlook, outlook

#: A path that takes this many times as long as its leg was expected to is planned again.
DETOUR = 1.2

#: A re-plan that takes this many times as long as what was left is polished further before it is followed.
FURTHER = 1.3

#: A current that was met and differs from the plan's by more than this share of the vehicle's speed counts
#: beside it, for two looks.
WRONG = 0.5

#: Whether a plan meets an obstacle within the look-ahead, and whether it breaks another limit.
_Standing = tuple[bool, bool]


@dataclass
class Review:
    """A plan in hand that is looked at again.

    Attributes:
        mission: at a place on its leg.
        cause: "window" or "hazard".
        forecast: in which all plans are made and judged.
        rest: of the plan in hand; None where the vehicle has left its path.
        standing: of the plan in hand.
        offers: plans that may replace it.
    """

    mission: Mission
    cause: str
    forecast: Current
    rest: Outlook | None
    standing: _Standing
    offers: list[Offer] = field(default_factory=list)

    @property
    def best(self) -> tuple[_Standing, Offer]:
        """The fastest of the offers that stand best, and how it stands."""
        return min(
            ((_standing(self.mission, offer.plan), offer) for offer in self.offers),
            key=lambda pair: (pair[0], pair[1].plan.travel_time),
        )

    @property
    def wants_more(self) -> bool:
        """Whether what would be followed is a long way round, or meets an obstacle."""
        standing, offer = self.best
        slow = self.rest is not None and offer.plan.travel_time > FURTHER * self.rest.time_left
        return standing[0] or (slow and standing < self.standing)

    def settle(self) -> None:
        """Follow the best offer, or keep the plan in hand."""
        leg, (standing, offer) = self.mission.active_leg, self.best
        seconds = sum(other.seconds for other in self.offers)
        if self.rest is not None:
            enough = (1.0 - self.mission.context.rules.window_change) * self.rest.time_left
            faster = offer.plan.travel_time < enough
            if standing > self.standing or (standing == self.standing and not faster):
                leg.keep(self.rest.times)
                leg.record.plans[-1].cpu += seconds
                return
        take(self.mission, replace(offer, seconds=seconds))


def review(mission: Mission, cause: str) -> Review:
    """Judge the plan in hand in the forecast of now, from where the vehicle is."""
    context, leg, forecast = mission.context, mission.active_leg, mission.sea.forecast()
    if leg.escaping:
        return Review(mission, cause, forecast, None, (True, True))
    sample = float(np.interp(leg.arc, leg.marks, np.arange(len(leg.marks))))
    common = mission.vehicle, context.path_config, context.area.closures
    rest = outlook(leg.followed, sample, mission.now, forecast, *common)
    return Review(mission, cause, forecast, rest, (hazard(mission, context.lookahead), rest.broken))


def holds(one: Review) -> bool:
    """Return whether the plan in hand still does what it was planned to do, by the forecast of now."""
    least = one.mission.context.rules.window_change
    if least == 0.0 or one.rest is None or detours(one.mission.active_leg):
        return False
    return one.rest.change < least and not any(one.standing)


def detours(leg: Leg) -> bool:
    """Return whether the followed path takes much longer than was expected of the leg."""
    return leg.followed.travel_time > DETOUR * (leg.record.t_expected - leg.record.t_task)


def hazard(mission: Mission, horizon: float = HORIZON) -> bool:
    """Return whether the belief sees the followed plan meet a collision boundary within a horizon, s.

    Where the current that was met is far from the plan's (`WRONG`), also whether it does so within two looks,
    at the times that this current makes.
    """
    leg, plan = mission.active_leg, mission.active_leg.followed
    arc = 0.0 if leg.escaping else leg.arc

    def meets(times: Array, horizon: float) -> bool:
        # The sea may have made the vehicle late: what counts is the time left on the plan from where it is.
        times = mission.now + times - np.interp(arc, leg.marks, times)
        return _meets(mission, plan.positions, times, horizon)

    if meets(_times(plan, mission.speed), horizon):
        return True
    if leg.met is None or not len(plan.water):
        return False
    step = min(int(np.searchsorted(leg.marks, arc, side="right")), len(plan.water)) - 1
    wrong = leg.met - np.asarray(plan.water, float)[step]
    if np.linalg.norm(wrong) <= WRONG * mission.speed:
        return False
    look = 2.0 * mission.context.scenario.sensors.interval
    return meets(_times(plan, mission.speed, wrong), min(look, horizon))


def _times(plan: PathPlan, speed: float, wrong: Array | None = None) -> Array:
    """Return s [S] at which a vehicle that makes a speed through the water, m/s, is at a plan's places.

    Args:
        wrong: [3] m/s by which the current differs from the plan's, or None.
    """
    planned = float(np.asarray(plan.conditions.vehicle.speed))
    if wrong is None and np.isclose(speed, planned, rtol=1e-3):
        return plan.times
    steps = np.diff(np.asarray(plan.positions, float), axis=0)
    water = np.asarray(plan.water) if wrong is None else np.asarray(plan.water, float) + wrong
    _, ground = progress_along(plan.conditions.config.speed_reading, speed, steps, water)
    ground = ground if wrong is None else np.fmax(ground, 1e-3)
    return plan.times[0] + np.concatenate([[0.0], np.cumsum(np.linalg.norm(steps, axis=1) / ground)])


def _standing(mission: Mission, plan: PathPlan) -> _Standing:
    # Obstacles further away do not count: they move, and are known better from near.
    others = set(plan.broken()) - {"obstacle"}
    return _meets(mission, plan.positions, plan.times, mission.context.lookahead), bool(others)


def _meets(mission: Mission, positions: np.ndarray, times: np.ndarray, horizon: float) -> bool:
    """Return whether a path [n, 3] m, [n] s meets a believed collision boundary within a horizon, s."""
    now, until = mission.now, mission.now + horizon
    inner = times[(times > now) & (times < until)]
    moments = np.clip(np.concatenate([[now], inner, [until]]), times[0], times[-1])
    places = np.stack([np.interp(moments, times, axis) for axis in positions.T], axis=1)
    return bool(mission.active_leg.belief.clearance(places, moments).min() < 0.0)


def replan(reviews: Sequence[Review]) -> None:
    """Offer plans in place of those in hand, and follow them where they are better.

    Differences from the paper:
        It follows what a window finds. Here a path that is slower than the rest of the old one is left,
        under the paper's preset either: a few generations from a transferred population may lose to it.
    """
    _offer(reviews)
    _offer([one for one in reviews if one.wants_more], cold=True)
    for one in reviews:
        one.settle()


def _offer(reviews: Sequence[Review], cold: bool = False) -> None:
    """Make one more offer in each review."""
    if not reviews:
        return
    rules, missions = reviews[0].mission.context.rules, [one.mission for one in reviews]
    causes, forecasts = [one.cause for one in reviews], [one.forecast for one in reviews]
    made = offered(missions, causes, cold or rules.replan_from == "fresh", not rules.second_look, forecasts)
    for one, offer in zip(reviews, made, strict=True):
        one.offers.append(offer)
