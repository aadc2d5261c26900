"""What files say of themselves: fences that autopilots hold, slow legs, sharp turns, the forecast."""

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from auvplan.export import Circle, PlannedLeg, Polygon, export_notes, itinerary_of
from auvplan.export.fences import nearest_fences, points
from auvplan.export.qgroundcontrol import qgc_plan
from auvplan.export.speeds import ground_share, track_notes
from auvplan.site import Site
from tests.export.compare import written
from tests.export.sample import make_itinerary
from tests.io.sample_run import make_run

LINE = np.array([[0.0, 0.0, 5.0], [1000.0, 0.0, 5.0]])


def square(north: float, east: float, size: float = 20.0) -> Polygon:
    return Polygon(
        np.array([north, east]) + size * np.array([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    )


def leg(*places, seconds=100.0, number=1) -> PlannedLeg:
    corners = np.asarray(places, float)
    return PlannedLeg.of(number, 0, 1, corners, seconds * np.arange(len(corners)))


def test_the_nearest_fences_come_first_up_to_the_points_there_are():
    fences = [square(500.0, 900.0), Circle((300.0, 400.0), 50.0), square(100.0, 60.0), square(800.0, 200.0)]
    assert [points(fence) for fence in fences] == [4, 1, 4, 4]
    kept, note = nearest_fences(fences, [LINE], 9)
    assert kept == (fences[1], fences[2], fences[3])
    assert "1 of 4 fences are left out, the nearest 900 m from the route" in note
    assert "13 points, the autopilot holds 9" in note
    kept, _ = nearest_fences(fences, [LINE], 5)
    assert kept == (fences[1], fences[2]), "what is nearest, and then what still fits"
    assert nearest_fences(fences, [LINE], 13) == (tuple(fences), "")
    assert nearest_fences(fences, [LINE], 0)[0] == ()


def test_a_plan_file_has_no_more_fence_than_fits_and_says_so():
    itinerary = replace(make_itinerary(), fence_points=4)
    plan = qgc_plan(itinerary)
    fence = plan["geoFence"]
    held = sum(len(area["polygon"]) for area in fence["polygons"]) + len(fence["circles"])
    assert 0 < held <= 4
    assert "fences are left out" in plan["comment"]
    assert any("fences are left out" in note for note in export_notes(itinerary, ["qgc"]))
    assert "left out" not in qgc_plan(make_itinerary())["comment"]


def test_slow_legs_are_told_from_others_and_from_those_between_two_tasks_in_one_place():
    quick, slow = leg([0, 0, 5], [200, 0, 5]), leg([0, 0, 5], [200, 0, 5], [240, 0, 5], number=2)
    still = leg([80, 10, 5], [80, 10, 5])
    assert [ground_share(one, 2.0) for one in (quick, slow, still)] == pytest.approx([1.0, 0.2, 1.0])
    (note,) = track_notes([quick, slow, still], 2.0, 0.1)
    assert "leg 2 is slow" in note
    assert "20 %" in note
    assert track_notes([quick, slow], 2.0, 0.1, slow=0.1) == []


def test_turns_and_dives_beyond_the_vehicle():
    hairpin = leg([0, 0, 5], [200, 0, 5], [0, 15, 5])
    (note,) = track_notes([hairpin], 2.0, 0.02)
    assert "turns too sharply for 100 m at waypoint 1" in note
    assert track_notes([leg([0, 0, 5], [200, 0, 5], [400, 30, 5])], 2.0, 0.02) == []
    dive = leg([0, 0, 5], [100, 0, 105], seconds=100.0 * np.sqrt(2.0))
    (note,) = track_notes([dive], 1.0, 0.1)
    assert "at 45 degrees, 0.7 m/s" in note
    assert note.endswith("common vehicles do 30")
    assert track_notes([dive], 1.0, 0.1, pitch_max=np.radians(45.0)) == []
    (note,) = track_notes([dive], 1.0, 0.1, pitch_max=np.radians(20.0))
    assert note.endswith("the vehicle's pitch_max is 20")


def test_warnings_and_sources_are_in_every_file(tmp_path):
    source, warning = "forecast tide.nc, SHA-256 abc", "leg 2 is slow"
    itinerary = replace(make_itinerary(), sources=(source,), warnings=(warning,))
    assert source in itinerary.description
    assert warning in itinerary.description
    assert source in json.loads(written(itinerary, tmp_path, "qgc").read_text())["comment"]
    assert source in written(itinerary, tmp_path, "csv").read_text()
    assert warning in export_notes(itinerary, ["csv"])


def test_the_forecast_of_a_run_is_named(tmp_path):
    (tmp_path / "tide.nc").write_bytes(b"tide")
    run = make_run()
    run.scenario = run.scenario | {"current": {"files": ["tide.nc"]}}
    run.folder = str(tmp_path)
    (line,) = itinerary_of(run, Site(148.96, -20.34)).sources
    assert line == f"forecast tide.nc, SHA-256 {hashlib.sha256(b'tide').hexdigest()[:16]}"
