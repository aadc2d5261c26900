"""The harness of the benchmarks: options, progress, turns, figures, tables, and JSON with the machine.

A benchmark is a module that ends with a `main`, which takes options as keywords, prints tables, and returns
what `--out` keeps::

    @launch(seeds=(5, "plans of each problem"))
    def main(seeds: int) -> dict[str, Any]:
"""

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
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import jax
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from auvplan.errors import AuvplanError

T = TypeVar("T")
Array = NDArray[np.floating]
Rng = np.random.Generator

PACKAGES = (
    "auvplan", "jax", "jaxlib", "numpy", "scipy", "numba", "mealpy", "evosax", "cma", "ortools", "pyvrp",
    "hj_reachability",
)  # fmt: skip
COMPILERS = ("cc", "gcc", "clang")

#: Real data lies beside the repository.
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"

#: Scenarios of the benchmarks.
SCENARIOS = Path(__file__).with_name("scenarios")

#: First words of the package's commands, in processes of their own.
AUVPLAN = [sys.executable, "-m", "auvplan"]

#: Where tables and lines are printed, wide enough where that is a file.
screen = Console()
if not screen.is_terminal:
    screen = Console(width=120)


def launch(**options: tuple[Any, ...] | dict[str, Any]) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Make the last function of a module its command, where the module is what Python was started with.

    It is called with the options of the command line. What it returns is written as JSON where `--out` says;
    it may return that and whether the benchmark failed, status 1.

    Args:
        options: ``name=(default, help)``, then choices where there are some. False is a switch, a range
            reads FIRST:END, a tuple takes several values, a type has no default; "out" replaces the usual
            one and is given to the function. A dictionary is a positional argument, as argparse has it.
    """

    def started(main: Callable[..., T]) -> Callable[..., T]:
        if main.__module__ == "__main__":
            _run(main, options)
        return main

    return started


def _run(main: Callable[..., Any], options: dict[str, tuple[Any, ...] | dict[str, Any]]) -> NoReturn:
    stated = sys.modules["__main__"].__spec__
    name = stated.name.removesuffix(".__main__") if stated else None
    text = sys.modules["__main__"].__doc__ or ""
    parser = argparse.ArgumentParser(prog=f"python -m {name}", description=text.partition("\n")[0])
    writes = "out" not in options
    for option, how in (options | ({"out": (Path, "JSON file to write")} if writes else {})).items():
        if isinstance(how, dict):
            parser.add_argument(option, **how)
        else:
            parser.add_argument(f"{'-' if len(option) == 1 else '--'}{option}", **_option(*how))
    given = vars(parser.parse_args())
    out = given.pop("out") if writes else None
    facts = machine()
    screen.print(f"{facts['processor']}, {facts['cores']} cores, jax {facts['versions']['jax']}")
    try:
        found = main(**given)
    except AuvplanError as error:
        parser.exit(2, f"{error}\n")
    content, failed = found if isinstance(found, tuple) else (found, False)
    write(out, content)
    sys.exit(failed)


def _option(default: Any, words: str, choices: Iterable[Any] | None = None) -> dict[str, Any]:
    if default is False:
        return {"action": "store_true", "help": words}
    more = {"help": words, "choices": None if choices is None else list(choices)}
    if isinstance(default, type):
        return more | {"type": default}
    if isinstance(default, tuple | list):
        return more | {"nargs": "*", "default": list(default), "type": type(default[0]) if default else str}
    return more | {"type": seed_range if isinstance(default, range) else type(default), "default": default}


def seed_range(text: str) -> range:
    """Read the seeds FIRST:END, the end left out, or one seed."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def write(path: Path | None, content: dict[str, Any] | None) -> None:
    """Write figures and rows (dataclasses) as JSON, with the machine; nothing where no file is asked for."""
    if path is not None and content is not None:
        path.write_text(json.dumps({"machine": machine(), **content}, indent=1, default=asdict) + "\n")


def earlier(path: Path | None, name: str) -> dict[str, Any]:
    """Return what an earlier run wrote under a name, for a run that goes on from it; empty without one."""
    return json.loads(path.read_text()).get(name, {}) if path is not None and path.exists() else {}


def installed(package: str) -> bool:
    """Whether an optional package can be imported."""
    return importlib.util.find_spec(package) is not None


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


