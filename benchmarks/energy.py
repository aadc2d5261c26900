"""Predicted against measured energy of real vehicles: ``python -m benchmarks.energy [--folder data/energy]``.

The 62 JaiaBot missions: what their plans and three constants, fitted on other days, say of the drain of the
battery; and what two Slocum gliders' dives took and how far off they surfaced. See `docs/energy.md`.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import scipy.optimize

from auvplan.errors import AuvplanError
from benchmarks.harness import SHARED, Array, launch, screen, show_markdown

#: Wh in a percent of the JaiaBot's battery.
PERCENT = 1.32
#: Factors on planned transit and dive energy, and J per rad of planned turns.
CONSTANTS = ("transit factor", "dive factor", "J per rad of turns")
#: s and m, stretches under water that last and go deep enough to tell of a position's error.
SHORTEST, UNDER_WATER = 240.0, 5.0
#: s, at which rates of growth are stated.
HOUR = 3600.0
#: Dives of this length, s, tell of a glider's usual use.
LONG_DIVE = 3000.0


def read(file: Path) -> pd.DataFrame:
    """Read a CSV file.

    Raises:
        AuvplanError: there is none.
    """
    if not file.is_file():
        raise AuvplanError(f"{file}: no such file: the data are not part of the repository")
    return pd.read_csv(file)


class Missions:
    """The JaiaBot missions: terms [N, 3] and drain [N] in percent of the battery, and day of each."""

    def __init__(self, table: pd.DataFrame) -> None:
        turns = np.radians(table.turn_density_deg_per_km) * table.planned_distance_m / 1000.0
        # The last column is 1 J a rad in percent.
        terms = table.planned_transit_energy_Wh, table.planned_dive_energy_Wh, turns / 3600.0
        self.terms = np.stack(terms, axis=1) / PERCENT
        self.drain, self.sum = (
            table[name].to_numpy() for name in ("measured_drain_pct", "predicted_sum_pct")
        )
        self.days = (table.fleet.astype(str) + " " + table.date.astype(str)).to_numpy(str)

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

    def rows(self) -> list[dict[str, Any]]:
        """Bias, MAE and RMSE of each way to predict, points."""
        single = np.arange(len(self.drain)).astype(str)
        days = np.array([np.mean(self.drain[self.days != day]) for day in self.days])
        ways = {
            "plain sum of the plan's terms": self.sum,
            "mean of the other days": days,
            "transit and dive, a fleet-day left out": self.left_out(self.days, [0, 1]),
            "transit, dive and turns, a mission left out": self.left_out(single, [0, 1, 2]),
            "transit, dive and turns, a fleet-day left out": self.left_out(self.days, [0, 1, 2]),
        }
        errors = {name: predicted - self.drain for name, predicted in ways.items()}
        return [
            {"prediction": name, "bias": float(error.mean()), "mae": float(np.abs(error).mean()),
             "rmse": float(np.sqrt((error**2).mean()))}
            for name, error in errors.items()
        ]  # fmt: skip

    def constants(self) -> dict[str, tuple[float, float, float]]:
        """Each constant by all missions, and its least and greatest where a fleet-day is left out."""
        terms = [0, 1, 2]
        days = [self.fitted(self.days != day, terms) for day in np.unique(self.days)]
        found = self.fitted(slice(None), terms), np.min(days, axis=0), np.max(days, axis=0)
        return dict(zip(CONSTANTS, zip(*map(np.ndarray.tolist, found), strict=True), strict=True))


def gliders(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Power, energy, and growth of the position error of each glider's long dives, but for an unsure one."""
    found = []
    table = table[(table.submerged_s > LONG_DIVE) & (table.check_residual_m < 200.0)]
    for glider, own in table.groupby("glider", sort=False):
        drift = own.dr_error_m / own.submerged_s
        medians = {
            "power_w": own.mean_power_W, "wh_a_dive": own.energy_Wh / own.n_profiles,
            "wh_per_km": own.energy_Wh / own.dr_path_m * 1000.0, "error_m": own.dr_error_m,
            "error_m_per_s": drift, "error_share": own.dr_error_m / own.dr_path_m,
        }  # fmt: skip
        row = {name: float(values.median()) for name, values in medians.items()}
        row |= {"error_m_per_s_90": float(drift.quantile(0.9))}
        found.append({"glider": glider, "dives": len(own)} | row)
    return found


