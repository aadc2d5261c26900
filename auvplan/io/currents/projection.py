"""Coordinates in metres of a map projection as degrees, and the directions of its axes."""

import re
from contextlib import suppress
from typing import Any

import numpy as np
from pyproj import CRS, Geod, Transformer

from auvplan.errors import AuvplanError, reason_of
from auvplan.io.currents.files import Array, File, text
from auvplan.io.currents.units import length_factor
from auvplan.ocean.gridded import CurrentError

_EARTH, _SPHERE = Geod(ellps="WGS84"), Geod(ellps="sphere")
#: Units of what counts the other way, and standard names of what is no longitude or latitude.
_TURNED = re.compile(r"degrees?_?(w|west|south)|degrees?_s", re.IGNORECASE)
_PLANE = ("projection_", "grid_longitude", "grid_latitude")
#: Attributes of a grid mapping that define it whole, beside those of CF.
_TEXTS = ("crs_wkt", "spatial_ref", "proj4_string", "proj4_params", "proj4")
_CODES = ("epsg", "epsg_code", "EPSG_code", "EPSG")
#: Per cent of confidence with which a spelling without a code is of an EPSG system.
_CONFIDENCE = 25


def as_crs(given: Any, fault: type[AuvplanError]) -> CRS:
    """Return a coordinate reference system of whatever pyproj understands, or raise `fault`."""
    try:
        return CRS.from_user_input(given)
    except Exception as error:
        why = f"{given!r} is no coordinate reference system ({reason_of(error)})"
        raise fault(why, field="crs") from None


def in_degrees(file: File, places: tuple[str, str]) -> tuple[Array, Array, CRS | None]:
    """Read longitude and latitude of coordinates in degrees, or in metres of a projection.

    Returns:
        Longitude and latitude, degrees, of the coordinates' own shape or, for x and y along dimensions of
        their own, [y, x]; and the projection, None for degrees.

    Raises:
        CurrentError: the coordinates are of a projection that neither the file nor `File.crs` names, or no
            degrees.
    """
    both, units = " and ".join(places), [file.text(name, "units") for name in places]
    x, y = (file.coordinate(name, missing=file.variables[name].ndim == 2) for name in places)
    if all(unit.lower().startswith("rad") for unit in units):
        return np.rad2deg(x), np.rad2deg(y), None
    x, y = (
        -values if _TURNED.fullmatch(unit) else values for unit, values in zip(units, (x, y), strict=True)
    )
    degrees = [unit.lower().startswith("deg") for unit in units]
    stated = any(file.standard_name(name).startswith(_PLANE) for name in places)
    if not stated and not any(map(length_factor, units)):
        finite = np.isfinite(x) & np.isfinite(y) if x.shape == y.shape else np.ones(1, bool)
        odd = np.nanmax(np.abs(y), initial=0.0) > 90.0 + 1e-6 or np.nanmax(np.abs(x), initial=0.0) > 720.0
        if not odd and finite.any():
            return x, y, None
        if any(degrees):
            raise file.fail(f"{both} are no degrees")
    crs = find_crs(file, places)
    if crs is None:
        raise file.fail(
            f"{both} are metres of a projection that the file does not name: say current.crs, such as "
            "EPSG:32633"
        )
    if not (crs.is_projected or crs.is_derived):
        raise file.fail(f"{both} are metres, {crs.name} is no projection")
    factors = (1.0 if flat else file.metres(name) for name, flat in zip(places, degrees, strict=True))
    unit = 1.0 if crs.is_geographic else _unit(crs)
    x, y = (values * factor / unit for values, factor in zip((x, y), factors, strict=True))
    if file.variables[places[0]].dims != file.variables[places[1]].dims:
        x, y = np.meshgrid(x, y)
    longitude, latitude = Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)
    longitude, latitude = np.asarray(longitude, float), np.asarray(latitude, float)
    known = np.isfinite(longitude) & np.isfinite(latitude)
    if not known[np.isfinite(x) & np.isfinite(y)].all():
        raise file.fail(f"{both} do not lie within {crs.name}")
    return longitude, latitude, crs


