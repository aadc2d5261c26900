"""The command line as a person meets it: results, exit codes, one clear line for bad input."""

import json
import re
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
import yaml
from PIL import Image
from rich.console import Console
from typer.testing import CliRunner

import auvplan as ap
from auvplan import cli
from auvplan.cli import shared
from auvplan.cli.plan import _promise_row, print_sheet
from auvplan.cli.study import run_with_bar
from auvplan.mission.jobs import JobLine, JobPoint, Jobs
from auvplan.ocean.whitsunday import classes, render
from auvplan.records import Promise
from auvplan.study import cluster
from auvplan.view.sheet import sheet_of
from tests.io.geo.files import write_geotiff
from tests.io.sample_run import make_run
from tests.ocean.chart_pictures import STYLES, paint

pytestmark = pytest.mark.usefixtures("light_search", "coarse")

LEG = {
    "name": "leg",
    "area": {"lower": [0, 0, 0], "upper": [1500, 1500, 40]},
    "chart": {"source": "none"},
    "current": {"vortices": 2, "layers": 1, "radius": [200, 400], "peak_speed": 0.6, "update_interval": 120},
    "simulation": {"obstacles": {"static": 1, "afloat": 0, "self_motivated": 0}},
    "mission": {"waypoints": 2, "start": [100, 100, 10], "goal": [1300, 1300, 10], "time_available": 3000},
    "planning": {"effort": "plain"},
}


def write(tmp_path, name="scenario.yaml", **sections):
    path = tmp_path / name
    path.write_text(yaml.safe_dump(LEG | sections))
    return path


def test_promise_says_what_it_costs_in_a_table_a_picture_and_json(tmp_path, call):
    scenario, out = write(tmp_path), tmp_path / "promise"
    code, said, err = call("promise", scenario, "--out", out)
    assert code == 0, err
    assert "home in time, and what it costs" in said
    assert (out / "promise.png").stat().st_size > 1000
    found = json.loads((out / "promise.json").read_text())
    assert found["scenario"] == "leg"
    shares = [plan["share"] for plan in found["plans"]]
    assert shares == sorted(shares)
    assert all(plan["low"] <= plan["share"] <= plan["high"] for plan in found["plans"])
    assert found["plans"][0]["gives_up"] == found["plans"][0]["does_instead"] == []
    code, said, _ = call("promise", scenario, "--out", out, "--json")
    assert (code, json.loads(said)) == (0, found)


@pytest.mark.parametrize("how", [(), ("--json",)])
def test_a_plan_is_written_without_the_files_that_cannot_hold_it(tmp_path, call, how):
    (tmp_path / "jobs.csv").write_text("name,north,east,depth,priority,duration\nwreck,700,700,10,3,70000\n")
    mission = {key: LEG["mission"][key] for key in ("start", "goal")}
    mission |= {"jobs": "jobs.csv", "time_available": 90_000}
    site = {"longitude": 8.0, "latitude": 54.0, "departure": "2026-03-01T05:30:00Z"}
    scenario, out = write(tmp_path, mission=mission, site=site), tmp_path / "out"
    code, said, err = call("plan", scenario, "--out", out, "--pictures", "none", *how)
    assert code == 0, err
    for file in ("itinerary.plan", "itinerary.imc.xml"):
        assert re.search(rf"warning: {file} is left out: .*the task .* takes 70000 s, at most 65535\n", err)
        assert not (out / file).exists()
        assert how or f"note: {file}" not in said
    assert all(
        (out / file).is_file() for file in ("summary.json", "mission.nc", "sheet.html", "itinerary.gpx")
    )
    code, said, again = call("export", out, "--out", tmp_path / "files")
    assert code == 0
    assert again.splitlines() == [line for line in err.splitlines() if "warning: " in line]
    assert len(list((tmp_path / "files").iterdir())) == 6
    code, _, err = call("export", out, "--format", "qgc")
    assert code == 2
    assert "the task at wreck (leg 1) takes 70000 s" in err


