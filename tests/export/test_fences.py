"""Fences cover all land near the paths, touch no path and have few corners."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

from auvplan.export import Circle, Fence, Polygon
from auvplan.export.fences import CORNERS, MOST, fences_around
from auvplan.ocean.chart import Chart

ORIGIN = (-400.0, 250.0)


def chart(water: np.ndarray, pixel: float = 10.0) -> Chart:
    return Chart.from_mask(water, pixel, ORIGIN)


def line(*points: tuple[float, float]) -> np.ndarray:
    """[n, 3] m at 20 m, by north and east."""
    return np.array([(*point, 20.0) for point in points])


def shape(fence: Fence):
    if isinstance(fence, Circle):
        return shapely.Point(fence.centre[::-1]).buffer(fence.radius * 1.0005, quad_segs=64)
    return shapely.Polygon(fence.corners[:, ::-1])


def uncovered(fences: list[Fence], water: np.ndarray, *lines: np.ndarray, pixel: float = 10.0) -> float:
    """m2 of land outside all fences, by its pixels' squares, within a kilometre of the box of the lines."""
    i, j = np.nonzero(~water)
    low = np.array(ORIGIN)[::-1] + pixel * np.stack([j, i], axis=1)
    land = shapely.union_all(shapely.box(*low.T, *(low + pixel).T))
    low, high = (f(np.concatenate(lines)[:, 1::-1], axis=0) for f in (np.min, np.max))
    near = land.intersection(shapely.box(*(low - 1000.0), *(high + 1000.0)))
    return near.difference(shapely.union_all([shape(fence) for fence in fences])).area


def check(fences: list[Fence], water: np.ndarray, *lines: np.ndarray) -> None:
    shapes = [shape(fence) for fence in fences]
    assert all(piece.is_valid for piece in shapes)
    assert uncovered(fences, water, *lines) < 1e-3
    for path in lines:
        assert not any(piece.intersects(shapely.LineString(path[:, 1::-1])) for piece in shapes)


def test_an_island_is_covered_by_few_corners():
    i, j = np.indices((200, 260))
    water = np.hypot((i - 110) / 40.0, (j - 90) / 65.0) > 1.0
    path = line((0.0, 500.0), (1500.0, 450.0), (1350.0, 2600.0))
    fences, notes = fences_around([path], chart(water))
    assert notes == []
    (fence,) = fences
    assert isinstance(fence, Polygon)
    assert 3 <= len(fence.corners) <= 16
    check(fences, water, path)
    assert shape(fence).area < 1.25 * 100.0 * (~water).sum()
    assert not shapely.is_ccw(shapely.LinearRing(fence.corners[:, ::-1]))  # on the map, east to the right


def test_a_path_through_a_narrow_bent_channel_stays_outside():
    water = np.zeros((120, 120), bool)
    water[20:23, 10:90] = True
    water[20:110, 87:90] = True
    north, east = np.array(ORIGIN) + 10.0
    path = line((north + 205.0, east + 120.0), (north + 205.0, east + 877.0), (north + 1000.0, east + 877.0))
    fences, notes = fences_around([path], chart(water))
    assert notes == []
    check(fences, water, path)


def test_a_lake_is_filled_unless_a_path_is_in_it():
    i, j = np.indices((150, 150))
    radius = np.hypot(i - 75, j - 75)
    water = (radius > 60) | (radius < 35)
    outside = line((-350.0, 300.0), (-340.0, 1700.0), (700.0, 1750.0))
    inside = line((250.0, 900.0), (400.0, 1050.0))
    (filled,), _ = fences_around([outside], chart(water))
    check([filled], water, outside)
    assert shape(filled).contains(shapely.Point(1000.0, 350.0))
    halves, _ = fences_around([outside, inside], chart(water))
    assert len(halves) == 2
    check(halves, water, outside, inside)


def test_islets_become_circles_and_far_land_is_left_out():
    water = np.ones((400, 400), bool)
    water[60:64, 70:75] = False
    water[390:, 390:] = False
    path = line((0.0, 400.0), (500.0, 400.0))  # due north: its box has no width
    (islet,), notes = fences_around([path], chart(water))
    assert notes == []
    assert isinstance(islet, Circle)
    assert islet.centre == pytest.approx((-400.0 + 620.0, 250.0 + 725.0))
    assert islet.radius == pytest.approx(np.hypot(20.0, 25.0), rel=1e-6)


def test_very_many_islets_become_at_most_a_hundred_fences():
    rng = np.random.default_rng(3)
    water = rng.uniform(size=(300, 300)) > 0.01
    water[140:150] = True
    path = line((1045.0, 300.0), (1052.0, 3200.0))
    fences, notes = fences_around([path], chart(water))
    assert len(fences) <= MOST
    assert notes == []
    check(fences, water, path)


def test_a_path_on_land_has_a_lane_and_is_told_of():
    water = np.ones((200, 200), bool)
    water[80:120, 60:140] = False
    path = line((600.0, 300.0), (604.0, 2200.0))
    fences, notes = fences_around([path], chart(water))
    assert "crosses land" in notes[0]
    assert len(fences) == 2
    assert not any(shape(fence).intersects(shapely.LineString(path[:, 1::-1])) for fence in fences)
    assert 800.0 < uncovered(fences, water, path) < 800.0 * 2.01


def test_obstacles_that_stand_still_are_circles_unless_a_path_passes_over_them():
    path = line((100.0, 0.0), (120.0, 3000.0))
    near, below, away = (310.0, 900.0, 35.0), (125.0, 2000.0, 90.0), (1e6, 1e6, 0.0)
    fences, notes = fences_around(
        [path], None, [(near, 80.0, "rock"), (below, 40.0, "wreck"), (away, 60.0, "buoy")]
    )
    assert fences == [Circle((310.0, 900.0), 80.0, "rock")]
    (note,) = notes
    assert "(125, 2000, 90) m, radius 40 m" in note


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.floats(1.0, 6.0))
def test_any_coast_is_covered_and_no_path_is(seed: int, smooth: float):
    rng = np.random.default_rng(seed)
    field = ndimage.gaussian_filter(rng.normal(size=(60, 70)), smooth)
    water = field < np.quantile(field, 0.7)
    # A path from water to water along pixels' centres, by steps north, south, east and west.
    label, _ = ndimage.label(water)
    cells = np.argwhere(label == np.argmax(np.bincount(label[label > 0])))
    target, here = cells[-1], tuple(cells[0])
    route = [here]
    for _ in range(60):
        steps = [(here[0] + a, here[1] + b) for a, b in ((1, 0), (0, 1), (0, -1), (-1, 0))]
        steps = [s for s in steps if s not in route and 0 <= s[0] < 60 and 0 <= s[1] < 70 and water[s]]
        if not steps:
            break
        here = min(steps, key=lambda s: np.hypot(*(np.asarray(s) - target)))
        route.append(here)
    route = [*route, route[-1]] if len(route) == 1 else route
    places = np.array(ORIGIN) + 10.0 * np.asarray(route) + np.array([5.5, 4.5])
    path = np.column_stack([places, np.full(len(places), 10.0)])
    fences, _ = fences_around([path], chart(water))
    check(fences, water, path)
    corners = [len(fence.corners) for fence in fences if isinstance(fence, Polygon)]
    assert max(corners, default=0) <= 4 * CORNERS
