"""The hierarchical loop of Fig. 7 over many missions: order the tasks, plan, execute, compare, re-plan.

One mission is a batch of one. Missions advance look by look, each at its own time. At every step the paths
that are due are planned in one call, whether a leg begins or a window of it does, and so are the routes of
tasks; when a mission ends the next one takes its place.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from pathlib import Path

import jax
import numpy as np

from auvplan.executive import surfacing
from auvplan.executive.context import Clock, Mission, MissionContext, make_context
from auvplan.executive.decide import Act, Facts, decide
from auvplan.executive.legs import (
    advance,
    begin_legs,
    finish,
    go_as_planned,
    plan_first_paths,
    unfit,
    warm_up,
)
from auvplan.executive.lines import count_line, edges_of_lines
from auvplan.executive.promise import plan_with_promise
from auvplan.executive.route_calls import plan_routes, time_edges
from auvplan.executive.speeds import energy_due, hurries, hurry_home, lacking
from auvplan.mission import MissionGraph, time_to_go
from auvplan.mission.jobs import edges_off_lines
from auvplan.path.risk import exposed
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.arguments import instance
from auvplan.runtime.compiled import MISSIONS, expecting
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.waypoints import make_graph, shut_in
from auvplan.simulation.faults import OF_A_LINK, Fault, Faults, FaultySea, PlannerOut
from auvplan.simulation.sea import ModelSea, Sea
from auvplan.simulation.simulator import WIDTH
from auvplan.simulation.world import make_sea

#: Legs that may be refused at one waypoint before the mission is given up.
_REFUSALS = 8

Progress = Callable[[int, float, str], None]


def seed_keys(seeds: Sequence[int]) -> jax.Array:
    """[B] PRNG keys of B seeds, as the commands make them."""
    return prng.of_seeds(seeds)


def run_mission(
    scenario: Scenario,
    *,
    key: jax.Array | None = None,
    seed: int | None = None,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    progress: Progress | None = None,
) -> MissionRun:
    """Plan and execute one mission; see `run_missions`.

    Example:
        >>> import auvplan as ap
        >>> ap.run_mission(ap.load_scenario("whitsunday"))
        Traceback (most recent call last):
            ...
        ValueError: a mission needs a key or a seed: run_mission(scenario, seed=0)
    """
    if key is None and seed is None:
        raise ValueError("a mission needs a key or a seed: run_mission(scenario, seed=0)")
    keys = None if key is None else prng.as_key(key, instead=", or seed=0 in its place")[None]
    seeds = None if seed is None else [seed]
    return run_missions(scenario, keys=keys, seeds=seeds, folder=folder, area=area, progress=progress)[0]


def run_missions(
    scenario: Scenario,
    *,
    keys: jax.Array | None = None,
    seeds: Sequence[int] | None = None,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    progress: Progress | None = None,
    faults: Sequence[Sequence[Fault]] = (),
) -> list[MissionRun]:
    """Plan and execute B missions of a scenario together.

    Args:
        scenario: settings; graph, current and obstacles differ by key.
        keys: [B] PRNG keys; the result of a mission depends on its own key alone. Those of `seeds` if absent.
        seeds: B numbers, that missions are made from where no keys are given, and that results are labelled
            with; 0, 1, ... if absent.
        folder: that relative paths in the scenario start from; that of its file if absent.
        area: what the scenario's files contain, as `load_area` reads it; read here if absent.
        progress: called with (mission, time s, what it does) as missions advance.
        faults: B lists of what goes wrong on purpose, see `auvplan.simulation.faults`; nothing if absent.

    Returns:
        One record a mission. A mission that fails is a record too: see `MissionRun.success` and `.reason`.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
        ValueError: neither keys nor seeds are given, there are not as many of them, or of faults, or a seed
            is no whole number.
        TypeError: keys are none, or the scenario is a file's name.
    """
    common = {"folder": folder, "area": area, "progress": progress, "faults": faults}
    found = dict(execute_missions(scenario, keys=keys, seeds=seeds, **common))
    return [found[number] for number in range(len(found))]


def execute_missions(
    scenario: Scenario,
    *,
    keys: jax.Array | None = None,
    seeds: Sequence[int] | None = None,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    progress: Progress | None = None,
    faults: Sequence[Sequence[Fault]] = (),
    together: int = WIDTH,
) -> Iterator[tuple[int, MissionRun]]:
    """`run_missions` one by one as they end: pairs of a mission's place among the keys and its record.

    Args:
        scenario, keys, seeds, folder, area, progress, faults: as for `run_missions`.
        together: missions under way at the same time, at most.
    """
    instance("scenario", scenario, Scenario, "ap.load_scenario(...)")
    if keys is None:
        if seeds is None:
            raise ValueError("missions need keys or seeds: run_missions(scenario, seeds=range(10))")
        keys = seed_keys(seeds)
    keys = prng.as_key(keys, "keys", instead=", or seeds=range(B) in their place")
    labels = range(len(keys)) if seeds is None else seeds
    if len(labels) != len(keys):
        raise ValueError(f"keys and seeds must be as many, got {len(keys)} and {len(labels)}")
    if faults and len(faults) != len(keys):
        raise ValueError(f"faults must be a list for each of {len(keys)} missions, got {len(faults)}")
    if any(isinstance(fault, OF_A_LINK) for given in faults for fault in given):
        raise ValueError("faults of a link need one: SimulatedVehicle(scenario, seed, faults=faults)")
    with expecting(MISSIONS, scenario.fingerprint):
        context = make_context(scenario, folder, area)
        context.faults = faults
        waiting = deque(enumerate(zip(prng.single(keys), labels, strict=True)))
        active: list[Mission] = []
        while active or waiting:
            while waiting and len(active) < together:
                number, (key, seed) = waiting.popleft()
                active.append(start_mission(context, number, key, int(seed)))
                settle(active[-1])
                warm_up(context, partial(start_mission, number=number, key=key, seed=int(seed)))
            step(active)
            for mission in active:
                if mission.ended:
                    mission.run.compile_seconds = context.clock.compile_seconds
                    yield mission.number, mission.run
                elif progress:
                    progress(mission.number, mission.now, mission.doing)
            active = [mission for mission in active if not mission.ended]


def start_mission(context: MissionContext, number: int, key: jax.Array, seed: int) -> Mission:
    """Build a mission's world; nothing is planned yet."""
    scenario, area = context.scenario, context.area
    graph_key, field_key, sea_key, planner_key, chance_key = prng.parts(key, 5)
    graph, names = make_graph(scenario, area, prng.generator(graph_key), context.around)
    run = MissionRun(
        scenario.model_dump(mode="json"),
        seed,
        context.as_built,
        graph,
        area.chart,
        0,
        graph.size - 1,
        scenario.mission.time_available,
        folder=str(Path(context.folder).resolve()),
        site=area.site,
        seabed=area.seabed,
        names=names,
        simulated=context.simulated,
        obstacles=area.obstacles,
        closures=area.closures,
        assumed=area.notes,
        jobs=area.jobs,
    )
    run.coast, run.zones = area.coast, area.zones
    sea = make_sea(scenario, area, field_key, sea_key, context.simulated)
    faults = context.faults_of(number)
    if faults:
        sea = FaultySea(sea, faults)
    if scenario.mission.lines == "whole":
        graph = graph.without_edges(edges_off_lines(area.jobs, np.asarray(graph.adjacency)))
    parts, rng = edges_of_lines(context), prng.generator(chance_key)
    parts = {edge: part for edge, part in parts.items() if graph.adjacency[edge]}
    common = {"allowance": context.rules.allowance, "faults": faults, "parts": parts}
    common |= {"navigation": context.navigation}
    return Mission(context, number, run, sea, planner_key, rng, graph, graph, **common)


