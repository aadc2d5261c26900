"""Many missions: designs with paired seeds, runs that can be broken off, statistics (section 4.2)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
