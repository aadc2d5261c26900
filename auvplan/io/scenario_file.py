"""Scenario files: YAML, loaded safely, validated as a whole."""

from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from auvplan.voyage.scenario import Scenario
from auvplan.voyage.world import ScenarioError

#: Larger files are no scenarios.
_MAX_BYTES = 1_000_000


def shipped_scenarios() -> dict[str, Scenario]:
    """The scenarios that come with the package, by name."""
    folder = files("auvplan") / "data" / "scenarios"
    found = sorted(entry.name for entry in folder.iterdir() if entry.name.endswith(".yaml"))
    return {name.removesuffix(".yaml"): load_scenario(name.removesuffix(".yaml")) for name in found}


def load_scenario(source: str | Path = "whitsunday") -> Scenario:
    """Load a scenario from a YAML file, or a shipped one by its name.

    Args:
        source: path of a file, or a name that `auvplan scenarios` lists.

    Raises:
        ScenarioError: one line that names file, field and reason.
    """
    text = _read(source)
    try:
        plain = yaml.load(text, Loader=_PlainLoader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f" at line {mark.line + 1}" if mark is not None else ""
        problem = getattr(error, "problem", None) or "cannot be parsed"
        raise ScenarioError(f"{source}: not valid YAML{line}: {problem}") from None
    except RecursionError:
        raise ScenarioError(f"{source}: nested too deeply") from None
    if not isinstance(plain, dict):
        raise ScenarioError(f"{source}: a scenario is a mapping of fields, got {type(plain).__name__}")
    return validate_scenario(plain, str(source))


def validate_scenario(plain: dict[str, Any], source: str = "scenario") -> Scenario:
    """Plain data to a scenario.

    Raises:
        ScenarioError: one line that names the first fault's field and reason, and how many more there are.
    """
    try:
        return Scenario.model_validate(plain)
    except ValidationError as error:
        faults = error.errors()
        field = ".".join(str(part) for part in faults[0]["loc"]) or "scenario"
        reason = faults[0]["msg"].removeprefix("Value error, ")
        if faults[0]["type"] == "extra_forbidden":
            reason = "unknown key"
        more = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ScenarioError(f"{source}: {field}: {reason}{more}") from None


def _read(source: str | Path) -> str:
    shipped = files("auvplan") / "data" / "scenarios" / f"{source}.yaml"
    path = Path(source)
    if path.suffix not in (".yaml", ".yml") and "/" not in str(source) and shipped.is_file():
        return shipped.read_text(encoding="utf-8")
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise ScenarioError(f"{source}: larger than {_MAX_BYTES} bytes, not a scenario")
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise ScenarioError(f"{source}: not a text file") from None
    except OSError as error:
        names = ", ".join(sorted(e.name.removesuffix(".yaml") for e in shipped.parent.iterdir()))  # type: ignore[attr-defined]
        raise ScenarioError(
            f"{source}: {error.strerror or 'cannot be read'}; shipped scenarios: {names}"
        ) from None


class _PlainLoader(yaml.SafeLoader):
    """YAML without tags, anchors that multiply, or keys given twice."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.events.AliasEvent):
            event = self.peek_event()
            raise yaml.constructor.ConstructorError(None, None, "aliases are not allowed", event.start_mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"key {key.value!r} given twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)
