"""Places and moments of a site: its projection, bearings of true north, and local time."""

from datetime import UTC, datetime, timedelta, timezone

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyproj import Geod

from auvplan.site import Site, as_utc, at_time

EPOCH = datetime(2015, 9, 7, 1, tzinfo=UTC)
FJORD = Site(5.677, 59.033, EPOCH)
ELLIPSOID = Geod(ellps="WGS84")


@given(
    longitude=st.floats(-179.9, 179.9),
    latitude=st.floats(-75.0, 75.0),
    north=st.floats(-50e3, 50e3),
    east=st.floats(-50e3, 50e3),
)
@settings(max_examples=50, deadline=None)
def test_there_and_back(longitude, latitude, north, east):
    site = Site(longitude, latitude, origin=(1000.0, -300.0))
    found = site.to_geographic(north, east)
    assert -180.0 <= float(found[0]) <= 180.0
    np.testing.assert_allclose(site.to_local(*found), (north, east), atol=1e-4)


def test_distance_and_bearing_from_the_site_are_true():
    azimuth = np.arange(0.0, 360.0, 30.0)
    ones = np.ones_like(azimuth)
    longitude, latitude, _ = ELLIPSOID.fwd(
        FJORD.longitude * ones, FJORD.latitude * ones, azimuth, 8000.0 * ones
    )
    north, east = FJORD.to_local(longitude, latitude)
    np.testing.assert_allclose(north, 8000.0 * np.cos(np.deg2rad(azimuth)), atol=1e-3)
    np.testing.assert_allclose(east, 8000.0 * np.sin(np.deg2rad(azimuth)), atol=1e-3)


def test_distances_about_the_site_are_nearly_true():
    rng = np.random.default_rng(0)
    one, other = rng.uniform(-5e3, 5e3, (2, 2, 40))
    local = np.hypot(*(one - other))
    there = ELLIPSOID.inv(*FJORD.to_geographic(*one), *FJORD.to_geographic(*other))[2]
    np.testing.assert_allclose(there, local, rtol=1e-6)


def test_origin_shifts_and_keeps_the_place():
    shifted = Site(FJORD.longitude, FJORD.latitude, origin=(2500.0, 400.0))
    np.testing.assert_allclose(shifted.to_local(FJORD.longitude, FJORD.latitude), (2500.0, 400.0), atol=1e-6)
    np.testing.assert_allclose(
        shifted.to_geographic(2500.0, 400.0), (FJORD.longitude, FJORD.latitude), atol=1e-9
    )


def test_longitudes_count_either_way():
    site = Site(179.99, -17.0)
    for eastern, western in ((-179.99, 180.01), (179.0, -181.0)):
        np.testing.assert_allclose(site.to_local(eastern, -17.0), site.to_local(western, -17.0), atol=1e-6)
    assert 2000.0 < float(site.to_local(-179.99, -17.0)[1]) < 2200.0
    assert float(site.to_geographic(0.0, 3000.0)[0]) < -179.9


def test_true_north_is_where_a_step_north_leads():
    north, east = np.array([4e3, -3e3, 0.0]), np.array([9e3, -8e3, 0.0])
    longitude, latitude = FJORD.to_geographic(north, east)
    ahead = np.stack(FJORD.to_local(longitude, latitude + 1e-4)) - np.stack([north, east])
    bearing = FJORD.true_north(longitude, latitude)
    np.testing.assert_allclose(bearing, np.arctan2(ahead[1], ahead[0]), atol=1e-6)
    # To the east meridians lean to the west as they go north.
    assert bearing[0] < -1e-3
    assert bearing[1] > 1e-3
    assert bearing[2] == pytest.approx(0.0, abs=1e-9)


def test_velocities_turn_as_the_docstring_says():
    # A drifter that goes (east e, north n) by the compass for a minute ends where the local velocity leads.
    north, east = 5e3, -9e3
    longitude, latitude = (float(value) for value in FJORD.to_geographic(north, east))
    e, n, seconds = 0.7, -0.4, 60.0
    azimuth, speed = np.rad2deg(np.arctan2(e, n)), np.hypot(e, n)
    there = ELLIPSOID.fwd(longitude, latitude, azimuth, speed * seconds)[:2]
    moved = np.array(FJORD.to_local(*there)) - (north, east)
    local = np.array(FJORD.local_vector(n, e, longitude, latitude))
    np.testing.assert_allclose(moved, local * seconds, atol=1e-3)
    np.testing.assert_array_equal(FJORD.local_vector(n, e, FJORD.longitude, latitude), (n, e))


def test_moments():
    assert FJORD.utc(3600.0) == datetime(2015, 9, 7, 2, tzinfo=UTC)
    assert FJORD.seconds(datetime(2015, 9, 7, 1, 30)) == 1800.0  # without a zone: UTC
    summer = timezone(timedelta(hours=2))
    assert FJORD.seconds(datetime(2015, 9, 7, 3, tzinfo=summer)) == 0.0
    assert as_utc(datetime(2015, 9, 7, 3, tzinfo=summer)) == EPOCH
    moment = FJORD.utc(-12345.5)
    assert moment is not None
    assert FJORD.seconds(moment) == -12345.5


def test_without_an_epoch_there_is_no_date():
    bare = Site(0.0, 0.0)
    assert bare.utc(0.0) is None
    with pytest.raises(ValueError, match="no epoch"):
        bare.seconds(EPOCH)


def test_times_in_words():
    assert at_time(3661.0, EPOCH) == "2015-09-07 02:01 UTC"
    assert (
        at_time(0.0, datetime(2015, 9, 7, 3, tzinfo=timezone(timedelta(hours=2)))) == "2015-09-07 01:00 UTC"
    )
    assert at_time(12345.6, None) == "at 12,346 s"
