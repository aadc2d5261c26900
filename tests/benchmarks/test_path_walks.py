"""Paths that the planner calls clear, walked by the checker of saved runs."""

import pytest

from benchmarks.path_walks import walks

pytestmark = pytest.mark.slow


def test_paths_called_clear_are_clear_when_walked():
    found = walks(60)
    assert found.paths == 60
    assert found.collisions == 0
