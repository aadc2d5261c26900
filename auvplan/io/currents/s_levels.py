"""ROMS' terrain-following levels, as its documentation of the vertical S-coordinate defines them."""

from collections.abc import Callable

import numpy as np

from auvplan.io.currents.names import standard_name
from auvplan.io.currents.series import Array, Series

#: Names of the s-coordinate and of the stretching curve, of ROMS and of CROCO, at levels and between them.
_CURVES = {
    "rho": (("s_rho", "sc_r"), ("Cs_r", "Cs_rho")),
    "w": (("s_w", "sc_w"), ("Cs_w",)),
}
_AXES = ("s_rho", "sc_r", "s_w", "sc_w")


def s_depths(s: Array, curve: Array, critical: float, transform: int, floor: Array, rise: Array) -> Array:
    """Depths of s-levels below the instantaneous surface, m.

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


def s_levels(series: Series, dim: str, notes: list[str]) -> Callable[[Array, Array], Array] | None:
    """Depths of levels from the sea bed's depth [P] and the surface's height [T, P], m, or None for others.

    Args:
        series: the files.
        dim: of the levels.
        notes: get what has to be assumed.

    Raises:
        CurrentError: these are s-levels, but a parameter is missing or makes no sense.
    """
    file = series.files[0]
    axis = next((name for name in _AXES if name in file.variables and series.dims(name) == (dim,)), dim)
    between = axis in ("s_w", "sc_w")
    coordinates, curves = _CURVES["w" if between else "rho"]
    own = standard_name(file, axis) if axis in file.variables else ""
    if axis not in _AXES and not own.startswith("ocean_s_coordinate"):
        return None
    count = next(v.sizes[dim] for v in file.variables.values() if dim in v.dims)
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
    transform = _transform(series, own, float(critical[0]), notes)
    return lambda floor, rise: s_depths(s, curve, float(critical[0]), transform, floor, rise)


def _transform(series: Series, own: str, critical: float, notes: list[str]) -> int:
    stated = _parameter(series, ("Vtransform",), 1)
    if stated is not None:
        if stated[0] not in (1.0, 2.0):
            raise series.fail(f"Vtransform is {stated[0]:g}, neither 1 nor 2")
        return int(stated[0])
    if own in ("ocean_s_coordinate_g1", "ocean_s_coordinate_g2"):
        return int(own[-1])
    if str(series.attributes.get("VertCoordType", "")).strip() in ("NEW", "SM09"):
        return 2
    # With the first, levels would cross where the water is shallower than hc, and ROMS does not start.
    shallow = "h" in series.variables and np.nanmin(series.files[0].coordinate("h", missing=True)) < critical
    notes.append(f"Vtransform is missing: taken as {2 if shallow else 1}")
    return 2 if shallow else 1


def _parameter(series: Series, names: tuple[str, ...], count: int) -> Array | None:
    """Return a parameter [count] that is a variable or, as CROCO writes it, an attribute of the file."""
    file = series.files[0]
    for name in names:
        if name in file.variables:
            values = np.atleast_1d(file.coordinate(name))
        elif name in series.attributes:
            values = np.atleast_1d(np.asarray(series.attributes[name], float))
        else:
            continue
        if values.size != count:
            raise series.fail(f"{name} has {values.size} values, not {count}")
        return values.ravel()
    return None
