"""Charts, sea beds, vortices, motions and sites as variables and attributes of a file, and back."""

from collections.abc import Sequence
from datetime import datetime
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from auvplan.ocean.chart import Chart
from auvplan.ocean.seabed import Seabed
from auvplan.ocean.vortices import LambVortices
from auvplan.path.motion import Motion
from auvplan.records import LegRecord
from auvplan.site import Site

#: Steps of the stored passability; 0 is coast and nothing else is.
LEVELS = 255

Variables = dict[str, xr.Variable]

#: Arrays of vortices by the names of their variables, with what they are and their units.
_VORTICES = {
    "centers": ("vortex_center", ("plan", "layer", "vortex", "horizontal"), "north, east of the centre", "m"),
    "strength": ("vortex_strength", ("plan", "layer", "vortex"), "strength", "m2 s-1"),
    "radius": ("vortex_radius", ("plan", "layer", "vortex"), "radius", "m"),
    "depths": ("vortex_depth", ("plan", "layer"), "depth of the layer", "m"),
    "vertical_scale": ("vortex_vertical_scale", ("plan",), "gamma of Eq. 1", "m"),
    "uniform": ("vortex_uniform", ("plan", "axis"), "velocity added everywhere", "m s-1"),
}

#: Body velocities of Eq. 7 by the names of their variables, and which way they count.
_BODY = {"surge": "forward", "sway": "to starboard", "heave": "downward"}


#: m/s, what is slower is zero but for the rounding of angles.
_ROUNDING = 1e-12

#: Histories of a search, by iteration, with what they are and their units.
HISTORIES = {
    "best": ("least cost", "s"),
    "mean": ("mean cost of the population", "s"),
    "std": ("standard deviation of the cost", "s"),
    "violation_best": ("violation of the habitat of least cost", "1"),
    "violation_mean": ("mean violation of the population", "1"),
    "violation_std": ("standard deviation of the violation", "1"),
}


def history_variables(histories: Sequence[dict[str, Any]]) -> Variables:
    """Return how the search for each plan went, padded to the longest."""
    counts = np.asarray([len(history.get("best", ())) for history in histories], np.int32)
    if not counts.any():
        return {}
    found = {
        "plan_iterations": variable("plan", counts, "iterations kept, the first population included", "1")
    }
    for name, (words, units) in HISTORIES.items():
        rows = padded([history.get(name, ()) for history in histories], np.nan, np.float32, counts.max())
        found[f"plan_history_{name}"] = variable(("plan", "iteration"), rows, f"{words} by iteration", units)
    return found


def history_of(dataset: xr.Dataset, plan: int) -> dict[str, Any]:
    """Return how the search for a plan went; empty where the file has none."""
    if "plan_iterations" not in dataset:
        return {}
    count = int(dataset["plan_iterations"].values[plan])
    return {name: dataset[f"plan_history_{name}"].values[plan, :count] for name in HISTORIES}


def padded(rows: Sequence[Any], fill: float, dtype: Any = float, length: int | None = None) -> NDArray[Any]:
    """Return rows of different lengths as one array, filled up to the longest, or to a length."""
    trail = np.shape(max(rows, key=len))[1:]
    most = max(len(row) for row in rows) if length is None else length
    found = np.full((len(rows), most, *trail), fill, dtype)
    for here, row in zip(found, rows, strict=True):
        here[: len(row)] = row
    return found


def variable(
    dims: str | tuple[str, ...], values: ArrayLike, name: str, units: str | None = None, **attrs: Any
) -> xr.Variable:
    """Return a variable with `long_name`, `units` where it has any, and further attributes."""
    return xr.Variable(
        dims, np.asarray(values), {"long_name": name} | ({"units": units} if units else {}) | attrs
    )


def site_of(dataset: xr.Dataset) -> Site | None:
    """Return where the local frame of a file lies, or None."""
    attributes = dataset.attrs
    if "site_longitude" not in attributes:
        return None
    north, east = (float(value) for value in np.asarray(attributes["site_origin"]))
    epoch = datetime.fromisoformat(attributes["site_epoch"]) if "site_epoch" in attributes else None
    return Site(float(attributes["site_longitude"]), float(attributes["site_latitude"]), epoch, (north, east))


def _passability(chart: Chart, dims: tuple[str, str], name: str) -> xr.Variable:
    """Return the passability raster in steps of 1/255."""
    passability = np.asarray(chart.passability, float)
    steps = np.where(passability > 0.0, np.clip(np.rint(passability * LEVELS), 1, LEVELS), 0)
    return variable(
        dims, steps.astype(np.uint8), name, "1",
        scale_factor=1.0 / LEVELS, valid_range=np.asarray([0, LEVELS], np.uint8),
        comment="0 coast, up to 0.35 uncertain, 1 water; stored in steps of 1/255, coast alone is 0",
    )  # fmt: skip


def _located(raster: Chart | Seabed, prefix: str) -> Variables:
    """Return where a raster lies."""
    corner, size = np.asarray(raster.origin, float)[:2], float(np.asarray(raster.pixel_size))
    return {
        f"{prefix}_origin": variable(
            "horizontal", corner, "south-west corner of the raster: north, east", "m"
        ),
        f"{prefix}_pixel_size": variable((), size, "edge of a pixel", "m"),
    }


