"""Statistics over the missions of a study, with 95 % intervals; a plan against simulated missions."""

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import xarray as xr
from scipy.special import stdtrit
from scipy.stats import binom

from auvplan.errors import ScenarioError, StudyError
from auvplan.mission.jobs import jobs_done, jobs_of
from auvplan.records import MissionRun
from auvplan.runtime.arrays import Array
from auvplan.runtime.intervals import wilson
from auvplan.scenario.scenario import Scenario

#: Share of what a plan covers of a survey line from which on a mission has done it.
_MOST = 0.95


def sweep_dims(dataset: xr.Dataset) -> list[str]:
    """Return names of the leading dimensions that are settings swept over; none without a sweep."""
    return [name.strip() for name in str(dataset.attrs.get("sweep", "")).split(",") if name.strip()]


def cases_of(dataset: xr.Dataset) -> list[tuple[dict[str, Any], xr.Dataset]]:
    """Return settings by field and the missions of each case of a sweep; without one, all are one case."""
    dims = {str(dataset[dim].attrs.get("field", dim)): dim for dim in sweep_dims(dataset)}
    indices = product(*(range(dataset.sizes[dim]) for dim in dims.values()))
    cases = (dataset.isel(dict(zip(dims.values(), index, strict=True))) for index in indices)
    return [({field: case[dim].item() for field, dim in dims.items()}, case) for case in cases]


def leg_times(dataset: xr.Dataset) -> tuple[Array, Array]:
    """Travel times expected, t_ij less what the task took, and executed, T_path, of legs that were finished.

    Returns:
        Two of [..., missions, legs] s; NaN for all other legs.
    """
    reached = dataset["leg_arrived"].values == 1
    expected = dataset["leg_t_expected"].values - dataset["leg_t_task"].values
    return np.where(reached, expected, np.nan), np.where(reached, dataset["leg_t_path"].values, np.nan)


def relative_errors(dataset: xr.Dataset) -> Array:
    """|T_path / expected - 1| of `leg_times`, [..., missions, legs]; NaN for legs that were not finished."""
    expected, executed = leg_times(dataset)
    return np.abs(executed / np.where(expected > 0.0, expected, np.nan) - 1.0)


def over_finite(values: Array, reduce: Callable[..., Array]) -> Array:
    """`reduce`, one of NumPy's NaN functions, along the last axis; NaN where no value is finite."""
    values = np.where(np.isfinite(values), values, np.nan)
    found = np.isfinite(values).any(axis=-1)
    reduced = np.full(found.shape, np.nan)
    if found.any():
        reduced[found] = reduce(values[found], axis=-1)
    return reduced


def positive(values: Array) -> Array:
    """Return the finite values above zero; the rest is NaN."""
    return np.where(np.isfinite(values) & (values > 0.0), values, np.nan)


def mean_interval(values: Array) -> tuple[Array, Array, Array]:
    """Mean and its 95 % interval by Student's t, along the last axis; NaN ends where one value is alone."""
    values = np.where(np.isfinite(values), values, np.nan)
    count = np.isfinite(values).sum(axis=-1)
    mean = over_finite(values, np.nanmean)
    free = np.maximum(count - 1, 1)
    error = np.sqrt(np.nansum((values - mean[..., None]) ** 2, axis=-1) / free / np.maximum(count, 1))
    half = np.where(count > 1, stdtrit(free, 0.975) * error, np.nan)
    return mean, mean - half, mean + half


def wilson_interval(values: Array) -> tuple[Array, Array, Array]:
    """Return share and Wilson's 95 % interval of values 0 or 100 %, along the last axis, %."""
    count = np.isfinite(values).sum(axis=-1)
    count = np.where(count > 0, count, np.nan)
    share = np.nansum(values, axis=-1) / 100.0 / count
    low, high = wilson(share, count)
    return 100.0 * share, 100.0 * low, 100.0 * high


