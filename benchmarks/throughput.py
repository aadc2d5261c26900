"""Missions an hour: one after the other in one process, and as a study on all cores.

``python -m benchmarks.throughput [-n 100]`` runs missions of the shipped Whitsunday scenario both ways and
prints seconds a mission, compilation apart, and the most memory that the study's processes held together.
"""

import json
import os
import tempfile
import threading
import time
from pathlib import Path

import auvplan as ap
from auvplan.executive import seed_keys
from auvplan.study import Design, run_study
from benchmarks.harness import clock, launch, screen, show

#: Missions that are executed one after the other, and seconds between two looks at the memory.
SINGLES, PERIOD = 20, 3.0


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
        while not self.over.wait(PERIOD):
            self.most = max(self.most, memory(os.getpid()))


@launch(n=(100, "missions of the study"))
def main(n: int) -> None:
    watch = Watch()
    watch.start()
    with tempfile.TemporaryDirectory() as folder:
        whole, _ = clock(lambda: run_study(Design(ap.load_scenario("whitsunday"), n), folder))
        spent = json.loads((Path(folder) / "summary.json").read_text())["clock"]
    watch.over.set()
    scenario, compiled, begin = ap.load_scenario("whitsunday"), 0.0, time.perf_counter()
    for seed, key in enumerate(seed_keys(range(SINGLES))):
        compiled += ap.run_mission(scenario, key=key, seed=seed).compile_seconds
    singles, study = time.perf_counter() - begin - compiled, whole - spent["compile_s"]
    ways = (
        ("one after the other", SINGLES, compiled, singles),
        (f"a study, {spent['workers']} processes", n, spent["compile_s"], study),
    )
    names = "how", "count", "compiled", "then"
    rows = [dict(zip(names, way, strict=True)) | {"each": way[3] / way[1]} for way in ways]
    for row in rows:
        row["ratio"] = rows[0]["each"] / row["each"]
    columns = {
        "how": "{how}", "missions": "{count}", "compilation": "{compiled:.0f} s", "then": "{then:.1f} s",
        "a mission": "{each:.2f} s", "throughput": "{ratio:.2f}",
    }  # fmt: skip
    show("Missions one by one and as a study", rows, columns)
    screen.print(f"most memory of the study's processes together {watch.most / 1e9:.2f} GB")
