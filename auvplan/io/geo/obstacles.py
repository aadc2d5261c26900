"""Known obstacles from GeoJSON (RFC 7946): points with a radius, that stand or move."""

import difflib
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from auvplan.io.geo.error import GeoError, label, reading
from auvplan.io.geo.features import Feature, Features, each, local_positions, read_features
from auvplan.ocean.known import KnownObstacle
from auvplan.site import Site

_NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class _Properties(BaseModel):
    """What a feature says of an obstacle; see `read_obstacles`."""

    model_config = ConfigDict(extra="forbid")

    radius: Annotated[float, Field(gt=0.0, le=100_000.0)]
    name: str = ""
    depth_min: _NotNegative = 0.0
    depth_max: _NotNegative | None = None
    course: Annotated[float, Field(ge=0.0, le=360.0)] | None = None
    speed: _NotNegative = 0.0

    @model_validator(mode="after")
    def _consistent(self) -> "_Properties":
        if self.depth_max is not None and self.depth_max < self.depth_min:
            raise ValueError(f"depth_max {self.depth_max:g} m lies above depth_min {self.depth_min:g} m")
        if self.speed > 0.0 and self.course is None:
            raise ValueError("speed needs a course, degrees clockwise from north")
        return self


def read_obstacles(source: Features, site: Site) -> tuple[KnownObstacle, ...]:
    """Read obstacles that are known before the mission.

    GeoJSON points with the properties `radius` m, and `name`, `depth_min` and `depth_max` m, `course` degrees
    clockwise from north and `speed` m/s over ground where they have them. An obstacle without depths reaches
    from the surface to the bed; one that moves is at its place at the scenario's epoch.

    Raises:
        GeoError: names the file and the number of the feature; its `lines` are all that is wrong.
    """
    with reading(label(source)):
        return tuple(each(read_features(source, ("Point",)), lambda feature: [_obstacle(feature, site)]))


def _obstacle(feature: Feature, site: Site) -> KnownObstacle:
    try:
        stated = _Properties.model_validate(feature.properties)
    except ValidationError as error:
        raise GeoError(*(_line(feature.where, found) for found in error.errors(include_url=False))) from None
    ((north, east, _),) = local_positions(feature, site).tolist()
    bearing = np.deg2rad(stated.course or 0.0)
    velocity = (stated.speed * float(np.cos(bearing)), stated.speed * float(np.sin(bearing)))
    return KnownObstacle(
        stated.name or f"obstacle {feature.number}",
        (north, east),
        stated.radius,
        stated.depth_min,
        np.inf if stated.depth_max is None else stated.depth_max,
        velocity if stated.speed > 0.0 else (0.0, 0.0),
    )


def _line(where: str, found: Any) -> str:
    """Return one of pydantic's errors in words."""
    name = ".".join(map(str, found["loc"]))
    what = found["msg"].removeprefix("Value error, ").replace("Input should", "must")
    if found["type"] == "extra_forbidden":
        near = difflib.get_close_matches(name, _Properties.model_fields, 1, 0.7)
        hint = f": did you mean {near[0]!r}?" if near else ""
        what = f"is unknown; an obstacle has {', '.join(_Properties.model_fields)}{hint}"
    elif found["type"] == "missing":
        what = "is missing"
    return f"{where}: {name} {what}".replace(":  ", ": ")
