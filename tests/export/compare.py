"""What files say against the itinerary that they were written from."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

from auvplan.export import FORMATS, Itinerary, export
from tests.export.sample import EPOCH


def written(itinerary: Itinerary, folder: Path, name: str) -> Path:
    (path,) = export(itinerary, folder, [name])
    assert path == folder / FORMATS[name].file
    return path


def near(itinerary: Itinerary, found, expected: np.ndarray) -> None:
    """Longitude, latitude, depth [n, 3] as parsed lie within 0.1 m of positions [n, 3] m."""
    found = np.asarray(found, float)
    assert found.shape == expected.shape
    assert (np.abs(found[:, 0]) <= 180.0).all()
    north, east = itinerary.site.to_local(found[:, 0], found[:, 1])
    assert np.column_stack([north, east, found[:, 2]]) == pytest.approx(expected, abs=0.1)


def azimuth(itinerary: Itinerary, places, angle) -> np.ndarray:
    """Degrees from true north, in [-180, 180], of local angles [n] rad at places [n, 2 or 3] m."""
    north, east = np.asarray(places, float)[..., :2].T
    ends = (north, east), (north + 10.0 * np.cos(angle), east + 10.0 * np.sin(angle))
    return Geod(ellps="WGS84").inv(*(part for end in ends for part in itinerary.site.to_geographic(*end)))[0]


def kept(itinerary: Itinerary) -> np.ndarray:
    """[6, 3] m: where legs join, the place comes once."""
    first, second = itinerary.legs
    return np.concatenate([first.waypoints, second.waypoints[1:]])


def kept_seconds(itinerary: Itinerary) -> np.ndarray:
    first, second = itinerary.legs
    return np.concatenate([first.times[first.kept], second.times[second.kept[1:]]])


def same_times(itinerary: Itinerary, found, seconds) -> None:
    """Times of day as text, to the millisecond; none without an epoch."""
    if itinerary.site.epoch is None:
        assert not any(found)
        return
    assert all(text.endswith("Z") for text in found)
    then = [(datetime.fromisoformat(text) - EPOCH) / timedelta(seconds=1) for text in found]
    assert then == pytest.approx(list(seconds), abs=2e-3)
