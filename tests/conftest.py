"""Shared helpers of the tests."""

import ctypes
import gc
import os
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

# Most programs of the tests run once, on little: compiling them takes longer than running them slowly.
# XLA ends a process at a flag that its version has lost.
os.environ["XLA_FLAGS"] = " ".join(
    [
        os.environ.get("XLA_FLAGS", ""),
        "--xla_backend_optimization_level=0",
        "--xla_llvm_disable_expensive_passes=true",
        "--xla_cpu_parallel_codegen_split_count=1",
        "--xla_cpu_prefer_vector_width=128",
        "--xla_cpu_use_fusion_emitters=false"
        if version("jaxlib").startswith(("0.8.", "0.9.", "0.10."))
        else "",
    ]
)

import jax
import pytest

from auvplan.runtime import compiled

compiled._LEVEL, compiled._WIDTH = 0, 128  # of programs that have their own

from auvplan import cli
from auvplan.executive import context, loop
from auvplan.link import rolling
from auvplan.plot import painter, style
from auvplan.runtime.compiled import drop_programs
from tests.executive.small import LIGHT

# What several test processes compile alike is compiled once, and kept for the next run: planners' programs by
# the package itself, those of the tests' own functions by JAX.
KEPT = Path(__file__).parent.parent / ".pytest_cache"
os.environ["AUVPLAN_CACHE"] = str(KEPT / "auvplan")
jax.config.update("jax_compilation_cache_dir", str(KEPT / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 2.0)

# Programs tell which line each of their operations comes from; nobody asks for it here.
jax.config.update("jax_traceback_in_locations_limit", 0)

# Traces make many objects that live on: to look through them for garbage again and again takes a tenth of the
# time.
gc.collect()
gc.freeze()
gc.set_threshold(50_000, 20, 50)

# Tests count programs: none is compiled behind their back.
loop.warm_up = lambda *_: None

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"

#: Bytes of memory from which on compiled programs are dropped. With 6 GB of them a process is also near the
#: number of mappings that Linux gives it, and the program beyond these crashes it.
_MEMORY = 1.5e9


@pytest.fixture(scope="module", autouse=True)
def few_programs():
    """Programs of earlier modules are dropped where there are many."""
    yield
    pages = Path("/proc/self/statm")
    if pages.is_file() and int(pages.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") > _MEMORY:
        jax.clear_caches()
        drop_programs()
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)


@pytest.fixture
def x64():
    """Double precision for tests of closed forms and gradients."""
    with jax.enable_x64(True):
        yield


@pytest.fixture
def shared():
    """Folder of real charts and currents, which lies beside the repository on some machines."""
    if not SHARED.is_dir():
        pytest.skip(f"needs real data in {SHARED}")
    return SHARED


@pytest.fixture(scope="module")
def light_search():
    """Searches of the hierarchical loop become small: what is tested does not depend on their depth."""
    with pytest.MonkeyPatch.context() as patch:
        for name, light in LIGHT.items():
            patch.setattr(context, name, light)
        patch.setattr(rolling, "_PLACES", 16)
        yield


@pytest.fixture
def coarse(monkeypatch):
    """Pictures of few pixels, where it is enough that they come about."""
    monkeypatch.setattr(style, "DPI", 50)


@pytest.fixture
def call(capsys, monkeypatch):
    """A function that runs a command and returns its exit status, standard output and standard error."""

    # They draw by themselves: a process beside them takes longer to begin, and has tests of its own.
    monkeypatch.setattr(painter, "cores", SimpleNamespace(count=lambda: 1))

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["auvplan", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        return stop.value.code or 0, *capsys.readouterr()

    return run


@pytest.fixture
def refused(call):
    """A function that runs a command which refuses what it is given, and returns its one line on that."""

    def run(*arguments):
        code, out, err = call(*arguments)
        assert (code, out) == (2, "")
        assert len(err.strip().splitlines()) == 1
        return err

    return run
