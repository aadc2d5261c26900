"""Mission layer: a graph and a time budget into an ordered list of tasks (section 3.3)."""

from auvplan.mission.bound import upper_bound
from auvplan.mission.config import MissionConfig
from auvplan.mission.exact import certify
from auvplan.mission.feasibility import OrderCheck, check_order
from auvplan.mission.graph import MissionGraph, random_graph, time_to_go
from auvplan.mission.order import MissionOrder, MissionOrders, MissionStatus
from auvplan.mission.planner import plan_mission, plan_missions
from auvplan.mission.tasks import task_graph
from auvplan.mission.trail_bound import trail_bound
from auvplan.mission.travel_times import TravelTimeConfig

__all__ = [
    "MissionConfig",
    "MissionGraph",
    "MissionOrder",
    "MissionOrders",
    "MissionStatus",
    "OrderCheck",
    "TravelTimeConfig",
    "certify",
    "check_order",
    "plan_mission",
    "plan_missions",
    "random_graph",
    "task_graph",
    "time_to_go",
    "trail_bound",
    "upper_bound",
]
