"""Many missions: designs with paired seeds, runs that can be broken off, statistics (section 4.2)."""

from auvplan.study.design import Design, StudyError, Sweep
from auvplan.study.runner import run_study
from auvplan.study.statistics import summarise
from auvplan.study.store import load_study
from auvplan.study.table import without_clocks

__all__ = ["Design", "StudyError", "Sweep", "load_study", "run_study", "summarise", "without_clocks"]
