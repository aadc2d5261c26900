"""How far a run keeps off coast, closed areas, sea bed and obstacles, also between its records."""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import shapely

from auvplan.check.track import Coast, SampledTrack
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime.arrays import Array
from auvplan.view.scene import FAR, true_obstacles


@dataclass(frozen=True)
class Margins:
    """Least distances on the straight line from each of n records to the next, m; of the last, at its place.

    Attributes:
        coast: [n] to the edge of the nearest pixel of land, at most `MissionRun.coast_reach`; 0 on land.
        closed: [n] to areas that are closed then; 0 within one.
        bed: [n] above the sea bed.
        obstacle: [n] to the surface of an obstacle, known or met; negative inside.

    What there is none of, or nowhere near, is infinitely far away.
    """

    coast: Array
    closed: Array
    bed: Array
    obstacle: Array

    @classmethod
    def of(cls, run: MissionRun, leg: LegRecord) -> "Margins":
        """Return those of a leg, whose records are its own; its ends count for as long as it stays there."""
        times, places, (tracks, radii) = leg.times, np.reshape(leg.positions, (-1, 3)), true_obstacles(leg)
        nothing = np.full(len(times), np.inf)
        if not len(times):
            return cls(nothing, nothing, nothing, nothing)
        samples = SampledTrack.of(times, places, tracks)
        record = np.clip(np.searchsorted(times, samples.times, side="right") - 1, 0, len(times) - 1)

        def least(values: Array) -> Array:
            found = nothing.copy()
            np.minimum.at(found, record, values)
            # The line to the next record ends there.
            arrivals = values[np.searchsorted(record, np.arange(1, len(times)))]
            return np.minimum(found, np.append(arrivals, np.inf))

        coast = bed = nothing
        if (chart := run.coast) is not None:
            land, corner = np.asarray(chart.passability) == 0.0, np.asarray(chart.lower, float)
            coast = Coast(land, corner, float(chart.pixel_size), run.coast_reach).distances(places)
        if run.seabed is not None:
            bed = least(np.asarray(run.seabed.altitude(samples.positions), float))
        near = [obstacle.distance(samples.positions, samples.times) for obstacle in run.obstacles]
        near += list((np.linalg.norm(samples.obstacles - samples.positions[:, None], axis=2) - radii).T)
        obstacle = least(np.min(near, axis=0)) if near else nothing
        every = coast, _to_closed(run, times, places), bed, obstacle
        found = cls(*(np.where(values < FAR, values, np.inf) for values in every))
        for end, begins, ends in leg.stays:
            known = (obstacle.closest(places[end], begins, ends)[1] for obstacle in run.obstacles)
            if (nearest := min(known, default=np.inf)) < FAR:
                found.obstacle[end] = min(found.obstacle[end], nearest)
            closed = _to_closed(run, np.array([begins, ends]), places[[end, end]]).min()
            found.closed[end] = min(found.closed[end], closed)
        return found

    @classmethod
    def joined(cls, parts: Sequence["Margins"]) -> "Margins":
        """Return those of legs in a row."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([np.zeros(0), *(getattr(p, name) for p in parts)]) for name in names))

    def least(self, part: slice = slice(None)) -> dict[str, float | None]:
        """Return the least of each on a part of the records; None of what there is none of."""
        found = {name: float(values[part].min(initial=np.inf)) for name, values in vars(self).items()}
        return {name: value if np.isfinite(value) else None for name, value in found.items()}


def _to_closed(run: MissionRun, times: Array, places: Array) -> Array:
    """[n] m from the line from each record to the next to areas that are closed then."""
    last = np.concatenate([places[1:], places[-1:]])
    lines = shapely.linestrings(np.stack([places, last], axis=1)[..., :2])
    until = np.append(times[1:], times[-1])
    found = np.full(len(times), np.inf)
    for zone in run.zones:
        found = np.minimum(found, shapely.distance(lines, zone.polygon))
    for closure in run.stated_closures:
        area = shapely.union_all([shapely.Polygon(ring) for ring in closure.rings])
        shut = np.any([(until >= begins) & (times <= ends) for begins, ends in closure.spans], axis=0)
        found = np.where(shut, np.minimum(found, shapely.distance(lines, area)), found)
    return found
