"""Commands that are killed at random moments, and commands whose disk is full: what do they leave behind?

`python -m benchmarks.crashes [--kills 30] [--disks 12]` kills mission, montecarlo, export and report on a
small sea; the folder then has to hold a whole result, one that `--resume` completes, or none. plan and
mission that replace the result of an earlier run are killed over the run and while files are written; then
it has to hold the old result, the new one, or none. On small file systems (a tmpfs, else a limit on the size
of files) each has to end with status 2 and one line. Other outcomes end this with status 1.
"""

import hashlib
import json
import random
import resource
import shutil
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import xarray as xr

from auvplan.runtime.files import MISSION, SUMMARY, read_dataset
from auvplan.study.store import DATASET, is_unfinished
from benchmarks.harness import AUVPLAN, SCENARIOS, clock, launch, screen, show

COMMANDS = "mission", "montecarlo", "export", "report"

#: The commands whose results are replaced, with what makes the new run another one than the old.
REPLACED = {"plan": ("--depart", "+1h"), "mission": ("--seed", "1")}

#: Outcomes that are as they should be.
GOOD = ("whole", "resumed", "none", "old whole", "new whole", "one line, status 2", "room enough")


def command(name: str, scenario: Path, result: Path, out: Path) -> list[str]:
    """A command that writes to a folder; `result` is that of an earlier mission."""
    words = {
        "plan": ["plan", str(scenario), "--pictures", "none", "--out", str(out)],
        "mission": ["mission", str(scenario), "--pictures", "none", "--out", str(out)],
        "montecarlo": ["montecarlo", str(scenario), "-n", "3", "--workers", "1", "--out", str(out)],
        "export": ["export", str(result), "--as-simulated", "--out", str(out)],
        "report": ["report", str(out)],
    }
    return [*AUVPLAN, *words[name], "--quiet"]


def clockless(stated: object) -> object:
    """A summary without what depends on clocks."""
    if isinstance(stated, dict):
        # Eq. 16's total cost has the computing time in it.
        clocks = {name for name in stated if name.startswith("cpu") or name == "cost_total"}
        return {name: clockless(value) for name, value in stated.items() if name not in clocks}
    return [clockless(value) for value in stated] if isinstance(stated, list) else stated


def prints(folder: Path) -> dict[str, str]:
    """A digest of each file, clock times left out."""

    def stated(file: Path) -> bytes:
        if file.name == SUMMARY:
            return repr(clockless(json.loads(file.read_bytes()))).encode()
        if file.name != MISSION:
            return file.read_bytes()
        with xr.open_dataset(file, engine="h5netcdf", decode_times=False) as run:
            kept = run.drop_vars([name for name in run.variables if "cpu" in str(name)]).load()
        parts = [f"{name}{kept[name].dims}".encode() + kept[name].values.tobytes() for name in kept.variables]
        return b"".join(sorted(parts))

    return {file.name: hashlib.sha256(stated(file)).hexdigest() for file in folder.iterdir()}


def broken(folder: Path) -> str:
    """The first file of a folder, hidden ones apart, that is not a whole one of its kind; or empty."""
    for file in sorted(folder.rglob("*")):
        if not file.is_file() or any(part.startswith(".") for part in file.relative_to(folder).parts):
            continue
        try:
            if file.suffix in (".json", ".plan", ".geojson"):
                json.loads(file.read_text(encoding="utf-8"))
            elif file.suffix == ".nc":
                read_dataset(file.parent, file.name)
            elif file.suffix in (".kml", ".gpx"):
                ElementTree.parse(file)
            elif file.suffix == ".html" and not file.read_text(encoding="utf-8").rstrip().endswith("</html>"):
                return f"broken: {file.name}: cut short"
            elif file.stat().st_size == 0:
                return f"broken: {file.name}: empty"
        except Exception as error:  # whatever is wrong with it
            return f"broken: {file.name}: {' '.join(str(error).split())[:120]}"
    return ""


def _names(folder: Path) -> set[str]:
    return {file.name for file in folder.iterdir()} if folder.is_dir() else set()


def _whole(name: str, out: Path, before: set[str]) -> bool:
    needed = {"mission": {SUMMARY, MISSION}, "montecarlo": {SUMMARY, DATASET}}.get(name)
    return bool(_names(out) - before) if needed is None else needed <= _names(out)


def _prepare(name: str, result: Path, out: Path) -> set[str]:
    shutil.rmtree(out, ignore_errors=True)
    if name == "report":
        shutil.copytree(result, out)
    return _names(out)


def killed(name: str, scenario: Path, result: Path, folder: Path, kills: int) -> list[str]:
    chance, out, found = random.Random(name), folder / f"{name}-out", []
    words = command(name, scenario, result, out)
    _prepare(name, result, out)
    seconds, _ = clock(lambda: subprocess.run(words, check=False, capture_output=True))
    for _ in range(kills):
        before = _prepare(name, result, out)
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(seconds * chance.uniform(0.3, 1.02))
        process.kill()
        process.wait()
        if fault := broken(out):
            found.append(fault)
        elif name == "montecarlo" and is_unfinished(out):
            again = subprocess.run([*words, "--resume"], capture_output=True, text=True)
            good = again.returncode in (0, 1) and _whole(name, out, before) and not broken(out)
            found.append("resumed" if good else f"not resumed: {again.stderr.strip()[:120]}")
        else:
            found.append("whole" if _whole(name, out, before) else "none")
    return found


