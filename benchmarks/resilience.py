"""Runs that are broken off: studies killed and resumed, or robbed of a Dask worker; results half replaced.

`python -m benchmarks.resilience [-n 30] [--kills 10]` runs a study of the shipped Whitsunday scenario
unbroken, then killed by SIGKILL at random moments and resumed, then on two Dask workers of which one is
killed, and prints whether the datasets are the same to the last bit, wall-clock times apart. `--outputs`
kills runs of `plan` and `mission` that replace the results of an earlier one: at moments spread over the
run, and while it writes its files.
"""

import argparse
import hashlib
import json
import os
import random
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import xarray as xr

import auvplan as ap
from auvplan.runtime.files import MISSION, SUMMARY
from auvplan.study import Design, load_study, run_study, without_clocks
from auvplan.study.store import DATASET, DESIGN, PIECES
from benchmarks.machine import AUVPLAN, clock, screen, show

#: Shortest and longest life of a command that is killed, as shares of what the unbroken study took.
LIFE = (0.4, 1.0)

#: What a folder holds after a kill. Neither is no result: files of one of the two runs without their summary.
HELD = ("old whole", "new whole", "neither", "mixed")

#: The commands whose results are replaced, with what makes the new run another one than the old.
OUTPUTS = {"plan": ("--depart", "+1h"), "mission": ("--seed", "1")}


def killed_and_resumed(count: int, kills: int, seconds: float, folder: Path) -> tuple[list[int], list[Path]]:
    """Run the command, killing it so many times in all; a study that ends is followed by a new one.

    Args:
        kills: in all.
        seconds: that the unbroken study took.

    Returns:
        Missions on disk at each death, and the folders of the studies, all of them finished.
    """
    chance, found, studies = random.Random(0), [], [folder / "0"]
    while len(found) < kills or not (studies[-1] / DATASET).is_file():
        if (studies[-1] / DATASET).is_file():
            studies.append(folder / str(len(studies)))
        command = [*AUVPLAN, "montecarlo", "-n", str(count), "--quiet"]
        command += ["--out", str(studies[-1])] + ["--resume"] * (studies[-1] / DESIGN).is_file()
        process = subprocess.Popen(command)
        if len(found) < kills:
            time.sleep(seconds * chance.uniform(*LIFE))
            if process.poll() is None:
                process.send_signal(signal.SIGKILL)
                found.append(len(list((studies[-1] / PIECES).glob("[0-9]*.npz"))))
        process.wait()
    return found, studies


def two_workers() -> Any:
    """A cluster of two Dask workers on this machine, a process each."""
    from distributed import LocalCluster

    return LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None)


def on_a_cluster(count: int, folder: Path) -> xr.Dataset:
    """The study on two Dask workers, one of which is killed in the middle."""
    from distributed import Client

    def kill(process: int) -> None:
        # A short study may be over, and its workers gone, before it is due.
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)

    with two_workers() as cluster:
        with Client(cluster) as client:
            workers = list(client.run(os.getpid).values())
        threading.Timer(45.0, kill, (workers[0],)).start()
        design = Design(ap.load_scenario("whitsunday"), count)
        return run_study(design, folder, dask=cluster.scheduler_address)


def same(one: xr.Dataset, other: xr.Dataset) -> str:
    return "identical" if without_clocks(one).identical(without_clocks(other)) else "DIFFERENT"


def prints(folder: Path) -> dict[str, str]:
    """A digest of each file: of its bytes, or of what it says but clock times where it tells these."""
    return {file.name: hashlib.sha256(_stated(file)).hexdigest() for file in folder.iterdir()}


def _stated(file: Path) -> bytes:
    if file.name == SUMMARY:
        return repr(clockless(json.loads(file.read_bytes()))).encode()
    if file.name == MISSION:
        with xr.open_dataset(file, engine="h5netcdf", decode_times=False) as run:
            kept = run.drop_vars([name for name in run.variables if "cpu" in str(name)]).load()
        parts = [f"{name}{kept[name].dims}".encode() + kept[name].values.tobytes() for name in kept.variables]
        return b"".join(sorted(parts))
    return file.read_bytes()


