"""Constraint diagnostics: which limit a path breaks, by how much, where and when."""

from datetime import datetime
from enum import Enum
from typing import TYPE_CHECKING

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from auvplan.path.cost import ALTITUDE_SCALE, CLEARANCE_SCALE, JUDGED_AT, VIOLATIONS
from auvplan.runtime.formatting import apart
from auvplan.site import at_time
from auvplan.vehicle import SPEED_FLOOR, VERTICAL_LIMITS, Vehicle

if TYPE_CHECKING:
    from auvplan.path.plan import PathPlan


class PathStatus(Enum):
    """How a path search ended; the text says what to do."""

    OK = "feasible path found"
    SURGE = "ground speed exceeds the surge limit: raise vehicle.surge_max or slow down"
    SWAY = (
        "the current across the track exceeds the sway limit: raise vehicle.sway_max or wait for slack water"
    )
    TURN_RATE = "the path turns too sharply: raise vehicle.turn_rate_max or move the waypoints apart"
    COAST = "no way clear of the coast was found: widen the search (PathConfig.width) or move the waypoints"
    OBSTACLE = "no way clear of the obstacles was found: widen the search or raise iterations"
    CURRENT = "the current is too strong for the vehicle: wait for slack water or choose a faster vehicle"
    SEABED = "no way clear of the sea bed was found: raise the waypoints or ask for less clearance"
    PITCH = "the path is too steep: raise vehicle.pitch_max or change depth over a longer way"
    CLIMB = "the path climbs too fast: raise vehicle.climb_rate_max or change depth over a longer way"
    DIVE = "the path dives too fast: raise vehicle.dive_rate_max or change depth over a longer way"
    NO_WAY = (
        "no way from start to goal clear of coast and obstacles: move the waypoints or ask for less clearance"
    )


#: Places on the straight line at which areas are looked for.
_PLACES = 257

#: What the breaking of each limit is called.
STATUS: dict[str, PathStatus] = dict(zip(VIOLATIONS, list(PathStatus)[1:-1], strict=True))


def explanation(plan: "PathPlan", limit: str, epoch: datetime | None = None) -> str:
    """One line: a limit's value where it is broken most and what it should be, the place, the time, advice.

    Args:
        plan: the path.
        limit: of `VIOLATIONS`.
        epoch: that times count from; UTC where it has no time zone. None for times in seconds.

    Raises:
        ValueError: there is no such limit.
    """
    if limit not in VIOLATIONS:
        raise ValueError(f"limit must be one of {', '.join(VIOLATIONS)}, got {limit!r}")
    segment = int(np.argmax(plan.excess[VIOLATIONS.index(limit)]))
    gaps = np.linalg.norm(np.diff(plan.positions, axis=0), axis=1)
    place = float(gaps[:segment].sum() + 0.5 * gaps[segment]) / 1000.0
    when = at_time(0.5 * float(plan.times[segment] + plan.times[segment + 1]), epoch, float(plan.times[0]))
    where = f"km {place:.1f} of {plan.length / 1000.0:.1f}"
    moving = limit == "obstacle" and _some_move(plan)
    advice = f"{STATUS[limit].value}{', or wait' if moving else ''}"
    return f"{_fact(plan, limit, segment)} at {where}, {when}: {advice}{_shut(plan, epoch)}"


def _shut(plan: "PathPlan", epoch: datetime | None) -> str:
    """Which areas on the straight line are closed while a path is under way, and until when; or nothing.

    A path that has to let time pass until they open breaks other limits.
    """
    begins, ends = float(plan.times[0]), float(plan.times[-1])
    north, east, _ = np.linspace(plan.positions[0], plan.positions[-1], _PLACES).T
    found = []
    for closure in plan.conditions.env.closures:
        until = max((last for first, last in closure.spans if first < ends and last > begins), default=None)
        if until is not None and (np.asarray(closure.chart.distance(north, east)) <= 0.0).any():
            opens = (
                at_time(until, epoch, begins).removeprefix("at ") if np.isfinite(until) else "further notice"
            )
            found.append(f"{closure.name or 'an area'} is closed until {opens}")
    return f"; on the straight line {', '.join(found)}" if found else ""


def _some_move(plan: "PathPlan") -> bool:
    """Whether an obstacle goes by itself or drifts."""
    obstacles = plan.conditions.world().obstacles
    moves = np.any(np.asarray(obstacles.velocity) != 0.0, axis=-1) | (np.asarray(obstacles.drift) != 0.0)
    return bool((moves & np.asarray(obstacles.active)).any())


def _fact(plan: "PathPlan", limit: str, segment: int) -> str:
    """Return what a limit demands and what a segment has of it."""
    excess = float(plan.excess[VIOLATIONS.index(limit), segment])
    vehicle, config, bed = plan.conditions.vehicle, plan.conditions.config, plan.conditions.env.seabed
    if limit == "current":
        return _beaten(plan, segment)
    if limit in VERTICAL_LIMITS:
        return _steep(plan, limit, segment)
    if limit in ("surge", "sway", "turn_rate"):
        most = float(np.asarray(getattr(vehicle, f"{limit}_max")))
        if limit == "turn_rate":
            most = float(np.degrees(most))
        name, unit = _NAMES[limit]
        value, most = apart((1.0 + excess) * most, most)
        return f"{name} {value} {unit} over {most}"
    if limit == "seabed":
        least, scale = 0.0 if bed is None else float(bed.clearance), ALTITUDE_SCALE
    else:
        least, scale = getattr(config, f"{limit}_margin"), CLEARANCE_SCALE
    name, unit = _NAMES[limit]
    if limit == "coast" and plan.conditions.env.closures:
        name = "clearance of the coast or of a closed area"
    if limit != "seabed" and vehicle.navigation is not None:
        asked = f"{least:g} m and the vehicle's uncertain position ask for"
        return f"{name} {excess * scale:.1f} {unit} less than {asked}"
    value, least = apart(least - excess * scale, least)
    return f"{name} {value} {unit} under {least}"


