"""Charts of other colours: stated by a person, proposed by rules, or refused; never silently wrong."""

import numpy as np
import pytest
from PIL import Image

from auvplan.errors import ScenarioWarning
from auvplan.ocean.chart import Chart, ChartError, classify_file
from auvplan.ocean.classify import UNCERTAIN_MAX, classify_picture
from auvplan.ocean.palette import ChartColours, as_hex, lab_of, to_hex, to_lab, to_rgb
from auvplan.ocean.whitsunday import classes, render
from tests.ocean.chart_pictures import SIZE, STYLES, Style, paint, satellite, shares_right

KINDS = classes(SIZE)
BLUE = Style((214, 196, 146), (150, 214, 204), (70, 130, 200), grain=3.0)


def some(*names: str) -> list:
    """All styles, those that others of their kind stand for marked as slow."""
    return [pytest.param(name, marks=pytest.mark.slow) if name in names else name for name in STYLES]


@pytest.mark.parametrize("name", some("grey", "dark", "blue land"))
def test_told_colours_make_the_chart(name):
    found = classify_picture(paint(STYLES[name]), colours=ChartColours(**STYLES[name].named))
    assert not found.doubts
    assert (found.warnings == ()) == (name != "satellite"), "charts are no photographs"
    assert min(shares_right(found.passability, KINDS).values()) > 0.98
    reef = found.passability[KINDS == 1]
    assert ((reef > 0.0) & (reef <= UNCERTAIN_MAX)).mean() > 0.9


@pytest.mark.parametrize("name", some("grey", "dark"))
def test_untold_colours_are_right_or_refused(name, tmp_path):
    path = tmp_path / "chart.png"
    Image.fromarray(paint(STYLES[name])).save(path)
    try:
        chart = Chart.from_image(path)
    except ChartError as error:
        message = str(error)
        assert name != "white deep water"
        assert message.startswith(f"{path}: ")
        assert "chart.colours" in message
        assert "--water" in message
        for cluster in classify_file(path).clusters:
            assert f"{cluster.colour} {cluster.share:.1%}" in message
        assert "\n" not in message
    else:
        assert min(shares_right(np.asarray(chart.passability)[::-1], KINDS).values()) > 0.98


def test_the_shipped_picture_is_in_no_doubt():
    found = classify_picture(render())
    assert found.doubts == found.notes == found.warnings == ()
    assert sum(cluster.share for cluster in found.clusters) == pytest.approx(1.0)
    shares = [cluster.share for cluster in found.clusters]
    assert shares == sorted(shares, reverse=True)


def test_colours_of_the_clusters_give_the_same_chart():
    proposed = classify_picture(render(300))
    kinds = {"water": "water", "land": "coast", "uncertain": "uncertain"}
    named = {
        name: tuple(cluster.colour for cluster in proposed.clusters if cluster.kind == kind)
        for name, kind in kinds.items()
    }
    stated = classify_picture(render(300), colours=ChartColours(**named))
    np.testing.assert_allclose(stated.passability, proposed.passability, atol=1e-6)


def test_one_colour_changes_one_cluster_where_not_all_are_stated():
    shoal = next(c for c in classify_picture(paint(BLUE)).clusters if c.kind == "uncertain")
    found = classify_picture(paint(BLUE), colours=ChartColours(water=(shoal.colour,)))
    assert (found.passability[KINDS == 1] == 1.0).mean() > 0.9
    assert min(shares_right(found.passability, KINDS).values()) > 0.98


def test_a_colour_of_water_settles_that_nothing_looks_like_water_and_one_of_land_does_not():
    grey = STYLES["grey"]
    found = classify_picture(paint(grey), colours=ChartColours(water=grey.named["water"]))
    assert not found.doubts
    assert min(shares_right(found.passability, KINDS).values()) > 0.98
    assert (found.passability[KINDS == 1] == 0.0).mean() > 0.9
    assert classify_picture(paint(grey), colours=ChartColours(land=grey.named["land"])).doubts


def test_colours_that_no_cluster_has():
    inverted = STYLES["inverted"]
    missed = ChartColours(**(inverted.named | {"land": ("navy",)}))
    doubts = classify_picture(paint(inverted), colours=missed).doubts
    assert any("#000080 of land" in doubt for doubt in doubts)
    pink = ChartColours(water=("#4682c8",), land=("#d6c492", "hotpink"))
    found = classify_picture(paint(BLUE), colours=pink)
    assert found.notes == ("no cluster is near the colour #ff69b4",)
    assert not found.doubts
    assert any("unlike all that were named" in line and "coast" in line for line in found.warnings)


def test_charts_whose_shallows_are_bluer_than_the_deep():
    """Deep water is the palest blue and shallows the strongest, as electronic charts by day have it."""
    electronic = Style((201, 185, 122), (115, 182, 239), (212, 234, 238), grain=2.0)
    found = classify_picture(paint(electronic))
    assert not found.doubts
    assert min(shares_right(found.passability, KINDS).values()) > 0.98
    assert found.notes


def test_white_land_and_blue_water_may_be_the_other_way_round():
    street = Style((242, 239, 233), (201, 227, 213), (170, 211, 223), grain=2.0)
    assert any("palest tone" in doubt for doubt in classify_picture(paint(street)).doubts)
    stated = classify_picture(paint(street), colours=ChartColours(**street.named))
    assert min(shares_right(stated.passability, KINDS).values()) > 0.98


