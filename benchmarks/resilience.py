"""Studies that are broken off: killed at random moments and resumed, or robbed of a Dask worker.

``python -m benchmarks.resilience [-n 30] [--kills 10]`` runs a study of the shipped Whitsunday scenario
unbroken, then again with the command killed by SIGKILL at random moments and resumed, then on two Dask
workers of which one is killed. It prints whether the datasets are the same to the last bit, wall-clock times
apart.
"""

import argparse
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

import xarray as xr

import auvplan as ap
from auvplan.study import Design, load_study, run_study, without_clocks
from auvplan.study.store import DATASET, DESIGN, PIECES
from benchmarks.machine import console

#: Shortest and longest life of a command that is killed, as shares of what the unbroken study took.
LIFE = (0.4, 1.0)


def killed_and_resumed(count: int, kills: int, seconds: float, folder: Path) -> tuple[list[int], list[Path]]:
    """Run the command, killing it so many times in all; a study that ends is followed by a new one.

    Args:
        count: missions of a study.
        kills: in all.
        seconds: that the unbroken study took.
        folder: of all studies.

    Returns:
        Missions on disk at each death, and the folders of the studies, all of them finished.
    """
    chance, found, studies = random.Random(0), [], [folder / "0"]
    while len(found) < kills or not (studies[-1] / DATASET).is_file():
        if (studies[-1] / DATASET).is_file():
            studies.append(folder / str(len(studies)))
        command = [sys.executable, "-m", "auvplan.cli", "montecarlo", "-n", str(count), "--quiet"]
        command += ["--out", str(studies[-1])] + ["--resume"] * (studies[-1] / DESIGN).is_file()
        process = subprocess.Popen(command)
        if len(found) < kills:
            time.sleep(seconds * chance.uniform(*LIFE))
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
                found.append(len(list((studies[-1] / PIECES).glob("[0-9]*.npz"))))
        process.wait()
    return found, studies


def on_a_cluster(count: int, folder: Path) -> xr.Dataset:
    """The study on two Dask workers, one of which is killed in the middle."""
    from distributed import Client, LocalCluster

    design = Design(ap.load_scenario("whitsunday"), count)
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            workers = list(client.run(os.getpid).values())
        threading.Timer(45.0, _kill, (workers[0],)).start()
        return run_study(design, folder, dask=cluster.scheduler_address)


def _kill(process: int) -> None:
    # A short study may be over, and its workers gone, before it is due.
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


def same(one: xr.Dataset, other: xr.Dataset) -> str:
    """Words for whether two datasets agree."""
    return "identical" if without_clocks(one).identical(without_clocks(other)) else "DIFFERENT"


def main() -> None:
    """Print what was compared."""
    parser = argparse.ArgumentParser(description="Studies that are broken off.")
    parser.add_argument("-n", type=int, default=30, help="missions of a study")
    parser.add_argument("--kills", type=int, default=10)
    options = parser.parse_args()
    screen = console()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        begin = time.perf_counter()
        unbroken = run_study(Design(ap.load_scenario("whitsunday"), options.n), folder / "unbroken")
        seconds = time.perf_counter() - begin
        on_disk, studies = killed_and_resumed(options.n, options.kills, seconds, folder / "killed")
        said = {same(unbroken, load_study(study)) for study in studies}
        screen.print(
            f"{len(studies)} studies killed {len(on_disk)} times, missions on disk then {on_disk}: "
            f"{', '.join(sorted(said))}"
        )
        screen.print(
            f"Dask, one of two workers killed: {same(unbroken, on_a_cluster(options.n, folder / 'dask'))}"
        )


if __name__ == "__main__":
    main()
