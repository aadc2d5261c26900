"""Plans whole missions: the route and its paths in the forecast and past known obstacles, nothing simulated.

A plan is what the hierarchical loop of Fig. 7 does where all goes as expected: legs take the time that is
planned for them, and each is planned in the sea as it is forecast for the time when it is begun.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.compiled import MISSIONS, expecting
from auvplan.errors import ScenarioError
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.records import MissionRun
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.waters import Waters
from auvplan.site import Site
from auvplan.voyage.clock import Untimed
from auvplan.voyage.context import Mission, SimulationContext
from auvplan.voyage.executive import embark, make_context, seed_keys, step

#: Called with (time s, what is planned) as a plan grows.
Progress = Callable[[float, str], None]


def plan_scenario(
    scenario: Scenario,
    *,
    key: jax.Array | None = None,
    seed: int = 0,
    depart: float = 0.0,
    folder: str | Path | None = None,
    waters: Waters | None = None,
    progress: Progress | None = None,
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
    if waters is None:
        waters = load_waters_at(scenario, [depart], folder)
    context = planning_context(scenario, folder, waters, depart)
    keyed = seed_keys([seed])[0] if key is None else key
    (mission,) = leaving(context, keyed, [depart], seed)
    with expecting(MISSIONS):
        complete(context, mission, progress)
    return _from_departure(mission.run, depart)


def load_waters_at(scenario: Scenario, departs: ArrayLike, folder: str | Path | None = None) -> Waters:
    """`load_waters` for missions that leave at other times: currents are read for all of them, not one.

    Args:
        scenario: settings.
        departs: [D] s since the scenario's epoch, which stays the epoch of what is read.
        folder: that relative paths in the scenario start from; that of its file if absent.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: as `load_waters`.
    """
    from auvplan.io.waters import load_jobs, load_waters

    moments, site = np.asarray(departs, float), scenario.site
    first, last = float(moments.min()), float(moments.max()) + scenario.mission.time_available
    if scenario.current.source != "file" or site is None or site.departure is None:
        waters = load_waters(scenario, folder, until=last)
        require_known(scenario, waters, moments)
        return waters
    # What lies between the scenario's own departure and the first of these need not be covered.
    leaving = site.model_copy(update={"departure": site.departure + timedelta(seconds=first)})
    waters = load_waters(scenario.model_copy(update={"site": leaving}), folder, until=last - first)
    assert waters.forecast is not None
    assert waters.truth is not None
    return replace(
        waters,
        site=site.site,
        jobs=load_jobs(scenario, site.site, scenario.folder if folder is None else folder, last),
        forecast=replace(waters.forecast, times=waters.forecast.times + first),
        truth=replace(waters.truth, times=waters.truth.times + first),
    )


def planning_context(
    scenario: Scenario, folder: str | Path | None, waters: Waters, depart: float | None = None
) -> SimulationContext:
    """Return what plans count on, nothing simulated or timed.

    Of the sea no more than one from `depart` meets.
    """
    if waters.forecast is not None and depart is not None:
        forecast = waters.forecast.window(depart, depart + scenario.mission.time_available)
        waters = replace(waters, forecast=forecast, truth=forecast)
    # Planning is done before the departure: it costs the mission no time.
    planning = scenario.planning.model_copy(update={"charge_compute": False})
    context = make_context(scenario.model_copy(update={"planning": planning}), folder, waters)
    context.simulated, context.clock = False, Untimed()
    return context


def leaving(context: SimulationContext, key: jax.Array, departs: ArrayLike, seed: int = 0) -> list[Mission]:
    """One mission a departure: the same but for the time and the sea as it is then."""
    departs = np.asarray(departs, float)
    model = embark(context, 0, key, seed)
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
        missions[number].sea.hold()
    return [missions[number] for number in range(len(departs))]


def complete(context: SimulationContext, mission: Mission, progress: Progress | None = None) -> None:
    """Plan a mission to its end."""
    while not mission.ended:
        step(context, [mission])
        if progress:
            progress(mission.now, mission.doing)


def _from_departure(run: MissionRun, depart: float) -> MissionRun:
    """Return the plan with times that count from its departure, `depart` s after the scenario's epoch."""
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
    if run.graph.timetable is not None:
        run.graph = replace(run.graph, timetable=run.graph.timetable.since(depart))
    run.t_mission -= depart
    run.t_available -= depart
    if run.site is not None and run.site.epoch is not None:
        moment = run.site.epoch + timedelta(seconds=depart)
        run.site = replace(run.site, epoch=moment)
        run.scenario["site"]["departure"] = moment.isoformat()
    run.obstacles, run.departed = tuple(obstacle.after(depart) for obstacle in run.obstacles), depart
    return run


def _is_gridded(part: Any) -> bool:
    return isinstance(part, GriddedCurrent)


def moment_name(site: Site | None, seconds: float) -> str:
    """Return a local time for people: UTC to the minute, or hours where there is no date."""
    moment = None if site is None else site.utc(round(seconds / 60.0) * 60.0)
    return f"{seconds / 3600.0:+.2f} h" if moment is None else f"{moment:%Y-%m-%d %H:%M} UTC"


def require_known(scenario: Scenario, waters: Waters, departs: NDArray[np.float64]) -> None:
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
