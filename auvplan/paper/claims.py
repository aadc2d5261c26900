"""The claims of section 4, each against the figures of both presets.

A claim is judged by a criterion that stands beside it: the paper's own number where it gives one, a reading
of its words where it does not. A claim about all missions, legs or seeds is confirmed where all meet it, and
partly where at least half do. Figures of the default preset are shown for comparison and decide nothing.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr

from auvplan.scenario.settings import PlanningSettings
from auvplan.study import statistics

Verdict = Literal["confirmed", "partly", "not confirmed"]

#: Largest mean violation that counts as none: "violation diminishes" to zero within 100 iterations.
NO_VIOLATION = 1e-3


@dataclass(frozen=True)
class Claim:
    """A claim of the paper and what was found.

    Attributes:
        claim: in a few words.
        where: section, equation or figure.
        criterion: what makes it confirmed.
        paper: the figure under the paper's preset.
        default: the figure under the default preset; empty where there is none.
        verdict: "confirmed", "partly" or "not confirmed", of the paper's preset.
    """

    claim: str
    where: str
    criterion: str
    paper: str
    default: str
    verdict: Verdict


@dataclass(frozen=True)
class Evidence:
    """What one preset's runs left behind.

    Attributes:
        legs: of `legs.legs_dataset`.
        missions: of a study without a sweep.
        calls: of `calls.call_times`.
        interval: s between two measurements by the vehicle's sensors.
    """

    legs: xr.Dataset
    missions: xr.Dataset
    calls: xr.Dataset
    interval: float


class Finding(NamedTuple):
    """A figure in words, and whether it meets its criterion: True, False, or None for in part."""

    words: str
    met: bool | None


class Question(NamedTuple):
    """What is asked of the evidence: a claim, where it stands, what makes it confirmed, and who answers."""

    claim: str
    where: str
    criterion: str
    ask: Callable[[Evidence], Finding]


#: In the paper's order.
QUESTIONS: list[Question] = []


def _question(claim: str, where: str, criterion: str) -> Callable[[Any], Any]:
    def add(ask: Callable[[Evidence], Finding]) -> Callable[[Evidence], Finding]:
        QUESTIONS.append(Question(claim, where, criterion, ask))
        return ask

    return add


def judge(paper: Evidence, default: Evidence | None = None) -> list[Claim]:
    """Judge every claim by the paper's preset, and show the default's figures beside it."""
    found = []
    for question in QUESTIONS:
        ours = question.ask(paper)
        theirs = "" if default is None else question.ask(default).words
        verdict: Verdict = "partly" if ours.met is None else ("confirmed" if ours.met else "not confirmed")
        found.append(Claim(question.claim, question.where, question.criterion, ours.words, theirs, verdict))
    return found


def as_json(claims: Sequence[Claim]) -> list[dict[str, Any]]:
    """Plain data of the claims."""
    return [asdict(claim) for claim in claims]


def as_markdown(claims: Sequence[Claim]) -> str:
    """Return the claims as a table."""
    lines = [
        "| claim | where | paper's preset | default | verdict | criterion |",
        "|---|---|---|---|---|---|",
    ]
    for claim in claims:
        cells = (claim.claim, claim.where, claim.paper, claim.default or "-", claim.verdict, claim.criterion)
        lines.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _all_or_some(met: np.ndarray) -> bool | None:
    """Return whether all are met; None where at least half are."""
    count, size = np.sum(met), np.size(met)
    return True if size and count == size else (None if size and 2 * count >= size else False)


def last_finite(history: np.ndarray) -> np.ndarray:
    """Last finite value along the last axis of [..., iterations]."""
    finite = np.isfinite(history)
    last = history.shape[-1] - 1 - np.argmax(finite[..., ::-1], axis=-1)
    return np.take_along_axis(history, last[..., None], axis=-1)[..., 0]


@_question(
    "cost converges, and its variation falls, within 100 iterations",
    "4.1, Fig. 11(a)",
    "mean and standard deviation of the population's cost end lower in every first plan",
)
def _converges(evidence: Evidence) -> Finding:
    mean, std = (evidence.legs[name].values for name in ("cost_mean", "cost_std"))
    end, spread = last_finite(mean), last_finite(std)
    met = (end < mean[..., 0]) & (spread < std[..., 0])
    words = (
        f"{met.sum()} of {met.size} first plans; cost {np.median(mean[..., 0]):,.0f} s to "
        f"{np.median(end):,.0f} s, deviation {np.median(std[..., 0]):,.0f} s to {np.median(spread):,.0f} s "
        "(medians)"
    )
    return Finding(words, _all_or_some(met))


def no_violation(legs: xr.Dataset) -> np.ndarray:
    """Return whether the population's mean violation falls below `NO_VIOLATION`, [scenarios, seeds]."""
    return np.any(legs["violation_mean"].values < NO_VIOLATION, axis=-1)


