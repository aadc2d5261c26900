"""The operation graph: waypoints joined by edges that may carry a task (section 3.3, Eq. 13)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np
import scipy
from numpy.typing import NDArray

from auvplan.mission.speeds import SpeedOptions
from auvplan.mission.timetable import Stages, Timetable, stages
from auvplan.mission.travel_times import Detours, PathsRound, Sketch, TravelTimeConfig, Trips, travel_times
from auvplan.ocean.currents import partition
from auvplan.ocean.environment import Environment
from auvplan.path.ends import check_given, check_worlds
from auvplan.runtime.arguments import instance, numbers, per_row
from auvplan.vehicle import Vehicle

#: Lines that are bent to the current where edges are timed at several departures.
_MOST_BENT = 5000


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class MissionGraph:
    """Waypoints and the edges between them; a task sits on each edge of positive priority.

    Row i, column j of the [N, N] fields belongs to the edge from i to j, so that a graph may be directed. An
    undirected graph has symmetric fields. Graphs of one size are stacked along leading axes B.

    Attributes:
        positions: [..., N, 3] m, local NED.
        adjacency: [..., N, N] bool, True where an edge leads from i to j. The diagonal is ignored.
        priority: [..., N, N] rho_ij >= 0; zero where the edge carries no task.
        duration: [..., N, N] s, delta_ij >= 0, the task's completion time.
        travel_time: [..., N, N] s, the known time from i to j without the task; NaN where it is not known
            and follows from the distance and the vehicle's speed. None means NaN everywhere.
        waypoint_priority: [..., N], the part of `priority` on every edge into waypoint j that belongs to a
            task at j itself: done once, on arrival, whichever edge leads there. None means zero.
        waypoint_duration: [..., N] s, the same part of `duration`.
        timetable: travel times by departure, and windows of tasks; None where neither depends on the clock.
            With one, `travel_time` is its least.
        options: speeds among which that of each leg may be chosen, with what edges take at them; None where
            the vehicle's speed is given, and energy does not count.

    Raises:
        ValueError: a field given as a NumPy array or nested list has a wrong shape, is negative or NaN, or an
            adjacency is neither 0 nor 1.
        TypeError: it holds text, dates or durations in place of numbers.
    """

    positions: Any
    adjacency: Any
    priority: Any
    duration: Any
    travel_time: Any = None
    waypoint_priority: Any = None
    waypoint_duration: Any = None
    timetable: Timetable | None = None
    options: SpeedOptions | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.positions, np.ndarray | list | tuple):
            return  # JAX rebuilds graphs from traced arrays and placeholders: nothing to check there
        positions = numbers("positions", self.positions)
        if positions.ndim < 2 or positions.shape[-1] != 3 or positions.shape[-2] < 1:
            raise ValueError(f"positions must be [N, 3] m, got shape {positions.shape}")
        square = (*positions.shape[:-1], positions.shape[-2])
        known = np.full(square, np.nan) if self.travel_time is None else self.travel_time
        fields = {
            "adjacency": numbers("adjacency", self.adjacency),
            "priority": numbers("priority", self.priority),
            "duration": numbers("duration", self.duration),
            "travel_time": numbers("travel_time", known),
        }
        for name, value in fields.items():
            if value.shape != square:
                raise ValueError(
                    f"{name} must be [N, N] = {square} as positions has it, got shape {value.shape}"
                )
        if not np.isin(fields["adjacency"], (0.0, 1.0)).all():
            raise ValueError("adjacency must be True or False, 1 or 0, for each pair of waypoints")
        fields["adjacency"] = fields["adjacency"].astype(bool)
        if not np.isfinite(positions).all():
            raise ValueError("positions must be finite, got NaN or infinity")
        for name in ("priority", "duration"):
            if not np.isfinite(fields[name]).all():
                raise ValueError(f"{name} must be finite, got NaN or infinity")
        for name in ("priority", "duration", "travel_time"):
            if (fields[name] < 0.0).any():
                raise ValueError(f"{name} must not be negative, got {np.nanmin(fields[name]):g}")
        if np.isinf(fields["travel_time"]).any():
            raise ValueError(
                "travel_time must be finite, or NaN where not known: remove closed edges instead"
            )
        for name, whole in (("waypoint_priority", "priority"), ("waypoint_duration", "duration")):
            given = getattr(self, name)
            value = np.zeros(square[:-1]) if given is None else numbers(name, given)
            if value.shape != square[:-1]:
                raise ValueError(f"{name} must be [N] = {square[:-1]}, got shape {value.shape}")
            if not (np.isfinite(value) & (value >= 0.0)).all():
                raise ValueError(f"{name} must be finite and not negative")
            missing = value[..., None, :] - fields[whole] > 1e-9 * (1.0 + value[..., None, :])
            if (missing & fields["adjacency"] & ~np.eye(square[-1], dtype=bool)).any():
                raise ValueError(f"{name} must be part of {whole} on every edge into the waypoint")
            fields[name] = value
        for name, kind in (("timetable", Timetable), ("options", SpeedOptions)):
            if (given := getattr(self, name)) is not None:
                instance(name, given, kind, f"{kind.__name__}(...)")
        object.__setattr__(self, "positions", positions)
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def size(self) -> int:
        """Number of waypoints N."""
        return self.positions.shape[-2]

    @classmethod
    def stack(cls, graphs: Iterable[Self]) -> Self:
        """Graphs of one size as one graph with a leading axis B, as `plan_missions` takes it.

        Raises:
            ValueError: there is none, or they are of several sizes.
        """
        graphs = list(graphs)
        if len({graph.size for graph in graphs}) != 1:
            sizes = [graph.size for graph in graphs]
            raise ValueError(f"graphs must have one number of waypoints, at least one graph, got {sizes}")
        return jax.tree.map(lambda *leaves: np.stack(leaves), *graphs)

    def leg_times(self, speed: Any) -> Any:
        """Time of each leg with its task, t_ij = d_ij / |v| + delta_ij (Eq. 13).

        Args:
            speed: |v| m/s, a scalar or [...] as the leading axes.

        Returns:
            [..., N, N] s; infinite where there is no edge and on the diagonal. Where `travel_time` is known
            it takes the place of d_ij / |v|.
        """
        xp = np if isinstance(self.positions, np.ndarray) else jnp
        planes = [self.positions[..., k] for k in range(3)]
        distance = xp.sqrt(sum((p[..., :, None] - p[..., None, :]) ** 2 for p in planes))
        travel = xp.where(
            xp.isnan(self.travel_time), distance / xp.asarray(speed)[..., None, None], self.travel_time
        )
        edge = self.adjacency & ~xp.eye(self.size, dtype=bool)
        return xp.where(edge, travel + self.duration, xp.inf)

    def still_times(self, speed: Any) -> Any:
        """[..., N, N] s, as `leg_times`: those of legs in still water, d_ij / |v|, without their tasks."""
        bare = {"travel_time": None, "waypoint_duration": None, "timetable": None}
        return replace(self, duration=0.0 * self.duration, **bare).leg_times(speed)

    def without_edges(self, used: Iterable[tuple[int, int]], both_ways: bool | None = True) -> Self:
        """Return a copy without the passed edges, the same shapes (section 3.3.2).

        Args:
            used: pairs (i, j).
            both_ways: remove (j, i) as well; None to do so where its own task is that of (i, j), so that the
                two are one.
        """
        adjacency = np.array(self.adjacency)
        for i, j in used:
            adjacency[..., i, j] = False
            adjacency[..., j, i] &= ~self._is_one_task(i, j) if both_ways is None else not both_ways
        return replace(self, adjacency=adjacency)

    def _is_one_task(self, i: int, j: int) -> Any:
        """Return [...] whether the edge's own task, without those at its ends, is the same both ways."""
        pairs = (self.priority, self.waypoint_priority), (self.duration, self.waypoint_duration)
        there, back = (
            np.stack([whole[..., a, b] - part[..., b] for whole, part in pairs]) for a, b in ((i, j), (j, i))
        )
        return np.isclose(there, back, atol=1e-6).all(axis=0)

    def without_waypoints(self, nodes: Iterable[int]) -> Self:
        """Return a copy without any edge into or out of waypoints, the same shapes.

        They are not visited again.
        """
        adjacency = np.array(self.adjacency)
        for node in nodes:
            adjacency[..., node, :] = adjacency[..., :, node] = False
        return replace(self, adjacency=adjacency)

    def without_task_at(self, node: int) -> Self:
        """Return a copy in which the task at a waypoint is done: edges into it keep their own tasks alone."""
        fields: dict[str, Any] = {}
        for name, part in (("priority", "waypoint_priority"), ("duration", "waypoint_duration")):
            whole, at_waypoint = np.array(getattr(self, name)), np.array(getattr(self, part))
            less = np.where(np.asarray(self.adjacency)[..., node], at_waypoint[..., node, None], 0.0)
            whole[..., node] = np.maximum(whole[..., node] - less, 0.0)
            at_waypoint[..., node] = 0.0
            fields |= {name: whole, part: at_waypoint}
        if self.timetable is not None:
            done = np.zeros(self.adjacency.shape, bool)
            done[..., node] = fields["priority"][..., node] == 0.0
            fields["timetable"] = self.timetable.without_windows(done)
        if self.options is not None:
            fields["options"] = self.options.without_task_at(node, np.asarray(self.adjacency))
        return replace(self, **fields)

    def with_edges(self, edges: Iterable[tuple[int, int]], tasks: bool = True) -> Self:
        """Return a copy with edges (i, j) open, the same shapes.

        Args:
            edges: pairs (i, j).
            tasks: whether they carry what the graph has for them; False makes them mere passages.
        """
        fields: dict[str, Any] = {
            name: np.array(getattr(self, name)) for name in ("adjacency", "priority", "duration")
        }
        for i, j in edges:
            fields["adjacency"][..., i, j] = True
            if not tasks:
                fields["priority"][..., i, j] = fields["duration"][..., i, j] = 0.0
        if self.timetable is not None:
            fields["timetable"] = self.timetable.without_windows(fields["priority"] == 0.0)
        return replace(self, **fields)

    def with_travel_time(self, i: int, j: int, seconds: float) -> Self:
        """Return a copy in which the edge from i to j takes `seconds`, its task not counted.

        Its shapes are the same.
        """
        travel_time, timetable = np.array(self.travel_time), self.timetable
        travel_time[..., i, j] = numbers("seconds", seconds)
        if timetable is not None:
            planes = timetable.travel_time.copy()
            planes[..., i, j] = seconds
            timetable = replace(timetable, travel_time=planes)
        return replace(self, travel_time=travel_time, timetable=timetable)

    def times_at(
        self,
        env: Environment,
        vehicle: Vehicle | None,
        departures: NDArray[np.floating],
        config: TravelTimeConfig | None = None,
        bends: int = 0,
        around: PathsRound | None = None,
        sketch: Sketch | None = None,
    ) -> NDArray[np.float64]:
        """Return the travel time of every edge at several departures, without tasks.

        Args:
            env, vehicle, config: as for `with_travel_times`, of one graph.
            departures: [M] s since the epoch.
            around: finds paths round what lies between, as for `travel_times`.
            sketch: finds paths over a sea bed that hinders, as for `travel_times`.
            bends: departures among these, evenly spread, at which lines are bent to the current too; fewer
                where edges are very many. The share of time that this saves is taken linear between them.

        Returns:
            [M, N, N] s; infinite where there is no edge or no feasible path along it.
        """
        adjacency = np.array(self.adjacency) & ~np.eye(self.size, dtype=bool)
        i, j = np.nonzero(adjacency)
        departures, effort = np.asarray(departures, float), config or TravelTimeConfig()

        def timed(
            moments: NDArray[np.floating], effort: TravelTimeConfig, detours: Detours | None
        ) -> NDArray[np.floating]:
            """Travel times [m, E] s at moments [m] s; infinite where an edge is closed."""
            count = len(moments)
            starts, goals = (np.tile(self.positions[nodes], (count, 1)) for nodes in (i, j))
            trips = Trips(starts, goals, np.repeat(moments, len(i)))
            seconds, passable = travel_times(
                trips, env, (vehicle or Vehicle()).without_power(), effort, detours=detours
            )
            return np.where(passable, seconds, np.inf).reshape(count, len(i))

        found = timed(departures, effort, Detours(around, sketch))
        bends = min(bends, _MOST_BENT // max(len(i), 1))
        if bends > 1 and len(i):
            chosen = np.unique(np.linspace(0, len(departures) - 1, bends).round().astype(int))
            bent, straight = timed(departures[chosen], effort.bending(), None), found[chosen]
            known = np.isfinite(bent) & np.isfinite(straight)
            saved = np.where(known, np.minimum(bent, straight) / np.where(known, straight, 1.0), 1.0)
            rows = np.arange(len(departures))
            found = found * np.stack([np.interp(rows, chosen, share) for share in saved.T], axis=1)
        times = np.full((len(departures), self.size, self.size), np.inf)
        times[:, i, j] = found
        return times

    def with_timetable(self, timetable: Timetable) -> Self:
        """Return a copy with travel times by departure, without the edges that never open.

        Raises:
            ValueError: it is of another number of waypoints.
            TypeError: it is none.
        """
        instance("timetable", timetable, Timetable, "Timetable(...)")
        least = timetable.least
        if least.shape != np.shape(self.adjacency):
            raise ValueError(f"a timetable of {np.shape(self.adjacency)} is needed, got {least.shape}")
        open_ = np.isfinite(least)
        return replace(
            self,
            adjacency=np.asarray(self.adjacency) & open_,
            travel_time=np.where(open_, least, np.nan),
            timetable=timetable,
        )

    def at_speeds(self, chosen: NDArray[np.integer]) -> Self:
        """Return a copy whose edges take the time that they do at speeds chosen among `options`.

        Args:
            chosen: [N, N] places of speeds, of one graph.
        """
        assert self.options is not None
        times = self.options.at(chosen)
        if self.timetable is not None:
            return self.with_timetable(replace(self.timetable, travel_time=times))
        known = np.isfinite(times)
        adjacency = np.asarray(self.adjacency) & known
        return replace(self, adjacency=adjacency, travel_time=np.where(known, times, np.nan))

    def itinerary(self, nodes: Sequence[int] | NDArray[np.int_], speed: Any, now: float = 0.0) -> Stages:
        """Go through a sequence of waypoints by the clock.

        Args:
            nodes: [n] the route; only edges of the graph.
            speed: |v| m/s, where travel times follow from it.
            now: s, when it begins.
        """
        timetable = self.timetable
        if timetable is None:
            travel = self.leg_times(speed) - self.duration
            timetable = Timetable(np.zeros(1), travel[None])
        return stages(timetable, self.duration, nodes, now)

    def with_travel_times(
        self,
        env: Environment,
        vehicle: Vehicle | None = None,
        depart: Any = 0.0,
        config: TravelTimeConfig | None = None,
        world_per_graph: bool = False,
        around: PathsRound | None = None,
        sketch: Sketch | None = None,
    ) -> Self:
        """A copy with `travel_time` in the present current, and without the edges that have no feasible path.

        Every edge is timed in both of its directions, whatever was known before; a graph of any size and any
        later call reuse the compiled programs. Edges are removed where no path tried keeps the limits of the
        path planner: land lies between, the current is too strong. Obstacles belong to legs and are met
        there: those of `env` are left out.

        Args:
            env: current, chart and box; with `world_per_graph` its current carries a leading axis B.
            vehicle: speed and limits; defaults to `Vehicle()`.
            depart: s since the epoch, when every edge is taken to be entered, one or [B].
            config: effort; defaults to `TravelTimeConfig()`.
            world_per_graph: whether the current differs by graph; needs stacked graphs [B, N, ...].
            around: finds paths round what lies between, as for `travel_times`.
            sketch: finds paths over a sea bed that hinders, as for `travel_times`.

        Raises:
            ValueError: `world_per_graph` is asked for a single graph, or of another number of currents, or
                more than one axis is stacked; or the departure is too far from the epoch for single
                precision.
            TypeError: environment, vehicle or departure are of another kind.

        Differences from the paper:
            Eq. 13 divides the distance by |v|, as in still water; there it is the default.
        """
        positions = np.asarray(self.positions, float)
        if positions.ndim > 3 or (world_per_graph and positions.ndim != 3):
            raise ValueError(f"graphs must be stacked along one axis, got positions {positions.shape}")
        adjacency = np.array(self.adjacency) & ~np.eye(self.size, dtype=bool)
        travel_time = np.full(adjacency.shape, np.nan)
        stacked = positions.reshape(-1, self.size, 3)
        edges = np.nonzero(adjacency.reshape(-1, self.size, self.size))
        graph, i, j = edges
        check_given(env, vehicle)
        if world_per_graph:
            check_worlds(len(stacked), "graph", current=partition(env.current)[1])
        departs = per_row("depart", depart, len(stacked))[graph]
        seconds, passable = travel_times(
            Trips(stacked[graph, i], stacked[graph, j], departs),
            env,
            (vehicle or Vehicle()).without_power(),
            config or TravelTimeConfig(),
            graph if world_per_graph else None,
            Detours(around, sketch),
        )
        place = edges if positions.ndim == 3 else (i, j)
        travel_time[place] = np.where(passable, seconds, np.nan)
        adjacency[place] = passable
        return replace(self, adjacency=adjacency, travel_time=travel_time)


def random_graph(
    rng: np.random.Generator,
    positions: Any,
    neighbours: int = 7,
    priority: tuple[int, int] = (1, 5),
    duration: tuple[float, float] = (30.0, 300.0),
    passable: Any = None,
) -> MissionGraph:
    """Return an undirected graph of the nearest neighbours, made connected, with a task on every edge.

    Args:
        rng: generator, consumed.
        positions: [N, 3] m.
        neighbours: each waypoint is linked to this many nearest ones.
        priority: range of rho, integers drawn uniformly, both ends included.
        duration: s, range of delta, drawn uniformly.
        passable: [N, N] bool, symmetric; edges are drawn only where it is True. None allows every edge.

    Raises:
        ValueError: the passable edges do not connect the waypoints.

    Differences from the paper:
        It gives neither the degree of its graphs nor the ranges of rho and delta; those are chosen here.
    """
    positions = numbers("positions", positions)
    if positions.ndim != 2 or positions.shape[1] != 3:
        raise ValueError(f"positions must be [N, 3] m, got shape {positions.shape}")
    size = len(positions)
    distance = scipy.spatial.distance.cdist(positions, positions)
    np.fill_diagonal(distance, np.inf)
    if passable is not None:
        distance[~np.asarray(passable, bool)] = np.inf
    adjacency = np.zeros((size, size), bool)
    nearest = np.argsort(distance, axis=1)[:, : min(neighbours, size - 1)]
    adjacency[np.arange(size)[:, None], nearest] = True
    adjacency &= np.isfinite(distance)
    adjacency |= adjacency.T
    if len(join_parts(adjacency, distance)):
        raise ValueError("the passable edges do not connect the waypoints")

    def symmetric(values: np.ndarray) -> np.ndarray:
        upper = np.triu(values, 1)
        return np.where(adjacency, upper + upper.T, 0.0)

    rho = rng.integers(*priority, size=(size, size), endpoint=True)
    delta = rng.uniform(*duration, size=(size, size))
    return MissionGraph(positions, adjacency, symmetric(rho.astype(float)), symmetric(delta))


def task_graph(
    positions: Any,
    edges: Iterable[tuple[int, int]],
    edge_tasks: Iterable[tuple[int, int, float, float]] = (),
    waypoint_tasks: Iterable[tuple[int, float, float]] = (),
    directed: bool = False,
) -> MissionGraph:
    """Build a graph from its edges and the tasks on them.

    Tasks on one edge add up, in priority and in duration: whoever takes the edge does them all. A task at a
    waypoint is put on every edge that leads into it and is done once, on the first arrival: within a route
    because no waypoint is visited twice, over a mission because `MissionGraph.without_task_at` takes it off
    those edges. The task of the waypoint from which a mission starts is never done.

    Args:
        positions: [N, 3] m.
        edges: pairs (i, j), either way unless `directed`. An edge without a task is a mere passage.
        edge_tasks: (i, j, priority, duration s), as many to an edge as there are, in either direction unless
            `directed`.
        waypoint_tasks: (j, priority, duration s), as many to a waypoint as there are.
        directed: whether (i, j) is an edge, and its task one, from i to j only.

    Raises:
        ValueError: an index is out of range, or a task lies on an edge that does not exist.

    Example:
        >>> import numpy as np
        >>> graph = task_graph(np.zeros((3, 3)), [(0, 1), (1, 2)], [(0, 1, 2.0, 60.0), (0, 1, 1.0, 30.0)])
        >>> float(graph.priority[0, 1]), float(graph.duration[1, 0]), float(graph.priority[1, 2])
        (3.0, 90.0, 0.0)
    """
    size = len(positions)
    adjacency = np.zeros((size, size), bool)
    priority, duration = np.zeros((2, size, size))
    at_waypoint, stay = np.zeros((2, size))
    for i, j in edges:
        if not (0 <= i < size and 0 <= j < size) or i == j:
            raise ValueError(f"edge ({i}, {j}) must join two of the {size} waypoints")
        adjacency[i, j] = True
        adjacency[j, i] |= not directed
    for i, j, rho, seconds in edge_tasks:
        if not (0 <= i < size and 0 <= j < size and adjacency[i, j]):
            raise ValueError(f"a task lies on ({i}, {j}), which is not an edge")
        for leg in {(i, j)} if directed else {(i, j), (j, i)}:
            priority[leg] += rho
            duration[leg] += seconds
    for j, rho, seconds in waypoint_tasks:
        if not 0 <= j < size:
            raise ValueError(f"a task lies at waypoint {j}, which is not one of the {size}")
        at_waypoint[j] += rho
        stay[j] += seconds
    priority += np.where(adjacency, at_waypoint, 0.0)
    duration += np.where(adjacency, stay, 0.0)
    return MissionGraph(
        positions, adjacency, priority, duration, waypoint_priority=at_waypoint, waypoint_duration=stay
    )


def join_parts(adjacency: NDArray[np.bool_], distance: NDArray[np.floating]) -> NDArray[np.int_]:
    """Join the parts of an undirected graph in place, one by one to that of its first waypoint.

    Args:
        adjacency: [N, N].
        distance: [N, N] m; by the shortest of these they are joined, infinite where no edge can be.

    Returns:
        The waypoints that cannot be joined.
    """
    while True:
        _, label = scipy.sparse.csgraph.connected_components(adjacency, directed=False)
        first = label == label[0]
        if first.all():
            return np.zeros(0, int)
        gap = np.where(first[:, None] & ~first[None, :], distance, np.inf)
        i, j = np.unravel_index(np.argmin(gap), gap.shape)
        if not np.isfinite(gap[i, j]):
            return np.flatnonzero(~first)
        adjacency[i, j] = adjacency[j, i] = True


def time_to_go(leg_times: NDArray[np.floating], goal: int) -> NDArray[np.float64]:
    """Shortest time from each waypoint to the goal, [N] s, infinite where it is out of reach.

    Args:
        leg_times: [N, N] s, infinite off the edges.
        goal: index.
    """
    return scipy.sparse.csgraph.dijkstra(_sparse(leg_times).T, indices=goal)


def shortest_path(leg_times: NDArray[np.floating], start: int, goal: int) -> list[int]:
    """Waypoints of the quickest path from the start to the goal; empty where there is none.

    Args:
        leg_times: [N, N] s, infinite off the edges.
        start, goal: indices.
    """
    times, before = scipy.sparse.csgraph.dijkstra(_sparse(leg_times), indices=start, return_predecessors=True)
    if not np.isfinite(times[goal]):
        return []
    path = [int(goal)]
    while path[-1] != start:
        path.append(int(before[path[-1]]))
    return path[::-1]


def shortest_times(leg_times: NDArray[np.floating]) -> NDArray[np.float64]:
    """Shortest time from each waypoint to each other one, [N, N] s, infinite where it is out of reach.

    Args:
        leg_times: [N, N] s, infinite off the edges.
    """
    return scipy.sparse.csgraph.shortest_path(_sparse(leg_times))


def _sparse(leg_times: NDArray[np.floating]) -> scipy.sparse.csr_array:
    """[N, N] leg times with entries for the finite ones alone, those of no time among them."""
    edges = np.nonzero(np.isfinite(leg_times))
    return scipy.sparse.csr_array((np.asarray(leg_times, float)[edges], edges), shape=np.shape(leg_times))
