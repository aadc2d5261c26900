"""The mission sheet: what the person who hands a plan to the vehicle reads of it."""

import html
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR
from auvplan.mission.graph import shortest_path, time_to_go
from auvplan.mission.jobs import NodesOfJob, jobs_done, jobs_of, kept_off
from auvplan.mission.route import MissionRoute
from auvplan.mission.survey import LinePart
from auvplan.mission.timetable import Stages, Timetable, stages
from auvplan.mission.travel_times import ONE_PLACE
from auvplan.path.reasons import lengthening
from auvplan.records import LegRecord, MissionRun, Promise
from auvplan.runtime.files import write_atomically
from auvplan.runtime.formatting import clearance, counted, depth, figure, hours, rounded_up
from auvplan.scenario.provenance import SourceFile, source_files
from auvplan.view import timeline
from auvplan.view.margins import Margins
from auvplan.view.scene import waypoint_name

#: Times what a route needs, a search finds it: it adds up in single precision, and tries few of all speeds.
_MORE, _MORE_ENERGY = 1.0 + 1e-5, 1.0005

#: A chance that is stated no finer.
_NO_RISK = 1e-4

#: Why a mission was planned again, by `RouteRecord.cause`.
_CAUSES = {
    "late": "a leg took longer than expected",
    "early": "a leg took less than expected",
    "refused": "a leg was refused",
    "charge": "the charge did not do for the rest",
    "spare": "there was charge to spare",
}


@dataclass(frozen=True)
class Stop:
    """A place on the route.

    Attributes:
        name: of the waypoint.
        task: name of the job that is done here or on the leg here, or empty.
        priority: of the task; 0 without one.
        arrival: s since the departure.
        utc: moment of the arrival, or None without a date.
        depth: m.
        wait: s between the arrival and the beginning of the task, and before the next leg.
        hold: s that the task takes.
        window: the task's time windows in words, or empty.
        length: m, of the path to it.
        ground_speed, slowest: m/s over ground on the leg, mean and least.
        coast, closed, bed, obstacle: m, least distance on the leg to the coast, to areas closed then, above
            the sea bed and to an obstacle; None where there is none. See `Margins`.
        place: longitude and latitude, degrees; None without a site.
        travel: s, of the leg to it.
        transit: m, least, mean and greatest depth on the leg to it; None at the start.
        speed: m/s through the water on the leg to it; None where all are gone at the vehicle's.
        latest: s since the departure, until when all here has to be over for the mission to be home in time
            as surely as it promises; None where it promises nothing.
        otherwise: where the vehicle goes when it leaves later; until when, s since the departure, None of the
            last; and s that it takes there. Empty without such a rule.
        position_std: m, standard deviation of the position along each horizontal axis on arrival; None where
            it is known exactly.
        risk: chance of touching coast or an obstacle on the leg to it, at most; None without that.
        fix: s that the vehicle surfaces here for a fix, before the next leg; None where it does not.
    """

    name: str
    task: str
    priority: float
    arrival: float
    utc: datetime | None
    depth: float
    wait: float
    hold: float
    window: str
    length: float
    ground_speed: float
    slowest: float
    coast: float | None
    closed: float | None
    bed: float | None
    obstacle: float | None
    place: tuple[float, float] | None = None
    travel: float = 0.0
    transit: tuple[float, float, float] | None = None
    speed: float | None = None
    latest: float | None = None
    otherwise: tuple[tuple[str, float | None, float], ...] = ()
    position_std: float | None = None
    risk: float | None = None
    fix: float | None = None

    @property
    def done(self) -> str:
        """What is done here, in words: the task, whose name is not repeated where it is the waypoint's."""
        task = "done" if self.task and self.task == self.name else self.task
        return ", ".join(filter(None, [task, "surfaces for a fix" if self.fix else ""]))

    def moment(self, seconds: float) -> str:
        """Return a time not to be passed, s since the departure, as the arrival is given."""
        later = timedelta(seconds=seconds - self.arrival)
        return hours(seconds) if self.utc is None else f"{self.utc + later:%H:%M:%S}"

    @property
    def ways(self) -> str:
        """Where the vehicle goes when it leaves later, in words."""
        return "; ".join(
            f"to {to}, {takes:.0f} s" + ("" if until is None else f", until {self.moment(until)}")
            for to, until, takes in self.otherwise
        )


@dataclass(frozen=True)
class LeftOut:
    """A job that the plan leaves out.

    Attributes:
        name: of the job.
        priority: of all that is left of it.
        reason: why, and what it would take.
    """

    name: str
    priority: float
    reason: str


