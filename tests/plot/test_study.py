"""Figures of a study show the dataset's numbers, for few missions and many, with and without a sweep."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.quiver import Quiver
from PIL import Image
from scipy import stats

from auvplan.plot import study as figures
from auvplan.plot import style
from auvplan.plot.study import draw_study, shown_mission
from auvplan.plot.sweep import MEASURES, plot_paired, plot_sweep
from auvplan.runtime.files import OutputError
from auvplan.study.statistics import leg_times, relative_errors
from tests.plot.sample_study import AVAILABLE, SPEED, make_study, without_legs

NAMES = ["time_use.png", "expected_times.png", "planning_time.png", "replans.png"]
SWEEPS = ["sweep.png", "sweep_paired.png"]
RATES = {"current.update_rate": [0.0, 0.1, 0.2]}
OBJECTIVES = {"planning.objective": ["priority", "weighted"]}


@pytest.fixture(autouse=True)
def of_others(coarse):
    """What is counted are the figures of one test."""
    plt.close("all")


def panels(figure: Any) -> list[Any]:
    return [axes for axes in figure.axes if axes.get_visible() and axes.axison]


def line_of(axes: Any, label: str) -> Any:
    return next(line for line in axes.lines if line.get_label() == label)


def with_nothing_but_nan(study):
    return study.assign({name: study[name] * np.nan for name in study if study[name].dtype.kind == "f"})


@pytest.mark.parametrize(
    "study",
    [
        make_study(5, RATES),
        without_legs(make_study(3, RATES)).isel(leg=slice(0), plan=slice(0), route=slice(0)),
        *(
            pytest.param(study, marks=pytest.mark.slow)
            for study in (
                make_study(1, failed=(0,)),
                make_study(8, failed=range(8), chart=False),
                make_study(1, {"planning.objective": ["only"]}),
                without_legs(make_study(3, RATES)),
                with_nothing_but_nan(make_study(3, RATES, chart=False)),
                make_study(1, RATES | OBJECTIVES),
            )
        ),
    ],
)
def test_all_figures_also_of_studies_that_lack_something(tmp_path, study):
    dims = study.attrs["sweep"]
    single = not dims or study.sizes[dims.split(",")[0]] == 1
    paths = draw_study(study, tmp_path)
    assert [path.name for path in paths] == NAMES + (SWEEPS[:1] if single else SWEEPS) * bool(dims)
    for path in paths:
        with Image.open(path) as picture:
            pixels = np.asarray(picture.convert("RGB"), int)
        assert len(np.unique(pixels @ [65536, 256, 1])) > 20, f"{path.name} is empty"
    assert plt.get_fignums() == []


@pytest.mark.parametrize("plot", [plot_sweep, plot_paired])
def test_a_sweep_over_yes_and_no_and_two_more_settings(plot):
    figure = plot(make_study(2, {"flag": [True, False], "vehicle.speed": [2, 3]} | OBJECTIVES))
    figure.draw_without_rendering()
    assert all(axes.get_xlabel() == "flag" for axes in panels(figure))


@pytest.mark.slow
def test_missions_are_shown_in_order_of_seed(tmp_path, monkeypatch):
    monkeypatch.setattr(style, "save", lambda figure, _: figure)
    study = make_study()
    mixed = study.isel(mission=[3, 1, 7, 0, 2, 6, 5, 4])
    for figure, other in zip(draw_study(study, tmp_path), draw_study(mixed, tmp_path), strict=True):
        assert what_is_drawn(figure) == what_is_drawn(other)


def what_is_drawn(figure):
    """Texts, lines, boxes and marks of a figure, as text."""
    parts = [figure.get_suptitle()]
    for axes in panels(figure):
        parts += [axes.get_title(), *(text.get_text() for text in axes.texts)]
        parts += [line.get_xydata().tolist() for line in axes.lines]
        parts += [
            [*patch.get_path().vertices.tolist(), *patch.get_extents().bounds] for patch in axes.patches
        ]
        parts += [np.asarray(marks.get_offsets()).tolist() for marks in axes.collections]
    assert len(parts) > 3
    return str(parts)


def test_unwritable_folder_and_unknown_seed(tmp_path):
    (tmp_path / "taken").touch()
    with pytest.raises(OutputError, match="taken"):
        draw_study(make_study(1), tmp_path / "taken")
    with pytest.raises(ValueError, match="no mission of seed 99; the study's are 0 to 7"):
        draw_study(make_study(), tmp_path / "new", seed=99)
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("count", [7, 300])
def test_time_use(count):
    study = make_study(count, failed=(2, 5), first_seed=40)
    figure = figures.plot_time_use(study)
    upper, lower = panels(figure)
    limit = line_of(upper, "$T_{available}$")
    assert limit.get_color() == "red"
    assert set(limit.get_ydata()) == {AVAILABLE}
    assert limit.get_xdata()[0] < 0
    assert limit.get_xdata()[-1] > count - 1
    failed = study["success"].values == 0
    for label, kept in (("on time", ~failed), ("failed", failed)):
        line = line_of(upper, label)
        np.testing.assert_array_equal(line.get_xdata(), np.flatnonzero(kept))
        np.testing.assert_array_equal(line.get_ydata(), study["t_mission"].values[kept])
    heights = {round(bar.get_center()[0]): bar.get_height() for bar in lower.patches}
    np.testing.assert_allclose([heights[k] for k in range(count)], study["t_residual"].values)
    share = 100 * float((study["t_mission"] / study["t_available"]).mean())
    title = figure.get_suptitle()
    assert f"mean use of time {share:.1f} %, {count - 2} of {count:,} missions on time" in title
    assert "failed: seed 42, 45" in title
    if count == 7:
        figure.draw_without_rendering()
        labels = [label.get_text() for label in lower.get_xticklabels()]
        assert [label for label in labels if label] == [str(seed) for seed in range(40, 47)]


@pytest.mark.parametrize("count", [4, 40])
def test_expected_times(count):
    study = make_study(count)
    left, right = panels(figures.plot_expected_times(study))
    assert len(left.patches) == 2 * min(count, 25)
    assert ("first 25 of 40" in left.get_title()) == (count == 40)
    reached = study["leg_arrived"].values == 1
    expected = (study["leg_t_expected"] - study["leg_t_task"]).values[reached]
    executed = study["leg_t_path"].values[reached]
    # The failed mission left its last leg unfinished.
    assert reached[2].sum() < np.isfinite(study["leg_t_path"].values[2]).sum()
    np.testing.assert_allclose(right.collections[0].get_offsets(), np.stack([expected, executed], axis=1))
    text = right.texts[0].get_text()
    assert f"correlation {np.corrcoef(expected, executed)[0, 1]:.3f}" in text
    assert f"median relative error {100 * np.median(np.abs(executed / expected - 1)):.1f} %" in text
    assert right.get_xlim() == right.get_ylim()


def test_boxes_are_wide_and_transparent_for_the_time_executed():
    study = make_study(3, failed=())
    left, right = panels(figures.plot_expected_times(study))
    assert "− $δ_{ij}$" in right.get_xlabel()
    for boxes, times, alpha in zip(
        (left.patches[3:], left.patches[:3]), leg_times(study), (1.0, 0.55), strict=True
    ):
        for k, box in enumerate(boxes):
            corners = box.get_path().vertices[:-1]
            quartiles = np.nanquantile(times[k], [0.25, 0.75])
            np.testing.assert_allclose([corners[:, 1].min(), corners[:, 1].max()], quartiles)
            assert box.get_alpha() == alpha
    wide, narrow = (np.ptp(left.patches[k].get_path().vertices[:, 0]) for k in (0, 3))
    assert wide > 2 * narrow
    none = study.assign(leg_t_task=0.0 * study["leg_t_task"])
    assert panels(figures.plot_expected_times(none))[1].get_xlabel() == "expected, $t_{ij}$ [s]"


def test_planning_time():
    study = make_study(6)
    (axes,) = panels(figures.plot_planning_time(study))
    assert axes.get_yscale() == "log"
    calls = line_of(axes, "one path planning call, median").get_ydata()
    np.testing.assert_allclose(calls, np.nanmedian(study["plan_cpu"].values, axis=1))
    whole = line_of(axes, "all planning of the mission: paths, routes, travel times").get_ydata()
    np.testing.assert_allclose(whole, study["path_cpu"] + study["mission_cpu"] + study["travel_time_cpu"])
    ends = np.stack([path.vertices[:, 1] for path in axes.collections[0].get_paths()])
    np.testing.assert_allclose(ends.T, np.nanquantile(study["plan_cpu"].values, [0.05, 0.95], axis=1))


def test_the_mission_shown_is_one_on_time():
    study = make_study(20, failed=())
    routes = (study["route_nodes"].values >= 0).any(axis=-1).sum(axis=-1)
    best = shown_mission(study)
    assert routes[best] == routes.max()
    failed = study.copy(deep=True)
    failed["success"][best] = 0
    assert shown_mission(failed) != best
    assert shown_mission(study.assign(success=0 * study["success"])) == best
    assert shown_mission(study, seed=11) == 11


def test_maps_of_the_routes():
    study = make_study(30)
    mission = shown_mission(study)
    figure = figures.plot_replans(study)
    one = study.isel(mission=mission)
    count = int(one["mission_replans"]) + 1
    assert count > 2
    assert len(panels(figure)) == min(count, 6)
    assert f"seed {mission}: {count - 1} mission re-plans, on time" in figure.get_suptitle()
    for number, axes in enumerate(panels(figure)):
        nodes = one["route_nodes"].values[number]
        nodes = nodes[nodes >= 0]
        places = one["waypoint_position"].values[nodes][:, [1, 0]] / 1000.0
        arrows: Any = next(item for item in axes.collections if isinstance(item, Quiver))
        np.testing.assert_allclose(arrows.get_offsets(), places[:-1])
        np.testing.assert_allclose(np.stack([arrows.U, arrows.V], axis=1), np.diff(places, axis=0))
        # What was executed before leads from the start to where the route begins.
        executed = axes.lines[0].get_xydata()
        start = one["waypoint_position"].values[0, [1, 0]] / 1000.0
        np.testing.assert_allclose(executed[[0, -1]], [start, places[0]])
        assert (len(executed) > 1) == (number > 0)
        title = axes.get_title()
        assert title.startswith("first route" if number == 0 else f"re-plan R{number}, late")
        assert f"at {float(one['route_made_at'][number]):,.0f} s" in title
        assert f"priority {float(one['route_priority'][number]):g}" in title
        legs = len(nodes) - 1
        assert f"{legs} leg{'s' * (legs != 1)} left" in title
        assert sorted(text.get_text() for text in axes.texts) == sorted(map(str, nodes))
        # East is to the right and north up, over as much of the chart as is seen: 10 km in pixels of 10 m.
        assert axes.get_aspect() == 1.0
        west, east, south, north = axes.images[0].get_extent()
        for (low, high), (begin, end) in ((axes.get_xlim(), (west, east)), (axes.get_ylim(), (south, north))):
            assert 0.0 <= begin <= max(low, 0.0) < min(high, 10.0) <= end <= 10.0
            pixels = 100.0 * np.asarray([begin, end])
            np.testing.assert_allclose(pixels, np.round(pixels), atol=1e-6)


@pytest.mark.slow
def test_maps_of_many_routes_show_the_first_and_the_last():
    study = make_study(1, failed=())
    routes = [name for name in study if "route" in study[name].dims]
    many = study.drop_vars(routes).assign({name: study[name].isel(route=[0] * 12) for name in routes})
    many["route_made_at"][0] = np.arange(12.0)
    titles = [axes.get_title().splitlines()[0] for axes in panels(figures.plot_replans(many))]
    assert len(titles) == 6
    assert titles[0] == "first route, at 0 s"
    assert titles[-1].startswith("re-plan R11")


def test_a_leg_executed_twice_to_one_waypoint():
    study = make_study(1, failed=())
    study["leg_arrived"][0] = -1
    study["leg_arrived"][0, :4], study["leg_to"][0, :4] = 1, [3, 5, 3, 6]
    study["route_nodes"][0] = -1
    for row, nodes in enumerate(([0, 3, 5, 19], [5, 3, 19], [3, 6, 19], [6, 19])):
        study["route_nodes"][0, row, : len(nodes)] = nodes
    lines = [axes.lines[0].get_xydata() for axes in panels(figures.plot_replans(study))]
    assert [len(line) for line in lines] == [1, 3, 4, 5]


def test_figures_of_one_setting_name_it():
    study = make_study(3, RATES)
    title = figures.plot_time_use(study.isel(current_update_rate=1)).get_suptitle()
    assert "current.update_rate = 0.1; mean use of time" in title
    study = make_study(3, OBJECTIVES).isel(planning_objective=0)
    assert "planning.objective = priority" in figures.plot_replans(study).get_suptitle()


def points_of(axes):
    """[lines, values] of the points that carry intervals, and the intervals' ends."""
    containers = axes.containers
    points = np.stack([container.lines[0].get_ydata() for container in containers])
    bars = [container.lines[2][0].get_segments() for container in containers]
    return points, np.asarray([[segment[:, 1] for segment in line] for line in bars])


