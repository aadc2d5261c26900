"""What each part of the planner is worth to whole missions: paired studies of the Whitsunday scenario.

``python -m benchmarks.ablations --out DIR [-n 100]`` simulates the same missions with the default settings,
then with one of them changed, and prints the differences mission by mission with their 95 % intervals.
Studies on disk are not run again.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

import auvplan as ap
from auvplan.scenario.file import validate_scenario
from auvplan.study import Design, load_study, run_study
from auvplan.study.statistics import mean_interval, median_interval, relative_errors, use_of_time
from auvplan.study.store import DATASET
from benchmarks.machine import console, table

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


def study(folder: Path, design: Design) -> xr.Dataset:
    """Run one study, or continue or load it."""
    if (folder / DATASET).is_file():
        return load_study(folder)
    with Progress(TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), transient=True) as bar:
        task = bar.add_task(folder.name, total=1.0)
        return run_study(
            design,
            folder,
            resume=(folder / "study.json").is_file(),
            progress=lambda _, __, share: bar.update(task, completed=share),
        )


def difference(dataset: xr.Dataset, base: xr.Dataset, of: Callable[[xr.Dataset], Any]) -> str:
    """Mean difference, mission by mission, and half of its 95 % interval."""
    mean, low, _ = mean_interval(np.asarray(of(dataset), float) - np.asarray(of(base), float))
    return f"{mean:+.2f} ± {mean - low:.2f}"


def rows(found: dict[str, xr.Dataset]) -> Iterator[dict[str, Any]]:
    """A row a study."""
    base = next(iter(found.values()))
    for name, dataset in found.items():
        row = {"name": name}
        for key, of in (("priority", lambda one: one["total_priority"].values), ("use", use_of_time)):
            own = f"{np.mean(of(dataset)):.2f}"
            row[key] = own if dataset is base else f"{own} ({difference(dataset, base, of)})"
        seconds = sum(dataset[layer].values for layer in ("path_cpu", "mission_cpu", "travel_time_cpu"))
        yield row | {
            "success": int((dataset["success"].values == 1).sum()),
            "collisions": int(dataset["collisions"].values.sum()),
            "error": median_interval(relative_errors(dataset))[0],
            "replans": dataset["path_replans"].values.mean(),
            "routes": 1.0 + dataset["mission_replans"].values.mean(),
            "seconds": np.mean(seconds),
        }


def main() -> None:
    """Run the studies that are missing and print the table."""
    parser = argparse.ArgumentParser(description="Ablations of whole missions.")
    parser.add_argument("-n", type=int, default=100, help="missions of each study")
    parser.add_argument("--out", type=Path, default=Path("out/ablations"), help="folder of the studies")
    options = parser.parse_args()
    found = {}
    for name, changes in STUDIES.items():
        folder = name.replace(" ", "-").replace("/", "").replace("|", "").replace("--", "-")
        plain = ap.load_scenario("whitsunday").model_dump(mode="json")
        plain["planning"] |= changes
        found[name] = study(options.out / folder, Design(validate_scenario(plain), options.n))
    columns = {
        "study": "{name}", "total priority": "{priority}", "use of time, %": "{use}", "on time": "{success}",
        "collisions": "{collisions}", "|T_path / t_ij - 1|": "{error:.1%}", "path re-plans": "{replans:.1f}",
        "routes": "{routes:.1f}", "planning, s": "{seconds:.2f}",
    }  # fmt: skip
    title = f"{options.n} paired missions; differences to the first row, 95 % intervals"
    console().print(table(title, rows(found), columns))


if __name__ == "__main__":
    main()