@dataclass(frozen=True)
class MissionSheet:
    """What a mission does, when, and with which margins.

    Attributes:
        title: name of the scenario.
        facts: name and value of what concerns the mission as a whole.
        stops: in the order of the route.
        left_out: jobs that are not done.
        warnings: a line each.
        files: that the mission was planned on.
        assumed: what was assumed in reading them, a line each.
        zone: name of the local time zone, or empty.
        accuracy: m, of the coast: no distance to it is stated finer.
        reach: m, greatest distance to the coast that is known.
    """

    title: str
    facts: dict[str, str]
    stops: tuple[Stop, ...]
    left_out: tuple[LeftOut, ...]
    warnings: tuple[str, ...] = ()
    files: tuple[SourceFile, ...] = ()
    assumed: tuple[str, ...] = ()
    zone: str = ""
    accuracy: float = 0.0
    reach: float = math.inf

    def plain(self) -> dict[str, Any]:
        """Return the sheet ready for JSON."""
        stops = [
            asdict(stop) | {"utc": None if stop.utc is None else f"{_second(stop.utc):%Y-%m-%dT%H:%M:%SZ}"}
            for stop in self.stops
        ]
        for stop in stops:
            for name in ("speed", "latest", "otherwise", "position_std", "risk", "fix"):
                if stop[name] is None or stop[name] == ():
                    del stop[name]
        return {
            "facts": self.facts,
            "stops": stops,
            "left_out": [asdict(job) for job in self.left_out],
            "warnings": list(self.warnings),
            "files": [asdict(file) for file in self.files],
            "assumed": list(self.assumed),
            "accuracy": self.accuracy,
        }

    def table(self, brief: bool = False) -> tuple[list[str], list[list[str]]]:
        """Headings and cells of the stops, as people read them; in `brief`, what fits a terminal."""
        rows = []
        for number, (stop, transit) in enumerate(zip(self.stops, _transits(self.stops), strict=True)):
            clocks = [] if stop.utc is None else [("UTC", f"{_second(stop.utc):%H:%M:%S}")]
            latest = "" if stop.latest is None else stop.moment(stop.latest)
            coast = clearance(stop.coast, self.accuracy, self.reach)
            if brief:
                waits = any(other.wait for other in self.stops)
                hold, parts = "wait + hold" if waits else "hold", [stop.wait] * waits + [stop.hold]
                rows.append([
                    ("", str(number)), ("waypoint", stop.name), ("task", stop.done),
                    *(clocks or [("after", hours(stop.arrival))]), ("leave by", latest),
                    ("depth", f"{depth(stop.depth)} m"),
                    (hold, " + ".join(f"{_whole(part)}" for part in parts) + " s" if any(parts) else ""),
                    ("coast, m", coast), ("closed, m", clearance(stop.closed)),
                    ("bed, m", clearance(stop.bed)),
                ])  # fmt: skip
                continue
            if stop.utc is not None and self.zone:
                local = _second(stop.utc.astimezone(ZoneInfo(self.zone)))
                clocks.append((self.zone.split("/")[-1], f"{local:%H:%M:%S}"))
            place = "" if stop.place is None else f"{stop.place[1]:.5f}, {stop.place[0]:.5f}"
            speeds = f"{stop.ground_speed:.1f} ({stop.slowest:.1f})"
            rows.append([
                ("", str(number)), ("waypoint", stop.name), ("latitude, longitude", place),
                ("task", stop.done), ("priority", figure(stop.priority) if stop.priority else ""),
                ("after", hours(stop.arrival)), *clocks, ("leave by", latest), ("otherwise", stop.ways),
                ("depth, m", depth(stop.depth)), ("transit, m", transit), ("may begin", stop.window),
                ("wait, s", f"{_whole(stop.wait)}" if stop.wait else ""),
                ("hold, s", f"{_whole(stop.hold)}" if stop.hold else ""),
                ("leg, s", f"{_whole(stop.travel):,}" if number else ""),
                ("leg, m", f"{stop.length:,.0f}" if number else ""),
                ("through water, m/s", "" if stop.speed is None else f"{stop.speed:.2f}"),
                ("speed, m/s", speeds if number else ""), ("coast, m", coast),
                ("closed, m", clearance(stop.closed)), ("bed, m", clearance(stop.bed)),
                ("obstacle, m", clearance(stop.obstacle)),
                ("fix, s", f"{_whole(stop.fix)}" if stop.fix else ""),
                ("position, m", "" if stop.position_std is None else f"{stop.position_std:.0f}"),
                ("risk", "" if stop.risk is None else share(stop.risk)),
            ])  # fmt: skip
        filled = {name for row in rows for name, cell in row if cell}
        kept = [
            [column for column in row if column[0] in filled or column[0] not in _OPTIONAL] for row in rows
        ]
        return [name for name, _ in kept[0]] if kept else [], [[cell for _, cell in row] for row in kept]


def _whole(seconds: float) -> int:
    """Return a time in whole seconds, halves rounded up as on the page."""
    return math.floor(seconds + 0.5)


def _second(moment: datetime) -> datetime:
    """Return a moment to the nearest second."""
    return (moment + timedelta(seconds=0.5)).replace(microsecond=0)


