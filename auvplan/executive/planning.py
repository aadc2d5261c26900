"""Plans whole missions: the route and its paths in the forecast and past known obstacles, nothing simulated.

A plan is what the hierarchical loop of Fig. 7 does where all goes as expected: legs take the time that is
planned for them, and each is planned in the current forecast for the time at which it is begun.
"""

from collections.abc import Callable
from dataclasses import replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from numpy.typing import ArrayLike, NDArray

from auvplan.errors import ScenarioError
from auvplan.executive.context import Clock, Mission, MissionContext, make_context
from auvplan.executive.loop import complete, seed_keys, start_mission
from auvplan.executive.promise import planned, surer_plans
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.records import MissionRun
from auvplan.runtime.arguments import instance, per_row
from auvplan.runtime.compiled import PLANS, expecting
from auvplan.runtime.prng import as_key
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site

#: Called with (time s, what is planned) as a plan grows.
Progress = Callable[[float, str], None]


def plan_scenario(
    scenario: Scenario,
    *,
    key: jax.Array | None = None,
    seed: int = 0,
    depart: float = 0.0,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    progress: Progress | None = None,
) -> MissionRun:
    """Plan a mission: the route, and a path along every leg.

    Nothing is simulated: currents are as forecast and obstacles are those of `obstacles.file`. The same call
    gives the same plan to the last bit.

    Args:
        scenario: settings.
        key: PRNG key of the planners, and of what the scenario leaves to chance; that of `seed` if absent.
        seed: the same as a number.
        depart: s since the scenario's epoch.
        folder: that relative paths in the scenario start from; that of its file if absent.
        area: what the scenario's files contain, as `load_area_at` reads it; read here if absent.
        progress: called with (time s, what is planned).

    Returns:
        The plan: legs with their paths, planned times in place of executed ones, and `simulated` False. See
        `MissionRun.success` and `.reason` for one that fails.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built, or its current is not
            known from the departure until the time available is over.
        ValueError, TypeError: the departure is not one finite number, the seed not whole, the key no key, or
            the scenario a file's name.
    """
    instance("scenario", scenario, Scenario, "ap.load_scenario(...)")
    keyed = seed_keys([seed])[0] if key is None else as_key(key, instead=", or seed=0 in its place")
    depart = float(per_row("depart", depart, 1)[0])
    if area is None:
        area = load_area_at(scenario, [depart], folder)
    require_read(scenario, area, np.asarray([depart]))
    context = planning_context(scenario, folder, area, depart)
    (mission,) = leaving(context, keyed, [depart], seed)
    judged = scenario.current.members is not None
    with expecting(PLANS, scenario.fingerprint):
        mission = planned(mission, partial(complete, progress=progress), judged)
    return _from_departure(mission.run, depart)


