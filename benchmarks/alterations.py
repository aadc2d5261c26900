"""Altered copies of saved runs: does the checker find each, and nothing in the originals?

`python -m benchmarks.alterations DIR [DIR ...] [-n 40] [--seed 0]` checks saved runs, and draws alterations
at random from `KINDS`, each of one figure by more than the checker's tolerance. It ends with status 1 where
an original has a fault or an alteration is not found.
"""

import copy
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.check.run import check_dataset
from auvplan.runtime.files import read_mission, read_summary
from benchmarks.harness import Rng, grouped, launch, screen, show, track

Summary = dict[str, Any]
Alter = Callable[[Summary, xr.Dataset, Rng], None]


def _values(name: str, change: Callable[[np.ndarray, xr.Dataset, Rng], None]) -> Alter:
    """The values of a variable, changed in place."""

    def alter(summary: Summary, dataset: xr.Dataset, rng: Rng) -> None:
        values = np.array(dataset[name].values)
        change(values, dataset, rng)
        dataset[name] = dataset[name].copy(data=values)

    return alter


def _one(name: str, change: float, at: Callable[[np.ndarray, xr.Dataset, Rng], Any]) -> Alter:
    """A value at one place, either way."""

    def alter(values: np.ndarray, dataset: xr.Dataset, rng: Rng) -> None:
        values[at(values, dataset, rng)] += change * rng.choice([-1.0, 1.0])

    return _values(name, alter)


def _inner(values: np.ndarray, dataset: xr.Dataset, rng: Rng) -> int:
    """An observation that begins a step of a moving vehicle and is neither first nor last of its leg."""
    leg, moving = dataset["leg_index"].values, np.hypot(*(dataset[name] for name in ("surge", "sway"))) > 0.1
    inner = (leg[1:-1] == leg[:-2]) & (leg[1:-1] == leg[2:]) & moving.values[1:-1] & moving.values[:-2]
    return int(rng.choice(np.flatnonzero(inner))) + 1


_track = partial(_one, at=_inner)
#: One leg's, route's or plan's figure, and the first of one's.
_row = partial(_one, at=lambda values, dataset, rng: rng.integers(len(values)))
_first = partial(_one, at=lambda values, dataset, rng: (rng.integers(len(values)), 0))


def _flipped(values: np.ndarray, dataset: xr.Dataset, rng: Rng) -> None:
    k = rng.integers(len(values))
    values[k] = 1 - values[k]


def _stated(name: str, change: float, rows_of: Callable[[Summary, xr.Dataset], Any]) -> Alter:
    """A figure of one of some rows."""

    def alter(summary: Summary, dataset: xr.Dataset, rng: Rng) -> None:
        rows = [row for row in rows_of(summary, dataset) if row.get(name) is not None]
        rows[rng.integers(len(rows))][name] += change

    return alter


_figure = partial(_stated, rows_of=lambda summary, dataset: [summary])
_leg_figure = partial(_stated, rows_of=lambda summary, dataset: summary["legs"])
_attribute = partial(_stated, rows_of=lambda summary, dataset: [dataset.attrs])


def _swapped(nodes: np.ndarray, dataset: xr.Dataset, rng: Rng) -> None:
    """Two waypoints of the first route change places."""
    count = int((nodes[0] >= 0).sum())
    if count < 4:
        nodes[0, 0] = nodes[0, 1]
    else:
        k = rng.integers(1, count - 2)
        nodes[0, [k, k + 1]] = nodes[0, [k + 1, k]]


def _moved(places: np.ndarray, dataset: xr.Dataset, rng: Rng) -> None:
    places[rng.integers(len(places)), 1, 0] += 10.0


def _kept(name: str, change: Callable[[Any, Rng], None]) -> Alter:
    """Something of what the run was made from."""

    def alter(summary: Summary, dataset: xr.Dataset, rng: Rng) -> None:
        stated = json.loads(dataset.attrs[name])
        change(stated, rng)
        dataset.attrs[name] = json.dumps(stated)

    return alter


def _job_figure(name: str, change: float) -> Alter:
    def alter(stated: dict[str, Any], rng: Rng) -> None:
        rng.choice(stated["points"])[name] += change

    return _kept("jobs", alter)


def _job_window(stated: dict[str, Any], rng: Rng) -> None:
    window = rng.choice([job for job in stated["points"] if job["windows"]])["windows"][0]
    window[:] = [None if end is None else end + 10.0 for end in window]


