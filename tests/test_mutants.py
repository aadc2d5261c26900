"""Rules that are broken by hand: which there are, and that every reason for one to live is of such a one."""

import tomllib
from pathlib import Path

import pytest

from tests.tool import load_tool

ROOT = Path(__file__).resolve().parent.parent

SOURCE = '''"""A module."""

LIMIT = 3.0


def least(values, most=True):
    """Return the least value."""
    if not values:
        raise ValueError("no value")
    found = min(values) if most else max(0, 1)
    report.count += 1
    report.note(divmod(found, LIMIT))
    return found
'''

BROKEN = [
    (3, "3.0 -> 4.0"),
    (6, "True -> False"),
    (8, "if not values: raise ValueError('no value') -> left out"),
    (8, "not values -> values"),
    (10, "0 -> 1"),
    (10, "1 -> 2"),
    (11, "report.count += 1 -> left out"),
    (11, "1 -> 2"),
    (12, "report.note(divmod(found, LIMIT)) -> left out"),
    (12, "divmod(found, LIMIT) -> divmod(LIMIT, found)"),
]


@pytest.fixture(scope="module")
def tool():
    """The tool, which is no part of the package."""
    return load_tool("mutants")


def test_each_rule_is_broken_in_one_place(tool):
    found = tool.mutants_of("least.py", SOURCE)
    assert sorted((mutant.line, mutant.change) for mutant in found) == sorted(BROKEN)
    lines = SOURCE.splitlines()
    for mutant in found:
        assert mutant.source == lines[mutant.line - 1].strip()
        broken = mutant.broken(SOURCE).splitlines()
        compile(mutant.broken(SOURCE), "least.py", "exec")
        assert broken[: mutant.line - 1] == lines[: mutant.line - 1]
        assert broken[mutant.line - 1] != lines[mutant.line - 1]


def test_reasons_are_of_mutants_that_can_be_drawn(tool):
    """Keys are texts of lines: one that is rewritten needs its reason looked at again."""
    stated = tomllib.loads(tool.REASONS.read_text(encoding="utf-8"))["mutant"]
    for file in tool.TARGETS:
        known = {
            (mutant.source, mutant.change)
            for mutant in tool.mutants_of(file, (ROOT / file).read_text(encoding="utf-8"))
        }
        reasons = [row for row in stated if row["file"] == file]
        assert not [row for row in reasons if (row["source"], row["change"]) not in known]
        assert all(row["why"] for row in reasons)
    assert {row["file"] for row in stated} <= set(tool.TARGETS)


def test_tests_of_targets_are_there(tool):
    for file, tests in tool.TARGETS.items():
        assert [place for place in (file, *tests) if not (ROOT / place).is_file()] == []
