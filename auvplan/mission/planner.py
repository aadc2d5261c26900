"""The mission planner: a graph and a time budget into an order of tasks (section 3.3)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import jax
import numpy as np

from auvplan.mission import decoder as decoders
from auvplan.mission.config import MissionConfig
from auvplan.mission.evolution import search_missions
from auvplan.mission.exact import certify
from auvplan.mission.graph import MissionGraph
from auvplan.mission.order import MissionOrder, MissionOrders, MissionStatus
from auvplan.mission.problem import Edges, rounding_margin
from auvplan.prng import as_key
from auvplan.rows import batch_map

if TYPE_CHECKING:
    from auvplan.vehicle import Vehicle

#: One program serves searches of up to so many iterations.
_ITERATIONS = 256

#: Graphs are padded with waypoints that no edge leads to, so that one program serves several numbers of them:
#: to one of these, or to a multiple of the largest.
_SIZES = (16, 40, 64, 80, 100, 125, 160, 200, 250, 320, 400, 500)


def plan_mission(
    graph: MissionGraph,
    start: int,
    goal: int,
    time_available: float,
    vehicle: "Vehicle | None" = None,
    *,
    key: jax.Array,
    config: MissionConfig | None = None,
    population: Any = None,
    speed: float | None = None,
    visited: Any = None,
    known_order: Sequence[int] | np.ndarray | None = None,
    method: Literal["search", "exact"] = "search",
    time_limit: float = 10.0,
) -> MissionOrder:
    """Find the order of tasks of most total priority that reaches the destination in time.

    The search starts from random habitats, good orders of a beam search, the shortest mission and the
    greediest one, so that its answer is feasible whenever a feasible mission exists (up to rounding of
    T_available in the last digits).

    To re-plan on the way (section 3.3.2) call it again from the waypoint reached, with the passed edges taken
    out (`MissionGraph.without_edges`), the time that is left, `population` of the last order, and the rest of
    that order as `known_order`.

    Args:
        graph: N waypoints.
        start: index of the waypoint where the vehicle is.
        goal: index of the destination; equal to `start` it gives the empty mission.
        time_available: T_available, s; the mission takes strictly less.
        vehicle: its `speed` is |v| of Eq. 13, m/s.
        key: PRNG key, consumed; the same key gives the same order.
        config: settings; defaults to `MissionConfig()`.
        population: [Q, D] habitats to start from, Q at most P, best first, as `MissionOrder.population`.
        speed: m/s, instead of `vehicle`.
        visited: [N] bool, waypoints not to be visited again; none by default.
        known_order: [n] waypoints from start to goal; the answer costs no more, if it keeps all limits.
        method: "exact" hands the order found to OR-Tools CP-SAT, which improves and proves it: `bound` of the
            answer is what it proved. It needs the extra `auvplan[exact]` and objective "priority".
        time_limit: s, of the exact method.

    Raises:
        ValueError: an argument is out of range or of the wrong shape.
        TypeError: the key is none, such as a seed.
        ImportError: method "exact" without OR-Tools.

    Example:
        >>> import jax, numpy as np
        >>> from auvplan.mission import plan_mission, random_graph
        >>> rng = np.random.default_rng(0)
        >>> graph = random_graph(rng, rng.uniform(0.0, 1000.0, (8, 3)), neighbours=3)
        >>> order = plan_mission(graph, 0, 7, 1800.0, speed=2.5, key=jax.random.key(0))
        >>> order.feasible, bool(order.time < 1800.0)
        (True, True)
        >>> order.priority <= order.bound
        True

    Differences from the paper:
        Its search starts from random priority vectors alone and minimises Eq. 15: `MissionConfig.paper()`.
    """
    if method not in ("search", "exact"):
        raise ValueError(f'method must be "search" or "exact", got {method!r}')
    if method == "exact" and config is not None and config.objective != "priority":
        raise ValueError(f'method "exact" needs objective "priority", got {config.objective!r}')
    if np.ndim(graph.positions) != 2:
        raise ValueError("plan_mission takes one graph: give stacked graphs to plan_missions")
    if (vehicle is None) == (speed is None):
        raise ValueError("give either vehicle or speed")
    orders = plan_missions(
        jax.tree.map(lambda field: np.asarray(field)[None], graph),
        [start],
        [goal],
        [time_available],
        vehicle.speed if vehicle is not None else speed,
        as_key(key)[None],
        populations=None if population is None else np.asarray(population)[None],
        config=config,
        visited=None if visited is None else np.asarray(visited)[None],
        known_orders=None if known_order is None else [known_order],
    )
    return certify(orders[0], time_limit) if method == "exact" else orders[0]


def plan_missions(
    graphs: MissionGraph,
    starts: Sequence[int] | np.ndarray,
    goals: Sequence[int] | np.ndarray,
    time_available: Any,
    speed: Any,
    keys: jax.Array,
    populations: Any = None,
    config: MissionConfig | None = None,
    visited: Any = None,
    return_margin: Any = 0.0,
    known_orders: Sequence[Sequence[int] | np.ndarray | None] | None = None,
) -> MissionOrders:
    """`plan_mission` for B missions with one compiled program, on all cores at once.

    Args:
        graphs: stacked along a leading axis B (`MissionGraph.stack`).
        starts, goals: [B] indices.
        time_available: [B] s, or one for all.
        speed: [B] m/s, or one for all.
        keys: [B] PRNG keys, consumed.
        populations: [B, Q, D] habitats to start from, as `MissionOrders.population`.
        config: settings; defaults to `MissionConfig()`.
        visited: [B, N] bool, waypoints not to be visited again.
        return_margin: [B] or one for all; share by which the way from any waypoint to the destination is
            taken to last longer than expected. It keeps slack for bad surprises where they cannot be mended:
            on the last legs. An order may then be reported out of time although it would just do.
        known_orders: for each mission the waypoints of an order from its start to its goal, or None.

    Raises:
        ValueError: an argument is out of range or of the wrong shape.
    """
    config = config or MissionConfig()
    graphs, keys = jax.tree.map(np.asarray, graphs), as_key(keys, "keys")
    if graphs.positions.ndim != 3:
        raise ValueError(f"graphs must be stacked, positions [B, N, 3], got shape {graphs.positions.shape}")
    batch, size = graphs.positions.shape[:2]
    starts, goals = _indices("start", starts, batch, size), _indices("goal", goals, batch, size)
    budget = _figures("time_available", time_available, batch)
    rate = _figures("speed", speed, batch)
    if not (rate > 0.0).all():
        raise ValueError(f"speed must be positive, got {rate.min():g} m/s")
    if len(keys) != batch:
        raise ValueError(f"keys must be [{batch}], one for each mission, got {len(keys)}")
    closed = np.zeros((batch, size), bool) if visited is None else np.asarray(visited, bool)
    if closed.shape != (batch, size):
        raise ValueError(f"visited must be [{size}] for each of {batch} missions, got shape {closed.shape}")
    margins = _figures("return_margin", return_margin, batch)
    given, count = _given(populations, batch, size, config)
    known = _known(known_orders, starts, goals, size)

    legs, iterations, more = graphs.leg_times(rate), config.bbo.iterations, _padded(size) - size
    shared = config.replace(bbo=config.bbo.replace(iterations=max(iterations, _ITERATIONS)))
    square, row = [(0, 0), (0, more), (0, more)], [(0, 0), (0, more)]
    edges = Edges.of(
        np.pad(legs, square, constant_values=np.inf),
        np.pad(graphs.priority, square),
        config.degree,
        None if graphs.timetable is None else graphs.timetable.padded(more),
        np.pad(graphs.duration, square),
    )
    found = batch_map(
        partial(search_missions, count=count, iterations=np.int32(iterations), config=shared),
        keys,
        edges,
        starts,
        goals,
        budget.astype(np.float32),
        np.pad(closed, row),
        margins.astype(np.float32),
        np.insert(given, [size] * more, 0, axis=2),
        np.pad(known, row, constant_values=-1),
    )
    result, best, least = found
    population = np.delete(result.state.population, np.s_[size : size + more], axis=2)
    history = jax.tree.map(lambda rows: rows[:, : iterations + 1], result.history)
    result = replace(result, state=replace(result.state, population=population), history=history)
    best = replace(best, nodes=best.nodes[..., :size])
    open_legs = np.where(closed[:, None, :], np.inf, legs)
    return _collect(result, best, least, graphs, open_legs, starts, goals, budget, margins)


def _padded(size: int) -> int:
    """Return the number of waypoints that a graph of `size` of them is padded to."""
    return next((most for most in _SIZES if most >= size), -(-size // _SIZES[-1]) * _SIZES[-1])


def _collect(
    result: Any,
    best: Any,
    least: np.ndarray,
    graphs: MissionGraph,
    legs: np.ndarray,
    starts: np.ndarray,
    goals: np.ndarray,
    budget: np.ndarray,
    margins: np.ndarray,
) -> MissionOrders:
    """Return what a search found as orders, added up in double precision."""
    batch, size = legs.shape[:2]
    reached = np.asarray(best.reached[:, 0])
    nodes = np.where(reached[:, None], best.nodes[:, 0], -1)
    nodes[:, 0] = starts
    late = (1.0 + margins) * least >= budget * (1.0 - 4.0 * rounding_margin(size))
    here, there = nodes[:, :-1], nodes[:, 1:]
    taken = there >= 0
    rows = np.arange(batch)[:, None]
    leg_times, waits = np.where(taken, legs[rows, here, there], 0.0), np.zeros((batch, size - 1))
    if graphs.timetable is not None:
        leg_times, waits = _by_the_clock(graphs, nodes)
        kept = leg_times.sum(axis=1) < budget
        reached &= kept
        nodes[~kept, 1:], leg_times[~kept], waits[~kept] = -1, 0.0, 0.0
        there, taken = nodes[:, 1:], nodes[:, 1:] >= 0
    rho = np.where(taken, graphs.priority[rows, here, there], 0.0)
    return MissionOrders(
        nodes=nodes,
        count=1 + taken.sum(axis=1),
        time=leg_times.sum(axis=1),
        priority=rho.sum(axis=1),
        tasks=(rho > 0.0).sum(axis=1),
        cost=result.cost,
        leg_times=leg_times,
        waits=waits,
        status=tuple(_status(*row) for row in zip(reached, least, late, strict=True)),
        least_time=least,
        time_available=budget,
        population=result.state.population,
        history=result.history,
        edge_times=legs,
        edge_priority=graphs.priority,
        goals=goals,
        return_margin=margins,
    )


def _by_the_clock(graphs: MissionGraph, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the time of each leg and the waiting in it, [B, N - 1] s, of orders padded with -1."""
    times, waits = np.zeros((2, len(nodes), nodes.shape[1] - 1))
    for row, order in enumerate(nodes):
        graph = jax.tree.map(lambda leaf, row=row: leaf[row], graphs)
        found = graph.itinerary(order[order >= 0], 1.0)
        count = len(found.ends)
        times[row, :count] = found.ends - found.departs
        waits[row, :count] = found.begins - found.arrives
    return times, waits


