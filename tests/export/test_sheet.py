"""The mission sheet: coast and closed areas apart, land beyond the area, and what was assumed."""

import json
import re
from dataclasses import replace
from datetime import UTC, datetime
from itertools import pairwise

import jax
import numpy as np
import pytest
import shapely
from matplotlib.figure import Figure
from matplotlib.text import Text

from auvplan.check.run import check_run
from auvplan.errors import ScenarioWarning
from auvplan.export import export_notes, itinerary_of
from auvplan.io import save_run
from auvplan.io.area import load_area
from auvplan.io.examine import examine_scenario
from auvplan.io.restore import restore_run
from auvplan.mission import MissionGraph, plan_mission
from auvplan.mission.jobs import JobLine, JobPoint, Jobs, jobs_done, jobs_graph, task_hours
from auvplan.mission.timetable import Timetable
from auvplan.ocean.chart import Chart
from auvplan.ocean.closures import Zone
from auvplan.plot.sheet import write_pdf
from auvplan.records import LegRecord, MissionRun, RouteRecord
from auvplan.report.run import run_data
from auvplan.runtime.formatting import clearance, hours
from auvplan.scenario.file import load_scenario
from auvplan.scenario.provenance import SourceFile
from auvplan.scenario.scenario import Scenario
from auvplan.site import Site
from auvplan.vehicle import Vehicle
from auvplan.view.sheet import LeftOut, sheet_of, write_html
from auvplan.view.timeline import spans_in_words
from tests.io.sample_run import SPEED, at_speeds, make_run
from tests.mission.naive import BARE

SITE = Site(147.4, -43.06, datetime(2026, 3, 1, 20, 30, tzinfo=UTC))
BAY = """\
site: {longitude: 147.4, latitude: -43.06, departure: 2026-03-01T20:30:00Z, timezone: Australia/Hobart}
area: {lower: [-1000, -1000, 0], upper: [1000, 1000, 30]}
chart: {source: polygons, file: coast.geojson, pixel_size: 10, accuracy: 300, no_go: closed.geojson}
current: {source: vortices, vortices: 0, forecast_error: 0}
safety: {coast: 200}
mission: {jobs: jobs.geojson, start: [0, 0, 5], goal: [100, 100, 5], time_available: 7200}
"""


def polygon(low, high, **stated):
    north, east = ((low[0], low[0], high[0], high[0], low[0]), (low[1], high[1], high[1], low[1], low[1]))
    ring = np.stack(SITE.to_geographic(np.asarray(north), np.asarray(east)), axis=-1).tolist()
    return {"type": "Feature", "properties": stated, "geometry": {"type": "Polygon", "coordinates": [ring]}}


def point(place, **stated):
    at = [float(axis) for axis in SITE.to_geographic(*map(float, place))]
    return {"type": "Feature", "properties": stated, "geometry": {"type": "Point", "coordinates": at}}


def write(folder, name, *features):
    (folder / name).write_text(json.dumps({"type": "FeatureCollection", "features": features}))


@pytest.fixture
def bay(tmp_path):
    """Land 33 m east of the area, a closed area in open water, and a job in the east."""
    (tmp_path / "scenario.yaml").write_text(BAY)
    write(tmp_path, "coast.geojson", polygon((-3000, 1033), (3000, 3000)))
    write(tmp_path, "closed.geojson", polygon((-600, -600), (-300, -200), name="range"))
    write(tmp_path, "jobs.geojson", point((0, 700), name="near"))
    return tmp_path


def test_a_job_too_near_to_land_beyond_the_edge_is_refused_in_degrees(bay):
    write(bay, "jobs.geojson", point((0, 950), name="near"), point((0, 0), name="on land"))
    write(bay, "coast.geojson", polygon((-3000, 1033), (3000, 3000)), polygon((-50, -50), (50, 50)))
    lines = examine_scenario(bay / "scenario.yaml").lines
    longitude, _ = SITE.to_geographic(0.0, 950.0)
    assert any(f"'near' at longitude {float(longitude):.5f}, latitude -43.0600" in line for line in lines)
    assert any("m from the coast: safety.coast asks for 200 m" in line for line in lines)
    assert any("'on land' at longitude 147.40000" in line and "lies on land" in line for line in lines)


