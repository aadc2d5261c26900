"""`docs/bbo.md` as it stands: its examples give what they say."""

import doctest
from pathlib import Path

import pytest


@pytest.mark.slow
def test_examples_give_what_the_page_says() -> None:
    page = Path(__file__).parents[2] / "docs" / "bbo.md"
    failed, tried = doctest.testfile(str(page), module_relative=False)
    assert tried > 15
    assert failed == 0
