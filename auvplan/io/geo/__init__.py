"""Files of places on Earth, brought to local metres: charts, closed areas, the sea floor, jobs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
