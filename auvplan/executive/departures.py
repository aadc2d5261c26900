"""When to leave: one mission or one leg planned at many departures, each in the current of its time.

Of a departure that is not feasible it is said why: the leg without a path, or the time that is too short.
"""

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.energy import energy_of_plan
from auvplan.errors import ScenarioError
from auvplan.executive.context import Mission, MissionContext
from auvplan.executive.loop import complete
from auvplan.executive.planning import (
    leaving,
    load_area_at,
    moment_name,
    planning_context,
    require_known,
    require_read,
)
from auvplan.executive.promise import planned
from auvplan.executive.route_calls import effort
from auvplan.mission.graph import shortest_path
from auvplan.ocean.currents import Current
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathPlans, plan_paths
from auvplan.path.follow import straight_plan
from auvplan.path.sensitivity import Conditions
from auvplan.runtime import prng
from auvplan.runtime.arguments import check_choice, instance, numbers
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import ReprMixin, counted, figure
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.sea import stacked
from auvplan.simulation.simulator import over_ground
from auvplan.site import Site

#: s added to the time of a closed edge, so that the shortest way has the fewest of them.
_CLOSED = 1e7

#: Called with how many departures are seen to, of how many, and what is done.
Progress = Callable[[int, int, str], None]

#: Places along a leg at which the current's strength is looked up.
_PLACES = 33


@dataclass(frozen=True, repr=False, eq=False)
class Departures(ReprMixin):
    """D departures of one mission or leg.

    Attributes:
        departs: [D] s since the scenario's epoch.
        feasible: [D] bool, whether the destination is reached in time and every limit kept.
        time: [D] s, expected of the mission, or travel time of the leg; NaN where it is not feasible.
        tasks: [D] tasks of the route; 0 of a leg.
        priority: [D] their total priority; 0 of a leg.
        current: [D] m/s, at the departure: mean level speed at the waypoints or along the leg.
        reasons: D lines on what stands against it; empty where it is feasible.
        routes: waypoints in the order of visit of each, None where it is not feasible; None where there are
            plans.
        plans: D path plans of a leg; None of a mission, and of a leg with a limit on charge or position, or
            with a range of speeds, which is planned as a mission is.
        site: where and when local coordinates begin, or None.
        names: of the waypoints; empty where they have none.
        energy: [D] Wh that it takes, NaN where it is not feasible; None without a power model.
        least: "time" or "energy", what the best departure has least of among those of most priority.
    """

    departs: Array
    feasible: NDArray[np.bool_]
    time: Array
    tasks: NDArray[np.int_]
    priority: Array
    current: Array
    reasons: tuple[str, ...]
    routes: tuple[list[int] | None, ...] | None = None
    plans: PathPlans | None = None
    site: Site | None = None
    names: tuple[str, ...] = ()
    energy: Array | None = None
    least: Literal["time", "energy"] = "time"

    def __len__(self) -> int:
        return len(self.departs)

    def _repr_items(self) -> dict[str, str]:
        count = f"{self.feasible.sum():,} of {counted(len(self), 'departure')} feasible"
        if (best := self.best) is None:
            return {"": count}
        return {
            "": count,
            "best": self.moment(best),
            "time": f"{self.time[best]:,.0f} s",
            **({} if self.routes is None else {"priority": figure(float(self.priority[best]), 6)}),
        }

    @property
    def best(self) -> int | None:
        """The feasible departure of most total priority, then least time or energy, then the earliest.

        None without one.
        """
        rank = np.lexsort((self.departs, getattr(self, self.least), -self.priority, ~self.feasible))
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
    area: OperatingArea | None = None,
    progress: Progress | None = None,
    least: Literal["time", "energy"] = "time",
) -> Departures:
    """Plan a mission, or the leg where the scenario has two waypoints, for each of D departures.

    Waypoints, tasks and chance are the same at every departure; the current differs. A mission is planned as
    `plan_scenario` plans it, in the current forecast for the transit. So is a leg; one without limits on
    charge and position and without a range of speeds is taken to be begun at once, not after a wait.

    Args:
        scenario: settings.
        departs: [D] s since the scenario's epoch; negative ones need currents from files.
        key: PRNG key of waypoints, sea and planners, as for `run_mission`.
        folder: that relative paths in the scenario start from; that of its file if absent.
        area: what the scenario's files contain, as `load_area_at` reads it; read here if absent.
        progress: called as departures are seen to.
        least: what the best one has least of; energy needs a vehicle with a power model.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built, or its current is not
            known from the first departure until the last one's time available is over.
        ValueError: `least` is none of the two.
        TypeError: departures are no numbers, the key is none, or the scenario a file's name.
    """
    instance("scenario", scenario, Scenario, "ap.load_scenario(...)")
    check_choice("least", least, ("time", "energy"))
    if least == "energy" and scenario.vehicle.power is None:
        raise ScenarioError("departures by energy need a vehicle with a power model: give vehicle.power")
    moments, key = numbers("departs", departs), prng.as_key(key)
    if moments.ndim != 1 or not len(moments) or not np.isfinite(moments).all():
        raise ScenarioError(f"departs must be [D] finite seconds, D at least 1, got shape {moments.shape}")
    if area is None:
        area = load_area_at(scenario, moments, folder)
    require_known(scenario, area, moments)
    require_read(scenario, area, moments)
    context = planning_context(scenario, folder, area)
    if _is_path_alone(context):
        return replace(_plan_legs(leaving(context, key, moments), progress), least=least)
    contexts = [planning_context(scenario, folder, area, float(depart)) for depart in moments]
    missions = [leaving(context, key, [now])[0] for context, now in zip(contexts, moments, strict=True)]
    return replace(_plan_missions(missions, progress), least=least)


