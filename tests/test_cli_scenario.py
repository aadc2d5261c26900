"""The commands for scenario files: schema, init, validate, scenarios."""

import json

import pytest
import yaml

from auvplan import cli


@pytest.fixture
def call(capsys, monkeypatch):
    """Runs a command; exit status, standard output, standard error."""

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["auvplan", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        out, err = capsys.readouterr()
        return stop.value.code or 0, out, err

    return run


def test_schema_is_printed_or_written(call, tmp_path):
    code, out, err = call("schema")
    assert (code, err) == (0, "")
    schema = json.loads(out)
    assert schema["title"]
    assert "mission" in schema["properties"]
    code, out, _ = call("schema", "--out", tmp_path / "schema.json")
    assert (code, out) == (0, "")
    assert json.loads((tmp_path / "schema.json").read_text()) == schema
    code, _, err = call("schema", "--out", tmp_path / "no" / "schema.json")
    assert code == 2
    assert "schema.json" in err
    assert len(err.splitlines()) == 1


def test_init_then_validate(call, tmp_path):
    code, out, err = call("init", tmp_path / "first")
    assert (code, err) == (0, "")
    assert f"auvplan mission {tmp_path / 'first' / 'scenario.yaml'}" in out
    code, out, err = call("validate", tmp_path / "first" / "scenario.yaml")
    assert (code, err) == (0, "")
    assert out == f"{tmp_path / 'first' / 'scenario.yaml'}: valid\n"
    code, out, err = call("init", tmp_path / "first")
    assert code == 2
    assert out == ""
    assert len(err.splitlines()) == 1
    assert "scenario.yaml" in err
    assert "--force" in err
    assert call("init", tmp_path / "first", "--force")[0] == 0


def test_validate_lists_every_fault_with_its_place(call, tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text(
        "name: a\n" + "\n" * 98 + "mission: {prioritys: [1, 2], waypoints: 1}\nvehicle: {speed: -1}\n"
    )
    code, out, err = call("validate", path)
    assert (code, err) == (2, "")
    assert out.splitlines() == [
        f"{path}:100:11 mission.prioritys: unknown key 'prioritys', did you mean 'priority'?",
        f"{path}:100:41 mission.waypoints: must be greater than or equal to 2, got 1",
        f"{path}:101:18 vehicle.speed: must be greater than 0, got -1",
    ]


def test_faults_as_one_object(call, tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text("vehicle: {speed: -1}\n")
    code, out, err = call("validate", path, "--json")
    assert (code, err) == (2, "")
    fault = {"field": "vehicle.speed", "reason": "must be greater than 0, got -1", "line": 1, "column": 18}
    assert json.loads(out) == {"scenario": str(path), "valid": False, "faults": [fault], "notes": []}
    code, out, _ = call("validate", "scenario-1", "--json")
    assert code == 0
    assert json.loads(out)["valid"] is True


def test_the_line_of_the_first_fault_is_told_by_other_commands(call, tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text("\n" * 99 + "mission: {waypoints: 1, x: 1}\n")
    code, _, err = call("mission", path, "--out", tmp_path / "out")
    assert code == 2
    assert err == (
        f"auvplan: {path}:100: mission.waypoints: must be greater than or equal to 2, got 1 "
        f"(and 1 more: auvplan validate {path} lists all)\n"
    )


def test_notes_are_told(call, tmp_path):
    from tests.io.small_site import SmallSite

    site = SmallSite(tmp_path / "site")
    site.bed(lambda data: data.assign(depth=data["depth"].assign_attrs(units="")))
    code, out, _ = call("validate", site.folder / "scenario.yaml")
    assert code == 0
    assert out.splitlines()[1:] == ["note: units are not told: metres"]


def test_a_shipped_scenario_is_valid_by_name(call):
    assert call("validate", "scenario-1")[:2] == (0, "scenario-1: valid\n")


def test_a_file_that_is_not_there(call, tmp_path):
    code, out, err = call("validate", tmp_path / "none.yaml")
    assert (code, out) == (2, "")
    assert err.startswith(f"auvplan: {tmp_path / 'none.yaml'}: No such file")
    assert len(err.splitlines()) == 1


def test_names_of_files_with_line_breaks_stay_on_a_line(call, tmp_path):
    path = tmp_path / "two\nlines.yaml"
    path.write_text(yaml.safe_dump({"vehicle": {"speed": -1}}))
    code, _, err = call("mission", path, "--out", tmp_path / "out")
    assert code == 2
    assert len(err.splitlines()) == 1


def test_scenarios_are_listed(call):
    code, out, _ = call("scenarios")
    assert code == 0
    assert "whitsunday" in out
