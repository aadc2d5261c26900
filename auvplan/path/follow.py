"""Following a straight line, left and taken up again around what stands in it."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.bbo import History
from auvplan.ocean.environment import Environment
from auvplan.path.config import PathConfig
from auvplan.path.cost import ALTITUDE_SCALE, CLEARANCE_SCALE, VIOLATIONS
from auvplan.path.plan import PathPlan
from auvplan.path.sensitivity import Conditions
from auvplan.path.straight import DISTANCES, Steps, Straights
from auvplan.vehicle import VERTICAL_LIMITS, Vehicle

Array = NDArray[np.floating]

#: m, longest step at which it is asked whether the line is free.
_STEP = 5.0

#: m by which a detour begins and ends farther off what stands in the line than it must keep at least, and how
#: far along the line such a place is looked for; a metre of altitude counts for so many.
_SLACK, _SEARCHED, _ALTITUDE = 5.0, 100.0, 10.0

#: Segments that detours have at least, of twice the length that is blocked.
_SEGMENTS = 64

#: m, shortest stretch between two that are blocked for which the line is taken up again.
_SHORTEST = 50.0

#: m, within which a vehicle is on the line.
_ON_LINE = 1.0

#: Plans a way [3] m to [3] m that departs at a time, s since the epoch.
Detour = Callable[[Array, Array, float], PathPlan]


def blocked_stretches(steps: Steps, marks: Array, env: Environment, config: PathConfig) -> Array:
    """Stretches [K, 2] m of a straight line that are blocked: where it is left, and where taken up again.

    They reach to where a detour has some room to begin, and to the line's ends where these are near.

    Args:
        steps: N steps along the line.
        marks: [N + 1] m, distances along it of their ends.
        env: the world.
        config: margins.
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
        low, high = float(marks[first]), float(marks[last])
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
        A plan from `place` to the end of the line. Its samples are `config.samples`, and so many more for
        each detour; corners between line and detour are among them. It has no population to re-plan from, and
        the history of the last detour.
    """
    sea = Straights.through(env, vehicle, config.speed_reading)
    start, end = (np.asarray(point, float) for point in line)
    length = float(np.linalg.norm(end - start))
    unit = (end - start) / length
    at = float(np.clip((np.asarray(place, float) - start) @ unit, 0.0, length))
    off = float(np.linalg.norm(place - start - at * unit))
    here, now, joins = np.asarray(place, float), float(depart), at
    if off > _ON_LINE:
        joins = min(at + off, length)
    pieces: list[PathPlan | _Straight] = [detour(here, end, now)] if at >= length else []
    while at < length:
        # From the line itself: where the vehicle is off it, all up to where it joins counts as blocked.
        begin = start + at * unit if joins > at else here
        steps, cut = sea.follow(np.stack([begin, end]), now, _STEP)
        marks = np.linspace(at, length, len(cut.line) + 1)
        runs = blocked_stretches(steps, marks, env, config)
        leaves, meets = next(iter(runs), (length, length))
        if joins > at:
            past = [run for run in runs if run[0] < joins + _SHORTEST and run[1] > joins]
            leaves, meets = at, past[0][1] if past else joins
        if leaves > at:
            piece = _Straight(begin, end, steps, marks).until(leaves)
            pieces.append(piece)
            here, now, at = piece.positions[-1], float(piece.steps.times[-1]), leaves
        if meets > at:
            goal = end if meets >= length else start + meets * unit
            way = detour(here, goal, now)
            pieces.append(way)
            here, now, at = np.asarray(way.positions[-1], float), float(way.times[-1]), meets
        joins = at
    return _joined(pieces, env, vehicle, config)


@dataclass(frozen=True)
class _Straight:
    """A free stretch of a line: its ends [3] m, its N steps, and their marks [N + 1] m along the line."""

    start: Array
    end: Array
    steps: Steps
    marks: Array

    @property
    def positions(self) -> Array:
        return np.stack([self.start, self.end])

    @property
    def length(self) -> float:
        return float(np.linalg.norm(self.end - self.start))

    def until(self, mark: float) -> "_Straight":
        """Return the part up to the end of a step."""
        count = int(np.searchsorted(self.marks, mark - 1e-6))
        share = (self.marks[count] - self.marks[0]) / (self.marks[-1] - self.marks[0])
        steps = Steps(self.steps.times[: count + 1], self.steps.room[:, :count], self.steps.water[:count])
        return _Straight(
            self.start, self.start + share * (self.end - self.start), steps, self.marks[: count + 1]
        )

    def sampled(
        self, segments: int, env: Environment, vehicle: Vehicle, config: PathConfig
    ) -> dict[str, Array]:
        """Return positions, times, excess and current of a plan of so many segments."""
        share = np.linspace(0.0, 1.0, segments + 1)
        step = np.linspace(0.0, 1.0, len(self.marks))
        excess, steps = _excess(self.steps, env, vehicle, config), len(self.marks) - 1
        bounds = share * steps
        over = [slice(int(low + 1e-9), int(np.ceil(high - 1e-9))) for low, high in pairwise(bounds)]
        times = np.interp(share, step, self.steps.times)
        ground = self.length / segments / np.diff(times)
        met = np.stack([self.steps.water[part].mean(axis=0) for part in over])
        return {
            "positions": self.start + share[:, None] * (self.end - self.start),
            "times": times,
            "excess": np.stack([excess[:, part].max(axis=1) for part in over], axis=1),
            "water": _met(met, ground, (self.end - self.start) / self.length, vehicle, config),
        }


def _met(water: Array, ground: Array, unit: Array, vehicle: Vehicle, config: PathConfig) -> Array:
    """[N, 3] m/s, the current of segments along which the vehicle makes its mean speed over ground [N] m/s.

    Args:
        water: [N, 3] m/s, means of the current that is met.
        ground: [N] m/s.
        unit: [3], the direction of the line.
        vehicle: speed and limits.
        config: how its speed is read.
    """
    if config.speed_reading == "eq11":
        return water
    across = water - (water @ unit)[:, None] * unit
    square = float(np.asarray(vehicle.speed)) ** 2 - np.where(
        config.speed_reading == "track", (across**2).sum(axis=1), 0.0
    )
    along = ground - np.sqrt(np.maximum(square, 0.0))
    return across + along[:, None] * unit


def _excess(steps: Steps, env: Environment, vehicle: Vehicle, config: PathConfig) -> Array:
    """[V, N], how far steps break each limit of `VIOLATIONS`; a straight line does not turn."""
    coast, obstacle, altitude, across, ground, made, *vertical = steps.room
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


def _joined(
    pieces: list[PathPlan | _Straight], env: Environment, vehicle: Vehicle, config: PathConfig
) -> PathPlan:
    """Return one plan of pieces that join."""
    detours = [piece for piece in pieces if isinstance(piece, PathPlan)]
    lengths = np.array([0.0 if isinstance(piece, PathPlan) else piece.length for piece in pieces])
    # As many samples as whole paths have together, so that few shapes are compiled.
    spare = config.samples - 1 + len(detours) - int((lengths > 0.0).sum())
    ends = np.rint(np.cumsum(lengths) / max(lengths.sum(), 1e-9) * spare).astype(int)
    counts = np.diff(ends, prepend=0) + 1
    parts = [
        {name: np.asarray(getattr(piece, name), float) for name in ("positions", "times", "excess", "water")}
        if isinstance(piece, PathPlan)
        else piece.sampled(int(count), env, vehicle, config)
        for piece, count in zip(pieces, counts, strict=True)
    ]
    positions, times = (
        np.concatenate([parts[0][name][:1], *(part[name][1:] for part in parts)])
        for name in ("positions", "times")
    )
    excess = np.concatenate([part["excess"] for part in parts], axis=1)
    water = np.concatenate([part["water"] for part in parts])
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    straights = [piece for piece in pieces if isinstance(piece, _Straight)]
    clearance = [piece.steps.room[:2].min() for piece in straights] + [plan.clearance for plan in detours]
    altitude = [piece.steps.room[2].min() for piece in straights] + [plan.altitude for plan in detours]
    weights = np.array([getattr(config.penalties, name) for name in VIOLATIONS])
    took = float(times[-1] - times[0])
    corners = [piece.positions[0] for piece in pieces] + [positions[-1]]
    none = jnp.zeros(0)
    return PathPlan(
        travel_time=took,
        length=float(gaps.sum()),
        positions=positions.astype(np.float32),
        times=times.astype(np.float32),
        control_points=np.asarray(corners, np.float32),
        violations=excess.mean(axis=1),
        clearance=float(min(clearance)),
        altitude=float(min(altitude)),
        cost=took
        + float(weights @ excess.mean(axis=1)) * float(gaps.sum()) / float(np.asarray(vehicle.speed)),
        population=jnp.zeros((0, 3 * config.control_points)),
        history=detours[-1].history if detours else History(*[none] * len(History.__dataclass_fields__)),
        excess=excess,
        water=water,
        conditions=Conditions(env, vehicle, config),
        closed=max((plan.closed for plan in detours), default=0.0),
    )
