"""Times of ocean files: CF units and calendars to UTC moments and seconds since 1970."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from importlib.util import find_spec
from typing import Any

import numpy as np
import xarray as xr

from auvplan.io.currents.files import Array, File
from auvplan.ocean.gridded import CurrentError
from auvplan.site import as_utc

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
#: Calendars that xarray decodes by itself.
_WITHOUT_CFTIME = ("", "standard", "gregorian", "proleptic_gregorian")
#: Misspelt names of calendars.
_MISSPELT = {"gregorian_proleptic": "proleptic_gregorian", "gregorian-proleptic": "proleptic_gregorian"}
#: Units of astronomers' days, which name no date.
_JULIAN = {
    "julian": "days since -4713-11-24 12:00:00",
    "modified julian": "days since 1858-11-17",
    "mjd": "days since 1858-11-17",
}
#: What may stand for UTC, a time zone at the end of a date, and dates that begin with day or month.
_UTC = ("Z", "UTC", "GMT", "UT")
_ZONE = re.compile(r"^\d.*?\d\s*([A-Za-z]+(?:\s*[-+][\d:]*[1-9][\d:]*)?)\s*$")
_DAY_FIRST = re.compile(r"\d{1,2}[-/.]\d{1,2}[-/.]\d{4}")
#: Times whose resolution is coarser, s, are noted.
_COARSE = 10.0
_NAMES = ("time", "ocean_time", "Time", "TIME", "t", "time_counter", "MT")


def find_time(file: File, dims: tuple[str, ...]) -> str:
    """Return the variable with the times of a field with these dimensions.

    It is one-dimensional, or one value.

    Raises:
        CurrentError: there is none.
    """
    found, plain = [], []
    for name, variable in file.variables.items():
        units, named = file.text(name, "units"), name in _NAMES
        along = variable.ndim == 1 and variable.dims[0] in dims
        standard = file.text(name, "standard_name") == "time"
        if (along or variable.ndim == 0) and " since " in f" {units} ".lower():
            likely = standard, named, file.text(name, "axis") == "T", name in variable.dims, variable.ndim
            # HYCOM's tau, "hours since analysis", is no date.
            if any(likely[:4]) or any(letter.isdigit() for letter in units):
                found.append((likely, name))
        if along and (named or (standard and variable.dims == (name,))):
            plain.append(name)
    plain += [name for name in file.variables if _is_text_of(file, name, dims)]
    if not (found or plain):
        raise file.fail(
            "no time coordinate with units like 'seconds since 1970-01-01': give it one, such as by ncap2"
        )
    return max(found)[1] if found else plain[0]


def decode_times(file: File, name: str) -> tuple[Array, list[str]]:
    """Seconds since 1970-01-01 UTC of the values of a time coordinate [T], and notes on how they were read.

    Raises:
        CurrentError: dates are missing, cannot be understood, or run backwards.
    """
    variable, notes = file.variables[name], []
    units = re.sub(r"(.*)\bsince\b", lambda found: found[0].lower(), file.text(name, "units"), flags=re.I)
    calendar = file.text(name, "calendar").lower()
    calendar = _MISSPELT.get(calendar, calendar)
    seconds, whole = None, {}
    for own, since in (("Itime", "days since 1858-11-17"), ("Itime2", "msec")):
        if own in file.variables and file.variables[own].dims == variable.dims:
            whole |= {own: file.read(own)} if file.text(own, "units").lower().startswith(since) else {}
    if len(whole) == 2:  # FVCOM's whole days and milliseconds: its float32 days are minutes off
        seconds = np.atleast_1d((whole["Itime"] - 40587.0) * 86400.0 + whole["Itime2"] / 1000.0)
    if seconds is None:
        seconds = _written_out(file, variable.dims, name)
    if seconds is None and "since" not in units:
        for words, days in _JULIAN.items():
            if units.lower().replace("_", " ").startswith(words):
                units, calendar = days, "proleptic_gregorian"
    if seconds is None and "%Y%m%d" in units:  # 20260501.25 is a quarter into a day
        values = np.atleast_1d(file.coordinate(name))
        days = np.floor(values + 1e-7)
        try:
            dates = [datetime.strptime(f"{day:.0f}", "%Y%m%d").replace(tzinfo=UTC) for day in days]
        except ValueError:
            raise file.fail(f"{name}: dates cannot be understood: {values[0]:.10g}") from None
        seconds = seconds_of(dates) + np.round((values - days) * 86400.0, 1)
    if seconds is None and "since" not in units:
        if file.epoch is None:
            raise file.fail(
                f"{name} does not state the date that it counts from: say current.epoch, such as "
                "2026-05-01T00:00:00Z"
            )
        if not units:
            notes.append(f"{name} has no units: taken as seconds since current.epoch")
        unit = units.split()[0].lower() if units else "seconds"
        units = f"{unit} since {stamp(file.epoch).removesuffix('Z')}"
    if seconds is None:
        values = np.atleast_1d(file.read(name))
        if not values.size:
            raise file.fail(f"{name} has no times")
        # 1e30 and the like would overflow before it is refused.
        if (far := np.abs(values).max()) > 1e17:
            raise file.fail(f"{name} has dates that are none: {far:g} {units}")
        seconds = _decoded(file, name, values, units, calendar)
        steps = np.diff(values)
        if variable.encoding.get("dtype", variable.dtype) == np.float32 and steps.any():
            ulp = float(np.spacing(np.float32(far))) * np.median(np.diff(seconds)) / np.median(steps)
            if ulp > _COARSE:
                notes.append(
                    f"{name} is in single precision, in steps of {ulp:.0f} s: its moments are no better known"
                )
    if not np.isfinite(seconds).all():
        raise file.fail(f"{name} has missing dates")
    if calendar not in (*_WITHOUT_CFTIME, "julian"):
        notes.append(f"{name}: dates of the calendar {calendar} are taken as UTC dates by their fields")
    if (np.diff(seconds) < 0).any():
        raise file.fail(f"{name} does not rise: sort the file by it, such as by xarray's sortby")
    return seconds, notes


def to_middles(file: File, name: str, of: str, seconds: Array) -> tuple[Array, list[str]]:
    """Return the times of means over windows of time as the middles of these, and notes.

    Means say so in their `cell_methods`; their windows are the bounds of the time coordinate, which may label
    them at any end. Other times are returned as they are.

    Args:
        name: of the time coordinate.
        of: the variable whose times they are.
        seconds: [T], as `decode_times` has them.
    """
    bounds = file.text(name, "bounds")
    variable = file.variables[name]
    if bounds not in file.variables or not _is_mean(file, of, {"time", name, *map(str, variable.dims)}):
        return seconds, []
    unused = [f"{bounds} does not hold the times of {name}, which are taken as they are"]
    stated = file.variables[bounds]
    own = {key: stated.attrs[key] for key in ("units", "calendar") if key in stated.attrs}
    try:
        windows = file.read(bounds)
        if stated.shape != (*variable.shape, 2) or not np.isfinite(windows).all():
            return seconds, unused
        begin, end = (
            decode_times(replace(file, variables={**file.variables, name: edge}), name)[0]
            for edge in (xr.Variable(variable.dims, windows[..., k], variable.attrs | own) for k in range(2))
        )
    except CurrentError:
        return seconds, unused
    # Times in single precision may lie beside their windows.
    slack, middles = 1.0 + 0.1 * np.abs(end - begin), 0.5 * (begin + end)
    if ((seconds < begin - slack) | (seconds > end + slack)).any() or (np.diff(middles) < 0).any():
        return seconds, unused
    moved = float(np.abs(middles - seconds).max())
    if moved < 1.0:
        return seconds, []
    note = f"means over time are taken at the middle of their windows ({bounds})"
    return middles, [f"{note}: {name} labels them up to {moved / 3600.0:.3g} h from there"]


def _is_mean(file: File, name: str, axes: set[str]) -> bool:
    """Return whether a variable is a mean over time, by CF's cell methods."""
    methods = re.sub(r"\([^)]*\)", " ", file.text(name, "cell_methods"))
    found = re.findall(r"((?:\w+\s*:\s*)+)(\w+)", methods)
    return any(axes & set(re.findall(r"\w+", over)) and method.lower() == "mean" for over, method in found)


