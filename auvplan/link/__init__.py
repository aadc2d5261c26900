"""Real vehicles: a mission is uploaded over a link, followed, re-planned and brought to a safe end."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
