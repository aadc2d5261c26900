"""Checks the fields of a scenario: all that is wrong with them at once, not the first of it.

A faulty value is reported, taken out, and the rest checked again, so that it hides no other fault. What the
rest then lacks only because of what was taken out is not reported.
"""

import difflib
from copy import deepcopy
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from auvplan.errors import AuvplanError, RuleError
from auvplan.scenario.findings import Finding, finding_at, in_order
from auvplan.scenario.places import SWAPPED, localised
from auvplan.scenario.settings import MOVED, Area, SiteSettings
from auvplan.scenario.yaml_lines import Document, Path, short, value_at

#: Paths of the fields that a rule between fields looks at.
Concerns = tuple[Path, ...]

_Model = TypeVar("_Model", bound=BaseModel)


def check_fields(document: Document, model: type[_Model]) -> tuple[_Model | None, list[Finding]]:
    """Return a document as a model, or all that is wrong with its fields, in their order in the file."""
    checked, faults, _ = check_what_is_left(document, model)
    return (None if faults else checked), faults


def check_what_is_left(
    document: Document, model: type[_Model]
) -> tuple[_Model | None, list[Finding], set[Path]]:
    """Return a document as a model without the values that are at fault, the faults, and what was taken out.

    The model is None where nothing sound is left.
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
            found = _merged(error, plain, model)
        except Exception as error:  # what no rule has foreseen, such as dates at the end of time
            line = f"cannot be understood ({type(error).__name__}: {error})"
            return None, in_order([*faults, finding_at((), line, document)]), taken
        before = _count(plain), len(taken)
        for path, reason, kind, concerns in found:
            # What was taken out may be all that is wrong.
            follows = path[:2] in taken or path[:1] in taken
            if kind == "rule":
                follows = any(out[: len(of)] == of[: len(out)] for out in taken for of in concerns)
            if reason and not follows:
                hint = _swap_hint(path, reason, document.data)
                key = document.keys.get(path) if kind == "extra_forbidden" else None
                faults.append(finding_at(path, reason + hint, document, key))
        for path, _, kind, _ in found:
            _take_out(plain, path, kind, taken)
        if (_count(plain), len(taken)) == before:
            return None, in_order(faults), taken


def _merged(
    error: ValidationError, plain: dict[str, Any], model: type[BaseModel]
) -> list[tuple[Path, str, str, Concerns]]:
    """Path, reason, kind and fields concerned of the faults found; alternatives of one value become one."""
    merged: dict[Path, tuple[list[str], str, str, Concerns]] = {}
    for found in error.errors(include_url=False):
        path, reason, kind, got, concerns = _read_error(found, plain, model)
        reasons, *_ = merged.setdefault(path, ([], kind, got, concerns))
        if reason not in reasons:
            reasons.append(reason)
    return [
        (path, " or ".join(reasons) + got, kind, concerns)
        for path, (reasons, kind, got, concerns) in merged.items()
    ]


def _read_error(
    found: Any, plain: dict[str, Any], model: type[BaseModel]
) -> tuple[Path, str, str, str, Concerns]:
    """Path, reason, kind, what was got and fields concerned of one of pydantic's errors."""
    path, kind = found["loc"], found["type"]
    if kind == "value_error":
        error = found["ctx"]["error"]
        reason = error.reason if isinstance(error, AuvplanError) else str(error)
        if len(path) > 1 or not isinstance(error, RuleError):
            at = (*path, *error.field.split(".")) if isinstance(error, AuvplanError) and error.field else path
            return _known_part(at, plain), reason, kind, "", ()
        concerns = tuple((*path, *name.split(".")) for name in (error.field, *error.concerns))
        return concerns[0], reason, "rule", "", concerns
    if kind == "extra_forbidden":
        return path, unknown_key(path, model), kind, "", ()
    if kind == "missing":
        if isinstance(path[-1], int):
            return path[:-1], f"has too few entries: {len(value_at(plain, path[:-1]))}", "value", "", ()
        return path, "is missing", kind, "", ()
    message = found["msg"]
    if kind in ("model_type", "model_attributes_type"):
        message = "must be a section of fields"
    got = "" if isinstance(found["input"], dict | list | tuple) else f", got {short(found['input'])}"
    return _known_part(path, plain), message.replace("Input should", "must", 1), kind, got, ()


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
    if path == ("site", "latitude") and isinstance(site, dict):
        turned = site | {"longitude": site.get("latitude"), "latitude": site.get("longitude")}
        try:
            SiteSettings.model_validate(turned)
        except ValueError:
            return ""
        return SWAPPED
    if path not in (("mission", "start"), ("mission", "goal")) or "outside the area" not in reason:
        return ""
    place = value_at(data, path)
    if not isinstance(place, dict):
        return ""
    turned = place | {"longitude": place["latitude"], "latitude": place["longitude"]}
    try:
        known = SiteSettings.model_validate(site).site
        local = localised({"mission": {"start": turned}, "area": data.get("area", {})}, known)
        area, start = Area.model_validate(local["area"]), local["mission"]["start"]
        inside = all(a <= p <= b for a, p, b in zip(area.lower[:2], start, area.upper[:2], strict=False))
    except (TypeError, ValueError):  # one that is none either
        return ""
    return ": with its longitude and latitude swapped it would lie within" if inside else ""


def _take_out(plain: dict[str, Any], path: Path, kind: str, taken: set[Path]) -> None:
    """Remove the faulty value, or else its section."""
    section = plain.get(str(path[0])) if path else None
    if kind == "missing" and isinstance(section, dict) and len(path) > 1:
        section[path[1]] = 0.0
        taken.add(path[:2])
    elif isinstance(section, dict) and len(path) > 1 and path[1] in section:
        del section[path[1]]
        taken.add(path[:2])
    elif path and path[0] in plain:
        del plain[str(path[0])]
        taken.add(path[:1])


def _known_part(path: Path, plain: dict[str, Any]) -> Path:
    """As much of a path as there is in the data: pydantic adds the names of alternatives."""
    for length in range(len(path)):
        inside, part = value_at(plain, path[:length]), path[length]
        if isinstance(inside, list):
            known = isinstance(part, int) and part < len(inside)
        else:
            known = isinstance(inside, dict) and part in inside
        if not known:
            return path[:length]
    return path


def _count(plain: dict[str, Any]) -> int:
    return sum(1 + (len(part) if isinstance(part, dict) else 0) for part in plain.values())
