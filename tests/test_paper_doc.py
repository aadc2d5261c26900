"""docs/paper.md names modules, functions and tests that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
LINES = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8").splitlines()
ROWS = [line for line in LINES if line.startswith("| ") and "`" in line]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.split("|")[1].strip())
def test_what_a_row_names_exists(row):
    names = re.findall(r"`([^`]+)`", row)
    files = [name for name in names if re.fullmatch(r"[\w/]+\.py", name)]
    sources = {name: path for name in files for path in (_found(name),)}
    text = "".join(path.read_text(encoding="utf-8") for path in sources.values())
    for test in (name for name in names if re.fullmatch(r"test_\w+", name)):
        assert f"def {test}(" in text, f"{test} is in none of {files}"
    for name in (name for name in names if re.fullmatch(r"[a-zA-Z_]+(\.\w+)?", name)):
        assert name.rpartition(".")[2] in text or name == "whitsunday", f"{name} is in none of {files}"


def test_every_equation_and_figure_has_a_row():
    first = " ".join(row.split("|")[1] for row in ROWS)
    numbers = {int(number) for number in re.findall(r"\b\d+\b", first)}
    assert numbers >= set(range(1, 17))


def _found(name: str) -> Path:
    """A file of the package or of its tests."""
    places = (ROOT / folder / name for folder in ("tests", "auvplan", "."))
    return next(path for path in places if path.is_file())
