"""How long a person waits for a command: the first time, with an empty cache, and later.

`python -m benchmarks.startup [--runs 3] [--study 100] [--functions 100]` times whole processes, and plans in
currents that are given as functions. *Beyond its own work* is what a command takes longer than the same call
made a second time in one process. Nothing else should run meanwhile.
"""

import os
import re
import statistics
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.harness import AUVPLAN, clock, launch, screen, show

README = Path(__file__).parent.parent / "README.md"

TWICE = """
import sys, time, auvplan.cli
for _ in range(2):
    begin = time.perf_counter()
    auvplan.cli.app(sys.argv[1:], standalone_mode=False)
    seconds = time.perf_counter() - begin
print(seconds, file=sys.stderr)
"""

#: Plans in currents that are Python functions, each another one: seconds of the first plan in each and of a
#: second one, and the most memory that the process has taken so far, MB.
OWN_CURRENTS = """
import resource, sys, time
import jax, jax.numpy as jnp, auvplan as ap

def sea(scale):
    def current(x, y, z, t):
        return 0.5 * jnp.sin(y / scale), 0.4 * jnp.cos(x / scale), 0.0
    return ap.Environment(current, lower=(-500, -2000, 0), upper=(4500, 2000, 0))

def plan(env):
    begin = time.perf_counter()
    ap.plan_path((0, 0, 0), (4000, 0, 0), env, key=jax.random.key(0))
    return time.perf_counter() - begin

for k in range(int(sys.argv[1])):
    env = sea(500.0 + 7.0 * k)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(plan(env), plan(env), peak)
"""


def call(words: list[str], folder: Path) -> tuple[float, list[str], list[str]]:
    """Wall-clock time of a process, its output and errors; a mission that fails, status 1, is one too."""
    place = {**os.environ, "AUVPLAN_CACHE": str(folder / "cache")}
    run = partial(subprocess.run, words, cwd=folder, env=place, capture_output=True, text=True)
    seconds, ended = clock(run)
    if ended.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(words)}: {ended.stderr.strip()}")
    return seconds, ended.stdout.splitlines(), ended.stderr.splitlines()


def other_counts(folder: Path) -> Path:
    """The shipped scenario in a part of its chart, with other numbers of all that it counts."""
    import auvplan as ap

    changes = {"current.vortices": 9, "simulation.obstacles": {"static": 1, "afloat": 3}}
    changes |= {"mission.waypoints": 23, "mission.neighbours": 5, "chart.window": [20, 10, 960, 970]}
    changes |= {"area.upper": [9600, 9700, 1000]}
    scenario = ap.load_scenario("whitsunday").with_(changes)
    file = folder / "other.yaml"
    file.write_text(scenario.model_dump_json(exclude_unset=True), encoding="utf-8")
    return file


def own_currents(count: int, folder: Path) -> list[dict[str, Any]]:
    """First and second plans in currents given as functions, by a process that never saw any of them.

    The cache holds what plans in another function have left in it.
    """

    def seen(count: int) -> list[list[float]]:
        _, lines, _ = call([sys.executable, "-c", OWN_CURRENTS, str(count)], folder)
        return [[float(word) for word in line.split()] for line in lines]

    (empty, *_), *_ = seen(1)
    (warm, second, _), *others = seen(1 + count)
    first = statistics.mean(row[0] for row in others)
    half, end = others[count // 2][2], others[-1][2]
    screen.print(
        f"a plan in a function, empty cache {empty:.1f} s, another process {warm:.1f} s, "
        f"a second one {second:.2f} s; "
        f"each of {len(others)} other functions {first:.2f} s; "
        f"{half:,.0f} MB after half of them, {end:,.0f} at the end"
    )
    return [{"what": "own current", "first": empty, "later": warm, "second": second, "others": first}]


def measured(runs: int, study: int, folder: Path) -> list[dict[str, Any]]:
    """First and later times of each command, in the order of a person's first day."""
    rows: list[dict[str, Any]] = []

    def take(name: str, words: list[str], own: bool = False, later: int = runs) -> None:
        first, *times = (call(words, folder)[0] for _ in range(1 + later))
        row = {"what": name, "first": first, "later": statistics.median(times or [first]), "beyond": None}
        if own:  # beyond the second of two calls in one process
            *_, said = call([sys.executable, "-c", TWICE, *words[len(AUVPLAN) :]], folder)
            row["beyond"] = row["later"] - float(said[-1])
        rows.append(row)
        screen.print("{what}, first {first:.2f}, later {later:.2f}".format(**row))

    take("mission, all pictures", [*AUVPLAN, "mission", "--out", "run"])
    take("mission, no pictures", [*AUVPLAN, "mission", "--pictures", "none", "--out", "none"])
    take("mission of other counts", [*AUVPLAN, "mission", str(other_counts(folder)), "--out", "other"])
    take("path scenario-2", [*AUVPLAN, "path", "scenario-2", "--out", "path"])
    ten = re.search(r"## Ten lines of Python\n\n```python\n(.*?)```", README.read_text(), re.DOTALL)
    assert ten is not None
    take("README's ten lines", [sys.executable, "-c", ten[1]])
    take("--help", [*AUVPLAN, "--help"])
    take("check", [*AUVPLAN, "check", "run"], own=True)
    take("validate", [*AUVPLAN, "validate", "whitsunday"], own=True)
    take("export", [*AUVPLAN, "export", "run", "--as-simulated", "--out", "files"], own=True)
    take("plot", [*AUVPLAN, "plot", "run"], own=True)
    if study:
        words = [*AUVPLAN, "montecarlo", "-n", str(study), "--force", "--out", "study"]
        (folder / "cache").rename(folder / "before")
        take(f"{study} missions", words, later=1)
    return rows


@launch(
    runs=(3, "later runs of each command; 0 for no commands"),
    study=(100, "missions of a study; 0 for none"),
    functions=(100, "currents as functions beside the first; 0 for none"),
)
def main(runs: int, study: int, functions: int) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name:
        own = own_currents(functions, Path(name)) if functions else []
        rows = measured(runs, study, Path(name)) if runs else []
    times = {"first": "{first:.1f}", "later": "{later:.1f}", "beyond its own work": "{beyond:.1f}"}
    show("wall-clock seconds of whole commands", rows, {"command": "{what}"} | times)
    return {"startup": [*own, *rows]}