def replaced(name: str, scenario: Path, result: Path, folder: Path, kills: int) -> list[str]:
    """Outcomes of a command that replaces an earlier result, half of them killed while files are written."""
    old, new, out = (folder / f"{name}-{which}" for which in ("old", "new", "replaced"))
    for first, more in ((old, ()), (new, REPLACED[name])):
        subprocess.run([*command(name, scenario, result, first), *more], capture_output=True, check=False)
    before, after, found = prints(old), prints(new), []

    def start() -> subprocess.Popen[bytes]:
        shutil.rmtree(out, ignore_errors=True)
        shutil.copytree(old, out)
        return subprocess.Popen([*command(name, scenario, result, out), *REPLACED[name]])

    def writing(process: subprocess.Popen[bytes]) -> None:
        part = folder / f".{out.name}.{process.pid}.part"
        while process.poll() is None and not (part.is_dir() and any(part.iterdir())):
            time.sleep(0.002)

    begin, process = time.perf_counter(), start()
    writing(process)
    written = time.perf_counter()
    process.wait()
    seconds, tail = time.perf_counter() - begin, time.perf_counter() - written
    if before == after or prints(out) != after:
        raise RuntimeError(f"{name}: two runs alike differ, or two that differ are alike")
    for kill in range(kills):
        share, process = (kill + 0.5) / kills, start()
        if kill % 2 == 0:
            time.sleep(seconds * share)
        elif kill % 4 == 1:
            writing(process)
            time.sleep(tail * share)
        else:
            while (out / SUMMARY).exists() and process.poll() is None:
                pass
        process.kill()
        process.wait()
        held = prints(out)
        of_one = SUMMARY not in held and (held.items() <= before.items() or held.items() <= after.items())
        whole = "old whole" if held == before else "new whole" if held == after else ""
        found.append(whole or ("none" if of_one else "mixed"))
    return found


@contextmanager
def small_disk(folder: Path, room: int) -> Iterator[bool]:
    """A file system of so many bytes; False where none can be mounted."""
    folder.mkdir(parents=True, exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={room}", "tmpfs", str(folder)]
    mounted = subprocess.run(mount, capture_output=True).returncode == 0
    try:
        yield mounted
    finally:
        if mounted:
            subprocess.run(["umount", str(folder)], check=True)


def without_room(name: str, scenario: Path, result: Path, folder: Path, disks: int) -> list[str]:
    """Outcomes of a command on small disks, of sizes up to what it needs."""
    chance, found, disk, sized = random.Random(name), [], folder / "disk", folder / f"{name}-size"
    whole = _prepare(name, result, sized)
    subprocess.run(command(name, scenario, result, sized), capture_output=True, check=False)
    used = sum(file.stat().st_size for file in sized.rglob("*") if file.is_file())
    least = sum(file.stat().st_size for file in result.iterdir()) + 8192 if whole else 8192
    words = command(name, scenario, result, disk / "out")
    for number in range(disks):
        room = int(least + (number + chance.random()) / disks * 1.2 * max(used - least, 16384))
        with small_disk(disk, room) as mounted:
            before = _prepare(name, result, disk / "out")
            limit = None if mounted else partial(resource.setrlimit, resource.RLIMIT_FSIZE, (room, room))
            ended = subprocess.run(words, capture_output=True, text=True, preexec_fn=limit)
            lines = ended.stderr.strip().splitlines()
            if fault := broken(disk / "out"):
                found.append(fault)
            elif ended.returncode in (0, 1) and _whole(name, disk / "out", before):
                found.append("room enough")
            elif ended.returncode == 2 and len(lines) == 1:
                found.append("one line, status 2")
            else:
                found.append(f"status {ended.returncode}, {len(lines)} lines: {(lines or [''])[-1][:120]}")
        shutil.rmtree(disk, ignore_errors=True)
    return found


@launch(kills=(30, "of each command"), disks=(12, "sizes of disks for each command"))
def main(kills: int, disks: int) -> tuple[dict[str, Any], bool]:
    rows, kinds = [], {
        "killed": (killed, COMMANDS, kills),
        "killed as it replaces a result": (replaced, REPLACED, kills),
        "disk full": (without_room, COMMANDS, disks),
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenario, result = SCENARIOS / "small.yaml", folder / "result"
        subprocess.run(command("mission", scenario, result, result), capture_output=True, check=False)
        for kind, (outcomes, commands, count) in kinds.items():
            for word in commands if count else ():
                counts = dict(Counter(outcomes(word, scenario, result, folder, count)))
                said = ", ".join(f"{outcome} {times}" for outcome, times in counts.items())
                rows.append({"command": word, "kind": kind, "outcomes": counts, "times": count, "said": said})
                screen.print(f"{word}, {kind}: {said}")
    columns = {"command": "{command}", "what": "{kind}", "outcomes": "{said}", "times": "{times}"}
    show("commands that were broken off", rows, columns, names=3)
    return {"crashes": rows}, any(outcome not in GOOD for row in rows for outcome in row["outcomes"])
