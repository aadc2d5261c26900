"""Tables: waypoints as comma-separated values, all samples as CF trajectories in NetCDF."""

import csv
import io
from datetime import UTC
from typing import Any

import numpy as np
import xarray as xr

from auvplan.export.itinerary import (
    Itinerary,
    Track,
    by_true_north,
    degrees,
    geographic,
    metres,
    moment,
    waypoints,
)
from auvplan.io.fields import motion_variables, variable
from auvplan.io.schema import TIME_UNITS
from auvplan.path.motion import Motion
from auvplan.site import as_utc

#: Degrees; metres, north and east in the local frame, depth positive down; UTC; s; the task's priority.
#: Yaw, from true north, and pitch of the hull, degrees, and its surge, sway and heave, m/s, are those of the
#: planned path at that place: the bearing of the straight line to the next waypoint may differ. Where the
#: battery is known, a column charge follows, the share of its usable energy that is left; where legs have
#: their own speeds, a column speed, m/s through the water on the way there.
COLUMNS = (
    "leg", "seq", "name", "lon", "lat", "depth", "time", "north", "east", "hold", "task", "note",
    "yaw", "pitch", "surge", "sway", "heave",
)  # fmt: skip


def csv_text(itinerary: Itinerary) -> bytes:
    """Return the waypoints, a row each.

    Times are empty where the site has no epoch, attitude and velocities where they are not known; notes stand
    where legs end, and with the first waypoint what concerns all.
    """
    notes = {leg.number: leg.note for leg in itinerary.legs}
    about = "; ".join((*itinerary.sources, *itinerary.warnings))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    rows = waypoints(itinerary)
    charged = any(not np.isnan(row.charge) for row in rows)
    paced = bool(itinerary.speeds)
    writer.writerow((*COLUMNS, *["charge"] * charged, *["speed"] * paced))
    for sequence, row in enumerate(rows, 1):
        note = notes[row.leg] if row.ends_leg else about if sequence == 1 else ""
        writer.writerow((
            row.leg, sequence, row.name, degrees(row.longitude), degrees(row.latitude), metres(row.depth),
            moment(itinerary.site, row.seconds) or "", metres(row.position[0]), metres(row.position[1]),
            f"{row.hold:.1f}", f"{row.priority:g}", note,
            *(_known(value, 2) for value in (row.yaw, row.pitch)),
            *(_known(value, 3) for value in row.body_velocity),
            *[_known(row.charge, 4)] * charged,
            *[f"{row.speed:.4f}"] * paced,
        ))  # fmt: skip
    return text.getvalue().encode()


def _known(value: float, decimals: int) -> str:
    """Return a number, never -0, or nothing where it is NaN."""
    return "" if np.isnan(value) else f"{round(float(value), decimals) + 0.0:.{decimals}f}"


def trajectories(itinerary: Itinerary) -> xr.Dataset:
    """Return all samples of all legs as a contiguous ragged array, planned first, then executed."""
    planned = [Track(leg.times, leg.positions, leg.motion) for leg in itinerary.legs]
    tracks = [*planned, *itinerary.executed]
    names = [f"plan, leg {leg.number}" for leg in itinerary.legs]
    names += [f"executed, leg {number}" for number in range(1, len(itinerary.executed) + 1)]
    places = np.concatenate([track.positions for track in tracks])
    where = geographic(itinerary.site, places)
    longitude, latitude, _ = where.T
    motion = by_true_north(Motion.joined([track.motion for track in tracks]), itinerary.site, where)
    kept = [np.isin(np.arange(len(leg.times)), leg.kept) for leg in itinerary.legs]
    kept += [np.zeros(len(track.times), bool) for track in itinerary.executed]
    more: dict[str, Any] = {}
    if any(leg.charge is not None for leg in itinerary.legs):
        left = [
            np.full(len(leg.times), np.nan) if leg.charge is None else leg.charge for leg in itinerary.legs
        ]
        left += [np.full(len(track.times), np.nan) for track in itinerary.executed]
        words = "share of the battery's usable energy that is left, as planned"
        more["charge"] = variable("obs", np.concatenate(left), words, "1")
    if itinerary.speeds:
        own = [itinerary.through_water(leg) for leg in itinerary.legs] + [np.nan] * len(itinerary.executed)
        words = "speed through the water that the leg is planned to be gone at"
        more["leg_speed"] = variable("trajectory", own, words, "m s-1")
    units = TIME_UNITS
    if (epoch := itinerary.site.epoch) is not None:
        units = f"seconds since {as_utc(epoch).astimezone(UTC).replace(tzinfo=None).isoformat(' ')}"
    flags: dict[str, Any] = {"flag_values": np.asarray([0, 1], np.int8)}
    rows = np.asarray([len(track.times) for track in tracks], np.int32)
    kinds = np.repeat(np.asarray([0, 1], np.int8), [len(planned), len(itinerary.executed)])
    times = np.concatenate([track.times for track in tracks])
    dataset = xr.Dataset({
        "trajectory": variable(
            "trajectory", np.asarray(names, object), "name of the leg", cf_role="trajectory_id"
        ),
        "row_size": variable("trajectory", rows, "samples of the leg", "1", sample_dimension="obs"),
        "kind": variable(
            "trajectory", kinds, "whether the leg is planned or was executed",
            flag_meanings="planned executed", **flags,
        ),
        "time": variable(
            "obs", times, "time", units, standard_name="time", calendar="standard", axis="T"
        ),
        "lon": variable("obs", longitude, "longitude", "degrees_east", standard_name="longitude", axis="X"),
        "lat": variable("obs", latitude, "latitude", "degrees_north", standard_name="latitude", axis="Y"),
        "depth": variable(
            "obs", places[:, 2], "depth below the surface", "m", standard_name="depth", positive="down",
            axis="Z",
        ),
        "north": variable("obs", places[:, 0], "north in the local frame", "m"),
        "east": variable("obs", places[:, 1], "east in the local frame", "m"),
        "waypoint": variable(
            "obs", np.concatenate(kept).astype(np.int8), "whether the sample was kept as a waypoint",
            flag_meanings="no yes", **flags,
        ),
        **motion_variables("obs", motion, true_north=True),
        **more,
    }, attrs=_attributes(itinerary))  # fmt: skip
    return dataset.set_coords(["time", "lon", "lat", "depth"])


def _attributes(itinerary: Itinerary) -> dict[str, Any]:
    site = itinerary.site
    comment = f"{itinerary.description}. {'; '.join(leg.note for leg in itinerary.legs)}."
    if site.epoch is None:
        comment += " The mission has no date: its epoch is written as 2000-01-01."
    return {
        "Conventions": "CF-1.11",
        "featureType": "trajectory",
        "title": f"AUV mission {itinerary.name}",
        "source": f"auvplan {itinerary.version}",
        "comment": comment,
        "auvplan_version": itinerary.version,
        "configuration": itinerary.configuration,
        "seed": np.int64(itinerary.seed),
        "vehicle_speed": float(itinerary.speed),
        "site_longitude": float(site.longitude),
        "site_latitude": float(site.latitude),
        "site_origin": np.asarray(site.origin, float),
    }
