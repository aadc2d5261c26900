"""Steps of a metre, the coast beside them, stretches of faults."""

import numpy as np
import pytest
import xarray as xr
from scipy import ndimage

from auvplan.check.track import Bed, Coast, SampledTrack, events


def test_walk_takes_steps_of_a_metre_at_most():
    times = np.array([0.0, 3.0, 6.0, 9.0])
    positions = np.array([[0.0, 0, 0], [7.4, 0, 0], [7.4, 0, 0], [7.4, 3.2, 1.0]])
    obstacles = np.array([[[0.0, 0, 0]], [[0.0, 0, 0]], [[0.0, 12.5, 0]], [[0.0, 12.5, 0]]])
    walk = SampledTrack.of(times, positions, obstacles)
    assert walk.metres.max() <= 1.0
    assert np.linalg.norm(np.diff(walk.obstacles[:, 0], axis=0), axis=1).max() <= 1.0
    assert walk.metres.sum() == pytest.approx(7.4 + np.hypot(3.2, 1.0))
    for time in times:
        assert np.isclose(walk.times, time).any()
    np.testing.assert_allclose(np.interp(walk.times, times, positions[:, 0]), walk.positions[:, 0])


@pytest.mark.parametrize("seed", range(5))
def test_coast_clearance_against_all_pixels(seed):
    rng = np.random.default_rng(seed)
    land = rng.random((60, 60)) < 0.01
    land[20:26, 30:36] = True
    data = xr.Dataset(
        {
            "passability": (("chart_x", "chart_y"), np.where(land, 0.0, 1.0)),
            "chart_origin": ("horizontal", np.array([100.0, -50.0])),
            "chart_pixel_size": ((), 10.0),
        }
    )
    coast = Coast.of(data)
    steps = np.concatenate([np.zeros((1, 3)), rng.normal(size=(800, 3))])
    steps /= np.maximum(np.linalg.norm(steps, axis=1, keepdims=True), 1.0)
    walk = np.array([400.0, 250.0, 0.0]) + np.cumsum(steps, axis=0) * [1.0, 1.0, 0.0]
    centres = np.array([100.0, -50.0]) + 10.0 * (np.argwhere(land) + 0.5)
    gap = np.maximum(np.abs(walk[:, None, :2] - centres) - 5.0, 0.0)
    found, least = coast.distances(walk), np.hypot(*gap.transpose(2, 1, 0)).min(axis=0)
    # Between two places it comes nearer than at either, by no more than half of the way.
    reach = np.append(np.linalg.norm(np.diff(walk[:, :2], axis=0), axis=1), 0.0)
    both = np.minimum(least, np.append(least[1:], np.inf))
    assert (found <= both + 1e-9).all()
    assert (found >= both - 0.5 * reach - 1e-9).all()


def test_events():
    assert list(events(np.array([True, True, False, True, False, False, True]))) == [(0, 1), (3, 3), (6, 6)]
    assert not list(events(np.zeros(4, bool)))


def test_altitude_is_bilinear_between_centres_and_held_beyond_them():
    rng = np.random.default_rng(1)
    depth = rng.uniform(20.0, 90.0, (7, 5))
    depth[2, 3] = np.nan  # not known: as shallow as can be
    data = xr.Dataset(
        {
            "seabed_depth": (("seabed_x", "seabed_y"), depth.astype(np.float32)),
            "seabed_origin": ("horizontal", np.array([100.0, -50.0])),
            "seabed_pixel_size": ((), 30.0),
        },
        attrs={"seabed_clearance": 5.0},
    )
    bed = Bed.of(data)
    places = rng.uniform([90.0, -60.0, 0.0], [320.0, 110.0, 99.0], (500, 3))
    index = np.stack([(places[:, 0] - 100.0) / 30.0 - 0.5, (places[:, 1] + 50.0) / 30.0 - 0.5])
    expected = ndimage.map_coordinates(np.nan_to_num(depth), index, order=1, mode="nearest") - places[:, 2]
    np.testing.assert_allclose(bed.altitude(places), expected, atol=1e-5)
    low, high = np.array([100.0, -50.0]), np.array([310.0, 100.0])
    beyond = ((places[:, :2] < low) | (places[:, :2] > high)).any(axis=1)
    assert (bed.outside(places) == beyond).all()
    assert bed.clearance == 5.0
