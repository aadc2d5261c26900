"""Missions under way together: what they share, how far each one is, and the leg that it is on."""

import time
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR, PowerModel
from auvplan.errors import ScenarioError
from auvplan.executive.belief import ObstacleBelief
from auvplan.mission import MissionConfig, MissionGraph, MissionRoute
from auvplan.mission.survey import LinePart
from auvplan.mission.travel_times import ONE_PLACE
from auvplan.navigation import AT_SURFACE, Navigation
from auvplan.ocean.currents import Current
from auvplan.ocean.environment import Environment
from auvplan.ocean.known import Spheres, spheres
from auvplan.ocean.obstacles import Obstacles
from auvplan.path import PathConfig, PathPlan
from auvplan.path.saw_tooth import SawTooth
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.arrays import Array
from auvplan.runtime.compiled import compilations, compile_seconds
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.detours import DetourFinder
from auvplan.scenario.power import NavigationSettings
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import PlanningSettings
from auvplan.scenario.vehicles import navigation_settings
from auvplan.simulation.faults import Fault, Faults, Obstacle
from auvplan.simulation.sea import Sea
from auvplan.simulation.world import TrueObstacles, make_vehicle
from auvplan.site import at_time
from auvplan.vehicle import Vehicle

#: s without compilation from which on a planning call is not made again to be timed.
_LONG = 2.0

#: Speeds that are tried between the least and the greatest of a vehicle.
_SPEEDS = 9

#: Seconds ahead within which a collision, believed or known of, makes the vehicle re-plan at once.
HORIZON = 180.0


class Clock:
    """Times planning calls without compilation: a short call that compiled is made again, and that is timed.

    One that is not `timed` makes no call twice: plans are the same to the last bit.

    Attributes:
        compile_seconds: s of all calls that compiled something; of long ones what compilation took.
    """

    def __init__(self, timed: bool = True) -> None:
        self._timed, self.compile_seconds = timed, 0.0

    def time(self, call: Callable[[], Any]) -> tuple[Any, float]:
        """Return the call's result and its wall-clock seconds, free of compilation; 0 if not timed."""
        if not self._timed:
            return call(), 0.0
        before, waited = compilations(), compile_seconds()
        result, seconds = _timed(call)
        if compilations() == before:
            return result, seconds
        compiling = min(compile_seconds() - waited, seconds)
        if seconds - compiling > _LONG:
            self.compile_seconds += compiling
            return result, seconds - compiling
        self.compile_seconds += seconds
        return _timed(call)


def _timed(call: Callable[[], Any]) -> tuple[Any, float]:
    begin = time.perf_counter()
    result = call()
    jax.block_until_ready(result)
    return result, time.perf_counter() - begin


class Followed(NamedTuple):
    """What share of a part of a survey line can be followed, and how long the path is, in its lengths."""

    free: float
    longer: float


