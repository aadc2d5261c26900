"""Tidal constituents from a small YAML file; astronomical arguments and nodal corrections are utide's."""

from collections.abc import Mapping
from datetime import UTC
from pathlib import Path
from typing import Any

import numpy as np

from auvplan.io.geo.error import Faults
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.scenario.yaml_lines import read_yaml_file
from auvplan.site import Site

#: utide's flags for corrections that are exact at the moment that is asked for.
_EXACT = (False, False, False, False)
_DAY = 86_400.0
#: Larger files hold no constituents.
_MAX_BYTES = 1_000_000


def read_tide(path: str | Path, site: Site, until: float) -> HarmonicCurrent:
    """Read a tidal current from constituents at one place or at a few.

    The file holds `constituents`, each by its name with `u` and `v`, east and north, [amplitude m/s,
    Greenwich phase degrees], or with `ellipse`, [semi-major m/s, semi-minor m/s, inclination degrees,
    Greenwich phase degrees], as utide solves for. Beside it may stand `mean`, [u, v] m/s; or all of that
    under `places`, a list whose members have `longitude` and `latitude` too. `depths` m and `shares` give a
    profile.

    Nodal corrections are those of the middle of the time: in a month they change by less than a hundredth.

    Raises:
        CurrentError: one line that names the file and the field.
    """
    from utide._ut_constants import ut_constants
    from utide.harmonics import FUV

    stated = _document(path)
    if site.epoch is None:
        raise CurrentError(
            f"{path}: tidal constituents need site.departure: the phase of the tide follows from it"
        )
    known = {str(name): number for number, name in enumerate(ut_constants.const.name)}
    sites = stated.get("places")
    if sites is None:
        sites = [{**stated, "longitude": site.longitude, "latitude": site.latitude}]
    elif "constituents" in stated:
        raise CurrentError(f"{path}: has places and constituents: put the constituents into the places")
    if not isinstance(sites, list) or not sites or not all(isinstance(one, dict) for one in sites):
        raise CurrentError(
            f"{path}: places must be a list of mappings with longitude, latitude, constituents"
        )
    names = list(dict.fromkeys(str(name) for one in sites for name in _constituents(path, one)))
    unknown = "is none that is known, such as M2, S2, N2, K1, O1"
    faults = Faults([f"{path}: constituents.{n[:60]}: {unknown}" for n in names if n not in known])
    names = [name for name in names if name in known]
    index = np.array([known[name] for name in names], int)
    rate = 2.0 * np.pi * ut_constants.const.freq[index] / 3600.0
    middle = 0.5 * until
    epoch = site.epoch.astimezone(UTC)
    seconds = epoch.hour * 3600.0 + epoch.minute * 60.0 + epoch.second
    days = epoch.toordinal() + seconds / _DAY + middle / _DAY
    shape = 2, len(sites), len(names)
    in_phase, quadrature, mean, places = np.zeros(shape), np.zeros(shape), np.zeros(shape[:2]), []
    for p, one in enumerate(sites):
        where = f"{path}: places[{p}]" if len(sites) > 1 else str(path)
        longitude, latitude = (
            float(_numbers(where, [one.get(name)], name, 1)[0]) for name in ("longitude", "latitude")
        )
        places.append([float(axis) for axis in site.to_local(longitude, latitude)])
        factor, nodal, argument = FUV(np.array([days]), days, index, latitude, list(_EXACT))
        phase = 2.0 * np.pi * (nodal[0] + argument[0]) - rate * middle
        given = {str(name): value for name, value in _constituents(path, one).items()}
        for k, name in enumerate(names):
            if name in given:
                # The argument at the epoch turns the amplitudes, north and east.
                with faults.kept():
                    complex_ = factor[0, k] * _amplitudes(f"{where}: constituents.{name}", given[name])
                    turned = complex_ * np.exp(1j * phase[k])
                    in_phase[:, p, k], quadrature[:, p, k] = turned.real, -turned.imag
        with faults.kept():
            mean[:, p] = _numbers(where, one.get("mean", [0.0, 0.0]), "mean", 2)[::-1]
    faults.refuse(kind=CurrentError)
    depths, shares = (
        np.atleast_1d(np.asarray(stated.get(name, [value]), float))
        for name, value in (("depths", 0.0), ("shares", 1.0))
    )
    fits = depths.shape == shares.shape and (np.diff(depths) > 0.0).all()
    if not fits or not np.isfinite([depths, shares]).all():
        raise CurrentError(f"{path}: depths must rise, and shares must be as many")
    arrays = places, rate, in_phase, quadrature, mean, depths, shares
    return HarmonicCurrent(*(np.asarray(array, np.float32) for array in arrays))


def _document(path: str | Path) -> dict[str, Any]:
    document = read_yaml_file(path, CurrentError, _MAX_BYTES)
    for _, reason, (line, _) in document.faults:
        raise CurrentError(f"{path}: line {line}: {reason}")
    stated = document.data
    if not isinstance(stated, dict):
        raise CurrentError(f"{path}: must be a mapping with constituents, or places that have them")
    known = {"constituents", "places", "mean", "depths", "shares", "source"}
    if extra := [name for name in stated if name not in known]:
        raise CurrentError(f"{path}: {extra[0][:60]}: unknown key; there are {', '.join(sorted(known))}")
    return stated


def _constituents(path: str | Path, stated: Mapping[str, Any]) -> dict[Any, Any]:
    found = stated.get("constituents")
    if not isinstance(found, dict) or not found:
        raise CurrentError(f"{path}: constituents must map names such as M2 to u and v, or to an ellipse")
    return found


def _amplitudes(where: str, stated: Any) -> np.ndarray:
    """Complex amplitudes north and east, m/s: times the cosine of the argument they are the velocity."""
    if not isinstance(stated, dict) or set(stated) not in ({"u", "v"}, {"ellipse"}):
        raise CurrentError(f"{where}: needs u and v, [m/s, degrees] each, or ellipse, and nothing else")
    if "u" in stated:
        parts = (_numbers(where, stated[name], name, 2) for name in ("v", "u"))
        return np.array([size * np.exp(-1j * np.radians(lag)) for size, lag in parts])
    major, minor, turn, lag = _numbers(where, stated["ellipse"], "ellipse", 4)
    along, across = np.exp(-1j * np.radians(lag)) * np.array([major, -1j * minor])
    east = along * np.cos(np.radians(turn)) - across * np.sin(np.radians(turn))
    return np.array([along * np.sin(np.radians(turn)) + across * np.cos(np.radians(turn)), east])


def _numbers(where: str, stated: Any, name: str, count: int) -> np.ndarray:
    # Whole numbers beyond all floats are none that NumPy knows.
    plain = isinstance(stated, list) and all(type(v) in (int, float) and abs(v) < 1e300 for v in stated)
    if not plain or len(stated) != count:
        raise CurrentError(f"{where}: {name} must be {count} numbers, got {repr(stated)[:40]}")
    return np.asarray(stated, float)
