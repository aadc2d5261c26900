"""How readers refuse."""

from collections.abc import Callable
from typing import Any

import pytest


def refusal(kind: type[Exception], words: str, read: Callable, *given: Any, **options: Any) -> Any:
    """What a reader raises: an error of a kind, in one short line that has a pattern of words."""
    with pytest.raises(kind, match=words) as caught:
        read(*given, **options)
    line = str(caught.value)
    assert "\n" not in line
    assert len(line) <= 1000
    return caught.value