def pumps(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Return what each glider draws all the time, and J of its pump a dive, by least squares over stretches.

    Beside them are the least and the greatest with a stretch left out, the mean error of predicting a stretch
    by the others, and that of predicting it by their mean power.
    """
    found = []
    for glider, own in table.groupby("glider", sort=False):
        terms, wh = own[["submerged_s", "n_profiles"]].to_numpy(float), own.energy_Wh.to_numpy()
        joules, others = 3600.0 * wh, ~np.eye(len(own), dtype=bool)

        def fitted(chosen: Any, terms: Array = terms, joules: Array = joules) -> Array:
            return np.linalg.lstsq(terms[chosen], joules[chosen], rcond=None)[0]

        whole, without = fitted(slice(None)), np.array([fitted(chosen) for chosen in others])
        mean = np.array([joules[chosen].sum() / terms[chosen, 0].sum() for chosen in others])
        found.append({
            "glider": glider, "stretches": len(own), "hotel_w": float(whole[0]), "pump_j": float(whole[1]),
            "hotel_range": (float(without[:, 0].min()), float(without[:, 0].max())),
            "pump_range": (float(without[:, 1].min()), float(without[:, 1].max())),
            "error": float(np.abs((terms * without).sum(axis=1) / joules - 1.0).mean()),
            "error_by_mean": float(np.abs(terms[:, 0] * mean / joules - 1.0).mean()),
        })  # fmt: skip
    return found


def submerged(positions: pd.DataFrame, unsure: Sequence[str]) -> pd.DataFrame:
    """Glider, s from fix to fix and error of dead reckoning, m east and north, of each stretch under water.

    The error is the fix at its end less the last dead-reckoned position, carried on with its last velocity.

    Args:
        positions: fixes and dead-reckoned positions by time.
        unsure: moments, UTC, at which stretches begin that are to be left out.
    """
    rows = []
    for glider, own in positions.groupby("glider", sort=False):
        fixes, reckoned = (own[own.kind == kind] for kind in ("gps", "dead_reckoned"))
        metres = np.radians(6_371_000.0) * np.array([np.cos(np.radians(own.lat.mean())), 1.0])
        for before, after in zip(fixes.index[:-1], fixes.index[1:], strict=True):
            t0, t1 = own.elapsed_s[before], own.elapsed_s[after]
            began = pd.Timestamp(own.time_utc[before])
            part = reckoned[(reckoned.elapsed_s > t0) & (reckoned.elapsed_s < t1)]
            out = any(abs(began - pd.Timestamp(moment)) < pd.Timedelta(60.0, "s") for moment in unsure)
            if out or t1 - t0 < SHORTEST or len(part) < 3 or part.depth_m.max() < UNDER_WATER:
                continue
            last = part.iloc[-2:]
            places, rate = last[["lon", "lat"]].to_numpy(float), np.diff(last.elapsed_s)
            reached = places[1] + (places[1] - places[0]) / rate * (t1 - last.elapsed_s.iloc[1])
            error = (own.loc[after, ["lon", "lat"]].to_numpy(float) - reached) * metres
            rows.append((glider, t1 - t0, *error))
    return pd.DataFrame(rows, columns=["glider", "seconds", "east", "north"])


def fitted_growth(seconds: Array, square: Array, fixed: Sequence[float | None]) -> Array:
    """Fix, m, m/s at `HOUR` and exponent of growth of greatest likelihood.

    Errors along both axes are normal, of variance fix^2 + (rate HOUR (t / HOUR)^exponent)^2.

    Args:
        seconds: [n] s since the fix.
        square: [n] m2, of the errors.
        fixed: the three, None for those that are fitted.
    """
    free = [k for k, value in enumerate(fixed) if value is None]

    def whole(logs: Array) -> Array:
        found = np.array([np.nan if value is None else value for value in fixed])
        found[free] = np.exp(logs)
        return found

    def unlikely(logs: Array) -> float:
        fix, rate, exponent = whole(logs)
        variance = fix**2 + (rate * HOUR * (seconds / HOUR) ** exponent) ** 2
        return float((np.log(variance) + 0.5 * square / variance).sum())

    start = np.log(np.array([10.0, 0.03, 1.0])[free])
    return whole(scipy.optimize.minimize(unlikely, start, method="Nelder-Mead").x)


def growth(dives: pd.DataFrame, draws: int = 400) -> list[dict[str, Any]]:
    """The growth of each glider's position error, fitted, with intervals of 95 % by drawing dives again.

    With them comes which share of errors lies within two standard deviations of a model of the other dives;
    of normal errors in the plane 86.5 % do.
    """
    found, rng, fix = [], np.random.default_rng(0), None
    for glider, own in dives.groupby("glider", sort=False):
        seconds, square = own.seconds.to_numpy(), (own.east**2 + own.north**2).to_numpy()
        wide = seconds.max() > 5.0 * seconds.min()  # dives of one length tell one number

        def fit(rows: Any, linear: bool, known: Any = fix if not wide else None, of: Any = (seconds, square)):
            return fitted_growth(of[0][rows], of[1][rows], (known, None, 1.0 if linear else None))

        every = np.arange(len(seconds))
        again = [rng.choice(every, len(every)) for _ in range(draws)]
        line, lines = fit(every, True), np.array([fit(rows, True) for rows in again])
        power = np.array([fit(rows, False) for rows in [every, *again]])[:, 2] if wide else np.full(1, np.nan)
        fix = line[0]
        others = np.array([fit(every != k, True) for k in every])
        std = np.hypot(others[:, 0], others[:, 1] * seconds)
        found.append({
            "glider": glider, "dives": len(own), "fix": line[0], "rate": line[1],
            "rate_range": np.quantile(lines[:, 1], [0.025, 0.975]).tolist(), "exponent": power[0],
            "exponent_range": np.quantile(power[1:] if wide else power, [0.025, 0.975]).tolist(),
            "within": float((square < 4.0 * std**2).mean()),
        })  # fmt: skip
    return found


def draw(missions: Missions, file: Path) -> None:
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


SCORES = {"prediction": "{prediction}", "bias": "{bias:+.1f}", "MAE": "{mae:.2f}", "RMSE": "{rmse:.2f}"}
FITTED = {
    "constant": "{constant}", "all missions": "{values[0]:.3g}", "least": "{values[1]:.3g}",
    "greatest, a fleet-day left out": "{values[2]:.3g}",
}  # fmt: skip
DIVES = {
    "glider": "{glider}", "dives": "{dives}", "W": "{power_w:.1f}", "Wh a dive": "{wh_a_dive:.2f}",
    "Wh/km": "{wh_per_km:.1f}", "error, m": "{error_m:.0f}", "m/s": "{error_m_per_s:.3f}",
    "90 %": "{error_m_per_s_90:.3f}", "share of the track": "{error_share:.0%}",
}  # fmt: skip
PUMPS = {
    "glider": "{glider}", "stretches": "{stretches}", "W but for the pump": "{hotel_w:.2f}",
    "one left out": "{hotel_range[0]:.2f}-{hotel_range[1]:.2f}", "J a dive": "{pump_j:,.0f}",
    "one left out ": "{pump_range[0]:,.0f}-{pump_range[1]:,.0f}", "error": "{error:.0%}",
    "error by mean power": "{error_by_mean:.0%}",
}  # fmt: skip

GROWTH = {
    "glider": "{glider}", "dives": "{dives}", "fix, m": "{fix:.0f}", "m/s along each axis": "{rate:.4f}",
    "95 %": "{rate_range[0]:.4f}-{rate_range[1]:.4f}", "exponent": "{exponent:.2f}",
    "95 % ": "{exponent_range[0]:.2f}-{exponent_range[1]:.2f}", "within two sigma": "{within:.0%}",
}  # fmt: skip


@launch(
    folder=(str(SHARED / "energy"), "of the data"),
    picture=("", "file to draw predictions against measurements in"),
)
def main(folder: str, picture: str) -> dict[str, Any]:
    missions = Missions(read(Path(folder) / "jaiabot_missions.csv"))
    scores, constants = missions.rows(), missions.constants()
    days = len(np.unique(missions.days))
    screen.print(f"{len(missions.drain)} JaiaBot missions on {days} fleet-days, points of charge")
    show_markdown(scores, SCORES)
    show_markdown([{"constant": name, "values": values} for name, values in constants.items()], FITTED)
    slocum = read(Path(folder) / "slocum.csv")
    dived, pumped = gliders(slocum), pumps(slocum)
    unsure = slocum[slocum.check_residual_m >= 200.0].dive_start_utc.tolist()
    grown = growth(submerged(read(Path(folder) / "slocum_positions.csv"), unsure))
    show_markdown(dived, DIVES)
    show_markdown(pumped, PUMPS)
    show_markdown(grown, GROWTH)
    if picture:
        draw(missions, Path(picture))
    return {"scores": scores, "constants": constants, "gliders": dived, "pumps": pumped, "growth": grown}
