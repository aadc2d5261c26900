"""Breaks rules by hand, one at a time, and sees whether the tests notice.

``python tools/mutants.py [-n 12] [--seed 9 ...] [--only FILE] [--out FILE.json]`` draws so many places in
each file of `TARGETS`, and changes what is there: a comparison, a sum, a product, a condition, a number, the
order of two arguments; or it leaves out a guard, a call or a change of state. It does so in a copy of the
repository, and runs the tests that go with the file there. A mutant that they pass survives, and is listed.
``--list`` prints all mutants that can be drawn, and runs nothing.

`REASONS` states why a survivor may live, which `tools/reliability.py` prints beside it.
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
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

#: Why mutants may live, by the text of the line that they are in.
REASONS = ROOT / "tools" / "mutants.toml"

#: Tests that go with each file: those that are meant to notice what is wrong with it.
TARGETS = {
    "auvplan/check/run.py": (
        "tests/check/test_check_limits.py", "tests/check/test_check.py", "tests/check/test_check_seabed.py",
        "tests/check/test_sources.py",
    ),
    "auvplan/path/clearance.py": ("tests/path/test_clearance.py", "tests/path/test_seabed.py"),
    "auvplan/mission/decoder.py": ("tests/mission/test_decoder.py", "tests/mission/test_timetable.py"),
    "auvplan/path/replanner.py": ("tests/path/test_reuse.py", "tests/faults/test_rules.py"),
    "auvplan/executive/decide.py": ("tests/executive/test_decide.py",),
    "auvplan/executive/loop.py": (
        "tests/executive/test_loop.py", "tests/executive/test_clock.py", "tests/executive/test_visits.py",
        "tests/faults/test_rules.py", "tests/executive/test_route_calls.py",
        "tests/executive/test_whole_lines.py",
    ),
}  # fmt: skip

#: s, after which a run of tests counts as one that noticed: the mutant does not end.
LIMIT = 400.0

SWAPS: dict[type, type] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Add: ast.Sub,
    ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.And: ast.Or, ast.Or: ast.And,
}  # fmt: skip

#: Functions whose arguments may stand in any order.
SYMMETRIC = {"hypot", "inner", "isclose", "max", "maximum", "min", "minimum", "norm"}

#: Statements that a guard leads to.
LEAVES = ast.Return | ast.Continue | ast.Break | ast.Raise


@dataclass(frozen=True)
class Mutant:
    """One broken rule.

    Attributes:
        file: path in the repository.
        line: its number, from 1.
        source: text of the line.
        change: what was there and what is there instead.
        begin, end: bytes of the file that are replaced.
        text: by what.
    """

    file: str
    line: int
    source: str
    change: str
    begin: int
    end: int
    text: str

    def __str__(self) -> str:
        return f"{self.file}:{self.line}: {self.change}"

    def broken(self, source: str) -> str:
        """Return the source with this rule broken."""
        whole = source.encode()
        return (whole[: self.begin] + self.text.encode() + whole[self.end :]).decode()


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
    elif isinstance(new, ast.Call) and _turnable(new):
        new.args[-2:] = new.args[:-3:-1]
    else:
        return None
    return new


def _turnable(call: ast.Call) -> bool:
    """Whether the last two arguments of a call can change places, and that means something."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else ast.unparse(call.func)
    last = call.args[-2:]
    return (
        len(last) == 2
        and name not in SYMMETRIC
        and not any(isinstance(node, ast.Starred) for node in last)
        and ast.dump(last[0]) != ast.dump(last[1])
    )


def left_out(node: ast.stmt) -> bool:
    """Whether a statement is one that mutants leave out: a guard, a call, or a change of what outlives it."""
    if isinstance(node, ast.If):
        return not node.orelse and len(node.body) == 1 and isinstance(node.body[0], LEAVES)
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Call)
    if isinstance(node, ast.Assign):
        return isinstance(node.targets[0], ast.Attribute | ast.Subscript)
    return isinstance(node, ast.AugAssign)


