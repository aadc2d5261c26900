from .config import PathConfig as PathConfig
from .config import Penalties as Penalties
from .cost import VIOLATIONS as VIOLATIONS
from .energy import plan_least_energy as plan_least_energy
from .energy import speeds_along as speeds_along
from .plan import PathPlan as PathPlan
from .plan import PathPlans as PathPlans
from .plan import PathStatus as PathStatus
from .planner import plan_path as plan_path
from .planner import plan_paths as plan_paths
from .replanner import replan_path as replan_path
from .replanner import replan_paths as replan_paths
from .sensitivity import travel_time as travel_time

__all__ = [
    "VIOLATIONS",
    "PathConfig",
    "PathPlan",
    "PathPlans",
    "PathStatus",
    "Penalties",
    "plan_least_energy",
    "plan_path",
    "plan_paths",
    "replan_path",
    "replan_paths",
    "speeds_along",
    "travel_time",
]