def test_what_a_plan_gives_up_are_tasks():
    """A line that is surveyed the other way is done; without names a task is that of its edge."""

    def run(jobs, *nodes):
        found = make_run(nodes)
        found.jobs = jobs
        found.promise = Promise(None, 0.9, 0.8, 0.95, 1000, 1, (1.0, 2.0, 3.0), 0.0)
        for leg in found.legs:
            leg.priority = 1.0
        return found

    ridge = JobLine("ridge", ((0.0, 0.0, 5.0), (100.0, 0.0, 5.0)))
    jobs = Jobs((JobPoint("buoy", (0.0, 100.0, 5.0)),), (ridge,))
    first, other = run(jobs, 0, 2, 3, 1), run(jobs, 0, 3, 2)
    row = _promise_row(other, first)
    assert (row["gives_up"], row["does_instead"]) == (["buoy"], [])
    row = _promise_row(run(None, 0, 2, 1), run(None, 0, 1, 2, 3))
    assert row["gives_up"] == ["edge 0 to 1", "edge 1 to 2", "edge 2 to 3"]
    assert row["does_instead"] == ["edge 0 to 2", "edge 2 to 1"]


@pytest.mark.parametrize("width", [70, 80, 100, 160])
def test_a_narrow_terminal_names_every_stop(width, monkeypatch, capsys):
    run = make_run()
    run.names = ["start", "gauge", "northern wreck", "goal", *map(str, range(4, len(run.graph.positions)))]
    sheet = sheet_of(run)
    first, gauge, wreck, *rest = sheet.stops
    gauge = replace(gauge, wait=154.0, hold=0.0, task="gauge")
    wreck = replace(wreck, wait=0.0, hold=600.0, task="northern wreck")
    sheet = replace(sheet, stops=(first, gauge, wreck, *rest))
    console = Console(width=width, force_terminal=True, color_system=None)
    monkeypatch.setattr(shared, "console", console)
    print_sheet(sheet)
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= width
    for words in ("gauge", "northern", "wreck", "154 + 0 s", "0 + 600 s"):
        assert words in said
    assert (width > 80) == ("in a wider window, and in sheet.html" not in said)


@pytest.mark.filterwarnings("ignore::auvplan.errors.ScenarioWarning")
def test_promise_without_a_plan_says_why(tmp_path, call):
    mission = LEG["mission"] | {"time_available": 300}
    code, _, err = call("promise", write(tmp_path, mission=mission), "--out", tmp_path / "promise")
    assert code == 1
    assert "no plan: " in err


def test_mission_check_and_files(tmp_path, call):
    code, said, err = call("mission", write(tmp_path), "--out", tmp_path / "out", "--seed", 3, "--certify")
    assert code == 0, err
    for words in ("collisions", "first route: total priority", "mission cost (Eq. 15), total (Eq. 16)"):
        assert words in said
    assert "gap 0.0%" in said, "two waypoints leave no choice"
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    fields = "t_available t_mission t_residual tasks total_priority path_calls mission_replans cost_mission"
    assert {*fields.split(), "cost_total", "legs", "cpu", "collisions", "version"} <= set(summary)
    assert (summary["success"], summary["seed"]) == (True, 3)
    assert {"from", "to", "t_expected", "t_path", "cpu_s"} <= set(summary["legs"][0])
    page = tmp_path / "out" / "report.html"
    pictures = (f"{name}.png" for name in ("mission", "timeline", "currents", "obstacles", "convergence"))
    for name in ("mission.nc", "report.html", *pictures):
        assert (tmp_path / "out" / name).stat().st_size > 1000
    assert said.splitlines()[-2] == f"open {page}"
    before = page.read_bytes()
    assert call("report", tmp_path / "out")[:2] == (0, f"open {page}\n")
    assert page.read_bytes() == before
    code, said, _ = call("check", tmp_path / "out")
    assert code == 0
    assert "collisions: 0" in said


def test_path_and_quiet(tmp_path, call):
    arguments = ("path", write(tmp_path), "--out", tmp_path / "out", "--quiet")
    assert call(*arguments, "--pictures", "main") == (0, "", "")
    assert (tmp_path / "out" / "report.html").is_file()
    assert call(*arguments, "--pictures", "none") == (0, "", "")
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
def test_bad_studies_are_one_line(tmp_path, refused, monkeypatch, arguments, words):
    monkeypatch.setattr(cluster, "PATIENCE", "1s")
    assert words in refused("montecarlo", write(tmp_path), "-n", 2, "--out", tmp_path / "mc", *arguments)
    assert not (tmp_path / "mc" / "missions.nc").exists()


