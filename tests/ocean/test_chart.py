"""Charts: geometry, signed distance, sampling, and the shipped example."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy import ndimage

from auvplan.ocean.chart import FAR, Chart, ChartError
from auvplan.ocean.whitsunday import CENTRE, EXTENT, FRINGE, SITE, classes, render, whitsunday_chart

#: Most that bilinear sampling adds to the true distance, in pixels: at the corner of a lone coast pixel.
EXCESS = (1.5 - np.sqrt(0.5)) / 4
masks = hnp.arrays(bool, hnp.array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=8))


def true_distance(water: np.ndarray, x: np.ndarray, y: np.ndarray, size: float) -> np.ndarray:
    """Distance to the nearest coast pixel, a square of edge `size`, by trying every one."""
    land = (np.argwhere(~water) + 0.5) * size
    dx = np.maximum(np.abs(x[..., None] - land[:, 0]) - size / 2, 0.0)
    dy = np.maximum(np.abs(y[..., None] - land[:, 1]) - size / 2, 0.0)
    return np.hypot(dx, dy).min(axis=-1)


def centres(shape: tuple[int, int], size: float) -> tuple[np.ndarray, np.ndarray]:
    """North and east of the pixel centres of a chart at the origin, [nx, ny] each."""
    x, y = np.meshgrid(*((np.arange(n) + 0.5) * size for n in shape), indexing="ij")
    return x, y


@pytest.fixture
def bay() -> Chart:
    """20 x 14 pixels of 5 m with scattered rocks, its corner at (100, -40)."""
    water = np.random.default_rng(3).random((20, 14)) > 0.1
    return Chart.from_mask(water, pixel_size=5.0, origin=(100.0, -40.0))


# Geometry


def test_land_is_the_pixels_of_the_coast():
    rng = np.random.default_rng(3)
    water = rng.random((17, 23)) < 0.7
    chart = Chart.from_mask(water, pixel_size=10.0, origin=(100.0, -50.0))
    land = chart.land()
    assert land.area == pytest.approx(100.0 * (~water).sum())
    north, east = np.meshgrid(105.0 + 10.0 * np.arange(17), -45.0 + 10.0 * np.arange(23), indexing="ij")
    np.testing.assert_array_equal(shapely.contains_xy(land, east, north), ~water)
    part = chart.land((132.0, -20.0), (171.0, 35.0))
    assert part.bounds[0] >= -20.0
    assert part.bounds[3] <= 180.0
    assert part.area == pytest.approx(100.0 * (~water[3:8, 3:9]).sum())


def test_positions_off_the_chart_are_no_water(bay):
    x = np.array([99.9, 200.1, 150.0, 150.0, np.nan, np.inf])
    y = np.array([0.0, 0.0, -40.1, 30.1, 0.0, 0.0])
    assert not bay.contains(x, y).any()
    assert not bay.is_water(x, y).any()
    assert bay.contains(*np.asarray(bay.lower))
    assert bay.contains(*np.asarray(bay.upper))


def test_is_water_agrees_with_the_raster(bay):
    x, y = centres(bay.shape, 5.0)
    np.testing.assert_array_equal(bay.is_water(x + 100.0, y - 40.0), np.asarray(bay.passability) > 0)


def test_crop_keeps_places_and_distances(bay):
    part = bay.crop(4, 2, 10, 8)
    assert part.shape == (10, 8)
    np.testing.assert_allclose(part.lower, [120, -30])
    x, y = np.meshgrid(np.linspace(122.5, 167.5, 31), np.linspace(-27.5, 7.5, 29))
    np.testing.assert_allclose(part.distance(x, y), bay.distance(x, y), atol=1e-4)
    np.testing.assert_allclose(part.passability_at(x, y), bay.passability_at(x, y), atol=1e-5)


def test_crop_knows_the_coast_beyond_its_edge():
    water = np.ones((10, 10), bool)
    water[0] = False
    part = Chart.from_mask(water).crop(1, 0, 5, 10)
    assert float(part.distance(15.0, 55.0)) <= 5.0


@pytest.mark.parametrize("window", [(-1, 0, 5, 5), (0, 0, 21, 5), (18, 0, 3, 3), (0, 12, 2, 3), (0, 0, 0, 1)])
def test_crop_beyond_the_chart(bay, window):
    with pytest.raises(ChartError, match="beyond"):
        bay.crop(*window)


@pytest.mark.parametrize(
    ("raster", "message"),
    [
        (np.zeros((0, 3)), "non-empty"),
        (np.zeros(3), "non-empty"),
        (np.full((2, 2), 0.5), "passability must be"),
        (np.full((2, 2), -0.1), "passability must be"),
        (np.full((2, 2), np.nan), "passability must be"),
    ],
)
def test_bad_rasters(raster, message):
    with pytest.raises(ChartError, match=message):
        Chart.from_passability(raster)


@pytest.mark.parametrize(
    "chart",
    [
        Chart.from_mask(np.ma.array(np.ones((3, 3), bool), mask=np.eye(3))),
        Chart.from_mask(np.where(np.eye(3), np.nan, 1.0)),
        Chart.from_passability(np.ma.array(np.ones((3, 3)), mask=np.eye(3))),
    ],
    ids=["masked", "not a number", "masked passability"],
)
def test_what_is_hidden_or_no_number_is_coast(chart):
    np.testing.assert_array_equal(chart.passability, 1.0 - np.eye(3))


@pytest.mark.parametrize("size", [0.0, -1.0, np.nan, np.inf])
def test_bad_pixel_size(size):
    with pytest.raises(ChartError, match="pixel_size"):
        Chart.from_mask(np.ones((2, 2), bool), pixel_size=size)


def test_uncertain_area_is_no_coast():
    chart = Chart.from_passability([[1.0, 0.2, 0.35, 0.0]])
    assert (np.asarray(chart.signed_distance)[0] > 0).tolist() == [True, True, True, False]
    assert chart.is_water(5.0, 15.0)
    assert chart.shares() == pytest.approx({"coast": 0.25, "uncertain": 0.5, "water": 0.25})


# Signed distance


@settings(max_examples=25, deadline=None)
@given(masks)
def test_signed_distance_against_naive(water):
    size = 7.0
    found = np.asarray(Chart.from_mask(water, pixel_size=size).signed_distance)
    if water.all() or not water.any():
        np.testing.assert_array_equal(found, np.where(water, FAR, -FAR) * size)
        return
    place = np.argwhere(np.ones_like(water)).reshape(*water.shape, 2).astype(float)
    for i, j in np.ndindex(water.shape):
        other = place[water != water[i, j]]
        nearest = np.hypot(*(other - place[i, j]).T).min()
        expected = nearest * size - size / np.sqrt(2) if water[i, j] else size / 2 - nearest * size
        assert found[i, j] == pytest.approx(expected, abs=1e-3)


@settings(max_examples=25, deadline=None)
@given(masks, st.integers(0, 2**32 - 1))
def test_distance_is_a_lower_bound(water, seed):
    """At pixel centres never above the distance to the coast pixels; between them by no more than stated."""
    size = 10.0
    chart = Chart.from_mask(water, pixel_size=size)
    signed = np.asarray(chart.signed_distance)
    assert ((signed > 0) == water).all()
    if water.all():
        assert (signed >= FAR).all()
        return
    assert (signed <= true_distance(water, *centres(water.shape, size), size) + 1e-3).all()
    x, y = np.random.default_rng(seed).uniform(0.0, size * np.array(water.shape)[:, None], (2, 400))
    assert (np.asarray(chart.distance(x, y)) <= true_distance(water, x, y, size) + EXCESS * size + 1e-3).all()


def test_sampling_excess_is_met_at_a_lone_pixel():
    water = np.ones((5, 5), bool)
    water[2, 2] = False
    assert float(Chart.from_mask(water, pixel_size=1.0).distance(3.0, 3.0)) == pytest.approx(EXCESS, abs=1e-6)


# Sampling


@pytest.mark.parametrize("shape", [(20, 14), (1, 9), (9, 1), (1, 1)])
def test_bilinear_against_scipy(shape):
    rng = np.random.default_rng(1)
    water = rng.random(shape) > 0.2
    chart = Chart.from_mask(water, pixel_size=5.0, origin=(100.0, -40.0))
    low, high = np.asarray(chart.lower), np.asarray(chart.upper)
    x, y = rng.uniform(low[:, None], high[:, None], (2, 500))
    index = np.stack([(x - 100.0) / 5.0 - 0.5, (y + 40.0) / 5.0 - 0.5])
    for raster, found in (
        (chart.signed_distance, chart.distance(x, y)),
        (chart.passability, chart.passability_at(x, y)),
    ):
        expected = ndimage.map_coordinates(np.asarray(raster, float), index, order=1, mode="nearest")
        expected = np.where(expected >= FAR, np.inf, expected)
        np.testing.assert_allclose(found, expected, atol=1e-3, rtol=1e-5)


def test_outside_the_way_back_is_subtracted(bay):
    corner = float(bay.distance(200.0, 30.0))
    assert float(bay.distance(203.0, 34.0)) == pytest.approx(corner - 5.0, abs=1e-4)
    assert float(bay.distance(150.0, -140.0)) == pytest.approx(
        float(bay.distance(150.0, -40.0)) - 100.0, abs=1e-4
    )
    assert float(bay.passability_at(203.0, 34.0)) == float(bay.passability_at(200.0, 30.0))


def test_gradient_against_differences(bay, x64):
    rng = np.random.default_rng(2)
    inside = rng.uniform([[100.0], [-40.0]], [[200.0], [30.0]], (2, 200))
    outside = rng.uniform([[205.0], [35.0]], [[300.0], [90.0]], (2, 20))
    x, y = np.concatenate([inside, outside], axis=1)
    found = jax.jit(jax.vmap(jax.grad(bay.distance, argnums=(0, 1))))(x, y)
    step = 1e-6
    # A difference across a line between pixel centres straddles a kink.
    cell = np.abs((np.stack([x, y]) / 5.0) % 1.0 - 0.5) > 1e-5
    for axis, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        difference = (bay.distance(x + dx, y + dy) - bay.distance(x - dx, y - dy)) / (2 * step)
        np.testing.assert_allclose(found[axis][cell[axis]], difference[cell[axis]], atol=1e-6)


def test_gradient_is_finite_everywhere(bay):
    x = jnp.array([100.0, 200.0, 100.0, 200.0, 150.0, 102.5, 95.0, 250.0, 1e7])
    y = jnp.array([-40.0, 30.0, 30.0, 0.0, -40.0, -37.5, -45.0, 30.0, -1e7])
    for sample in (bay.distance, bay.passability_at):
        gradient = jax.jit(jax.vmap(jax.grad(sample, argnums=(0, 1))))(x, y)
        assert np.isfinite(np.asarray(gradient)).all()


def test_a_chart_made_in_double_precision_serves_in_single():
    with jax.enable_x64(True):
        chart = Chart.from_mask(np.eye(4, dtype=bool))
    assert {leaf.dtype for leaf in jax.tree.leaves(chart)} == {np.dtype(np.float32)}
    assert chart.distance(15.0, 15.0).dtype == np.float32


# The shipped example


def test_shipped_chart():
    chart = whitsunday_chart()
    assert chart.shape == (1000, 1000)
    np.testing.assert_allclose(chart.upper, [EXTENT, EXTENT])
    assert 0.2 < chart.shares()["coast"] < 0.45
    parts, count = ndimage.label(np.asarray(chart.passability) > 0)
    sizes = np.bincount(parts.ravel(), minlength=count + 1)[1:]
    assert sizes.max() > 0.99 * sizes.sum()


def test_shipped_chart_north_is_up():
    """Whitsunday Island fills the north, Hamilton Island lies south-west of the centre, sea south-east."""
    chart = whitsunday_chart()
    middle = SITE.to_local(*np.array([CENTRE]).T)
    np.testing.assert_allclose(middle, EXTENT / 2, atol=1e-6)
    for longitude, latitude, water in (
        (148.975, -20.305, False),
        (148.952, -20.354, False),
        (149.0, -20.375, True),
    ):
        x, y = SITE.to_local(np.array(longitude), np.array(latitude))
        assert bool(chart.is_water(x, y)) == water


def test_shipped_picture_is_a_function_of_its_seed():
    np.testing.assert_array_equal(render(100, seed=4), render(100, seed=4))
    assert (render(100, seed=4) != render(100, seed=5)).any()
    kinds = classes(500)
    reach = ndimage.distance_transform_edt(kinds != 0) * EXTENT / 500
    assert (reach[kinds == 1] <= FRINGE).all()
    assert (reach[kinds == 2] > FRINGE).all()


def test_slopes_by_pixels_are_their_shares():
    chart = Chart.from_mask(np.arange(9).reshape(3, 3) < 8)
    slopes = jax.grad(lambda chart: chart.distance(12.0, 7.5))(chart)
    shares = np.outer([0.3, 0.7, 0.0], [0.75, 0.25, 0.0])
    np.testing.assert_allclose(slopes.signed_distance, shares, atol=1e-6)


def test_without_a_coast_it_is_nowhere_near():
    chart = Chart.from_mask(np.ones((3, 4), bool))
    assert (np.asarray(chart.distance([5.0, -300.0], 12.0)) == np.inf).all()
    slope = jax.grad(lambda x: jnp.minimum(chart.distance(x, 12.0), 3.0))(5.0)
    assert slope == 0.0


def test_a_program_is_no_picture(tmp_path, monkeypatch):
    """PostScript would be given to an interpreter."""
    monkeypatch.setattr("subprocess.Popen", lambda *_, **__: pytest.fail("started"))
    path = tmp_path / "chart.png"
    path.write_text("%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 80 60\n%%EndComments\nshowpage\n%%EOF\n")
    with pytest.raises(ValueError, match="not a picture or grid that can be read"):
        Chart.from_image(path, 10.0)
