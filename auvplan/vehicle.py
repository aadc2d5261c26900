"""The vehicle: constant speed through the water, limits, and ground speed along a track."""

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from auvplan.energy.power import PowerModel
from auvplan.navigation import Navigation
from auvplan.runtime.pytree import register_without_init

SpeedReading = Literal["track", "eq8", "eq11"]

#: Arrays of JAX or of NumPy.
T = TypeVar("T", jax.Array, np.ndarray)

#: Least ground speed that travel times reckon with, as a share of the speed through the water. Slower
#: progress is a violation; the floor keeps times and gradients finite.
SPEED_FLOOR = 0.05


#: Limits in the vertical, which a vehicle may be without, and the fields that have them.
VERTICAL_LIMITS = {"pitch": "pitch_max", "climb": "climb_rate_max", "dive": "dive_rate_max"}

#: rad, pitch that common torpedo-shaped vehicles keep.
PITCH_MAX = math.radians(30.0)

_UNITS = {
    "speed": "m/s",
    "surge_max": "m/s",
    "sway_max": "m/s",
    "turn_rate_max": "rad/s",
    "pitch_max": "rad",
    "climb_rate_max": "m/s",
    "dive_rate_max": "m/s",
    "transit_depth": "m",
    "transit_altitude": "m",
    "depth_toll": "s/m",
}

#: Fields that a vehicle may be without.
_OPTIONAL = *VERTICAL_LIMITS.values(), "transit_depth", "transit_altitude", "depth_toll"


@register_without_init
@dataclass(frozen=True)
class Vehicle:
    """A vehicle of constant thrust.

    Attributes:
        speed: |v|, m/s through the water (2.5, chosen here).
        surge_max: u_max, m/s, limit on the ground speed along the track.
        sway_max: v_max, m/s, limit on the current across the track.
        turn_rate_max: rad/s, limit on the rate at which the course over ground turns between samples; in a
            current the hull may turn faster.
        pitch_max: rad, limit on the pitch theta of the hull, nose up or down; None for no limit.
        climb_rate_max: m/s, limit on the vertical speed over ground upwards; None for no limit.
        dive_rate_max: m/s, the same downwards.
        transit_depth: m, depth that paths go down or up to between their ends, as far as box and sea bed
            allow; None for depths that are free.
        transit_altitude: m, the same above the sea bed: paths follow the terrain.
        depth_toll: s/m of change in depth that a path's cost counts beside time (`with_tolls`), or None.
        power: what it draws, and its battery; None where energy does not count. Planners of paths and routes
            do without it.
        navigation: how well it knows where it is: paths keep the farther off for it; None where it is taken
            to be where it should.

    Raises:
        TypeError: a value is not a number or an array of numbers.
        ValueError: a value is not positive and finite, or a pitch greater than a right angle; both transit
            depth and transit altitude are given.

    Differences from the paper:
        Eq. 12 limits |psi| itself, which on a map forbids a direction; here the limit is on the turn rate. It
        has no limit in the vertical: those here are ours, and preset "paper" goes without them.
    """

    speed: ArrayLike = 2.5
    surge_max: ArrayLike = 5.0
    sway_max: ArrayLike = 1.5
    turn_rate_max: ArrayLike = 0.1
    pitch_max: ArrayLike | None = PITCH_MAX
    climb_rate_max: ArrayLike | None = None
    dive_rate_max: ArrayLike | None = None
    transit_depth: ArrayLike | None = None
    transit_altitude: ArrayLike | None = None
    depth_toll: ArrayLike | None = None
    power: PowerModel | None = None
    navigation: Navigation | None = None

    def __post_init__(self) -> None:
        for name, unit in _UNITS.items():
            value = getattr(self, name)
            if isinstance(value, Tracer) or (value is None and name in _OPTIONAL):
                continue
            if not isinstance(value, int | float | np.generic | np.ndarray | jax.Array) or (
                np.asarray(value).dtype.kind not in "iuf"
            ):
                raise TypeError(f"vehicle {name} must be a number of {unit}, got {value!r}")
            zero = name in ("transit_depth", "depth_toll")
            least = np.asarray(value) >= 0 if zero else np.asarray(value) > 0
            if not (least & np.isfinite(value)).all():
                raise ValueError(f"vehicle {name} must be positive and finite, got {value}")
            if name == "pitch_max" and (np.asarray(value) > 0.5 * np.pi + 1e-6).any():
                raise ValueError(f"vehicle {name} must be at most a right angle, pi / 2 rad, got {value}")

        if not isinstance(self.power, PowerModel | None | Tracer):
            raise TypeError(f"vehicle power must be a PowerModel, got {type(self.power).__name__}")
        if not isinstance(self.navigation, Navigation | None | Tracer):
            raise TypeError(f"vehicle navigation must be a Navigation, got {type(self.navigation).__name__}")
        if self.transit_depth is not None and self.transit_altitude is not None:
            raise ValueError("vehicle transit_depth and transit_altitude exclude each other: leave one out")

    @property
    def has_transit(self) -> bool:
        """Whether the depth of paths between their ends is given."""
        return self.transit_depth is not None or self.transit_altitude is not None

    def without_transit(self) -> "Vehicle":
        """Return a copy whose depth between ends is free."""
        return replace(self, transit_depth=None, transit_altitude=None)

    def without_power(self) -> "Vehicle":
        """Return a copy without its power model, which planners are compiled for."""
        return self if self.power is None else replace(self, power=None)

    def with_tolls(self, power: PowerModel, price: ArrayLike = 0.0) -> "Vehicle":
        """Return a copy whose quickest paths, tolls included, take least energy at its speed.

        Energy and price are (P(v) + price) T + dive * metres down + climb * metres up. Between two ends
        metres down exceed metres up by the same on every path, so that both count as their mean, on each.

        Args:
            power: what it draws.
            price: W, what a second is worth beyond that.
        """
        per_metre = 0.5 * (power.dive + power.climb)  # type: ignore[operator]
        free = not isinstance(per_metre, Tracer) and not np.any(per_metre)
        return replace(self, depth_toll=None if free else per_metre / (power.power(self.speed) + price))

    @property
    def vertical_limits(self) -> dict[str, jax.Array]:
        """Greatest vertical speeds, m/s, by names of `VERTICAL_LIMITS`, of the limits that there are.

        "pitch" is |v| sin(pitch_max), through the water; "climb" and "dive" are over ground.
        """
        limits = {
            name: jnp.asarray(getattr(self, field))
            for name, field in VERTICAL_LIMITS.items()
            if getattr(self, field) is not None
        }
        if "pitch" in limits:
            limits["pitch"] = jnp.asarray(self.speed * jnp.sin(limits["pitch"]))
        return limits

    def steepest(self, down: ArrayLike) -> Any:
        """Sine of the steepest slope in still water, [...]: of dives where it goes `down`, else of climbs.

        An array of NumPy for one, of JAX for others.
        """
        xp: Any = np if isinstance(down, np.ndarray) else jnp
        limits = self.dive_rate_max, self.climb_rate_max
        rates = (np.inf if limit is None else xp.asarray(limit) for limit in limits)
        pitch = 1.0 if self.pitch_max is None else xp.sin(xp.asarray(self.pitch_max))
        return xp.minimum(xp.where(xp.asarray(down) > 0.0, *rates) / xp.asarray(self.speed), pitch)

    def vertical_times(self, depth: float) -> tuple[float, float]:
        """Return s that it takes from a depth, m, up to the surface, and back down, as steeply as it may."""
        up, down = depth / (float(np.asarray(self.speed)) * self.steepest(np.array([-1.0, 1.0])))
        return float(up), float(down)

    def stricter(self, share: float, *names: str) -> "Vehicle":
        """Return a copy with some limits multiplied by a share; absent limits stay absent.

        Args:
            share: in (0, 1].
            names: of the limits.
        """
        limits = {name: getattr(self, name) for name in names}
        return replace(self, **{name: share * limit for name, limit in limits.items() if limit is not None})


