"""A small hand-made run: four waypoints, three legs, a chart with a narrow spit, moving obstacles."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from auvplan.mission.graph import MissionGraph
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure
from auvplan.ocean.vortices import LambVortices
from auvplan.path.motion import Motion
from auvplan.records import LegRecord, MissionRun, PlanRecord, RouteRecord
from auvplan.vehicle import Vehicle

SPEED = 2.5
#: Rows (north) and columns (east) of the land: a spit one pixel wide that reaches in from the north.
SPIT = (slice(120, 200), slice(150, 151))

WAYPOINTS = np.array(
    [[300.0, 300.0, 20.0], [700.0, 900.0, 40.0], [1000.0, 1800.0, 30.0], [400.0, 1200.0, 25.0]]
)


def make_chart() -> Chart:
    """2 x 2 km of 10 m pixels: water, a spit, an uncertain fringe beside it."""
    passability = np.ones((200, 200))
    passability[120:, 140:161] = 0.2
    passability[SPIT] = 0.0
    return Chart.from_passability(passability, 10.0)


def make_graph(waypoints: np.ndarray = WAYPOINTS) -> MissionGraph:
    """All waypoints linked but 0 and 2."""
    adjacency = ~np.eye(len(waypoints), dtype=bool)
    adjacency[0, 2] = adjacency[2, 0] = False
    priority = np.where(adjacency, 3.0, 0.0)
    priority[1, 2] = priority[2, 1] = 0.0
    return MissionGraph(waypoints, adjacency, priority, np.where(adjacency, 60.0, 0.0))


def make_closure() -> Closure:
    """A band 200 m wide across the chart, closed from 100 s to 200 s, and 30 s longer at either end."""
    passability = np.ones((200, 200))
    passability[50:70] = 0.0
    return Closure(Chart.from_passability(passability, 10.0), np.array([70.0]), np.array([230.0]), "band")


def make_vortices() -> LambVortices:
    """Two vortices in two layers, so weak that they move nothing by more than 2 cm/s."""
    return LambVortices(
        centers=np.array([[[500.0, 800.0], [1200.0, 1500.0]]] * 2),
        strength=np.array([[20.0, -30.0]] * 2),
        radius=np.array([[300.0, 400.0]] * 2),
        depths=np.array([0.0, 100.0]),
    )


def make_plan(start: np.ndarray, goal: np.ndarray, made_at: float, cause: str, bend: float) -> PlanRecord:
    """A plan in an arc that leaves the straight line by `bend` metres."""
    share = np.linspace(0.0, 1.0, 32)
    positions = start + (goal - start) * share[:, None]
    positions[:, 0] += bend * np.sin(np.pi * share)
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    times = made_at + np.concatenate([[0.0], np.cumsum(gaps / SPEED)])
    fall = np.exp(-np.arange(21) / 5.0)
    history = {
        "best": 300.0 + 400.0 * fall, "mean": 400.0 + 3000.0 * fall, "std": 20.0 + 800.0 * fall,
        "violation_best": np.maximum(5.0 * fall - 1.0, 0.0), "violation_mean": 40.0 * fall,
        "violation_std": 15.0 * fall,
    }  # fmt: skip
    duration = float(times[-1] - times[0])
    motion = Motion.along("track", SPEED, np.diff(positions, axis=0), np.zeros((31, 3)))
    return PlanRecord(made_at, positions, times, duration, True, cause, 0.2, history, make_vortices(), motion)


def make_leg(
    graph: MissionGraph, i: int, j: int, depart: float, obstacles: bool = True, interval: float = 3.0
) -> LegRecord:
    """Make a leg straight ahead at constant speed, with a record every `interval` s."""
    start, goal = graph.positions[i], graph.positions[j]
    length = float(np.linalg.norm(goal - start))
    times = np.append(np.arange(0.0, length / SPEED - 1e-6, interval), length / SPEED)
    positions = start + (goal - start) * (times / times[-1])[:, None]
    task = float(graph.duration[i, j])
    leg = LegRecord(i, j, length / SPEED + task + 5.0, task, float(graph.priority[i, j]), arrived=True)
    leg.times, leg.positions = depart + times, positions
    straight = np.broadcast_to(SPEED * (goal - start) / length, positions.shape)
    leg.motion = Motion.through_water(straight, np.zeros(3))
    leg.plans = [make_plan(start, goal, depart, "leg", 80.0)]
    middle = len(times) // 2
    leg.plans.append(make_plan(positions[middle], goal, float(leg.times[middle]), "window", 30.0))
    leg.obstacle_positions = np.zeros((len(times), 0, 3))
    if obstacles:
        across = np.array([start[1] - goal[1], goal[0] - start[0], 0.0]) / length
        still = positions[middle] + 200.0 * across
        moving = positions[middle] - 150.0 * across + (times - times[middle])[:, None] * 0.2 * across
        leg.obstacle_positions = np.stack([np.broadcast_to(still, positions.shape), moving], axis=1)
        leg.obstacle_radii = np.array([40.0, 25.0])
        leg.obstacle_kinds = ["static", "self-motivated"]
    return leg


def make_run(
    nodes: tuple[int, ...] = (0, 1, 3, 2),
    chart: bool = True,
    obstacles: bool = True,
    waypoints: np.ndarray = WAYPOINTS,
    interval: float = 3.0,
) -> MissionRun:
    """Make a run through the waypoints in order, without a fault."""
    graph, now = make_graph(waypoints), 0.0
    run = MissionRun(
        {"name": "sample", "area": {"lower": [0.0, 0.0, 0.0], "upper": [2000.0, 2000.0, 100.0]}},
        7, Vehicle(speed=SPEED), graph, make_chart() if chart else None, nodes[0], nodes[-1], 3000.0,
    )  # fmt: skip
    worth = [float(graph.priority[i, j]) for i, j in pairwise(nodes)]
    run.saved_bound = sum(worth)
    run.routes.append(RouteRecord(0.0, list(nodes), 1500.0, sum(worth), 0.3, "start"))
    for k, (i, j) in enumerate(pairwise(nodes)):
        leg = make_leg(graph, i, j, now, obstacles, interval)
        run.legs.append(leg)
        now = float(leg.times[-1]) + leg.t_task
        if k == 0 and len(nodes) > 2:
            run.routes.append(RouteRecord(now, list(nodes[1:]), 1100.0, sum(worth[1:]), 0.3, "late"))
    expected = [leg.t_expected for leg in run.legs]
    for route in run.routes:  # as many of the last legs as it has
        route.leg_times = expected[-(len(route.nodes) - 1) :]
        route.waits, route.time = [0.0] * len(route.leg_times), sum(route.leg_times)
    run.t_mission, run.arrived, run.reason = now, True, "destination reached in time"
    return run


def refused_leg(run: MissionRun) -> LegRecord:
    """A leg that was planned and never executed."""
    leg = LegRecord(1, 2, 400.0, 60.0, 0.0)
    leg.plans = [make_plan(WAYPOINTS[1], WAYPOINTS[2], float(run.legs[1].times[0]), "leg", 10.0)]
    leg.obstacle_radii, leg.obstacle_kinds = np.array([30.0, 20.0]), ["static", "afloat"]
    return leg


def at_speeds(run: MissionRun, speeds: Sequence[float | None]) -> MissionRun:
    """Return a run whose legs are gone at speeds through the water of their own, one after the other."""
    run = replace(run, legs=list(run.legs), routes=[replace(route) for route in run.routes])
    now, begun = 0.0, {}
    for k, (leg, speed) in enumerate(zip(run.legs, speeds, strict=True)):
        share, begins = (speed or SPEED) / SPEED, float(leg.times[0])
        begun[begins] = now

        def later(times, begins=begins, now=now, share=share):
            return now + (np.asarray(times) - begins) / share

        def paced(motion, share=share):
            return replace(motion, ground_velocity=share * motion.ground_velocity)

        plans = [
            replace(
                plan, made_at=float(later(plan.made_at)), times=later(plan.times), motion=paced(plan.motion)
            )
            for plan in leg.plans
        ]
        run.legs[k] = replace(
            leg, speed=speed, times=later(leg.times), motion=paced(leg.motion), plans=plans,
            t_expected=leg.t_task + (leg.t_expected - leg.t_task) / share,
        )  # fmt: skip
        now = run.legs[k].ends
    for route in run.routes:
        route.made_at, count = begun[route.made_at], len(route.nodes) - 1
        route.leg_times = [leg.t_expected for leg in run.legs[-count:]]
        route.time, route.speeds = sum(route.leg_times), [speed or SPEED for speed in speeds[-count:]]
    run.t_mission = now
    return run
