"""Does the same seed give the same summary, byte for byte, whatever else differs?

`python -m benchmarks.determinism` runs one mission again and again in processes of their own: on one core
and on two, with and without XLA's threads, beside other missions in its batch, in studies here, on Dask
workers, and killed and resumed. Compared are the bytes of `summary.json` but for clock times.
"""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from auvplan.runtime.files import SUMMARY
from auvplan.study.store import PIECES, RUNS
from benchmarks import small_sea
from benchmarks.machine import AUVPLAN, arguments, screen, show, write
from benchmarks.resilience import clockless, two_workers

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


def digest(folder: Path) -> str:
    """What a summary says but for clocks."""
    stated = clockless(json.loads((folder / SUMMARY).read_bytes()))
    assert isinstance(stated, dict)
    stated.pop("sheet", None)  # that of the command, which a study does not write
    return hashlib.sha256(json.dumps(stated, indent=2).encode()).hexdigest()


def _call(command: list[str], cores: int | None = None, **environment: str) -> None:
    limited = [] if cores is None else ["taskset", "-c", ",".join(map(str, range(cores)))]
    # A mission that fails ends with status 1, and has a summary all the same.
    code = subprocess.run([*limited, *command], env={**os.environ, **environment}, stderr=subprocess.DEVNULL)
    if code.returncode not in (0, 1):
        raise RuntimeError(f"status {code.returncode}: {' '.join(command)}")


def killed_and_resumed(command: list[str], folder: Path) -> None:
    process = subprocess.Popen([*command, "--out", str(folder)], stderr=subprocess.DEVNULL)
    while process.poll() is None and not any((folder / PIECES).glob("[0-9]*.npz")):
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    _call([*command, "--out", str(folder), "--resume"])


def compared(name: str, seed: int, count: int, folder: Path) -> list[dict[str, str]]:
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
    study = [*STUDY, name, "-n", str(count), "--seed", str(seed)]
    _call([*study, "--out", str(folder / "local")])
    with two_workers() as cluster:
        _call([*study, "--out", str(folder / "dask"), "--dask", cluster.scheduler_address])
    killed_and_resumed(study, folder / "killed")
    for how in ("local", "dask", "killed"):
        runs = sorted((folder / how / RUNS).iterdir())
        note({"killed": "study, killed and resumed"}.get(how, f"study, {how}"), runs[0])
    return found


def main() -> None:
    parser = arguments("The same seed, the same summary.")
    parser.add_argument("--scenario", default="whitsunday", help="shipped one, a file, or 'small'")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-n", type=int, default=4, help="missions of a study")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        chosen = str(small_sea.write(folder)) if options.scenario == "small" else options.scenario
        found = compared(chosen, options.seed, options.n, folder)
    for row in found:
        row["same"] = "the same" if row["digest"] == found[0]["digest"] else "DIFFERENT"
    same = sum(row["same"] == "the same" for row in found)
    title = f"{options.scenario}, seed {options.seed}"
    show(title, found, {"how": "{how}", "summary": "{same}"}, names=2)
    screen.print(f"{same} of {len(found)} summaries are the same to the byte, clock times left out")
    write(options.out, {"determinism": found})
    sys.exit(same < len(found))


if __name__ == "__main__":
    main()
