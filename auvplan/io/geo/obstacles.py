"""Known obstacles from GeoJSON (RFC 7946): points with a radius, that stand or move."""

from typing import Annotated

import numpy as np
from pydantic import Field

from auvplan.errors import RuleError
from auvplan.io.geo.error import GeoError, label, reading
from auvplan.io.geo.features import Feature, Features, each, local_positions, read_features
from auvplan.ocean.known import KnownObstacle
from auvplan.scenario.fields import check_fields
from auvplan.scenario.section import NotNegative, Section
from auvplan.scenario.yaml_lines import Document
from auvplan.site import Site


class _Properties(Section):
    """What a feature says of an obstacle; see `read_obstacles`."""

    radius: Annotated[float, Field(gt=0.0, le=100_000.0)]
    name: str = ""
    depth_min: NotNegative = 0.0
    depth_max: NotNegative | None = None
    course: Annotated[float, Field(ge=0.0, le=360.0)] | None = None
    speed: NotNegative = 0.0

    def _check(self) -> None:
        if self.depth_max is not None and self.depth_max < self.depth_min:
            reason = f"{self.depth_max:g} m lies above depth_min {self.depth_min:g} m"
            raise RuleError(reason, field="depth_max", concerns=("depth_min",))
        if self.speed > 0.0 and self.course is None:
            reason = "needs a course, degrees clockwise from true north"
            raise RuleError(reason, field="speed", concerns=("course",))


def read_obstacles(source: Features, site: Site) -> tuple[KnownObstacle, ...]:
    """Read obstacles that are known before the mission.

    GeoJSON points with the properties `radius` m, and `name`, `depth_min` and `depth_max` m, `course` degrees
    clockwise from true north and `speed` m/s over ground where they have them. An obstacle without depths
    reaches from the surface to the bed; one that moves is at its place at the scenario's epoch.

    Raises:
        GeoError: names the file and the number of the feature; its `lines` are all that is wrong.
    """
    with reading(label(source)):
        return tuple(each(read_features(source, ("Point",)), lambda feature: [_obstacle(feature, site)]))


def _obstacle(feature: Feature, site: Site) -> KnownObstacle:
    stated, faults, _ = check_fields(Document(feature.properties), _Properties)
    if stated is None or faults:
        lines = (f"{one.field} {one.reason}".replace(f"{one.field} unknown", "unknown") for one in faults)
        raise GeoError(*(f"{feature.where}: {line}" for line in lines))
    ((north, east, _),) = local_positions(feature, site).tolist()
    course = np.deg2rad(stated.course or 0.0)
    by_true_north = stated.speed * np.cos(course), stated.speed * np.sin(course)
    velocity = site.local_vector(*by_true_north, *site.to_geographic(north, east))
    return KnownObstacle(
        stated.name or f"obstacle {feature.number}",
        (north, east),
        stated.radius,
        stated.depth_min,
        np.inf if stated.depth_max is None else stated.depth_max,
        (float(velocity[0]), float(velocity[1])) if stated.speed > 0.0 else (0.0, 0.0),
    )
