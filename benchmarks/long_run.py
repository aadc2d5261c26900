"""Thousands of missions in one process: does memory stay flat, and is nothing compiled twice or left open?

`python -m benchmarks.long_run [-n 2000] [--sea vortices]` simulates missions of one sea, and saves every
twentieth and reads it again. The first tenth is warm-up. It ends with status 1 where a program was compiled
twice, a file was left open, or memory grew by more than a tenth. The figures of other seas in the file are
kept.
"""

import gc
import logging
import os
import tempfile
from pathlib import Path

import jax
import numpy as np

import auvplan as ap
from auvplan.executive import execute_missions
from auvplan.runtime.compiled import compilations
from benchmarks import clock
from benchmarks.harness import SCENARIOS, earlier, launch, screen, show, write

#: Missions between two rows, and between two that are saved.
EVERY, SAVED = 50, 20
TOGETHER = 8
SEAS = {"vortices": "small sea", "tide": "harmonic tide"}


class Compiled(logging.Handler):
    """What JAX says that it compiles: names of programs, with the shapes of their arguments."""

    def __init__(self) -> None:
        super().__init__()
        self.warm = False
        self.seen: set[str] = set()
        self.again: list[str] = []
        jax.config.update("jax_log_compiles", True)
        for name in ("jax._src.interpreters.pxla", "jax._src.dispatch", "jax._src.compiler"):
            logging.getLogger(name).propagate = False
        logging.getLogger("jax._src.interpreters.pxla").addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """Count a program."""
        if not (text := record.getMessage()).startswith("Compiling"):
            return
        # Programs of other settings have the same shapes: all of these are met in the warm-up.
        if self.warm and text in self.seen:
            self.again.append(text)
        self.seen.add(text)


def watched(sea: str, count: int, compiled: Compiled) -> list[dict[str, float]]:
    """Simulate missions; return a row every `EVERY` of them: memory in MiB, programs, open files."""
    rows, late = [], 0
    with tempfile.TemporaryDirectory() as name:
        if sea == "vortices":
            scenario = ap.load_scenario(SCENARIOS / "small.yaml")
        else:
            scenario = clock.seas(Path(name))[0].with_({"planning.departures": 24})
        missions = execute_missions(scenario, seeds=range(count), together=TOGETHER)
        for done, (_, run) in enumerate(missions, 1):
            compiled.warm = done >= count / 10
            late += not run.success
            if done % SAVED == 0:
                ap.save_run(run, name)
                ap.restore_run(name)
            if done % EVERY == 0 or done == count:
                gc.collect()
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                row = {"missions": done, "memory": pages * os.sysconf("SC_PAGE_SIZE") / 2**20}
                # The file that this takes to look is left out.
                row |= {"programs": compilations(), "files": len(os.listdir("/proc/self/fd")) - 1}
                rows.append(row | {"failed": late})
                screen.print(", ".join(f"{key} {value:.0f}" for key, value in rows[-1].items()))
    return rows


@launch(
    out=(Path, "JSON file to write; the figures of other seas there are kept"),
    n=(2000, "missions"),
    sea=("vortices", "that they are in", SEAS),
)
def main(out: Path | None, n: int, sea: str) -> tuple[None, bool]:
    compiled = Compiled()
    rows = watched(sea, n, compiled)
    later = [row for row in rows if row["missions"] >= n / 10]
    warm, last = later[0], rows[-1]
    words = {
        "missions": "missions", "memory": "memory, MiB", "programs": "programs compiled",
        "files": "files open", "failed": "missions failed",
    }  # fmt: skip
    shown = [{"what": words[name], "warm": warm[name], "last": last[name]} for name in words]
    columns = {"": "{what}", "after warm-up": "{warm:.0f}", "at the end": "{last:.0f}"}
    show(f"{last['missions']} missions, {SEAS[sea]}", shown, columns)
    slope = np.polyfit([row["missions"] for row in later], [row["memory"] for row in later], 1)[0]
    screen.print(f"memory grows by {1000.0 * slope:.1f} MiB per 1,000 missions after warm-up")
    for text in compiled.again:
        screen.print(f"twice: {text[:200]}", markup=False)
    last["twice"] = len(compiled.again)
    write(out, {"long_run": earlier(out, "long_run") | {SEAS[sea]: rows}})
    grew = last["memory"] > 1.1 * warm["memory"]
    return None, bool(grew or compiled.again or last["files"] > warm["files"])
