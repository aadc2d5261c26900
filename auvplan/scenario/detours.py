"""Ways around land, shallows and closed areas between two places that no clear straight line joins."""

from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from auvplan.path.passages import SURROUNDINGS
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario

Array = NDArray[np.floating]

#: Cells along the longer side of the area, coarse first: narrower channels need smaller ones.
_CELLS = (150, 500)
#: Samples of a straight line, and how many of them are looked up together, then where these may not be clear.
_SAMPLES, _TOGETHER = 200, (25, 5, 1)
#: m/m, by which a distance that is interpolated between pixels changes at most.
_SLOPE = 1.01 * np.sqrt(2.0)
#: A second near land counts this many times, fading over this share of the area's longer side.
_SHUN, _FADES = 3.0, 0.01
#: Rounds that pull a path taut, and shares of each leg between which corners are cut off.
_ROUNDS = 6
_CUTS = np.array([0.5**5, 0.5**4, 0.5**3, 0.25, 0.5, 0.75, 1 - 0.5**3, 1 - 0.5**4, 1 - 0.5**5])[None, :, None]
#: Share of a path's length within which the sea bed is looked up around places of a taut one, and sides of a
#: cell within which it is around the cells that it leads over.
_WINDOW, _WIDER = 1.0 / 100.0, 1.5
#: A round that shortens a path by less than this share is the last.
_SETTLED = 1e-4


