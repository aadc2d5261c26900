"""Energy: the power of a vehicle by speed, and what a mission takes, with the charge that it leaves."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from auvplan.energy import TERMS, Fit, PowerModel, best_speed, speed_range
from auvplan.plot import style
from auvplan.records import MissionRun

#: Of the terms of energy.
_COLOURS: dict[str, str] = dict(
    zip(
        TERMS,
        (style.GREY, style.SKY, style.BLUE, style.GREEN, style.YELLOW, style.PURPLE, style.ORANGE),
        strict=True,
    )
)
#: Steps of time over which the power along a mission is averaged.
_STEPS = 240


def plot_energy(run: MissionRun, *, ax: Axes | None = None) -> Axes | NDArray[Any]:
    """Draw the power by term along a mission, stacked, and below it the charge that is left.

    Args:
        run: as executed, or a plan, of a vehicle with a power model; without one the picture says so.
        ax: axes of a grid, whose place the panels take; a new figure if absent.
    """
    energy = run.energy
    if energy is None or len(energy.times) < 2:
        return style.annotate_empty(ax, "no energy is known: give vehicle.power")
    figure = style.figure_for(ax, 9.5, 5.2)
    upper, lower = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    edges = np.linspace(energy.times[0], energy.times[-1], _STEPS + 1)
    totals = energy.totals
    shown = [name for name in TERMS if totals[name] > 0.0]
    heights = []
    for name in shown:
        spent = np.concatenate([np.zeros(1), np.cumsum(energy.terms[name])])
        heights.append(np.diff(np.interp(edges, energy.times, spent)) / np.diff(edges))
    labels = [f"{name} {totals[name]:,.0f} Wh" for name in shown]
    minutes = (edges - energy.times[0]) / 60.0
    stacked = np.repeat(np.asarray(heights), 2, axis=1)
    colours = [_COLOURS[name] for name in shown]
    upper.stackplot(np.repeat(minutes, 2)[1:-1], stacked, labels=labels, colors=colours, lw=0)
    upper.set_ylabel("power [W]")
    upper.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8, frameon=False)
    passed = (energy.times - energy.times[0]) / 60.0
    battery = energy.power.battery
    if battery is None:
        lower.plot(passed, np.concatenate([np.zeros(1), np.cumsum(sum(energy.terms.values()))]) / 3600.0)
        lower.set_ylabel("energy [Wh]")
    else:
        lower.plot(passed, 100.0 * energy.charge, color=style.BLACK, lw=1.6)
        reserve = 100.0 * float(battery.reserve)  # type: ignore[arg-type]
        lower.axhspan(min(0.0, 100.0 * float(energy.charge[-1])), reserve, color=style.RED, alpha=0.14, lw=0)
        lower.annotate("reserve", (0.0, reserve), xytext=(3, -10), textcoords="offset points", fontsize=8)
        lower.set_ylabel("charge [%]")
    for axes in (upper, lower):
        style.grid(axes)
        axes.set_xlim(0.0, minutes[-1])
    lower.set_xlabel("time since the mission began [min]")
    figure.suptitle(energy.line, fontsize=11)
    return np.asarray([upper, lower])


def plot_power(power: PowerModel, fit: Fit | None = None, *, ax: Axes | None = None) -> Axes:
    """Draw the power that a vehicle draws by speed, and the speed of least energy per metre in still water.

    Args:
        power: of the vehicle.
        fit: whose points are drawn as well.
        ax: axes to draw in; those of a new figure if absent.
    """
    axes = style.own_axes(ax, 6.5, 4.2)
    points = fit.speeds if fit is not None else None
    low, high = speed_range(power) if points is None else (float(points.min()), float(points.max()))
    speeds = np.linspace(low, high, 200)
    axes.plot(speeds, power.propulsion(speeds), color=style.BLUE, lw=1.8, label="propulsion")
    if float(power.hotel + power.payload) > 0.0:  # type: ignore[operator]
        axes.plot(speeds, power.power(speeds), color=style.BLACK, lw=1.8, label="with hotel and payload")
        best = float(best_speed(power, limits=(low, high)))
        axes.axvline(best, color=style.GREEN, ls="--", lw=1.2, label=f"least Wh per km: {best:.2f} m/s")
    if fit is not None:
        axes.plot(fit.speeds, fit.watts, "o", color=style.RED, ms=5, label="points")
    axes.set(xlabel="speed through the water [m/s]", ylabel="power [W]", ylim=(0.0, None))
    style.grid(axes)
    axes.legend(fontsize=8)
    return axes
