"""Time-to-reach fields against Dijkstra's, and the passages they find: gaps, islands, both sides of rocks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import auvplan as ap
from auvplan.path import passages
from tests.path.kernels import curves, leg

CONFIG = ap.PathConfig(field_cells=48, control_points=16, samples=64)
START, GOAL = jnp.array([0.0, 0.0, 10.0]), jnp.array([2000.0, 0.0, 10.0])
LOWER, UPPER = (-1000, -1600, 0), (3000, 1600, 60)
WATER = np.ones((400, 320), bool)
NOWHERE = ap.Obstacles.static([[9e4, 9e4, 10.0]], [1.0])


def sea(water=WATER, obstacles=NOWHERE, current=None, origin=LOWER[:2], **box):
    """Water in pixels of 10 m with one obstacle: what all have is traced by one program."""
    chart = ap.Chart.from_mask(water, 10.0, origin)
    return ap.Environment(current, chart, obstacles, **{"lower": LOWER, "upper": UPPER} | box)


trace_passages = jax.jit(passages.trace_passages, static_argnums=(1, 2))


def traced(start, goal, env, count=4):
    """Passages from start to goal, as `trace_passages` returns them."""
    return trace_passages(leg(start, goal, env), count, CONFIG)


def grid_with(times):
    """A grid of given times of moves from (1, 2) to (6, 4)."""
    cells = times.shape[1]
    nothing, zero = jnp.zeros((cells, cells)), jnp.zeros(2)
    ends = ((jnp.array(1), jnp.array(2)), (jnp.array(6), jnp.array(4)))
    broken = jnp.zeros((2, cells, len(passages.MOVES), cells))
    return passages._Grid(zero, zero, nothing, nothing, nothing, times, broken, *ends)


def naive(times):
    """All moves of such a grid as a sparse matrix, from cell to cell."""
    cells = times.shape[1]
    tails, heads, lengths = [], [], []
    for turned, table in enumerate(np.asarray(times)):
        for i, k, j in np.ndindex(cells, len(passages.MOVES), cells):
            a, b = passages.MOVES[k]
            if i < a or not 0 <= j - b < cells:
                continue
            here, there = (i, j), (i - a, j - b)
            here, there = (
                np.ravel_multi_index(p[::-1] if turned else p, (cells,) * 2) for p in (here, there)
            )
            tails += [there, here]
            heads += [here, there]
            lengths += [table[i, k, 0, j], table[i, k, 1, j]]
    # Diagonal moves are in both tables: the quicker one counts.
    table = np.full((cells**2, cells**2), np.inf)
    np.minimum.at(table, (tails, heads), lengths)
    kept = np.nonzero(np.isfinite(table))
    return coo_array((table[kept], kept), shape=table.shape).tocsr()


def test_fields_are_shortest_times(monkeypatch):
    monkeypatch.setattr(passages, "_SLOWER", 1e6)  # every cell counts, however slow the way through it
    rng = np.random.default_rng(0)
    times = jnp.asarray(rng.uniform(1.0, 10.0, (2, 9, len(passages.MOVES), 2, 9)))
    ahead, back = grid_with(times).fields()
    graph = naive(times)
    np.testing.assert_allclose(ahead.ravel(), dijkstra(graph, indices=1 * 9 + 2), rtol=1e-4)
    np.testing.assert_allclose(back.ravel(), dijkstra(graph.T.tocsr(), indices=6 * 9 + 4), rtol=1e-4)


def test_chains_lead_back_along_shortest_ways():
    rng = np.random.default_rng(1)
    times = jnp.asarray(rng.uniform(1.0, 10.0, (2, 9, len(passages.MOVES), 2, 9)))
    grid, graph = grid_with(times), naive(times).toarray()
    ahead, back = grid.fields()
    previous = np.asarray(grid.previous(jnp.stack([ahead, back]))[0])[0]
    cell = 6 * 9 + 4
    elapsed = 0.0
    while cell != 1 * 9 + 2:
        elapsed += graph[previous[cell], cell]
        cell = int(previous[cell])
    assert elapsed == pytest.approx(float(ahead[6, 4]), rel=1e-4)


def test_passages_on_both_sides_of_an_obstacle():
    rock = ap.Obstacles.static([[1000.0, 50.0, 10.0]], [300.0])
    env = sea(obstacles=rock)
    found, _, times, closed, known = traced(START, GOAL, env)
    assert (np.diff(times[np.isfinite(times)]) >= 0.0).all()
    x, y, _ = (axis.T for axis in curves(found, START, GOAL, CONFIG).places)
    beside = np.asarray(y)[np.arange(4), np.abs(np.asarray(x) - 1000.0).argmin(axis=1)]
    assert beside[0] < -200.0  # the shorter way, west of the rock
    assert beside[1] > 300.0
    assert float(closed) == 0.0
    assert 800.0 < float(known) < 900.0  # 2000 m at 2.5 m/s, and the detour


@pytest.mark.slow
def test_the_way_follows_the_current():
    # A jet along the line of y = 400 m.
    env = ap.Environment(
        lambda x, y, z, t: (1.5 * jnp.exp(-(((y - 400.0) / 150.0) ** 2)), 0.0, 0.0), None, None, LOWER, UPPER
    )
    found, *_ = traced(START, GOAL, env, 1)
    _, y, _ = (axis.T for axis in curves(found, START, GOAL, CONFIG).places)
    assert float(y.max()) > 250.0


def walled(*gaps, obstacles=NOWHERE):
    """A wall from side to side of a box of 4 km by 3.2 km, 100 m thick, with gaps in it, in pixels."""
    water = WATER.copy()
    water[195:205] = False
    for gap in gaps:
        water[195:205, gap] = True
    return sea(water, obstacles, upper=(3000, 1600, 0))


def test_passages_with_more_control_points_are_the_same_ways():
    rock = ap.Obstacles.static([[1000.0, 0.0, 10.0]], [300.0])
    env = sea(obstacles=rock)
    usual, fine, *_ = traced(START, GOAL, env)
    assert fine.shape == (4, CONFIG.finer * 3 * CONFIG.control_points)
    for k in range(2):
        few, many = (
            np.stack([np.asarray(axis)[:, k] for axis in curves(rows, START, GOAL, own).places[:2]], axis=1)
            for rows, own in ((usual, CONFIG), (fine, CONFIG.fine()))
        )
        away = np.linalg.norm(few[:, None] - many, axis=2).min(axis=1)
        assert away.max() < 60.0  # a cell


def test_a_gap_narrower_than_a_cell_is_found():
    env = walled(slice(243, 249))  # 60 m between 830 and 890 m east; the cells are larger
    ends = jnp.array([0.0, 0.0, 0.0]), jnp.array([2000.0, 0.0, 0.0])
    found, _, _, closed, known = traced(*ends, env)
    assert float(closed) == 0.0
    assert float(known) == pytest.approx(2.0 * np.hypot(1000.0, 850.0) / 2.5, rel=0.03)
    x, y, _ = (np.asarray(axis)[:, 0] for axis in curves(found, *ends, CONFIG).places)
    assert 800.0 < np.interp(1000.0, x, y) < 920.0


def test_a_wall_without_a_gap_is_closed():
    env = walled()
    ends = jnp.array([0.0, 0.0, 0.0]), jnp.array([2000.0, 0.0, 0.0])
    _, _, _, closed, known = traced(*ends, env)
    assert 0.0 < float(closed) < 200.0
    assert np.isinf(float(known))


def test_the_way_round_an_island_wider_than_the_straight_line_is_found():
    water = WATER.copy()
    water[145:155, 40:260] = False  # 2.2 km across a way of 1 km
    env = sea(water, origin=(0.0, 0.0), lower=(0, 0, 0), upper=(3000, 3000, 0))
    ends = jnp.array([1000.0, 1400.0, 0.0]), jnp.array([2000.0, 1400.0, 0.0])
    found, _, times, closed, known = traced(*ends, env)
    assert float(closed) == 0.0
    # Round the nearer end, 1010 m aside; the other passage leads round the farther one, 1210 m aside.
    for time, aside in zip(times[:2], (1010.0, 1210.0), strict=True):
        assert float(time) == pytest.approx(2.0 * np.hypot(450.0, aside) / 2.5 + 100.0 / 2.5, rel=0.03)
    assert float(known) == float(times[0])
    y = np.asarray(curves(found, *ends, CONFIG).places[1])
    assert y[:, 0].min() < 450.0
    assert y[:, 1].max() > 2550.0


def test_a_passage_that_is_closed_by_the_time_of_arrival_is_not_taken():
    # Two gaps; a sphere comes to the nearer one while the vehicle is on its way there.
    gaps = slice(170, 180), slice(110, 120)
    comes = ap.Obstacles.create([[1000.0, 950.0, 0.0]], [150.0], velocity=[[0.0, -2.0, 0.0]])
    free, met = (walled(*gaps, obstacles=seen) for seen in (NOWHERE, comes))
    ends = jnp.array([0.0, 0.0, 0.0]), jnp.array([2000.0, 0.0, 0.0])
    sides = []
    for world in (free, met):
        found, *_ = traced(*ends, world)
        x, y, _ = (np.asarray(axis)[:, 0] for axis in curves(found, *ends, CONFIG).places)
        sides.append(np.interp(1000.0, x, y))
    assert sides[0] > 0.0 > sides[1]
