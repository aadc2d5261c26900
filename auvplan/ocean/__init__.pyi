from .chart import Chart as Chart
from .chart import ChartError as ChartError
from .currents import Current as Current
from .currents import FunctionCurrent as FunctionCurrent
from .currents import UniformCurrent as UniformCurrent
from .environment import Environment as Environment
from .environment import Price as Price
from .gridded import CurrentError as CurrentError
from .gridded import GriddedCurrent as GriddedCurrent
from .obstacles import Obstacles as Obstacles
from .seabed import Seabed as Seabed
from .seabed import SeabedError as SeabedError
from .vortices import CurrentUpdate as CurrentUpdate
from .vortices import LambVortices as LambVortices
from .vortices import evolve as evolve
from .vortices import random_vortices as random_vortices

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
    "Price",
    "Seabed",
    "SeabedError",
    "UniformCurrent",
    "evolve",
    "random_vortices",
]