def settle(mission: Mission) -> None:
    """Take the allowance by which a plan in the forecast keeps the scenario's promise.

    Where all missions are planned alike, the first one's plan is that of all.
    """
    context, asked = mission.context, mission.context.rules.promise
    if asked is None:
        return
    left = context.left
    if left is None:
        planned = replace(context, simulated=False, clock=Clock(timed=False), faults=())
        sea = Sea(copy(mission.sea).forecast())
        ahead = mission.fork(context=planned, sea=sea, faults=Faults(), learnt={})
        ahead.run.simulated = False
        promise = plan_with_promise(ahead, asked, complete).run.promise
        left = 0.0 if promise is None else promise.left
        if not context.scenario.differs_by_seed and context.scenario.current.forecast_error == 0.0:
            context.left = left
    mission.allowance = max(mission.allowance, left / (1.0 - left))


def step(missions: list[Mission]) -> None:
    """Order tasks and begin legs where vehicles are at a waypoint, then advance all to the next look.

    Where nothing is simulated, legs are gone to their ends as they are planned.
    """
    waiting = [mission for mission in missions if mission.leg is None]
    for mission in waiting:  # what is decided without its planner would be decided for the wrong time
        mission.charge(mission.faults.left(PlannerOut, mission.now))
        first, place = not (mission.run.legs or mission.run.routes), mission.graph.positions[mission.here]
        if first and (why := shut_in(np.asarray(place), mission.context.area, mission.now)):
            mission.end(f"{mission.run.place(mission.here)} {why}: depart later, or start elsewhere")
    waiting = [mission for mission in waiting if not mission.ended]
    _update_edge_times(waiting)
    plan_routes([mission for mission in waiting if mission.cause])
    _begin([mission for mission in waiting if not mission.ended])
    under_way = [mission for mission in missions if mission.leg is not None]
    executed = [one for one in under_way if one.context.simulated and not one.active_leg.stays]
    go_as_planned([mission for mission in under_way if mission not in executed])
    if executed:
        advance(executed)
    for mission in under_way:
        if not mission.active_leg.under_way:
            _judge(mission)


