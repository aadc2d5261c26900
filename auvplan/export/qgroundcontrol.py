"""QGroundControl's plan files for ArduSub, by its developer guide ("Plan File Format", versions 1 and 2).

Waypoints are MAV_CMD_NAV_WAYPOINT in the frame of altitudes above home, and home is taken to be at the
surface, so that altitude is minus depth.
"""

import json
import math
from typing import Annotated, Any, Literal

import numpy as np
import shapely
from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from auvplan.export.fences import Circle, Fence
from auvplan.export.itinerary import (
    DEGREES,
    ExportError,
    Itinerary,
    Waypoint,
    geographic,
    stays_for,
    waypoints,
)
from auvplan.export.speeds import approach, speed_note, stretches
from auvplan.site import Site

#: MAV_AUTOPILOT_ARDUPILOTMEGA and MAV_TYPE_SUBMARINE.
_ARDUPILOT, _SUBMARINE = 3, 12

#: MAV_CMD_NAV_WAYPOINT and MAV_CMD_DO_CHANGE_SPEED.
_WAYPOINT, _CHANGE_SPEED = 16, 178

#: MAV_CMD_NAV_LAND, by which ArduSub surfaces, and MAV_CMD_NAV_LOITER_UNLIM, by which it holds its place.
_ENDS = {"surface": 21, "station": 17, "loiter": 17}

#: MAV_FRAME_GLOBAL_RELATIVE_ALT, MAV_FRAME_MISSION; QGroundControl's altitude mode of the first.
_ABOVE_HOME, _NO_PLACE, _RELATIVE = 3, 2, 1

#: m from a waypoint at which it counts as reached.
ACCEPTANCE = 5.0

#: s, longest hold that ArduPilot stores.
_LONGEST_HOLD = 65_535

#: m; a depth that small is the surface.
_SURFACE = 1e-3

#: m/s, by which speeds differ that are set one after the other.
_SAME_SPEED = 0.005


def qgc_plan(itinerary: Itinerary) -> dict[str, Any]:
    """Return a plan as the data of its JSON file.

    Raises:
        ExportError: a waypoint is above the surface, or a task is longer than ArduPilot can hold.
    """
    rows = waypoints(itinerary)
    home = [round(rows[0].latitude, DEGREES), round(rows[0].longitude, DEGREES), 0.0]
    items: list[dict[str, Any]] = []
    speeds = item_speeds(itinerary)
    for row, speed, before in zip(rows, speeds, [None, *speeds[:-1]], strict=True):
        if speed != before:  # of which the throttle is left as it is
            items.append({
                "type": "SimpleItem", "autoContinue": True, "command": _CHANGE_SPEED,
                "doJumpId": len(items) + 1, "frame": _NO_PLACE, "params": [1, speed, -1, 0, 0, 0, 0],
            })  # fmt: skip
        items.append(_item(row, len(items) + 1))
    items.append(_end(items[-1], itinerary.end))
    held, left_out = itinerary.held_fences
    fences = [_fence(fence, itinerary.site) for fence in held]
    return {
        "fileType": "Plan",
        "version": 1,
        "groundStation": "QGroundControl",
        "comment": "; ".join(filter(None, (itinerary.description, speed_note(itinerary), left_out))),
        "mission": {
            "version": 2,
            "firmwareType": _ARDUPILOT,
            "vehicleType": _SUBMARINE,
            "globalPlanAltitudeMode": _RELATIVE,
            "cruiseSpeed": itinerary.speed,
            "hoverSpeed": itinerary.speed,
            "items": items,
            "plannedHomePosition": home,
        },
        "geoFence": {
            "version": 2,
            "circles": [fence for fence in fences if "circle" in fence],
            "polygons": [fence for fence in fences if "polygon" in fence],
        },
        "rallyPoints": {"version": 2, "points": []},
    }


def item_speeds(itinerary: Itinerary) -> list[float]:
    """Return m/s at which each waypoint is gone to; one after the other they are equal or differ for good."""
    speeds: list[float] = []
    rows = waypoints(itinerary)
    for leg in itinerary.legs:
        own = sum(row.leg == leg.number for row in rows)
        lines = [approach(itinerary, leg)]
        for part in stretches(itinerary, leg):
            lines += [round(part.speed, 3)] * (part.last - part.first)
        for speed in lines[len(lines) - own :]:
            speeds.append(speeds[-1] if speeds and abs(speed - speeds[-1]) < _SAME_SPEED else speed)
    return speeds


def qgc_text(itinerary: Itinerary) -> bytes:
    """Return the content of a `.plan` file; raises as `qgc_plan`."""
    return (json.dumps(qgc_plan(itinerary), indent=2, allow_nan=False) + "\n").encode()


def qgc_notes(itinerary: Itinerary) -> list[str]:
    """Return what whoever uploads the plan ought to know."""
    _, left_out = itinerary.held_fences
    notes = [f".plan: {left_out}"] if left_out else []
    if itinerary.over_ground:
        notes += [".plan: speeds are over ground, as ArduPilot holds them, line by line as planned"]
    else:
        notes += [f".plan: {speed_note(itinerary)} in the plan, over the ground to ArduPilot"]
    shallow = [row.name for row in waypoints(itinerary) if abs(row.depth) <= _SURFACE]
    if shallow:
        notes.append(
            f".plan: {len(shallow)} waypoints lie at altitude 0, the surface, which ArduSub may not hold "
            f"(ArduPilot issue 30823); the first is {shallow[0]}"
        )
    if rises := [leg.goal_name for leg in itinerary.legs if leg.rise > 0.0]:
        notes.append(
            f".plan: where it is planned to surface for a fix, at {', '.join(rises)}, the vehicle holds at "
            "depth for as long: let it surface by hand"
        )
    if itinerary.end == "loiter":
        notes.append(".plan: ArduSub loiters on the spot, as it keeps station")
    return notes


