"""Planning meets a moving world: the truth, the belief, and the loop between them (Fig. 7)."""

from auvplan.voyage.departures import Departures, load_waters_at, plan_departures
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
    "Departures",
    "LegRecord",
    "MissionRun",
    "OrderRecord",
    "PlanRecord",
    "Scenario",
    "ScenarioError",
    "load_waters_at",
    "mission_configs",
    "path_config",
    "plan_departures",
    "run_mission",
    "run_missions",
    "sail_missions",
    "seed_keys",
]
