"""Batched calls of the mission planner: travel times in the sea as it is told, then orders of tasks."""

from dataclasses import replace
from functools import partial

import jax.numpy as jnp
import numpy as np

from auvplan.mission import MissionConfig, MissionGraph, MissionOrder, plan_missions
from auvplan.mission.travel_times import TravelTimeConfig, programs
from auvplan.path import PathConfig
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


def time_edges(fleet: Fleet, missions: list[Mission]) -> None:
    """Estimate the travel times of the edges that are left, from what is told of the sea now."""
    scenario = fleet.scenario
    allowance = scenario.planning.detour * scenario.obstacles.total
    for mission in missions:
        mission.timed = mission.graph
        if sea_times(scenario):
            mission.sea.advance(mission.now)
            timed, seconds = _timed(fleet, mission)
            mission.timed = replace(timed, travel_time=timed.travel_time + allowance)
            mission.run.estimate_seconds += seconds
            if scenario.planning.charge_compute:
                mission.charge(seconds)
        for (i, j), seconds in mission.learnt.items():
            mission.timed = mission.timed.with_travel_time(i, j, seconds)


def _timed(fleet: Fleet, mission: Mission) -> tuple[MissionGraph, float]:
    """The timed graph and the wall-clock seconds that took, free of compilation."""
    env = fleet.environment(mission.sea.told())
    config = effort(fleet.path_config)
    while True:
        # Which programs are needed shows only as blocked edges turn up.
        compiled = programs()
        timed, seconds = fleet.clock.time(
            ("travel times",),
            lambda: mission.graph.with_travel_times(env, fleet.vehicle, mission.now, config),
        )
        if programs() == compiled:
            return timed, seconds
        fleet.clock.compile_seconds += seconds


def plan_orders(fleet: Fleet, missions: list[Mission]) -> None:
    """Plan the order of tasks for the missions that need one, from where each stands."""
    # Slack is kept for the last legs, which no re-planning can mend; where nothing fits with it, it is halved
    # and in the end given up. Then edges that the estimate closed are tried: a path may be found yet.
    for share, final in ((1.0, False), (0.5, False), (0.0, False), (0.0, True)):
        due = [mission for mission in missions if mission.cause and not mission.ended]
        if final:
            for mission in due:
                mission.timed = replace(mission.timed, adjacency=mission.graph.adjacency)
        groups: dict[MissionConfig, list[Mission]] = {}
        for mission in due:
            groups.setdefault(_config(fleet, mission), []).append(mission)
        for config, group in groups.items():
            _plan_orders(fleet, group, config, share, final)


def _config(fleet: Fleet, mission: Mission) -> MissionConfig:
    """Settings for the mission's next order; places for neighbours come from its own graph alone."""
    first, later = fleet.order_configs
    most = int(np.asarray(mission.run.graph.adjacency).sum(axis=1).max())
    config = first if mission.order is None else later
    return config.replace(degree=max(config.degree, 1 << (most - 1).bit_length()))


def _plan_orders(
    fleet: Fleet, missions: list[Mission], config: MissionConfig, share: float, final: bool
) -> None:
    """One call of the mission planner that keeps a share of the slack, and what it found."""
    reserve = share * fleet.scenario.planning.reserve
    left = [mission.run.t_available - mission.now - reserve for mission in missions]
    orders, seconds = fleet.clock.time(
        ("mission", missions[0].graph.size, config),
        partial(
            plan_missions,
            MissionGraph.stack(mission.timed for mission in missions),
            np.asarray([mission.here for mission in missions]),
            np.asarray([mission.run.goal for mission in missions]),
            np.maximum(left, 1.0),
            speed=fleet.vehicle.speed,
            keys=jnp.stack([mission.order_key() for mission in missions]),
            config=config,
            return_margin=share * return_margin(fleet.scenario),
            known_orders=[mission.rest or None for mission in missions],
        ),
    )
    for mission, order in zip(missions, orders, strict=True):
        _take(fleet, mission, order, seconds / len(missions), final)


def return_margin(scenario: Scenario) -> float:
    """Share by which the way back is taken to last longer than expected."""
    given = scenario.planning.return_margin
    if given is not None:
        return given
    return 0.2 if sea_times(scenario) else 0.4


def _take(fleet: Fleet, mission: Mission, order: MissionOrder, seconds: float, final: bool) -> None:
    """Book a new order, or end the mission where there is none."""
    run, planning = mission.run, fleet.scenario.planning
    if not order.feasible:
        if final:
            refused = f"; refused before: {mission.obstruction}" if mission.obstruction else ""
            mission.end(f"no order of tasks from waypoint {mission.here}: {order.reason}{refused}")
        return
    nodes = [int(node) for node in order.nodes]
    run.first_order = run.first_order or order
    run.orders.append(
        OrderRecord(mission.now, nodes, float(order.time), float(order.priority), seconds, mission.cause)
    )
    mission.order, mission.step, mission.cause = order, 0, ""
    mission.slack = run.t_available - planning.reserve - (mission.now + float(order.time))
    if planning.charge_compute:
        mission.charge(seconds)
