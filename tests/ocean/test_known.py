"""Spheres that cover known obstacles: nothing of a cylinder is left out, and little is added."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.ocean.known import KnownObstacle, spheres


@settings(max_examples=40, deadline=None)
@given(
    radius=st.floats(0.5, 300.0),
    top=st.floats(0.0, 80.0),
    height=st.floats(0.0, 400.0),
    depths=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 100.0)).map(lambda pair: (pair[0], sum(pair))),
    now=st.floats(0.0, 5000.0),
    seed=st.integers(0, 99),
)
def test_every_point_of_a_cylinder_near_the_depths_lies_in_a_sphere(radius, top, height, depths, now, seed):
    obstacle = KnownObstacle("ship", (100.0, -50.0), radius, top, top + height, (0.3, -0.2))
    found = spheres([obstacle], depths, now)
    rng = np.random.default_rng(seed)
    centre = np.array([100.0 + 0.3 * now, -50.0 - 0.2 * now])
    angle, share = rng.uniform(0.0, 2.0 * np.pi, 200), np.sqrt(rng.uniform(0.0, 1.0, 200))
    places = np.empty((200, 3))
    places[:, :2] = centre + radius * share[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    places[:, 2] = rng.uniform(top, top + height, 200)
    places = places[(places[:, 2] >= depths[0] - 50.0) & (places[:, 2] <= depths[1] + 50.0)]
    if len(places):
        away = np.linalg.norm(places[:, None] - found.position, axis=2) - found.radius
        assert away.min(axis=1).max() <= 1e-6 * (1.0 + np.abs(places).max())
    if len(found.radius):
        assert found.radius.max() <= radius + max(0.12 * radius, 1.0) + 1e-9
        np.testing.assert_allclose(found.position[:, :2], np.tile(centre, (len(found.radius), 1)))
        np.testing.assert_array_equal(found.velocity, np.tile([0.3, -0.2, 0.0], (len(found.radius), 1)))


def test_what_lies_far_below_is_left_out():
    wreck = KnownObstacle("wreck", (0.0, 0.0), 20.0, 300.0, 310.0)
    assert len(spheres([wreck], (0.0, 50.0), 0.0).radius) == 0
    assert len(spheres([], (0.0, 50.0), 0.0).radius) == 0


@settings(max_examples=40, deadline=None)
@given(
    st.tuples(*[st.floats(-200.0, 200.0)] * 2),
    st.tuples(*[st.floats(-2.0, 2.0)] * 2),
    st.floats(0.0, 500.0),
    st.floats(0.0, 500.0),
)
def test_how_close_one_comes_is_the_least_of_all_times(position, velocity, begin, lasts):
    obstacle = KnownObstacle("ship", position, 15.0, 0.0, 8.0, velocity)
    place, times = np.array([10.0, -20.0, 5.0]), np.linspace(begin, begin + lasts, 2001)
    when, apart = obstacle.closest(place, begin, begin + lasts)
    assert begin <= when <= begin + lasts
    every = obstacle.distance(np.broadcast_to(place, (2001, 3)), times)
    assert apart <= every.min() + 1e-6
    assert apart == pytest.approx(every.min(), abs=lasts / 2000.0 * np.hypot(*velocity) + 1e-6)
