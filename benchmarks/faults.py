"""Missions in which something goes wrong on purpose: does each end safely, and say why it ended as it did?

`python -m benchmarks.faults [-n 200]` simulates missions of the shipped Whitsunday scenario, a share of them
with each kind of fault of `auvplan.simulation.faults`, a share with several. It ends with status 1 where a
collision could have been avoided when it was sensed, or a mission ended without a reason.
"""

import sys
from collections import Counter
from collections.abc import Callable

import numpy as np

import auvplan as ap
from auvplan.executive import execute_missions
from auvplan.executive.collisions import Collision, collisions
from auvplan.simulation.faults import (
    CurrentStep,
    Fault,
    HeldUp,
    Obstacle,
    PlannerOut,
    SensorOut,
    Slower,
    WrongForecast,
)
from benchmarks.machine import arguments, screen, show, track, write

Draw = Callable[[np.random.Generator, float], Fault]


def _step(rng: np.random.Generator, at: float, known: bool) -> Fault:
    direction, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.0)
    return CurrentStep(at, (speed * np.cos(direction), speed * np.sin(direction)), known)


def _obstacle(rng: np.random.Generator, at: float, gap: tuple[float, float]) -> Fault:
    """An obstacle so many metres ahead, its centre up to 20 m to a side, that moves at up to 0.5 m/s."""
    radius, aside = rng.uniform(20.0, 60.0), rng.uniform(-20.0, 20.0)
    ahead = np.sqrt((radius + rng.uniform(*gap)) ** 2 - aside**2)
    heading, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.5)
    velocity = speed * np.cos(heading), speed * np.sin(heading)
    return Obstacle(at, float(ahead), float(aside), float(radius), velocity)


#: A fault of each kind at a time, s.
KINDS: dict[str, Draw] = {
    "current steps, forecast": lambda rng, at: _step(rng, at, known=True),
    "current steps, unknown": lambda rng, at: _step(rng, at, known=False),
    "forecast wrong by a factor": lambda rng, at: WrongForecast(
        at, float(rng.choice([0.0, 0.5, 1.5, 2.0, -1.0]))
    ),
    "obstacle 50 to 300 m ahead": lambda rng, at: _obstacle(rng, at, (50.0, 300.0)),
    "obstacle within 5 m": lambda rng, at: _obstacle(rng, at, (0.5, 5.0)),
    "sensor out": lambda rng, at: SensorOut(at, rng.uniform(60.0, 1800.0)),
    "held up": lambda rng, at: HeldUp(at, rng.uniform(60.0, 1800.0)),
    "planner out": lambda rng, at: PlannerOut(at, rng.uniform(30.0, 600.0)),
    "vehicle slower": lambda rng, at: Slower(at, rng.uniform(0.6, 0.95)),
}

#: What the last share of missions has: two to six faults of any kind.
MIXED = "several of these"


def draw(kind: str, rng: np.random.Generator, time_available: float) -> list[Fault]:
    """Draw the faults of a mission, by the time they strike: one to three of a kind, or several of any."""
    several = kind == MIXED
    count = rng.integers(2, 7) if several else rng.integers(1, 4)
    names = rng.choice(list(KINDS), count) if several else [kind] * count
    times = np.sort(rng.uniform(0.0, 0.9 * time_available, count))
    return [KINDS[str(name)](rng, float(at)) for name, at in zip(names, times, strict=True)]


def simulate(
    scenario: ap.Scenario, count: int
) -> list[tuple[str, list[Fault], ap.MissionRun, list[Collision]]]:
    """Simulate missions of seeds 0, 1, ...; return kind, faults, record and collisions of each."""
    names, found = [*KINDS, MIXED], []
    kinds = [names[seed % len(names)] for seed in range(count)]
    available = scenario.mission.time_available
    faults = [draw(kind, np.random.default_rng([7, seed]), available) for seed, kind in enumerate(kinds)]
    runs = execute_missions(scenario, seeds=range(count), faults=faults)
    for number, run in track(runs, "missions", count):
        found.append((kinds[number], faults[number], run, collisions(run, faults[number])))
    return sorted(found, key=lambda row: row[2].seed)


def _cause(reason: str) -> str:
    """What missions that fail alike have in common: the reason without its places and figures."""
    causes = ("no route", "beat the vehicle", "time ran out", "too late", "cannot be executed")
    return next((words for words in causes if words in reason), reason or "NO REASON")


def main() -> None:
    parser = arguments("Missions with injected faults.")
    parser.add_argument("-n", type=int, default=200, help="missions")
    options = parser.parse_args()
    rows, wrong = [], []
    found = simulate(ap.load_scenario("whitsunday"), options.n)
    for name in [*KINDS, MIXED, "all"]:
        chosen = [row for row in found if name in (row[0], "all")]
        failed = Counter(_cause(run.reason) for _, _, run, _ in chosen if not run.success)
        hits = [hit.avoidable for *_, hits in chosen for hit in hits]
        rows.append({
            "fault": name, "missions": len(chosen), "on time": sum(run.success for _, _, run, _ in chosen),
            "failed": dict(failed), "avoidable": sum(hits), "unavoidable": len(hits) - sum(hits),
            "causes": ", ".join(f"{words} {times}" for words, times in failed.most_common()),
        })  # fmt: skip
    for _, given, run, hits in found:
        wrong += [f"seed {run.seed}: {hit}; {given}" for hit in hits if hit.avoidable]
        wrong += [] if run.reason else [f"seed {run.seed}: ended without a reason; {given}"]
    counts = {name: f"{{{name}}}" for name in ("missions", "on time", "avoidable", "unavoidable")}
    show("injected faults", rows, {"fault": "{fault}"} | counts | {"failed": "{causes}"})
    for line in wrong:
        screen.print(line, soft_wrap=True)
    write(options.out, {"faults": rows, "wrong": wrong})
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
