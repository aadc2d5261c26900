"""Rules and phases of `auvplan.executive.decide` as they stand in docs/execution.md.

`python tools/decisions.py` writes them there; `--check` says whether they are the code's, by its exit status.
"""

import argparse
import re
import sys
from pathlib import Path

from auvplan.executive.decide import NEXT, RULES, Phase

PAGE = Path(__file__).resolve().parent.parent / "docs" / "execution.md"
_BLOCK = re.compile(r"(<!-- decisions -->\n).*?(<!-- end of decisions -->)", re.DOTALL)


def as_markdown() -> str:
    """Return a table of the rules in order, and a diagram of the phases."""
    rows = ["| rule | where | what is done |", "|---|---|---|"]
    rows += [f"| {rule.name} | {rule.where} | {rule.act.value} |" for rule in RULES]
    number = {phase: f"s{k}" for k, phase in enumerate(Phase)}
    drawn = ["```mermaid", "stateDiagram-v2"]
    drawn += [f'    state "{phase.value}" as {number[phase]}' for phase in Phase]
    drawn += [f"    [*] --> {number[Phase.READY]}"]
    drawn += [f"    {number[begin]} --> {number[end]}: {act.value}" for (begin, act), end in NEXT.items()]
    ends = set(NEXT.values()) - {begin for begin, _ in NEXT}
    drawn += [f"    {number[end]} --> [*]" for end in Phase if end in ends]
    return "\n".join([*rows, "", *drawn, "```", ""])


def main() -> int:
    parser = argparse.ArgumentParser(description="Rules and phases in docs/execution.md.")
    parser.add_argument("--check", action="store_true", help="write nothing")
    before = PAGE.read_text(encoding="utf-8")
    wanted = _BLOCK.sub(lambda found: found[1] + as_markdown() + found[2], before)
    if parser.parse_args().check:
        return int(wanted != before)
    PAGE.write_text(wanted, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
