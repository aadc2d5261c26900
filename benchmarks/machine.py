"""What the benchmarks share: options, what their figures depend on, and how these are shown and kept."""

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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

PACKAGES = (
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
)
WIDTH = 120
COMPILERS = ("cc", "gcc", "clang")

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


def arguments(description: str, prog: str | None = None) -> argparse.ArgumentParser:
    """Return a parser of a benchmark's options with `--out`, the path that `write` takes."""
    parser = argparse.ArgumentParser(prog=prog, description=description)
    parser.add_argument("--out", type=Path, help="JSON file to write")
    return parser


def write(path: Path | None, content: dict[str, Any]) -> None:
    """Write figures as JSON, with the machine; nothing where no file is asked for."""
    if path is None:
        return
    path.write_text(json.dumps({"machine": machine(), **content}, indent=1) + "\n")


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