def along_track(reading: SpeedReading, speed: ArrayLike, along: T, across: T) -> tuple[T, T]:
    """Compute the ground speed along a track from the current along and across it.

    "track": the vehicle crabs to hold the track, c_t + sqrt(V^2 - c_n^2). "eq8": it points along the tangent,
    V + c_t. "eq11": the current is left out, V.

    Args:
        reading: which of the three.
        speed: V, m/s through the water.
        along: c_t, m/s, current along the tangent; an array of JAX or of NumPy, as the results will be.
        across: c_n >= 0, m/s, current across it.

    Returns:
        ``(ground_speed, shortfall)``: the speed that travel times use, at least `SPEED_FLOOR` times V, and by
        how much the current beats the vehicle, as a share of V; zero where the track can be held.
    """
    xp: Any = np if isinstance(along, np.ndarray) else jnp
    speed = xp.asarray(speed, along.dtype)
    if reading == "eq11":
        still = xp.broadcast_to(speed, along.shape)
        return still, xp.zeros_like(along)
    floor = SPEED_FLOOR * speed
    if reading == "eq8":
        progress, beaten = speed + along, xp.zeros_like(along)
    else:
        beaten = xp.maximum(across - (1.0 - SPEED_FLOOR**2) * speed, 0.0)
        margin = xp.maximum((speed - across) * (speed + across), floor**2)
        progress = along + xp.sqrt(margin)
    shortfall = (xp.maximum(floor - progress, 0.0) + beaten) / speed
    return xp.maximum(progress, floor), shortfall
