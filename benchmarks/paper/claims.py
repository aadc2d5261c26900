"""The claims of section 4, each against the figures of both presets.

A claim is judged by a criterion that stands beside it: the paper's own number where it gives one, a reading
of its words where it does not. A claim about all missions, legs or seeds is confirmed where all meet it, and
partly where at least half do. Figures of the default preset are shown for comparison and decide nothing.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from auvplan.scenario.settings import PlanningSettings
from auvplan.study import statistics
from benchmarks.harness import markdown

Verdict = Literal["confirmed", "partly", "not confirmed"]

#: Largest mean violation that counts as none: "violation diminishes" to zero within 100 iterations.
NO_VIOLATION = 1e-3


@dataclass(frozen=True)
class Claim:
    claim: str  # in a few words
    where: str  # section, equation or figure
    criterion: str  # what makes it confirmed
    paper: str  # the figure under the paper's preset
    default: str  # the figure under the default preset; empty where there is none
    verdict: Verdict  # of the paper's preset


@dataclass(frozen=True)
class Evidence:
    """What one preset's runs left behind."""

    legs: xr.Dataset  # of `legs.legs_dataset`
    missions: xr.Dataset  # of a study without a sweep
    calls: xr.Dataset  # of `calls.call_times`
    interval: float  # s between two measurements by the vehicle's sensors


class Finding(NamedTuple):
    """A figure in words, and whether it meets its criterion: True, False, or None for in part."""

    words: str
    met: bool | None


class Question(NamedTuple):
    """What is asked of the evidence: a claim, where it stands, what makes it confirmed, and who answers."""

    claim: str
    where: str
    criterion: str
    missions_alone: bool  # whether missions alone decide it
    ask: Callable[[Evidence], Finding]


#: In the paper's order.
QUESTIONS: list[Question] = []


def _question(claim: str, where: str, criterion: str, missions_alone: bool = False) -> Callable[[Any], Any]:
    return lambda ask: QUESTIONS.append(Question(claim, where, criterion, missions_alone, ask))


def judge(paper: Evidence, default: Evidence | None = None) -> list[Claim]:
    """Judge every claim by the paper's preset, and show the default's figures beside it."""
    found, verdicts = [], {True: "confirmed", None: "partly", False: "not confirmed"}
    for claim, where, criterion, _, ask in QUESTIONS:
        words, met = ask(paper)
        theirs = "" if default is None else ask(default).words
        found.append(Claim(claim, where, criterion, words, theirs, verdicts[met]))
    return found


def as_markdown(claims: Sequence[Claim]) -> str:
    rows = ((c.claim, c.where, c.paper, c.default or "-", c.verdict, c.criterion) for c in claims)
    escaped = ([cell.replace("|", r"\|") for cell in row] for row in rows)
    heads = ("claim", "where", "paper's preset", "default", "verdict", "criterion")
    return "\n".join(markdown(heads, escaped)) + "\n"


def _share(met: np.ndarray | Sequence[bool]) -> bool | None:
    """Return whether all are met; None where at least half are."""
    count, size = np.sum(met), np.size(met)
    return True if size and count == size else (None if size and 2 * count >= size else False)


def last_finite(history: np.ndarray) -> np.ndarray:
    """Last finite value along the last axis of [..., iterations]."""
    finite = np.isfinite(history)
    last = history.shape[-1] - 1 - np.argmax(finite[..., ::-1], axis=-1)
    return np.take_along_axis(history, last[..., None], axis=-1)[..., 0]


@_question(
    "cost converges, and its variation falls, within 100 iterations", "4.1, Fig. 11(a)",
    "mean and standard deviation of the population's cost end lower in every first plan",
)  # fmt: skip
def _converges(evidence: Evidence) -> Finding:
    mean, std = (evidence.legs[name].values for name in ("cost_mean", "cost_std"))
    end, spread = last_finite(mean), last_finite(std)
    met = (end < mean[..., 0]) & (spread < std[..., 0])
    costs = (f"{np.median(values):,.0f} s" for values in (mean[..., 0], end, std[..., 0], spread))
    words = "{} of {} first plans; cost {} to {}, deviation {} to {} (medians)"
    return Finding(words.format(met.sum(), met.size, *costs), _share(met))


