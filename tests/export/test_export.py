"""Exporting in several formats: files, notes, odd names and dates, errors."""

import json
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from auvplan.export import FORMATS, ExportError, export, export_held, export_notes
from auvplan.runtime.files import OutputError
from tests.export.compare import written
from tests.export.sample import EPOCH, SITE, make_itinerary


def test_an_epoch_without_a_time_zone_is_utc(tmp_path: Path):
    naive = make_itinerary(replace(SITE, epoch=EPOCH.replace(tzinfo=None)))
    for name in ("csv", "imc", "gpx"):
        text = written(make_itinerary(), tmp_path, name).read_bytes()
        assert written(naive, tmp_path, name).read_bytes() == text


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
    for name in ("csv", "netcdf"):
        (tmp_path / FORMATS[name].file).mkdir()
        with pytest.raises(OutputError, match=rf"^cannot write .*{FORMATS[name].file}"):
            export(make_itinerary(), tmp_path, [name])


@pytest.mark.parametrize("name", ["wreck\0", "half \ud800", "\x1b[2J \U0001f41f"])
def test_names_that_are_no_text_do_not_spoil_any_format(name: str, tmp_path: Path):
    whole = make_itinerary()
    legs = tuple(replace(leg, start_name=name, goal_name=name) for leg in whole.legs)
    assert len(export(replace(whole, name=name, legs=legs), tmp_path)) == len(FORMATS)
    assert "?" in json.loads((tmp_path / "itinerary.geojson").read_text())["name"]
    for kind in ("kml", "gpx", "imc"):
        ElementTree.parse(tmp_path / FORMATS[kind].file)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speed": 0.0}, "speed must be positive, got 0"),
        ({"speed": float("nan")}, "speed must be positive, got nan"),
        ({"site": replace(SITE, epoch=EPOCH.replace(year=9999, month=12, day=31))}, "beyond the calendar"),
    ],
)
def test_itineraries_that_no_file_can_hold_are_refused(changes, words):
    with pytest.raises(ExportError, match=words):
        replace(make_itinerary(), **changes)
    first, *rest = make_itinerary().legs
    with pytest.raises(ExportError, match="leg 1: a task cannot take -1 s"):
        replace(make_itinerary(), legs=(replace(first, hold=-1.0), *rest))


def test_a_time_beyond_those_of_ros_is_told_in_one_line(tmp_path: Path):
    itinerary = make_itinerary(replace(SITE, epoch=EPOCH.replace(year=2100)))
    with pytest.raises(ExportError, match="a ROS time is from 1901 to 2038"):
        export(itinerary, tmp_path, ["ros"])
    assert not list(tmp_path.iterdir())


def test_formats_that_cannot_hold_a_plan_are_left_out_by_name(tmp_path: Path):
    whole = make_itinerary()
    first, *rest = whole.legs
    held, left_out = export_held(replace(whole, legs=(replace(first, hold=70_000.0), *rest)), tmp_path)
    assert [*held] == [name for name in FORMATS if name not in ("qgc", "imc")]
    assert sorted(held.values()) == sorted(tmp_path.iterdir())
    assert left_out == [
        "itinerary.plan is left out: .plan: the task at wreck & reef (leg 1) takes 70000 s, at most 65535",
        "itinerary.imc.xml is left out: IMC plan: the task of leg 1 takes 70000 s, at most 65535",
    ]
    held, left_out = export_held(whole, tmp_path)
    assert ([*held], left_out) == ([*FORMATS], [])


def test_no_older_file_stays_of_a_format_that_is_left_out(tmp_path: Path):
    whole, other = make_itinerary(), tmp_path / "other.plan"
    other.touch()
    first, *rest = whole.legs
    export_held(whole, tmp_path)
    held, left_out = export_held(replace(whole, legs=(replace(first, hold=70_000.0), *rest)), tmp_path)
    assert sorted([*held.values(), other]) == sorted(tmp_path.iterdir())
    lines = [line.split(":")[0] for line in left_out]
    assert lines == [
        f"{name} is left out; an older one is deleted" for name in ("itinerary.plan", "itinerary.imc.xml")
    ]
