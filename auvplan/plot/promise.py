"""What it costs to be home in time: how sure plans are by the total priority that they leave."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

from auvplan.plot import style
from auvplan.records import MissionRun

#: Shares that are marked, as far as they are in reach.
_TICKS = 0.01, 0.05, 0.1, 0.2, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999


def plot_promises(runs: Sequence[MissionRun], *, ax: Axes | None = None) -> Axes:
    """Draw the share of drawn seas in which plans are home in time by their total priority.

    Shares are drawn by their odds, so that 99 % and 99.9 % are apart.

    Args:
        runs: plans with promises.
        ax: to draw on; a new figure if absent.
    """
    axes = style.own_axes(ax, 6.6, 4.6)
    promises = [run.promise for run in runs if run.promise is not None]
    priority = np.asarray([run.total_priority for run in runs])
    ends = 0.5 / promises[0].seas  # what is counted never or always is no surer than that
    share, low, high = (
        np.clip([getattr(one, of) for one in promises], ends, 1.0 - ends) for of in ("share", "low", "high")
    )
    axes.set_yscale("logit")
    axes.errorbar(
        priority, share, yerr=[share - low, high - share], fmt="o-", color=style.BLUE, capsize=3, lw=1.4
    )
    for run, x, y in zip(runs, priority, share, strict=True):
        place = {"xytext": (7, 3), "textcoords": "offset points", "fontsize": 8}
        axes.annotate(f"{run.tasks} tasks", (x, y), **place)
    least = 0.7 * float(low.min())
    axes.set_ylim(least, 1.0 - 0.6 * ends)
    axes.yaxis.set_major_locator(FixedLocator([tick for tick in _TICKS if tick >= least]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{100.0 * value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.margins(x=0.18)
    axes.set_xlabel("total priority [-]")
    axes.set_ylabel(f"home in time [% of {promises[0].seas:,} drawn seas]")
    axes.set_title(str(runs[0].scenario.get("name") or "mission"), fontsize=11)
    style.grid(axes)
    return axes
