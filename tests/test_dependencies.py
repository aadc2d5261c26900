"""Every dependency has its reason in the documentation, and none is missing from it."""

import re
import sys
import tomllib
from contextlib import contextmanager
from pathlib import Path

import pytest
from xarray.namedarray.utils import module_available

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


@pytest.mark.parametrize("options", [(), ("--times",)])
def test_an_example_is_written_once_is_valid_and_needs_no_extra(call, refused, tmp_path, options):
    scenario = tmp_path / "first" / "scenario.yaml"
    with without_extras():
        code, out, err = call("init", scenario.parent, *options)
        valid, lines, _ = call("validate", scenario)
    assert (code, valid, err) == (0, 0, "")
    assert lines.startswith(f"{scenario}: valid\n")
    assert ("no coast is known" in lines) == (options == ("--times",))
    assert f"auvplan plan {scenario}" in out
    assert all(word in refused("init", scenario.parent) for word in ("scenario.yaml", "--force"))
    assert call("init", scenario.parent, *options, "--force")[0] == 0
