"""Ways around land and shallows between two places that no clear straight line joins."""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario

Array = NDArray[np.floating]

#: Cells along the longer side of the area, coarse first: narrower channels need smaller ones.
_CELLS = (150, 500)
#: Samples of a straight line.
_SAMPLES = 200
#: A second near land counts so many times, fading over this share of the area's longer side.
_SHUN, _FADES = 3.0, 0.01


def room(positions: Array, gap: float | Array, scenario: Scenario, area: OperatingArea) -> Array:
    """Distance [m] to what a straight line may not come near, at places [..., 2]; positive where it is clear.

    Args:
        positions: north and east, m.
        gap: m, around each place within which the sea bed is looked up.
        scenario: the clearances.
        area: chart and sea bed.
    """
    x, y = positions[..., 0], positions[..., 1]
    free = np.full(x.shape, np.inf)
    if area.chart is not None:
        free = np.asarray(area.chart.distance(x, y)) - 0.3 * scenario.mission.waypoint_clearance
    if area.seabed is not None:
        shallowest = np.asarray(area.seabed.shallowest_at(x, y, gap))
        deep_enough = shallowest - float(area.seabed.clearance) - scenario.box[0][2]
        free = np.minimum(free, np.where(deep_enough > 0.0, np.inf, deep_enough))
    return free


def clear_lines(starts: Array, ends: Array, scenario: Scenario, area: OperatingArea) -> NDArray[np.bool_]:
    """Return whether the straight lines between places [..., 3] m keep clear of coast and shallows, [...]."""
    share = np.linspace(0.0, 1.0, _SAMPLES).reshape(-1, *(1,) * max(np.ndim(starts), np.ndim(ends)))
    line = starts * (1.0 - share) + ends * share
    gap = np.hypot(*np.moveaxis(line[1] - line[0], -1, 0)[:2])
    return np.asarray((room(line, gap, scenario, area) > 0.0).all(axis=0))


class WaysAround:
    """Finds ways around land and shallows over a grid of the area."""

    def __init__(self, scenario: Scenario, area: OperatingArea) -> None:
        self._scenario, self._area = scenario, area

    def __call__(self, start: Array, goal: Array) -> Array | None:
        """Return waypoints [K, 3] m that clear straight lines join to each other and to both ends; or None.

        Args:
            start: [3] m, north, east, depth.
            goal: [3] m.
        """
        for grid in (self._coarse, self._fine):
            cells = grid.path(start, goal)
            if cells is not None and (way := self._pulled(start, goal, cells)) is not None:
                return way
        return None

    @cached_property
    def _coarse(self) -> "_Grid":
        return _Grid(self._scenario, self._area, _CELLS[0])

    @cached_property
    def _fine(self) -> "_Grid":
        return _Grid(self._scenario, self._area, _CELLS[1])

    def _pulled(self, start: Array, goal: Array, cells: Array) -> Array | None:
        """Return the corners of a path over cells [C, 2] m, each as far along it as a clear line leads."""
        share = np.linspace(0.0, 1.0, len(cells) + 2)[1:-1, None]
        depths = start[2] * (1.0 - share) + goal[2] * share
        if self._area.seabed is not None:
            shallowest = np.asarray(self._area.seabed.shallowest_at(cells[:, 0], cells[:, 1], 0.0))
            deepest = shallowest - float(self._area.seabed.clearance) - 0.5
            depths = np.minimum(depths, np.maximum(deepest, self._scenario.box[0][2])[:, None])
        places = np.concatenate([np.concatenate([cells, depths], axis=1), np.asarray(goal)[None]])
        way, here, at = [], np.asarray(start), -1
        while at < len(places) - 1:
            ahead = places[at + 1 :]
            seen = np.flatnonzero(clear_lines(here[None], ahead, self._scenario, self._area))
            if not seen.size:
                return None
            at += 1 + int(seen[-1])
            here = places[at]
            way.append(here)
        return np.array(way[:-1]).reshape(-1, 3)


class _Grid:
    """Cells of the area that a vehicle may pass, and moves between neighbours."""

    def __init__(self, scenario: Scenario, area: OperatingArea, cells: int) -> None:
        low, high = (np.asarray(corner[:2], float) for corner in scenario.box)
        self._size = float((high - low).max()) / cells
        north, east = (max(int(np.ceil(side / self._size - 1e-9)), 1) for side in high - low)
        self._shape = north, east
        index = np.indices(self._shape).reshape(2, -1).T
        self._places = np.minimum(low + (index + 0.5) * self._size, high)
        free = room(self._places, self._size, scenario, area)
        fades = _FADES * float((high - low).max())
        self._shunned = 1.0 + _SHUN * np.exp(-np.clip(free, 0.0, None) / fades)
        self._open = free > 0.0

    @cached_property
    def _moves(self) -> csr_array:
        number = np.arange(len(self._places)).reshape(self._shape)
        ends = []
        for a, b in ((1, 0), (0, 1), (1, 1), (1, -1)):
            here = number[: self._shape[0] - a, max(0, -b) : self._shape[1] - max(0, b)]
            there = number[a:, max(0, b) : self._shape[1] - max(0, -b)]
            ends.append(np.stack([here.ravel(), there.ravel()]))
        i, j = np.concatenate(ends, axis=1)
        kept = self._open[i] & self._open[j]
        i, j = i[kept], j[kept]
        length = np.linalg.norm(self._places[i] - self._places[j], axis=1)
        costs = length * 0.5 * (self._shunned[i] + self._shunned[j])
        return csr_array((costs, (i, j)), shape=(number.size,) * 2)

    @cached_property
    def _water(self) -> NDArray[np.int_]:
        """Number of the body of water that each cell belongs to."""
        return connected_components(self._moves, directed=False)[1]

    def path(self, start: Array, goal: Array) -> Array | None:
        """Return the open cells [C, 2] m of the shortest way between two places; None where there is none."""
        first, last = (self._nearest_open(np.asarray(place)[:2]) for place in (start, goal))
        if first is None or last is None or self._water[first] != self._water[last]:
            return None
        _, before = dijkstra(self._moves, directed=False, indices=first, return_predecessors=True)
        nodes = [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        return self._places[nodes[::-1]]

    def _nearest_open(self, place: Array) -> int | None:
        """Return the open cell nearest to a place, of those within two cells; None without one."""
        away = np.where(self._open, np.linalg.norm(self._places - place, axis=1), np.inf)
        nearest = int(np.argmin(away))
        return nearest if away[nearest] <= 3.0 * self._size else None
