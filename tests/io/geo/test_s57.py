"""S-57 cells: what they close, what stands in their water, and how faults are told."""

import re
import sys
import warnings
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from auvplan.errors import ScenarioWarning
from auvplan.io.geo.charts import Land
from auvplan.io.geo.grid import Extent
from auvplan.io.geo.s57 import read_cells
from auvplan.ocean.chart import ChartError
from auvplan.ocean.seabed import Seabed
from auvplan.site import Site
from tests.io.geo import enc_cells
from tests.io.geo.enc_cells import Object, write_cell
from tests.io.refusals import refusal

pytest.importorskip("pyogrio")

SITE = Site(10.05, 50.05)
BOX: dict[str, Any] = {"lower": (-4000.0, -3000.0), "upper": (4000.0, 3000.0)}
SEA = shapely.box(10.0, 50.0, 10.1, 50.1)
ISLE = shapely.Polygon([(10.02, 50.02), (10.04, 50.025), (10.035, 50.045), (10.022, 50.04)])
SHALLOWS = shapely.box(10.012, 50.012, 10.05, 50.055)
SLOPE = shapely.box(10.012, 50.055, 10.05, 50.065)


def bay(*more: Object) -> list[Object]:
    """An isle in shallow water, in a sea of 10 to 20 m, with a shelf of 5 to 10 m."""
    return [
        Object("M_COVR", SEA, {"CATCOV": 1}),
        Object("LNDARE", ISLE, {"OBJNAM": "Isle"}),
        Object("DEPARE", SHALLOWS - ISLE, {"DRVAL1": 0, "DRVAL2": 5}),
        Object("DEPARE", SLOPE, {"DRVAL1": 5, "DRVAL2": 10}),
        Object("DEPARE", SEA - SHALLOWS - SLOPE, {"DRVAL1": 10, "DRVAL2": 20}),
        *more,
    ]


def read(path: Path, **options) -> Land:
    given = {"deepest": 15.0, "pixel_size": 25.0} | BOX | options
    extent = {name: given.pop(name) for name in Extent._fields if name in given}
    return read_cells(path, SITE, Extent(**extent), **given)


def is_water(cells: Land, longitude: float, latitude: float) -> bool:
    return bool(cells.chart.is_water(*SITE.to_local(longitude, latitude)))


@pytest.mark.parametrize("depth", [0.0, 5.0, 7.5])
def test_land_and_water_shallower_than_the_safety_depth_are_closed(tmp_path, depth):
    foul, forbidden = shapely.box(10.075, 50.05, 10.08, 50.055), shapely.box(10.06, 50.05, 10.07, 50.06)
    more = Object("OBSTRN", foul, {"VALSOU": 12.0, "WATLEV": 3}), Object("RESARE", forbidden, {"RESTRN": "7"})
    found = read(write_cell(tmp_path / "A.000", bay(*more)), safety_depth=depth)
    shut = shapely.union_all([ISLE, foul, forbidden, *[SHALLOWS] * (depth > 0.0), *[SLOPE] * (depth > 5.0)])
    rng = np.random.default_rng(1)
    north, east = rng.uniform(-3990.0, 3990.0, 4000), rng.uniform(-2990.0, 2990.0, 4000)
    longitude, latitude = SITE.to_geographic(north, east)
    inside = shapely.contains_xy(shut, longitude, latitude)
    # A pixel is closed that anything closed reaches into: near an edge water may be closed, never land open.
    away = shapely.distance(shapely.points(longitude, latitude), shut.boundary) > 0.0006
    water = found.chart.is_water(north, east)
    assert not water[inside].any()
    assert water[~inside & away].all()
    assert found.chart.shares()["coast"] < 0.5
    assert found.land.is_water(*SITE.to_local(10.065, 50.055))


def test_what_is_unsurveyed_unknown_or_left_out_is_closed(tmp_path):
    sides = ((50.03, 50.04), (50.05, 50.06), (50.07, 50.075))
    unsurveyed, unknown, gap = (shapely.box(10.06, south, 10.07, north) for south, north in sides)
    parts = [part for part in bay() if part.attributes.get("DRVAL1") != 10]
    sea = Object("DEPARE", SEA - SHALLOWS - SLOPE - unsurveyed - unknown - gap, {"DRVAL1": 10})
    more = Object("UNSARE", unsurveyed), Object("DEPARE", unknown)
    found = read(write_cell(tmp_path / "A.000", [*parts, sea, *more]))
    for shape in (unsurveyed, unknown, gap):
        assert not is_water(found, shape.centroid.x, shape.centroid.y)
    assert is_water(found, 10.065, 50.045)
    assert any("neither land nor a depth area" in note for note in found.notes)
    assert any("1 depth area of unknown depth" in note for note in found.notes)


