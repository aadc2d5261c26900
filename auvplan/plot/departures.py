"""When to leave: what a mission or a leg comes to by its departure."""

from datetime import UTC
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from auvplan.executive.departures import Departures
from auvplan.plot import style

#: Departures of which each has a mark of its own.
_FEW = 60

_BEST = {"marker": "*", "s": 200, "color": style.YELLOW, "edgecolors": style.BLACK, "zorder": 5}


def plot_departures(found: Departures, *, ax: Axes | None = None) -> NDArray[Any]:
    """Time, what it earns of a mission, and the current's strength by departure.

    Infeasible departures are shaded.

    Args:
        found: of a mission or a leg.
        ax: axes of a grid, whose place the panels take; a new figure if absent.
    """
    panels = [
        (found.time / 60.0, "travel time [min]" if found.routes is None else "mission time [min]", style.BLUE)
    ]
    if found.routes is not None:
        priority = np.where(found.feasible, found.priority, np.nan)
        tasks = np.where(found.feasible, found.tasks, np.nan)
        panels = [(priority, "total priority [-]", style.GREEN), (tasks, "tasks [-]", style.PURPLE), *panels]
    if found.energy is not None:
        panels.append((found.energy, "energy [Wh]", style.ORANGE))
    panels.append((found.current, "current [m/s]", style.RED))
    order = np.argsort(found.departs, kind="stable")
    epoch = None if found.site is None else found.site.epoch
    when: NDArray[Any] = found.departs / 3600.0
    if epoch is not None:
        first = np.datetime64(epoch.astimezone(UTC).replace(tzinfo=None), "ms")
        when = first + np.rint(found.departs * 1000.0).astype("timedelta64[ms]")
    figure = style.figure_for(ax, 9.5, 1.3 + 1.75 * len(panels))
    rows = figure.subplots(len(panels), sharex=True, squeeze=False)[:, 0]
    for axes, (values, name, colour) in zip(rows, panels, strict=True):
        mark = {"marker": "o", "ms": 4.5 if len(found) <= _FEW else 2.0, "lw": 1.2}
        axes.plot(when[order], values[order], color=colour, **mark)
        axes.set_ylabel(name)
        _scale(axes, values)
    _mark_infeasible(rows, found, when, order)
    if (best := found.best) is not None:
        label = f"best: {found.moment(best)}"
        for axes, (values, *_) in zip(rows[:-1], panels[:-1], strict=True):
            axes.scatter(when[[best]], values[[best]], label=label if axes is rows[0] else None, **_BEST)
    for axes, (_, name, _) in zip(rows, panels, strict=True):
        if "[min]" not in name:
            axes.set_ylim(0.0, 1.12 * max(axes.get_ylim()[1], 1e-3))
    if len(found) == 1:
        rows[-1].set_xlim(*_around(when))
    rows[-1].set_xlabel("departure [h after the scenario's]" if epoch is None else "departure [UTC]")
    if epoch is not None:
        locator = AutoDateLocator(tz=UTC, minticks=4, maxticks=9)
        rows[-1].xaxis.set_major_locator(locator)
        rows[-1].xaxis.set_major_formatter(ConciseDateFormatter(locator, tz=UTC))
    figure.align_ylabels(rows)
    kind = "leg" if found.routes is None else "mission"
    share = f"{found.feasible.sum()} of {len(found)}"
    figure.suptitle(f"When to leave: {share} departures of the {kind} feasible", fontsize=11)
    if rows[0].get_legend_handles_labels()[0]:
        style.legend_below(figure, ncols=2)
    return rows


def _scale(axes: Axes, values: NDArray[np.floating]) -> None:
    """Room above and below, so that no marker is cut, and whole numbers where there are such alone."""
    axes.margins(y=0.18)
    style.grid(axes)
    known = values[np.isfinite(values)]
    whole = bool((known == np.rint(known)).all())
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=whole, min_n_ticks=1, steps=[1, 2, 5, 10]))
    if not len(known):
        axes.set_yticks([])


def _mark_infeasible(
    rows: NDArray[Any], found: Departures, when: NDArray[Any], order: NDArray[np.int_]
) -> None:
    """Shade half a step on both sides of departures that are not feasible."""
    if found.feasible.all():
        return
    times = when[order]
    middles = times[:-1] + (times[1:] - times[:-1]) / 2
    edges = [times[0], *middles, times[-1]] if len(times) > 1 else _around(times)
    marks: dict[str, Any] = {"marker": "x", "ls": "none", "color": style.RED, "ms": 6, "zorder": 6}
    for first, place in enumerate(np.flatnonzero(~found.feasible[order])):
        for row, axes in enumerate(rows):
            label = "not feasible" if first == row == 0 else None
            axes.axvspan(edges[place], edges[place + 1], color=style.RED, alpha=0.14, lw=0, label=label)
        if len(order) <= _FEW:
            rows[0].plot(times[place], 0.07, transform=rows[0].get_xaxis_transform(), **marks)


def _around(times: NDArray[Any]) -> list[Any]:
    """Half an hour before and after a time that stands alone."""
    half = np.timedelta64(30, "m") if times.dtype.kind == "M" else 0.5
    return [times[0] - half, times[0] + half]