def find_crs(file: File, names: tuple[str, ...]) -> CRS | None:
    """Return the reference system of variables: their grid mapping's, else the only one, else the argument's.

    Raises:
        CurrentError: the file's own contradicts the argument, or makes no sense.
    """
    stated = None if file.crs is None else as_crs(file.crs, CurrentError)
    mappings = [file.text(name, "grid_mapping").split(":")[0] for name in names]
    listed = [name for name in mappings if name in file.variables]
    others = [
        name
        for name, variable in file.variables.items()
        if "grid_mapping_name" in variable.attrs or any(key in variable.attrs for key in _TEXTS)
    ]
    for name in [*listed, *(others if len(others) == 1 else [])]:
        own = of_mapping(file.variables[name].attrs)
        if own is None or not (own.is_projected or own.is_derived):
            continue
        if stated is not None and not same_crs(own, stated):
            raise file.fail(f"{name} is {own.name}, not {stated.name} as current.crs says")
        return own
    return stated


def same_crs(one: CRS, other: CRS) -> bool:
    """Return whether two reference systems are the same, also where one is ESRI's spelling of it."""
    code = one.to_epsg(_CONFIDENCE)
    return one.equals(other, ignore_axis_order=True) or (
        code is not None and code == other.to_epsg(_CONFIDENCE)
    )


def axes_angle(crs: CRS, longitude: Array, latitude: Array) -> Array:
    """Return the angle, rad, from east to a projection's x axis, counter-clockwise, at places in degrees."""
    there = Transformer.from_crs("EPSG:4326", crs, always_xy=True)
    x, y = there.transform(longitude, latitude)
    step = 1e-3 if crs.is_geographic else 100.0 / _unit(crs)
    ends = [
        Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(np.asarray(x) + side * step, y)
        for side in (-1.0, 1.0)
    ]
    # A pole is turned on a sphere; a projection keeps or changes angles on an ellipsoid of its own.
    return _from_east(*ends[0], *ends[1], _SPHERE if crs.is_geographic else crs.get_geod() or _EARTH)


def grid_angle(longitude: Array, latitude: Array) -> Array:
    """Return the angle, rad, from east to the rows of a grid [ny, nx] of places, counter-clockwise."""
    east, north = (
        np.concatenate([axis[:, :1], axis, axis[:, -1:]], axis=1) for axis in (longitude, latitude)
    )
    return _from_east(east[:, :-2], north[:, :-2], east[:, 2:], north[:, 2:], _EARTH)


def _from_east(x: Array, y: Array, to_x: Array, to_y: Array, earth: Geod) -> Array:
    """Return the angle, rad, from east of the line from one place to another, degrees, in its middle."""
    there, back, _ = earth.inv(x, y, to_x, to_y)
    both = np.exp(1j * np.deg2rad(there)) - np.exp(1j * np.deg2rad(back))
    return np.pi / 2 - np.angle(both)


def _unit(crs: CRS) -> float:
    """Return metres in a projection's unit."""
    return float(crs.axis_info[0].unit_conversion_factor) or 1.0


def of_mapping(attributes: Any) -> CRS | None:
    """Return the reference system of a grid mapping's attributes, or None where they define none."""
    tries = [text(attributes, name) for name in _TEXTS]
    tries += [f"EPSG:{text(attributes, name).removeprefix('EPSG:')}" for name in _CODES if name in attributes]
    found: list[CRS] = []
    for words in filter(None, tries):
        with suppress(Exception):  # a mapping is often given twice, once badly
            found.append(CRS.from_user_input(words))
    with suppress(Exception):  # whatever pyproj makes of a name that CF does not know
        found.append(CRS.from_cf({key: np.asarray(value).tolist() for key, value in attributes.items()}))
    projected = [crs for crs in found if crs.is_projected or crs.is_derived]
    return (projected or found or [None])[0]
