"""A vehicle's power and battery, and how well it knows where it is, as settings."""

from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from auvplan.errors import RuleError
from auvplan.scenario.section import NotNegative, Positive, Section, optional, setting

Share = Annotated[float, Field(gt=0.0, le=1.0)]
Numbers = Annotated[tuple[NotNegative, ...], Field(min_length=2)]


if TYPE_CHECKING:
    from auvplan.energy.power import PowerLaw, PowerTable
    from auvplan.navigation import Navigation


class PropulsionSettings(Section):
    """Propulsion power by speed through the water: a table, or the law constant + factor v^exponent."""

    speeds: Numbers | None = optional("m/s through the water, rising, of a table that is linear between them")
    watts: Numbers | None = optional("W at these speeds")
    constant: NotNegative | None = optional("W, of the law")
    factor: NotNegative | None = optional("W (s/m)^exponent, of the law")
    exponent: Annotated[float, Field(ge=1.0, le=6.0)] = setting(3.0, "of the law")

    def _check(self) -> None:
        table, law = (self.speeds, self.watts), (self.constant, self.factor)
        if (table == (None, None)) == (law == (None, None)) or None in (
            table if law == (None, None) else law
        ):
            raise ValueError("must have either speeds and watts or constant and factor")
        self.made()

    def made(self) -> "PowerTable | PowerLaw":
        """Return the propulsion power."""
        from auvplan.energy.power import PowerLaw, PowerTable  # it loads JAX

        if self.speeds is not None:
            return PowerTable(list(self.speeds), list(self.watts or ()))
        return PowerLaw(self.constant or 0.0, self.factor or 0.0, self.exponent)


class BatterySettings(Section):
    """The battery, and how much of it a mission may use."""

    capacity: Positive | None = optional("Wh, as new and at its rated temperature")
    usable: Share | None = optional("share of it between full and empty that may be used; default 1")
    ageing: Share | None = optional("share of the capacity as new that is left; default 1")
    temperature: Share | None = optional("share of the capacity that is left in the water's cold; default 1")
    reserve: Annotated[float, Field(ge=0.0, le=1.0)] | None = optional(
        "share of the usable energy that has to be left at the end; default 0.2"
    )
    charge: Share | None = optional("share of the usable energy that there is at the start; default 1")


class PowerSettings(Section):
    """What the vehicle draws; the name of a shipped one alone, or the path of a file, is its `vehicle`."""

    vehicle: str | None = optional(
        "a shipped vehicle, as `auvplan vehicle list` names it, or path of a YAML file of the same form; "
        "what stands beside it here counts more"
    )
    hotel: NotNegative | None = optional("W, of whatever is always on; default 0")
    payload: NotNegative | None = optional("W, of what the mission carries, always on as well; default 0")
    propulsion: PropulsionSettings | None = optional("W by speed through the water")
    dive: NotNegative | None = optional("J per metre that is dived, beyond the propulsion; default 0")
    climb: NotNegative | None = optional("J per metre that is climbed; default 0")
    pump: NotNegative | None = optional(
        "J each time that a dive of a saw-tooth ends and the vehicle makes itself lighter; in place of the "
        "propulsion of its vehicle, and of one that is not given; default 0"
    )
    turning: NotNegative | None = optional("J per rad of change of heading; default 0")
    task: NotNegative | None = optional("W, in addition during tasks and along survey lines; default 0")
    task_start: NotNegative | None = optional("J, whenever a task, or a survey line, is begun; default 0")
    battery: BatterySettings | None = optional("energy is not limited if absent")

    def _check(self) -> None:
        if self.vehicle is None and self.propulsion is None and not self.pump:
            raise ValueError("needs propulsion, or the vehicle that it is of")
        battery = self.battery
        if self.vehicle is None and battery is not None and battery.capacity is None:
            raise RuleError("needs its capacity, Wh", field="battery")


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

    def made(self, confidence: float) -> "Navigation":
        """Return the model, with margins wider by a number of standard deviations."""
        from auvplan.navigation import Navigation  # it loads JAX

        own = self.stated("vehicle", "fix_time", "surfacing_price", "most")
        return Navigation(**own, confidence=confidence)


def is_file_name(name: str) -> bool:
    """Return whether a vehicle is named by the path of a file, not as a shipped one."""
    return name.endswith((".yaml", ".yml")) or "/" in name
