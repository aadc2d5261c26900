"""How well a vehicle knew where it was, worked out again from the track and its navigation. Plain NumPy.

Along each horizontal axis the standard deviation is that of the fix, of a share of the way through the water
since then, and of a velocity out of bottom lock, as biases: the root of the sum of their squares.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from auvplan.check.inputs import read_jobs
from auvplan.check.saved import Array, Leg, Saved, near
from auvplan.check.track import Bed

#: m, depth at which there are fixes without surfacing.
_AT_SURFACE = 0.5

#: m, and share of it, by which a standard deviation may differ from what is worked out here.
_STD_TOLERANCE = 0.05, 2e-3

#: m of altitude within which there may be bottom lock or none.
_LOCK_TOLERANCE = 0.5

#: s at the surface that a fix takes, where a scenario does not say, and by which one may be off.
_FIX_TIME = 60.0
_FIX_TOLERANCE = 0.05

#: Least and greatest share of its speed that a vehicle may have been planned with under way, and the share of
#: a leg's time by which what it spent in bottom lock may be off there: paths are judged by fewer samples.
_PACE, _UNSURE = (0.5, 1.1), 0.1


@dataclass(frozen=True)
class _Known:
    """Least and most of what the error grows with since the last fix."""

    way: Array = field(default_factory=lambda: np.zeros(2))  # [2] m through the water
    unlocked: Array = field(default_factory=lambda: np.zeros(2))  # [2] s out of bottom lock

    def after(self, way: Any, unlocked: Any) -> "_Known":
        """Return what they are after as much more, [2] each."""
        return _Known(self.way + way, self.unlocked + unlocked)


@dataclass(frozen=True)
class _Reckoning:
    """The navigation of a run's vehicle, and where and how fast it goes."""

    run: Saved
    bed: Bed | None
    drift: float
    current_error: float
    fix: float
    bottom_lock: float | None

    @property
    def pace(self) -> Array:
        """[2] least and greatest share of its speed that it makes."""
        return np.asarray(_PACE if self.run.simulated else (1.0, 1.0))

    def std(self, known: _Known) -> Array:
        """Return the least and the greatest standard deviation, [2] m."""
        return np.sqrt(
            self.fix**2 + (self.drift * known.way) ** 2 + (self.current_error * known.unlocked) ** 2
        )

    def out_of_lock(self, altitude: Array) -> np.ndarray:
        """Return whether there surely, and perhaps, is no bottom lock at altitudes [n] m, [2, n]."""
        room = np.asarray([_LOCK_TOLERANCE, -_LOCK_TOLERANCE])[:, None]
        return altitude > (-np.inf if self.bottom_lock is None else self.bottom_lock) + room

    def altitude(self, places: Array) -> Array:
        """Return the altitude of places [n, 3] m above the bed, [n] m; infinite where none is known."""
        return np.full(len(places), np.inf) if self.bed is None else self.bed.altitude(places)

    def staying(self, known: _Known, node: int, seconds: Any, speed: Any) -> _Known:
        """Return what is known after a time at a waypoint, s, that counts as a way at a speed, m/s."""
        away = self.out_of_lock(self.altitude(self.run.places[[node]]))[:, 0]
        return known.after(self.pace * speed * seconds, away * seconds)

    def along(self, known: _Known, leg: Leg) -> _Known:
        """Return what is known at the end of a leg."""
        lasts, altitude = np.full(2, leg.t_path), self.altitude(leg.positions)
        away = self.out_of_lock(np.maximum(altitude[1:], altitude[:-1])) * np.diff(leg.times)
        unlocked = away.sum(axis=1)
        if self.run.simulated:  # it is that of the path that was followed last, from the leg's beginning on
            times = self.run["plan_time"][self.run["plan_leg"] == leg.number]
            planned = [leg.t_path, *(np.nanmax(times, axis=1) - leg.begins)]
            lasts = np.asarray([min(planned), max(planned)])
            unlocked = np.clip(unlocked + lasts - leg.t_path + [-_UNSURE, _UNSURE] * lasts, 0.0, lasts)
        return known.after(self.pace * leg.speed * lasts, unlocked)

    def vertical(self, leg: Leg) -> tuple[float, float]:
        """Return s from a leg's first waypoint up to the surface and back down, as steeply as may be."""
        stated, depth = self.run.data.attrs, float(self.run.places[leg.start, 2])
        steepest = self.run.number("vehicle_speed") * np.sin(
            float(stated.get("vehicle_pitch_max", 0.5 * np.pi))
        )
        up, down = (
            depth / min(steepest, float(stated.get(f"vehicle_{name}_rate_max", np.inf)))
            for name in ("climb", "dive")
        )
        return up, down


