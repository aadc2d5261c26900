from .results import load_run as load_run
from .results import save_run as save_run

__all__ = ["load_run", "save_run"]
