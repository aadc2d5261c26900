"""Following a straight line, left and taken up again around what stands in it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.environment import Environment
from auvplan.path import habitats
from auvplan.path.config import PathConfig
from auvplan.path.cost import ALTITUDE_SCALE, CLEARANCE_SCALE, VIOLATIONS, WITHIN, followed_by
from auvplan.path.plan import PathPlan
from auvplan.path.problem import Problem
from auvplan.path.sensitivity import Conditions
from auvplan.path.straight import DISTANCES, Steps, Straights
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle

Array = NDArray[np.floating]

#: m, longest step at which it is asked whether the line is free.
_STEP = 5.0

#: m by which a detour begins and ends farther off what stands in the line than it must keep at least, and how
#: far along the line such a place is looked for; a metre of altitude counts for this many.
_SLACK, _SEARCHED, _ALTITUDE = 5.0, 100.0, 10.0

#: Segments that detours have at least, of twice the length that is blocked.
_SEGMENTS = 64

#: m, shortest stretch between two that are blocked for which the line is taken up again.
_SHORTEST = 50.0

#: m, within which a vehicle is on the line.
_ON_LINE = 1.0

#: rad, by which an arc turns at most from one of its samples to the next.
_TURN = 0.1

#: Turning radii of the line that each corner may cost before another way to leave it is tried.
_GIVEN_UP = 1.5

#: Share of the radius that the fastest turn at full turn rate has, that is wide enough.
_WIDE = 0.9

#: Plans a way [3] m to [3] m that departs at a time, s since the epoch.
Detour = Callable[[Array, Array, float], PathPlan]


def blocked_stretches(
    steps: Steps, marks: Array, env: Environment, config: PathConfig, lead: float = 0.0
) -> Array:
    """Stretches [K, 2] m of a straight line that are blocked: where it is left, and where taken up again.

    They reach to where a detour has some room to begin, and to the line's ends where these are near.

    Args:
        steps: N steps along the line.
        marks: [N + 1] m, distances along it of their ends.
        env: the world.
        config: margins.
        lead: m, by which stretches reach farther at both ends.
    """
    asked = [config.coast_margin, config.obstacle_margin, float(env.seabed.clearance) if env.seabed else 0.0]
    left = steps.room[:DISTANCES] - np.asarray(asked)[:, None]
    least = (left * np.array([1.0, 1.0, _ALTITUDE])[:, None]).min(axis=0)
    runs: list[list[float]] = []
    edges = np.flatnonzero(np.diff(np.concatenate([[False], least < 0.0, [False]]).astype(int)))
    for first, last in edges.reshape(-1, 2):
        low, high = float(marks[first]), float(marks[last])
        # Where a detour sets out along a coast, half a segment's length between its samples is not certain.
        half = (high - low) / _SEGMENTS
        slack = max(_SLACK, np.hypot(config.coast_margin, half) - config.coast_margin + 2.0)
        while first > 0 and least[first - 1] < slack and low - marks[first - 1] <= _SEARCHED:
            first -= 1
        while last < len(least) and least[last] < slack and marks[last + 1] - high <= _SEARCHED:
            last += 1
        low = float(marks[max(np.searchsorted(marks, marks[first] - lead, side="right") - 1, 0)])
        high = float(marks[min(np.searchsorted(marks, marks[last] + lead), len(marks) - 1)])
        if runs and low - runs[-1][1] < _SHORTEST:
            runs[-1][1] = high
        else:
            runs.append([low, high])
    for run in runs:
        run[0] = float(marks[0]) if run[0] - marks[0] < _SHORTEST else run[0]
        run[1] = float(marks[-1]) if marks[-1] - run[1] < _SHORTEST else run[1]
    return np.asarray(runs, float).reshape(-1, 2)


def blocked_on(start: Array, end: Array, env: Environment, vehicle: Vehicle, config: PathConfig) -> Array:
    """`blocked_stretches` [K, 2] m of the straight line from start to end, [3] m each, at the epoch."""
    steps, cut = Straights.through(env, vehicle).follow(np.stack([start, end]), 0.0, _STEP)
    marks = np.linspace(0.0, float(np.linalg.norm(end - start)), len(cut.line) + 1)
    return blocked_stretches(steps, marks, env, config)


def straight_plan(start: Array, goal: Array, depart: float, conditions: Conditions) -> PathPlan:
    """Return the straight line between two places as a path plan, kept limits or broken ones and all.

    Args:
        start, goal: [3] m.
        depart: s since the epoch.
        conditions: the world, without obstacles, the vehicle, and settings; their search is not run.
    """
    problem = Problem(start, goal, depart, conditions.env, conditions.vehicle)
    found = jax.device_get(_straight(problem, config=conditions.config))
    numbers = {name: float(found.pop(name)) for name in ("travel_time", "length", "clearance", "altitude")}
    ends = np.stack([start, goal])
    return PathPlan.unsearched(conditions, control_points=ends, cost=np.nan, **numbers, **found)


@partial(compiled, static_argnames=("config",))
def _straight(problem: Problem, config: PathConfig) -> dict[str, jax.Array]:
    """Fields of a plan of the straight line."""
    line = habitats.straight_line(*problem.ends, config)[None]
    return followed_by(line, problem, config)[1].fields()


def follow_line(
    place: Array,
    line: tuple[Array, Array],
    env: Environment,
    vehicle: Vehicle,
    config: PathConfig,
    depart: float,
    detour: Detour,
) -> PathPlan:
    """Follow a straight line to its end wherever it is free, with detours around what stands in it.

    Where the vehicle is off the line it joins it ahead. The current is met along the line as it is then; the
    vehicle holds its track (`PathConfig.speed_reading`).

    Args:
        place: [3] m, where the vehicle is.
        line: [3] m each, its ends in the direction of travel.
        env: the world, without a leading axis.
        vehicle: speed and limits.
        config: margins, and how many samples paths have.
        depart: s since the epoch.
        detour: plans the way around what is blocked.

    Returns:
        A plan from `place` to the end of the line. Corners between line and detour are arcs that the
        vehicle's turn rate allows, unless every such path breaks a limit. Samples are `config.samples`, and
        as many again for each detour. It has no population to re-plan from, and the history of the last
        detour.
    """
    sea = Straights.through(env, vehicle, config.speed_reading)
    turning = float(np.asarray(vehicle.speed)) / float(np.asarray(vehicle.turn_rate_max))
    tried, plans, kept = [], [], []
    # Where a detour sets out too sharply for the vehicle to turn, the line is left earlier.
    for lead in (0.0, turning):
        tried.append(_pieces(place, line, sea, config, depart, detour, lead, turning))
        rounded, smooth = _with_corners_rounded(tried[-1], vehicle)
        plans.append(_joined(rounded, sea, env, config, depart))
        kept.append(_on_line(rounded) if smooth and plans[-1].feasible else -np.inf)
        if kept[-1] >= _on_line(tried[-1]) - _GIVEN_UP * turning * (len(tried[-1]) - 1):
            break
    if np.isfinite(kept).any():
        return plans[int(np.argmax(kept))]
    plans.append(_joined(tried[0], sea, env, config, depart))
    return next((plan for plan in plans if plan.feasible), plans[-1])


def _on_line(pieces: list["_Piece"]) -> float:
    """Return the length of the line, m, in pieces of a path."""
    return sum(piece.length for piece in pieces if piece.is_line)


def _pieces(
    place: Array,
    line: tuple[Array, Array],
    sea: Straights,
    config: PathConfig,
    depart: float,
    detour: Detour,
    lead: float,
    turning: float,
) -> list["_Piece"]:
    """Return stretches of a line and detours that join.

    Arguments as for `follow_line` and `blocked_stretches`, and m, the radius of the vehicle's turns.
    """
    start, end = (np.asarray(point, float) for point in line)
    length = float(np.linalg.norm(end - start))
    unit = (end - start) / length
    at = float(np.clip((np.asarray(place, float) - start) @ unit, 0.0, length))
    off = float(np.linalg.norm(place - start - at * unit))
    here, now, joins = np.asarray(place, float), float(depart), at
    if off > _ON_LINE:
        # Far off at an angle of 45 degrees; nearby so that two turns lead there, one after the other.
        joins = min(at + max(off, 2.0 * np.sqrt(turning * off)), length)
    pieces: list[_Piece] = [_Piece.around(detour(here, end, now))] if at >= length else []
    while at < length:
        # From the line itself: where the vehicle is off it, all up to where it joins counts as blocked.
        begin = start + at * unit if joins > at else here
        steps, cut = sea.follow(np.stack([begin, end]), now, _STEP)
        marks = np.linspace(at, length, len(cut.line) + 1)
        runs = blocked_stretches(steps, marks, sea.env, config, lead)
        leaves, meets = next(iter(runs), (length, length))
        if joins > at:
            past = [run for run in runs if run[0] < joins + _SHORTEST and run[1] > joins]
            leaves, meets = at, past[0][1] if past else joins
        if leaves > at:
            count = int(np.searchsorted(marks, leaves - 1e-6))
            share = (marks[count] - at) / (length - at)
            pieces.append(_Piece(np.stack([begin, begin + share * (end - begin)])))
            here, now, at = pieces[-1].places[-1], float(steps.times[count]), leaves
        if meets > at:
            goal = end if meets >= length else start + meets * unit
            way = detour(here, goal, now)
            pieces.append(_Piece.around(way))
            here, now, at = pieces[-1].places[-1], float(way.times[-1]), meets
        joins = at
    return pieces


@dataclass(frozen=True)
class _Piece:
    """A piece of a path: a stretch of the line where there are two places, else a corner or a detour.

    Attributes:
        places: [n, 3] m.
        plan: of the detour that it is all or a part of.
        excess: [V, n - 1], by which the detour breaks each limit of `VIOLATIONS`.
    """

    places: Array
    plan: PathPlan | None = None
    excess: Array | None = None

    @classmethod
    def around(cls, plan: PathPlan) -> "_Piece":
        """Return a whole detour."""
        return cls(np.asarray(plan.positions, float), plan, np.asarray(plan.excess, float))

    @property
    def is_line(self) -> bool:
        """Whether it is a stretch of the line."""
        return len(self.places) == 2

    @property
    def length(self) -> float:
        """Length, m."""
        return float(np.linalg.norm(np.diff(self.places, axis=0), axis=1).sum())

    def reversed(self) -> "_Piece":
        """Return the piece from its last place to its first."""
        excess = None if self.excess is None else self.excess[:, ::-1]
        return replace(self, places=self.places[::-1], excess=excess)

    def since(self, sample: int) -> "_Piece":
        """Return what of a detour comes after a sample."""
        assert self.excess is not None
        return replace(self, places=self.places[sample:], excess=self.excess[:, sample:])


def _with_corners_rounded(pieces: list[_Piece], vehicle: Vehicle) -> tuple[list[_Piece], bool]:
    """Return pieces with arcs between line and detours, and whether the vehicle's turn rate allows all."""
    currents = [np.hypot(*piece.plan.water.T[:2]).max() for piece in pieces if piece.plan is not None]
    fastest = float(np.asarray(vehicle.speed)) + float(max(currents, default=0.0))
    radius = fastest / float(np.asarray(vehicle.turn_rate_max))
    found, smooth = pieces[:1], True
    for piece in pieces[1:]:
        before = found.pop()
        if before.is_line and not piece.is_line:
            parts, own = _rounded(before, piece, radius)
        elif piece.is_line and not before.is_line:
            parts, own = _rounded(piece.reversed(), before.reversed(), radius)
            parts = [part.reversed() for part in parts[::-1]]
        else:
            parts, own = [before, piece], radius
        found += parts
        smooth &= own >= _WIDE * radius
    return found, smooth


