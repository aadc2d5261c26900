"""The harness of the benchmarks: options, timing, what figures depend on, and how they are shown and kept."""

import argparse
import importlib.metadata
import importlib.util
import json
import os
import platform
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import jax
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

PACKAGES = (
    "auvplan", "jax", "jaxlib", "numpy", "scipy", "numba", "mealpy", "evosax", "cma", "ortools", "pyvrp",
)  # fmt: skip
COMPILERS = ("cc", "gcc", "clang")
T = TypeVar("T")

#: Where tables and lines are printed, wide enough where that is a file.
screen = Console()
if not screen.is_terminal:
    screen = Console(width=120)

#: Real data lies beside the repository.
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"

#: First words of the package's commands, in processes of their own.
AUVPLAN = [sys.executable, "-m", "auvplan.cli"]


def installed(package: str) -> bool:
    """Whether an optional package can be imported."""
    return importlib.util.find_spec(package) is not None


def available(name: str, packages: Iterable[str]) -> bool:
    """Whether a contender can take part; a line where one of its packages is missing."""
    missing = " and ".join(package for package in packages if not installed(package))
    if missing:
        screen.print(f"{name}: left out, {missing} not installed: pip install 'auvplan[bench]'")
    return not missing


def compiler() -> str | None:
    """Path of a C compiler; None where there is none."""
    return next((path for name in COMPILERS if (path := shutil.which(name))), None)


def machine() -> dict[str, Any]:
    """Processor, cores, system, versions and date."""
    versions = {package: importlib.metadata.version(package) for package in PACKAGES if installed(package)}
    facts, path = Path("/proc/cpuinfo"), compiler()
    lines = facts.read_text().splitlines() if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    said = subprocess.run([path, "--version"], capture_output=True, text=True).stdout if path else ""
    return {
        "processor": names[0] if names else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "backend": jax.default_backend(),
        "versions": versions,
        "compiler": (said.splitlines() or [path])[0],
        "date": time.strftime("%Y-%m-%d"),
    }


def track(items: Iterable[T], description: str, total: int | None = None) -> Iterator[T]:
    """Yield items beside a bar that vanishes when all are done."""
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    with Progress(*columns, console=screen, transient=True) as progress:
        yield from progress.track(items, total, description=description)


def clock(call: Callable[[], Any]) -> tuple[float, Any]:
    """``(s, what the call returned)``."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call())
    return time.perf_counter() - begin, result


def take_turns(
    calls: Mapping[str, Callable[[int], Any]], rounds: Mapping[str, int], first: int
) -> dict[str, dict[str, Any]]:
    """Time calls of seeds 0, 1, ... in turns, so that all see the same machine.

    Args:
        calls: by name.
        rounds: for each of them.
        first: seed of the calls that compile.

    Returns:
        By name: median and least time of a call, how much longer the first one took, s, and all results.
    """
    times, results = {name: [] for name in calls}, {name: [] for name in calls}
    compiling = {name: clock(partial(call, first))[0] for name, call in track(calls.items(), "compiling")}
    for turn in track(range(max(rounds.values())), "turns"):
        for name, call in calls.items():
            if turn < rounds[name]:
                # The first call of a turn finds the caches as another contender left them.
                jax.block_until_ready(call(turn))
                seconds, result = clock(partial(call, turn))
                times[name].append(seconds)
                results[name].append(result)
    return {name: timed(compiling[name], times[name]) | {"results": results[name]} for name in calls}


def timed(first: float, seconds: Sequence[float]) -> dict[str, Any]:
    """Return median and least of times of a call, and how much longer the first one took, all s."""
    median = float(np.median(seconds))
    least, compiling = float(min(seconds)), max(0.0, first - median)
    return {"seconds": median, "least_seconds": least, "compile_seconds": compiling}


def arguments(description: str, prog: str | None = None) -> argparse.ArgumentParser:
    """Return a parser of a benchmark's options with `--out`, the path that `write` takes."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    return parser


def seed_range(text: str) -> range:
    """Read the seeds FIRST:END, the end left out, or one seed."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def show(
    title: str, rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str], names: int = 1, **options: Any
) -> None:
    """Print a table of rows.

    Args:
        title: above it.
        columns: heading to a format of a row's entries, such as "{gap:.2%}"; "-" where an entry is None.
        names: number of first columns that are names, to the left; repeats in the first are left blank.
        options: of all columns, as rich has them.
    """

    def cell(form: str, row: Mapping[str, Any]) -> str:
        try:
            return form.format_map(row)
        except TypeError:  # None has no format
            return "-"

    made, last = Table(title=title), None
    for number, heading in enumerate(columns):
        made.add_column(heading, justify="left" if number < names else "right", **options)
    for row in rows:
        first, *others = (cell(form, row) for form in columns.values())
        made.add_row("" if first == last else first, *others)
        last = first
    screen.print(made)


def markdown(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [
        f"| {' | '.join(heads)} |",
        "|" + "---|" * len(heads),
        *(f"| {' | '.join(row)} |" for row in rows),
    ]


def write(path: Path | None, content: dict[str, Any]) -> None:
    """Write figures and rows (dataclasses) as JSON, with the machine; nothing where no file is asked for."""
    if path is not None:
        path.write_text(json.dumps({"machine": machine(), **content}, indent=1, default=asdict) + "\n")
