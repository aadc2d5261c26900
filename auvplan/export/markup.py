"""XML elements and files."""

import re
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from auvplan.files import write_atomically

Element = ElementTree.Element

#: What XML 1.0 does not know as characters.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def plain(text: str) -> str:
    """Return text with question marks for what is no character to XML, and to most other formats."""
    return _FORBIDDEN.sub("?", text)


def child(
    parent: Element, name: str, text: str | None = None, attributes: Mapping[str, str] | None = None
) -> Element:
    """Append an element; characters that XML does not know become question marks."""
    clean = {key: plain(value) for key, value in (attributes or {}).items()}
    element = ElementTree.SubElement(parent, name, clean)
    element.text = None if text is None else plain(text)
    return element


def write_xml(root: Element, path: str | Path) -> Path:
    """Write a document in UTF-8, indented.

    Raises:
        OutputError: the operating system refused; one line that names the file.
    """
    ElementTree.indent(root)
    text = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return write_atomically(path, lambda part: part.write_bytes(text + b"\n"))