def median_interval(values: Array) -> tuple[float, float, float]:
    """Median of the finite values and its 95 % interval by order statistics."""
    found = np.sort(values[np.isfinite(values)])
    if not len(found):
        return np.nan, np.nan, np.nan
    # As many values lie below the true median as heads fall among as many coins.
    low = max(int(binom.ppf(0.025, len(found), 0.5)) - 1, 0)
    high = len(found) - 1 - low
    return float(np.median(found)), float(found[low]), float(found[high])


def use_of_time(dataset: xr.Dataset) -> Array:
    """T_mission as a share of T_available, [..., missions] %."""
    available = dataset["t_available"].values
    return 100.0 * dataset["t_mission"].values / np.where(available > 0.0, available, np.nan)


def cost_per_metre(dataset: xr.Dataset) -> Array:
    """Cost of the first plan of each leg by the leg's straight line, mean over the legs reached, s/m."""
    legs = dataset.sizes["leg"]
    made_for = dataset["plan_leg"].values[..., None] == np.arange(legs)
    if not made_for.size:
        return np.full(dataset["leg_distance"].shape[:-1], np.nan)
    cost = np.take_along_axis(dataset["plan_cost"].values, made_for.argmax(axis=-2), axis=-1)
    return _per_metre(dataset, np.where(made_for.any(axis=-2), cost, np.nan))


def _per_metre(dataset: xr.Dataset, values: Array) -> Array:
    """Values of legs [..., missions, legs] by their straight lines, mean over the legs reached."""
    distance = dataset["leg_distance"].values
    usable = (dataset["leg_arrived"].values == 1) & (distance > 0.0)
    return over_finite(np.where(usable, values, np.nan) / np.where(usable, distance, 1.0), np.nanmean)


def planning_time(dataset: xr.Dataset) -> Array:
    """All planning of each mission, paths, routes and travel times, [..., missions] s; NaN without any."""
    parts = [dataset[name].values.astype(float) for name in ("path_cpu", "mission_cpu", "travel_time_cpu")]
    return over_finite(np.stack(parts, axis=-1), np.nansum)


def call_times(dataset: xr.Dataset) -> tuple[Array, Array, Array]:
    """Return 5 %, median and 95 % of the time of each mission's path planning calls, [..., missions] s."""
    calls = positive(dataset["plan_cpu"].values)
    low, middle, high = (over_finite(calls, partial(np.nanquantile, q=q)) for q in (0.05, 0.5, 0.95))
    return low, middle, high


def priority_gap(dataset: xr.Dataset) -> Array:
    """Return share of the bound on its total priority that each mission misses, %."""
    total, bound = dataset["total_priority"].values, dataset["priority_bound"].values
    return 100.0 * np.where(bound > 0.0, 1.0 - total / np.where(bound > 0.0, bound, 1.0), 0.0)


@dataclass(frozen=True)
class Figure:
    """A figure of a summary.

    Attributes:
        of: its values from the dataset, or the variable that holds them.
        words: for it in tables, empty where these leave it out.
        compared: whether the cases of a sweep are compared by it, seed by seed.
    """

    of: str | Callable[[xr.Dataset], Array]
    words: str = ""
    compared: bool = False

    def values(self, dataset: xr.Dataset) -> Array:
        """Return the values of all missions, legs or calls."""
        return np.asarray(dataset[self.of].values if isinstance(self.of, str) else self.of(dataset), float)


