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
from collections.abc import Callable, Iterator
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
#: tests; then, for the other kinds, files of tests, single ones (file::test), or modules of benchmarks.
CAPABILITIES: dict[str, dict[str, tuple[str, ...]]] = {
    "Currents and their interpolation": {
        "tests": (
            "tests/ocean/test_currents.py",
            "tests/ocean/test_gridded.py",
            "tests/ocean/test_interpolation.py",
        ),
        "independent": ("tests/simulation/test_model_sea.py",),
        "peer": ("benchmarks.gridded",),
    },
    "Coast and sea bed": {
        "tests": ("tests/ocean/test_chart.py", "tests/ocean/test_seabed.py", "tests/path/test_seabed.py"),
        "independent": ("tests/check/test_check_seabed.py", "benchmarks.water_land"),
        "fault": ("tests/faults/test_machine.py",),
    },
    "Obstacles and clearance": {
        "tests": (
            "tests/ocean/test_obstacles.py",
            "tests/ocean/test_known.py",
            "tests/path/test_clearance.py",
        ),
        "independent": ("benchmarks.path_walks", "tests/check/test_track.py"),
        "fault": ("tests/faults/test_machine.py", "benchmarks.faults"),
    },
    "Paths": {
        "tests": (
            "tests/path/test_planner.py",
            "tests/path/test_cost.py",
            "tests/path/test_passages.py",
            "tests/path/test_stages.py",
            "tests/path/test_loops.py",
            "tests/path/test_reasons.py",
        ),
        "independent": ("benchmarks.waters", "benchmarks.path_arrivals"),
        "peer": ("benchmarks.plans", "benchmarks.paths"),
    },
    "Re-plans under way": {
        "tests": ("tests/path/test_reuse.py", "tests/path/test_outlook.py"),
        "independent": ("benchmarks.path_replans",),
        "fault": ("tests/faults/test_machine.py", "benchmarks.faults"),
    },
    "Routes": {
        "tests": (
            "tests/mission/test_decoder.py",
            "tests/mission/test_beam.py",
            "tests/mission/test_local_search.py",
            "tests/mission/test_mission_planner.py",
            "tests/mission/test_graph.py",
            "tests/mission/test_feasibility.py",
            "tests/mission/test_travel_times.py",
        ),
        "independent": ("tests/mission/test_exact.py", "tests/mission/test_bound.py"),
        "peer": ("benchmarks.missions",),
    },
    "Time-dependent routing": {
        "tests": ("tests/mission/test_timetable.py", "tests/executive/test_clock.py"),
        "independent": ("benchmarks.clock", "benchmarks.windows", "tests/check/test_windows.py"),
        "peer": ("benchmarks.clock_peers",),
    },
    "The executive": {
        "tests": (
            "tests/executive/test_executive.py",
            "tests/executive/test_loop.py",
            "tests/executive/test_route_calls.py",
            "tests/executive/test_visits.py",
            "tests/executive/test_whole_lines.py",
            "tests/faults/test_rules.py",
        ),
        "independent": ("tests/executive/test_coasts.py",),
        "fault": ("tests/faults/test_machine.py", "tests/faults/test_faults.py", "benchmarks.faults"),
    },
    "Vehicles over a link": {
        "tests": ("tests/link/test_execution.py", "tests/link/test_upload.py", "tests/link/test_notices.py"),
        "peer": (
            "tests/link/test_mavlink.py",
            "tests/link/test_ardusub.py",
            "tests/link/test_imc.py",
            "benchmarks.links",
        ),
        "fault": (
            "tests/link/test_execution.py",
            "tests/link/test_simulated.py",
            "benchmarks.links",
            "benchmarks.faults",
        ),
    },
    "Simulation": {
        "tests": ("tests/executive/test_truth_and_belief.py", "tests/simulation/test_model_sea.py"),
        "fault": ("tests/faults/test_faults.py",),
    },
    "Budgets of wall-clock time": {
        "tests": ("tests/runtime/test_budget.py",),
        "fault": ("benchmarks.budgets",),
    },
    "The same seed, the same result": {
        "tests": (
            "tests/executive/test_executive.py::test_a_mission_does_not_depend_on_those_beside_it",
            "tests/executive/test_executive.py::test_same_key_same_mission_and_later_ones_compile_nothing",
        ),
        "fault": ("benchmarks.determinism",),
    },
    "Studies": {
        "tests": (
            "tests/study/test_runner.py",
            "tests/study/test_design.py",
            "tests/study/test_statistics.py",
        ),
        "peer": ("tests/study/test_statistics.py",),
        "fault": ("tests/study/test_resume.py", "tests/study/test_cluster.py", "benchmarks.resilience"),
    },
    "Results on disk": {
        "tests": ("tests/io/test_results.py", "tests/io/test_restore.py", "tests/io/test_whole_result.py"),
        "peer": ("tests/export/test_schemas.py",),
        "fault": (
            "tests/faults/test_disk.py",
            "benchmarks.crashes",
            "benchmarks.resilience",
            "benchmarks.fuzz",
        ),
    },
    "The checker": {
        "tests": (
            "tests/check/test_check.py",
            "tests/check/test_check_limits.py",
            "tests/check/test_track.py",
            "tests/check/test_sources.py",
        ),
        "fault": ("benchmarks.alterations",),
    },
    "Readers of currents": {
        "tests": ("tests/io/currents/test_reading.py", "tests/io/currents/test_formats.py"),
        "independent": ("tests/io/currents/test_real_files.py",),
        "peer": ("benchmarks.files",),
        "fault": (
            "tests/io/currents/test_malformed.py",
            "tests/io/currents/test_altered.py",
            "benchmarks.fuzz",
        ),
    },
    "Charts, jobs, sea beds from files": {
        "tests": (
            "tests/io/geo/test_charts.py",
            "tests/io/geo/test_s57.py",
            "tests/io/geo/test_jobs.py",
            "tests/io/geo/test_bathymetry.py",
        ),
        "peer": ("benchmarks.file_rasters",),
        "fault": (
            "tests/io/geo/test_damage.py",
            "tests/io/geo/test_bathymetry_faults.py",
            "benchmarks.fuzz",
        ),
    },
    "Scenarios": {
        "tests": ("tests/io/test_scenario_file.py", "tests/io/test_examine.py"),
        "fault": ("tests/io/test_bad_input.py", "benchmarks.fuzz"),
    },
    "Vehicle files": {
        "tests": (
            "tests/export/test_export.py",
            "tests/export/test_qgroundcontrol.py",
            "tests/export/test_imc.py",
        ),
        "peer": ("tests/export/test_formats.py", "tests/export/test_schemas.py"),
        "fault": ("benchmarks.crashes",),
    },
    "Pages and pictures": {
        "tests": ("tests/report/test_pages.py", "tests/plot/test_figures.py"),
        "independent": ("tests/report/test_browser.py",),
        "fault": ("benchmarks.crashes",),
    },
    "The optimiser": {
        "tests": ("tests/bbo/test_search.py", "tests/bbo/test_operators.py", "tests/bbo/test_rates.py"),
        "peer": ("benchmarks.bbob",),
    },
}