def coast_variables(coast: Chart) -> Variables:
    """Return the passability without closed areas, also beyond the area, and where it lies."""
    words = "passability without closed areas"
    return {"coast": _passability(coast, ("coast_x", "coast_y"), words), **_located(coast, "coast")}


def chart_variables(chart: Chart) -> Variables:
    """Return the passability raster in steps of 1/255, and the centres of its pixels."""
    size, corner = float(np.asarray(chart.pixel_size)), np.asarray(chart.origin, float)
    north, east = (corner[k] + size * (np.arange(chart.shape[k]) + 0.5) for k in range(2))
    return {
        "passability": _passability(chart, ("chart_x", "chart_y"), "passability"),
        "chart_x": variable("chart_x", north, "north of the pixel's centre", "m"),
        "chart_y": variable("chart_y", east, "east of the pixel's centre", "m"),
        **_located(chart, "chart"),
    }


def chart_of(dataset: xr.Dataset, name: str = "passability", place: str = "chart") -> Chart | None:
    """Return the chart that `chart_variables` wrote, or that of `coast_variables` by its names; or None."""
    if name not in dataset:
        return None
    north, east = (float(axis) for axis in dataset[f"{place}_origin"].values)
    raster = np.asarray(dataset[name].values, np.float32)
    return Chart.from_passability(raster, float(dataset[f"{place}_pixel_size"]), (north, east))


def seabed_variables(seabed: Seabed) -> Variables:
    """Return the depth raster, and where it lies."""
    depth, stated = np.asarray(seabed.depth, np.float32), "sea_floor_depth_below_sea_surface"
    dims = "seabed_x", "seabed_y"
    return {
        "seabed_depth": variable(dims, depth, "depth of the sea bed", "m", standard_name=stated),
        **_located(seabed, "seabed"),
    }


def seabed_of(dataset: xr.Dataset) -> Seabed | None:
    """Return the sea bed that `seabed_variables` wrote, or None."""
    if "seabed_depth" not in dataset:
        return None
    corner = dataset["seabed_origin"].values
    return Seabed.from_depth(
        dataset["seabed_depth"].values,
        float(dataset["seabed_pixel_size"]),
        corner,
        clearance=float(dataset.attrs["seabed_clearance"]),
    )


def vortex_variables(legs: Sequence[LegRecord]) -> Variables:
    """Return the true vortices at every plan; nothing where the current is no vortices."""
    fields = [plan.current for leg in legs for plan in leg.plans]
    if not fields or not all(isinstance(field, LambVortices) for field in fields):
        return {}
    return {
        name: variable(
            dims, np.stack([np.asarray(getattr(f, key)) for f in fields]), f"vortices: {what}", units
        )
        for key, (name, dims, what, units) in _VORTICES.items()
    }


def vortices_of(dataset: xr.Dataset, plan: int) -> LambVortices | None:
    """Return the vortices at a plan that `vortex_variables` wrote, or None."""
    if "vortex_center" not in dataset:
        return None
    arrays: dict[str, Any] = {
        key: np.asarray(dataset[name].values[plan]) for key, (name, *_) in _VORTICES.items()
    }
    return LambVortices(**arrays)


def motion_variables(
    dims: str | tuple[str, ...], motion: Motion, prefix: str = "", *, true_north: bool = False
) -> Variables:
    """Write course, attitude and body velocities, an array each.

    CF's names of course and yaw are those of angles from true north; the local frame's have none.
    """
    yaw, pitch = (np.degrees(angle).astype(np.float32) for angle in (motion.yaw, motion.pitch))
    body = np.where(np.abs(motion.body_velocity) < _ROUNDING, 0.0, motion.body_velocity).astype(np.float32)
    # The course is that of what is filed, so that a run that was read back is filed as it was.
    course = Motion.of_body(np.radians(yaw, dtype=float), np.radians(pitch, dtype=float), body).course
    course = np.degrees(course % (2.0 * np.pi)).astype(np.float32)
    course = np.where(course >= 360.0, 0.0, course)  # just west of north
    named = {"course": "platform_course", "yaw": "platform_yaw_fore_starboard"} if true_north else {}
    named |= {"pitch": "platform_pitch_fore_up"}
    north = "true north" if true_north else "the local frame's north"
    angles = {
        "course": (course, f"course over ground, clockwise from {north}"),
        "yaw": (yaw, f"yaw psi of the hull, clockwise from {north}"),
        "pitch": (pitch, "pitch theta of the hull, nose up"),
    }
    return {
        prefix + name: variable(
            dims,
            values.astype(np.float32),
            what,
            "degree",
            **({"standard_name": named[name]} if name in named else {}),
        )
        for name, (values, what) in angles.items()
    } | {
        prefix + name: variable(
            dims, body[..., axis], f"{name}: speed over ground {sense} of the hull", "m s-1"
        )
        for axis, (name, sense) in enumerate(_BODY.items())
    }


def motion_of(dataset: xr.Dataset, prefix: str = "") -> Motion:
    """Read what `motion_variables` wrote."""
    yaw, pitch = (np.radians(np.asarray(dataset[prefix + name].values, float)) for name in ("yaw", "pitch"))
    body = np.stack([dataset[prefix + name].values for name in _BODY], axis=-1)
    return Motion.of_body(yaw, pitch, body)
