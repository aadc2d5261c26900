"""Whether a peer holds what was planned."""

import math
import time
from dataclasses import replace

from auvplan.export.imc import plan_specification
from auvplan.export.qgroundcontrol import qgc_plan
from auvplan.link.imc import as_message


def held_as_planned(kind: str, peer, upload) -> bool:
    """Whether the peer holds what was planned: every field of every item of the vehicle file.

    MAVSDK hands an upload to its application a moment after it has acknowledged it.
    """
    end = time.monotonic() + 2.0
    while not (held := _held(kind, peer, upload)) and time.monotonic() < end:
        time.sleep(0.01)
    return held


def _held(kind: str, peer, upload) -> bool:
    if kind == "imc":
        named = replace(upload.itinerary, name=upload.name)
        wanted = as_message(plan_specification(named))
        held = peer.stored.get(wanted.plan_id)
        return held is not None and held.serialize_fields() == wanted.serialize_fields()
    plan = qgc_plan(upload.itinerary)
    fence = plan["geoFence"]
    corners = sum(len(area["polygon"]) for area in fence["polygons"]) + len(fence["circles"])
    if corners and (not peer.fences or len(peer.fences[-1]) != corners):
        return False
    items, held = plan["mission"]["items"], peer.missions[-1] if peer.missions else []
    return len(items) == len(held) and all(map(_same, items, held))


def _same(item: dict, held) -> bool:
    """Whether an item of a `.plan` file is one that MAVSDK took."""
    wanted = [math.nan if part is None else float(part) for part in item["params"]]
    found = [held.param1, held.param2, held.param3, held.param4, held.x * 1e-7, held.y * 1e-7, held.z]
    close = (1e-3, 1e-3, 1e-3, 1e-3, 1.1e-7, 1.1e-7, 1e-3)
    return (item["command"], item["frame"]) == (held.command, held.frame) and all(
        math.isnan(a) or abs(a - b) <= least for a, b, least in zip(wanted, found, close, strict=True)
    )
