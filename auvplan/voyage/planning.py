"""Plans whole missions: the route and its paths in the forecast and past known obstacles, nothing simulated.

A plan is what the hierarchical loop of Fig. 7 does where all goes as expected: legs take the time that is
planned for them, and each is planned in the sea as it is forecast for the time when it is begun.
"""

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from typing import Any

import jax

from auvplan.ocean.gridded import GriddedCurrent
from auvplan.voyage.clock import Untimed
from auvplan.voyage.executive import make_fleet, seed_keys, step
from auvplan.voyage.fleet import Fleet, Mission
from auvplan.voyage.records import MissionRun
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.waters import Waters

#: Called with (mission, time s, what is planned) as plans grow.
Progress = Callable[[int, float, str], None]


def plan_scenario(
    scenario: Scenario,
    *,
    key: jax.Array | None = None,
    seed: int = 0,
    depart: float = 0.0,
    folder: str | Path | None = None,
    waters: Waters | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> MissionRun:
    """Plan a mission: the order of its tasks, and a path along every leg.

    Nothing is simulated: the sea is as forecast and obstacles are those of `obstacles.file`. The same call
    gives the same plan to the last bit.

    Args:
        scenario: settings.
        key: PRNG key of the planners, and of what the scenario leaves to chance; that of `seed` if absent.
        seed: the same as a number.
        depart: s since the scenario's epoch.
        folder: that relative paths in the scenario start from; that of its file if absent.
        waters: what the scenario's files tell, as `load_waters_at` reads it; read here if absent.
        progress: called with (time s, what is planned).

    Returns:
        The plan: legs with their paths, planned times in place of sailed ones, and `simulated` False. See
        `MissionRun.success` and `.reason` for one that fails.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built, or its current is not
            known from the departure until the time available is over.
    """
    from auvplan.voyage.departures import leaving, load_waters_at

    if waters is None:
        waters = load_waters_at(scenario, [depart], folder)
    fleet = planning_fleet(scenario, folder, waters, depart)
    keyed = seed_keys([seed])[0] if key is None else key
    missions = leaving(fleet, keyed, [depart], seed)
    complete(fleet, missions, progress and (lambda _, now, doing: progress(now, doing)))
    return _from_departure(missions[0].run, depart)


def planning_fleet(scenario: Scenario, folder: str | Path | None, waters: Waters, depart: float) -> Fleet:
    """What a plan counts on: nothing simulated, nothing timed, no more of the sea than it meets."""
    if waters.forecast is not None:
        forecast = waters.forecast.window(depart, depart + scenario.mission.time_available)
        waters = replace(waters, forecast=forecast, truth=forecast)
    # Planning is done before the departure: it costs the mission no time.
    planning = scenario.planning.model_copy(update={"charge_compute": False})
    fleet = make_fleet(scenario.model_copy(update={"planning": planning}), folder, waters)
    fleet.simulated, fleet.clock = False, Untimed()
    return fleet


def complete(fleet: Fleet, missions: list[Mission], progress: Progress | None = None) -> None:
    """Plan missions to their ends."""
    while active := [mission for mission in missions if not mission.ended]:
        step(fleet, active)
        for mission in active:
            if progress:
                progress(mission.number, mission.now, mission.doing)


def _from_departure(run: MissionRun, depart: float) -> MissionRun:
    """The plan with times that count from its departure, `depart` s after the scenario's epoch."""
    if depart == 0.0:
        return run
    shifted: dict[int, Any] = {}

    def later(current: Any) -> Any:
        if id(current) not in shifted:
            shifted[id(current)] = jax.tree.map(
                lambda part: replace(part, times=part.times - depart) if _is_gridded(part) else part,
                current,
                is_leaf=_is_gridded,
            )
        return shifted[id(current)]

    for leg in run.legs:
        leg.times = leg.times - depart
        leg.plans = [
            replace(
                plan, made_at=plan.made_at - depart, times=plan.times - depart, current=later(plan.current)
            )
            for plan in leg.plans
        ]
    for order in run.orders:
        order.made_at -= depart
    run.t_mission -= depart
    run.t_available -= depart
    if run.site is not None and run.site.epoch is not None:
        moment = run.site.epoch + timedelta(seconds=depart)
        run.site = replace(run.site, epoch=moment)
        run.scenario["site"]["departure"] = moment.isoformat()
    run.obstacles = tuple(obstacle.after(depart) for obstacle in run.obstacles)
    return run


def _is_gridded(part: Any) -> bool:
    return isinstance(part, GriddedCurrent)
