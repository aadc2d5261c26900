"""Batched calls of the mission planner: travel times in the sea as it is told, then orders of tasks."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.mission import MissionConfig, MissionGraph, MissionOrder, plan_missions
from auvplan.mission.travel_times import TravelTimeConfig, programs
from auvplan.ocean.environment import Environment
from auvplan.path import PathConfig
from auvplan.voyage.batching import chunks
from auvplan.voyage.fleet import Fleet, Mission
from auvplan.voyage.records import OrderRecord
from auvplan.voyage.scenario import Scenario


def sea_times(scenario: Scenario) -> bool:
    """Whether travel times follow from the current, not from the distance alone."""
    kind = scenario.planning.travel_times
    return scenario.planning.preset != "paper" if kind is None else kind == "sea"


def effort(config: PathConfig) -> TravelTimeConfig:
    """The estimate's settings that go with a path planner's: its limits and margins, on fewer samples."""
    return TravelTimeConfig(path=config.replace(control_points=6, samples=64))


def time_edges(fleet: Fleet, missions: list[Mission], chosen: Sequence[int]) -> None:
    """Estimate the travel times of the edges that are left, from what is told of the sea now."""
    scenario = fleet.scenario
    fleet.current.advance(fleet.now)
    for m in chosen:
        missions[m].timed = missions[m].graph
    for batch, real in chunks(list(chosen) if sea_times(scenario) else []):
        told = fleet.current.told(batch, scenario.current.forecast_error)
        area = scenario.area
        env = Environment(told, fleet.chart, None, area.lower, area.upper)  # type: ignore[arg-type]
        # The graphs need no padding: their edges are padded.
        graphs = MissionGraph.stack(missions[m].graph for m in batch[:real])
        timed, seconds = _timed(fleet, graphs, env, fleet.now[batch[:real]])
        allowance = scenario.planning.detour * scenario.obstacles.total
        for row, m in enumerate(batch[:real]):
            graph = jax.tree.map(lambda field, row=row: field[row], timed)
            missions[m].timed = replace(graph, travel_time=graph.travel_time + allowance)
            missions[m].run.estimate_seconds += seconds / real
            if scenario.planning.charge_compute:
                fleet.now[m] += seconds / real
                missions[m].run.charged_compute += seconds / real
    for m in chosen:
        for (i, j), seconds in missions[m].learnt.items():
            missions[m].timed = missions[m].timed.with_travel_time(i, j, seconds)


def _timed(
    fleet: Fleet, graphs: MissionGraph, env: Environment, now: np.ndarray
) -> tuple[MissionGraph, float]:
    """Timed graphs and the wall-clock seconds that took, free of compilation."""
    while True:
        # Which programs are needed shows only as blocked edges turn up.
        compiled = programs()
        timed, seconds = fleet.clock.time(
            ("travel times",),
            lambda: graphs.with_travel_times(env, fleet.vehicle, now, effort(fleet.config), True),
        )
        if programs() == compiled:
            return timed, seconds
        fleet.clock.compile_seconds += seconds


def plan_orders(fleet: Fleet, missions: list[Mission], due: Sequence[int], config: MissionConfig) -> None:
    """Plan the order of tasks for the missions that need one, from where each stands."""
    planning = fleet.scenario.planning
    # Slack is kept for the last legs, which no re-planning can mend; where nothing fits with it, it is halved
    # and in the end given up. Then edges that the estimate closed are tried: a path may be found yet.
    for share, final in ((1.0, False), (0.5, False), (0.0, False), (0.0, True)):
        due = [m for m in due if missions[m].cause and not missions[m].ended]
        if final:
            for m in due:
                missions[m].timed = replace(missions[m].timed, adjacency=missions[m].graph.adjacency)
        if not due:
            return
        left = [missions[m].run.t_available - fleet.now[m] - share * planning.reserve for m in due]
        keys = [
            jax.random.fold_in(jax.random.fold_in(fleet.keys[m], 0), len(missions[m].run.orders)) for m in due
        ]
        orders, seconds = fleet.clock.time(
            ("mission", missions[due[0]].graph.size, config),
            partial(
                plan_missions,
                MissionGraph.stack(missions[m].timed for m in due),
                np.asarray([missions[m].here for m in due]),
                np.asarray([missions[m].run.goal for m in due]),
                np.maximum(left, 1.0),
                speed=fleet.vehicle.speed,
                keys=jnp.stack(keys),
                config=config,
                return_margin=share * return_margin(fleet.scenario),
                known_orders=[missions[m].rest or None for m in due],
            ),
        )
        for m, order in zip(due, orders, strict=True):
            _take(fleet, m, missions[m], order, seconds / len(due), final)


def return_margin(scenario: Scenario) -> float:
    """Share by which the way back is taken to last longer than expected."""
    given = scenario.planning.return_margin
    if given is not None:
        return given
    return 0.2 if sea_times(scenario) else 0.4


def _take(fleet: Fleet, m: int, mission: Mission, order: MissionOrder, seconds: float, final: bool) -> None:
    """Book a new order, or end the mission where there is none."""
    run, now = mission.run, float(fleet.now[m])
    if not order.feasible:
        if final:
            mission.end(now, f"no order of tasks from waypoint {mission.here}: {order.reason}")
        return
    nodes = [int(node) for node in order.nodes]
    run.first_order = run.first_order or order
    run.orders.append(
        OrderRecord(now, nodes, float(order.time), float(order.priority), seconds, mission.cause)
    )
    mission.order, mission.step, mission.cause = order, 0, ""
    mission.slack = run.t_available - fleet.scenario.planning.reserve - (now + float(order.time))
    if fleet.scenario.planning.charge_compute:
        fleet.now[m] += seconds
        run.charged_compute += seconds
