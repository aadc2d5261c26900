"""Notices from a file that grows: obstacles, currents, and lines that are neither."""

import json

import numpy as np
import pytest
from pyproj import Geod

from auvplan.errors import AuvplanError
from auvplan.link.notices import CurrentNotice, GoneNotice, NoticeFile, ObstacleNotice
from auvplan.site import Site

SITE = Site(148.96, -20.34)


def stated(tmp_path, *lines):
    path = tmp_path / "notices.jsonl"
    path.write_text("".join(f"{line if isinstance(line, str) else json.dumps(line)}\n" for line in lines))
    return list(NoticeFile(path, SITE).read())


def test_obstacles_by_place_and_by_metres(tmp_path):
    first, second = stated(
        tmp_path,
        {
            "obstacle": "ferry",
            "longitude": 148.97,
            "latitude": -20.34,
            "radius": 80,
            "course": 90,
            "speed": 3,
        },
        {"obstacle": "buoy", "north": 100, "east": -50, "radius": 5, "depth_max": 12},
    )
    assert isinstance(first, ObstacleNotice)
    assert first.obstacle.position == pytest.approx((0.0, 1044.0), abs=2.0)
    there = Geod(ellps="WGS84").fwd(148.97, -20.34, 90.0, 300.0)[:2]
    assert first.obstacle.after(100.0).position == pytest.approx(SITE.to_local(*there), abs=1e-3)
    assert isinstance(second, ObstacleNotice)
    assert (second.obstacle.position, second.obstacle.depth_max) == ((100.0, -50.0), 12.0)


def test_courses_and_currents_count_from_true_north_at_places_in_degrees(tmp_path):
    place = {"longitude": 149.96, "latitude": -20.34}
    obstacle = {"obstacle": "ship", "radius": 5, "course": 180, "speed": 2}
    ship, current, still = stated(
        tmp_path, obstacle | place, {"current": [-2, 0, 0.1]} | place, obstacle | {"north": 0, "east": 1e5}
    )
    ends = (SITE.to_local(149.96, -20.34 + step) for step in (0.0, -1e-4))
    way = np.subtract(*reversed(list(ends)))
    velocity = 2.0 * way / np.hypot(*way)
    assert isinstance(ship, ObstacleNotice)
    assert ship.obstacle.velocity == pytest.approx(velocity, abs=1e-5)
    assert isinstance(current, CurrentNotice)
    assert current.velocity == pytest.approx([*velocity, 0.1], abs=1e-5)
    assert isinstance(still, ObstacleNotice)
    assert still.obstacle.velocity == pytest.approx((-2.0, 0.0))


def test_currents_here_and_elsewhere(tmp_path):
    here, there = stated(
        tmp_path, {"current": [0.4, -0.1]}, {"current": [0, 0, 0.1], "north": 5, "east": 6, "depth": 7}
    )
    assert isinstance(here, CurrentNotice)
    assert here.position is None
    assert here.velocity == pytest.approx([0.4, -0.1, 0.0])
    assert isinstance(there, CurrentNotice)
    assert there.position == pytest.approx([5.0, 6.0, 7.0])


def test_what_is_gone_goes_by_its_name(tmp_path):
    (gone,) = stated(tmp_path, {"gone": "ferry"})
    assert gone == GoneNotice("ferry")


def test_fields_that_are_not_read_are_named_once(tmp_path):
    ferry = {"obstacle": "ferry", "north": 1, "east": 2, "radius": 3, "velocity": [1, 0]}
    found = stated(tmp_path, ferry, ferry | {"mmsi": 7}, {"gone": "ferry", "north": 1})
    assert [type(notice) for notice in found] == [ObstacleNotice, str, ObstacleNotice, str, GoneNotice, str]
    first, second, third = (notice for notice in found if isinstance(notice, str))
    assert "line 1: not read: velocity; obstacle has longitude" in first
    assert "line 2: not read: mmsi;" in second
    assert "line 3: not read: north; gone has none" in third


