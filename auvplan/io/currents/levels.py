"""Depths of a model's levels: fixed, ROMS' s-levels, sigma levels, or heights of the file; values between."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.geometry import Window
from auvplan.io.currents.names import standard_name
from auvplan.io.currents.opening import File, text
from auvplan.io.currents.points import Points
from auvplan.io.currents.s_levels import s_levels
from auvplan.io.currents.series import Array
from auvplan.io.currents.units import length_factor

#: No level lies deeper or higher, m.
DEEPEST = 20_000.0
#: Heights of levels above the datum, as SCHISM and SELFE tell them.
_HEIGHTS = ("zcor", "zCoordinates", "zval")
_SIGMAS = ("siglay", "sigma", "siglev")


@dataclass(frozen=True)
class Levels:
    """Depths of levels below the instantaneous surface.

    Attributes:
        dim: of the levels; None where there is one level and no such dimension.
        order: the levels in the order in which their depths rise.
        fixed: [K] m rising, or None where they follow the sea bed.
        read: depths [1 or T, K, 1 or P] m of the levels in a window in that order, and of the sea bed
            [1 or T, P] m below the surface, or None where that is not known.
    """

    dim: str | None
    order: slice
    fixed: Array | None
    read: Callable[[slice, Window], tuple[Array, Array | None]]


def find_levels(points: Points, name: str, dim: str | None, notes: list[str]) -> Levels:
    """Return the levels of a velocity component.

    Args:
        points: where it is given.
        name: of the component.
        dim: of its levels; None where it has none.
        notes: get what has to be assumed.

    Raises:
        CurrentError: the levels have no depths, or such as contradict themselves.
    """
    if dim is None:
        return _single(points, name, notes)
    file = points.series.files[0]
    for heights in _HEIGHTS:
        if heights in file.variables and dim in file.variables[heights].dims:
            return _stated(points, heights, dim, notes)
    found = s_levels(points.series, dim, notes)
    if found is not None:
        return _following(points, name, dim, found, notes)
    for sigma, variable in file.variables.items():
        stated = standard_name(file, sigma).startswith("ocean_sigma") or sigma in _SIGMAS
        if stated and dim in variable.dims and (variable.ndim == 1 or points.has(sigma)):
            return _sigma(points, name, sigma, dim, notes)
    for heights, variable in file.variables.items():
        if variable.ndim > 1 and dim in variable.dims and points.has(heights) and is_vertical(file, heights):
            return _stated(points, heights, dim, notes)
    axis = _axis(points, dim)
    if axis is None:
        raise points.series.fail(
            f"{name} has levels along {dim}, but no depths of them: if they are levels, give their depths in "
            f"metres as {dim}({dim}) with positive = down; if not, take one of them out, such as by "
            f"ncks -d {dim},0"
        )
    return _fixed(points, axis, dim, notes)


def is_level(points: Points, dim: str) -> bool:
    """Return whether a file tells where levels along a dimension lie."""
    file = points.series.files[0]
    return _axis(points, dim) is not None or any(
        dim in variable.dims
        and (name in (*_HEIGHTS, *_SIGMAS) or standard_name(file, name).startswith("ocean_s"))
        for name, variable in file.variables.items()
    )


def is_vertical(file: File, name: str) -> bool:
    """Return whether a variable says that it is a depth or a height."""
    attributes = file.variables[name].attrs
    known = standard_name(file, name) == "depth" or standard_name(file, name).startswith(
        ("height", "altitude")
    )
    return known or bool(text(attributes, "positive") and length_factor(text(attributes, "units")))


def _axis(points: Points, dim: str) -> str | None:
    """Return the variable that tells the depths along a dimension, None where there is none."""
    file = points.series.files[0]
    found = []
    for candidate, variable in file.variables.items():
        if variable.dims == (dim,) and variable.dtype.kind in "iuf":
            standard = is_vertical(file, candidate)
            likely = candidate == dim or standard or text(variable.attrs, "axis") == "Z"
            named = "depth" in candidate.lower()
            if likely or text(variable.attrs, "positive") or named:
                counted = not (standard or named or text(variable.attrs, "units")) and _counts(
                    file, candidate
                )
                if not counted:
                    found.append((standard, candidate == dim, candidate))
    return max(found)[2] if found else None


def _counts(file: File, name: str) -> bool:
    """Return whether the values of an axis are the numbers of its levels, or members, from 0 or 1."""
    values = file.coordinate(name)
    return bool(values[0] in (0.0, 1.0) and (np.diff(values) == 1.0).all())


def _fixed(points: Points, axis: str, dim: str | None, notes: list[str]) -> Levels:
    file, series = points.series.files[0], points.series
    values = np.atleast_1d(file.coordinate(axis))
    if not text(series.attrs(axis), "units"):
        if len(values) > 1 and float(np.max(np.abs(values))) <= 1.0:
            raise series.fail(
                f"{axis} has no units and lies between {values.min():g} and {values.max():g}, as shares of "
                f"the depth do: say which, such as by ncatted -a units,{axis},c,c,m or by its standard_name"
            )
        notes.append(f"{axis} has no units: taken as metres")
    depths = _downward(points, axis, values * points.metres(axis), notes)
    if (far := float(np.max(np.abs(depths)))) > DEEPEST:
        raise series.fail(f"depths {axis} reach {far:g} m, where there is no sea: check units")
    steps = np.diff(depths)
    if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
        raise series.fail(
            f"depths {axis} neither rise nor fall throughout: sort them, such as by xarray's sortby"
        )
    order = slice(None, None, -1 if len(steps) and steps[0] < 0 else 1)
    rising = depths[order]

    def read(frames: slice, window: Window) -> tuple[Array, Array | None]:
        floor = points.floor(window)
        return rising[None, :, None], None if floor is None else floor[None]

    return Levels(dim, order, rising, read)


def _downward(points: Points, axis: str, values: Array, notes: list[str]) -> Array:
    """Depths, positive down, by the attribute `positive` or, without one, by their signs."""
    attributes, file = points.series.attrs(axis), points.series.files[0]
    positive = text(attributes, "positive").lower()
    signs = {bool(value > 0) for value in values if value != 0}
    if len(signs) > 1:
        raise points.series.fail(f"depths {axis} are of both signs")
    above = signs == {False}
    if positive not in ("", "up", "down"):
        raise points.series.fail(f"{axis} has positive = {positive!r}, neither up nor down")
    if positive != "down" and not above and standard_name(file, axis).startswith(("height", "altitude")):
        raise points.series.fail(
            f"{axis} is {standard_name(file, axis)}, and positive: depths below the surface are needed"
        )
    if positive == "":
        notes.append(f"{axis} does not say which way is positive: {'up' if above else 'down'}, by its values")
    elif signs and above != (positive == "up"):
        kind, other = ("negative", "up") if above else ("positive", "down")
        raise points.series.fail(
            f"{axis} says positive = {positive}, but its values are {kind}: set it right, "
            f"such as by ncatted -a positive,{axis},o,c,{other}"
        )
    elif signs and positive == "up" and standard_name(file, axis) == "depth":
        notes.append(f"{axis} is called depth and is positive up: taken by the attribute positive")
    return -values + 0.0 if above else values + 0.0


def _single(points: Points, name: str, notes: list[str]) -> Levels:
    """One level: at the depth of a scalar coordinate, or else at the surface."""
    file = points.series.files[0]
    words = standard_name(file, name)
    for candidate, variable in file.variables.items():
        if variable.ndim == 0 and variable.dtype.kind in "iuf":
            standard = standard_name(file, candidate)
            # The height of a wind may stand beside a current.
            if "depth" in (standard, candidate.lower()) or (
                standard == "height" and "sea_water" not in words
            ):
                return _fixed(points, candidate, None, notes)
    notes.append(f"{name} has no levels: taken as the current at the surface")
    fixed = np.zeros(1)

    def read(frames: slice, window: Window) -> tuple[Array, Array | None]:
        floor = points.floor(window)
        return fixed[None, :, None], None if floor is None else floor[None]

    return Levels(None, slice(None), fixed, read)


def _following(
    points: Points, name: str, dim: str, depths: Callable[[Array, Array], Array], notes: list[str]
) -> Levels:
    """Levels whose depths [T, K, P] follow from the sea bed's [P] and the surface's height [T, P]."""
    if points.floor_name() is None:
        raise points.series.fail(f"{name} has levels that follow the sea bed, but h is missing")
    if points.rise_name() is None:
        notes.append("the surface's height zeta is not given: taken as 0")

    def read(frames: slice, window: Window) -> tuple[Array, Array | None]:
        floor, rise = points.floor(window), points.rise(frames, window)
        assert floor is not None
        return depths(floor, rise), floor + rise

    # Whether the file counts from the bed or from the surface shows in any column.
    probe = depths(np.full(1, 100.0), np.zeros((1, 1)))[0, :, 0]
    steps = np.diff(probe)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise points.series.fail(f"levels along {dim} neither rise nor fall throughout")
    if (steps > 0).all():
        return Levels(dim, slice(None), None, read)

    def flipped(frames: slice, window: Window) -> tuple[Array, Array | None]:
        levels, floor = read(frames, window)
        return levels[:, ::-1], floor

    return Levels(dim, slice(None, None, -1), None, flipped)


def _sigma(points: Points, name: str, sigma: str, dim: str, notes: list[str]) -> Levels:
    """Shares of the water's depth, the same everywhere or given for each point; FVCOM, SELFE, POM."""
    series = points.series
    if series.dims(sigma) == (dim,):
        shares = _shares(points, sigma)
        return _following(
            points, name, dim, lambda floor, rise: shares[None, :, None] * (floor + rise)[:, None], notes
        )
    if not points.has(sigma):
        raise series.fail(f"levels {sigma} are not given where {name} is")
    if points.floor_name() is None:
        raise series.fail(f"{name} has levels that follow the sea bed, but h is missing")
    if points.rise_name() is None:
        notes.append("the surface's height zeta is not given: taken as 0")
    column = np.moveaxis(_shares(points, sigma), series.dims(sigma).index(dim), 0)
    order = slice(None, None, 1 if column[0].mean() < column[-1].mean() else -1)

    def read(frames: slice, window: Window) -> tuple[Array, Array | None]:
        floor, rise = points.floor(window), points.rise(frames, window)
        assert floor is not None
        shares = np.abs(points.read(sigma, slice(0, 1), window, (dim,)))[:, order]
        return shares * (floor + rise)[:, None], floor + rise

    return Levels(dim, order, None, read)


