"""The exceptions of files of places, and what turns whatever a library raises into them."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from auvplan.errors import AuvplanError, reason_of


class GeoError(AuvplanError):
    """A file of places that cannot be used; the message is one line that names it."""


class PlaceError(GeoError):
    """A longitude and latitude off the Earth; `swapped` is whether they are a place the other way round."""

    def __init__(self, line: str, swapped: bool) -> None:
        super().__init__(line)
        self.swapped = swapped


@dataclass
class Faults:
    """What is wrong with the parts of a file, gathered so that one does not hide another."""

    lines: list[str] = field(default_factory=list)  # on what is wrong, each with the file and the part
    #: Those on places whose longitude and latitude seem swapped.
    swapped: list[str] = field(default_factory=list)
    places: int = 0  # how many parts with a place were looked at

    @contextmanager
    def kept(self) -> Iterator[None]:
        """An error of input within is kept, and what follows goes on."""
        try:
            yield
        except PlaceError as error:
            (self.swapped if error.swapped else self.lines).append(str(error))
        except AuvplanError as error:
            self.lines += error.lines

    def refuse(self, places: int = 0, kind: type[AuvplanError] = GeoError) -> None:
        """Raise what was kept, if anything; once where all `places` of a file are swapped."""
        swapped = self.swapped
        if 1 < len(swapped) == places:
            swapped = [f"{swapped[0]} (so in all {places} places of the file)"]

        def by_number(line: str) -> tuple[int, str]:
            number = re.search(r": (?:row|feature|waypoint|placemark|item) (\d+)", line)
            return (int(number[1]) if number else 1 << 30), line

        if found := sorted([*self.lines, *swapped], key=by_number):
            raise kind(*found)


@contextmanager
def reading(path: str | Path, kind: type[AuvplanError] = GeoError) -> Iterator[None]:
    """Whatever is raised within becomes one line on the file, an error of `kind`; `GeoError`s keep theirs."""
    try:
        yield
    except kind:
        raise
    except GeoError as error:
        raise kind(*error.lines, field=error.field) from None
    except Exception as error:  # readers answer a damaged file with whatever their layers stumble over
        raise kind(f"{path}: {reason_of(error)}") from None


def label(source: Any) -> str:
    """Return what messages call a file or an object that is given in its place."""
    return str(source) if isinstance(source, str | Path) else f"the given {type(source).__name__}"


def number_of(value: Any) -> float:
    """Return a value as a number; NaN of what is none."""
    try:
        return float("nan") if isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return float("nan")
