"""Options that several commands have, and what is given while and after they run."""

import subprocess
import sys
import time
import warnings
from itertools import pairwise
from pathlib import Path

import pytest

import auvplan as ap
from auvplan import study
from auvplan.cli import shared
from auvplan.cli.shared import load, progress_bar
from auvplan.errors import ScenarioError, ScenarioWarning
from auvplan.study.store import PIECES


def test_settings_take_the_place_of_the_scenarios():
    texts = [
        "vehicle.speed=2",
        "mission.start=[3000, 2000, 5]",
        "site={longitude: 1, latitude: 2}",
        "name=a=b",
    ]
    with pytest.warns(ScenarioWarning, match="chart: is that of the Whitsunday Islands"):
        scenario, _ = load("whitsunday", settings=texts)
    assert (scenario.vehicle.speed, scenario.mission.start) == (2.0, (3000.0, 2000.0, 5.0))
    assert (scenario.site.latitude, scenario.name) == (2.0, "a=b")
    assert load("whitsunday", settings=["mission.start="])[0].mission.start is None


def test_implausible_is_what_the_settings_make_of_the_file(tmp_path):
    range_, power = "speed_range: [0.8, 2.0]", "power: {propulsion: {constant: 0, factor: 10}}"
    straight = "mission: {waypoints: 2, start: [0, 0, 5], goal: [3600, 0, 5], time_available: %d}"
    path = tmp_path / "scenario.yaml"

    def warned(available, *settings):
        path.write_text(f"vehicle: {{speed: 1.0, {range_}, {power}}}\n{straight % available}\n")
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            scenario, _ = load(str(path), settings=["chart.source=none", *settings])
        assert tuple(str(one.message) for one in found) == scenario.warnings
        return scenario

    (line,) = warned(1700).warnings
    assert line.startswith(f"{path}:2: mission.time_available: 1700 s are less than the straight line")
    assert "3,600 m at 2 m/s" in line
    assert not warned(1700, "mission.time_available=5000").warnings
    assert not warned(1900).warnings
    (line,) = warned(1900, "mission.time_available=1700").warnings
    assert line.startswith("--set: mission.time_available: 1700 s are less than")
    (line,) = warned(1900, "vehicle.speed_range=", "vehicle.speed=1").warnings
    assert line.startswith(f"{path}:2: mission.time_available: 1900 s are less than")
    assert not warned(1700).with_({"mission.time_available": 5000}).warnings


def test_settings_count_more_than_the_option_of_the_same():
    assert load("whitsunday", "paper", settings=["planning.preset=default"])[0].planning.preset == "default"
    assert load("whitsunday", "paper")[0].planning.preset == "paper"
    assert load("whitsunday", leg=True)[0].mission.waypoints == 2


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        (["vehicle.sped=2"], "--set: vehicle.sped: unknown key 'sped', did you mean 'speed'?"),
        (["vehicle.speed=-2"], "--set: vehicle.speed: must be greater than 0, got -2"),
        (["vehicle.speed"], "section.field=value"),
        (["=2"], "section.field=value"),
        (["vehicle.speed=[1"], "not YAML"),
        (["vehicle.speed=*x"], "--set 'vehicle.speed=*x': "),
        (["vehicle.speed=1", "vehicle.speed=2"], "given twice"),
        (["mission.start=[1e6, 0, 0]"], "--set: mission.start: "),
    ],
)
def test_a_bad_setting_is_one_line_that_names_the_option(tmp_path, refused, texts, words):
    options = [part for text in texts for part in ("--set", text)]
    err = refused("mission", "whitsunday", "--out", tmp_path / "out", *options)
    assert err.startswith("auvplan: --set")
    assert words in err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("command", ["path", "departures", "montecarlo"])
def test_a_bad_setting_is_refused_by_each_command(tmp_path, refused, command):
    assert "--set: vehicle.speed: " in refused(command, "--out", tmp_path, "--set", "vehicle.speed=-2")


@pytest.mark.parametrize("command", ["plan", "mission", "montecarlo", "departures"])
def test_a_seed_beyond_the_greatest_is_refused(tmp_path, call, command):
    for seed in (2**32, 10**20):
        code, _, err = call(command, "whitsunday", "--out", tmp_path / "out", "--seed", seed)
        assert code == 2
        assert "4294967295" in err
    assert not (tmp_path / "out").exists()


def test_the_option_of_a_bad_preset_is_named():
    with pytest.raises(ScenarioError, match=r"^--preset: planning\.preset: must be"):
        load("whitsunday", "best")


def test_the_version_by_either_name(call):
    code, out, err = call("--version")
    assert (code, out, err) == (0, f"auvplan {ap.__version__}\n", "")
    root = Path(__file__).resolve().parent.parent
    command = [sys.executable, "-m", "auvplan", "--version"]
    assert subprocess.run(command, cwd=root, capture_output=True, text=True, check=True).stdout == out


def test_a_study_that_is_interrupted_says_how_to_go_on(tmp_path, call, monkeypatch):
    def begin(design, out, **_):
        if out.name == "begun":
            (out / PIECES).mkdir(parents=True)
        raise KeyboardInterrupt

    monkeypatch.setattr(study, "run_study", begin)
    for name, words in (("begun", "--resume"), ("not", "interrupted")):
        code, out, err = call("montecarlo", "--out", tmp_path / name)
        assert (code, out) == (130, "")
        assert words in err
        assert len(err.splitlines()) == 1
    assert "--resume" not in err


def test_other_commands_end_on_one_line_too(call, monkeypatch):
    def stopped(_):
        raise KeyboardInterrupt

    monkeypatch.setattr("auvplan.io.examine.examine_scenario", stopped)
    assert call("validate", "whitsunday") == (130, "", "auvplan: interrupted\n")


def test_progress_in_a_log_is_few_plain_lines(capsys, monkeypatch):
    monkeypatch.setattr(shared, "APART", 0.005)
    with progress_bar("loading", quiet=False, of="of the work") as advance:
        time.sleep(0.5)
        for step in range(101):
            advance(step / 100.0, f"step {step}")
            time.sleep(0.002)
    lines = capsys.readouterr().err.splitlines()
    assert lines[0] == "auvplan: loading"
    assert 2 <= len(lines) <= 11
    assert all(line.isprintable() and line.endswith(" % of the work") for line in lines[1:])
    shares = [int(line.split()[-5]) for line in lines[1:]]
    assert all(b - a >= 10 for a, b in pairwise(shares))
    with progress_bar("loading", quiet=True) as advance:
        time.sleep(0.05)
    assert capsys.readouterr().err == ""
