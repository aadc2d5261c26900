"""Changes to files for `benchmarks.fuzz`: of bytes, and of what the bytes mean in each format."""

import json
import re
import struct
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import yaml

from benchmarks.mutated_files import damage

Rng = np.random.Generator
Tree = Any

#: What replaces a value in a tree of JSON or YAML.
EXTREMES: tuple[Any, ...] = (
    float("nan"), float("inf"), -0.0, 0, -1, 1e308, -1e308, 5e-324, 2**31, -(2**63), 10**30, 10**400, "",
    None, True, [], {}, [[]], [None], {"": None}, "1e400", "0x10", "nan", "2026-13-45T99:00:00Z",
    "9999-12-31T23:59:59Z", "24:00Z/23:00Z", "\x00", "\ud800", "a\nb", "\u202e", "%s%n{0}",
)  # fmt: skip

#: Words that stand for raw text, which no tree can hold, until the tree is written.
_LONG, _DEEP, _MANY = "@@long@@", "@@deep@@", "@@digits@@"
_RAW = {
    _LONG: '"' + "x" * 1_000_000 + '"',
    _DEEP: "[" * 10_000 + "]" * 10_000,
    _MANY: "9" * 10_000,
}
#: The same for YAML alone: tags that build objects, aliases that multiply, dates that are none.
_YAML = {
    "@@tag@@": '!!python/object/apply:os.system ["true"]',
    "@@module@@": "!!python/name:os.system",
    "@@set@@": "!!set {a, b}",
    "@@binary@@": "!!binary Zm9v",
    "@@date@@": "2026-13-45",
    "@@clock@@": "99:99:99",
    "@@self@@": "&self [*self]",
    "@@laughs@@": "["
    + ", ".join(
        ["&a0 [ha, ha, ha, ha, ha, ha, ha, ha, ha]"]
        + [f"&a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 10)]
    )
    + "]",
    "@@merge@@": "{<<: &m {a: 1}, <<: *m}",
}
_LAUGHS = (
    '<!DOCTYPE x [<!ENTITY a0 "ha">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    + "]>"
)


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


def _bytes(path: Path, rng: Rng) -> str:
    whole = path.read_bytes()
    kind = int(rng.integers(8))
    if kind == 0:
        path.write_bytes(b"")
        return "emptied"
    if kind == 1 and whole:
        first, size = int(rng.integers(len(whole))), int(rng.integers(1, 4096))
        path.write_bytes(whole[: first + size] + whole[first:] * int(rng.integers(1, 4)))
        return "bytes repeated"
    if kind == 2 and whole:
        place = int(rng.integers(len(whole)))
        odd = (b"\xff\xfe", b"\x00" * 16, b"\xed\xa0\x80", b"\xef\xbb\xbf", b"\r\r\n", b'"', b"9" * 400)
        path.write_bytes(whole[:place] + odd[int(rng.integers(len(odd)))] + whole[place:])
        return "bytes put in"
    return damage(path, rng)[0] if whole else "nothing"


def _places(tree: Tree) -> list[tuple[Any, Any]]:
    """Every container with a key or index of it."""
    found, left = [], [tree]
    while left:
        inside = left.pop()
        keys = list(inside) if isinstance(inside, dict) else range(len(inside))
        for key in keys:
            found.append((inside, key))
            if isinstance(inside[key], dict | list):
                left.append(inside[key])
    return found


def _extreme(rng: Rng, outside: Path, words: tuple[str, ...]) -> Any:
    paths = [str(file) for file in sorted(outside.iterdir())]
    names = ("/etc/passwd", "../" * 12 + "etc/passwd", "file:///etc/passwd", "~/.bashrc", "/dev/zero", *paths)
    kind = rng.random()
    if kind < 0.15:
        return names[int(rng.integers(len(names)))]
    if kind < 0.4:
        return words[int(rng.integers(len(words)))]
    return EXTREMES[int(rng.integers(len(EXTREMES)))]


def _alter(tree: Tree, rng: Rng, outside: Path, words: tuple[str, ...]) -> str:
    """Change a tree in place."""
    places = _places(tree)
    if not places:
        return "nothing"
    inside, key = places[int(rng.integers(len(places)))]
    kind = int(rng.integers(8))
    if kind < 5:
        value = _extreme(rng, outside, words)
        # A value within its kind gets farther than one of another kind.
        if kind < 2 and isinstance(inside[key], float | int) and not isinstance(inside[key], bool):
            numbers = (float("nan"), 1e308, -1e308, -0.0, 0.0, 1e-300, 10**30, 10**400, -1, 2**31, 1e9, _MANY)
            value = numbers[int(rng.integers(len(numbers)))]
        inside[key] = value
        return f"{str(key)[:40]} = {repr(value)[:40]}"
    if kind == 5:
        del inside[key]
        return f"{str(key)[:40]} taken away"
    if isinstance(inside, list):
        times = int(rng.choice([2, 3, 2000]))
        inside[key:key] = [inside[key]] * times
        return f"item {key} {times} times more"
    other = str(
        rng.choice(["x", "", f"{key} ", str(key).upper(), "__proto__", f"@@twice@@{key}", *map(str, inside)])
    )
    if other.startswith("@@twice@@"):
        inside[other] = inside[key]
    else:
        inside[other] = inside.pop(key)
    return f"{str(key)[:40]} renamed {other[:40]}"


def _count(rng: Rng) -> int:
    """How many changes a tree gets: few, so that most of it is still read."""
    return int(rng.choice([1, 1, 1, 2, 3]))


def _raw(text: str, words: dict[str, str]) -> str:
    """Text with the words replaced by what they stand for."""
    for word, raw in words.items():
        text = text.replace(f'"{word}"', raw).replace(f"'{word}'", raw)
    return text.replace("@@twice@@", "")


def _json(path: Path, rng: Rng, outside: Path) -> str:
    tree = json.loads(path.read_text(encoding="utf-8"))
    said = [_alter(tree, rng, outside, tuple(_RAW)) for _ in range(_count(rng))]
    text = json.dumps(tree, ensure_ascii=bool(rng.random() < 0.7))
    path.write_bytes(_raw(text, _RAW).encode("utf-8", "surrogatepass"))
    return "; ".join(said)


def _json_lines(path: Path, rng: Rng, outside: Path) -> str:
    lines = path.read_text(encoding="utf-8").splitlines()
    number = int(rng.integers(len(lines)))
    tree = json.loads(lines[number])
    said = _alter(tree, rng, outside, tuple(_RAW))
    lines[number] = _raw(json.dumps(tree), _RAW)
    path.write_bytes(("\n".join(lines) + "\n").encode("utf-8", "surrogatepass"))
    return said


def _yaml(path: Path, rng: Rng, outside: Path) -> str:
    tree = yaml.safe_load(path.read_text(encoding="utf-8"))
    words = _RAW | _YAML
    said = [_alter(tree, rng, outside, tuple(words)) for _ in range(_count(rng))]
    text = yaml.safe_dump(tree, allow_unicode=True, sort_keys=False, width=10_000)
    path.write_bytes(_raw(text, words).encode("utf-8", "surrogatepass"))
    return "; ".join(said)


def _cell(rng: Rng, outside: Path) -> str:
    value = _extreme(rng, outside, tuple(_RAW))
    return _RAW[value].strip('"') if isinstance(value, str) and value in _RAW else str(value)


def _table(path: Path, rng: Rng, outside: Path) -> str:
    rows = [line.split(",") for line in path.read_text(encoding="utf-8").splitlines()]
    row = int(rng.integers(len(rows)))
    column = int(rng.integers(len(rows[row])))
    kind = int(rng.integers(8))
    if kind < 4:
        rows[row][column] = _cell(rng, outside)
        said = f"row {row}, column {column} = {rows[row][column][:40]!r}"
    elif kind == 4:
        rows = [[cell for k, cell in enumerate(cells) if k != column] for cells in rows]
        said = f"column {column} taken away"
    elif kind == 5:
        rows = [[*cells, *cells[column : column + 1]] for cells in rows]
        said = f"column {column} doubled"
    elif kind == 6:
        rows[row:row] = [rows[row]] * int(rng.choice([1, 3000]))
        said = f"row {row} repeated"
    else:
        rows[row] = rows[row] * int(rng.choice([0, 2, 5000]))
        said = f"row {row} of another length"
    mark = str(rng.choice([",", ",", ",", ";", "\t", "|"]))
    path.write_bytes("\n".join(mark.join(cells) for cells in rows).encode("utf-8", "surrogatepass"))
    return said


def _words(path: Path, rng: Rng, outside: Path) -> str:
    """Of a text of numbers and words, such as a world file."""
    words = re.split(r"(\s+)", path.read_text(encoding="utf-8"))
    place = int(rng.integers(len(words)))
    words[place] = _cell(rng, outside)
    path.write_bytes("".join(words).encode("utf-8", "surrogatepass"))
    return f"word {place} = {words[place][:40]!r}"


def _xml_text(text: str, rng: Rng, outside: Path) -> tuple[str, str]:
    kind = int(rng.integers(8))
    if kind == 0:
        return _doctype(text, _LAUGHS, "&a9;", rng), "entities that multiply"
    if kind == 1:
        named = ["/etc/passwd", *(str(file) for file in sorted(outside.iterdir()))]
        system = f'<!DOCTYPE x [<!ENTITY e SYSTEM "file://{named[int(rng.integers(len(named)))]}">]>'
        return _doctype(text, system, "&e;", rng), "an entity from a file"
    if kind == 2:
        return _doctype(
            text, '<!DOCTYPE x SYSTEM "http://127.0.0.1:9/x.dtd">', "", rng
        ), "a type from a server"
    if kind == 3:
        tags = list(re.finditer(r"<[A-Za-z]\w*[^>]*>", text))
        where = tags[int(rng.integers(len(tags)))].end()
        return text[:where] + "<a>" * 10_000 + "</a>" * 10_000 + text[where:], "elements 10,000 deep"
    root = ElementTree.fromstring(text)
    elements = list(root.iter())
    element = elements[int(rng.integers(len(elements)))]
    if kind < 6:
        value = re.sub("[\x00-\x08\ud800-\udfff]", "?", _cell(rng, outside))
        keys = list(element.attrib)
        if keys and rng.random() < 0.7:
            key = str(rng.choice(keys))
            element.attrib[key] = value
            said = f"{key} = {value[:40]!r}"
        else:
            element.text = value
            said = f"text of {element.tag[-20:]} = {value[:40]!r}"
    elif kind == 6:
        parents = [(parent, child) for parent in elements for child in parent]
        if not parents:
            return text, "nothing"
        parent, child = parents[int(rng.integers(len(parents)))]
        times = int(rng.choice([0, 2, 2000]))
        parent.remove(child)
        parent.extend([child] * times)
        said = f"{child.tag[-20:]} {times} times"
    else:
        element.tag = str(rng.choice(["x", "Point", "coordinates", "wpt", "{urn:x}Placemark"]))
        said = f"an element renamed {element.tag}"
    return ElementTree.tostring(root, encoding="unicode"), said


def _doctype(text: str, stated: str, use: str, rng: Rng) -> str:
    head = re.match(r"\s*<\?xml.*?\?>", text)
    at = head.end() if head else 0
    texts = [found.end() - 1 for found in re.finditer(r">[^<>]*<", text[at:])]
    place = at + (texts[int(rng.integers(len(texts)))] if texts else 0)
    return text[:at] + stated + text[at:place] + use + text[place:]


def _xml(path: Path, rng: Rng, outside: Path) -> str:
    text, said = _xml_text(path.read_text(encoding="utf-8"), rng, outside)
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    return said


def _kmz(path: Path, rng: Rng, outside: Path) -> str:
    with zipfile.ZipFile(path) as archive:
        content = {entry.filename: archive.read(entry) for entry in archive.infolist()}
    name = next(name for name in content if name.endswith(".kml"))
    kind = int(rng.integers(4))
    if kind == 0:
        content[name] = content[name] + b" " * 300_000_000
        said = "300 MB of blanks"
    elif kind == 1:
        other = str(rng.choice(["../../evil.kml", "/etc/evil.kml", "C:\\evil.kml", "x" * 60_000 + ".kml"]))
        content = {other: content.pop(name), **content}
        said = f"named {other[:40]}"
    elif kind == 2:
        content = {f"{k}.kml": b"<kml/>" for k in range(3000)} | content
        said = "3,000 files"
    else:
        text, said = _xml_text(content[name].decode("utf-8"), rng, outside)
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
        name = str(rng.choice(names))
        return _HDF5[int(rng.integers(len(_HDF5)))](file, name, rng, outside)


def _value(file: h5py.File, name: str, rng: Rng, _: Path) -> str:
    data: Any = file[name]
    if data.dtype.kind not in "iuf" or not data.size:
        return _attribute(file, name, rng, _)
    whole = data.dtype.kind != "f"
    numbers = (
        [0, 1, -1, 2, 100, 2**31 - 1, -(2**31)] if whole else [np.nan, np.inf, 0.0, -1.0, 1e9, 1e30, 1e308]
    )
    with np.errstate(all="ignore"):
        number = np.asarray(numbers[int(rng.integers(len(numbers)))]).astype(data.dtype)
    share = float(rng.choice([0.0, 0.0, 0.5, 1.0]))
    if share < 0.5 and data.shape:
        data[tuple(int(rng.integers(size)) for size in data.shape)] = number
    elif data.shape:
        values = data[...]
        values[: int(np.ceil(share * len(values)))] = number
        data[...] = values
    else:
        data[()] = number
    return f"{name} = {number}"


def _attribute(file: h5py.File, name: str, rng: Rng, outside: Path) -> str:
    holder: Any = file if rng.random() < 0.5 and len(file.attrs) else file[name]
    own = [str(key) for key in holder.attrs if key not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS")]
    key = str(rng.choice([*own, "scale_factor", "_FillValue", "units", "coordinates"]))
    if key in holder.attrs and rng.random() < 0.2:
        del holder.attrs[key]
        return f"{key} taken away"
    there = holder.attrs.get(key)
    text = there.decode("utf-8", "replace") if isinstance(there, bytes) else there
    if isinstance(text, str) and text.startswith(("{", "[")) and rng.random() < 0.8:
        tree = json.loads(text)
        said = _alter(tree, rng, outside, (_DEEP, _MANY))
        holder.attrs[key] = _raw(json.dumps(tree), _RAW).encode("utf-8", "surrogatepass")
        return f"{key}: {said}"
    values = (
        0, -1, 1e308, np.nan, "", "x" * 60_000, "\x00", np.zeros(0), np.arange(5.0),
        "seconds since 0000-00-00", "days since 9999-99-99", str(outside), "nan", 2**62,
        "é" * 100, np.array([["a", "b"]], object),
    )  # fmt: skip
    value = values[int(rng.integers(len(values)))]
    if isinstance(value, np.ndarray) and value.dtype == object:
        holder.attrs.create(key, value, dtype=h5py.string_dtype())
    else:
        holder.attrs[key] = value
    return f"{key} = {repr(value)[:40]}"


def _renamed(file: h5py.File, name: str, rng: Rng, _: Path) -> str:
    if rng.random() < 0.5:
        del file[name]
        return f"{name} taken away"
    other = str(rng.choice([f"{name}_2", "x" * 300, name.upper(), "time", "é"]))
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
    shape = shapes[int(rng.integers(len(shapes)))]
    dtype = data.dtype if rng.random() < 0.7 else np.dtype(str(rng.choice(["S5", "u1", "f8", "c16", "?"])))
    del file[name]
    chunks = tuple(min(max(size, 1), 1000) for size in shape) if np.prod(shape, dtype=float) > 1e6 else None
    file.create_dataset(name, shape, dtype, chunks=chunks)
    return f"{name} of shape {shape}, {dtype}"


def _linked(file: h5py.File, name: str, rng: Rng, outside: Path) -> str:
    """A variable whose values lie in another file."""
    data: Any = file[name]
    shape, dtype = data.shape, data.dtype
    other = str(outside / "linked.nc")
    kind = int(rng.integers(4))
    if kind == 0:
        del file[name]
        file[name] = h5py.ExternalLink(other, "/secret")
        return f"{name} a link to another file"
    if kind == 1 and shape and dtype.kind in "iuf":
        del file[name]
        external = [(str(outside / "linked.txt"), 0, h5py.h5f.UNLIMITED)]
        file.create_dataset(name, shape, dtype, external=external)
        return f"{name} stored in another file"
    if kind == 2 and shape and dtype.kind in "iuf":
        del file[name]
        layout = h5py.VirtualLayout(shape, dtype)
        layout[...] = h5py.VirtualSource(other, "secret", shape=shape)
        file.create_virtual_dataset(name, layout)
        return f"{name} made of another file"
    file["more"] = h5py.ExternalLink(other, "/")
    return "a group that is a link to another file"


_HDF5: tuple[Callable[[h5py.File, str, Rng, Path], str], ...] = (
    _value, _value, _value, _attribute, _attribute, _attribute, _renamed, _reshaped, _linked,
)  # fmt: skip


def _numbers(path: Path, rng: Rng) -> str:
    """Of a binary file: four bytes of its head that count something."""
    whole = bytearray(path.read_bytes())
    place = 4 * int(rng.integers(min(len(whole), 4000) // 4))
    number = int(rng.choice([0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0x10000000, 65536]))
    whole[place : place + 4] = struct.pack(str(rng.choice([">I", "<I"])), number)
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
    number = int(rng.choice([0, 1, 2, 3, 255, 65535, 10**6, 2**31 - 1, 2**31, 2**32 - 1]))
    part, form, said = [(2, "H", "type"), (4, "I", "count"), (8, "I", "value"), (8, "I", "value")][
        int(rng.integers(4))
    ]
    struct.pack_into(order + form, whole, entry + part, number & (0xFFFF if form == "H" else 0xFFFFFFFF))
    path.write_bytes(whole)
    return f"{said} of tag {tag} = {number}"


def _png(path: Path, rng: Rng, outside: Path) -> str:
    whole, at, chunks = path.read_bytes(), 8, []
    while at + 12 <= len(whole):
        (size,) = struct.unpack_from(">I", whole, at)
        chunks.append((whole[at + 4 : at + 8], whole[at + 8 : at + 8 + size]))
        at += 12 + size
    kind = int(rng.integers(6))
    if kind == 5:
        path.write_bytes(
            b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 80 60\n%%EndComments\nshowpage\n%%EOF\n"
        )
        return "PostScript, which is a program"
    if kind < 2:
        head = bytearray(chunks[0][1])
        place = int(rng.choice([0, 4]))
        number = int(rng.choice([0, 1, 7999, 60_000, 2**31 - 1, 2**32 - 1]))
        struct.pack_into(">I", head, place, number)
        chunks[0], said = (chunks[0][0], bytes(head)), f"a side of {number}"
    elif kind == 2:
        head = bytearray(chunks[0][1])
        head[8 + int(rng.integers(5))] = int(rng.integers(256))
        chunks[0], said = (chunks[0][0], bytes(head)), "another kind of picture"
    elif kind == 3:
        bomb = b"a\0\0" + zlib.compress(b"x" * 200_000_000, 1)
        chunks[1:1], said = [(b"zTXt", bomb)], "200 MB of text"
    else:
        chunks[1:1], said = [(b"PLTE", bytes(int(rng.integers(0, 900))))], "a table of colours"
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
    kinds = (virtual, other.read_text(encoding="utf-8"), f"CSV:{other}", "<GDAL_WMS></GDAL_WMS>")
    kind = int(rng.integers(len(kinds) + 2))
    if kind >= len(kinds):
        return _numbers(path, rng)
    path.write_text(kinds[kind], encoding="utf-8")
    return "another format that names a file" if kind == 0 else "another format"


class _Call:
    """What calls a function when it is unpickled."""

    def __reduce__(self) -> Any:
        import os

        return os.system, ("true",)


def _arrays(path: Path, rng: Rng, outside: Path) -> str:
    with np.load(path) as found:
        arrays = {name: found[name] for name in found}
    name = str(rng.choice(sorted(arrays)))
    kind = int(rng.integers(4))
    if kind == 0:
        arrays[name], said = np.array([_Call()], object), f"{name} an object that calls"
    elif kind == 1:
        del arrays[name]
        said = f"{name} taken away"
    elif kind == 2:
        arrays[name], said = np.zeros((3, 0, 2)), f"{name} of no values"
    else:
        arrays[name], said = np.zeros(100_000_000, np.uint8), f"{name} of 100 MB"
    np.savez_compressed(path, **arrays)
    return said


Format = Callable[[Path, Rng, Path], str]
_FORMATS: dict[str, Format] = {
    ".geojson": _json, ".json": _json, ".plan": _json, ".jsonl": _json_lines, ".yaml": _yaml, ".csv": _table,
    ".gpx": _xml, ".kml": _xml, ".kmz": _kmz, ".nc": _netcdf, ".tif": _tiff, ".png": _png, ".pgw": _words,
    ".prj": _words, ".gpkg": _vector, ".shp": _vector, ".npz": _arrays,
}  # fmt: skip

warnings.filterwarnings("ignore", message="Duplicate name", category=UserWarning)
