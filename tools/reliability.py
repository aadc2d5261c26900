"""Writes docs/reliability.md: what is checked in which way, and the figures of the fault benchmarks.

``python tools/reliability.py [--add FILE.json ...]`` counts the tests named in `CAPABILITIES` and writes the
page. Files that the benchmarks wrote by ``--out`` are first taken into ``docs/reliability.json``, which the
page's figures come from. ``--check`` writes nothing, and ends with status 1 where the page is not what this
would write.
"""

import argparse
import ast
import json
import sys
import tomllib
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
PAGE, FIGURES = ROOT / "docs" / "reliability.md", ROOT / "docs" / "reliability.json"

#: Why mutants may live.
REASONS = ROOT / "tools" / "mutants.toml"

#: Kinds of checks, and what they are called on the page.
KINDS = {
    "unit": "unit",
    "property": "property",
    "independent": "independent check",
    "peer": "peer",
    "fault": "fault",
}

#: Files of tests by capability, of which those with drawn cases count as properties and the others as unit
#: tests; then, for the other kinds, files of tests, single ones (file::test), or benchmarks (@name).
CAPABILITIES: dict[str, dict[str, str]] = {
    "Currents and their interpolation": {
        "tests": "ocean/test_currents ocean/test_gridded ocean/test_interpolation",
        "independent": "simulation/test_model_sea",
        "peer": "@gridded",
    },
    "Coast and sea bed": {
        "tests": "ocean/test_chart ocean/test_seabed path/test_seabed",
        "independent": "check/test_check_seabed @waters",
        "fault": "faults/test_machine",
    },
    "Obstacles and clearance": {
        "tests": "ocean/test_obstacles ocean/test_known path/test_clearance",
        "independent": "@path_walks check/test_track",
        "fault": "faults/test_machine @faults",
    },
    "Paths": {
        "tests": (
            "path/test_planner path/test_cost path/test_passages path/test_stages path/test_loops "
            "path/test_reasons"
        ),
        "independent": "@waters @path_walks",
        "peer": "@plans @paths",
    },
    "Re-plans under way": {
        "tests": "path/test_reuse path/test_outlook",
        "independent": "@path_replans",
        "fault": "faults/test_machine @faults",
    },
    "Routes": {
        "tests": (
            "mission/test_decoder mission/test_beam mission/test_local_search "
            "mission/test_mission_planner mission/test_graph mission/test_feasibility "
            "mission/test_travel_times"
        ),
        "independent": "mission/test_exact mission/test_bound",
        "peer": "@missions",
    },
    "Time-dependent routing": {
        "tests": "mission/test_timetable executive/test_clock",
        "independent": "@clock @windows check/test_windows",
        "peer": "@clock_peers",
    },
    "The executive": {
        "tests": (
            "executive/test_executive executive/test_loop executive/test_route_calls "
            "executive/test_visits executive/test_whole_lines faults/test_rules"
        ),
        "independent": "executive/test_coasts",
        "fault": "faults/test_machine faults/test_faults @faults",
    },
    "Vehicles over a link": {
        "tests": "link/test_execution link/test_upload link/test_notices",
        "peer": "link/test_mavlink link/test_ardusub link/test_imc @links",
        "fault": "link/test_execution link/test_simulated @links @faults",
    },
    "Simulation": {
        "tests": "executive/test_truth_and_belief simulation/test_model_sea",
        "fault": "faults/test_faults",
    },
    "Budgets of wall-clock time": {
        "tests": "runtime/test_budget",
        "fault": "@budgets",
    },
    "The same seed, the same result": {
        "tests": "executive/test_executive::test_a_mission_is_the_same_alone_and_later_ones_compile_nothing",
        "fault": "@determinism",
    },
    "Studies": {
        "tests": "study/test_runner study/test_design study/test_statistics",
        "peer": "study/test_statistics",
        "fault": "study/test_resume study/test_cluster @determinism",
    },
    "Results on disk": {
        "tests": "io/test_saved_run io/test_output",
        "peer": "export/test_formats",
        "fault": "faults/test_disk @crashes @determinism @fuzz",
    },
    "The checker": {
        "tests": "check/test_check check/test_check_limits check/test_track check/test_sources",
        "fault": "@alterations",
    },
    "Readers of currents": {
        "tests": "io/currents/test_reading io/currents/test_formats",
        "independent": "io/currents/test_files",
        "peer": "@files",
        "fault": "io/currents/test_malformed io/currents/test_altered @fuzz",
    },
    "Charts, jobs, sea beds from files": {
        "tests": "io/geo/test_charts io/geo/test_s57 io/geo/test_jobs io/geo/test_bathymetry",
        "independent": "io/geo/test_files",
        "peer": "@file_rasters",
        "fault": "io/geo/test_damage io/geo/test_bathymetry_faults @fuzz",
    },
    "Scenarios": {
        "tests": "io/test_scenario_file io/test_examine",
        "fault": "io/test_bad_input @fuzz",
    },
    "Vehicle files": {
        "tests": "export/test_export export/test_qgroundcontrol export/test_imc",
        "peer": "export/test_formats",
        "fault": "@crashes",
    },
    "Pages and pictures": {
        "tests": "report/test_pages plot/test_figures",
        "independent": "report/test_browser",
        "fault": "@crashes",
    },
    "The optimiser": {
        "tests": "bbo/test_search bbo/test_operators bbo/test_rates",
        "peer": "@bbob",
    },
}