def complete(mission: Mission, progress: Callable[[float, str], None] | None = None) -> None:
    """Go through a mission to its end; `progress` is called with (time s, what it does)."""
    while not mission.ended:
        step([mission])
        if progress:
            progress(mission.now, mission.doing)


def _update_edge_times(missions: list[Mission]) -> None:
    """Time the edges in the present current, and find the routes that no longer fit it."""
    time_edges(missions)
    for mission in missions:
        planning, speed = mission.context.rules, mission.context.speed
        if mission.cause or planning.replan != "deviation":
            continue
        times, rest = mission.timed.leg_times(speed), mission.rest
        if mission.timed.timetable is None:
            ends = mission.now + times[rest[:-1], rest[1:]].sum()
        else:
            ends = mission.now + float(mission.timed.itinerary(rest, speed).ends[-1])
        slack, due = mission.run.t_available - planning.reserve - ends, ""
        # Chosen speeds use the time as far as that saves energy.
        planned = 0.0 if mission.timed.options is None else max(mission.slack, 0.0)
        if slack < min(mission.slack, 0.0) - planning.tolerance:
            due = "late"
        elif slack - mission.allowance * (ends - mission.now) - planned > planning.gain:
            due = "early"
        due = due or energy_due(mission)
        if decide(Facts(due=due)).act is Act.REPLAN_REST:
            mission.cause = due
            if mission.slow_and_fast:
                time_edges([mission])


