from . import bbo as bbo
from . import plot as plot
from . import study as study
from .executive import plan_scenario as plan_scenario
from .executive import run_mission as run_mission
from .executive import run_missions as run_missions
from .export import export_run as export_run
from .io import save_run as save_run
from .io.area import load_area as load_area
from .io.currents import read_current as read_current
from .io.restore import restore_run as restore_run
from .mission import MissionConfig as MissionConfig
from .mission import MissionGraph as MissionGraph
from .mission import MissionRoute as MissionRoute
from .mission import plan_mission as plan_mission
from .mission import plan_missions as plan_missions
from .mission import replan_mission as replan_mission
from .ocean import Chart as Chart
from .ocean import Current as Current
from .ocean import Environment as Environment
from .ocean import GriddedCurrent as GriddedCurrent
from .ocean import LambVortices as LambVortices
from .ocean import Obstacles as Obstacles
from .ocean import Seabed as Seabed
from .ocean import UniformCurrent as UniformCurrent
from .ocean import random_vortices as random_vortices
from .path import PathConfig as PathConfig
from .path import PathPlan as PathPlan
from .path import PathPlans as PathPlans
from .path import PathStatus as PathStatus
from .path import plan_path as plan_path
from .path import plan_paths as plan_paths
from .path import replan_path as replan_path
from .path import replan_paths as replan_paths
from .path import travel_time as travel_time
from .records import MissionRun as MissionRun
from .scenario import Scenario as Scenario
from .scenario import load_scenario as load_scenario
from .site import Site as Site
from .vehicle import Vehicle as Vehicle

__version__: str

__all__ = [
    "Chart",
    "Current",
    "Environment",
    "GriddedCurrent",
    "LambVortices",
    "MissionConfig",
    "MissionGraph",
    "MissionRoute",
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
    "load_area",
    "load_scenario",
    "plan_mission",
    "plan_missions",
    "plan_path",
    "plan_paths",
    "plan_scenario",
    "plot",
    "random_vortices",
    "read_current",
    "replan_mission",
    "replan_path",
    "replan_paths",
    "restore_run",
    "run_mission",
    "run_missions",
    "save_run",
    "study",
    "travel_time",
]
