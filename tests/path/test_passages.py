"""Coarse time-to-reach fields: times against Dijkstra's, passages on both sides of an obstacle."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import auvplan as ap
from auvplan.path import passages
from auvplan.path.cost import curves

CONFIG = ap.PathConfig(field_cells=24)
START, GOAL = jnp.array([0.0, 0.0, 10.0]), jnp.array([2000.0, 0.0, 10.0])
LOWER, UPPER = (-1000, -1600, 0), (3000, 1600, 60)


def test_fields_are_shortest_times():
    rng = np.random.default_rng(0)
    shape = (9, 7)
    edges = rng.uniform(1.0, 10.0, (len(passages.MOVES), *shape))
    rows, columns, times = [], [], []
    for k, (a, b) in enumerate(passages.MOVES):
        for i, j in np.ndindex(shape):
            if 0 <= i - a < shape[0] and 0 <= j - b < shape[1]:
                rows.append((i - a) * shape[1] + j - b)
                columns.append(i * shape[1] + j)
                times.append(edges[k, i, j])
    graph = coo_array((times, (rows, columns)), shape=(edges[0].size,) * 2).tocsr()
    field = passages._field(jnp.asarray(edges), (2, 3))
    np.testing.assert_allclose(field.reshape(-1), dijkstra(graph, indices=2 * shape[1] + 3), rtol=1e-5)
    back = passages._field(passages._reversed(jnp.asarray(edges)), (2, 3))
    np.testing.assert_allclose(back.reshape(-1), dijkstra(graph.T.tocsr(), indices=17), rtol=1e-5)


def test_passages_on_both_sides_of_an_obstacle():
    rock = ap.Obstacles.static([[1000.0, 50.0, 10.0]], [300.0])
    env = ap.Environment(None, None, rock, LOWER, UPPER)
    found, times = jax.jit(passages.trace_passages, static_argnums=(5, 6))(
        START, GOAL, 0.0, env, ap.Vehicle(), 4, CONFIG
    )
    assert (np.diff(times) >= 0.0).all()
    x, y, _ = (axis.T for axis in curves(found, START, GOAL, CONFIG).places)
    beside = np.asarray(y)[np.arange(4), np.abs(np.asarray(x) - 1000.0).argmin(axis=1)]
    assert beside[0] < -200.0  # the shorter way, west of the rock
    assert beside[np.isfinite(times)].max() > 300.0


def test_the_way_follows_the_current():
    # A jet along the line of y = 400 m.
    env = ap.Environment(
        lambda x, y, z, t: (1.5 * jnp.exp(-(((y - 400.0) / 150.0) ** 2)), 0.0, 0.0), None, None, LOWER, UPPER
    )
    found, _ = passages.trace_passages(START, GOAL, 0.0, env, ap.Vehicle(), 1, CONFIG)
    _, y, _ = (axis.T for axis in curves(found, START, GOAL, CONFIG).places)
    assert float(y.max()) > 250.0
