"""Changed files for every reader, a few each: read or refused by a line, and nothing else is touched."""

import json

import numpy as np
import pytest
import utide  # noqa: F401 - it unpickles constants of its own

from benchmarks.fuzz.cases import Cases, Tripwire, Watch, attempt, write_outside
from benchmarks.fuzz.changes import change
from benchmarks.fuzz.readers import READERS, write_sources

#: Cases of each reader; of those that take longer, fewer.
CASES = 20
SLOW = {
    "scenario and its files": 2, "jobs, KMZ": 4, "land": 10, "chart, PNG": 4, "chart, GeoTIFF": 8,
    "picture": 6, "bathymetry": 6, "currents": 12, "study": 2, "saved run": 4, "saved run, checked": 4,
}  # fmt: skip


#: Readers of what takes longest to read, whose parts are read by others.
LONGEST = {"scenario and its files", "saved run, checked"}


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    write_sources(folder / "sources", planned=False)
    return folder


@pytest.fixture(scope="module")
def watch():
    heard = Watch()
    heard.install()
    return heard


@pytest.fixture(scope="module")
def wire(sources):
    return Tripwire(write_outside(sources))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LONGEST else ()) for name in READERS]
)
def test_changed_files_are_read_or_refused(name, sources, watch, wire, monkeypatch):
    monkeypatch.setenv("AUVPLAN_CACHE", "off")
    place = sources / name
    # The same cases whether or not there are real data beside the repository.
    monkeypatch.setattr("benchmarks.fuzz.readers.SHARED", sources / "nowhere")
    seeds = tuple(READERS[name].write(place, sources / "sources"))
    cases = Cases(name, seeds, place, sources / "outside", 0)
    wrong = []
    for number in range(SLOW.get(name, CASES)):
        path, said = cases.make(number, sources / "case")
        found = attempt(cases, path, sources / "case", watch, wire)
        if found not in ("read", "refused"):
            wrong.append(f"{number}: {said}: {found}")
    assert not wrong


def test_the_same_seed_makes_the_same_cases(tmp_path):
    outside = write_outside(tmp_path)
    made = []
    for name in "ab":
        path = tmp_path / f"{name}.json"
        path.write_text(json.dumps({"a": [1, 2, {"b": "c"}]}))
        said = [change(path, np.random.default_rng(seed), outside) for seed in range(3)]
        made.append((said, path.read_bytes()))
    assert made[0] == made[1]


def test_what_is_not_to_be_done_is_noticed(tmp_path, watch, wire, sources):
    outside = sources / "outside" / "linked.txt"
    (tmp_path / "own").write_text("x")
    with watch.over(tmp_path, names=False):
        (tmp_path / "own").read_text()
        outside.read_text()
        with pytest.raises(PermissionError):
            __import__("os").system("true")
    assert [line.split()[0] for line in watch.found] == ["opened", "os.system:"]
    assert wire.opened() in (["linked.txt"], [])