def _rounded(line: _Piece, way: _Piece, radius: float) -> tuple[list[_Piece], float]:
    """Return a stretch of the line, an arc and the rest of a detour that begins there; the arc's radius, m.

    The arc touches both. Of those that begin in the last half of the stretch and end at a sample of the first
    half of the detour it is the shortest of the radius, m, or the widest.
    """
    ahead = np.diff(line.places, axis=0)[0]
    level = float(np.hypot(*ahead[:2]))
    if level < _ON_LINE:  # straight down, where the hull may turn as it likes
        return [line, way], radius
    unit, corner = ahead / level, line.places[1]
    samples = way.places[1 : len(way.places) // 2 + 1]
    course = way.places[2 : len(samples) + 2] - way.places[: len(samples)]
    course = course[:, :2] / np.maximum(np.hypot(*course.T[:2]), 1e-9)[:, None]
    across = unit[0] * course[:, 1] - unit[1] * course[:, 0]
    turn = np.arctan2(across, course @ unit[:2])
    # Tangents to the detour meet the line so far beyond its end, and so far before the sample.
    offset = samples[:, :2] - corner[:2]
    across = np.where(np.abs(across) < 1e-9, np.nan, across)
    beyond = (offset[:, 0] * course[:, 1] - offset[:, 1] * course[:, 0]) / across
    before = (unit[0] * offset[:, 1] - unit[1] * offset[:, 0]) / across
    radii = before / np.tan(0.5 * np.abs(turn))
    begins = beyond - before
    possible = (before > 0.0) & (begins <= 0.0) & (begins >= -0.5 * level)
    if not possible.any():
        return [line, way], 0.0
    k = int(np.argmax(np.where(possible, np.minimum(radii, radius), -np.inf)))
    steps = int(np.ceil(np.abs(turn[k]) / _TURN)) + 1
    share = np.linspace(0.0, 1.0, steps + 1)
    angle = np.abs(turn[k]) * share
    side = np.sign(turn[k]) * np.array([-unit[1], unit[0]])
    arc = np.empty((steps + 1, 3))
    first = corner + begins[k] * unit
    aside = (1.0 - np.cos(angle))[:, None] * side
    arc[:, :2] = first[:2] + radii[k] * (np.sin(angle)[:, None] * unit[:2] + aside)
    arc[:, 2] = first[2] + share * (samples[k, 2] - first[2])
    arc[-1] = samples[k]
    parts = [_Piece(np.stack([line.places[0], first])), _Piece(arc), way.since(k + 1)]
    return parts, float(radii[k])


def excess_of(room: Array, env: Environment, vehicle: Vehicle, config: PathConfig) -> Array:
    """[V, N], how far `Steps.room` breaks each limit of `VIOLATIONS`; a straight line does not turn."""
    coast, obstacle, altitude, across, ground, made, *vertical = room
    sway, surge = (float(np.asarray(getattr(vehicle, f"{name}_max"))) for name in ("sway", "surge"))
    limits = vehicle.vertical_limits
    bed = 0.0 if env.seabed is None else float(env.seabed.clearance)
    found = {
        "surge": -ground / surge - 1e-6,
        "sway": -across / sway - 1e-6,
        "turn_rate": 0.0 * made,
        "coast": (config.coast_margin - coast) / CLEARANCE_SCALE,
        "obstacle": (config.obstacle_margin - obstacle) / CLEARANCE_SCALE,
        "current": -made,
        "seabed": (bed - altitude) / ALTITUDE_SCALE,
        **{
            name: -left / float(limits.get(name, 1.0)) - 1e-6
            for name, left in zip(VERTICAL_LIMITS, vertical, strict=True)
        },
    }
    return np.maximum(np.stack([found[name] for name in VIOLATIONS]), 0.0)


def met_along(water: Array, ground: Array, units: Array, vehicle: Vehicle, config: PathConfig) -> Array:
    """[N, 3] m/s, the current of segments along which the vehicle makes its mean speed over ground [N] m/s.

    Args:
        water: [N, 3] m/s, means of the current that is met.
        ground: [N] m/s.
        units: [N, 3], directions of the segments.
        vehicle: speed and limits.
        config: how its speed is read.
    """
    if config.speed_reading == "eq11":
        return water
    across = water - (water * units).sum(axis=1, keepdims=True) * units
    square = float(np.asarray(vehicle.speed)) ** 2 - np.where(
        config.speed_reading == "track", (across**2).sum(axis=1), 0.0
    )
    along = ground - np.sqrt(np.maximum(square, 0.0))
    return across + along[:, None] * units


def _joined(
    pieces: list[_Piece], sea: Straights, env: Environment, config: PathConfig, depart: float
) -> PathPlan:
    """Return one plan of pieces that join, timed along all of them."""
    vehicle = sea.vehicle
    detours = [piece.plan for piece in pieces if piece.plan is not None]
    lengths = np.array([piece.length if piece.is_line else 0.0 for piece in pieces])
    # As many samples as whole paths have together, so that few shapes are compiled.
    others = [len(piece.places) - 1 for piece in pieces if not piece.is_line]
    usual = config.samples + sum(len(plan.positions) for plan in detours)
    spare = max(usual - 1 - sum(others) - int((lengths > 0.0).sum()), 0)
    ends = np.rint(np.cumsum(lengths) / max(lengths.sum(), 1e-9) * spare).astype(int)
    parts = [
        np.linspace(piece.places[0], piece.places[1], count + 2) if piece.is_line else piece.places
        for piece, count in zip(pieces, np.diff(ends, prepend=0), strict=True)
    ]
    positions = np.concatenate([parts[0][:1], *(part[1:] for part in parts)])
    steps, cut = sea.follow(positions, depart, _STEP)
    times = steps.times[[*cut.offsets, len(cut.line)]]
    way = np.diff(positions, axis=0)
    gaps = np.linalg.norm(way, axis=1)
    water = np.add.reduceat(steps.water, cut.offsets) / np.bincount(cut.line)[:, None]
    excess = np.maximum.reduceat(excess_of(steps.room, env, vehicle, config), cut.offsets, axis=1)
    room = np.minimum.reduceat(steps.room[:DISTANCES], cut.offsets, axis=1)
    obstacle, first = VIOLATIONS.index("obstacle"), 0
    for piece, part in zip(pieces, parts, strict=True):
        own = slice(first, first + len(part) - 1)
        first = own.stop
        if piece.plan is not None:
            # The planner has judged detours. Where a corner is cut they are passed a little earlier.
            late = np.where(excess[obstacle, own] > WITHIN, excess[obstacle, own], 0.0)
            excess[:, own], room[:, own] = piece.excess, np.inf
            if len(part) < len(piece.plan.positions):
                excess[obstacle, own] = np.maximum(excess[obstacle, own], late)
    whole = [piece.plan.clearance for piece in pieces if piece.plan is not None]
    heights = [piece.plan.altitude for piece in pieces if piece.plan is not None]
    weights = np.array([getattr(config.penalties, name) for name in VIOLATIONS])
    took = float(times[-1] - times[0])
    corners = [piece.places[0] for piece in pieces] + [positions[-1]]
    history = {"history": detours[-1].history} if detours else {}
    return PathPlan.unsearched(
        Conditions(env, vehicle, config),
        excess,
        travel_time=took,
        length=float(gaps.sum()),
        positions=positions.astype(np.float32),
        times=times.astype(np.float32),
        control_points=np.asarray(corners, np.float32),
        clearance=float(min([room[:2].min(), *whole])),
        altitude=float(min([room[2].min(), *heights])),
        cost=took
        + float(weights @ excess.mean(axis=1)) * float(gaps.sum()) / float(np.asarray(vehicle.speed)),
        water=met_along(water, gaps / np.diff(times), way / gaps[:, None], vehicle, config),
        closed=max((plan.closed for plan in detours), default=0.0),
        **history,
    )