@_question(
    "violation of the population goes to zero within 100 iterations",
    "4.1, Fig. 11(b)",
    f"mean violation below {NO_VIOLATION:g} in every first plan",
)
def _violation(evidence: Evidence) -> Finding:
    met, end = no_violation(evidence.legs), last_finite(evidence.legs["violation_mean"].values)
    shares = ", ".join(f"{100.0 * row.mean():.0f} %" for row in met)
    ends = ", ".join(f"{value:.2g}" for value in np.median(end, axis=-1))
    return Finding(f"{shares} of seeds in scenarios 1 to 3; at the end {ends}", _all_or_some(met))


@_question(
    "paths satisfy vehicular and collision limits in all three scenarios",
    "4.1",
    "the best path of every first plan keeps every limit",
)
def _best_feasible(evidence: Evidence) -> Finding:
    met = evidence.legs["feasible"].values == 1.0
    return Finding(f"{met.sum()} of {met.size} first plans keep every limit", _all_or_some(met))


@_question(
    "the path is corrected to the latest current",
    "4.1, Fig. 8",
    "scenario-1: no re-plan is slower than going on along the old path, and it is faster on average",
)
def _adapts(evidence: Evidence) -> Finding:
    gain = evidence.legs["replan_gain"].sel(scenario="scenario-1").values
    gain = gain[np.isfinite(gain)]
    if not len(gain):
        return Finding("no re-plan", False)
    words = (
        f"{100.0 * gain.mean():+.2f} % of the time left saved on average, least {100.0 * gain.min():+.2f} %"
    )
    return Finding(words, _all_or_some(gain >= 0.0) if gain.mean() > 0.0 else False)


@_question(
    "favourable current speeds the vehicle up",
    "4.1, Fig. 10",
    "scenario-1: every first plan is faster than the straight line",
)
def _uses_current(evidence: Evidence) -> Finding:
    one = evidence.legs.sel(scenario="scenario-1")
    saved = 1.0 - one["planned_s"].values / one["straight_s"].values
    less = "less" if saved.mean() > 0.0 else "more"
    words = (
        f"{100.0 * abs(saved.mean()):.1f} % {less} time than the straight line on average; faster in "
        f"{(saved > 0.0).sum()} of {saved.size}"
    )
    return Finding(words, _all_or_some(saved > 0.0) if saved.mean() > 0.0 else False)


@_question(
    "obstacles of all kinds and coast are avoided",
    "4.1, Figs 9, 10",
    "no collision by the independent checker",
)
def _no_collision(evidence: Evidence) -> Finding:
    legs = evidence.legs["collisions"].values
    missions = evidence.missions["collisions"].values
    words = f"{legs.sum():.0f} in {legs.size} legs, {missions.sum():.0f} in {missions.size} missions"
    return Finding(words, bool(legs.sum() == 0.0 and missions.sum() == 0))


@_question(
    "fitness falls as the rate of current updates rises",
    "4.1",
    "scenario-1: mean cost of the path as produced rises with U_R^C, beyond chance at the highest",
)
def _slower_with_updates(evidence: Evidence) -> Finding:
    rates, cost = evidence.legs["rate"].values, evidence.legs["rate_cost"].values
    excess = 100.0 * (cost / cost[:1] - 1.0)
    mean = excess.mean(axis=1)
    half = (
        1.96 * excess.std(axis=1, ddof=1) / np.sqrt(excess.shape[1]) if excess.shape[1] > 1 else mean * np.nan
    )
    words = "cost against none " + ", ".join(
        f"{value:+.1f} ± {error:.1f} % at {rate:g}"
        for rate, value, error in zip(rates[1:], mean[1:], half[1:], strict=True)
    )
    rising = bool((np.diff(mean) > 0.0).all())
    beyond_chance = bool(mean[-1] > half[-1])
    return Finding(words, True if rising and beyond_chance else (None if mean[-1] > 0.0 else False))