def _is_path_alone(context: MissionContext) -> bool:
    """Return whether the path of one leg is all that there is to plan.

    Then there are no tasks, no speeds to choose among, no promise, no limit on charge or position.
    """
    scenario, power, fixes = context.scenario, context.power, context.fixes
    if scenario.mission.waypoints != 2 or context.area.jobs is not None or scenario.planning.promises:
        return False
    chosen = context.speeds is not None or context.saw_tooth is not None
    limits = None if power is None else power.battery, None if fixes is None else fixes.most
    return not chosen and limits == (None, None)


def _circumstances(missions: Sequence[Mission]) -> dict[str, Any]:
    """Fields of `Departures` that no planning goes into, by name."""
    run, places = missions[0].run, np.asarray(missions[0].graph.positions)
    if len(places) == 2:
        places = np.linspace(places[0], places[1], _PLACES)
    still, adrift = np.zeros_like(places), np.ones(len(places))
    speeds = []
    for mission in missions:
        forecast = copy(mission.sea).forecast()
        water = over_ground(forecast, places, still, adrift, now=mission.now)
        speeds.append(float(np.hypot(water[:, 0], water[:, 1]).mean()))
    return {
        "departs": np.asarray([mission.now for mission in missions]),
        "current": np.asarray(speeds),
        "site": run.site,
        "names": tuple(run.names),
    }


