"""Intervals against SciPy and closed forms; the figures of a study against its numbers."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from auvplan.study import summarise
from auvplan.study.statistics import (
    leg_times,
    mean_interval,
    median_interval,
    over_finite,
    relative_errors,
    sweep_dims,
    use_of_time,
    wilson_interval,
)
from tests.plot.sample_study import AVAILABLE, make_study, without_legs

RATES = {"current.update_rate": [0.0, 0.1, 0.2]}
OBJECTIVES = {"planning.objective": ["priority", "eq15"]}

numbers = st.floats(-1e6, 1e6, allow_subnormal=False)


def strict(summary):
    """A summary as JSON keeps it, which knows neither NaN nor infinity."""
    return json.loads(json.dumps(summary, allow_nan=False))


def test_mean_and_its_interval_leave_out_what_is_not_finite():
    values = np.array([[1.0, 2.0, 4.0, np.nan], [3.0, np.nan, np.nan, np.inf], [np.nan] * 4])
    mean, low, high = mean_interval(values)
    np.testing.assert_allclose(mean, [7.0 / 3.0, 3.0, np.nan])
    assert np.isnan(low[1:]).all()
    assert np.isnan(high[1:]).all()
    spread = stats.t.interval(0.95, 2, mean[0], stats.sem(values[0, :3]))
    np.testing.assert_allclose([low[0], high[0]], spread)


@settings(deadline=None)
@given(st.lists(numbers, min_size=2, max_size=40))
def test_mean_interval_is_students(values):
    values = np.array(values)
    mean, low, high = mean_interval(values)
    assert mean == pytest.approx(values.mean(), rel=1e-9, abs=1e-6)
    half = stats.t.ppf(0.975, len(values) - 1) * stats.sem(values)
    assert [mean - low, high - mean] == pytest.approx([half, half], rel=1e-6, abs=1e-6)


@pytest.mark.parametrize("count", [1, 2, 10, 333])
def test_wilson_interval_is_scipys_and_the_root_of_the_score_test(count):
    for kept in {0, 1, count // 3, count - 1, count}:
        share, low, high = wilson_interval(np.repeat([100.0, 0.0], [kept, count - kept]))
        wilson = stats.binomtest(kept, count).proportion_ci(method="wilson")
        expected = [100 * kept / count, 100 * wilson.low, 100 * wilson.high]
        np.testing.assert_allclose([share, low, high], expected, atol=1e-5)
        for end in (low / 100.0, high / 100.0):
            score = (kept / count - end) ** 2 - stats.norm.ppf(0.975) ** 2 * end * (1.0 - end) / count
            assert score == pytest.approx(0.0, abs=1e-6)


def test_wilson_interval_of_several_rows_and_of_none():
    values = np.array([[100.0, 0.0, np.nan], [np.nan, np.nan, np.nan]])
    share, low, high = wilson_interval(values)
    assert share[0] == 50.0
    assert low[0] < 50.0 < high[0]
    assert np.isnan([share[1], low[1], high[1]]).all()


@pytest.mark.parametrize("count", [*range(6, 120), 500, 2001])
def test_median_interval_covers(count):
    """Of any continuous law: the exact coverage of two order statistics is binomial."""
    _, low, high = median_interval(np.arange(count, dtype=float))
    coverage = np.diff(stats.binom.cdf([low, high], count, 0.5))
    assert 0.95 <= coverage < 0.995


@settings(deadline=None)
@given(st.lists(numbers | st.just(np.nan) | st.just(np.inf), min_size=1, max_size=60))
def test_median_interval_is_about_the_median_of_finite_values(values):
    values = np.array(values)
    found = values[np.isfinite(values)]
    median, low, high = median_interval(values)
    if not len(found):
        assert np.isnan([median, low, high]).all()
        return
    assert median == pytest.approx(np.median(found))
    assert low <= median <= high
    assert low in found
    assert high in found


def test_reduction_of_finite_values_without_any():
    values = np.array([[1.0, np.inf, 5.0], [np.nan] * 3])
    np.testing.assert_array_equal(over_finite(values, np.nanmax), [5.0, np.nan])
    assert over_finite(np.zeros((2, 0)), np.nanmean).tolist() == pytest.approx([np.nan] * 2, nan_ok=True)


def test_leg_times_are_those_of_legs_that_were_finished():
    study = make_study(4)
    expected, executed = leg_times(study)
    reached = study["leg_arrived"].values == 1
    assert 0 < reached[2].sum() < np.isfinite(study["leg_t_path"].values[2]).sum(), "the last was not"
    np.testing.assert_array_equal(np.isfinite(executed), reached)
    np.testing.assert_array_equal(executed[reached], study["leg_t_path"].values[reached])
    whole = study["leg_t_expected"].values - study["leg_t_task"].values
    np.testing.assert_array_equal(expected[reached], whole[reached])
    np.testing.assert_allclose(relative_errors(study)[reached], np.abs(executed / expected - 1)[reached])


def test_a_leg_expected_in_no_time_has_no_relative_error():
    study = make_study(1, failed=())
    study["leg_t_expected"][0, 0] = study["leg_t_task"][0, 0]
    errors = relative_errors(study)
    assert np.isnan(errors[0, 0])
    assert np.isfinite(errors[0, 1])


@pytest.mark.parametrize("failed", [(), (2,), (0, 3, 4)])
def test_summary_tells_the_numbers_of_the_study(failed):
    study = make_study(5, failed=failed, first_seed=40)
    summary = strict(summarise(study))
    assert summary["missions"] == 5
    assert summary["on_time"] == 5 - len(failed)
    assert summary["failed_seeds"] == [40 + k for k in failed]
    assert summary["failures"] == ["destination reached too late"] * len(failed)
    assert summary["collisions"] == summary["faults"] == 0
    share = summary["on_time_percent"]
    wilson = stats.binomtest(5 - len(failed), 5).proportion_ci(method="wilson")
    assert share["share"] == pytest.approx(20.0 * (5 - len(failed)))
    assert [share["low"], share["high"]] == pytest.approx([100 * wilson.low, 100 * wilson.high], abs=1e-4)
    expected, executed = (times[np.isfinite(times)] for times in leg_times(study))
    legs = summary["expected_against_executed"]
    assert legs["legs"] == len(expected)
    assert legs["correlation"] == pytest.approx(np.corrcoef(expected, executed)[0, 1])
    alike = study.assign(leg_t_expected=study["leg_t_task"] + 100.0)
    assert strict(summarise(alike))["expected_against_executed"]["correlation"] is None
    errors = 100 * np.abs(executed / expected - 1)
    assert legs["median_relative_error_percent"] == pytest.approx(np.median(errors))
    assert legs["low"] < np.median(errors) < legs["high"]


def test_figures_of_a_summary_are_the_means_and_quantiles_of_missions_legs_and_calls():
    study = make_study(30)
    figures = strict(summarise(study))["figures"]
    expected, executed = leg_times(study)
    values = {
        "use_of_time_percent": use_of_time(study),
        "t_residual_s": study["t_residual"].values,
        "total_priority": study["total_priority"].values,
        "priority_bound": 1.0 + 1.25 * study["total_priority"].values,
        "priority_gap_percent": 100.0
        * (1.0 - study["total_priority"].values / (1.0 + 1.25 * study["total_priority"].values)),
        "mission_replans": study["mission_replans"].values,
        "cost_mission": study["cost_mission"].values,
        "cost_total": study["cost_total"].values,
        "path_cpu_s": study["path_cpu"].values,
        "mission_cpu_s": study["mission_cpu"].values,
        "mission_replan_cpu_s": study["mission_replan_cpu"].values,
        "t_expected_s": expected,
        "t_path_s": executed,
        "path_call_cpu_s": study["plan_cpu"].values,
        "mission_call_cpu_s": study["route_cpu"].values,
        "obstacle_clearance_m": study["obstacle_clearance"].values,
        "seabed_altitude_m": study["seabed_altitude"].values,
    }
    for name, found in values.items():
        found, figure = found[np.isfinite(found)], figures[name]
        low, high = stats.t.interval(0.95, len(found) - 1, found.mean(), stats.sem(found))
        quantiles = np.quantile(found, [0, 0.05, 0.25, 0.5, 0.75, 0.95, 1])
        assert list(figure.values()) == pytest.approx(
            [found.mean(), low, high, found.std(ddof=1), *quantiles]
        ), name
    assert figures["coast_clearance_m"] == {}, "there is no coast"
    used = study["t_mission"].values / AVAILABLE
    assert figures["use_of_time_percent"]["mean"] == pytest.approx(100 * used.mean())


def test_one_mission_has_no_interval():
    figure = strict(summarise(make_study(1)))["figures"]["total_priority"]
    assert figure["mean"] == figure["median"] == figure["most"]
    assert figure["low"] is figure["high"] is figure["std"] is None


def test_collisions_and_faults_are_added_up():
    study = make_study(4)
    study["collisions"][1], study["faults"][1], study["faults"][3] = 3, 1, 2
    summary = summarise(study)
    assert (summary["collisions"], summary["faults"]) == (3, 3)


def test_a_sweep_is_summarised_case_by_case():
    study = make_study(3, OBJECTIVES | RATES)
    summary = strict(summarise(study))
    assert sweep_dims(study) == ["planning_objective", "current_update_rate"]
    assert summary["sweep"] == [*OBJECTIVES, *RATES]
    settings = [case.pop("setting") for case in summary["cases"]]
    differences = [case.pop("differences_to_first")["total_priority"] for case in summary["cases"]]
    priority = study["total_priority"].values.reshape(6, -1)
    for difference, change in zip(differences, priority - priority[0], strict=True):
        assert difference["mean"] == pytest.approx(change.mean())
        assert difference["low"] <= difference["mean"] <= difference["high"]
    assert [list(setting.values()) for setting in settings] == [
        [objective, rate] for objective in ("priority", "eq15") for rate in (0.0, 0.1, 0.2)
    ]
    assert all(list(setting) == summary["sweep"] for setting in settings)
    for case, index in zip(summary["cases"], np.ndindex(2, 3), strict=True):
        one = study.isel(planning_objective=index[0], current_update_rate=index[1])
        assert case == strict(summarise(one.assign_attrs(sweep="")))


def test_numbers_stay_numbers_beside_words_in_the_settings_of_cases():
    """In memory words are objects, out of a file they are text."""
    study = make_study(2, OBJECTIVES | RATES)
    words = study["planning_objective"].astype(object).assign_attrs(study["planning_objective"].attrs)
    cases = strict(summarise(study.assign_coords(planning_objective=words)))["cases"]
    assert cases[1]["setting"] == {"planning.objective": "priority", "current.update_rate": 0.1}


@pytest.mark.parametrize(
    "study",
    [make_study(1, failed=()), make_study(1, failed=(0,)), without_legs(make_study(3)), make_study(1, RATES)],
    ids=["one", "one failed", "no legs", "one of each value"],
)
def test_studies_with_little_in_them_are_summarised(study):
    summary = strict(summarise(study))
    for case in summary.get("cases", [summary]):
        for figure in case["figures"].values():
            assert not figure or figure["least"] <= figure["median"] <= figure["most"]
