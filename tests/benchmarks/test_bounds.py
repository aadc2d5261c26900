import pytest

pytest.importorskip("numba", reason="needs numba: pip install 'auvplan[bench]'")

from benchmarks.bounds import bounds
from benchmarks.water_problems import FAMILIES

#: As if no path were known that is quicker than so many times the reference.
KNOWN = 1.25


@pytest.mark.slow
@pytest.mark.parametrize("family", ["open", "sounds", "moving"])
def test_no_reference_beats_its_bound(family):
    (run,) = bounds([family], [1000], None, KNOWN, 0.25)
    assert run["kind"] == "certified"
    assert not run["violated"]
    assert run["bound"] > 0.5 * run["quickest"]


@pytest.mark.slow
def test_none_of_many_references_beats_its_bound():
    runs = list(bounds(FAMILIES, range(1000, 1034), None, KNOWN, 0.25))
    assert len(runs) > 150
    assert not [run["problem"] for run in runs if run["violated"]]
