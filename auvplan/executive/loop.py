"""The hierarchical loop of Fig. 7 over many missions: order the tasks, plan, execute, compare, re-plan.

One mission is a batch of one. Missions advance look by look, each at its own time. At every step the paths
that are due are planned in one call, whether a leg begins or a window of it does, and so are the routes of
tasks; when a mission ends the next one takes its place.
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import jax
import numpy as np

from auvplan.executive.context import Leg, Mission, SimulationContext
from auvplan.executive.decide import Act, Facts, decide
from auvplan.executive.legs import advance, begin_legs, finish, go_as_planned, unfit
from auvplan.executive.lines import count_line, edges_of_lines
from auvplan.executive.route_calls import plan_routes, time_edges
from auvplan.executive.warmup import warm_up
from auvplan.mission import MissionConfig, MissionGraph, time_to_go
from auvplan.mission.jobs import ways_off_lines
from auvplan.path import PathConfig
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.compiled import MISSIONS, expecting
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.waypoints import make_graph
from auvplan.simulation.faults import OF_A_LINK, Fault, FaultySea, PlannerOut
from auvplan.simulation.sea import ModelSea
from auvplan.simulation.simulator import WIDTH
from auvplan.simulation.world import make_sea, make_vehicle

#: Legs that may be refused at one waypoint before the mission is given up.
_REFUSALS = 8

#: Share by which a vehicle's speed must differ from what is assumed for its times to be recalculated.
_PACE = 0.02

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
        ValueError: neither keys nor seeds are given, or there are not as many of them, or of faults.
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
                warm_up(context, partial(start_mission, context, number, key, int(seed)))
            step(context, active)
            for mission in active:
                if mission.ended:
                    mission.run.compile_seconds = context.clock.compile_seconds
                    yield mission.number, mission.run
                elif progress:
                    progress(mission.number, mission.now, mission.doing)
            active = [mission for mission in active if not mission.ended]


def path_config(scenario: Scenario, ahead: bool = False) -> PathConfig:
    """Return the path planner's settings under the scenario's preset and effort.

    Args:
        scenario: settings.
        ahead: whether all is planned before the departure. Legs under way are planned without
            `PathConfig.finer`, whose program would be compiled while the vehicle waits.
    """
    planning = scenario.planning.resolved
    efforts = {"quick": PathConfig.quick, "full": PathConfig, "plain": PathConfig.plain}
    config = PathConfig.paper() if planning.preset == "paper" else efforts[planning.effort]()
    given = {"control_points": planning.control_points, "width": planning.path_width}
    config = config.replace(**{name: value for name, value in given.items() if value is not None})
    safety = scenario.safety
    margins = {"coast_margin": safety.coast, "obstacle_margin": safety.obstacles}
    finer = config.finer if ahead and config.refine_steps else 1
    return config.replace(t_series=planning.t_series, finer=finer, **margins)


def mission_configs(scenario: Scenario) -> tuple[MissionConfig, MissionConfig]:
    """Return the mission planner's settings under the scenario's preset and effort.

    First and later routes.
    """
    planning = scenario.planning.resolved
    phi1, phi2 = planning.phi
    aim = {"objective": planning.objective, "phi1": phi1, "phi2": phi2}
    if planning.preset == "paper":
        config = MissionConfig.paper().replace(**aim)
        return config, config
    # Between two waypoints there is one route: the search is that which is soonest compiled.
    alone = scenario.mission.jobs is None and scenario.mission.waypoints == 2
    config = MissionConfig.plain() if planning.effort == "plain" or alone else MissionConfig()
    config = config.replace(**aim)
    if planning.effort != "quick":
        return config, config
    # Beams of one width make the first route and later ones one program.
    later = config.quicker()
    return config.replace(beam_width=later.beam_width), later


def make_context(
    scenario: Scenario,
    folder: str | Path | None = None,
    area: OperatingArea | None = None,
    ahead: bool = False,
) -> SimulationContext:
    """Gather the operating area, the vehicle and the planners' settings of a scenario.

    All is planned `ahead` of the departure or under way, see `path_config`.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
    """
    # Files are read at the edge of the package; what is built from them can be given instead.
    from auvplan.io.area import load_area

    home = scenario.folder if folder is None else str(folder)
    return SimulationContext(
        scenario,
        path_config(scenario, ahead),
        mission_configs(scenario),
        make_vehicle(scenario),
        load_area(scenario, home) if area is None else area,
        home,
    )


def start_mission(context: SimulationContext, number: int, key: jax.Array, seed: int) -> Mission:
    """Build a mission's world; nothing is planned yet."""
    scenario = context.scenario
    graph_key, field_key, sea_key, planner_key, chance_key = prng.parts(key, 5)
    graph, names = make_graph(scenario, context.area, _generator(graph_key), context.around)
    run = MissionRun(
        scenario.model_dump(mode="json"),
        seed,
        context.vehicle,
        graph,
        context.chart,
        0,
        graph.size - 1,
        scenario.mission.time_available,
        folder=str(Path(context.folder).resolve()),
        site=context.area.site,
        seabed=context.area.seabed,
        names=names,
    )
    run.simulated, run.obstacles = context.simulated, context.area.obstacles
    run.assumed, run.closures = context.area.notes, context.area.closures
    run.coast, run.zones, run.jobs = context.area.coast, context.area.zones, context.area.jobs
    sea = make_sea(scenario, context.area, field_key, sea_key, context.simulated)
    faults = context.faults_of(number)
    if faults:
        sea = FaultySea(sea, faults)
    if scenario.mission.lines == "whole":
        graph = graph.without_edges(ways_off_lines(names, np.asarray(graph.adjacency)))
    parts = edges_of_lines(context, names)
    return Mission(
        number, run, sea, planner_key, _generator(chance_key), graph, graph, faults=faults, parts=parts
    )