@pytest.mark.parametrize(
    ("kind", "stated", "top"),
    [
        ("UWTROC", {"VALSOU": 2.5, "WATLEV": 3}, 2.5),
        ("UWTROC", {"WATLEV": 3}, 0.0),
        ("UWTROC", {"VALSOU": -0.6, "WATLEV": 4}, 0.0),
        ("UWTROC", {"VALSOU": 1.2, "WATLEV": 5}, 0.0),
        ("WRECKS", {"CATWRK": 2, "VALSOU": 8.1}, 8.1),
        ("WRECKS", {"CATWRK": 4, "VALSOU": 8.1}, 0.0),
        ("OBSTRN", {"VALSOU": 19.9}, 19.9),
        ("OBSTRN", {"VALSOU": 20.1}, None),
        ("PILPNT", {}, 0.0),
    ],
)
def test_points_are_obstacles_from_their_depth_down(tmp_path, kind, stated, top):
    path = write_cell(tmp_path / "A.000", bay(Object(kind, shapely.Point(10.07, 50.06), stated)))
    found = read(path, hazard_radius=40.0)
    if top is None:
        assert found.hazards == ()
        return
    (one,) = found.hazards
    assert one.depth_min == pytest.approx(top)
    assert one.depth_max == np.inf
    assert one.radius == 40.0
    assert one.position == pytest.approx(np.ravel(SITE.to_local(10.07, 50.06)), abs=0.02)
    assert is_water(found, 10.07, 50.06)


@pytest.mark.parametrize(("stated", "low", "top"), [
    ({"VALSOU": 6.0}, -4.0, 2.0),
    ({"VALSOU": 6.0}, 1.5, 7.5),
    ({"VALSOU": 3.0}, -4.0, 0.0),
    ({"VALSOU": 20.1}, -0.5, 19.6),  # at its datum it is too deep to count
    ({}, 2.0, 0.0),
    ({"VALSOU": 1.2, "WATLEV": 5}, 2.0, 0.0),
])  # fmt: skip
def test_what_stands_in_the_water_is_as_deep_as_at_low_water(tmp_path, stated, low, top):
    foul = Object("OBSTRN", shapely.box(10.075, 50.05, 10.08, 50.055), stated)
    path = write_cell(tmp_path / "A.000", bay(Object("UWTROC", shapely.Point(10.07, 50.06), stated), foul))
    found = read(path, low_water=low)
    assert [one.depth_min for one in found.hazards] == pytest.approx([top])
    assert not is_water(found, 10.0775, 50.0525)


def test_obstacles_on_land_or_beyond_the_area_are_left_out(tmp_path):
    places = (10.03, 50.03), (10.001, 50.001), (10.07, 50.06)
    rocks = [Object("UWTROC", shapely.Point(place), {"WATLEV": 3}) for place in places]
    found = read(write_cell(tmp_path / "A.000", bay(*rocks)))
    assert [one.name for one in found.hazards] == ["rock 8"]


def test_lines_and_areas_of_hazards_are_closed_as_far_down_as_the_vehicle_goes(tmp_path):
    wall = Object("OBSTRN", shapely.LineString([(10.06, 50.03), (10.07, 50.03)]), {"WATLEV": 3})
    farm = Object("MARCUL", shapely.box(10.06, 50.05, 10.065, 50.055))
    foul = Object("OBSTRN", shapely.box(10.075, 50.05, 10.08, 50.055), {"VALSOU": 18.0, "WATLEV": 3})
    path = write_cell(tmp_path / "A.000", bay(wall, farm, foul))
    found = read(path)
    assert found.hazards == ()
    for place in ((10.065, 50.0303), (10.0625, 50.0525), (10.0775, 50.0525)):
        assert not is_water(found, *place)
    assert is_water(found, 10.065, 50.032)
    assert is_water(read(path, deepest=12.0), 10.0775, 50.0525)


def test_a_point_of_land_is_closed_with_its_surroundings(tmp_path):
    found = read(write_cell(tmp_path / "A.000", bay(Object("LNDARE", shapely.Point(10.07, 50.06)))))
    north, east = (float(axis) for axis in SITE.to_local(10.07, 50.06))
    assert not found.land.is_water(north + 45.0, east)
    assert found.land.is_water(north + 65.0, east)


