"""The command line as a person meets it: results, exit codes, one clear line for bad input."""

import json
import re

import numpy as np
import pytest
import yaml
from PIL import Image
from typer.testing import CliRunner

import auvplan as ap
from auvplan import cli
from auvplan.ocean.whitsunday import classes, render
from auvplan.study import cluster
from tests.io.geo.files import write_geotiff
from tests.ocean.chart_pictures import STYLES, paint

pytestmark = pytest.mark.usefixtures("light_search")

LEG = {
    "name": "leg",
    "area": {"lower": [0, 0, 0], "upper": [1500, 1500, 40]},
    "chart": {"source": "none"},
    "current": {"vortices": 2, "layers": 1, "radius": [200, 400], "peak_speed": 0.6, "update_interval": 120},
    "simulation": {"obstacles": {"static": 1, "afloat": 0, "self_motivated": 0}},
    "mission": {"waypoints": 2, "start": [100, 100, 10], "goal": [1300, 1300, 10], "time_available": 3000},
}


def write(tmp_path, name="scenario.yaml", **sections):
    path = tmp_path / name
    path.write_text(yaml.safe_dump(LEG | sections))
    return path


def test_mission_check_and_files(tmp_path, call):
    code, out, err = call("mission", write(tmp_path), "--out", tmp_path / "out", "--seed", 3, "--certify")
    assert code == 0, err
    assert "collisions" in out
    assert "first route: total priority" in out
    assert "mission cost (Eq. 15), total (Eq. 16)" in out
    assert "gap 0.0%" in out, "two waypoints leave no choice"
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    fields = ("t_available", "t_mission", "t_residual", "success", "tasks", "total_priority", "path_calls")
    for field in (
        *fields,
        "mission_replans",
        "cost_mission",
        "cost_total",
        "legs",
        "cpu",
        "collisions",
        "seed",
        "version",
    ):
        assert field in summary
    assert summary["success"] is True
    assert summary["seed"] == 3
    assert {"from", "to", "t_expected", "t_path", "cpu_s"} <= set(summary["legs"][0])
    for name in (
        "mission.nc",
        "mission.png",
        "timeline.png",
        "currents.png",
        "obstacles.png",
        "convergence.png",
        "report.html",
    ):
        assert (tmp_path / "out" / name).stat().st_size > 1000
    assert out.splitlines()[-2] == f"open {tmp_path / 'out' / 'report.html'}"
    page = (tmp_path / "out" / "report.html").read_bytes()
    code, out, _ = call("report", tmp_path / "out")
    assert (code, out) == (0, f"open {tmp_path / 'out' / 'report.html'}\n")
    assert (tmp_path / "out" / "report.html").read_bytes() == page
    code, out, _ = call("check", tmp_path / "out")
    assert code == 0
    assert "collisions: 0" in out


def test_path_and_quiet(tmp_path, call):
    arguments = ("path", write(tmp_path), "--out", tmp_path / "out", "--quiet")
    code, out, err = call(*arguments)
    assert code == 0, err
    assert out == ""
    assert (tmp_path / "out" / "report.html").is_file()
    code, _, err = call(*arguments, "--pictures", "none")
    assert code == 0, err
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["mission.nc", "summary.json"]


def test_montecarlo_reports_statistics_and_plot_draws_them(tmp_path, call):
    out = tmp_path / "mc"
    arguments = ("montecarlo", write(tmp_path), "-n", 3, "--workers", 1, "--out", out)
    code, said, err = call(*arguments)
    assert code == 0, err
    report = json.loads((out / "summary.json").read_text())
    assert report["missions"] == report["on_time"] == 3
    assert "3 of 3 missions" in said
    assert said.splitlines()[-1] == f"open {out / 'report.html'}"
    code, said, err = call(*arguments, "--resume", "--json")
    assert code == 0, err
    assert json.loads(said)["on_time"] == 3
    code, said, err = call("plot", out)
    assert code == 0, err
    for name in ("time_use.png", "expected_times.png", "planning_time.png", "replans.png"):
        assert (out / name).stat().st_size > 1000
        assert name in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sweep", "current.update_rate"), "section.name=value"),
        (("--sweep", "current.speed=1,2"), "current.speed: unknown key"),
        (("--sweep", "current.vortices=1,-2"), "current.vortices"),
        (("--resume",), "no study to resume"),
        (("--dask", "tcp://127.0.0.1:1"), "cannot be reached"),
    ],
)
def test_bad_studies_are_one_line_and_exit_2(tmp_path, call, monkeypatch, arguments, words):
    out = tmp_path / "mc"
    monkeypatch.setattr(cluster, "PATIENCE", "1s")
    code, _, err = call("montecarlo", write(tmp_path), "-n", 2, "--out", out, *arguments)
    assert code == 2
    assert words in err
    assert len(err.strip().splitlines()) == 1
    assert not (out / "missions.nc").exists()


