from .context import mission_configs as mission_configs
from .context import path_config as path_config
from .departures import Departures as Departures
from .departures import plan_departures as plan_departures
from .loop import execute_missions as execute_missions
from .loop import run_mission as run_mission
from .loop import run_missions as run_missions
from .loop import seed_keys as seed_keys
from .planning import load_area_at as load_area_at
from .planning import plan_scenario as plan_scenario

__all__ = [
    "Departures",
    "execute_missions",
    "load_area_at",
    "mission_configs",
    "path_config",
    "plan_departures",
    "plan_scenario",
    "run_mission",
    "run_missions",
    "seed_keys",
]
