"""Infeasibility diagnosis: the leg without a feasible path, or the time that is too short."""

from functools import partial
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np

from auvplan.bbo import History
from auvplan.executive.context import Mission, SimulationContext
from auvplan.executive.route_calls import effort
from auvplan.mission import MissionGraph
from auvplan.mission.graph import shortest_way
from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.path import PathConfig, PathPlan, habitats
from auvplan.path.cost import evaluate, tracks
from auvplan.path.sensitivity import Conditions
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle

#: s added to the time of a closed edge, so that the shortest way has the fewest of them.
_CLOSED = 1e7


def why_no_route(context: SimulationContext, mission: Mission, timed: MissionGraph, forecast: Current) -> str:
    """One line on a mission that has no route over open edges.

    Args:
        context: what missions share.
        mission: where it stands, with its whole graph.
        timed: the graph without the edges that have no feasible path, as `time_edges` leaves it.
        forecast: the current that it was timed in.
    """
    run = mission.run
    cost, nodes = _way(context, mission, timed)
    if not nodes:
        return f"no way through the graph leads from waypoint {mission.here} to the destination"
    for i, j in pairwise(nodes):
        if not timed.adjacency[i, j]:
            return f"there is no path on leg {run.called(i)} to {run.called(j)}: " + _line_fault(
                context, mission, (i, j), forecast
            )
    left = run.t_available - mission.now
    return f"the shortest way to the destination takes {cost:.0f} s, {left:.0f} s are available"


def _way(context: SimulationContext, mission: Mission, timed: MissionGraph) -> tuple[float, list[int]]:
    """Return seconds and waypoints of the way to the destination over the fewest closed edges.

    Empty without one.
    """
    here, goal = mission.here, mission.run.goal
    everywhere = mission.graph.leg_times(context.speed) + _CLOSED
    times = np.where(timed.adjacency, timed.leg_times(context.speed), everywhere)
    nodes = shortest_way(times, here, goal)
    return float(times[nodes[:-1], nodes[1:]].sum()), nodes


def _line_fault(
    context: SimulationContext, mission: Mission, edge: tuple[int, int], forecast: Current
) -> str:
    """Return the limit that the straight line of an edge breaks most, where and when."""
    config, site = effort(context.path_config).path, mission.run.site
    start, goal = mission.graph.positions[list(edge)]
    line = straight_plan(start, goal, mission.now, context.environment(forecast), context.vehicle, config)
    if line.feasible:
        return "an end lies outside the area"
    return line.explain(line.broken()[0], site and site.epoch)


def straight_plan(
    start: np.ndarray,
    goal: np.ndarray,
    depart: float,
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
) -> PathPlan:
    """Return the straight line between two places as a path plan, kept limits or broken ones and all.

    Args:
        start, goal: [3] m.
        depart: s since the epoch.
        env: the world, without obstacles.
        vehicle: speed and limits.
        config: of the path planner; its search is not run.
    """
    found = jax.device_get(_straight(start, goal, depart, env, vehicle, config=config))
    nothing = jnp.zeros(0)
    return PathPlan(
        control_points=np.stack([start, goal]),
        violations=found["excess"].mean(axis=1),
        travel_time=float(found["times"][-1] - found["times"][0]),
        cost=np.nan,
        population=jnp.zeros((0, 3 * config.control_points)),
        history=History(*[nothing] * len(History.__dataclass_fields__)),
        conditions=Conditions(env, vehicle, config),
        **{name: float(found.pop(name)) for name in ("length", "clearance", "altitude")},
        **found,
    )


@partial(compiled, static_argnames=("config",))
def _straight(
    start: jax.Array, goal: jax.Array, depart: float, env: Environment, vehicle: Vehicle, config: PathConfig
) -> dict[str, jax.Array]:
    """Fields of a plan of the straight line."""
    line = tracks(habitats.straight_line(start, goal, config)[None], start, goal, env, vehicle, config)
    trajectory = evaluate(line, jnp.asarray(depart), env, vehicle, config)
    return {
        "positions": jnp.stack([trajectory.x[:, 0], trajectory.y[:, 0], trajectory.z[:, 0]], axis=1),
        "times": trajectory.times[:, 0],
        "excess": jnp.stack(trajectory.excess)[:, :, 0],
        "water": jnp.stack(trajectory.water, axis=-1)[:, 0],
        "length": trajectory.length[0],
        "clearance": trajectory.clearance.min(),
        "altitude": trajectory.altitude.min(),
    }
