"""How well a vehicle knows where it is, as settings."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from auvplan.scenario.places import NotNegative, Positive
from auvplan.scenario.section import Section, optional

if TYPE_CHECKING:
    from auvplan.navigation import Navigation


class NavigationSettings(Section):
    """Dead reckoning and fixes; the name of a shipped vehicle alone, or a file's path, is its `vehicle`."""

    vehicle: str | None = optional(
        "a shipped vehicle, as `auvplan vehicle list` names it, or path of a YAML file with navigation; "
        "what stands beside it here counts more"
    )
    drift: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional(
        "error of dead reckoning as a share of the way through the water, 1 sigma along each axis; default 0"
    )
    current_error: NotNegative | None = optional(
        "m/s, error of the current that it is taken to drift with, 1 sigma along each axis; counts out of "
        "bottom lock; default 0"
    )
    fix: NotNegative | None = optional("m, error of a fix at the surface, 1 sigma along each axis; default 0")
    bottom_lock: Positive | None = optional(
        "m, altitude up to which it measures its speed over ground; needs a sea bed; never if absent"
    )
    fix_time: NotNegative | None = optional("s at the surface that a fix takes; default 60")
    surfacing_price: NotNegative | None = optional("s that the risk of a surfacing is worth; default 0")
    most: Positive | None = optional(
        "m, standard deviation of the position on arrival at each waypoint, at most; not limited if absent"
    )

    def given(self) -> dict[str, float]:
        """Return the figures that are stated."""
        stated = {name: getattr(self, name) for name in type(self).model_fields if name != "vehicle"}
        return {name: value for name, value in stated.items() if value is not None}

    def made(self, confidence: float) -> "Navigation":
        """Return the model, with margins wider by a number of standard deviations."""
        from auvplan.navigation import Navigation  # it loads JAX

        own = {k: v for k, v in self.given().items() if k in ("drift", "current_error", "fix", "bottom_lock")}
        return Navigation(**own, confidence=confidence)
