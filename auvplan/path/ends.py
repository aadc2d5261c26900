"""Checks of what a path is asked for with: world, vehicle, end points and departure."""

import jax
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.environment import Environment
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.raster import is_traced
from auvplan.vehicle import Vehicle

#: m, by which an end may fall short of the sea bed's clearance: rounding in single precision.
_HAIR = 0.01
#: s, by which moments may be rounded.
_TICK = 1.0


def check_given(env: object, vehicle: object) -> None:
    """Refuse what is easily taken for an environment or a vehicle.

    Raises:
        TypeError: one line that says what is wanted.
    """
    if not isinstance(env, Environment):
        made = "ap.Environment(current)" if callable(env) or env is None else "ap.Environment(...)"
        raise TypeError(f"env must be an Environment, got {type(env).__name__}: give {made}")
    if vehicle is not None and not isinstance(vehicle, Vehicle):
        made = f"ap.Vehicle(speed={vehicle})" if isinstance(vehicle, int | float) else "ap.Vehicle(...)"
        raise TypeError(f"vehicle must be a Vehicle, got {type(vehicle).__name__}: give {made}")


def check_concrete(name: str, given: object) -> None:
    """Refuse what JAX traces: a planner calls many compiled programs, one after the other.

    Raises:
        TypeError: one line that says what to use.
    """
    if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(given)):
        raise TypeError(
            f"{name} cannot be traced here: give many legs to ap.plan_paths, trace ap.travel_time along a "
            "given path, or differentiate ap.plan_path once, outside of jax.jit and jax.vmap"
        )


def check_moment(name: str, given: ArrayLike) -> None:
    """Refuse moments, s, so far from zero that the precision in which JAX computes loses more than a second.

    Raises:
        ValueError: one line that says what to use.
    """
    if is_traced(given):
        return
    farthest = float(np.abs(np.asarray(given, float)).max(initial=0.0))
    lost = float(np.spacing(np.asarray(farthest, jax.dtypes.canonicalize_dtype(float))))
    if lost > _TICK:
        raise ValueError(
            f"{name} of {farthest:g} s is rounded to {lost:g} s in single precision: count times from an "
            "epoch nearby, such as the first departure"
        )


def as_point(name: str, given: ArrayLike) -> NDArray[np.floating]:
    """[3] m of a place.

    Raises:
        ValueError: it is none.
    """
    point = np.asarray(given, float)
    if point.shape != (3,):
        raise ValueError(f"{name} must be three numbers, north, east and depth in m, got shape {point.shape}")
    return point


def check_water(water: ArrayLike, positions: ArrayLike, times: ArrayLike) -> None:
    """Refuse a current that is not a number somewhere along the paths that were found in it.

    Args:
        water: [B, S - 1, 3] m/s, met in the middle of each segment.
        positions: [B, S, 3] m.
        times: [B, S] s.

    Raises:
        CurrentError: one line that names leg, place and time.
    """
    place, when = np.asarray(positions, float), np.asarray(times, float)
    moving = np.isfinite(place.reshape(len(place), -1)).min(axis=1)
    bad = ~np.isfinite(np.asarray(water, float)).min(axis=2) & moving[:, None]
    for b, k in np.argwhere(bad)[:1]:
        x, y, z = 0.5 * (place[b, k] + place[b, k + 1])
        at = f" at {when[b, k]:.0f} s" if np.isfinite(when[b, k]) else ""
        raise CurrentError(
            f"the current is not a number (NaN) at ({x:.0f}, {y:.0f}, {z:.0f}) m{at}, on the way of leg {b}: "
            "it has to have a value wherever the vehicle can be"
        )


def check_ends(starts: ArrayLike, goals: ArrayLike, env: Environment, vehicle: Vehicle) -> None:
    """Refuse legs that no path can join.

    A start is where the vehicle is, and be it nearer to the sea bed than it should: the path that climbs from
    there is reported infeasible. A goal is chosen.

    Args:
        starts, goals: [B, 3] m.
        env: the world.
        vehicle: that is to go.

    Raises:
        ValueError: the vehicle follows a sea bed that is not there; an end lies on land, below the sea bed,
            outside the chart or outside the box, a goal too near the sea bed, or both ends coincide; one line
            that names leg and place.
    """
    if vehicle.transit_altitude is not None and env.seabed is None:
        raise ValueError("vehicle transit_altitude needs a sea bed: give Environment(seabed=...)")
    start, goal = np.asarray(starts), np.asarray(goals)
    lower, upper = np.asarray(env.lower), np.asarray(env.upper)
    for name, points in (("start", start), ("goal", goal)):
        faults = {
            "is not finite": ~np.isfinite(points).all(axis=1),
            "lies outside the environment's bounds": ((points < lower - 1e-3) | (points > upper + 1e-3)).any(
                axis=1
            ),
        }
        if env.chart is not None:
            x, y = points[:, 0], points[:, 1]
            faults["lies outside the chart"] = ~np.asarray(env.chart.contains(x, y))
            faults["lies on land"] = ~np.asarray(env.chart.is_water(x, y))
        for fault, found in faults.items():
            for b in np.flatnonzero(found)[:1]:
                raise ValueError(f"{_end(name, b, points)} {fault}")
        if env.seabed is not None:
            _check_altitude(name, points, env)
    for b in np.flatnonzero(np.linalg.norm(goal - start, axis=1) < 1e-3)[:1]:
        raise ValueError(f"start and goal of leg {b} coincide")


def _check_altitude(name: str, points: NDArray[np.floating], env: Environment) -> None:
    """Refuse ends [B, 3] m below the sea bed, and goals that do not keep its clearance."""
    assert env.seabed is not None
    clearance = float(env.seabed.clearance)
    altitude = env.seabed.altitude(points)
    for b in np.flatnonzero(altitude < -_HAIR)[:1]:
        raise ValueError(f"{_end(name, b, points)} lies {-altitude[b]:.1f} m below the sea bed")
    if name == "goal":
        for b in np.flatnonzero(altitude < clearance - _HAIR)[:1]:
            short = f"{clearance - altitude[b]:.1f} m less than its clearance of {clearance:g} m"
            raise ValueError(f"{_end(name, b, points)} lies {altitude[b]:.1f} m above the sea bed, {short}")


def _end(name: str, leg: int, points: NDArray[np.floating]) -> str:
    return "{} of leg {} at ({:.0f}, {:.0f}, {:.0f}) m".format(name, leg, *points[leg])
