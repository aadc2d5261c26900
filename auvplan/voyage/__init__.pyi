from .departures import Departures as Departures
from .departures import plan_departures as plan_departures
from .executive import mission_configs as mission_configs
from .executive import path_config as path_config
from .executive import run_mission as run_mission
from .executive import run_missions as run_missions
from .executive import sail_missions as sail_missions
from .executive import seed_keys as seed_keys
from .planning import load_waters_at as load_waters_at
from .planning import plan_scenario as plan_scenario

__all__ = [
    "Departures",
    "load_waters_at",
    "mission_configs",
    "path_config",
    "plan_departures",
    "plan_scenario",
    "run_mission",
    "run_missions",
    "sail_missions",
    "seed_keys",
]
