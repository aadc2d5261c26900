"""The checker's own view of a current at places and times: files, tides and vortices."""

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
import yaml

from auvplan.io.ledger import Array
from auvplan.io.originals import matching, opened, path_of, places_of

_NAMES = {
    "east": ("eastward_sea_water_velocity", "sea_water_x_velocity", "uo", "u", "water_u", "u_eastward"),
    "north": ("northward_sea_water_velocity", "sea_water_y_velocity", "vo", "v", "water_v", "v_northward"),
}


class UnknownCurrentError(Exception):
    """A current that this view cannot look at; the message says why."""


def speeds_at(dataset: xr.Dataset, places: Array, moments: Array, true: bool = False) -> Array:
    """Return the horizontal speed of the current, m/s, at times, [n].

    Args:
        dataset: `mission.nc`, whose scenario names the current.
        places: [1 or n, 3] m north, east, depth.
        moments: [n] s since the departure.
        true: return the current that a simulated vehicle was in, NaN where the file does not hold it; the
            forecast otherwise.

    Raises:
        UnknownCurrentError: it is of a kind that this view does not know.
    """
    settings = json.loads(str(dataset.attrs["scenario"])).get("current", {})
    if true and settings.get("source", "vortices") == "vortices":
        return _of_vortices(dataset, settings, np.broadcast_to(places, (len(moments), 3)), moments)
    if "site_longitude" not in dataset.attrs or "site_epoch" not in dataset.attrs:
        raise UnknownCurrentError("the run has no site or date")
    epoch = datetime.fromisoformat(str(dataset.attrs["site_epoch"]))
    when = np.array(
        [np.datetime64((epoch + timedelta(seconds=float(t))).replace(tzinfo=None)) for t in moments]
    )
    places = np.broadcast_to(places, (len(moments), 3))
    longitude, latitude = places_of(dataset)(places[:, 0], places[:, 1])
    if settings.get("source") == "harmonic":
        path = path_of(dataset, settings["constituents"])
        return _of_tide(path, dataset.attrs, longitude, latitude, places, when)
    if settings.get("source") != "file":
        raise UnknownCurrentError(f"a current of source {settings.get('source')!r}")
    simulated = true and bool(dataset.attrs.get("simulated", 1))
    files = (settings.get("truth") if simulated else None) or settings["files"]
    paths = [str(path_of(dataset, name)) for name in ([files] if isinstance(files, str) else files)]
    names = matching(paths)
    if len(names) != 1:
        raise UnknownCurrentError("a current of several files")
    return _of_file(names[0], longitude, latitude, places[:, 2], when)


def _of_vortices(dataset: xr.Dataset, settings: dict[str, Any], places: Array, moments: Array) -> Array:
    """Speeds of the Lamb vortices that a run holds of every plan: known until the field changes (Eqs 1-2)."""
    if "vortex_center" not in dataset:
        raise UnknownCurrentError("the run holds no vortices")
    planning = json.loads(str(dataset.attrs["scenario"])).get("planning", {})
    by_window = planning.get("preset") == "paper" or planning.get("current_updates") == "window"
    made_at, interval = dataset["plan_made_at"].values, float(settings.get("update_interval", np.inf))
    until = (np.floor(made_at / interval) + 1.0) * interval
    if not dataset.attrs.get("simulated", 1):
        until = np.full(len(made_at), np.inf)
    elif by_window:
        until = made_at
    fields = [dataset[f"vortex_{name}"].values.astype(float) for name in ("center", "strength", "radius")]
    speeds = np.full(len(moments), np.nan)
    for plan, (begin, end) in enumerate(zip(made_at, until, strict=True)):
        inside = (moments >= begin) & (moments < max(end, begin + 1e-3))
        if not inside.any():
            continue
        x, y, z = places[inside].T
        centre, strength, radius = (field[plan] for field in fields)
        offset = np.stack([x, y], axis=1)[:, None, None] - centre  # [n, layers, K, 2]
        square = np.maximum((offset**2).sum(axis=-1), 1e-12)
        factor = strength / (2.0 * np.pi * square) * -np.expm1(-square / radius**2)
        layers = np.stack([(-factor * offset[..., 1]).sum(axis=-1), (factor * offset[..., 0]).sum(axis=-1)])
        depths = dataset["vortex_depth"].values[plan].astype(float)
        level = np.interp(z, depths, np.arange(len(depths)))
        below = np.minimum(level.astype(int), max(len(depths) - 2, 0))
        above, share, row = np.minimum(below + 1, len(depths) - 1), level - below, np.arange(len(z))
        velocity = (1.0 - share) * layers[:, row, below] + share * layers[:, row, above]
        uniform = dataset["vortex_uniform"].values[plan][:2].astype(float)
        speeds[inside] = np.hypot(*(velocity + uniform[:, None]))
    return speeds


