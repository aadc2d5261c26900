"""What of a survey line counts as covered."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from auvplan.check.lines import LENGTH_TOLERANCE
from auvplan.check.lines import covered as measured_again
from auvplan.mission.survey import LinePart

LINE = LinePart((0.0, 0.0, 10.0), (1000.0, 0.0, 10.0), 10.0)
places = st.tuples(
    st.floats(-200.0, 1200.0, width=16), st.floats(-60.0, 60.0, width=16), st.floats(0.0, 30.0, width=16)
)


def naive(track, part):
    """Length of the line that finely spaced places of a track lie beside, by counting its decimetres."""
    track = np.asarray(track, float)
    share = np.linspace(0.0, 1.0, 4001)[:, None]
    fine = np.concatenate([a + share * (b - a) for a, b in pairwise(track)])
    off = np.hypot(fine[:, 1], fine[:, 2] - 10.0)
    near = fine[(off <= part.tolerance) & (fine[:, 0] >= 0.0) & (fine[:, 0] <= part.length), 0]
    return len(np.unique(np.floor(near))) * 1.0 if len(near) else 0.0


@settings(max_examples=25, deadline=None)
@given(st.lists(places, min_size=2, max_size=6))
@example([(26.0, 2.0**-23, 0.0), (0.0, 0.0, 0.0), (51.0, 0.0, 3.0)])  # by the tolerance off, but for rounding
@example([(4.0, 2.0**-23, 0.0), (0.0, 0.0, 0.0)])
@example([(0.0, 2.0**-23, 0.0), (1.0, 0.0, 0.0)])
def test_coverage_is_that_of_a_plain_count(track):
    found = LINE.covered(track)
    # Each stretch may cut a metre at either end.
    assert found.length == pytest.approx(naive(track, LINE), abs=2.0 * len(track))
    assert 0.0 <= found.mean <= found.worst <= LINE.tolerance + 1e-6
    again = measured_again(np.asarray(track, float), np.array(LINE.start), np.array(LINE.end), LINE.tolerance)
    assert again[0] == pytest.approx(found.length, abs=LENGTH_TOLERANCE)
    if found.length > 50.0:
        assert again[1:] == pytest.approx(found[1:], abs=LENGTH_TOLERANCE)


def test_the_line_itself_is_covered_whole_in_either_direction():
    ends = [LINE.start, LINE.end]
    for track in (ends, ends[::-1]):
        found = LINE.covered(track)
        assert found == pytest.approx((1000.0, 0.0, 0.0))
        assert LINE.share(found) == 1.0


def test_what_is_passed_farther_off_or_twice_does_not_count():
    aside = [(0, 0, 10), (400, 0, 10), (400, 50, 10), (600, 50, 10), (600, 0, 10), (1000, 0, 10)]
    assert LINE.covered(aside).length == pytest.approx(800.0)
    assert LINE.covered([(0, 0, 10), (600, 0, 10), (300, 0, 10), (700, 0, 10)]).length == pytest.approx(700.0)
    assert LINE.covered([(0, 6, 18), (1000, 6, 18)]).worst == pytest.approx(10.0)
    assert LINE.covered([(0, 6, 18.1), (1000, 6, 18.1)]) == (0.0, 0.0, 0.0)
    assert LINE.covered([(0, 0, 10)]).length == 0.0
