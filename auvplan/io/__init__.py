"""The edges: scenario files in, result files out."""

from auvplan.io.files import OutputError, output_folder, write_atomically
from auvplan.io.results import load_run, save_run
from auvplan.io.scenario_file import load_scenario, shipped_scenarios

__all__ = [
    "OutputError",
    "load_run",
    "load_scenario",
    "output_folder",
    "save_run",
    "shipped_scenarios",
    "write_atomically",
]
