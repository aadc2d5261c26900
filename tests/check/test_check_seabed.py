"""The independent checker over a sea bed: hits, near misses and what is not known."""

import numpy as np
import pytest

from auvplan.check.run import ResultError, check_dataset, check_run
from auvplan.io import save_run
from auvplan.io.results import to_dataset
from tests.io.sample_run import make_run


def over(depth, clearance=5.0):
    """The sample run's dataset with a sea bed [50, 50] of 40 m pixels put in by hand."""
    data = to_dataset(make_run())
    data["seabed_depth"] = (("seabed_x", "seabed_y"), np.asarray(depth, np.float32))
    data["seabed_origin"] = ("horizontal", np.array([0.0, 0.0]))
    data["seabed_pixel_size"] = ((), 40.0)
    data.attrs["seabed_clearance"] = clearance
    return data


def sounded(depth, clearance=5.0):
    """Check the sample run over such a sea bed."""
    return check_dataset(make_run().summary(), over(depth, clearance))


def test_a_bank_is_hit_and_nearly_hit():
    # The first leg goes from (300, 300, 20) to (700, 900, 40): a bank of 25 m from 420 to 580 m north.
    depth = np.full((50, 50), 60.0)
    depth[11:14, :20] = 25.0
    report = sounded(depth)
    assert report.seabed_hits == report.collisions == 1
    assert report.seabed_metres > 50.0
    slope = 35.0 / 40.0  # from the last centre on the bank to the next one
    north = np.linspace(300.0, 700.0, 100_001)
    bed = np.interp(north, [420.0, 460.0, 540.0, 580.0], [60.0, 25.0, 25.0, 60.0])
    altitude = bed - (20.0 + 20.0 * (north - 300.0) / 400.0)
    assert report.seabed_altitude == pytest.approx(altitude.min(), abs=slope)
    metres = (altitude < 0.0).mean() * np.linalg.norm([400.0, 600.0, 20.0])
    assert report.seabed_metres == pytest.approx(metres, abs=2.0)
    assert sum("below the sea bed for" in fault for fault in report.faults) == 1
    assert sum("above the sea bed, under 5 m, for" in fault for fault in report.faults) == 2
    assert not report.ok
    assert "1 with the sea bed" in str(report)


@pytest.mark.parametrize(("clearance", "ok"), [(19.9, True), (20.05, True), (20.2, False)])
def test_clearance_of_the_sea_bed_is_kept_to_a_tenth_of_a_metre(clearance, ok):
    report = sounded(np.full((50, 50), 60.0), clearance)
    assert report.ok is ok
    assert report.collisions == 0


def test_unknown_depths_are_dry_and_the_raster_must_reach():
    depth = np.full((50, 50), 60.0)
    depth[12, 14:16] = np.nan  # under the middle of the first leg
    assert sounded(depth).seabed_hits == 1
    report = sounded(np.full((20, 50), 60.0))
    assert any("beyond the known sea bed" in fault for fault in report.faults)


def test_a_sea_bed_of_other_dimensions_is_refused(tmp_path):
    save_run(make_run(), tmp_path)
    data = over(np.full((50, 50), 60.0))
    data["seabed_origin"] = data["seabed_origin"].rename(horizontal="place")
    data.to_netcdf(tmp_path / "mission.nc", engine="h5netcdf")
    with pytest.raises(
        ResultError, match=r"seabed_origin has dimensions \('place',\), not \('horizontal',\)"
    ):
        check_run(tmp_path)