@pytest.fixture
def chart(tmp_path, call):
    """A function that runs `chart` on a picture: what it says, and the scenario's section in that."""

    def run(picture, *options, out=tmp_path / "out"):
        path = tmp_path / "map.png"
        if not isinstance(picture, np.ndarray):
            path = picture
        else:
            Image.fromarray(picture).save(path)
        code, said, err = call("chart", path, "--out", out, *options)
        assert code == 0, err
        return said, yaml.safe_load(said[said.index("chart:\n") :])["chart"]

    return run


def test_the_chart_command_proposes_what_colours_stand_for(tmp_path, chart):
    said, section = chart(paint(STYLES["white deep water"], 300), out=tmp_path)
    row = next(line for line in said.splitlines() if "#ffffff" in line)
    assert "water" in row
    assert '--land "#ffffff"' in row
    assert "note: " in said
    assert (section["source"], section["image"]) == ("image", str(tmp_path / "map.png"))
    assert section["colours"]["water"] == ["#ffffff"]
    # The lines make a scenario of the same chart.
    area = {"lower": [0, 0, 0], "upper": [100, 100, 50]}
    shares = ap.load_area(
        ap.Scenario.model_validate({"chart": section, "area": area}), tmp_path
    ).chart.shares()
    assert f"coast {shares['coast']:.1%}, uncertain {shares['uncertain']:.1%}" in said


def test_the_chart_command_takes_stated_colours(tmp_path, call, chart):
    style = STYLES["inverted"]
    Image.fromarray(paint(style, 300)).save(tmp_path / "map.png")
    code, said, err = call("chart", tmp_path / "map.png", "--out", tmp_path / "out")
    assert (code, err.count("\n")) == (2, 1)
    assert "chart.colours" in err
    assert (tmp_path / "out" / "chart.png").is_file(), "the clusters are drawn where they are refused, too"
    assert "chart:" not in said
    stated = [word for kind, (colour,) in style.named.items() for word in (f"--{kind}", colour)]
    said, section = chart(tmp_path / "map.png", *stated)
    assert section["colours"] == {kind: list(colours) for kind, colours in style.named.items()}
    coast = (classes(300) == 0).mean()
    assert float(re.search(r"coast ([\d.]+)%", said)[1]) == pytest.approx(100.0 * coast, abs=1.0)


@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (["--water", "blu"], "--water 'blu' is no colour"),
        (["--land", "#12"], "--land '#12' is no colour"),
        (["--uncertain", ""], "--uncertain '' is no colour"),
        (["--water", "white", "--land", "#fff"], "#ffffff is given for water and for land"),
    ],
)
def test_colours_that_are_none(tmp_path, refused, stated, words):
    Image.fromarray(paint(STYLES["grey"], 100)).save(tmp_path / "map.png")
    assert words in refused("chart", tmp_path / "map.png", "--out", tmp_path / "out", *stated)


def test_the_chart_command_leaves_the_picture_alone(tmp_path, chart):
    path = tmp_path / "chart.png"
    Image.fromarray(render(100)).save(path)
    before = path.read_bytes()
    for _ in range(2):
        assert "chart-drawn.png" in chart(path, out=tmp_path)[0]
    assert path.read_bytes() == before
    assert sorted(file.name for file in tmp_path.iterdir()) == ["chart-drawn.png", "chart.png"]


def test_pixels_are_as_large_as_the_file_states(tmp_path, chart):
    path = write_geotiff(
        tmp_path / "c.tif", render(100), corner=(5e5, 7_774_100.0), scale=(300, 300), epsg=32755
    )
    said, section = chart(path)
    assert "pixels of 300" in said
    assert (section["source"], section["file"]) == ("raster", str(path))
    assert "note" not in said
    said, _ = chart(path, "--pixel-size", 25)
    assert "pixels of 25 m" in said
    assert "has pixels of 300" in said
    Image.fromarray(render(100)).save(tmp_path / "w.png")
    (tmp_path / "w.pgw").write_text("40\n0\n0\n-40\n697205\n7774095\n")
    said, _ = chart(tmp_path / "w.png")
    assert "pixels of 40 m" in said
    assert "crs:" in said