@_question(
    "re-using past solutions saves time and gives better paths",
    "3.2.2, Fig. 5",
    "at a window's iterations: lower median cost than a fresh population, no worse in most",
)
def _warm_start(evidence: Evidence) -> Finding:
    kept, fresh, share = (
        evidence.legs[name].values.ravel() for name in ("kept_cost", "fresh_cost", "kept_iterations")
    )
    known = np.isfinite(kept) & np.isfinite(fresh)
    if not known.any():
        return Finding("no re-plan to compare", False)
    better = kept[known] <= fresh[known]
    gain = 100.0 * float(np.median(1.0 - kept[known] / fresh[known]))
    words = (
        f"no worse in {better.sum()} of {known.sum()} first re-plans, median cost {-gain:+.1f} %; as good as "
        f"fresh after {100.0 * statistics.over_finite(share, np.nanmedian):.0f} % of the iterations (median)"
    )
    return Finding(
        words, True if gain > 0.0 and better.mean() > 0.5 else (None if better.mean() > 0.5 else False)
    )


@_question(
    "every mission ends on time with time left",
    "4.2, Fig. 12",
    "all missions arrive with positive T_residual",
)
def _on_time(evidence: Evidence) -> Finding:
    met = (evidence.missions["success"].values == 1) & (evidence.missions["t_residual"].values > 0.0)
    left, cut = evidence.missions["t_residual"].values, cut_off(evidence.missions)
    words = f"{met.sum()} of {met.size}"
    if cut.any():
        words += f", {cut.sum()} cut off by the clock under way"
    if not cut.all():
        words += f"; least time left of those that arrived {left[~cut].min():,.0f} s"
    return Finding(words, _all_or_some(met))


@_question(
    "T_mission approaches T_available",
    "4.2, Fig. 12",
    "missions on time use at least 95 % on average (partly: 90 %); Fig. 15's first route uses 97 %",
)
def _use(evidence: Evidence) -> Finding:
    use = statistics.use_of_time(evidence.missions)[evidence.missions["success"].values == 1]
    if not use.size:
        return Finding("no mission on time", False)
    mean = float(use.mean())
    met = True if mean >= 95.0 else (None if mean >= 90.0 else False)
    count = evidence.missions.sizes["mission"]
    words = f"{mean:.1f} % on average of the {use.size} of {count} missions on time, least {use.min():.1f} %"
    return Finding(words, met)


@_question(
    "T_path and t_ij lie in a similar range",
    "4.2, Fig. 13",
    "correlation at least 0.9 and median relative error at most 10 %; Fig. 15's example: 6.5 %",
)
def _similar_times(evidence: Evidence) -> Finding:
    expected, executed = statistics.leg_times(evidence.missions)
    both = np.isfinite(expected) & np.isfinite(executed)
    correlation = float(np.corrcoef(expected[both], executed[both])[0, 1])
    error = 100.0 * float(np.nanmedian(statistics.relative_errors(evidence.missions)))
    words = f"correlation {correlation:.3f}, median relative error {error:.1f} %, {both.sum()} legs"
    close, correlated = error <= 10.0, correlation >= 0.9
    return Finding(words, True if close and correlated else (None if close or correlated else False))


@_question(
    "planning is fast enough for real time",
    "4.2, Fig. 14",
    "no single call, in one thread, takes longer than the interval between two looks",
)
def _quick_calls(evidence: Evidence) -> Finding:
    first, window = (evidence.calls[name].values for name in ("first_cpu", "window_cpu"))
    words = (
        f"{1000.0 * np.median(first):.0f} ms a leg, {1000.0 * np.median(window):.0f} ms a re-plan, at most "
        f"{1000.0 * max(first.max(), window.max()):.0f} ms of {evidence.interval:.0f} s between two looks"
    )
    return Finding(words, bool(max(first.max(), window.max()) < evidence.interval))


@_question(
    "CPU time of path calls and of missions varies little",
    "4.2, Fig. 14",
    "standard deviation below half of the mean for both",
)
def _stable_calls(evidence: Evidence) -> Finding:
    first, whole = (
        evidence.calls["first_cpu"].values,
        np.nan_to_num(statistics.planning_time(evidence.missions)),
    )
    spread = [float(values.std() / values.mean()) for values in (first, whole)]
    words = (
        f"standard deviation over missions {100.0 * spread[0]:.0f} % of the mean for a call, "
        f"{100.0 * spread[1]:.0f} % for all planning of a mission"
    )
    steady = [value < 0.5 for value in spread]
    return Finding(words, True if all(steady) else (None if any(steady) else False))


