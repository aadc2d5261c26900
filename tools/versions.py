"""Runs the tests with the lowest and the newest JAX and NumPy that `pyproject.toml` allows.

``python tools/versions.py [--only lowest|newest] [--python PYTHON] [--tests PATH ...] [--out FILE.json]``
makes an environment for each beside the repository's own (``.venv-lowest``, ``.venv-newest``), installs the
package there with what the tests need, and runs these. All else that is installed is the newest that goes
with the two; a newer Python may have newer ones. It ends with status 1 where tests fail.
"""

import argparse
import json
import re
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

PACKAGES = "jax", "numpy"
KINDS = "lowest", "newest"

#: What a run of the tests closes with.
_COUNT = re.compile(r"(\d+) (passed|failed|skipped|error)")


def lowest() -> list[str]:
    """Return the lower bounds of the packages as exact versions; JAX's binary part goes with it."""
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["dependencies"]
    bounds = dict(line.split(">=") for line in stated)
    return [f"{name}=={bounds[name]}" for name in PACKAGES] + [f"jaxlib=={bounds['jax']}"]


def environment(kind: str, interpreter: str) -> Path:
    """Return the interpreter of an environment with such versions, made by another where it is missing."""
    folder = ROOT / f".venv-{kind}"
    python = folder / "bin" / "python"
    if not python.is_file():
        subprocess.run([interpreter, "-m", "venv", folder], check=True)
    pinned = folder / "constraints.txt"
    pinned.write_text("\n".join(lowest() if kind == "lowest" else []) + "\n", encoding="utf-8")
    install = [python, "-m", "pip", "install", "--quiet", "--upgrade", "--upgrade-strategy", "eager"]
    subprocess.run([*install, "-c", pinned, "-e", f"{ROOT}[dev]"], check=True)
    return python


def versions(python: Path) -> dict[str, str]:
    """Return what is installed, by name."""
    code = "import sys, importlib.metadata as m; print(*map(m.version, sys.argv[1:]))"
    found = subprocess.run([python, "-c", code, *PACKAGES], capture_output=True, text=True, check=True)
    return dict(zip(PACKAGES, found.stdout.split(), strict=True))


def tested(python: Path, tests: list[str]) -> dict[str, int]:
    """Run the tests; return how many passed, failed and so on."""
    command = [python, "-m", "pytest", "-n", "2", "--dist", "worksteal", "-q", "-m", "not slow", *tests]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    last = ""
    for line in process.stdout:
        print(line, end="", flush=True)
        last = line if _COUNT.search(line) else last
    process.wait()
    return {word: int(count) for count, word in _COUNT.findall(last)}


def main() -> None:
    """Print what passed under which versions."""
    parser = argparse.ArgumentParser(description="The tests under the lowest and the newest versions.")
    parser.add_argument("--only", choices=KINDS)
    parser.add_argument("--python", default=sys.executable, help="that makes the environments")
    parser.add_argument("--tests", nargs="+", default=["tests"], help="files or folders of tests")
    parser.add_argument("--out", type=Path, help="JSON file to write")
    options = parser.parse_args()
    rows = []
    for kind in [options.only] if options.only else KINDS:
        python = environment(kind, options.python)
        found = versions(python)
        print(f"{kind}:", ", ".join(f"{name} {version}" for name, version in found.items()), flush=True)
        counts = tested(python, options.tests)
        rows.append({"kind": kind, **found, **counts})
        if options.out:
            options.out.write_text(json.dumps({"versions": rows}, indent=1) + "\n", encoding="utf-8")
    for row in rows:
        print(", ".join(f"{name} {value}" for name, value in row.items()))
    sys.exit(any(row.get("failed") or row.get("error") or not row.get("passed") for row in rows))


if __name__ == "__main__":
    main()
