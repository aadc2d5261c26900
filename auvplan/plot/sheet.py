"""The mission sheet as pages to print."""

from math import ceil
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from auvplan.runtime.files import write_atomically
from auvplan.runtime.formatting import figure
from auvplan.view.sheet import MissionSheet

#: Inches of an A4 page on its side, and of its margin.
_PAGE, _MARGIN = (11.69, 8.27), 0.5

#: Shares of its width: of the margin, and of what lies between both.
_LEFT, _WIDTH = _MARGIN / _PAGE[0], 1.0 - 2.0 * _MARGIN / _PAGE[0]

#: Shares of its height: where the first page and the others begin, a line of text, a row of the table, and
#: what stays free at the bottom.
_FACTS, _NEXT, _LINE, _ROW, _BOTTOM = 0.91, 0.925, 0.0166, 0.024, 0.08

#: Points of the text whose lines are that high.
_SIZE = 8.0


def write_pdf(sheet: MissionSheet, path: str | Path) -> Path:
    """Write the sheet on pages of A4 on their side, as few as can be read.

    Raises:
        OutputError: the file cannot be written.
    """
    files = [
        f"{file.name} ({file.sha256[:12]}{'; ' if file.fetched else ''}{file.fetched})"
        for file in sheet.files
    ]
    foot = fill("planned on: " + ", ".join(files), 240).split("\n") if files else []
    pages = _Pages(sheet.title, foot)
    facts = [fill(f"{name}: {value}", 92, subsequent_indent="   ") for name, value in sheet.facts.items()]
    pages.write(*("\n".join(facts[column::2]).split("\n") for column in range(2)))
    pages.top -= _LINE
    if notes := [line for note in (*sheet.warnings, *sheet.assumed) for line in _filled(f"! {note}", 170)]:
        pages.write(notes, color="#a04000")
        pages.top -= _LINE
    headings, rows = sheet.table()
    step = min(_ROW, (pages.top - _BOTTOM) / (len(rows) + 2 * len(sheet.left_out) + 4))
    pages.tabulate(headings, rows, step if step >= _LINE else _ROW)
    left_out = [f"{job.name} (priority {figure(job.priority)}): {job.reason}" for job in sheet.left_out]
    pages.write([line for job in left_out for line in _filled(job, 190)], size=7.5, heading="Left out")
    return write_atomically(path, pages.save)


def _filled(text: str, width: int) -> list[str]:
    return fill(text, width).split("\n")


class _Pages:
    """Pages that are filled from the top to the bottom.

    Attributes:
        title: of the sheet, on all of them.
        bottom, top: shares of the height between which the last page is free.
        all: of them.
    """

    def __init__(self, title: str, foot: list[str]) -> None:
        self.title = title
        size, low = 5.5, 0.3 * _MARGIN / _PAGE[1]
        self.bottom = max(_BOTTOM, low + (len(foot) + 1) * _LINE * size / _SIZE)
        self.all = [Figure(figsize=_PAGE)]
        self.top = _FACTS
        self.all[0].text(_LEFT, 0.955, title, fontsize=15, weight="bold", va="top")
        self.all[0].text(_LEFT, low, "\n".join(foot), fontsize=size, va="bottom", color="0.35")

    def turn(self) -> None:
        """Begin a page."""
        self.all.append(Figure(figsize=_PAGE))
        self.top = _NEXT
        self.all[-1].text(_LEFT, 0.955, self.title, fontsize=10, weight="bold", va="top")

    def room(self, step: float, least: float = 1.0) -> int:
        """Return how many steps fit, on a page that is begun where this one has not the least room."""
        if self.top - self.bottom < least * step:
            self.turn()
        return max(int((self.top - self.bottom) / step), 1)

    def write(self, *columns: list[str], size: float = _SIZE, heading: str = "", **style: Any) -> None:
        """Write columns of lines beside each other, each part of them under the heading."""
        step, before = _LINE * size / _SIZE, 0.045 if heading else 0.0
        begin, count = 0, max(map(len, columns))
        while begin < count:
            room = max(self.room(step, 2.0 + before / step if heading else 1.0) - ceil(before / step), 1)
            if heading:
                words = f"{heading}, continued" if begin else heading
                self.all[-1].text(_LEFT, self.top - 0.02, words, fontsize=9, weight="bold", va="top")
                self.top -= before
            for number, lines in enumerate(columns):
                left, text = _LEFT + _WIDTH * number / len(columns), "\n".join(lines[begin : begin + room])
                self.all[-1].text(left, self.top, text, fontsize=size, va="top", **style)
            self.top -= step * min(room, count - begin)
            begin += room

    def tabulate(self, headings: list[str], rows: list[list[str]], step: float) -> None:
        """Write a table whose rows are a step high, with its headings on each page."""
        lengths = [max(len(cell) for cell in column) + 2 for column in zip(headings, *rows, strict=True)]
        while rows:
            shown = max(self.room(step, 3.0) - 1, 1)
            height = step * (len(rows[:shown]) + 1)
            axes = self.all[-1].add_axes((_LEFT, self.top - height, _WIDTH, height))
            _draw(axes, headings, rows[:shown], lengths)
            self.top -= height
            rows = rows[shown:]

    def save(self, path: Path) -> None:
        """Write them as PDF, numbered where there are several."""
        with PdfPages(path, metadata={"CreationDate": None}) as pdf:
            for number, page in enumerate(self.all, 1):
                if len(self.all) > 1:
                    place, words = (_LEFT + _WIDTH, 0.98), f"page {number} of {len(self.all)}"
                    page.text(*place, words, fontsize=7.5, ha="right", va="top", color="0.35")
                pdf.savefig(page)


def _draw(axes: Axes, headings: list[str], rows: list[list[str]], lengths: list[int]) -> None:
    """Rows of the table of stops, over all of the axes; columns are as wide as lengths, in letters."""
    axes.set_axis_off()
    total = sum(lengths)
    table = axes.table(
        rows, colLabels=headings, colWidths=[length / total for length in lengths], cellLoc="left",
        bbox=Bbox.unit(),
    )  # fmt: skip
    table.auto_set_font_size(False)
    # A letter is less than 0.62 of the font's size wide.
    table.set_fontsize(min(7.5, 72.0 * (_PAGE[0] - 2.0 * _MARGIN) / (0.62 * total)))
    for (row, _), cell in table.get_celld().items():
        cell.PAD = 0.02
        cell.set_linewidth(0.4)
        cell.set_edgecolor("0.7")
        if row == 0:
            cell.set_text_props(weight="bold")
            cell.set_facecolor("0.93")