#: Columns of the sheet that are left out where they have nothing to say.
_OPTIONAL = (
    *("latitude, longitude", "leave by", "otherwise", "transit, m", "may begin", "wait, s", "hold, s"),
    *("through water, m/s", "closed, m", "bed, m", "obstacle, m", "fix, s", "position, m", "risk"),
)


def sheet_of(run: MissionRun) -> MissionSheet:
    """Return the sheet of a plan or of a mission as it was executed."""
    start = LegRecord(
        run.start, run.start, 0.0, 0.0, 0.0, times=np.zeros(1),
        positions=np.asarray(run.graph.positions, float)[[run.start]], obstacle_positions=np.zeros((1, 0, 3)),
    )  # fmt: skip
    stops = [replace(_stop(run, start), window=_windows(run, run.start), transit=None, speed=None)]
    stops += [_stop(run, leg) for leg in run.done]
    for number, leg in enumerate(run.done):
        waits = leg.t_hold - (leg.t_fix or 0.0)
        stops[number] = replace(stops[number], wait=stops[number].wait + waits, fix=leg.t_fix)
    # Where the vehicle has arrived for good nothing is left to be late for.
    for number, latest in enumerate(run.promise.latest[:-1] if run.promise else ()):
        stops[number + 1] = replace(stops[number + 1], latest=latest)
    turns = run.promise.turns if run.promise else ()
    for number in {turn.leg for turn in turns}:
        here = sorted((turn for turn in turns if turn.leg == number), key=lambda turn: turn.latest)
        until = [*(turn.latest for turn in here[1:]), None]
        goals = [run.goal if turn.past is None else run.done[turn.past].goal for turn in here]
        names = [waypoint_name(run, goal) for goal in goals]
        ways = zip(names, until, [turn.takes for turn in here], strict=True)
        stops[number + 1] = replace(stops[number + 1], otherwise=tuple(ways))
    epoch = None if run.site is None else run.site.utc(0.0)
    available = f"{hours(run.t_available)} ({run.t_available:.0f} s)"
    taken = (
        f"{hours(run.t_mission)} of {hours(run.t_available)} ({run.t_mission:.0f} of {run.t_available:.0f} s)"
    )
    left = f"{hours(run.t_residual)}, of which no plan uses {run.planning.reserve:g} s"
    facts = {
        "outcome": run.reason,
        "departure": "no date" if epoch is None else timeline.moment_in_words(run, 0.0),
        "arrival": timeline.moment_in_words(run, run.t_mission) if run.arrived else "",
        **({"time": taken, "time left": left} if run.done else {"time available": available}),
        "at the end": timeline.END_BEHAVIOURS[run.safety.end] if run.arrived else "",
        "tasks": f"{run.tasks}, total priority {figure(run.total_priority)} of at most "
        f"{figure(rounded_up(run.bound))}",
        "length": f"{sum(stop.length for stop in stops) / 1000.0:.1f} km" if run.done else "",
        "in depth": _steepest(run),
        "speed": f"{run.speeds} through the water" if run.speeds else "",
        "paths": _bounded(run),
        "position": _uncertain(run, stops),
        "survey lines": "; ".join(_lines(run)),
        "promise": "" if run.promise is None else _promised(run.promise),
        "energy": "" if (energy := run.energy) is None else energy.line.removeprefix("energy "),
        "closed areas": "; ".join(timeline.closures_in_words(run)),
    }
    return MissionSheet(
        str(run.scenario.get("name") or "mission"),
        {name: words for name, words in facts.items() if words},
        tuple(stops),
        tuple(_left_out(run)),
        tuple(_warnings(run, stops)),
        source_files(run.scenario, run.folder),
        run.assumed,
        timeline.time_zone(run),
        float((run.scenario.get("chart") or {}).get("accuracy") or 0.0),
        run.coast_reach,
    )


def _promised(promise: Promise) -> str:
    """Return how sure a plan is to be home in time, and when."""
    first, middle, last = (hours(end) for end in promise.ends)
    asked = "" if promise.asked is None else f"; {100.0 * promise.asked:g} % was asked for"
    back = f", and {100.0 * promise.left:.1f} % of the time is kept back for it" if promise.left else ""
    over = f"over after {first} to {last} in 90 % of them, {middle} in the median"
    rule = ""
    if promise.priority is not None:
        skipped = sum(turn.share for turn in promise.turns if turn.past is not None)
        home = 100.0 * sum(turn.share for turn in promise.turns if turn.past is None)
        rule = f"; what is late is left out: {skipped:.2f} tasks in the mean, all the rest in {home:.1f} %"
        rule += f" of them; priority {promise.priority:.1f} in the mean"
    return f"{promise.line}{asked}{back}; {over}{rule}"


