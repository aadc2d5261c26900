"""The checker's own measure of how survey lines were followed. Plain NumPy."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from auvplan.check.inputs import Job
from auvplan.check.saved import Array, Leg, Saved
from auvplan.runtime.files import MISSION, SUMMARY

#: m, longest step along a track at which its distance from the line is looked up.
_STEP = 0.5
#: m by which lengths and distances may differ from what is measured here.
LENGTH_TOLERANCE = 0.5
_FIELDS = "length", "tolerance", "covered", "across_mean", "across_worst"


def covered(positions: Array, start: Array, end: Array, tolerance: float) -> tuple[float, float, float]:
    """M of a straight line that a track [n, 3] m covers, and its mean and greatest distance off it there."""
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    counts = np.maximum(np.ceil(gaps / _STEP), 1.0).astype(int)
    place = np.concatenate([k + np.arange(count) / count for k, count in enumerate(counts)] + [[len(gaps)]])
    fine = np.stack([np.interp(place, np.arange(len(positions)), axis) for axis in positions.T], axis=1)
    length = float(np.linalg.norm(end - start))
    unit = (end - start) / length
    along = (fine - start) @ unit
    off = np.linalg.norm(fine - start - along[:, None] * unit, axis=1)
    # Where a step leaves the line's neighbourhood it counts up to there.
    change = np.diff(off)
    share = np.clip((tolerance - off[:-1]) / np.where(change == 0.0, np.inf, change), 0.0, 1.0)
    first, last = off[:-1] <= tolerance, off[1:] <= tolerance
    crossing = along[:-1] + share * np.diff(along)
    begins, ends = np.where(first, along[:-1], crossing), np.where(last, along[1:], crossing)
    low, high = np.clip(np.sort(np.stack([begins, ends]), axis=0), 0.0, length)
    passed = (first | last) & (high > low)
    if not passed.any():
        return 0.0, 0.0, 0.0
    low, high = low[passed], high[passed]
    order = np.argsort(low)
    reached = np.maximum.accumulate(np.concatenate([[0.0], high[order]]))[:-1]
    total = float(np.maximum(high[order] - np.maximum(low[order], reached), 0.0).sum())
    middle = np.minimum(0.5 * (off[:-1] + off[1:]), tolerance)[passed]
    worst = np.minimum(np.maximum(off[:-1], off[1:]), tolerance)[passed].max()
    return total, float((middle * (high - low)).sum() / (high - low).sum()), float(worst)


def measured(run: Saved, leg: Leg) -> tuple[float, ...] | None:
    """Return `_FIELDS` of a leg that follows a survey line, measured on its track; None of others."""
    if "leg_line_tolerance" not in run or not leg.executed:
        return None
    tolerance = float(run["leg_line_tolerance"][leg.number])
    if np.isnan(tolerance) or not all(0 <= node < len(run.places) for node in (leg.start, leg.goal)):
        return None
    start, end = run.places[leg.start], run.places[leg.goal]
    return float(np.linalg.norm(end - start)), tolerance, *covered(leg.positions, start, end, tolerance)


def share_of_line(run: Saved, leg: Leg) -> float:
    """Return the share of its part of a survey line that a leg covers; 1 where it follows none."""
    found = measured(run, leg)
    if found is None:
        return 1.0
    length, _, passed, *_ = found
    return 1.0 if length - passed <= LENGTH_TOLERANCE / 2.0 else passed / length


def line_faults(run: Saved) -> Iterator[str]:
    """Yield what is said of survey lines that the track does not bear out."""
    asked = run.section("mission").get("line_tolerance")
    for leg, row in zip(run.legs, run.summary["legs"], strict=False):
        found, stated = measured(run, leg), row.get("line")
        if found is None:
            if stated is not None and leg.executed:
                yield f"{leg}: follows a survey line by {SUMMARY}, none by {MISSION}"
            continue
        if asked is not None and abs(found[1] - asked) > 1e-6:
            yield f"{leg}: line_tolerance is {asked:g} m, the leg is measured with {found[1]:g} m"
        for name, value in zip(_FIELDS, found, strict=True):
            given = {MISSION: float(run[f"leg_line_{name}"][leg.number])}
            if stated is not None:
                given[SUMMARY] = float(stated[name])
            for source, figure in given.items():
                if not abs(figure - value) <= LENGTH_TOLERANCE:
                    yield f"{leg}: line_{name} is {figure:.1f} m in {source}, {value:.1f} m by the track"


def line_of(jobs: list[Job], leg: Leg) -> Job | None:
    """Return the survey line along which a leg leads from vertex to vertex, or None."""
    ends = {leg.start, leg.goal}
    return next((job for job in jobs if any(ends == set(part) for part in pairwise(job.nodes))), None)
