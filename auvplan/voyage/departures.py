"""When to leave: one mission or one leg planned at many departures, each in the sea as it is then."""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan import prng
from auvplan.brief import Brief
from auvplan.errors import ScenarioError
from auvplan.mission import MissionOrder
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathPlan, PathPlans, plan_paths
from auvplan.site import Site
from auvplan.voyage.clock import Clock
from auvplan.voyage.closures import why_no_order
from auvplan.voyage.executive import embark as embark
from auvplan.voyage.executive import make_fleet
from auvplan.voyage.fleet import Fleet, Mission
from auvplan.voyage.order_calls import plan_orders, time_edges
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.sea import stacked
from auvplan.voyage.simulator import over_ground
from auvplan.voyage.waters import Waters
from auvplan.words import counted, figure

Array = NDArray[np.float64]

#: Called with how many departures are seen to, of how many, and what is done.
Progress = Callable[[int, int, str], None]

#: Places along a leg at which the current's strength is looked up.
_PLACES = 33


@dataclass(frozen=True, repr=False)
class Departures(Brief):
    """D departures of one mission or leg.

    Attributes:
        departs: [D] s since the scenario's epoch.
        feasible: [D] bool, whether the destination is reached in time and every limit kept.
        time: [D] s, expected of the mission, or travel time of the leg; NaN where it is not feasible.
        tasks: [D] tasks of the order; 0 of a leg.
        priority: [D] their total priority; 0 of a leg.
        current: [D] m/s, told of the departure: mean level speed at the waypoints or along the leg.
        reasons: D lines on what stands against it; empty where it is feasible.
        orders: D orders of tasks, None where there is none; None of a leg.
        plans: D path plans of a leg; None of a mission.
        site: where and when local coordinates begin, or None.
        names: of the waypoints; empty where they have none.
    """

    departs: Array
    feasible: NDArray[np.bool_]
    time: Array
    tasks: NDArray[np.int_]
    priority: Array
    current: Array
    reasons: tuple[str, ...]
    orders: tuple[MissionOrder | None, ...] | None = None
    plans: PathPlans | None = None
    site: Site | None = None
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.departs)

    def _facts(self) -> dict[str, str]:
        count = f"{self.feasible.sum():,} of {counted(len(self), 'departure')} feasible"
        if (best := self.best) is None:
            return {"": count}
        return {
            "": count,
            "best": self.moment(best),
            "time": f"{self.time[best]:,.0f} s",
            **({} if self.orders is None else {"priority": figure(float(self.priority[best]), 6)}),
        }

    @property
    def best(self) -> int | None:
        """The feasible departure of most total priority, then least time, then the earliest; None without."""
        rank = np.lexsort((self.departs, self.time, -self.priority, ~self.feasible))
        return int(rank[0]) if self.feasible.any() else None

    def moment(self, k: int) -> str:
        """Departure k for people: UTC to the minute, or hours after the scenario's."""
        return moment_name(self.site, float(self.departs[k]))


def plan_departures(
    scenario: Scenario,
    departs: ArrayLike,
    *,
    key: jax.Array,
    folder: str | Path | None = None,
    waters: Waters | None = None,
    progress: Progress | None = None,
) -> Departures:
    """Plan a mission, or the leg where the scenario has two waypoints, for each of D departures.

    Waypoints, tasks and chance are the same at every departure; the sea differs. A mission's order is the one
    that `run_mission` would begin with, its travel times those of the sea at departure. A leg is planned
    through the current as it will be on the way; the obstacles of either, met on the way, are left out.

    Args:
        scenario: settings.
        departs: [D] s since the scenario's epoch; negative ones need currents from files.
        key: PRNG key of waypoints, sea and planners, as for `run_mission`.
        folder: that relative paths in the scenario start from; that of its file if absent.
        waters: what the scenario's files tell, as `load_waters_at` reads it; read here if absent.
        progress: called as departures are seen to.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built, or its current is not
            known from the first departure until the last one's time available is over.
    """
    moments, key = np.asarray(departs, float), prng.as_key(key)
    if moments.ndim != 1 or not len(moments) or not np.isfinite(moments).all():
        raise ScenarioError(f"departs must be [D] finite seconds, D at least 1, got shape {moments.shape}")
    # Planning is done before the departure: it costs the mission no time.
    planning = scenario.planning.model_copy(update={"charge_compute": False})
    scenario = scenario.model_copy(update={"planning": planning})
    if waters is None:
        waters = load_waters_at(scenario, moments, folder)
    _require_known(scenario, waters, moments)
    fleet = replace(make_fleet(scenario, folder, waters), clock=_Stopwatch())
    missions = _leaving(fleet, key, moments)
    single = missions[0].graph.size == 2 and waters.jobs is None
    return (_plan_legs if single else _order_tasks)(fleet, missions, progress)