def _lines(run: MissionRun) -> list[str]:
    """Return how much of each survey line that is followed is covered, and how far off it the track is."""
    followed = {frozenset((leg.start, leg.goal)): leg for leg in run.done if leg.line and not leg.missed}
    found = []
    for job in jobs_of(run.jobs):
        legs = [followed[edge] for edge in map(frozenset, pairwise(job.nodes)) if edge in followed]
        parts = [leg.coverage for leg in legs if leg.coverage is not None]
        if not parts:
            continue
        places = np.asarray(run.graph.positions, float)[job.nodes]
        length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
        covered = sum(part.length for part in parts)
        mean = sum(part.length * part.mean for part in parts) / max(covered, 1e-9)
        found.append(
            f"{job.name} {covered:,.0f} of {length:,.0f} m ({100.0 * covered / length:.0f} %), "
            f"{mean:.1f} m off it in the mean and {max(part.worst for part in parts):.1f} m at worst"
        )
    return found


def _steepest(run: MissionRun) -> str:
    """Return the steepest pitch on the way, and the limits in the vertical; empty where all is level."""
    pitch = np.concatenate([np.zeros(1), *(leg.motion.pitch for leg in run.done)])
    steepest = float(np.degrees(np.nanmax(np.abs(pitch))))
    if steepest < 0.5:
        return ""
    vehicle, limits = run.vehicle, []
    if vehicle.pitch_max is not None:
        limits.append(f"{np.degrees(vehicle.pitch_max):.0f} degrees")
    for verb, rate in (("climbs", vehicle.climb_rate_max), ("dives", vehicle.dive_rate_max)):
        if rate is not None:
            limits.append(f"{verb} of {float(rate):g} m/s")  # type: ignore[arg-type]
    allowed = f"; the vehicle's limits: {', '.join(limits)}" if limits else ""
    winding = [
        (waypoint_name(run, leg.goal), line)
        for leg in run.done
        if (line := lengthening(leg.positions, leg.t_path, run.vehicle_on(leg)))
    ]
    legs = [f"; the leg to {goal} {line}" for goal, line in winding[:1]]
    if len(winding) > 1:
        legs.append(f"; those to {', '.join(goal for goal, _ in winding[1:])} wind as well")
    return f"up to {steepest:.0f} degrees steep{allowed}{''.join(legs)}"


def _bounded(run: MissionRun) -> str:
    """Return how far the paths are from the quickest possible, as far as that is known; else empty."""
    gaps = [(leg.plans[leg.followed].gap, leg.goal) for leg in run.done if leg.plans]
    gaps = [(gap, goal) for gap, goal in gaps if not math.isnan(gap)]
    if not gaps:
        return ""
    worst, goal = max(gaps)
    mean = sum(gap for gap, _ in gaps) / len(gaps)
    of = "" if len(gaps) == len(run.done) else f" ({len(gaps)} of {len(run.done)} legs)"
    return (
        f"at most {mean:.1%} longer than the quickest possible in the mean{of}, the leg to "
        f"{waypoint_name(run, goal)} {worst:.1%}"
    )


def _uncertain(run: MissionRun, stops: Sequence[Stop]) -> str:
    """Return how well the position is known on the way, and the risk of contact; empty where exactly."""
    known = [stop for stop in stops if stop.position_std is not None]
    if not known or run.risk is None:
        return ""
    worst = max(known, key=lambda stop: stop.position_std or 0.0)
    risky = max(known, key=lambda stop: stop.risk or 0.0)
    fixes = sum(1 for stop in stops if stop.fix)
    times = ["", ", surfaces once for a fix"][fixes] if fixes < 2 else f", surfaces {fixes} times for a fix"
    return (
        f"known to {worst.position_std:.0f} m (1 sigma along each axis) at worst, on arrival at {worst.name}"
        f"{times}; touches coast or an obstacle in {share(run.risk)} at most"
        + (f", on the way to {risky.name} in {share(risky.risk or 0.0)}" if run.risk > _NO_RISK else "")
    )


def share(risk: float) -> str:
    """Return a chance in words, such as "0.3 %"; what is less than one in ten thousand as that."""
    return "< 0.01 %" if risk < _NO_RISK else f"{100.0 * risk:.2g} %"


def _stop(run: MissionRun, leg: LegRecord) -> Stop:
    """Return the end of a leg."""
    node, places, times = leg.goal, leg.positions, leg.times
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    gone = (np.diff(times) > 0.0) & ((steps > 0.0) | (not run.dives))
    speeds = steps[gone] / np.diff(times)[gone]
    place = None
    if run.site is not None:  # to a tenth of a metre
        longitude, latitude = run.site.to_geographic(*np.asarray(run.graph.positions[node], float)[:2])
        place = round(float(longitude), 6), round(float(latitude), 6)
    task, arrival = _task_name(run, leg.start, leg.goal) if leg.priority else "", float(times[-1])
    return Stop(
        waypoint_name(run, node),
        "out of its window" if leg.missed else task,
        float(leg.priority),
        arrival,
        None if run.site is None else run.site.utc(arrival),
        float(run.graph.positions[node][2]),
        float(leg.t_wait),
        float(leg.t_task),
        _windows(run, node, leg.start),
        float(steps.sum()),
        float(steps.sum() / max(times[-1] - times[0], 1e-9)),
        float(speeds.min()) if len(speeds) else 0.0,
        **Margins.of(run, leg).least(),
        place=place,
        otherwise=(),
        travel=float(times[-1] - times[0]),
        transit=leg_depths(times, places),
        speed=float(np.asarray(run.vehicle_on(leg).speed)) if run.speeds else None,
        position_std=leg.position_std,
        risk=leg.risk,
    )


