"""Every constant of sections 2 and 4 of the paper, read from the objects that its preset uses."""

import numpy as np
import pytest

import auvplan as ap
from auvplan import MissionConfig, PathConfig
from auvplan.executive import mission_configs, path_config
from auvplan.mission.decoder import HIGHEST, LOWEST
from auvplan.ocean.classify import UNCERTAIN_MAX
from auvplan.ocean.whitsunday import EXTENT, PIXELS, whitsunday_chart
from auvplan.simulation.world import make_vehicle
from benchmarks.paper.legs import SCENARIOS, changed
from benchmarks.paper.reproduce import Effort


@pytest.fixture(scope="module")
def missions():
    return changed("whitsunday", "paper")


@pytest.mark.parametrize("name", [*SCENARIOS, "whitsunday"])
def test_the_path_search_is_that_of_section_4_1(name):
    config = path_config(changed(name, "paper"))
    assert config == PathConfig.paper().replace(t_series=config.t_series)
    bbo = config.bbo
    assert (bbo.population, bbo.iterations, bbo.elites) == (100, 100, 1)
    immigration, emigration = bbo.migration_rates()
    np.testing.assert_allclose(emigration, np.linspace(1.0, 0.0, 100))
    np.testing.assert_allclose(immigration, 1.0 - emigration)
    # Fig. 11: m(S) is a habitat's probability to mutate, in one of its SIVs on average.
    per_habitat = bbo.mutation_rate(3 * config.control_points) * 3 * config.control_points
    assert per_habitat.max() == pytest.approx(0.1)
    assert (config.passages, config.refine_steps, config.fresh_share) == (0, 0, 0.0)


def test_paths_are_read_with_four_control_points_and_tasks_in_t_ij_alone(missions):
    """What the paper leaves open, as docs/paper.md states it."""
    config, rules = path_config(missions), missions.planning.resolved
    assert (config.control_points, config.width, config.samples) == (4, 0.35, 160)
    assert config == PathConfig.paper(control_points=4, width=0.35)
    assert (rules.task_time, rules.phi) == ("expected", (1.0, 100.0))
    assert missions.tasks_under_way


def test_there_is_no_limit_in_the_vertical(missions):
    vehicle = make_vehicle(missions)
    assert (vehicle.pitch_max, vehicle.climb_rate_max, vehicle.dive_rate_max) == (None, None, None)
    assert make_vehicle(changed("whitsunday", "default")).pitch_max == ap.Vehicle().pitch_max


def test_the_mission_search_is_that_of_section_4_2(missions):
    first, later = mission_configs(missions)
    assert first == later == MissionConfig.paper()
    assert (first.bbo.population, first.bbo.iterations, first.bbo.migration) == (150, 200, "fig6")
    immigration, emigration = first.bbo.migration_rates()
    np.testing.assert_allclose(emigration, 0.2)
    np.testing.assert_allclose(immigration, 0.8)
    waypoints = missions.mission.waypoints
    assert (first.bbo.mutation_rate(waypoints) * waypoints).max() == pytest.approx(0.5)
    assert (first.decoder, first.objective) == ("paper", "eq15")
    assert (LOWEST, HIGHEST) == (-200, 100)
    # A hundred missions of 40 waypoints in 14,400 s.
    assert (waypoints, missions.mission.time_available, Effort().missions) == (40, 14_400.0, 100)


def test_iterations_are_divided_by_t_series_of_3_and_4():
    scenarios = [changed(name, "paper") for name in SCENARIOS]
    assert [scenario.planning.t_series for scenario in scenarios] == [3, 4, 4]
    assert [path_config(scenario).window().bbo.iterations for scenario in scenarios] == [33, 25, 25]


def test_rules_of_sections_3_3_1_and_3_3_2(missions):
    rules = missions.planning.resolved
    assert (rules.replan, rules.travel_times, rules.visits) == ("late", "distance", "edges")
    assert rules.reserve == rules.return_margin == 0.0
    # The current is updated at windows.
    assert (rules.current_updates, rules.window_change, rules.replan_from) == ("window", 0.0, "kept")


def test_the_large_map_is_10_kilometres_wide_and_1000_metres_deep(missions):
    assert whitsunday_chart().shape == (1000, 1000) == (PIXELS, PIXELS)
    assert missions.area.lower == (0.0, 0.0, 0.0)
    assert missions.area.upper == (10_000.0, 10_000.0, 1000.0)
    assert EXTENT / PIXELS == missions.chart.pixel_size == 10.0


def test_the_local_map_is_350_pixels_of_10_metres_wide():
    chart = ap.load_area(changed("scenario-3", "paper")).chart
    assert chart is not None
    assert chart.shape == (350, 350)
    np.testing.assert_allclose(np.asarray(chart.upper) - np.asarray(chart.lower), 3500.0)
    assert {changed(name, "paper").area.upper[:2] for name in SCENARIOS} == {(3500.0, 3500.0)}


def test_coast_is_0_uncertain_area_up_to_035_and_water_1():
    raster = np.asarray(whitsunday_chart().passability)
    between = raster[(raster > 0.0) & (raster < 1.0)]
    assert (raster.min(), raster.max()) == (0.0, 1.0)
    assert between.size > 0
    assert between.max() <= UNCERTAIN_MAX == 0.35
