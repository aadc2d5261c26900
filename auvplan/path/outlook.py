"""Re-evaluation of a followed plan in the current known now, and of a mission's legs in many drawn ones."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.ocean.closures import Closure
from auvplan.ocean.currents import Current, combine
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.config import PathConfig
from auvplan.path.cost import IN_CURRENT, VIOLATIONS, WITHIN, Track, evaluate
from auvplan.path.kinematics import in_turn, norm
from auvplan.path.plan import PathPlan
from auvplan.path.profile import timed
from auvplan.runtime.compiled import compiled
from auvplan.vehicle import Vehicle

#: [V, 1], excess over each limit that is not a break.
_LET_PASS = np.array([[WITHIN * (name in IN_CURRENT)] for name in VIOLATIONS])

#: s, by which windows may be missed: times are of single precision.
_PUNCTUAL = 0.01


@dataclass(frozen=True)
class Outlook:
    """The rest of a plan, timed in another current.

    Attributes:
        time_left: s from the vehicle's place to the goal.
        planned: s, the same as it was planned.
        broken: whether the current breaks a limit on the way, or an area is closed by then. In the
            vertical, what a plan may exceed a limit by within its segments, `WITHIN`, is no break: stored
            positions have fewer digits than the planner's steps.
        times: [S] s since the epoch, at the samples of the plan; of those ahead they say when it is there.
    """

    time_left: float
    planned: float
    broken: bool
    times: NDArray[np.floating]

    @property
    def change(self) -> float:
        """By what share of the planned time the rest differs from it."""
        return abs(self.time_left - self.planned) / max(self.planned, 1.0)


def outlook(
    plan: PathPlan,
    sample: float,
    now: float,
    current: Current,
    vehicle: Vehicle,
    config: PathConfig,
    closures: tuple[Closure, ...] = (),
) -> Outlook:
    """Time the rest of a plan in a current; coast and obstacles are left out.

    Args:
        plan: the plan being followed.
        sample: where the vehicle is, in samples from the plan's start: in [0, S - 1], fractions between two.
        now: s since the epoch.
        current: as it is known now.
        vehicle: speed and limits.
        config: the settings that it was planned by.
        closures: areas that are closed at some hours.
    """
    sea = current, vehicle, closures
    count = np.arange(len(plan.times))
    # The vehicle may be later than planned: it is where it is now.
    depart = now - (np.interp(sample, count, plan.times) - plan.times[0])
    own = timed(config, current)
    times, excess = jax.device_get(_executed(plan.positions, np.float32(depart), *sea, config=own))
    times = np.asarray(times, float) + now - np.interp(sample, count, times)
    ahead = count[:-1] >= np.floor(sample)
    return Outlook(
        float(times[-1] - now),
        float(plan.times[-1] - np.interp(sample, count, plan.times)),
        bool((excess[:, ahead] > _LET_PASS).any()),
        times,
    )


@partial(compiled, static_argnames=("config",), quick=True)
def _executed(
    positions: jax.Array,
    depart: jax.Array,
    current: Current,
    vehicle: Vehicle,
    closures: tuple[Closure, ...],
    config: PathConfig,
) -> tuple[jax.Array, jax.Array]:
    """Times [S] s at the samples, and excess [V, S - 1] of each segment over each limit."""
    track = Track.through(*(positions[:, axis, None] for axis in range(3)))
    box = positions.min(axis=0), positions.max(axis=0)
    bare = Environment(current, None, Obstacles.none(), *box, closures=closures)
    trajectory = evaluate(track, depart, bare, vehicle, config)
    return trajectory.times[:, 0], jnp.stack(trajectory.excess)[:, :, 0]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Chain:
    """The paths of a mission's L legs, to be followed one after the other.

    Attributes:
        positions: [L, S, 3] m.
        departs: [L] s since the epoch, as planned.
        takes: [L] s, the same.
        speed: [L] m/s through the water.
        rises: [L] s, that the vehicle surfaces for a fix before it.
        leaves: [L] s, before which a leg is not begun; minus infinity where the vehicle does not wait.
        opens, closes: [L, W] s, windows in which the task at its end may begin.
        enters, until: [L, V] s, windows in one of which it is begun and its task done.
        task: [L] s, that it takes.
    """

    positions: jax.Array
    departs: jax.Array
    takes: jax.Array
    speed: jax.Array
    rises: jax.Array
    leaves: jax.Array
    opens: jax.Array
    closes: jax.Array
    enters: jax.Array
    until: jax.Array
    task: jax.Array


class Drawn(NamedTuple):
    """Currents that were drawn, and who goes through them.

    Attributes:
        forecast: that legs were planned in.
        shared, own: parts of D drawn currents, as `currents.partition` has them; leaves of `own` have a
            leading axis D.
        vehicle: limits; the speed is that of the leg.
    """

    forecast: Current
    shared: Current | None
    own: Current | None
    vehicle: Vehicle


@partial(compiled, static_argnames=("config",), quick=True)
def chain_times(
    chain: Chain, factors: jax.Array, delays: jax.Array, begins: jax.Array, seas: Drawn, config: PathConfig
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Follow the legs of a plan in D drawn currents: the paths stay, the times change.

    A leg takes as many times as long as planned as its path takes in the drawn current, against the forecast.
    A vehicle that comes too late for a task's windows goes on without it.

    Args:
        chain: the plan.
        factors: [D, L], of the times that tasks take.
        delays: [D, L] s, that legs take longer.
        begins: s since the epoch.
        seas: that are drawn.
        config: static settings.

    Returns:
        ``(travel [D, L] s, ends [D, L] s since the epoch, done [D, L])``: of each leg, when its task is over,
        and whether it is done.
    """
    taken = partial(_taken, vehicle=seas.vehicle, config=config)
    expected = jax.lax.map(lambda leg: taken(seas.forecast, leg, leg.departs), chain)

    def followed(own: Current | None, factors: jax.Array, delays: jax.Array) -> tuple[jax.Array, ...]:
        current = combine(seas.shared, own)

        def go(time: jax.Array, row: tuple) -> tuple[jax.Array, tuple[jax.Array, ...]]:
            found = _gone(taken, current, time, *row)
            return found[1], found

        return jax.lax.scan(go, begins, (chain, expected, factors, delays))[1]

    travel, ends, done = jax.vmap(followed)(seas.own, factors, delays)
    return travel, ends, done


