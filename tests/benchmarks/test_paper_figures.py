"""The paper's figures show what the records hold."""

import numpy as np
import pytest
import xarray as xr

from auvplan.ocean.chart import Chart
from auvplan.plot import style
from auvplan.plot.paths import plot_currents
from auvplan.plot.timeline import plot_timeline
from benchmarks.paper.plots import (
    plot_call_times,
    plot_clusters,
    plot_layers,
    plot_populations,
    plot_windows,
)
from tests.benchmarks import paper_evidence as evidence
from tests.io.sample_run import make_run, refused_leg
from tests.plot.sample_study import make_study

SENSORS = {"range": 150.0, "interval": 30.0, "growth": 0.1, "growth_max": 20.0}


@pytest.fixture(autouse=True)
def coarse(monkeypatch):
    """Pictures of few pixels: it is enough that they come about."""
    monkeypatch.setattr(style, "DPI", 50)


@pytest.fixture
def run():
    run = make_run((0, 1))
    run.scenario |= {"sensors": SENSORS}
    return run


@pytest.fixture
def saved(tmp_path):
    def save(figure):
        assert style.save(figure, tmp_path / "figure.png").stat().st_size > 3_000
        return figure

    return save


def test_clusters_show_the_map_and_its_window(saved):
    passability = np.ones((100, 100))
    passability[60:80, 20:40], passability[80:, 20:40] = 0.3, 0.0
    picture = np.full((100, 100, 3), 200, np.uint8)
    figure = saved(plot_clusters(Chart.from_passability(passability, 10.0), picture, (0, 10, 50, 40)))
    titles = [axes.get_title() for axes in figure.axes]
    assert "100 × 100 pixels of 10 m" in titles[0]
    assert titles[1] == "clusters: coast 4.0%, uncertain 4.0%, water 92.0%"
    assert "50 × 40 pixels" in titles[2]
    # Rows 0 to 50 from the north, columns 10 to 50: all of the land.
    assert titles[3] == "clusters: coast 20.0%, uncertain 20.0%, water 60.0%"
    image = np.asarray(figure.axes[1].images[0].get_array())
    assert (image[:20, 20:40] == 0.0).all(), "coast in the north is black"
    assert (image[50:] == 1.0).all(), "water is white"


def test_current_panels_stand_side_by_side_and_carry_the_note(run, saved):
    figure = saved(style.figure_of(plot_currents(run, note="as chosen")))
    assert "as chosen" in figure.get_suptitle()


def test_layers_have_one_current_for_each_plan(run, saved):
    figure = saved(plot_layers(run))
    times = ", ".join(f"{plan.made_at:,.0f}" for plan in run.legs[0].plans)
    assert f"layers of the current at {times} s" in figure.get_suptitle()
    low, high = figure.axes[0].get_zlim()
    assert low > high, "depth points down"


def test_windows_draw_the_first_path_dashed_re_plans_thick_and_growing_boundaries(run, saved):
    axes, leg = saved(plot_windows(run)).axes[0], run.legs[0]
    first, last = leg.plans
    dashed = next(line for line in axes.lines if line.get_linestyle() == "--")
    np.testing.assert_allclose(dashed.get_xydata(), first.positions[:, [1, 0]])
    thick = max(axes.lines, key=lambda line: line.get_linewidth())
    np.testing.assert_allclose(thick.get_xydata(), last.positions[:, [1, 0]])
    assert "re-plans 1 by window" in axes.get_title()
    radii = sorted(circle.get_radius() for circle in axes.patches)
    assert len(radii) == 2 * 2 * len(leg.plans)
    assert radii[0] == pytest.approx(leg.obstacle_radii.min())
    assert leg.obstacle_radii.max() < radii[-1] <= leg.obstacle_radii.max() + SENSORS["growth_max"]


def test_a_rejected_retry_is_not_drawn(run):
    leg = run.legs[0]
    leg.plans.insert(1, refused_leg(make_run()).plans[0])
    lines = plot_windows(run).axes[0].lines
    assert sum(line.get_linestyle() == "--" for line in lines) == 1
    drawn, retry = np.concatenate([line.get_xydata() for line in lines]), leg.plans[1].positions[:, [1, 0]]
    assert not any(np.isclose(drawn, place).all(axis=1).any() for place in retry[5:-5])


def test_populations_show_the_mean_over_the_seeds(saved):
    legs = evidence.legs()
    legs["violation_mean"][1] += 0.5
    met = np.array([[True] * 4, [False] * 4, [True, True, True, False]])
    figure = saved(plot_populations(legs, met, 1e-3))
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == list(legs["scenario"].values)
    assert [title.split(": ")[1].split(" %")[0] for title in titles[3:]] == ["100", "0", "75"]
    mean = next(line for line in figure.axes[0].lines if line.get_label() == "mean")
    np.testing.assert_allclose(mean.get_ydata(), legs["cost_mean"][0].mean("seed"))


def test_call_times_stand_beside_all_planning_and_the_interval(saved):
    times = {
        name: ("mission", np.full(4, value)) for name, value in (("first_cpu", 0.2), ("window_cpu", 0.05))
    }
    calls = xr.Dataset(times, {"seed": ("mission", [0, 2, 4, 6])})
    left, right = saved(plot_call_times(make_study(8), calls, 30.0)).axes
    single = next(line for line in left.lines if "a leg" in str(line.get_label()))
    np.testing.assert_allclose(single.get_xydata(), np.stack([[0, 2, 4, 6], np.full(4, 0.2)], axis=1))
    assert any(np.allclose(line.get_ydata(), 30.0) for line in left.lines)
    assert [text.get_text().split("\n")[1] for text in right.get_xticklabels()][1:] == ["0.2 s", "0.05 s"]


def test_a_new_order_says_when_it_was_made_and_which_leg_was_late():
    run = make_run()
    leg = run.legs[0]
    took = leg.t_path + leg.t_task
    leg.t_expected = took - 25.0
    name = plot_timeline(run).get_yticklabels()[1].get_text()
    assert f"at {run.routes[1].made_at:,.0f} s, late" in name
    assert f"0→1 took {took:,.0f} s, not {leg.t_expected:,.0f} s" in name