def position_faults(run: Saved, bed: Bed | None) -> Iterator[str]:
    """Yield legs whose end is known better or worse than is said, or worse than was asked for, and fixes.

    Args:
        run: a saved run; a note says where its navigation is not known.
        bed: the sea bed, above which there may be bottom lock.
    """
    settings = run.section("vehicle").get("navigation")
    if settings is None:
        return
    made = {
        name: value for name, value in (run.stated("navigation") or settings).items() if value is not None
    }
    if "vehicle" in made:
        run.notes.append(f"the navigation of {made['vehicle']} was not saved and not looked at")
        return
    for name, value in made.items():
        if settings.get(name, value) not in (value, None):
            yield f"vehicle.navigation.{name} is {value:g}, the scenario says {settings[name]:g}"
    drift, current_error, fix = (float(made.get(name, 0.0)) for name in ("drift", "current_error", "fix"))
    reckoning = _Reckoning(run, bed, drift, current_error, fix, made.get("bottom_lock"))
    stated, limits = run.get("leg_position_std", np.full(len(run.legs), np.nan)), _limits(run, settings)
    known, now, own = _Known(), 0.0, run.number("vehicle_speed")
    for leg in (leg for leg in run.legs if leg.executed):
        if leg.t_fix > 0.0:
            yield from _fix_faults(reckoning, leg)
            # It surfaces before it waits for its way to open, or after.
            known = reckoning.staying(_Known(), leg.start, np.asarray([0.0, leg.t_hold - leg.t_fix]), own)
            known = reckoning.staying(known, leg.start, reckoning.vertical(leg)[1], own)
        elif run.places[leg.start, 2] <= _AT_SURFACE:
            known = _Known()
        else:
            known = reckoning.staying(known, leg.start, leg.begins - now, own)
        known, now = reckoning.along(known, leg), float(leg.times[-1])
        if not leg.arrived:
            return
        least, most = reckoning.std(known)
        found, (metres, share) = float(stated[leg.number]), _STD_TOLERANCE
        if not least * (1.0 - share) - metres <= found <= most * (1.0 + share) + metres:
            by = f"{least:.1f}" if most - least < 0.1 else f"{least:.1f} to {most:.1f}"
            yield f"{leg}: its end is known to {found:.1f} m, by the track and vehicle.navigation to {by} m"
        stays = near(run.places[leg.start], run.places[leg.goal])
        if not run.simulated and not stays and found > limits[leg.goal] + metres:
            yield f"{leg}: its end is known to {found:.1f} m, {limits[leg.goal]:g} m are asked for"


def _limits(run: Saved, settings: dict[str, Any]) -> Array:
    """Return the standard deviation that is asked for at most at each waypoint, [N] m."""
    limits = np.full(len(run.places), settings.get("most") or np.inf)
    for job in read_jobs(run) or ():
        if job.max_error is not None and job.nodes[-1] < len(limits):
            limits[job.nodes] = np.minimum(limits[job.nodes], job.max_error)
    return limits


def fix_time(run: Saved) -> float | None:
    """Return s at the surface that a fix takes; None where a shipped vehicle's navigation has it."""
    settings = run.section("vehicle").get("navigation") or {}
    stated = settings.get("fix_time")
    return _FIX_TIME if stated is None and settings.get("vehicle") is None else stated


def _fix_faults(reckoning: _Reckoning, leg: Leg) -> Iterator[str]:
    """Yield that surfacing took another time than up, for a fix, and down again, or longer than the wait."""
    least = sum(reckoning.vertical(leg))
    most, at_surface = least / reckoning.pace[0], fix_time(reckoning.run)
    least, most = (least, np.inf) if at_surface is None else (least + at_surface, most + at_surface)
    if not least - _FIX_TOLERANCE <= leg.t_fix <= min(most, leg.t_hold) + _FIX_TOLERANCE:
        yield f"{leg}: surfaces for {leg.t_fix:.1f} s, a fix takes {least:.1f} s there"