def test_the_file_is_read_on_by_whole_lines(tmp_path):
    path = tmp_path / "notices.jsonl"
    path.write_text("")
    notices = NoticeFile(path, SITE)
    assert list(notices.read()) == []
    with path.open("a") as file:
        file.write('{"current": [1, 0]}\n{"current"')
    assert len(list(notices.read())) == 1
    with path.open("a") as file:
        file.write(": [0, 1]}\n")
    (found,) = notices.read()
    assert isinstance(found, CurrentNotice)
    assert np.asarray(found.velocity) == pytest.approx([0.0, 1.0, 0.0])


def test_a_file_that_was_away_is_read_from_its_beginning(tmp_path):
    path, line = tmp_path / "notices.jsonl", '{"current": [1, 0]}\n'
    path.write_text(line)
    notices = NoticeFile(path, SITE)
    assert len(list(notices.read())) == 1
    path.unlink()
    assert len(list(notices.read())) == 1, "that it is away"
    path.write_text(line)
    assert isinstance(next(notices.read()), CurrentNotice)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("not json", "line 1"),
        ({}, "one of 'obstacle', 'current', 'gone'"),
        ({"current": [0, 1], "obstacle": "x"}, "one of"),
        ({"current": 3}, "must be [north, east]"),
        ({"current": [99, 0]}, "from -10 to 10"),
        ({"obstacle": "x", "radius": 5}, "needs longitude and latitude"),
        ({"obstacle": "x", "radius": 5, "north": 1, "east": 2, "longitude": 3, "latitude": 4}, "not both"),
        ({"obstacle": "x", "radius": 5, "north": 1, "east": 2, "speed": 3}, "course: is missing"),
        ({"obstacle": "x", "north": 0, "east": 0}, "radius: is missing"),
        ({"obstacle": "x", "north": 0, "east": 0, "radius": -5}, "radius: must be from"),
        ({"obstacle": "x", "north": 0, "east": 0, "radius": 5, "depth_min": 9, "depth_max": 3}, "is above"),
        ({"obstacle": "x", "north": 0, "east": 0, "radius": float("inf")}, "radius: must be from"),
        ({"obstacle": "x", "longitude": 500, "latitude": 0, "radius": 5}, "longitude: must be from"),
        ('{"current": [NaN, 0]}', "must be a number"),
        ({"current": [10**400, 0]}, "line 1"),
        ({"current": ["9" * 9000, 0]}, "must be a number"),
        ('{"current": ' + "9" * 9000 + "}", "line 1"),
        ("[" * 100_000, "line 1"),
    ],
)
def test_what_cannot_be_understood_is_one_line_of_text(tmp_path, line, words):
    (found,) = stated(tmp_path, line)
    assert isinstance(found, str)
    assert words in found
    assert "\n" not in found
    assert len(found) < 600


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(AuvplanError, match="create it empty"):
        NoticeFile(tmp_path / "none", SITE)


def test_a_file_that_goes_and_comes_back_is_told_of_once_and_read_anew(tmp_path):
    path = tmp_path / "notices.jsonl"
    path.write_text('{"current": [1, 0]}\n{"current": [1, 0]}\n')
    notices = NoticeFile(path, SITE)
    assert len(list(notices.read())) == 2
    path.unlink()
    (said,) = notices.read()
    assert isinstance(said, str)
    assert list(notices.read()) == []
    path.write_text('{"current": [0, 1]}\n')
    (found,) = notices.read()
    assert isinstance(found, CurrentNotice)


def test_names_are_one_line_and_folders_are_refused(tmp_path):
    (found,) = stated(tmp_path, {"obstacle": "a\x1b[2J\nb", "north": 0, "east": 0, "radius": 5})
    assert isinstance(found, ObstacleNotice)
    assert found.obstacle.name == "a [2J b"
    with pytest.raises(AuvplanError, match="is no file of lines"):
        NoticeFile(tmp_path, SITE)