@partial(compiled, static_argnames=("config",), quick=True)
def ruled_times(
    chains: Chain,
    latest: jax.Array,
    factors: jax.Array,
    delays: jax.Array,
    begins: jax.Array,
    seas: Drawn,
    config: PathConfig,
) -> tuple[jax.Array, jax.Array, jax.Array, jax.Array]:
    """Follow a plan in D drawn currents, by a rule that leaves out what there is no time for.

    Before each leg it is the leg itself that is gone, or one past the task at its end to the next, or one
    straight to the destination.

    Args:
        chains: of the three kinds; leaves have a leading axis 3.
        latest: [L, 2] s since the epoch, until when each leg of the plan is begun, and the one past its task.
        factors: [3, D, L], of the times that tasks at the ends of these legs take.
        delays: [3, D, L] s, that they take longer.
        begins, seas, config: as for `chain_times`.

    Returns:
        ``(kind, travel s, ends s since the epoch, done)``, [D, L] each: which of the legs is gone, minus 1
        for none; how long it takes; when its task, or that of the leg before, is over; whether it is done.
    """
    taken = partial(_taken, vehicle=seas.vehicle, config=config)
    expected = jax.lax.map(
        lambda legs: jax.lax.map(lambda leg: taken(seas.forecast, leg, leg.departs), legs), chains
    )

    def followed(own: Current | None, factors: jax.Array, delays: jax.Array) -> tuple[jax.Array, ...]:
        current = combine(seas.shared, own)

        def go(state: tuple[jax.Array, ...], row: tuple) -> tuple[tuple, tuple[jax.Array, ...]]:
            (time, past, home), (latest, *legs) = state, row
            found = jax.lax.map(lambda leg: jnp.stack(_gone(taken, current, time, *leg)), tuple(legs))
            kind = jnp.where(time <= latest[0], 0, jnp.where(time <= latest[1], 1, 2))
            travel, ends, done = found[kind]
            idle = past | home
            state = jnp.where(idle, time, ends), ~idle & (kind == 1), home | (~idle & (kind == 2))
            return state, (jnp.where(idle, -1, kind), travel, state[0], ~idle & (done > 0.0))

        def by_leg(values: jax.Array) -> jax.Array:
            return jnp.swapaxes(values, 0, 1)

        rows = latest, *(jax.tree.map(by_leg, part) for part in (chains, expected, factors, delays))
        return jax.lax.scan(go, (begins, jnp.bool_(False), jnp.bool_(False)), rows)[1]

    kind, travel, ends, done = jax.vmap(followed, in_axes=(0, 1, 1))(seas.own, factors, delays)
    return kind, travel, ends, done