def _shares(points: Points, sigma: str) -> Array:
    """Shares of the depth, 0 at the surface, of CF's sigma, which falls from 0 to -1.

    Raises:
        CurrentError: they reach beyond 1, or count from the bed.
    """
    series = points.series
    values = series.files[0].coordinate(sigma)
    if text(series.attrs(sigma), "positive").lower() == "up" and (values > 0.0).any():
        raise series.fail(
            f"levels {sigma} are positive upward, from the bed: CF's sigma, 0 at the surface and -1 at the "
            "bed, is needed"
        )
    shares = np.abs(values)
    if shares.max() > 1.0 + 1e-6:
        raise series.fail(f"levels {sigma} are no shares of the depth: they reach {shares.max():g}")
    return shares


def _stated(points: Points, heights: str, dim: str, notes: list[str]) -> Levels:
    """Heights above the datum, or depths, of each level and point, at each time or all; NaN below the bed."""
    attributes = points.series.attrs(heights)
    down = text(attributes, "positive").lower() == "down" or (
        standard_name(points.series.files[0], heights) == "depth" and not text(attributes, "positive")
    )
    metres = points.metres(heights) * (-1.0 if down else 1.0)
    if heights not in _HEIGHTS and not down and points.rise_name() is None:
        notes.append("the surface's height is not given: taken as 0")
    last = points.series.variables[heights].sizes[dim] - 1
    first = points.series.read(heights, {dim: np.array([0, last])}, slice(0, 1), points.series.dims(heights))
    ends = np.moveaxis(first[0], points.series.dims(heights).index(dim), 0) * metres
    both = np.isfinite(ends).all(axis=0)
    rising = not both.any() or float((ends[-1] - ends[0])[both].mean()) >= 0.0
    order = slice(None, None, -1 if rising else 1)

    def read(frames: slice, window: Window) -> tuple[Array, Array | None]:
        height = points.read(heights, frames, window, (dim,)) * metres
        if (far := float(np.nanmax(np.abs(height), initial=0.0))) > DEEPEST:
            raise points.series.fail(
                f"{heights} reaches {far:g} m, where there is no sea: check _FillValue and units"
            )
        there = np.isfinite(height)
        rise = points.rise(frames, window)
        if heights in _HEIGHTS and points.rise_name() is None:
            top = np.where(there, height, -np.inf).max(axis=1)
            rise = np.where(np.isfinite(top), top, 0.0)
        # Depths are below the surface as it is.
        depths = np.where(there, (0.0 if down else rise[:, None]) - height, np.inf)
        floor = points.floor(window)
        if floor is not None:
            return depths[:, order], floor + rise
        bed = np.where(there, depths, -np.inf).max(axis=1)
        return depths[:, order], np.where(np.isfinite(bed), bed, np.nan)

    return Levels(dim, order, None, read)


