"""Figures of these tests are closed: pyplot, where it is loaded, keeps those of the public functions."""

import sys

import pytest


@pytest.fixture(autouse=True)
def closed_figures():
    """Close what a test has drawn."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")
