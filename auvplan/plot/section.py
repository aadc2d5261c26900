"""Vertical sections along a path, below its map."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Patch

from auvplan.plot import style
from auvplan.plot.maps import unit_of
from auvplan.records import MissionRun
from auvplan.view.section import Section

#: The sea bed, and the height of a section, inches.
_BED, SECTION = "#a08c5b", 2.3


def add_section(above: Axes, sections: Sequence[Section], run: MissionRun | None = None) -> dict[str, Any]:
    """Draw sections, one after the other, below axes that fill a figure; return legend handles by name.

    Args:
        above: alone in a figure that is higher by `SECTION` for each inch of theirs.
        sections: none for nothing.
        run: whose waypoints are named between them; None of a path alone.
    """
    if not sections:
        return {}
    figure = style.figure_of(above)
    rest = figure.get_figheight() - SECTION
    grid = GridSpec(2, 1, figure, height_ratios=[rest, SECTION])
    above.set_subplotspec(grid[0])
    axes = figure.add_subplot(grid[1], label="section")
    figure.sca(above)
    name, metres = unit_of(float(sections[-1].distance[-1]))
    fastest = np.concatenate([np.abs(section.along[np.isfinite(section.along)]) for section in sections])
    scale = max(float(np.quantile(fastest, 0.995)) if len(fastest) else 0.0, 1e-3)
    handles: dict[str, Any] = {"path": style.line("path, in the section", color="black", lw=2.0)}
    for section in sections:
        x, depth = section.distance / metres, section.depth
        image = axes.imshow(
            section.along, cmap="PRGn", vmin=-scale, vmax=scale, aspect="auto", zorder=0,
            extent=(x[0], x[-1], depth[-1], depth[0]), interpolation="bilinear",
        )  # fmt: skip
        for cut in section.cuts:
            colour = style.KIND_COLOURS.get(cut.kind, style.ORANGE)
            solid: dict[str, Any] = {"fc": colour, "ec": "black", "lw": 0.6, "alpha": 0.85}
            axes.fill_between(x, *cut.solid, zorder=2, **solid)
            axes.fill_between(x, *cut.boundary, fc="none", ec=colour, lw=1.2, ls="--", zorder=2)
            words = f"{cut.kind} obstacle" if cut.kind in style.KIND_COLOURS else cut.kind
            handles[cut.kind] = Patch(label=f"{words}, in the section", **solid)
        if section.bed is not None:
            axes.fill_between(x, section.bed, depth[-1], fc=_BED, ec="black", lw=0.6, zorder=2.5)
            handles["bed"] = Patch(facecolor=_BED, edgecolor="black", label="sea bed")
        for line in section.earlier:
            kind: dict[str, Any] = {"color": style.RED, "ls": "--", "lw": 1.1}
            axes.plot(line[:, 0] / metres, line[:, 1], zorder=3, **kind)
            handles["earlier"] = style.line("earlier plan, in the section", **kind)
        axes.plot(
            section.path[:, 0] / metres, section.path[:, 1], color="black", lw=2.0,
            path_effects=style.halo(3.4), zorder=4,
        )  # fmt: skip
    axes.set(
        xlim=(0.0, sections[-1].distance[-1] / metres), ylim=(depth[-1], depth[0]),
        xlabel=f"distance along the path [{name}]", ylabel="depth [m]",
    )  # fmt: skip
    axes.tick_params(labelsize=8)
    bar = figure.colorbar(image, ax=axes, pad=0.02, extend="both")
    bar.set_label("current along\nthe path [m/s]", fontsize=8)
    bar.ax.tick_params(labelsize=8)
    if run is not None:
        _name_ends(axes, sections, run, metres)
    return handles


def _name_ends(axes: Axes, sections: Sequence[Section], run: MissionRun, metres: float) -> None:
    """Mark where legs begin and end, and write the waypoints' names above as far as there is room."""
    size, taken = 7.0, -np.inf
    point = axes.get_xlim()[1] / (72.0 * 0.8 * style.figure_of(axes).get_figwidth())
    ends = [
        (distance / metres, run.called(node))
        for section in sections
        if (leg := section.leg)
        for distance, node in ((section.distance[0], leg.start), (section.distance[-1], leg.goal))
    ]
    for place, name in dict.fromkeys(ends):
        axes.axvline(place, color="black", lw=0.5, ls=":", zorder=3)
        half = 0.31 * size * len(name) * point
        side, shift = (
            ("left", 0.0) if place == 0.0 else ("right", 2.0) if place == ends[-1][0] else ("center", 1.0)
        )
        begin = place - shift * half
        if begin > taken:
            axes.text(place, 1.02, name, fontsize=size, ha=side, transform=axes.get_xaxis_transform())
            taken = begin + 2.0 * half + size * point
