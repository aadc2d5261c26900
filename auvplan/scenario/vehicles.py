"""Vehicles that are shipped or from files, and the power models that settings describe."""

from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import field_validator

from auvplan.errors import ScenarioError
from auvplan.scenario.fields import read_section
from auvplan.scenario.power import NavigationSettings, PowerSettings, is_file_name
from auvplan.scenario.section import Positive, Section, optional, setting

# It loads JAX, which scenarios need later only.
if TYPE_CHECKING:
    from auvplan.energy.power import PowerModel

_SHIPPED = files("auvplan") / "data" / "vehicles"


class VehicleFile(Section):
    """A vehicle's file: what it draws, and where that is known from."""

    description: str = ""
    source: str = setting("", "of the figures")
    depth_max: Positive | None = optional("m")
    speeds: tuple[Positive, Positive] | None = optional("m/s through the water, least and greatest")
    power: PowerSettings
    navigation: NavigationSettings | None = None

    @field_validator("speeds")
    @classmethod
    def _rising(cls, speeds: tuple[float, float] | None) -> tuple[float, float] | None:
        if speeds is not None and not speeds[0] < speeds[1]:
            raise ValueError("must be the least and then the greatest")
        return speeds

    @field_validator("power", "navigation")
    @classmethod
    def _by_itself(cls, part: Any) -> Any:
        if part is not None and part.vehicle is not None:
            raise ValueError("must be given here, not by another vehicle")
        return part


def shipped_vehicles() -> list[str]:
    """Return the names of the shipped vehicles."""
    return sorted(e.name.removesuffix(".yaml") for e in _SHIPPED.iterdir() if e.name.endswith(".yaml"))


def load_vehicle(name: str, folder: str | Path = ".") -> VehicleFile:
    """Load a shipped vehicle by its name, or one from a YAML file.

    Args:
        name: as `shipped_vehicles` returns them, or a path.
        folder: that relative paths start from.

    Raises:
        ScenarioError: there is none, or it is faulty; one line that names file, field and reason.
    """
    path = Path(folder) / Path(name).expanduser() if is_file_name(name) else Path(f"{_SHIPPED / name}.yaml")
    if not is_file_name(name) and name not in shipped_vehicles():
        raise ScenarioError(f"{name!r} is no shipped vehicle: {', '.join(shipped_vehicles())}")
    return read_section(path, VehicleFile, ScenarioError)


def power_model(
    settings: PowerSettings | None, folder: str | Path = ".", speed: float | None = None
) -> "PowerModel | None":
    """Return the power model that settings describe; None where there are none.

    Args:
        settings: of the scenario's vehicle.
        folder: that relative paths start from.
        speed: m/s, of the vehicle, that its table must have.

    Raises:
        ScenarioError: a vehicle is not there or faulty, or has no power at the speed.
    """
    if settings is None:
        return None
    whole = settings
    if settings.vehicle is not None:
        base, battery = _named(settings.vehicle, folder, "power").power, settings.battery
        # A pump stands in place of propulsion, and propulsion of a pump, unless both are given together.
        changes = {"pump": None} if settings.propulsion else {}
        changes |= {"propulsion": None} if settings.pump else {}
        changes |= settings.stated("vehicle", "battery")
        if battery is not None and base.battery is not None:
            battery = base.battery.model_copy(update=battery.stated())
        whole = base.model_copy(update=changes | {"battery": battery or base.battery})
    from auvplan.energy.power import Battery, PowerLaw, PowerModel, PowerTable

    propulsion = PowerLaw(0.0, 0.0) if whole.propulsion is None else whole.propulsion.made()
    if speed is not None and isinstance(propulsion, PowerTable) and speed > 1.000001 * propulsion.speeds[-1]:
        reason = (
            f"{speed:g} m/s is beyond the table of vehicle.power, which ends at {propulsion.speeds[-1]:g} m/s"
            ": set at most that, or a propulsion that reaches further"
        )
        raise ScenarioError(reason, field="vehicle.speed")
    battery = whole.battery
    if battery is not None and battery.capacity is None:
        raise ScenarioError("needs its capacity, Wh", field="vehicle.power.battery")
    return PowerModel(
        propulsion,
        **whole.stated("vehicle", "propulsion", "battery"),
        battery=None if battery is None else Battery(**battery.stated()),
    )


def navigation_settings(
    settings: NavigationSettings | None, folder: str | Path = "."
) -> NavigationSettings | None:
    """Return settings of navigation with those of the vehicle that they name; None where there are none.

    Raises:
        ScenarioError: the vehicle is not there or faulty, or states no navigation.
    """
    if settings is None or settings.vehicle is None:
        return settings
    known = _named(settings.vehicle, folder, "navigation").navigation
    if known is None:
        reason = f"names {settings.vehicle}, which states none: give drift, current_error and fix"
        raise ScenarioError(reason, field="vehicle.navigation")
    return known.model_copy(update=settings.stated("vehicle"))


def _named(name: str, folder: str | Path, part: str) -> VehicleFile:
    """Return the vehicle that a part of a scenario's vehicle names; an error is that part's."""
    try:
        return load_vehicle(name, folder)
    except ScenarioError as error:
        raise ScenarioError(error.reason, field=f"vehicle.{part}") from None
