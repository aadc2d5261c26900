"""The hierarchical loop of Fig. 7 over a batch of missions: order the tasks, plan, sail, compare, re-plan.

One mission is a batch of one. All missions stand at the same step of the loop, each at its own time; the legs
of all of them are planned in one batched call, and so are the orders that are due.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.mission import MissionConfig, time_to_go
from auvplan.path import PathConfig
from auvplan.voyage.fleet import Fleet, Leg, Mission
from auvplan.voyage.legs import begin_legs, refusal, sail_legs
from auvplan.voyage.order_calls import plan_orders, return_margin, time_edges
from auvplan.voyage.records import LegRecord, MissionRun
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.simulator import TrueCurrent
from auvplan.voyage.world import current_update, make_chart, make_current, make_graph, make_vehicle

#: Legs that may be refused at one waypoint before the mission is given up.
_REFUSALS = 8

Progress = Callable[[int, float, str], None]


def run_mission(
    scenario: Scenario,
    *,
    key: jax.Array,
    seed: int = 0,
    folder: str | Path = ".",
    progress: Progress | None = None,
) -> MissionRun:
    """Plan and sail one mission; see `run_missions`."""
    return run_missions(scenario, keys=key[None], seeds=[seed], folder=folder, progress=progress)[0]


def run_missions(
    scenario: Scenario,
    *,
    keys: jax.Array,
    seeds: Sequence[int] | None = None,
    folder: str | Path = ".",
    progress: Progress | None = None,
) -> list[MissionRun]:
    """Plan and sail B missions of a scenario in lockstep.

    Args:
        scenario: settings; graph, current and obstacles differ by key.
        keys: [B] PRNG keys; the result of a mission depends on its own key alone.
        seeds: B numbers to report beside the results.
        folder: that relative paths in the scenario start from.
        progress: called with (mission, time s, what it does) as missions advance.

    Returns:
        One record a mission. A mission that fails is a record too: see `MissionRun.success` and `.reason`.

    Raises:
        ScenarioError, ChartError: the scenario cannot be built.
    """
    fleet, missions = _embark(scenario, keys, seeds or range(len(keys)), folder)
    config = mission_config(scenario)
    while active := [m for m, mission in enumerate(missions) if not mission.ended]:
        _take_stock(fleet, missions, active)
        plan_orders(fleet, missions, [m for m in active if missions[m].cause], config)
        _sail_next(fleet, missions, [m for m in active if not missions[m].ended], progress)
    for mission in missions:
        mission.run.compile_seconds = fleet.clock.compile_seconds
    return [mission.run for mission in missions]


def path_config(scenario: Scenario) -> PathConfig:
    """The path planner's settings under the scenario's preset."""
    config = PathConfig.paper() if scenario.planning.preset == "paper" else PathConfig()
    return config.replace(t_series=scenario.planning.t_series)


def mission_config(scenario: Scenario) -> MissionConfig:
    """The mission planner's settings under the scenario's preset."""
    config = MissionConfig.paper() if scenario.planning.preset == "paper" else MissionConfig()
    objective = scenario.planning.objective
    return config if objective is None else config.replace(objective=objective)


def _embark(
    scenario: Scenario, keys: jax.Array, seeds: Sequence[int], folder: str | Path
) -> tuple[Fleet, list[Mission]]:
    """Build the worlds; nothing is planned yet."""
    chart, vehicle = make_chart(scenario, folder), make_vehicle(scenario)
    plain = scenario.model_dump(mode="json")
    missions, rngs, fields, sea_keys, planner_keys = [], [], [], [], []
    for key, seed in zip(keys, seeds, strict=True):
        graph_key, field_key, sea_key, planner_key, chance_key = jax.random.split(key, 5)
        graph = make_graph(scenario, chart, _generator(graph_key))
        last, available = graph.size - 1, scenario.mission.time_available
        run = MissionRun(plain, int(seed), vehicle, graph, chart, 0, last, available)
        missions.append(Mission(run, graph, graph, 0))
        rngs.append(_generator(chance_key))
        fields.append(make_current(scenario, field_key))
        sea_keys.append(sea_key)
        planner_keys.append(planner_key)
    current = TrueCurrent(
        jnp.stack(sea_keys), fields, current_update(scenario), scenario.current.update_interval
    )
    count = len(missions)
    return (
        Fleet(
            scenario,
            path_config(scenario),
            vehicle,
            chart,
            current,
            jnp.stack(planner_keys),
            rngs,
            np.zeros(count),
            np.zeros(count, int),
        ),
        missions,
    )


def _generator(key: jax.Array) -> np.random.Generator:
    return np.random.default_rng(np.asarray(jax.random.key_data(key)).tolist())


def _take_stock(fleet: Fleet, missions: list[Mission], active: list[int]) -> None:
    """Time the edges in the sea as it is now, and see which orders no longer fit it."""
    planning = fleet.scenario.planning
    time_edges(fleet, missions, active)
    for m in active:
        mission = missions[m]
        if mission.cause or planning.replan != "deviation":
            continue
        times = mission.timed.leg_times(float(fleet.vehicle.speed))  # type: ignore[arg-type]
        rest = mission.rest
        ends = fleet.now[m] + times[rest[:-1], rest[1:]].sum()
        slack = mission.run.t_available - planning.reserve - ends
        if slack < min(mission.slack, 0.0) - planning.tolerance:
            mission.cause = "late"
        elif slack > planning.gain:
            mission.cause = "early"


def _sail_next(fleet: Fleet, missions: list[Mission], active: list[int], progress: Progress | None) -> None:
    """Plan and sail the next leg of every active mission, do its task, and judge the time it took (3.3.2)."""
    if not active:
        return
    records, ends = [], []
    times = {m: missions[m].timed.leg_times(float(fleet.vehicle.speed)) for m in active}  # type: ignore[arg-type]
    for m in active:
        mission = missions[m]
        i, j = mission.rest[:2]
        graph = mission.graph
        task, rho = float(graph.duration[i, j]), float(graph.priority[i, j])
        records.append(LegRecord(i, j, float(times[m][i, j]), task, rho))
        ends.append((graph.positions[i], graph.positions[j]))
    legs = begin_legs(fleet, active, records, ends)
    begun = []
    for m, leg in zip(active, legs, strict=True):
        if why := _refused(fleet, m, missions[m], leg, times[m]):
            _turn_down(fleet, m, missions[m], leg, why)
        else:
            missions[m].run.legs.append(leg.record)
            begun.append(leg)
    doing = {leg.mission: f"leg {leg.record.start} to {leg.record.goal}" for leg in begun}
    tick = None if progress is None else (lambda m, now: progress(m, now, doing[m]))
    deadline = fleet.scenario.mission.time_available
    sail_legs(fleet, begun, deadline, tick)
    for leg in begun:
        _judge(fleet, leg.mission, missions[leg.mission], leg.record, leg.stopped)


def _refused(fleet: Fleet, m: int, mission: Mission, leg: Leg, times: np.ndarray) -> str:
    """Why the planned leg should not be sailed, or an empty string.

    A leg is refused when its path is not feasible, or when the time that the path takes would leave too
    little for the shortest way from its end to the destination, although another order might still do.
    """
    if why := refusal(leg):
        return why
    if leg.record.goal == mission.run.goal or mission.refusals >= _REFUSALS:
        return ""
    to_go = float(time_to_go(jnp.asarray(times), mission.run.goal)[leg.record.goal])
    back = (1.0 + return_margin(fleet.scenario)) * to_go
    late = fleet.now[m] + leg.followed.travel_time + leg.record.t_task + back - mission.run.t_available
    return f"its path would leave {late:.0f} s too little for the way back" if late > 0.0 else ""


def _turn_down(fleet: Fleet, m: int, mission: Mission, leg: Leg, why: str) -> None:
    """Ask for another order without the refused edge, or with the time that its path takes."""
    mission.refusals += 1
    i, j = leg.record.start, leg.record.goal
    mission.run.legs.append(leg.record)
    barred = bool(refusal(leg))
    if barred:
        mission.graph = mission.graph.without_edges([(i, j)])
    else:
        mission.learnt[i, j] = leg.followed.travel_time
    mission.cause = "refused"
    if mission.refusals > _REFUSALS or (barred and not mission.graph.adjacency[i].any()):
        mission.end(float(fleet.now[m]), f"leg {i} to {j} cannot be sailed: {why}")


def _judge(fleet: Fleet, m: int, mission: Mission, record: LegRecord, stopped: str) -> None:
    """After a leg: do the task, compare the leg's whole time with t_ij, decide on re-planning (3.3.2)."""
    run, planning = mission.run, fleet.scenario.planning
    if planning.charge_compute:
        fleet.now[m] += record.cpu
        run.charged_compute += record.cpu
    if not record.arrived:
        mission.end(float(fleet.now[m]), f"leg {record.start} to {record.goal} was not finished: {stopped}")
        return
    fleet.now[m] += record.t_task
    mission.refusals = 0
    mission.here = record.goal
    mission.step += 1
    mission.graph = mission.graph.without_edges([(record.start, record.goal)])
    if record.goal == run.goal:
        mission.end(float(fleet.now[m]), "")
    elif planning.replan == "late" and record.t_path + record.t_task > record.t_expected:
        mission.cause = "late"
