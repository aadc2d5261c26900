"""How a leg's plans converge (Fig. 11)."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from auvplan.plot import style
from auvplan.records import LegRecord, MissionRun
from auvplan.view.scene import busiest_leg, leg_title

LABELS = ("cost [s, penalties included]", "violation [-]")
#: Error bars drawn at most.
BARS = 60
#: Larger ranges are drawn on a logarithmic scale.
_WIDE = 30.0


def plot_convergence(
    run: MissionRun, leg: LegRecord | None = None, *, ax: Axes | None = None
) -> NDArray[Any]:
    """Cost and violation of the population by iteration, all plans of a leg in a row.

    Args:
        run: as executed.
        leg: that of `busiest_leg` where not given.
        ax: axes of a grid, whose place the panels take; a new figure if absent.

    Returns:
        [2] axes, of cost and violation.

    Raises:
        ValueError: the run comes from files that do not keep histories.
    """
    leg = leg or busiest_leg(run)
    if leg is None:
        return np.array([style.annotate_empty(ax, "no path was planned")])
    if not all(plan.history for plan in leg.plans):
        raise ValueError("the run's plans have no histories: it was saved without them")
    if not (found := [plan.history for plan in leg.plans if len(plan.history["best"])]):
        return np.array([style.annotate_empty(ax, "nothing was searched for: the leg follows a survey line")])
    figure = style.figure_for(ax, 9.0, 6.6)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, of, label in zip(panels, ("", "violation_"), LABELS, strict=True):
        begin = 0
        # The plans of a leg have nothing between them: lines break where one ends.
        for k, history in enumerate(found):
            best, mean, std = (np.asarray(history[of + part], float) for part in ("best", "mean", "std"))
            end = begin + len(best)
            if k:
                name = "re-plan" if k == 1 else None
                axes.axvline(begin - 0.5, color=style.GREY, ls=":", lw=1.0, zorder=1, label=name)
            names = (None, None, None) if k else ("mean", "standard deviation", "best")
            at = np.arange(begin, end)
            axes.plot(at, _finite(mean), color="black", lw=1.2, zorder=3, label=names[0])
            draw_errors(axes, at, mean, std, max(2, BARS // len(found)), names[1])
            axes.plot(at, _finite(best), color=style.RED, lw=1.8, zorder=4, label=names[2])
            begin = end
        dress(axes, np.concatenate([history[of + part] for part in ("best", "mean") for history in found]))
        axes.set_ylabel(label)
        axes.set_xlim(-0.5, begin - 0.5)
    panels[1].set_xlabel("iteration [-]")
    style.legend_below(figure, ncols=5)
    figure.suptitle(f"Convergence of the path planner, {leg_title(run, leg)}", fontsize=11)
    return panels


def draw_errors(
    axes: Axes, at: NDArray[np.integer], mean: style.Array, std: style.Array, most: int, label: str | None
) -> None:
    """Error bars at some of the iterations; none where the deviation is not finite."""
    bars = np.unique(np.linspace(at[0], at[-1], most).astype(int)) - at[0]
    mean, spread = mean[bars], np.where(np.isfinite(std[bars]), std[bars], 0.0)
    axes.errorbar(
        at[bars], _finite(mean), yerr=[np.minimum(spread, 0.999 * np.abs(mean)), spread],
        fmt="none", ecolor=style.BLUE, elinewidth=0.9, capsize=1.8, zorder=2, label=label,
    )  # fmt: skip


def _finite(values: style.Array) -> style.Array:
    """Gaps in the line where nothing of the population had a finite value."""
    return np.where(np.isfinite(values), values, np.nan)


def dress(axes: Axes, values: style.Array) -> None:
    """A scale that fits the values, logarithmic where they differ much, and a grid."""
    axes.grid(alpha=0.25)
    axes.tick_params(labelsize=8)
    values = values[np.isfinite(values)]
    if not len(values) or values.max() <= 0.0:
        axes.set_ylim(-0.05, 1.0)
    elif values.min() > 0.0:
        if values.max() > _WIDE * values.min():
            axes.set_yscale("log")
            # A deviation larger than its mean would stretch the scale to nothing.
            axes.set_ylim(bottom=0.6 * float(values.min()))
    elif values.max() > _WIDE * values[values > 0.0].min():
        # Zero, which is what a violation should come to, has no place on a logarithmic scale.
        least = max(float(values.max()) * 1e-3, 1e-9)
        axes.set_yscale("symlog", linthresh=least, linscale=0.5)
        axes.set_ylim(bottom=-0.2 * least)
