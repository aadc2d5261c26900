"""Sea beds, charts and pictures of real files: the pixels are those that GDAL, netCDF4 and SciPy find."""

import pytest

from benchmarks.file_rasters import RASTERS

#: Others are of the same kinds, take long, or are refused.
LEFT = "hamilton", "norkyst", "arctic20", "norfjords", "passage.png"
CASES = {case.name: case for case in RASTERS if not any(word in case.name for word in LEFT)}


@pytest.mark.filterwarnings("ignore::PendingDeprecationWarning")
@pytest.mark.parametrize("name", CASES)
def test_pixels_are_those_of_other_libraries(shared, tmp_path, name):
    case = CASES[name]
    (path,), _ = case.prepare(tmp_path)
    assert case.equal(case.read(path), case.expect(path)) == 1.0
