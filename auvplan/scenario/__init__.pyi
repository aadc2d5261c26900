from .area import OperatingArea as OperatingArea
from .file import load_scenario as load_scenario
from .file import shipped_scenarios as shipped_scenarios
from .scenario import Scenario as Scenario

__all__ = ["OperatingArea", "Scenario", "load_scenario", "shipped_scenarios"]