def leg_depths(times: NDArray, places: NDArray) -> tuple[float, float, float]:
    """Return the least depth, the mean over time and the greatest on a leg, m, of [n] s and [n, 3] m."""
    down = np.asarray(places, float)[:, 2]
    mean = float(np.trapezoid(down, times) / max(times[-1] - times[0], 1e-9)) if len(down) > 1 else 0.0
    return float(down.min()), float(np.clip(mean, down.min(), down.max())), float(down.max())


def _transits(stops: Sequence[Stop]) -> list[str]:
    """Return the depths of the path to each stop with their mean; nothing where all are as deep as these."""

    def words(stop: Stop) -> str:
        least, mean, greatest = stop.transit or (0.0, 0.0, 0.0)
        if stop.transit is None:
            return ""
        return depth(mean) if greatest - least < 1.0 else f"{depth(least)}-{depth(greatest)} ({mean:.0f})"

    level = all(np.abs(np.subtract(stop.transit or stop.depth, stop.depth)).max() < 1.0 for stop in stops)
    return [""] * len(stops) if level else [words(stop) for stop in stops]


def _windows(run: MissionRun, node: int, start: int | None = None) -> str:
    """Return when the task at a waypoint may begin, or the one on the way from `start` be done, in words.

    Empty where it may at any time.
    """
    table, begin = run.graph.timetable, node - 1 if start is None else start  # to a waypoint: from any
    return "" if table is None else timeline.spans_in_words(run, timeline.windows_of(table, begin, node))


def _task_name(run: MissionRun, start: int, goal: int) -> str:
    """Return the job that a leg does, or a part of."""
    if run.jobs is None:
        return f"edge {start} to {goal}"
    for job in jobs_of(run.jobs):
        if goal in job.nodes and (len(job.nodes) == 1 or start in job.nodes):
            part = min(job.nodes.index(node) for node in (start, goal) if node in job.nodes) + 1
            return job.name if len(job.nodes) <= 2 else f"{job.name}, part {part}"
    return run.names[goal]


def _left_out(run: MissionRun) -> list[LeftOut]:
    """Jobs that are not done, with what stands against them."""
    if run.jobs is None:
        return []
    done = jobs_done(run.jobs, [(leg.start, leg.goal) for leg in run.earning])
    taken = {frozenset((leg.start, leg.goal)) for leg in run.earning}
    graph, found = run.graph, []
    off = kept_off(run.jobs, run.obstacles, run.safety.obstacles)
    for job in jobs_of(run.jobs):
        if job.name in done:
            continue
        if len(job.nodes) == 1:
            priority = float(np.asarray(graph.waypoint_priority)[job.nodes[0]])
        else:
            left = [edge for edge in pairwise(job.nodes) if frozenset(edge) not in taken]
            priority = float(sum(np.asarray(graph.priority)[edge] for edge in left))
        barred = next((off[node] for node in job.nodes if node in off), "")
        why = _why_dropped(run, job) or barred or _too_steep(run, job.nodes) or _why(run, job.nodes)
        found.append(LeftOut(job.name, priority, why))
    return sorted(found, key=lambda job: -job.priority)


def _too_steep(run: MissionRun, nodes: Sequence[int]) -> str:
    """Return which parts of a line are closed since they are too steep, and why the rest of it is left out.

    Empty where none is.
    """
    open_, steep = _open_edges(run), dict[int, str]()
    places = np.asarray(run.graph.positions, float)
    for number, (i, j) in enumerate(pairwise(nodes), 1):
        part = LinePart(tuple(places[i]), tuple(places[j]), 0.0)
        if not (open_[i, j] or open_[j, i]) and (why := part.too_steep(run.vehicle)):
            steep[number] = why
    if not steep:
        return ""
    first, *others = steep
    found = f"{f'its part {first}' if len(nodes) > 2 else 'it'} is too steep, {steep[first]}"
    found += f", and {counted(len(others), 'other part')} as well" if others else ""
    if len(nodes) > 2 and (run.scenario.get("mission") or {}).get("lines") == "whole":
        return f"{found}: mission.lines 'whole' leaves out all of it"
    taken = {frozenset((leg.start, leg.goal)) for leg in run.earning}
    kept = [
        number not in steep and frozenset(edge) not in taken for number, edge in enumerate(pairwise(nodes), 1)
    ]
    if not any(kept):
        return found
    begin = kept.index(True)
    end = next((k for k in range(begin, len(kept)) if not kept[k]), len(kept))
    return f"{found}; of its part {begin + 1}: {_why(run, nodes[begin : end + 1])}"


