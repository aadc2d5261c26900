"""The world as pure functions of position and time."""

from auvplan.ocean.chart import Chart, ChartError
from auvplan.ocean.currents import Current, FunctionCurrent, UniformCurrent
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, evolve, random_vortices

__all__ = [
    "Chart",
    "ChartError",
    "Current",
    "CurrentUpdate",
    "Environment",
    "FunctionCurrent",
    "LambVortices",
    "Obstacles",
    "UniformCurrent",
    "evolve",
    "random_vortices",
]
