"""Thinning: closed forms in still water, an independent twin in a current, and clearance."""

from itertools import combinations, pairwise

import jax.numpy as jnp
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from auvplan.export import thin
from auvplan.ocean.chart import Chart
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.seabed import Seabed
from auvplan.path.straight import Cut, Straights
from auvplan.vehicle import Vehicle
from tests.io.sample_run import make_vortices

VEHICLE = Vehicle(speed=2.0)
BOX = {"lower": (-1e5, -1e5, 0.0), "upper": (1e5, 1e5, 200.0)}


def still(**world) -> Environment:
    return Environment(None, **world, **BOX)  # type: ignore[arg-type]


def arc(angle: float, samples: int, radius: float = 1500.0) -> np.ndarray:
    """[samples, 3] m on a part of a circle, at 35 m."""
    turn = np.linspace(0.2, 0.2 + angle, samples)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(samples, 35.0)], axis=1)


def even_times(positions: np.ndarray, start: float = 0.0) -> np.ndarray:
    gaps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    return start + np.concatenate([[0.0], np.cumsum(gaps / 2.0)])


def test_straight_line_needs_its_ends_alone():
    line = np.array([120.0, -340.0, 5.0]) + np.linspace(0, 1, 40)[:, None] * np.array([-900.0, 2500.0, 80.0])
    few = thin(line, even_times(line, 77.0), still(), VEHICLE)
    assert few.indices.tolist() == [0, 39]
    assert few.times == pytest.approx([77.0, 77.0 + np.linalg.norm(line[-1] - line[0]) / 2.0], rel=1e-5)
    assert few.time_change == pytest.approx(0.0, abs=1e-5)
    assert few.clearance == np.inf


def test_a_leg_that_leads_nowhere_needs_its_ends_alone():
    """From one task to another in the same place; times are rounded."""
    here = np.full((64, 3), [-1138.0054, 1112.9994, 10.0], np.float32)
    few = thin(here, 1500.0 + np.linspace(0.0, 1.0, 64), Environment(make_vortices(), **BOX), VEHICLE)
    assert few.indices.tolist() == [0, 63]
    assert few.time_change == 0.0


@pytest.mark.parametrize(("angle", "tolerance"), [(np.pi, 0.02), (1.5, 0.02), (np.pi, 0.1), (4.0, 0.005)])
def test_arc_takes_as_many_chords_as_geometry_says(angle: float, tolerance: float):
    samples = 91
    path = arc(angle, samples)
    few = thin(path, even_times(path), still(), VEHICLE, tolerance=tolerance)
    # A chord over an angle a is shorter than its arc by the share 1 - sin(a/2) / (a/2).
    share = [1.0 - np.sinc(angle / (2.0 * k) / np.pi) for k in range(1, 60)]
    chords = 1 + int(np.argmax(np.asarray(share) < tolerance))
    assert len(few.indices) - 1 == chords
    assert few.time_change == pytest.approx(-share[chords - 1], rel=0.02)
    # The least sum of changes has chords of one length.
    assert np.ptp(np.diff(few.indices)) <= 1


def rowed(places: np.ndarray, current, depart: float, steps: int = 400) -> float:
    """Arrival along straight lines in a current (x, y, z, t) -> (u, v, w), step by step in plain NumPy."""
    now = depart
    for first, last in pairwise(places):
        way = (last - first) / steps
        gap = np.linalg.norm(way)
        for k in range(steps):
            x, y, z = first + (k + 0.5) * way
            # The middle of a step is reached when half of it is done at the speed of its beginning.
            water = np.asarray(current(x, y, z, now + 0.25 * gap))
            along = water @ way / gap
            across = np.sqrt(max(water @ water - along**2, 0.0))
            now += gap / (along + np.sqrt(4.0 - across**2))
    return now


def test_lines_of_any_length_are_looked_at_in_blocks_that_change_nothing(monkeypatch):
    path = arc(4.0, 30)
    i, j = np.triu_indices(30, 1)
    lines = path[i], path[j], 70.0 * i, 70.0 * (j - i)
    sea = Straights.through(Environment(make_vortices(), **BOX), VEHICLE)
    whole, sizes, cut = sea.pass_lines(*lines), [], Cut.of
    monkeypatch.setattr("auvplan.path.straight._AT_ONCE", 1000)
    monkeypatch.setattr(Cut, "of", lambda *ends: sizes.append(cut(*ends)) or sizes[-1])
    for once, again in zip(whole, sea.pass_lines(*lines), strict=True):
        np.testing.assert_array_equal(once, again)
    counts = [len(block.line) for block in sizes]
    assert sum(counts) == len(cut(*lines[:2]).line)
    assert max(counts) < 1000 + 3000 / 20 + 1 < sum(counts) / 10


