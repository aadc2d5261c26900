"""The plan of a mission that is under way: what is left of it is re-planned by the mission's own planners.

Before every leg the state of the planners is kept. A new plan begins from the state before the first leg that
may still change, with what has been learnt since.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from auvplan.errors import ScenarioError
from auvplan.executive.context import Mission
from auvplan.executive.legs import escape_track, finish, go_as_planned, plan_first_paths, set_out, unfit
from auvplan.executive.loop import seed_keys, settle, step
from auvplan.executive.planning import leaving, load_area_at, planning_context
from auvplan.executive.surfacing import after_fix
from auvplan.export.itinerary import Itinerary, PlannedLeg
from auvplan.export.runs import itinerary_of
from auvplan.link.limits import Allowance
from auvplan.mission import MissionGraph
from auvplan.ocean.currents import SumCurrent, combine, partition
from auvplan.ocean.ensemble import ErrorScale, Measured, corrected, member_weights, perturbed
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.ocean.known import KnownObstacle
from auvplan.ocean.obstacles import closest_approach
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime.arrays import Array
from auvplan.runtime.compiled import PLANS, expecting
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.lines import jobs_kept_off
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import MemberSettings
from auvplan.simulation.sea import Sea
from auvplan.site import Site

#: Of a vehicle that keeps to its paths.
_NONE = Allowance()

#: s that a vehicle goes aside for, at a share of its speed, and s that it stays there before it ends its
#: mission by itself.
_ASIDE, _BRISK, _WAIT = 90.0, 0.8, 900.0

#: Tasks of the plan after that of a leg that is given up which the vehicle may go to at once.
_NEXT = 2

#: Times as much less time as a plan was late by which it is made again.
_SHORTER = 2.0, 4.0, 8.0

#: Spheres of known obstacles that programs are made for; a slender one that reaches deep takes many.
_PLACES = 64


class Correction(NamedTuple):
    """What a measured current makes of the forecast.

    Attributes:
        offset: [3] m/s north, east, down, what was measured less that forecast.
        member: number of the member that fits what was measured best, from 1; 0 is the forecast itself.
        weight: how probable that one is among them; 1 where there is no other.
    """

    offset: Array
    member: int
    weight: float


@dataclass(frozen=True)
class Prospect:
    """A plan to the mission's end, which may be followed.

    Attributes:
        legs: in order, executed ones first.
        states: of the planners before each leg, and at the end.
    """

    legs: list[LegRecord]
    states: list[Mission]

    @property
    def ends(self) -> float:
        """Planned end of the mission, s."""
        return self.states[-1].now


class RollingPlan:
    """A mission planned to its end, and re-planned from any of its legs on.

    Attributes:
        followed: the plan that is executed, from the first call of `plan` on.
        reason: how the last planning ended, in words.
        left_out: waypoints whose task no plan does, and why.
        measured: currents that count.
        pace: share of the speed that it is asked for which the vehicle makes; counted on from now on.
        patience: s that a vehicle waits for its ways on and back, where both are blocked, before it goes
            straight to the destination.
    """

    followed: Prospect
    pace: float = 1.0
    patience: float = 0.0

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        folder: str | Path | None = None,
        area: OperatingArea | None = None,
    ) -> None:
        """Read the scenario's files and make ready; nothing is planned yet.

        Raises:
            ScenarioError, ChartError, GeoError, CurrentError: the scenario cannot be built.
        """
        if scenario.vehicle.saw_tooth is not None:
            reason = (
                "is planned for and not executed: use `auvplan plan` and `auvplan export`, or leave it out"
            )
            raise ScenarioError(reason, field="vehicle.saw_tooth")
        known = load_area_at(scenario, [0.0], folder) if area is None else area
        self._fingerprint = scenario.fingerprint
        self._context = planning_context(scenario, folder, known, 0.0, ahead=False)
        self._context.places = _PLACES
        (self._first,) = leaving(self._context, seed_keys([seed])[0], [0.0], seed)
        forecast = self._first.sea.forecast()
        self._forecasts = (forecast, *map(SumCurrent, self._context.area.members))
        self.measured = Measured.none()
        self._first.sea = Sea(forecast)
        self.reason, self._stop, self._task = "", 0.0, 0.0
        self.left_out: dict[int, str] = {}
        self._known, self._added = known.obstacles, dict[str, KnownObstacle]()

    @property
    def site(self) -> Site:
        """Where and when the mission is; at 0 degrees where the scenario does not say."""
        return self._context.area.site or Site(0.0, 0.0)

    @property
    def run(self) -> MissionRun:
        """What the mission is planned with: graph, chart, vehicle, time available."""
        return self._first.run

    @property
    def tolerance(self) -> float:
        """Seconds by which the rest may overrun before it is re-planned, as the scenario has it."""
        return self._context.rules.tolerance

    @property
    def legs(self) -> list[LegRecord]:
        """Legs that are followed, in order."""
        return self.followed.legs

    def plan(self, allowance: Allowance = _NONE, away: float = 0.0) -> bool:
        """Plan the whole mission and follow the plan; return whether it reaches the destination in time.

        Args:
            allowance: what the vehicle takes longer than its paths: until the first leg, and at the end of
                every leg, in this plan and in those that are made of it.
            away: s that it takes to the start.
        """
        self._context.circle = allowance.circle
        first, graph = self._first.fork(), self._clear_of_obstacles(self._first.graph)
        own = float(np.asarray(self.run.vehicle.speed))
        fastest = max((self.run.scenario.get("vehicle") or {}).get("speed_range") or [own])
        self._stop, self._task = allowance.ends(fastest), allowance.task
        first.now = away + allowance.begins(float(graph.positions[first.here][2]))
        more = self._stop * np.asarray(graph.adjacency) + self._task * (np.asarray(graph.duration) > 0.0)
        first.graph = replace(graph, duration=graph.duration + more)
        settle(first)
        found = self._complete(first)
        if found is not None:
            self.followed = found
        return found is not None

    def _clear_of_obstacles(self, graph: MissionGraph) -> MissionGraph:
        """Return a graph without the jobs and tasks that no vehicle does, as an obstacle stands too near."""
        context = self._context
        self.left_out = jobs_kept_off(context.scenario, context.area)
        graph, near = graph.without_waypoints(self.left_out), self.margin + context.circle
        standing = [known for known in context.area.obstacles if context.circle and not known.moves]
        for node, place in enumerate(np.asarray(graph.positions, float)):
            close = (known.name for known in standing if known.closest(place, 0.0, 0.0)[1] < near)
            work = np.asarray(graph.adjacency)[:, node] & (np.asarray(graph.duration)[:, node] > 0.0)
            if work.any() and (name := next(close, None)) is not None:
                self.left_out[node] = f"{name} is within {near:g} m of it, and the vehicle circles it"
                graph = graph.without_task_at(node)
                own = np.flatnonzero(work & (np.asarray(graph.duration)[:, node] > 0.0))
                graph = graph.without_edges([(int(i), node) for i in own], both_ways=False)
        return graph

    def ended(self, count: int, now: float) -> None:
        """Count on the leg after the first `count` having ended, with its task, at `now`, s."""
        legs = list(self.legs)
        leg = legs[count]
        begin = legs[count - 1].ends + leg.t_hold if count else float(leg.times[0])
        lasts, planned = now - leg.t_wait - leg.t_task - begin, leg.t_path
        if lasts > 0.0 and planned > 0.0:
            legs[count] = replace(leg, times=begin + (leg.times - leg.times[0]) * lasts / planned)
            self.followed = replace(self.followed, legs=legs)

    def _before(self, count: int, **changes: Any) -> Mission:
        """Return the planners' state before the leg after the first `count`, with these as they were gone."""
        state, gone = self.followed.states[count].fork(pace=self.pace, **changes), iter(self.legs[:count])
        state.run.legs[:] = [next(gone, leg) if leg.arrived else leg for leg in state.run.legs]
        return state

    def from_leg(self, count: int, now: float, late: bool = False) -> Prospect | None:
        """Re-plan all after the first `count` legs, which end at `now`.

        None where there is no plan that reaches the destination, in time if not `late`.
        """
        found = self._rest(lambda: self._before(count, now=now, cause="late"), count)
        return found if found is not None and (late or self.in_time(found)) else None

    def from_position(self, count: int, position: Array, now: float) -> Prospect | None:
        """Plan the rest of the leg after the first `count` from a position, and all after it.

        Where no path leads from there to the leg's goal, or all after it would be too late, its rest is left
        out, see `leave_leg`: the plan of most priority is taken that is in time, then that which ends first.
        Where only the time is short, the plan that is least late is taken.
        Where nothing but the way to the destination is open, and there is the time, it is not taken as long
        as there is `patience`.

        Args:
            count: legs that are done.
            position: [3] m, where the vehicle is.
            now: s.

        Returns:
            The plan, or None.
        """
        found, leg, home = list[Prospect](), self.legs[count], self.run.goal
        for plan in self._onward(count, position, now):
            if self.in_time(plan):
                return plan
            found.append(plan)
        found += self._without_leg(count, position, now)
        if good := list(filter(self.in_time, found)):
            best = max(good, key=lambda plan: (plan.states[-1].run.total_priority, -plan.ends))
            shut = len(found) == 1 and best.legs[count].goal == home not in (leg.start, leg.goal)
            if not (shut and 0.0 < self.patience <= self.run.t_available - best.ends):
                return best
            found = []
        if not found:
            self.reason = "no path leads on from where the vehicle is, nor back"
        return min(found, key=lambda plan: plan.ends, default=None)

    def _onward(self, count: int, position: Array, now: float) -> Iterator[Prospect]:
        """Yield a plan of the rest of a leg and all after it, as that was where it is in time still."""
        old, before, after = self.legs[count], self._before(count), self.followed.states[count + 1]
        if old.start == old.goal:  # a way back to its start, which `_without_leg` plans
            return
        # The route that the leg belongs to may have been made at its beginning, after the state was kept.
        route = {"route": after.route, "step": after.step - 1, "slack": after.slack}
        state = self._as_left(old, before.fork(now=now, cause="", **route))
        state.run.routes[:] = after.run.routes
        none = {"times": np.zeros(0), "positions": np.zeros((0, 3))}
        record = replace(old, plans=[], followed=0, **none, arrived=False, t_hold=0.0, t_fix=None)
        if self._set_out_from(state, record, position):
            state.run.legs.append(record)
            with expecting(PLANS, self._fingerprint):
                step([state])
            first, own = (record, before), self._complete(state.fork(), count, (record, before))
            if own is not None:
                yield own
            elif rest := self._rest(lambda: state.fork(cause="late"), count, first):
                yield rest

    @staticmethod
    def _as_left(leg: LegRecord, state: Mission) -> Mission:
        """Return a state with the position known as it was when the vehicle left, with a fix or without."""
        if state.navigation is not None:
            left = state.fork(now=float(leg.times[0]))
            known = after_fix(left) if leg.t_fix or state.at_surface else left.known
            state.navigation, state.navigated = known, left.now
        return state

    def in_time(self, plan: Prospect) -> bool:
        """Return whether a plan keeps the time available, and what else is promised."""
        return plan.states[-1].run.success

    def leave_leg(self, count: int, position: Array, now: float) -> Prospect | None:
        """Plan without the rest of the leg after the first `count`.

        Back to its start, to the destination without the task there, or on to one of the tasks after its own.

        Arguments as for `from_position`; None where the destination is not reached so in time, or where the
        leg is such a way back itself.
        """
        if self.legs[count].start == self.legs[count].goal:
            return None
        return next(filter(self.in_time, self._without_leg(count, position, now)), None)

    def _without_leg(self, count: int, position: Array, now: float) -> Iterator[Prospect]:
        """Yield plans without the rest of a leg, as `leave_leg` looks for."""
        old, before, home = self.legs[count], self._before(count), self.run.goal
        if old.start != old.goal:
            before.barred |= {(old.start, old.goal), (old.goal, old.start)}
            before.graph = before.graph.without_edges([(old.start, old.goal)])
        for goal in (old.start, home) if old.goal != home or old.priority > 0.0 else (old.start,):
            state = before.fork(now=now)
            record = LegRecord(old.start, goal, 0.0, self._stop, 0.0, revisit=True)
            if not self._set_out_from(state, record, position):
                continue
            go_as_planned([state])
            finish(state.active_leg)
            state.run.legs.append(record)
            state.now += record.t_task
            state.leg, state.here, state.cause = None, goal, "refused"
            if goal == home:
                state.end("")
            if (found := self._complete(state, count, (record, before), late=True)) is not None:
                yield found
        if old.start == old.goal:
            return
        graph, later = before.graph, dict.fromkeys(leg.goal for leg in self.legs[count + 1 :])
        tasks = graph.adjacency[old.start] & (np.asarray(graph.priority[old.start]) > 0.0)
        for goal in [node for node in later if node != home and tasks[node]][:_NEXT]:
            state = self._as_left(old, before.fork(now=now, cause="", route=None, step=0))
            record = LegRecord(old.start, goal, 0.0, *state.task(old.start, goal))
            if not self._set_out_from(state, record, position):
                continue
            state.run.legs.append(record)
            step([state])
            if not state.ended:
                state.cause = "refused"
                if (found := self._complete(state, count, (record, before), late=True)) is not None:
                    yield found

    def _set_out_from(self, state: Mission, record: LegRecord, position: Array) -> bool:
        """Plan a leg's path from a position instead of its start; return whether it may be gone."""
        set_out(state, record, position)
        plan_first_paths([state], "hazard")
        return not unfit(state)

    def add_obstacle(self, obstacle: KnownObstacle) -> None:
        """Count on an obstacle in all that is planned from now on; its position is for time 0 s.

        It stands for what was added by its name before.
        """
        self._count_on(self._added | {obstacle.name: obstacle})

    def remove_obstacle(self, name: str) -> bool:
        """Count no more on an obstacle that was added; return whether there was one of the name."""
        there = name in self._added
        self._count_on({other: known for other, known in self._added.items() if other != name})
        return there

    def _count_on(self, added: dict[str, KnownObstacle]) -> None:
        self._added = added
        self._context.area = replace(self._context.area, obstacles=(*self._known, *added.values()))

    def correct_current(self, velocity: Array, position: Array, now: float) -> Correction | None:
        """Count on what was measured: a current [3] m/s at [3] m.

        Of several forecasts that one is planned in from now on which fits best what was measured up to now.
        One on a grid is moved by its most probable error, where and when that is near what was measured; any
        other by its difference, everywhere.

        Returns:
            The correction, or None where there is no forecast to compare with; nothing is changed then.
        """
        measured = self.measured.added(velocity[:2], position, now)
        errs = self._context.scenario.current.members or MemberSettings()
        scale = ErrorScale(errs.error, errs.length, errs.duration)
        weights = member_weights(self._forecasts, measured, scale) if len(self._forecasts) > 1 else np.ones(1)
        member = int(weights.argmax())
        forecast = self._forecasts[member]
        moment = (np.asarray(part, np.float32) for part in (*position, now))
        offset = velocity - np.asarray([float(part) for part in forecast(*moment)])  # type: ignore[arg-type]
        if not np.isfinite(offset).all():
            return None
        shared, own = partition(forecast)
        if isinstance(shared, GriddedCurrent):
            moved = combine(corrected(shared, measured.off(forecast), measured, scale), own)
        else:
            moved = perturbed(forecast, offset=offset) if offset.any() else forecast
        self.measured = measured
        for state in (self._first, *self.followed.states):
            state.sea = Sea(moved)
            state.by_departure, state.sketches = None, {}
        return Correction(offset, member, float(weights[member]))

    def itinerary(self, prospect: Prospect, count: int) -> Itinerary:
        """Return the itinerary of all after the first `count` legs, numbered as in the whole mission.

        Times are by the pace that the vehicle makes, speeds those that it is asked for to make it.
        """
        end, rest, asked = prospect.states[-1], [], [leg.speed for leg in prospect.legs[count:]]
        for leg, speed in zip(prospect.legs[count:], asked, strict=True):
            # What the vehicle takes longer anyway it is not asked to stay.
            task = max(leg.t_task - self._stop - self._task, 0.0)
            rest.append(replace(leg, t_task=task, speed=None if speed is None else end.pace * speed))
        run = replace(end.run, legs=rest, obstacles=self._context.area.obstacles)
        run.vehicle = replace(run.vehicle, speed=end.pace * self._context.speed)
        found = itinerary_of(run, self.site)
        legs = [
            replace(leg, number=leg.number + count, speed=speed, pace=end.pace)
            for leg, speed in zip(found.legs, asked, strict=True)
        ]
        return replace(found, speed=self._context.speed, legs=tuple(legs))

    def clearance(self, positions: Array, times: Array) -> float:
        """Return m, how far a path through [n, 3] m at [n] s stays from the spheres of known obstacles."""
        return float(self._clearances(positions, times).min(initial=np.inf))

    def _clearances(self, positions: Array, times: Array) -> Array:
        """Return m [n], as `clearance`, from each place to the next."""
        known = self._context.known_obstacles(0.0)
        gone = np.asarray(times)[:, None, None] * known.velocity
        apart = closest_approach(np.asarray(positions, float)[:, None] - known.position - gone)[0]
        return (apart - known.radius).min(axis=1, initial=np.inf)

    def aside(self, count: int, position: Array, now: float) -> PlannedLeg | None:
        """Return a straight leg out of the way of known obstacles; None where staying is as good.

        At its end the vehicle stays until it is told to go on, and at last ends the mission by itself.

        Args:
            count: legs that are done.
            position: [3] m, where the vehicle is.
            now: s.
        """
        how = _ASIDE, self._clearances, _BRISK * self.pace * self._context.speed, 2.0 * _ASIDE
        track = escape_track(self._context, position, now, *how)
        if track is None:
            return None
        leg, ends = self.legs[count], np.stack([position, track[-1]])
        times, names = [now, now + _BRISK * _ASIDE], self.run.names  # it is asked for all its speed
        away = PlannedLeg.of(count + 1, leg.start, leg.goal, ends, times, names=names, hold=_WAIT)
        return replace(away, onward=_WAIT)

    @property
    def margin(self) -> float:
        """M that paths keep off obstacles."""
        return self._context.scenario.safety.obstacles

    def _rest(
        self, start: Callable[[], Mission], count: int, first: tuple[LegRecord, Mission] | None = None
    ) -> Prospect | None:
        """Plan to the end from a state that is made twice, in time if it can be; else as `_complete`.

        Paths take longer than routes reckon with: where that makes a plan late, it is made again with twice
        as much less time as it was late, and so on; not once the time is over.
        """
        state, available = start(), self.run.t_available
        over = state.now >= available
        found = self._complete(state, count, first, late=True)
        if found is None or found.ends < available or over:
            return found
        for times in _SHORTER:
            state = start()
            state.run.t_available = available - times * (found.ends - available)
            sooner = self._complete(state, count, first, late=True)
            for one in [] if sooner is None else sooner.states:
                one.run.t_available = available
            if sooner is None or self.in_time(sooner):
                return sooner or found
        return found

    def _complete(
        self,
        state: Mission,
        count: int = 0,
        first: tuple[LegRecord, Mission] | None = None,
        late: bool = False,
    ) -> Prospect | None:
        """Plan to the end, after `count` legs of the plan that is followed and, where given, a first one.

        Returns:
            None where the destination is not reached, in time if not `late`.
        """
        before = self.followed if count else Prospect([], [])
        legs, states = before.legs[:count], before.states[:count]
        if first is not None:
            legs, states = [*legs, first[0]], [*states, first[1]]
        with expecting(PLANS, self._fingerprint):
            while not state.ended:
                kept, known = state.fork(), len(state.run.legs)
                step([state])
                done = [record for record in state.run.legs[known:] if record.arrived]
                legs, states = legs + done, states + [kept] * len(done)
        self.reason = state.run.reason
        good = state.run.success or (late and state.run.arrived)
        return Prospect(legs, [*states, state]) if good else None
