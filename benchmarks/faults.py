"""Missions in which something goes wrong on purpose: does each end safely, and say why it ended as it did?

`python -m benchmarks.faults [-n 200]` simulates missions of the shipped Whitsunday scenario, a share of them
with each kind of fault of `auvplan.simulation.faults`, a share with several; with `--link` the same
missions, and more with what can strike a vehicle on a link, are executed as on a vehicle at sea, on
`SimulatedVehicle`. It ends with status 1 where a collision could have been avoided when it was sensed, or a
mission ended without a reason.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

import auvplan as ap
from auvplan.executive import execute_missions
from auvplan.link import execute
from auvplan.link.rolling import Prospect, RollingPlan
from auvplan.link.simulated import SimulatedVehicle
from auvplan.simulation import faults as injected
from benchmarks.collisions import Collision, collisions
from benchmarks.harness import Rng, grouped, launch, screen, show, track

Draw = Callable[[Rng, float], injected.Fault]


def _step(rng: Rng, at: float, known: bool) -> injected.Fault:
    direction, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.0)
    return injected.CurrentStep(at, (speed * np.cos(direction), speed * np.sin(direction)), known)


def _obstacle(rng: Rng, at: float, gap: tuple[float, float]) -> injected.Fault:
    """An obstacle so many metres ahead, its centre up to 20 m to a side, that moves at up to 0.5 m/s."""
    radius, aside = rng.uniform(20.0, 60.0), rng.uniform(-20.0, 20.0)
    ahead = np.sqrt((radius + rng.uniform(*gap)) ** 2 - aside**2)
    heading, speed = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.0, 0.5)
    velocity = speed * np.cos(heading), speed * np.sin(heading)
    return injected.Obstacle(at, float(ahead), float(aside), float(radius), velocity)


#: A fault of each kind at a time, s.
KINDS: dict[str, Draw] = {
    "current steps, forecast": lambda rng, at: _step(rng, at, known=True),
    "current steps, unknown": lambda rng, at: _step(rng, at, known=False),
    "forecast wrong by a factor": lambda rng, at: injected.WrongForecast(
        at, float(rng.choice([0.0, 0.5, 1.5, 2.0, -1.0]))
    ),
    "obstacle 50 to 300 m ahead": lambda rng, at: _obstacle(rng, at, (50.0, 300.0)),
    "obstacle within 5 m": lambda rng, at: _obstacle(rng, at, (0.5, 5.0)),
    "sensor out": lambda rng, at: injected.SensorOut(at, rng.uniform(60.0, 1800.0)),
    "held up": lambda rng, at: injected.HeldUp(at, rng.uniform(60.0, 1800.0)),
    "planner out": lambda rng, at: injected.PlannerOut(at, rng.uniform(30.0, 600.0)),
    "vehicle slower": lambda rng, at: injected.Slower(at, rng.uniform(0.6, 0.95)),
}

#: What strikes a vehicle on a link besides.
OF_A_LINK: dict[str, Draw] = {
    "link out": lambda rng, at: injected.LinkOut(at, rng.uniform(30.0, 1200.0)),
    "vehicle gives up": lambda rng, at: injected.GivesUp(at),
    "taken over": lambda rng, at: injected.TakenOver(at),
    "computer starts anew": lambda rng, at: injected.Restarts(at),
}

#: What the last share of missions has: two to six faults of any kind.
MIXED = "several of these"


class Outcome(NamedTuple):
    kind: str
    faults: list[injected.Fault]
    seed: int
    success: bool
    reason: str
    hits: list[Collision]


class Planner(RollingPlan):
    """A planner that answers nothing for some time, by the vehicle's clock."""

    def strike(self, faults: list[injected.Fault], vehicle: SimulatedVehicle) -> None:
        self._faults, self._vehicle = injected.Faults(faults), vehicle

    def _out(self) -> bool:
        out = self._faults.left(injected.PlannerOut, self._vehicle.now) > 0.0
        self.reason = "the planner is out" if out else self.reason
        return out

    def from_leg(self, count: int, now: float, late: bool = False) -> Prospect | None:
        return None if self._out() else super().from_leg(count, now, late)

    def from_position(self, count: int, position: np.ndarray, now: float) -> Prospect | None:
        return None if self._out() else super().from_position(count, position, now)


