"""YAML (1.1, as PyYAML reads it) to plain data that remembers where in the text every value stands.

Only mappings, lists and scalars are taken: no tags, aliases, merged or repeated keys. Keys stay text.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import yaml

#: Values nested deeper, and files of more bytes, are refused.
MAX_DEPTH, MAX_BYTES = 32, 1_000_000

_PREFIX = "tag:yaml.org,2002:"
_NUMBERS = (_PREFIX + "int", _PREFIX + "float")
_TAGS = {_PREFIX + name for name in ("map", "seq", "str", "int", "float", "bool", "null", "timestamp")}

Path = tuple[str | int, ...]
Place = tuple[int, int]


class YamlError(ValueError):
    """Text that is no plain YAML; one line, without the place.

    Attributes:
        place: line and column, from 1, or None.
    """

    def __init__(self, message: str, place: Place | None = None) -> None:
        super().__init__(message)
        self.place = place


@dataclass
class Document:
    """Plain data, and the line and column, from 1, of what it was made of."""

    data: Any = None  # mappings, lists and scalars
    keys: dict[Path, Place] = field(default_factory=dict)  # of every value in a mapping, where its key stands
    values: dict[Path, Place] = field(default_factory=dict)  # of every value, where it begins
    #: Keys given twice and scalars that cannot be, each with its path, reason and place.
    faults: list[tuple[Path, str, Place]] = field(default_factory=list)

    def place(self, path: Path) -> Place | None:
        """Return where a value begins, or the key of a mapping.

        Else the place of the nearest value around it.
        """
        for length in range(len(path), -1, -1):
            part = path[:length]
            if part in self.values:
                own = self.keys.get(part)
                mapping = own is not None and isinstance(value_at(self.data, part), dict)
                return own if mapping else self.values[part]
        return None


def read_yaml(text: str) -> Document:
    """Plain data with places.

    Raises:
        YamlError: the text is not YAML, is more than one document, is nested too deeply, or has an alias.
    """
    loader: Any = None
    try:
        loader = _Loader(text)
        node = loader.get_single_node()
        document = Document()
        if node is not None:
            document.data = _build(loader, node, (), document)
    except yaml.reader.ReaderError as error:
        before = text[: error.position]
        place = before.count("\n") + 1, error.position - before.rfind("\n")
        raise YamlError(f"a character that is no text, {chr(int(error.character))!r}", place) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = None if mark is None else (mark.line + 1, mark.column + 1)
        message = str(error.problem or "cannot be parsed")
        message = f"{error.context}, {message}" if message.startswith("but ") and error.context else message
        raise YamlError(" ".join(message.split())[:200], place) from None
    finally:
        if loader is not None:
            loader.dispose()
    return document


def _build(loader: Any, node: yaml.Node, path: Path, document: Document) -> Any:
    """Return the plain value of a node; notes where it stands and what is wrong with it."""
    document.values[path] = _place(node)
    if node.tag not in _TAGS:
        tag = node.tag.replace(_PREFIX, "!!")
        document.faults.append((path, f"the YAML tag {short(tag)} is not allowed", _place(node)))
        return None
    if isinstance(node, yaml.SequenceNode):
        return [_build(loader, part, (*path, k), document) for k, part in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode):
        return dict(_entries(loader, node, path, document))
    # YAML 1.1 has bases that numbers do not look like.
    base = "a number to base 60" if ":" in node.value else "octal"
    if node.tag in _NUMBERS and (":" in node.value or re.fullmatch(r"[-+]?0[0-7_]+", node.value)):
        taken = f"{short(node.value)} is {loader.construct_object(node)!r} in YAML, which takes it as {base}"
        document.faults.append((path, f"{taken}: write that, or put it in quotes", _place(node)))
        return None
    try:
        return loader.construct_object(node)
    except (ValueError, OverflowError, yaml.YAMLError) as error:
        reason = getattr(error, "problem", None) or str(error)
        message = " ".join(str(reason).split())[:200]
        document.faults.append((path, f"{short(node.value)} is no value: {message}", _place(node)))
        return None


def _entries(
    loader: Any, node: yaml.MappingNode, path: Path, document: Document
) -> Iterator[tuple[str, Any]]:
    seen: set[str] = set()
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or key.tag not in _TAGS:
            document.faults.append((path, "a key must be a word", _place(key)))
            continue
        name = str(key.value)
        inner = (*path, name)
        if name in seen:
            document.faults.append((inner, f"key {short(name)} given twice", _place(key)))
            continue
        seen.add(name)
        document.keys[inner] = _place(key)
        yield name, _build(loader, value, inner, document)


class _Loader(yaml.SafeLoader):
    """Refuses aliases and depth while composing, before either can multiply."""

    depth = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        mark = self.peek_event().start_mark
        if self.check_event(yaml.events.AliasEvent):
            raise yaml.MarkedYAMLError(None, None, "aliases are not allowed", mark)
        if self.depth > MAX_DEPTH:
            raise yaml.MarkedYAMLError(None, None, "nested too deeply", mark)
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def value_at(data: Any, path: Path) -> Any:
    """Return the part of plain data at a path.

    Raises:
        KeyError, IndexError, TypeError: there is none.
    """
    for part in path:
        data = data[part]
    return data


def _place(node: yaml.Node) -> Place:
    return node.start_mark.line + 1, node.start_mark.column + 1


def short(value: Any) -> str:
    """Return a piece of the file as a message may show it."""
    shown = repr(value)
    return shown if len(shown) <= 60 else f"{shown[:57]}..."
