"""Surfacings along an order of waypoints against a search of all sets of places."""

from itertools import combinations

import numpy as np
import pytest

from auvplan.mission.fixes import Order, surfacings
from auvplan.navigation import Navigation


def problem(seed: int) -> tuple[Navigation, Order]:
    """A random order of up to six places at which to surface, some of them forbidden, and limits."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    known = Navigation(rng.uniform(0.0, 0.03), rng.uniform(0.0, 0.1), rng.uniform(1.0, 10.0))
    known = known.after(rng.uniform(0.0, 1000.0), rng.uniform(0.0, 300.0))
    legs = rng.uniform([200.0, 0.0], [3000.0, 1500.0], (count, 2))
    stays, dives = rng.uniform(0.0, 300.0, (count, 2)), rng.uniform(0.0, 60.0, (count, 2))
    price = np.where(rng.uniform(size=count) < 0.2, np.inf, rng.uniform(60.0, 600.0, count))
    most = np.where(rng.uniform(size=count) < 0.4, rng.uniform(20.0, 120.0, count), np.inf)
    return known, Order(legs, stays, dives, price, np.minimum(most, rng.uniform(80.0, 250.0)))


def arrivals(known: Navigation, order: Order, at: tuple[int, ...]) -> np.ndarray:
    """Standard deviations on arrival, by the closed form in plain NumPy."""
    way, time, found = float(known.way), float(known.unlocked), []
    for k, leg in enumerate(order.legs):
        way, time = order.dives[k] if k in at else (way + order.stays[k][0], time + order.stays[k][1])
        way, time = way + leg[0], time + leg[1]
        found.append(np.sqrt(known.fix**2 + (known.drift * way) ** 2 + (known.current_error * time) ** 2))
    return np.asarray(found)


def exhaustive(known: Navigation, order: Order) -> float:
    """Least price of all sets of places that keep the limits; infinite where none does."""
    places = range(len(order.legs))
    sets = [at for size in range(len(order.legs) + 1) for at in combinations(places, size)]
    kept = [at for at in sets if (arrivals(known, order, at) <= order.most + 1e-4).all()]
    return min((float(sum(order.price[k] for k in at)) for at in kept), default=np.inf)


@pytest.mark.parametrize("seed", range(100))
def test_as_cheap_as_the_best_of_all_sets(seed):
    known, order = problem(seed)
    found, best = surfacings(known, order), exhaustive(known, order)
    assert (found.lacking is None) == np.isfinite(best)
    expected = arrivals(known, order, found.at)[: len(found.std)]
    np.testing.assert_allclose(found.std, expected, rtol=1e-6)
    if found.lacking is None:
        assert found.price == pytest.approx(best, rel=1e-12)
        assert (found.std <= order.most + 1e-3).all()
    else:
        place, least = found.lacking
        assert least > order.most[place - 1]
        assert (found.std[:-1] <= order.most[: place - 1] + 1e-3).all()
        assert found.std[-1] == pytest.approx(least, rel=1e-6)


def test_both_kinds_are_among_them():
    kinds = [surfacings(*problem(seed)).lacking is None for seed in range(100)]
    assert sum(kinds) >= 50
    assert not all(kinds)


def test_free_fixes_are_taken_and_none_without_need():
    known = Navigation(drift=0.01, fix=2.0)
    nothing, legs = np.zeros((3, 2)), np.array([[1000.0, 0.0]] * 3)
    need = Order(legs, nothing, nothing, np.array([np.inf, 100.0, 90.0]), np.array([np.inf, np.inf, 15.0]))
    assert surfacings(known, need).at == (2,)
    free = Order(legs, nothing, nothing, np.full(3, 100.0), np.full(3, np.inf))
    assert surfacings(known, free).at == ()
    strict = Order(legs, nothing, nothing, np.full(3, 100.0), np.array([np.inf, 5.0, np.inf]))
    assert surfacings(known, strict).lacking == (2, pytest.approx(np.hypot(2.0, 10.0)))