FIGURES = {
    "use_of_time_percent": Figure(use_of_time, "use of the available time, %", True),
    "t_residual_s": Figure("t_residual", "time left at the end, s"),
    "tasks": Figure("tasks", "tasks done"),
    "total_priority": Figure("total_priority", "total priority", True),
    "priority_bound": Figure("priority_bound"),
    "priority_gap_percent": Figure(priority_gap, "gap to the bound on it, %"),
    "path_calls": Figure("path_calls"),
    "path_replans": Figure("path_replans", "path re-plans a mission", True),
    "mission_replans": Figure("mission_replans", "mission re-plans a mission", True),
    "cost_mission": Figure("cost_mission", "cost of a mission (Eq. 15)"),
    "cost_total": Figure("cost_total", "total cost with re-planning (Eq. 16)", True),
    "t_expected_s": Figure(lambda dataset: leg_times(dataset)[0], "expected time of a leg, s"),
    "t_path_s": Figure(lambda dataset: leg_times(dataset)[1], "T_path of a leg, s"),
    "path_cost_per_metre_s": Figure(cost_per_metre, compared=True),
    "executed_time_per_metre_s": Figure(
        lambda dataset: _per_metre(dataset, dataset["leg_t_path"].values), compared=True
    ),
    "coast_clearance_m": Figure("coast_clearance", "least distance to the coast, m"),
    "obstacle_clearance_m": Figure("obstacle_clearance", "least distance to an obstacle, m"),
    "seabed_altitude_m": Figure("seabed_altitude", "least altitude above the bed, m"),
    "path_cpu_s": Figure("path_cpu", "path planning a mission, s"),
    "mission_cpu_s": Figure("mission_cpu", "mission planning a mission, s"),
    "mission_replan_cpu_s": Figure("mission_replan_cpu"),
    "path_call_cpu_s": Figure("plan_cpu", "time of a path planning call, s"),
    "mission_call_cpu_s": Figure("route_cpu", "time of a mission planning call, s"),
}

#: Names of what `mean_interval` returns.
_INTERVAL = "mean", "low", "high"

#: Words for those that tables show.
DESCRIBED = {name: figure.words for name, figure in FIGURES.items() if figure.words}