def _status(reached: bool, least: float, late: bool) -> MissionStatus:
    if reached:
        return MissionStatus.OK
    if not np.isfinite(least):
        return MissionStatus.UNREACHABLE
    return MissionStatus.OUT_OF_TIME if late else MissionStatus.NOT_FOUND


def _indices(name: str, values: Any, batch: int, size: int) -> np.ndarray:
    found = np.broadcast_to(np.asarray(values), (batch,))
    if not np.issubdtype(found.dtype, np.integer) or found.min() < 0 or found.max() >= size:
        raise ValueError(f"{name} must be an index in [0, {size}), got {np.unique(found)}")
    return found.astype(np.int32)


def _figures(name: str, values: Any, batch: int) -> np.ndarray:
    found = np.broadcast_to(np.asarray(values, float), (batch,))
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite, got {found}")
    return found


def _given(populations: Any, batch: int, size: int, config: MissionConfig) -> tuple[np.ndarray, int]:
    """Populations padded to [B, P, D], and how many habitats were given."""
    shape = (batch, config.bbo.population, decoders.siv_count(size, config.decoder))
    padded = np.zeros(shape, np.int32)
    if populations is None:
        return padded, 0
    populations = np.asarray(populations)
    fits = populations.ndim == 3 and populations.shape[0] == batch and populations.shape[2] == shape[2]
    if not fits or populations.shape[1] > shape[1]:
        raise ValueError(
            f"population must be [Q <= {shape[1]}, {shape[2]}] for each of {batch} missions, "
            f"got shape {populations.shape}"
        )
    count = populations.shape[1]
    padded[:, :count] = np.clip(populations, decoders.LOWEST, decoders.HIGHEST)
    return padded, count


def _known(orders: Any, starts: np.ndarray, goals: np.ndarray, size: int) -> np.ndarray:
    """Known orders padded to [B, N] with -1."""
    padded = np.full((len(starts), size), -1, np.int32)
    if orders is None:
        return padded
    if len(orders) != len(starts):
        raise ValueError(f"known_orders must hold one order or None for each of {len(starts)} missions")
    for row, order, start, goal in zip(padded, orders, starts, goals, strict=True):
        if order is None:
            continue
        nodes = np.asarray(order)
        fits = nodes.ndim == 1 and len(np.unique(nodes)) == len(nodes) <= size
        if not fits or not np.isin(nodes, np.arange(size)).all() or tuple(nodes[[0, -1]]) != (start, goal):
            raise ValueError(
                f"known_order must lead from {start} to {goal} and visit no waypoint twice, got {order}"
            )
        row[: len(nodes)] = nodes
    return padded
