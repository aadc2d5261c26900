"""The energy that a track or a mission takes, by term, and the charge that is left along it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR, PowerModel
from auvplan.runtime.arrays import Array

if TYPE_CHECKING:
    from auvplan.path.cost import Trajectory
    from auvplan.path.plan import PathPlan
    from auvplan.records import LegRecord
    from auvplan.vehicle import Vehicle

#: What energy is spent on.
TERMS = ("hotel", "payload", "propulsion", "dive", "climb", "turning", "tasks")

#: m/s through the water along the horizontal from which on a vehicle has a heading.
_STILL = 1e-3


def energy_of_steps(power: PowerModel, seconds: Any, speed: Any, down: Any, turn: Any) -> dict[str, Any]:
    """Return the energy of steps by term, J, but for tasks; arrays of JAX or of NumPy, [...] each.

    Args:
        power: of the vehicle.
        seconds: s, that each lasts.
        speed: m/s through the water.
        down: m, by which depth grows.
        turn: rad, by which the heading changes.
    """
    traced = any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves((power, seconds, speed, down, turn)))
    xp: Any = jnp if traced else np
    return {
        "hotel": power.hotel * seconds,
        "payload": power.payload * seconds,
        "propulsion": power.propulsion(speed) * seconds,
        "dive": power.dive * xp.maximum(down, 0.0),
        "climb": power.climb * xp.maximum(-down, 0.0),
        "turning": power.turning * xp.abs(turn),
    }


def energy_along(trajectory: "Trajectory", power: PowerModel, vehicle: "Vehicle") -> dict[str, jax.Array]:
    """Return the energy along P paths that `auvplan.path.cost.evaluate` followed, [P] J by term.

    The vehicle moves through the water at its speed; its heading is that of the reading "track", in which it
    crabs. Differentiable in all that times depend on, and in the power model.

    Args:
        trajectory: of S samples.
        power: of the vehicle.
        vehicle: of it, the speed counts.
    """
    seconds = jnp.diff(trajectory.times, axis=0)
    north, east, down = (jnp.diff(axis, axis=0) for axis in (trajectory.x, trajectory.y, trajectory.z))
    safe = jnp.maximum(seconds, 1e-6)
    through = north / safe - trajectory.water[0], east / safe - trajectory.water[1]
    # Where it goes straight up or down it has no heading: that before counts.
    place = jnp.arange(len(seconds))[:, None]
    headed = through[0] ** 2 + through[1] ** 2 > _STILL**2
    last = jax.lax.cummax(jnp.where(headed, place, 0), axis=0)
    # The angle between neighbours, from their products: smooth across north, and where the hull is still.
    rows = (jnp.take_along_axis(axis, last, axis=0) for axis in through)
    (x0, x1), (y0, y1) = ((axis[:-1], axis[1:]) for axis in rows)
    turn = jnp.arctan2(x0 * y1 - y0 * x1, x0 * x1 + y0 * y1 + 1e-9)
    turn = jnp.concatenate([jnp.zeros_like(turn[:1]), turn])
    speed = jnp.broadcast_to(jnp.asarray(vehicle.speed, seconds.dtype), seconds.shape)
    spent = _with_pump(energy_of_steps(power, seconds, speed, down, turn), power, down)
    return {name: part.sum(axis=0) for name, part in spent.items()}


def energy_of_plan(plan: "PathPlan", power: PowerModel) -> float:
    """Return the energy of a planned path, Wh, as that of a mission's leg is worked out."""
    speed, seconds = float(np.asarray(plan.conditions.vehicle.speed)), np.diff(np.asarray(plan.times, float))
    down, (turn, _) = np.diff(np.asarray(plan.positions, float)[:, 2]), _turns(plan.motion.yaw, np.nan)
    spent = _with_pump(energy_of_steps(power, seconds, np.full(len(seconds), speed), down, turn), power, down)
    return float(sum(part.sum() for part in spent.values())) / WATT_HOUR


