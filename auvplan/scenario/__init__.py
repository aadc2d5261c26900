"""Scenarios: settings, their files and validation, and the area and waypoints that they describe."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
