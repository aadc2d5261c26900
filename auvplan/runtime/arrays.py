"""What arrays are called in signatures, where their shapes and units are said beside them."""

import numpy as np
from numpy.typing import NDArray

#: Numbers of any precision, on the host.
Array = NDArray[np.floating]
