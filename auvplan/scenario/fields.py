"""Checks the fields of a scenario: all that is wrong with them at once, not the first of it.

A faulty value is reported, taken out, and the rest checked again, so that it hides no other fault. What the
rest then lacks only because of what was taken out is not reported.
"""

import difflib
from collections.abc import Iterable
from copy import deepcopy
from dataclasses import dataclass, field
from pathlib import Path as FilePath
from typing import Any, Literal, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from auvplan.errors import AuvplanError, RuleError
from auvplan.runtime.files import read_text
from auvplan.scenario.section import SWAPPED, localised
from auvplan.scenario.settings import MOVED, Area, SiteSettings
from auvplan.scenario.yaml_lines import (
    MAX_BYTES,
    Document,
    Path,
    Place,
    YamlError,
    read_yaml,
    short,
    value_at,
)

#: Characters of a reason that are shown.
_LONGEST = 500

Severity = Literal["error", "warning", "note"]
_Model = TypeVar("_Model", bound=BaseModel)


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, may not be meant, or was assumed.

    Attributes:
        field: dotted, such as "mission.time_available"; empty for the file as a whole.
        reason: one line.
        place: line and column in the file, from 1, or None.
        severity: an error stands in the way of a mission.
    """

    field: str
    reason: str
    place: Place | None = None
    severity: Severity = "error"

    def line(self, source: str) -> str:
        """As compilers write it: `FILE:LINE:COL field: reason`; the reason alone of what is no field's."""
        if self.severity != "error" and not self.field:
            return self.reason
        where = source if self.place is None else f"{source}:{self.place[0]}:{self.place[1]}"
        return " ".join(f"{where} {self.field or 'scenario'}: {self.reason}".split())


def finding_at(
    path: Path, reason: str, document: Document, place: Place | None = None, severity: Severity = "error"
) -> Finding:
    """Return a finding on a value in a document."""
    line = " ".join(reason.split())
    line = line if len(line) <= _LONGEST else f"{line[:_LONGEST]} ..."
    # One word that can be printed, whatever the keys hold.
    parts = [str(part) for part in path]
    parts = [one if one.isprintable() and len(one) <= 80 else ascii(one[:80])[1:-1] for one in parts]
    return Finding(".".join(parts), line, place or document.place(path), severity)


def in_order(findings: Iterable[Finding]) -> list[Finding]:
    """As they stand in the file, those without a place last; each once."""
    return sorted(dict.fromkeys(findings), key=lambda finding: finding.place or (1 << 30, 0))


def first_of(findings: list[Finding], source: str, is_file: bool) -> str:
    """Return the first finding on one line that names the file, and how many more there are."""
    first, more = findings[0], len(findings) - 1
    where = f"{source}:{first.place[0]}" if first.place is not None else source
    line = f"{where}: {first.field + ': ' if first.field else ''}{first.reason}"
    if not more:
        return line
    return f"{line} (and {more} more{f': auvplan validate {source} lists all' if is_file else ''})"


@dataclass
class _Fault:
    """A value that pydantic, or a rule between fields, refuses."""

    path: Path
    kind: str
    reasons: list[str]  # of each alternative
    got: str = ""
    concerns: tuple[Path, ...] = field(default=())  # the fields that a rule looks at

    @property
    def reason(self) -> str:
        return " or ".join(self.reasons) + self.got

    def follows(self, taken: set[Path]) -> bool:
        """Return whether what was taken out may be all that is wrong."""
        if self.kind == "rule":
            return any(out[: len(of)] == of[: len(out)] for out in taken for of in self.concerns)
        return self.path[:2] in taken or self.path[:1] in taken


def read_section(path: str | FilePath, model: type[_Model], fault: type[AuvplanError]) -> _Model:
    """Read a YAML file that is a section by itself.

    Raises:
        AuvplanError: a `fault`; lines that name file, field and reason of all that is wrong.
    """
    try:
        found, faults, _ = check_fields(read_yaml(read_text(path, fault, MAX_BYTES)), model)
    except YamlError as error:
        raise fault(f"{path}: is no YAML: {error}") from None
    if faults or found is None:
        raise fault(*(first_of([one], str(path), is_file=False) for one in faults))
    return found


def check_fields(document: Document, model: type[_Model]) -> tuple[_Model | None, list[Finding], set[Path]]:
    """Return a document as a model without the values that are at fault, the faults, and what was taken out.

    The faults are in their order in the file. The model is None where nothing sound is left.
    """
    faults = [finding_at(path, reason, document, place) for path, reason, place in document.faults]
    if not isinstance(document.data, dict):
        what = "nothing" if document.data is None else type(document.data).__name__
        line = f"must be a mapping of fields, got {what}"
        return None, faults or [Finding("", line, document.place(()))], set()
    plain = deepcopy(document.data)
    taken: set[Path] = {path[:2] for path, _, _ in document.faults if value_at(document.data, path) is None}
    while True:
        try:
            return model.model_validate(plain), in_order(faults), taken
        except ValidationError as error:
            merged: dict[Path, _Fault] = {}  # alternatives of one value are one fault
            for one in error.errors(include_url=False):
                fault = _read_error(one, plain, model)
                known = merged.setdefault(fault.path, fault)
                known.reasons += [reason for reason in fault.reasons if reason not in known.reasons]
            found = list(merged.values())
        except Exception as error:  # what no rule has foreseen, such as dates at the end of time
            line = f"cannot be understood ({type(error).__name__}: {error})"
            return None, in_order([*faults, finding_at((), line, document)]), taken
        for fault in found:
            if fault.reason and not fault.follows(taken):
                hint = _swap_hint(fault.path, fault.reason, document.data)
                key = document.keys.get(fault.path) if fault.kind == "extra_forbidden" else None
                faults.append(finding_at(fault.path, fault.reason + hint, document, key))
        gone = [_take_out(plain, fault, taken) for fault in found]
        if not any(gone):
            return None, in_order(faults), taken