@pytest.mark.parametrize(
    ("codes", "closed"), [("7", True), ("3,14", True), ("1,2,3", False), ("8", False), ("17", False)]
)
def test_areas_are_closed_whose_entry_is_prohibited_or_to_be_avoided(tmp_path, codes, closed):
    area = Object("RESARE", shapely.box(10.06, 50.05, 10.07, 50.06), {"RESTRN": codes, "OBJNAM": "Range"})
    found = read(write_cell(tmp_path / "A.000", bay(area)))
    assert is_water(found, 10.065, 50.055) is not closed
    assert [zone.name for zone in found.closed] == ["Range"] * closed
    assert found.land.is_water(*SITE.to_local(10.065, 50.055))
    assert any("RESTRN 8" in note for note in found.notes) == (codes == "8")


def test_the_area_must_lie_in_the_cells_coverage(tmp_path):
    path = write_cell(tmp_path / "A.000", bay())
    words = r"beyond what the cells cover \(M_COVR\) with 4\.4% of it, between -6000 and -5560 m north"
    refusal(ChartError, words, read, path, lower=(-6000.0, -3000.0))
    words = r"wholly beyond the cells, which cover longitudes 10\.00 to 10\.10"
    refusal(ChartError, words, read, path, lower=(40_000.0, 0.0), upper=(41_000.0, 1000.0))
    turned = Site(50.05, 10.05)
    refusal(ChartError, "swapped it would fit", read_cells, path, turned, Extent(**BOX), deepest=15.0)
    hole = shapely.box(10.06, 50.05, 10.061, 50.051)
    objects = [Object("M_COVR", SEA - hole, {"CATCOV": 1}), Object("M_COVR", hole, {"CATCOV": 2}), *bay()[1:]]
    holed = write_cell(tmp_path / "B.000", objects)
    refusal(ChartError, r"with 0\.0% of it|with 0\.2% of it", read, holed)


def test_cells_side_by_side_cover_together(tmp_path):
    middle = 10.0567891
    for name, (west, east) in (("W", (10.0, middle)), ("E", (middle, 10.1))):
        (tmp_path / name).mkdir()
        half = [(one, one.shape & shapely.box(west, 50.0, east, 50.1)) for one in bay()]
        objects = [Object(one.kind, part, one.attributes) for one, part in half if part.area > 0.0]
        write_cell(tmp_path / name / f"{name}.000", objects)
    whole = read(write_cell(tmp_path / "whole.000", bay()))
    (tmp_path / "whole.000").unlink()
    both = read(tmp_path)
    assert np.array_equal(both.chart.passability, whole.chart.passability)


def test_the_cell_of_the_largest_scale_is_used(tmp_path):
    inner = shapely.box(10.03, 50.03, 10.07, 50.07)
    objects = [Object("M_COVR", inner, {"CATCOV": 1}), Object("DEPARE", inner, {"DRVAL1": 30})]
    write_cell(tmp_path / "fine.000", objects, scale=10_000)
    rock = Object("UWTROC", shapely.Point(10.06, 50.06), {"WATLEV": 3})
    write_cell(tmp_path / "coarse.000", bay(rock), scale=90_000)
    found = read(tmp_path)
    assert is_water(found, 10.033, 50.035)
    assert not is_water(found, 10.025, 50.03)
    assert found.hazards == ()
    assert [note for note in found.notes if "1:" in note] == [
        "fine.000: edition 1, update 0 of 2026-01-01, 1:10000",
        "coarse.000: edition 1, update 0 of 2026-01-01, 1:90000",
    ]


def wreck(number):
    return Object("WRECKS", shapely.Point(10.06 + 0.001 * (number % 100), 50.06), number=number)


ROCK, NO_ROCK = (
    Object("UWTROC", shapely.Point(10.06, 50.06), {"WATLEV": 3}, 30),
    Object("UWTROC", None, number=30),
)


def cell(*more, **options):
    return {"objects": bay(*more), **options}


def update(number, *objects, **options):
    return {"objects": objects, "update": number, "first": 100 + 100 * number, **options}


APPLIED = {"A.000": cell(ROCK), "A.001": update(1, NO_ROCK, wreck(131))}
#: Files of a folder, the hazards that are read, the update that is noted, and what is warned of.
UPDATES = {
    "applied": (APPLIED, [131], "edition 1, update 1", None),
    "one is missing": ({**APPLIED, "A.003": update(3)}, [131], "edition 1, update 1",
                       r"A\.000: A\.003 is not applied: it is update 3 of edition 1, and update 2 of"),
    "of another edition": ({"A.000": cell(edition=2), "A.001": update(1, wreck(131))}, [],
                           "edition 2, update 0", "is update 1 of edition 1, and update 1 of edition 2 is"),
    "of its edition": ({"A.000": cell(edition=2), "A.001": update(1, wreck(131), edition=2)}, [131],
                       "edition 2, update 1", None),
    "issued again": ({"A.000": cell(wreck(131), reissued=2), "A.001": update(1, wreck(131)),
                      "A.003": update(3, wreck(132))}, [131, 132], "edition 1, update 3", None),
    "in folders": ({"0/A.000": cell(), "1/A.001": update(1, wreck(131)), "2/A.002": update(2, wreck(132))},
                   [131, 132], "edition 1, update 2", None),
    "an older cell": ({"old/A.000": cell(wreck(131)), "new/A.000": cell(wreck(132), edition=2)}, [132],
                      "edition 2, update 0", r"old/A\.000: is left out for .*new/A\.000, which is edition 2"),
    "cancelled": ({"A.000": cell(wreck(131)), "A.001": update(1, edition=0)}, None, "",
                  r"A\.000: is left out: A\.001 cancels it"),
}  # fmt: skip