def _jobs_swapped(stated: dict[str, Any], rng: Rng) -> None:
    jobs = stated["points"]
    one, two = rng.choice(len(jobs), 2, replace=False)
    jobs[one]["position"], jobs[two]["position"] = jobs[two]["position"], jobs[one]["position"]


def _leg_of_both(name: str, change: float) -> Alter:
    """A figure of one leg, in both files alike."""

    def alter(summary: Summary, dataset: xr.Dataset, rng: Rng) -> None:
        values = np.array(dataset[f"leg_{name}"].values)
        leg = rng.choice(np.flatnonzero(np.isfinite(values)))
        values[leg] += change
        summary["legs"][leg][name] = float(values[leg])
        dataset[f"leg_{name}"] = dataset[f"leg_{name}"].copy(data=values)

    return alter


def _promised(summary: Summary, dataset: xr.Dataset, rng: Rng) -> None:
    """The share of a promise, in both files alike."""
    stated = json.loads(dataset.attrs["promise"])
    summary["promise"]["share"] = stated["share"] = stated["share"] - 0.02
    dataset.attrs["promise"] = json.dumps(stated)


#: Alterations of what is said of vehicles whose position grows uncertain.
POSITIONS: dict[str, Alter] = {
    "a leg's position error by 2 m": _leg_of_both("position_std", 2.0),
    "a leg's position error by -2 m": _leg_of_both("position_std", -2.0),
    "a leg's time at the surface by 10 s": _leg_of_both("t_fix", 10.0),
    "a leg's time at the surface by -10 s": _leg_of_both("t_fix", -10.0),
    "summary: a leg's position error by 2 m": _leg_figure("position_std", 2.0),
    "summary: a leg's time at the surface by 10 s": _leg_figure("t_fix", 10.0),
    "summary: a leg's risk by 0.001": _leg_figure("risk", 1e-3),
    "summary: the risk by 0.001": _figure("risk", 1e-3),
}

#: What is altered, by how much it says so.
KINDS: dict[str, Alter] = {
    "a position 3 m north": _track("x", 3.0),
    "a position 3 m east": _track("y", 3.0),
    "a position 15 m east": _track("y", 15.0),
    "a depth by 5 m": _track("depth", 5.0),
    "a time by 0.9 s": _track("time", 0.9),
    "a surge by 0.5 m/s": _track("surge", 0.5),
    "a sway by 0.5 m/s": _track("sway", 0.5),
    "a heave by 0.5 m/s": _track("heave", 0.5),
    "a yaw by 20 deg": _track("yaw", 20.0),
    "a pitch by 20 deg": _track("pitch", 20.0),
    "a course by 5 deg": _track("course", 5.0),
    "a longitude by 1e-4 deg": _track("longitude", 1e-4),
    "a latitude by 1e-4 deg": _track("latitude", 1e-4),
    "a leg's expected time by 10 s": _row("leg_t_expected", 10.0),
    "a leg's travel time by 10 s": _row("leg_t_path", 10.0),
    "a leg's task time by 10 s": _row("leg_t_task", 10.0),
    "a leg's waiting by 10 s": _row("leg_t_wait", 10.0),
    "a leg's priority by 1": _row("leg_priority", 1.0),
    "a leg's arrival": _values("leg_arrived", _flipped),
    "a leg's revisit": _values("leg_revisit", _flipped),
    "a route's time by 10 s": _row("route_time", 10.0),
    "a route's priority by 1": _row("route_priority", 1.0),
    "a route's first leg by 10 s": _first("route_leg_time", 10.0),
    "two waypoints of a route": _values("route_nodes", _swapped),
    "a plan's first time by 10 s": _first("plan_time", 10.0),
    "a plan's position by 10 m": _values("plan_position", _moved),
    "the mission's time by 10 s": _attribute("t_mission", 10.0),
    "the charged planning time by 10 s": _attribute("charged_compute", 10.0),
    "the speed of the vehicle by 0.2 m/s": _attribute("vehicle_speed", 0.2),
    "a job's priority by 1": _job_figure("priority", 1.0),
    "a job's duration by 10 s": _job_figure("duration", 10.0),
    "a job's window by 10 s": _kept("jobs", _job_window),
    "two jobs swapped": _kept("jobs", _jobs_swapped),
    "the current by 0.1 m/s": _values("current_north", lambda values, *_: np.add(values, 0.1, out=values)),
    "the digest of a file": _kept("sources", lambda stated, rng: rng.choice(stated).update(sha256="0" * 64)),
    "summary: mission time by 10 s": _figure("t_mission", 10.0),
    "summary: time left by 10 s": _figure("t_residual", 10.0),
    "summary: tasks by 1": _figure("tasks", 1),
    "summary: priority by 1": _figure("total_priority", 1.0),
    "summary: replans of the mission by 1": _figure("mission_replans", 1),
    "summary: replans of paths by 1": _figure("path_replans", 1),
    "summary: planning calls by 1": _figure("path_calls", 1),
    "summary: collisions by 1": _figure("collisions", 1),
    "summary: revisits by 1": _figure("revisits", 1),
    "summary: a leg's expected time by 10 s": _leg_figure("t_expected", 10.0),
    "summary: a leg's planned time by 10 s": _leg_figure("t_planned", 10.0),
    "summary: a leg's travel time by 10 s": _leg_figure("t_path", 10.0),
    "summary: a leg's replans by 1": _leg_figure("path_replans", 1),
    "summary: a leg's waypoint": _leg_figure("to", 1),
    "a promise's share by 0.02": _promised,
    "summary: a promise's share": lambda summary, *_: summary["promise"].update(share=0.123),
    **POSITIONS,
}