def draw(kind: str, kinds: dict[str, Draw], rng: Rng, time_available: float) -> list[injected.Fault]:
    """Draw the faults of a mission, by the time they strike: one to three of a kind, or several of any."""
    several = kind == MIXED
    count = rng.integers(2, 7) if several else rng.integers(1, 4)
    names = rng.choice(list(kinds), count) if several else [kind] * count
    times = np.sort(rng.uniform(0.0, 0.9 * time_available, count))
    return [kinds[str(name)](rng, float(at)) for name, at in zip(names, times, strict=True)]


def outcomes(
    scenario: ap.Scenario, kinds: list[str], faults: list[list[injected.Fault]], link: bool
) -> Iterator[Outcome]:
    """Simulate missions of seeds 0, 1, ..., or execute them as on vehicles at sea."""
    if not link:
        for number, run in execute_missions(scenario, seeds=range(len(faults)), faults=faults):
            struck = faults[number]
            yield Outcome(kinds[number], struck, run.seed, run.success, run.reason, collisions(run, struck))
        return
    for seed, struck in enumerate(faults):
        plan, vehicle = Planner(scenario, seed), SimulatedVehicle(scenario, seed, faults=struck)
        plan.strike(struck, vehicle)
        record = execute(plan, vehicle, notices=vehicle)
        hits = collisions(vehicle.record(), struck)
        yield Outcome(kinds[seed], struck, seed, record.success, record.reason, hits)


#: What missions that fail alike have in common: the reason without its places and figures.
_CAUSES = (
    "no route", "beat the vehicle", "time ran out", "too late", "cannot be executed", "overdue",
    "no longer on its plan", "in a state of fault", "no way made", "off its track", "is in the way",
    "no plan from here",
)  # fmt: skip


def summed(name: str, found: list[Outcome]) -> dict[str, Any]:
    why = [row.reason for row in found if not row.success]
    failed = Counter(next((words for words in _CAUSES if words in one), one or "NO REASON") for one in why)
    hits = [hit.avoidable for row in found for hit in row.hits]
    return {
        "fault": name, "missions": len(found), "on time": sum(row.success for row in found),
        "failed": dict(failed), "avoidable": sum(hits), "unavoidable": len(hits) - sum(hits),
        "causes": ", ".join(f"{words} {times}" for words, times in failed.most_common()),
    }  # fmt: skip


@launch(n=(200, "missions"), link=(False, "as on a vehicle at sea"))
def main(n: int, link: bool) -> tuple[dict[str, Any], bool]:
    scenario, kinds, wrong = ap.load_scenario("whitsunday"), KINDS | OF_A_LINK if link else KINDS, []
    names, available = [*kinds, MIXED], scenario.mission.time_available
    struck = [names[seed % len(names)] for seed in range(n)]
    faults = [
        draw(kind, kinds, np.random.default_rng([7, seed]), available) for seed, kind in enumerate(struck)
    ]
    found = list(track(outcomes(scenario, struck, faults, link), "missions", n))
    groups = grouped(found, lambda row: [row.kind, "all"])
    rows = [summed(name, groups.get(name, [])) for name in [*names, "all"]]
    for row in sorted(found, key=lambda row: row.seed):
        wrong += [f"seed {row.seed}: {hit}; {row.faults}" for hit in row.hits if hit.avoidable]
        wrong += [] if row.reason else [f"seed {row.seed}: ended without a reason; {row.faults}"]
    counts = {name: f"{{{name}}}" for name in ("missions", "on time", "avoidable", "unavoidable")}
    show("injected faults", rows, {"fault": "{fault}"} | counts | {"failed": "{causes}"})
    for line in wrong:
        screen.print(line, soft_wrap=True)
    return {"link_faults" if link else "faults": rows, "wrong": wrong}, bool(wrong)
