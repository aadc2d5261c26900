"""Jobs from GeoJSON and CSV."""

import numpy as np
import pytest

from auvplan.errors import ScenarioWarning
from auvplan.io.geo import GeoError, read_jobs
from auvplan.site import Site
from tests.io.geo.files import feature, geographic, write_geojson, written
from tests.io.refusals import refusal

SITE = Site(148.96, -20.34, origin=(700.0, -300.0))
#: North, east, down, m.
A, B, C, D = (1200.0, 350.0, 12.0), (-40.0, 2210.0, 30.0), (3100.0, -900.0, 5.0), (2950.0, -400.0, 8.0)


def lonlat(place):
    return geographic(place[0], place[1], SITE).tolist()


def close(found, expected):
    np.testing.assert_allclose(found, expected, atol=1e-3)


def test_geojson(tmp_path):
    path = write_geojson(
        tmp_path / "jobs.geojson",
        feature("Point", lonlat(A), depth=12, priority=3, duration=60, name="reef"),
        feature("Point", [*lonlat(B), -30.0]),
        feature("LineString", [lonlat(C), lonlat(D)], Depth="7.5", PRIORITY=2, duration=100.0, colour="red"),
        feature("MultiPoint", [lonlat(A), [*lonlat(D), -8.0]], name="sample", priority=0),
        feature("Point", [*lonlat(B), -30.0], depth=30, name=17),
    )
    jobs = read_jobs(path, SITE, default_depth=4.0)
    assert [job.name for job in jobs.points] == ["reef", "2", "sample 1", "sample 2", "17"]
    close([job.position for job in jobs.points], [A, B, (*A[:2], 4.0), D, B])
    assert [(job.priority, job.duration) for job in jobs.points] == [(3, 60), (1, 0), (0, 0), (0, 0), (1, 0)]
    (line,) = jobs.lines
    assert (line.name, line.priority, line.duration) == ("3", 2.0, 100.0)
    close(line.positions, [(*C[:2], 7.5), (*D[:2], 7.5)])


def test_greatest_error_on_arrival(tmp_path):
    own = (
        feature("Point", lonlat(A), max_error=15),
        feature("LineString", [lonlat(C), lonlat(D)], max_error="8"),
    )
    jobs = read_jobs(write_geojson(tmp_path / "jobs.geojson", *own, feature("Point", lonlat(B))), SITE)
    assert [job.max_error for job in (*jobs.points, *jobs.lines)] == [15.0, None, 8.0]
    table = written(tmp_path / "jobs.csv", "longitude,latitude,depth,max_error\n" + rows(A) + ",20\n")
    assert read_jobs(table, SITE).points[0].max_error == 20.0
    with pytest.raises(GeoError, match=r"row 2: max_error must be at least 0, got -3"):
        read_jobs(written(table, "longitude,latitude,depth,max_error\n" + rows(A) + ",-3\n"), SITE)


def rows(*places):
    return "\n".join(",".join(f"{c:.9f}" for c in (*lonlat(p), p[2])) for p in places)


def test_csv_by_longitude_and_latitude(tmp_path):
    path = written(tmp_path / "jobs.csv", "\ufeffLongitude,LAT,Depth\n" + rows(A, B) + "\n\n")
    jobs = read_jobs(path, SITE)
    close([job.position for job in jobs.points], [A, B])
    assert [(job.name, job.priority, job.duration) for job in jobs.points] == [("1", 1, 0), ("2", 1, 0)]
    assert jobs.lines == ()


@pytest.mark.parametrize("site", [SITE, None])
@pytest.mark.parametrize("heads", ["North;East", "NORTH ; east"])
def test_csv_in_local_metres_with_lines(tmp_path, site, heads):
    path = tmp_path / "jobs.csv"
    path.write_text(
        f"name;{heads};line;priority;duration;Remark;depth\n"
        "reef, west;1200,5;350;;3;60;seen;12\n"
        ";10;20;survey;2;;;5\n"
        ";10;120;survey;;90;;6\n"
        ";-30;120;survey;2;90;;\n"
        ";1;2;;0;;;\n"
        ";0;0;second;;;;\n"
        ";0;1e2;second;;;;\n"
    )
    jobs = read_jobs(path, site, default_depth=2.0)
    assert [job.name for job in jobs.points] == ["reef, west", "3"]
    close([job.position for job in jobs.points], [(1200.5, 350, 12), (1, 2, 2)])
    assert [(job.priority, job.duration) for job in jobs.points] == [(3, 60), (0, 0)]
    found = [(job.name, job.priority, job.duration) for job in jobs.lines]
    assert found == [("survey", 2, 90), ("second", 1, 0)]
    close(jobs.lines[0].positions, [(10, 20, 5), (10, 120, 6), (-30, 120, 2)])


