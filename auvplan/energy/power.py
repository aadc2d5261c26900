"""The power that a vehicle draws, and the battery that it draws it from."""

from dataclasses import dataclass, fields
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from auvplan.runtime.arguments import numbers
from auvplan.runtime.pytree import register_without_init

#: J in a Wh.
WATT_HOUR = 3600.0


def _require(owner: str, values: dict[str, Any], least: float = 0.0, most: float = np.inf) -> None:
    """Refuse what is no number or out of range; tracers pass.

    Raises:
        ValueError: one line that names the field.
    """
    for name, value in values.items():
        if isinstance(value, Tracer):
            continue
        if not isinstance(value, int | float | np.ndarray | np.generic | jax.Array):
            raise ValueError(f"{owner} {name} must be a number, got {value!r}")
        found = np.asarray(value, float)
        if not (np.isfinite(found) & (found >= least) & (found <= most)).all():
            bounds = f"of at least {least:g}" if most == np.inf else f"from {least:g} to {most:g}"
            raise ValueError(f"{owner} {name} must be a number {bounds}, got {value}")


@register_without_init
@dataclass(frozen=True, eq=False)
class PowerTable:
    """Propulsion power by a table of speeds, linear between its points.

    Below the first point its power holds; beyond the last one the last segment goes on.

    Attributes:
        speeds: [K] m/s through the water, rising.
        watts: [K] W at these speeds.

    Raises:
        ValueError: there are not as many of both, or fewer than two; speeds do not rise.

    Example:
        >>> table = PowerTable([0.0, 1.0, 2.0], [0.0, 20.0, 80.0])
        >>> float(table(1.5)), float(table(2.5))
        (50.0, 110.0)
    """

    speeds: Any
    watts: Any

    def __post_init__(self) -> None:
        for name in ("speeds", "watts"):
            value = getattr(self, name)
            if not isinstance(value, Tracer | jax.Array):
                object.__setattr__(self, name, numbers(f"propulsion {name}", value))
            _require("propulsion", {name: getattr(self, name)})
        if np.ndim(self.speeds) != 1 or np.shape(self.speeds) != np.shape(self.watts) or len(self.speeds) < 2:
            raise ValueError("propulsion speeds and watts must be as many, and at least two")
        if not isinstance(self.speeds, Tracer) and not (np.diff(self.speeds) > 0.0).all():
            raise ValueError(f"propulsion speeds must rise, got {np.asarray(self.speeds).tolist()}")

    def __call__(self, speed: ArrayLike) -> jax.Array:
        """Return the power, W, at speeds through the water, m/s."""
        xp: Any = np if _plain(speed, self.speeds, self.watts) else jnp
        speeds, watts, speed = (xp.asarray(part) for part in (self.speeds, self.watts, speed))
        k = xp.clip(xp.searchsorted(speeds, speed, side="right") - 1, 0, len(speeds) - 2)
        slope = (watts[k + 1] - watts[k]) / (speeds[k + 1] - speeds[k])
        return watts[k] + slope * xp.maximum(speed - speeds[k], 0.0)


@register_without_init
@dataclass(frozen=True)
class PowerLaw:
    """Propulsion power h + k v^n.

    Attributes:
        constant: h, W, that is drawn at any speed.
        factor: k, W (s/m)^n.
        exponent: n.

    Example:
        >>> float(PowerLaw(10.0, 15.0)(2.0))
        130.0
    """

    constant: ArrayLike
    factor: ArrayLike
    exponent: ArrayLike = 3.0

    def __post_init__(self) -> None:
        _require("propulsion", {"constant": self.constant, "factor": self.factor})
        _require("propulsion", {"exponent": self.exponent}, 1.0, 6.0)

    def __call__(self, speed: ArrayLike) -> jax.Array:
        """Return the power, W, at speeds through the water, m/s."""
        xp: Any = np if _plain(speed, *(getattr(self, part.name) for part in fields(self))) else jnp
        # The slope of a power with a traced exponent is not defined at zero.
        return self.constant + self.factor * xp.maximum(xp.asarray(speed), 1e-6) ** self.exponent


