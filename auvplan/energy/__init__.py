"""Energy: what a vehicle draws by speed, what a track costs, and the speeds that cost least."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
