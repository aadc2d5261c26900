"""The one exception of files of places, and what turns whatever a library raises into it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from auvplan.errors import AuvplanError
from auvplan.ocean.chart import ChartError


class GeoError(AuvplanError):
    """A file of places that cannot be used; the message is one line that names it."""


@contextmanager
def reading(path: str | Path) -> Iterator[None]:
    """Whatever is raised within becomes one line on the file; a `GeoError` passes as it is."""
    try:
        yield
    except GeoError:
        raise
    except Exception as error:  # readers answer a damaged file with whatever their layers stumble over
        raise GeoError(f"{path}: {reason(error)}") from None


@contextmanager
def as_chart() -> Iterator[None]:
    """A `GeoError` within becomes a `ChartError` of the same message."""
    try:
        yield
    except GeoError as error:
        raise ChartError(str(error)) from None


def reason(error: Exception) -> str:
    """What an error says, on one line."""
    said = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(said.split())[:300] or f"cannot be read ({type(error).__name__})"


def read_text(path: str | Path, limit: int) -> str:
    """The text of a UTF-8 file, with or without a byte order mark.

    Args:
        path: of the file.
        limit: bytes; a larger file is refused.

    Raises:
        GeoError: the file is missing, larger, or not UTF-8.
    """
    with reading(path):
        if Path(path).stat().st_size > limit:
            raise GeoError(f"{path}: larger than {limit} bytes")
        try:
            # "utf-8-sig" drops the mark that spreadsheets put before the first heading.
            return Path(path).read_text(encoding="utf-8-sig")
        except UnicodeDecodeError:
            raise GeoError(f"{path}: not UTF-8 text") from None
