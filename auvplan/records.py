"""Records of a mission: plain data on the host, for files, figures and statistics."""

import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from importlib.metadata import version
from typing import Any

import numpy as np

from auvplan.energy import EnergyUse, energy_of_legs
from auvplan.mission import MissionGraph, MissionRoute, trail_bound, upper_bound
from auvplan.mission.jobs import Jobs, jobs_done
from auvplan.mission.survey import Coverage, LinePart
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Closure, Zone
from auvplan.ocean.currents import Current
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.seabed import Seabed
from auvplan.path.motion import Motion
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import ReprMixin, between, figure, rounded_up
from auvplan.scenario.settings import PlanningSettings, SafetySettings
from auvplan.site import Site
from auvplan.vehicle import Vehicle

#: Share of the time available by which a mission that uses it up may seem to exceed it.
_ROUNDING = 1e-6


@dataclass(repr=False, eq=False)
class PlanRecord(ReprMixin):
    """One path plan as it was made.

    Attributes:
        made_at: s since the epoch.
        positions: [S, 3] m.
        times: [S] s.
        cost: s, of Eq. 12: travel time and what broken limits cost.
        feasible: whether the belief saw every limit kept.
        cause: "leg", "window" or "hazard".
        cpu: s of wall-clock time.
        history: by iteration, [I + 1] each: best, mean, std, violation_best, violation_mean, violation_std;
            empty where it comes from a file without them.
        current: the true one when the plan was made, for pictures.
        motion: attitude and velocities on its S - 1 segments, as planned.
        lower_bound: s, what no path could have beaten when it was made; NaN where nobody asked.
    """

    made_at: float
    positions: Array
    times: Array
    cost: float
    feasible: bool
    cause: str
    cpu: float
    history: dict[str, Array]
    current: Current
    motion: Motion
    lower_bound: float = math.nan

    @property
    def travel_time(self) -> float:
        """Travel time, s, in double precision whatever that of the times."""
        return float(self.times[-1]) - float(self.times[0])

    @property
    def gap(self) -> float:
        """Share by which the travel time is above its lower bound, at most; NaN where none is known."""
        known = self.feasible and self.lower_bound > 0.0
        return self.travel_time / self.lower_bound - 1.0 if known else math.nan

    def _repr_items(self) -> dict[str, str]:
        return {
            "": "feasible" if self.feasible else "not feasible",
            "made for a": self.cause,
            "at": f"{self.made_at:,.0f} s",
            "travel time": f"{self.travel_time:,.0f} s",
            **({} if math.isnan(self.gap) else {"above its lower bound": f"{self.gap:.1%} at most"}),
            "cost": f"{self.cost:,.0f} s",
        }