def test_times_and_choice_agree_with_a_naive_search_in_a_tide():
    def tide(x, y, z, t, xp=np):
        u = 0.5 * xp.sin(y / 700.0) + 0.3 * xp.cos(t / 900.0)
        return u, 0.4 * xp.cos((x - 0.3 * t) / 900.0) - 0.002 * z, 0.0 * t

    env = Environment(lambda x, y, z, t: tide(x, y, z, t, jnp), **BOX)  # type: ignore[arg-type]
    path = arc(1.6, 9, 1400.0) + np.array([40.0, -250.0, 0.0]) * np.linspace(0, 1, 9)[:, None] ** 2
    whole = rowed(path, tide, 500.0)
    few = thin(path, even_times(path, 500.0), env, VEHICLE, tolerance=0.01)
    assert few.times[-1] == pytest.approx(rowed(path[few.indices], tide, 500.0), abs=0.5)
    assert few.time_change == pytest.approx((few.times[-1] - 500.0) / (whole - 500.0) - 1.0, abs=5e-4)
    assert abs(few.time_change) < 0.01

    passed = prefix(path, tide)
    pairs = combinations(range(len(path)), 2)
    lines = {(i, j): abs(rowed(path[[i, j]], tide, passed[i]) - passed[j]) for i, j in pairs}
    inner = range(1, len(path) - 1)
    for k in range(1, len(few.indices)):
        chains = [(0, *chosen, len(path) - 1) for chosen in combinations(inner, k - 1)]
        best = min(chains, key=lambda chain: sum(lines[pair] for pair in pairwise(chain)))
        change = (rowed(path[list(best)], tide, 500.0) - 500.0) / (whole - 500.0) - 1.0
        if k < len(few.indices) - 1:
            assert abs(change) > 0.0099
        else:
            assert few.indices.tolist() == list(best)


def prefix(path: np.ndarray, current) -> list[float]:
    """Arrival at every sample."""
    return [rowed(path[: k + 1], current, 500.0, 100) if k else 500.0 for k in range(len(path))]


def test_lines_stay_clear_of_land_and_of_moving_obstacles():
    # A bight around a headland that the chord would cut, and a rock that the way between would meet.
    water = np.ones((300, 300), bool)
    water[100:150, 70:210] = False
    chart = Chart.from_mask(water, 10.0)
    share = np.linspace(0.0, 1.0, 64)
    path = np.stack(
        [1200.0 + 900.0 * np.sin(np.pi * share) ** 0.5, 300.0 + 2300.0 * share, 20.0 + 5.0 * share], axis=1
    )
    times = even_times(path, 1000.0)
    met = path[40] + np.array([130.0, 20.0, 3.0])
    rock = Obstacles.create(met[None], 60.0, velocity=[[0.2, -0.1, 0.0]], observed_at=float(times[40]))
    env = still(chart=chart, obstacles=rock)
    few = thin(path, times, env, VEHICLE, tolerance=0.5, margin=25.0)
    assert 2 < len(few.indices) < 20
    assert few.clearance >= 25.0 - 0.1
    fine = np.linspace(few.times[0], few.times[-1], 4000)
    places = np.stack([np.interp(fine, few.times, few.positions[:, k]) for k in range(3)], axis=1)
    land = np.argwhere(~water) * 10.0 + 5.0
    gap = np.linalg.norm(places[::10, None, :2] - land[None], axis=2).min() - 5.0 * np.sqrt(2.0)
    assert gap > 25.0 - 5.0  # the centres are up to a pixel's half from its edge
    away = met + np.array([0.2, -0.1, 0.0]) * (fine - times[40])[:, None]
    assert np.linalg.norm(places - away, axis=1).min() - 60.0 >= 25.0 - 0.5
    # Without a margin lines may go nearer than that, and are fewer or as many.
    near = thin(path, times, env, VEHICLE, tolerance=0.5, margin=1.0)
    assert len(near.indices) <= len(few.indices)
    assert near.clearance >= 1.0 - 0.1


def test_a_path_nearer_than_the_margin_may_stay_as_near():
    water = np.ones((200, 200), bool)
    water[:, 120:] = False
    line = np.stack([np.linspace(200, 1800, 30), np.full(30, 1175.0), np.full(30, 9.0)], axis=1)
    few = thin(line, even_times(line), still(chart=Chart.from_mask(water, 10.0)), VEHICLE, margin=50.0)
    assert few.indices.tolist() == [0, 29]
    assert 10.0 < few.clearance < 25.0


def round_both() -> tuple[np.ndarray, Environment]:
    """A path [S, 3] m that passes an island and a rock, both round and of 100 m, in arcs 160 m off them."""
    turn = np.linspace(0.0, np.pi, 31)
    bend, run = 260.0 * np.sin(turn), -260.0 * np.cos(turn)
    first, second = (np.stack([1000.0 + bend, 500.0 + run]), np.stack([1000.0 - bend, 2500.0 + run]))
    level = np.concatenate([first, second], axis=1).T
    north, east = np.meshgrid(*(5.0 + 10.0 * np.arange(count) for count in (200, 300)), indexing="ij")
    water = np.hypot(north - 1000.0, east - 500.0) > 100.0
    rock = Obstacles.create([[1000.0, 2500.0, 20.0]], [100.0])
    world = still(chart=Chart.from_mask(water, 10.0), obstacles=rock)
    return np.concatenate([level, np.full((len(level), 1), 20.0)], axis=1), world


