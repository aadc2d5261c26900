"""What the sections of a scenario are made of: their base, numbers, and places.

Places are local metres, or longitude and latitude that are brought to them.
"""

from typing import Annotated, Any, ClassVar, Self, get_args

import numpy as np
from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from auvplan.errors import ScenarioError
from auvplan.site import Site, is_place

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
#: S, at most ten years: longer ones are slips.
Seconds = Annotated[float, Field(gt=0, le=10 * 365 * 86400, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


def setting(default: Any, description: str) -> Any:
    """Return a field of a section: its default, and what it is."""
    return Field(default=default, description=description)


def optional(description: str) -> Any:
    """Return a field that may be absent, and is None then."""
    return setting(None, description)


class Section(BaseModel):
    """Base of all sections: unknown keys are faults, values do not change."""

    model_config: ClassVar[ConfigDict] = ConfigDict(extra="forbid", frozen=True)

    def stated(self, *apart: str) -> dict[str, Any]:
        """Return the fields that are given, but for some."""
        fields = {name: getattr(self, name) for name in type(self).model_fields if name not in apart}
        return {name: value for name, value in fields.items() if value is not None}

    def _check(self) -> None:
        """Refuse values that do not go together, by a `ValueError`; a `RuleError` names the fields."""

    @model_validator(mode="after")
    def _checked(self) -> Self:
        self._check()
        return self

    @field_validator("*", mode="before")
    @classmethod
    def _no_truth(cls, given: Any, info: ValidationInfo) -> Any:
        """Refuse true and false, for which YAML takes yes, no, on and off too, where a number is wanted."""
        annotation = cls.model_fields[info.field_name or ""].annotation
        if bool not in (annotation, *get_args(annotation)):
            for entry in given if isinstance(given, list) else [given]:
                if isinstance(entry, bool):
                    shown = str(entry).lower()
                    raise ValueError(f"must not be true or false (nor yes, no, on, off), got {shown}")
        return given


#: A place in a file: local north, east, depth in metres, or longitude and latitude in degrees and depth.
_PLACE_SCHEMA = {
    "anyOf": [
        {
            "type": "array",
            "prefixItems": [{"type": "number"}] * 3,
            "minItems": 3,
            "maxItems": 3,
            "description": "north, east, depth, m, from the scenario's origin",
        },
        {
            "type": "object",
            "properties": {name: {"type": "number"} for name in ("longitude", "latitude", "depth")},
            "required": ["longitude", "latitude"],
            "additionalProperties": False,
            "description": "degrees east and north, and m down; needs the section site",
        },
    ]
}


def _no_error(value: Any) -> Any:
    if isinstance(value, ScenarioError):
        raise value
    return value


Point = Annotated[tuple[Finite, Finite, Finite], BeforeValidator(_no_error), WithJsonSchema(_PLACE_SCHEMA)]
#: What is said of a place that would be one the other way round.
SWAPPED = ": longitude and latitude seem swapped"


def by_degrees(given: dict[str, Any]) -> dict[tuple[str, str], dict[str, Any]]:
    """Return the places of a scenario's plain data that are mappings, by section and name."""
    paths = [("mission", "start"), ("mission", "goal"), ("area", "lower"), ("area", "upper")]
    sections = {name: part for name, part in given.items() if isinstance(part, dict)}
    stated = {path: sections.get(path[0], {}).get(path[1]) for path in paths}
    return {path: dict(value) for path, value in stated.items() if isinstance(value, dict)}


def localised(given: dict[str, Any], site: Site | None) -> dict[str, Any]:
    """Return a scenario's plain data with places of longitude and latitude in local metres.

    In place of one that is none stands the error that says why; its reason is empty where another says it.
    """
    stated = by_degrees(given)
    local: dict[tuple[str, str], Any] = {path: _place(value, site) for path, value in stated.items()}
    swapped = [path for path, place in local.items() if str(place).endswith(SWAPPED)]
    if len(swapped) > 1:  # said once
        first = ScenarioError(f"{local[swapped[0]]}, here and in other places")
        local |= dict.fromkeys(swapped, ScenarioError("")) | {swapped[0]: first}
    corners = [path for path in local if path[0] == "area"]
    if corners and not any(isinstance(local[path], ScenarioError) for path in corners):
        try:
            local |= _box(stated.get(("area", "lower")), stated.get(("area", "upper")), site)
        except ScenarioError as error:
            local[corners[0]] = error
    if any(isinstance(local[path], ScenarioError) for path in corners):  # half a box by place is none
        local |= {path: ScenarioError("") for path in corners if not isinstance(local[path], ScenarioError)}
    out = dict(given)
    for (section, name), place in local.items():
        out[section] = out[section] | {name: place}
    return out


def _place(value: dict[str, Any], site: Site | None) -> tuple[float, float, float] | ScenarioError:
    """Return a place in local metres, or what is wrong with it."""
    if not {"longitude", "latitude"} <= value.keys() <= {"longitude", "latitude", "depth"}:
        return ScenarioError(
            f"must have longitude, latitude and perhaps depth, got {sorted(map(str, value))}"
        )
    longitude, latitude, depth = numbers = [value["longitude"], value["latitude"], value.get("depth", 0.0)]
    if not all(isinstance(number, int | float) and abs(number) <= 1e7 for number in numbers):
        return ScenarioError("must have numbers for longitude, latitude and depth")
    if not is_place(longitude, latitude):
        hint = SWAPPED if site is not None and is_place(latitude, longitude) else ""
        return ScenarioError(f"longitude {longitude}, latitude {latitude} is no place on Earth{hint}")
    if site is None:
        return ScenarioError("a place by longitude and latitude needs the section site")
    north, east = site.to_local(longitude, latitude)
    return (round(float(north), 2), round(float(east), 2), float(depth))


def _box(low: Any, high: Any, site: Site | None) -> dict[tuple[str, str], tuple[float, float, float]]:
    """Return the local box around a box of longitude and latitude, whose sides are not quite straight."""
    if not (isinstance(low, dict) and isinstance(high, dict)):
        raise ScenarioError("lower and upper must both be places by longitude and latitude, or neither")
    assert site is not None
    wide, tall = (high[key] - low[key] for key in ("longitude", "latitude"))
    if wide < 0.0 and wide % 360.0 < 180.0:  # across the antimeridian, or Greenwich in longitudes up to 360
        wide %= 360.0
    if not (wide > 0.0 and tall > 0.0):
        raise ScenarioError("must be the south-western corner and area.upper the north-eastern one")
    share = np.linspace(0.0, 1.0, 33)
    along, ends = np.concatenate([share, share]), np.repeat([0.0, 1.0], 33)
    longitude = low["longitude"] + wide * np.concatenate([along, ends])
    latitude = low["latitude"] + tall * np.concatenate([ends, along])
    north, east = site.to_local(longitude, latitude)
    least, most = np.floor([north.min(), east.min()]).tolist(), np.ceil([north.max(), east.max()]).tolist()
    return {
        ("area", "lower"): (*least, float(low.get("depth", 0.0))),
        ("area", "upper"): (*most, float(high.get("depth", 0.0))),
    }
