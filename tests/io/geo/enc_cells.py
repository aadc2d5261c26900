"""Small S-57 cells, written by the book: the records of IHO S-57 edition 3.1, part 3, in ISO/IEC 8211.

GDAL's driver can create such files, but takes all layers in one session, which pyogrio has no way to do.
"""

import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

_UNIT, _FIELD = b"\x1f", b"\x1e"
_FACTOR = 10_000_000
#: Codes of object classes and attributes (S-57, appendix A).
_CLASSES = {
    "DEPARE": 42, "DRGARE": 46, "LNDARE": 71, "MARCUL": 82, "MIPARE": 83, "OBSTRN": 86, "PILPNT": 90,
    "PONTON": 95, "RESARE": 112, "SLCONS": 122, "UNSARE": 154, "UWTROC": 153, "WRECKS": 159, "M_COVR": 302,
}  # fmt: skip
_ATTRIBUTES = {
    "CATCOV": 18, "CATWRK": 71, "DRVAL1": 87, "DRVAL2": 88, "OBJNAM": 116, "PEREND": 118, "PERSTA": 119,
    "RESTRN": 131, "VALSOU": 179, "WATLEV": 187,
}  # fmt: skip
#: Tag, controls, name, labels and formats of each field.
_DEFINITIONS = (
    ("0001", "0500;&   ", "ISO 8211 Record Identifier", "", "(b12)"),
    ("DSID", "1600;&   ", "Data set identification field",
     "RCNM!RCID!EXPP!INTU!DSNM!EDTN!UPDN!UADT!ISDT!STED!PRSP!PSDN!PRED!PROF!AGEN!COMT",
     "(b11,b14,2b11,3A,2A(8),R(4),b11,2A,b11,b12,A)"),
    ("DSSI", "1600;&   ", "Data set structure information field",
     "DSTR!AALL!NALL!NOMR!NOCR!NOGR!NOLR!NOIN!NOCN!NOED!NOFA", "(3b11,8b14)"),
    ("DSPM", "1600;&   ", "Data set parameter field",
     "RCNM!RCID!HDAT!VDAT!SDAT!CSCL!DUNI!HUNI!PUNI!COUN!COMF!SOMF!COMT", "(b11,b14,3b11,b14,4b11,2b14,A)"),
    ("VRID", "1600;&   ", "Vector record identifier field", "RCNM!RCID!RVER!RUIN", "(b11,b14,b12,b11)"),
    ("VRPT", "2600;&   ", "Vector record pointer field", "*NAME!ORNT!USAG!TOPI!MASK", "(B(40),4b11)"),
    ("SG2D", "2500;&   ", "2-D coordinate field", "*YCOO!XCOO", "(2b24)"),
    ("FRID", "1600;&   ", "Feature record identifier field", "RCNM!RCID!PRIM!GRUP!OBJL!RVER!RUIN",
     "(b11,b14,2b11,2b12,b11)"),
    ("FOID", "1600;&   ", "Feature object identifier field", "AGEN!FIDN!FIDS", "(b12,b14,b12)"),
    ("ATTF", "2600;&   ", "Feature record attribute field", "*ATTL!ATVL", "(b12,A)"),
    ("FSPT", "2600;&   ", "Feature record to spatial record pointer field", "*NAME!ORNT!USAG!MASK",
     "(B(40),3b11)"),
)  # fmt: skip
_PAIRS = "0001DSIDDSIDDSSI0001DSPM0001FRIDFRIDFOIDFRIDATTFFRIDFSPT0001VRIDVRIDVRPTVRIDSG2D"
_PRIMITIVE = {"Point": 1, "LineString": 2, "Polygon": 3}


@dataclass(frozen=True)
class Object:
    """An object of a cell.

    Attributes:
        kind: acronym of its class.
        shape: point, line or polygon, longitude and latitude, degrees; None where an update deletes it.
        attributes: values by acronym.
        number: of the record, by which updates know it; its place in the list, from 1, if absent.
    """

    kind: str
    shape: Any
    attributes: Mapping[str, Any] = field(default_factory=dict)
    number: int | None = None


