"""Pictures of a study with a sweep: figures of the missions against the value of a setting."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from auvplan.plot import style
from auvplan.runtime.arrays import Array
from auvplan.runtime.formatting import counted
from auvplan.study import statistics

#: Lines of a second setting, in turn.
_COLOURS = style.BLUE, style.ORANGE, style.GREEN, style.PURPLE, style.RED, style.SKY, style.BLACK
_LINES = list(zip(_COLOURS, "os^DvPX", strict=True))


@dataclass(frozen=True)
class Measure:
    """A figure of a mission: `of` gives [..., missions], NaN where there is none; a `share` is 0 or 100 %."""

    label: str
    of: Callable[[xr.Dataset], Array]
    share: bool = False


def setting_name(dataset: xr.Dataset, dim: str) -> str:
    """Return words for a setting swept over."""
    return str(dataset[dim].attrs.get("long_name", dim))


def setting_value(value: Any) -> str:
    """Return words for one value of a setting."""
    return f"{value:g}" if isinstance(value, np.number) else str(value)


def set_title(figure: Figure, dataset: xr.Dataset, text: str) -> None:
    """What is shown, under the study's title and the settings that were chosen from a sweep."""
    chosen = [dim for dim in statistics.sweep_dims(dataset) if dim not in dataset.dims]
    settings = [f"{setting_name(dataset, dim)} = {setting_value(dataset[dim].values[()])}" for dim in chosen]
    title = dataset.attrs.get("title")
    figure.suptitle(f"{title}\n" * bool(title) + "; ".join([*settings, text]), fontsize=11)


def _plain(name: str, factor: float = 1.0) -> Callable[[xr.Dataset], Array]:
    return lambda dataset: factor * dataset[name].values.astype(float)


MEASURES = (
    Measure("use of the time available [%]", statistics.use_of_time),
    Measure("total priority [-]", _plain("total_priority")),
    Measure("missions on time [%]", _plain("success", 100.0), share=True),
    Measure(
        "median |$T_{path}$ / ($t_{ij}$ − $δ_{ij}$) − 1| [%]",
        lambda dataset: 100.0 * statistics.over_finite(statistics.relative_errors(dataset), np.nanmedian),
    ),
    Measure("path cost per metre of straight line [s/m]", statistics.cost_per_metre),
    Measure("path re-plans per mission [-]", _plain("path_replans")),
    Measure("mission re-plans per mission [-]", _plain("mission_replans")),
)


def plot_sweep(dataset: xr.Dataset) -> Figure:
    """Draw every figure's mean over the missions with its 95 % interval, against the first swept setting."""
    dim, lines = _first_setting(dataset), _line_names(dataset)
    values = dataset[dim].values
    numeric = values.dtype.kind in "iuf"
    places = values.astype(float) if numeric else np.arange(len(values), dtype=float)
    figure = style.new_figure(14.5, 7.2)
    count = counted(dataset.sizes["mission"], "mission")
    note = f"mean of {count}\nand its 95 % interval;\nby Wilson for the share on time"
    for axes, measure, by_line in _panels(figure, dataset, lines, note):
        found = (statistics.wilson_interval if measure.share else statistics.mean_interval)(by_line)
        for k, (mean, low, high) in enumerate(zip(*found, strict=True)):
            order = np.argsort(places)
            at = (places + _shift(k, len(lines), places, 0.06 if numeric else 0.4))[order]
            ends = np.stack([mean - low, high - mean])[:, order]
            colour, marker = _LINES[k % len(_LINES)]
            axes.errorbar(
                at, mean[order], np.maximum(ends, 0.0), color=colour, marker=marker, ms=4.5, capsize=3,
                lw=1.4, ls="-" if numeric else "none",
            )  # fmt: skip
        _value_axis(axes, dataset, places, values)
        axes.set_ylabel(measure.label, fontsize=9)
    set_title(figure, dataset, "mean figures of the missions against " + setting_name(dataset, dim))
    return figure


