"""What the tests of links share."""

import pytest

from auvplan.link import Upload, mavlink
from tests.export.sample import make_itinerary
from tests.link.joining import CLEAN, body_at, joined

#: s of mission time in one of wall-clock time.
SCALE, FAST = 400.0, 1000.0


@pytest.fixture(autouse=True)
def _soon_alone(monkeypatch):
    """Other vehicles on a link are looked for as long as it takes to hear two heartbeats of a peer."""
    monkeypatch.setattr(mavlink, "_OTHERS", 0.3)


@pytest.fixture
def upload():
    return Upload(make_itinerary())


@pytest.fixture
def opened():
    """A list of links, peers and proxies, which are closed at the end."""
    parts = []
    yield parts
    for part in parts:
        part.close()


@pytest.fixture
def join_vehicle(upload, opened):
    """Makes a link to a vehicle at the upload's start, through a proxy with faults."""

    def make(faults=CLEAN, *, kind, limits, scale=SCALE):
        site, (north, east, _) = upload.itinerary.site, upload.steps[0].position
        parts = joined(kind, site, body_at(site, north, east, 12.5), scale, faults, 0, limits)
        opened.extend(parts)
        parts[0].connect()
        return parts

    return make
