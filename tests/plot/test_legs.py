"""The leg that tells most, the one asked for, and legs that were refused."""

import numpy as np
import pytest

from auvplan.errors import AuvplanError
from auvplan.plot import busiest_leg, draw_run, plot_currents, plot_mission, plot_timeline, style
from auvplan.plot.maps import Map
from auvplan.view.scene import clearance, done_leg, leg_title, plan_name
from tests.io.sample_run import make_run, refused_leg

pytestmark = pytest.mark.usefixtures("coarse")


def labels(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_clearance_is_that_between_records_too():
    leg = make_run().legs[0]
    leg.times, leg.positions = np.array([0.0, 10.0]), np.array([[0.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    leg.obstacle_positions = np.full((2, 1, 3), [50.0, 30.0, 0.0])
    leg.obstacle_radii = np.array([10.0])
    assert clearance(leg) == pytest.approx(20.0)
    leg.obstacle_positions = np.zeros((2, 0, 3))
    assert clearance(leg) == np.inf


def test_most_replans_count_first_then_the_nearest_obstacle():
    run = make_run()
    run.legs[2].obstacle_radii = run.legs[2].obstacle_radii + 60.0
    assert busiest_leg(run) is run.legs[2]
    assert leg_title(run, run.legs[2]).startswith("leg 3 of 3: 3 → 2\n1 re-plan, as many as any; of such")
    run.legs[1].plans.append(run.legs[1].plans[-1])
    assert busiest_leg(run) is run.legs[1]
    assert leg_title(run, run.legs[1]).splitlines()[1].startswith("most re-plans (2)")
    assert leg_title(run, run.legs[0]).splitlines()[1].startswith("1 re-plan, ")


def test_a_refused_leg_is_not_shown_for_an_executed_one_and_a_second_try_is_no_replan():
    run = make_run()
    refused = refused_leg(run)
    refused.plans = refused.plans + make_run().legs[0].plans * 3
    run.legs.insert(0, refused)
    assert len(busiest_leg(run).times)
    assert leg_title(run, refused).endswith("planned and refused")
    leg = run.legs[1]
    leg.plans.insert(0, leg.plans[0])
    assert [plan_name(leg, k).split(",")[0] for k in range(3)] == ["first plan", "first plan", "re-plan 1"]


def test_the_leg_asked_for_is_drawn(tmp_path):
    run = make_run()
    assert done_leg(run, 2) is run.legs[1]
    names = ["convergence.png", "timeline.png"]
    paths = draw_run(run, tmp_path, names, leg="all")
    assert [path.name for path in paths] == [f"convergence-{k}.png" for k in (1, 2, 3)] + ["timeline.png"]
    assert [path.name for path in draw_run(run, tmp_path, names[:1], leg=3)] == names[:1]
    assert (tmp_path / names[0]).read_bytes() == paths[2].read_bytes()
    for number in (0, 4):
        with pytest.raises(AuvplanError, match="3 done legs: choose 1 to 3"):
            draw_run(run, tmp_path / "none", leg=number)
    assert not (tmp_path / "none").exists()
    assert "leg 1 of 3" in style.figure_of(plot_currents(run, run.legs[0])).get_suptitle()


def test_without_histories_there_is_no_convergence(tmp_path):
    run = make_run()
    for plan in busiest_leg(run).plans:
        plan.history = {}
    paths = draw_run(run, tmp_path, ["mission.png", "convergence.png"])
    assert [path.name for path in paths] == ["mission.png"]


@pytest.mark.parametrize("plot", [plot_mission, plot_timeline])
def test_refused_legs_are_marked_where_there_are_some(plot):
    run = make_run()
    assert not [text for text in labels(style.figure_of(plot(run))) if "refused" in text]
    run.legs.insert(1, refused_leg(run))
    axes = plot(run)
    assert len([text for text in labels(style.figure_of(axes)) if "refused" in text]) == 1
    crosses = [line for line in axes.lines if line.get_marker() == "x"]
    assert len(crosses) == 1
    if plot is plot_timeline:
        assert crosses[0].get_xdata()[0] == run.legs[1].plans[-1].made_at


def test_the_compass_keeps_off_what_is_drawn():
    everywhere = np.random.default_rng(0).uniform(0.0, 1000.0, (400, 2))
    for corner in ((0, 0), (1, 0), (0, 1), (1, 1)):
        axes = style.new_figure(4.0, 4.0).subplots()
        pen = Map(axes, np.zeros(2), np.full(2, 1000.0))
        free = ~np.all(np.abs(everywhere / 1000.0 - corner) < 0.4, axis=1)
        pen.compass(everywhere[free][:, ::-1])
        bar = axes.lines[0].get_xydata()
        assert np.all((bar > 500.0) == np.array(corner, bool))