def no_violation(legs: xr.Dataset) -> np.ndarray:
    """Return whether the population's mean violation falls below `NO_VIOLATION`, [scenarios, seeds]."""
    return np.any(legs["violation_mean"].values < NO_VIOLATION, axis=-1)


@_question(
    "violation of the population goes to zero within 100 iterations", "4.1, Fig. 11(b)",
    f"mean violation below {NO_VIOLATION:g} in every first plan",
)  # fmt: skip
def _violation(evidence: Evidence) -> Finding:
    met, end = no_violation(evidence.legs), last_finite(evidence.legs["violation_mean"].values)
    shares = ", ".join(f"{100.0 * row.mean():.0f} %" for row in met)
    ends = ", ".join(f"{value:.2g}" for value in np.median(end, axis=-1))
    return Finding(f"{shares} of seeds in scenarios 1 to 3; at the end {ends}", _share(met))


@_question(
    "paths satisfy vehicular and collision limits in all three scenarios", "4.1",
    "the best path of every first plan keeps every limit",
)  # fmt: skip
def _best_feasible(evidence: Evidence) -> Finding:
    met = evidence.legs["feasible"].values == 1.0
    return Finding(f"{met.sum()} of {met.size} first plans keep every limit", _share(met))


@_question(
    "the path is corrected to the latest current", "4.1, Fig. 8",
    "scenario-1: no re-plan is slower than going on along the old path, and it is faster on average",
)  # fmt: skip
def _adapts(evidence: Evidence) -> Finding:
    gain = evidence.legs["replan_gain"].sel(scenario="scenario-1").values
    gain = gain[np.isfinite(gain)]
    if not len(gain):
        return Finding("no re-plan", False)
    mean, least = 100.0 * gain.mean(), 100.0 * gain.min()
    words = f"{mean:+.2f} % of the time left saved on average, least {least:+.2f} %"
    return Finding(words, _share(gain >= 0.0) if mean > 0.0 else False)


@_question(
    "favourable current speeds the vehicle up", "4.1, Fig. 10",
    "scenario-1: every first plan is faster than the straight line",
)  # fmt: skip
def _uses_current(evidence: Evidence) -> Finding:
    one = evidence.legs.sel(scenario="scenario-1")
    saved = 1.0 - one["planned_s"].values / one["straight_s"].values
    mean, less = 100.0 * abs(saved.mean()), "less" if saved.mean() > 0.0 else "more"
    words = f"{mean:.1f} % {less} time than the straight line on average; "
    words += f"faster in {(saved > 0.0).sum()} of {saved.size}"
    return Finding(words, _share(saved > 0.0) if saved.mean() > 0.0 else False)


@_question(
    "obstacles of all kinds and coast are avoided", "4.1, Figs 9, 10",
    "no collision by the independent checker",
)  # fmt: skip
def _no_collision(evidence: Evidence) -> Finding:
    legs, missions = (each["collisions"].values for each in (evidence.legs, evidence.missions))
    words = f"{legs.sum():.0f} in {legs.size} legs, {missions.sum():.0f} in {missions.size} missions"
    return Finding(words, bool(legs.sum() == 0.0 and missions.sum() == 0))


@_question(
    "fitness falls as the rate of current updates rises", "4.1",
    "scenario-1: mean cost of the path as produced rises with U_R^C, beyond chance at the highest",
)  # fmt: skip
def _slower_with_updates(evidence: Evidence) -> Finding:
    rates, cost = evidence.legs["rate"].values, evidence.legs["rate_cost"].values
    excess, count = 100.0 * (cost / cost[:1] - 1.0), cost.shape[1]
    mean = excess.mean(axis=1)
    half = 1.96 * excess.std(axis=1, ddof=1) / np.sqrt(count) if count > 1 else mean * np.nan
    each = zip(rates[1:], mean[1:], half[1:], strict=True)
    words = (f"{value:+.1f} ± {error:.1f} % at {rate:g}" for rate, value, error in each)
    rises = bool((np.diff(mean) > 0.0).all() and mean[-1] > half[-1])
    return Finding("cost against none " + ", ".join(words), rises or (None if mean[-1] > 0.0 else False))


