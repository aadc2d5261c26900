"""Small worlds, and settings of a small search, that several tests share."""

import jax
import numpy as np

import auvplan as ap

START = np.array([200.0, 300.0, 20.0])
GOAL = np.array([1800.0, 1500.0, 60.0])
LOWER, UPPER = (0.0, 0.0, 0.0), (2000.0, 2000.0, 100.0)

#: Tests that plan with the same settings share compiled programs.
CONFIG = ap.PathConfig(
    bbo=ap.bbo.BBOConfig(
        population=40, iterations=40, replacement="greedy", mutation="gaussian", mutation_step=0.05
    ),
    samples=64,
    control_points=16,
    passages=6,
    field_cells=48,
    refine_steps=20,
    passage_steps=20,
    finer=1,
)


def chart_with_island() -> ap.Chart:
    """A 2 km square of water with a round island near its middle and a shoal around it."""
    north, east = np.meshgrid(*(np.arange(200) * 10.0 + 5.0,) * 2, indexing="ij")
    away = np.hypot(north - 900.0, east - 1050.0)
    passability = np.where(away < 200.0, 0.0, np.where(away < 320.0, 0.2, 1.0))
    return ap.Chart.from_passability(passability)


def world(chart=True, obstacles=True, layers=2) -> ap.Environment:
    """Vortices, an island and one obstacle of each kind."""
    current = ap.random_vortices(
        jax.random.key(5), LOWER, UPPER, count=4, layers=layers, radius=(150, 400), vertical_scale=10.0
    )
    some = ap.Obstacles.static([[1300.0, 1250.0, 50.0]], [60.0], growth=0.05)
    some += ap.Obstacles.afloat([[500.0, 600.0, 30.0]], [40.0], position_std=3.0, growth=0.05)
    some += ap.Obstacles.self_motivated([[1500.0, 1200.0, 40.0]], [30.0], [[-0.2, 0.1, 0.0]])
    return ap.Environment(
        current, chart_with_island() if chart else None, some if obstacles else None, LOWER, UPPER
    )
