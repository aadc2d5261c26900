"""Depths of a model's levels: fixed, ROMS' s-levels, sigma levels, or heights of the file; values between."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from auvplan.io.currents.files import Array, Series
from auvplan.io.currents.names import HEIGHTS, SIGMAS, depth_axis, is_vertical

if TYPE_CHECKING:
    from auvplan.io.currents.model import Part, Source

#: No level lies deeper or higher, m.
_DEEPEST = 20_000.0
#: Names of the s-coordinate and of the stretching curve, of ROMS and of CROCO, at levels and between them.
_CURVES = {"rho": (("s_rho", "sc_r"), ("Cs_r", "Cs_rho")), "w": (("s_w", "sc_w"), ("Cs_w",))}
_AXES = ("s_rho", "sc_r", "s_w", "sc_w")


@dataclass(frozen=True)
class Levels:
    """Depths of levels below the instantaneous surface."""

    dim: str | None  # of the levels in the file; None where there is one level and no such dimension
    count: int  # how many there are
    order: slice  # the levels of the file in the order in which their depths rise
    fixed: Array | None  # [K] m rising, or None where they follow the sea bed
    #: Where they follow it: the depths [T or 1, K, P] m in the file's order, and that of the bed [T or 1, P].
    columns: "Callable[[Part], tuple[Array, Array]] | None" = None

    def at(self, part: "Part") -> tuple[Array, Array | None]:
        """Return the depths [T or 1, K, 1 or P] m, rising, and the bed's [T or 1, P] where they follow it."""
        if self.fixed is not None:
            return self.fixed[None, :, None], None
        assert self.columns is not None
        depths, bed = self.columns(part)
        return depths[:, self.order], bed


def find_levels(source: "Source", name: str, dim: str | None) -> Levels:
    """Return the levels of a velocity component, along a dimension if it has one.

    Raises:
        CurrentError: the levels have no depths, or such as contradict themselves.
    """
    file = source.series
    if dim is None:  # one level: at the depth of a scalar coordinate, or else at the surface
        for candidate, variable in file.variables.items():
            if variable.ndim == 0 and variable.dtype.kind in "iuf":
                standard = file.standard_name(candidate)
                # The height of a wind may stand beside a current.
                height = standard == "height" and "sea_water" not in file.standard_name(name)
                if height or "depth" in (standard, candidate.lower()):
                    return _fixed(source, candidate, None)
        source.notes.append(f"{name} has no levels: taken as the current at the surface")
        return Levels(None, 1, slice(None), np.zeros(1))
    for heights in HEIGHTS:
        if heights in file.variables and dim in file.variables[heights].dims:
            return _stated(source, heights, dim)
    s_depth = _s_levels(file, dim, source.notes)
    if s_depth is not None:
        return _following(source, name, dim, s_depth)
    for sigma, variable in file.variables.items():
        stated = file.standard_name(sigma).startswith("ocean_sigma") or sigma in SIGMAS
        if stated and dim in variable.dims and (variable.ndim == 1 or source.has(sigma)):
            return _sigma(source, name, sigma, dim)
    for heights, variable in file.variables.items():
        if variable.ndim > 1 and dim in variable.dims and source.has(heights) and is_vertical(file, heights):
            return _stated(source, heights, dim)
    axis = depth_axis(file, dim)
    if axis is None:
        raise file.fail(
            f"{name} has levels along {dim}, but no depths of them: if they are levels, give their depths in "
            f"metres as {dim}({dim}) with positive = down; if not, take one of them out, such as by "
            f"ncks -d {dim},0"
        )
    return _fixed(source, axis, dim)


def _fixed(source: "Source", axis: str, dim: str | None) -> Levels:
    series = source.series
    values = np.atleast_1d(series.coordinate(axis))
    if not series.text(axis, "units"):
        if len(values) > 1 and float(np.max(np.abs(values))) <= 1.0:
            raise series.fail(
                f"{axis} has no units and lies between {values.min():g} and {values.max():g}, as shares of "
                f"the depth do: say which, such as by ncatted -a units,{axis},c,c,m or by its standard_name"
            )
        source.notes.append(f"{axis} has no units: taken as metres")
    depths = _downward(source, axis, values * series.metres(axis))
    if (far := float(np.max(np.abs(depths)))) > _DEEPEST:
        raise series.fail(f"depths {axis} reach {far:g} m, where there is no sea: check units")
    steps = np.diff(depths)
    if len(steps) and not ((steps > 0).all() or (steps < 0).all()):
        raise series.fail(
            f"depths {axis} neither rise nor fall throughout: sort them, such as by xarray's sortby"
        )
    order = slice(None, None, -1 if len(steps) and steps[0] < 0 else 1)
    return Levels(dim, len(depths), order, depths[order])