def plan_promises(
    scenario: Scenario,
    *,
    seed: int = 0,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[MissionRun]:
    """Plan a mission more and more surely: what it costs to be home in time.

    Args:
        scenario: settings; `planning.promise` and `planning.turn_back` do not count.
        seed, folder, area: as for `plan_scenario`.
        progress: called with how many plans are made, of how many.

    Returns:
        Plans with their promises, the least sure first; of such as promise the same, that of most priority.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: as `plan_scenario`.
    """
    area = load_area_at(scenario, [0.0], folder) if area is None else area
    context = planning_context(scenario, folder, area, 0.0)
    (mission,) = leaving(context, seed_keys([seed])[0], [0.0], seed)
    with expecting(PLANS, scenario.fingerprint):
        return surer_plans(mission, complete, progress)


def load_area_at(scenario: Scenario, departs: ArrayLike, folder: str | Path | None = None) -> OperatingArea:
    """`load_area` for missions that leave at other times: currents and hours are read for all, not one.

    Args:
        scenario: settings.
        departs: [D] s since the scenario's epoch, which stays the epoch of what is read.
        folder: that relative paths in the scenario start from; that of its file if absent.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: as `load_area`.
    """
    from auvplan.io.area import load_area

    moments, site = np.asarray(departs, float), scenario.site
    first, last = float(moments.min()), float(moments.max()) + scenario.mission.time_available
    if scenario.current.source == "file" and site is not None and site.departure is not None:
        # What lies between the scenario's own departure and the first of these need not be covered.
        return load_area(scenario, folder, until=last, since=first)
    area = load_area(scenario, folder, until=last, since=min(first, 0.0))
    require_known(scenario, area, moments)
    return area


def planning_context(
    scenario: Scenario,
    folder: str | Path | None,
    area: OperatingArea,
    depart: float | None = None,
    ahead: bool = True,
) -> MissionContext:
    """Return what plans count on, nothing simulated or timed.

    That is no more of the data than a mission from `depart` meets. Plans that are all made `ahead` of the
    departure polish winding paths with more control points.
    """
    if area.forecast is not None and depart is not None:
        until = depart + scenario.mission.time_available
        forecast = area.forecast.window(depart, until)
        members = tuple(member.window(depart, until) for member in area.members)
        area = replace(area, forecast=forecast, truth=forecast, members=members)
    # Planning is done before the departure: it costs the mission no time.
    planning = scenario.planning.model_copy(update={"charge_compute": False})
    context = make_context(scenario.model_copy(update={"planning": planning}), folder, area, ahead, False)
    context.clock = Clock(timed=False)
    return context


def leaving(context: MissionContext, key: jax.Array, departs: ArrayLike, seed: int = 0) -> list[Mission]:
    """One mission a departure: the same but for the time and the current of that time."""
    departs = np.asarray(departs, float)
    model = start_mission(context, 0, key, seed)
    missions = {}
    for number in np.argsort(departs, kind="stable").tolist():
        now = float(departs[number])
        model.sea.advance(now)
        run = replace(model.run, t_available=now + model.run.t_available, routes=[], legs=[])
        missions[number] = model.fork(number=number, run=run, now=now, navigated=now, sketches={})
        missions[number].sea.hold()
    return [missions[number] for number in range(len(departs))]


def _from_departure(run: MissionRun, depart: float) -> MissionRun:
    """Return the plan with times that count from its departure, `depart` s after the scenario's epoch."""
    if depart == 0.0:
        return run
    shifted: dict[int, Any] = {}

    def since(part: Any) -> Any:
        if isinstance(part, HarmonicCurrent):
            return part.after(depart)
        return replace(part, times=part.times - depart) if isinstance(part, GriddedCurrent) else part

    def later(current: Any) -> Any:
        if id(current) not in shifted:
            shifted[id(current)] = jax.tree.map(
                since, current, is_leaf=lambda part: isinstance(part, GriddedCurrent | HarmonicCurrent)
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
    for route in run.routes:
        route.made_at -= depart
    if run.graph.timetable is not None:
        run.graph = replace(run.graph, timetable=run.graph.timetable.since(depart))
    run.t_mission -= depart
    run.t_available -= depart
    if run.site is not None and run.site.epoch is not None:
        moment = run.site.epoch + timedelta(seconds=depart)
        run.site = replace(run.site, epoch=moment)
        run.scenario["site"]["departure"] = moment.isoformat()
    run.jobs = None if run.jobs is None else run.jobs.after(depart)
    run.closures = tuple(closure.after(depart) for closure in run.closures)
    run.obstacles, run.departed = tuple(obstacle.after(depart) for obstacle in run.obstacles), depart
    return run


def moment_name(site: Site | None, seconds: float) -> str:
    """Return a local time for people: UTC to the minute, or hours where there is no date."""
    moment = None if site is None else site.utc(round(seconds / 60.0) * 60.0)
    return f"{seconds / 3600.0:+.2f} h" if moment is None else f"{moment:%Y-%m-%d %H:%M} UTC"


def require_known(scenario: Scenario, area: OperatingArea, departs: NDArray[np.float64]) -> None:
    """Refuse departures at which the current is not known.

    Raises:
        ScenarioError: one line that names the times.
    """
    first, last = departs.min(), departs.max() + scenario.mission.time_available
    field, name = area.forecast, partial(moment_name, area.site)
    if field is None:
        if first < 0.0:
            raise ScenarioError(
                f"departure {name(first)} lies before the scenario's, with which its vortices begin: "
                "set site.departure earlier"
            )
    elif isinstance(field, GriddedCurrent) and not field.steady and scenario.current.outside == "refuse":
        begin, end = float(field.times[0]), float(field.times[-1])
        slack = 1e-6 * max(abs(begin), abs(end))  # times are kept in single precision
        if first < begin - slack or last > end + slack:
            raise ScenarioError(
                f"departures and the time available reach from {name(first)} to {name(last)}, "
                f"the current's data from {name(begin)} to {name(end)}"
            )


def require_read(scenario: Scenario, area: OperatingArea, departs: NDArray[np.float64]) -> None:
    """Refuse departures at which it was not read what is closed, or when jobs may be done.

    Raises:
        ScenarioError: one line that names the times, and what reads them.
    """
    first, last = departs.min(), departs.max() + scenario.mission.time_available
    jobs = () if area.jobs is None else (*area.jobs.points, *area.jobs.lines)
    timed = scenario.chart.no_go is not None or any(job.windows for job in jobs)
    if timed and area.hours is not None and not area.hours[0] <= first <= last <= area.hours[1]:
        spans = (first, last), area.hours
        whole, read = (" to ".join(moment_name(area.site, one) for one in span) for span in spans)
        raise ScenarioError(
            f"departures and the time available reach from {whole}, closed areas and windows were "
            f"read from {read}: give the area that load_area_at(scenario, departs) reads"
        )
