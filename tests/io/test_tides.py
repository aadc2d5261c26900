"""Tidal constituents: against utide's reconstruction, stated by u and v or by ellipses; slips in one line."""

import json
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
import yaml
from utide import reconstruct, solve

from auvplan.io.tides import read_tide
from auvplan.ocean.gridded import CurrentError
from auvplan.site import Site
from tests.io.refusals import refusal

SITE = Site(5.0, 60.0, epoch=datetime(2026, 3, 1, 6, tzinfo=UTC))
MONTH = 30 * 86_400.0
NAMES = ("M2", "S2", "N2", "K1", "O1")


@pytest.fixture(scope="module")
def solved():
    """What utide makes of half a year of a made current, and its own reconstruction over a month after."""
    hours = np.arange(0.0, 24.0 * 200, 0.5)
    rates = dict(zip(NAMES, (28.984104, 30.0, 28.43973, 15.041069, 13.943036), strict=True))
    u, v = (
        sum(a * np.cos(np.radians(rates[n] * hours - g)) for n, a, g in zip(NAMES, sizes, lags, strict=True))
        for sizes, lags in (
            ((0.7, 0.25, 0.1, 0.15, 0.1), (40, 75, 10, 200, 90)),
            ((0.4, 0.1, 0.05, 0.2, 0.07), (100, 20, 60, 300, 10)),
        )
    )
    first = datetime(2025, 6, 1)
    times = np.array([first + timedelta(hours=float(hour)) for hour in hours], "datetime64[ns]")
    options = {"constit": list(NAMES), "nodal": True, "trend": False, "conf_int": "none", "verbose": False}
    coef = solve(times, u + 0.05, v - 0.02, lat=60.0, **options)
    seconds = np.arange(0.0, MONTH, 1800.0)
    later = np.datetime64("2026-03-01T06:00") + seconds.astype("timedelta64[s]")
    found = reconstruct(later, coef, verbose=False)
    return coef, seconds, np.asarray(found.v), np.asarray(found.u)


def written(folder, stated):
    path = folder / "tide.yaml"
    path.write_text(stated if isinstance(stated, str) else yaml.safe_dump(stated))
    return path


def of_ellipses(coef):
    rows = zip(coef.name, coef.Lsmaj, coef.Lsmin, coef.theta, coef.g, strict=True)
    constituents = {str(name): {"ellipse": [float(part) for part in parts]} for name, *parts in rows}
    return {"constituents": constituents, "mean": [float(coef.umean), float(coef.vmean)]}


def test_a_month_equals_utide(tmp_path, solved):
    coef, seconds, north, east = solved
    tide = read_tide(written(tmp_path, of_ellipses(coef)), SITE, MONTH)
    u, v, w = (np.asarray(part) for part in tide(0.0, 0.0, 5.0, seconds.astype(np.float32)))
    assert np.abs(u - north).max() < 1e-3
    assert np.abs(v - east).max() < 1e-3
    assert not w.any()
    assert np.hypot(north, east).max() <= tide.fastest


def test_amplitudes_and_phases_say_the_same_as_an_ellipse(tmp_path, solved):
    """Lsmaj cos a + i Lsmin sin a, turned by theta, is u + i v."""
    coef, seconds, *_ = solved
    one = read_tide(written(tmp_path, of_ellipses(coef)), SITE, MONTH)
    stated = of_ellipses(coef)
    for constituent in stated["constituents"].values():
        major, minor, turn, lag = constituent.pop("ellipse")
        turn, lag = np.radians([turn, lag])
        u = np.exp(-1j * lag) * (major * np.cos(turn) + 1j * minor * np.sin(turn))
        v = np.exp(-1j * lag) * (major * np.sin(turn) - 1j * minor * np.cos(turn))
        constituent |= {
            name: [float(abs(part)), float(-np.degrees(np.angle(part)))]
            for name, part in (("u", u), ("v", v))
        }
    other = read_tide(written(tmp_path, stated), SITE, MONTH)
    places = 0.0, 0.0, 5.0, seconds.astype(np.float32)
    np.testing.assert_allclose(one(*places)[:2], other(*places)[:2], atol=1e-4)


