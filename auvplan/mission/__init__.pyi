from .bound import trail_bound as trail_bound
from .bound import upper_bound as upper_bound
from .config import MissionConfig as MissionConfig
from .exact import certify as certify
from .feasibility import RouteCheck as RouteCheck
from .feasibility import check_route as check_route
from .graph import MissionGraph as MissionGraph
from .graph import random_graph as random_graph
from .graph import task_graph as task_graph
from .graph import time_to_go as time_to_go
from .planner import plan_mission as plan_mission
from .planner import plan_missions as plan_missions
from .planner import replan_mission as replan_mission
from .route import MissionRoute as MissionRoute
from .route import MissionRoutes as MissionRoutes
from .route import MissionStatus as MissionStatus
from .timetable import Timetable as Timetable
from .travel_times import TravelTimeConfig as TravelTimeConfig

__all__ = [
    "MissionConfig",
    "MissionGraph",
    "MissionRoute",
    "MissionRoutes",
    "MissionStatus",
    "RouteCheck",
    "Timetable",
    "TravelTimeConfig",
    "certify",
    "check_route",
    "plan_mission",
    "plan_missions",
    "random_graph",
    "replan_mission",
    "task_graph",
    "time_to_go",
    "trail_bound",
    "upper_bound",
]
