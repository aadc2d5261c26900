"""The 62 JaiaBot missions and the gliders, where the data are."""

import numpy as np
import pytest

from benchmarks.energy import Missions, fitted_growth, gliders, growth, main, pumps, read, submerged


@pytest.fixture
def data(shared):
    """Folder of the data."""
    folder = shared / "data" / "energy"
    if not folder.is_dir():
        pytest.skip(f"needs real data in {folder}")
    return folder


def test_three_constants_predict_the_drain_of_other_days(data):
    missions = Missions(read(data / "jaiabot_missions.csv"))
    assert len(missions.drain) == 62
    scores = {row["prediction"]: row for row in missions.rows()}
    assert scores["plain sum of the plan's terms"]["mae"] == pytest.approx(6.4, abs=0.05)
    assert scores["transit and dive, a fleet-day left out"]["mae"] == pytest.approx(5.6, abs=0.05)
    assert scores["transit, dive and turns, a fleet-day left out"]["mae"] <= 5.0
    assert all(least <= whole <= greatest for whole, least, greatest in missions.constants().values())


def test_gliders_take_what_is_stated(data):
    maria, rosie = gliders(read(data / "slocum.csv"))
    assert (maria["dives"], rosie["dives"]) == (13, 5)
    assert maria["power_w"] == pytest.approx(3.0, abs=0.05)
    assert maria["error_m_per_s"] == pytest.approx(0.021, abs=0.001)
    assert maria["wh_per_km"] == pytest.approx(3.7, abs=0.1)


def test_two_gliders_have_one_pump(data):
    maria, rosie = pumps(read(data / "slocum.csv"))
    assert maria["pump_j"] == pytest.approx(4850, abs=20)
    assert rosie["pump_j"] == pytest.approx(4780, abs=20)
    assert maria["pump_range"][0] < rosie["pump_j"] < maria["pump_range"][1]
    assert maria["error"] < maria["error_by_mean"]


def test_the_benchmark_draws_and_returns_its_figures(data, tmp_path):
    found = main(str(data), str(tmp_path / "energy.png"))
    assert (tmp_path / "energy.png").stat().st_size > 1000
    assert set(found) == {"scores", "constants", "gliders", "pumps", "growth"}


def test_data_that_are_not_there_are_named(tmp_path):
    with pytest.raises(ValueError, match=r"jaiabot_missions\.csv: no such file"):
        main(str(tmp_path), "")


def test_growth_of_drawn_errors_is_found_again():
    rng = np.random.default_rng(1)
    seconds = rng.uniform(300.0, 12_000.0, 4000)
    error = rng.normal(size=(4000, 2)) * np.hypot(15.0, 0.03 * seconds)[:, None]
    fix, rate, exponent = fitted_growth(seconds, (error**2).sum(axis=1), (None, None, None))
    assert (fix, rate, exponent) == (
        pytest.approx(15.0, rel=0.2), pytest.approx(0.03, rel=0.03), pytest.approx(1.0, abs=0.03)
    )  # fmt: skip


def test_errors_of_the_gliders_grow_as_the_model_has_it(data):
    unsure = read(data / "slocum.csv").query("check_residual_m >= 200").dive_start_utc.tolist()
    dives = submerged(read(data / "slocum_positions.csv"), unsure)
    (maria, rosie) = growth(dives, draws=60)
    assert (maria["dives"], rosie["dives"]) == (31, 5)
    low, high = maria["exponent_range"]
    assert low < 1.0 < high
    assert maria["rate_range"][0] < 0.018 < maria["rate_range"][1] < rosie["rate"]
    assert 0.7 < maria["within"] <= 1.0
