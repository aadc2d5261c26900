"""Mission planning against proven optima and against other solvers: ``python -m benchmarks.missions``.

The gap of a plan is 1 - priority / optimum, or to the least upper bound where no optimum is proved. A plan
that was not found, or breaks a rule of section 3.3, counts as priority zero. PyVRP, which cannot express
tasks on edges, runs on the orienteering sets only. The paper preset minimises Eq. 15, which is not the most
total priority.
"""

from typing import Any

from benchmarks.harness import installed, launch, screen, show
from benchmarks.missions.bench import LARGEST_BATCHED, Bench, families, solvers

COLUMNS = {
    "set": "{family}", "solver": "{solver}", "mean gap": "{sign}{mean_gap:.2%}{star}",
    "worst gap": "{sign}{worst_gap:.2%}", "feasible": "{feasible:.0%}",
    "time per plan": "{milliseconds:.1f} ms", "compilation": "{compile_seconds:.1f} s", "plans": "{plans}",
}  # fmt: skip


@launch(
    seeds=(10, "plans of each case"),
    peers=(False, "other solvers too"),
    variants=(False, "what each part of the default is worth"),
    only=((), "families to run, such as knn40"),
)
def main(seeds: int, peers: bool, variants: bool, only: list[str]) -> dict[str, Any]:
    sets = {name: cases for name, cases in families().items() if not only or name in only}
    bench, chosen = Bench(seeds), solvers(variants, peers)
    for family, cases in sets.items():
        bench.compare_with_optima(cases)
        bench.run_bound(family, cases)
        for solver in chosen:
            if all(solver.fits(case) for case in cases):
                bench.run(family, cases, solver)
        if cases[0].graph.size <= LARGEST_BATCHED:
            bench.run_batched(family, cases)
        if family == "knn40":
            bench.run_replanning(family, cases)
    if "knn40" in sets and installed("ortools"):
        bench.run_eq15("knn40", sets["knn40"])
    else:
        screen.print("Eq. 15: left out, it needs the shared graphs and OR-Tools")
    show("Missions: gap to the proven optimum (* to a bound)", bench.rows, COLUMNS, names=2)
    return {"seeds": seeds, "rows": bench.rows}