def moment_of(seconds: float) -> datetime:
    """Return the moment, UTC, of seconds since 1970."""
    return _EPOCH + timedelta(seconds=float(seconds))


def seconds_of(moment: Any) -> Array:
    """Return seconds since 1970 of datetimes, datetime64 or such seconds, of any shape.

    Datetimes without a time zone are UTC.

    Raises:
        CurrentError: it is neither.
    """
    values = np.asarray(moment)
    try:
        if values.dtype.kind == "M":
            values = (values - np.datetime64(0, "s")) / np.timedelta64(1, "s")
        elif values.dtype.kind not in "fiu":
            flat = [(as_utc(value) - _EPOCH).total_seconds() for value in values.ravel().tolist()]
            values = np.reshape(flat, values.shape)
    except (AttributeError, TypeError):
        raise CurrentError(f"a moment must be a datetime or seconds since 1970, got {moment!r}") from None
    seconds = np.asarray(values, float)
    if not np.isfinite(seconds).all():
        raise CurrentError("a moment must be a date, got a missing one")
    return seconds


def stamp(seconds: float) -> str:
    """Return a moment in ISO 8601, UTC, to the second."""
    return moment_of(round(float(seconds))).strftime("%Y-%m-%dT%H:%M:%SZ")


def _decoded(file: File, name: str, values: Array, units: str, calendar: str) -> Array:
    attributes = {"units": units} | ({"calendar": calendar} if calendar else {})
    reference = units.partition(" since ")[2]
    zone = _ZONE.search(reference)
    if zone is not None and zone[1].upper() not in _UTC:
        raise file.fail(
            f"{name}: the time zone {zone[1]} in {units!r} is in doubt: write it as an offset, such as +02:00"
        )
    if _DAY_FIRST.match(reference):
        raise file.fail(f"{name}: {units!r} may begin with the day or the month: write it as YYYY-MM-DD")
    try:
        with file.guarded(name):
            found = xr.decode_cf(xr.Dataset({"time": ("time_", values, attributes)}))["time"].values
            if found.dtype.kind == "M":
                # Whole microseconds: days as floating point numbers are good for no more.
                return np.round((found - np.datetime64(0, "s")) / np.timedelta64(1, "us")) / 1e6
    except CurrentError:
        if calendar not in _WITHOUT_CFTIME and find_spec("cftime") is None:
            raise file.fail(
                f"{name}: calendar {calendar} needs a further package: pip install 'auvplan[readers]'"
            ) from None
        raise file.fail(
            f"{name}: dates cannot be understood: {units!r}: units such as 'hours since "
            "2026-05-01' are needed"
        ) from None
    moments = []
    for date in found:
        # A Julian date stands for its day, others for their fields.
        same = date.change_calendar("proleptic_gregorian") if calendar == "julian" else date
        fields = same.year, same.month, same.day, same.hour, same.minute, same.second, same.microsecond
        try:
            moments.append(datetime(*fields, tzinfo=UTC))
        except ValueError:
            day = f"{fields[0]}-{fields[1]:02d}-{fields[2]:02d}"
            raise file.fail(f"{name}: {day} of the calendar {calendar} is no UTC date") from None
    return seconds_of(moments)


