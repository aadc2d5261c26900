"""The cases of a reader: made, read under watch, and what becomes of each."""

import contextlib
import ctypes
import json
import os
import resource
import shutil
import struct
import sys
import sysconfig
import threading
import time
import traceback
import warnings
import zoneinfo
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import jax
import joblib
import numpy as np

import auvplan
from auvplan.errors import AuvplanError
from benchmarks.apart import Late, run_apart, within
from benchmarks.fuzz.changes import change
from benchmarks.fuzz.readers import READERS, Reader, Seed

#: Processor time of a case, s; wall-clock time after which its process is ended.
SECONDS, PATIENCE = 10, 90.0
#: Memory of a case beyond what is loaded.
BYTES = 2 << 30
#: Longest line that refuses a file.
LINE = 2000
#: Outcomes that are as they should be.
GOOD = "read", "refused"

#: Files that no reader may open: none names the linked ones but from within, and only scenarios name others.
OUTSIDE = ("linked.nc", "linked.txt", "linked.geojson", "other.geojson", "other.nc")

_FORBIDDEN = (
    "subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.startfile",
    "socket.connect", "socket.getaddrinfo", "pickle.find_class", "os.remove", "os.rename",
)  # fmt: skip


@dataclass
class Watch:
    """What a reader does that it should not; `install` it once in a process."""

    found: list[str] = field(default_factory=list)  # what was done in the case under way, in words
    roots: tuple[str, ...] = ()  # folders whose files may be opened
    named: bytes = b""  # text in which files elsewhere may be named
    thread: int | None = None  # that is watched; None while no case is under way
    removing: bool = False  # whether the reader removes a folder of its own

    def install(self) -> None:
        joblib.cpu_count(only_physical_cores=True)  # asks lscpu once, at the first clustering otherwise
        sys.addaudithook(self._hear)

    @contextlib.contextmanager
    def over(self, folder: Path, names: bool) -> Iterator[None]:
        files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
        self.named = b"".join(path.read_bytes() for path in files) if names else b""
        self.roots = (*_own_folders(), str(folder), str(folder.resolve()))
        self.found, self.removing, self.thread = [], False, threading.get_ident()
        try:
            yield
        finally:
            self.thread = None

    def _hear(self, event: str, given: tuple[Any, ...]) -> None:
        if self.thread is None or threading.get_ident() != self.thread:
            return
        if event == "tempfile.mkdtemp":
            self.roots += (os.path.abspath(os.fsdecode(given[0])),)  # the reader's own
        elif event == "shutil.rmtree":
            self.removing = os.path.abspath(os.fsdecode(given[0])).startswith(self.roots)
        elif event == "open" and isinstance(given[0], str | bytes | os.PathLike):
            if not self._may_open(given[0]):
                self.found.append(f"opened {os.path.abspath(os.fsdecode(given[0]))}")
        elif event in _FORBIDDEN:
            if event in ("os.remove", "os.rename") and self._may_open(given[0]):
                return
            self.found.append(f"{event}: {str(given)[:120]}")
            if not event.startswith("pickle"):
                raise PermissionError("not while files are read")

    def _may_open(self, given: Any) -> bool:
        name = os.fsdecode(given)
        path = os.path.abspath(name)
        # What is removed with a folder is named as it is within that.
        if path.startswith(self.roots) or (self.removing and os.path.basename(name) == name):
            return True
        return os.fsencode(os.path.basename(path)) in self.named


def _own_folders() -> tuple[str, ...]:
    """Folders of Python, of packages and of the system, whose files do not depend on what is read."""
    paths = {sys.prefix, sys.base_prefix, sys.exec_prefix, *sysconfig.get_paths().values(), *zoneinfo.TZPATH}
    paths |= {path for path in sys.path if path.rstrip("/").endswith("site-packages")}
    paths |= {str(Path(auvplan.__file__).parent), str(Path(__file__).parents[1]), f"/proc/{os.getpid()}"}
    paths |= {"/usr/share", "/usr/lib", "/lib", "/proc/self", "/proc/cpuinfo", "/proc/meminfo"}
    paths |= {"/sys/devices/system/cpu", "/sys/fs/cgroup"}
    # Where JAX keeps what took it long to compile.
    paths |= {folder for folder in (jax.config.jax_compilation_cache_dir,) if folder}
    return (*sorted(paths), "/dev/null", "/dev/urandom", "/etc/localtime", "<")


class Tripwire:
    """Lists files of a folder that were opened, by libraries in C too; none but on Linux."""

    _OPENED = 0x20

    def __init__(self, folder: Path) -> None:
        self._handle = -1
        if sys.platform == "linux":
            library = ctypes.CDLL(None, use_errno=True)
            self._handle = library.inotify_init1(os.O_NONBLOCK)
            if self._handle >= 0:
                library.inotify_add_watch(self._handle, os.fsencode(folder), self._OPENED)

    def opened(self) -> list[str]:
        """Names of files that were opened since the last call."""
        content, at, found = b"", 0, set()
        with contextlib.suppress(OSError):
            content = os.read(self._handle, 1 << 16)
        while at + 16 <= len(content):
            _, mask, _, size = struct.unpack_from("iIII", content, at)
            name = content[at + 16 : at + 16 + size].rstrip(b"\0").decode()
            found |= {name} if mask & self._OPENED and name else set()
            at += 16 + size
        return sorted(found)


