"""Every dependency has its reason in the documentation, and none is missing from it."""

import re
import sys
import tomllib
from pathlib import Path

import pytest

from auvplan.io.examine import examine_scenario
from auvplan.io.example import write_example, write_example_of_times

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PAGE = (ROOT / "docs" / "dependencies.md").read_text()


def names(requirements: list[str]) -> set[str]:
    return {re.match(r"[\w-]+", requirement)[0] for requirement in requirements}


def test_the_page_has_the_dependencies_and_no_others():
    table = PAGE.split("## Always installed")[1].split("## Extras")[0]
    assert set(re.findall(r"^\| ([\w-]+) \| (?!what)", table, re.M)) - {"package"} == names(
        PROJECT["dependencies"]
    )


@pytest.mark.parametrize(
    "extra", sorted(set(PROJECT["optional-dependencies"]) - {"docs", "notebooks", "dev"})
)
def test_the_page_has_the_extras(extra):
    (row,) = re.findall(rf"^\| `{extra}` \| ([\w, -]+) \|", PAGE, re.M)
    assert set(row.split(", ")) == names(PROJECT["optional-dependencies"][extra])


def test_shipped_examples_need_no_extra(monkeypatch, tmp_path):
    extras = set().union(*(names(of) for of in PROJECT["optional-dependencies"].values()))
    for name in extras - names(PROJECT["dependencies"]):
        monkeypatch.setitem(sys.modules, name, None)
    for name in ("example", "times"):
        written = (write_example if name == "example" else write_example_of_times)(tmp_path / name)
        found = examine_scenario(next(path for path in written if path.suffix == ".yaml"))
        assert found.lines == []
