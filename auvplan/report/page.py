"""Pages that hold all they need: template, styles, scripts and packed data in one file."""

import base64
import html
import json
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from auvplan.runtime.files import write_atomically

_PLOTLY = "plotly-cartesian.min.js"
#: Scripts by the kind of page, in the order in which they stand there.
_SCRIPTS: dict[str, Sequence[str]] = {
    "run": ("base.js", "figures.js", "map.js", "run.js"),
    "study": ("base.js", "figures.js", "map.js", "study.js"),
    "departures": ("base.js", "figures.js", "departures.js"),
}

#: Marks of the template.
_MARK = re.compile(r"\{\{(\w+)\}\}")

#: NumPy's name of each kind of number that pages unpack, by the name that stands in the page.
_KINDS = {"f32": "<f4", "i16": "<i2", "i32": "<i4"}

#: What would end a script or a line of it, and the escape that replaces it within JSON.
_UNSAFE = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


def write_page(kind: str, title: str, data: Mapping[str, Any], path: str | Path) -> Path:
    """Write a page, whole or not at all.

    Raises:
        OutputError: the file cannot be written; one line that names it.
    """
    parts = {
        "title": html.escape(title),
        "style": asset("report.css"),
        "library": asset(_PLOTLY),
        "script": "\n".join(asset(name) for name in _SCRIPTS[kind]),
        "data": script_json(data),
    }
    page = _MARK.sub(lambda mark: parts[mark[1]], asset("report.html"))
    return write_atomically(path, lambda part: part.write_text(page, encoding="utf-8", newline="\n"))


@cache
def asset(name: str) -> str:
    """Return a file of the page, by its name."""
    return (files("auvplan.report") / "page" / name).read_text(encoding="utf-8")


def packed(values: ArrayLike, kind: str = "f32", step: float = 1.0) -> dict[str, Any]:
    """Return an array as base64 of its little-endian bytes.

    Args:
        values: of any shape.
        kind: "f32", "i16" or "i32"; integers are rounded and must be finite.
        step: what one unit of the stored numbers is worth.
    """
    scaled = np.asarray(values, float) / step
    rounded = scaled if kind == "f32" else np.rint(scaled)
    data = np.ascontiguousarray(rounded, _KINDS[kind])
    return {
        "kind": kind,
        "shape": list(data.shape),
        "step": step,
        "data": base64.b64encode(data.tobytes()).decode("ascii"),
    }


def script_json(data: Any) -> str:
    """Return JSON that may stand in a script element whatever its texts hold."""
    text = json.dumps(plain(data), ensure_ascii=False, allow_nan=False, separators=(",", ":"))
    for sign, instead in _UNSAFE.items():
        text = text.replace(sign, instead)
    return text


def plain(data: Any) -> Any:
    """Return data of Python's own types, seven digits of every number; what is no number is None."""
    text = json.dumps(data, default=lambda x: x.isoformat() if isinstance(x, datetime) else x.tolist())
    return json.loads(text, parse_float=lambda x: float(f"{float(x):.7g}"), parse_constant=lambda _: None)