def plot_paired(dataset: xr.Dataset) -> Figure:
    """Draw every figure's difference from the first setting's first value, mission by mission.

    Boxes hold the middle half of the missions, whiskers 90 %; points are means with their 95 % intervals.
    """
    dim, lines = _first_setting(dataset), _line_names(dataset)
    values = dataset[dim].values
    places = np.arange(1.0, len(values))
    figure = style.new_figure(14.5, 7.2)
    note = (
        "difference mission by mission:\nbox: quartiles, whiskers: 5-95 %,\npoint mean and its 95 % interval"
    )
    for axes, measure, by_line in _panels(figure, dataset, lines, note):
        differences = by_line[:, 1:] - by_line[:, :1]
        axes.axhline(0.0, color=style.GREY, lw=1.0, ls="--", zorder=0)
        for k, line in enumerate(differences):
            colour, marker = _LINES[k % len(_LINES)]
            at = places + _shift(k, len(lines), np.arange(2.0), 0.75)
            # Whether a mission was on time is yes or no: a box says nothing.
            if not measure.share:
                _boxes(axes, at, line, 0.6 / len(lines), colour)
            mean, low, high = statistics.mean_interval(line)
            axes.errorbar(
                at, mean, np.maximum(np.stack([mean - low, high - mean]), 0.0), color="black", mfc=colour,
                marker=marker, ms=5, capsize=3.5, lw=1.5, ls="none", zorder=4,
            )  # fmt: skip
        _value_axis(axes, dataset, places, values[1:], named=True)
        axes.set_ylabel("Δ " + measure.label.replace("[%]", "[% points]"), fontsize=9)
    reference = f"{setting_name(dataset, dim)} = {setting_value(values[0])}"
    count = counted(dataset.sizes["mission"], "mission")
    set_title(figure, dataset, f"differences from {reference}, {count} with the same seeds")
    return figure


def _first_setting(dataset: xr.Dataset) -> str:
    dims = statistics.sweep_dims(dataset)
    if not dims:
        raise ValueError("the study has no sweep")
    return dims[0]


def _line_names(dataset: xr.Dataset) -> list[str]:
    """Return a name for each combination of the settings after the first; one empty name without any."""
    names = [
        [f"{setting_name(dataset, dim)} = {setting_value(value)}" for value in dataset[dim].values]
        for dim in statistics.sweep_dims(dataset)[1:]
    ]
    return [", ".join(parts) for parts in product(*names)]


def _panels(
    figure: Figure, dataset: xr.Dataset, lines: list[str], note: str
) -> Iterator[tuple[Axes, Measure, Array]]:
    """Yield axes for each measure, and it as [lines, values of the first setting, missions].

    The last panel says what the lines are.
    """
    *panels, last = figure.subplots(2, 4).flat
    last.set_axis_off()
    for k, name in enumerate(lines):
        colour, marker = _LINES[k % len(_LINES)]
        if name:
            last.plot([], [], color=colour, marker=marker, ms=5, lw=1.4, label=name)
    last.text(0.0, 0.98, note, transform=last.transAxes, va="top", fontsize=9)
    if any(lines):
        last.legend(loc="lower left", fontsize=8, frameon=False)
    for axes, measure in zip(panels, MEASURES, strict=True):
        values = measure.of(dataset)
        yield axes, measure, np.swapaxes(values.reshape(values.shape[0], -1, values.shape[-1]), 0, 1)


def _shift(line: int, lines: int, places: Array, share: float) -> float:
    """Return how far to move a line aside so that intervals do not cover each other, in units of the axis."""
    gaps = np.diff(np.unique(places))
    return share * float(gaps.min()) * ((line + 0.5) / lines - 0.5) if gaps.size else 0.1 * line


def _boxes(axes: Axes, places: Array, values: Array, width: float, colour: str) -> None:
    """A pale box for each row of values [places, missions]; none where nothing is finite."""
    kept = [row[np.isfinite(row)] for row in values]
    filled = [k for k, row in enumerate(kept) if row.size]
    if filled:
        axes.boxplot(
            [kept[k] for k in filled], positions=places[filled], widths=width, whis=(5, 95),
            showfliers=False, manage_ticks=False, patch_artist=True,
            boxprops={"facecolor": colour, "edgecolor": colour, "alpha": 0.35},
            medianprops={"color": colour}, whiskerprops={"color": colour}, capprops={"color": colour},
        )  # fmt: skip


def _value_axis(axes: Axes, dataset: xr.Dataset, places: Array, values: Any, named: bool = False) -> None:
    """Ticks at the values of the first setting; by name for text, and where `named`."""
    names = [setting_value(value) for value in values]
    span = float(np.ptp(places)) if len(places) else 0.0
    gaps = np.diff(np.unique(places))
    if named or values.dtype.kind not in "iuf":
        axes.set_xlim(places.min() - 0.6, places.max() + 0.6)
        axes.set_xticks(places, names)
        if len(names) * max(map(len, names)) > 38:
            axes.tick_params(axis="x", rotation=25)
    elif gaps.size and gaps.min() > 0.012 * span * max(map(len, names)) * 2.0:
        axes.set_xticks(places, names)
    axes.set_xlabel(setting_name(dataset, _first_setting(dataset)), fontsize=9)
    style.grid(axes)