def available(name: str, packages: Iterable[str]) -> bool:
    """Whether a contender can take part; a line where one of its packages is missing."""
    missing = " and ".join(package for package in packages if not installed(package))
    if missing:
        screen.print(f"{name}: left out, {missing} not installed: pip install 'auvplan[bench]'")
    return not missing


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


def clock_all(
    call: Callable[..., T], given: Iterable[tuple[Any, ...]], description: str
) -> tuple[list[float], list[T]]:
    """Clock a call with each of some arguments, beside a bar: s, and what it returned."""
    runs = [clock(partial(call, *each)) for each in track([*given], description)]
    return [seconds for seconds, _ in runs], [result for _, result in runs]


def take_turns(
    calls: Mapping[str, Callable[[int], Any]], rounds: Mapping[str, int], first: int, lasts: float = 0.0
) -> dict[str, dict[str, Any]]:
    """Time calls of seeds 0, 1, ... in turns, so that all see the same machine.

    Args:
        calls: by name.
        rounds: for each of them.
        first: seed of the calls that compile.
        lasts: s, of a turn, in which a call is repeated; at least one call.

    Returns:
        By name: median and least time of a call, how much longer the first one took, s, and all results.
    """
    times, results = {name: [] for name in calls}, {name: [] for name in calls}
    compiling = {name: clock(partial(call, first))[0] for name, call in track(calls.items(), "compiling")}
    for turn in track(range(max(rounds.values())), "turns"):
        for name, call in calls.items():
            if turn < rounds[name]:
                # The first call of a turn finds the caches as another contender left them.
                warm, result = clock(partial(call, turn))
                results[name].append(result)
                times[name] += [clock(partial(call, turn))[0] for _ in range(max(1, int(lasts / warm)))]
    return {name: timed(compiling[name], times[name]) | {"results": results[name]} for name in calls}


def timed(first: float, seconds: Sequence[float]) -> dict[str, Any]:
    """Return median and least of times of a call, and how much longer the first one took, s, and in ms."""
    median, least = float(np.median(seconds)), float(min(seconds))
    found = {"seconds": median, "least_seconds": least, "compile_seconds": max(0.0, first - median)}
    return found | {"milliseconds": 1e3 * median, "least": 1e3 * least}


def figures(values: Sequence[float]) -> dict[str, float | None]:
    """Return mean, median, least, percentiles and the greatest of some values; None of no value."""
    of = {"mean": np.mean, "median": np.median, "least": np.min, "worst": np.max}
    of |= {f"p{q}": partial(np.percentile, q=q) for q in (90, 95, 99)}
    numbers = np.asarray(values, float)
    return {name: float(call(numbers)) if numbers.size else None for name, call in of.items()}


def means(rows: Sequence[Mapping[str, Any]], names: Iterable[str]) -> dict[str, float]:
    """Return the mean of some of the figures of rows."""
    return {name: float(np.mean([row[name] for row in rows])) for name in names}


def grouped(rows: Iterable[T], keys: Callable[[T], Iterable[Hashable]]) -> dict[Any, list[T]]:
    """Return the rows of each key, in the order in which keys are met; a row may have several."""
    groups: dict[Any, list[T]] = {}
    for row in rows:
        for key in keys(row):
            groups.setdefault(key, []).append(row)
    return groups


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
    made, last = Table(title=title), None
    for number, heading in enumerate(columns):
        made.add_column(heading, justify="left" if number < names else "right", **options)
    for first, *others in _cells(rows, columns):
        made.add_row("" if first == last else first, *others)
        last = first
    screen.print(made)


def show_markdown(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> None:
    """Print a table of rows as the documentation has it; columns as `show` takes them."""
    print(*markdown([heading.strip() for heading in columns], _cells(rows, columns)), "", sep="\n")


def _cells(rows: Iterable[Mapping[str, Any]], columns: Mapping[str, str]) -> Iterator[list[str]]:
    def cell(form: str, row: Mapping[str, Any]) -> str:
        try:
            return form.format_map(row)
        except TypeError:  # None has no format
            return "-"

    for row in rows:
        yield [cell(form, row) for form in columns.values()]


def markdown(heads: Sequence[str], rows: Iterable[Sequence[Any]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in (heads, *rows)]
    return [lines[0], "|" + "---|" * len(heads), *lines[1:]]
