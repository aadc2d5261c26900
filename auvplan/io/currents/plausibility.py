"""Plausibility of a current that was read: hours and places without values, gaps, odd speeds."""

import warnings
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from auvplan.errors import ScenarioWarning
from auvplan.io.currents.files import Array
from auvplan.io.currents.ocean import OceanData
from auvplan.io.currents.times import stamp
from auvplan.ocean.gridded import CurrentError

#: A time that lacks this share of the water of other times is missing.
_LOST = 0.5
#: So many usual steps between two times are a gap.
_GAP = 1.5
#: Water that is faster, m/s, is hardly known; and none is as still everywhere.
_FAST, _STILL = 6.0, 1e-6


def check_times(ocean: OceanData, frames: slice) -> None:
    """Warn of a gap between the times that were read.

    Warns:
        ScenarioWarning: two neighbours are farther apart than the usual step of the files.
    """
    steps, usual = np.diff(ocean.times), 0.0
    if len(steps) > 1:
        usual = float(np.median(steps))
    wide = [k for k in range(frames.start, frames.stop - 1) if usual and steps[k] > _GAP * usual]
    if wide:
        k = max(wide, key=lambda k: steps[k])
        more = f", and in {len(wide) - 1} more gaps" if len(wide) > 1 else ""
        _warn(
            ocean.label,
            f"has no current between {stamp(ocean.times[k])} and {stamp(ocean.times[k + 1])}{more}, "
            f"{steps[k] / 3600.0:.3g} h where its usual step is {usual / 3600.0:.3g} h: it is interpolated",
        )


def check_values(
    ocean: OceanData,
    frames: slice,
    depths: Array,
    u: Array,
    v: Array,
    place: Callable[[int, int], str],
) -> None:
    """Refuse times without values, and warn of places without them and of speeds that are hardly the sea's.

    Args:
        ocean: the files.
        frames: the times that were read.
        depths: [D] m.
        u, v: [T, D, X, Y] m/s, NaN where there is no value.
        place: of a node, as a message names it.

    Raises:
        CurrentError: a time lacks half or more of the water that other times have.

    Warns:
        ScenarioWarning: nodes that have a current at some times only, or below a depth where they have none;
            speeds that are hardly known of the sea, or none at all.
    """
    known = np.isfinite(u) & np.isfinite(v)
    ever = known.any(axis=0)
    gone = ever & ~known
    lost = gone.sum(axis=(1, 2, 3)) / max(int(ever.sum()), 1)
    moments = ocean.times[frames]
    missing = np.flatnonzero(lost >= _LOST)
    if len(missing):
        first = int(missing[0])
        file = ocean.form["file"].values[frames][first]
        more = f" and at {len(missing) - 1} other of {len(moments)} times" if len(missing) > 1 else ""
        raise CurrentError(
            f"{file}: at {stamp(float(moments[first]))}{more} the current is missing in {lost[first]:.0%} of "
            "the water that other times have: take such times out of the file, or fetch it anew"
        )
    if ocean.levels is None:  # the tide lifts and lowers the bed among the depths
        gone[:, 1:] &= ~known[:, :-1]
    water: NDArray[np.bool_] = np.asarray(ever.any(axis=0))
    at_times: NDArray[np.bool_] = np.asarray(gone.any(axis=(0, 1)))
    if at_times.any():
        first = int(np.flatnonzero(gone.any(axis=(1, 2, 3)))[0])
        _warn(
            ocean.label,
            f"{percent(at_times, water)} of the area's water has a current at some times only, such as "
            f"{_named(at_times, place)}, first missing at {stamp(float(moments[first]))}: the nearest "
            "water's is taken there",
        )
    under = ~known[:, :-1] & known[:, 1:] & ~gone[:, :-1]
    beneath: NDArray[np.bool_] = np.asarray(under.any(axis=(0, 1)))
    if beneath.any():
        level = int(np.flatnonzero(under.any(axis=(0, 2, 3)))[0])
        _warn(
            ocean.label,
            f"{percent(beneath, water)} of the area's water has no current at {depths[level]:g} m depth "
            f"though there is one below it, such as {_named(beneath, place)}: the nearest water's is "
            "taken there",
        )
    fastest = float(np.sqrt(np.nanmax(np.square(u) + np.square(v))))
    if fastest > _FAST:
        _warn(ocean.label, f"the current reaches {fastest:.1f} m/s, more than the sea's: are its units m/s?")
    elif fastest < _STILL:
        _warn(ocean.label, "the current is 0 everywhere in the area at all times")


def percent(nodes: NDArray[np.bool_], of: NDArray[np.bool_] | None = None) -> str:
    """Return the share of nodes that are true, of all or of those that others are true for, in per cent."""
    share = nodes.sum() / max(nodes.size if of is None else int(of.sum()), 1)
    return f"{share:.0%}" if share >= 0.005 else "less than 1%"


def _named(nodes: NDArray[np.bool_], place: Callable[[int, int], str]) -> str:
    """One of some nodes [X, Y], the one nearest to their middle."""
    found = np.argwhere(nodes)
    middle = found[np.argmin(np.linalg.norm(found - found.mean(axis=0), axis=1))]
    return place(int(middle[0]), int(middle[1]))


def _warn(label: str, line: str) -> None:
    warnings.warn(f"{label}: {line}", ScenarioWarning, stacklevel=3)
