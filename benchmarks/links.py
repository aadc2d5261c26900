"""Executes missions on other people's vehicle code over a link that loses packets.

`python -m benchmarks.links`: twenty missions by MAVSDK's autopilot side and twenty by a peer of imcpy's
messages, each behind a proxy that loses, doubles and delays packets. Counted are verdicts, uploads that are
what was planned, item by item, and tasks by the vehicles' own books. With `--random` three to eight things
happen at random moments of each mission: obstacles and currents are reported, nothing is heard, the vehicle
makes no way, is driven off or ends its plan, by itself or by others. `--link ADDRESS -n 5`: missions on a
running vehicle, one after another; `--current` gives them the current that the vehicle's simulator has, m/s
north and east.
"""

import json
import os
import random
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from auvplan.io.area import load_area
from auvplan.link import Limits, execute, open_link
from auvplan.link.notices import CurrentNotice, GoneNotice, ObstacleNotice
from auvplan.link.rolling import RollingPlan
from auvplan.ocean.known import KnownObstacle
from auvplan.scenario.file import load_scenario
from auvplan.site import Site
from benchmarks.harness import SCENARIOS, launch
from tests.link.joining import Faults, body_at, held_as_planned, joined

#: Known beforehand, and so in the fence.
WRECK = KnownObstacle("wreck", (1300.0, 1200.0), 60.0)

#: Replies are waited for a shorter time than on real links: loopback is quick, and mission time is scaled.
LIMITS = Limits(reply=0.3, attempts=20, uploads=8, silence=3.0, outdated=0.2, late=60.0)