def rules_of(missions: xr.Dataset) -> PlanningSettings:
    """Return the rules that missions were planned by."""
    planning = json.loads(missions.attrs["scenario"]).get("planning", {})
    return PlanningSettings.model_validate(planning).resolved


def cut_off(missions: xr.Dataset) -> np.ndarray:
    """Return which missions ended on the way, as time ran out: by how much they are late is not known."""
    return np.asarray(["was not finished: time ran out" in str(why) for why in missions["reason"].values])


def late_legs(missions: xr.Dataset) -> tuple[np.ndarray, np.ndarray]:
    """Return numbers by mission: late legs after which something was left to plan, new routes for one."""
    reached = missions["leg_arrived"].values == 1
    count = np.cumsum(reached, axis=-1)
    # After the last leg there is nothing left to plan.
    going_on = reached & ((count < count[..., -1:]) | (missions["success"].values != 1)[..., None])
    times = (missions[f"leg_t_{name}"].values for name in ("path", "task", "expected"))
    late = (going_on & rules_of(missions).late(*times)).sum(axis=-1)
    causes = missions["route_cause"]
    code = dict(zip(causes.attrs["flag_meanings"].split(), causes.attrs["flag_values"], strict=False))["late"]
    return late, (causes.values == code).sum(axis=-1)


@_question(
    "the mission is re-planned when, and only when, a leg was late",
    "3.3.2, 4.2",
    "no new route without a late leg; in every mission on time as many as late legs before the last one",
)
def _replans_when_late(evidence: Evidence) -> Finding:
    missions = evidence.missions
    late, replans = late_legs(missions)
    failed = missions["success"].values != 1
    words = f"{late.sum()} late legs, {replans.sum()} new routes for one; the same number in "
    words += f"{(late == replans).sum()} of {late.size} missions, {(late == replans)[~failed].sum()} of "
    words += f"{(~failed).sum()} on time"
    return Finding(words, _all_or_some((late == replans) | (failed & (replans < late))))


def _within(values: np.ndarray, paper: float, unit: str = "") -> tuple[str, bool]:
    """Median and range of the middle 90 %, and whether the paper's figure lies in it."""
    low, middle, high = np.nanquantile(values, [0.05, 0.5, 0.95])
    low, middle, high = (round(float(value), 1) for value in (low, middle, high))
    return f"{middle:,g}{unit} ({low:,g} to {high:,g})", bool(low <= paper <= high)


def _several(found: Sequence[tuple[str, bool]], names: Sequence[str]) -> Finding:
    words = "; ".join(f"{name} {text}" for name, (text, _) in zip(names, found, strict=True))
    met = [inside for _, inside in found]
    return Finding(words, True if all(met) else (None if any(met) else False))


@_question(
    "first route: 17 tasks, weight 47, 13,976 s",
    "4.2, Fig. 15",
    "the paper's figures lie within the middle 90 % of the missions",
)
def _first_route(evidence: Evidence) -> Finding:
    missions = evidence.missions
    legs = (missions["route_nodes"].values[:, 0] >= 0).sum(axis=-1) - 1.0
    weight, time = (missions[f"route_{name}"].values[:, 0] for name in ("priority", "time"))
    found = [_within(legs, 17.0), _within(weight, 47.0), _within(time, 13_976.0, " s")]
    return _several(found, ("tasks", "weight", "time"))


@_question(
    "3 mission re-plans, 11 path calls",
    "4.2, Fig. 15",
    "the paper's figures lie within the middle 90 % of the missions",
)
def _call_counts(evidence: Evidence) -> Finding:
    missions = evidence.missions
    found = [
        _within(missions["mission_replans"].values.astype(float), 3.0),
        _within(missions["path_calls"].values.astype(float), 11.0),
    ]
    return _several(found, ("mission re-plans", "path calls"))


#: Those that missions alone decide.
MISSION_QUESTIONS = tuple(
    question
    for question in QUESTIONS
    if question.ask in (_on_time, _use, _similar_times, _replans_when_late, _first_route, _call_counts)
)