@dataclass(repr=False, eq=False)
class LegRecord(ReprMixin):
    """One executed leg between two waypoints.

    Attributes:
        start: index of the waypoint left.
        goal: index of the waypoint reached.
        t_expected: t_ij of Eq. 13, s, the task included.
        t_task: delta_ij, s; zero where the task's window was missed.
        priority: rho_ij of the task; zero where the edge has none, it was done before or its window was
            missed.
        revisit: whether the waypoint reached had been visited before: allowed with `visits: edges`, otherwise
            on the only way to the destination alone, and then without a task.
        plans: the first plan and every re-plan.
        followed: number in `plans` of the one that the leg was begun with.
        current_difference: m/s, root mean square of the difference between the forecast current and the
            true one along the track; NaN where both change as vortices do.
        times: [n] s since the epoch; the last is the arrival.
        positions: [n, 3] m, as executed.
        motion: attitude and velocities, [n] as simulated: each from its time to the next.
        obstacle_positions: [n, M, 3] m, the truth.
        obstacle_radii: [M] m, the truth.
        obstacle_kinds: [M] names: "static", "afloat" or "self-motivated".
        arrived: whether the goal was reached.
        refused: why it was planned and not begun, or empty.
        t_hold: s that the vehicle waited at the waypoint left, for the way to open, or surfaced there.
        t_fix: s of these that it surfaced for a fix, up and down included; None where it did not.
        t_wait: s that it waited at the waypoint reached, for the task's window.
        missed: whether it came too late for the task's window.
        line: the part of a survey line that it follows, or None.
        current: [n, 2] m/s north and east, the true current from each time to the next; None where it changes
            as vortices do.
        speed: m/s through the water that it is gone at; None where that is the vehicle's.
        position_std: m, standard deviation of the position along each horizontal axis at its end; None
            without navigation.
        risk: chance that the vehicle touches coast or an obstacle on the path that it followed last, at most;
            None without navigation. See `auvplan.path.risk`.
    """

    start: int
    goal: int
    t_expected: float
    t_task: float
    priority: float
    revisit: bool = False
    plans: list[PlanRecord] = field(default_factory=list)
    followed: int = 0
    current_difference: float = math.nan
    times: Array = field(default_factory=lambda: np.zeros(0))
    positions: Array = field(default_factory=lambda: np.zeros((0, 3)))
    motion: Motion = field(default_factory=Motion.none)
    obstacle_positions: Array = field(default_factory=lambda: np.zeros((0, 0, 3)))
    obstacle_radii: Array = field(default_factory=lambda: np.zeros(0))
    obstacle_kinds: list[str] = field(default_factory=list)
    arrived: bool = False
    refused: str = ""
    t_hold: float = 0.0
    t_wait: float = 0.0
    missed: bool = False
    line: LinePart | None = None
    current: Array | None = None
    speed: float | None = None
    position_std: float | None = None
    risk: float | None = None
    t_fix: float | None = None

    def _repr_items(self) -> dict[str, str]:
        return {
            "": f"{self.start} to {self.goal}",
            **({} if self.speed is None else {"through the water": f"{self.speed:.2f} m/s"}),
            "executed": f"{self.t_path:,.0f} s" if self.arrived else f"{self.t_path:,.0f} s, not arrived",
            "expected": f"{self.t_expected - self.t_task:,.0f} s",
            "task": f"{self.t_task:,.0f} s",
            "priority": figure(self.priority, 6),
            "plans": f"{len(self.plans):,}",
        }

    @cached_property
    def coverage(self) -> Coverage | None:
        """What its track covers of its survey line, once it is executed; None without one."""
        return None if self.line is None else self.line.covered(self.positions)

    @property
    def stays(self) -> list[tuple[int, float, float]]:
        """Ends of the leg, 0 or -1, at which the vehicle stays, and s from when to when."""
        if not len(self.times):
            return []
        begins, ends = float(self.times[0]), float(self.times[-1])
        stays = [(0, begins - self.t_hold, begins), (-1, ends, ends + self.t_wait + self.t_task)]
        return [stay for stay in stays if stay[2] > stay[1]]

    @property
    def ends(self) -> float:
        """When it is over, its task included, s since the epoch."""
        return float(self.times[-1]) + self.t_wait + self.t_task

    @property
    def t_path(self) -> float:
        """Travel time as executed, s."""
        return float(self.times[-1] - self.times[0]) if len(self.times) else 0.0

    @property
    def t_planned(self) -> float:
        """Travel time of the plan that the leg was begun with, s; NaN without one."""
        if not self.plans:
            return math.nan
        return self.plans[self.followed].travel_time

    @property
    def as_begun(self) -> "LegRecord":
        """The leg as it would have gone by the plan that it was begun with."""
        plan = self.plans[self.followed]
        return replace(self, times=plan.times, positions=plan.positions, motion=plan.motion, current=None)

    @property
    def followed_numbers(self) -> list[int]:
        """Numbers in `plans` of those that were followed: the first, and the last one of each re-plan."""
        if not self.plans:
            return []
        later = {
            plan.made_at: number
            for number, plan in enumerate(self.plans)
            if number > self.followed and plan.cause != "leg"
        }
        return [self.followed, *later.values()]

    @property
    def followed_plans(self) -> list[PlanRecord]:
        """Plans that were followed, in order."""
        return [self.plans[number] for number in self.followed_numbers]

    @property
    def path_replans(self) -> int:
        """Re-plans on the way; a second try before the start is none."""
        return sum(plan.cause != "leg" for plan in self.plans)

    @property
    def cpu(self) -> float:
        """Wall-clock seconds of all path planning calls of the leg."""
        return sum(plan.cpu for plan in self.plans)


