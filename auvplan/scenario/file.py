"""Scenario files: YAML, loaded safely, validated as a whole."""

import warnings
from collections.abc import Mapping
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

from auvplan.errors import ScenarioError, ScenarioWarning
from auvplan.runtime.files import read_text
from auvplan.scenario.fields import Finding, check_fields, first_of
from auvplan.scenario.plausibility import implausible
from auvplan.scenario.scenario import Scenario, change_scenario, put_fields, warn_of_overrides
from auvplan.scenario.yaml_lines import MAX_BYTES, Document, YamlError, read_yaml
from auvplan.scenario.yaml_lines import Path as YamlPath

_SHIPPED = files("auvplan") / "data" / "scenarios"


def shipped_scenarios() -> dict[str, Scenario]:
    """Return the scenarios that come with the package, by name."""
    return {name: load_scenario(name) for name in _shipped_names()}


def _shipped_names() -> list[str]:
    return sorted(e.name.removesuffix(".yaml") for e in _SHIPPED.iterdir() if e.name.endswith(".yaml"))


def load_scenario(source: str | Path = "whitsunday") -> Scenario:
    """Load a scenario from a YAML file, or a shipped one by its name.

    Args:
        source: path of a file, or a name that `auvplan scenarios` lists.

    Returns:
        The scenario, which remembers the folder of its file: what is named there is found from anywhere.

    Raises:
        ScenarioError: one line that names file, line, field and reason, and how many more faults there are.

    Warns:
        ScenarioWarning: a setting differs from what the preset 'paper' fixes; the line has both values. A
            field is implausible; the line names file, line and field.
    """
    scenario = read_scenario(source)
    warn_of_overrides(scenario)
    return scenario


def read_scenario(
    source: str | Path,
    changes: Mapping[str, Any] | None = None,
    names: Mapping[str, str] | None = None,
) -> Scenario:
    """`load_scenario` with other values of some fields in place of the file's.

    Args:
        source: as for `load_scenario`.
        changes: values by "section.field"; None for no changes, and no look at presets.
        names: of the options that these come from.
    """
    scenario, faults, _, document = check_scenario(source)
    if faults or scenario is None:
        raise ScenarioError(first_of(faults, str(source), is_file=True))
    path, names = Path(source), names or {}
    scenario = scenario.in_folder(path.resolve().parent if path.is_file() else scenario.folder)
    if changes is not None:
        scenario = change_scenario(scenario, changes, "command line", names)
        put_fields(document.data, changes)
    doubtful = []
    for one in implausible(scenario, document):
        given = [name for name in changes or () if f"{one.field}.".startswith(f"{name}.")]
        at = (replace(one, place=None), names.get(given[0], "command line")) if given else (one, str(source))
        doubtful.append(first_of([at[0]], at[1], is_file=True))
        warnings.warn(doubtful[-1], ScenarioWarning, stacklevel=1)
    return scenario.in_folder(scenario.folder, tuple(doubtful))


def check_scenario(source: str | Path) -> tuple[Scenario | None, list[Finding], set[YamlPath], Document]:
    """Read a scenario file, and all that is wrong with its fields.

    Returns:
        What `check_fields` returns of it, and what the file says, with places.

    Raises:
        ScenarioError: the file cannot be read as text; one line that names it.
    """
    text = _read(source)
    try:
        document = read_yaml(text)
    except YamlError as error:
        return None, [Finding("YAML", str(error), error.place)], set(), Document()
    return *check_fields(document, Scenario), document


def validate_scenario(plain: dict[str, Any], source: str = "scenario") -> Scenario:
    """Plain data to a scenario.

    Raises:
        ScenarioError: one line that names the first fault's field and reason, and how many more there are.
    """
    scenario, faults, _ = check_fields(Document(plain), Scenario)
    if faults or scenario is None:
        raise ScenarioError(first_of(faults, source, is_file=False))
    warn_of_overrides(scenario)
    return scenario


def scenario_schema() -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of scenario files, with descriptions, units, defaults and limits.

    Rules between fields, such as that a chart's source needs a file, are beyond it: `auvplan validate`
    reports them.
    """
    own = Scenario.model_json_schema()
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "auvplan scenario",
        "description": "What a mission of an autonomous underwater vehicle needs to know. Local metres "
        "north, east and down; seconds; m/s.",
    }
    return head | {name: value for name, value in own.items() if name not in head}


def _read(source: str | Path) -> str:
    shipped, path = _SHIPPED / f"{source}.yaml", Path(source)
    if path.suffix not in (".yaml", ".yml") and "/" not in str(source) and shipped.is_file():
        return shipped.read_text(encoding="utf-8")
    try:
        return read_text(path, ScenarioError, MAX_BYTES)
    except ScenarioError as error:
        if path.is_file():
            raise
        raise ScenarioError(f"{error}; shipped scenarios: {', '.join(_shipped_names())}") from None
