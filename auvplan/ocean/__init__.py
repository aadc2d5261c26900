"""The world as pure functions of position and time."""

from auvplan.ocean.chart import Chart, ChartError
from auvplan.ocean.currents import Current, FunctionCurrent, UniformCurrent
from auvplan.ocean.environment import Environment
from auvplan.ocean.gridded import CurrentError, GriddedCurrent
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.seabed import Seabed, SeabedError
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve, random_vortices

__all__ = [
    "Chart",
    "ChartError",
    "Current",
    "CurrentError",
    "CurrentUpdate",
    "Environment",
    "FunctionCurrent",
    "GriddedCurrent",
    "LambVortices",
    "Obstacles",
    "Seabed",
    "SeabedError",
    "UniformCurrent",
    "evolve",
    "random_vortices",
]
