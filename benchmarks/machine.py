"""What figures depend on: processor, versions, compiler, optional packages, and where the real data lie."""

import importlib.metadata
import importlib.util
import os
import platform
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import jax

PACKAGES = (
    "auvplan", "jax", "jaxlib", "numpy", "scipy", "numba", "mealpy", "evosax", "cma", "ortools", "pyvrp",
)  # fmt: skip
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
