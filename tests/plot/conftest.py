"""Figures of these tests are closed: pyplot, where it is loaded, keeps those of the public functions."""

import sys

import pytest

from auvplan.plot import style


@pytest.fixture(autouse=True)
def closed_figures():
    """Close what a test has drawn."""
    yield
    if pyplot := sys.modules.get("matplotlib.pyplot"):
        pyplot.close("all")


@pytest.fixture
def coarse(monkeypatch):
    """Pictures of few pixels, where it is enough that they come about."""
    monkeypatch.setattr(style, "DPI", 50)