@dataclass
class MissionContext:
    """What missions in one sea area share, planned or simulated.

    Attributes:
        scenario: settings.
        path_config: of the path planner.
        route_configs: of the mission planner, for the first route and for later ones.
        vehicle: speed and limits; planners and simulator do without its power, and all but the planner of
            paths without its navigation.
        area: what is known of the operating area.
        folder: that relative paths in the scenario start from.
        clock: that planning calls are timed by.
        simulated: whether missions meet what no plan knows of; otherwise they go as planned, in the forecast.
        faults: injected into each mission, by its number; empty for none.
        followed: of each edge along a survey line, how it can be followed; None before it is known.
        places: spheres of known obstacles that programs are made for at least, so that those that become
            known need no other ones; where there are more, twice as many. 0 for as many as there are.
        power: what the vehicle draws, or None.
        navigation: how well it knows where it is, at a fix; or None.
        fixes: what fixes take and are for, or None.
        speeds: [K] m/s through the water among which the speed of each leg is chosen; that of the vehicle
            alone where its battery is limited and its speed is not free; None where energy does not count.
        saw_tooth: that paths become, for which the vehicle is that of `SawTooth.for_planning`; or None.
        circle: m that the vehicle circles off the place of a task.
        left: share of time and energy that plans keep back for `planning.promise`, where it is the same for
            all missions; None before it is known.
    """

    scenario: Scenario
    path_config: PathConfig
    route_configs: tuple[MissionConfig, MissionConfig]
    vehicle: Vehicle
    area: OperatingArea
    folder: str = "."
    clock: Clock = field(default_factory=Clock)
    simulated: bool = True
    faults: Sequence[Sequence[Fault]] = ()
    followed: dict[tuple[int, int], Followed] | None = None
    places: int = 0
    power: PowerModel | None = None
    navigation: Navigation | None = None
    fixes: NavigationSettings | None = None
    speeds: Array | None = None
    saw_tooth: SawTooth | None = None
    circle: float = 0.0
    left: float | None = None

    @cached_property
    def rules(self) -> PlanningSettings:
        """How missions are planned, with the preset's values for what the scenario leaves open."""
        return self.scenario.planning.resolved

    @property
    def surprises(self) -> int:
        """Obstacles on each leg that no plan knows of."""
        return self.scenario.simulation.obstacles.total if self.simulated else 0

    def faults_of(self, number: int) -> Faults:
        """Return the faults of one mission; all have as many places for obstacles."""
        if not self.faults:
            return Faults()
        counts = (sum(isinstance(fault, Obstacle) for fault in given) for given in self.faults)
        return Faults(self.faults[number], max(counts))

    @property
    def by_clock(self) -> bool:
        """Whether edges are timed by their departure: where the forecast changes, or areas close."""
        rules, forecast = self.rules, self.area.forecast
        changes = (forecast is not None and not forecast.steady) or bool(self.area.closures)
        return rules.travel_times == "sea" and rules.departures > 1 and changes

    @cached_property
    def around(self) -> DetourFinder:
        """Paths round what is in the way between jobs."""
        return DetourFinder(self.scenario, self.area)

    @property
    def epoch(self) -> datetime | None:
        """The moment that times count from, or None."""
        return None if self.area.site is None else self.area.site.epoch

    def moment(self, now: float) -> str:
        """Return a time, s since the epoch, in words."""
        return at_time(now, self.epoch)

    @property
    def box(self) -> tuple[Array, Array]:
        """Corners of the box that vehicles stay in, [3] m each."""
        lower, upper = self.scenario.box
        return np.asarray(lower), np.asarray(upper)

    def environment(self, current: Current, obstacles: Obstacles | None = None) -> Environment:
        """Return the world as planners know it."""
        lower, upper = (jax.device_put(corner.astype(float)) for corner in self.box)
        known, area = Obstacles.none() if obstacles is None else obstacles, self.area
        return Environment(current, area.chart, known, lower, upper, area.seabed, area.closures)

    def known_obstacles(self, now: float) -> Spheres:
        """Spheres that cover what is known beforehand, where it is at a time, s."""
        lower, upper = self.scenario.box
        found, places = spheres(self.area.obstacles, (lower[2], upper[2]), now), self.places
        while 0 < places < len(found.radius):
            places *= 2
        return found.padded(places)

    @property
    def lookahead(self) -> float:
        """S ahead within which a plan must be clear: what is further away is seen from near before."""
        return max(HORIZON, self.scenario.sensors.range / self.speed)

    @property
    def as_built(self) -> Vehicle:
        """The vehicle with power and navigation, and as fast as it is through the water."""
        glides = {"speed": self.scenario.vehicle.speed, "transit_depth": None} if self.saw_tooth else {}
        return replace(self.vehicle, power=self.power, navigation=self.navigation, **glides)

    @property
    def speed(self) -> float:
        """|v|, m/s."""
        return float(self.vehicle.speed)  # type: ignore[arg-type]


class ByDeparture(NamedTuple):
    """Travel times [M, N, N] s of all edges by departures, [M] s since the epoch."""

    departures: Array
    travel_time: Array


class AtSpeed(NamedTuple):
    """Travel times of edges at another speed than the vehicle's.

    Attributes:
        lasts: [N, N] s, or [M, N, N] by departure, as estimated last.
        beside: those at the vehicle's speed then.
        by_departure: as in `Mission`.
    """

    lasts: Array
    beside: Array
    by_departure: ByDeparture | None


class Stretch(NamedTuple):
    """What was executed of a leg between two looks, n steps.

    Attributes:
        times: [n] s at their ends.
        positions, obstacles: [n, 3] m and [n, M, 3] m, the truth then.
        ground, water: [n, 3] m/s, velocity over ground and current during each step.
    """

    times: Array
    positions: Array
    obstacles: Array
    ground: Array
    water: Array