def test_a_job_a_few_decimetres_too_near_to_the_coast_is_not_said_to_be_as_far_as_is_asked(bay):
    write(bay, "coast.geojson", polygon((-3000, 1150), (3000, 3000)))
    found = []
    for east in np.arange(944.0, 948.0, 0.4):
        write(bay, "jobs.geojson", point((0, east), name="near"))
        for line in examine_scenario(bay / "scenario.yaml").lines:
            found.append(re.search(r"lies (\S+) m from the coast: safety.coast asks for (\S+) m", line))
    assert 2 < len(found) < 9
    assert all(float(away[1]) < float(away[2]) == 200.0 for away in found)


def test_coast_and_closed_areas_are_different_things_and_land_beyond_the_area_is_as_near_as_it_is(bay):
    assert examine_scenario(bay / "scenario.yaml").lines == []
    area = load_area(load_scenario(bay / "scenario.yaml"))
    assert [zone.name for zone in area.zones] == ["range"]
    inside = (-450.0, -400.0)
    assert not area.chart.is_water(*inside)
    assert area.coast.is_water(*inside)
    assert area.coast.is_water(0.0, 1020.0)
    assert not area.coast.is_water(0.0, 1100.0)
    assert area.chart.shape == (200, 200)
    for east in (400.0, 700.0, 990.0):
        away = float(area.chart.distance(900.0, east))
        assert 1033.0 - east - 20.0 <= away <= 1033.0 - east


def bay_run(bay):
    """The made run of three legs, by a coast east of it and a closed area north of it."""
    run = make_run()
    settings = Scenario().model_dump(mode="json")
    settings["site"] = {"longitude": 147.4, "latitude": -43.06, "timezone": "Australia/Hobart"}
    settings["chart"] |= {"accuracy": 300.0}
    run.scenario, run.site = settings, SITE
    places = np.concatenate([leg.positions for leg in run.legs])
    low, high = places.min(axis=0)[:2], places.max(axis=0)[:2]
    shape = tuple(np.ceil((high - low) / 20.0).astype(int) + 100)
    passability = np.ones(shape, np.float32)
    corner = tuple((low - 1000.0).tolist())
    run.chart = Chart.from_passability(passability, 20.0, corner)
    beyond = np.ones((shape[0] + 100, shape[1] + 100), np.float32)
    beyond[:, -60:] = 0.0
    run.coast = Chart.from_passability(beyond, 20.0, (corner[0] - 1000.0, corner[1] - 1000.0))
    run.zones = (Zone("range", shapely.box(high[0] + 150.0, low[1], high[0] + 400.0, high[1])),)
    run.assumed = ("no sea bed is known",)
    run.__dict__.pop("coast_reach", None)
    return run, corner[1] - 1000.0 + 20.0 * (beyond.shape[1] - 60)


def test_one_clearance_has_one_value_on_sheet_page_and_in_the_checker(bay, tmp_path):
    run, shore = bay_run(bay)
    sheet = sheet_of(run)
    fine = np.concatenate([np.linspace(a, b, 50) for leg in run.done for a, b in
                           zip(leg.positions[:-1], leg.positions[1:], strict=True)])  # fmt: skip
    expected = min(shore - fine[:, 1].max(), run.coast_reach)
    least = min(stop.coast for stop in sheet.stops)
    assert least == pytest.approx(expected, abs=0.01)
    away = shapely.distance(run.zones[0].polygon, shapely.linestrings(fine[:, :2]))
    assert min(stop.closed for stop in sheet.stops) == pytest.approx(away, abs=0.01)
    plain = sheet.plain()
    folder = save_run(run, tmp_path / "run", sheet=plain)
    again = sheet_of(restore_run(folder))
    for one, other in zip(sheet.stops, again.stops, strict=True):
        assert (one.coast, one.closed) == pytest.approx((other.coast, other.closed), abs=0.01)
    data = run_data(restore_run(folder), run.summary() | {"sheet": plain})
    limits = {row["name"]: row["least"] for row in data["limits"]}
    assert limits["coast"] == pytest.approx(least, abs=0.01)
    assert [closed["name"] for closed in data["closures"]] == ["range"]
    report = check_run(folder)
    assert report.coast_clearance == pytest.approx(least, abs=0.01)
    near = [stop.obstacle for stop in sheet.stops if stop.obstacle is not None]
    assert report.obstacle_clearance == pytest.approx(min(near), abs=0.01)


