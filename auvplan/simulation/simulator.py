"""The truth: obstacles move, and vehicles follow their tracks through a true current.

All B missions advance together; arrays carry a leading axis B, and a mission that has ended stands still.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from numpy.typing import NDArray

from auvplan.ocean.currents import Current, combine, partition
from auvplan.ocean.vortices import rounded_up
from auvplan.runtime.arrays import Array
from auvplan.runtime.compiled import compiled
from auvplan.runtime.rows import padded_batches
from auvplan.simulation.sea import stacked
from auvplan.vehicle import Vehicle, along_track

#: Seconds between two recorded positions.
TIME_STEP = 3.0

#: Missions that are simulated in one call. Fewer are padded to it: a mission's result then comes from the
#: same program whatever runs beside it, to the last bit.
WIDTH = 32


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Transit:
    """A stretch of simulation, n recorded steps.

    Attributes:
        positions: [B, n, 3] m.
        times: [B, n] s.
        obstacles: [B, n, M, 3] m, true positions at those times.
        ground: [B, n, 3] m/s, velocity over ground of the vehicle during each step.
        water: [B, n, 3] m/s, the true current at the beginning of each step, that it is in.
        moves: [B, M, 3] m/s, true velocities of the obstacles over ground at the end.
        arc: [B] m covered along the track.
        arrived: [B] bool, the end of the track was reached; time stands still from there on.
        shortfall: [B], largest share of |v| by which the current beat the vehicle.
    """

    positions: jax.Array
    times: jax.Array
    obstacles: jax.Array
    ground: jax.Array
    water: jax.Array
    moves: jax.Array
    arc: jax.Array
    arrived: jax.Array
    shortfall: jax.Array


class Course(NamedTuple):
    """What one vehicle does next, and what is around it.

    Attributes:
        track: [S, 3] m, that is followed.
        arc: m already executed along it.
        moving: whether it follows it; otherwise it keeps station.
        now: s.
        current: the truth.
        obstacles: true position [M, 3] m, own velocity [M, 3] m/s and drift [M].
        share: that it makes of its speed through the water.
    """

    track: Array
    arc: float
    moving: bool
    now: float
    current: Current
    obstacles: tuple[Array, Array, Array]
    share: float = 1.0


#: Fields of a course that are numbers.
_ROWS = ("arc", "moving", "now", "share")


def simulate(courses: Sequence[Course], vehicle: Vehicle, samples: int, steps: int) -> list[Transit]:
    """Simulate `steps` of vehicles together; tracks have `samples` places or, on detours, more."""
    obstacles, found = [[padded_rows(part) for part in course.obstacles] for course in courses], []
    for index, real in padded_batches(len(courses), (WIDTH,)):
        batch = [courses[k] for k in index]
        most = max(len(course.track) for course in batch)
        if most > samples:  # of few shapes
            most = samples * 2 ** int(np.ceil(np.log2(most / samples)))
        tracks = [np.pad(one.track, ((0, most - len(one.track)), (0, 0)), mode="edge") for one in batch]
        rows: dict[str, Any] = {name: np.asarray([getattr(one, name) for one in batch]) for name in _ROWS}
        rows["obstacles"] = tuple(map(np.stack, zip(*(obstacles[k] for k in index), strict=True)))
        together = Course(
            track=np.stack(tracks),
            current=stacked([course.current for course in batch]),
            **rows,
        )
        out: Transit = jax.device_get(transit(together, vehicle, steps=steps))
        for row in range(real):
            one, present = jax.tree.map(lambda part, row=row: part[row], out), len(batch[row].obstacles[2])
            found.append(replace(one, obstacles=one.obstacles[:, :present], moves=one.moves[:present]))
    return found


@partial(compiled, static_argnames=("steps",))
def transit(courses: Course, vehicle: Vehicle, *, steps: int) -> Transit:
    """Follow B tracks, stacked, in the true current for `steps` of `TIME_STEP`.

    The vehicle crabs to hold its track; where the current beats it, it makes the least progress that travel
    times assume, and `Transit.shortfall` is that amount.
    """
    shared, each = partition(courses.current)

    def one(course: Any) -> Transit:
        track, arc, moving, now, own, (position, velocity, drift), share = course
        current, speed = combine(shared, own), share * vehicle.speed
        gaps = jnp.sqrt((jnp.diff(track, axis=0) ** 2).sum(axis=1))
        marks = jnp.concatenate([jnp.zeros(1), jnp.cumsum(gaps)])
        total = marks[-1]

        def step(carry, _):
            arc, now, position, arrived, worst = carry
            here = _along(track, marks, arc)
            ahead = _along(track, marks, jnp.minimum(arc + 5.0, total))
            behind = _along(track, marks, jnp.maximum(arc - 5.0, 0.0))
            tangent = (ahead - behind) / jnp.maximum(jnp.linalg.norm(ahead - behind), 1e-6)
            water = jnp.stack(current(here[0], here[1], here[2], now))
            along = tangent @ water
            across = jnp.sqrt(jnp.maximum(water @ water - along**2, 0.0))
            ground, shortfall = along_track("track", speed, along, across)
            left = total - arc
            arrives = moving & (ground * TIME_STEP >= left)
            elapsed = jnp.where(arrived, 0.0, jnp.where(arrives, left / ground, TIME_STEP))
            arc = jnp.where(arrives, total, arc + jnp.where(moving, ground * elapsed, 0.0))
            position = position + _over_ground(current, position, velocity, drift, now) * elapsed
            carry = (arc, now + elapsed, position, arrived | arrives, jnp.maximum(worst, shortfall))
            over_ground = jnp.where(moving, ground, 0.0) * tangent
            return carry, (_along(track, marks, arc), now + elapsed, position, over_ground, water)

        begin = (arc, now, position, jnp.array(False), jnp.array(0.0))
        (arc, now, position, arrived, worst), (positions, times, trace, ground, water) = jax.lax.scan(
            step, begin, length=steps
        )
        moves = _over_ground(current, position, velocity, drift, now)
        return Transit(positions, times, trace, ground, water, moves, arc, arrived, worst)

    return jax.vmap(one)(courses._replace(current=each))


def _over_ground(
    current: Current, position: jax.Array, velocity: jax.Array, drift: jax.Array, now: jax.Array
) -> jax.Array:
    """Velocity of obstacles over ground, [M, 3] m/s: their own plus the current's where it carries them."""
    swept = jnp.stack(current(position[:, 0], position[:, 1], position[:, 2], now), axis=1)
    return velocity + drift[:, None] * swept


_compiled_over_ground = compiled(_over_ground)


def over_ground(current: Current, *motion: ArrayLike, now: float) -> NDArray[np.float64]:
    """Velocity over ground, [M, 3] m/s, of obstacles of position, own velocity [M, 3] and drift [M]."""
    count = len(motion[0])  # type: ignore[arg-type]
    found = _compiled_over_ground(current, *(padded_rows(part) for part in motion), now)
    return np.asarray(found, float)[:count]


def padded_rows(values: ArrayLike) -> NDArray[np.float64]:
    """Figures [M, ...] of obstacles, followed by zeros up to a number that one program serves."""
    figures = np.asarray(values, float)
    padded = np.zeros((rounded_up(len(figures)), *figures.shape[1:]))
    padded[: len(figures)] = figures
    return padded


def _along(track: jax.Array, marks: jax.Array, arc: jax.Array) -> jax.Array:
    """Position [3] at a distance along a track."""
    return jnp.stack([jnp.interp(arc, marks, track[:, axis]) for axis in range(3)])
