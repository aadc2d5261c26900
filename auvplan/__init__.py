"""auvplan: mission and path planning for autonomous underwater vehicles in a moving sea, on JAX.

Local metres, north-east-down; seconds since the scenario's epoch; m/s; rad.
"""

from importlib.metadata import version

from auvplan import bbo
from auvplan.io import load_scenario, save_run
from auvplan.mission import MissionConfig, MissionGraph, MissionOrder, plan_mission, plan_missions
from auvplan.ocean import (
    Chart,
    Current,
    Environment,
    LambVortices,
    Obstacles,
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
from auvplan.vehicle import Vehicle
from auvplan.voyage import MissionRun, Scenario, run_mission, run_missions

__version__ = version("auvplan")

__all__ = [
    "Chart",
    "Current",
    "Environment",
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
    "UniformCurrent",
    "Vehicle",
    "__version__",
    "bbo",
    "load_scenario",
    "plan_mission",
    "plan_missions",
    "plan_path",
    "plan_paths",
    "random_vortices",
    "replan_path",
    "replan_paths",
    "run_mission",
    "run_missions",
    "save_run",
]
