"""Picture files that are charts, and files that are none."""

import warnings

import numpy as np
import pytest
from PIL import Image

from auvplan.ocean.chart import Chart, ChartError
from auvplan.ocean.whitsunday import render
from tests.io.small_site import png_head

LAND, WATER = (120, 140, 80), (40, 95, 160)


def test_image_rows_run_from_the_north(tmp_path):
    picture = np.empty((40, 60, 3), np.uint8)
    picture[:] = WATER
    picture[:10, :20] = LAND  # the north-western corner
    Image.fromarray(picture).save(tmp_path / "chart.png")
    chart = Chart.from_image(tmp_path / "chart.png", pixel_size=2.0)
    assert chart.shape == (40, 60)
    assert not chart.is_water(78.0, 2.0)
    assert chart.is_water([2.0, 78.0, 2.0], [2.0, 118.0, 118.0]).all()
    assert np.mean(np.asarray(chart.passability) == 0) == pytest.approx(200 / 2400, abs=0.002)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"this is a letter", "not a picture"),
        (b"", "not a picture"),
        (png_head(0, 10), "not a picture"),
        (png_head(10, 10, b""), "Read Error"),
        (png_head(10_000, 9_000), "10000 x 9000 pixels"),
        (png_head(100_000, 100_000), "100000 x 100000 pixels"),
        (b"II*\x00\x08\x00\x00\x00\x05\x00", "."),
    ],
)
def test_bad_files(tmp_path, content, reason):
    path = tmp_path / "broken.png"
    path.write_bytes(content)
    with pytest.raises(ChartError, match=reason) as caught:
        Chart.from_image(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_folder(tmp_path):
    with pytest.raises(ChartError, match=r"nowhere\.png: No such file"):
        Chart.from_image(tmp_path / "nowhere.png")
    with pytest.raises(ChartError, match=tmp_path.name):
        Chart.from_image(tmp_path)


@pytest.mark.parametrize("mode", ["L", "1", "LA", "F", "I"])
def test_pictures_without_colour_are_refused(tmp_path, mode):
    path = tmp_path / "grey.tif"
    Image.fromarray(render(50)).convert("L").convert(mode).save(path)
    with pytest.raises(ChartError, match=r"grey\.tif: a picture without colour"):
        Chart.from_image(path)


def test_palettes_and_see_through_pixels(tmp_path):
    picture = np.full((20, 20, 4), (*WATER, 255), np.uint8)
    picture[:10, :, 3] = 0
    Image.fromarray(picture).save(tmp_path / "half.png")
    half = Chart.from_image(tmp_path / "half.png")
    assert (np.asarray(half.passability)[10:] == 0).all()
    assert (np.asarray(half.passability)[:10] == 1).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # as Pillow has it of palettes with transparency
        Image.fromarray(render(50)).convert("P").save(
            tmp_path / "palette.png", transparency=bytes(range(256))
        )
        assert Chart.from_image(tmp_path / "palette.png").shape == (50, 50)
