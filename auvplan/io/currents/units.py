"""Units as they are spelled in ocean files: factors to metres a second and to metres."""

import re

#: Metres in a unit of length, by its spellings without the plural.
_LENGTHS = {
    "m": 1.0, "metre": 1.0, "meter": 1.0,
    "dm": 0.1, "decimetre": 0.1, "decimeter": 0.1,
    "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01,
    "mm": 0.001, "millimetre": 0.001, "millimeter": 0.001,
    "km": 1000.0, "kilometre": 1000.0, "kilometer": 1000.0,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "ussurveyfoot": 1200.0 / 3937.0, "fathom": 1.8288,
    "nmi": 1852.0, "nauticalmile": 1852.0,
}  # fmt: skip
_TIMES = {
    "s": 1.0, "sec": 1.0, "second": 1.0,
    "min": 60.0, "minute": 60.0,
    "h": 3600.0, "hr": 3600.0, "hour": 3600.0,
    "d": 86400.0, "day": 86400.0,
}  # fmt: skip
_KNOTS = {"kn", "kt", "kts", "knot", "knots"}


def _alternatives(names: dict[str, float]) -> str:
    return "|".join(f"{name}s?" if len(name) > 2 else name for name in sorted(names, key=len, reverse=True))


#: A number of units, and the unit, such as "100 km".
_LENGTH = re.compile(rf"(\d*\.?\d+(?:e[-+]?\d+)?)?[*·]?({_alternatives(_LENGTHS)})")
#: A length over a time: "m/s" and "m per s", or "m s-1" with any sign of multiplication and of power.
_SPEED = re.compile(
    rf"{_LENGTH.pattern}"
    rf"(?:(?:/|per)({_alternatives(_TIMES)})|[.*·]?({_alternatives(_TIMES)})(?:\^|\*\*)?\(?-1\)?)"
)


def speed_factor(units: str) -> float | None:
    """Return metres a second in a unit of speed, or None where it is none that is known.

    Example:
        >>> [speed_factor(units) for units in ("ms-1", "meter second-1", "cm/s", "m")]
        [1.0, 1.0, 0.01, None]
    """
    if " ".join(units.lower().split()) in _KNOTS:
        return 1852.0 / 3600.0
    found = _SPEED.fullmatch(_plain(units))
    if found is None:
        return None
    number, length, over, times = found.groups()
    return float(number or 1.0) * _size(_LENGTHS, length) / _size(_TIMES, over or times)


def length_factor(units: str) -> float | None:
    """Return metres in a unit of length, or None where it is none that is known.

    Example:
        >>> [length_factor(units) for units in ("Meters", "100 km", "dbar")]
        [1.0, 100000.0, None]
    """
    found = _LENGTH.fullmatch(_plain(units))
    return None if found is None else float(found[1] or 1.0) * _size(_LENGTHS, found[2])


def _plain(units: str) -> str:
    """Lower case, without blanks and braces, with one kind of minus."""
    text = units.lower().replace("−", "-").replace("⁻¹", "-1").replace("⁻1", "-1")
    return re.sub(r"[\s{}_]", "", text)


def _size(sizes: dict[str, float], name: str) -> float:
    return sizes[name] if name in sizes else sizes[name[:-1]]
