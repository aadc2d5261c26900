"""Places in scenario files: local metres, or longitude and latitude brought to them."""

from typing import Annotated, Any

import numpy as np
from pydantic import Field, WithJsonSchema

from auvplan.errors import ScenarioError
from auvplan.site import Site

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]

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
Point = Annotated[tuple[Finite, Finite, Finite], WithJsonSchema(_PLACE_SCHEMA)]


class OffEarthError(ScenarioError):
    """A longitude or latitude beyond those of the Earth."""


def localised(given: dict[str, Any], site: Site | None) -> dict[str, Any]:
    """Return a scenario's plain data with places of longitude and latitude in local metres."""
    out = dict(given)
    mission, area = given.get("mission"), given.get("area")
    if isinstance(mission, dict):
        out["mission"] = mission | {
            name: _place(mission[name], site, f"mission.{name}")
            for name in ("start", "goal")
            if name in mission
        }
    if isinstance(area, dict):
        corners = {name: area[name] for name in ("lower", "upper") if name in area}
        if any(isinstance(corner, dict) for corner in corners.values()):
            out["area"] = area | _box(corners, site)
    return out


def _place(value: Any, site: Site | None, name: str) -> Any:
    """Return a place in local metres; what is no mapping is left to validation."""
    if not isinstance(value, dict):
        return value
    known = {"longitude", "latitude", "depth"}
    if not {"longitude", "latitude"} <= value.keys() <= known:
        reason = f"must have longitude, latitude and perhaps depth, got {sorted(value)}"
        raise ScenarioError(reason, field=name)
    numbers = [value["longitude"], value["latitude"], value.get("depth", 0.0)]
    if not all(isinstance(number, int | float) and abs(number) <= 1e7 for number in numbers):
        raise ScenarioError("must have numbers for longitude, latitude and depth", field=name)
    if not (-180.0 <= numbers[0] <= 360.0 and -90.0 <= numbers[1] <= 90.0):
        reason = f"longitude {numbers[0]}, latitude {numbers[1]} is no place on Earth"
        raise OffEarthError(reason, field=name)
    if site is None:
        reason = "a place by longitude and latitude needs the section site"
        raise ScenarioError(reason, field=name)
    north, east = site.to_local(numbers[0], numbers[1])
    return (round(float(north), 2), round(float(east), 2), float(numbers[2]))


def _box(corners: dict[str, Any], site: Site | None) -> dict[str, Any]:
    """Return the local box around a box of longitude and latitude, whose sides are not quite straight."""
    for name in ("lower", "upper"):
        if not isinstance(corners.get(name), dict):
            reason = "lower and upper must both be places by longitude and latitude, or neither"
            raise ScenarioError(reason, field="area")
        _place(corners[name], site, f"area.{name}")
    assert site is not None
    low, high = corners["lower"], corners["upper"]
    if not (low["longitude"] < high["longitude"] and low["latitude"] < high["latitude"]):
        reason = "must be the south-western corner and area.upper the north-eastern one"
        raise ScenarioError(reason, field="area.lower")
    share = np.linspace(0.0, 1.0, 33)
    along, ends = np.concatenate([share, share]), np.repeat([0.0, 1.0], 33)
    wide, tall = (high[key] - low[key] for key in ("longitude", "latitude"))
    longitude = low["longitude"] + wide * np.concatenate([along, ends])
    latitude = low["latitude"] + tall * np.concatenate([ends, along])
    north, east = site.to_local(longitude, latitude)
    return {
        "lower": (float(np.floor(north.min())), float(np.floor(east.min())), float(low.get("depth", 0.0))),
        "upper": (float(np.ceil(north.max())), float(np.ceil(east.max())), float(high.get("depth", 0.0))),
    }
