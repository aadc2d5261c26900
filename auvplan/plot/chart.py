"""A picture and the chart that was made of it (Fig. 1)."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from PIL import Image

from auvplan.io.files import output_folder
from auvplan.ocean.chart import Chart
from auvplan.ocean.classify import Classified
from auvplan.plot import style

#: Longest edge at which the picture is drawn, pixels.
_EDGE = 1200


def plot_chart(chart: Chart, image: str | Path | None = None, classified: Classified | None = None) -> Figure:
    """The clustered chart, beside the picture it was made of where that is given.

    Args:
        chart: to draw.
        image: a picture with north up that covers the same area.
        classified: its clusters, which are listed with their colours, shares and what they were taken for.
    """
    low, high = np.asarray(chart.lower, float), np.asarray(chart.upper, float)
    unit = style.Unit.for_extent(float((high - low).max()))
    figure = style.new_figure(11.0 if image else 6.4, 6.2 if classified is None else 6.9)
    grid = np.atleast_1d(figure.subplots(1, 2 if image else 1))
    for axes in grid:
        style.map_axes(axes, low, high, unit)
    if image:
        with Image.open(image) as opened:
            picture = opened.convert("RGB")
        picture.thumbnail((_EDGE, _EDGE))
        extent = (low[1] / unit.metres, high[1] / unit.metres, low[0] / unit.metres, high[0] / unit.metres)
        grid[0].imshow(np.asarray(picture), extent=extent)
        grid[0].set_title("picture", fontsize=10)
    handles = style.draw_coast(grid[-1], chart, unit)
    shares = chart.shares()
    parts = ", ".join(f"{name} {shares[name]:.1%}" for name in ("coast", "uncertain", "water"))
    title = f"chart: {parts}"
    if classified is not None and classified.doubts:
        title = "\n".join([f"in doubt, {title}", *classified.doubts])
    grid[-1].set_title(title, fontsize=10)
    if classified is not None:
        listed = [
            Patch(
                facecolor=cluster.colour,
                edgecolor=style.GREY,
                label=f"{cluster.colour}, {cluster.share:.1%}: {cluster.kind}",
            )
            for cluster in classified.clusters
        ]
        title = "colours of the picture, their shares and what they were taken for"
        figure.legend(
            handles=listed, loc="outside lower left", ncols=4, fontsize=8, frameon=False, title=title
        ).get_title().set_fontsize(8)
    if handles:
        place = "outside lower center" if classified is None else "outside lower right"
        figure.legend(handles=handles, loc=place, ncols=2, fontsize=8, frameon=False)
    return figure


def draw_chart(
    chart: Chart, image: str | Path | None, folder: str | Path, classified: Classified | None = None
) -> Path:
    """Write `chart.png`, or `chart-drawn.png` where the picture itself is that file.

    Raises:
        OutputError: the folder or the file cannot be written.
    """
    target = output_folder(folder) / "chart.png"
    if image and target.exists() and target.samefile(image):
        target = target.with_name("chart-drawn.png")
    return style.save(plot_chart(chart, image, classified), target)