def _gone(
    taken: Callable[..., jax.Array],
    current: Current,
    time: jax.Array,
    leg: Chain,
    expects: jax.Array,
    factor: jax.Array,
    delay: jax.Array,
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Go one leg from a time, s: how long it takes, when its task is over, and whether that is done."""
    leaves = jnp.maximum(time + leg.rises, leg.leaves)
    travel = leg.takes * taken(current, leg, leaves) / jnp.maximum(expects, 1e-3) + delay
    arrives = leaves + travel
    waits = jnp.where(arrives > leg.closes, jnp.inf, jnp.maximum(leg.opens - arrives, 0.0))
    wait = waits.min(initial=jnp.inf)
    kept = (leaves >= leg.enters - _PUNCTUAL) & (arrives + factor * leg.task <= leg.until + _PUNCTUAL)
    done = jnp.isfinite(wait) & kept.any()
    return travel, arrives + jnp.where(done, wait + factor * leg.task, 0.0), done


@partial(compiled, static_argnames=("config",), quick=True)
def leg_times(chain: Chain, leaves: jax.Array, seas: Drawn, config: PathConfig) -> jax.Array:
    """Follow L legs in D drawn currents, each from a moment of its own; travel times [D, L] s.

    Args:
        chain: the legs; what is not of their paths does not count.
        leaves: [D, L] s since the epoch, when they are begun.
        seas, config: as for `chain_times`.
    """
    taken = partial(_taken, vehicle=seas.vehicle, config=config)
    expected = jax.lax.map(lambda leg: taken(seas.forecast, leg, leg.departs), chain)

    def followed(own: Current | None, leaves: jax.Array) -> jax.Array:
        current = combine(seas.shared, own)

        def go(row: tuple) -> jax.Array:
            leg, expects, depart = row
            return leg.takes * taken(current, leg, depart) / jnp.maximum(expects, 1e-3)

        return jax.lax.map(go, (chain, expected, leaves))

    return jax.vmap(followed)(seas.own, leaves)


def _taken(
    current: Current, leg: Chain, depart: jax.Array, vehicle: Vehicle, config: PathConfig
) -> jax.Array:
    """S that the path of one leg takes in a current."""
    way = jnp.diff(leg.positions, axis=0)
    gap = norm(*way.T)
    middle = leg.positions[:-1] + 0.5 * way
    own_speed = replace(vehicle, speed=leg.speed)
    planes = (middle[:, 0], middle[:, 1], middle[:, 2]), (way[:, 0], way[:, 1], way[:, 2])
    return in_turn(*planes, gap, depart, current, own_speed, config)[0]