def test_the_same_tide_from_a_later_epoch(tmp_path, solved):
    path = written(tmp_path, of_ellipses(solved[0]))
    now = read_tide(path, SITE, 86_400.0).after(7200.0)
    later = read_tide(path, replace(SITE, epoch=SITE.epoch + timedelta(hours=2)), 86_400.0)
    for t in (0.0, 5000.0, 40_000.0):
        np.testing.assert_allclose(now(0.0, 0.0, 0.0, t)[:2], later(0.0, 0.0, 0.0, t)[:2], atol=1e-3)


def test_places_and_depths_are_between_what_is_stated(tmp_path):
    tide = {"M2": {"u": [1.0, 0.0], "v": [0.0, 0.0]}}
    half = {"M2": {"u": [0.5, 0.0], "v": [0.0, 0.0]}}
    places = [
        {"longitude": 5.0, "latitude": 60.0, "constituents": tide},
        {"longitude": 5.1, "latitude": 60.0, "constituents": half, "mean": [0.1, 0.0]},
    ]
    stated = {"places": places, "depths": [0.0, 20.0], "shares": [1.0, 0.5]}
    found = read_tide(written(tmp_path, stated), SITE, 3600.0)
    first, middle, last = (float(found(0.0, east, 0.0, 0.0)[1]) for east in (0.0, 2790.0, 5580.0))
    assert middle == pytest.approx(0.5 * (first + last), abs=0.01)
    assert float(found(0.0, 0.0, 20.0, 0.0)[1]) == pytest.approx(0.5 * first, abs=1e-6)


def test_a_tide_is_by_true_north(tmp_path):
    """20 km to the east in 82 degrees north a current to the north sets to the west of the frame's north."""
    site = Site(5.0, 82.0, epoch=SITE.epoch)
    tide = {"constituents": {"M2": {"u": [0.0, 0.0], "v": [0.5, 0.0]}}, "mean": [0.0, 0.8]}
    places = [{"longitude": x, "latitude": 82.0} | tide for x in (5.0, 6.3)]
    field = read_tide(written(tmp_path, json.dumps({"places": places})), site, 3600.0)
    here, ahead = (np.array(site.to_local(6.3, 82.0 + step)) for step in (0.0, 1e-4))
    for second in (0.0, 3000.0):
        north, east, _ = (float(part) for part in field(*here, 0.0, second))
        assert np.arctan2(east, north) == pytest.approx(np.arctan2(*(ahead - here)[::-1]), abs=1e-4)
        at_site = field(0.0, 0.0, 0.0, second)
        assert np.hypot(north, east) == pytest.approx(float(at_site[0]), rel=1e-5)
        assert float(at_site[1]) == pytest.approx(0.0, abs=1e-7)


ROUND = {"constituents": {"M2": {"ellipse": [1, 0, 0, 0]}}}


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({}, "constituents: must map names such as M2"),
        ({"constituents": {"M9": {"u": [1, 0], "v": [0, 0]}}}, r"constituents\.M9: is none that is known"),
        ({"constituents": {"M2": {"u": [1, 0]}}}, r"constituents\.M2: needs u and v"),
        ({"constituents": {"M2": {"u": [1], "v": [0, 0]}}}, r"constituents\.M2\.u: has too few entries: 1"),
        ({"constituent": {}}, "constituent: unknown key 'constituent', did you mean 'constituents'"),
        (ROUND | {"depths": [0, 10]}, "shares must be as many"),
        ({"places": [{"longitude": 5.0} | ROUND]}, r"places\.0\.latitude: is missing"),
        ("constituents: " + "[" * 10_000, "is no YAML: nested too deeply"),
        ("constituents: {M2: {ellipse: [1, 0, 0, 2026-13-45]}}", ".*2026-13-45.* is no value"),
        ("constituents: {M2: {u: [1" + "0" * 400 + ", 0], v: [0, 0]}}", r"constituents\.M2\.u"),
        ({"constituents": {"M2": {"u": [1e308, 0], "v": [0, 0]}}}, r"M2\.u\.0: must be less than .* 100"),
        ("x" * 2_000_000, "larger than 1000000 bytes"),
    ],
)
def test_slips_are_stated(tmp_path, stated, message):
    refusal(
        CurrentError, rf"tide\.yaml(:\d+)?: .*{message}", read_tide, written(tmp_path, stated), SITE, 3600.0
    )


def test_the_tide_needs_a_date(tmp_path):
    path = written(tmp_path, ROUND)
    refusal(CurrentError, r"needs? site\.departure", read_tide, path, Site(5.0, 60.0), 3600.0)