def _begin(missions: list[Mission]) -> None:
    """Plan the next leg of every mission, and begin those that are not refused."""
    if not missions:
        return
    for mission in missions:
        if mission.timed.options is not None and mission.rest[1:] == [mission.run.goal]:
            hurry_home(mission)
    expected, records = [mission.timed.leg_times(mission.context.speed) for mission in missions], []
    before = [(mission.navigation, mission.navigated) for mission in missions]
    rises = [surfacing.surface(mission) if surfacing.due(mission) else 0.0 for mission in missions]
    for mission, times, rise in zip(missions, expected, rises, strict=True):
        i, j = mission.rest[:2]
        expects, hold = float(times[i, j]), 0.0
        if mission.timed.timetable is not None:
            expects, hold = _by_the_clock(mission, i, j, expects)
        revisit, speed = j in mission.visited, mission.chosen_speed((i, j))
        own = {"revisit": revisit, "t_hold": rise + hold, "t_fix": rise or None, "speed": speed}
        records.append(LegRecord(i, j, expects, *mission.task(i, j), **own))
    for mission in missions:
        if mission.navigation is not None:  # from here on at the leg's speed
            mission.navigate(mission.navigation.fixed() if mission.at_surface else mission.known)
    begin_legs(missions, records)
    _surface_instead(missions)
    if late := [mission for mission in missions if hurries(mission)]:
        plan_first_paths(late, "leg")
    for mission, times, record, known in zip(missions, expected, records, before, strict=True):
        mission.run.legs.append(record)
        if why := why_refused(mission, times):
            mission.now -= record.t_hold
            record.t_hold, record.t_fix = 0.0, None
            mission.navigation, mission.navigated = known
            _reject_leg(mission, why)


def _surface_instead(missions: list[Mission]) -> None:
    """Let vehicles whose legs cannot be begun as they are surface for a fix first, where that may help."""
    wanting = [one for one in missions if one.navigation is not None and not one.active_leg.record.t_fix]
    again = [mission for mission in wanting if unfit(mission) and surfacing.helps(mission)]
    for mission in again:
        record = mission.active_leg.record
        record.t_fix = surfacing.surface(mission)
        record.t_hold += record.t_fix
    if again:
        begin_legs(again, [mission.active_leg.record for mission in again])


def _by_the_clock(mission: Mission, i: int, j: int, least: float) -> tuple[float, float]:
    """Wait for the way to open; return how long the leg is expected to take, waiting left out, and the wait.

    Where nothing says that the leg can be done, `least` is expected.
    """
    leg = mission.timed.itinerary([i, j], mission.context.speed)  # its times count from now
    hold, arrives = leg.leaves.item(), leg.arrives.item()
    if not np.isfinite(arrives):
        return least, 0.0
    mission.now += hold
    return arrives - hold + float(mission.graph.duration[i, j]), hold


def why_refused(mission: Mission, times: np.ndarray) -> str:
    """Return why the planned leg should not be executed, or an empty string.

    A leg is refused when its path is not feasible, or when the time that the path takes would leave too
    little for the shortest way from its end to the destination, with the margin that its route was made with.
    Edges are expected to take `times`, [N, N] s.
    """
    leg, rules = mission.active_leg, mission.context.rules
    if why := unfit(mission):
        return why
    if leg.record.goal == mission.run.goal or mission.refusals >= _REFUSALS or not rules.guard_return:
        return ""
    if mission.timed.options is not None:
        return lacking(mission)
    if rules.visits == "once":
        times = times.copy()
        times[:, leg.record.start] = np.inf
    to_go = float(time_to_go(times, mission.run.goal)[leg.record.goal])
    if not np.isfinite(to_go):
        return ""  # the route counts on edges that the estimate closed, for which a path may be found yet
    # A route that had to do without the margin would be made again.
    back = (1.0 + mission.last_route.return_margin) * to_go
    lasts = leg.followed.travel_time + leg.record.t_task
    late = mission.now + lasts + back - mission.run.t_available
    return f"its path would leave {late:.0f} s too little for the way back" if late > 0.0 else ""