def test_no_distance_is_stated_finer_than_it_is_known(bay):
    run, _ = bay_run(bay)
    headings, rows = sheet_of(run).table()
    column = headings.index("coast, m")
    for row in rows:
        value = row[column].strip("<> ").replace(",", "")
        assert row[column].startswith(">") or float(value) % 300.0 == 0.0
    assert clearance(3640.0, 1000.0) == "3,000"


def test_places_times_and_priorities_are_on_the_sheet(bay):
    run, _ = bay_run(bay)
    run.simulated, run.legs[0].priority = False, 2.85391
    sheet = sheet_of(run)
    headings, rows = sheet.table()
    assert rows[1][headings.index("leg, s")] == f"{run.legs[0].t_path:,.0f}"
    longitude, latitude = SITE.to_geographic(*np.asarray(run.graph.positions[run.start], float)[:2])
    assert rows[0][headings.index("latitude, longitude")] == f"{float(latitude):.5f}, {float(longitude):.5f}"
    assert rows[1][headings.index("priority")] == "2.85"
    assert sheet.facts["departure"] == "2026-03-01 20:30 UTC, 2026-03-02 07:30 Hobart"
    assert "Hobart" in sheet.facts["arrival"]


def test_what_was_assumed_stands_everywhere(bay, tmp_path):
    (bay / "scenario.yaml").write_text(BAY.replace("20:30:00Z", "20:30:00"))
    with pytest.warns(ScenarioWarning, match="no zone of time"):
        area = load_area(load_scenario(bay / "scenario.yaml").with_({"vehicle.speed": 1.5}))
    assert any("no zone of time" in note for note in area.notes)
    assert any("good to 300 m at best: no chart for navigation" in note for note in area.notes)
    assert any("no sea bed is known" in note for note in area.notes)
    run, _ = bay_run(bay)
    sheet = sheet_of(run)
    assert "no sea bed is known" in write_html(sheet, tmp_path / "sheet.html").read_text()
    assert "no sea bed is known" in sheet.plain()["assumed"]
    run.simulated = False
    assert any("no sea bed is known" in note for note in export_notes(itinerary_of(run), ["kml"]))


def test_limits_in_the_vertical_are_stated_beside_the_steepest_way():
    run = make_run()
    run.site = SITE
    steepest = max(float(np.degrees(np.abs(leg.motion.pitch).max())) for leg in run.legs)
    fact = f"up to {steepest:.0f} degrees steep"
    assert sheet_of(run).facts["in depth"] == f"{fact}; the vehicle's limits: 30 degrees"
    assert not any("no file carries" in note for note in itinerary_of(run).notes)
    run.vehicle = Vehicle(pitch_max=None, dive_rate_max=0.5)
    assert sheet_of(run).facts["in depth"] == f"{fact}; the vehicle's limits: dives of 0.5 m/s"
    run.scenario["vehicle"] = {"dive_rate_max": 0.5}
    assert any("no file carries dive_rate_max 0.5 m/s" in note for note in itinerary_of(run).notes)
    run.vehicle = Vehicle(pitch_max=None)
    assert sheet_of(run).facts["in depth"] == fact


