"""Saw-tooth paths of gliders and profilers: dives one after the other along a planned track."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from auvplan.ocean.currents import evaluated
from auvplan.ocean.environment import Environment
from auvplan.ocean.seabed import Seabed
from auvplan.path.cost import ALTITUDE_SCALE, VIOLATIONS, WITHIN
from auvplan.path.follow import excess_of, met_along
from auvplan.path.plan import PathPlan
from auvplan.path.sensitivity import Conditions
from auvplan.path.straight import Straights
from auvplan.vehicle import SPEED_FLOOR, Vehicle, along_track

Array = NDArray[np.floating]

#: m of depth between two samples of a glide at most, and that a dive has at least.
STEP, LEAST_DIVE = 10.0, 5.0

#: rad, least turn of a track that is a corner.
_CORNER = 0.02

#: m, below which no difference counts; m of depth between a corner and other samples; most passes of a glide.
_LEAST, _NEAR, _PASSES = 1e-3, 0.25, 12


@dataclass(frozen=True)
class SawTooth:
    """Dives one after the other, down and up at one angle to the water.

    Attributes:
        glide_angle: rad, of the way through the water below and above the horizontal.
        shallow, deep: m, depths of the turns.
        above_bed: m above the sea bed at which a descent ends at the latest.
        dives: between two surfacings; 0 for none.
        surface_time: s that each surfacing takes.

    Raises:
        ValueError: the angle is not between 0 and a right angle, or a dive has less than `LEAST_DIVE`.
    """

    glide_angle: float
    shallow: float
    deep: float
    above_bed: float = 10.0
    dives: int = 0
    surface_time: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.glide_angle < 0.5 * math.pi:
            raise ValueError(f"glide_angle must be between 0 and a right angle, got {self.glide_angle:g} rad")
        if not 0.0 <= self.shallow <= self.deep - LEAST_DIVE:
            raise ValueError(f"deep must be at least {LEAST_DIVE:g} m below shallow, got {self.deep:g} m")

    def way_speed(self, speed: float) -> float:
        """Return the horizontal speed that a speed through the water comes to, surfacings included, m/s."""
        down = 2.0 * (self.dives * (self.deep - self.shallow) + self.shallow)
        gliding = down / (speed * math.sin(self.glide_angle)) if self.dives else math.inf
        return speed * math.cos(self.glide_angle) / (1.0 + self.surface_time / gliding)

    def for_planning(self, vehicle: Vehicle) -> Vehicle:
        """Return the vehicle that tracks are planned for: as fast, in the current half-way down."""
        speed = self.way_speed(float(np.asarray(vehicle.speed)))
        return replace(vehicle, speed=speed, transit_depth=0.5 * (self.shallow + self.deep))

    def with_room(self, seabed: Seabed | None) -> Seabed | None:
        """Return the sea bed that tracks are planned above, which have room for a dive everywhere."""
        room = self.shallow + LEAST_DIVE + self.above_bed
        return seabed and replace(seabed, clearance=np.float32(max(room, float(seabed.clearance))))


def turns(positions: ArrayLike) -> NDArray[np.intp]:
    """Return the samples of a path [S, 3] m that are its ends, or at which it turns in depth or rests."""
    steps = np.diff(np.asarray(positions, float), axis=0)
    sense = np.where(steps.any(axis=1), np.sign(steps[:, 2]), 2.0)
    return np.concatenate([[0], np.flatnonzero(np.diff(sense)) + 1, [len(steps)]])


def saw_tooth_plan(plan: PathPlan, saw: SawTooth, vehicle: Vehicle, seabed: Seabed | None = None) -> PathPlan:
    """Return the saw-tooth along the track of a plan, from its departure on.

    Through the water the vehicle descends and climbs at its speed along the glide angle. Horizontally it
    holds the track as in the reading "track", by the current at its depth then; the current's vertical part
    carries it up or down. Descents end at the deep turns or above the sea bed; while it surfaces it keeps its
    place. The last dives are as deep as brings it to the goal's depth at the goal.

    Args:
        plan: of the track; of its depths, those of the ends count.
        saw: the shape.
        vehicle: whose speed is that along the glide slope.
        seabed: with the clearance that counts; that of the plan if absent.

    Returns:
        A plan whose limits are judged again. Where the goal is too far down for the angle, limit "pitch" is
        broken, and "seabed" where the water has no room for a dive.
    """
    env, config, places = plan.conditions.world(), plan.conditions.config, np.asarray(plan.positions, float)
    env = env if seabed is None else replace(env, seabed=seabed)
    vehicle, speed = (
        replace(vehicle.without_power(), pitch_max=saw.glide_angle),
        float(np.asarray(vehicle.speed)),
    )
    sea = _Sea(env, saw, places[:, :2], speed)
    parts, broken = sea.dive((0.0, places[0, 2], float(plan.times[0]), 0.0), places[-1, 2])
    marks, depths, times, beaten = np.concatenate([parts[0][:, :1], *(part[:, 1:] for part in parts)], axis=1)
    positions = np.column_stack([sea.at(marks), depths])
    positions[[0, -1]] = places[[0, -1]]
    steps, lasts, begin = np.diff(positions, axis=0), np.diff(times), times[:-1]
    gaps, middle = np.linalg.norm(steps, axis=1), 0.5 * (positions[1:] + positions[:-1])
    moving = gaps > 0.0
    lines = positions[:-1][moving], positions[1:][moving], begin[moving], lasts[moving]
    _, room = Straights.through(env, vehicle).pass_lines(*lines)
    # Angle and progress are those that the steps were made with; turns are the track's.
    found = dict(zip(VIOLATIONS, np.zeros((len(VIOLATIONS), len(lasts))), strict=True))
    for name, beyond in zip(VIOLATIONS, excess_of(room, env, vehicle, config), strict=True):
        least = 0.0 if name in ("coast", "obstacle", "seabed") else WITHIN
        found[name][moving] = np.where(beyond > least, beyond, 0.0)
    turned = plan.excess[VIOLATIONS.index("turn_rate")].max()
    found |= {"current": beaten[1:], "pitch": np.zeros(len(lasts)), "turn_rate": np.full(len(lasts), turned)}
    for name, far in broken.items():
        found[name][-1] = far
    excess = np.stack([found[name] for name in VIOLATIONS])
    water = np.stack(evaluated(env.current, *middle.T, t=begin + 0.5 * lasts), axis=1)
    units = steps[moving] / gaps[moving, None]
    water[moving] = met_along(water[moving], gaps[moving] / lasts[moving], units, vehicle, config)
    if "seabed" in broken and env.seabed is not None:  # which states what the dive lacks
        env = replace(env, seabed=replace(env.seabed, clearance=np.float32(saw.above_bed)))
    weights = np.array([getattr(config.penalties, name) for name in VIOLATIONS])
    took, penalty = float(times[-1] - times[0]), float(weights @ excess.mean(axis=1))
    return PathPlan.unsearched(
        Conditions(env, vehicle, config), excess, water=water, times=times, travel_time=took,
        positions=positions.astype(np.float32), control_points=positions[turns(positions)].astype(np.float32),
        length=float(gaps.sum()), clearance=float(room[:2].min()), altitude=float(room[2].min()),
        cost=took + penalty * float(gaps.sum()) / speed, closed=plan.closed, history=plan.history,
    )  # fmt: skip


#: Where a glide begins or ends: m along the track, m of depth, s since the epoch, and the share of its
#: horizontal or vertical speed by which the current beats the vehicle on the way. Glides and rests are
#: [4, n], by sample.
_State = tuple[float, ...] | Array


class _Sea:
    """What a saw-tooth leads through."""

    def __init__(self, env: Environment, saw: SawTooth, track: Array, speed: float) -> None:
        """Dive along a track [n, 2] m at a speed through the water, m/s."""
        self.env, self.saw, self.track = env, saw, track
        self.level, self.fall = speed * math.cos(saw.glide_angle), speed * math.sin(saw.glide_angle)
        self.marks = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(track, axis=0), axis=1))])
        self.length, course = float(self.marks[-1]), np.unwrap(np.arctan2(*np.diff(track, axis=0).T[::-1]))
        self.corners = self.marks[1:-1][np.abs(np.diff(course)) > _CORNER]

    def at(self, marks: Array) -> Array:
        """Return the places [n, 2] m at distances along the track; beyond its end it goes on straight."""
        beyond = np.maximum(marks - self.length, 0.0)[:, None] / max(self.length, _LEAST)
        places = np.stack([np.interp(marks, self.marks, axis) for axis in self.track.T], axis=1)
        return places + beyond * (self.track[-1] - self.track[0])

    def glide(self, begin: _State, to: float, bedded: bool = False) -> Array:
        """Glide to a depth, or where it is `bedded` as far as the bed lets.

        Steps end at corners of the track too, and have the current of their middle: passes settle both.
        """
        along, depth, time, _ = begin
        if (drop := abs(to - depth)) < _LEAST:
            return np.reshape(begin, (4, 1))
        grid, sense = np.linspace(0.0, drop, math.ceil(drop / STEP) + 1), math.copysign(1.0, to - depth)
        fallen, marks, times = grid, along + self.level / self.fall * grid, time + grid / self.fall
        for _ in range(_PASSES):
            corners = self.corners[(self.corners > along) & (self.corners < marks[-1])]
            finer = np.sort(np.concatenate([grid, np.interp(corners, marks, fallen)]))
            apart = np.minimum(finer[1:-1] - finer[:-2], drop - finer[1:-1])
            finer = np.concatenate([[0.0], finer[1:-1][apart >= _NEAR], [drop]])
            before, when, fallen = np.interp(finer, fallen, marks), np.interp(finer, fallen, times), finer
            way, where = np.diff(self.at(before), axis=0), self.at(0.5 * (before[:-1] + before[1:]))
            unit = way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
            middle = depth + sense * 0.5 * (fallen[:-1] + fallen[1:])
            moments = 0.5 * (when[:-1] + when[1:])
            water = np.stack(evaluated(self.env.current, *where.T, z=middle, t=moments), axis=1)
            forward = (water[:, :2] * unit).sum(axis=1)
            across = np.linalg.norm(water[:, :2] - forward[:, None] * unit, axis=1)
            ground, beaten = along_track("track", self.level, forward, across)
            sinking = (self.fall + sense * water[:, 2]) / self.fall
            beaten = np.maximum(beaten, SPEED_FLOOR - sinking)
            lasts = np.diff(fallen) / (self.fall * np.maximum(sinking, SPEED_FLOOR))
            marks = along + np.concatenate([[0.0], np.cumsum(ground * lasts)])
            times = time + np.concatenate([[0.0], np.cumsum(lasts)])
            if np.abs(marks - before).max() < _LEAST:
                break
        depths = depth + sense * fallen
        if bedded and self.env.seabed is not None:
            places = np.column_stack([self.at(marks), depths])
            room = self.env.seabed.altitude(places) - self.saw.above_bed
            if (room < 0.0).any():
                k = max(int(np.argmax(room < 0.0)), 1)
                above = max(float(room[k - 1]), 0.0)
                share = min(above / max(above - float(room[k]), 1e-9), 1.0)
                return self.glide(begin, depths[k - 1] + share * (depths[k] - depths[k - 1]))
        return np.stack([marks, depths, times, np.concatenate([[0.0], beaten])])

    def through(self, begin: _State, *depths: float) -> list[Array]:
        """Glide to one depth after the other."""
        glides = [np.reshape(begin, (4, 1))]
        for depth in depths:
            glides.append(self.glide(glides[-1][:, -1], depth))
        return glides[1:]

    def over(self, begin: _State, *depths: float) -> float:
        """Return by how many m glides to one depth after the other end beyond the track."""
        return float(self.through(begin, *depths)[-1][0, -1]) - self.length

    def straight(self, begin: _State, goal: float) -> Array:
        """Go straight to the end of the track, which no glide does."""
        lasts = max((self.length - begin[0]) / self.level, abs(goal - begin[1]) / self.fall)
        return np.stack([begin, (self.length, goal, begin[2] + lasts, 0.0)], axis=1)

    def dive(self, now: _State, goal: float) -> tuple[list[Array], dict[str, float]]:
        """Return glides and rests one after the other to a depth, and by how much the last breaks a limit."""
        saw, done, dives = self.saw, list[Array](), 0
        if self.over(now, goal) > 0.0:
            slope = math.atan2(abs(goal - now[1]), self.length)
            return [self.straight(now, goal)], {"pitch": math.sin(slope) / math.sin(saw.glide_angle) - 1.0}
        while True:
            surfaces = saw.dives > 0 and (dives + 1) % saw.dives == 0
            top = 0.0 if surfaces else saw.shallow
            down = self.glide(now, max(saw.deep, now[1]), bedded=True)
            end, bottom, up = down[:, -1], down[1, -1], self.glide(down[:, -1], top)
            if self.over(up[:, -1], goal) > 0.0:
                break
            if up[3].any() or down[3].any():  # beaten by the current, it would not get there for long
                return [*done, down, up, self.straight(up[:, -1], goal)], {}
            if (lack := top + LEAST_DIVE - bottom) > 0.0:
                return [*done, self.straight(now, goal)], {"seabed": lack / ALTITUDE_SCALE}
            done, dives, now = [*done, down, up], dives + 1, up[:, -1]
            if surfaces:
                now = now + np.array([0.0, 0.0, saw.surface_time, 0.0])
                done.append(np.stack([up[:, -1], now], axis=1))
        if goal <= bottom and self.over(now, bottom, goal) >= 0.0:  # a shallower dive ends there
            depth = _root(lambda depth: self.over(now, depth, goal), max(now[1], goal), bottom)
            return [*done, *self.through(now, depth, goal)], {}
        # So does a descent from where the climb is broken off.
        depth = _root(lambda depth: self.over(end, depth, goal), top, min(goal, bottom))
        return [*done, down, *self.through(end, depth, goal)], {}


def _root(over: Callable[[float], float], low: float, high: float) -> float:
    """Return the depth between two at which glides end at the end of the track."""
    ends = over(low), over(high)
    if ends[0] * ends[1] > 0.0:  # a rest before it has changed the current a little
        return low if abs(ends[0]) < abs(ends[1]) else high
    return float(scipy.optimize.brentq(over, low, high, xtol=_LEAST))