def test_chart_command(tmp_path, call):
    picture = np.full((60, 80, 3), (60, 120, 200), np.uint8)
    picture[:20] = (200, 180, 120)
    Image.fromarray(picture).save(tmp_path / "map.png")
    code, out, err = call("chart", tmp_path / "map.png", "--out", tmp_path / "chart")
    assert code == 0, err
    assert "coast 33.3" in out
    assert (tmp_path / "chart" / "chart.png").is_file()


def test_the_chart_command_proposes_what_colours_stand_for(tmp_path, call):
    style = STYLES["white deep water"]
    Image.fromarray(paint(style, 300)).save(tmp_path / "map.png")
    code, out, err = call("chart", tmp_path / "map.png", "--out", tmp_path)
    assert code == 0, err
    row = next(line for line in out.splitlines() if "#ffffff" in line)
    assert "water" in row
    assert '--land "#ffffff"' in row
    assert "note: " in out
    lines = out[out.index("chart:\n") :]
    chart = yaml.safe_load(lines)["chart"]
    assert chart["source"] == "image"
    assert chart["image"] == str(tmp_path / "map.png")
    assert chart["colours"]["water"] == ["#ffffff"]
    # The lines make a scenario of the same chart.
    area = {"lower": [0, 0, 0], "upper": [100, 100, 50]}
    scenario = ap.Scenario.model_validate({"chart": chart, "area": area})
    shares = ap.load_area(scenario, tmp_path).chart.shares()
    assert f"coast {shares['coast']:.1%}, uncertain {shares['uncertain']:.1%}" in out


def test_the_chart_command_takes_told_colours(tmp_path, call):
    style = STYLES["inverted"]
    Image.fromarray(paint(style, 300)).save(tmp_path / "map.png")
    arguments = ["chart", tmp_path / "map.png", "--out", tmp_path / "out"]
    code, out, err = call(*arguments)
    assert code == 2
    assert err.count("\n") == 1
    assert "chart.colours" in err
    assert (tmp_path / "out" / "chart.png").is_file(), "the clusters are drawn where they are refused, too"
    assert "chart:" not in out
    stated = [word for kind, (colour,) in style.named.items() for word in (f"--{kind}", colour)]
    code, out, err = call(*arguments, *stated)
    assert code == 0, err
    assert yaml.safe_load(out[out.index("chart:\n") :])["chart"]["colours"] == {
        kind: list(colours) for kind, colours in style.named.items()
    }
    coast = (classes(300) == 0).mean()
    assert float(re.search(r"coast ([\d.]+)%", out)[1]) == pytest.approx(100.0 * coast, abs=1.0)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (["--water", "blu"], "--water 'blu' is no colour"),
        (["--land", "#12"], "--land '#12' is no colour"),
        (["--uncertain", ""], "--uncertain '' is no colour"),
        (["--water", "white", "--land", "#fff"], "#ffffff is given for water and for land"),
    ],
)
def test_colours_that_are_none(tmp_path, call, stated, words):
    Image.fromarray(paint(STYLES["grey"], 100)).save(tmp_path / "map.png")
    code, _, err = call("chart", tmp_path / "map.png", "--out", tmp_path / "out", *stated)
    assert code == 2
    assert words in err
    assert err.count("\n") == 1


def test_the_chart_command_leaves_the_picture_alone(tmp_path, call):
    path = tmp_path / "chart.png"
    Image.fromarray(render(100)).save(path)
    before = path.read_bytes()
    for _ in range(2):
        code, out, err = call("chart", path, "--out", tmp_path)
        assert code == 0, err
        assert "chart-drawn.png" in out
    assert path.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["chart-drawn.png", "chart.png"]


def test_pixels_are_as_large_as_the_file_tells(tmp_path, call):
    path = write_geotiff(
        tmp_path / "c.tif", render(100), corner=(5e5, 7_774_100.0), scale=(300, 300), epsg=32755
    )
    arguments = ["chart", path, "--out", tmp_path / "out"]
    code, out, err = call(*arguments)
    assert code == 0, err
    assert "pixels of 300" in out
    chart = yaml.safe_load(out[out.index("chart:\n") :])["chart"]
    assert (chart["source"], chart["file"]) == ("raster", str(path))
    assert "note" not in out
    code, out, err = call(*arguments, "--pixel-size", 25)
    assert code == 0, err
    assert "pixels of 25 m" in out
    assert "has pixels of 300" in out
    Image.fromarray(render(100)).save(tmp_path / "w.png")
    (tmp_path / "w.pgw").write_text("40\n0\n0\n-40\n697205\n7774095\n")
    code, out, err = call("chart", tmp_path / "w.png", "--out", tmp_path / "out")
    assert code == 0, err
    assert "pixels of 40 m" in out
    assert "crs:" in out


def test_scenarios_are_listed(call):
    code, out, _ = call("scenarios")
    assert code == 0
    for name in ("whitsunday", "scenario-1", "scenario-2", "scenario-3"):
        assert name in out


