"""KML by the OGC's schema and Google's extensions to it, where a package that ships them is installed."""

import importlib.util
from pathlib import Path

import pytest

from auvplan.export import write_kml
from auvplan.site import Site
from tests.export.sample import SITE, make_itinerary


@pytest.mark.parametrize("site", [SITE, Site(12.5, -3.25)], ids=["dated", "dateless"])
def test_kml_is_valid(site: Site, tmp_path: Path):
    lxml = pytest.importorskip("lxml.etree", reason="needs lxml")
    package = importlib.util.find_spec("fastkml")
    if package is None or package.origin is None:
        pytest.skip("needs fastkml, which ships the schemas of KML")
    schemas = Path(package.origin).parent / "schema"
    schema = lxml.XMLSchema(lxml.parse(str(schemas / "kml22gx.xsd")))
    schema.assertValid(lxml.parse(str(write_kml(make_itinerary(site), tmp_path / "x.kml"))))
