"""Shared helpers of the tests."""

from pathlib import Path

import jax
import pytest

from auvplan.voyage import executive
from tests.voyage.small import light_config

# What several test processes compile alike is compiled once, and kept for the next run.
jax.config.update("jax_compilation_cache_dir", str(Path(__file__).parent.parent / ".pytest_cache" / "jax"))
jax.config.update("jax_persistent_cache_min_compile_time_secs", 1.0)

SHARED = Path(__file__).resolve().parent.parent.parent / "shared"


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
    """Path searches of the hierarchical loop become small: what is tested does not depend on their depth."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(executive, "path_config", light_config)
        yield