def load_waters_at(scenario: Scenario, departs: ArrayLike, folder: str | Path | None = None) -> Waters:
    """`load_waters` for missions that leave at other times: currents are read for all of them, not one.

    Args:
        scenario: settings.
        departs: [D] s since the scenario's epoch, which stays the epoch of what is read.
        folder: that relative paths in the scenario start from; that of its file if absent.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: as `load_waters`.
    """
    from auvplan.io.waters import load_waters

    moments, site = np.asarray(departs, float), scenario.site
    first, last = float(moments.min()), float(moments.max()) + scenario.mission.time_available
    if scenario.current.source != "file" or site is None or site.departure is None:
        waters = load_waters(scenario, folder, until=last)
        _require_known(scenario, waters, moments)
        return waters
    # What lies between the scenario's own departure and the first of these need not be covered.
    leaving = site.model_copy(update={"departure": site.departure + timedelta(seconds=first)})
    waters = load_waters(scenario.model_copy(update={"site": leaving}), folder, until=last - first)
    assert waters.forecast is not None
    assert waters.truth is not None
    return replace(
        waters,
        site=site.site,
        forecast=replace(waters.forecast, times=waters.forecast.times + first),
        truth=replace(waters.truth, times=waters.truth.times + first),
    )


def moment_name(site: Site | None, seconds: float) -> str:
    """A local time for people: UTC to the minute, or hours where there is no date."""
    moment = None if site is None else site.utc(round(seconds / 60.0) * 60.0)
    return f"{seconds / 3600.0:+.2f} h" if moment is None else f"{moment:%Y-%m-%d %H:%M} UTC"


class _Stopwatch(Clock):
    """Times calls without making any of them twice: compilation is no matter here."""

    def time(self, call: Callable[[], Any]) -> tuple[Any, float]:
        return call(), 0.0


def _require_known(scenario: Scenario, waters: Waters, departs: Array) -> None:
    """Refuse departures at which the current is not known.

    Raises:
        ScenarioError: one line that names the times.
    """
    first, last = departs.min(), departs.max() + scenario.mission.time_available
    field, name = waters.forecast, partial(moment_name, waters.site)
    if field is None:
        if first < 0.0:
            raise ScenarioError(
                f"departure {name(first)} lies before the scenario's, with which its vortices begin"
            )
    elif not field.steady and scenario.current.outside == "refuse":
        begin, end = float(field.times[0]), float(field.times[-1])
        slack = 1e-6 * max(abs(begin), abs(end))  # times are kept in single precision
        if first < begin - slack or last > end + slack:
            raise ScenarioError(
                f"departures and the time available reach from {name(first)} to {name(last)}, "
                f"the current's data from {name(begin)} to {name(end)}"
            )


def _leaving(fleet: Fleet, key: jax.Array, departs: Array) -> list[Mission]:
    """One mission a departure: the same but for the time and the sea as it is then."""
    model = embark(fleet, 0, key, 0)
    missions = {}
    for number in np.argsort(departs, kind="stable").tolist():
        now = float(departs[number])
        model.sea.advance(now)
        run = replace(model.run, t_available=now + model.run.t_available, orders=[], legs=[])
        own = {
            "run": run,
            "sea": copy(model.sea),
            "now": now,
            "learnt": {},
            "visited": set(),
            "barred": set(),
        }
        missions[number] = replace(model, number=number, **own)
    return [missions[number] for number in range(len(departs))]


