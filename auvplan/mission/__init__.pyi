from .bound import upper_bound as upper_bound
from .config import MissionConfig as MissionConfig
from .exact import certify as certify
from .feasibility import OrderCheck as OrderCheck
from .feasibility import check_order as check_order
from .graph import MissionGraph as MissionGraph
from .graph import random_graph as random_graph
from .graph import time_to_go as time_to_go
from .order import MissionOrder as MissionOrder
from .order import MissionOrders as MissionOrders
from .order import MissionStatus as MissionStatus
from .planner import plan_mission as plan_mission
from .planner import plan_missions as plan_missions
from .tasks import task_graph as task_graph
from .timetable import Timetable as Timetable
from .trail_bound import trail_bound as trail_bound
from .travel_times import TravelTimeConfig as TravelTimeConfig

__all__ = [
    "MissionConfig",
    "MissionGraph",
    "MissionOrder",
    "MissionOrders",
    "MissionStatus",
    "OrderCheck",
    "Timetable",
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
