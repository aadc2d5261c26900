from .file import load_scenario as load_scenario
from .file import shipped_scenarios as shipped_scenarios
from .scenario import Scenario as Scenario
from .waters import Waters as Waters

__all__ = ["Scenario", "Waters", "load_scenario", "shipped_scenarios"]