def _reject_leg(mission: Mission, why: str) -> None:
    """Ask for another route without the refused edge, or with the time that its path takes."""
    leg = mission.active_leg
    mission.refusals += 1
    leg.record.refused = why
    barred = bool(unfit(mission))
    i, j = leg.record.start, leg.record.goal
    mission.obstruction = f"{mission.leg_name}, {why}"
    if barred:
        mission.barred |= {(i, j), (j, i)}
        mission.graph = mission.graph.without_edges([(i, j)])
    elif mission.context.speeds is not None:
        expected = leg.record.t_expected - leg.record.t_task
        mission.learnt[i, j] = leg.followed.travel_time / expected * mission.learnt.get((i, j), 1.0)
    else:
        mission.learnt[i, j] = leg.followed.travel_time
    mission.cause = "refused"
    stuck = barred and not mission.graph.adjacency[i].any() and not mission.visited - {i}
    if mission.refusals > _REFUSALS or stuck:
        mission.end(f"{mission.leg_name} cannot be executed: {why}")
    mission.leg = None


def _judge(mission: Mission) -> None:
    """After a leg: do the task, compare the leg's whole time with t_ij, decide on re-planning (3.3.2)."""
    run, context, leg = mission.run, mission.context, mission.active_leg
    record, planning = leg.record, context.rules
    finish(leg)
    if mission.navigation is not None and record.arrived:  # how well it knows where it is, what it risked
        met = None if leg.stays else exposed(leg.followed)
        mission.navigate(mission.known if met is None else met.end)
        record.position_std = float(np.asarray(mission.navigation.std))
        record.risk = 0.0 if met is None else met.risk
    if isinstance(mission.sea, ModelSea):
        record.current_difference = mission.sea.difference(record.positions, record.times)
        record.current = mission.sea.along(record.positions, record.times, mean=not context.simulated)
    if planning.charge_compute:
        mission.charge(record.cpu)
    if not record.arrived:
        mission.end(f"{mission.leg_name} was not finished: {leg.stopped}")
    mission.leg = None
    if mission.ended:
        return
    _await_window(mission, record)
    if context.simulated and (error := context.scenario.mission.duration_error):
        record.t_task *= max(1.0 + error * mission.rng.standard_normal(), 0.0)
    mission.now += record.t_wait + record.t_task
    count_line(mission, record)
    mission.refusals = 0
    mission.here = record.goal
    mission.step += 1
    mission.visited |= {record.start, record.goal}
    mission.graph = what_is_left(mission.graph, record.start, record.goal, planning.visits)
    late = planning.replan == "late" and planning.late(record.t_path, record.t_task, record.t_expected)
    decision = decide(Facts(arrived=record.goal == run.goal, due="late" if late else ""))
    if decision.act is Act.ARRIVE:
        mission.end("")
    elif decision.act is Act.REPLAN_REST:
        mission.cause = decision.why


def _await_window(mission: Mission, record: LegRecord) -> None:
    """Record how long the vehicle waits for the window of the task, or that it has missed it."""
    timetable = mission.graph.timetable
    if timetable is None or record.priority == 0.0 == record.t_task:
        return
    edge = record.start, record.goal
    begins = timetable.begins(*edge, mission.now)
    kept = timetable.kept(*edge, float(record.times[0]), mission.now + record.t_task)
    if np.isfinite(begins) and kept:
        record.t_wait = begins - mission.now
        record.priority -= timetable.lost(*edge, begins)
    else:
        record.missed, record.priority, record.t_task = True, 0.0, 0.0


def what_is_left(graph: MissionGraph, left: int, reached: int, visits: str) -> MissionGraph:
    """Return the graph after a leg: what may still be visited, and the tasks that are not done.

    Args:
        graph: before it.
        left, reached: waypoints at the leg's ends.
        visits: "once" or "edges", as in `PlanningSettings`.
    """
    if visits == "once":
        return graph.without_waypoints([left]).without_task_at(reached)
    return graph.without_edges([(left, reached)], both_ways=None).without_task_at(reached)
