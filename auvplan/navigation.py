"""How well a vehicle knows where it is: the standard deviation of its position since its last fix."""

from dataclasses import dataclass, fields, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jax.typing import ArrayLike

from auvplan.runtime.pytree import register_without_init

#: m2 added under a root, whose slope is finite then where nothing is uncertain.
_TINY = 1e-8

#: m, depth at which a vehicle has fixes without surfacing for them.
AT_SURFACE = 0.5


@register_without_init
@dataclass(frozen=True)
class Navigation:
    """Dead reckoning of a vehicle, and how far it has gone since its last fix.

    Along each horizontal axis the error has three independent parts: that of the fix; a bias of the dead
    reckoning, which grows with the way through the water; and, out of bottom lock, a bias of the current that
    the vehicle is taken to drift with, which grows with time. After a way w and a time t out of lock its
    standard deviation is

        sigma^2 = fix^2 + (drift w)^2 + (current_error t)^2 [m2].

    Biases last: the error of speed and heading of a log and a compass, and that of a current forecast, are
    much the same from one minute to the next, so that errors grow in proportion to the way and not to its
    root (Leonard and Bahr 2016, Autonomous Underwater Vehicle Navigation, Springer Handbook of Ocean
    Engineering; Kinsey, Eustice and Whitcomb 2006, A Survey of Underwater Vehicle Navigation).

    Attributes:
        drift: error as a share of the way through the water, 1 sigma along each axis.
        current_error: m/s, of the current that the vehicle cannot measure, 1 sigma along each axis.
        fix: m, of a fix at the surface, 1 sigma along each axis.
        bottom_lock: m, altitude up to which the speed over ground is measured; None for never.
        confidence: standard deviations by which margins are wider.
        way: m through the water since the last fix; one for each of B legs, [B], where they are planned
            together.
        unlocked: s of it out of bottom lock; the same.

    Raises:
        ValueError: a value is no number, or negative.

    Example:
        >>> log = Navigation(drift=0.01, current_error=0.05, fix=3.0)
        >>> round(float(log.after(400.0, 200.0).std), 2)  # (3^2 + 4^2 + 10^2)^(1/2)
        11.18
    """

    drift: ArrayLike = 0.0
    current_error: ArrayLike = 0.0
    fix: ArrayLike = 0.0
    bottom_lock: ArrayLike | None = None
    confidence: ArrayLike = 2.0
    way: ArrayLike = 0.0
    unlocked: ArrayLike = 0.0

    def __post_init__(self) -> None:
        for part in fields(self):
            value = getattr(self, part.name)
            if isinstance(value, Tracer) or (value is None and part.name == "bottom_lock"):
                continue
            known = isinstance(value, int | float | np.ndarray | np.generic | jax.Array)
            if not known or not (np.isfinite(value) & (np.asarray(value) >= 0.0)).all():
                raise ValueError(f"navigation {part.name} must be a number, not negative, got {value!r}")

    @property
    def std(self) -> Any:
        """Standard deviation of the position along each horizontal axis, m, now."""
        growing = (self.drift * self.way) ** 2 + (self.current_error * self.unlocked) ** 2  # type: ignore[operator]
        square = self.fix * self.fix + growing + _TINY  # type: ignore[operator]
        return jnp.sqrt(square) if isinstance(square, jax.Array) else np.sqrt(square)

    @property
    def allowance(self) -> Any:
        """By how much margins are wider now, m."""
        return self.confidence * self.std

    def after(self, way: ArrayLike, unlocked: ArrayLike) -> "Navigation":
        """Return the same farther on: m through the water, and s out of bottom lock."""
        return replace(self, way=self.way + way, unlocked=self.unlocked + unlocked)  # type: ignore[operator]

    def since(self, way: ArrayLike, unlocked: ArrayLike) -> "Navigation":
        """Return the same at a way, m, and a time out of bottom lock, s, after the last fix."""
        return replace(self, way=way, unlocked=unlocked)

    def fixed(self) -> "Navigation":
        """Return the same at a fix."""
        return self.since(0.0, 0.0)

    def scaled(self, factor: jax.Array) -> "Navigation":
        """Return the same where lengths and times are `factor` times as great."""
        names = "fix", "bottom_lock", "way", "unlocked"
        lengths = {name: getattr(self, name) for name in names}
        return replace(self, **{n: value * factor for n, value in lengths.items() if value is not None})
