"""Intervals of shares that were counted."""

from typing import Any

import numpy as np

#: Normal quantile of two-sided 95 % intervals.
Z = 1.959964


def wilson(share: Any, count: Any) -> tuple[Any, Any]:
    """Return the ends of Wilson's 95 % interval of shares [...] in [0, 1] that were counted in [...] trials.

    Trials need not be whole numbers: of such as are alike, fewer count.
    """
    middle = (share + Z**2 / (2.0 * count)) / (1.0 + Z**2 / count)
    spread = share * (1.0 - share) / count + Z**2 / (4.0 * count**2)
    half = Z / (1.0 + Z**2 / count) * np.sqrt(spread)
    return np.clip(middle - half, 0.0, 1.0), np.clip(middle + half, 0.0, 1.0)