@_question(
    "re-using past solutions saves time and gives better paths", "3.2.2, Fig. 5",
    "at a window's iterations: lower median cost than a fresh population, no worse in most",
)  # fmt: skip
def _warm_start(evidence: Evidence) -> Finding:
    names = "kept_cost", "fresh_cost", "kept_iterations"
    kept, fresh, share = (evidence.legs[name].values.ravel() for name in names)
    known = np.isfinite(kept) & np.isfinite(fresh)
    if not known.any():
        return Finding("no re-plan to compare", False)
    better = kept[known] <= fresh[known]
    gain = 100.0 * float(np.median(1.0 - kept[known] / fresh[known]))
    as_good = 100.0 * statistics.over_finite(share, np.nanmedian)
    words = f"no worse in {better.sum()} of {known.sum()} first re-plans, median cost {-gain:+.1f} %; "
    words += f"as good as fresh after {as_good:.0f} % of the iterations (median)"
    most = bool(better.mean() > 0.5)
    return Finding(words, None if most and gain <= 0.0 else most)


@_question(
    "every mission ends on time with time left", "4.2, Fig. 12",
    "all missions arrive with positive T_residual", missions_alone=True,
)  # fmt: skip
def _on_time(evidence: Evidence) -> Finding:
    missions = evidence.missions
    left, cut = missions["t_residual"].values, cut_off(missions)
    met = (missions["success"].values == 1) & (left > 0.0)
    words = f"{met.sum()} of {met.size}"
    words += f", {cut.sum()} cut off by the clock under way" if cut.any() else ""
    words += "" if cut.all() else f"; least time left of those that arrived {left[~cut].min():,.0f} s"
    return Finding(words, _share(met))


@_question(
    "T_mission approaches T_available", "4.2, Fig. 12",
    "missions on time use at least 95 % on average (partly: 90 %); Fig. 15's first route uses 97 %",
    missions_alone=True,
)  # fmt: skip
def _use(evidence: Evidence) -> Finding:
    success = evidence.missions["success"].values == 1
    use = statistics.use_of_time(evidence.missions)[success]
    if not use.size:
        return Finding("no mission on time", False)
    mean = float(use.mean())
    words = f"{mean:.1f} % on average of the {use.size} of {success.size} missions on time"
    met = True if mean >= 95.0 else (None if mean >= 90.0 else False)
    return Finding(f"{words}, least {use.min():.1f} %", met)


@_question(
    "T_path and t_ij lie in a similar range", "4.2, Fig. 13",
    "correlation at least 0.9 and median relative error at most 10 %; Fig. 15's example: 6.5 %",
    missions_alone=True,
)  # fmt: skip
def _similar_times(evidence: Evidence) -> Finding:
    expected, executed = statistics.leg_times(evidence.missions)
    both = np.isfinite(expected) & np.isfinite(executed)
    correlation = float(np.corrcoef(expected[both], executed[both])[0, 1])
    error = 100.0 * float(np.nanmedian(statistics.relative_errors(evidence.missions)))
    words = f"correlation {correlation:.3f}, median relative error {error:.1f} %, {both.sum()} legs"
    return Finding(words, _share([error <= 10.0, correlation >= 0.9]))


@_question(
    "planning is fast enough for real time", "4.2, Fig. 14",
    "no single call, in one thread, takes longer than the interval between two looks",
)  # fmt: skip
def _quick_calls(evidence: Evidence) -> Finding:
    first, window = (evidence.calls[name].values for name in ("first_cpu", "window_cpu"))
    longest = max(first.max(), window.max())
    leg, again, most = (f"{1000.0 * time:.0f} ms" for time in (np.median(first), np.median(window), longest))
    words = f"{leg} a leg, {again} a re-plan, at most {most} of {evidence.interval:.0f} s between two looks"
    return Finding(words, bool(longest < evidence.interval))


