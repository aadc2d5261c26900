"""Currents from files of ocean models."""

from auvplan.io.currents.ocean import OceanData, open_ocean
from auvplan.io.currents.reader import CurrentFile, read_current
from auvplan.ocean.gridded import CurrentError

__all__ = ["CurrentError", "CurrentFile", "OceanData", "open_ocean", "read_current"]
