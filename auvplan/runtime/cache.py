"""Cache on disk of what takes long to compute: compiled programs, clustered charts.

An entry is named by all that it depends on; for a program these are the function and the kinds of its
arguments, the sources that programs are compiled from, the versions of Python, JAX and its compiler, the
processor, and JAX's settings. So an entry is never out of date: it is found, or it is not. One that is
damaged, or that JAX does not take, is left out, which is logged; nothing fails for it.

The folder is ``~/.cache/auvplan``. The environment variable ``AUVPLAN_CACHE`` names another one, or says
``off``. Entries not used for longest are removed where all together exceed `LIMIT`.
"""

import functools
import hashlib
import logging
import os
import pickle
import platform
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any, TypeVar

from auvplan.runtime.files import write_atomically

T = TypeVar("T")

log = logging.getLogger(__name__)

#: Bytes that all entries together may take; what a mission needs takes 25 MB.
LIMIT = 1_000_000_000

#: Settings of JAX that say nothing about programs: where things are kept and what is printed.
_SILENT = "cache", "log", "dump", "dir", "profil", "traceback", "monitor", "distributed"

#: The folder of the package whose code programs are compiled from.
HOME = Path(__file__).parents[1]

#: Packages in it that no compiled program takes code from: what changes there leaves programs as they are.
UNCOMPILED = "check", "cli", "export", "io", "plot", "report", "scenario", "study", "view"

_DIGEST = hashlib.sha256().digest_size


@dataclass(frozen=True)
class Entry:
    """One of the things kept.

    Attributes:
        path: of its file.
        name: of the function that made it.
        size: bytes.
        used: s since the epoch of the clock, when it was stored or last loaded.
    """

    path: Path
    name: str
    size: int
    used: float


def folder() -> Path | None:
    """Return where things are kept; None where they are not."""
    choice = os.environ.get("AUVPLAN_CACHE", "")
    if choice.lower() in ("off", "0", "no"):
        return None
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return Path(choice) if choice else base / "auvplan"


def enabled() -> bool:
    """Return whether anything is kept."""
    return folder() is not None


def key_of(*parts: str) -> str:
    """Return the key of what the parts and everything else that compiled code depends on say."""
    return hashlib.sha256("\n".join((_surroundings(), *parts)).encode()).hexdigest()[:32]


def kept(name: str, make: Callable[[], T], *parts: str) -> T:
    """Return what `make` returns, computed where it is not kept yet; the parts say all that it depends on."""
    if not enabled():
        return make()
    key = key_of(name, *parts)
    found = load(name, key)
    if found is None:
        found = make()
        store(name, key, found)
    return found


def holds(name: str, key: str) -> bool:
    """Return whether something is kept under a key."""
    return _path(name, key).is_file()


def load(name: str, key: str) -> Any | None:
    """Return what was stored under a key; None where there is nothing, or nothing whole."""
    path = _path(name, key)
    try:
        content = path.read_bytes()
    except OSError:
        return None
    try:
        digest, body = content[:_DIGEST], content[_DIGEST:]
        if hashlib.sha256(body).digest() != digest:
            raise ValueError("it is damaged")
        found = pickle.loads(body)
    except Exception as error:  # unpickling raises what it likes
        discard(name, key, error)
        return None
    with suppress(OSError):  # others may own the folder
        os.utime(path)
    return found


def store(name: str, key: str, value: Any) -> None:
    """Keep a value under a key, whole or not at all; where that cannot be done the log says why."""
    if not enabled():
        return
    path = _path(name, key)
    try:
        body = pickle.dumps(value)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, lambda part: part.write_bytes(hashlib.sha256(body).digest() + body))
        trim()
    except Exception as error:  # a full disk, or what cannot be pickled
        log.info("%s is not stored: %s", name, error)


def discard(name: str, key: str, error: Exception) -> None:
    """Remove an entry that could not be used, and log it."""
    log.info("a stored %s is left out and made again: %s", name, error)
    with suppress(OSError):
        _path(name, key).unlink()


def entries() -> Iterator[Entry]:
    """Yield all that is stored, in no order."""
    place = folder()
    for path in place.glob("*.pickle") if place and place.is_dir() else ():
        try:
            status = path.stat()
        except OSError:
            continue
        yield Entry(path, path.name.rsplit("-", 1)[0], status.st_size, status.st_mtime)


def trim(limit: int = LIMIT) -> list[Entry]:
    """Remove the entries not used for longest until at most `limit` bytes are left; returns those removed."""
    left = sorted(entries(), key=lambda entry: entry.used)
    total, removed = sum(entry.size for entry in left), []
    while left and total > limit:
        oldest = left.pop(0)
        with suppress(OSError):
            oldest.path.unlink()
        total -= oldest.size
        removed.append(oldest)
    return removed


def _path(name: str, key: str) -> Path:
    """Return the file of an entry; one that cannot be where nothing is kept."""
    return (folder() or Path(os.devnull)) / f"{name}-{key}.pickle"


@functools.cache
def _surroundings() -> str:
    """Return all that every entry depends on."""
    # Imported here because it takes most of a second, and showing what is kept does without it.
    import jax

    settings = {
        name: value
        for name, value in sorted(jax.config.values.items())
        if not any(word in name for word in _SILENT) and name != "jax_enable_x64"
    }
    device, processor = jax.devices()[0], f"{platform.machine()} {platform.processor()}"
    with suppress(OSError):  # make and instruction sets, where Linux lists them
        lines = Path("/proc/cpuinfo").read_text().split("\n\n")[0].splitlines()
        stated = ("model name", "flags", "Features", "CPU part")
        processor = f"{platform.machine()} {[line for line in lines if line.startswith(stated)]}"
    parts = (
        platform.python_version(),
        jax.__version__,
        version("jaxlib"),
        device.platform,
        device.device_kind,
        processor,
        os.environ.get("XLA_FLAGS", ""),
        settings,
        digest_of_sources(HOME),
    )
    return repr(parts)


def digest_of_sources(home: Path) -> str:
    """Return a digest of the code in the package's folder, as far as programs are compiled from it."""
    digest = hashlib.sha256()
    for path in sorted(home.rglob("*.py")):
        if path.relative_to(home).parts[0] not in UNCOMPILED:
            digest.update(path.read_bytes())
    return digest.hexdigest()