@dataclass(frozen=True, eq=False)
class EnergyUse:
    """Energy along a mission, of n intervals one after the other.

    Attributes:
        times: [n + 1] s since the epoch, from the departure to the end.
        terms: J in each interval by the names of `TERMS`, [n] each.
        power: that it was worked out with.
    """

    times: Array
    terms: dict[str, Array]
    power: PowerModel

    @property
    def totals(self) -> dict[str, float]:
        """Wh by term."""
        return {name: float(part.sum()) / WATT_HOUR for name, part in self.terms.items()}

    @property
    def total(self) -> float:
        """Wh in all."""
        return sum(self.totals.values())

    @property
    def largest(self) -> str:
        """The term that takes most."""
        return max(self.totals, key=lambda name: self.totals[name])

    def scaled(self, factor: float) -> "EnergyUse":
        """Return the same of a vehicle that draws as many times as much."""
        return replace(self, terms={name: factor * part for name, part in self.terms.items()})

    @property
    def charge(self) -> Array:
        """Share of the usable energy that is left, [n + 1]; negative where the battery is empty; else NaN."""
        battery = self.power.battery
        spent = np.concatenate([np.zeros(1), np.cumsum(sum(self.terms.values()))])
        if battery is None:
            return np.full(len(spent), np.nan)
        return float(battery.charge) - spent / float(battery.usable_joules)  # type: ignore[arg-type]

    def charge_at(self, times: Array) -> Array:
        """Return the charge at other moments [...] s, linear between."""
        return np.interp(times, self.times, self.charge)

    @property
    def margin(self) -> float:
        """Wh left at the end beyond the reserve; infinite where no battery is known."""
        battery = self.power.battery
        if battery is None:
            return np.inf
        return float((self.charge[-1] - battery.reserve) * battery.usable_wh)

    @property
    def line(self) -> str:
        """One line for people."""
        battery = self.power.battery
        if battery is None:
            return f"energy {self.total:,.0f} Wh"
        return (
            f"energy {self.total:,.0f} of {float(battery.usable_wh):,.0f} Wh usable, charge "
            f"{100.0 * self.charge[-1]:.0f} % at the end, reserve {100.0 * float(battery.reserve):.0f} %"  # type: ignore[arg-type]
        )

    @property
    def lack(self) -> str:
        """Why the energy does not do: less is left than the reserve; empty where it does."""
        if self.margin >= 0.0:
            return ""
        most = self.totals[self.largest]
        missing = f"{-self.margin:,.0f} Wh short of the battery's reserve"
        return f"{missing}: {self.line}; the largest term is {self.largest}, {most:,.0f} Wh"

    def summary(self) -> dict[str, Any]:
        """Return the figures, ready for JSON."""
        found: dict[str, Any] = {"total_wh": self.total, "terms_wh": self.totals}
        if (battery := self.power.battery) is not None:
            found |= {
                "usable_wh": float(battery.usable_wh),
                "reserve": float(battery.reserve),  # type: ignore[arg-type]
                "charge_end": float(self.charge[-1]),
                "margin_wh": self.margin,
            }
        return found


def surfacing_steps(
    depth: float, lasts: float, ways: tuple[float, float], speed: float, drift: float
) -> tuple[Array, Array, Array]:
    """Return the steps of surfacing for a fix, up, at the surface and down: arguments of `energy_of_steps`.

    Args:
        depth: m, from which it surfaces and to which it returns.
        lasts: s, of all of it.
        ways: s of these that it takes up, and down.
        speed: m/s through the water, up and down.
        drift: m/s through the water at the surface.

    Returns:
        ``(seconds [3] s, speed [3] m/s, down [3] m)``.
    """
    up, down = min(1.0, lasts / max(sum(ways), 1e-9)) * np.asarray(ways, float)
    seconds = np.array([up, max(lasts - up - down, 0.0), down])
    return seconds, np.array([speed, drift, speed]), np.array([-depth, 0.0, depth])


def energy_of_legs(
    legs: "Sequence[LegRecord]",
    power: PowerModel,
    speed: float,
    *,
    known: bool,
    loiters: bool = False,
    drifts: bool = False,
    vertical_times: Callable[[float], tuple[float, float]] | None = None,
) -> EnergyUse:
    """Return the energy of executed or planned legs, one after the other.

    Under way a vehicle moves through the water at the leg's speed, or at that which its recorded motion and
    the recorded current come to. Where it stays, it keeps station against the last current that is known
    there, or loiters at its speed. Where it surfaces for a fix it goes up and down at its speed, and stays at
    the surface between. Turns count between records and at waypoints.

    Args:
        legs: in order; refused ones take nothing.
        power: of the vehicle.
        speed: m/s through the water, of legs that have none of their own, of loitering, and up and down.
        known: whether the recorded current is what the vehicle met; a plan's is what it was planned in.
        loiters: whether it loiters where it stays.
        drifts: whether it does not move through the water there.
        vertical_times: s from a depth, m, up to the surface, and back down; straight at its speed if absent.
    """
    legs = [leg for leg in legs if len(leg.times)]
    moments = [float(leg.times[0]) - leg.t_hold for leg in legs[:1]] or [0.0]
    rows, heading, before, held = list[dict[str, Array]](), np.nan, None, None

    def stay(seconds: float, drift: float, task: bool = False) -> None:
        if seconds > 0.0:
            add(np.asarray([seconds]), np.asarray([drift]), np.zeros(1), task)

    def add(seconds: Array, through: Array, down: Array, task: bool = False) -> None:
        spent = energy_of_steps(power, seconds, through, down, np.zeros(len(seconds)))
        rows.append(_with_tasks(spent, power.task * seconds * task))
        moments.extend((moments[-1] + np.cumsum(seconds)).tolist())

    for leg in legs:
        own = speed if leg.speed is None else leg.speed
        through, moving = _through_water(leg, None if known and leg.current is not None else own)
        turn, heading = _turns(np.where(moving, leg.motion.yaw[: len(moving)], np.nan), heading)
        seconds, down = np.diff(leg.times), np.diff(np.asarray(leg.positions, float)[:, 2])
        drift = 0.0 if drifts else speed if loiters else _drift(leg, through, moving)
        held, fix = drift if held is None else held, leg.t_fix or 0.0
        # Between two legs a vehicle is held, or waits for its planner, and may surface.
        stay(float(leg.times[0]) - moments[-1] - fix, held)
        if fix:
            depth = float(leg.positions[0][2])
            ways = (depth / speed, depth / speed) if vertical_times is None else vertical_times(depth)
            add(*surfacing_steps(depth, fix, ways, speed, held))
        if len(seconds):
            spent = energy_of_steps(power, seconds, np.where(moving, through, drift), down, turn)
            spent = _with_pump(spent, power, down)
            rows.append(_with_tasks(spent, power.task * seconds * (leg.line is not None)))
            moments += np.asarray(leg.times[1:], float).tolist()
        if leg.arrived:
            done = leg.priority > 0.0
            stay(leg.t_wait, drift)
            stay(leg.t_task, drift, task=done)
            if done and rows and not (before and _goes_on(leg, before)):
                rows[-1]["tasks"][-1] += float(power.task_start)  # type: ignore[arg-type]
        before, held = leg, drift
    terms = {name: np.concatenate([np.zeros(0), *(row[name] for row in rows)]) for name in TERMS}
    return EnergyUse(np.asarray(moments), terms, power)