def write_cell(
    path: Path,
    objects: Iterable[Object],
    *,
    scale: int = 25_000,
    update: int = 0,
    first: int = 1,
    datum: int = 2,
    units: int = 1,
    edition: int = 1,
    reissued: int = 0,
) -> Path:
    """Write a cell, or an update of one, and return its path.

    Args:
        path: `.000` of a cell, `.001` and so on of an update.
        objects: that it holds; of an update those that it adds, and without shapes those that it deletes.
        scale: of compilation, one in so many.
        update: number of the update; 0 for a cell.
        first: number of the first vector record.
        datum: code of the horizontal datum; 2 is WGS 84.
        units: code of the unit of depths; 1 is metres.
        edition: number; 0 of an update that cancels its cell.
        reissued: number of the last update that a cell holds.
    """
    features, vectors = [], _Vectors(first)
    for place, one in enumerate(objects, 1):
        number, deleted = one.number or place, one.shape is None
        primitive = 255 if deleted else _PRIMITIVE[one.shape.geom_type]
        codes = 100, number, primitive, 2, _CLASSES[one.kind], 1 + deleted, 1 + deleted
        record = [
            ("FRID", struct.pack("<BIBBHHB", *codes)),
            ("FOID", struct.pack("<HIH", 550, number, 1)),
        ]
        if one.attributes:
            values = (
                struct.pack("<H", _ATTRIBUTES[name]) + str(value).encode("latin-1") + _UNIT
                for name, value in one.attributes.items()
            )
            record.append(("ATTF", b"".join(values)))
        if not deleted:
            record.append(("FSPT", vectors.of(one.shape)))
        features.append(record)
    name = path.name.encode()
    issue = (struct.pack("<BIBB", 10, 1, 1 + bool(update), 5) + name, str(edition).encode())
    issue += (str(update or reissued).encode(), b"2026010120260101" + b"03.1" + struct.pack("<B", 1), b"2.0")
    identity = _UNIT.join(issue) + _UNIT + struct.pack("<BH", 1 + bool(update), 550) + _UNIT
    counts = len(features), 0, vectors.nodes, vectors.joints, vectors.edges, 0
    head = [("DSID", identity), ("DSSI", struct.pack("<3B8I", 2, 0, 0, 0, 0, *counts))]
    records = [head]
    if not update:
        measures = struct.pack("<BI3BI4B2I", 20, 1, datum, 23, 23, scale, units, 1, 1, 1, _FACTOR, 10) + _UNIT
        records.append([("DSPM", measures)])
    written = map(_record, count(1), [*records, *vectors.records, *features])
    path.write_bytes(_definitions() + b"".join(written))
    return path


class _Vectors:
    """Spatial records: isolated nodes, and edges between connected nodes."""

    def __init__(self, first: int) -> None:
        self.records: list[list[tuple[str, bytes]]] = []
        self.nodes = self.joints = self.edges = 0
        self.number = first - 1

    def of(self, shape: Any) -> bytes:
        """Add the records of a shape, and return the pointers to them."""
        if shape.geom_type == "Point":
            self.nodes += 1
            return _pointer(110, self._add(110, shape.coords), 255, 255, 255)
        if shape.geom_type == "LineString":
            return self._edge(shape.coords, 255)
        rings = [(shape.exterior, 1), *((ring, 2) for ring in shape.interiors)]
        return b"".join(self._edge(ring.coords, usage) for ring, usage in rings)

    def _edge(self, places: Any, usage: int) -> bytes:
        places = list(places)
        begin = self._add(120, places[:1])
        end = begin if places[0] == places[-1] else self._add(120, places[-1:])
        self.joints += 2 - (begin == end)
        self.edges += 1
        ends = _pointer(120, begin, 255, 255, 1, 255) + _pointer(120, end, 255, 255, 2, 255)
        return _pointer(130, self._add(130, places[1:-1], ends), 1, usage, 255)

    def _add(self, kind: int, places: Any, ends: bytes = b"") -> int:
        self.number += 1
        record = [("VRID", struct.pack("<BIHB", kind, self.number, 1, 1))]
        if ends:
            record.append(("VRPT", ends))
        if places:
            pairs = (struct.pack("<2i", round(y * _FACTOR), round(x * _FACTOR)) for x, y in places)
            record.append(("SG2D", b"".join(pairs)))
        self.records.append(record)
        return self.number


def _pointer(kind: int, number: int, *rest: int) -> bytes:
    return struct.pack("<BI", kind, number) + bytes(rest)


def _definitions() -> bytes:
    """Return the data descriptive record."""
    fields = [("0000", b"0000;&   " + _UNIT + _PAIRS.encode())]
    for tag, controls, name, labels, formats in _DEFINITIONS:
        parts = (controls + name, labels, formats)
        fields.append((tag, _UNIT.join(part.encode() for part in parts)))
    return _packed(fields, b"3LE1 09", b" ! ")


def _record(number: int, fields: list[tuple[str, bytes]]) -> bytes:
    """Return a data record."""
    return _packed([("0001", struct.pack("<H", number % 65536)), *fields], b" D     ", b"   ")


def _packed(fields: list[tuple[str, bytes]], leader: bytes, charset: bytes) -> bytes:
    body, directory = b"", b""
    for tag, data in fields:
        directory += f"{tag}{len(data) + 1:05d}{len(body):05d}".encode()
        body += data + _FIELD
    directory += _FIELD
    base = 24 + len(directory)
    start = f"{base + len(body):05d}".encode() + leader + f"{base:05d}".encode() + charset + b"5504"
    return start + directory + body
