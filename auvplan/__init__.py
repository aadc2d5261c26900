"""auvplan: mission and path planning for autonomous underwater vehicles in a moving sea, on JAX.

Local metres, north-east-down; seconds since the scenario's epoch; m/s; rad.
"""

from importlib.metadata import version

from auvplan import bbo
from auvplan.export import export_run
from auvplan.io import load_scenario, save_run
from auvplan.io.currents import read_current
from auvplan.io.restore import restore_run
from auvplan.io.waters import load_waters
from auvplan.mission import MissionConfig, MissionGraph, MissionOrder, plan_mission, plan_missions
from auvplan.ocean import (
    Chart,
    Current,
    Environment,
    GriddedCurrent,
    LambVortices,
    Obstacles,
    Seabed,
    UniformCurrent,
    random_vortices,
)
from auvplan.path import (
    PathConfig,
    PathPlan,
    PathPlans,
    PathStatus,
    plan_path,
    plan_paths,
    replan_path,
    replan_paths,
)
from auvplan.site import Site
from auvplan.vehicle import Vehicle
from auvplan.voyage import MissionRun, Scenario, run_mission, run_missions

__version__ = version("auvplan")

__all__ = [
    "Chart",
    "Current",
    "Environment",
    "GriddedCurrent",
    "LambVortices",
    "MissionConfig",
    "MissionGraph",
    "MissionOrder",
    "MissionRun",
    "Obstacles",
    "PathConfig",
    "PathPlan",
    "PathPlans",
    "PathStatus",
    "Scenario",
    "Seabed",
    "Site",
    "UniformCurrent",
    "Vehicle",
    "__version__",
    "bbo",
    "export_run",
    "load_scenario",
    "load_waters",
    "plan_mission",
    "plan_missions",
    "plan_path",
    "plan_paths",
    "random_vortices",
    "read_current",
    "replan_path",
    "replan_paths",
    "restore_run",
    "run_mission",
    "run_missions",
    "save_run",
]
