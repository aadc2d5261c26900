"""Path planning against global references: ``python -m benchmarks.paths [--each]``.

The gap of a plan is travel time / reference - 1, both measured by `ruler`. A plan that breaks a limit has no
gap and lowers the feasible share. Times are of one plan, the compilation apart.
"""

from typing import Any

from benchmarks.harness import launch, screen
from benchmarks.paths.gaps import COMPILING, VARIANTS, plan_all, rows, show_gaps
from benchmarks.paths.problems import PRESETS, have_charts, path_problems


@launch(
    seeds=(5, "plans of each problem"),
    only=((), "families or problems, such as coast or open-03"),
    preset=(("default", "paper"), "to plan with", [*PRESETS, *VARIANTS]),
    each=(False, "a row for each problem too"),
)
def main(seeds: int, only: list[str], preset: list[str], each: bool) -> dict[str, Any]:
    if not have_charts():
        screen.print("problems on real coast: left out, the shared maps were not found")
    chosen = [one for one in path_problems() if not only or {one.family, one.name} & set(only)]
    runs = plan_all(chosen, preset, seeds)
    families, problems = rows(runs, "family"), rows(runs, "problem")
    if each:
        show_gaps("Each problem: gap to the reference", problems, **COMPILING)
    show_gaps("Paths: gap to the reference", families, **COMPILING)
    return {"seeds": seeds, "families": families, "problems": problems, "runs": runs}
