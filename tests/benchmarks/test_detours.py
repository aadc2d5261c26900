"""Jobs about closed areas and islands, planned and searched exhaustively."""

import numpy as np
import pytest

from benchmarks import detours

pytestmark = pytest.mark.usefixtures("light_search")


@pytest.mark.slow
def test_an_area_in_open_water_leaves_the_tour_of_all_jobs(tmp_path):
    """A closed area of 1.6 by 2.2 km whose corners the best tour clips, and two known obstacles."""
    row = detours.planned(detours.hobart(), None, tmp_path)
    assert row.priority == row.best == 26.0
    assert row.time < 1.02 * row.least
    assert row.faults == ()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*lie in the same place:auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_plans_among_areas_and_islands_are_as_good_as_exhaustive_search(seed, tmp_path):
    row = detours.planned(detours.drawn(seed), seed, tmp_path)
    assert row.priority == row.best
    assert row.faults == ()


def test_the_reference_goes_round_what_is_in_the_way():
    """Of two places on both sides of a square, and two that see each other."""
    case = detours.hobart()
    places = np.array([(0.0, -1500.0), (0.0, 1500.0), (2000.0, 1500.0)])
    paths = detours.shortest_paths(case, places)
    around, along = (np.linalg.norm(np.diff(paths[pair], axis=0), axis=1).sum() for pair in ((0, 1), (1, 2)))
    margin = detours.COAST
    assert along == pytest.approx(2000.0)
    assert 2.0 * np.hypot(1100.0, 700.0) + 1600.0 < around < 2.0 * np.hypot(1100 + margin, 700.0) + 1640.0
    still = detours.seconds_along(paths[0, 1], 0.0, lambda now: np.zeros(2))
    assert still == pytest.approx(around / detours.SPEED)
