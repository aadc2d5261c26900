"""Changes to files for `benchmarks.fuzz`: of bytes, and of what the bytes mean in each format.

What is text - JSON, YAML, tables, XML - is read into nested dicts and lists, altered there and written again.
"""

import json
import os
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import yaml

from benchmarks.harness import Rng

Tree = Any

#: What replaces a value in a tree, beside names of files, and a number.
EXTREMES: tuple[Any, ...] = (
    float("nan"), float("inf"), -0.0, 0, -1, 1e308, -1e308, 5e-324, 2**31, -(2**63), 10**30, 10**400, "",
    None, True, [], {}, [[]], [None], {"": None}, "1e400", "0x10", "nan", "2026-13-45T99:00:00Z",
    "9999-12-31T23:59:59Z", "24:00Z/23:00Z", "\x00", "\ud800", "a\nb", "\u202e", "%s%n{0}",
)  # fmt: skip
NAMES = "/etc/passwd", "../" * 12 + "etc/passwd", "file:///etc/passwd", "~/.bashrc", "/dev/zero"
NUMBERS = (
    float("nan"), 1e308, -1e308, -0.0, 0.0, 1e-300, 10**30, 10**400, -1, 2**31, 1e9, "@@digits@@",
)  # fmt: skip

#: Words that stand for raw text, which no tree can hold, until the tree is written.
_RAW = {
    "@@long@@": '"' + "x" * 1_000_000 + '"',
    "@@deep@@": "[" * 10_000 + "]" * 10_000,
    "@@digits@@": "9" * 10_000,
}
_LAUGHS = [f"&a{k} [{', '.join([f'*a{k - 1}' if k else 'ha'] * 9)}]" for k in range(10)]
#: The same for YAML: tags that build objects, aliases that multiply, dates that are none.
_YAML = _RAW | {
    "@@tag@@": '!!python/object/apply:os.system ["true"]',
    "@@module@@": "!!python/name:os.system",
    "@@set@@": "!!set {a, b}",
    "@@binary@@": "!!binary Zm9v",
    "@@date@@": "2026-13-45",
    "@@clock@@": "99:99:99",
    "@@self@@": "&self [*self]",
    "@@laughs@@": f"[{', '.join(_LAUGHS)}]",
    "@@merge@@": "{<<: &m {a: 1}, <<: *m}",
}
_ENTITIES = ['<!ENTITY a0 "ha">', *(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))]


def change(path: Path, rng: Rng, outside: Path) -> str:
    """Change a file, and say how.

    Args:
        path: of the file; its name tells the format.
        outside: a folder of files that no reader has any business with, some of which are put in as names.
    """
    by_format = _FORMATS.get(path.suffix.lower())
    if by_format is None or rng.random() < 0.3:
        return _bytes(path, rng)
    try:
        return by_format(path, rng, outside)
    # What cannot be taken apart any more is changed as bytes: two changes may hit one file.
    except Exception as error:
        return f"{_bytes(path, rng)} (not as {path.suffix}: {type(error).__name__})"


def _pick(rng: Rng, options: Sequence[Any]) -> Any:
    return options[int(rng.integers(len(options)))]


