"""Planning meets a moving world: the truth, the belief, and the loop between them (Fig. 7)."""

from auvplan.voyage.executive import (
    mission_configs,
    path_config,
    run_mission,
    run_missions,
    sail_missions,
    seed_keys,
)
from auvplan.voyage.records import LegRecord, MissionRun, OrderRecord, PlanRecord
from auvplan.voyage.scenario import Scenario
from auvplan.voyage.world import ScenarioError

__all__ = [
    "LegRecord",
    "MissionRun",
    "OrderRecord",
    "PlanRecord",
    "Scenario",
    "ScenarioError",
    "mission_configs",
    "path_config",
    "run_mission",
    "run_missions",
    "sail_missions",
    "seed_keys",
]
