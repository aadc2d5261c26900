"""Predicted against measured energy of real vehicles: ``python -m benchmarks.energy [--folder data/energy]``.

The 62 JaiaBot missions: what their plans and three constants, fitted on other days, say of the drain of the
battery; and what two Slocum gliders' dives took and how far off they surfaced. See `docs/energy.md`.
"""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from auvplan.errors import AuvplanError
from benchmarks.harness import launch, markdown, screen

Array = NDArray[np.floating]

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "energy"
#: Wh in a percent of the JaiaBot's battery.
PERCENT = 1.32
#: Factors on planned transit and dive energy, and J per rad of planned turns.
CONSTANTS = ("transit factor", "dive factor", "J per rad of turns")
#: Dives of this length, s, tell of a glider's usual use.
LONG_DIVE = 3000.0


def read(file: Path) -> list[dict[str, str]]:
    """Rows of a CSV file.

    Raises:
        AuvplanError: there is none.
    """
    if not file.is_file():
        raise AuvplanError(f"{file}: no such file: the data are not part of the repository")
    return list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))


def columns(rows: Sequence[dict[str, str]], *names: str) -> Array:
    """Numbers of some columns, [len(names), rows]."""
    return np.array([[float(row[name]) for row in rows] for name in names])


class Missions:
    """The JaiaBot missions: terms [N, 3] in percent of the battery, drain [N] and day of each."""

    def __init__(self, rows: Sequence[dict[str, str]]) -> None:
        transit, dive, hold, density, distance, self.drain, self.sum = columns(
            rows, "planned_transit_energy_Wh", "planned_dive_energy_Wh", "planned_hold_energy_Wh",
            "turn_density_deg_per_km", "planned_distance_m", "measured_drain_pct", "predicted_sum_pct",
        )  # fmt: skip
        turns = np.radians(density) * distance / 1000.0
        # The last column is 1 J a rad in percent.
        self.terms = np.stack([transit / PERCENT, dive / PERCENT, turns / 3600.0 / PERCENT], axis=1)
        self.hold = hold / PERCENT
        self.days = np.array([f"{row['fleet']} {row['date']}" for row in rows])

    def fitted(self, chosen: Any, terms: Sequence[int]) -> Array:
        """Constants of some terms by least squares on the chosen missions, [len(terms)]."""
        return np.linalg.lstsq(self.terms[chosen][:, terms], self.drain[chosen], rcond=None)[0]

    def left_out(self, groups: Array, terms: Sequence[int]) -> Array:
        """Predictions, [N] percent, of each group by constants that were fitted on the others."""
        found = np.empty(len(self.drain))
        for group in np.unique(groups):
            inside = groups == group
            found[inside] = self.terms[inside][:, terms] @ self.fitted(~inside, terms)
        return found

    def scores(self, predicted: Array) -> dict[str, float]:
        """Bias, MAE and RMSE, points."""
        error = predicted - self.drain
        return {
            "bias": float(error.mean()),
            "mae": float(np.abs(error).mean()),
            "rmse": float(np.sqrt((error**2).mean())),
        }

    def rows(self) -> list[dict[str, Any]]:
        """Scores of each way to predict."""
        single = np.arange(len(self.drain)).astype(str)
        days = np.array([np.mean(self.drain[self.days != day]) for day in self.days])
        ways = {
            "plain sum of the plan's terms": self.sum,
            "mean of the other days": days,
            "transit and dive, a fleet-day left out": self.left_out(self.days, [0, 1]),
            "transit, dive and turns, a mission left out": self.left_out(single, [0, 1, 2]),
            "transit, dive and turns, a fleet-day left out": self.left_out(self.days, [0, 1, 2]),
        }
        return [{"prediction": name} | self.scores(predicted) for name, predicted in ways.items()]

    def constants(self) -> dict[str, tuple[float, float, float]]:
        """Each constant by all missions, and its least and greatest where a fleet-day is left out."""
        terms = [0, 1, 2]
        days = [self.fitted(self.days != day, terms) for day in np.unique(self.days)]
        whole, low, high = self.fitted(slice(None), terms), np.min(days, axis=0), np.max(days, axis=0)
        return {name: (float(whole[k]), float(low[k]), float(high[k])) for k, name in enumerate(CONSTANTS)}


def gliders(rows: Iterable[dict[str, str]]) -> list[dict[str, Any]]:
    """Power, energy, and growth of the position error of each glider's long dives, but for an unsure one."""
    found = []
    rows = [row for row in rows if float(row["submerged_s"]) > LONG_DIVE]
    rows = [row for row in rows if float(row["check_residual_m"]) < 200.0]
    for glider in dict.fromkeys(row["glider"] for row in rows):
        own = [row for row in rows if row["glider"] == glider]
        seconds, watts, wh, path, error, profiles = columns(
            own, "submerged_s", "mean_power_W", "energy_Wh", "dr_path_m", "dr_error_m", "n_profiles"
        )
        found.append({
            "glider": glider, "dives": len(own),
            "power_w": float(np.median(watts)),
            "wh_a_dive": float(np.median(wh / profiles)),
            "wh_per_km": float(np.median(wh / path * 1000.0)),
            "error_m": float(np.median(error)),
            "error_m_per_s": float(np.median(error / seconds)),
            "error_m_per_s_90": float(np.quantile(error / seconds, 0.9)),
            "error_share": float(np.median(error / path)),
        })  # fmt: skip
    return found