@dataclass
class Leg:
    """The leg that a vehicle is on, between two waypoints.

    Attributes:
        record: what is kept of it.
        origin, target: [3] m, the waypoints.
        truth: its obstacles, and `moves` [M, 3] m/s their velocities over ground.
        belief: of the obstacles.
        plan: that is followed; `marks` [S] m are distances along it.
        track: [S, 3] m that is followed, and `arc` m how far: the plan's, or that of an escape.
        moving: whether it follows the track; otherwise it keeps station.
        escaping: whether the track gives way to an obstacle.
        windows: s, times at which the path is re-planned.
        stopped: why it was given up, or empty.
        stretches: as executed; the first is the start, without a step.
        met: [3] m/s, the current that the vehicle met last when it moved; None before.
    """

    record: LegRecord
    origin: Array
    target: Array
    truth: TrueObstacles
    moves: Array
    belief: ObstacleBelief
    plan: PathPlan | None = None
    marks: Array = field(default_factory=lambda: np.zeros(0))
    track: Array = field(default_factory=lambda: np.zeros((0, 3)))
    arc: float = 0.0
    moving: bool = True
    escaping: bool = False
    windows: list[float] = field(default_factory=list)
    stopped: str = ""
    stretches: list[Stretch] = field(default_factory=list)
    met: Array | None = None

    @property
    def position(self) -> Array:
        """[3] m, where the vehicle is."""
        return self.stretches[-1].positions[-1] if self.stretches else self.origin

    def set_off(self, now: float) -> None:
        """Keep where all are before the first step."""
        none, obstacles = np.zeros((0, 3)), self.truth.position[None].copy()
        self.stretches.append(Stretch(np.asarray([now]), self.origin[None], obstacles, none, none))

    @property
    def stays(self) -> bool:
        """Whether both waypoints are one place: there is no path, but another task."""
        return float(np.linalg.norm(self.target - self.origin)) <= ONE_PLACE

    @property
    def followed(self) -> PathPlan:
        """The plan being followed; there is one from the leg's beginning on."""
        assert self.plan is not None
        return self.plan

    def follow(self, plan: PathPlan) -> None:
        """Follow a plan from its beginning."""
        gaps = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1)
        self.plan, self.marks = plan, np.concatenate([[0.0], np.cumsum(gaps)])
        self.track, self.arc = plan.positions, 0.0
        self.moving, self.escaping = True, False

    def keep(self, times: Array) -> None:
        """Go on with the plan in hand, at times [S] s."""
        self.plan = replace(self.followed, times=times)
        self.moving = True

    @property
    def under_way(self) -> bool:
        """Whether the leg is neither finished nor stopped."""
        return not self.record.arrived and not self.stopped


