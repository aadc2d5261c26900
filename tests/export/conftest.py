"""The sample itinerary at sites of all hemispheres, with and without a date."""

from dataclasses import replace

import pytest

from auvplan.export import Itinerary
from auvplan.site import Site
from tests.export.sample import EPOCH, SITE, make_itinerary

SITES = {
    "antimeridian": SITE,
    "north-west": Site(-70.25, 41.5, EPOCH, origin=(-5000.0, 800.0)),
    "dateless": replace(SITE, epoch=None),
}


@pytest.fixture(params=SITES)
def itinerary(request: pytest.FixtureRequest) -> Itinerary:
    return make_itinerary(SITES[request.param])