def functions(place: str) -> list[ast.FunctionDef]:
    """Tests of a file below tests/, or the one named after `::`.

    Raises:
        SystemExit: there is none.
    """
    file, _, name = place.partition("::")
    path = ROOT / "tests" / f"{file}.py"
    if not path.is_file():
        raise SystemExit(f"{path}: no such file")
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    found = [node for node in nodes if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]
    chosen = [node for node in found if name in ("", node.name)]
    if not chosen:
        raise SystemExit(f"{place}: no such test")
    return chosen


def drawn(test: ast.FunctionDef) -> bool:
    """Whether a test's cases are drawn by Hypothesis, or by rules fired at random."""
    return any("given" in ast.unparse(mark) for mark in test.decorator_list) or "fired(" in ast.unparse(test)


def cell(capability: str, kind: str) -> str:
    """What the matrix says of a capability and a kind of check; empty where there is none."""
    of_tests = kind in ("unit", "property")
    places = CAPABILITIES[capability].get("tests" if of_tests else kind, "").split()
    tests = [test for place in places if place[0] != "@" for test in functions(place)]
    if of_tests:
        tests = [test for test in tests if drawn(test) == (kind == "property")]
    benchmarks = [place[1:] for place in places if place[0] == "@"]
    for name in benchmarks:
        if not any((ROOT / "benchmarks" / file).is_file() for file in (f"{name}.py", f"{name}/__main__.py")):
            raise SystemExit(f"{name}: no such benchmark")
    return ", ".join([str(len(tests))] * bool(tests) + [f"`{name}`" for name in benchmarks])


def matrix() -> list[str]:
    """Table of capabilities and kinds of checks."""
    rows = [[capability, *(cell(capability, kind) for kind in KINDS)] for capability in CAPABILITIES]
    lines = _table(("capability", *KINDS.values()), rows)
    return [line.replace("|  |", "| |").replace("|  |", "| |") for line in lines]


def _table(headings: tuple[str, ...], rows: list[list[Any]]) -> list[str]:
    lines = ["| " + " | ".join(headings) + " |", "|---" * len(headings) + "|"]
    return lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows]


def tabled(columns: dict[str, str]) -> Callable[[list[dict[str, Any]]], list[str]]:
    """Return what writes rows as a table of such columns: headings, and formats of a row's entries."""

    def lines(found: list[dict[str, Any]]) -> list[str]:
        rows = []
        for row in found:
            known: dict[str, Any] = defaultdict(int, row)
            for name, counts in row.items():
                if isinstance(counts, dict):
                    known[name] = ", ".join(f"{each} {times}" for each, times in counts.items())
                    known["total"] = sum(counts.values())
            rows.append([form.format_map(known).replace("%", " %") for form in columns.values()])
        return _table(tuple(columns), rows)

    return lines


def determinism(found: list[dict[str, str]]) -> list[str]:
    """Whether summaries are the same."""
    same = sum(row["digest"] == found[0]["digest"] for row in found)
    others = [row["how"] for row in found if row["digest"] != found[0]["digest"]]
    line = f"{same} of {len(found)} summaries are the same to the byte, clock times left out"
    line += f"; different: {', '.join(others)}." if others else "."
    return [line, "", f"Compared: {', '.join(row['how'] for row in found)}."]


def fuzz(found: list[dict[str, Any]]) -> list[str]:
    """Changed files for every reader."""
    columns = {name: f"{{{name}}}" for name in ("reader", "cases", "read", "refused", "failures")}
    failed = [f"- {row['reader']}: `{one['found']}`" for row in found for one in row["failed"]]
    more = ["", "Failures:", "", *dict.fromkeys(failed)] if failed else []
    return tabled(columns | {"most memory, MiB": "{memory:.0f}"})(found) + more


def alterations(found: dict[str, Any]) -> list[str]:
    """Altered figures of saved runs."""
    rows = [[kind, *counts] for kind, counts in found["kinds"].items()]
    found_all, drawn_all = (sum(counts[k] for _, *counts in rows) for k in (0, 1))
    line = f"{found['clean']} of {found['originals']} saved runs are without a fault, {found_all} of "
    line += f"{drawn_all} altered copies have one."
    return [line, "", *_table(("alteration", "found", "of"), rows)]


