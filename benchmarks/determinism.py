"""Does the same seed give the same result to the last bit, whatever else differs?

`python -m benchmarks.determinism` runs one mission again and again in processes of their own: on one core
and on two, with and without XLA's threads, beside other missions in its batch. Studies of it are run
unbroken, killed by SIGKILL at random moments and resumed, and on two Dask workers of which one is killed.
Compared are the bytes of `summary.json`, and the datasets of the studies, but for clock times.
"""

import hashlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from auvplan.runtime.files import DESIGN, SUMMARY
from auvplan.study import load_study, without_clocks
from auvplan.study.store import DATASET, PIECES, RUNS
from benchmarks.crashes import clockless
from benchmarks.harness import AUVPLAN, SCENARIOS, clock, launch, screen, show

RUN = [*AUVPLAN, "mission", "--pictures", "none", "--quiet"]
STUDY = [*AUVPLAN, "montecarlo", "--quiet", "--save-runs"]
BESIDE = """
import sys
import auvplan as ap
name, seed, beside, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
runs = ap.run_missions(ap.load_scenario(name), seeds=range(seed, seed + beside + 1))
ap.save_run(runs[0], out)
"""
ONE_THREAD = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"}

#: Shortest and longest life of a study that is killed, as shares of what the unbroken one took.
LIFE = (0.4, 1.0)


def digest(folder: Path) -> str:
    """What a summary says but for clocks."""
    stated = json.loads((folder / SUMMARY).read_bytes())
    stated.pop("sheet", None)  # that of the command, which a study does not write
    return hashlib.sha256(json.dumps(clockless(stated)).encode()).hexdigest()


def _call(command: list[str], cores: int | None = None, **environment: str) -> None:
    limited = [] if cores is None else ["taskset", "-c", ",".join(map(str, range(cores)))]
    # A mission that fails ends with status 1, and has a summary all the same.
    code = subprocess.run([*limited, *command], env={**os.environ, **environment}, stderr=subprocess.DEVNULL)
    if code.returncode not in (0, 1):
        raise RuntimeError(f"status {code.returncode}: {' '.join(command)}")


def killed_and_resumed(command: list[str], kills: int, seconds: float, folder: Path) -> list[Path]:
    """Run a study, killing it so many times in all; one that ends is followed by a new one.

    Args:
        seconds: that the unbroken study took.

    Returns:
        The folders of the studies, all of them finished.
    """
    chance, deaths, studies = random.Random(0), [], [folder / "0"]
    while len(deaths) < kills or not (studies[-1] / DATASET).is_file():
        if (studies[-1] / DATASET).is_file():
            studies.append(folder / str(len(studies)))
        resumed = ["--resume"] * (studies[-1] / DESIGN).is_file()
        process = subprocess.Popen([*command, "--out", str(studies[-1]), *resumed], stderr=subprocess.DEVNULL)
        if len(deaths) < kills:
            time.sleep(seconds * chance.uniform(*LIFE))
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
                deaths.append(len(list((studies[-1] / PIECES).glob("[0-9]*.npz"))))
        process.wait()
    screen.print(f"{len(studies)} studies killed {len(deaths)} times, missions on disk then {deaths}")
    return studies


def on_two_workers(command: list[str], seconds: float, folder: Path) -> None:
    """Run a study on two Dask workers, a process each, one of which is killed in the middle."""
    from distributed import Client, LocalCluster

    def kill(process: int) -> None:
        # A short study may be over, and its workers gone, before it is due.
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)

    alone = {"threads_per_worker": 1, "processes": True, "dashboard_address": None}
    with LocalCluster(n_workers=2, **alone) as cluster:
        with Client(cluster) as client:
            workers = list(client.run(os.getpid).values())
        threading.Timer(0.5 * seconds, kill, (workers[0],)).start()
        _call([*command, "--out", str(folder), "--dask", cluster.scheduler_address])


def compared(name: str, seed: int, count: int, kills: int, folder: Path) -> list[dict[str, str]]:
    """Digests of one mission's summary by how it came about; a study is of `count` missions."""
    found: list[dict[str, str]] = []

    def note(how: str, at: Path) -> None:
        found.append({"how": how, "digest": digest(at)})
        screen.print(f"{how}: {found[-1]['digest'][:12]}")

    mission = [*RUN, name, "--seed", str(seed), "--out"]
    for number in range(5):
        _call([*mission, str(folder / f"run-{number}")])
        note(f"run {number + 1} of 5", folder / f"run-{number}")
    for cores in (1, 2):
        for threads, flags in (("all threads", {}), ("one thread", ONE_THREAD)):
            at = folder / f"{cores}-{threads[:3]}"
            _call([*mission, str(at)], cores, **flags)
            note(f"{cores} core{'s' * (cores > 1)}, {threads}", at)
    for beside in range(1, 8):
        at = folder / f"beside-{beside}"
        _call([sys.executable, "-c", BESIDE, name, str(seed), str(beside), str(at)])
        note(f"{beside} beside it in the batch", at)
    study, first = [*STUDY, name, "-n", str(count), "--seed", str(seed)], folder / "local"
    seconds, _ = clock(lambda: _call([*study, "--out", str(first)]))
    on_two_workers(study, seconds, folder / "dask")
    broken = killed_and_resumed(study, kills, seconds, folder / "killed")
    unbroken = without_clocks(load_study(first))
    ways = {"local": [first], "one of two Dask workers killed": [folder / "dask"]}
    ways["killed and resumed"] = broken
    for how, folders in ways.items():
        for at in folders:
            note(f"study, {how}", min((at / RUNS).iterdir()))
            if not without_clocks(load_study(at)).identical(unbroken):
                found[-1]["digest"] = "another dataset"
    return found


@launch(
    scenario=("whitsunday", "shipped one, a file, or 'small'"),
    seed=(0, "of the mission"),
    n=(30, "missions of a study"),
    kills=(10, "of studies, by SIGKILL"),
)
def main(scenario: str, seed: int, n: int, kills: int) -> tuple[dict[str, Any], bool]:
    with tempfile.TemporaryDirectory() as name:
        chosen = str(SCENARIOS / "small.yaml") if scenario == "small" else scenario
        found = compared(chosen, seed, n, kills, Path(name))
    for row in found:
        row["same"] = "the same" if row["digest"] == found[0]["digest"] else "DIFFERENT"
    same = sum(row["same"] == "the same" for row in found)
    show(f"{scenario}, seed {seed}", found, {"how": "{how}", "result": "{same}"}, names=2)
    screen.print(f"{same} of {len(found)} results are the same to the byte, clock times left out")
    return {"determinism": found}, same < len(found)
