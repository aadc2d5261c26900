"""Exporting in several formats: files, notes, odd names and dates, errors."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from auvplan.export import FORMATS, ExportError, export, export_notes, write_csv
from auvplan.files import OutputError
from tests.export.compare import written
from tests.export.sample import EPOCH, SITE, make_itinerary


def test_an_epoch_without_a_time_zone_is_utc(tmp_path: Path):
    naive = make_itinerary(replace(SITE, epoch=EPOCH.replace(tzinfo=None)))
    for name in ("csv", "imc", "gpx"):
        text = written(make_itinerary(), tmp_path, name).read_bytes()
        assert written(naive, tmp_path, name).read_bytes() == text


def test_control_characters_do_not_spoil_xml(tmp_path: Path):
    itinerary = replace(make_itinerary(), name="bad\x00 \x1b name \U0001f41f")
    for name in ("kml", "gpx", "imc"):
        ElementTree.parse(written(itinerary, tmp_path, name))


def test_all_formats_at_once_and_their_notes(tmp_path: Path):
    itinerary = make_itinerary(replace(SITE, epoch=None))
    paths = export(itinerary, tmp_path / "new" / "folder")
    assert [path.name for path in paths] == [kind.file for kind in FORMATS.values()]
    assert all(path.stat().st_size for path in paths)
    notes = export_notes(itinerary)
    assert notes[0] == "a note"
    assert "6 of 18 samples kept" in notes[1]
    assert sum("no date" in note for note in notes) == 6
    assert export_notes(make_itinerary(), ["gpx"]) == notes[:2]


def test_unknown_formats_and_unwritable_files_are_told_in_one_line(tmp_path: Path):
    with pytest.raises(ExportError, match="format 'shp' is not one of qgc, geojson"):
        export(make_itinerary(), tmp_path, ["gpx", "shp"])
    assert not list(tmp_path.iterdir())
    (tmp_path / "itinerary.csv").mkdir()
    with pytest.raises(OutputError, match=r"cannot write .*itinerary\.csv"):
        write_csv(make_itinerary(), tmp_path / "itinerary.csv")
