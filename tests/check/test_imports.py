"""The checker shares no code with what it checks."""

import ast
from pathlib import Path

import auvplan.check

#: Names, opens and hashes files of results; says what is wrong with them.
SHARED = {"auvplan.runtime.files", "auvplan.errors"}


def test_the_checker_imports_nothing_but_files_and_errors():
    found = set()
    for path in Path(auvplan.check.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [name.name for name in node.names] if isinstance(node, ast.Import) else []
            assert not (isinstance(node, ast.ImportFrom) and node.level)
            found |= {name for name in names if name.split(".")[0] == "auvplan"}
    assert {name for name in found if not f"{name}.".startswith("auvplan.check.")} == SHARED
