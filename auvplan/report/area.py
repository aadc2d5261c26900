"""What lies under a map: frame, coast and uncertain area as pictures, sea bed, currents; sections."""

import base64
import io
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from auvplan.ocean.chart import Chart
from auvplan.ocean.seabed import Seabed
from auvplan.records import MissionRun
from auvplan.report.page import packed
from auvplan.runtime.arrays import Array
from auvplan.site import Site
from auvplan.view.section import PARTS, run_sections, true_current

#: Coast and uncertain area on light and on dark pages; water is transparent.
_COLOURS = {"light": ("#c9b98f", "#eae1c6"), "dark": ("#5a5038", "#37342a")}
#: Pixels of a chart's picture, and points of a sea bed, along the longer edge at most.
_PIXELS, _POINTS = 1600, 160
#: Arrows along the longer edge of the map, and moments at which they are looked up.
_ARROWS, _MOMENTS = 22, 60
#: Stands for a current that is nowhere, such as on land; units of `_STEP`.
_NONE = -32768
#: m/s, steps in which currents are stored.
_STEP = 0.001


def map_data(
    low: Array, high: Array, chart: Chart | None, seabed: Seabed | None, site: Site | None
) -> dict[str, Any]:
    """Return what a map between two corners, [2] m, shows under everything else; its place with a site.

    Longitudes of its corners go on beyond 180 degrees where the map lies across.
    """
    # South-west, south-east, north-west and north-east.
    north, east = np.asarray([low[0], low[0], high[0], high[0]]), np.tile([low[1], high[1]], 2)
    corners = None
    if site is not None:
        longitude, latitude = site.to_geographic(north, east)
        corners = np.stack([np.unwrap(longitude, period=360.0), latitude], axis=1).tolist()
    return {
        "low": low,
        "high": high,
        "chart": None if chart is None else _picture(chart, low, high),
        "depths": None if seabed is None else _depths(seabed, low, high),
        "corners": corners,
    }


