"""Breaks rules by hand, one at a time, and sees whether the tests notice.

``python tools/mutants.py [-n 12] [--seed 9] [--only FILE] [--out FILE.json]`` draws so many places in each
file of `TARGETS`, changes a comparison, a sum, a product, a condition or a number there, in a copy of the
repository, and runs the tests that go with the file. A mutant that they pass survives, and is listed.
"""

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: Tests that go with each file: those that are meant to notice what is wrong with it.
TARGETS = {
    "auvplan/io/check.py": ("tests/io/test_check.py", "tests/io/test_check_seabed.py"),
    "auvplan/path/clearance.py": ("tests/path/test_clearance.py", "tests/path/test_seabed.py"),
    "auvplan/mission/decoder.py": ("tests/mission/test_decoder.py", "tests/mission/test_timetable.py"),
    "auvplan/path/replanner.py": ("tests/path/test_reuse.py", "tests/faults/test_rules.py"),
    "auvplan/executive/loop.py": (
        "tests/executive/test_loop.py",
        "tests/executive/test_clock.py",
        "tests/executive/test_visits.py",
        "tests/faults/test_rules.py",
        "tests/executive/test_route_calls.py",
    ),
}

#: s, after which a run of tests counts as one that noticed: the mutant does not end.
LIMIT = 400.0

SWAPS: dict[type, type] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Add: ast.Sub,
    ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip


def changed(node: ast.expr) -> ast.expr | None:
    """A broken copy of an expression; None where it is not of a kind that is broken."""
    new = copy.deepcopy(node)
    if isinstance(new, ast.Compare) and type(new.ops[0]) in SWAPS:
        new.ops[0] = SWAPS[type(new.ops[0])]()
    elif isinstance(new, ast.BinOp | ast.BoolOp) and type(new.op) in SWAPS:
        new.op = SWAPS[type(new.op)]()
    elif isinstance(new, ast.UnaryOp) and isinstance(new.op, ast.Not):
        return new.operand
    elif isinstance(new, ast.Constant) and isinstance(new.value, bool):
        new.value = not new.value
    elif isinstance(new, ast.Constant) and isinstance(new.value, int | float):
        new.value = new.value + 1
    else:
        return None
    return new


def places(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions of the code itself: no annotations, no texts, no messages of errors."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.JoinedStr | ast.Raise) or not isinstance(node, ast.AST):
                continue
            if isinstance(node, ast.keyword) and node.arg in ("strict", "frozen"):
                continue  # guards, which change nothing
            if isinstance(node, ast.expr) and changed(node) is not None:
                yield node
            yield from places(node)


def mutant(source: str, node: ast.expr) -> str:
    """The source with one expression broken."""
    lines = source.encode().splitlines(keepends=True)
    begin = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    assert node.end_lineno is not None
    assert node.end_col_offset is not None
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    new = changed(node)
    assert new is not None
    text = source.encode()
    return (text[:begin] + f"({ast.unparse(new)})".encode() + text[end:]).decode()


def noticed(copied: Path, tests: tuple[str, ...]) -> bool:
    """Whether tests fail in a copy of the repository."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-m", "not slow", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copied), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        ended = subprocess.run(command, cwd=copied, env=environment, capture_output=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return True
    return ended.returncode != 0


def copied_to(folder: Path) -> Path:
    """A copy of what git keeps; compiled programs of tests are shared."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file():
            shutil.copy2(ROOT / name, target)
    (ROOT / ".pytest_cache").mkdir(exist_ok=True)
    (folder / ".pytest_cache").symlink_to(ROOT / ".pytest_cache")
    return folder


def main() -> None:
    """Print which mutants survive."""
    parser = argparse.ArgumentParser(description="Rules broken by hand.")
    parser.add_argument("-n", type=int, default=12, help="mutants of each file")
    parser.add_argument("--seed", type=int, default=9)
    parser.add_argument("--only", choices=TARGETS, help="this file alone")
    parser.add_argument("--out", type=Path, help="JSON file to write, as soon as there is something to say")
    options = parser.parse_args()
    files, survivors = [], []
    with tempfile.TemporaryDirectory() as name:
        copied = copied_to(Path(name) / "copy")
        for file, tests in TARGETS.items():
            if options.only not in (None, file):
                continue
            if noticed(copied, tests):
                raise SystemExit(f"{file}: its tests fail as it is")
            source = (ROOT / file).read_text(encoding="utf-8")
            found = list(places(ast.parse(source)))
            chosen = random.Random(f"{options.seed}:{file}").sample(found, min(options.n, len(found)))
            killed = 0
            for node in chosen:
                begin = time.perf_counter()
                (copied / file).write_text(mutant(source, node), encoding="utf-8")
                seen = noticed(copied, tests)
                killed += seen
                new = changed(node)
                assert new is not None
                line = f"{file}:{node.lineno}: {ast.unparse(node)} -> {ast.unparse(new)}"
                survivors += [] if seen else [line]
                word = "killed" if seen else "SURVIVED"
                print(f"{word} {line} ({time.perf_counter() - begin:.0f} s)", flush=True)
            (copied / file).write_text(source, encoding="utf-8")
            files.append({"file": file, "mutants": len(chosen), "killed": killed})
            if options.out:
                stated = {"mutants": {"files": files, "survivors": survivors}}
                options.out.write_text(json.dumps(stated, indent=1) + "\n")
    total, killed = (sum(row[key] for row in files) for key in ("mutants", "killed"))
    print(f"{killed} of {total} mutants killed")


if __name__ == "__main__":
    main()