def test_the_speed_of_each_leg_is_on_the_sheet_where_it_has_its_own(tmp_path):
    speeds = (2.0, None, 3.0)
    run = at_speeds(make_run(), speeds)
    sheet = sheet_of(run)
    assert sheet.facts["speed"] == "2.00 to 3.00 m/s through the water"
    headings, rows = sheet.table()
    assert [row[headings.index("through water, m/s")] for row in rows] == ["", "2.00", "2.50", "3.00"]
    assert "2.00 to 3.00 m/s" in write_html(sheet, tmp_path / "sheet.html").read_text()
    assert [stop.get("speed") for stop in sheet.plain()["stops"]] == [None, 2.0, 2.5, 3.0]
    data = run_data(run, run.summary())
    assert [leg["speed"] for leg in data["legs"]] == [2.0, 2.5, 3.0]
    assert not any("speed" in leg for leg in run_data(make_run(), make_run().summary())["legs"])
    # Over ground it is slow where it makes little of the leg's own speed, not of the vehicle's.
    assert not any("speed over ground falls" in line for line in sheet.warnings)
    slow = at_speeds(make_run(), (0.5, None, 3.0))
    assert not any("speed over ground falls" in line for line in sheet_of(slow).warnings)
    slow.legs = [replace(leg, speed=None) for leg in slow.legs]
    assert any("speed over ground falls to 0.5 m/s" in line for line in sheet_of(slow).warnings)


def test_without_speeds_of_their_own_nothing_is_said_of_them():
    sheet = sheet_of(make_run())
    assert "speed" not in sheet.facts
    assert "through water, m/s" not in sheet.table()[0]
    assert not any("speed" in stop for stop in sheet.plain()["stops"])
    alike = sheet_of(at_speeds(make_run(), (2.0, 2.0, 2.0)))
    assert alike.facts["speed"] == "2.00 m/s through the water"


def timed_mission(points, lines):
    """A mission by the clock in open water that has its first route alone."""
    graph, names = jobs_graph(points, lines, [0.0, 0.0, 5.0], [0.0, 900.0, 5.0])
    still = graph.leg_times(SPEED) - graph.duration
    graph = graph.with_timetable(Timetable(np.zeros(1), still[None], **task_hours(points, lines, graph.size)))
    goal = graph.size - 1
    how = {"method": "exact", "config": BARE}
    first = plan_mission(graph, 0, goal, 9000.0, speed=SPEED, key=jax.random.key(0), **how)
    run = MissionRun({}, 0, Vehicle(speed=SPEED), graph, None, 0, goal, 9000.0, names=names)
    run.jobs, run.first_route = Jobs(tuple(points), tuple(lines)), first
    return run


def test_a_job_in_whose_window_the_route_could_be_is_left_out_for_the_window_that_it_then_misses():
    """Job b is in time alone before a, and a alone before b."""
    closes = 620.0 / SPEED
    b_then_a = (600.0 + float(np.hypot(600.0, 600.0))) / SPEED
    points = [
        JobPoint("a", (0.0, 600.0, 5.0), 4.0, windows=((0.0, closes),)),
        JobPoint("b", (600.0, 0.0, 5.0), 3.0, windows=((0.0, closes),)),
    ]
    run = timed_mission(points, [])
    assert np.asarray(run.first_route.nodes).tolist() == [0, 1, 3]
    reasons = {job.name: job.reason for job in sheet_of(run).left_out}
    late, window = hours(b_then_a - closes), f"0 h 00 min-{hours(closes)}"
    assert reasons["b"].endswith(f"the first route comes to a {late} too late for its window, {window}")


def test_a_line_of_several_parts_is_left_out_for_its_window():
    places = (900.0, 0.0, 5.0), (900.0, 300.0, 5.0), (1200.0, 300.0, 5.0)
    line = JobLine("l", places, 4.0, windows=((60.0, 180.0),))
    point = JobPoint("a", (0.0, 600.0, 5.0), 1.0)
    reasons = {job.name: job.reason for job in sheet_of(timed_mission([point], [line])).left_out}
    window = "its window is 0 h 01 min-0 h 03 min"
    assert reasons["l"] == f"{window}: from no place of the first route on can all of it be done then"


def failed_mission(time_available):
    """A mission in open water with jobs a (east) and b (far in the east), that has its first route alone."""
    points = [JobPoint("a", [0.0, 600.0, 5.0], 3.0, 60.0), JobPoint("b", [0.0, 2000.0, 5.0], 4.0, 60.0)]
    graph, names = jobs_graph(points, [], [0.0, 0.0, 5.0], [900.0, 0.0, 5.0])
    first = plan_mission(graph, 0, 3, time_available, speed=SPEED, key=jax.random.key(0), method="exact")
    run = MissionRun({}, 0, Vehicle(speed=SPEED), graph, None, 0, 3, time_available, names=names)
    run.jobs = Jobs(tuple(points))
    run.first_route, run.t_mission, run.reason = first, time_available, "time ran out"
    figures = float(first.time), float(first.priority), 0.1
    run.routes = [RouteRecord(0.0, np.asarray(first.nodes).tolist(), *figures, "start")]
    return run