def _plan_legs(missions: list[Mission], progress: Progress | None) -> Departures:
    """One call of the path planner for all departures."""
    count, run, context = len(missions), missions[0].run, missions[0].context
    if progress:
        progress(0, count, "planning paths")
    common = _circumstances(missions)
    known = [
        Obstacles.create(one.position, one.radius, velocity=one.velocity, observed_at=mission.now)
        for mission in missions
        for one in [context.known_obstacles(mission.now)]
    ]
    obstacles = jax.tree.map(lambda *leaves: np.stack(leaves), *known)
    start, goal = (np.tile(run.graph.positions[end], (count, 1)) for end in (run.start, run.goal))
    plans = plan_paths(
        start,
        goal,
        context.environment(stacked([mission.sea.forecast() for mission in missions]), obstacles),
        replace(context.vehicle, navigation=context.navigation),
        key=prng.stacked([mission.path_key() for mission in missions]),
        config=context.path_config,
        depart=common["departs"],
        world_per_leg=True,
    )
    available, reasons = context.scenario.mission.time_available, [""] * count
    for number, plan in enumerate(plans):
        if not plan.feasible:
            reasons[number] = plan.explain(plan.broken()[0], context.epoch)
        elif plan.travel_time >= available:
            reasons[number] = f"the leg takes {plan.travel_time:.0f} s, {available:.0f} s are available"
    feasible, power = np.asarray([not reason for reason in reasons]), run.vehicle.power
    energy = None
    if power is not None:
        energy = np.where(feasible, [energy_of_plan(plan, power) for plan in plans], np.nan)
    return Departures(
        feasible=feasible,
        time=np.where(feasible, plans.travel_time, np.nan),
        tasks=np.zeros(count, int),
        priority=np.zeros(count),
        energy=energy,
        reasons=tuple(reasons),
        plans=plans,
        **common,
    )


def _plan_missions(missions: list[Mission], progress: Progress | None) -> Departures:
    """Whole missions, each as `plan_scenario` plans it: side by side they would differ in the last digits."""
    common = _circumstances(missions)
    # Copies get what the plans got.
    seas = [copy(mission.sea) for mission in missions]
    for number, mission in enumerate(missions):
        if progress:
            progress(number, len(missions), "planning missions")
        missions[number] = planned(mission, complete)
    runs, energy = [mission.run for mission in missions], None
    if runs[0].vehicle.power is not None:
        used = [run.energy for run in runs]
        energy = np.asarray(
            [one.total if one and run.success else np.nan for one, run in zip(used, runs, strict=True)]
        )
    return Departures(
        feasible=np.asarray([run.success for run in runs]),
        time=np.asarray([run.t_mission if run.success else np.nan for run in runs]) - common["departs"],
        tasks=np.asarray([run.tasks if run.success else 0 for run in runs]),
        priority=np.asarray([run.total_priority if run.success else 0.0 for run in runs]),
        energy=energy,
        reasons=tuple(
            "" if one.run.success else one.run.reason if one.run.legs else _why_no_route(one, sea.forecast())
            for one, sea in zip(missions, seas, strict=True)
        ),
        routes=tuple(run.route if run.success else None for run in runs),
        **common,
    )


def _why_no_route(mission: Mission, forecast: Current) -> str:
    """Return one line on a mission that has no route over open edges, timed in a forecast."""
    run, timed, speed = mission.run, mission.timed, mission.context.speed
    # The way to the destination over the fewest closed edges.
    everywhere = mission.graph.leg_times(speed) + _CLOSED
    times = np.where(timed.adjacency, timed.leg_times(speed), everywhere)
    nodes = shortest_path(times, mission.here, run.goal)
    if not nodes:
        return f"no way through the graph leads from waypoint {mission.here} to the destination"
    for i, j in pairwise(nodes):
        if not timed.adjacency[i, j]:
            context, (start, goal) = mission.context, mission.graph.positions[[i, j]]
            env, config = context.environment(forecast), effort(context.path_config).path
            line = straight_plan(start, goal, mission.now, Conditions(env, context.vehicle, config))
            # The limit that the straight line breaks most, where and when.
            why = "an end lies outside the area"
            if not line.feasible:
                why = line.explain(line.broken()[0], context.epoch)
            return f"there is no path on leg {run.called(i)} to {run.called(j)}: {why}"
    left, cost = run.t_available - mission.now, float(times[nodes[:-1], nodes[1:]].sum())
    if cost <= left or timed.options is not None:  # it is not time alone that is lacking
        return run.reason
    return f"the shortest way to the destination takes {cost:.0f} s, {left:.0f} s are available"
