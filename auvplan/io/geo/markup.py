"""XML from strangers: read without document types, entities or anything from elsewhere."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError
from zipfile import ZipFile

from defusedxml import DefusedXmlException
from defusedxml.ElementTree import fromstring

from auvplan.io.geo.error import GeoError

#: Larger files hold no jobs.
_MAX_BYTES = 50_000_000


def read_xml(path: Path, kind: str) -> Element:
    """Return the root of an XML file, or of the one `.kml` in a zip archive.

    Args:
        path: of the file.
        kind: the name that the root has without its namespace.

    Raises:
        GeoError: one line; the file is too large, no XML, of another kind, or has a document type.
    """
    try:
        root = fromstring(_content(path), forbid_dtd=True)
    except DefusedXmlException:
        raise GeoError(f"{path}: has a document type or entities, which are not read") from None
    except ParseError as error:
        line, column = error.position
        raise GeoError(f"{path}: line {line}, column {column + 1}: not valid XML") from None
    if plain(root) != kind:
        raise GeoError(f"{path}: is no {kind.upper()}: its root is {plain(root)}")
    return root


def plain(element: Element) -> str:
    """Return an element's name without its namespace."""
    return str(element.tag).rpartition("}")[2]


def children(element: Element, *names: str) -> Iterator[Element]:
    """Yield the direct children of some names."""
    return (child for child in element if plain(child) in names)


def text_of(element: Element, name: str) -> str:
    """Return the text of the first child of a name; empty where there is none."""
    found = next(children(element, name), None)
    return "" if found is None else (found.text or "").strip()


def number_of(where: str, name: str, text: str) -> float:
    """Return a number that is written in a file.

    Raises:
        GeoError: it is none; the line names the field.
    """
    try:
        return float(text)
    except ValueError:
        raise GeoError(f"{where}: {name} must be a number, got {text[:40]!r}") from None


def _content(path: Path) -> bytes:
    if path.suffix.lower() != ".kmz":
        if path.stat().st_size > _MAX_BYTES:
            raise GeoError(f"{path}: larger than {_MAX_BYTES} bytes")
        return path.read_bytes()
    with ZipFile(path) as archive:
        inside = [entry for entry in archive.infolist() if entry.filename.lower().endswith(".kml")]
        if not inside:
            raise GeoError(f"{path}: has no .kml inside")
        if len(inside) > 1:
            listed = ", ".join(entry.filename for entry in inside)[:200]
            raise GeoError(f"{path}: holds {len(inside)} .kml, {listed}: it must hold one")
        with archive.open(inside[0]) as file:
            content = file.read(_MAX_BYTES + 1)  # whatever size the archive claims
    if len(content) > _MAX_BYTES:
        raise GeoError(f"{path}: {inside[0].filename} is larger than {_MAX_BYTES} bytes")
    return content
