"""Plausibility: fields of a scenario that are valid and implausible."""

import math
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime
from typing import Any

import numpy as np

from auvplan.scenario.fields import Finding, finding_at, in_order
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.yaml_lines import Document, Path
from auvplan.site import Site, as_utc, swapped

#: The greatest number of a time available, s, that may have been meant as hours.
_HOURS = 100.0
#: rad, 5 degrees: a pitch that all vehicles reach.
_FLAT = 0.087
#: Farther from the site, m, its local metres are not those of the sea.
_FAR = 200_000.0


def implausible(scenario: Scenario, document: Document) -> list[Finding]:
    """Return warnings of implausible fields, in their order in the file."""
    given = document.data if isinstance(document.data, dict) else {}
    sections = {name: part if isinstance(part, dict) else {} for name, part in given.items()}
    found = [*_zone(sections), *_place(scenario, sections), *_time(scenario), *_idle(scenario, sections)]
    found += _speeds(scenario)
    return in_order(finding_at(path, reason, document, severity="warning") for path, reason in found)


def unreachable(scenario: Scenario) -> str:
    """Return why the goal cannot be reached in time whatever the current does; or an empty string."""
    length, mission, fastest = _straight(scenario), scenario.mission, scenario.vehicle.surge_max
    if length is None or mission.time_available >= length / fastest:
        return ""
    line = (
        f"{mission.time_available:g} s are too short: the straight line from start to goal, {length:,.0f} m, "
    )
    line += f"takes {length / fastest:,.0f} s at vehicle.surge_max, {fastest:g} m/s"
    return line + _as_hours(mission.time_available)


def _zone(sections: dict[str, dict[str, Any]]) -> Iterator[tuple[Path, str]]:
    """Yield a departure without a zone of time."""
    given = sections.get("site", {}).get("departure")
    with suppress(ValueError):  # none, or seconds
        if (moment := datetime.fromisoformat(str(given))).tzinfo is None:
            taken = as_utc(moment).strftime("%Y-%m-%dT%H:%M:%SZ")
            line = f"{given} has no zone of time and is taken as UTC: write {taken}, or a zone such as +10:00"
            yield ("site", "departure"), line


def _place(scenario: Scenario, sections: dict[str, dict[str, Any]]) -> Iterator[tuple[Path, str]]:
    """A site that is not where the area or the shipped chart is, and pictures whose size is not given."""
    if scenario.site is not None:
        site, (low, high) = scenario.site.site, scenario.box
        middle = np.add(low[:2], high[:2]) / 2.0
        away = float(np.hypot(*(middle - site.origin)))
        if away > _FAR:
            hint, other = "", swapped(site)
            there = other and np.subtract(other.to_local(*site.to_geographic(*middle)), other.origin)
            if there is not None and float(np.hypot(*there)) < _FAR:
                hint = ", and longitude and latitude seem swapped in one of them"
            line = f"its middle lies {away / 1000.0:,.0f} km from the site, where local metres are not true"
            yield ("area",), f"{line}{hint}: move the site into the area"
        if scenario.chart.source == "whitsunday":
            from auvplan.ocean.whitsunday import CENTRE  # it loads JAX, which most scenarios need later only

            away = float(np.hypot(*Site(*CENTRE).to_local(site.longitude, site.latitude)))
            line = f"is that of the Whitsunday Islands, {away / 1000.0:,.0f} km from the site: give "
            if away > _FAR:
                yield ("chart",), f"{line}chart.source, 'none' being open water"
    if scenario.chart.source == "image" and "pixel_size" not in sections.get("chart", {}):
        size = scenario.chart.pixel_size
        yield ("chart", "image"), f"chart.pixel_size is not given: a pixel is taken as {size:g} m"


def _time(scenario: Scenario) -> Iterator[tuple[Path, str]]:
    """Yield a time available that no mission has."""
    mission, length = scenario.mission, _straight(scenario)
    path = ("mission", "time_available")
    vehicle, time = scenario.vehicle, mission.time_available
    speed = vehicle.way_speed if vehicle.speed_range is None else vehicle.speed_range[1]
    if length is not None and time < length / speed:
        line = f"{time:g} s are less than the straight line from start to goal takes in still water, "
        yield path, f"{line}{length:,.0f} m at {speed:g} m/s, {length / speed:,.0f} s{_as_hours(time)}"
    elif length is None and time <= _HOURS:
        yield path, f"{time:g} s is very short for a mission{_as_hours(time)}"


def _speeds(scenario: Scenario) -> Iterator[tuple[Path, str]]:
    """Yield speeds and limits in the vertical that no vehicle has, and such as limit nothing."""
    vehicle, pitch = scenario.vehicle, scenario.vehicle.pitch_max
    if vehicle.speed > vehicle.surge_max:
        line = f"{vehicle.speed:g} m/s are more than surge_max, {vehicle.surge_max:g} m/s over ground"
        yield ("vehicle", "speed"), f"{line}: in still water no leg can be executed"
    if isinstance(pitch, float) and pitch < _FLAT:
        deep = f"depth changes by {1000.0 * math.tan(pitch):,.0f} m in a kilometre at most"
        yield ("vehicle", "pitch_max"), f"{pitch:g} rad are {math.degrees(pitch):.2g} degrees: {deep}"
    for name in ("climb_rate_max", "dive_rate_max"):
        rate = getattr(vehicle, name)
        if rate is not None and rate > vehicle.speed:
            line = f"{rate:g} m/s are more than the vehicle's {vehicle.speed:g} m/s through the water"
            yield ("vehicle", name), f"{line}: in still water nothing is limited"


def _as_hours(time: float) -> str:
    return f": is this hours? {time:g} h are {time * 3600.0:g} s" if time <= _HOURS else ""


def _straight(scenario: Scenario) -> float | None:
    """M from start to goal; None where one of them is drawn."""
    start, goal = scenario.mission.start, scenario.mission.goal
    return None if start is None or goal is None else float(np.linalg.norm(np.subtract(goal, start)))


def _idle(scenario: Scenario, sections: dict[str, dict[str, Any]]) -> Iterator[tuple[Path, str]]:
    """Fields that are given and have no effect beside others."""
    sourced = {"chart": scenario.chart, "bathymetry": scenario.bathymetry, "current": scenario.current}
    sources = {name: section.source for name, section in sourced.items()}
    idle = {
        (section, name): (f"{section}.source", sources[section])
        for section, settings in sourced.items()
        for name, needed in settings.effective.items()
        if sources[section] not in needed
    }
    if sources["chart"] == "whitsunday" or (sources["chart"] == "none" and scenario.chart.no_go is None):
        idle["chart", "pixel_size"] = "chart.source", sources["chart"]
    if sources["current"] != "vortices" and scenario.current.forecast_error == 0.0:
        vortices = (("current", name) for name in ("vortices", "radius"))
        idle |= dict.fromkeys(vortices, ("current.source", sources["current"]))
    if (jobs := scenario.mission.jobs) is not None:
        drawn = (("mission", name) for name in ("waypoints", "priority", "duration"))
        idle |= dict.fromkeys(drawn, ("mission.jobs", jobs))
    for (section, name), (other, value) in idle.items():
        if name in sections.get(section, {}):
            yield (section, name), f"has no effect with {other} {value!r}"