@pytest.mark.parametrize("margin", [(140.0, 20.0), (20.0, 140.0), (140.0, 140.0), (500.0, 500.0)])
def test_coast_and_obstacles_have_each_a_margin_of_their_own(margin: tuple[float, float]):
    path, world = round_both()
    few = thin(path, even_times(path), world, VEHICLE, tolerance=0.5, margin=margin)
    whole, lines = (shapely.LineString(places[:, :2]) for places in (path, few.positions))
    for asked, east, pixels in zip(margin, (500.0, 2500.0), (10.0, 0.0), strict=True):
        kept, own = (line.distance(shapely.Point(1000.0, east)) - 100.0 for line in (lines, whole))
        assert kept > min(asked, own) - pixels - 0.2
        assert (kept < 125.0) == (asked < 125.0)


def test_lines_come_as_near_as_the_path_only_where_it_does():
    """A quay 6 m off its start is no leave to pass a headland, which it rounds at 60 m, as near."""
    north, east = np.meshgrid(*(2.0 * np.arange(2000) - 999.0,) * 2, indexing="ij")
    quay = (north < -3.0) & (np.abs(east) < 200.0)
    headland = (north > 1000.0) & (north < 1400.0) & (east > -600.0) & (east < 0.0)
    corners = np.array([[3.0, -150.0], [1000.0, 60.0], [1400.0, 60.0], [2400.0, -300.0]])
    level = np.stack([np.interp(np.linspace(0.0, 3.0, 61), range(4), axis) for axis in corners.T])
    path = np.concatenate([level, np.full((1, 61), 5.0)]).T
    world = still(chart=Chart.from_mask(~(quay | headland), 2.0, (-1000.0, -1000.0)))
    few = thin(path, even_times(path), world, VEHICLE, margin=(50.0, 10.0))
    land = shapely.box(1000.0, -600.0, 1400.0, 0.0)
    assert shapely.LineString(few.positions[:, :2]).distance(land) > 50.0
    assert few.clearance == pytest.approx(6.0, abs=2.0)


def test_lines_keep_the_altitude_over_a_bank():
    depth = np.full((150, 60), 80.0)
    depth[70:80] = 30.0  # across the way, from 1.4 to 1.6 km
    bed = Seabed.from_depth(depth, 20.0, clearance=6.0)
    env = Environment(None, None, None, (0.0, 0.0, 0.0), (3000.0, 1200.0, 80.0), bed)  # type: ignore[arg-type]
    share = np.linspace(0.0, 1.0, 61)
    north = 100.0 + 2800.0 * share
    path = np.stack(
        [north, np.full(61, 500.0), np.interp(north, [1000, 1300, 1700, 2000], [60, 20, 20, 60])], 1
    )
    free = thin(path, even_times(path), still(), VEHICLE)
    assert free.indices.tolist() == [0, 60]
    few = thin(path, even_times(path), env, VEHICLE)
    assert 2 < len(few.indices) < 12
    fine = np.linspace(few.times[0], few.times[-1], 4000)
    places = np.stack([np.interp(fine, few.times, few.positions[:, k]) for k in range(3)], axis=1)
    assert bed.altitude(places).min() > 6.0 - 0.1
    assert few.clearance == np.inf


def test_a_line_against_too_strong_a_current_is_not_taken():
    def jet(x, y, z, t):
        strength = jnp.exp(-(((x - 100.0) / 120.0) ** 2) - ((y - 1000.0) / 200.0) ** 2)
        return 0.0 * x, -3.0 * strength, 0.0 * x

    env = Environment(jet, **BOX)  # type: ignore[arg-type]
    share = np.linspace(0.0, 1.0, 60)
    path = np.stack([700.0 * np.sin(np.pi * share) ** 0.5 + 100.0, 2000.0 * share, 10.0 + 0 * share], axis=1)
    few = thin(path, even_times(path), env, VEHICLE, tolerance=10.0)
    assert len(few.indices) > 2


@settings(max_examples=15, deadline=None)
@given(st.integers(2, 24), st.integers(0, 1000), st.floats(0.001, 0.2))
def test_what_is_kept_is_part_of_the_path(samples: int, seed: int, tolerance: float):
    steps = np.random.default_rng(seed).normal([60.0, 20.0, 0.0], [30.0, 60.0, 2.0], (samples, 3))
    path = np.cumsum(steps, axis=0) + np.array([0.0, 0.0, 60.0])
    few = thin(path, even_times(path), still(), VEHICLE, tolerance=tolerance)
    assert few.indices[0] == 0
    assert few.indices[-1] == samples - 1
    assert (np.diff(few.indices) > 0).all()
    assert (few.positions == path[few.indices]).all()
    assert abs(few.time_change) < tolerance
    straight = even_times(few.positions)
    assert few.times == pytest.approx(straight, abs=0.05)


@pytest.mark.parametrize("shapes", [((5, 2), (5,)), ((1, 3), (1,)), ((5, 3), (4,)), ((5,), (5,))])
def test_wrong_shapes_are_refused(shapes):
    with pytest.raises(ValueError, match="positions must be"):
        thin(np.zeros(shapes[0]), np.zeros(shapes[1]), still(), VEHICLE)