def _downward(source: "Source", axis: str, values: Array) -> Array:
    """Depths, positive down, by the attribute `positive` or, without one, by their signs."""
    series, standard = source.series, source.series.standard_name(axis)
    positive = series.text(axis, "positive").lower()
    signs = {bool(value > 0) for value in values if value != 0}
    if len(signs) > 1:
        raise series.fail(f"depths {axis} are of both signs")
    above = signs == {False}
    if positive not in ("", "up", "down"):
        raise series.fail(f"{axis} has positive = {positive!r}, neither up nor down")
    if positive != "down" and not above and standard.startswith(("height", "altitude")):
        raise series.fail(f"{axis} is {standard}, and positive: depths below the surface are needed")
    if positive == "":
        sense = "up" if above else "down"
        source.notes.append(f"{axis} does not say which way is positive: {sense}, by its values")
    elif signs and above != (positive == "up"):
        kind, other = ("negative", "up") if above else ("positive", "down")
        raise series.fail(
            f"{axis} says positive = {positive}, but its values are {kind}: set it right, "
            f"such as by ncatted -a positive,{axis},o,c,{other}"
        )
    elif signs and positive == "up" and standard == "depth":
        source.notes.append(f"{axis} is called depth and is positive up: taken by the attribute positive")
    return -values + 0.0 if above else values + 0.0


def _require_bed(source: "Source", name: str) -> None:
    if source.floor_name is None:
        raise source.series.fail(f"{name} has levels that follow the sea bed, but h is missing")
    if source.rise_name is None:
        source.notes.append("the surface's height zeta is not given: taken as 0")


def _following(source: "Source", name: str, dim: str, depths: Callable[[Array, Array], Array]) -> Levels:
    """Levels whose depths [T, K, P] follow from the sea bed's [P] and the surface's height [T, P]."""
    _require_bed(source, name)
    # Whether the file counts from the bed or from the surface shows in any column.
    probe = depths(np.full(1, 100.0), np.zeros((1, 1)))[0, :, 0]
    steps = np.diff(probe)
    if not ((steps > 0).all() or (steps < 0).all()):
        raise source.series.fail(f"levels along {dim} neither rise nor fall throughout")

    def columns(part: "Part") -> tuple[Array, Array]:
        return depths(part.floor[0], part.rise), part.floor + part.rise

    return Levels(dim, len(probe), slice(None, None, 1 if (steps > 0).all() else -1), None, columns)


def _sigma(source: "Source", name: str, sigma: str, dim: str) -> Levels:
    """Shares of the water's depth, the same everywhere or given for each point; FVCOM, SELFE, POM."""
    series = source.series
    values = series.coordinate(sigma)
    if series.text(sigma, "positive").lower() == "up" and (values > 0.0).any():
        raise series.fail(
            f"levels {sigma} are positive upward, from the bed: CF's sigma, 0 at the surface and -1 at the "
            "bed, is needed"
        )
    shares = np.abs(values)
    if shares.max() > 1.0 + 1e-6:
        raise series.fail(f"levels {sigma} are no shares of the depth: they reach {shares.max():g}")
    if series.dims(sigma) == (dim,):
        return _following(
            source, name, dim, lambda floor, rise: shares[None, :, None] * (floor + rise)[:, None]
        )
    _require_bed(source, name)
    source.along(sigma, dim)
    column = np.moveaxis(shares, series.dims(sigma).index(dim), 0)

    def columns(part: "Part") -> tuple[Array, Array]:
        bed = part.floor + part.rise
        return np.abs(part.values(sigma, dim)) * bed[:, None], bed

    order = slice(None, None, 1 if column[0].mean() < column[-1].mean() else -1)
    return Levels(dim, len(column), order, None, columns)


def _stated(source: "Source", heights: str, dim: str) -> Levels:
    """Heights above the datum, or depths, of each level and point, at each time or all; NaN below the bed."""
    series = source.series
    positive = series.text(heights, "positive").lower()
    down = positive == "down" or (series.standard_name(heights) == "depth" and not positive)
    metres = series.metres(heights) * (-1.0 if down else 1.0)
    alone = source.rise_name is None
    if heights not in HEIGHTS and not down and alone:
        source.notes.append("the surface's height is not given: taken as 0")
    count, dims = series.variables[heights].sizes[dim], series.dims(heights)
    first = series.at(slice(0, 1), heights, {dim: np.array([0, count - 1])}, dims)
    ends = np.moveaxis(first[0], dims.index(dim), 0) * metres
    both = np.isfinite(ends).all(axis=0)
    rising = not both.any() or float((ends[-1] - ends[0])[both].mean()) >= 0.0
    source.along(heights, dim)

    def columns(part: "Part") -> tuple[Array, Array]:
        height = part.values(heights, dim) * metres
        if (far := float(np.nanmax(np.abs(height), initial=0.0))) > _DEEPEST:
            raise series.fail(
                f"{heights} reaches {far:g} m, where there is no sea: check _FillValue and units"
            )
        there, rise = np.isfinite(height), part.rise
        if heights in HEIGHTS and alone:
            top = np.where(there, height, -np.inf).max(axis=1)
            rise = np.where(np.isfinite(top), top, 0.0)
        depths = np.where(there, (0.0 if down else rise[:, None]) - height, np.inf)
        if source.floor_name is not None:
            return depths, part.floor + rise
        deepest = np.where(np.isfinite(depths), depths, -np.inf).max(axis=1)
        return depths, np.where(np.isfinite(deepest), deepest, np.nan)

    return Levels(dim, count, slice(None, None, -1 if rising else 1), None, columns)


