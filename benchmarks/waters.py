"""Path planning in waters that no planner was tuned on: problems by seed, references and the planner's gaps.

`water_problem(family, seed)` makes a problem. Seeds below 100 are for development; what is reported comes
from seeds of 1000 and more.
"""

from benchmarks.water_problems import FAMILIES, KINDS, water_problem

__all__ = ["FAMILIES", "KINDS", "water_problem"]
