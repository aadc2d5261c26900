"""The vertical section along a path: current, sea bed and obstacles, as they are when it passes them."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from auvplan.ocean.currents import evaluated
from auvplan.ocean.seabed import Seabed
from auvplan.path.plan import PathPlan
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.runtime.arrays import Array
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.world import KNOWN
from auvplan.view.scene import as_filed, grown, planned_obstacles, shown_obstacles, track_at, true_obstacles

Velocity = Callable[..., Sequence[Array]]

#: Rows of the raster, its columns in all and on a path at least, and places to a column.
_ROWS, _COLUMNS, _FEWEST, PARTS = 32, 360, 10, 4
#: m and m/s: what differs by less with depth does not differ.
_LEVEL, _SHEAR = 1.0, 0.02
#: A section reaches at most so far below the deepest place of the path: a factor and m.
_BELOW = 6.0, 60.0
#: m; no water is deeper.
_DEEP = 12_000.0
#: Beside where vehicles may go, as much of the sea bed's depth is shown.
_BEDS = 1.6


@dataclass(frozen=True)
class Cut:
    """An obstacle as a section cuts it at its k places, at the time at which each is passed.

    Attributes:
        kind: as `LegRecord.obstacle_kinds` has it, "known", or "obstacle".
        solid: [2, k] m, depth of its top and its bottom; NaN where it is not cut.
        boundary: [2, k] m, the same of its collision boundary, as it has grown by then.
    """

    kind: str
    solid: Array
    boundary: Array


@dataclass(frozen=True)
class Section:
    """A vertical section along a path, at k places in equal distances, from the beginning of the first leg.

    Attributes:
        distance: [k] m in the plan view, rising.
        time: [k] s, when the path is there.
        depth: [m + 1] m, rising, edges of the raster's rows.
        along: [m, n] m/s, current along the path in cells from each `PARTS`-th place to the next, when it is
            passed; against the path it is negative.
        shear: m/s, greatest difference of the current between two depths above the bed.
        bed: [k] m, depth of the sea bed; None where it is not known.
        path: [r, 2] m, distance and depth.
        earlier: [s, 2] m, the same of each plan that was given up. From where it was made it is laid over
            the rest of the path by the share of its length.
        cuts: obstacles.
        leg: that it is of; None of a path alone.
    """

    distance: Array
    time: Array
    depth: Array
    along: Array
    shear: float
    bed: Array | None
    path: Array
    earlier: tuple[Array, ...]
    cuts: tuple[Cut, ...]
    leg: LegRecord | None


@dataclass(frozen=True)
class _Path:
    """`row`, `times` [r], `places` [r, 3] as given; `distance`, `time` [k], `at` [k, 3] as sampled."""

    row: Array
    times: Array
    places: Array
    distance: Array
    time: Array
    at: Array

    @classmethod
    def of(cls, times: Array, places: Array, cells: int, begin: float = 0.0) -> "_Path":
        places = as_filed(places)
        row = begin + _arc(places)
        distance = np.linspace(row[0], row[-1], PARTS * cells + 1)
        time, *axes = (np.interp(distance, row, values) for values in (times, *places.T))
        return cls(row, np.asarray(times, float), places, distance, time, np.stack(axes, axis=1))

    @property
    def line(self) -> Array:
        """[r, 2] m, distance and depth."""
        return np.stack([self.row, self.places[:, 2]], axis=1)


def _arc(places: Array) -> Array:
    """[r] m in the plan view from the first of places [r, 3] m."""
    return np.append(0.0, np.cumsum(np.linalg.norm(np.diff(places[:, :2], axis=0), axis=1)))


def plan_section(plan: PathPlan) -> Section | None:
    """Return the section along a planned path; None where nothing in it differs with depth."""
    world = plan.conditions.world()
    path = _Path.of(np.asarray(plan.times, float), plan.positions, _COLUMNS // 2)
    met = planned_obstacles(world, path.time)
    cuts = [_cut("obstacle", path, one.track, one.radius, one.boundary) for one in met]

    def velocity(*where: Array) -> Sequence[Array]:
        return evaluated(world.current, *where)

    reach = float(world.lower[2]), float(world.upper[2])
    return next(iter(_sections([(None, path, velocity, cuts)], world.seabed, reach)), None)


def run_sections(run: MissionRun) -> list[Section]:
    """Return the sections along the executed legs in a row; none where nothing differs with depth."""
    legs = [(leg, _arc(leg.positions)[-1]) for leg in run.legs if len(leg.times) > 1]
    total = sum(length for _, length in legs)
    parts, begin = [], 0.0
    for leg, length in legs:
        if length > 0.0:
            cells = max(_FEWEST, round(_COLUMNS * length / total))
            path = _Path.of(leg.times, leg.positions, cells, begin)
            parts.append((leg, path, true_current(leg.plans), _leg_cuts(run, leg, path)))
            begin += length
    lower, upper = Scenario.model_validate(dict(run.scenario)).box
    return _sections(parts, run.seabed, (lower[2], upper[2]))


def _sections(
    parts: Sequence[tuple[LegRecord | None, _Path, Velocity, Sequence[Cut]]],
    seabed: Seabed | None,
    reach: tuple[float, float],
) -> list[Section]:
    """Sections of parts, with rows in common, within a `reach` of depths, m; none where nothing differs."""
    if not parts or reach[0] >= reach[1]:
        return []
    beds = [None if seabed is None else seabed.altitude(path.at * [1.0, 1.0, 0.0]) for _, path, *_ in parts]
    lines = [line for leg, path, *_ in parts for line in (path.line, *_earlier(leg, path))]
    levels = np.concatenate([line[:, 1] for line in lines])
    depth = np.linspace(min(0.0, levels.min()), _floor(float(levels.max()), reach[1], beds), _ROWS + 1)
    found = [_section(*part, depth, bed) for part, bed in zip(parts, beds, strict=True)]
    sheared = max(section.shear for section in found) > _SHEAR
    return found if seabed is not None or sheared or np.ptp(levels) > _LEVEL else []


def _floor(deepest: float, reach: float, beds: Sequence[Array | None]) -> float:
    """Return how deep sections reach, m: as the vehicle and, where it is in sight, the sea bed."""
    floor = reach if np.isfinite(reach) else 1.3 * deepest
    known = [float(bed.max()) for bed in beds if bed is not None]
    if known:
        floor = min(1.05 * max(known), _BEDS * floor)
    return max(min(floor, _BELOW[0] * deepest + _BELOW[1]), 1.1 * deepest + 5.0)


def _section(
    leg: LegRecord | None,
    path: _Path,
    velocity: Velocity,
    cuts: Sequence[Cut],
    depth: Array,
    bed: Array | None,
) -> Section:
    """Return one section: the current is looked up in the middle of each cell."""
    middle = slice(PARTS // 2, None, PARTS)
    step = np.diff(path.at[::PARTS, :2], axis=0)
    course = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    levels = 0.5 * (depth[:-1] + depth[1:])
    shape = len(levels), len(step)
    x, y, t = (np.broadcast_to(values, shape) for values in (*path.at[middle, :2].T, path.time[middle]))
    u, v, _ = velocity(x, y, np.broadcast_to(levels[:, None], shape), t)
    water = np.isfinite(u) & (True if bed is None else levels[:, None] < bed[middle])
    both = np.stack([u, v], axis=-1)
    shear = [np.ptp(both[rows, k], axis=0).max() for k, rows in enumerate(water.T) if rows.any()]
    cuts = tuple(cut for cut in cuts if np.isfinite(cut.boundary).any())
    along, steepest = u * course[:, 0] + v * course[:, 1], float(max(shear, default=0.0))
    earlier = _earlier(leg, path)
    return Section(path.distance, path.time, depth, along, steepest, bed, path.line, earlier, cuts, leg)


def _cut(kind: str, path: _Path, centre: Array, radius: float, grown: ArrayLike) -> Cut:
    """Return where the vertical below and above each place of a path cuts a sphere [k, 3] m."""
    apart = ((centre - path.at)[:, :2] ** 2).sum(axis=1)

    def ends(size: ArrayLike) -> Array:
        rest = np.broadcast_to(np.square(size), apart.shape) - apart
        half = np.sqrt(np.where(rest >= 0.0, rest, np.nan))
        return np.stack([centre[:, 2] - half, centre[:, 2] + half])

    return Cut(kind, ends(radius), ends(grown))


def _leg_cuts(run: MissionRun, leg: LegRecord, path: _Path) -> list[Cut]:
    """Obstacles of a leg, the true ones, and those known beforehand, upright cylinders."""
    (tracks, radii), margins = true_obstacles(leg), grown(run, leg, path.time)
    found = []
    for m, number in enumerate(shown_obstacles(leg)):
        centre = track_at(leg, tracks[:, m], path.time)
        found.append(_cut(leg.obstacle_kinds[number], path, centre, radii[m], radii[m] + margins[:, m]))
    for known in run.obstacles:
        centre = np.asarray(known.position) + path.time[:, None] * np.asarray(known.velocity)
        inside = np.linalg.norm(centre - path.at[:, :2], axis=1) < known.radius
        ends = np.where(inside, np.minimum([[known.depth_min], [known.depth_max]], _DEEP), np.nan)
        found.append(Cut(KNOWN, ends, ends))
    return found


def true_current(plans: Iterable[PlanRecord]) -> Velocity:
    """Return the current of the latest plan, on arrays of north, east, depth, m, and time, s."""
    plans = sorted(plans, key=lambda plan: plan.made_at)
    made = [plan.made_at for plan in plans]

    def velocity(*where: Array) -> Sequence[Array]:
        found = np.full((3, *where[0].shape), np.nan)
        latest = np.maximum(np.searchsorted(made, where[3] + 1e-3, side="right") - 1, 0)
        for number in np.unique(latest) if plans else ():
            here = latest == number
            found[:, here] = evaluated(plans[number].current, *(values[here] for values in where))
        return tuple(found)

    return velocity


def _earlier(leg: LegRecord | None, path: _Path) -> tuple[Array, ...]:
    """Plans of a leg that were given up, [s, 2] m distance and depth each."""
    if leg is None:
        return ()
    found = []
    for number, plan in enumerate(leg.plans):
        if number not in leg.followed_numbers[-1:]:
            places = as_filed(plan.positions)
            arc = _arc(places)
            begin = float(np.interp(plan.made_at, path.times, path.row))
            share = arc / max(arc[-1], 1e-9)
            found.append(np.stack([begin + share * (path.row[-1] - begin), places[:, 2]], axis=1))
    return tuple(found)