@dataclass(frozen=True, eq=False)
class Clearance:
    """What straight lines keep clear of."""

    scenario: Scenario  # the box and the clearance of the sea bed
    area: OperatingArea  # chart, sea bed and closed areas
    margin: float  # m, to the coast
    closed: bool = False  # whether areas that are closed at some hours count as coast
    window: float = 0.0  # m, least length around a place within which the sea bed is looked up

    def room(self, x: Array, y: Array, gap: Array) -> Array:
        """Distance [m] to what a line may not come near; positive where it is clear.

        Args:
            x, y: north and east, m, of one shape.
            gap: m, around each place within which the sea bed is looked up; of a shape that broadcasts.
        """
        water = self._over_the_bed(x, y, gap)[0]
        return np.minimum(self._off_the_coast(x, y, gap)[0], np.where(water > 0.0, np.inf, water))

    def lines(self, starts: Array, ends: Array) -> NDArray[np.bool_]:
        """Return whether the straight lines between places [..., 3] m keep clear, [...].

        A line is clear where `_SAMPLES` places on it are. One look-up can show it of many in a row; where it
        does not, shorter rows are looked up.
        """
        starts, ends = np.broadcast_arrays(starts, ends)
        shape, (x0, y0), (x1, y1) = starts.shape[:-1], starts.reshape(-1, 3).T[:2], ends.reshape(-1, 3).T[:2]
        gap = np.hypot(x1 - x0, y1 - y0) / (_SAMPLES - 1)
        clear, shares = np.ones(gap.shape, bool), np.linspace(0.0, 1.0, _SAMPLES)
        for room in (self._off_the_coast, self._over_the_bed):
            line, first = (part.ravel() for part in np.mgrid[: gap.size, : _SAMPLES : _TOGETHER[0]])
            for count, fewer in zip(_TOGETHER, (*_TOGETHER[1:], 1), strict=True):
                line, first = line[clear[line]], first[clear[line]]
                share = shares[first + count // 2]
                x, y = (a[line] * (1.0 - share) + b[line] * share for a, b in ((x0, x1), (y0, y1)))
                here, around = room(x, y, gap[line], count // 2)
                clear[line[here <= 0.0]] = False
                line, first, parts = line[around <= 0.0], first[around <= 0.0], np.arange(0, count, fewer)
                line, first = np.repeat(line, len(parts)), (first[:, None] + parts).ravel()
        return clear.reshape(shape)

    def _off_the_coast(self, x: Array, y: Array, gap: Array, around: int = 0) -> tuple[Array, Array]:
        """Distance to coast and closed areas less the margin, m: there, and at least `around` gaps about."""
        free = np.full(x.shape, np.inf)
        charts = [closure.chart for closure in self.area.closures] if self.closed else []
        for chart in charts if self.area.chart is None else [self.area.chart, *charts]:
            free = np.minimum(free, np.asarray(chart.distance(x, y)) - self.margin)
        return free, free - _SLOPE * around * gap

    def _over_the_bed(self, x: Array, y: Array, gap: Array, around: int = 0) -> tuple[Array, Array]:
        """Depth of the water over the sea bed and its clearance, m; as `_off_the_coast`.

        Where all is deep around, the first is the second.
        """
        if (seabed := self.area.seabed) is None:
            return np.full(x.shape, np.inf), np.full(x.shape, np.inf)
        taken, window = float(seabed.clearance) + self.scenario.box[0][2], np.maximum(gap, self.window)
        if not around:
            water = np.asarray(seabed.shallowest_at(x, y, window)) - taken
            return water, water
        # What a look-up takes in is within three halves of its window, or of a pixel.
        wide = 2 * around * gap + 3.0 * np.maximum(window, float(seabed.pixel_size))
        least = np.asarray(seabed.shallowest_at(x, y, wide)) - taken
        here, low = least.copy(), least <= 0.0
        here[low] = self._over_the_bed(x[low], y[low], gap[low])[0]
        return here, least


def clear_lines(starts: Array, ends: Array, scenario: Scenario, area: OperatingArea) -> NDArray[np.bool_]:
    """Return whether the straight lines between places [..., 3] m keep clear of coast and shallows, [...]."""
    return Clearance(scenario, area, 0.3 * scenario.mission.waypoint_clearance).lines(starts, ends)


class DetourFinder:
    """Finds detours around land, shallows and closed areas over a grid of the area."""

    def __init__(self, scenario: Scenario, area: OperatingArea) -> None:
        self._scenario, self._area = scenario, area
        self._roomy = Clearance(scenario, area, 0.3 * scenario.mission.waypoint_clearance)
        self._tight = [
            Clearance(scenario, area, scenario.safety.coast, closed)
            for closed in ((False, True) if area.closures else (False,))
        ]
        self._grid, self._known = cache(_Grid), dict[bytes, list[tuple[Array, bool]]]()

    def __call__(self, start: Array, goal: Array) -> Array | None:
        """Return waypoints [K, 3] m that clear straight lines join to each other and to both ends; or None.

        Args:
            start: [3] m, north, east, depth.
            goal: [3] m.
        """
        line = self._path(start, goal, self._roomy)
        return None if line is None else line[1:-1]

    def paths(self, start: Array, goal: Array) -> list[tuple[Array, bool]]:
        """Return taut polylines [K, 3] m from the one place to the other that have corners.

        All keep clear of the coast; beside each stands whether it keeps clear of areas as well that are
        closed at some hours. What leads farther off than the path planner looks is left out.
        """
        return [(line, clear) for line, clear in self._taut_lines(start, goal) if len(line) > 2]

    def length(self, start: Array, goal: Array) -> float:
        """Return the length of the shortest path clear of the coast, m; infinite where there is none.

        Arguments as for `paths`.
        """
        return min((_length(line) for line, _ in self._taut_lines(start, goal)), default=np.inf)

    def _taut_lines(self, start: Array, goal: Array) -> list[tuple[Array, bool]]:
        key, back = (np.stack(ends).tobytes() for ends in ((start, goal), (goal, start)))
        if back in self._known:
            return [(line[::-1], clear) for line, clear in self._known[back]]
        if key not in self._known:
            taut = [(self._path(start, goal, clearance, True), clearance.closed) for clearance in self._tight]
            always = not self._area.closures
            self._known[key] = [
                (line, always or closed) for line, closed in taut if line is not None and _near(line)
            ]
        return self._known[key]

    def _path(self, start: Array, goal: Array, clearance: Clearance, taut: bool = False) -> Array | None:
        """Return a polyline [K, 3] m between two places, over the coarsest grid that has one.

        One that is `taut` keeps off banks as paths must that are timed at samples, where it can.
        """
        off_banks = taut and self._area.seabed is not None
        for wider, size in product((_WIDER, 1.0) if off_banks else (1.0,), _CELLS):
            cells = self._grid(clearance, size, wider).path(start, goal)
            if cells is None:
                continue
            kept = [replace(clearance, window=_WINDOW * _length(cells))] if off_banks else []
            kept.append(clearance)
            if (line := self._pulled(start, goal, cells, kept)) is not None:
                return _taut(line, kept[0]) if taut else line
        return None

    def _pulled(self, start: Array, goal: Array, cells: Array, clearances: list[Clearance]) -> Array | None:
        """Return the corners of a path over cells [C, 2] m, each as far along it as a clear line leads.

        Lines are clear by the first of the clearances by which any leads on.
        """
        share = np.linspace(0.0, 1.0, len(cells) + 2)[1:-1, None]
        depths = start[2] * (1.0 - share) + goal[2] * share
        if self._area.seabed is not None:
            shallowest = np.asarray(self._area.seabed.shallowest_at(cells[:, 0], cells[:, 1], 0.0))
            deepest = shallowest - float(self._area.seabed.clearance) - 0.5
            depths = np.minimum(depths, np.maximum(deepest, self._scenario.box[0][2])[:, None])
        places = np.concatenate([np.concatenate([cells, depths], axis=1), np.asarray(goal)[None]])
        line, at = [np.asarray(start)], -1
        while at < len(places) - 1:
            ahead = places[at + 1 :]
            lines = (np.flatnonzero(clearance.lines(line[-1][None], ahead)) for clearance in clearances)
            seen = next((found for found in lines if found.size), None)
            if seen is None:
                return None
            at += 1 + int(seen[-1])
            line.append(places[at])
        return np.array(line)


def _taut(line: Array, clearance: Clearance) -> Array:
    """Return a clear polyline [K, 3] m pulled taut: corners are cut off as far as clear lines lead."""
    for _ in range(_ROUNDS):
        length = _length(line)
        between = line[:-1, None] * (1.0 - _CUTS) + line[1:, None] * _CUTS
        places = np.concatenate(
            [np.concatenate([line[:-1, None], between], axis=1).reshape(-1, 3), line[-1:]]
        )
        i, j = np.triu_indices(len(places), 1)
        leg = 1 + _CUTS.shape[1]
        clear = j <= (i // leg + 1) * leg
        clear[~clear] = clearance.lines(places[i[~clear]], places[j[~clear]])
        gaps = np.maximum(np.linalg.norm(places[j] - places[i], axis=1), 1e-9)
        lines = csr_array((gaps[clear], (i[clear], j[clear])), shape=(len(places),) * 2)
        before, nodes = dijkstra(lines, indices=0, return_predecessors=True)[1], [len(places) - 1]
        while nodes[-1]:
            nodes.append(int(before[nodes[-1]]))
        line = _corners(places[nodes[::-1]])
        if _length(line) > (1.0 - _SETTLED) * length:
            break
    return line


def _corners(line: Array) -> Array:
    """Return a polyline without the corners that lie on the line between their neighbours."""
    kept = [0]
    for corner in range(1, len(line) - 1):
        before, here, after = line[kept[-1]], line[corner], line[corner + 1]
        chord = np.linalg.norm(after - before)
        if np.linalg.norm(here - before) + np.linalg.norm(after - here) > chord + 1e-4:
            kept.append(corner)
    return line[[*kept, len(line) - 1]]


def _length(line: Array) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


def _near(line: Array) -> bool:
    """Return whether a polyline stays within what the path planner looks at between its ends."""
    ends = line[[0, -1], :2]
    beyond = SURROUNDINGS * float(np.linalg.norm(line[-1] - line[0]))
    low, high = ends.min(axis=0) - beyond, ends.max(axis=0) + beyond
    return bool(((line[:, :2] >= low) & (line[:, :2] <= high)).all())


class _Grid:
    """Cells of the area that a vehicle may pass, and moves between neighbours."""

    def __init__(self, clearance: Clearance, cells: int, wider: float) -> None:
        low, high = (np.asarray(corner[:2], float) for corner in clearance.scenario.box)
        self._size = float((high - low).max()) / cells
        north, east = (max(int(np.ceil(side / self._size - 1e-9)), 1) for side in high - low)
        self._shape = north, east
        index = np.indices(self._shape).reshape(2, -1).T
        self._places = np.minimum(low + (index + 0.5) * self._size, high)
        gap = np.full(len(self._places), wider * self._size)
        free = clearance.room(self._places[:, 0], self._places[:, 1], gap)
        fades = _FADES * float((high - low).max())
        self._shunned = 1.0 + _SHUN * np.exp(-np.clip(free, 0.0, None) / fades)
        self._open = free > 0.0
        self._before = cache(
            lambda first: dijkstra(self._moves, directed=False, indices=first, return_predecessors=True)[1]
        )

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
        """Return the open cells [C, 2] m of the shortest path between two places; None if none."""
        away = [np.linalg.norm(self._places - np.asarray(place)[:2], axis=1) for place in (start, goal)]
        away = np.where(self._open, away, np.inf)
        first, last = away.argmin(axis=1).tolist()  # the nearest open cells, of those within two cells
        if (away.min(axis=1) > 3.0 * self._size).any() or self._water[first] != self._water[last]:
            return None
        before, nodes = self._before(first), [last]
        while nodes[-1] != first:
            nodes.append(int(before[nodes[-1]]))
        return self._places[nodes[::-1]]