def summarise(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the figures of a study, ready for JSON; with a sweep a list of them under "cases"."""
    (sweep, start), *_ = cases = cases_of(dataset)
    if not sweep:
        return _case(dataset)
    compared = {name: figure for name, figure in FIGURES.items() if figure.compared}
    first = {name: figure.values(start) for name, figure in compared.items()}
    stated = []
    for setting, case in cases:
        less = {name: figure.values(case) - first[name] for name, figure in compared.items()}
        differences = {name: _stated(_INTERVAL, mean_interval(values)) for name, values in less.items()}
        stated.append({"setting": setting} | _case(case) | {"differences_to_first": differences})
    return {"sweep": list(sweep), "cases": stated}


def _case(dataset: xr.Dataset) -> dict[str, Any]:
    """Figures of the missions of one case."""
    success = dataset["success"].values == 1
    share, low, high = (float(value) for value in wilson_interval(100.0 * success))
    expected, executed = leg_times(dataset)
    both = np.isfinite(expected) & np.isfinite(executed)
    errors = [100.0 * value for value in median_interval(relative_errors(dataset))]
    seeds, correlation = dataset["seed"].values, np.nan
    if both.sum() > 2 and min(np.ptp(expected[both]), np.ptp(executed[both])) > 1e-6:  # s
        correlation = np.corrcoef(expected[both], executed[both])[0, 1]
    return {
        "missions": int(success.size),
        "on_time": int(success.sum()),
        "on_time_percent": {"share": share, "low": low, "high": high},
        "failed_seeds": [int(seed) for seed in seeds[~success]],
        "failures": [str(reason) for reason in dataset["reason"].values[~success]],
        "collisions": int(dataset["collisions"].values.sum()),
        "faults": int(dataset["faults"].values.sum()),
        "expected_against_executed": {
            "legs": int(both.sum()),
            **_stated(("correlation",), (correlation,)),
            **_stated(("median_relative_error_percent", "low", "high"), errors),
        },
        "figures": {name: _describe(figure.values(dataset)) for name, figure in FIGURES.items()},
    }


def _describe(values: Array) -> dict[str, float | None]:
    """Mean with its interval, standard deviation and quantiles of the finite values; None of one alone."""
    found = values[np.isfinite(values)]
    if not len(found):
        return {}
    spread = found.std(ddof=1) if len(found) > 1 else np.nan
    names = (*_INTERVAL, "std", "least", "q05", "q25", "median", "q75", "q95", "most")
    quantiles = np.quantile(found, [0.0, 0.05, 0.25, 0.5, 0.75, 0.95, 1.0])
    return _stated(names, (*mean_interval(found), spread, *quantiles))


def _stated(names: Iterable[str], values: Iterable[Any]) -> dict[str, float | None]:
    """Numbers by their names; None for one that is not finite."""
    found = zip(names, values, strict=True)
    return {name: float(value) if np.isfinite(value) else None for name, value in found}


def require_one_sea(scenario: Scenario) -> None:
    """Raise ScenarioError where each seed is another mission altogether, in which no plan can hold."""
    if reason := scenario.differs_by_seed:
        raise ScenarioError(
            f"{reason}, in which no plan of one holds: a rehearsal needs currents from files, or none "
            "(vortices: 0), and mission.jobs, or one leg with start and goal"
        )


def rehearsal_of(planned: MissionRun, executed: xr.Dataset) -> dict[str, Any]:
    """Figures of how often a plan holds in missions of its scenario, ready for JSON.

    A survey line counts as done where a mission covers `_MOST` of what the plan covers of it, whatever it is
    worth by then.

    Returns:
        What `summarise` returns of the missions; the plan's figures; how many missions came to each job, how
        many did it, and what share of what is planned of it they do on average; how many did all that is
        planned, on time.

    Raises:
        StudyError: the missions are of an older study, which does not say what of lines they cover.
    """
    if "leg_line_covered" not in executed:
        raise StudyError("the study has no variable leg_line_covered: replace it with --force")
    nodes, count = {job.name: job.nodes for job in jobs_of(planned.jobs)}, executed.sizes["mission"]

    def did(legs: list[tuple[int, int, float]]) -> tuple[set[str], dict[str, float]]:
        """Return the jobs of which legs do all parts, and how much they do of each: of points 1."""
        much = dict.fromkeys(nodes, 0.0)
        for start, goal, amount in legs:
            for name, own in nodes.items():
                if goal in own and (len(own) == 1 or start in own):
                    much[name] += 1.0 if len(own) == 1 else amount
        return jobs_done(planned.jobs, [leg[:2] for leg in legs]), much

    legs_of_plan = [(leg.start, leg.goal, leg.coverage, leg.priority) for leg in planned.earning]
    wanted, whole = did([(i, j, part.length if part else worth) for i, j, part, worth in legs_of_plan])
    lines = {name for name in wanted if len(nodes.get(name, ())) > 1}
    come, done, shares, complete = Counter[str](), Counter[str](), dict.fromkeys(wanted, 0.0), 0
    covered = executed["leg_line_covered"]
    amounts = covered.where(covered > 0.0, executed["leg_priority"])
    for row in range(count):
        legs = {of: executed[f"leg_{of}"].values[row] for of in ("arrived", "priority", "from", "to")}
        earning = (legs["arrived"] == 1) & (legs["priority"] > 0.0)
        starts, goals = (legs[of][earning].tolist() for of in ("from", "to"))
        parts = zip(map(int, starts), map(int, goals), amounts.values[row][earning].tolist(), strict=True)
        found, much = did(list(parts))
        come.update(found)
        found -= {name for name in lines if much[name] < _MOST * whole[name]}
        for name in shares:
            shares[name] += min(much[name] / whole[name], 1.0) / count
        done.update(found)
        complete += bool(executed["success"].values[row] == 1 and wanted <= found)
    plan = {"tasks": planned.tasks, "total_priority": planned.total_priority, "time_s": planned.t_mission}
    jobs = [
        {
            "name": name,
            "planned": name in wanted,
            "come_to": come[name],
            "done": done[name],
            "share": shares.get(name),
        }
        for name in nodes
    ]
    more = {"plan": plan, "all_planned_tasks": complete, "jobs": jobs}
    return {"scenario": str(planned.scenario.get("name", ""))} | more | summarise(executed)
