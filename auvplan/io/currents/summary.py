"""What an ocean model's files hold, in a few lines."""

from typing import Any

import numpy as np

from auvplan.io.currents.ocean import OceanData
from auvplan.io.currents.times import stamp

_KINDS = {
    "regular": "regular grid of longitude and latitude",
    "curvilinear": "curvilinear grid",
    "roms": "curvilinear grid with components on the edges of its cells",
    "triangles": "mesh",
}


def summary_of(ocean: OceanData) -> dict[str, Any]:
    """Return kind, extent, times and levels of a current, ready for JSON."""
    points = ocean.velocity.points
    shape = ocean.longitude.shape if ocean.kind != "regular" else (len(ocean.latitude), len(ocean.longitude))
    found: dict[str, Any] = {
        "files": ocean.series.label,
        "kind": _KINDS[ocean.kind],
        "points": " x ".join(map(str, shape)),
        "longitude": _span(ocean.longitude),
        "latitude": _span(ocean.latitude),
        "times": len(ocean.times),
        "from": stamp(ocean.times[0]),
        "to": stamp(ocean.times[-1]),
    }
    if len(ocean.times) > 1:
        found["step_h"] = round(float(np.median(np.diff(ocean.times))) / 3600.0, 4)
    if ocean.levels is None:
        found["levels"] = "follow the sea bed"
    elif len(ocean.levels) == 1:
        found["levels"] = f"one, {ocean.levels[0]:g} m"
    else:
        found["levels"] = f"{len(ocean.levels)}, {ocean.levels[0]:g} to {ocean.levels[-1]:g} m"
    names = {
        "components": f"{ocean.velocity.east.name}, {ocean.velocity.north.name}",
        "vertical": None if ocean.velocity.up is None else ocean.velocity.up.name,
        "sea_floor": points.floor_name(),
        "surface_height": points.rise_name(),
    }
    return found | {name: value or "not given" for name, value in names.items()}


def _span(values: Any) -> str:
    return f"{np.nanmin(values):.4f} to {np.nanmax(values):.4f}"