BY_DEGREES = "lon,lat,depth\n"
#: Tables, and what is said of them.
TABLES = [
    ("", "has no rows of jobs"),
    ("north,east\n", "has no rows of jobs"),
    ("north,depth\n1,2\n",
     "needs the columns longitude and latitude, or north and east; it has north, depth"),
    ("north,east,lon,lat\n1,2,3,4\n", "needs the columns longitude and latitude, or north and east"),
    ("easting,northing,depth\n495000,7750000,5\n", "needs the columns"),
    ("x,north,east\n1,2,3\n", "two columns map to north"),
    ("north,east,priorty\n1,2,3\n", "unknown name 'priorty', did you mean 'priority'"),
    ("north,east,depth [m]\n1,2,3\n", r"unknown name 'depth \[m\]', did you mean 'depth' \(m, positive"),
    ("north,east,duration_min\n1,2,3\n", r"unknown name 'duration_min', did you mean 'duration' \(s\)"),
    ("north,east\n1,2\n3\n", "row 3: east is missing"),
    ("north,east\n1,2,3\n", "row 2: has 3 cells under 2 headings"),
    ("north,east\n1,2\n\nthree,4\n", "row 4: north must be a finite number, got 'three'"),
    ("north,east,depth\n1,2,-5\n", "row 2: depth must be at least 0, got -5"),
    ("lon,lat\n400,2\n", r"row 2: \(400, 2\) is no longitude"),
    ("lon,lat\n148 57.6 E,20 20.4 S\n", "row 2: lon must be a finite number of degrees such as"),
    (f"{BY_DEGREES}-20.3,148.9,5\n-20.4,148.9,5\n", r"row 2: .* swapped \(so in all 2 places of the file\)"),
    (f"{BY_DEGREES}148.9,-20.3,5\n-20.4,148.9,5\n", "row 3: .* longitude and latitude seem swapped$"),
    ("x,y\n148.96,-20.34\n148.965,-20.35\n", "columns x and y are metres .* look like longitude"),
    ("north,east\n-20.35,148.96\n", "are metres from the site, but look like latitude and longitude"),
    ("north,east,name\n1,2,a\n3,4,a\n", "two jobs are named 'a'"),
    ("north,east,name,line\n1,2,a,\n3,4,,a\n5,6,,a\n", "two jobs are named 'a'"),
    ("north,east,line\n1,2,a\n", "line 'a': needs at least 2 positions, got 1"),
    ("north,east,line\n1,2,a\n1,2,a\n", "line 'a': positions 1 and 2 are the same place"),
    ("north,east,line\n1,2,a\n3,4,a\n5,6,b\n7,8,b\n9,9,a\n", "row 6: line 'a' goes on after other rows"),
    ("north,east,line,priority\n1,2,a,1\n3,4,a,2\n",
     "row 3: line 'a' has priority 1 in an earlier row, 2 in this"),
]  # fmt: skip
#: Features, and what is said of them.
FEATURES = [
    (feature("Point", [148, -20, -5], depth=6), "feature 1: depth 6 m contradicts the elevation -5 m"),
    (feature("Point", [148, -20, 5]), "feature 1: elevation 5 m is above the sea"),
    (feature("Point", [148, -20], depth="deep"), "feature 1: depth must be a finite number, got 'deep'"),
    (feature("Point", [148, -20], priority=True), "feature 1: priority must be a finite number"),
    (feature("Point", [148]), r"feature 1: \[148\] is no position"),
    (feature("Point", [148, -100]), "feature 1: .* is no longitude"),
    (feature("MultiPoint", []), "feature 1: needs at least 1 positions, got 0"),
    (feature("LineString", [[148, -20], [148, -20]]), "feature 1: positions 1 and 2 are the same place"),
    (feature("Polygon", [[[0, 0], [0, 1], [1, 1], [0, 0]]]),
     "feature 1: a Polygon, where Point or MultiPoint or"),
    (feature("Point", [148, -20, float("nan")]), "feature 1: .* is not finite"),
]  # fmt: skip


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
@pytest.mark.parametrize(("content", "words"), TABLES + FEATURES)
def test_jobs_that_are_refused(tmp_path, content, words):
    path = written(tmp_path / ("jobs.csv" if isinstance(content, str) else "jobs.geojson"), content)
    assert str(refusal(GeoError, words, read_jobs, path, SITE)).startswith(str(path))


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ("dwell", r"'dwell' is ignored: did you mean 'duration' \(s\)"),
        ("altitude", r"'altitude' is ignored: did you mean 'depth' \(m, positive down\)"),
        ("transect", "'transect' is ignored: did you mean 'line'"),
        ("deadline", "'deadline' is ignored: did you mean 'to'"),
        ("radius", "'radius' is ignored: jobs have a place, priority, duration, name and time windows alone"),
        ("x", "the columns x and y are read as metres north and east"),
    ],
)
def test_words_of_others_are_warned_of(tmp_path, heading, words):
    table = tmp_path / "jobs.csv"
    table.write_text("x,y\n1,2\n" if heading == "x" else f"north,east,{heading}\n1,2,3\n")
    with pytest.warns(ScenarioWarning, match=words):
        assert len(read_jobs(table, SITE).points) == 1