def places(tree: ast.AST) -> Iterator[tuple[ast.expr | ast.stmt, str]]:
    """Places of the code itself, and what stands there instead: no annotations, no texts, no messages."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns", "decorator_list"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.JoinedStr | ast.Raise) or not isinstance(node, ast.AST):
                continue
            if isinstance(node, ast.keyword) and node.arg in ("strict", "frozen"):
                continue  # guards, which change nothing
            if isinstance(node, ast.expr) and (new := changed(node)) is not None:
                yield node, f"({ast.unparse(new)})"
            if isinstance(node, ast.stmt) and left_out(node):
                yield node, "pass"
            yield from places(node)


def mutants_of(file: str, source: str) -> list[Mutant]:
    """All mutants of a file's source, in the order of their places."""
    lines = source.encode().splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    found = []
    for node, text in places(ast.parse(source)):
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        new = "left out" if isinstance(node, ast.stmt) else text[1:-1]
        change = f"{' '.join(ast.unparse(node).split())} -> {new}"
        begin = starts[node.lineno - 1] + node.col_offset
        end = starts[node.end_lineno - 1] + node.end_col_offset
        stated = lines[node.lineno - 1].decode().strip()
        found.append(Mutant(file, node.lineno, stated, change, begin, end, text))
    return found


def noticed(copied: Path, tests: tuple[str, ...], broken: bool = True) -> bool:
    """Whether tests fail in a copy of the repository; of code that is whole the byte code is kept."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-n", "0", "-m", "not slow", *tests]
    environment = {**os.environ, "PYTHONPATH": str(copied), "PYTHONDONTWRITEBYTECODE": "1" if broken else ""}
    try:
        ended = subprocess.run(command, cwd=copied, env=environment, capture_output=True, timeout=LIMIT)
    except subprocess.TimeoutExpired:
        return True
    return ended.returncode != 0


def copied_to(folder: Path) -> Path:
    """A copy of what git keeps, and of the compiled programs of tests, to which mutants add their own."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file():
            shutil.copy2(ROOT / name, target)
    kept = ROOT / ".pytest_cache"
    if kept.is_dir():
        shutil.copytree(kept, folder / ".pytest_cache", copy_function=_linked)
    return folder


def _linked(source: str, target: str) -> None:
    """Link a file, or copy it where links do not reach; one that another process has just removed is left."""
    try:
        os.link(source, target)
    except FileNotFoundError:
        return
    except OSError:
        shutil.copy2(source, target)


def main() -> None:
    """Print which mutants survive."""
    parser = argparse.ArgumentParser(description="Rules broken by hand.")
    parser.add_argument("-n", type=int, default=12, help="mutants of each file")
    parser.add_argument("--seed", type=int, nargs="+", default=[9], help="a draw of so many by each")
    parser.add_argument("--only", choices=TARGETS, help="this file alone")
    parser.add_argument("--list", action="store_true", help="print all mutants, and run nothing")
    parser.add_argument("--out", type=Path, help="JSON file to write, as soon as there is something to say")
    options = parser.parse_args()
    chosen_files = [file for file in TARGETS if options.only in (None, file)]
    if options.list:
        for file in chosen_files:
            print(*mutants_of(file, (ROOT / file).read_text(encoding="utf-8")), sep="\n")
        return
    files, survivors = [], []
    with tempfile.TemporaryDirectory() as name:
        copied = copied_to(Path(name) / "copy")
        for file in chosen_files:
            tests = TARGETS[file]
            if noticed(copied, tests, broken=False):
                raise SystemExit(f"{file}: its tests fail as it is")
            source = (copied / file).read_text(encoding="utf-8")
            found = mutants_of(file, source)
            draws = [random.Random(f"{seed}:{file}").sample(range(len(found)), min(options.n, len(found)))
                     for seed in options.seed]  # fmt: skip
            chosen = [found[number] for number in dict.fromkeys(number for draw in draws for number in draw)]
            killed = 0
            for mutant in chosen:
                begin = time.perf_counter()
                (copied / file).write_text(mutant.broken(source), encoding="utf-8")
                seen = noticed(copied, tests)
                killed += seen
                kept = {"file", "line", "source", "change"}
                survivors += [] if seen else [{k: v for k, v in asdict(mutant).items() if k in kept}]
                word = "killed" if seen else "SURVIVED"
                print(f"{word} {mutant} ({time.perf_counter() - begin:.0f} s)", flush=True)
            (copied / file).write_text(source, encoding="utf-8")
            files.append({"file": file, "mutants": len(chosen), "killed": killed})
            if options.out:
                stated = {"mutants": {"seed": options.seed, "files": files, "survivors": survivors}}
                options.out.write_text(json.dumps(stated, indent=1) + "\n")
    total, killed = (sum(row[key] for row in files) for key in ("mutants", "killed"))
    print(f"{killed} of {total} mutants killed")


if __name__ == "__main__":
    main()