def functions(place: str) -> Iterator[ast.FunctionDef]:
    """Tests of a file, or the one named after `::`.

    Raises:
        SystemExit: there is none.
    """
    file, _, name = place.partition("::")
    path = ROOT / file
    if not path.is_file():
        raise SystemExit(f"{file}: no such file")
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    found = [node for node in nodes if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")]
    chosen = [node for node in found if name in ("", node.name)]
    if not chosen:
        raise SystemExit(f"{place}: no such test")
    yield from chosen


def drawn(test: ast.FunctionDef) -> bool:
    """Whether a test's cases are drawn by Hypothesis, or by rules fired at random."""
    return any("given" in ast.unparse(mark) for mark in test.decorator_list) or "fired(" in ast.unparse(test)


def cell(capability: str, kind: str) -> str:
    """What the matrix says of a capability and a kind of check; empty where there is none."""
    places = CAPABILITIES[capability]
    if kind in ("unit", "property"):
        count = sum(
            drawn(test) == (kind == "property") for place in places["tests"] for test in functions(place)
        )
        return str(count) if count else ""
    words = []
    tests = [place for place in places.get(kind, ()) if place.startswith("tests/")]
    if tests:
        words.append(str(sum(len(list(functions(place))) for place in tests)))
    for place in places.get(kind, ()):
        if place.startswith("benchmarks."):
            if not (ROOT / (place.replace(".", "/") + ".py")).is_file():
                raise SystemExit(f"{place}: no such benchmark")
            words.append(f"`{place.removeprefix('benchmarks.')}`")
    return ", ".join(words)


def matrix() -> list[str]:
    """Table of capabilities and kinds of checks."""
    rows = [[capability, *(cell(capability, kind) for kind in KINDS)] for capability in CAPABILITIES]
    return [
        row.replace("|  |", "| |").replace("|  |", "| |")
        for row in _table(("capability", *KINDS.values()), rows)
    ]


def _table(headings: tuple[str, ...], rows: list[list[Any]]) -> list[str]:
    lines = ["| " + " | ".join(headings) + " |", "|---" * len(headings) + "|"]
    return lines + ["| " + " | ".join(map(str, row)) + " |" for row in rows]


def _said(counts: dict[str, int]) -> str:
    return ", ".join(f"{name} {times}" for name, times in counts.items())


def faults(found: list[dict[str, Any]]) -> list[str]:
    """Missions with injected faults."""
    names = ("fault", "missions", "on time", "failed", "avoidable", "unavoidable")
    rows = [[_said(row[name]) if name == "failed" else row[name] for name in names] for row in found]
    return _table((*names[:3], "failed: why", "avoidable collisions", names[-1]), rows)


def budgets(found: list[dict[str, Any]]) -> list[str]:
    """Overruns of budgets."""
    rows = [
        [row["call"], row["machine"], f"{row['budget']:g}"]
        + [f"{100.0 * row[part]:+.1f} %" for part in ("median", "p95", "worst")]
        + [f"{row['beyond a tenth']} of {row['calls']}", f"{100.0 * row['worse by']:+.2f} %"]
        for row in found
    ]
    return _table(
        ("call", "machine", "budget, s", "median", "95 %", "worst", "beyond a tenth", "worse by"), rows
    )


def determinism(found: list[dict[str, str]]) -> list[str]:
    """Whether summaries are the same."""
    same = sum(row["digest"] == found[0]["digest"] for row in found)
    others = [row["how"] for row in found if row["digest"] != found[0]["digest"]]
    line = f"{same} of {len(found)} summaries are the same to the byte, clock times left out"
    line += f"; different: {', '.join(others)}." if others else "."
    return [line, "", f"Compared: {', '.join(row['how'] for row in found)}."]


def crashes(found: list[dict[str, Any]]) -> list[str]:
    """What kills and full disks leave."""
    rows = [
        [row["command"], row["kind"], sum(row["outcomes"].values()), _said(row["outcomes"])] for row in found
    ]
    return _table(("command", "what", "times", "outcomes"), rows)


def fuzz(found: list[dict[str, Any]]) -> list[str]:
    """Changed files for every reader."""
    columns = ("reader", "cases", "read", "refused", "failures")
    rows = [[*(row[name] for name in columns), f"{row['memory']:.0f}"] for row in found]
    lines = _table((*columns, "most memory, MiB"), rows)
    failed = [f"- {row['reader']}: `{one['found']}`" for row in found for one in row["failed"]]
    return lines + (["", "Failures:", "", *dict.fromkeys(failed)] if failed else [])


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


def versions(found: list[dict[str, Any]]) -> list[str]:
    """The tests under the lowest and the newest versions."""
    names = ("kind", "jax", "numpy", "passed", "failed", "error", "skipped")
    return _table(("", *names[1:]), [[row.get(name, 0) for name in names] for row in found])


#: By name in the figures: heading, command, and what writes the lines below them.
SECTIONS: dict[str, tuple[str, str, Callable[[Any], list[str]]]] = {
    "faults": ("Faults on the way", "python -m benchmarks.faults", faults),
    "link_faults": ("Faults on a vehicle over a link", "python -m benchmarks.faults --link", faults),
    "budgets": ("Budgets of wall-clock time", "python -m benchmarks.budgets", budgets),
    "determinism": ("The same seed", "python -m benchmarks.determinism", determinism),
    "crashes": ("Kills and full disks", "python -m benchmarks.crashes", crashes),
    "fuzz": ("Changed files", "python -m benchmarks.fuzz", fuzz),
    "alterations": ("Altered results", "python -m benchmarks.alterations DIR ...", alterations),
    "long_run": ("Very many missions in one process", "python -m benchmarks.long_run", long_run),
    "mutants": ("Mutants", "python tools/mutants.py", mutants),
    "versions": ("Versions", "python tools/versions.py", versions),
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