def _generator(key: jax.Array) -> np.random.Generator:
    return np.random.default_rng(np.asarray(jax.random.key_data(key)).tolist())


def step(context: SimulationContext, missions: list[Mission]) -> None:
    """Order tasks and begin legs where vehicles are at a waypoint, then advance all to the next look.

    Where nothing is simulated, legs are gone to their ends as they are planned.
    """
    waiting = [mission for mission in missions if mission.leg is None]
    for mission in waiting:  # what is decided without its planner would be decided for the wrong time
        mission.charge(mission.faults.left(PlannerOut, mission.now))
    _update_edge_times(context, waiting)
    plan_routes(context, [mission for mission in waiting if mission.cause])
    _begin(context, [mission for mission in waiting if not mission.ended])
    under_way = [mission for mission in missions if mission.leg is not None]
    executed = [mission for mission in under_way if context.simulated and not mission.active_leg.stays]
    if planned := [mission for mission in under_way if mission not in executed]:
        go_as_planned(context, planned)
    if executed:
        advance(context, executed)
    for mission in under_way:
        if not mission.active_leg.under_way:
            _judge(context, mission)


def _update_edge_times(context: SimulationContext, missions: list[Mission]) -> None:
    """Time the edges in the present current, and find the routes that no longer fit it."""
    planning = context.rules
    time_edges(context, missions)
    for mission in missions:
        if mission.cause or planning.replan != "deviation":
            continue
        times, rest = mission.timed.leg_times(context.speed), mission.rest
        if mission.timed.timetable is None:
            ends = mission.now + times[rest[:-1], rest[1:]].sum()
        else:
            ends = mission.now + float(mission.timed.itinerary(rest, context.speed).ends[-1])
        slack, due = mission.run.t_available - planning.reserve - ends, ""
        if slack < min(mission.slack, 0.0) - planning.tolerance:
            due = "late"
        elif slack - planning.allowance * (ends - mission.now) > planning.gain:
            due = "early"
        if decide(Facts(due=due)).act is Act.REPLAN_REST:
            mission.cause = due


def _begin(context: SimulationContext, missions: list[Mission]) -> None:
    """Plan the next leg of every mission, and begin those that are not refused."""
    if not missions:
        return
    expected, records = [mission.timed.leg_times(context.speed) for mission in missions], []
    for mission, times in zip(missions, expected, strict=True):
        i, j = mission.rest[:2]
        task, rho = float(mission.graph.duration[i, j]), float(mission.graph.priority[i, j])
        if context.scenario.tasks_under_way:
            task = 0.0
        expects, hold = float(times[i, j]), 0.0
        if mission.timed.timetable is not None:
            expects, hold = _by_the_clock(mission, i, j, expects, context.speed)
        revisit = j in mission.visited
        records.append(LegRecord(i, j, expects, task, rho, revisit=revisit, t_hold=hold))
    begin_legs(context, missions, records)
    for mission, times in zip(missions, expected, strict=True):
        mission.run.legs.append(mission.active_leg.record)
        if why := why_refused(context, mission, mission.active_leg, times):
            mission.now -= mission.active_leg.record.t_hold
            mission.active_leg.record.t_hold = 0.0
            _reject_leg(context, mission, mission.active_leg, why)
            mission.leg = None


