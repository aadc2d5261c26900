"""Shared helpers of the tests."""

from pathlib import Path

import jax
import pytest

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