def test_help_names_every_command():
    out = CliRunner().invoke(cli.app, ["--help"]).output
    for command in (
        "mission",
        "path",
        "departures",
        "export",
        "montecarlo",
        "plot",
        "report",
        "chart",
        "check",
    ):
        assert command in out
    for command in ("init", "validate", "schema", "scenarios"):
        assert command in out


@pytest.mark.slow
def test_a_current_that_wins_exits_1_and_names_the_place(tmp_path, call):
    strong = LEG["current"] | {"uniform": [-4.0, 0.0, 0.0]}
    code, _, err = call("mission", write(tmp_path, current=strong), "--out", tmp_path / "out")
    assert code == 1
    assert "current" in err
    assert "km" in err
    assert "Traceback" not in err


BAD_FIELDS = [
    ({"mision": {}}, "mision: unknown key"),
    ({"mission": {"waypoint": 3}}, "mission.waypoint: unknown key"),
    ({"vehicle": {"speed": -1}}, "vehicle.speed"),
    ({"vehicle": {"speed": "fast"}}, "vehicle.speed"),
    ({"vehicle": {"speed": "2.5 knots"}}, "vehicle.speed"),
    ({"vehicle": {"speed": float("nan")}}, "vehicle.speed"),
    ({"mission": LEG["mission"] | {"time_available": -5}}, "mission.time_available"),
    ({"mission": LEG["mission"] | {"start": [5000, 100, 10]}}, "mission.start"),
    ({"mission": LEG["mission"] | {"start": [100, 100]}}, "mission.start"),
    ({"area": {"lower": [0, 0, 0], "upper": [-1, 100, 0]}}, "area"),
    ({"chart": {"source": "image"}}, "chart"),
    (
        {"chart": {"source": "image", "image": "x.png", "colours": {"water": "blu"}}},
        "chart.colours.water: 'blu'",
    ),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"land": None}}}, "needs quotes"),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"land": [3]}}}, "chart.colours.land"),
    (
        {"chart": {"source": "image", "image": "x.png", "colours": {"land": "tan", "water": "tan"}}},
        "chart.colours: #d2b48c is given for water and for land",
    ),
    ({"chart": {"source": "whitsunday", "colours": {"land": "tan"}}}, "chart.colours"),
    ({"chart": {"source": "image", "image": "missing.png", "pixel_size": 10}}, "missing.png"),
    ({"planning": {"preset": "best"}}, "planning.preset"),
    ({"chart": {"source": "whitsunday"}, "area": {"lower": [0, 0, 0], "upper": [99000, 99000, 10]}}, "chart"),
    (
        {
            "chart": {"source": "whitsunday"},
            "area": {"lower": [0, 0, 0], "upper": [10000, 10000, 10]},
            "mission": LEG["mission"] | {"start": [8000, 6500, 5], "time_available": 9000},
        },
        "land",
    ),
]


@pytest.mark.parametrize(("sections", "expected"), BAD_FIELDS, ids=[expected for _, expected in BAD_FIELDS])
def test_bad_scenarios_exit_2_with_one_line(tmp_path, call, sections, expected):
    code, out, err = call("mission", write(tmp_path, **sections), "--out", tmp_path / "out", "--quiet")
    assert code == 2, err
    assert expected in err
    assert len(err.strip().splitlines()) == 1
    assert "Traceback" not in out + err
    assert not list((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else True


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1, 2", "YAML"),
        ("- just\n- a list", "mapping"),
        ("name: !!python/object/apply:os.system ['true']", "YAML"),
        ("a: &x [1]\nb: *x", "aliases"),
        ("name: a\nname: b", "twice"),
        ("\x00\x01", "YAML"),
        ("[" * 5000, "YAML|deeply"),
    ],
)
def test_hostile_yaml(tmp_path, call, text, expected):
    import re

    path = tmp_path / "bad.yaml"
    path.write_text(text)
    code, _, err = call("mission", path, "--out", tmp_path / "out")
    assert code == 2
    assert "bad.yaml" in err
    assert re.search(expected, err)
    assert len(err.strip().splitlines()) == 1


def test_unknown_scenario_lists_the_shipped_ones(tmp_path, call):
    code, _, err = call("mission", "nowhere", "--out", tmp_path / "out")
    assert code == 2
    assert "nowhere" in err
    assert "whitsunday" in err


def test_output_folder_that_cannot_be_made(tmp_path, call):
    (tmp_path / "file").write_text("in the way")
    code, _, err = call("mission", write(tmp_path), "--out", tmp_path / "file")
    assert code == 2
    assert "file" in err
    assert len(err.strip().splitlines()) == 1


def test_check_of_nothing(tmp_path, call):
    code, _, err = call("check", tmp_path)
    assert code == 2
    assert len(err.strip().splitlines()) == 1