def _by_the_clock(mission: Mission, i: int, j: int, least: float, speed: float) -> tuple[float, float]:
    """Wait for the way to open; return how long the leg is expected to take, waiting left out, and the wait.

    Where nothing says that the leg can be done, `least` is expected.
    """
    leg = mission.timed.itinerary([i, j], speed)  # its times count from now
    hold, arrives = leg.leaves.item(), leg.arrives.item()
    if not np.isfinite(arrives):
        return least, 0.0
    mission.now += hold
    return arrives - hold + float(mission.graph.duration[i, j]), hold


def why_refused(context: SimulationContext, mission: Mission, leg: Leg, times: np.ndarray) -> str:
    """Return why the planned leg should not be executed, or an empty string.

    A leg is refused when its path is not feasible, or when the time that the path takes would leave too
    little for the shortest way from its end to the destination, with the margin that its route was made with.
    """
    if why := unfit(context, mission, leg):
        return why
    if leg.record.goal == mission.run.goal or mission.refusals >= _REFUSALS or not context.rules.guard_return:
        return ""
    if context.rules.visits == "once":
        times = times.copy()
        times[:, leg.record.start] = np.inf
    to_go = float(time_to_go(times, mission.run.goal)[leg.record.goal])
    if not np.isfinite(to_go):
        return ""  # the route counts on edges that the estimate closed, for which a path may be found yet
    # A route that had to do without the margin would be made again.
    back = (1.0 + mission.last_route.return_margin) * to_go
    lasts = leg.followed.travel_time / mission.pace + leg.record.t_task
    late = mission.now + lasts + back - mission.run.t_available
    return f"its path would leave {late:.0f} s too little for the way back" if late > 0.0 else ""


def _reject_leg(context: SimulationContext, mission: Mission, leg: Leg, why: str) -> None:
    """Ask for another route without the refused edge, or with the time that its path takes."""
    mission.refusals += 1
    leg.record.refused = why
    barred = bool(unfit(context, mission, leg))
    i, j = leg.record.start, leg.record.goal
    name = f"leg {mission.run.called(i)} to {mission.run.called(j)}"
    mission.obstruction = f"{name}, {why}"
    if barred:
        mission.barred |= {(i, j), (j, i)}
        mission.graph = mission.graph.without_edges([(i, j)])
    else:
        mission.learnt[i, j] = leg.followed.travel_time
    mission.cause = "refused"
    stuck = barred and not mission.graph.adjacency[i].any() and not mission.visited - {i}
    if mission.refusals > _REFUSALS or stuck:
        mission.end(f"{name} cannot be executed: {why}")


def _judge(context: SimulationContext, mission: Mission) -> None:
    """After a leg: do the task, compare the leg's whole time with t_ij, decide on re-planning (3.3.2)."""
    run, planning, leg = mission.run, context.rules, mission.active_leg
    record = leg.record
    finish(leg)
    if isinstance(mission.sea, ModelSea):
        record.current_difference = mission.sea.difference(record.positions, record.times)
        record.current = mission.sea.along(record.positions, record.times, mean=not context.simulated)
    mission.leg = None
    if context.simulated:
        made = leg.speed_made / context.speed
        mission.pace = made if abs(made - 1.0) > _PACE else 1.0
    if planning.charge_compute:
        mission.charge(record.cpu)
    if not record.arrived:
        name = f"leg {mission.run.called(record.start)} to {mission.run.called(record.goal)}"
        mission.end(f"{name} was not finished: {leg.stopped}")
        return
    _await_window(mission, record)
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
    """Book how long the vehicle waits for the window of the task, or that it has missed it."""
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
    return graph.without_edges([(left, reached)]).without_task_at(reached)