def _bytes(path: Path, rng: Rng) -> str:
    whole = path.read_bytes()
    kind = int(rng.integers(8))
    if kind == 0 or not whole:
        path.write_bytes(b"")
        return "emptied"
    place = int(rng.integers(len(whole)))
    if kind == 1:
        size = int(rng.integers(1, 4096))
        path.write_bytes(whole[: place + size] + whole[place:] * int(rng.integers(1, 4)))
        return "bytes repeated"
    if kind == 2:
        odd = (b"\xff\xfe", b"\x00" * 16, b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\r\r\n", b'"', b"9" * 400)
        path.write_bytes(whole[:place] + _pick(rng, odd) + whole[place:])
        return "bytes put in"
    return damage(path, rng)


def damage(path: Path, rng: Rng) -> str:
    """Cut a file off, or zero or change some of its bytes; say which."""
    whole = bytearray(path.read_bytes())
    kind = rng.integers(4)
    if kind == 0:
        path.write_bytes(whole[: int(rng.integers(len(whole)))])
        return "cut off"
    if kind == 1:
        first = int(rng.integers(len(whole)))
        size = int(rng.integers(1, 4096))
        whole[first : first + size] = bytes(len(whole[first : first + size]))
        path.write_bytes(whole)
        return "bytes zeroed"
    end = len(whole) if kind == 2 else min(len(whole), 20_000)
    for place in rng.integers(0, end, int(rng.integers(1, 6))):
        whole[place] = int(rng.integers(256))
    path.write_bytes(whole)
    return "bytes changed" if kind == 2 else "bytes of the head changed"


def _places(tree: Tree) -> list[tuple[Any, Any]]:
    """Every container with a key or index of it."""
    found, left = [], [tree]
    while left:
        inside = left.pop()
        for key in list(inside) if isinstance(inside, dict) else range(len(inside)):
            found.append((inside, key))
            if isinstance(inside[key], dict | list):
                left.append(inside[key])
    return found


def _files(outside: Path) -> list[str]:
    return [str(file) for file in sorted(outside.iterdir())]


def _alter(tree: Tree, rng: Rng, outside: Path, words: Sequence[str]) -> str:
    if not (places := _places(tree)):
        return "nothing"
    inside, key = _pick(rng, places)
    kind = int(rng.integers(8))
    if kind < 5:
        # A value within its kind gets farther than one of another kind.
        number = isinstance(inside[key], float | int) and not isinstance(inside[key], bool)
        if kind < 2 and number:
            values = NUMBERS
        elif (share := rng.random()) < 0.15:
            values = [*NAMES, *_files(outside)]
        else:
            values = words if share < 0.4 else EXTREMES
        inside[key] = _pick(rng, values)
        return f"{str(key)[:40]} = {repr(inside[key])[:40]}"
    if kind == 5:
        del inside[key]
        return f"{str(key)[:40]} taken away"
    if isinstance(inside, list):
        times = int(rng.choice([2, 3, 2000]))
        inside[key:key] = [inside[key]] * times
        return f"item {key} {times} times more"
    twice = f"@@twice@@{key}"
    other = _pick(rng, ["x", "", f"{key} ", str(key).upper(), "__proto__", twice, *map(str, inside)])
    inside[other] = inside[key] if other == twice else inside.pop(key)
    return f"{str(key)[:40]} renamed {other[:40]}"


def _altered(text: str, rng: Rng, outside: Path, form: "Form") -> tuple[str, str]:
    load, dump, words = form
    tree = load(text)
    # Few changes, so that most of it is still read.
    said = [_alter(tree, rng, outside, list(words)) for _ in range(int(rng.choice([1, 1, 1, 2, 3])))]
    text = dump(tree, rng)
    for word, raw in words.items():
        text = text.replace(f'"{word}"', raw).replace(f"'{word}'", raw).replace(word, raw.strip('"'))
    return text.replace("@@twice@@", ""), "; ".join(said)


def _cells(tree: Tree, rng: Rng) -> str:
    mark = str(rng.choice([",", ",", ",", ";", "\t", "|"]))
    return "\n".join(mark.join(map(str, row)) if isinstance(row, list) else str(row) for row in tree)


def _nested(element: ElementTree.Element) -> Tree:
    return [element.tag, dict(element.attrib), element.text or "", *map(_nested, element)]


def _element(tree: Tree) -> ElementTree.Element:
    tag, attributes, text, *inner = tree
    element = ElementTree.Element(str(tag), {str(key): str(value) for key, value in attributes.items()})
    element.text = re.sub("[\x00-\x08\ud800-\udfff]", "?", str(text))
    element.extend(map(_element, inner))
    return element


#: How a text is read into a tree and written, and the words that stand for raw text in it.
Form = tuple[Callable[[str], Tree], Callable[[Tree, Rng], str], dict[str, str]]
_XML: Form = (
    lambda text: _nested(ElementTree.fromstring(text)),
    lambda tree, rng: ElementTree.tostring(_element(tree), encoding="unicode"),
    _RAW,
)
_FORMS: dict[str, Form] = {
    "json": (json.loads, lambda tree, rng: json.dumps(tree, ensure_ascii=bool(rng.random() < 0.7)), _RAW),
    "lines": (
        lambda text: [json.loads(line) for line in text.splitlines()],
        lambda tree, rng: "\n".join(map(json.dumps, tree)) + "\n",
        _RAW,
    ),
    "yaml": (
        yaml.safe_load,
        lambda tree, rng: yaml.safe_dump(tree, allow_unicode=True, sort_keys=False, width=10_000),
        _YAML,
    ),
    "table": (lambda text: [line.split(",") for line in text.splitlines()], _cells, _RAW),
    # A text of numbers and words, such as a world file.
    "words": (partial(re.split, r"(\s+)"), lambda tree, rng: "".join(map(str, tree)), _RAW),
}


def _text(path: Path, rng: Rng, outside: Path, change: Callable[..., tuple[str, str]]) -> str:
    text, said = change(path.read_text(encoding="utf-8"), rng, outside)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return said


def _xml(text: str, rng: Rng, outside: Path) -> tuple[str, str]:
    kind = int(rng.integers(8))
    if kind == 3:
        tag = _pick(rng, list(re.finditer(r"<[A-Za-z]\w*[^>]*>", text)))
        deep = "<a>" * 10_000 + "</a>" * 10_000
        return text[: tag.end()] + deep + text[tag.end() :], "elements 10,000 deep"
    if kind > 3:
        return _altered(text, rng, outside, _XML)
    file = _pick(rng, ["/etc/passwd", *_files(outside)])
    stated, use, said = (
        (f"[{''.join(_ENTITIES)}]", "&a9;", "entities that multiply"),
        (f'[<!ENTITY e SYSTEM "file://{file}">]', "&e;", "an entity from a file"),
        ('SYSTEM "http://127.0.0.1:9/x.dtd"', "", "a type from a server"),
    )[kind]
    head = re.match(r"\s*<\?xml.*?\?>", text)
    at = head.end() if head else 0
    place = _pick(rng, [found.end() - 1 for found in re.finditer(r">[^<>]*<", text[at:])] or [0])
    return f"{text[:at]}<!DOCTYPE x {stated}>{text[at : at + place]}{use}{text[at + place :]}", said


def _kmz(path: Path, rng: Rng, outside: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        content = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    name = next(name for name in content if name.endswith(".kml"))
    kind = int(rng.integers(4))
    if kind == 0:
        content[name] = content[name] + b" " * 300_000_000
        said = "300 MB of blanks"
    elif kind == 1:
        other = _pick(rng, ["../../evil.kml", "/etc/evil.kml", "C:\\evil.kml", "x" * 60_000 + ".kml"])
        content = {other: content.pop(name), **content}
        said = f"named {other[:40]}"
    elif kind == 2:
        content = {f"{k}.kml": b"<kml/>" for k in range(3000)} | content
        said = "3,000 files"
    else:
        text, said = _xml(content[name].decode("utf-8"), rng, outside)
        content[name] = text.encode("utf-8", "surrogatepass")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for own, text in content.items():
            archive.writestr(own, text)
    return said


def _netcdf(path: Path, rng: Rng, outside: Path) -> str:
    if not h5py.is_hdf5(path):
        return _numbers(path, rng)
    with h5py.File(path, "r+") as file:
        names = sorted(str(name) for name in file if isinstance(file.get(name), h5py.Dataset))
        return _pick(rng, _HDF5)(file, _pick(rng, names), rng, outside)


def _value(file: h5py.File, name: str, rng: Rng, outside: Path) -> str:
    data: Any = file[name]
    if data.dtype.kind not in "iuf" or not data.size:
        return _attribute(file, name, rng, outside)
    whole = 0, 1, -1, 2, 100, 2**31 - 1, -(2**31)
    with np.errstate(all="ignore"):
        numbers = (np.nan, np.inf, 0.0, -1.0, 1e9, 1e30, 1e308) if data.dtype.kind == "f" else whole
        number = np.asarray(_pick(rng, numbers)).astype(data.dtype)
    share = _pick(rng, (0.0, 0.0, 0.5, 1.0))
    if not data.shape:
        data[()] = number
    elif share < 0.5:
        data[tuple(int(rng.integers(size)) for size in data.shape)] = number
    else:
        data[: int(np.ceil(share * len(data)))] = number
    return f"{name} = {number}"


def _attribute(file: h5py.File, name: str, rng: Rng, outside: Path) -> str:
    holder: Any = file if rng.random() < 0.5 and len(file.attrs) else file[name]
    own = [str(key) for key in holder.attrs if key not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS")]
    key = _pick(rng, [*own, "scale_factor", "_FillValue", "units", "coordinates"])
    if key in holder.attrs and rng.random() < 0.2:
        del holder.attrs[key]
        return f"{key} taken away"
    there = holder.attrs.get(key)
    text = there.decode("utf-8", "replace") if isinstance(there, bytes) else there
    if isinstance(text, str) and text.startswith(("{", "[")) and rng.random() < 0.8:
        text, said = _altered(text, rng, outside, _FORMS["json"])
        holder.attrs[key] = text[:60_000].encode("utf-8", "surrogatepass")
        return f"{key}: {said}"
    values = (
        0, -1, 1e308, np.nan, "", "x" * 60_000, "\x00", np.zeros(0), np.arange(5.0),
        "seconds since 0000-00-00", "days since 9999-99-99", str(outside), "nan", 2**62,
        "é" * 100, np.array([["a", "b"]], object),
    )  # fmt: skip
    value = _pick(rng, values)
    strings = isinstance(value, np.ndarray) and value.dtype == object
    holder.attrs.create(key, value, dtype=h5py.string_dtype() if strings else None)
    return f"{key} = {repr(value)[:40]}"


def _renamed(file: h5py.File, name: str, rng: Rng, _: Path) -> str:
    if rng.random() < 0.5:
        del file[name]
        return f"{name} taken away"
    other = _pick(rng, [f"{name}_2", "x" * 300, name.upper(), "time", "é"])
    if other in file:
        del file[other]
    file.move(name, other)
    return f"{name} renamed {other[:40]}"


def _reshaped(file: h5py.File, name: str, rng: Rng, _: Path) -> str:
    """A variable of another shape; of very many values that are not stored."""
    data: Any = file[name]
    shapes: list[tuple[int, ...]] = [
        (), (0,), (1,), (7,), data.shape[::-1], (*data.shape, 2), (10**5, 10**5), (10**9,), (3 * 10**8,)
    ]  # fmt: skip
    shape = _pick(rng, shapes)
    dtype = data.dtype if rng.random() < 0.7 else np.dtype(_pick(rng, ["S5", "u1", "f8", "c16", "?"]))
    del file[name]
    chunks = tuple(min(max(size, 1), 1000) for size in shape) if np.prod(shape, dtype=float) > 1e6 else None
    file.create_dataset(name, shape, dtype, chunks=chunks)
    return f"{name} of shape {shape}, {dtype}"


def _linked(file: h5py.File, name: str, rng: Rng, outside: Path) -> str:
    """A variable whose values lie in another file."""
    data: Any = file[name]
    shape, dtype, other = data.shape, data.dtype, str(outside / "linked.nc")
    kind = int(rng.integers(4))
    if kind == 3 or (kind and not (shape and dtype.kind in "iuf")):
        file["more"] = h5py.ExternalLink(other, "/")
        return "a group that is a link to another file"
    del file[name]
    if kind == 0:
        file[name] = h5py.ExternalLink(other, "/secret")
    elif kind == 1:
        external = [(str(outside / "linked.txt"), 0, h5py.h5f.UNLIMITED)]
        file.create_dataset(name, shape, dtype, external=external)
    else:
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource(other, "secret", shape=shape)
        file.create_virtual_dataset(name, layout)
    return f"{name} {('a link to', 'stored in', 'made of')[kind]} another file"


_HDF5 = _value, _value, _value, _attribute, _attribute, _attribute, _renamed, _reshaped, _linked


def _numbers(path: Path, rng: Rng) -> str:
    """Of a binary file: four bytes of its head that count something."""
    whole = bytearray(path.read_bytes())
    place = 4 * int(rng.integers(min(len(whole), 4000) // 4))
    number = _pick(rng, [0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000000, 65536])
    struct.pack_into(_pick(rng, [">I", "<I"]), whole, place, number)
    path.write_bytes(whole)
    return f"bytes at {place} = {number}"


def _tiff(path: Path, rng: Rng, outside: Path) -> str:
    """Of an entry of the first directory: its type, its count or its value."""
    whole = bytearray(path.read_bytes())
    order = "<" if whole[:2] == b"II" else ">"
    (first,) = struct.unpack_from(order + "I", whole, 4)
    (count,) = struct.unpack_from(order + "H", whole, first)
    entry = first + 2 + 12 * int(rng.integers(count))
    (tag,) = struct.unpack_from(order + "H", whole, entry)
    number = _pick(rng, [0, 1, 2, 3, 255, 65535, 10**6, 2**31 - 1, 2**31, 2**32 - 1])
    part, form, said = _pick(rng, [(2, "H", "type"), (4, "I", "count"), (8, "I", "value"), (8, "I", "value")])
    struct.pack_into(order + form, whole, entry + part, number & (0xFFFF if form == "H" else 0xFFFFFFFF))
    path.write_bytes(whole)
    return f"{said} of tag {tag} = {number}"


def _png(path: Path, rng: Rng, outside: Path) -> str:
    whole, at, chunks = path.read_bytes(), 8, []
    while at + 12 <= len(whole):
        (size,) = struct.unpack_from(">I", whole, at)
        chunks.append((whole[at + 4 : at + 8], whole[at + 8 : at + 8 + size]))
        at += 12 + size
    kind, head = int(rng.integers(6)), bytearray(chunks[0][1])
    if kind == 5:
        postscript = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 80 60\n%%EndComments\nshowpage\n%%EOF\n"
        path.write_bytes(postscript)
        return "PostScript, which is a program"
    if kind < 2:
        number = _pick(rng, [0, 1, 7999, 60_000, 2**31 - 1, 2**32 - 1])
        struct.pack_into(">I", head, _pick(rng, [0, 4]), number)
        said = f"a side of {number}"
    elif kind == 2:
        head[8 + int(rng.integers(5))] = int(rng.integers(256))
        said = "another kind of picture"
    elif kind == 3:
        chunks[1:1] = [(b"zTXt", b"a\0\0" + zlib.compress(b"x" * 200_000_000, 1))]
        said = "200 MB of text"
    else:
        chunks[1:1], said = [(b"PLTE", bytes(int(rng.integers(0, 900))))], "a table of colours"
    chunks[0] = chunks[0][0], bytes(head)
    parts = [struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))
             for name, body in chunks]  # fmt: skip
    path.write_bytes(whole[:8] + b"".join(parts))
    return said


def _vector(path: Path, rng: Rng, outside: Path) -> str:
    """Another format under the name, one that refers to files elsewhere."""
    other = outside / "linked.geojson"
    virtual = (
        f'<OGRVRTDataSource><OGRVRTLayer name="linked"><SrcDataSource>{other}</SrcDataSource>'
        "</OGRVRTLayer></OGRVRTDataSource>"
    )
    kinds = virtual, other.read_text(encoding="utf-8"), f"CSV:{other}", "<GDAL_WMS></GDAL_WMS>", None, None
    kind = _pick(rng, kinds)
    if kind is None:
        return _numbers(path, rng)
    path.write_text(kind, encoding="utf-8")
    return "another format that names a file" if kind is virtual else "another format"


class _Call:
    """What calls a function when it is unpickled."""

    def __reduce__(self) -> Any:
        return os.system, ("true",)


def _arrays(path: Path, rng: Rng, outside: Path) -> str:
    with np.load(path) as found:
        arrays = {name: found[name] for name in found}
    name = _pick(rng, sorted(arrays))
    value, said = _pick(rng, (
        (np.array([_Call()], object), "an object that calls"),
        (None, "taken away"),
        (np.zeros((3, 0, 2)), "of no values"),
        (np.zeros(100_000_000, np.uint8), "of 100 MB"),
    ))  # fmt: skip
    arrays[name] = value
    np.savez_compressed(path, **{name: array for name, array in arrays.items() if array is not None})
    return f"{name} {said}"


_JSON, _LINES, _YAML_FILE, _TABLE, _WORDS = (
    partial(_text, change=partial(_altered, form=form)) for form in _FORMS.values()
)
_MARKUP = partial(_text, change=_xml)
_FORMATS: dict[str, Callable[[Path, Rng, Path], str]] = {
    ".geojson": _JSON, ".json": _JSON, ".plan": _JSON, ".jsonl": _LINES, ".yaml": _YAML_FILE, ".csv": _TABLE,
    ".gpx": _MARKUP, ".kml": _MARKUP, ".kmz": _kmz, ".nc": _netcdf, ".tif": _tiff, ".png": _png,
    ".pgw": _WORDS, ".prj": _WORDS, ".gpkg": _vector, ".shp": _vector, ".npz": _arrays,
}  # fmt: skip

warnings.filterwarnings("ignore", message="Duplicate name", category=UserWarning)