def _picture(chart: Chart, low: Array, high: Array) -> dict[str, Any] | None:
    """Coast and uncertain area within a frame as PNG, for light and dark pages; None where all is water."""
    raster, size = np.asarray(chart.passability), float(chart.pixel_size)
    corner = np.asarray(chart.lower, float)
    begin = np.clip(np.floor((low - corner) / size).astype(int), 0, raster.shape)
    end = np.clip(np.ceil((high - corner) / size).astype(int), 0, raster.shape)
    part = raster[begin[0] : end[0], begin[1] : end[1]]
    if not part.size:
        return None
    step = max(1, -(-max(part.shape) // _PIXELS))
    short = [-length % step for length in part.shape]
    part = np.pad(part, [(0, more) for more in short], mode="edge")
    blocks = part.reshape(part.shape[0] // step, step, part.shape[1] // step, step).min(axis=(1, 3))
    kinds = np.where(blocks == 0.0, 1, np.where(blocks < 1.0, 2, 0)).astype(np.uint8)
    if not kinds.any():
        return None
    far = begin + np.asarray(blocks.shape) * step
    return {
        "low": corner + begin * size,
        "high": corner + far * size,
        "uncertain": bool((kinds == 2).any()),
        **{theme: _png(kinds[::-1], colours) for theme, colours in _COLOURS.items()},
    }


def _png(kinds: NDArray[np.uint8], colours: Sequence[str]) -> str:
    """Classes 0 (transparent), 1, 2, north up, as a data URI."""
    picture = Image.fromarray(kinds)
    picture.putpalette(bytes.fromhex("000000" + "".join(colour[1:] for colour in colours)))
    file = io.BytesIO()
    picture.save(file, "PNG", bits=2, transparency=0, compress_level=6)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode("ascii")


def _depths(seabed: Seabed, low: Array, high: Array) -> dict[str, Any]:
    """Depths of the sea bed at points within a frame, as far as the raster reaches."""
    low, high = np.maximum(low, np.asarray(seabed.lower)), np.minimum(high, np.asarray(seabed.upper))
    north, east = _grid(low, high, _POINTS)
    x, y = np.meshgrid(north, east, indexing="ij")
    # The altitude of the surface above the bed is its depth.
    depth = seabed.altitude(np.stack([x, y, np.zeros_like(x)], axis=-1))
    return {"north": packed(north), "east": packed(east), "depth": packed(np.round(depth, 1))}


def _grid(low: Array, high: Array, most: int) -> tuple[Array, Array]:
    """Points [n] north and [m] east in squares, `most` along the longer edge."""
    step = float((high - low).max()) / most
    counts = [max(2, round(float(edge) / step)) for edge in high - low]
    edges = zip(low, high, counts, strict=True)
    north, east = (first + (np.arange(count) + 0.5) * (last - first) / count for first, last, count in edges)
    return north, east


def current_data(
    run: MissionRun, low: Array, high: Array, times: Array, depths: Array
) -> dict[str, Any] | None:
    """Return the true current between two corners, [2] m, over time, at the depth of the track then.

    At each moment it is the current of the latest plan; None where no path was planned.
    """
    plans = sorted((plan for leg in run.legs for plan in leg.plans), key=lambda plan: plan.made_at)
    if not plans:
        return None
    first, last = plans[0].made_at, max(float(times[-1]) if len(times) else 0.0, plans[-1].made_at)
    made = [plan.made_at for plan in plans]
    step = max(1, -(-len(made) // _MOMENTS))
    moments = np.unique(np.round([*np.linspace(first, last, _MOMENTS), *made[::step]], 3))
    north, east = _grid(low, high, _ARROWS)
    x, y = np.meshgrid(north, east, indexing="ij")
    levels = np.full(len(moments), plans[0].positions[0, 2])
    if len(times):
        levels = np.interp(moments, times, depths)
    where = np.broadcast_arrays(x, y, levels[:, None, None], moments[:, None, None])
    u, v, _ = true_current(plans)(*where)
    speed = np.hypot(u, v)
    known = np.isfinite(speed)
    if run.chart is not None:
        known &= np.asarray(run.chart.is_water(x.ravel(), y.ravel())).reshape(x.shape)
    if not known.any():
        return None
    return {
        "times": moments,
        "depths": levels,
        "north": north,
        "east": east,
        "u": packed(np.where(known, u, _NONE * _STEP), "i16", _STEP),
        "v": packed(np.where(known, v, _NONE * _STEP), "i16", _STEP),
        "fastest": float(np.quantile(speed[known], 0.99)),
    }


def section_data(run: MissionRun) -> dict[str, Any] | None:
    """Return the vertical sections along the legs in a row; None where nothing differs with depth."""
    sections = run_sections(run)
    if not sections:
        return None
    rows = len(sections[0].depth) - 1
    # Between two legs, where the vehicle may wait, there is a column without a value.
    parts = [part for one in sections for part in (one.along, np.full((rows, 1), np.nan))][:-1]
    along = np.concatenate(parts, axis=1)
    known = np.isfinite(along)
    outlines = [
        {"kind": cut.kind, "grown": grown, "times": one.time[[*piece, *piece[::-1]]],
         "depths": np.round([*ends[0, piece], *ends[1, piece[::-1]]], 1)}
        for one in sections
        for cut in one.cuts
        for grown, ends in ((False, cut.solid), (True, cut.boundary))
        for piece in _pieces(np.isfinite(ends[0]))
    ]  # fmt: skip
    return {
        "depth": sections[0].depth,
        "times": packed(np.concatenate([one.time[::PARTS] for one in sections])),
        "along": packed(np.where(known, along, _NONE * _STEP), "i16", _STEP),
        "fastest": float(np.quantile(np.abs(along[known]), 0.995)) if known.any() else 0.0,
        "outlines": outlines,
        "earlier": [
            {"times": np.interp(line[:, 0], one.distance, one.time), "depths": np.round(line[:, 1], 2)}
            for one in sections
            for line in one.earlier
        ],
    }


def _pieces(shown: NDArray[np.bool_]) -> list[NDArray[np.int_]]:
    """Indices of each run of places that are shown, where there is more than one."""
    places = np.flatnonzero(shown)
    return [piece for piece in np.split(places, np.flatnonzero(np.diff(places) > 1) + 1) if len(piece) > 1]