def test_what_a_failed_mission_left_out_is_compared_with_its_first_route():
    run = failed_mission(500.0)
    assert run.routes[0].nodes == [0, 3]
    reasons = {job.name: job.reason for job in sheet_of(run).left_out}
    ways = {"a": 600.0 + float(np.hypot(600.0, 900.0)), "b": 2000.0 + float(np.hypot(2000.0, 900.0))}
    for name, way in ways.items():
        seconds = way / SPEED + 60.0
        assert f"the first route takes {hours(seconds)}, {hours(500.0)} are available" in reasons[name]
        needed = float(re.search(r"(\d+) s would do", reasons[name])[1])
        assert needed == pytest.approx(seconds, rel=1e-3)
        assert name in jobs_done(run.jobs, pairwise(failed_mission(1.01 * needed).routes[0].nodes))


def test_a_refused_plan_has_no_arrival_and_depths_are_no_shallower_than_they_are():
    run = failed_mission(500.0)
    facts = sheet_of(run).facts
    assert {"arrival", "time", "time left", "at the end", "length"}.isdisjoint(facts)
    assert facts["time available"] == "0 h 08 min (500 s)"
    run = make_run()
    assert {"arrival", "time", "time left", "at the end", "length"} <= set(sheet_of(run).facts)
    deep = np.array(run.graph.positions, float)
    deep[run.start, 2], deep[run.legs[0].goal, 2] = 2.5, 12.5
    run.graph = replace(run.graph, positions=deep)
    for brief in (True, False):
        headings, rows = sheet_of(run).table(brief=brief)
        column = headings.index("depth" if brief else "depth, m")
        assert [row[column].removesuffix(" m") for row in rows[:2]] == ["2.5", "13"]


def test_what_a_failed_mission_had_on_its_route_was_left_out_under_way_or_time_ran_out_before_it():
    run = failed_mission(3000.0)
    assert set(run.routes[0].nodes) == {0, 1, 2, 3}
    assert {job.reason for job in sheet_of(run).left_out} == {"the mission ended before it: time ran out"}
    run.routes.append(RouteRecord(0.0, [0, 1, 3], 100.0, 3.0, 0.1, "refused"))
    run.legs = [LegRecord(0, 2, 860.0, 60.0, 4.0, refused="its path is too long")]
    reasons = {job.name: job.reason for job in sheet_of(run).left_out}
    assert reasons["a"] == "the mission ended before it: time ran out"
    assert reasons["b"].endswith("without it: the leg from start was refused, its path is too long")
    run.legs, run.routes[1].cause = [], "late"
    reasons = {job.name: job.reason for job in sheet_of(run).left_out}
    assert reasons["b"].endswith("without it: a leg took longer than expected")


def test_of_hours_those_that_touch_the_mission_are_stated_with_their_date_on_other_days():
    run, day = make_run(), 86400.0
    run.site, run.t_available = SITE, 7200.0  # 20:30 to 22:30 UTC on 1 March
    daily = [(k * day + 3600.0, k * day + 5400.0) for k in range(-20, 4)]
    assert spans_in_words(run, daily) == "21:30-22:00"
    assert spans_in_words(run, daily[:20] + daily[21:]) == "2026-02-28 21:30-22:00, 2026-03-02 21:30-22:00"
    night = [(k * day + 5400.0, k * day + 5.5 * 3600.0) for k in range(-20, 4)]
    assert spans_in_words(run, night) == "22:00-2026-03-02 02:00"
    run.t_available = day + 7200.0
    words = "2026-02-28 22:00-2026-03-01 02:00"
    assert spans_in_words(run, [(-day + 5400.0, 0.0 - 66600.0)]) == words
    assert spans_in_words(run, night) == "22:00-2026-03-02 02:00, 2026-03-02 22:00-2026-03-03 02:00"
    assert spans_in_words(run, [(-np.inf, 3600.0), (5400.0, np.inf)]) == "-21:30, 22:00-"
    assert spans_in_words(run, [*daily, (-np.inf, np.inf)]) == ""
    run.site = replace(SITE, epoch=None)
    assert spans_in_words(run, daily[20:21]) == "1 h 00 min-1 h 30 min"


