"""What a result was made from: files, assumptions, seed, versions, settings that differ from the defaults."""

from collections.abc import Iterator
from typing import Any

from auvplan.scenario.scenario import Scenario


def changed_settings(settings: dict[str, Any], base: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the settings of a scenario that differ from the defaults: field, value, default.

    Args:
        settings: a scenario as plain data; what it leaves out has its default.
        base: a scenario to compare with in place of the defaults.
    """
    compared = Scenario().model_dump(mode="json") if base is None else base
    found = _differences(settings, compared, "")
    return [row for row in found if row["field"] not in ("name", "description")]


def _differences(given: dict[str, Any], base: dict[str, Any], above: str) -> Iterator[dict[str, Any]]:
    for name, value in given.items():
        usual = base.get(name)
        if isinstance(value, dict) and isinstance(usual, dict):
            yield from _differences(value, usual, f"{above}{name}.")
        elif value != usual:
            yield {"field": above + name, "value": value, "default": usual}
