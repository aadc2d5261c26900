"""Two points to a timed, checked trajectory (section 3.2)."""

from auvplan.path.config import PathConfig, Penalties
from auvplan.path.cost import VIOLATIONS
from auvplan.path.plan import PathPlan, PathPlans, PathStatus
from auvplan.path.planner import plan_path, plan_paths
from auvplan.path.replanner import replan_path, replan_paths

__all__ = [
    "VIOLATIONS",
    "PathConfig",
    "PathPlan",
    "PathPlans",
    "PathStatus",
    "Penalties",
    "plan_path",
    "plan_paths",
    "replan_path",
    "replan_paths",
]
