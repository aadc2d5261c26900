"""How a leg's plans converge (Fig. 11)."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from auvplan.plot import style
from auvplan.plot.legs import busiest_leg
from auvplan.voyage.records import LegRecord, MissionRun

#: Error bars drawn at most.
_BARS = 60
#: Larger ranges are drawn on a logarithmic scale.
_WIDE = 30.0


def plot_convergence(run: MissionRun, leg: LegRecord | None = None) -> Figure:
    """Cost and violation of the population by iteration, all plans of a leg in a row.

    Args:
        run: as sailed.
        leg: the one with most re-plans where not given.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return style.empty_figure("no path was planned")
    figure = style.new_figure(9.0, 6.6)
    upper, lower = figure.subplots(2, 1, sharex=True)
    _draw(upper, leg, ("best", "mean", "std"), "cost [s, penalties included]")
    _draw(lower, leg, ("violation_best", "violation_mean", "violation_std"), "violation [-]")
    lower.set_xlabel("iteration [-]")
    handles, labels = upper.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    figure.suptitle(f"Convergence of the path planner, leg {leg.start} → {leg.goal}", fontsize=11)
    return figure


def _draw(axes: Axes, leg: LegRecord, keys: tuple[str, str, str], label: str) -> None:
    best, mean, std = (
        np.concatenate([np.asarray(plan.history[key], float) for plan in leg.plans]) for key in keys
    )
    count = np.asarray([len(plan.history[keys[0]]) for plan in leg.plans])
    first = np.concatenate([[0], np.cumsum(count)[:-1]])
    iteration = np.arange(len(best))
    # The plans of a leg have nothing between them: lines break where one ends.
    for k, (begin, length) in enumerate(zip(first, count, strict=True)):
        part = slice(begin, begin + length)
        bars = np.unique(np.linspace(begin, begin + length - 1, max(2, _BARS // len(count))).astype(int))
        spread = np.where(np.isfinite(std[bars]), std[bars], 0.0)
        names = ("mean", "standard deviation", "best") if k == 0 else (None, None, None)
        axes.plot(iteration[part], _finite(mean[part]), color="black", lw=1.2, zorder=3, label=names[0])
        axes.errorbar(
            iteration[bars], _finite(mean[bars]),
            yerr=[np.minimum(spread, 0.999 * np.abs(mean[bars])), spread],
            fmt="none", ecolor=style.BLUE, elinewidth=0.9, capsize=1.8, zorder=2, label=names[1],
        )  # fmt: skip
        axes.plot(iteration[part], _finite(best[part]), color=style.RED, lw=1.8, zorder=4, label=names[2])
        if k:
            name = "re-plan" if k == 1 else None
            axes.axvline(begin - 0.5, color=style.GREY, ls=":", lw=1.0, zorder=1, label=name)
    _scale(axes, _finite(np.concatenate([best, mean])))
    axes.set_ylabel(label)
    axes.grid(alpha=0.25)
    axes.tick_params(labelsize=8)
    axes.set_xlim(-0.5, len(best) - 0.5)


def _finite(values: style.Array) -> style.Array:
    """Gaps in the line where nothing of the population had a finite value."""
    return np.where(np.isfinite(values), values, np.nan)


def _scale(axes: Axes, values: style.Array) -> None:
    values = values[np.isfinite(values)]
    if not len(values) or values.max() <= 0.0:
        axes.set_ylim(-0.05, 1.0)
        return
    if values.min() > 0.0:
        if values.max() > _WIDE * values.min():
            axes.set_yscale("log")
            # A deviation larger than its mean would stretch the scale to nothing.
            axes.set_ylim(bottom=0.6 * float(values.min()))
    elif values.max() > _WIDE * values[values > 0.0].min():
        # Zero, which is what a violation should come to, has no place on a logarithmic scale.
        least = max(float(values.max()) * 1e-3, 1e-9)
        axes.set_yscale("symlog", linthresh=least, linscale=0.5)
        axes.set_ylim(bottom=-0.2 * least)
