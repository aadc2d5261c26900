"""Damaged and altered copies of a small file: refused in one line, or read as other libraries read them."""

import shutil
from collections import Counter
from functools import partial

import numpy as np
import pytest

from benchmarks.file_models import Currents, regular_file
from benchmarks.file_references import grid
from benchmarks.mutated_files import current, netcdf, outcome

NAMES = ["uo", "vo", "longitude", "latitude", "time"]
CASE = Currents("regular", "CF", "made", lambda folder: regular_file(folder, "regular")[:2],
                partial(grid, names=NAMES), (*NAMES[:4], "depth", "time"))  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.slow)])
def test_altered_files(tmp_path, seed):
    (tmp_path / "kept").mkdir()
    whole, options = CASE.prepare(tmp_path / "kept")
    original, said = CASE.reading(whole), Counter()
    for number in range(16):
        path = shutil.copy(whole[0], tmp_path / "altered.nc")
        change = netcdf(path, CASE.variables, np.random.default_rng([seed, number]))
        became = outcome(partial(current, CASE, [path], options, change, original))
        assert became.startswith(("refused", "right")), (number, change, became)
        assert became.startswith("right") or "altered.nc" in became
        said[became.partition(":")[0]] += 1
    assert min(said["refused"], said["right"]) > 2, said
