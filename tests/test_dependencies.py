"""Every dependency has its reason in the documentation, and none is missing from it."""

import re
import sys
import tomllib
from contextlib import contextmanager
from pathlib import Path

import pytest
from xarray.namedarray.utils import module_available

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


@contextmanager
def without_extras():
    """Packages of extras are not there; xarray keeps in mind which packages are, and is to forget it."""
    extras = set().union(*(names(of) for of in PROJECT["optional-dependencies"].values()))
    with pytest.MonkeyPatch.context() as patch:
        for name in extras - names(PROJECT["dependencies"]):
            patch.setitem(sys.modules, name, None)
        module_available.cache_clear()
        try:
            yield
        finally:
            module_available.cache_clear()


def test_shipped_examples_need_no_extra(tmp_path):
    for name in ("example", "times"):
        with without_extras():
            written = (write_example if name == "example" else write_example_of_times)(tmp_path / name)
            found = examine_scenario(next(path for path in written if path.suffix == ".yaml"))
        assert found.lines == []
