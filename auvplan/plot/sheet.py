"""The mission sheet as a page to print."""

from pathlib import Path
from textwrap import fill

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from auvplan.runtime.files import write_atomically
from auvplan.runtime.formatting import figure
from auvplan.view.sheet import MissionSheet

#: Inches of an A4 page on its side, and of its margin.
_PAGE, _MARGIN = (11.69, 8.27), 0.5

#: Shares of its height: where facts begin, and a line of them.
_FACTS, _LINE = 0.91, 0.0166


def write_pdf(sheet: MissionSheet, path: str | Path) -> Path:
    """Write the sheet as one page, A4 on its side.

    Raises:
        OutputError: the file cannot be written.
    """
    page = Figure(figsize=_PAGE)
    left, width = _MARGIN / _PAGE[0], 1.0 - 2.0 * _MARGIN / _PAGE[0]
    page.text(left, 0.955, sheet.title, fontsize=15, weight="bold", va="top")
    facts = [fill(f"{name}: {value}", 92, subsequent_indent="   ") for name, value in sheet.facts.items()]
    columns = ["\n".join(facts[column::2]) for column in range(2)]
    for column, lines in enumerate(columns):
        page.text(left + 0.5 * width * column, _FACTS, lines, fontsize=8, va="top")
    notes = "\n".join(fill(f"! {line}", 170) for line in (*sheet.warnings, *sheet.assumed))
    top = _FACTS - _LINE * (2 + max(column.count("\n") for column in columns))
    page.text(left, top, notes, fontsize=8, va="top", color="#a04000")
    top -= _LINE * (2 + notes.count("\n") if notes else 0)
    headings, rows = sheet.table()
    step = min(0.024, (top - 0.08) / (len(rows) + 2 * len(sheet.left_out) + 4))
    height = step * (len(rows) + 1)
    axes = page.add_axes((left, top - height, width, height))
    _draw(axes, headings, rows)
    if sheet.left_out:
        lines = [
            fill(f"{job.name} (priority {figure(job.priority)}): {job.reason}", 190) for job in sheet.left_out
        ]
        page.text(left, top - height - 0.02, "Left out", fontsize=9, weight="bold", va="top")
        page.text(left, top - height - 0.045, "\n".join(lines), fontsize=7.5, va="top")
    foot = [
        f"{file.name} ({file.sha256[:12]}{'; ' if file.fetched else ''}{file.fetched})"
        for file in sheet.files
    ]
    lines = ["planned on: " + ", ".join(foot)] if foot else []
    text = "\n".join(fill(line, 240) for line in lines)
    page.text(left, 0.3 * _MARGIN / _PAGE[1], text, fontsize=5.5, va="bottom", color="0.35")
    return write_atomically(
        path, lambda part: page.savefig(part, format="pdf", metadata={"CreationDate": None})
    )


def _draw(axes: Axes, headings: list[str], rows: list[list[str]]) -> None:
    """The table of stops, over all of the axes."""
    axes.set_axis_off()
    lengths = [max(len(cell) for cell in column) + 2 for column in zip(headings, *rows, strict=True)]
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
