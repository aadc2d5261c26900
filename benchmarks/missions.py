"""Mission planning against proven optima and against other solvers.

``python -m benchmarks.missions`` prints one table and, with ``--out FILE.json``, writes the same as JSON. The
gap of a plan is 1 - priority / optimum; where no optimum is proved the least upper bound takes its place. A
plan that was not found, or breaks a rule of section 3.3, counts as priority zero. PyVRP runs on the
orienteering sets only, whose prizes sit on waypoints: it cannot express tasks on edges. The paper preset
minimises Eq. 15, which is not the most total priority.
"""

from collections.abc import Iterator
from functools import partial

from rich.console import Console
from rich.table import Table

import auvplan as ap
from benchmarks import mission_peers as peers
from benchmarks.machine import SHARED, arguments, bars, console, empty_table, installed, named_once, write
from benchmarks.mission_runs import Bench, Row, Solver, preset
from benchmarks.mission_sets import Case, generated_cases, shared_cases

LARGEST_BATCHED = 100
LARGEST_MEALPY = 64
PEER_SEEDS = 2


def variants() -> dict[str, ap.MissionConfig]:
    """What each part of the default preset is worth, one step at a time from the paper's."""
    paper, default = ap.MissionConfig.paper(), ap.MissionConfig()
    evolution = default.replace(seeds=0, local_rounds=0)
    return {
        "paper, total priority": paper.replace(objective="priority"),
        "and mutation of two SIVs": evolution.replace(decoder="timely"),
        "and the rate decoder": evolution,
        "and local search": default.replace(seeds=0),
        "beam search alone": default.replace(local_rounds=0, bbo=default.bbo.replace(iterations=0)),
        "evolution from the beam's routes": default.replace(local_rounds=0),
    }


def solvers(with_variants: bool, with_peers: bool, limit: float, console: Console) -> list[Solver]:
    """The presets, and with them the peers that are installed; a line for each that is not."""
    found = []
    presets = {"default": ap.MissionConfig(), "paper": ap.MissionConfig.paper()}
    for name, config in (presets | (variants() if with_variants else {})).items():
        plan = partial(preset, config=config)
        found.append(Solver(name, plan, compiles=partial(plan, seed=999)))
    if not with_peers:
        return found
    seconds = min(limit, 2.0)
    cp_sat = Solver("CP-SAT", lambda case, _: peers.cp_sat(case, limit).nodes, seeds=1)
    pyvrp = Solver(
        f"PyVRP, {seconds:g} s",
        lambda case, seed: peers.pyvrp(case, seed, seconds),
        seeds=PEER_SEEDS,
        fits=lambda case: case.prizes is not None,
    )
    mealpy = Solver(
        "mealpy OriginalBBO",
        peers.mealpy_bbo,
        compiles=partial(peers.mealpy_bbo, seed=0, population=5, iterations=1),
        seeds=PEER_SEEDS,
        fits=lambda case: case.graph.size <= LARGEST_MEALPY,
    )
    for solver, packages in ((cp_sat, ["ortools"]), (pyvrp, ["pyvrp"]), (mealpy, ["mealpy", "numba"])):
        missing = " and ".join(package for package in packages if not installed(package))
        if missing:
            console.print(f"{solver.name}: left out, {missing} not installed: pip install 'auvplan[bench]'")
        else:
            found.append(solver)
    return found


def families(quick: bool, console: Console) -> Iterator[tuple[str, list[Case]]]:
    """Cases by family; quick: one or two of each, of 200 waypoints at most."""
    cases = shared_cases()
    if not cases:
        console.print(f"shared graphs and orienteering sets: left out, not found at {SHARED}")
    cases += generated_cases(count=1 if quick else 3)
    groups: dict[str, list[Case]] = {}
    for case in cases:
        groups.setdefault(case.family, []).append(case)
    for family, members in groups.items():
        if quick and members[0].graph.size > 200:
            continue
        yield family, members[:: max(1, len(members) // 2)][:2] if quick else members


def optimum(case: Case, limit: float) -> tuple[float, bool]:
    """Total priority to compare with and whether it is proved."""
    return (case.optimum, True) if case.optimum is not None else peers.reference(case, limit)


def table(rows: list[Row]) -> Table:
    """All rows as one table."""
    figures = ("mean gap", "worst gap", "feasible", "time per plan", "compilation", "plans")
    shown = empty_table("Missions: gap to the proven optimum (* to a bound)", ["set", "solver"], figures)
    for name, row in named_once(rows, "family"):
        compilation = "-" if row.compile_seconds is None else f"{row.compile_seconds:.1f} s"
        sign = "+" if row.solver == "upper bound" else ""
        star = "" if row.proved == 1.0 else " *"
        shown.add_row(
            name, row.solver, f"{sign}{row.mean_gap:.2%}{star}",
            f"{sign}{row.worst_gap:.2%}", f"{row.feasible:.0%}", f"{1e3 * row.seconds:.1f} ms", compilation,
            str(row.plans),
        )  # fmt: skip
    return shown


def main() -> None:
    """Print the table and write the file."""
    parser = arguments("Missions against proven optima and other solvers.")
    parser.add_argument("--seeds", type=int, default=10, help="plans of each case")
    parser.add_argument("--quick", action="store_true", help="two cases of each set, two seeds, short limits")
    parser.add_argument("--peers", action="store_true", help="other solvers too")
    parser.add_argument("--variants", action="store_true", help="what each part of the default is worth")
    parser.add_argument("--only", nargs="+", help="families to run, such as knn40")
    options = parser.parse_args()
    seeds, limit = (min(options.seeds, 2), 10.0) if options.quick else (options.seeds, 60.0)
    screen = console()
    with bars(screen) as progress:
        sets = dict(families(options.quick, screen))
        sets = {name: cases for name, cases in sets.items() if not options.only or name in options.only}
        bench = Bench(seeds, progress)
        chosen = solvers(options.variants, options.peers, limit, screen)
        whole = progress.add_task("all", total=len(sets))
        for family, cases in sets.items():
            bench.compare_with({case.name: optimum(case, limit) for case in cases})
            bench.run_bound(family, cases)
            for solver in chosen:
                if all(solver.fits(case) for case in cases):
                    bench.run(family, cases, solver)
            if cases[0].graph.size <= LARGEST_BATCHED:
                bench.run_batched(family, cases, repeats=1 if options.quick else 3)
            if family == "knn40":
                bench.run_replanning(family, cases)
            progress.advance(whole)
        if "knn40" in sets and installed("ortools"):
            bench.run_eq15("knn40", sets["knn40"], limit)
        else:
            screen.print("Eq. 15: left out, it needs the shared graphs and OR-Tools")
    screen.print(table(bench.rows))
    write(options.out, {"seeds": seeds, "rows": bench.rows})


if __name__ == "__main__":
    main()