def clockless(stated: object) -> object:
    """A summary without what depends on clocks."""
    if isinstance(stated, dict):
        # Eq. 16's total cost has the computing time in it.
        clocks = {name for name in stated if name.startswith("cpu") or name == "cost_total"}
        return {name: clockless(value) for name, value in stated.items() if name not in clocks}
    return [clockless(value) for value in stated] if isinstance(stated, list) else stated


def held(found: dict[str, str], old: dict[str, str], new: dict[str, str]) -> str:
    """Which of `HELD` the digests of a folder's files are."""
    if found in (old, new):
        return HELD[0] if found == old else HELD[1]
    of_one = found.items() <= old.items() or found.items() <= new.items()
    return HELD[2] if SUMMARY not in found and of_one else HELD[3]


def outputs_killed(name: str, kills: int, scenario: Path, folder: Path) -> dict[str, dict[str, int]]:
    """Kill a command that replaces the results of an earlier one.

    Args:
        kills: of each kind.
        scenario: file that both runs are of.

    Returns:
        How often the folder held what, see `HELD`, for each kind of moment.
    """
    command = [*AUVPLAN, name, str(scenario), "--quiet", "--pictures", "none", "--out"]
    old, new, target = folder / f"{name}-old", folder / f"{name}-new", folder / f"{name}-out"
    subprocess.run([*command, str(old)], check=True)
    subprocess.run([*command, str(new), *OUTPUTS[name]], check=True)
    before, after = prints(old), prints(new)
    command += [str(target), *OUTPUTS[name]]

    def start() -> subprocess.Popen[bytes]:
        shutil.rmtree(target, ignore_errors=True)
        shutil.copytree(old, target)
        return subprocess.Popen(command)

    def writing(process: subprocess.Popen[bytes]) -> None:
        part = folder / f".{target.name}.{process.pid}.part"
        while process.poll() is None and not (part.is_dir() and any(part.iterdir())):
            time.sleep(0.002)

    begin, process = time.perf_counter(), start()
    writing(process)
    written = time.perf_counter()
    process.wait()
    seconds, tail = time.perf_counter() - begin, time.perf_counter() - written
    if before == after or prints(target) != after:
        raise RuntimeError(f"{name}: two runs alike differ, or two that differ are alike")
    counts = {kind: dict.fromkeys(HELD, 0) for kind in ("over the run", "while files are written")}
    for kill in range(2 * kills):
        kind = list(counts)[kill // kills]
        share, process = (kill % kills + 0.5) / kills, start()
        if kill < kills:
            time.sleep(seconds * share)
        elif kill % 2:
            writing(process)
            time.sleep(tail * share)
        else:
            while (target / SUMMARY).exists() and process.poll() is None:
                pass
        process.kill()
        process.wait()
        counts[kind][held(prints(target), before, after)] += 1
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description="Runs that are broken off.")
    parser.add_argument("-n", type=int, default=30, help="missions of a study")
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--outputs", action="store_true", help="kill runs that replace earlier results")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if options.outputs:
            scenario = folder / "example" / "scenario.yaml"
            subprocess.run([*AUVPLAN, "init", str(scenario.parent)], check=True, stdout=subprocess.DEVNULL)
            rows = []
            for command in OUTPUTS:
                for kind, counts in outputs_killed(command, options.kills, scenario, folder).items():
                    rows.append({"command": command, "killed": f"{options.kills} times {kind}"} | counts)
            columns = {heading: f"{{{heading}}}" for heading in ("command", "killed", *HELD)}
            show("results of an earlier run, after a kill of a new one", rows, columns, names=2)
            return
        design = Design(ap.load_scenario("whitsunday"), options.n)
        seconds, unbroken = clock(lambda: run_study(design, folder / "unbroken"))
        on_disk, studies = killed_and_resumed(options.n, options.kills, seconds, folder / "killed")
        said = ", ".join(sorted({same(unbroken, load_study(study)) for study in studies}))
        deaths = f"{len(studies)} studies killed {len(on_disk)} times"
        screen.print(f"{deaths}, missions on disk then {on_disk}: {said}")
        said = same(unbroken, on_a_cluster(options.n, folder / "dask"))
        screen.print(f"Dask, one of two workers killed: {said}")


if __name__ == "__main__":
    main()
