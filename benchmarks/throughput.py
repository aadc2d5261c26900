"""Missions an hour: one after the other in one process, and as a study on all cores.

``python -m benchmarks.throughput [-n 100]`` runs missions of the shipped Whitsunday scenario both ways and
prints seconds a mission, compilation apart, and the most memory that the study's processes held together.
"""

import argparse
import json
import os
import tempfile
import threading
import time
from pathlib import Path

import jax

import auvplan as ap
from auvplan.executive import seed_keys
from auvplan.study import Design, run_study
from benchmarks.machine import console, empty_table

#: Missions that are executed one after the other, and seconds between two looks at the memory.
SINGLES, PERIOD = 20, 3.0


def one_after_the_other(count: int) -> tuple[float, float]:
    """Seconds a mission without compilation, and of compilation, of missions by `run_mission`."""
    scenario = ap.load_scenario("whitsunday")
    begin, compile_seconds = time.perf_counter(), 0.0
    for seed, key in enumerate(seed_keys(range(count))):
        compile_seconds += ap.run_mission(scenario, key=key, seed=seed).compile_seconds
    return (time.perf_counter() - begin - compile_seconds) / count, compile_seconds


def memory(process: int) -> int:
    """Bytes that a process and its children hold, shared ones counted once; 0 where Linux does not tell."""
    try:
        rows = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
        children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    except OSError:
        return 0
    own = sum(1024 * int(row.split()[1]) for row in rows if row.startswith("Pss:"))
    return own + sum(memory(int(child)) for child in children)


class Watch(threading.Thread):
    """Follows the memory of this process and its children."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.most, self.over = 0, threading.Event()

    def run(self) -> None:
        """Look until it is over."""
        while not self.over.wait(PERIOD):
            self.most = max(self.most, memory(os.getpid()))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Missions one by one and as a study.")
    parser.add_argument("-n", type=int, default=100, help="missions of the study")
    options = parser.parse_args()
    watch = Watch()
    watch.start()
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        design = Design(ap.load_scenario("whitsunday"), options.n)
        run_study(design, folder)
        whole = time.perf_counter() - begin
        clock = json.loads((Path(folder) / "summary.json").read_text())["clock"]
    watch.over.set()
    single, compiled = one_after_the_other(SINGLES)
    study = whole - clock["compile_s"]
    figures = ("missions", "compilation", "then", "a mission", "throughput")
    shown = empty_table(f"{os.cpu_count()} cores, {jax.default_backend()}", ["how"], figures)
    shown.add_row(
        "one after the other", str(SINGLES), f"{compiled:.0f} s", f"{single * SINGLES:.1f} s",
        f"{single:.2f} s", "1",
    )  # fmt: skip
    shown.add_row(
        f"a study, {clock['workers']} processes", str(options.n), f"{clock['compile_s']:.0f} s",
        f"{study:.1f} s", f"{study / options.n:.2f} s", f"{single / (study / options.n):.2f}",
    )  # fmt: skip
    shown.caption = f"most memory of the study's processes together {watch.most / 1e9:.2f} GB"
    console().print(shown)


if __name__ == "__main__":
    main()
