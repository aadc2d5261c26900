"""What the tests of links share."""

import pytest

from auvplan.link import Upload
from tests.export.sample import make_itinerary


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
