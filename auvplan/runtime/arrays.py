"""What arrays are called in signatures, where their shapes and units are said beside them; vectors turned."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Numbers of any precision, on the host.
Array = NDArray[np.floating]


def turned(first: ArrayLike, second: ArrayLike, angle: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return two components of vectors turned by an angle, rad, from the first axis towards the second."""
    cos, sin, first, second = np.cos(angle), np.sin(angle), np.asarray(first), np.asarray(second)
    return first * cos - second * sin, first * sin + second * cos
