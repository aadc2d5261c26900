"""Routes by the clock against routes by the sea as it is when they are planned, in three tidal seas.

`python -m benchmarks.clock --missions 100`. Missions of one seed differ in nothing but
`planning.departures`: 1 prices every leg as if it were executed at once, 24 by the time at which it is
begun. Forecasts are exact and nothing is in the way. Two seas are files of ../shared/data, the third is a
harmonic tide (M2, S2, K1) made here.
"""

import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

import auvplan as ap
from auvplan.records import MissionRun
from auvplan.scenario.scenario import Scenario
from auvplan.study.statistics import mean_interval
from benchmarks.harness import SCENARIOS, SHARED, launch, show, track

#: Degrees an hour, m/s along the channel and phase in degrees, of the harmonic tide.
CONSTITUENTS = {"M2": (28.984, 0.7, 40.0), "S2": (30.0, 0.25, 75.0), "K1": (15.041, 0.15, 10.0)}
#: Seconds by which an arrival may differ, as a share of the time since the route was made.
OFF = 0.05


def harmonic_tide(path: Path) -> Path:
    """Write a current that runs to and fro along the north-east, stronger in the middle of a channel."""
    hours = np.arange(0.0, 36.0, 0.25)
    speed = sum(a * np.cos(np.radians(rate * hours - phase)) for rate, a, phase in CONSTITUENTS.values())
    longitude, latitude = np.linspace(4.9, 5.2, 31), np.linspace(59.9, 60.1, 41)
    across = (longitude[None, :] - 5.05) / 0.06 - (latitude[:, None] - 60.0) / 0.12
    shape = 0.3 + 0.7 * np.exp(-(across**2))
    u, v = (part * speed[:, None, None] * shape for part in (0.55, 0.83))
    dims = ("time", "latitude", "longitude")
    xr.Dataset(
        {
            "uo": (dims, u, {"units": "m s-1", "standard_name": "eastward_sea_water_velocity"}),
            "vo": (dims, v, {"units": "m s-1", "standard_name": "northward_sea_water_velocity"}),
        },
        {
            "time": np.datetime64("2026-03-01T00:00", "ns") + (hours * 3.6e12).astype("timedelta64[ns]"),
            "latitude": ("latitude", latitude, {"units": "degrees_north"}),
            "longitude": ("longitude", longitude, {"units": "degrees_east"}),
        },
    ).to_netcdf(path, engine="h5netcdf")
    return path


def seas(folder: Path) -> list[Scenario]:
    """The scenarios, as far as their files are there; the tide's is written into a folder."""
    names = ("tide", "fjord", "ocean") if SHARED.is_dir() else ("tide",)
    tide, *real = (ap.load_scenario(SCENARIOS / f"{name}.yaml") for name in names)
    return [tide.with_({"current.files": str(harmonic_tide(folder / "tide.nc"))}), *real]


def arrivals(run: MissionRun) -> list[float]:
    """Of the first route as far as it was followed: how far off each arrival is, as a share of its time."""
    route, found, now = run.routes[0], [], 0.0
    for (i, j), seconds, leg in zip(pairwise(route.nodes), route.leg_times, run.done, strict=False):
        if (i, j) != (leg.start, leg.goal):
            break
        now += seconds
        ends = float(leg.times[-1]) + leg.t_wait + leg.t_task
        found.append(abs(now - ends) / ends)
    return found


COLUMNS = {
    "sea": "{sea}", "routes": "{way}", "priority": "{priority:.1f}", "gain": "{gain}",
    "arrivals off": "{off:.1%}",
    f"by more than {OFF:.0%}": "{late:.0%}", "re-plans": "{replans:.1f}", "on time": "{on_time}",
}  # fmt: skip


def compared(sea: Scenario, seeds: range) -> list[dict[str, Any]]:
    """Rows of the same missions by the sea as it is when a route is made, and by the clock."""
    rows, before = [], np.zeros(len(seeds))
    for way, departures in (("snapshot", 1), ("clock", 24)):
        runs = ap.run_missions(sea.with_({"planning.departures": departures}), seeds=seeds)
        priority = np.array([run.total_priority for run in runs])
        mean, low, _ = mean_interval(priority - before)
        off, before = np.array([error for run in runs for error in arrivals(run)]), priority
        rows.append({
            "sea": sea.name, "way": way, "priority": float(priority.mean()), "off": float(off.mean()),
            "gain": f"{mean:+.2f} ± {mean - low:.2f}" if rows else "", "late": float((off > OFF).mean()),
            "replans": float(np.mean([len(run.routes) - 1 for run in runs])),
            "on_time": sum(run.success for run in runs),
        })  # fmt: skip
    return rows


@launch(missions=(100, "of each sea"), first=(5000, "first seed"), only=("", "seas whose name holds this"))
def main(missions: int, first: int, only: str) -> dict[str, Any]:
    seeds = range(first, first + missions)
    with tempfile.TemporaryDirectory() as folder:
        found = [sea for sea in seas(Path(folder)) if only in sea.name]
        rows = [row for sea in track(found, "seas") for row in compared(sea, seeds)]
    show(f"Seeds {first} to {seeds[-1]}", rows, COLUMNS, names=2)
    return {"clock": rows}
