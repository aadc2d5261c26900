"""Missions on coasts of other models' files: every metre of the track in water, by an independent mask."""

import pytest

from auvplan.check.run import check_dataset
from auvplan.executive import run_mission
from auvplan.io.results import to_dataset
from auvplan.scenario.scenario import Scenario

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("light_search")]

COASTS = {
    "estuary of triangles": {
        "site": {"longitude": -123.75, "latitude": 46.2, "departure": "2022-07-30T03:00:00Z"},
        "area": {"lower": [-9000, -9000, 0], "upper": [9000, 9000, 15]},
        "chart": {"source": "current", "pixel_size": 40},
        "bathymetry": {"source": "current"},
        "current": {"source": "file", "files": "creofs_selfe_noaa.nc", "outside": "clamp"},
        "vehicle": {"speed": 2.0, "depth_max": 15},
        "safety": {"seabed": 1.0},
        "mission": {"waypoints": 10, "time_available": 9000},
    },
    "native ROMS": {
        "site": {"longitude": 13.4, "latitude": 67.2, "departure": "2016-02-02T13:00:00Z"},
        "area": {"lower": [-20000, -20000, 0], "upper": [20000, 20000, 60]},
        "chart": {"source": "current", "pixel_size": 200},
        "bathymetry": {"source": "current"},
        "current": {
            "source": "file",
            "files": ["nordic_roms_native_day1.nc", "nordic_roms_native_day2.nc"],
        },
        "vehicle": {"speed": 2.0},
        "mission": {"waypoints": 10, "time_available": 30000},
    },
    "polar stereographic": {
        "site": {"longitude": 18.0, "latitude": 78.0, "departure": "2016-02-01T13:00:00Z"},
        "area": {"lower": [-60000, -60000, 0], "upper": [60000, 60000, 100]},
        "chart": {"source": "current", "pixel_size": 500},
        "bathymetry": {"source": "current"},
        "current": {"source": "file", "files": "arctic20_polar_stereographic.nc"},
        "mission": {"waypoints": 10, "time_available": 80000},
    },
}


@pytest.mark.parametrize("coast", COASTS)
def test_every_metre_is_in_water(coast, shared):
    scenario = Scenario.model_validate(COASTS[coast])
    run = run_mission(scenario, seed=0, folder=shared / "data" / "elsewhere")
    assert run.done
    report = check_dataset(run.summary(), to_dataset(run))
    assert report.ok, report
    assert report.coast_hits == 0
    assert not any("was not looked at again" in note for note in report.notes), report.notes
