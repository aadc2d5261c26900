"""Checks of what a path is asked for with: world, vehicle, end points and departure."""

from collections.abc import Iterable
from typing import Any

import jax
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.currents import evaluated
from auvplan.ocean.environment import Environment
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.raster import is_traced
from auvplan.path.config import PathConfig
from auvplan.runtime.arguments import instance, numbers
from auvplan.vehicle import Vehicle

#: m, by which an end may fall short of the sea bed's clearance: rounding in single precision.
_HAIR = 0.01
#: s, by which moments may be rounded.
_TICK = 1.0
#: m, by which places may be rounded; whatever the leg, as it grows shorter under way.
_GRAIN = 0.2
#: Places along each axis at which a current is looked at where no path could be followed.
_LATTICE = 25


def check_given(env: object, vehicle: object, config: object = None) -> None:
    """Refuse what is easily taken for an environment, a vehicle or settings of paths.

    Raises:
        TypeError: one line that says what is wanted.
    """
    if not isinstance(env, Environment):
        made = "ap.Environment(current)" if callable(env) or env is None else "ap.Environment(...)"
        raise TypeError(f"env must be an Environment, got {type(env).__name__}: give {made}")
    if vehicle is not None and not isinstance(vehicle, Vehicle):
        made = f"ap.Vehicle(speed={vehicle})" if isinstance(vehicle, int | float) else "ap.Vehicle(...)"
        raise TypeError(f"vehicle must be a Vehicle, got {type(vehicle).__name__}: give {made}")
    if config is not None:
        instance("config", config, PathConfig)


def check_worlds(count: int, row: str, **parts: Any) -> None:
    """Refuse parts of worlds that differ by row, such as a "leg", and are not as many as there are rows.

    Raises:
        ValueError: one line that names the part and both numbers.
    """
    for name, part in parts.items():
        for shape in map(np.shape, jax.tree.leaves(part)):
            if shape[:1] != (count,) or (isinstance(part, Obstacles) and len(shape) < 2):
                wanted = f"stacked along a leading axis [{count}], one for each {row}"
                raise ValueError(f"{name} must be {wanted}, got an array of shape {shape}")


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
    """Refuse moments, s, that are not finite, or so far from zero that single precision loses over a second.

    Raises:
        TypeError: they are no numbers, as dates and `timedelta` are not.
        ValueError: one line that says what to use.
    """
    if is_traced(given):
        return
    moments = numbers(name, given)
    if not np.isfinite(moments).all():
        raise ValueError(f"{name} must be finite, s since the epoch, got {moments[~np.isfinite(moments)][0]}")
    farthest = float(np.abs(moments).max(initial=0.0))
    lost = float(_rounding(farthest))
    if lost > _TICK:
        raise ValueError(
            f"{name} of {farthest:g} s is rounded to {lost:g} s in single precision: count times from an "
            "epoch nearby, such as the first departure"
        )


def _rounding(given: ArrayLike) -> NDArray[np.floating]:
    """Return by how much numbers are rounded in the precision in which JAX computes."""
    return np.spacing(np.abs(np.asarray(given, jax.dtypes.canonicalize_dtype(float))))


def as_point(name: str, given: ArrayLike) -> NDArray[np.floating]:
    """[3] m of a place.

    Raises:
        ValueError: it is none.
        TypeError: it is not given by numbers.
    """
    point = numbers(name, given)
    if point.shape != (3,):
        raise ValueError(f"{name} must be three numbers, north, east and depth in m, got shape {point.shape}")
    return point


def check_water(
    water: ArrayLike,
    positions: ArrayLike,
    times: ArrayLike,
    ends: tuple[NDArray[np.floating], NDArray[np.floating]],
    env: Environment,
) -> None:
    """Refuse a current that is not finite somewhere along the paths that were found in it.

    Where none could be followed at all, it is looked at all over the box.

    Args:
        water: [B, S - 1, 3] m/s, met in the middle of each segment.
        positions: [B, S, 3] m.
        times: [B, S] s.
        ends: starts and goals, [B, 3] m.
        env: the world.

    Raises:
        CurrentError: one line that names leg, place and time.
    """
    met: Any = np.asarray(water, float)
    place: Any = np.asarray(positions, float)
    when: Any = np.asarray(times, float)
    moving = np.isfinite(place).all(axis=(1, 2))
    for b in map(int, np.flatnonzero(~moving)):  # slopes in a current without end leave no path
        corners = np.sort(np.stack([end[b] for end in ends]), axis=0)
        bounds = np.stack([env.lower, env.upper])
        low, high = np.where(np.isfinite(bounds), bounds, corners)
        axes = np.linspace(low, high, _LATTICE).T
        x, y, z = (axis.ravel() for axis in np.meshgrid(*axes))
        found = np.stack(evaluated(env.current, x, y, z, np.full(len(x), when[b, 0])), axis=1)
        for k in map(int, np.flatnonzero(~np.isfinite(found).all(axis=1))[:1]):
            raise _not_finite(found[k], (x[k], y[k], z[k]), when[b, 0], f"and leg {b} finds no path")
    for b, k in np.argwhere(~np.isfinite(met).all(axis=2) & moving[:, None])[:1].tolist():
        middle = 0.5 * (place[b, k] + place[b, k + 1])
        raise _not_finite(met[b, k], middle, when[b, k], f"on the way of leg {b}")


def _not_finite(
    water: NDArray[np.floating], place: Iterable[float], when: float, consequence: str
) -> CurrentError:
    what = "not a number (NaN)" if np.isnan(water).any() else "infinite"
    at = "({:.0f}, {:.0f}, {:.0f}) m".format(*place) + (f" at {when:.0f} s" if np.isfinite(when) else "")
    wanted = "it has to have a finite value wherever the vehicle can be"
    return CurrentError(f"the current is {what} at {at}, {consequence}: {wanted}")


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
    lost = np.maximum(_rounding(start), _rounding(goal)).max(axis=1)
    for b in np.flatnonzero(lost > _GRAIN)[:1]:
        raise ValueError(
            f"{_end('goal', b, goal)} is rounded to {lost[b]:g} m in single precision: count places from an "
            "origin nearby, such as the first start"
        )


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