@dataclass
class RouteRecord:
    """One route as the mission planner made it.

    Attributes:
        made_at: s since the epoch.
        nodes: waypoints from the present one to the destination.
        time: s, expected.
        priority: total of its tasks.
        cpu: s of wall-clock time.
        cause: "start", "late" (a leg took longer than expected), "early", "refused" (a leg could not be
            executed in time), "charge" (it does not do for the rest) or "spare" (it leaves much).
        leg_times: s, expected of each leg with waiting and task; empty where it was not kept.
        waits: s of them that pass in waiting for the task's window; empty where it was not kept.
        speeds: m/s through the water of each leg; empty where that is the vehicle's.
        energies: J expected of each leg with its task; empty without a power model.
    """

    made_at: float
    nodes: list[int]
    time: float
    priority: float
    cpu: float
    cause: str
    leg_times: list[float] = field(default_factory=list)
    waits: list[float] = field(default_factory=list)
    speeds: list[float] = field(default_factory=list)
    energies: list[float] = field(default_factory=list)


@dataclass(frozen=True)
class TurnBack:
    """What a plan's rule says of one stop: left later than that, the vehicle leaves out what comes next.

    Of several the one with the latest moment before counts.

    Attributes:
        leg: number of the leg that ends at the stop, from 0.
        latest: s after the departure, until when the stop is left to do otherwise.
        share: of the drawn seas, in which the vehicle does this.
        takes: s, of the way from there, as planned.
        positions: [S, 3] m along it.
        past: number of the leg at whose end it leads on, past a task; None where it leads to the destination.
    """

    leg: int
    latest: float
    share: float
    takes: float
    positions: tuple[tuple[float, ...], ...]
    past: int | None = None


@dataclass(frozen=True)
class Promise:
    """How sure a plan is to reach its destination in time, and with the energy that it may use.

    Attributes:
        asked: probability that it was to keep; None where none was asked for.
        share: of the drawn seas, in which it does.
        low, high: ends of the 95 % interval of that.
        seas: that were drawn.
        members: of the forecast that they were drawn from.
        ends: s after the departure, when the mission is over in 5, 50 and 95 % of the seas.
        left: share of time and energy that was kept back when its tasks were chosen, beside the reserves.
        latest: [L] s after the departure, until when each leg and its task have to be over for the rest to be
            done in time as surely as asked, or in 95 % of those drawn; with a rule, for the vehicle to go on,
            and None where it always does.
        priority: that is won in the mean of the drawn seas, with a rule; None without one.
        turns: the rule, of each stop that has one.
    """

    asked: float | None
    share: float
    low: float
    high: float
    seas: int
    members: int
    ends: tuple[float, float, float]
    left: float
    latest: tuple[float | None, ...] = ()
    priority: float | None = None
    turns: tuple[TurnBack, ...] = ()

    @property
    def kept(self) -> bool:
        """Whether it is what was asked for."""
        return self.asked is None or self.share >= self.asked

    @property
    def summary(self) -> dict[str, Any]:
        """Its figures as plain data, without the lines of its rule."""
        figures = asdict(self)
        for turn in figures["turns"]:
            del turn["positions"]
        return figures

    @property
    def line(self) -> str:
        """One line for people."""
        of = f" from {self.members} members" if self.members > 1 else ""
        share, low, high = (f"{100.0 * part:.1f}" for part in (self.share, self.low, self.high))
        return f"home in time in {share} % [{low} to {high}] of {self.seas:,} drawn seas{of}"


