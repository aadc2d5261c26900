"""Numbers, their nouns, durations and results, as people read them."""

import math
import re
from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: What bounds add for rounding at most where there is nothing to gain.
_NOTHING = 1e-8

#: What XML 1.0 does not know as characters.
_FORBIDDEN = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def counted(count: int, noun: str) -> str:
    """Return a number and its noun, in the plural where there is not one.

    Example:
        >>> counted(1, "leg"), counted(1200, "mission"), counted(2, "entry")
        ('1 leg', '1,200 missions', '2 entries')
    """
    if count == 1:
        return f"1 {noun}"
    many = f"{noun[:-1]}ies" if noun.endswith("y") and noun[-2:-1] not in "aeiou" else f"{noun}s"
    return f"{count:,} {many}"


def figure(value: float, digits: int = 3) -> str:
    """Return a number to some significant digits, all of those before the point, never with an exponent.

    Example:
        >>> figure(12345.678), figure(0.012345), figure(98.0), figure(0.0)
        ('12,346', '0.0123', '98', '0')
    """
    if not math.isfinite(value) or value == 0.0:
        return "0" if value == 0.0 else str(value)
    places = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{places}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def apart(value: float, limit: float, digits: int = 1) -> tuple[str, str]:
    """Return both numbers with the fewest decimal places, `digits` at least, that distinguish them.

    A limit that is not zero is not shown as zero.

    Example:
        >>> apart(45.0, 30.0, digits=0), apart(59.8, 60.0, digits=0), apart(59.996, 60.0)
        (('45', '30'), ('59.8', '60.0'), ('59.996', '60.000'))
    """
    for places in range(digits, 4):
        own, most = f"{value:.{places}f}", f"{limit:.{places}f}"
        if own != most and (float(most) or not limit):
            return own, most
    return f"{value:.4g}", f"{limit:.4g}"


def rounded_up(bound: float) -> float:
    """Return an upper bound to nine digits, rounded up but for what sums in double precision are off.

    Example:
        >>> rounded_up(12.000000000004), rounded_up(12.3456789123), rounded_up(1.3e-12)
        (12.0, 12.345679, 0.0)
    """
    if not math.isfinite(bound) or bound <= 0.0:
        return bound
    if bound < _NOTHING:
        return 0.0
    digits = 8 - math.floor(math.log10(bound))
    return round(math.ceil(bound * 10.0**digits - 0.01) / 10.0**digits, digits)


def hours(seconds: float) -> str:
    """Return a duration in hours and minutes.

    Example:
        >>> hours(10452.0), hours(-90.0), hours(-20.0)
        ('2 h 54 min', '-0 h 02 min', '0 h 00 min')
    """
    minutes = round(abs(seconds) / 60.0)
    return f"{'-' if seconds < 0.0 < minutes else ''}{minutes // 60} h {minutes % 60:02d} min"


def depth(metres: float) -> str:
    """Return a depth in whole metres, halves as the greater one; of less than 10 m with tenths that it has.

    Example:
        >>> depth(2.5), depth(5.0), depth(9.97), depth(12.5), depth(0.0)
        ('2.5', '5', '10', '13', '0')
    """
    if metres < 9.95 and (text := f"{metres:.1f}")[-1] != "0":
        return text
    return f"{math.floor(metres + 0.5)}"


def clearance(metres: float | None, accuracy: float = 0.0, reach: float = math.inf) -> str:
    """Return a least distance in whole metres, no finer than what it is to is known; empty for None.

    Args:
        metres: the distance.
        accuracy: m, of what it is to; the distance is rounded down to it.
        reach: m, greatest distance that is looked for.

    Example:
        >>> clearance(467.9), clearance(467.9, 1000.0), clearance(3725.0, 1000.0), clearance(5e3, reach=5e3)
        ('468', '< 1,000', '3,000', '> 5,000')
    """
    if metres is None:
        return ""
    if metres >= reach:
        return f"> {reach:,.0f}"
    if 0.0 <= metres < accuracy:
        return f"< {accuracy:,.0f}"
    return f"{accuracy * (metres // accuracy) if accuracy > 0.0 else metres:,.0f}"


def plain(text: str) -> str:
    """Return text with question marks for what is no character to XML 1.0, and to most other formats."""
    return _FORBIDDEN.sub("?", text)


class ReprMixin:
    """A result that is shown by its main figures; subclasses give them in `_repr_items`."""

    def _repr_items(self) -> dict[str, str]:
        """Words for each figure, with its unit; the first one is how it ended."""
        raise NotImplementedError

    def __repr__(self) -> str:
        parts = (f"{name} {value}" if name else value for name, value in self._repr_items().items())
        return f"<{type(self).__name__}: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        rows = "".join(
            f'<tr><td style="text-align:left">{escape(name)}</td>'
            f'<td style="text-align:left">{escape(value)}</td></tr>'
            for name, value in self._repr_items().items()
        )
        return f"<table><thead><tr><th colspan=2>{type(self).__name__}</th></tr></thead>{rows}</table>"


def between(values: "ArrayLike", digits: int = 0) -> str:
    """Return the least and the greatest of the finite values, to `digits` decimal places.

    Example:
        >>> between([812.4, 1530.0, float("inf")]), between([12.0]), between([])
        ('812 to 1,530', '12', 'no')
    """
    import numpy as np  # the commands load this room before they know whether they need it

    found = np.asarray(values, float)
    found = found[np.isfinite(found)]
    if not found.size:
        return "no"
    low, high = (f"{value:,.{digits}f}" for value in (found.min(), found.max()))
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
