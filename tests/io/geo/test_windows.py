"""Time windows of jobs: moments, times of day, seconds; each slip in one line."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from auvplan.io.geo import GeoError, read_jobs
from auvplan.io.geo.windows import Hours
from auvplan.site import Site
from tests.io.geo.files import written
from tests.io.refusals import refusal

SITE = Site(148.96, -20.34, epoch=datetime(2026, 3, 1, tzinfo=UTC))
HOUR = 3600.0


def windows(duration=0.0, until=6 * HOUR, speed=None, site=SITE, since=0.0, **stated):
    return Hours("jobs.csv: row 2", stated, site, until, since).windows(duration, speed)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        ({}, ()),
        ({"from": "", "to": ".."}, ()),
        ({"from": 600, "to": "1800"}, ((600.0, 1800.0),)),
        ({"to": 1800}, ((-float("inf"), 1800.0),)),
        ({"from": "2026-03-01T01:00Z", "to": "2026-03-01T13:00+10:00"}, ((HOUR, 3 * HOUR),)),
        ({"from": "11:30+10:00", "to": "12:30+10:00"}, ((1.5 * HOUR, 2.5 * HOUR),)),
        ({"from": "23:00Z", "to": "02:00Z"}, ((-HOUR, 2 * HOUR),)),
        ({"windows": "0/600, 3000/.."}, ((0.0, 600.0), (3000.0, float("inf")))),
        ({"windows": [[3000, 4200], [None, 600]]}, ((-float("inf"), 600.0), (3000.0, 4200.0))),
    ],
)
def test_windows_are_read(stated, expected):
    assert windows(**stated) == expected


def test_the_whole_task_lies_in_the_window_unless_its_beginning_does():
    stated = {"windows": [[0, 100], [1000, 2000]]}
    assert windows(300.0, **stated) == ((1000.0, 1700.0),)
    assert windows(300.0, **stated, window="begin") == ((0.0, 100.0), (1000.0, 2000.0))


def test_times_of_day_hold_on_every_day():
    found = windows(until=50 * HOUR, **{"from": "03:00Z", "to": "04:00Z"})
    assert found == tuple((day * 24 * HOUR + 3 * HOUR, day * 24 * HOUR + 4 * HOUR) for day in range(2))


@pytest.mark.parametrize(
    ("ends", "hours"),
    [
        (("08:00+10:00", "23:00Z"), ((22.0, 23.0),)),
        (("23:00Z", "10:00+10:00"), ((-1.0, 0.0), (23.0, 24.0))),
        (("22:00Z", "09:00+10:00"), ((22.0, 23.0),)),
        (("08:00+10:00", "22:00Z"), ((-2.0, 22.0), (22.0, 46.0))),  # all day
        (("00:00Z", "00:00Z"), ((-24.0, 0.0), (0.0, 24.0), (24.0, 48.0))),
    ],
)
def test_times_of_day_may_be_in_two_zones(ends, hours):
    found = windows(until=30 * HOUR, **dict(zip(("from", "to"), ends, strict=True)))
    assert found == tuple((first * HOUR, last * HOUR) for first, last in hours)


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"from": 1800, "to": 600}, "from 1800 to 600 ends before it begins"),
        ({"from": "2026-03-01T01:00"}, "has no time zone: write 2026-03-01T01:00Z"),
        ({"from": "08:00", "to": "09:00Z"}, "has no time zone: write 08:00Z"),
        ({"from": "8 o'clock"}, "cannot be read: write a moment"),
        ({"from": "25:00Z", "to": "26:00Z"}, "is no time of day"),
        ({"from": "nan"}, "must be a finite time"),
        ({"from": 0, "windows": "1/2"}, "put all into windows"),
        ({"windows": "0/600/1200"}, "must be pairs"),
        ({"windows": "0/600, 500/900"}, "two windows overlap"),
        ({"from": 0, "to": 200}, "takes 300 s, its longest window 200 s"),
        ({"from": "2026-03-02T01:00Z"}, "lie outside the mission"),
        ({"from": "03:00Z", "to": 600}, "both be times of day"),
        ({"from": 0, "window": "half"}, "must be 'whole' or 'begin'"),
    ],
)
def test_slips_are_stated(stated, message):
    refusal(GeoError, "^jobs.csv: row 2: .*" + message, windows, 300.0, **stated)


def test_daylight_is_between_sunrise_and_sunset():
    """On the equinox the sun is up for some minutes more than twelve hours, around noon by the sun."""
    site = Site(15.0, 0.0, epoch=datetime(2026, 3, 20, tzinfo=UTC))
    (day, _) = windows(until=30 * HOUR, site=site, windows="daylight")
    assert day[1] - day[0] == pytest.approx(12.12 * HOUR, abs=180.0)
    assert sum(day) / 2.0 == pytest.approx(11.0 * HOUR + 8 * 60.0, abs=180.0)  # 15 degrees are an hour
    nights = windows(until=30 * HOUR, site=site, windows="night")
    assert [night[0] for night in nights][1] == pytest.approx(day[1] + 60.0)


@pytest.mark.parametrize(
    "stated", [{"from": "03:00Z", "to": "04:00Z"}, {"windows": "03:00Z/04:00Z"}, {"windows": "daylight"}]
)
def test_times_that_the_mission_does_not_reach_are_no_leave_for_any_time(stated):
    evening = Site(148.96, -20.34, epoch=datetime(2026, 3, 1, 14, tzinfo=UTC))
    refusal(
        GeoError, "all its windows lie outside the mission", windows, 60.0, 2 * HOUR, site=evening, **stated
    )
    spans = Hours("zone", stated, evening, 2 * HOUR).spans()
    assert spans
    assert all(closes < 0.0 or opens > 2 * HOUR for opens, closes in spans)


@pytest.mark.parametrize("back", [2.0, 30.0, 24.0 * 190])
@pytest.mark.parametrize("words", ["daylight", "slack < 0.5", "{}/{}"])
def test_windows_before_the_departure_are_those_of_a_site_that_departs_then(back, words):
    earlier = Site(148.96, -20.34, epoch=SITE.epoch - timedelta(hours=back))
    stated = {"windows": words.format(*(f"{earlier.epoch + timedelta(hours=h):%H:%MZ}" for h in (0.5, 1.5)))}
    calm = {"speed": lambda times: np.abs(np.sin(np.pi * times / (4 * HOUR)))}
    later = {"speed": lambda times: calm["speed"](times + back * HOUR)}
    found = windows(60.0, (2.0 - back) * HOUR, since=-back * HOUR, **later, **stated)
    own = windows(60.0, 2 * HOUR, site=earlier, **calm, **stated)
    np.testing.assert_allclose(np.add(found, back * HOUR), own)


def test_windows_that_an_early_departure_does_not_reach_name_it():
    early, back = {"since": -2 * HOUR, "until": -HOUR}, {"to": "2026-02-28T21:00Z"}
    over = r"over at the departure, 2026-02-28 22:00 UTC"
    refusal(GeoError, over, windows, **early, **back)
    words = r"lie outside the mission, which may last 3600 s"
    refusal(GeoError, words, windows, **early, **{"from": "00:00Z", "to": "01:00Z"})


def test_there_is_no_night_in_the_arctic_summer():
    site = Site(20.0, 78.0, epoch=datetime(2026, 6, 20, tzinfo=UTC))
    assert windows(until=HOUR, site=site, windows="daylight") == ((-float("inf"), float("inf")),)
    refusal(GeoError, "there is no night", windows, until=HOUR, site=site, windows="night")


def test_dates_need_a_departure():
    stated = {"from": "2026-03-01T01:00Z"}
    refusal(GeoError, r"needs site\.departure", windows, site=Site(0.0, 0.0), **stated)


def test_windows_of_a_line_stand_in_any_of_its_rows(tmp_path):
    path, line = tmp_path / "jobs.csv", "line,lon,lat,from,to\na,148.95,-20.33,60,\na,148.96,-20.33"
    table = written(path, f"{line},,\na,148.97,-20.33,60,900\n")
    (line_,) = read_jobs(table, SITE).lines
    assert line_.windows == ((60.0, 900.0),)
    written(path, "name,lon,lat,duration,from,to\na,148.95,-20.33,60,01:00Z,02:00Z\n")
    (point,) = read_jobs(table, SITE, until=6 * HOUR).points
    assert point.windows == ((HOUR, 2 * HOUR - 60.0),)
    words = "line 'a' has from 60 in an earlier row, 90 in this"
    refusal(GeoError, words, read_jobs, written(path, f"{line},90,\n"), SITE)
    begin = written(path, "line,lon,lat,from,window\na,148.95,-20.33,60,begin\na,148.96,-20.33,,\n")
    refusal(GeoError, "leave out window: begin", read_jobs, begin, SITE)


def test_slack_water_is_when_the_current_is_slower_there(tmp_path):
    table = tmp_path / "jobs.csv"
    table.write_text("name,north,east,windows\na,100,0,slack < 0.5\nb,900,0,slack<0.5 m/s\n")

    def speed(place, times):
        return np.abs(np.cos(np.pi * times / HOUR)) * place[0] / 500.0

    near, far = read_jobs(table, SITE, until=HOUR, speed=speed).points
    assert near.windows == ((0.0, HOUR),)
    half = HOUR / np.pi * np.arccos(0.5 / 1.8)
    assert far.windows[0] == pytest.approx((half, HOUR - half), abs=60.0)
    refusal(GeoError, r"needs a current that is forecast", read_jobs, table, SITE)
    table.write_text("name,north,east,windows\na,100,0,slack < fast\n")
    words = r"row 2, job 'a': slack water is given in m/s, such as slack < 0\.2, got 'fast'"
    refusal(GeoError, words, read_jobs, table, SITE, speed=speed)
    words = r"never below 0\.1 m/s there in the time of the mission: 0\.30 m/s"
    refusal(GeoError, words, windows, speed=lambda times: 0.3 + 0.0 * times, windows="slack < 0.1")


def falls(stated):
    return Hours("a", {"priority_after": stated}, SITE, HOUR).falls(3.0)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        (None, ()),
        ("600/2", ((600.0, 2.0),)),
        ([600, 2], ((600.0, 2.0),)),
        ([[600, 2], ["7200", 0.5]], ((600.0, 2.0), (2 * HOUR, 0.5))),
        ("2026-03-01T01:00Z/2, 7200/0.5", ((HOUR, 2.0), (2 * HOUR, 0.5))),
    ],
)
def test_priorities_fall_at_moments(stated, expected):
    assert falls(stated) == expected


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ("600", "'600' cannot be read: write moment/priority"),
        ("600/5", "falls from 3 to '5'"),
        ("600/2, 300/1", "has 300 after a later moment"),
        ("08:00Z/1", "needs a moment or seconds"),
        ("600/low", "falls from 3 to 'low'"),
    ],
)
def test_slips_in_falling_priorities_are_stated(stated, message):
    refusal(GeoError, message, falls, stated)


def test_the_sun_of_a_place_is_reckoned_once(monkeypatch):
    """Thousands of jobs by daylight are read in no time."""
    site = Site(3.25, 41.5, datetime(2026, 5, 4, 12, tzinfo=UTC))
    once = windows(site=site, windows="daylight")
    monkeypatch.setattr("astral.sun.elevation", lambda *_: pytest.fail("reckoned again"))
    assert windows(site=site, windows="daylight") == once
