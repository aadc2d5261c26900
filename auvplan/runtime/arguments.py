"""Checks of what functions and settings are given; messages name it, what it was and what would do."""

import math
from collections.abc import Mapping
from datetime import date, timedelta
from functools import cache
from types import NoneType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

#: What a value of a field's type is, and how messages call it.
_KINDS: dict[Any, tuple[tuple[type, ...], str]] = {
    int: ((int,), "a whole number"),
    float: ((int, float), "a number"),
    bool: ((bool,), "True or False"),
    NoneType: ((NoneType,), "None"),
}


def numbers(
    name: str, values: Any, dtype: type = float, hidden: float = np.nan, durations: bool = False
) -> NDArray[Any]:
    """Return an argument's values as floats, `hidden` where a NumPy mask hides a fill value.

    With `durations` it may be `numpy.timedelta64`, which is read in seconds.

    Raises:
        TypeError: they are no real numbers: text, dates, durations, None.
        ValueError: rows are of different lengths.
    """
    try:
        found = np.asarray(values)
    except ValueError:
        raise ValueError(f"{name} must be an array of numbers, got rows of different lengths") from None
    if durations and found.dtype.kind == "m":
        found = found / np.timedelta64(1, "s")
    if found.dtype.kind not in "biufV":
        first = found.flat[0] if found.size else found
        timed = isinstance(first, date | timedelta | np.datetime64 | np.timedelta64)
        got = type(first).__name__ if timed else f"{getattr(first, 'item', lambda: first)()!r:.80}"
        instead = ": give seconds" if timed else ""
        raise TypeError(f"{name} must be given in numbers, got {got}{instead}")
    if isinstance(values, np.ma.MaskedArray):
        found = np.where(np.ma.getmaskarray(values), hidden, found)
    return found.astype(dtype, copy=False)


def per_row(name: str, values: Any, rows: int) -> NDArray[Any]:
    """Return finite numbers [rows], given as such or as one for all.

    Raises:
        TypeError, ValueError: as `numbers`; they are not as many, or not finite.
    """
    found = numbers(name, values)
    if found.shape not in ((), (1,), (rows,)):
        raise ValueError(f"{name} must be one number or [{rows}], got shape {found.shape}")
    if not np.isfinite(found).all():
        raise ValueError(f"{name} must be finite, got {found[~np.isfinite(found)][0]}")
    return np.broadcast_to(found, (rows,))


def instance(name: str, given: Any, kind: type, make: str = "") -> None:
    """Refuse what is not of a class, with how to `make` one.

    Raises:
        TypeError: one line that names what was given.
    """
    if not isinstance(given, kind):
        wanted, got = kind.__name__, type(given).__name__
        a = "an" if wanted[0] in "AEIOU" else "a"
        raise TypeError(f"{name} must be {a} {wanted}, got {got}: give {make or f'ap.{wanted}(...)'}")


def check_choice(name: str, given: Any, choices: tuple[Any, ...]) -> None:
    """Refuse what is not among some words.

    Raises:
        ValueError: one line that lists them.
    """
    if not isinstance(given, str | None) or given not in choices:
        raise ValueError(f"{name} must be one of {choices}, got {given!r}")


def check_settings(settings: Any, ranges: Mapping[str, tuple[float, float]]) -> None:
    """Refuse settings, a dataclass, that are not of their fields' types or out of range; arrays pass.

    Args:
        settings: fields are numbers, choices by `Literal`, or settings themselves.
        ranges: of some fields, least and greatest value.

    Raises:
        ValueError: one line that names the field.
    """
    for name, (choices, kinds, wanted) in _types_of(type(settings)).items():
        value: Any = getattr(settings, name)
        value = value.item() if isinstance(value, np.generic) else value
        least, most = ranges.get(name, (-math.inf, math.inf))
        if choices:
            check_choice(name, value, choices)
        elif hasattr(value, "shape"):
            continue
        elif not isinstance(value, kinds) or value != value:
            raise ValueError(f"{name} must be {wanted}, got {value!r}")
        elif name in ranges and value is not None and (value < least or value > most):
            within = f"at least {least:g}" if math.isinf(most) else f"in [{least:g}, {most:g}]"
            raise ValueError(f"{name} must be {within}, got {value}")


@cache
def _types_of(kind: type) -> dict[str, tuple[tuple[Any, ...], tuple[type, ...], str]]:
    """Return the choices of each field, or the types that a value may be of and these in words."""
    found = {}
    for name, hint in get_type_hints(kind).items():
        options = (hint,) if get_origin(hint) is Literal or not get_args(hint) else get_args(hint)
        words = tuple(word for option in options for word in get_args(option))
        choices = (*words, None) if words and NoneType in options else words
        known = [_KINDS.get(option, ((option,), f"a {option.__name__}")) for option in options if not words]
        kinds = tuple(one for types, _ in known for one in types)
        found[name] = choices, kinds, " or ".join(said for _, said in known)
    return found
