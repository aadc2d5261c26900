"""Short representations of results: one line at a prompt, a small table in a notebook."""

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike


class Brief:
    """A result that tells what matters of it; subclasses say what that is in `_facts`."""

    def _facts(self) -> dict[str, str]:
        """Words for each figure, with its unit; the first one is how it ended."""
        raise NotImplementedError

    def __repr__(self) -> str:
        parts = (f"{name} {value}" if name else value for name, value in self._facts().items())
        return f"<{type(self).__name__}: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><td style="text-align:left">{escape(name)}</td>'
            f'<td style="text-align:left">{escape(value)}</td></tr>'
            for name, value in self._facts().items()
        )
        return f"<table><thead><tr><th colspan=2>{type(self).__name__}</th></tr></thead>{rows}</table>"


def between(values: ArrayLike) -> str:
    """Return the least and the greatest of the finite values, to whole numbers.

    Example:
        >>> between([812.4, 1530.0, float("inf")]), between([12.0]), between([])
        ('812 to 1,530', '12', 'no')
    """
    found = np.asarray(values, float)
    found = found[np.isfinite(found)]
    if not found.size:
        return "no"
    low, high = (f"{value:,.0f}" for value in (found.min(), found.max()))
    return low if low == high else f"{low} to {high}"


def shortened(names: Sequence[str], most: int = 12) -> str:
    """Return names in order, those in the middle left out where there are many.

    Example:
        >>> shortened(["0", "4", "2"]), shortened([str(k) for k in range(40)], most=4)
        ('0 > 4 > 2', '0 > 1 > ... > 38 > 39')
    """
    half = most // 2
    shown = list(names) if len(names) <= most else [*names[:half], "...", *names[-half:]]
    return " > ".join(shown)