def test_places_on_earth_need_a_site(tmp_path):
    table = written(tmp_path / "j.csv", "lon,lat\n148,-20\n")
    refusal(GeoError, r"j\.csv: row 2: longitude and latitude need a site", read_jobs, table, None)
    refusal(GeoError, "default_depth must not be negative", read_jobs, table, SITE, default_depth=-1.0)


def test_a_slip_in_many_features_is_told_once_and_faults_of_each(tmp_path):
    places = [feature("Point", [148.0 + k, -20.0], prority=1, depth=-k) for k in range(4)]
    path = write_geojson(tmp_path / "jobs.geojson", *places)
    lines = refusal(GeoError, r"and 3 more: auvplan validate", read_jobs, path, SITE).lines
    assert len(lines) == 4
    (slip,) = [line for line in lines if "'prority'" in line]
    assert "feature 1" in slip


def test_another_word_is_told_of_the_first_job_that_lacks_the_known_one(tmp_path):
    path = write_geojson(
        tmp_path / "jobs.geojson",
        feature("Point", [148.0, -20.0], duration=60, time="2026-03-01"),
        feature("Point", [148.1, -20.0], time=60),
        feature("Point", [148.2, -20.0], time=60),
    )
    with pytest.warns(ScenarioWarning) as heard:
        read_jobs(path, SITE)
    (warning,) = (warning for warning in heard if warning.category is ScenarioWarning)
    assert "feature 2: 'time' is ignored: did you mean 'duration'" in str(warning.message)


def test_words_of_ones_own_are_left_without_a_word(tmp_path):
    """What means a column of a table is a word of one's own in a feature."""
    table = written(tmp_path / "jobs.csv", "north,east,note,colour,fid2,vessel,surveyor,lonely\n1,2,,,,,,\n")
    own = dict.fromkeys(("lines", "track", "longitud", "northern", "x"), 1)
    path = write_geojson(tmp_path / "jobs.geojson", feature("Point", lonlat(A), **own))
    assert len(read_jobs(table, SITE).points) == len(read_jobs(path, SITE).points) == 1


def test_separators_and_decimals(tmp_path):
    head, row = "north{0}east{0}depth\n", "1{1}5{0}2{1}5{0}3{1}5\n"
    for name, first, mark, decimal in (
        ("a.csv", "sep=;\n", ";", ","),
        ("b.tsv", "", "\t", ","),
        ("c.csv", "", "|", "."),
        ("d.csv", "SEP=,\n", ",", "."),
    ):
        (tmp_path / name).write_text(first + head.format(mark) + row.format(mark, decimal))
        assert read_jobs(tmp_path / name, None).points[0].position == (1.5, 2.5, 3.5)
    mixed = written(tmp_path / "e.csv", "north;east;duration\n1,5;2;1.200\n")
    refusal(GeoError, r"row 2: duration '1\.200' has a point, where other", read_jobs, mixed, None)