def _circumstances(missions: Sequence[Mission]) -> dict[str, Any]:
    """Fields of `Departures` that no planning goes into, by name."""
    run, places = missions[0].run, np.asarray(missions[0].graph.positions)
    if len(places) == 2:
        places = np.linspace(places[0], places[1], _PLACES)
    still, adrift = np.zeros_like(places), np.ones(len(places))
    speeds = []
    for mission in missions:
        told = copy(mission.sea).told()
        water = over_ground(told, places, still, adrift, now=mission.now)
        speeds.append(float(np.hypot(water[:, 0], water[:, 1]).mean()))
    return {
        "departs": np.asarray([mission.now for mission in missions]),
        "current": np.asarray(speeds),
        "site": run.site,
        "names": tuple(run.names),
    }


def _plan_legs(fleet: Fleet, missions: list[Mission], progress: Progress | None) -> Departures:
    """One call of the path planner for all departures."""
    count, run = len(missions), missions[0].run
    if progress:
        progress(0, count, "planning paths")
    common = _circumstances(missions)
    none = jax.tree.map(lambda leaf: np.zeros((count, *leaf.shape), leaf.dtype), Obstacles.none())
    start, goal = (np.tile(run.graph.positions[end], (count, 1)) for end in (run.start, run.goal))
    plans = plan_paths(
        start,
        goal,
        fleet.environment(stacked([mission.sea.told() for mission in missions]), none),
        fleet.vehicle,
        key=prng.stacked([mission.path_key() for mission in missions]),
        config=fleet.path_config,
        depart=common["departs"],
        world_per_leg=True,
    )
    reasons = tuple(_fault(plan, fleet.scenario.mission.time_available, run.site) for plan in plans)
    feasible = np.asarray([not reason for reason in reasons])
    return Departures(
        feasible=feasible,
        time=np.where(feasible, plans.travel_time, np.nan),
        tasks=np.zeros(count, int),
        priority=np.zeros(count),
        reasons=reasons,
        plans=plans,
        **common,
    )


def _fault(plan: PathPlan, available: float, site: Site | None) -> str:
    """The limit that a leg breaks most, where and when; or an empty string."""
    if not plan.feasible:
        return plan.explain(plan.broken()[0], site and site.epoch)
    late = plan.travel_time >= available
    return f"the leg takes {plan.travel_time:.0f} s, {available:.0f} s are available" if late else ""


def _order_tasks(fleet: Fleet, missions: list[Mission], progress: Progress | None) -> Departures:
    """Travel times at each departure, then one call of the mission planner for all of them."""
    common = _circumstances(missions)
    # Copies are told again what the estimates were told.
    seas = [copy(mission.sea) for mission in missions]
    for number, mission in enumerate(missions):
        if progress:
            progress(number, len(missions), "estimating travel times")
        time_edges(fleet, [mission])
    if progress:
        progress(len(missions), len(missions), "ordering tasks")
    timed = [mission.timed for mission in missions]
    plan_orders(fleet, missions)
    orders: list[MissionOrder | None] = []
    reasons = []
    for mission, sea, graph in zip(missions, seas, timed, strict=True):
        nodes = mission.rest
        # An order may count on edges that the sea closes, for which a path may be found yet: not here.
        closed = mission.ended or not graph.adjacency[nodes[:-1], nodes[1:]].all()
        orders.append(None if closed else mission.order)
        reasons.append(why_no_order(fleet, mission, graph, sea.told()) if closed else "")

    def figures(name: str, missing: float) -> Array:
        return np.asarray([missing if order is None else getattr(order, name) for order in orders], float)

    return Departures(
        feasible=np.asarray([order is not None for order in orders]),
        time=figures("time", np.nan),
        tasks=figures("tasks", 0).astype(int),
        priority=figures("priority", 0.0),
        reasons=tuple(reasons),
        orders=tuple(orders),
        **common,
    )