def _of_tide(
    path: Path, attributes: Any, longitude: Array, latitude: Array, places: Array, when: Any
) -> Array:
    """Speeds of tidal constituents, as utide reconstructs them at each place."""
    from utide import reconstruct
    from utide._ut_constants import ut_constants
    from utide.utilities import Bunch

    stated = yaml.safe_load(path.read_text(encoding="utf-8-sig"))
    here = {"longitude": float(attributes["site_longitude"]), "latitude": float(attributes["site_latitude"])}
    sites = stated.get("places") or [stated | here]
    names, frequency = list(ut_constants.const.name), ut_constants.const.freq
    away, velocities = [], []
    for one in sites:
        ellipses = {name: _ellipse(value) for name, value in one["constituents"].items()}
        lind = np.array([names.index(name) for name in ellipses])
        major, minor, turn, lag = np.array(list(ellipses.values())).T
        options = dict.fromkeys(("nodsatlint", "nodsatnone", "gwchlint", "gwchnone"), False)
        options |= {"twodim": True, "notrend": True, "nodiagn": True, "prefilt": []}
        start = np.datetime64("2000-01-01")
        days = (np.asarray(when) - start) / np.timedelta64(1, "D")
        aux = Bunch(
            opt=Bunch(options),
            reftime=float(days.mean()),
            frq=frequency[lind],
            lind=lind,
            lat=one["latitude"],
        )
        mean = one.get("mean", [0.0, 0.0])
        coef = Bunch(name=list(ellipses), Lsmaj=major, Lsmin=minor, theta=turn, g=lag, aux=aux)
        coef.umean, coef.vmean = mean
        ordinal = datetime(2000, 1, 1).toordinal()
        aux.reftime += ordinal
        found = reconstruct(days + ordinal, coef, epoch="python", verbose=False)
        velocities.append(np.asarray(found.u) + 1j * np.asarray(found.v))
        east = (longitude - one["longitude"]) * np.cos(np.radians(one["latitude"]))
        away.append(np.hypot(east, latitude - one["latitude"]) * 111_200.0)
    weights = 1.0 / (np.array(away) ** 2 + 1.0)
    share = np.interp(places[:, 2], stated.get("depths", [0.0]), stated.get("shares", [1.0]))
    return np.abs((weights * np.array(velocities)).sum(axis=0) / weights.sum(axis=0)) * share


def _ellipse(stated: dict[str, Any]) -> tuple[float, ...]:
    """Semi-major and semi-minor axes, m/s, inclination and phase, degrees, of a constituent."""
    if "ellipse" in stated:
        return tuple(stated["ellipse"])
    u, v = (size * np.exp(-1j * np.radians(lag)) for size, lag in (stated["u"], stated["v"]))
    forth, back = 0.5 * (u + 1j * v), 0.5 * (u - 1j * v).conjugate()
    turn, lag = (np.angle(forth) + np.angle(back)) / 2.0, (np.angle(back) - np.angle(forth)) / 2.0
    return abs(forth) + abs(back), abs(forth) - abs(back), np.degrees(turn), np.degrees(lag) % 360.0


def _of_file(path: str, longitude: Array, latitude: Array, depth: Array, when: Any) -> Array:
    """Speeds in a file on a grid of longitude and latitude, linear between its nodes."""
    with opened(path) as data:
        parts = []
        for names in _NAMES.values():
            found = [
                n for n, v in data.data_vars.items() if n in names or v.attrs.get("standard_name") in names
            ]
            if not found:
                raise UnknownCurrentError("the names of its current are not known")
            values = data[found[0]]
            at: dict[Any, Any] = {}
            for dim in values.dims:
                word = str(dim).lower()
                if word.startswith("lat"):
                    at[dim] = latitude
                elif word.startswith("lon"):
                    axis = values[dim].values
                    at[dim] = axis[0] + (longitude - axis[0]) % 360.0
                elif "time" in word:
                    at[dim] = when
                elif values.sizes[dim] == 1:
                    values = values.isel({dim: 0})
                else:
                    at[dim] = np.clip(depth, values[dim].values.min(), values[dim].values.max())
            if any(dim not in values.indexes for dim in at):
                raise UnknownCurrentError("its grid has no axes of longitude and latitude")
            points = {dim: xr.DataArray(axis, dims="point") for dim, axis in at.items()}
            parts.append(np.asarray(values.interp(points).values, float))
    speeds = np.hypot(*parts)
    if not np.isfinite(speeds).all():
        raise UnknownCurrentError("it has no value there")
    return speeds
