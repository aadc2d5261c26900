from .design import Design as Design
from .design import StudyError as StudyError
from .design import Sweep as Sweep
from .runner import run_study as run_study
from .statistics import summarise as summarise
from .store import load_study as load_study
from .table import without_clocks as without_clocks

__all__ = ["Design", "StudyError", "Sweep", "load_study", "run_study", "summarise", "without_clocks"]
