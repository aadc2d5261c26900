"""Areas that are closed at some hours."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jax.core import Tracer
from numpy.typing import NDArray

from auvplan.ocean.chart import Chart
from auvplan.runtime.packed import Packable


@dataclass(frozen=True)
class Zone:
    """A closed area.

    Attributes:
        name: as in the file, or its number there.
        polygon: shapely Polygon or MultiPolygon in local (north, east), m.
        where: the file and the feature, as messages name it.
        hours: when it is closed, as the file gives it by `from`, `to` and `windows`; empty for always.
    """

    name: str
    polygon: Any
    where: str = ""
    hours: Mapping[str, Any] = field(default_factory=dict)

    @property
    def rings(self) -> list[NDArray[np.floating]]:
        """Outlines, [n, 2] (north, east) m each; holes are left out."""
        return [shapely.get_coordinates(part.exterior) for part in shapely.get_parts(self.polygon)]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Closure(Packable):
    """Areas in which no path may be at some hours.

    Attributes:
        chart: on which they alone are coast.
        begins, ends: [W] s since the epoch, when they are closed; infinite where one is open.
        name: for people.
        outline: of the areas as stated, (north, east) m, as WKT; empty where it is not known.
    """

    chart: Chart
    begins: Any
    ends: Any
    name: str = field(default="", metadata={"static": True})
    outline: str = field(default="", metadata={"static": True})

    def closed(self, first: Any, last: Any) -> jax.Array:
        """Return whether they are closed at any moment between two times, s, of one shape."""
        first, last = (jnp.asarray(moment)[..., None] for moment in (first, last))
        return ((last > self.begins) & (first < self.ends)).any(axis=-1)

    def shut_until(self, place: NDArray[np.floating], now: float) -> float | None:
        """Return s until when they stay closed about a place [3] m; None where it is free at `now`."""
        ends = [last for first, last in self.spans if first <= now < last]
        if not ends or float(self.chart.distance(place[0], place[1])) > 0.0:
            return None
        return max(ends)

    def after(self, seconds: float) -> "Closure":
        """Return the same for an epoch that is later by `seconds`."""
        return replace(self, begins=self.begins - seconds, ends=self.ends - seconds)

    def widened(self, seconds: float) -> "Closure":
        """Return the same, closed `seconds` earlier and longer."""
        return replace(self, begins=self.begins - seconds, ends=self.ends + seconds)

    @cached_property
    def packed(self) -> "Closure":
        """See `Packable.packed`. One program serves areas of all names and outlines, and more hours."""
        if isinstance(self.begins, Tracer) or np.ndim(self.begins) > 1:
            return self
        count = len(self.begins)
        more = (0, (1 << (count - 1).bit_length()) - count)
        begins, ends = (
            np.pad(np.asarray(moments), more, constant_values=none)
            for moments, none in ((self.begins, np.inf), (self.ends, -np.inf))
        )
        return Closure(self.chart.packed, begins, ends)

    @property
    def spans(self) -> list[tuple[float, float]]:
        """When they are closed, s since the epoch, for use on the host."""
        begins, ends = (np.asarray(moments, float).tolist() for moments in (self.begins, self.ends))
        return list(zip(begins, ends, strict=True))

    @property
    def rings(self) -> list[NDArray[np.floating]]:
        """Outlines of the areas, [n, 2] (north, east) m each, to a pixel: holes are left out."""
        size = float(self.chart.pixel_size)
        parts = shapely.get_parts(self.chart.land().buffer(0.01 * size).simplify(size))
        return [shapely.get_coordinates(part.exterior)[:, ::-1] for part in parts]
