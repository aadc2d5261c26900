"""Fits h + k v^n to measured or configured propulsion power."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar, nnls

from auvplan.energy.power import PowerLaw
from auvplan.errors import AuvplanError
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import counted

#: Exponents that are looked for: power grows no slower than drag's linear part, no faster than waves let it.
EXPONENTS = 1.0, 4.5


@dataclass(frozen=True)
class Fit:
    """A law of propulsion power, and how well it fits.

    Attributes:
        law: h + k v^n.
        speeds: [K] m/s, of the points that it was fitted to.
        watts: [K] W.
        free: numbers that were fitted.
    """

    law: PowerLaw
    speeds: Array
    watts: Array
    free: int

    @property
    def residuals(self) -> Array:
        """[K] W, points less the law."""
        return self.watts - np.asarray(self.law(self.speeds))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals, W."""
        return float(np.sqrt(np.mean(self.residuals**2)))

    @property
    def worst(self) -> float:
        """Greatest residual, W."""
        return float(np.abs(self.residuals).max())

    @property
    def line(self) -> str:
        """One line for people."""
        constant, factor, exponent = (
            float(part)  # type: ignore[arg-type]
            for part in (self.law.constant, self.law.factor, self.law.exponent)
        )
        points = f"{counted(len(self.speeds), 'point')}, {self.free} coefficients"
        flatters = ": they say little of other speeds" if len(self.speeds) <= self.free + 1 else ""
        return (
            f"{constant:.4g} + {factor:.4g} v^{exponent:.3g} W; residuals {self.rms:.2g} W rms, "
            f"{self.worst:.2g} W at worst, in {points}{flatters}"
        )


def fit_power(speeds: ArrayLike, watts: ArrayLike, exponent: float | None = None) -> Fit:
    """Fit h + k v^n by least squares, h and k not negative.

    Points at standstill, where the motor is off, are left out.

    Args:
        speeds: [K] m/s through the water.
        watts: [K] W.
        exponent: n; looked for within `EXPONENTS` if absent.

    Raises:
        AuvplanError: there are too few points, or values that are no numbers; one line.

    Example:
        >>> fit = fit_power([0.5, 1.0, 1.5, 2.0], [11.25, 20.0, 43.75, 90.0])
        >>> [round(float(part), 3) for part in (fit.law.constant, fit.law.factor, fit.law.exponent)]
        [10.0, 10.0, 3.0]
    """
    speed, power = np.asarray(speeds, float), np.asarray(watts, float)
    if speed.shape != power.shape or speed.ndim != 1 or not np.isfinite([speed, power]).all():
        raise AuvplanError("speeds and powers must be as many, and numbers")
    if (speed < 0.0).any() or (power < 0.0).any():
        raise AuvplanError("speeds and powers must not be negative")
    speed, power = speed[speed > 0.0], power[speed > 0.0]
    needed = 2 if exponent is not None else 3
    if len(np.unique(speed)) < needed:
        found = counted(len(np.unique(speed)), "speed")
        raise AuvplanError(f"{needed} coefficients need as many speeds above zero, got {found}")

    def solve(n: float) -> tuple[Array, float]:
        return nnls(np.stack([np.ones_like(speed), speed**n], axis=1), power)

    if exponent is None:
        grid = np.linspace(*EXPONENTS, 71)
        best = float(grid[np.argmin([solve(n)[1] for n in grid])])
        around = max(best - 0.05, EXPONENTS[0]), min(best + 0.05, EXPONENTS[1])
        found: Any = minimize_scalar(
            lambda n: solve(n)[1], bounds=around, method="bounded", options={"xatol": 1e-6}
        )
        best = float(found.x) if found.fun < solve(best)[1] else best
    else:
        best = exponent
    (constant, factor), _ = solve(best)
    return Fit(PowerLaw(float(constant), float(factor), best), speed, power, needed)