def _item(row: Waypoint, number: int) -> dict[str, Any]:
    altitude = 0.0 if abs(row.depth) <= _SURFACE else -row.depth
    if altitude > 0.0:
        raise ExportError(f".plan: {row.name} (leg {row.leg}) lies {altitude:g} m above the surface")
    hold = math.ceil(row.hold)
    if hold > _LONGEST_HOLD:
        raise ExportError(
            f".plan: the {stays_for(row)} at {row.name} (leg {row.leg}) takes {hold} s, "
            f"at most {_LONGEST_HOLD}"
        )
    place = [round(row.latitude, DEGREES), round(row.longitude, DEGREES)]
    return {
        "type": "SimpleItem", "autoContinue": True, "command": _WAYPOINT, "doJumpId": number,
        "frame": _ABOVE_HOME, "params": [hold, ACCEPTANCE, 0, None, *place, altitude],
        "Altitude": altitude, "AltitudeMode": _RELATIVE, "AMSLAltAboveTerrain": None,
    }  # fmt: skip


def _end(last: dict[str, Any], behaviour: str) -> dict[str, Any]:
    """Return what is done at the place of the last item, until commanded otherwise."""
    depth = 0.0 if behaviour == "surface" else last["Altitude"]
    return last | {
        "command": _ENDS[behaviour], "doJumpId": last["doJumpId"] + 1, "Altitude": depth,
        "params": [0, 0, 0, None, *last["params"][4:6], depth],
    }  # fmt: skip


def _fence(fence: Fence, site: Site) -> dict[str, Any]:
    """Return an exclusion; polygons run clockwise."""
    if isinstance(fence, Circle):
        ((longitude, latitude),) = geographic(site, np.array([fence.centre])).tolist()
        centre = [round(latitude, DEGREES), round(longitude, DEGREES)]
        return {"circle": {"center": centre, "radius": fence.radius}, "inclusion": False, "version": 1}
    ring = shapely.LinearRing(fence.corners[:, ::-1])
    corners = fence.corners[::-1] if shapely.is_ccw(ring) else fence.corners
    places = np.round(geographic(site, corners)[:, ::-1], DEGREES).tolist()
    return {"polygon": places, "inclusion": False, "version": 1}


def validate_plan(plan: Any) -> None:
    """Check a plan against the fields that QGroundControl's developer guide documents.

    Raises:
        ExportError: one line that names the first field at fault.
    """
    _check(_Plan, plan, "plan")
    for k, item in enumerate(plan["mission"]["items"]):
        name, placed = f"plan.mission.items[{k}]", item["command"] != _CHANGE_SPEED
        _check(_Placed if placed else _Item, item, name)
        for field, wanted in [("doJumpId", k + 1), *[("Altitude", item["params"][6])] * placed]:
            if item[field] != wanted:
                raise ExportError(f"{name}.{field}: cannot be {item[field]!r}")


def _check(fields: type[BaseModel], found: Any, name: str) -> None:
    try:
        fields.model_validate_json(json.dumps(found))
    except ValidationError as error:
        fault = error.errors()[0]
        where = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in fault["loc"])
        raise ExportError(f"{name}{where}: {fault['msg']}") from None


def _fields(name: str, base: type[BaseModel] | None = None, **kinds: Any) -> Any:
    """Return a model whose fields, beside those of its base, are all required, as JSON has them."""
    config = None if base else ConfigDict(strict=True, allow_inf_nan=False)
    required: dict[str, Any] = {field: (kind, ...) for field, kind in kinds.items()}
    return create_model(name, __base__=base, __config__=config, **required)


#: What every field must fulfil.
_Count = Annotated[int, Field(ge=0)]
_Latitude, _Longitude = Annotated[float, Field(ge=-90, le=90)], Annotated[float, Field(ge=-180, le=180)]
_Item = _fields(
    "Item", type=Literal["SimpleItem"], autoContinue=bool, command=_Count, frame=_Count, doJumpId=_Count,
    params=Annotated[list[float | None], Field(min_length=7, max_length=7)],
)  # fmt: skip
_Placed = _fields(
    "Placed", _Item, Altitude=float, AltitudeMode=_Count, AMSLAltAboveTerrain=float | None,
    params=tuple[float, float, float, float | None, _Latitude, _Longitude, float],
)  # fmt: skip
_Mission = _fields(
    "Mission", version=Literal[2], firmwareType=_Count, vehicleType=_Count, globalPlanAltitudeMode=_Count,
    cruiseSpeed=float, hoverSpeed=float, plannedHomePosition=tuple[_Latitude, _Longitude, float],
    items=Annotated[list[_Item], Field(min_length=1)],
)  # fmt: skip
_Fence = _fields("Fence", version=Literal[1], inclusion=bool)
_Round = _fields("Round", center=tuple[_Latitude, _Longitude], radius=Annotated[float, Field(gt=0)])
_Corners = Annotated[list[tuple[_Latitude, _Longitude]], Field(min_length=3)]
_Fences = _fields(
    "Fences", version=Literal[2], circles=list[_fields("Circle", _Fence, circle=_Round)],
    polygons=list[_fields("Polygon", _Fence, polygon=_Corners)],
)  # fmt: skip
_Plan = _fields(
    "Plan", fileType=Literal["Plan"], version=Literal[1], groundStation=str, mission=_Mission,
    geoFence=_Fences, rallyPoints=_fields("Rally", version=Literal[2], points=list[Any]),
)  # fmt: skip
