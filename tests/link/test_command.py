"""`auvplan execute`: what it prints and writes, and bad input as one line."""

import json

import pytest
import yaml

from tests.executive.small import SMALL

SITE = {"longitude": 148.96, "latitude": -20.34}


def scenario_file(tmp_path, **sections):
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(SMALL | {"site": SITE} | sections))
    return path


@pytest.mark.slow
def test_the_simulator_is_executed_and_recorded(tmp_path, call, light_search):
    notices = tmp_path / "notices.jsonl"
    notices.write_text('{"current": [0.1, 0]}\nnonsense\n')
    out = tmp_path / "out"
    status, text, err = call(
        "execute", scenario_file(tmp_path), "--seed", 1, "--out", out, "--notices", notices
    )
    assert (status, err) == (0, "")
    assert "destination reached in time" in text
    assert "line 2" in text
    record = json.loads((out / "execution.json").read_text())
    assert record["success"] is True
    assert record["counts"]["leg"] == len(record["planned"])
    assert record["uploads"][0]["steps"]
    assert len(record["track"]) > 10


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--link", "boat"], "--link boat: must be sim"),
        (["--link-loss", "surface"], "--link-loss: is for --link mavlink:ADDRESS, where ArduSub is, not sim"),
        (["--link", "mavlink:x"], "a MAVLink address is such as"),
        (["--scale", "0"], "--scale: must be positive"),
        (["--limit", "patience=3"], "with a name of reply"),
        (["--limit", "silence=long"], "'long' is no number"),
        (["--limit", "tries=1.5"], "'1.5' is no whole number"),
        (["--limit", "look=1e9"], "limit look: must be at most 60 s"),
        (["--limit", "silence=-1"], "limit silence: must be positive"),
        (["--notices", "no/such/file"], "create it empty"),
    ],
)
def test_bad_input_is_one_line(tmp_path, call, options, words):
    status, _, err = call("execute", scenario_file(tmp_path), "--out", tmp_path / "out", "--quiet", *options)
    assert status == 2
    assert words in err
    assert err.count("\n") == 1
    assert not (tmp_path / "out" / "execution.json").exists()


def test_a_real_vehicle_needs_a_site(tmp_path, call):
    pytest.importorskip("imcpy", reason="needs imcpy: pip install 'auvplan[link]'")
    path = scenario_file(tmp_path, site=None)
    status, _, err = call("execute", path, "--link", "imc:127.0.0.1:9", "--out", tmp_path / "out")
    assert status == 2
    assert "site: is missing" in err


@pytest.mark.parametrize(
    ("link", "library"), [("imc:127.0.0.1:9", "imcpy"), ("mavlink:udpin:127.0.0.1:14999", "pymavlink")]
)
def test_a_mission_that_was_broken_off_is_not_begun_again_unseen(tmp_path, call, link, library):
    pytest.importorskip(library, reason=f"needs {library}: pip install 'auvplan[link]'")
    out = tmp_path / "out"
    out.mkdir()
    (out / "execution.json").write_text('{"reason": "under way"}')
    before = (out / "execution.json").read_bytes()
    status, _, err = call("execute", scenario_file(tmp_path), "--link", link, "--out", out)
    assert status == 2
    assert "its mission did not end: see to the vehicle" in err
    assert err.count("\n") == 1
    assert (out / "execution.json").read_bytes() == before


@pytest.mark.slow
def test_an_interrupted_execution_leaves_its_record(tmp_path, call, light_search, monkeypatch):
    from auvplan.link.simulated import SimulatedVehicle

    reports = SimulatedVehicle.report
    reasons = []

    def report(vehicle, seconds):
        if vehicle.now > 300.0:
            reasons.append(json.loads((tmp_path / "out" / "execution.json").read_text())["reason"])
            raise KeyboardInterrupt
        return reports(vehicle, seconds)

    monkeypatch.setattr(SimulatedVehicle, "report", report)
    status, _, err = call("execute", scenario_file(tmp_path), "--seed", 1, "--out", tmp_path / "out")
    assert status == 130
    record = json.loads((tmp_path / "out" / "execution.json").read_text())
    last = record["uploads"][-1]["number"]
    assert f"interrupted; the vehicle goes on with upload {last}, whose last item is to surface" in err
    assert reasons == ["under way"]
    assert record["reason"] == "interrupted"
    assert record["track"]