def _read_error(found: Any, plain: dict[str, Any], model: type[BaseModel]) -> _Fault:
    """Return one of pydantic's errors in our words."""
    path, kind, message = found["loc"], found["type"], found["msg"]
    if kind == "value_error":
        error = found["ctx"]["error"]
        reason = error.reason if isinstance(error, AuvplanError) else str(error)
        if len(path) > 1 or not isinstance(error, RuleError):
            at = (*path, *error.field.split(".")) if isinstance(error, AuvplanError) and error.field else path
            return _Fault(_known_part(at, plain), kind, [reason])
        concerns = tuple((*path, *name.split(".")) for name in (error.field, *error.concerns))
        return _Fault(concerns[0], "rule", [reason], concerns=concerns)
    if kind == "extra_forbidden":
        return _Fault(path, kind, [unknown_key(path, model)])
    if kind == "missing" and isinstance(path[-1], int):
        return _Fault(path[:-1], "value", [f"has too few entries: {len(value_at(plain, path[:-1]))}"])
    if kind == "missing":
        return _Fault(path, kind, ["is missing"])
    if kind in ("model_type", "model_attributes_type"):
        message = "must be a section of fields"
    got = "" if isinstance(found["input"], dict | list | tuple) else f", got {short(found['input'])}"
    return _Fault(_known_part(path, plain), kind, [message.replace("Input should", "must", 1)], got)


def unknown_key(path: Path, model: type[BaseModel]) -> str:
    """Return what to say of a key that there is not.

    The one that may be meant, or the section where it belongs.
    """
    key = str(path[-1])
    if moved := MOVED.get(".".join(map(str, path))):
        return f"is now {moved}"
    sections = {name: _section(model, name) for name in model.model_fields}
    home: type[BaseModel] | None = model
    for part in path[:-1]:
        home = home and _section(home, str(part))
    elsewhere = {
        f"{name}.{inner}": inner for name, part in sections.items() if part for inner in part.model_fields
    }
    close = difflib.get_close_matches(key, list(home.model_fields) if home else [], 1, 0.6)
    if not close:
        near = difflib.get_close_matches(key, elsewhere.values(), 1, 0.8)
        close = [name for name, inner in elsewhere.items() if inner in near][:1]
    return f"unknown key {short(key)}" + (f", did you mean {close[0]!r}?" if close else "")


def _section(model: type[BaseModel], name: str) -> type[BaseModel] | None:
    """Return the model of a field that is a section; None of a plain field or of none."""
    annotation = model.model_fields[name].annotation if name in model.model_fields else None
    for part in (annotation, *get_args(annotation)):
        if isinstance(part, type) and issubclass(part, BaseModel):
            return part
    return None


def _swap_hint(path: Path, reason: str, data: dict[str, Any]) -> str:
    """Return what to add where longitude and latitude of the site or of a place are swapped; or nothing."""
    site = data.get("site")
    try:
        if path == ("site", "latitude") and isinstance(site, dict):
            turned = {"longitude": site.get("latitude"), "latitude": site.get("longitude")}
            SiteSettings.model_validate(site | turned)
            return SWAPPED
        if path in (("mission", "start"), ("mission", "goal")) and "outside the area" in reason:
            place, known = value_at(data, path), SiteSettings.model_validate(site).site
            area = Area.model_validate(localised({"area": data.get("area", {})}, known)["area"])
            turned = known.to_local(place["latitude"], place["longitude"])
            if all(a <= p <= b for a, p, b in zip(area.lower, turned, area.upper, strict=False)):
                return ": with its longitude and latitude swapped it would lie within"
    except (TypeError, ValueError):  # one that is none either
        pass
    return ""


def _take_out(plain: dict[str, Any], fault: _Fault, taken: set[Path]) -> bool:
    """Remove a faulty value, or else its section; return whether it was there."""
    path = fault.path
    section = plain.get(str(path[0])) if path else None
    if isinstance(section, dict) and len(path) > 1 and fault.kind == "missing":
        new, section[path[1]] = path[:2] not in taken, 0.0
        taken.add(path[:2])
        return new
    if isinstance(section, dict) and len(path) > 1 and path[1] in section:
        del section[path[1]]
        taken.add(path[:2])
        return True
    if path and path[0] in plain:
        del plain[str(path[0])]
        taken.add(path[:1])
        return True
    return False


def _known_part(path: Path, plain: dict[str, Any]) -> Path:
    """As much of a path as there is in the data: pydantic adds the names of alternatives."""
    for length, part in enumerate(path):
        inside = value_at(plain, path[:length])
        if isinstance(inside, list):
            known = isinstance(part, int) and part < len(inside)
        else:
            known = isinstance(inside, dict) and part in inside
        if not known:
            return path[:length]
    return path
