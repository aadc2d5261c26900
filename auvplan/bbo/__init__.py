"""Biogeography-based optimisation: knows arrays, nothing of the sea (section 3.1)."""

from auvplan.bbo.config import BBOConfig
from auvplan.bbo.refine import refine
from auvplan.bbo.search import CostFunction, History, Result, State, ask, init, minimize, run, tell

__all__ = [
    "BBOConfig",
    "CostFunction",
    "History",
    "Result",
    "State",
    "ask",
    "init",
    "minimize",
    "refine",
    "run",
    "tell",
]