def altered(kind: str, summary: Summary, dataset: xr.Dataset, rng: Rng) -> tuple[Summary, xr.Dataset]:
    changed = copy.deepcopy(summary), dataset.copy(deep=True)
    KINDS[kind](*changed, rng)
    return changed


def possible(kind: str, dataset: xr.Dataset) -> bool:
    name = kind.split(" by ")[0]
    jobs = (json.loads(dataset.attrs.get("jobs", "null")) or {}).get("points", [])
    needs = {
        "a longitude": "longitude" in dataset,
        "a latitude": "longitude" in dataset,
        "a job's priority": bool(jobs),
        "a job's duration": bool(jobs),
        "a job's window": any(job["windows"] for job in jobs),
        "two jobs swapped": len(jobs) > 1,
        "the current": "current_north" in dataset,
        "the digest of a file": bool(json.loads(dataset.attrs.get("sources", "null"))),
        "a promise's share": "promise" in dataset.attrs,
        "a leg's position error": "leg_position_std" in dataset,
        "a leg's time at the surface": "leg_t_fix" in dataset,
        "a leg's risk": "leg_risk" in dataset,
        "the risk": "leg_risk" in dataset,
    }
    return needs.get(name.removeprefix("summary: "), True)


@launch(
    runs={"nargs": "+", "type": Path, "metavar": "DIR", "help": "folders of saved runs"},
    n=(40, "alterations"),
    seed=(0, "that they are drawn by"),
)
def main(runs: list[Path], n: int, seed: int) -> tuple[dict[str, Any], bool]:
    rng, rows, clean, originals = np.random.default_rng(seed), [], 0, []
    for folder in track(runs, "originals"):
        originals.append((folder, read_summary(folder), read_mission(folder)))
        report = check_dataset(*originals[-1][1:])
        clean += report.ok
        if not report.ok:
            screen.print(f"{folder}: {report.faults[0]}")
    for _ in track(range(n), "alterations"):
        folder, summary, dataset = originals[rng.integers(len(originals))]
        kind = str(rng.choice([kind for kind in KINDS if possible(kind, dataset)]))
        report = check_dataset(*altered(kind, summary, dataset, rng))
        rows.append({"run": str(folder), "kind": kind, "faults": report.faults})
    found, kinds, shown = sum(bool(row["faults"]) for row in rows), {}, []
    groups = grouped(rows, lambda row: [row["kind"]])
    for kind in filter(groups.get, KINDS):
        faults = [row["faults"] for row in groups[kind]]
        kinds[kind] = sum(map(bool, faults)), len(faults)
        row = dict(zip(("found", "of"), kinds[kind], strict=True))
        shown.append(row | {"kind": kind, "first": (max(faults, key=len) or [""])[0]})
    columns = {"alteration": "{kind}", "first fault": "{first}", "found": "{found}", "of": "{of}"}
    show("altered runs", shown, columns, names=2)
    screen.print(
        f"originals without a fault: {clean} of {len(runs)}; alterations found: {found} of {len(rows)}"
    )
    content = {"alterations": {"originals": len(runs), "clean": clean, "kinds": kinds}}
    return content, clean < len(runs) or found < len(rows)