def _goes_on(leg: "LegRecord", before: "LegRecord") -> bool:
    """Return whether a leg goes on along a survey line that the one before it has begun."""
    if leg.line is None or before.line is None:
        return False
    return before.arrived and before.priority > 0.0 and leg.line.start == before.line.end


def _with_tasks(spent: dict[str, Any], tasks: Any) -> dict[str, Array]:
    """Return the energy of steps with that of tasks, as arrays of their own."""
    return {name: np.array(part, float) for name, part in (spent | {"tasks": tasks}).items()}


def _with_pump(spent: dict[str, Any], power: PowerModel, down: Any) -> dict[str, Any]:
    """Return the energy of steps one after the other, along axis 0, with that of the pump after descents."""
    sinks = down > 0.0
    xp: Any = np if isinstance(down, np.ndarray) else jnp
    ends = sinks & ~xp.concatenate([sinks[1:], xp.zeros_like(sinks[:1])])
    return spent | {"dive": spent["dive"] + power.pump * ends}


def _through_water(leg: "LegRecord", stated: float | None) -> tuple[Array, NDArray[np.bool_]]:
    """Return the speed through the water in each step between records, m/s, and whether the vehicle moves."""
    ground = np.asarray(leg.motion.ground_velocity, float)[: max(len(leg.times) - 1, 0)]
    if not len(ground) or np.isnan(ground).any():
        places, seconds = np.asarray(leg.positions, float), np.diff(leg.times)
        ground = np.diff(places, axis=0) / np.maximum(seconds, 1e-9)[:, None]
    moving = np.linalg.norm(ground, axis=1) > 1e-6
    if stated is not None:
        return np.full(len(ground), stated), moving
    water = np.nan_to_num(np.asarray(leg.current, float)[: len(ground)])
    own = ground - np.pad(water, ((0, 0), (0, 1)))
    return np.linalg.norm(own, axis=1), moving


def _drift(leg: "LegRecord", through: Array, moving: NDArray[np.bool_]) -> float:
    """Return the strength of the last current known on a leg, m/s: recorded, or that of the motion."""
    if leg.current is not None and len(leg.current) and np.isfinite(leg.current[-1]).all():
        return float(np.linalg.norm(leg.current[-1]))
    last = np.flatnonzero(moving)
    if not len(last) or np.isnan(leg.motion.yaw[last[-1]]):
        return 0.0
    yaw, pitch = (float(getattr(leg.motion, of)[last[-1]]) for of in ("yaw", "pitch"))
    hull = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    return float(np.linalg.norm(leg.motion.ground_velocity[last[-1]] - through[last[-1]] * hull))


def _turns(yaw: Sequence[float] | Array, heading: float) -> tuple[Array, float]:
    """Return by how much each heading differs from the last one that is known, [n] rad, and the last."""
    known = np.flatnonzero(np.isfinite(yaw))
    turn = np.zeros(len(yaw))
    if not len(known):
        return turn, heading
    row = np.asarray(yaw)[known]
    before = np.concatenate([[row[0] if np.isnan(heading) else heading], row[:-1]])
    turn[known] = np.abs((row - before + np.pi) % (2.0 * np.pi) - np.pi)
    return turn, float(row[-1])