@_question(
    "CPU time of path calls and of missions varies little", "4.2, Fig. 14",
    "standard deviation below half of the mean for both",
)  # fmt: skip
def _stable_calls(evidence: Evidence) -> Finding:
    whole = np.nan_to_num(statistics.planning_time(evidence.missions))
    call, all_ = (values.std() / values.mean() for values in (evidence.calls["first_cpu"].values, whole))
    words = f"standard deviation over missions {100.0 * call:.0f} % of the mean for a call, "
    words += f"{100.0 * all_:.0f} % for all planning of a mission"
    return Finding(words, _share([call < 0.5, all_ < 0.5]))


def cut_off(missions: xr.Dataset) -> np.ndarray:
    """Return which missions ended on the way, as time ran out: by how much they are late is not known."""
    return np.asarray(["was not finished: time ran out" in str(why) for why in missions["reason"].values])


def late_legs(missions: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers by mission: late legs after which something was left to plan, new routes for one."""
    planning = json.loads(missions.attrs["scenario"]).get("planning", {})
    rules = PlanningSettings.model_validate(planning).resolved
    reached = missions["leg_arrived"].values == 1
    count = np.cumsum(reached, axis=-1)
    # After the last leg there is nothing left to plan.
    going_on = reached & ((count < count[..., -1:]) | (missions["success"].values != 1)[..., None])
    times = (missions[f"leg_t_{name}"].values for name in ("path", "task", "expected"))
    late = (going_on & rules.late(*times)).sum(axis=-1)
    causes = missions["route_cause"]
    code = dict(zip(causes.attrs["flag_meanings"].split(), causes.attrs["flag_values"], strict=False))["late"]
    return late, (causes.values == code).sum(axis=-1)


@_question(
    "the mission is re-planned when, and only when, a leg was late", "3.3.2, 4.2",
    "no new route without a late leg; in every mission on time as many as late legs before the last one",
    missions_alone=True,
)  # fmt: skip
def _replans_when_late(evidence: Evidence) -> Finding:
    late, replans = late_legs(evidence.missions)
    failed, same = evidence.missions["success"].values != 1, late == replans
    words = f"{late.sum()} late legs, {replans.sum()} new routes for one; the same number in "
    words += f"{same.sum()} of {late.size} missions, {same[~failed].sum()} of {(~failed).sum()} on time"
    return Finding(words, _share(same | (failed & (replans < late))))


def _as_in_fig15(**figures: tuple[np.ndarray, float, str]) -> Finding:
    """Judge whether the paper's figures lie within the middle 90 % of values; by name, with a unit."""
    words, met = [], []
    for name, (values, paper, unit) in figures.items():
        low, middle, high = (round(float(q), 1) for q in np.nanquantile(values, [0.05, 0.5, 0.95]))
        words.append(f"{name} {middle:,g}{unit} ({low:,g} to {high:,g})")
        met.append(bool(low <= paper <= high))
    return Finding("; ".join(words), True if all(met) else (None if any(met) else False))


@_question(
    "first route: 17 tasks, weight 47, 13,976 s", "4.2, Fig. 15",
    "the paper's figures lie within the middle 90 % of the missions", missions_alone=True,
)  # fmt: skip
def _first_route(evidence: Evidence) -> Finding:
    nodes, weight, time = (
        evidence.missions[f"route_{name}"].values[:, 0] for name in ("nodes", "priority", "time")
    )
    legs = (nodes >= 0).sum(axis=-1) - 1.0
    return _as_in_fig15(tasks=(legs, 17.0, ""), weight=(weight, 47.0, ""), time=(time, 13_976.0, " s"))


@_question(
    "3 mission re-plans, 11 path calls", "4.2, Fig. 15",
    "the paper's figures lie within the middle 90 % of the missions", missions_alone=True,
)  # fmt: skip
def _call_counts(evidence: Evidence) -> Finding:
    replans, calls = (evidence.missions[name].values * 1.0 for name in ("mission_replans", "path_calls"))
    return _as_in_fig15(**{"mission re-plans": (replans, 3.0, ""), "path calls": (calls, 11.0, "")})
