"""How far interpolation may depart from means, against any points of a box."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import RegularGridInterpolator

from auvplan.ocean.deviation import interpolation_deviation


@given(seed=st.integers(0, 2**32 - 1))
def test_no_mean_of_points_departs_by_more(seed):
    rng = np.random.default_rng(seed)
    count = rng.integers(1, 4)
    even = rng.random() < 0.5
    nodes = [
        np.arange(size, dtype=float) if even else np.unique(rng.uniform(0.0, 10.0, size).round(3))
        for size in rng.integers(3, 7, count)
    ]
    fields = [rng.normal(size=[len(line) for line in nodes]) for _ in range(2)]
    edges = rng.choice([0.0, 0.1, 0.7, 2.0, 5.0], count)
    centre = rng.uniform(-1.0, 11.0, count)
    if rng.random() < 0.3:
        centre[0] = rng.choice(nodes[0])

    def at(points):
        held = np.stack(
            [np.clip(part, line[0], line[-1]) for part, line in zip(points.T, nodes, strict=True)], 1
        )
        return np.stack([RegularGridInterpolator(nodes, field)(held) for field in fields], axis=1)

    bound = interpolation_deviation(fields, nodes, [np.array([place]) for place in centre], edges.tolist())[0]
    for _ in range(4):
        shares = rng.uniform(-0.5, 0.5, (5, count))
        shares = np.where(rng.random(shares.shape) < 0.5, np.sign(shares) * 0.5, shares)
        points, weights = centre + shares * edges, rng.dirichlet(np.ones(5))
        departure = np.linalg.norm(at(weights[None] @ points)[0] - weights @ at(points))
        assert departure <= bound + 1e-9


def test_it_is_as_great_as_the_kink_of_a_box_and_nothing_beside_it():
    """A quarter of jump times edge where the kink is in the middle; a box that ends at it has none."""
    line, values = np.arange(5.0), np.array([0.0, 0.0, 0.0, 3.0, 6.0])
    places, edges = [np.array([2.0, 1.5, 2.3, 0.2])], [np.array([1.0, 1.0, 0.8, 0.3])]
    found = interpolation_deviation([values], [line], places, edges)
    assert found == pytest.approx([0.75, 0.0, 0.6, 0.0])
