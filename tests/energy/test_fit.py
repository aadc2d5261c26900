"""Fits of propulsion power, of made-up laws and of real tables; the command."""

import csv
import json

import numpy as np
import pytest

from auvplan.energy import fit_power
from auvplan.errors import AuvplanError
from auvplan.scenario.power import PowerSettings
from auvplan.scenario.vehicles import load_vehicle, power_model, shipped_vehicles


@pytest.mark.parametrize("exponent", [1.6, 2.4, 3.0, 3.7])
def test_a_law_is_found_again(exponent):
    speeds = np.linspace(0.4, 2.0, 9)
    fit = fit_power(speeds, 8.0 + 13.0 * speeds**exponent)
    found = [float(getattr(fit.law, name)) for name in ("constant", "factor", "exponent")]
    np.testing.assert_allclose(found, [8.0, 13.0, exponent], rtol=1e-3)
    assert fit.worst < 1e-2


def test_coefficients_are_bounded_and_standstill_is_left_out():
    fit = fit_power([0.0, 0.5, 1.0, 2.0], [3.0, 0.2, 3.0, 30.0], exponent=3.0)
    assert float(fit.law.constant) == 0.0, "never negative"
    assert len(fit.speeds) == 3
    assert "in 3 points, 2 coefficients: they say little" in fit.line
    assert 1.0 <= float(fit_power([0.5, 1.0, 2.0, 3.0], [1.0, 1.0, 1.0, 300.0]).law.exponent) <= 4.5


@pytest.mark.parametrize(
    ("speeds", "exponent", "words"),
    [
        ([1.0, 1.0], 3.0, "2 coefficients need"),
        ([1.0, 2.0], None, "3 coefficients need"),
        ([1.0, np.nan], 3.0, "numb"),
    ],
)
def test_what_cannot_be_fitted_is_said_in_a_line(speeds, exponent, words):
    with pytest.raises(AuvplanError, match=words):
        fit_power(speeds, [10.0, 20.0], exponent)


def test_cubic_fits_of_real_tables_are_those_published_with_them(shared):
    folder = shared / "data" / "energy"
    if not folder.is_dir():
        pytest.skip(f"needs {folder}")
    rows = list(csv.DictReader((folder / "propulsion.csv").read_text().splitlines()))
    for stated in csv.DictReader((folder / "propulsion_fits.csv").read_text().splitlines()):
        own = [r for r in rows if r["vehicle"] == stated["vehicle"] and r["power_origin"] == "table"]
        fit = fit_power([float(r["speed_m_s"]) for r in own], [float(r["power_W"]) for r in own], 3.0)
        assert float(fit.law.constant) == pytest.approx(float(stated["h_W"]), abs=0.02)
        assert float(fit.law.factor) == pytest.approx(float(stated["k_W_per_m3_s3"]), abs=0.02)
        assert fit.rms == pytest.approx(float(stated["rms_residual_W"]), abs=0.01)
        assert fit.worst == pytest.approx(float(stated["max_residual_W"]), abs=0.01)


@pytest.mark.parametrize(
    "head", ["speed_m_s,power_W", "Speed [m/s],Power [W]", "v (kn),P kW", "velocity_km_h,power_total_w"]
)
def test_the_command_fits_a_table_and_writes_a_vehicle(tmp_path, call, head):
    speeds, factors = np.array([0.5, 1.0, 1.5, 2.0]), (1.0, 1.0)
    if "kn" in head:
        factors = 1852.0 / 3600.0, 1000.0
    if "km_h" in head:
        factors = 1.0 / 3.6, 1.0
    rows = [f"{v / factors[0]:.9g},{(10.0 + 15.0 * v**3) / factors[1]:.9g}" for v in speeds]
    table = tmp_path / "table.csv"
    table.write_text("\n".join([head, *rows]) + "\n")
    code, out, err = call("vehicle", "fit", table, "--out", tmp_path / "out", "--hotel", 30, "--exponent", 3)
    assert (code, err) == (0, "")
    assert out.startswith("10 + 15 v^3 W; residuals ")
    assert (tmp_path / "out" / "power.png").stat().st_size > 1000
    vehicle = tmp_path / "out" / "vehicle.yaml"
    model = power_model(PowerSettings(vehicle=str(vehicle)))
    assert float(model.power(1.2)) == pytest.approx(40.0 + 15.0 * 1.2**3, rel=1e-4)
    code, out, _ = call("vehicle", "show", vehicle, "--json")
    assert json.loads(out)["best_speed"] == pytest.approx((40.0 / 30.0) ** (1 / 3), rel=1e-3)


@pytest.mark.parametrize(
    ("text", "options", "words"),
    [
        (
            "speed_m_s,watts\n1,2\n",
            (),
            "table.csv: has no column of power such as power_w, but speed_m_s, watts",
        ),
        ("speed,power_W\n1,2\n", (), "column 'speed' has no unit in its name: speed_m_s, say"),
        (
            "speed_m_s,power_W\n1,x\n",
            (),
            "table.csv: line 2: power_W must be a number of at least 0, got 'x'",
        ),
        (
            "speed_m_s,power_W\n1,2\n",
            (),
            "table.csv: 3 coefficients need as many speeds above zero, got 1 speed",
        ),
        ("vehicle,speed_m_s,power_W\na,1,2\nb,1,2\n", (), "name one by --only vehicle=NAME"),
        ("vehicle,speed_m_s,power_W\na,1,2\n", ("--only", "vehicle=c"), "vehicle is nowhere 'c': it is a"),
        ("speed_m_s,power_W\n1,2\n", ("--only", "vehicle"), "give it as COLUMN=VALUE"),
        ("", (), "has no rows below a line of names"),
    ],
)
def test_a_bad_table_is_one_line(tmp_path, refused, text, options, words):
    (tmp_path / "table.csv").write_text(text)
    assert words in refused("vehicle", "fit", tmp_path / "table.csv", "--out", tmp_path / "out", *options)


def test_shipped_vehicles_are_listed_and_shown(call):
    code, out, _ = call("vehicle", "list")
    assert code == 0
    assert all(name[:12] in out for name in shipped_vehicles())
    assert all("at " in load_vehicle(name).source for name in shipped_vehicles()), "whose commit is named"
    for name in ("jaiabot", "lauv-xplore-1"):
        code, out, _ = call("vehicle", "show", name, "--json")
        least, most = load_vehicle(name).speeds
        assert least - 1e-6 <= json.loads(out)["best_speed"] <= most + 1e-6
    code, out, _ = call("vehicle", "show", "lauv-xplore-1")
    assert "best speed in bold" in out


def test_an_unknown_vehicle_is_one_line(refused):
    assert "'lauv' is no shipped vehicle: jaiabot, " in refused("vehicle", "show", "lauv")
    assert "nowhere.yaml: No such file" in refused("vehicle", "show", "nowhere.yaml")
