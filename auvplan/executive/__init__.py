"""Planning meets a moving world: the truth, the belief, and the loop between them (Fig. 7)."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
