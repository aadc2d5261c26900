"""What each part of the planner is worth to whole missions: paired studies of the Whitsunday scenario.

`python -m benchmarks.ablations --out DIR [-n 100]` simulates the same missions with the default settings,
then with one of them changed. `--sheared` simulates missions in three seas whose currents differ with depth,
with ways in depth and with ways that are sought in the plan view alone. Studies on disk are not run again.
"""

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import xarray as xr

import auvplan as ap
from auvplan.io.example import write_example
from auvplan.runtime.files import DESIGN
from auvplan.study import Design, load_study, run_study
from auvplan.study.statistics import mean_interval, median_interval, relative_errors, use_of_time
from auvplan.study.store import DATASET
from benchmarks.harness import SCENARIOS, launch, screen, show

#: Settings of each study.
STUDIES: dict[str, dict[str, Any]] = {
    "default": {},
    "objective of Eq. 15": {"objective": "eq15"},
    "travel times d / |v| (Eq. 13)": {"travel_times": "distance"},
    "full effort": {"effort": "full"},
    "plain search, both layers": {"effort": "plain"},
    "routes anew after every late leg, as the paper": {"replan": "late"},
    "no windows": {"t_series": 1},
    "paths anew at every window, kept population": {"window_change": 0.0},
    "paths anew at every window, fresh population": {"window_change": 0.0, "replan_from": "fresh"},
    "paper's planners, ten control points": {"preset": "paper", "control_points": 10, "task_time": "whole"},
}

_FIGURES = {
    "planned": "{name}", "total priority": "{priority}", "use of time, %": "{use}", "on time": "{success}",
    "collisions": "{collisions}", "planning, s": "{seconds:.2f}",
}  # fmt: skip

#: Both of these ask whether paths are sought in depth.
_ASKED = "auvplan.path.stages.is_searched_in_depth", "auvplan.mission.travel_times.is_searched_in_depth"

#: Arrivals count as off from this share of the leg's time in the plan on.
_OFF = 0.05

#: Of the made tide: period, s; speed at most above and below, m/s; depths, m, of the soft edge between them.
_PERIOD, _ABOVE, _BELOW, _EDGE = 44_714.0, 0.9, -0.6, (10.0, 16.0)


def two_layers(folder: Path) -> ap.Scenario:
    """Write the example with a tide in two layers that run against each other; return the scenario."""
    write_example(folder, force=True)
    scenario = ap.load_scenario(folder / "scenario.yaml")
    with xr.open_dataset(folder / "current.nc") as sea:
        sea = sea.load()
    seconds = (sea["time"] - sea["time"][0]) / np.timedelta64(1, "s")
    share = np.clip((sea["depth"] - _EDGE[0]) / (_EDGE[1] - _EDGE[0]), 0.0, 1.0)
    speed = (_ABOVE + (_BELOW - _ABOVE) * share) * np.cos(2.0 * np.pi * seconds / _PERIOD)
    names = [name for name in sea.data_vars if set(sea[name].dims) >= {"time", "depth"}]
    for name, part in zip(names, (np.sin(0.5), np.cos(0.5)), strict=True):
        sea[name] = (speed * part * xr.ones_like(sea[name])).transpose(*sea[name].dims)
    sea.to_netcdf(folder / "layers.nc")
    return scenario.with_({
        "current.files": "layers.nc", "mission": {"waypoints": 14, "time_available": 9000}, "obstacles": {},
        "simulation": {"obstacles": {"static": 0, "afloat": 0, "self_motivated": 0}},
    })  # fmt: skip


def in_sheared_seas(folder: Path, count: int) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """Yield each sea and its rows, one for each way of planning: studies of `count` missions."""
    seas = {"tide in two layers": two_layers(folder / "tide" / "scenario")}
    for name in ("fjord", "shelf"):
        scenario = ap.load_scenario(SCENARIOS / f"{name}_levels.yaml")
        seas[scenario.name] = scenario
    for name, scenario in seas.items():
        design, own = Design(scenario, count), folder / name.split()[0]
        deep = study(own / "depth", design, workers=1)
        with ExitStack() as stack:
            for asked in _ASKED:
                stack.enter_context(patch(asked, lambda *_: False))
            flat = study(own / "plan-view", design, workers=1)
        found = list(rows({"with ways in depth": deep, "without": flat}))
        for dataset, row in zip((deep, flat), found, strict=True):
            off = relative_errors(dataset)
            row["off"] = float(np.mean(off[np.isfinite(off)] > _OFF))
        yield name, found


def study(folder: Path, design: Design, workers: int | None = None) -> xr.Dataset:
    if (folder / DATASET).is_file():
        return load_study(folder)
    screen.print(f"{folder.name} ...")
    return run_study(design, folder, workers=workers, resume=(folder / DESIGN).is_file())


def rows(found: dict[str, xr.Dataset]) -> Iterator[dict[str, Any]]:
    base = next(iter(found.values()))
    for name, dataset in found.items():
        row = {"name": name}
        for key, of in (("priority", lambda one: one["total_priority"].values), ("use", use_of_time)):
            values, before = (np.asarray(of(one), float) for one in (dataset, base))
            mean, low, _ = mean_interval(values - before)
            row[key] = f"{values.mean():.2f}" + f" ({mean:+.2f} ± {mean - low:.2f})" * (dataset is not base)
        seconds = sum(dataset[layer].values for layer in ("path_cpu", "mission_cpu", "travel_time_cpu"))
        yield row | {
            "success": int((dataset["success"].values == 1).sum()),
            "collisions": int(dataset["collisions"].values.sum()),
            "error": median_interval(relative_errors(dataset))[0],
            "replans": dataset["path_replans"].values.mean(),
            "routes": 1.0 + dataset["mission_replans"].values.mean(),
            "seconds": np.mean(seconds),
        }


@launch(
    out=(Path("out/ablations"), "folder of the studies"),
    n=(100, "missions of each study"),
    sheared=(False, "ways in depth, in currents sheared in depth"),
)
def main(out: Path, n: int, sheared: bool) -> None:
    title = f"{n} paired missions; differences to the first row, 95 % intervals"
    if sheared:
        for sea, found in in_sheared_seas(out / "sheared", n):
            show(f"{sea}: {title}", found, _FIGURES | {"arrivals off by > 5 %": "{off:.1%}"})
        return
    studies = {}
    for name, changes in STUDIES.items():
        folder = name.replace(" ", "-").replace("/", "").replace("|", "").replace("--", "-")
        scenario = ap.load_scenario("whitsunday").with_({f"planning.{key}": changes[key] for key in changes})
        studies[name] = study(out / folder, Design(scenario, n))
    more = {"|T_path / t_ij - 1|": "{error:.1%}", "path re-plans": "{replans:.1f}", "routes": "{routes:.1f}"}
    show(title, rows(studies), _FIGURES | more)
