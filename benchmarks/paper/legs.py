"""The path planner on the paper's three scenarios (section 4.1): what is run and what is kept of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import xarray as xr

from auvplan.check.run import check_dataset
from auvplan.executive import run_missions, seed_keys
from auvplan.io.results import to_dataset
from auvplan.ocean.currents import Current
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.scenario import Scenario
from auvplan.scenario.file import load_scenario, validate_scenario

Array = np.ndarray

SCENARIOS = ("scenario-1", "scenario-2", "scenario-3")

#: Values of U_R^C (Eq. 2) that the claim on update rates is tested at; 1 is the shipped scenarios'.
RATES = (0.0, 1.0, 4.0, 16.0)

#: The one whose paths are drawn in Fig. 8: at 1 the current changes little within a leg.
SHOWN_RATE = 4.0

_HISTORY = {
    "cost_mean": "mean", "cost_std": "std", "cost_best": "best",
    "violation_mean": "violation_mean", "violation_std": "violation_std",
}  # fmt: skip


@dataclass(frozen=True)
class Legs:
    """Runs of single legs under one preset, all for the same seeds."""

    scenarios: dict[str, list[MissionRun]]  # of each of `SCENARIOS`, as planned from the kept population
    fresh: dict[str, list[MissionRun]]  # of each of `SCENARIOS`, re-planned from a fresh population
    rates: dict[float, list[MissionRun]]  # of scenario-1, by each of `RATES`


def changed(name: str, preset: str, **sections: dict[str, Any]) -> Scenario:
    """Load a shipped scenario under a preset, with some settings of its sections changed."""
    plain = load_scenario(name).model_dump(mode="json")
    plain["planning"]["preset"] = preset
    for section, settings in sections.items():
        plain[section] |= settings
    return validate_scenario(plain, name)


def execute_legs(preset: str, seeds: Sequence[int], rate_seeds: Sequence[int]) -> Legs:
    """Run the three scenarios from a kept and a fresh population, and the first one by update rate.

    Args:
        preset: "paper" or "default".
        seeds: of the three scenarios.
        rate_seeds: of scenario-1 at each of `RATES`.
    """

    def run(name: str, seeds: Sequence[int], **sections: dict[str, Any]) -> list[MissionRun]:
        return run_missions(changed(name, preset, **sections), keys=seed_keys(seeds), seeds=seeds)

    kept, fresh = (
        {name: run(name, seeds, planning={"replan_from": source}) for name in SCENARIOS}
        for source in ("kept", "fresh")
    )
    rates = {rate: run("scenario-1", rate_seeds, current={"update_rate": rate}) for rate in RATES}
    return Legs(kept, fresh, rates)


def legs_dataset(legs: Legs) -> xr.Dataset:
    """Condense runs of single legs into the figures that the claims of section 4.1 are judged by.

    Returns:
        Variables over scenario, seed and iteration of the first plan; and over update rate and its seeds.
    """
    by_run: dict[str, Callable[[MissionRun], float]] = {
        "planned_s": lambda run: leg_of(run).t_planned,
        "straight_s": _straight,
        "replan_gain": replan_gain,
        "success": lambda run: run.success,
        "collisions": lambda run: check_dataset(run.summary(), to_dataset(run)).collisions,
        "feasible": lambda run: leg_of(run).plans[0].feasible,
    }
    kept, fresh = list(legs.scenarios.values()), list(legs.fresh.values())
    each = {name: [[of(run) for run in runs] for runs in kept] for name, of in by_run.items()}
    pairs = [
        [warm_start(leg_of(a), leg_of(b)) for a, b in zip(*both, strict=True)]
        for both in zip(kept, fresh, strict=True)
    ]
    names = "kept_cost", "fresh_cost", "kept_iterations"
    each |= dict(zip(names, np.moveaxis(np.asarray(pairs), -1, 0), strict=True))
    history = {
        name: _histories([[leg_of(run).plans[0].history[key] for run in runs] for runs in kept])
        for name, key in _HISTORY.items()
    }
    of_rate: dict[str, Callable[[MissionRun], float]] = {
        "rate_cost": lambda run: fitness(leg_of(run)),
        "rate_success": lambda run: run.success,
        "rate_time": lambda run: leg_of(run).t_path,
    }
    rates = {
        name: [[of(run) for run in runs] for runs in legs.rates.values()] for name, of in of_rate.items()
    }
    sizes = ("scenario", "seed"), ("scenario", "seed", "iteration"), ("rate", "rate_seed")
    found = zip(sizes, (each, history, rates), strict=True)
    seeds = ([run.seed for run in next(iter(runs.values()))] for runs in (legs.scenarios, legs.rates))
    labels = dict(zip(("seed", "rate_seed"), seeds, strict=True))
    return xr.Dataset(
        {name: (dims, np.asarray(values, float)) for dims, part in found for name, values in part.items()},
        labels | {"scenario": list(legs.scenarios), "rate": list(legs.rates)},
    )


def leg_of(run: MissionRun) -> LegRecord:
    return run.legs[0]


def _histories(rows: list[list[Array]]) -> list[list[Array]]:
    """[scenarios][seeds] histories of one length; searches of fewer iterations end in NaN."""
    longest = max(len(history) for row in rows for history in row)
    return [[np.pad(one, (0, longest - len(one)), constant_values=np.nan) for one in row] for row in rows]


def _straight(run: MissionRun) -> float:
    """Time of the straight line at the current of the first plan, s; land and obstacles left out."""
    plan = leg_of(run).plans[0]
    share = np.linspace(0.0, 1.0, len(plan.positions))[:, None]
    line = plan.positions[0] + share * (plan.positions[-1] - plan.positions[0])
    return time_along(line, plan.current, float(run.vehicle.speed))


def time_along(positions: Array, current: Current, speed: float) -> float:
    """Time a vehicle takes that holds a track in a steady current, s.

    Args:
        positions: [n, 3] m.
        current: taken at time zero.
        speed: m/s through the water.
    """
    positions = np.asarray(positions, float)
    step = np.diff(positions, axis=0)
    length = np.maximum(np.linalg.norm(step, axis=1), 1e-9)
    middle = 0.5 * (positions[1:] + positions[:-1])
    field: Any = current
    water = np.stack([np.asarray(part, float) for part in field(*middle.T, np.zeros(len(middle)))], axis=1)
    along = (water * step).sum(axis=1) / length
    across = (water**2).sum(axis=1) - along**2
    ground = along + np.sqrt(np.maximum(speed**2 - across, 0.0))
    return float((length / np.maximum(ground, 0.05 * speed)).sum())


def rest_of(plan: PlanRecord, position: Array) -> Array:
    """Return the part of a plan that is left at a position [3] m, as many points [S, 3] m as the plan has."""
    nearest = int(np.argmin(np.linalg.norm(plan.positions - position, axis=1)))
    left = np.concatenate([position[None], plan.positions[nearest + 1 :]])
    place = np.linspace(0.0, len(left) - 1.0, len(plan.positions))
    return np.stack([np.interp(place, np.arange(len(left)), part) for part in left.T], axis=1)


def replan_gain(run: MissionRun) -> float:
    """Return share of the time left that re-planning saves against the old path, mean over re-plans.

    Both paths are timed in the current that the re-plan was made in. NaN without re-plans.
    """
    plans, speed, gains = leg_of(run).followed_plans, float(run.vehicle.speed), []
    for old, new in pairwise(plans):
        before = time_along(rest_of(old, new.positions[0]), new.current, speed)
        gains.append(1.0 - time_along(new.positions, new.current, speed) / before)
    return float(np.mean(gains)) if gains else np.nan


def displacement(leg: LegRecord) -> float:
    """Return how far the re-plans lead the path aside from what was planned before, m; the largest one."""
    pairs = pairwise(leg.followed_plans)
    return max((_away(new.positions, old.positions) for old, new in pairs), default=0.0)


def _away(places: Array, line: Array) -> float:
    """Largest distance of places [n, 3] m to a line through points [S, 3] m, m."""
    begin, step = line[:-1], np.diff(line, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-12)
    share = np.clip(((places[:, None] - begin) * step).sum(axis=2) / square, 0.0, 1.0)
    nearest = begin + share[..., None] * step
    return float(np.linalg.norm(places[:, None] - nearest, axis=2).min(axis=1).max())


def fitness(leg: LegRecord) -> float:
    """Cost of the path as produced: time to the last re-plan and the cost (Eq. 12) of what it planned, s."""
    last = leg.followed_plans[-1]
    return last.made_at - leg.plans[0].made_at + last.cost


def warm_start(kept: LegRecord, fresh: LegRecord) -> tuple[float, float, float]:
    """Compare the first re-plan from the kept population with a fresh one at the same place (Fig. 5).

    Both searches get the iterations of a window: later ones of the fresh search do not count.

    Returns:
        Cost from the kept population and from the fresh one, s; and the share of the window's iterations
        after which the kept population is as good as the fresh one at their end, 1 where it never is. NaN
        where the legs had no common re-plan.
    """
    pair = [next((plan for plan in leg.plans if plan.cause != "leg"), None) for leg in (kept, fresh)]
    if pair[0] is None or pair[1] is None or not np.allclose(pair[0].positions[0], pair[1].positions[0]):
        return np.nan, np.nan, np.nan
    warm, cold = (np.asarray(plan.history["best"], float) for plan in pair if plan is not None)
    budget = min(len(warm), len(cold)) - 1
    reached = warm[: budget + 1] <= cold[budget]
    first = int(np.argmax(reached)) if reached.any() else budget
    return float(warm[budget]), float(cold[budget]), first / max(budget, 1)


def shown_leg(runs: Sequence[MissionRun], largest: bool = False) -> MissionRun:
    """Choose the run to draw, of those that arrived, that of middle or of largest `displacement`.

    Runs with a plan that broke a limit are left out where there are others.
    """
    arrived = [run for run in runs if run.success] or list(runs)
    sound = [run for run in arrived if all(plan.feasible for plan in leg_of(run).followed_plans)] or arrived
    ranked = sorted(sound, key=lambda run: displacement(leg_of(run)))
    return ranked[-1] if largest else ranked[len(ranked) // 2]


def followed(leg: LegRecord) -> LegRecord:
    """Copy a leg without the plans that were made and not followed."""
    return replace(leg, plans=leg.followed_plans, followed=0)
