"""Whether a saved track, its velocities, its hull and the current agree with each other. Plain NumPy."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from auvplan.check.inputs import places_of
from auvplan.check.saved import TIME_TOLERANCE, Array, Saved

#: m by which a position may differ from where the stored velocity leads in one step, on a straight track.
POSITION_TOLERANCE = 0.3
#: Share of what the velocity changes by within a step that its mean may be off, on a curved one.
_CURVATURE = 0.25
#: Shares of what the current changes by that the mean velocity of a planned step may be off: where the path
#: keeps its limits, and where it does not, as the current may beat the vehicle on part of it.
_MEANS = 0.1, 0.5
#: Share of the turn at a corner by which a velocity there may lie off the middle of those beside it.
_CORNER = 0.6
#: m/s by which the speed through the water may differ from the vehicle's where the current is known, beyond
#: what two interpolations of a current differ by.
SPEED_TOLERANCE = 0.03
#: Degrees between the stored course and that of the stored velocity.
COURSE_TOLERANCE = 0.1
#: Degrees by which the pitch of a planned path may exceed the vehicle's limit, and the share of the speed
#: through the water by which its vertical speed may.
PITCH_TOLERANCE, RATE_TOLERANCE = 0.5, 0.01
#: Share of the speed through the water by which the vertical speed, through it and over ground, of a track
#: that was executed may exceed what the limits allow: the current was not quite the one planned in.
SURPRISE = 0.1
#: m between x, y and longitude, latitude.
PLACE_TOLERANCE = 0.1
#: Moments a leg at which the current is asked for.
_MOMENTS = 200


@dataclass(frozen=True)
class Velocities:
    """Velocities of n moments, or of n segments of each plan."""

    ground: Array  # [..., n, 3] m/s over ground north, east, down, from body velocities and attitude (Eq. 7)
    heading: Array  # [..., n, 3] unit vectors of the hull
    course: Array  # [..., n] degrees, as stored

    @classmethod
    def of(cls, run: Saved, prefix: str = "") -> "Velocities":
        """Return those of all observations of a saved run, or with the prefix "plan_" of all plans."""
        names = ("yaw", "pitch", "course", "surge", "sway", "heave")
        yaw, pitch, course, surge, sway, heave = (np.asarray(run[prefix + name], float) for name in names)
        cy, sy, cp, sp = (f(np.radians(angle)) for angle in (yaw, pitch) for f in (np.cos, np.sin))
        ahead = np.stack([cy * cp, sy * cp, -sp], axis=-1)
        aside = np.stack([-sy, cy, 0.0 * cy], axis=-1)
        under = np.stack([cy * sp, sy * sp, cp], axis=-1)
        parts = zip((surge, sway, heave), (ahead, aside, under), strict=True)
        return cls(sum(size[..., None] * axis for size, axis in parts), ahead, course)  # type: ignore[arg-type]

    def __getitem__(self, part: slice) -> "Velocities":
        return Velocities(self.ground[part], self.heading[part], self.course[part])


def motion_faults(run: Saved) -> Iterator[str]:
    """Yield where positions, times, velocities, attitude and the current of a track contradict each other."""
    velocities = Velocities.of(run)
    made_at = run.get("plan_made_at", ())
    for leg in run.legs:
        own = velocities[leg.rows]
        if len(leg.times) < 2:
            continue
        if not np.isfinite(own.ground).all():
            yield f"{leg}: a velocity is not a number"
            continue
        yield from _step_faults(str(leg), leg.times, leg.positions, own.ground, run.simulated, made_at)
        turned = np.degrees(np.arctan2(own.ground[:, 1], own.ground[:, 0])) - own.course
        turned = np.abs((turned + 180.0) % 360.0 - 180.0)
        level = np.hypot(own.ground[:, 0], own.ground[:, 1]) > 0.05
        for k in np.flatnonzero(level & ~(turned <= COURSE_TOLERANCE))[:1]:
            off = f"{turned[k]:.1f} deg off the velocity"
            yield f"{leg}: the course at {leg.times[k]:.2f} s is {own.course[k]:.1f} deg, {off}"
    yield from _plan_faults(run)
    yield from _vertical_faults(run)
    yield from _speed_faults(run, velocities)
    if "longitude" in run and "site_longitude" in run.data.attrs:
        longitude, latitude = places_of(run)(run["x"], run["y"])
        metres = 111_320.0 * np.cos(np.radians(latitude)), 110_574.0
        east = (run["longitude"] - longitude + 180.0) % 360.0 - 180.0
        apart = np.hypot(metres[0] * east, metres[1] * (run["latitude"] - latitude))
        for k in np.flatnonzero(~(apart <= PLACE_TOLERANCE))[:1]:
            yield f"longitude and latitude of observation {k} are {apart[k]:.1f} m from its north and east"


def _step_faults(
    name: str,
    times: Array,
    positions: Array,
    velocity: Array,
    simulated: bool = False,
    made_at: Array | tuple[()] = (),
    unsure: Array | float = 0.0,
) -> Iterator[str]:
    """Yield the first of n - 1 steps that its velocity does not lead along.

    Args:
        times: [n] s.
        positions: [n, 3] m.
        velocity: [n or n - 1, 3] m/s over ground, from each moment on.
        simulated: whether a velocity is that at the beginning of its step, and not the mean of it.
        made_at: s, when the paths were planned that were followed.
        unsure: [n - 1] m/s, by which the mean velocity of each step may be off.
    """
    elapsed = np.diff(times)[:, None]
    moved, begin = np.diff(positions, axis=0), velocity[: len(elapsed)] * elapsed
    apart = np.linalg.norm(moved - begin, axis=1)
    allowed = POSITION_TOLERANCE + unsure * elapsed[:, 0]
    if simulated:
        # On a curve half of the change to the next velocity leads there. At a corner, where a velocity lies
        # between those beside it, all of it may.
        change = np.diff(velocity, axis=0) * elapsed
        around = np.diff(velocity[[0, *range(len(elapsed))]], axis=0) * elapsed + change
        aside = np.linalg.norm(change - 0.5 * around, axis=1)
        aside = aside / np.maximum(np.linalg.norm(around, axis=1), 1e-9)
        turned = np.linalg.norm(change, axis=1)
        share = ((moved - begin) * change).sum(axis=1) / np.maximum(turned, 1e-9) ** 2
        share = np.clip(share, 0.0, np.where(aside < _CORNER, 1.0, 0.5))
        apart = np.linalg.norm(moved - begin - share[:, None] * change, axis=1)
        # After the last step there is no velocity, and that of a new path says nothing of the one before it:
        # half of what the track turned by on the step before may lead there. A track that turns one way and
        # then the other within a step turns as much as on the steps beside it.
        unseen = np.append(np.isin(times[1:-1], made_at), True)
        before = np.append(turned[:1], turned[:-1])
        beside = np.maximum(before, np.append(turned[1:], 0.0))
        turned = np.maximum(turned, np.where(unseen, before, beside))
        allowed += (_CURVATURE + 0.5 * unseen) * turned
    for k in np.flatnonzero(~(apart <= allowed))[:1]:
        yield (
            f"{name}: the velocity at {times[k]:.2f} s leads {apart[k]:.1f} m off the next position, "
            f"{elapsed[k, 0]:.2f} s later"
        )


def _plan_faults(run: Saved) -> Iterator[str]:
    """Yield path plans that begin at another time than they were made for, or contradict themselves."""
    if "plan_time" not in run or "plan_yaw" not in run:
        return
    times, positions = run["plan_time"], run["plan_position"].astype(float)
    velocities, made_at = Velocities.of(run, "plan_"), run["plan_made_at"]
    velocity, feasible = velocities.ground, run["plan_feasible"]
    for number, count in enumerate(np.isfinite(times).sum(axis=1)):
        own = times[number, :count]
        if count and not abs(own[0] - made_at[number]) <= TIME_TOLERANCE:
            yield f"plan {number}: made at {made_at[number]:.2f} s, it begins at {own[0]:.2f} s"
        if count > 1 and np.isfinite(velocity[number, : count - 1]).all():
            # A step takes the mean of the times by the current in several places, and has the velocity by its
            # mean: they differ as the current changes along it, as far as those beside it show.
            steps = np.s_[number, : count - 1]
            speed = run.legs[int(run["plan_leg"][number])].speed
            water = velocity[steps] - speed * velocities.heading[steps]
            changes = np.pad(np.linalg.norm(np.diff(water, axis=0), axis=1), 1)
            unsure = np.maximum(changes[:-1], changes[1:]) * _MEANS[not feasible[number]]
            places = positions[number, :count]
            yield from _step_faults(f"plan {number}", own, places, velocity[steps], unsure=unsure)


def _vertical_faults(run: Saved) -> Iterator[str]:
    """Yield plans, and legs as they were executed, that are steeper or faster in depth than the vehicle is.

    Plans that are stored as breaking a limit are left out, and limits that are not stored.
    """
    names = "pitch_max", "climb_rate_max", "dive_rate_max"
    limits = {name: run.number(f"vehicle_{name}") for name in names if f"vehicle_{name}" in run.data.attrs}
    if "plan_pitch" in run:
        times, depths = run["plan_time"], run["plan_position"][..., 2].astype(float)
        pitch, kept = np.radians(run["plan_pitch"].astype(float)), run["plan_feasible"]
        for number in np.flatnonzero(kept):
            count = int(np.isfinite(times[number]).sum())
            own = times[number, :count], depths[number, :count], pitch[number, : max(count - 1, 0)]
            speed = run.legs[int(run["plan_leg"][number])].speed
            yield from _steep(f"plan {number}", *own, speed, limits, False)
    pitch = np.radians(run["pitch"].astype(float))
    for leg in run.legs:
        own = leg.times, leg.positions[:, 2], pitch[leg.rows][:-1]
        yield from _steep(str(leg), *own, leg.speed, limits, run.simulated)


def _steep(
    name: str,
    times: Array,
    depths: Array,
    pitch: Array,
    speed: float,
    limits: dict[str, float],
    surprised: bool,
) -> Iterator[str]:
    """Yield the first of n - 1 steps of n moments that breaks each of the limits in the vertical.

    Args:
        times, depths: [n] s and m.
        pitch: [n - 1] rad, nose up.
        speed: through the water, m/s.
        limits: rad or m/s, of those there are.
        surprised: whether the current may have been another than was planned in.
    """
    if len(times) < 2:
        return
    down = np.diff(depths) / np.maximum(np.diff(times), 1e-9)
    if "pitch_max" in limits:
        most = limits["pitch_max"]
        allowed = most + np.radians(PITCH_TOLERANCE)
        if surprised:
            allowed = np.arcsin(min(np.sin(most) + SURPRISE, 1.0))
        for k in np.flatnonzero(np.abs(pitch) > allowed)[:1]:
            yield (
                f"{name}: the pitch at {times[k]:.2f} s is {np.degrees(pitch[k]):.1f} deg, the vehicle's "
                f"limit {np.degrees(most):.1f}"
            )
    more = speed * (SURPRISE if surprised else RATE_TOLERANCE)
    for kind, rate in (("climb", -down), ("dive", down)):
        most = limits.get(f"{kind}_rate_max", np.inf)
        for k in np.flatnonzero(rate > most + more)[:1]:
            yield f"{name}: {kind}s at {rate[k]:.2f} m/s at {times[k]:.2f} s, the vehicle's limit is {most:g}"


def _speed_faults(run: Saved, velocities: Velocities) -> Iterator[str]:
    """Yield legs on which the vehicle's speed through the known current is not that of the leg."""
    saved = None
    # A plan's velocity is that of its segment, in the current in the middle of it.
    half = 0.0 if run.simulated else 0.5
    if "current_north" in run:
        saved = np.stack([run[f"current_{name}"] for name in ("north", "east")], axis=1)
        if unknown := int((~np.isfinite(saved)).any(axis=1).sum()):
            run.notes.append(f"{unknown:,} observations have no current, which was not looked at there")
    elif run.section("current").get("source", "vortices") != "vortices":
        run.notes.append("the current along the track was not saved and not looked at")
        return
    elif "vortex_center" not in run:
        run.notes.append("the current was not looked at again: the run holds no vortices")
        return
    for leg in run.legs:
        own = velocities[leg.rows]
        moments = np.arange(max(len(leg.times) - 1, 0))
        moving = moments[np.linalg.norm(own.ground[:-1], axis=1) > 0.0] if len(moments) else moments
        chosen = moving[:: max(len(moving) // _MOMENTS, 1)]
        if not len(chosen) or not np.isfinite(leg.positions).all() or not np.isfinite(leg.times).all():
            continue  # what is not a number is a fault of its own
        if saved is not None:
            known = saved[leg.rows][chosen]
        else:
            places, times = (
                part[chosen] + half * (part[chosen + 1] - part[chosen]) for part in (leg.positions, leg.times)
            )
            known = _in_vortices(run, places, times)
        water = own.ground[chosen, :2] - leg.speed * own.heading[chosen, :2]
        apart = np.linalg.norm(water - known, axis=1)
        # Times are of single precision since the scenario's own departure.
        since = np.abs(leg.times[chosen] + float(run.data.attrs.get("departed", 0.0)))
        rounded = 2.0 * np.spacing(since.astype(np.float32)) / np.maximum(np.diff(leg.times)[chosen], 1e-9)
        allowed = SPEED_TOLERANCE + rounded * np.linalg.norm(own.ground[chosen, :2], axis=1)
        for k in np.flatnonzero(apart > allowed)[:1]:
            yield (
                f"{leg}: at {leg.times[chosen[k]]:.2f} s the vehicle makes its {leg.speed:g} m/s in a "
                f"current of {np.hypot(*water[k]):.2f} m/s, which is {np.hypot(*known[k]):.2f} m/s there"
            )


def _in_vortices(run: Saved, places: Array, moments: Array) -> Array:
    """Return the current [n, 2] m/s of the plans' Lamb vortices (Eqs 1-2), NaN where they had changed."""
    planning, current = run.section("planning"), run.section("current")
    by_window = planning.get("preset") == "paper" or planning.get("current_updates") == "window"
    made_at, interval = run["plan_made_at"], float(current.get("update_interval", np.inf))
    until = (np.floor(made_at / interval) + 1.0) * interval
    if not run.simulated:
        until = np.full(len(made_at), np.inf)
    elif by_window:
        until = made_at
    fields = [run[f"vortex_{name}"].astype(float) for name in ("center", "strength", "radius")]
    found = np.full((len(moments), 2), np.nan)
    for plan, (begin, end) in enumerate(zip(made_at, until, strict=True)):
        inside = (moments >= begin) & (moments < max(end, begin + 1e-3))
        if not inside.any():
            continue
        x, y, z = places[inside].T
        centre, strength, radius = (field[plan] for field in fields)
        offset = np.stack([x, y], axis=1)[:, None, None] - centre  # [n, layers, K, 2]
        square = np.maximum((offset**2).sum(axis=-1), 1e-12)
        factor = strength / (2.0 * np.pi * square) * -np.expm1(-square / radius**2)
        layers = np.stack([(-factor * offset[..., 1]).sum(axis=-1), (factor * offset[..., 0]).sum(axis=-1)])
        depths = run["vortex_depth"][plan].astype(float)
        level = np.interp(z, depths, np.arange(len(depths)))
        below = np.minimum(level.astype(int), max(len(depths) - 2, 0))
        above, share, row = np.minimum(below + 1, len(depths) - 1), level - below, np.arange(len(z))
        velocity = (1.0 - share) * layers[:, row, below] + share * layers[:, row, above]
        uniform = run["vortex_uniform"][plan][:2].astype(float)
        found[inside] = velocity.T + uniform
    return found