def s_depths(s: Array, curve: Array, critical: float, transform: int, floor: Array, rise: Array) -> Array:
    """Depths of ROMS' s-levels below the instantaneous surface, m, by its vertical S-coordinate.

    Args:
        s: [K] in [-1, 0], the vertical coordinate.
        curve: [K] in [-1, 0], the stretching curve at s.
        critical: m, depth below which the curve rules.
        transform: 1 or 2, ROMS' Vtransform; CF's ocean_s_coordinate_g1 and _g2.
        floor: [P] m, the sea bed below the datum.
        rise: [T, P] m, the surface above the datum.

    Returns:
        [T, K, P] m.
    """
    s, curve = s[:, None], curve[:, None]
    if transform == 1:
        still = critical * s + (floor - critical) * curve
        # The moving surface stretches the column of water at rest.
        return -still - rise[:, None] * still / floor
    share = (critical * s + floor * curve) / (critical + floor)
    return -share * (rise + floor)[:, None]


def _s_levels(series: Series, dim: str, notes: list[str]) -> Callable[[Array, Array], Array] | None:
    """Return `s_depths` of levels along a dimension by sea bed and surface; None for other levels."""
    axis = next((name for name in _AXES if name in series.variables and series.dims(name) == (dim,)), dim)
    between = axis in ("s_w", "sc_w")
    coordinates, curves = _CURVES["w" if between else "rho"]
    own = series.standard_name(axis) if axis in series.variables else ""
    if axis not in _AXES and not own.startswith("ocean_s_coordinate"):
        return None
    count = next(v.sizes[dim] for v in series.variables.values() if dim in v.dims)
    s = _parameter(series, (axis, *coordinates), count)
    if s is None:
        steps = np.arange(count) / (count - 1) if between else (np.arange(count) + 0.5) / count
        s = steps - 1.0
        notes.append(f"the s-levels along {dim} are not given: taken as evenly spaced")
    curve, critical = _parameter(series, curves, count), _parameter(series, ("hc",), 1)
    if curve is None or critical is None:
        raise series.fail(f"levels along {dim} need {curves[0] if curve is None else 'hc'}, which is missing")
    if not ((s >= -1.0001) & (s <= 0.0001) & (curve >= -1.0001) & (curve <= 0.0001)).all():
        raise series.fail(f"{coordinates[0]} or {curves[0]} is not between -1 and 0")
    stated = _parameter(series, ("Vtransform",), 1)
    if stated is not None:
        transform = int(stated[0])
        if stated[0] not in (1.0, 2.0):
            raise series.fail(f"Vtransform is {stated[0]:g}, neither 1 nor 2")
    elif own in ("ocean_s_coordinate_g1", "ocean_s_coordinate_g2"):
        transform = int(own[-1])
    elif str(series.attributes.get("VertCoordType", "")).strip() in ("NEW", "SM09"):
        transform = 2
    else:
        # With the first, levels would cross where the water is shallower than hc, and ROMS does not start.
        shallow = "h" in series.variables and np.nanmin(series.coordinate("h", missing=True)) < critical[0]
        transform = 2 if shallow else 1
        notes.append(f"Vtransform is missing: taken as {transform}")
    return lambda floor, rise: s_depths(s, curve, float(critical[0]), transform, floor, rise)


def _parameter(series: Series, names: tuple[str, ...], count: int) -> Array | None:
    """Return a parameter [count] that is a variable or, as CROCO writes it, an attribute of the file."""
    for name in names:
        if name in series.variables or name in series.attributes:
            own = name in series.variables
            values = np.ravel(series.coordinate(name) if own else np.asarray(series.attributes[name], float))
            if values.size != count:
                raise series.fail(f"{name} has {values.size} values, not {count}")
            return values
    return None


def at_depth(
    values: tuple[Array, ...], depths: Array, wanted: Array, floor: Array | None = None
) -> tuple[Array, ...]:
    """Return values of N columns at a depth.

    Between levels it is linear. Above the first level, the first holds. Below the deepest level that has a
    value, that holds down to the sea bed and no further than the next level; where the bed is not known, down
    to half-way to the next level, and without end below the last. Elsewhere there is no value, NaN.

    Args:
        values: each [..., K, N]; all axes of the others may also be of one.
        depths: [..., K, N] m, rising.
        wanted: [N] m.
        floor: [..., N] m, the sea bed; None where it is not known.

    Returns:
        Each [..., N].
    """
    count = depths.shape[-2]
    below = (depths < wanted).sum(axis=-2)
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
    """[..., N] or [..., 1], each column's value at a level of its own."""
    if level.size == 1:
        return array[..., level.flat[0], :]
    return np.take_along_axis(array, level[..., None, :], axis=-2)[..., 0, :]