def _open_edges(run: MissionRun) -> NDArray[np.bool_]:
    """[N, N], the edges that were open to the first route at some time and speed; all without a route."""
    first = run.first_route
    if first is None:
        return np.ones(np.asarray(run.graph.adjacency).shape, bool)
    found = np.isfinite(np.asarray(first.edge_times, float))
    if first.timetable is not None:
        found = found | np.isfinite(np.asarray(first.timetable.travel_time)).any(axis=0)
    if first.speeds is not None:
        found = found | np.isfinite(np.asarray(first.speeds.times_of_edges)).any(axis=0)
    return found


def _why_dropped(run: MissionRun, job: NodesOfJob) -> str:
    """Return why a job that was on a route of a mission is not done; empty where it was on none."""
    if any(leg.missed for leg in run.done if leg.goal in job.nodes):
        return "the vehicle came too late for its window"

    def has(moment: float, ahead: Sequence[int]) -> bool:
        legs = [(leg.start, leg.goal) for leg in run.done if leg.ends <= moment + 1.0]
        return job.name in jobs_done(run.jobs, [*legs, *pairwise(ahead)])

    if (run.arrived and not run.simulated) or has(math.inf, ()):
        return ""
    having = [k for k, route in enumerate(run.routes) if has(route.made_at, route.nodes)]
    if not having:
        return ""
    if having[-1] == len(run.routes) - 1:
        return "" if run.arrived else f"the mission ended before it: {run.reason}"
    cause = _refused(run, job.nodes) or _CAUSES.get(run.routes[having[-1] + 1].cause, "")
    return f"it was on the route until that was planned again without it{': ' * bool(cause)}{cause}"


def _refused(run: MissionRun, nodes: Sequence[int]) -> str:
    """Return why the last leg to a job was refused; empty where none was."""
    refused = [leg for leg in run.legs if leg.refused and leg.goal in nodes]
    if not refused:
        return ""
    return f"the leg from {waypoint_name(run, refused[-1].start)} was refused, {refused[-1].refused}"


def _why(run: MissionRun, nodes: Sequence[int]) -> str:
    """Return why a job is left out: what the route comes to with it.

    Of a mission that did not reach its destination this is the first route, as planned.
    """
    if run.first_route is None:
        return "no route was found"
    first = run.first_route
    route, earned, of = run.route, run.total_priority, "the route"
    if not run.arrived:
        route, earned, of = np.asarray(first.nodes).tolist(), float(first.priority), "the first route"
    if all(node in route for node in nodes):
        return f"{of} passes its waypoints, not the line between them"
    with_it = _with_job(first, route, nodes)
    if with_it is None:
        return "no open path leads there: the current, the coast or the sea bed closes every leg"
    if not np.isfinite(with_it.ends[-1]):
        return _out_of_time(run, nodes, with_it, of)
    more = f"with it, the others in their order, {of} takes"
    if lacks := list(filter(None, (_short_of_time(run, with_it), _short_of_energy(run, with_it)))):
        taken, would_do = zip(*lacks, strict=True)
        return f"{more} {', and '.join(taken)}: {' and '.join(would_do)} would do"
    lost = earned - with_it.others
    if with_it.own - lost <= 1e-9:
        if lost > 1e-9:
            return f"with it, the others in their order, they begin later and lose {lost:g} of their priority"
        return f"{more} {hours(float(with_it.ends[-1]))}, which is in time, but it has no priority then"
    if len(set(with_it.nodes)) < len(with_it.nodes):
        return f"every way to it, the others in their order, leads {of} to a waypoint a second time"
    why = f"the search did not find that route, of {with_it.own - lost:g} more priority"
    if run.planning.objective != "priority":
        why = f"planning.objective {run.planning.objective} does not ask for most priority"
    why = _refused(run, nodes) or why
    return f"{more} {hours(float(with_it.ends[-1]))}, which is in time: {why}"


def _short_of_time(run: MissionRun, with_it: "_WithJob") -> tuple[str, str] | None:
    """Return how much more than the time a route takes, and what would do; None where it has enough."""
    first, end, available = run.first_route, float(with_it.ends[-1]), run.t_available
    if first is None or with_it.needs < first.time_available:
        return None
    # The time that a route is given is less than all of it by the reserve and an allowance.
    needed = available + (with_it.given - first.time_available) * available / first.time_available
    would_do = f"{math.ceil(needed)} s"
    if end >= available:
        return f"{hours(end)}, {hours(available)} are available", would_do
    kept = "too long for the reserve and the margin that are kept for the return"
    return f"{hours(end)} of {hours(available)}, {kept}", would_do