def test_sweep_shows_means_and_intervals():
    """In order of the values, though they are swept in another."""
    study = make_study(12, {"current.update_rate": [0.2, 0.0, 0.1]})
    axes = panels(plot_sweep(study))
    study = study.sortby("current_update_rate")
    assert len(axes) == len(MEASURES)
    points, ends = points_of(axes[1])
    priority = study["total_priority"].values
    np.testing.assert_allclose(points[0], priority.mean(axis=1))
    spread = stats.t.interval(0.95, 11, priority.mean(axis=1), stats.sem(priority, axis=1))
    np.testing.assert_allclose(ends[0], np.transpose(spread))
    np.testing.assert_allclose(points_of(axes[2])[0], [[1100 / 12] * 3])
    errors = 100 * np.nanmedian(relative_errors(study), axis=-1)
    np.testing.assert_allclose(points_of(axes[3])[0][0], errors.mean(axis=1))
    np.testing.assert_allclose(axes[0].containers[0].lines[0].get_xdata(), RATES["current.update_rate"])
    assert all(panel.get_xlabel() == "current.update_rate" for panel in axes)
    assert all(panel.get_ylabel().endswith("]") for panel in axes)


def test_a_line_for_each_value_of_a_second_setting():
    study = make_study(6, OBJECTIVES | RATES)
    figure = plot_sweep(study)
    points = points_of(panels(figure)[1])[0]
    np.testing.assert_allclose(points, study["total_priority"].values.mean(axis=-1).T)
    legend = figure.axes[-1].get_legend()
    assert legend is not None
    names = [text.get_text() for text in legend.get_texts()]
    assert names == [f"current.update_rate = {rate:g}" for rate in RATES["current.update_rate"]]
    labels = [label.get_text() for label in panels(figure)[0].get_xticklabels()]
    assert labels == ["priority", "weighted"]
    replans = study["path_replans"].values
    points = points_of(panels(plot_paired(study))[5])[0]
    np.testing.assert_allclose(points, (replans[1:] - replans[:1]).mean(axis=-1).T)


