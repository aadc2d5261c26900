"""All benchmarks of the path layer: ``python -m benchmarks [--out FILE.json] [--quick]``."""

from dataclasses import asdict
from typing import Any

from benchmarks import path_replans, path_walks, plans, scoring
from benchmarks.harness import grouped, launch, screen, show
from benchmarks.paths import gaps
from benchmarks.paths.problems import path_problems


def against_references(quick: bool) -> list[dict[str, Any]]:
    """Rows of `benchmarks.paths` by family, and of the default's parts on the random problems.

    Quick: two problems of each family with one seed, and the default alone.
    """
    families = grouped(path_problems(), lambda problem: [problem.family])
    chosen = [problem for members in families.values() for problem in (members[:2] if quick else members)]
    random = [problem for problem in chosen if problem.family != "literature"]
    asked = [("gap to the reference", chosen, ["default", "paper"], 1 if quick else 5)]
    asked += [] if quick else [("the default without some of its parts", random, list(gaps.VARIANTS), 1)]
    found = []
    for title, problems, presets, seeds in asked:
        rows = gaps.rows(gaps.plan_all(problems, presets, seeds), "family")
        gaps.show_gaps(f"Paths: {title}", rows, **gaps.COMPILING)
        found += rows
    return found


@launch(quick=(False, "few rounds and seeds"))
def main(quick: bool) -> dict[str, Any]:
    scored = scoring.rows(5 if quick else scoring.ROUNDS)
    show(scoring.TITLE, scored, scoring.COLUMNS, names=2)
    planned = plans.rows(2 if quick else plans.SEEDS)
    show(plans.TITLE, planned, plans.COLUMNS)
    compared = against_references(quick)
    replans = path_replans.rows(4 if quick else path_replans.SITUATIONS)
    show(path_replans.TITLE, replans, path_replans.COLUMNS)
    walked = path_walks.walks(200 if quick else path_walks.COUNT)
    screen.print(path_walks.said(walked))
    parts = {"scoring": scored, "plans": planned, "paths": compared, "replans": replans}
    return {"quick": quick, **parts, "walks": asdict(walked)}
