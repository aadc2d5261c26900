"""A small sea with an island and a shallow, for tests of what goes wrong on a mission in it."""

from dataclasses import replace

import numpy as np

from auvplan.executive.context import Mission, MissionContext
from auvplan.executive.loop import seed_keys, start_mission
from auvplan.ocean import Chart, Seabed
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.faults import Obstacle
from auvplan.simulation.world import make_vehicle
from tests.executive.small import SMALL, light_config, light_routes

#: Places that every leg keeps for obstacles that appear.
PLACES = 3

PIXEL = 40.0


def scenario(**sections) -> Scenario:
    """The small mission in 4 x 4 km with whole sections replaced."""
    own = {
        "mission": SMALL["mission"] | {"waypoint_clearance": 60.0},
        "planning": SMALL["planning"] | {"effort": "plain"},
    }
    return Scenario.model_validate(SMALL | own | sections)


def area() -> OperatingArea:
    """An island of 600 m in the middle, and a bank 12 m below the surface beside it."""
    north, east = (np.arange(-2, 102) + 0.5)[:, None] * PIXEL, (np.arange(-2, 102) + 0.5)[None] * PIXEL
    island = np.hypot(north - 2000.0, east - 2000.0) < 300.0
    bank = np.hypot(north - 3000.0, east - 1200.0) < 350.0
    depth = np.where(bank, 12.0, 70.0)
    corner = (-2 * PIXEL, -2 * PIXEL)
    return OperatingArea(
        chart=Chart.from_mask(~island, PIXEL, corner), seabed=Seabed.from_depth(depth, PIXEL, corner)
    )


def context(settings: Scenario | None = None) -> MissionContext:
    """What missions share, with a small search."""
    settings = settings or scenario()
    return MissionContext(
        settings, light_config(settings), light_routes(settings), make_vehicle(settings), area()
    )


def begun(shared: MissionContext, seed: int) -> Mission:
    """A mission that may be given faults as it goes: append them to `mission.faults.given`."""
    never = [Obstacle(np.inf, 0.0)] * PLACES
    return start_mission(replace(shared, faults=[never]), 0, seed_keys([seed])[0], seed)
