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
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import jax
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

PACKAGES = [
    "auvplan",
    "jax",
    "jaxlib",
    "numpy",
    "scipy",
    "numba",
    "mealpy",
    "evosax",
    "cma",
    "ortools",
    "pyvrp",
]
WIDTH = 120
COMPILERS = ("cc", "gcc", "clang")

#: Real data lies beside the repository.
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"

#: First words of the package's commands, in processes of their own.
AUVPLAN = [sys.executable, "-m", "auvplan.cli"]


def installed(package: str) -> bool:
    """Whether an optional package can be imported."""
    return importlib.util.find_spec(package) is not None


def compiler() -> str | None:
    """Path of a C compiler; None where there is none."""
    return next((path for name in COMPILERS if (path := shutil.which(name))), None)


def machine() -> dict[str, Any]:
    """Processor, cores, system, versions and date."""
    versions = {package: importlib.metadata.version(package) for package in PACKAGES if installed(package)}
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "python": platform.python_version(),
        "backend": jax.default_backend(),
        "versions": versions,
        "compiler": _compiler_version(),
        "date": time.strftime("%Y-%m-%d"),
    }


def console() -> Console:
    """A console that is wide enough where the output goes to a file."""
    found = Console()
    return found if found.is_terminal else Console(width=WIDTH)


def bars(console: Console) -> Progress:
    """Progress bars that vanish when done."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    return Progress(*columns, console=console, transient=True)


def clock(call: Callable[[], Any]) -> tuple[float, Any]:
    """``(s, what the call returned)``."""
    begin = time.perf_counter()
    result = jax.block_until_ready(call())
    return time.perf_counter() - begin, result


@dataclass
class Turns:
    """Times of a call, s, and what it returned; the first call compiles and counts apart."""

    first: float
    seconds: list[float] = field(default_factory=list)
    results: list[Any] = field(default_factory=list)

    @property
    def median(self) -> float:
        return float(np.median(self.seconds))

    @property
    def compiling(self) -> float:
        """How much longer the first call took, s."""
        return max(0.0, self.first - self.median)


def take_turns(
    calls: Mapping[str, Callable[[int], Any]],
    rounds: Mapping[str, int],
    first: int,
    bar: Callable[[], object],
) -> dict[str, Turns]:
    """Time calls of seeds 0, 1, ... in turns, so that all see the same machine.

    Args:
        calls: by name.
        rounds: for each of them.
        first: seed of the calls that compile.
        bar: called once for each turn of each call.
    """
    found = {}
    for name, call in calls.items():
        found[name] = Turns(clock(partial(call, first))[0])
        bar()
    for turn in range(max(rounds.values())):
        for name, call in calls.items():
            bar()
            if turn < rounds[name]:
                # The first call of a turn finds the caches as another contender left them.
                jax.block_until_ready(call(turn))
                seconds, result = clock(partial(call, turn))
                found[name].seconds.append(seconds)
                found[name].results.append(result)
    return found


def arguments(description: str, prog: str | None = None) -> argparse.ArgumentParser:
    """Return a parser of a benchmark's options with `--out`, the path that `write` takes."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    return parser


def seed_range(text: str) -> range:
    """Read the seeds FIRST:END, the end left out, or one seed."""
    first, _, end = text.partition(":")
    return range(int(first), int(end) if end else int(first) + 1)


def empty_table(title: str, names: Iterable[str], figures: Iterable[str], **options: Any) -> Table:
    """Return a table with columns of names, to the left, and of figures, to the right."""
    table = Table(title=title)
    for names_or_figures, side in ((names, "left"), (figures, "right")):
        for name in names_or_figures:
            table.add_column(name, justify=side, **options)
    return table


def named_once(rows: Sequence[Any], attribute: str) -> Iterator[tuple[str, Any]]:
    """Yield each row after its name, which is blank where the row before has the same."""
    last = None
    for row in rows:
        name = getattr(row, attribute)
        yield "" if name == last else name, row
        last = name


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


def _processor() -> str:
    """Name of the processor, as far as the system tells it."""
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text().splitlines() if facts.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _compiler_version() -> str | None:
    """First line of what the C compiler says of itself."""
    path = compiler()
    if path is None:
        return None
    said = subprocess.run([path, "--version"], capture_output=True, text=True).stdout.splitlines()
    return said[0] if said else path