def test_help_names_every_command():
    said = CliRunner().invoke(cli.app, ["--help"]).output
    commands = (
        "mission path departures export montecarlo plot report chart check init validate schema scenarios"
    )
    for command in commands.split():
        assert command in said


@pytest.mark.slow
def test_a_current_that_wins_exits_1_and_names_the_place(tmp_path, call):
    strong = LEG["current"] | {"uniform": [-4.0, 0.0, 0.0]}
    code, _, err = call("mission", write(tmp_path, current=strong), "--out", tmp_path / "out")
    assert code == 1
    assert all(words in err for words in ("current", "km"))
    assert "Traceback" not in err


#: What the fields of a scenario must be, and what YAML must, is asked of the rooms that read them.
BAD_SCENARIOS = [
    ({"mission": LEG["mission"] | {"start": [5000, 100, 10]}}, "mission.start"),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"water": "blu"}}},
     "chart.colours.water: 'blu'"),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"land": None}}}, "needs quotes"),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"land": [3]}}}, "chart.colours.land"),
    ({"chart": {"source": "image", "image": "x.png", "colours": {"land": "tan", "water": "tan"}}},
     "chart.colours: #d2b48c is given for water and for land"),
    ({"chart": {"source": "whitsunday", "colours": {"land": "tan"}}}, "chart.colours"),
    ({"chart": {"source": "image", "image": "missing.png", "pixel_size": 10}}, "missing.png"),
    ({"chart": {"source": "whitsunday"}, "area": {"lower": [0, 0, 0], "upper": [99000, 99000, 10]}}, "chart"),
    ({"chart": {"source": "whitsunday"}, "area": {"lower": [0, 0, 0], "upper": [10000, 10000, 10]},
      "mission": LEG["mission"] | {"start": [8000, 6500, 5], "time_available": 9000}}, "land"),
]  # fmt: skip


@pytest.mark.parametrize(("sections", "expected"), BAD_SCENARIOS)
def test_bad_scenarios_are_one_line(tmp_path, refused, sections, expected):
    assert expected in refused("mission", write(tmp_path, **sections), "--out", tmp_path / "out", "--quiet")
    assert not list((tmp_path / "out").glob("*"))


@pytest.mark.parametrize(("text", "expected"), [("[1, 2", "YAML"), ("- just\n- a list", "mapping")])
def test_text_that_is_no_scenario(tmp_path, refused, text, expected):
    (tmp_path / "bad.yaml").write_text(text)
    err = refused("mission", tmp_path / "bad.yaml", "--out", tmp_path / "out")
    assert "bad.yaml" in err
    assert expected in err


def test_what_is_not_there_or_in_the_way_is_named(tmp_path, refused):
    assert all(
        word in refused("mission", "nowhere", "--out", tmp_path / "out") for word in ("nowhere", "whitsunday")
    )
    (tmp_path / "file").write_text("in the way")
    assert "file" in refused("mission", write(tmp_path), "--out", tmp_path / "file")
    assert str(tmp_path) in refused("check", tmp_path)


def test_the_end_of_a_study_is_judged_by_missions_that_are_under_way(monkeypatch, tmp_path):
    """Not by what compiling took before the first of them moved, nor only by those that are done."""
    clock, said = [0.0], []

    @contextmanager
    def bar(*_, **__):
        yield lambda share, text: said.append(text)

    def study(*_, progress, **__):
        for at, done, share in ((0.0, 0, 0.0), (100.0, 0, 0.01), (104.0, 0, 0.05), (139.0, 2, 0.40)):
            clock[0] = at
            progress(done, 10, share)

    monkeypatch.setattr("auvplan.cli.shared.progress_bar", bar)
    monkeypatch.setattr("auvplan.study.run_study", study)
    monkeypatch.setattr("auvplan.cli.study.time.monotonic", lambda: clock[0])
    run_with_bar(None, tmp_path, quiet=True)
    assert said[:3] == ["0 of 10 missions"] * 3
    assert said[3] == "2 of 10 missions, 0.13 a second, 60 s left"  # 60 % at 1 % a second