@pytest.mark.parametrize("case", UPDATES)
def test_updates_and_editions(tmp_path, case):
    files, hazards, noted, warned = UPDATES[case]
    for name, options in files.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_cell(tmp_path / name, **options)
    with pytest.warns(ScenarioWarning, match=warned) if warned else nullcontext():
        if hazards is None:
            words = "is cancelled by an update: get the cell that replaces it"
            refusal(ChartError, words, read, tmp_path)
            return
        found = read(tmp_path)
    assert [one.name for one in found.hazards] == [f"wreck {number}" for number in hazards]
    assert found.notes[0] == f"A.000: {noted} of 2026-01-01, 1:25000"


def test_attributes_that_a_class_does_not_have_are_no_fault(tmp_path, monkeypatch):
    monkeypatch.setitem(enc_cells._ATTRIBUTES, "UNKNOWN", 40_000)
    rock = Object("UWTROC", shapely.Point(10.06, 50.06), {"UNKNOWN": 3, "CATCOV": 1, "VALSOU": 4})
    (one,) = read(write_cell(tmp_path / "A.000", bay(rock))).hazards
    assert one.depth_min == 4.0


def _hit(path: Path) -> None:
    data = bytearray(write_cell(path, bay()).read_bytes())
    data[1500:1520] = bytes(20)
    path.write_bytes(bytes(data))


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.write_bytes(b"no cell at all, but a text of more than twenty-four bytes"),
         "A.000: is no S-57 cell"),
        (lambda path: path.write_bytes(write_cell(path, bay()).read_bytes()[:-7]),
         "A.000: cannot be read (Data record is short on DDF file.)"),
        (_hit, "A.000: cannot be read (ISO8211 record leader appears to be corrupt.)"),
        (lambda path: write_cell(path, bay()[1:]), "A.000: has no coverage (M_COVR)"),
        (lambda path: write_cell(path, bay(), datum=3),
         "A.000: its positions are not on WGS 84 (DSPM_HDAT is 3)"),
        (lambda path: write_cell(path, bay(), units=2),
         "A.000: its depths are not in metres (DSPM_DUNI is 2)"),
        (lambda path: None, "A.000: no such file or folder"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_cell_is_one_line(tmp_path, spoil, said):
    spoil(tmp_path / "A.000")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        refusal(ChartError, re.escape(said), read, tmp_path / "A.000")


def test_what_is_no_cell_by_its_name_is_refused(tmp_path):
    refusal(ChartError, "holds no S-57 cell", read, tmp_path)
    (tmp_path / "A.001").write_bytes(b"x")
    refusal(ChartError, r"ends in \.000", read, tmp_path / "A.001")


def test_without_the_library_it_says_which_extra_is_missing(tmp_path, monkeypatch):
    path = write_cell(tmp_path / "A.000", bay())
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    refusal(ChartError, r"auvplan\[readers\]", read, path)


def test_the_depth_areas_are_a_sea_bed_that_is_nowhere_too_deep(tmp_path):
    path = write_cell(tmp_path / "A.000", bay(Object("UNSARE", shapely.box(10.08, 50.04, 10.09, 50.05))))
    found = read(path)
    bed = Seabed.from_depth(found.depth, 25.0, np.asarray(found.chart.origin), clearance=0.0)
    rng = np.random.default_rng(3)
    north, east = rng.uniform(-3990.0, 3990.0, 6000), rng.uniform(-2990.0, 2990.0, 6000)
    places = SITE.to_geographic(north, east)
    least = np.full(6000, 10.0)
    for shape, depth in ((SLOPE, 5.0), (SHALLOWS, 0.0), (shapely.box(10.08, 50.04, 10.09, 50.05), 0.0)):
        least[shapely.contains_xy(shape, *places)] = depth
    depth = np.asarray(bed.depth_at(north, east))
    assert (depth <= least + 1e-4).all()
    assert np.mean(depth < least - 1e-4) < 0.03  # about the edges