def _is_text_of(file: File, name: str, dims: tuple[str, ...]) -> bool:
    """Return whether a variable holds dates as text along one of some dimensions."""
    variable, named = file.variables[name], "time" in name.lower() or "date" in name.lower()
    return named and variable.ndim in (1, 2) and variable.dims[0] in dims and variable.dtype.kind in "SUO"


def _written_out(file: File, dims: tuple, name: str) -> Array | None:
    """Dates as text to the microsecond, of the times or of FVCOM's Times; None where there are none."""
    found = [other for other in (name, "Times") if other in file.variables and dims]
    found = [other for other in found if _is_text_of(file, other, dims[:1])]
    if not found:
        return None
    with file.guarded(found[0]):
        values = np.asarray(file.variables[found[0]].values)
    rows = [
        "".join(part.decode("ascii", "replace") if isinstance(part, bytes) else str(part) for part in row)
        for row in values.reshape(len(values), -1).tolist()
    ]
    try:
        dates = [datetime.fromisoformat(row.strip(" \0").replace("_", "T").removesuffix("Z")) for row in rows]
    except ValueError:
        if found[0] == name:
            raise file.fail(
                f"{name}: dates cannot be understood: {rows[0]!r}: write them as 2026-05-01T00:00:00"
            ) from None
        return None
    return seconds_of(dates)