def at_depth(
    values: tuple[Array, ...], depths: Array, wanted: Array, floor: Array | None = None
) -> tuple[Array, ...]:
    """Return values of N columns at a depth.

    Between levels it is linear. Above the first level, the first holds. Below the deepest level that has a
    value, that holds down to the sea bed and no further than the next level; where the bed is not known, down
    to half-way to the next level, and without end below the last. Elsewhere there is no value, NaN.

    Args:
        values: each [K, N].
        depths: [K, N] or [K, 1] m, rising.
        wanted: [N] or [1] m.
        floor: [N] or [1] m, the sea bed; None where it is not known.

    Returns:
        Each [N].
    """
    count = len(depths)
    below = (depths < wanted).sum(axis=0)
    upper, lower = np.maximum(below - 1, 0), np.minimum(below, count - 1)
    first, second = _take(depths, upper), _take(depths, lower)
    with np.errstate(invalid="ignore"):  # columns of land have no levels: all are infinitely deep
        apart = np.where(second > first, second - first, np.inf)
        share = np.clip((wanted - first) / apart, 0.0, 1.0)
    share = np.where(lower == upper, 0.0, share)
    grounded = False if floor is None else wanted > floor
    found = []
    for field in values:
        above, beneath = _take(field, upper), _take(field, lower)
        between = np.where(share >= 1.0, beneath, above + share * (beneath - above))
        between = np.where(share <= 0.0, above, between)
        held = np.isnan(beneath) & (share < 1.0) | (below == count)
        dry = grounded if floor is not None else np.isnan(beneath) & (share > 0.5)
        result = np.where(held, np.where(dry, np.nan, above), between)
        found.append(np.where(np.isnan(first), np.nan, result))
    return tuple(found)


def _take(array: Array, level: NDArray[np.int64]) -> Array:
    """[N] or [1], each column's value at a level of its own; either argument may be of one column."""
    if level.size == 1:
        return array[int(level[0])]
    if array.shape[1] == 1:
        return array[level, 0]
    return np.take_along_axis(array, level[None], axis=0)[0]