@dataclass
class Mission:
    """One mission under way: its clock and sources of chance, where it stands, what it follows.

    Attributes:
        context: what it shares with others.
        number: its place among the missions asked for.
        run: the record.
        sea: the true current.
        key: of the planners.
        rng: of obstacles and sensors.
        graph: waypoints that may still be visited and the tasks that are left.
        timed: the same with the travel times expected now, and without edges that have no feasible path.
        now: s since the epoch.
        here: waypoint reached.
        leg: that it is on, or None at a waypoint.
        route: of tasks that is followed, and `step` the place in it.
        slack: s that the route left of the available time, less the reserve, when it was made.
        allowance: share by which it is taken to last longer when its tasks are chosen.
        cause: why a new route is due, or empty.
        learnt: s, travel times of edges (i, j) whose planned path was refused for its time; where speeds are
            chosen, in shares of those estimated.
        chosen: [N, N] places of the speeds of edges among the context's, or None.
        slow_and_fast: what is known of edges at the least and the greatest of these, by the speed.
        energy_slack: J that the route left beyond the reserve, when it was made.
        energy_kept: J that no route is planned to use, beside the reserve.
        by_departure: times of all edges where currents are forecast to change; None before they are timed.
        sketches: paths [K, S, 3] m by which edges are timed, by the ends of each, [6] m as bytes.
        refusals: of legs in a row.
        obstruction: the last leg that was refused and why, or empty.
        no_route: why the last call of the mission planner found no route, or empty.
        visited: waypoints that were reached or left.
        barred: edges (i, j) whose path was refused for a broken limit.
        path_calls: planning calls so far, which number the keys.
        pace: share of the speed through the water that it is asked for which the vehicle made last.
        faults: injected.
        parts: of survey lines, by the edge (i, j) that follows them.
        navigation: how well the vehicle knew where it was at `navigated`, s since the epoch; or None.
        ended: whether it is over.
    """

    context: MissionContext
    number: int
    run: MissionRun
    sea: Sea
    key: jax.Array
    rng: np.random.Generator
    graph: MissionGraph
    timed: MissionGraph
    now: float = 0.0
    here: int = 0
    leg: Leg | None = None
    route: MissionRoute | None = None
    step: int = 0
    slack: float = 0.0
    allowance: float = 0.0
    cause: str = "start"
    learnt: dict[tuple[int, int], float] = field(default_factory=dict)
    chosen: NDArray[np.integer] | None = None
    slow_and_fast: dict[float, AtSpeed] = field(default_factory=dict)
    energy_slack: float = 0.0
    energy_kept: float = 0.0
    by_departure: ByDeparture | None = None
    sketches: dict[bytes, Array] = field(default_factory=dict)
    refusals: int = 0
    obstruction: str = ""
    no_route: str = ""
    visited: set[int] = field(default_factory=set)
    barred: set[tuple[int, int]] = field(default_factory=set)
    path_calls: int = 0
    pace: float = 1.0
    faults: Faults = field(default_factory=Faults)
    parts: dict[tuple[int, int], LinePart] = field(default_factory=dict)
    navigation: Navigation | None = None
    navigated: float = 0.0
    ended: bool = False

    @property
    def rest(self) -> list[int]:
        """Waypoints of the route from the one reached to the destination; empty without a route."""
        return [] if self.route is None else [int(node) for node in self.route.nodes[self.step :]]

    def task(self, i: int, j: int) -> tuple[float, float]:
        """Duration, s, and priority of the task of an edge; done under way it takes no time of its own."""
        under_way = self.context.scenario.tasks_under_way
        return 0.0 if under_way else float(self.graph.duration[i, j]), float(self.graph.priority[i, j])

    @property
    def last_route(self) -> MissionRoute:
        """The route that is followed; there is one from the first on."""
        assert self.route is not None
        return self.route

    @property
    def active_leg(self) -> Leg:
        """The leg that it is on."""
        assert self.leg is not None
        return self.leg

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle at the speed that it makes on its leg."""
        chosen = self.leg is not None and self.leg.record.speed is not None
        vehicle = self.context.vehicle
        return replace(vehicle, speed=self.speed) if chosen or self.pace != 1.0 else vehicle

    def chosen_speed(self, edge: tuple[int, int]) -> float | None:
        """|v| that is chosen for an edge, m/s; None where it is the vehicle's."""
        speeds = self.context.speeds
        if speeds is None or len(speeds) == 1 or self.chosen is None:
            return None
        return float(speeds[self.chosen[edge]])

    @property
    def asked_speed(self) -> float:
        """|v| that it is asked for on the leg that it is on, m/s."""
        chosen = None if self.leg is None else self.leg.record.speed
        return self.context.speed if chosen is None else chosen

    @property
    def speed(self) -> float:
        """|v| that it makes, m/s."""
        return self.pace * self.asked_speed

    @property
    def known(self) -> Navigation | None:
        """How well the vehicle knows where it is now; None where that is exactly.

        Whatever it does counts as a way at its speed, at a waypoint at the vehicle's. It is in bottom lock as
        it would be where it is.
        """
        if self.navigation is None:
            return None
        passed, here = max(self.now - self.navigated, 0.0), self.graph.positions[self.here]
        place = np.asarray(here if self.leg is None else self.leg.position, float)
        reach, bed, locked = self.navigation.bottom_lock, self.context.area.seabed, False
        if reach is not None and bed is not None:
            locked = float(bed.altitude(place)) <= float(np.asarray(reach))
        return self.navigation.after(self.speed * passed, 0.0 if locked else passed)

    def navigate(self, known: Navigation | None) -> None:
        """Keep how well the vehicle knows where it is now."""
        self.navigation, self.navigated = known, self.now

    @property
    def at_surface(self) -> bool:
        """Whether the waypoint reached is at the surface, where there are fixes."""
        return float(self.graph.positions[self.here][2]) <= AT_SURFACE

    @property
    def energy_left(self) -> float:
        """J left beyond what is kept after what was drawn so far; infinite where no battery is known."""
        energy = self.run.energy
        return np.inf if energy is None else energy.margin * WATT_HOUR - self.energy_kept

    @property
    def doing(self) -> str:
        """What it does now, in a few words."""
        return f"at {self.run.place(self.here)}" if self.leg is None else self.leg_name

    @property
    def leg_name(self) -> str:
        """The leg that it is on, in words."""
        record = self.active_leg.record
        return f"leg {self.run.called(record.start)} to {self.run.called(record.goal)}"

    def fork(self, **changes: Any) -> "Mission":
        """Return a mission that goes on from here by itself; what paths were sketched, both keep."""
        own: dict[str, Any] = {
            "run": replace(self.run, routes=list(self.run.routes), legs=list(self.run.legs)),
            "sea": copy(self.sea),
            "learnt": dict(self.learnt),
            "slow_and_fast": dict(self.slow_and_fast),
            "visited": set(self.visited),
            "barred": set(self.barred),
        }
        return replace(self, **own | changes)

    def path_key(self) -> jax.Array:
        """Return a fresh key for the next path planning call."""
        self.path_calls += 1
        return prng.folded(self.key, self.path_calls)

    def charge(self, seconds: float) -> None:
        """Let the mission's clock pass planning time (Eq. 16)."""
        self.now += seconds
        self.run.charged_compute += seconds

    def end(self, reason: str) -> None:
        """Book the end; an empty reason means that the destination was reached."""
        run = self.run
        self.ended = True
        run.t_mission = self.now
        run.arrived = self.here == run.goal and not reason
        arrives = "destination reached" if run.simulated else "planned to reach the destination"
        run.reason = reason or arrives + (" in time" if run.in_time else " too late")
        if run.arrived and (lack := run.energy_lack):
            run.reason += f", {lack}"


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
    simulated: bool = True,
) -> MissionContext:
    """Gather the operating area, the vehicle and the planners' settings of a scenario.

    All is planned `ahead` of the departure or under way, see `path_config`; missions are `simulated` or go as
    planned.

    Raises:
        ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
    """
    # Files are read at the edge of the package; what is built from them can be given instead.
    from auvplan.io.area import load_area

    home = scenario.folder if folder is None else str(folder)
    vehicle, shape = make_vehicle(scenario, home), scenario.vehicle.saw_tooth
    saw = None if shape is None else shape.made()
    area = load_area(scenario, home) if area is None else area
    for wrong, reason in (
        (simulated, "is planned for and not simulated: use `auvplan plan`, or leave it out"),
        (area.jobs and area.jobs.lines, "does not keep the depth of survey lines: leave one of them out"),
    ):
        if saw is not None and wrong:
            raise ScenarioError(reason, field="vehicle.saw_tooth")
    speeds, power = scenario.vehicle.speed_range, vehicle.power
    limited = power is not None and power.battery is not None and saw is None
    limited &= scenario.planning.resolved.objective == "priority"
    fixed = np.asarray([scenario.vehicle.speed]) if limited else None
    first, later = mission_configs(scenario)
    if speeds is not None or limited:
        first, later = (config.replace(saves=scenario.planning.saves) for config in (first, later))
    if saw is not None and vehicle.navigation is not None:
        reason = "does not go with vehicle.saw_tooth, whose surfacings between dives are fixes: leave one out"
        raise ScenarioError(reason, field="vehicle.navigation")
    known, vehicle = vehicle.navigation, replace(vehicle, navigation=None)
    return MissionContext(
        scenario,
        path_config(scenario, ahead),
        (first, later),
        (vehicle if saw is None else saw.for_planning(vehicle)).without_power(),
        area,
        home,
        simulated=simulated,
        power=power,
        navigation=known,
        fixes=navigation_settings(scenario.vehicle.navigation, home),
        speeds=fixed if speeds is None else np.linspace(*speeds, _SPEEDS),
        saw_tooth=saw,
    )