class Events:
    """Rules fired at moments of a mission: what is reported, what happens to vehicle and link."""

    def __init__(self, link, plan: RollingPlan, peer, proxy, seed: int, eventful: bool) -> None:
        self._link, self._plan, self._peer, self._proxy = link, plan, peer, proxy
        self._random = rng = random.Random(1000 + seed)
        self.fired: list[str] = []
        self._reported: list = []
        self._due: list = []
        if not eventful:
            rules = [self.ahead, self.steady]
            self._due += [(300.0 + 40.0 * seed, rules[seed % 3 - 1])] if seed % 3 else []
            return
        rules = [self.obstacle, self.gone, self.current, self.silence, self.stuck, self.driven]
        if hasattr(peer, "abort"):
            rules += [peer.restart, peer.halt]
        ends = [getattr(peer, name) for name in ("abort", "stop") if hasattr(peer, name)]
        times = sorted(rng.uniform(0.0, 2200.0) for _ in range(rng.randint(3, 8)))
        self._due += [(time, rng.choice(rules)) for time in times]
        if ends and rng.random() < 0.3:
            self._due.append((rng.uniform(200.0, 2200.0), rng.choice(ends)))

    def read(self):
        """Fire what is due, and yield what is reported."""
        while due := [rule for rule in self._due if rule[0] <= self._link.now]:
            self._due.remove(due[0])
            self.fired.append(due[0][1].__name__)
            due[0][1]()
        reported, self._reported = self._reported, []
        yield from reported

    def _later(self, name: str, seconds: float, undo) -> None:
        undo.__name__ = f"end of {name}"
        self._due.append((self._link.now + seconds, undo))

    def ahead(self) -> None:
        """An obstacle amid a leg that is ahead."""
        ahead = [leg for leg in self._plan.legs if leg.times[0] > self._link.now] or self._plan.legs[-1:]
        north, east, _ = ahead[0].positions[len(ahead[0].positions) // 2]
        self._reported.append(ObstacleNotice(KnownObstacle("reported", (float(north), float(east)), 40.0)))

    def steady(self) -> None:
        self._reported.append(CurrentNotice(np.array([0.25, -0.15, 0.0])))

    def obstacle(self) -> None:
        """One to any side of the vehicle, that stands or comes its way."""
        rng, place = self._random, self._link.report(0.0).position
        if place is None:
            return
        angle, away = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(60.0, 300.0)
        speed = rng.choice([0.0, 0.5, 1.0])
        side = np.array([np.cos(angle), np.sin(angle)])
        north, east = (place[:2] + away * side).tolist()
        moves = tuple((-speed * side).tolist())
        name, radius = f"obstacle {rng.randint(0, 2)}", rng.uniform(10.0, 40.0)
        self._reported.append(ObstacleNotice(KnownObstacle(name, (north, east), radius, velocity=moves)))

    def gone(self) -> None:
        self._reported.append(GoneNotice(f"obstacle {self._random.randint(0, 2)}"))

    def current(self) -> None:
        north, east = (self._random.uniform(-0.4, 0.4) for _ in range(2))
        self._reported.append(CurrentNotice(np.array([north, east, 0.0])))

    def silence(self) -> None:
        self._proxy.dead = True
        self._later("silence", self._random.uniform(60.0, 600.0), lambda: setattr(self._proxy, "dead", False))

    def stuck(self) -> None:
        body = self._peer.body
        body.stuck = True
        self._later("stuck", self._random.uniform(60.0, 400.0), lambda: setattr(body, "stuck", False))

    def driven(self) -> None:
        body = self._peer.body
        body.push = self._random.uniform(-1.5, 1.5), self._random.uniform(-1.5, 1.5)
        self._later("driven", self._random.uniform(60.0, 200.0), lambda: setattr(body, "push", (0.0, 0.0)))


def books(record, plan: RollingPlan, peer, reach: float) -> tuple[int, int]:
    """Tasks that the record has and the vehicle's own books lack, and those that it did more than once.

    They are the same within `reach` m: a vehicle that is driven off does them where it is.
    """
    site, places = plan.site, []
    for task in peer.tasks:
        north, east = site.to_local(task.longitude, task.latitude)
        places.append((float(north), float(east), task.depth))
    lost, matched = 0, [0] * len(places)
    legs = {f"{plan.run.called(leg.start)} - {plan.run.called(leg.goal)}": leg for leg in plan.legs}
    for name in record.tasks:
        leg = legs[name]
        goal = np.asarray(plan.run.graph.positions[leg.goal], float)
        near = [k for k, place in enumerate(places) if np.linalg.norm(goal - place) < reach]
        lost += not near
        for k in near[:1]:
            matched[k] += 1
    return lost, len(places) - sum(matched)


def mission(kind: str, seed: int, scale: float, faults: Faults, tell, eventful: bool = False) -> dict:
    scenario = load_scenario(SCENARIOS / "link.yaml")
    area = replace(load_area(scenario, "."), obstacles=(WRECK,))
    plan = RollingPlan(scenario, seed, area=area)
    start, pace = plan.run.graph.positions[plan.run.start], random.Random(seed).uniform(0.85, 1.1)
    body = body_at(plan.site, *np.asarray(start, float), pace)
    # Where nothing is heard for long, an upload is given up before the mission is over at the scaled time.
    limits = replace(LIMITS, attempts=8, uploads=3) if eventful else LIMITS
    link, peer, proxy = joined(kind, plan.site, body, scale, faults, seed, limits)
    checked, send = [], link.upload

    def upload(wanted):
        notes = send(wanted)
        checked.append(held_as_planned(kind, peer, wanted))
        return notes

    link.upload = upload
    notices = Events(link, plan, peer, proxy, seed, eventful)
    begin = time.perf_counter()
    try:
        record = execute(plan, link, limits=limits, notices=notices, tell=tell)
    finally:
        peer.close()
        proxy.close()
    lost, doubled = books(record, plan, peer, limits.corridor if eventful else 10.0)
    return {
        "kind": kind, "seed": seed, "success": record.success, "reason": record.reason, "safe": record.safe,
        "uploads": len(checked), "as_planned": sum(checked), "tasks": len(record.tasks), "lost": lost,
        "doubled": doubled, "counts": dict(Counter(event.kind for event in record.events)),
        "packets": proxy.counts, "wall_s": round(time.perf_counter() - begin, 1),
        "fired": notices.fired if eventful else [],
    }  # fmt: skip


def mission_nearby(address: str, seed: int, scale: float, current: list[float], tell) -> dict:
    """Execute one mission on a vehicle that is running, and set its legs beside the plan."""
    whole = open_link(address, Site(0.0, 0.0))
    whole.connect()
    north, east, _ = whole.report(0.0).position
    longitude, latitude = Site(0.0, 0.0).to_geographic(north, east)
    whole.close()
    scenario = load_scenario(SCENARIOS / "nearby.yaml")
    begin = scenario.mission.start
    corner = Site(float(longitude), float(latitude)).to_geographic(-begin[0], -begin[1])
    site = dict(zip(("longitude", "latitude"), map(float, corner), strict=True))
    plan = RollingPlan(scenario.with_({"site": site, "current.uniform": [*current, 0.0]}), seed)
    planned: list[float] = []

    def noted(event) -> None:
        if event.kind == "plan":  # the last one before the start; later legs are as they were executed
            planned[:] = [leg.ends for leg in plan.legs]
        tell(event)

    record = execute(plan, open_link(address, plan.site, scale=scale), tell=noted)
    ends = [event.time for event in record.events if event.kind == "leg"]
    return {
        "seed": seed, "success": record.success, "reason": record.reason, "safe": record.safe,
        "tasks": len(record.tasks), "uploads": [upload["cause"] for upload in record.uploads],
        "planned_s": [round(time) for time in planned], "executed_s": [round(time) for time in ends],
    }  # fmt: skip


def totals(kind: str, rows: list[dict]) -> None:
    names = ("success", "uploads", "as_planned", "tasks", "lost", "doubled")
    total = {name: sum(row[name] for row in rows) for name in names}
    packets = {name: sum(row["packets"][name] for row in rows) for name in rows[0]["packets"]}
    words = (
        f"{kind}: {len(rows)} missions, {sum(bool(row['reason']) for row in rows)} verdicts, "
        "{success} at the destination in time; {as_planned} of {uploads} uploads as planned; "
        "{tasks} tasks, {lost} lost, {doubled} doubled; packets "
    )
    print(words.format(**total) + str(packets))


@launch(
    out=(Path, "file of JSON lines"),
    n=(20, "missions a kind"),
    kind=(("mavlink", "imc"), "of link", ("mavlink", "imc")),
    first=(0, "first seed"),
    scale=(50.0, "s of mission in one of wall-clock time"),
    loss=(0.05, "share of the packets that are lost"),
    random=(False, "things happen at random moments"),
    verbose=(False, "print every event"),
    link=(str, "a vehicle that is running: mavlink:ADDRESS or imc:HOST:PORT"),
    current=((0.0, 0.0), "m/s, with --link"),
)
def main(
    out: Path | None, n: int, kind: list[str], first: int, scale: float, loss: float, random: bool,
    verbose: bool, link: str | None, current: list[float],
) -> None:  # fmt: skip
    def tell(event) -> None:
        if verbose:
            print(f"  {event.time:8.1f} {event.kind}: {event.text}", flush=True)

    def note(row: dict) -> dict:
        print(json.dumps(row), flush=True)
        if out:
            with out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(row) + "\n")
        return row

    seeds = range(first, first + n)
    if link:
        for seed in seeds:
            note(mission_nearby(link, seed, scale, current, tell))
        return
    for each in kind:
        totals(each, [note(mission(each, seed, scale, Faults(lost=loss), tell, random)) for seed in seeds])
    sys.stdout.flush()
    os._exit(0)  # MAVSDK's threads outlive its objects
