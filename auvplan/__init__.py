"""auvplan: mission and path planning for autonomous underwater vehicles in time-varying currents, on JAX.

Local metres, north-east-down; seconds since the scenario's epoch; m/s; rad.
"""

from importlib.metadata import version as _version

import lazy_loader as _lazy_loader

__version__ = _version("auvplan")
__getattr__, _, __all__ = _lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __dir__() -> list[str]:
    return list(__all__)