@dataclass(repr=False, eq=False)
class MissionRun(ReprMixin):
    """A mission from start to end.

    Attributes:
        scenario: the scenario's settings as plain data.
        seed: that the world and the planners were made from.
        vehicle: speed and limits.
        graph: waypoints and tasks, as they were at the start.
        chart: coast and closed areas as one, or None.
        start, goal: waypoint indices.
        t_available: s.
        routes: the first route and every re-plan.
        first_route: the first of `routes` as planned, with its bound; None before.
        legs: as executed.
        t_mission: s, travel and tasks (and planning time where it is charged).
        arrived: whether the destination was reached.
        reason: one line on how the mission ended.
        estimate_seconds: s of wall-clock time of all estimates of travel times.
        charged_compute: s of planning time charged to the mission clock; zero unless asked for (Eq. 16).
        compile_seconds: s spent on calls of the planners that compiled something; shared by all missions of a
            batch and counted nowhere else.
        folder: that relative paths in the scenario start from.
        site: where and when local coordinates begin, or None.
        seabed: or None.
        names: of the waypoints; empty where they have none.
        simulated: whether the mission was simulated; otherwise it is a plan, and what counts as
            executed below is what is planned, in the forecast.
        obstacles: that were known beforehand, where they are at the departure.
        closures: areas that are closed at some hours.
        coast: the coast alone, also beyond the area; or None.
        zones: areas that are closed at all times.
        departed: s from the scenario's own departure, to which files of obstacles refer, to this one's.
        assumed: what was assumed in reading the scenario's files, a line each.
        followable: [N, N], the share of each edge's own task that can be done, survey lines being blocked in
            part; None where all of every task can.
        jobs: from a file, their times counted from the departure; None where waypoints were drawn.
        sources: digests of the files that it was made from, see `source_digests`; None until it is saved.
        saved_bound: `bound` of a run that comes from files, which do not keep `first_route`; None of others.
        promise: how sure a plan is to be home in time; None where nobody asked.
    """

    scenario: dict[str, Any]
    seed: int
    vehicle: Vehicle
    graph: MissionGraph
    chart: Chart | None
    start: int
    goal: int
    t_available: float
    routes: list[RouteRecord] = field(default_factory=list)
    first_route: MissionRoute | None = None
    legs: list[LegRecord] = field(default_factory=list)
    t_mission: float = 0.0
    arrived: bool = False
    reason: str = ""
    estimate_seconds: float = 0.0
    charged_compute: float = 0.0
    compile_seconds: float = 0.0
    folder: str = "."
    site: Site | None = None
    seabed: Seabed | None = None
    names: list[str] = field(default_factory=list)
    simulated: bool = True
    obstacles: tuple[KnownObstacle, ...] = ()
    closures: tuple[Closure, ...] = ()
    coast: Chart | None = None
    zones: tuple[Zone, ...] = ()
    departed: float = 0.0
    assumed: tuple[str, ...] = ()
    followable: Array | None = None
    jobs: Jobs | None = None
    sources: list[dict[str, Any]] | None = None
    saved_bound: float | None = None
    promise: Promise | None = None

    def __post_init__(self) -> None:
        if not self.zones:  # what is coast on the chart is nothing else
            self.coast = self.coast or self.chart

    def _repr_items(self) -> dict[str, str]:
        return {
            "": self.reason or "under way",
            "scenario": str(self.scenario.get("name", "")),
            "seed": str(self.seed),
            "time": f"{self.t_mission:,.0f} of {self.t_available:,.0f} s",
            "legs": f"{len(self.done):,}",
            "tasks": f"{self.tasks:,}",
            "priority": figure(self.total_priority, 6),
            "re-plans": f"{sum(leg.path_replans for leg in self.legs):,} of paths, "
            f"{max(len(self.routes) - 1, 0):,} of the mission",
        }

    @cached_property
    def coast_reach(self) -> float:
        """How far beyond the chart land is known, m: the greatest distance to the coast that is stated.

        Infinite where the coast is known no farther than the chart: its edge is then the end of the world.
        """
        if self.coast is None or self.chart is None:
            return math.inf
        sides = [np.asarray(self.chart.lower) - np.asarray(self.coast.lower)]
        sides += [np.asarray(self.coast.upper) - np.asarray(self.chart.upper)]
        reach = float(np.min(sides))
        return reach if reach > 1.0 else math.inf

    @property
    def stated_closures(self) -> list[Closure]:
        """The areas that are closed at some hours, closed as long as stated: without `safety.closing`."""
        return [closure.widened(-self.safety.closing) for closure in self.closures]

    @property
    def planning(self) -> PlanningSettings:
        """The scenario's rules of planning."""
        return PlanningSettings.model_validate(self.scenario.get("planning", {})).resolved

    @property
    def safety(self) -> SafetySettings:
        """The scenario's margins, and how the mission ends."""
        return SafetySettings.model_validate(self.scenario.get("safety", {}))

    @property
    def t_residual(self) -> float:
        """Time left at the end, s."""
        return self.t_available - self.t_mission

    @property
    def in_time(self) -> bool:
        """Whether it lasts no longer than the time available, up to the rounding of single precision."""
        return self.t_residual > -_ROUNDING * self.t_available

    @property
    def reserve_used(self) -> float:
        """How much of the reserve the mission took, s; all of it where time ran out."""
        reserve = self.planning.reserve
        return float(np.clip(reserve - self.t_residual, 0.0, reserve))

    def vehicle_on(self, leg: LegRecord) -> Vehicle:
        """Return the vehicle at the speed through the water that a leg is gone at."""
        return self.vehicle if leg.speed is None else replace(self.vehicle, speed=leg.speed)

    @property
    def speeds(self) -> str:
        """Speeds through the water of the legs done, in words; empty where all are the vehicle's."""
        own = [float(np.asarray(self.vehicle_on(leg).speed)) for leg in self.done]
        return f"{between(own, 2)} m/s" if any(leg.speed is not None for leg in self.done) else ""

    @property
    def draw(self) -> float:
        """What the vehicle draws in truth, in shares of what its power model says; 1 in a plan."""
        return float(self.scenario.get("simulation", {}).get("draw", 1.0)) if self.simulated else 1.0

    @property
    def energy(self) -> EnergyUse | None:
        """Energy that the mission took, by term, and the charge along it; None without a power model."""
        use = self._energy_of(self.legs, known=self.simulated)
        return use if use is None or self.draw == 1.0 else use.scaled(self.draw)

    def _energy_of(self, legs: list[LegRecord], *, known: bool) -> EnergyUse | None:
        """Return the energy of legs by the power model, with the recorded current where it is `known`."""
        if self.vehicle.power is None:
            return None
        speed = float(np.asarray(self.vehicle.speed))
        stays = {
            "loiters": (self.scenario.get("mission") or {}).get("wait") == "loiter",
            "drifts": self.dives,
            "vertical_times": self.vehicle.vertical_times,
        }
        return energy_of_legs(legs, self.vehicle.power, speed, known=known, **stays)

    @property
    def dives(self) -> bool:
        """Whether its paths are saw-teeth: at rest the vehicle does nothing, and its turns are waypoints."""
        return bool((self.scenario.get("vehicle") or {}).get("saw_tooth"))

    @property
    def energy_lack(self) -> str:
        """Why its energy does not do, in words; empty where it does or none is known."""
        energy = self.energy
        if energy is None or not energy.lack:
            return ""
        planned = self._energy_of([leg.as_begun for leg in self.done if leg.plans], known=False)
        if not self.simulated or planned is None:
            return energy.lack
        grown = {name: most - planned.totals[name] for name, most in energy.totals.items()}
        name = max(grown, key=lambda term: grown[term])
        more = f"; {name} grew most, by {grown[name]:,.0f} Wh over what legs were begun with"
        return energy.lack + more if grown[name] > 0.5 else energy.lack

    @property
    def success(self) -> bool:
        """Whether the destination was reached in time, with the battery's reserve, as promised."""
        kept = self.promise is None or self.promise.kept
        return self.arrived and self.in_time and not self.energy_lack and kept

    @property
    def done(self) -> list[LegRecord]:
        """Legs whose goal was reached."""
        return [leg for leg in self.legs if leg.arrived]

    @property
    def route(self) -> list[int]:
        """Waypoints in the order in which they were visited."""
        return [self.start, *(leg.goal for leg in self.done)]

    def called(self, node: int) -> str:
        """Return a waypoint's name, or its number where it has none."""
        return self.names[node] if self.names else str(node)

    def place(self, node: int) -> str:
        """Return what a waypoint is called in a sentence."""
        return self.names[node] if self.names else f"waypoint {node}"

    @property
    def total_priority(self) -> float:
        """Sum of rho over the tasks that were done, each counted once."""
        return float(sum(leg.priority for leg in self.done))

    @property
    def earning(self) -> list[LegRecord]:
        """Legs whose task was done."""
        return [leg for leg in self.done if leg.priority > 0.0]

    @property
    def tasks(self) -> int:
        """Tasks that were done; a survey line is one when each of its parts earned, whatever it covers."""
        return self.count_tasks(self.earning)

    def count_tasks(self, legs: Iterable[LegRecord]) -> int:
        """Return how many tasks some of the `earning` legs complete."""
        return len(self.completed(legs))

    def completed(self, legs: Iterable[LegRecord]) -> list[str]:
        """Return what the tasks are called that some of the `earning` legs complete."""
        taken = [(leg.start, leg.goal) for leg in legs]
        if self.jobs is not None:
            return sorted(jobs_done(self.jobs, taken))
        return [f"edge {start} to {goal}" for start, goal in taken]

    @cached_property
    def bound(self) -> float:
        """Bound on the total priority of the whole mission; 0.0 where there never was a route.

        No mission does better at the travel times that the first route was planned with, or, on the edges
        that were taken, at the times that they took where these are shorter. It follows the rule for visits;
        where a visited waypoint had to be passed, it is the sum over all tasks.
        """
        if self.first_route is None:
            return self.saved_bound or 0.0
        times, graph = np.array(self.first_route.edge_times), self.graph
        once, stay = np.asarray(graph.waypoint_priority), np.asarray(graph.waypoint_duration)
        priority = np.array(graph.priority, float)
        if self.followable is not None:
            priority = once + (priority - once) * self.followable
        for leg in self.done:
            # As on a first arrival: what is done at the waypoint itself counts once in any case.
            own = leg.t_task - (0.0 if leg.revisit else stay[leg.goal])
            taken = leg.t_path + own + stay[leg.goal]
            edge = leg.start, leg.goal
            times[edge] = min(times[edge], taken)
            if leg.line is not None:
                priority[edge] = max(priority[edge], leg.priority)
        common = (times, priority, self.start, self.goal, self.t_available)
        if self.planning.visits == "edges":
            return trail_bound(*common, waypoint_priority=once, waypoint_duration=stay)
        if any(leg.revisit for leg in self.done):
            edges = np.where(graph.adjacency, priority - once, 0.0)
            return float(np.triu(np.maximum(edges, edges.T), 1).sum() + once.sum())
        return upper_bound(*common)

    @property
    def replan_compute(self) -> float:
        """Sum of T_compute over the mission's re-plans, s of wall-clock time; the first route is none."""
        return sum(route.cpu for route in self.routes[1:])

    def cost_mission(self, phi1: float | None = None, phi2: float | None = None) -> float:
        """Weigh the mission as it was done: Phi_1 |T_Mission - T_available| + Phi_2 sum(1 / rho) (Eq. 15).

        The sum is over the tasks done.

        Args:
            phi1: Phi_1, per second; that of `planning.phi` if absent.
            phi2: Phi_2, the same.

        Differences from the paper:
            The path cost of a leg is read as its travel time, T_path; planning time that the mission's clock
            was charged with is left out, since Eq. 16 adds it.
        """
        given = self.planning.phi
        phi1, phi2 = given[0] if phi1 is None else phi1, given[1] if phi2 is None else phi2
        used = self.t_mission - self.charged_compute
        return phi1 * abs(used - self.t_available) + phi2 * sum(1.0 / leg.priority for leg in self.earning)

    def cost_total(self, phi1: float | None = None, phi2: float | None = None) -> float:
        """Add the computing time of the mission's re-plans to `cost_mission` (Eq. 16).

        Differences from the paper:
            T_compute is the time of the new route alone: what checks whether it is due is not timed apart.
        """
        return self.cost_mission(phi1, phi2) + self.replan_compute

    @property
    def risk(self) -> float | None:
        """Chance of touching coast or an obstacle on the whole way, at most: the sum of the legs' (Boole)."""
        risks = [leg.risk for leg in self.done if leg.risk is not None]
        return min(sum(risks), 1.0) if risks else None

    @property
    def collisions(self) -> int:
        """Points about a metre apart on the executed tracks that lie inside a true obstacle or on land."""
        return sum(self._hits(leg) for leg in self.legs)

    def _hits(self, leg: LegRecord) -> int:
        if not len(leg.times):
            return 0
        # Recorded positions are some metres apart: look between them as well.
        steps = len(leg.times) - 1
        place = np.linspace(0.0, steps, 12 * steps + 1)
        left = np.minimum(place.astype(int), max(steps - 1, 0))
        part = (place - left)[:, None]
        right = np.minimum(left + 1, steps)
        positions = (1 - part) * leg.positions[left] + part * leg.positions[right]
        hit = np.zeros(len(place), bool)
        for m, radius in enumerate(leg.obstacle_radii):
            track = leg.obstacle_positions[:, m]
            centre = (1 - part) * track[left] + part * track[right]
            hit |= np.linalg.norm(positions - centre, axis=1) < radius
        if self.chart is not None:
            hit |= ~np.asarray(self.chart.is_water(positions[:, 0], positions[:, 1]))
        return int(hit.sum())

    def forecast(self) -> dict[str, float] | None:
        """Return how the forecast compares with the true sea; None for vortices."""
        legs = [leg for leg in self.done if not math.isnan(leg.current_difference)]
        if not legs:
            return None
        squares = [leg.t_path * leg.current_difference**2 for leg in legs]
        executed = sum(leg.t_path for leg in legs)
        return {
            "planned_s": sum(leg.t_planned for leg in legs),
            "executed_s": executed,
            "current_difference": math.sqrt(sum(squares) / executed),
        }

    def summary(self) -> dict[str, Any]:
        """Return the figures of the mission, ready for JSON."""
        return {
            "simulated": self.simulated,
            "t_available": self.t_available,
            "t_mission": self.t_mission,
            "t_residual": self.t_residual,
            "reserve_used": self.reserve_used,
            "success": self.success,
            "reason": self.reason,
            "tasks": self.tasks,
            "total_priority": self.total_priority,
            "priority_bound": rounded_up(self.bound),
            "revisits": sum(leg.revisit for leg in self.done),
            "path_calls": len(self.legs),
            "path_replans": sum(leg.path_replans for leg in self.legs),
            "mission_replans": max(len(self.routes) - 1, 0),
            "cost_mission": self.cost_mission(),
            "cost_total": self.cost_total(),
            "legs": [
                {
                    "from": leg.start,
                    "to": leg.goal,
                    "t_expected": leg.t_expected,
                    "t_planned": None if math.isnan(leg.t_planned) else leg.t_planned,
                    "t_path": leg.t_path,
                    "t_hold": leg.t_hold,
                    "t_wait": leg.t_wait,
                    "t_task": leg.t_task,
                    "priority": leg.priority,
                    "revisit": leg.revisit,
                    **({} if leg.speed is None else {"speed": leg.speed}),
                    **({"t_fix": leg.t_fix} if leg.t_fix else {}),
                    **({} if leg.position_std is None else {"position_std": leg.position_std}),
                    **({} if leg.risk is None else {"risk": leg.risk}),
                    "line": None if leg.line is None else leg.line.figures(leg.coverage),
                    "path_replans": leg.path_replans,
                    "arrived": leg.arrived,
                    "cpu_s": leg.cpu,
                }
                for leg in self.legs
            ],
            "cpu": {
                "path_s": sum(leg.cpu for leg in self.legs),
                "mission_s": sum(route.cpu for route in self.routes),
                "mission_replans_s": self.replan_compute,
                "travel_times_s": self.estimate_seconds,
                "charged_s": self.charged_compute,
                "compile_s": self.compile_seconds,
            },
            "collisions": self.collisions,
            **({} if self.risk is None else {"risk": self.risk}),
            "forecast": self.forecast(),
            **({} if (energy := self.energy) is None else {"energy": energy.summary()}),
            **({} if self.promise is None else {"promise": self.promise.summary}),
            "scenario": self.scenario.get("name", ""),
            "seed": self.seed,
            "version": version("auvplan"),
        }
