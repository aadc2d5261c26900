"""k-means on chart pictures: classes by colour, whatever the picture."""

import numpy as np
import pytest
from PIL import Image

from auvplan.ocean.classify import DEFAULT_CLUSTERS, UNCERTAIN_MAX, classify_picture
from auvplan.ocean.naming import name_clusters
from auvplan.ocean.palette import to_lab
from auvplan.ocean.whitsunday import classes, render

LAND, SHOAL, WATER = (120, 140, 80), (165, 205, 190), (40, 95, 160)


def classify(rgb: np.ndarray, clusters: int = DEFAULT_CLUSTERS, seed: int = 0) -> np.ndarray:
    """Passability of every pixel, [h, w]."""
    return classify_picture(rgb, None, clusters, seed).passability


def named(passability: np.ndarray) -> np.ndarray:
    """Passability to classes: 0 coast, 1 uncertain, 2 water."""
    return np.where(passability == 0, 0, np.where(passability == 1, 2, 1))


def picture(*bands: tuple[int, int, int], noise: float = 4.0, seed: int = 0) -> np.ndarray:
    """Bands of 30 rows of one colour each under pixel noise, [30 * bands, 50, 3]."""
    clean = np.repeat(np.array(bands, float), 30, axis=0)[:, None].repeat(50, axis=1)
    noisy = clean + np.random.default_rng(seed).normal(scale=noise, size=clean.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8)


def test_lab_of_known_colours():
    """Values of the sRGB primaries in CIELAB under D65."""
    rgb = np.array([[255, 255, 255], [0, 0, 0], [255, 0, 0], [0, 255, 0], [0, 0, 255]], np.uint8)
    primaries = [53.24, 80.09, 67.20], [87.73, -86.18, 83.18], [32.30, 79.19, -107.86]
    expected = [[100, 0, 0], [0, 0, 0], *primaries]
    np.testing.assert_allclose(to_lab(rgb), expected, atol=0.05)


@pytest.mark.parametrize("clusters", [3, DEFAULT_CLUSTERS])
def test_shipped_picture_agrees_with_its_truth(clusters):
    assert (named(classify(render(), clusters)) == classes()).mean() >= 0.99


@pytest.mark.parametrize(
    ("site", "clusters"),
    [
        ("hamilton_dent", 3),
        ("hook_passage", DEFAULT_CLUSTERS),
        pytest.param("hamilton_dent", DEFAULT_CLUSTERS, marks=pytest.mark.slow),
        pytest.param("hook_passage", 3, marks=pytest.mark.slow),
    ],
)
def test_real_outlines_agree_with_their_truth(shared, site, clusters):
    folder = shared / "data" / "maps"
    if not folder.is_dir():
        pytest.skip(f"needs charts in {folder}")
    rgb = np.asarray(Image.open(folder / f"whitsunday_{site}_rgb.tif").convert("RGB"))
    truth = np.asarray(Image.open(folder / f"whitsunday_{site}_class.tif"))
    assert (named(classify(rgb, clusters)) == truth).mean() >= 0.99


def test_classes_do_not_depend_on_the_seed():
    rgb = render(300)
    first = named(classify(rgb, seed=0))
    assert (named(classify(rgb, seed=1)) == first).mean() > 0.999


def test_names_do_not_depend_on_the_order_of_clusters():
    lab = to_lab(np.array([LAND, SHOAL, WATER, (20, 60, 120), (90, 80, 50)], np.uint8))
    for order in ([0, 1, 2, 3, 4], [4, 3, 2, 1, 0], [2, 0, 4, 1, 3]):
        np.testing.assert_array_equal(name_clusters(lab[order]), np.array([0, 1, 2, 2, 0])[order])


@pytest.mark.parametrize(
    ("bands", "expected"),
    [
        pytest.param((LAND, SHOAL, WATER), (0, 1, 2), id="all three"),
        pytest.param((LAND, (45, 80, 40), WATER), (0, 0, 2), id="no uncertain area"),
        pytest.param((WATER, (20, 60, 120), (75, 125, 180)), (2, 2, 2), id="all water"),
        pytest.param((LAND, (45, 80, 40), (134, 120, 90)), (0, 0, 0), id="all land"),
        pytest.param((SHOAL, WATER), (1, 2), id="no land"),
        pytest.param(((150, 150, 150), SHOAL, WATER), (0, 1, 2), id="grey land"),
        pytest.param(((240, 220, 160), (190, 220, 240), (70, 130, 190)), (0, 1, 2), id="paper chart"),
        pytest.param(((60, 70, 35), (60, 160, 150), (12, 25, 55)), (0, 1, 2), id="satellite"),
    ],
)
def test_other_pictures(bands, expected):
    truth = np.repeat(np.array(expected), 30)[:, None].repeat(50, axis=1)
    assert (named(classify(picture(*bands))) == truth).mean() >= 0.99


def test_uncertain_passability_falls_with_the_distance_from_water():
    near, far = (120, 185, 190), (185, 215, 200)
    found = classify(picture(LAND, far, near, WATER, noise=0.0))
    values = found[[45, 75], 25]
    assert 0 < values[0] < values[1] <= UNCERTAIN_MAX


def test_fewer_colours_than_clusters():
    assert (classify(np.full((5, 5, 3), WATER, np.uint8)) == 1).all()
    assert classify(np.full((1, 1, 3), LAND, np.uint8)).item() == 0


def test_bad_arrays_and_numbers_of_clusters():
    for shape, dtype in (((4, 4), "u1"), ((4, 4, 4), "u1"), ((4, 4, 3), float), ((0, 4, 3), "u1")):
        with pytest.raises(ValueError, match="picture"):
            classify(np.zeros(shape, dtype))
    with pytest.raises(ValueError, match="clusters"):
        classify(np.zeros((4, 4, 3), np.uint8), clusters=0)
