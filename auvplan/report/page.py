"""Pages that hold all they need: template, styles, scripts and data in one file."""

import html
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from auvplan.files import write_atomically
from auvplan.report.packing import script_json

_PLOTLY = "plotly-cartesian.min.js"
#: Scripts by the kind of page, in the order in which they stand there.
_SCRIPTS: dict[str, Sequence[str]] = {
    "run": ("base.js", "figures.js", "map.js", "run.js"),
    "study": ("base.js", "figures.js", "map.js", "study.js"),
    "departures": ("base.js", "figures.js", "departures.js"),
}

#: Marks of the template.
_MARK = re.compile(r"\{\{(\w+)\}\}")


def write_page(kind: str, title: str, data: Mapping[str, Any], path: str | Path) -> Path:
    """Write a page, whole or not at all.

    Args:
        kind: "run", "study" or "departures".
        title: of the window.
        data: that the page's scripts show; see `plain`.
        path: of the file.

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