def test_paired_differences():
    study = make_study(9, RATES)
    figure = plot_paired(study)
    axes = panels(figure)[1]
    priority = study["total_priority"].values
    differences = priority[1:] - priority[:1]
    points, ends = points_of(axes)
    np.testing.assert_allclose(points[0], differences.mean(axis=1))
    np.testing.assert_allclose(ends[0].mean(axis=1), points[0])
    assert [label.get_text() for label in axes.get_xticklabels()] == ["0.1", "0.2"]
    quartiles = np.quantile(differences, [0.25, 0.75], axis=1).T
    for box, quartile in zip(axes.patches, quartiles, strict=True):
        heights = box.get_path().vertices[:-1, 1]
        np.testing.assert_allclose([heights.min(), heights.max()], quartile)
    assert "differences from current.update_rate = 0" in figure.get_suptitle()
    with pytest.raises(ValueError, match="no sweep"):
        plot_paired(make_study())


def test_path_cost_is_of_the_first_plan_of_each_leg():
    study = make_study(4, RATES)
    cost = MEASURES[4].of(study)
    # In the sample a first plan costs 1.01 of the time executed, and later plans less.
    reached = study["leg_arrived"].values == 1
    rate = np.where(reached, 1.01 * study["leg_t_path"] / study["leg_distance"], np.nan)
    np.testing.assert_allclose(cost, np.nanmean(rate, axis=-1))
    assert np.nanmin(cost) > 0.9 / SPEED