def write_outside(folder: Path) -> Path:
    """Write the files that no reader has any business with; the folder they are in."""
    import h5py

    outside = folder / "outside"
    outside.mkdir(parents=True)
    for name in OUTSIDE:
        if name.endswith(".nc"):
            with h5py.File(outside / name, "w") as file:
                file["secret"] = np.arange(10.0)
        else:
            ring = [[148.95, -20.33], [148.96, -20.33], [148.96, -20.32], [148.95, -20.33]]
            (outside / name).write_text(json.dumps({"type": "Polygon", "coordinates": [ring]}))
    return outside


@dataclass(frozen=True)
class Cases:
    name: str
    seeds: tuple[Seed, ...]
    folder: Path  # with a folder of each of them
    outside: Path  # a folder of files that are not to be opened
    seed: int

    @property
    def reader(self) -> Reader:
        return READERS[self.name]

    def make(self, number: int, place: Path) -> tuple[Path, str]:
        """Write a case to a folder: the file to read, and what was changed."""
        rng = np.random.default_rng([self.seed, number, *self.name.encode()])
        seed = self.seeds[number % len(self.seeds)]
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.folder / seed.name, place / seed.name)
        target = seed.targets[int(rng.integers(len(seed.targets)))]
        said = change(place / seed.name / target, rng, self.outside)
        return place / seed.name / seed.main, f"{seed.name}/{target}: {said}"


def attempt(cases: Cases, path: Path, place: Path, watch: Watch, wire: Tripwire) -> str:
    """Read a case: "read", "refused", or what is wrong."""
    wire.opened()
    with watch.over(place, cases.reader.names), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            cases.reader.read(path)
            found = "read"
        except AuvplanError as error:
            line, found = " ".join(str(error).split()), "refused"
            if "MemoryError" in line or "Unable to allocate" in line:
                found = f"memory: {line[:160]}"
            elif len(line) > LINE:
                found = f"a line of {len(line)} characters: {line[:160]}"
        except Late as error:
            found = str(error)
        except Exception as error:
            where = traceback.extract_tb(error.__traceback__)
            own = [frame for frame in where if "/auvplan/" in frame.filename] or list(where)
            spot = f"{Path(own[-1].filename).name}:{own[-1].lineno}" if own else ""
            found = f"{type(error).__name__}: {' '.join(str(error).split())[:160]} at {spot}"
    opened = [name for name in wire.opened() if not cases.reader.names or name.startswith("linked")]
    if watch.found or opened:
        return "; ".join(list(dict.fromkeys(watch.found))[:3] + [f"opened {name}" for name in opened])
    return found


def work(cases: Cases, place: Path, keep: Path, pipe: Connection) -> None:
    """Make and read cases, and report each before and after; runs in a process of its own."""
    os.environ["AUVPLAN_CACHE"] = "off"
    warnings.simplefilter("ignore")
    watch, wire = Watch(), Tripwire(cases.outside)
    watch.install()
    for seed in cases.seeds:  # what reading loads is loaded
        with contextlib.suppress(AuvplanError):
            shutil.rmtree(place, ignore_errors=True)
            shutil.copytree(cases.folder / seed.name, place / seed.name)
            cases.reader.read(place / seed.name / seed.main)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # libraries in C complain of files
    _, hard = resource.getrlimit(resource.RLIMIT_DATA)
    for number in iter(pipe.recv, None):
        path, said = cases.make(number, place)
        pipe.send(said)
        _status("VmHWM", reset=True)
        before = _status("VmRSS")
        resource.setrlimit(resource.RLIMIT_DATA, (_status("VmData") + BYTES, hard))
        try:
            with within(SECONDS):
                found = attempt(cases, path, place, watch, wire)
        except Late as error:
            found = str(error)
        finally:
            resource.setrlimit(resource.RLIMIT_DATA, (hard, hard))
        grown = max(_status("VmHWM") - before, 0)
        if grown > BYTES and found in GOOD:
            found = f"memory: {grown / 2**30:.1f} GiB"
        if found not in GOOD:
            keep_case(cases, number, said, found, place, keep)
        pipe.send((found, grown / 2**20))


def _status(name: str, reset: bool = False) -> int:
    """Bytes of memory of this process, by Linux's name; 0 elsewhere."""
    with contextlib.suppress(OSError):
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        for line in Path("/proc/self/status").read_text().splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) << 10
    return 0


def keep_case(cases: Cases, number: int, said: str, found: str, place: Path, keep: Path) -> None:
    folder = keep / f"{cases.name.replace(', ', '-').replace(' ', '-')}-{cases.seed}-{number}"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(place, folder)
    stated = {"reader": cases.name, "seed": cases.seed, "case": number, "change": said, "found": found}
    text = "".join(f"{key}: {value}\n" for key, value in stated.items())
    (folder / "case.txt").write_text(text, encoding="utf-8", errors="replace")


def fuzz(cases: Cases, minutes: float, most: int, keep: Path, first: int = 0) -> dict[str, Any]:
    """Read cases of a reader until the time is up or `most` are read; return what became of them."""
    outcomes, failures, memory = Counter(), [], 0.0
    end, place = time.monotonic() + 60.0 * minutes, cases.folder / "case"
    given, numbers = (cases, place, keep), range(first, first + most)
    became = run_apart(work, given, numbers, "spawn", PATIENCE, lambda: time.monotonic() < end)
    for number, said, found, *grown in became:
        if not grown:
            with contextlib.suppress(OSError):
                keep_case(cases, number, said, found, place, keep)
        outcomes[found if found in GOOD else "failures"] += 1
        memory = max(memory, *grown, 0.0)
        if found not in GOOD:
            failures.append({"case": number, "change": said[:300], "found": found})
    return {
        "reader": cases.name, "cases": outcomes.total(), "failed": failures[:50], "memory": round(memory, 1),
        **{name: outcomes[name] for name in (*GOOD, "failures")},
    }  # fmt: skip
