"""The figure of departures: every one is there, the best and those without a way are marked."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest
from matplotlib.dates import num2date

from auvplan.executive import Departures
from auvplan.plot import plot_departures
from auvplan.plot.style import figure_of
from auvplan.site import Site
from tests.plot.test_figures import assert_apart

EPOCH = datetime(2026, 3, 1, 21, tzinfo=UTC)


def make(count=9, dated=True, closed=(2, 3, 8), leg=False):
    """Departures half an hour apart, an hour after the scenario's; some are not feasible."""
    feasible = ~np.isin(np.arange(count), closed)
    time = np.where(feasible, 3000.0 + 40.0 * (np.arange(count) - 5.0) ** 2, np.nan)
    gain = np.where(feasible, 6, 0)
    return Departures(
        departs=3600.0 + 1800.0 * np.arange(count),
        feasible=feasible,
        time=time,
        tasks=0 * gain if leg else gain,
        priority=np.zeros(count) if leg else 3.0 * gain,
        current=0.5 + 0.1 * np.arange(count),
        reasons=tuple("" if kept else "cross-current" for kept in feasible),
        routes=None if leg else (None,) * count,
        site=Site(5.0, 60.0, EPOCH if dated else None),
    )


def shaded(axes):
    """First and last of the times of each shade."""
    return sorted((patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches)


def test_best_is_of_most_priority_then_least_time_then_earliest():
    found = make()
    assert found.best == 5
    assert replace(found, priority=np.where(np.arange(9) == 7, 99.0, found.priority)).best == 7
    assert replace(found, time=np.where(found.feasible, 3000.0, np.nan)).best == 0
    assert make(closed=range(9)).best is None
    assert found.moment(5) == "2026-03-02 00:30 UTC"
    assert make(dated=False).moment(5) == "+3.50 h"


@pytest.mark.parametrize(
    ("leg", "labels"),
    [
        (False, ["total priority [-]", "tasks [-]", "mission time [min]", "current [m/s]"]),
        (True, ["travel time [min]", "current [m/s]"]),
    ],
)
def test_panels_have_labels_with_units_and_all_feasible_departures(leg, labels):
    found = make(leg=leg)
    figure = figure_of(plot_departures(found))
    assert [axes.get_ylabel() for axes in figure.axes] == labels
    assert figure.axes[-1].get_xlabel() == "departure [UTC]"
    minutes = figure.axes[labels.index(labels[-2])].lines[0].get_ydata()
    np.testing.assert_allclose(minutes, found.time / 60.0)
    np.testing.assert_allclose(figure.axes[-1].lines[0].get_ydata(), found.current)


def test_shades_lie_around_the_departures_that_are_not_feasible():
    found = make(dated=False)
    figure = figure_of(plot_departures(found))
    hours = found.departs / 3600.0
    expected = [(hours[k] - 0.25, min(hours[k] + 0.25, hours[-1])) for k in (2, 3, 8)]
    for axes in figure.axes:
        np.testing.assert_allclose(shaded(axes), expected)
    crosses = [line.get_xdata()[0] for line in figure.axes[0].lines[1:]]
    np.testing.assert_allclose(crosses, hours[[2, 3, 8]])
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert sorted(texts) == ["best: +3.50 h", "not feasible"]


def test_dates_are_utc():
    figure = figure_of(plot_departures(make()))
    first = figure.axes[-1].lines[0].get_xdata()[0]
    assert num2date(figure.axes[-1].convert_xunits(first)) == datetime(2026, 3, 1, 22, tzinfo=UTC)


@pytest.mark.parametrize(
    ("count", "dated", "closed"),
    [
        (1, True, ()),
        (1, False, (0,)),
        (2, True, (0,)),
        (2, False, (0, 1)),
        (60, True, ()),
        (200, True, range(200)),
    ],
)
def test_any_number_of_departures_can_be_drawn_without_labels_on_each_other(count, dated, closed):
    figure = figure_of(plot_departures(make(count, dated, closed)))
    figure.draw_without_rendering()
    for axis in (figure.axes[-1].xaxis, *(axes.yaxis for axes in figure.axes)):
        labels = [label for label in (*axis.get_ticklabels(), axis.offsetText) if label.get_text()]
        assert_apart([*labels, axis.label], 1)


def test_the_order_of_departures_does_not_matter():
    found, mixed = make(dated=False), np.array([4, 0, 8, 1, 7, 2, 6, 3, 5])
    arrays = {
        name: getattr(found, name)[mixed]
        for name in ("departs", "feasible", "time", "tasks", "priority", "current")
    }
    figure = figure_of(plot_departures(replace(found, **arrays)))
    line = figure.axes[-1].lines[0]
    np.testing.assert_allclose(line.get_xydata(), np.stack([found.departs / 3600.0, found.current], axis=1))