@register_without_init
@dataclass(frozen=True)
class Battery:
    """A battery, and how much of it a mission may use.

    Attributes:
        capacity: Wh, as new and at its rated temperature.
        usable: share of it between full and empty that may be used.
        ageing: share of the capacity as new that is left.
        temperature: share of the capacity that is left at the water's temperature.
        reserve: share of the usable energy that has to be left at the end.
        charge: share of the usable energy that there is at the start.

    Example:
        >>> battery = Battery(1000.0, usable=0.9, ageing=0.8)
        >>> round(float(battery.usable_wh)), round(float(battery.usable_joules))
        (720, 2592000)
    """

    capacity: ArrayLike
    usable: ArrayLike = 1.0
    ageing: ArrayLike = 1.0
    temperature: ArrayLike = 1.0
    reserve: ArrayLike = 0.2
    charge: ArrayLike = 1.0

    def __post_init__(self) -> None:
        _require("battery", {"capacity": self.capacity}, 1e-9)
        shares = {part.name: getattr(self, part.name) for part in fields(self)[1:]}
        reserve = shares.pop("reserve")
        _require("battery", shares, 1e-6, 1.0)
        _require("battery", {"reserve": reserve}, 0.0, 1.0)

    @property
    def usable_wh(self) -> Any:
        """Energy of the full battery that may be used, the reserve included, Wh."""
        return self.capacity * self.usable * self.ageing * self.temperature  # type: ignore[operator]

    @property
    def usable_joules(self) -> Any:
        """The same in J."""
        return WATT_HOUR * self.usable_wh


@register_without_init
@dataclass(frozen=True)
class PowerModel:
    """The power that a vehicle draws.

    Attributes:
        hotel: W, of computers, sensors for navigation and whatever else is always on.
        payload: W, of what the mission carries, always on as well.
        propulsion: W by speed through the water: a `PowerTable`, a `PowerLaw`, or another pytree like them.
        dive, climb: J per metre of depth that is gained and lost, beyond the propulsion.
        pump: J each time that a descent ends, of a buoyancy engine; it counts as energy of dives, as what it
            takes by the metre of depth does.
        turning: J per rad of change of heading.
        task: W, in addition while a task is done or a survey line followed.
        task_start: J, each time that a task, or a survey line, is begun.
        battery: or None for one that is not known.

    Raises:
        ValueError: a value is negative or no number; one line that names it.
        TypeError: propulsion or battery is given by a number.

    Example:
        >>> model = PowerModel(hotel=30.0, propulsion=PowerLaw(10.0, 15.0), dive=100.0)
        >>> float(model.power(1.0)), float(model.rate(1.0, vertical_speed=0.2))
        (55.0, 75.0)
    """

    propulsion: Any
    hotel: ArrayLike = 0.0
    payload: ArrayLike = 0.0
    dive: ArrayLike = 0.0
    climb: ArrayLike = 0.0
    turning: ArrayLike = 0.0
    task: ArrayLike = 0.0
    task_start: ArrayLike = 0.0
    battery: Battery | None = None
    pump: ArrayLike = 0.0

    def __post_init__(self) -> None:
        names = (part.name for part in fields(self) if part.name not in ("propulsion", "battery"))
        _require("power", {name: getattr(self, name) for name in names})
        if isinstance(self.propulsion, int | float | np.ndarray | np.generic | list | tuple):
            got = type(self.propulsion).__name__
            raise TypeError(f"power propulsion must be a PowerTable or PowerLaw, W by speed, got {got}")
        if isinstance(self.battery, int | float):
            raise TypeError(f"power battery must be a Battery, got a number: give Battery({self.battery})")

    def power(self, speed: ArrayLike) -> Any:
        """Return what is drawn at steady level speeds through the water [...] m/s, W."""
        return self.hotel + self.payload + self.propulsion(speed)  # type: ignore[operator]

    def rate(self, speed: ArrayLike, vertical_speed: ArrayLike = 0.0, turn_rate: ArrayLike = 0.0) -> Any:
        """Return what is drawn in motion, W.

        Args:
            speed: [...] m/s through the water.
            vertical_speed: [...] m/s over ground, positive down.
            turn_rate: [...] rad/s, of the heading.
        """
        xp: Any = np if _plain(speed, vertical_speed, turn_rate, *jax.tree.leaves(self)) else jnp
        down = xp.asarray(vertical_speed)
        return self.power(speed) + self.in_depth(down) + self.turning * xp.abs(xp.asarray(turn_rate))

    def in_depth(self, down: ArrayLike) -> Any:
        """Return J that changes in depth [...] m take, positive down; W of vertical speeds [...] m/s."""
        xp: Any = np if _plain(down, self.dive, self.climb) else jnp
        return self.dive * xp.maximum(down, 0.0) + self.climb * xp.maximum(-xp.asarray(down), 0.0)


def _plain(*values: Any) -> bool:
    """Return whether no value is JAX's."""
    return not any(isinstance(value, jax.Array) for value in values)