def test_photographs_are_warned_of(tmp_path):
    style = STYLES["satellite"]
    Image.fromarray(paint(style)).save(tmp_path / "view.png")
    with pytest.warns(ScenarioWarning, match=r"view\.png looks more like a photograph"):
        Chart.from_image(tmp_path / "view.png", colours=ChartColours(**style.named))


SCENES = [(texture, seed) for texture in (0.3, 1.0, 1.5) for seed in (0, 1, 2)]
LATIN = ((0.3, 0), (1.5, 2))


@pytest.mark.parametrize(
    ("texture", "seed"),
    [scene if scene in LATIN else pytest.param(*scene, marks=pytest.mark.slow) for scene in SCENES],
)
def test_pictures_from_space_are_told_from_charts(texture, seed):
    found = classify_picture(satellite(texture, seed))
    assert any("more like a photograph" in line for line in found.warnings)


def test_real_charts_are_no_photographs(shared):
    charts = sorted((shared / "data" / "maps").glob("*_rgb.tif"))
    assert charts
    for path in charts:
        assert classify_file(path).warnings == ()


def test_pictures_without_colour_are_read_by_told_greys(tmp_path):
    grey = STYLES["grey"]
    Image.fromarray(paint(grey)).convert("L").save(tmp_path / "grey.png")
    chart = Chart.from_image(tmp_path / "grey.png", colours=ChartColours(**grey.named))
    assert min(shares_right(np.asarray(chart.passability)[::-1], KINDS).values()) > 0.98


# Frames


def framed(inner: np.ndarray, shade: int) -> tuple[np.ndarray, tuple[slice, slice]]:
    outer = np.full((SIZE + 80, SIZE + 112, 3), shade, np.uint8)
    place = slice(32, 32 + SIZE), slice(48, 48 + SIZE)
    outer[place] = inner
    return outer, place


@pytest.mark.parametrize(("shade", "name"), [(0, "black"), (255, "white")])
def test_margins_are_coast_and_stated(shade, name):
    picture, place = framed(paint(BLUE), shade)
    found = classify_picture(picture)
    assert not found.doubts
    assert min(shares_right(found.passability[place], KINDS).values()) > 0.98
    outside = np.ones(picture.shape[:2], bool)
    outside[place] = False
    assert (found.passability[outside] == 0.0).all()
    assert found.notes == (f"the {name} frame, 34.9% of the picture, shows no sea area and is closed",)
    assert sum(cluster.share for cluster in found.clusters) == pytest.approx(1.0)


@pytest.mark.parametrize("shade", ["black", "white"])
def test_corners_of_a_turned_raster_are_coast(shade):
    turned = Image.fromarray(paint(BLUE)).convert("RGBA").rotate(17, expand=True)
    flat = Image.new("RGBA", turned.size, shade)
    flat.paste(turned, mask=turned.getchannel("A"))
    corners = np.asarray(turned)[..., 3] == 0
    found = classify_picture(np.asarray(flat.convert("RGB")))
    assert not found.doubts
    assert (found.passability[corners] == 0.0).all()
    assert f"the {shade} frame" in found.notes[0]


def test_see_through_pixels_are_no_cluster(tmp_path):
    picture, cut = np.dstack([paint(BLUE), np.full((SIZE, SIZE), 255, np.uint8)]), SIZE // 5
    picture[:cut, :, 3] = 0
    Image.fromarray(picture).save(tmp_path / "cut.png")
    found = classify_file(tmp_path / "cut.png")
    assert (found.passability[:cut] == 0.0).all()
    assert min(shares_right(found.passability[cut:], KINDS[cut:]).values()) > 0.98
    assert "#ffffff" not in found.listed()
    assert found.notes[0].startswith("what is see-through or no data, 20.0% of the picture")
    picture[..., 3] = 0
    Image.fromarray(picture).save(tmp_path / "nothing.png")
    with pytest.raises(ChartError, match=r"nothing\.png: .*nothing but no data"):
        Chart.from_image(tmp_path / "nothing.png")


def test_white_water_is_no_frame():
    white = STYLES["white deep water"]
    open_sea = np.full((300, 300, 3), 255, np.uint8)
    open_sea[100:200, 100:220] = white.land
    found = classify_picture(open_sea, colours=ChartColours(water=("white",), land=white.named["land"]))
    assert (found.passability[:90] == 1.0).all()
    assert any("white along all four sides" in line for line in found.warnings)
    margin, _ = framed(paint(white), 255)
    assert any("white along all four sides" in doubt for doubt in classify_picture(margin).doubts)


# Colours


def test_colours_by_name_and_number():
    assert as_hex("LightBlue") == "#add8e6"
    assert as_hex(" #fff ") == "#ffffff"
    assert as_hex("rgb(1, 2, 3)") == "#010203"
    assert lab_of(("white",))[0] == pytest.approx([100.0, 0.0, 0.0], abs=0.05)
    given = ChartColours(water=("white", "#FFFFFF"), land=("tan",))
    assert given == ChartColours(water=("#ffffff",), land=("#d2b48c",))
    assert given.complete
    assert not ChartColours()
    with pytest.raises(ValueError, match=r"'blu' is no colour: .*did you mean 'blue'"):
        ChartColours(water=("blu",))
    with pytest.raises(ValueError, match="#ffffff is given for water and for land"):
        ChartColours(water=("white",), land=("#fff",))


def test_rgb_of_lab_is_the_inverse_of_lab_of_rgb():
    rgb = np.random.default_rng(0).integers(0, 256, (500, 3)).astype(np.uint8)
    assert np.abs(to_rgb(to_lab(rgb)).astype(int) - rgb).max() <= 1
    assert to_hex(np.array([300.0, -4.0, 127.6])) == "#ff0080"