def _short_of_energy(run: MissionRun, with_it: "_WithJob") -> tuple[str, str] | None:
    """Return how much more than the battery has a route takes, and what would do; None where it has enough.

    A route that is not in time is given the time that would do.
    """
    first, power = run.first_route, run.vehicle.power
    if first is None or first.speeds is None or power is None or (battery := power.battery) is None:
        return None
    clock = None if first.timetable is None else first.clocked.timetable
    time_and_margin = max(first.time_available, with_it.given), first.return_margin
    found = first.speeds.least_energy(np.asarray(with_it.nodes), clock, *time_and_margin)
    spent, needs, given = (joules / WATT_HOUR for joules in (*found, float(first.speeds.available)))
    if needs <= given or not np.isfinite(needs):
        return None
    available = float((battery.charge - battery.reserve) * battery.usable_wh)  # type: ignore[operator]
    # As with time: the energy that a route is given is less than all of it by an allowance.
    least = "at least " if len(first.speeds.options.speeds) > 1 else ""
    needed = available + (_MORE_ENERGY * needs - given) * available / given
    would_do = f"{math.ceil(10.0 * needed) / 10.0:.1f} Wh"
    if spent >= available:
        return f"{least}{spent:.1f} Wh, {available:.1f} Wh are available", would_do
    return f"{least}{spent:.1f} of {available:.1f} Wh, too much for the margin that is kept", would_do


class _WithJob(NamedTuple):
    """The route with one more job in its best place, the others in their order.

    Attributes:
        nodes: [n + 1] its waypoints.
        done: its legs [n] by the clock.
        last: number of the leg that ends the job.
        needs: s, the time that it must be given, with the margin that its route was made with.
        others, own: priority that the other tasks are worth then, and the job.
    """

    nodes: list[int]
    done: Stages
    last: int
    needs: float
    others: float
    own: float

    @property
    def ends(self) -> NDArray:
        """[n] s, when each leg is done; infinite from the first on that cannot be done in time."""
        return self.done.ends

    @property
    def lack(self) -> tuple[float, bool, int, float]:
        """What is less in a better place: its end, s; without one, legs not done, and s until the first."""
        late, arrives = np.isinf(self.ends), self.done.arrives
        if late[self.last]:
            return np.inf, True, 0, float(arrives[self.last])
        return float(self.ends[-1]), False, int(late.sum()), float(arrives[late].min(initial=np.inf))

    @property
    def given(self) -> float:
        """S that a search has to be given to find it."""
        return _MORE * self.needs


def _with_job(first: MissionRoute, route: Sequence[int], nodes: Sequence[int]) -> _WithJob | None:
    """Put a job into a route where that ends soonest, by the clock; None where no open leg leads there.

    Where no place leaves all tasks in their windows, it is where the most of the route follows it in time.

    Args:
        first: the first route of the mission, by whose times of all edges that is.
        route: waypoints from the start to the destination.
        nodes: of the job.
    """
    times = np.asarray(first.edge_times, float)
    table, duration = first.timetable, first.duration
    if first.speeds is not None:  # at the fastest
        times = first.speeds.times_of_edges.min(axis=0)
        table = None if table is None else first.clocked.timetable
    if table is None or duration is None:
        table, duration = Timetable(np.zeros(1), times[None]), np.zeros_like(times)
    back = (1.0 + first.return_margin) * time_to_go(times, first.goal)
    found: _WithJob | None = None
    for k, job in product(range(1, len(route)), {tuple(nodes), tuple(nodes[::-1])}):
        legs = [shortest_path(times, i, j) for i, j in ((route[k - 1], job[0]), (job[-1], route[k]))]
        if not all(legs):
            continue
        onward = legs[1] if len(job) > 1 else legs[1][1:]
        whole = [*route[: k - 1], *legs[0], *job[1:-1], *onward, *route[k + 1 :]]
        done = stages(table, duration, whole)
        worth = {True: 0.0, False: 0.0}
        for leg, begins in zip(pairwise(whole), done.begins, strict=True):
            worth[leg[1] in job] += float(first.edge_priority[leg]) - table.lost(*leg, float(begins))
        needs = float(np.max(done.ends + back[whole[1:]]))
        if first.speeds is not None:  # which are chosen with the margin on the last leg
            last = float(done.ends[-1] - done.departs[-1])
            needs = max(needs, float(done.ends[-1]) + first.return_margin * last)
        ended = k + len(legs[0]) + len(job) - 4
        here = _WithJob(whole, done, ended, needs, worth[False], worth[True])
        if found is None or here.lack < found.lack:
            found = here
    return found