def test_times_of_the_sheet_are_rounded_to_the_second():
    run = make_run()
    run.site = SITE
    leg = run.legs[0]
    end = float(np.ceil(leg.times[-1])) + 0.75
    run.legs[0] = replace(leg, times=np.append(leg.times[:-1], end), t_task=60.5)
    headings, rows = sheet_of(run).table()
    moment = SITE.utc(end + 0.25)
    assert rows[1][headings.index("UTC")] == f"{moment:%H:%M:%S}"
    assert sheet_of(run).plain()["stops"][1]["utc"] == f"{moment:%Y-%m-%dT%H:%M:%SZ}"
    assert rows[1][headings.index("hold, s")] == "61"
    brief, cells = sheet_of(run).table(brief=True)
    assert (cells[1][brief.index("UTC")], cells[1][brief.index("hold")]) == (f"{moment:%H:%M:%S}", "61 s")


def test_the_ends_of_a_mission_of_two_waypoints_are_called_the_same_on_sheet_and_page():
    run = make_run((0, 1))
    small = MissionGraph(*(part[:2] for part in (run.graph.positions, run.graph.adjacency[:, :2])),
                         run.graph.priority[:2, :2], run.graph.duration[:2, :2])  # fmt: skip
    run.graph = small
    names = [stop.name for stop in sheet_of(run).stops]
    data = run_data(run, run.summary())
    assert [waypoint["name"] for waypoint in data["waypoints"]] == names == ["start", "goal"]
    assert next(words for _, words in data["doing"]) == "leg 1: start → goal"
    more = run_data(make_run(), make_run().summary())
    assert [waypoint["name"] for waypoint in more["waypoints"]] == ["0", "1", "2", "3"]


def overlaps(page):
    """How deep texts on a page lie in each other or beyond its edges at most, points."""
    page.set_dpi(72.0)
    texts = [text for text in page.findobj(Text) if text.get_text()]
    boxes = np.array([text.get_window_extent().extents for text in texts])
    shared = np.minimum(boxes[:, None, 2:], boxes[None, :, 2:]) - np.maximum(
        boxes[:, None, :2], boxes[None, :, :2]
    )
    deep = shared.min(axis=-1)
    np.fill_diagonal(deep, 0.0)
    return max(deep.max(), -boxes[:, :2].min(), (boxes[:, 2:] - page.bbox.size).max())


def test_a_long_sheet_prints_on_pages_on_which_no_text_lies_on_another(tmp_path, monkeypatch):
    pages, savefig = [], Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (pages.append(self), savefig(self, *a, **k)))
    sheet = sheet_of(make_run())
    write_pdf(sheet, tmp_path / "short.pdf")
    assert len(pages) == 1
    assert overlaps(pages[0]) < 1.0
    pages.clear()
    lines = "; ".join(f"line {k}: 800 of 800 m" for k in range(300))
    long = replace(
        sheet,
        facts=sheet.facts | {"survey lines": lines},
        stops=sheet.stops * 30,
        left_out=tuple(LeftOut(f"job {k}", 1.0, "no way leads there " * (k % 20)) for k in range(60)),
        assumed=tuple(f"assumption {k}" for k in range(70)),
        files=tuple(SourceFile("chart.file", f"tile {k}.nc", 1, "0" * 64) for k in range(40)),
    )
    write_pdf(long, tmp_path / "long.pdf")
    assert len(pages) > 5
    assert max(overlaps(page) for page in pages) < 1.0
    words = " ".join(" ".join(text.get_text() for page in pages for text in page.findobj(Text)).split())
    assert words.count("line ") == 300
    assert words.count("(priority 1)") == 60
    assert all(f"page {number} of {len(pages)}" in words for number in range(1, len(pages) + 1))
