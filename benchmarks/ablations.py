"""What each part of the planner is worth to whole missions: paired studies of the Whitsunday scenario.

``python -m benchmarks.ablations --out DIR [-n 100]`` simulates the same missions with the default settings,
then with one of them changed, and prints the differences mission by mission with their 95 % intervals.
Studies on disk are not run again.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

import auvplan as ap
from auvplan.scenario.file import validate_scenario
from auvplan.study import Design, load_study, run_study
from auvplan.study.statistics import mean_interval, median_interval, relative_errors, use_of_time
from auvplan.study.store import DATASET
from benchmarks.machine import console, empty_table

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


def study(name: str, changes: dict[str, Any], count: int, out: Path) -> xr.Dataset:
    """Run one study, or load it."""
    folder = out / name.replace(" ", "-").replace("/", "").replace("|", "").replace("--", "-")
    if (folder / DATASET).is_file():
        return load_study(folder)
    plain = ap.load_scenario("whitsunday").model_dump(mode="json")
    plain["planning"] |= changes
    design = Design(validate_scenario(plain), count)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console(), transient=True) as bar:
        task = bar.add_task(name, total=1.0)
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


def table(found: dict[str, xr.Dataset]) -> Table:
    """A row a study."""
    base = next(iter(found.values()))
    title = f"{base.sizes['mission']} paired missions; differences to the first row, 95 % intervals"
    figures = ("total priority", "use of time, %", "on time", "collisions", "|T_path / t_ij - 1|")
    shown = empty_table(title, ["study"], [*figures, "path re-plans", "routes", "planning, s"])
    for name, dataset in found.items():
        row = [name]
        for of in (lambda one: one["total_priority"].values, use_of_time):
            own = f"{np.mean(of(dataset)):.2f}"
            row.append(own if dataset is base else f"{own} ({difference(dataset, base, of)})")
        seconds = sum(dataset[layer].values for layer in ("path_cpu", "mission_cpu", "travel_time_cpu"))
        row += [
            f"{int((dataset['success'].values == 1).sum())}",
            f"{int(dataset['collisions'].values.sum())}",
            f"{median_interval(relative_errors(dataset))[0]:.1%}",
            f"{dataset['path_replans'].values.mean():.1f}",
            f"{1.0 + dataset['mission_replans'].values.mean():.1f}",
            f"{np.mean(seconds):.2f}",
        ]
        shown.add_row(*row)
    return shown


def main() -> None:
    """Run the studies that are missing and print the table."""
    parser = argparse.ArgumentParser(description="Ablations of whole missions.")
    parser.add_argument("-n", type=int, default=100, help="missions of each study")
    parser.add_argument("--out", type=Path, default=Path("out/ablations"), help="folder of the studies")
    options = parser.parse_args()
    found = {name: study(name, changes, options.n, options.out) for name, changes in STUDIES.items()}
    screen = console()
    screen.print(table(found))


if __name__ == "__main__":
    main()
