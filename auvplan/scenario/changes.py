"""Other values of a scenario's fields, validated as those of a file."""

import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from auvplan.errors import ScenarioError, ScenarioWarning
from auvplan.scenario.faults import Fault, first_of
from auvplan.scenario.fields import check_fields
from auvplan.scenario.yaml_lines import Document

if TYPE_CHECKING:
    from auvplan.scenario.scenario import Scenario


def change_scenario(
    scenario: "Scenario",
    changes: Mapping[str, Any],
    source: str = "scenario",
    sources: Mapping[str, str] | None = None,
) -> "Scenario":
    """Return a scenario with other values of some fields, validated as one from a file; see `Scenario.with_`.

    Args:
        scenario: stays as it is.
        changes: values by "section.field", or of a whole section by its name.
        source: that an error names.
        sources: what an error names instead, by field.

    Raises:
        ScenarioError: a field is not known or a value does not fit; one line that names source and field.
    """
    plain = scenario.model_dump(mode="json")
    for name, value in changes.items():
        *sections, field = name.split(".")
        inside: Any = plain
        for section in sections:
            if isinstance(inside, dict) and inside.get(section) is None:
                inside[section] = {}
            inside = inside.get(section) if section and isinstance(inside, dict) else None
        if not isinstance(inside, dict):
            raise ScenarioError(f"{(sources or {}).get(name, source)}: {name}: unknown key")
        inside[field] = value
    changed, faults = check_fields(Document(plain), type(scenario))
    if changed is None:
        # What was given is reported before what it leads to elsewhere.
        given = [(fault, name) for fault in faults for name in changes if _concerns(fault, name)]
        faults = list(dict.fromkeys([*(fault for fault, _ in given), *faults]))
        source = (sources or {}).get(given[0][1], source) if given else source
        raise ScenarioError(first_of(faults, source, is_file=False))
    warn_of_overrides(changed)
    return changed.in_folder(scenario.folder, scenario.doubts)


def _concerns(fault: Fault, name: str) -> bool:
    """Return whether a fault is one of a field, of its section, or of something within it."""
    return f"{fault.field}.".startswith(f"{name}.") or f"{name}.".startswith(f"{fault.field}.")


def warn_of_overrides(scenario: "Scenario") -> None:
    """Warn of settings that differ from what the preset fixes."""
    for line in scenario.overrides:
        warnings.warn(line, ScenarioWarning, stacklevel=1)