def lengthening(positions: ArrayLike, travel_time: float, vehicle: Vehicle) -> str:
    """One line where a path is longer since the straight line is too steep for the vehicle; else empty.

    Args:
        positions: [S, 3] m, north, east, depth.
        travel_time: s along them.
        vehicle: speed and limits.

    Example:
        >>> import auvplan as ap
        >>> vehicle = ap.Vehicle(2.0, pitch_max=0.5236)
        >>> lengthening([(0, 0, 0), (300, 300, 100), (0, 300, 200)], 380.0, vehicle)
        'winds over 752 m instead of 361: a dive of 200 m takes 200 s at least, the straight line 182 s'
    """
    places = np.asarray(positions, float)
    length = float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
    straight = float(np.linalg.norm(places[-1] - places[0]))
    rise = float(places[-1, 2] - places[0, 2])
    speed = float(np.asarray(vehicle.speed))
    limit = vehicle.dive_rate_max if rise > 0.0 else vehicle.climb_rate_max
    rates = [] if limit is None else [float(np.asarray(limit))]
    if vehicle.pitch_max is not None:
        rates.append(speed * float(np.sin(np.asarray(vehicle.pitch_max))))
    if not rates or length <= 0.0:
        return ""
    least, directly = abs(rise) / min(rates), straight / length * travel_time
    if least <= directly or length < _LENGTHENED * straight:
        return ""
    return (
        f"winds over {length:,.0f} m instead of {straight:,.0f}: a {'dive' if rise > 0.0 else 'climb'} of "
        f"{abs(rise):,.0f} m takes {least:,.0f} s at least, the straight line {directly:,.0f} s"
    )


#: A path that is longer than the straight line by so much has been lengthened.
_LENGTHENED = 1.02

_NAMES = {
    "surge": ("ground speed", "m/s"),
    "sway": ("cross-current", "m/s"),
    "turn_rate": ("turn rate", "deg/s"),
    "coast": ("clearance of the coast", "m"),
    "obstacle": ("clearance of the obstacles' boundaries", "m"),
    "seabed": ("altitude above the sea bed", "m"),
}


def _steep(plan: "PathPlan", limit: str, segment: int) -> str:
    """Return how a segment climbs or dives, and the limit on it."""
    excess = float(plan.excess[VIOLATIONS.index(limit), segment])
    most = float(np.asarray(getattr(plan.conditions.vehicle, VERTICAL_LIMITS[limit])))
    if limit != "pitch":
        value, most = apart((1.0 + excess) * most, most)
        return f"{limit}s at {value} m/s, limit {most}"
    angle = np.degrees(np.arcsin(min((1.0 + excess) * np.sin(most), 1.0)))
    value, most = apart(float(angle), float(np.degrees(most)))
    return f"{'climbs' if plan.pitch[segment] > 0.0 else 'dives'} at {value} deg, limit {most}"


def _beaten(plan: "PathPlan", segment: int) -> str:
    """Return the current on a segment where it leaves the vehicle the least way, and how much.

    Where it holds the vehicle at its depth, it is that.
    """
    way = plan.positions[segment + 1] - plan.positions[segment]
    share = np.asarray(JUDGED_AT)
    places = plan.positions[segment] + share[:, None] * way
    times = plan.times[segment] + share * (plan.times[segment + 1] - plan.times[segment])
    found = plan.conditions.world().current(*(jnp.asarray(v, float) for v in (*places.T, times)))
    water = np.stack([np.broadcast_to(np.asarray(axis, float), share.shape) for axis in found], axis=1)
    speed, steepest = float(np.asarray(plan.conditions.vehicle.speed)), plan.conditions.vehicle.pitch_max
    if steepest is not None and way[2] != 0.0:
        against, rate = -float((water[:, 2] * np.sign(way[2])).min()), speed * float(np.sin(steepest))
        if against > (1.0 - SPEED_FLOOR) * rate:
            sense, moves = ("upwards", "sinks") if way[2] > 0.0 else ("downwards", "rises")
            return f"current {against:.2f} m/s {sense} beats the {rate:.2f} m/s at which the vehicle {moves}"
    all_along = water @ way / np.linalg.norm(way)
    all_across = np.sqrt(np.maximum((water**2).sum(axis=1) - all_along**2, 0.0))
    progress = all_along + np.sqrt(np.maximum(speed**2 - all_across**2, 0.0))
    if plan.conditions.config.speed_reading == "eq8":
        progress = all_along + speed
    worst = int(np.argmin(progress))
    along, across, left = float(all_along[worst]), float(all_across[worst]), float(progress[worst])
    least = SPEED_FLOOR * speed
    digits = next((n for n in (1, 2) if round(left, n) not in (0.0, round(least, n))), 3)
    parts = [
        f"{part:.{digits}f} m/s {sense}"
        for part, sense in ((abs(along), "against" if along < 0.0 else "along"), (across, "across"))
        if part >= 0.05
    ]
    found, of = f"current {' and '.join(parts)} the track", f"the vehicle's {speed:.{digits}f} m/s"
    if left < 0.0 or across > speed:
        return f"{found} beats {of}"
    short = f", less than {least:.{digits}f}" if left < least else ""
    return f"{found} leaves {left:.{digits}f} m/s of {of}{short}"
