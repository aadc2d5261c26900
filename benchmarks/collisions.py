"""Collisions of a simulated mission, and whether a manoeuvre could have avoided them once sensed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvplan.check.track import SampledTrack, events
from auvplan.ocean.obstacles import CONFIDENCE
from auvplan.records import LegRecord, MissionRun
from auvplan.scenario.settings import SensorSettings
from auvplan.simulation.faults import Fault, Faults, HeldUp, Obstacle, SensorOut
from auvplan.simulation.simulator import TIME_STEP
from auvplan.view.scene import track_at
from benchmarks.harness import Array

#: Headings among which a way out is looked for; keeping station is another.
_HEADINGS = 72
#: s after the collision for which a way out has to stay clear.
_AFTER = 60.0


@dataclass(frozen=True)
class Collision:
    """A stretch of a track inside something."""

    leg: int  # number of the leg, from 0
    what: str  # "land", "sea bed" or "obstacle"
    number: int  # of the obstacle on its leg; -1 of others
    time: float  # s since the epoch, when it began
    # s, the first look at it with nothing of the truth changing between then and the collision; NaN where
    # there was none
    sensed: float
    # whether a straight course at the speed of then, or keeping station, would have kept clear
    avoidable: bool

    def __str__(self) -> str:
        name = f"obstacle {self.number}" if self.what == "obstacle" else self.what
        kind = "avoidable" if self.avoidable else "unavoidable"
        seen = "not seen before" if np.isnan(self.sensed) else f"seen {self.time - self.sensed:.0f} s before"
        return f"leg {self.leg}: {kind} collision with {name} at {self.time:.0f} s, {seen}"


def collisions(run: MissionRun, faults: Sequence[Fault] = ()) -> list[Collision]:
    """Return all collisions of a mission; `faults` are those that were injected into it.

    Land and sea bed are known beforehand: going there is always avoidable. Of an obstacle a vehicle knows by
    its sensors, with the error that they have, and it cannot know what is about to change.
    """
    injected = Faults(faults)
    return [found for number, leg in enumerate(run.legs) for found in _of_leg(run, injected, number, leg)]


def _of_leg(run: MissionRun, faults: Faults, number: int, leg: LegRecord) -> Iterator[Collision]:
    if len(leg.times) < 2:
        return
    walk = SampledTrack.of(leg.times, leg.positions, leg.obstacle_positions)
    known: dict[str, NDArray[np.bool_]] = {}
    if run.chart is not None:
        known["land"] = ~np.asarray(run.chart.is_water(walk.positions[:, 0], walk.positions[:, 1]))
    if run.seabed is not None:
        known["sea bed"] = np.asarray(run.seabed.altitude(walk.positions)) < 0.0
    for what, inside in known.items():
        for first, _ in events(inside):
            yield Collision(number, what, -1, float(walk.times[first]), np.nan, True)
    distance = np.linalg.norm(walk.obstacles - walk.positions[:, None], axis=2) - leg.obstacle_radii
    for obstacle, inside in enumerate((distance < 0.0).T):
        for first, _ in events(inside):
            time = float(walk.times[first])
            sensed = _sensed(run, faults, leg, obstacle, time)
            avoidable = not np.isnan(sensed) and _way_out(run, faults, leg, sensed, time)
            yield Collision(number, "obstacle", obstacle, time, sensed, avoidable)


def _sensed(run: MissionRun, faults: Faults, leg: LegRecord, obstacle: int, time: float) -> float:
    """Return the first look at an obstacle, after the last change of the truth before a collision; or NaN."""
    sensors = _sensors(run)
    period = TIME_STEP * max(1, round(sensors.interval / TIME_STEP))
    changes = [leg.times[0]]
    for fault in faults.given:
        changes += [fault.at, fault.at + getattr(fault, "seconds", 0.0)]
        if isinstance(fault, Obstacle):  # seen at the look that it appears at, or at a later one
            near = leg.obstacle_positions[:, obstacle, 2] < 1e5
            changes.append(float(leg.times[near.argmax()]) if near.any() else np.inf)
    since = max(change for change in changes if change <= time)
    for look in np.arange(leg.times[0], time, period):
        apart = _traced(leg, obstacle, np.array([look]))[0] - track_at(leg, leg.positions, look)
        away = np.linalg.norm(apart) - leg.obstacle_radii[obstacle]
        idle = faults.left(SensorOut, look) > 0.0 or faults.left(HeldUp, look) > 0.0
        if look >= since and away <= sensors.range and not idle:
            return float(look)
    return np.nan


def _way_out(run: MissionRun, faults: Faults, leg: LegRecord, sensed: float, time: float) -> bool:
    """Return whether a course from where the vehicle was kept clear of everything."""
    times = np.arange(sensed, time + _AFTER, 1.0)
    start = track_at(leg, leg.positions, sensed)
    speed = float(run.vehicle.speed) * faults.speed(sensed)  # type: ignore[arg-type]
    water = _water(leg, sensed, speed)
    heading = 2.0 * np.pi * np.arange(_HEADINGS) / _HEADINGS
    courses = speed * np.stack([np.cos(heading), np.sin(heading), 0.0 * heading], axis=1) + water * (1, 1, 0)
    if np.linalg.norm(water) < speed:
        courses = np.concatenate([courses, np.zeros((1, 3))])
    tracks = start + (times - sensed)[:, None, None] * courses
    obstacles = np.stack([_traced(leg, row, times) for row in range(len(leg.obstacle_radii))], axis=1)
    margin = CONFIDENCE * np.sqrt(2.0) * _sensors(run).position_std
    clear = np.ones(len(courses), bool)
    for row, radius in enumerate(leg.obstacle_radii):
        distance = np.linalg.norm(tracks - obstacles[:, row, None], axis=2)
        # Where it begins within the margin, it is enough to come no nearer.
        gap = np.linalg.norm(start - obstacles[0, row]) - radius
        clear &= (distance >= radius + min(margin, gap)).all(axis=0) & (gap > 0.0)
    if run.chart is not None:
        clear &= run.chart.is_water(tracks[..., 0], tracks[..., 1]).all(axis=0)
    if run.seabed is not None:
        altitude = np.asarray(run.seabed.altitude(tracks.reshape(-1, 3))).reshape(tracks.shape[:2])
        clear &= (altitude > 0.0).all(axis=0)
    return bool(clear.any())


def _sensors(run: MissionRun) -> SensorSettings:
    return SensorSettings.model_validate(run.scenario.get("sensors", {}))


def _traced(leg: LegRecord, obstacle: int, times: Array) -> Array:
    """Return places [n, 3] m of an obstacle, which goes on as it did after the end of the leg."""
    trace = leg.obstacle_positions[:, obstacle]
    moves = (trace[-1] - trace[-2]) / (leg.times[-1] - leg.times[-2])
    return track_at(leg, trace, times) + np.maximum(times - leg.times[-1], 0.0)[:, None] * moves


def _water(leg: LegRecord, time: float, speed: float) -> Array:
    """Return the current [3] m/s at the vehicle: what it moved at over ground less through the water."""
    row = min(int(np.searchsorted(leg.times, time, side="right")) - 1, len(leg.times) - 1)
    yaw, pitch = leg.motion.yaw[row], leg.motion.pitch[row]
    hull = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)])
    ground = leg.motion.ground_velocity[row]
    if not np.linalg.norm(ground):  # keeping station, it heads into the current, which is no faster than it
        return np.zeros(3)
    return ground - speed * hull