def pumps(rows: Sequence[dict[str, str]]) -> list[dict[str, Any]]:
    """Return what each glider draws all the time, and J of its pump a dive, by least squares over stretches.

    Beside them are the least and the greatest with a stretch left out, the mean error of predicting a stretch
    by the others, and that of predicting it by their mean power.
    """
    found = []
    for glider in dict.fromkeys(row["glider"] for row in rows):
        own = [row for row in rows if row["glider"] == glider]
        seconds, dives, wh = columns(own, "submerged_s", "n_profiles", "energy_Wh")
        terms, joules, each = np.stack([seconds, dives], axis=1), 3600.0 * wh, np.arange(len(own))
        whole = np.linalg.lstsq(terms, joules, rcond=None)[0]
        without = np.array([
            np.linalg.lstsq(terms[each != k], joules[each != k], rcond=None)[0] for k in each
        ])  # fmt: skip
        mean = np.array([joules[each != k].sum() / seconds[each != k].sum() for k in each])
        found.append({
            "glider": glider, "stretches": len(own), "hotel_w": float(whole[0]), "pump_j": float(whole[1]),
            "hotel_range": (float(without[:, 0].min()), float(without[:, 0].max())),
            "pump_range": (float(without[:, 1].min()), float(without[:, 1].max())),
            "error": float(np.abs((terms * without).sum(axis=1) / joules - 1.0).mean()),
            "error_by_mean": float(np.abs(seconds * mean / joules - 1.0).mean()),
            "mean_wh": float(wh.sum() / dives.sum()),
        })  # fmt: skip
    return found


def draw(missions: Missions, file: Path) -> None:
    """Draw predictions against what was measured."""
    from auvplan.plot import style

    axes = style.own_axes(None, 5.2, 4.8)
    predicted = missions.left_out(missions.days, [0, 1, 2])
    axes.plot(
        missions.drain, missions.sum, "x", color=style.GREY, ms=5, label="plain sum of the plan's terms"
    )
    axes.plot(missions.drain, predicted, "o", color=style.BLUE, ms=4, label="three constants of other days")
    most = 1.05 * max(missions.drain.max(), missions.sum.max())
    axes.plot([0.0, most], [0.0, most], color=style.BLACK, lw=0.8)
    axes.set(
        xlabel="measured drain [% of the battery]", ylabel="predicted [%]", xlim=(0, most), ylim=(0, most)
    )
    style.grid(axes)
    axes.legend(fontsize=8)
    style.save(axes, file)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table as the documentation has it."""
    print(*markdown(heads, rows), "", sep="\n")


def main(folder: str, picture: str) -> dict[str, Any]:
    place = Path(folder)
    missions = Missions(read(place / "jaiabot_missions.csv"))
    scores, constants = missions.rows(), missions.constants()
    days = len(np.unique(missions.days))
    screen.print(f"{len(missions.drain)} JaiaBot missions on {days} fleet-days, points of charge")
    rows = [
        [row["prediction"], f"{row['bias']:+.1f}", f"{row['mae']:.2f}", f"{row['rmse']:.2f}"]
        for row in scores
    ]
    table(["prediction", "bias", "MAE", "RMSE"], rows)
    fitted = [[name, *(f"{value:.3g}" for value in values)] for name, values in constants.items()]
    table(["constant", "all missions", "least", "greatest, a fleet-day left out"], fitted)
    dived = gliders(read(place / "slocum.csv"))
    table(
        ["glider", "dives", "W", "Wh a dive", "Wh/km", "error, m", "m/s", "90 %", "share of the track"],
        [[
            row["glider"], str(row["dives"]), f"{row['power_w']:.1f}", f"{row['wh_a_dive']:.2f}",
            f"{row['wh_per_km']:.1f}", f"{row['error_m']:.0f}", f"{row['error_m_per_s']:.3f}",
            f"{row['error_m_per_s_90']:.3f}", f"{row['error_share']:.0%}",
        ] for row in dived],
    )  # fmt: skip
    pumped = pumps(read(place / "slocum.csv"))
    table(
        ["glider", "stretches", "W but for the pump", "one left out", "J a dive", "one left out",
         "error", "error by mean power"],
        [[
            row["glider"], str(row["stretches"]), f"{row['hotel_w']:.2f}",
            "{:.2f}-{:.2f}".format(*row["hotel_range"]), f"{row['pump_j']:,.0f}",
            "{:,.0f}-{:,.0f}".format(*row["pump_range"]), f"{row['error']:.0%}",
            f"{row['error_by_mean']:.0%}",
        ] for row in pumped],
    )  # fmt: skip
    if picture:
        draw(missions, Path(picture))
    return {"scores": scores, "constants": constants, "gliders": dived, "pumps": pumped}


if __name__ == "__main__":
    launch(
        main,
        folder=(str(FOLDER), "of the data"),
        picture=("", "file to draw predictions against measurements in"),
    )
