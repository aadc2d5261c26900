"""Pictures of a run, after the paper's figures. No display is needed and no global state is kept."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
