"""The commands for scenario files: schema, init, validate, scenarios."""

import json

import yaml
from PIL import Image

from tests.io.small_site import SmallSite


def test_schema_is_printed_or_written(call, refused, tmp_path):
    code, out, err = call("schema")
    assert (code, err) == (0, "")
    schema = json.loads(out)
    assert schema["title"]
    assert "mission" in schema["properties"]
    assert call("schema", "--out", tmp_path / "schema.json")[:2] == (0, "")
    assert json.loads((tmp_path / "schema.json").read_text()) == schema
    assert "schema.json" in refused("schema", "--out", tmp_path / "no" / "schema.json")


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
    found = {"scenario": str(path), "valid": False, "faults": [fault], "warnings": [], "notes": []}
    assert json.loads(out) == found
    code, out, _ = call("validate", "scenario-1", "--json")
    assert code == 0
    assert json.loads(out)["valid"] is True


def test_other_commands_name_the_line_of_the_first_fault(refused, tmp_path):
    path = tmp_path / "my.yaml"
    path.write_text("\n" * 99 + "mission: {waypoints: 1, x: 1}\n")
    assert refused("mission", path, "--out", tmp_path / "out") == (
        f"auvplan: {path}:100: mission.waypoints: must be greater than or equal to 2, got 1 "
        f"(and 1 more: auvplan validate {path} lists all)\n"
    )


def test_notes_are_stated(call, tmp_path):
    site = SmallSite(tmp_path / "site")
    site.bed(lambda data: data.assign(depth=data["depth"].assign_attrs(units="")))
    code, out, _ = call("validate", site.folder / "scenario.yaml")
    assert code == 0
    assert out.splitlines()[1:] == [
        "note: bed.nc: units are not given: metres",
        "note: the sea bed is taken at its datum: at low water there is less above it, which "
        "bathymetry.water_level would count",
    ]


def test_a_shipped_scenario_is_valid_by_name(call):
    assert call("validate", "scenario-1")[:2] == (0, "scenario-1: valid\n")


def test_a_file_that_is_not_there(refused, tmp_path):
    path = tmp_path / "none.yaml"
    assert refused("validate", path).startswith(f"auvplan: {path}: No such file")


def test_names_of_files_with_line_breaks_stay_on_a_line(refused, tmp_path):
    path = tmp_path / "two\nlines.yaml"
    path.write_text(yaml.safe_dump({"vehicle": {"speed": -1}}))
    assert "vehicle.speed" in refused("mission", path, "--out", tmp_path / "out")


def test_scenarios_are_listed(call):
    code, out, _ = call("scenarios")
    assert code == 0
    assert all(name in out for name in ("whitsunday", "scenario-1", "scenario-2", "scenario-3"))


def test_validate_takes_a_folder(call, refused, tmp_path):
    (tmp_path / "a.yaml").write_text("vehicle: {speed: -1}\nmission: {waypoints: 1}\n")
    (tmp_path / "b.yml").write_text("chart: {source: none}\ncurrent: {vortices: 0}\n")
    (tmp_path / "c.yaml").write_bytes(bytes(range(256)))
    (tmp_path / "notes.txt").write_text("no scenario")
    code, out, err = call("validate", tmp_path)
    assert (code, err) == (2, "")
    sections = out.strip().split("\n\n")
    assert sections[0].splitlines()[0] == f"{tmp_path / 'a.yaml'}: 2 faults"
    assert len(sections[0].splitlines()) == 3
    assert sections[1] == f"{tmp_path / 'b.yml'}: valid"
    assert "not a text file" in sections[2]
    assert sections[3] == "3 scenarios, 2 with faults"
    (tmp_path / "a.yaml").unlink()
    (tmp_path / "c.yaml").unlink()
    assert call("validate", tmp_path)[0] == 0
    # What a scenario names is none.
    assert call("init", tmp_path / "tide", "--times")[0] == 0
    code, out, _ = call("validate", tmp_path / "tide")
    assert (code, out.strip().splitlines()[-1]) == (0, "1 scenario, 0 with faults")
    (tmp_path / "b.yml").unlink()
    assert "no scenario" in refused("validate", tmp_path)


def test_validate_draws_what_it_read(call, refused, tmp_path):
    site = SmallSite(tmp_path / "site")
    code, out, _ = call("validate", site.folder / "scenario.yaml", "--plot", tmp_path / "map.png")
    assert code == 0
    assert out.splitlines()[-1] == f"map: {tmp_path / 'map.png'}"
    with Image.open(tmp_path / "map.png") as picture:
        assert min(picture.size) > 500
    # With a job on land there is a map too, to see it on.
    site.write("jobs.csv", "north,east,depth\n-400,-400,5\n")
    code, out, _ = call("validate", site.folder / "scenario.yaml", "--plot", tmp_path / "land.png")
    assert code == 2
    assert "on land" in out
    assert (tmp_path / "land.png").is_file()
    site.set(vehicle={"speed": -1})
    code, out, _ = call("validate", site.folder / "scenario.yaml", "--plot", tmp_path / "none.png")
    assert code == 2
    assert "no map" in out
    assert not (tmp_path / "none.png").exists()
    assert "--plot" in refused("validate", site.folder, "--plot", tmp_path / "none.png")
