"""Check what would be released: types, wheel and sdist, an installation elsewhere, a mission run there.

`python tools/check_release.py` ends with status 1 at the first thing that is wrong. The wheel is installed
into an empty environment in a temporary folder, so that nothing of the repository stands in for what it
lacks.
"""

import json
import os
import subprocess
import sys
import tarfile
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: Per cent of the exported symbols whose types pyright knows, at least.
TYPED = 95.0
#: What a source distribution needs beside the package.
SOURCES = (
    "LICENSE", "README.md", "CHANGELOG.md", "CITATION.cff", "Makefile", "constraints.txt", "pyproject.toml",
)  # fmt: skip

#: Prints what is installed, the largest first.
SIZES = """
from importlib.metadata import distributions
rows = []
for one in distributions():
    paths = [file.locate() for file in one.files or () if not str(file).endswith(".pyc")]
    rows.append((sum(path.stat().st_size for path in paths if path.is_file()) / 1e6, one.name))
rows.sort(reverse=True)
print(f"{len(rows)} distributions, {sum(size for size, _ in rows):.0f} MB:",
      ", ".join(f"{name} {size:.0f}" for size, name in rows if size >= 5.0))
"""


def main() -> None:
    """Check everything, a line each."""
    check_types()
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        run(sys.executable, "-m", "build", "--outdir", str(home), str(ROOT))
        check_contents(home)
        check_installed(home)
    print("ready")


def check_types() -> None:
    """Compare the completeness of types with the bar."""
    words = ["pyright", "--verifytypes", "auvplan", "--ignoreexternal", "--outputjson"]
    found = subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, cwd=ROOT)
    score = 100.0 * json.loads(found.stdout)["typeCompleteness"]["completenessScore"]
    tell(score >= TYPED, f"types: {score:.1f} % known, {TYPED:g} % asked for")


def check_contents(home: Path) -> None:
    """Look for every tracked file of the package in the wheel, and for the sources in the sdist."""
    listed = subprocess.run(
        ["git", "ls-files", "auvplan"], capture_output=True, text=True, cwd=ROOT, check=True
    )
    tracked = set(listed.stdout.split())
    (wheel,), (sdist,) = home.glob("*.whl"), home.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        lacking = tracked - set(archive.namelist())
    tell_lacking(wheel, lacking)
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    tell_lacking(sdist, (tracked | set(SOURCES)) - names)


def check_installed(home: Path) -> None:
    """Install the wheel into an empty environment, and run a mission there."""
    (wheel,) = home.glob("*.whl")
    venv.create(home / "env", with_pip=True)
    binaries, away = home / "env" / "bin", home / "away"
    away.mkdir()
    constraints = str(ROOT / "constraints.txt")
    run(str(binaries / "pip"), "install", "--quiet", "-c", constraints, str(wheel), cwd=away)
    run(str(binaries / "pip"), "check", cwd=away)
    sizes = subprocess.run([binaries / "python", "-c", SIZES], capture_output=True, text=True, cwd=away)
    tell(not sizes.returncode, sizes.stdout.strip() or sizes.stderr)
    run(str(binaries / "auvplan"), "mission", "--pictures", "none", "--quiet", "--out", "out", cwd=away)
    summary = json.loads((away / "out" / "summary.json").read_text(encoding="utf-8"))
    tell(summary["success"], f"mission: {summary['reason']}, {summary['tasks']} tasks")
    run(str(binaries / "auvplan"), "report", "out", cwd=away)
    page = (away / "out" / "report.html").stat().st_size
    tell(page < 5_000_000, f"report: {page / 1e6:.1f} MB")
    run(str(binaries / "auvplan"), "init", "mine", cwd=away)
    run(str(binaries / "auvplan"), "validate", "mine/scenario.yaml", cwd=away)


def run(*words: str, cwd: Path = ROOT) -> None:
    """Run a command without the repository in its path; end where it fails."""
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(words, capture_output=True, text=True, cwd=cwd, env=clean)
    named = " ".join([Path(words[0]).name, *words[1:]])
    tell(done.returncode == 0, named if done.returncode == 0 else f"{named}\n{done.stdout}{done.stderr}")


def tell_lacking(file: Path, lacking: set[str]) -> None:
    """Tell a distribution's size, and what is not in it."""
    tell(
        not lacking, f"{file.name}: {file.stat().st_size / 1e3:,.0f} kB, lacks {sorted(lacking) or 'nothing'}"
    )


def tell(right: bool, words: str) -> None:
    """Print a line; end where it tells of a fault."""
    print(("ok    " if right else "wrong ") + words, flush=True)
    if not right:
        sys.exit(1)


if __name__ == "__main__":
    main()
