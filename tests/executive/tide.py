"""Tidal streams for tests: the same everywhere, to and fro in time."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np

from auvplan.mission.jobs import JobPoint, Jobs
from auvplan.ocean.gridded import GriddedCurrent
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site

EPOCH = datetime(2026, 3, 1, 6, tzinfo=UTC)

#: s, of the lunar tide.
PERIOD = 44_714.0

CHANNEL = {
    "name": "channel",
    "site": {"longitude": 5.0, "latitude": 60.0, "departure": EPOCH},
    "area": {"lower": [-60, -60, 0], "upper": [1060, 60, 20]},
    "chart": {"source": "none"},
    "current": {"vortices": 0, "forecast_error": 0},
    "simulation": {"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
    "mission": {"waypoints": 2, "start": [0, 0, 5], "goal": [1000, 0, 5], "time_available": 3000},
    "planning": {"effort": "plain", "departures": 1},
}


def channel(**sections) -> Scenario:
    """A leg of 1 km to the north through a narrow channel, with whole sections replaced."""
    return Scenario.model_validate(CHANNEL | sections)


def stream(t, north: float, east: float):
    """u and v, m/s, at a time, s: largest at time 0."""
    swing = np.cos(2.0 * np.pi * np.asarray(t) / PERIOD)
    return north * swing, east * swing


def tidal_area(
    north: float, east: float, hours: tuple[float, float] = (-1.0, 16.0), site: Site | None = None
) -> OperatingArea:
    """An operating area with a stream of such amplitudes, m/s, stated every 300 s."""
    times = np.arange(hours[0] * 3600.0, hours[1] * 3600.0 + 1.0, 300.0)
    u, v = (
        np.broadcast_to(c[:, None, None, None], (len(times), 1, 2, 2)) for c in stream(times, north, east)
    )
    field = GriddedCurrent.from_arrays(u, v, origin=(-5e4, -5e4), spacing=1e5, times=times)
    return OperatingArea(site=site or Site(5.0, 60.0, EPOCH), forecast=field, truth=field)


#: Members of a forecast: the stream as it is, and weaker or against the vehicle.
STREAMS = 0.3, 0.0, -0.5, -1.0

JOBS = Jobs(
    tuple(JobPoint(f"task {k}", (150.0 * k, 30.0 * (-1) ** k, 5.0), float(k), 60.0) for k in range(1, 7))
)


def channel_with(members=(), available=900.0, **sections):
    """The channel with six tasks and other forecasts of its stream, and its area."""
    mission = CHANNEL["mission"] | {"time_available": available} | sections.pop("mission", {})
    area = replace(tidal_area(0.3, 0.0), jobs=JOBS)
    others = tuple(tidal_area(north, 0.0).forecast for north in members)
    return channel(mission=mission, **sections), replace(area, members=others)
