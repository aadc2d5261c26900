"""Tools of the repository, which are no part of the package."""

import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parent.parent


@contextmanager
def refused(kind: type[Exception], words: str) -> Iterator[None]:
    """What is within raises an error of one line with these words, a pattern."""
    with pytest.raises(kind, match=words) as caught:
        yield
    assert len(str(caught.value).splitlines()) == 1


def load_tool(name: str) -> ModuleType:
    """`tools/NAME.py` as a module."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # where dataclasses look their module up
    try:
        spec.loader.exec_module(module)
    finally:
        del sys.modules[name]
    return module
