"""A disk without room: one line, and what was there before stays as it was."""

import json

import numpy as np
import pytest
import xarray as xr

import auvplan as ap
from auvplan.runtime.files import OutputError, read_dataset, whole_result, write_atomically, write_dataset
from tests.faults.disk import full_disk
from tests.io.sample_run import make_run


@pytest.mark.parametrize("room", [0, 100, 5_000, 100_000, 400_000])
def test_a_dataset_is_written_whole_or_not_at_all(room, tmp_path):
    noise = np.random.default_rng(0).normal(size=(200, 300))
    old, new = (xr.Dataset({"a": (("n", "m"), noise + k)}) for k in range(2))
    write_dataset(old, tmp_path / "a.nc")
    with full_disk(room), pytest.raises(OutputError, match="cannot write"):
        write_dataset(new, tmp_path / "a.nc")
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]
    np.testing.assert_array_equal(read_dataset(tmp_path, "a.nc")["a"], noise)


def test_a_run_that_finds_no_room_leaves_the_last_one(tmp_path):
    run = make_run()
    with whole_result(tmp_path / "out") as partial:
        ap.save_run(run, partial)
    before = {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()}

    def again():
        with whole_result(tmp_path / "out") as partial:
            ap.save_run(run, partial)

    with full_disk(), pytest.raises(OutputError) as stated:
        again()
    assert "\n" not in str(stated.value)
    assert {file.name: file.read_bytes() for file in (tmp_path / "out").iterdir()} == before
    assert [file.name for file in tmp_path.iterdir()] == ["out"]
    json.loads(before["summary.json"])


def test_text_is_written_whole_or_not_at_all(tmp_path):
    with full_disk(), pytest.raises(OutputError, match=r"cannot write .*a\.txt"):
        write_atomically(tmp_path / "a.txt", lambda path: path.write_text("x" * 10_000))
    assert not list(tmp_path.iterdir())
