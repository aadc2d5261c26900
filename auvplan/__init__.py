"""auvplan: mission and path planning for autonomous underwater vehicles in a moving sea, on JAX.

Local metres, north-east-down; seconds since the scenario's epoch; m/s; rad.
"""

from importlib.metadata import version

import lazy_loader

__version__ = version("auvplan")
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