def _out_of_time(run: MissionRun, nodes: Sequence[int], with_it: _WithJob, of: str) -> str:
    """Return which window a route with one more job, the others in their order, misses first.

    Args:
        run: whose first route it is.
        nodes: of the job.
        with_it: the route with the job in its best place, where it is not in time.
        of: what the route is called.
    """
    leg = int(np.argmin(np.isfinite(with_it.ends)))
    i, j = with_it.nodes[leg : leg + 2]
    table, window, arrives = run.graph.timetable, _windows(run, j, i), float(with_it.done.arrives[leg])
    with_others = "with it, the others in their order,"
    if table is None or not window:
        closed = "is closed by then"
        if not _open_edges(run)[i, j]:
            closed = "is closed all the time, by the current or by an area that is"
        return f"{with_others} the way from {run.called(i)} to {run.called(j)} {closed}"
    own = j in nodes and (len(nodes) == 1 or i in nodes)
    if not np.isfinite(arrives):  # of a line, whose parts lie in a window whole
        if own:
            return f"its window is {window}: from no place of {of} on can all of it be done then"
        return f"{with_others} {_task_name(run, i, j)} cannot be done in its window, {window}"
    over = arrives - float(table.closes[i, j].max())
    late = f"{hours(over) if over >= 30.0 else f'{over:.0f} s'} too late"
    if own:
        there = f"the route could be there {timeline.time_in_words(run, arrives)} at the earliest"
        return f"its window is {window}: {there}{f', {late}' if over > 0.0 else ' and may not wait'}"
    comes = f"comes to {_task_name(run, i, j)}"
    misses = f"{late} for" if over > 0.0 else "and may not wait for"
    return f"{with_others} {of} {comes} {misses} its window, {window}"


def _warnings(run: MissionRun, stops: Sequence[Stop]) -> list[str]:
    """Return what to look at before the vehicle leaves."""
    warnings = []
    if run.simulated:
        warnings.append("this is one simulated mission, not a plan for a vehicle: `auvplan plan` makes that")
    if not run.success:
        warnings.append(f"the mission does not end as it should: {run.reason}")
    speed = float(np.asarray(run.vehicle.speed))
    for stop in stops[1:]:
        if stop.length > ONE_PLACE and stop.slowest < 0.3 * (stop.speed or speed):
            slowest = f"the speed over ground falls to {stop.slowest:.1f} m/s"
            warnings.append(f"on the way to {stop.name} {slowest}")
    return warnings


def write_html(sheet: MissionSheet, path: str | Path, picture: str | None = None) -> Path:
    """Write the sheet as a page that needs nothing else but, beside it, the picture.

    Raises:
        OutputError: the file cannot be written.
    """
    headings, rows = sheet.table()
    facts = "".join(
        f"<tr><th>{html.escape(n)}</th><td>{html.escape(v)}</td></tr>" for n, v in sheet.facts.items()
    )
    left = [[job.name, figure(job.priority), job.reason] for job in sheet.left_out]
    parts = [
        f"<h1>{html.escape(sheet.title)}</h1>",
        *(f'<p class="warning">{html.escape(line)}</p>' for line in (*sheet.warnings, *sheet.assumed)),
        f"<table>{facts}</table>",
        _html_table(headings, rows),
        "<p>Transit: least and greatest depth on the way and, in brackets, the mean. Speed over ground: the "
        "mean on the way and, in brackets, the least. Distances: the least.</p>",
        *([_POSITION] if "position, m" in headings else []),
    ]
    if left:
        parts += ["<h2>Left out</h2>", _html_table(["job", "priority", "why"], left)]
    if sheet.files:
        files = [[file.field, file.name, f"{file.size:,}", file.sha256[:16]] for file in sheet.files]
        parts += ["<h2>Planned on</h2>", _html_table(["field", "file", "bytes", "SHA-256 begins"], files)]
        for file in sheet.files:
            if file.fetched:
                request, digest = file.origin.get("request", "?"), file.origin.get("request_sha256", "?")[:16]
                line = f"{file.name}: {file.fetched}; request: {request} (SHA-256 {digest})"
                parts.append(f"<p>{html.escape(line)}</p>")
    if picture:
        parts.append(f'<img src="{html.escape(picture)}" alt="map of the mission">')
    page = _PAGE.format(title=html.escape(sheet.title), body="\n".join(parts))
    return write_atomically(path, lambda part: part.write_text(page, encoding="utf-8"))


def _html_table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    body = "".join(row(cells, "td") for cells in rows)
    return f"<table><thead>{row(headings, 'th')}</thead><tbody>{body}</tbody></table>"


_POSITION = (
    "<p>Position: its standard deviation along each horizontal axis on arrival. Risk: the chance of touching "
    "coast or an obstacle on the way, at most.</p>"
)

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>{title}</title>
<style>
body {{ font: 14px/1.4 system-ui, sans-serif; margin: 1.5rem auto; max-width: 80rem; padding: 0 1rem; }}
table {{ border-collapse: collapse; margin: 0 0 1.5rem; }}
th, td {{ border-bottom: 1px solid #ccc; padding: .25rem .4rem; text-align: left; vertical-align: top; }}
.warning {{ background: #fff3cd; border-left: 4px solid #d98c00; padding: .4rem .8rem; color: #222; }}
img {{ max-width: 100%; }}
@media print {{ body {{ font-size: 10pt; margin: 0; }} }}
</style></head><body>
{body}
</body></html>
"""
