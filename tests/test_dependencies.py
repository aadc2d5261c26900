"""Every dependency has its reason in the documentation, and none is missing from it."""

import re
import tomllib
from pathlib import Path

import pytest

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
