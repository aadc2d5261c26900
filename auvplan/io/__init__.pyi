from .files import OutputError as OutputError
from .files import output_folder as output_folder
from .files import write_atomically as write_atomically
from .results import load_run as load_run
from .results import save_run as save_run
from .scenario_file import load_scenario as load_scenario
from .scenario_file import shipped_scenarios as shipped_scenarios

__all__ = [
    "OutputError",
    "load_run",
    "load_scenario",
    "output_folder",
    "save_run",
    "shipped_scenarios",
    "write_atomically",
]