def long_run(found: dict[str, list[dict[str, float]]]) -> list[str]:
    """Memory, programs and files of very many missions."""
    columns = (("memory", "memory, MiB"), ("programs", "programs compiled"), ("files", "files open"))
    rows = []
    for sea, seen in found.items():
        last = seen[-1]
        warm = next(row for row in seen if row["missions"] >= last["missions"] / 10)
        cells = [f"{warm[key]:,.0f}, {last[key]:,.0f}" for key, _ in columns]
        rows.append([sea, f"{last['missions']:,.0f}", *cells, f"{last['failed']:.0f}"])
    words = (f"{words} after a tenth, at the end" for _, words in columns)
    return _table(("sea", "missions", *words, "failed"), rows)


def mutants(found: dict[str, Any]) -> list[str]:
    """Rules broken on purpose, which of them the tests notice, and why the others may live."""
    columns = ("file", "mutants", "killed")
    lines = _table(columns, [[row[name] for name in columns] for row in found["files"]])
    lines = [f"Drawn by `--seed {' '.join(map(str, found['seed']))}`.", "", *lines]
    key = "file", "source", "change"
    stated = tomllib.loads(REASONS.read_text(encoding="utf-8"))["mutant"]
    reasons = {tuple(row[name] for name in key): row["why"] for row in stated}
    if found["survivors"]:
        lines += ["", "Survivors:", ""]
    for row in found["survivors"]:
        why = reasons.get(tuple(row[name] for name in key))
        lines.append(f"- `{row['file']}:{row['line']}: {row['change']}`" + (f": {why}" if why else ""))
    return lines


_FAULTS = tabled({
    "fault": "{fault}", "missions": "{missions}", "on time": "{on time}", "failed: why": "{failed}",
    "avoidable collisions": "{avoidable}", "unavoidable": "{unavoidable}",
})  # fmt: skip
_BUDGETS = tabled({
    "call": "{call}", "machine": "{machine}", "budget, s": "{budget:g}", "median": "{median:+.1%}",
    "95 %": "{p95:+.1%}", "worst": "{worst:+.1%}", "beyond a tenth": "{beyond a tenth} of {calls}",
    "worse by": "{worse by:+.2%}",
})  # fmt: skip
_CRASHES = tabled({"command": "{command}", "what": "{kind}", "times": "{total}", "outcomes": "{outcomes}"})
_COUNTS = "jax", "numpy", "passed", "failed", "error", "skipped"
_VERSIONS = tabled({"": "{kind}"} | {name: f"{{{name}}}" for name in _COUNTS})

#: By name in the figures: heading, command, and what writes the lines below them.
SECTIONS: dict[str, tuple[str, str, Callable[[Any], list[str]]]] = {
    "faults": ("Faults on the way", "python -m benchmarks.faults", _FAULTS),
    "link_faults": ("Faults on a vehicle over a link", "python -m benchmarks.faults --link", _FAULTS),
    "budgets": ("Budgets of wall-clock time", "python -m benchmarks.budgets", _BUDGETS),
    "determinism": ("The same seed", "python -m benchmarks.determinism", determinism),
    "crashes": ("Kills and full disks", "python -m benchmarks.crashes", _CRASHES),
    "fuzz": ("Changed files", "python -m benchmarks.fuzz", fuzz),
    "alterations": ("Altered results", "python -m benchmarks.alterations DIR ...", alterations),
    "long_run": ("Very many missions in one process", "python -m benchmarks.long_run", long_run),
    "mutants": ("Mutants", "python tools/mutants.py", mutants),
    "versions": ("Versions", "python tools/versions.py", _VERSIONS),
}

HEAD = """# Reliability

How each capability is checked, and what happens when things go wrong. `python tools/reliability.py` writes
this page; an empty cell is a check that is missing.

Numbers count tests, names are benchmarks (`python -m benchmarks.NAME`). *Unit* tests state cases, *property*
tests draw them; an *independent check* compares with code that shares nothing with what is checked, a *peer*
is someone else's program or format, a *fault* is something that goes wrong on purpose.
"""


def page(figures: dict[str, Any]) -> str:
    """The page."""
    parts = [HEAD.rstrip().splitlines(), ["## Matrix", "", *matrix()]]
    for name, (heading, command, lines) in SECTIONS.items():
        if name in figures:
            parts.append([f"## {heading}", "", f"`{command}`", "", *lines(figures[name])])
    if machine := figures.get("machine"):
        parts.append([f"Figures: {machine['processor']}, {machine['cores']} cores."])
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def main() -> None:
    """Write the page, or compare it."""
    parser = argparse.ArgumentParser(description="The page on reliability.")
    parser.add_argument("--add", type=Path, nargs="*", default=[], help="JSON files of benchmarks")
    parser.add_argument("--check", action="store_true")
    options = parser.parse_args()
    figures = json.loads(FIGURES.read_text(encoding="utf-8")) if FIGURES.is_file() else {}
    for file in options.add:
        stated = json.loads(file.read_text(encoding="utf-8"))
        figures |= {name: stated[name] for name in (*SECTIONS, "machine") if name in stated}
    text = page(figures)
    if options.check:
        sys.exit(PAGE.read_text(encoding="utf-8") != text)
    FIGURES.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
