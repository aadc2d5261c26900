"""Consistency checks of a saved run: legs, places, edges and times. Plain NumPy."""

import json
from collections.abc import Iterator
from datetime import datetime
from typing import Any

import numpy as np

from auvplan.check.inputs import Job, read_jobs
from auvplan.check.lines import line_of
from auvplan.check.navigation import fix_time
from auvplan.check.saved import TIME_TOLERANCE, Leg, Saved, near
from auvplan.check.track import events
from auvplan.runtime.files import MISSION, SUMMARY

#: Shares of its speed that a vehicle moves at through the water on a simulated track: something may slow it.
_TRACKED = 0.5, 1.1
#: Normal quantile of two-sided 95 % intervals.
_Z = 1.959964
#: What the summary has of legs of vehicles whose position grows uncertain.
_NAVIGATED = "t_fix", "position_std", "risk"
#: By how much figures other than times may differ where they should agree.
_ROOM = {"risk": 1e-6}
#: Share of the time available by which single precision may let a mission seem to exceed it.
_ROUNDING = 1e-6


def site_faults(run: Saved) -> Iterator[str]:
    """Yield that a run is not where and when, or its vehicle not as fast, as its scenario says."""
    site, stated = run.settings.get("site"), {"vehicle_speed": (run.section("vehicle").get("speed"), 1e-6)}
    if site and "site_longitude" in run.data.attrs:
        stated |= {f"site_{name}": (site[name], 1e-9) for name in ("longitude", "latitude")}
    for name, (value, tolerance) in stated.items():
        if value is not None and abs(run.number(name) - value) > tolerance:
            unit = " m/s" if name == "vehicle_speed" else ""
            yield f"{name} is {run.number(name):g}{unit}, the scenario says {value:g}"
    if not site or "site_longitude" not in run.data.attrs:
        return
    origin = np.asarray(run.data.attrs["site_origin"], float)
    if "origin" in site and np.abs(origin - site["origin"]).max() > 1e-3:
        yield f"site_origin is {origin.tolist()} m, the scenario says {site['origin']} m"
    if site.get("departure") and "site_epoch" in run.data.attrs:
        # The departure that was planned for: a plan for another moment than the scenario's has it moved.
        departs = datetime.fromisoformat(site["departure"])
        off = (datetime.fromisoformat(str(run.data.attrs["site_epoch"])) - departs).total_seconds()
        if abs(off) > TIME_TOLERANCE:
            yield f"it departs {off:+.0f} s off the scenario's departure"


def graph_faults(run: Saved) -> Iterator[str]:
    """Yield edges that are not there or that are taken twice."""
    symmetric = np.array_equal(run.adjacency, run.adjacency.T)
    used: dict[Any, Leg] = {}
    for leg in run.legs:
        edge = (leg.start, leg.goal)
        known = leg.start != leg.goal and all(0 <= node < len(run.adjacency) for node in edge)
        if not (known and run.adjacency[edge]):
            yield f"{leg}: no such edge in the graph"
            continue
        if leg.executed:
            name = frozenset(edge) if symmetric else edge
            if name in used:
                yield f"{leg}: the edge was taken before, by {used[name]}"
            used.setdefault(name, leg)


def place_faults(run: Saved) -> Iterator[str]:
    """Legs that do not join up with each other or with their waypoints."""
    known = range(len(run.places))
    executed = [leg for leg in run.legs if leg.executed and leg.start in known and leg.goal in known]
    here, place = int(run.number("start")), None
    for leg in executed:
        if leg.start != here:
            yield f"{leg}: begins at waypoint {leg.start}, the vehicle is at {here}"
        if place is not None and not near(leg.positions[0], place):
            gap = np.linalg.norm(leg.positions[0] - place)
            yield f"{leg}: begins {gap:.1f} m from where the last leg ended"
        if not near(leg.positions[0], run.places[leg.start]):
            yield f"{leg}: begins off waypoint {leg.start}"
        if leg.arrived and not near(leg.positions[-1], run.places[leg.goal]):
            yield f"{leg}: ends off waypoint {leg.goal}"
        if not leg.arrived and leg is not executed[-1]:
            yield f"{leg}: did not arrive, yet the mission went on"
        here, place = (leg.goal if leg.arrived else -1), leg.positions[-1]
    arrived = bool(run.number("arrived"))
    if arrived != (here == int(run.number("goal"))):
        yield f"arrived is {arrived}, yet the legs end {f'at waypoint {here}' if here >= 0 else 'under way'}"


def time_faults(run: Saved) -> Iterator[str]:
    """Times that do not add up, in the file or in the summary."""
    summary = run.summary
    charged, now, spent = float(summary["cpu"]["charged_s"]), 0.0, 0.0
    for leg in (leg for leg in run.legs if leg.executed):
        taken = leg.times[-1] - leg.times[0]
        if not _same(taken, leg.t_path):
            yield f"{leg}: took {taken:.2f} s, its travel time is given as {leg.t_path:.2f} s"
        gap = leg.times[0] - now - leg.t_hold
        # Between two legs nothing but waiting passes, and planning where it is charged.
        if gap < -TIME_TOLERANCE or gap > charged + TIME_TOLERANCE or not np.isfinite(gap):
            yield f"{leg}: begins at {leg.times[0]:.2f} s, the last leg and its task end at {now:.2f} s"
        task, waited = (leg.t_task, leg.t_wait) if leg.arrived else (0.0, 0.0)
        now = leg.times[-1] + waited + task
        spent += leg.t_hold + leg.t_path + waited + task
    total = spent + charged
    if not _same(total, summary["t_mission"]):
        yield f"legs, tasks and planning add up to {total:.2f} s, t_mission is {summary['t_mission']:.2f} s"
    if not _same(summary["t_available"] - summary["t_mission"], summary["t_residual"]):
        yield f"t_residual is {summary['t_residual']:.2f} s, not t_available less t_mission"
    in_time = summary["t_residual"] > -_ROUNDING * summary["t_available"]
    success, says = bool(run.number("arrived")) and in_time, "the times"
    energy = summary.get("energy")
    if isinstance(energy, dict) and "charge_end" in energy:
        success, says = success and energy["charge_end"] >= energy["reserve"], "the times, the charge"
    if (promise := summary.get("promise")) and promise["asked"] is not None:
        success, says = success and promise["share"] >= promise["asked"], f"{says}, the promise"
    if bool(summary["success"]) != success:
        yield f"success is {bool(summary['success'])}, {says} and the last waypoint say {success}"


def speed_faults(run: Saved) -> Iterator[str]:
    """Yield legs and routes at speeds through the water that the scenario does not let the vehicle choose."""
    least, most = run.speed_range
    stated = [(str(leg), leg.speed) for leg in run.legs]
    for number, speeds in enumerate(run.get("route_speed", ())):
        stated += [(f"route {number}", speed) for speed in speeds[~np.isnan(speeds)]]
    for name, speed in stated:
        if not least - 1e-6 <= speed <= most + 1e-6:
            allowed = f"{least:g} to {most:g} m/s" if most > least else f"{most:g} m/s alone"
            yield f"{name}: is gone at {speed:g} m/s, the scenario allows {allowed}"


def energy_faults(run: Saved) -> Iterator[str]:
    """Yield figures of energy that the track, the time, the power model and the battery do not make."""
    energy, stated = run.summary.get("energy"), run.data.attrs.get("power_model")
    if energy is None and stated is None:
        return
    if not isinstance(energy, dict) or stated is None:
        yield "energy stands in one of summary and power_model alone"
        return
    power, terms = json.loads(stated), energy["terms_wh"]
    yield from _contradictions("vehicle.power", run.section("vehicle").get("power"), power)
    total = sum(terms.values())
    if not _same(total, energy["total_wh"]):
        yield f"energy by term adds up to {total:.2f} Wh, total_wh is {energy['total_wh']:.2f}"
    draw = run.section("simulation").get("draw", 1.0) if run.simulated else 1.0
    for name, (least, most) in _energy_bounds(run, power).items():
        least, most = draw * least, draw * most
        found, room = terms[name], 0.01 + 1e-3 * most
        if not least - room <= found <= most + room:
            yield f"{name} takes {found:.2f} Wh, time and track make it {least:.2f} to {most:.2f}"
    if battery := power.get("battery"):
        usable = battery["capacity"] * battery["usable"] * battery["ageing"] * battery["temperature"]
        left = battery["charge"] - total / usable
        margin = (left - battery["reserve"]) * usable
        figures = {
            "usable_wh": usable,
            "reserve": battery["reserve"],
            "charge_end": left,
            "margin_wh": margin,
        }
        for name, value in figures.items():
            if not abs(energy[name] - value) <= 1e-4 * max(abs(value), 1.0):
                yield f"energy: {name} is {energy[name]:.4f}, battery and terms make it {value:.4f}"
    if "charge" not in run.data:
        return
    charge = run.data["charge"].values.astype(float)
    if not np.isfinite(charge).all() or (np.diff(charge) > 1e-6).any():
        yield "the charge rises along the track, or is no number"
    elif len(charge) and charge[-1] < energy["charge_end"] - 1e-6:
        yield f"the charge at the end, {energy['charge_end']:.4f}, is more than on the way"


def _contradictions(name: str, given: Any, used: Any) -> Iterator[str]:
    """Yield the settings of a power model that are given as numbers and were not used."""
    if isinstance(given, dict):
        for part, value in given.items():
            if part != "vehicle" and value is not None:
                yield from _contradictions(f"{name}.{part}", value, (used or {}).get(part))
        return
    if isinstance(given, str) or given is None:  # a vehicle by its name, or its file
        return
    if used is None or np.shape(given) != np.shape(used) or not np.allclose(given, used, rtol=1e-6):
        yield f"{name} is {used} in power_model, the scenario says {given}"


def _energy_bounds(run: Saved, power: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Return the least and the most that terms can be, Wh: by time, depths, tasks and speed."""
    legs = [leg for leg in run.legs if leg.executed]
    lasts, unsure = run.summary["t_mission"], run.number("charged_compute") + TIME_TOLERANCE
    seconds = np.concatenate([np.zeros(0), *(np.diff(leg.times) for leg in legs)])
    steps = np.concatenate([np.zeros((0, 3)), *(np.diff(leg.positions, axis=0) for leg in legs)])
    down, moved = steps[:, 2].astype(float), np.linalg.norm(steps, axis=1)
    # Of a surfacing for a fix no track is recorded: up from the depth of the waypoint left, and down again.
    rises = [leg for leg in legs if leg.t_fix > 0.0]
    up = float(sum(max(leg.positions[0, 2], 0.0) for leg in rises))
    dived, climbed = (up + float(np.maximum(sign * down, 0.0).sum()) for sign in (1.0, -1.0))
    descents = sum(len(list(events(np.diff(leg.positions[:, 2]) > 0.0))) for leg in legs)
    law = power["propulsion"]

    def watts(speed: float) -> float:
        if "speeds" in law:
            return float(np.interp(speed, law["speeds"], law["watts"]))
        return law["constant"] + law["factor"] * speed ** law["exponent"]

    speeds = np.concatenate([np.zeros(0), *(np.full(len(leg.times) - 1, leg.speed) for leg in legs)])
    moving = moved > 1e-6 * seconds
    under_way = float(seconds[moving].sum())
    slow, fast = (
        sum(watts(share * v) * seconds[moving & (speeds == v)].sum() for v in np.unique(speeds))
        for share in (_TRACKED if run.simulated else (1.0, 1.0))
    )
    rising = 0.0  # J, of the ways up and down, where the time at the surface is known
    if (at_surface := fix_time(run)) is not None:
        share = _TRACKED[0] if run.simulated else 1.0
        ways = sum(max(leg.t_fix - at_surface - TIME_TOLERANCE, 0.0) for leg in rises)
        rising = share * watts(share * run.number("vehicle_speed")) * ways
    # Where it stays, it makes the speed of a current that it held out against, or its own.
    fastest = max([run.number("vehicle_speed"), *speeds], key=watts)
    done = [leg for leg in legs if leg.arrived and leg.priority > 0.0]
    jobs = read_jobs(run) or []
    starts = sum(not _goes_on(run, jobs, leg) for leg in done)
    tasks = power["task"] * sum(leg.t_task for leg in done) + power["task_start"] * starts
    joules = {
        **{
            name: (power[name] * (lasts - unsure), power[name] * (lasts + unsure))
            for name in ("hotel", "payload")
        },
        "propulsion": (slow + rising, fast + watts(fastest) * max(lasts - under_way, 0.0)),
        "dive": (power["dive"] * dived + power.get("pump", 0.0) * descents,) * 2,
        "climb": (power["climb"] * climbed,) * 2,
        # Along survey lines a task is under way.
        "tasks": (tasks, tasks + power["task"] * under_way),
    }
    return {name: (least / 3600.0, most / 3600.0) for name, (least, most) in joules.items()}


def _goes_on(run: Saved, jobs: list[Job], leg: Leg) -> bool:
    """Return whether a leg goes on along a survey line that the one before it has begun."""
    before = [other for other in run.legs[: leg.number] if other.executed][-1:]
    if not before or not (before[0].arrived and before[0].priority > 0.0):
        return False
    line = line_of(jobs, leg)
    return line is not None and line_of(jobs, before[0]) is line and before[0].goal == leg.start


def figure_faults(run: Saved) -> Iterator[str]:
    """Yield figures of the summary that differ from the legs, plans and routes of the file."""
    summary, attributes, rows = run.summary, run.data.attrs, run.summary["legs"]
    for name in ("t_available", "t_mission"):
        if not _same(summary[name], attributes[name]):
            yield f"{name} is {summary[name]} in {SUMMARY}, {attributes[name]} in {MISSION}"
    if len(rows) != len(run.legs):
        yield f"{len(rows)} legs in {SUMMARY}, {len(run.legs)} in {MISSION}"
    filed = list(_leg_figures(run))
    made = run.get("route_cpu", np.zeros(0))
    total: dict[str, float] = {
        "path_calls": len(run.legs),
        "path_replans": sum(figures["path_replans"] for figures in filed),
        "mission_replans": max(len(made) - 1, 0),
        "revisits": sum(figures["revisit"] for figures in filed if figures["arrived"]),
        "seed": int(run.data.attrs["seed"]),
    }
    if "leg_risk" in run:
        total["risk"] = min(float(np.nansum(run["leg_risk"][run["leg_arrived"].astype(bool)])), 1.0)
    reserve = run.section("planning").get("reserve")
    if reserve is not None:
        total["reserve_used"] = float(np.clip(reserve - summary["t_residual"], 0.0, reserve))
    if "cost_mission" in summary:
        total["cost_total"] = summary["cost_mission"] + made[1:].sum()
    computing = {
        "charged_s": run.number("charged_compute"),
        "path_s": sum(figures["cpu_s"] for figures in filed),
        "mission_s": made.sum(),
        "mission_replans_s": made[1:].sum(),
    }
    tables: list[tuple[str, dict[str, Any], dict[str, Any]]] = [
        *((f"{leg}: ", row, figures) for row, leg, figures in zip(rows, run.legs, filed, strict=False)),
        ("", summary, total),
        ("cpu.", summary["cpu"], computing),
    ]
    for prefix, stated, figures in tables:
        for name, value in figures.items():
            absent = np.isnan(value)  # which is stored as null, or not at all
            given = stated.get(name, None if name in _NAVIGATED else value)
            agree = absent if given is None else not absent and _same(float(given), value, _ROOM.get(name))
            if not agree:
                yield f"{prefix}{name} is {given} in {SUMMARY}, {value:g} by {MISSION}"
    if summary.get("priority_bound", np.inf) < summary["total_priority"] - 1e-6:
        yield f"priority_bound, {summary['priority_bound']:g}, is less than the total priority"


def _leg_figures(run: Saved) -> Iterator[dict[str, float]]:
    """Yield what the summary says of a leg, from the file."""
    count = len(run.legs)
    revisits = run.get("leg_revisit", np.zeros(count))
    followed = run.get("leg_followed", np.zeros(count, int))
    # Of every plan [P] the leg, why it was made, and s of wall-clock time and as planned.
    owner, cause, cpu, planned = np.zeros(0, int), np.zeros(0, str), np.zeros(0), np.zeros(0)
    if "plan_leg" in run:
        owner, cpu, times = (run[f"plan_{name}"] for name in ("leg", "cpu", "time"))
        codes = run.data["plan_cause"]
        cause = np.array(str(codes.attrs["flag_meanings"]).split())[codes.values]
        planned = np.nanmax(times, axis=1) - np.nanmin(times, axis=1)
    for leg in run.legs:
        own = np.flatnonzero(owner == leg.number)
        yield {
            "from": leg.start, "to": leg.goal, "arrived": leg.arrived, "priority": leg.priority,
            "revisit": bool(revisits[leg.number]), "t_expected": leg.t_expected, "t_path": leg.t_path,
            "t_task": leg.t_task, "t_hold": leg.t_hold, "t_wait": leg.t_wait,
            "t_planned": float(planned[own[followed[leg.number]]]) if len(own) else np.nan,
            "path_replans": int((cause[own] != "leg").sum()), "cpu_s": float(cpu[own].sum()),
            "speed": leg.speed,
            **{name: float(run[f"leg_{name}"][leg.number]) for name in _NAVIGATED if f"leg_{name}" in run},
        }  # fmt: skip


def route_faults(run: Saved) -> Iterator[str]:
    """Yield routes whose time is not their legs', and legs that leave their route or expect another time."""
    if "route_leg_time" not in run:
        return
    nodes, made_at = run["route_nodes"], run["route_made_at"]
    number, stop, left = -1, 0, False
    for leg in (leg for leg in run.legs if leg.executed):  # the first that does not lead where its route says
        newest = int(np.sum(made_at <= leg.begins - leg.t_hold + TIME_TOLERANCE)) - 1
        if newest != number:
            number, stop, left = newest, 0, False
        if number >= 0 and not left and tuple(nodes[number, stop : stop + 2]) != (leg.start, leg.goal):
            left = True
            yield f"{leg}: route {number} leads from {nodes[number, stop]} elsewhere"
        stop += 1
    routes = run["route_leg_time"]
    for number, (route, total) in enumerate(zip(routes, run["route_time"], strict=True)):
        if np.isfinite(route).any() and not _same(np.nansum(route), total):
            yield f"route {number}: its legs add up to {np.nansum(route):.2f} s, its time is {total:.2f} s"
    waits = np.nan_to_num(run["route_wait"])
    for before, leg in zip([None, *run.legs], run.legs, strict=False):
        if before and not before.executed and (before.start, before.goal) == (leg.start, leg.goal):
            continue  # refused for its time, which is expected now: no other route need have been found since
        # A leg that begins when its route is made expects what the route says.
        for number in np.flatnonzero(np.abs(made_at + leg.t_hold - leg.begins) <= TIME_TOLERANCE)[-1:]:
            expected = routes[number, 0] - waits[number, 0] - (leg.t_hold - leg.t_fix)
            same = tuple(nodes[number, :2]) == (leg.start, leg.goal) and np.isfinite(expected)
            if same and not _same(expected, leg.t_expected):
                yield f"{leg}: expects {leg.t_expected:.2f} s, its route {expected:.2f} s"


def promise_faults(run: Saved) -> Iterator[str]:
    """Yield a promise that differs between both files, or whose share is not that of its interval."""
    stated, summary = run.stated("promise"), json.loads(json.dumps(run.summary.get("promise")))
    if stated is None or summary is None:
        if stated is not summary:
            yield f"a promise stands in one of {SUMMARY} and {MISSION} alone"
        return
    kept = stated | {"turns": [{k: v for k, v in one.items() if k != "positions"} for one in stated["turns"]]}
    for name in kept:
        if kept[name] != summary.get(name):
            yield f"promise.{name} is {summary.get(name)} in {SUMMARY}, {kept[name]} in {MISSION}"
    for name, one in ((SUMMARY, summary), (MISSION, stated)):
        share, seas, interval = one["share"], one["seas"], np.asarray([one["low"], one["high"]])
        room, spread = _Z**2 / seas, share * (1.0 - share) / seas + (0.5 * _Z / seas) ** 2
        half = _Z * np.asarray([-1.0, 1.0]) * np.sqrt(spread)
        wilson = np.clip((share + 0.5 * room + half) / (1.0 + room), 0.0, 1.0)
        # Seas of several members count as fewer.
        fits = np.allclose(wilson, interval, atol=1e-6) if one["members"] == 1 else True
        if not (fits and interval[0] <= share <= interval[1]):
            given = f"[{interval[0]:g}, {interval[1]:g}]"
            yield f"promise.share is {share:g} of {seas} seas in {name}, its interval {given}"


def _same(a: float, b: float, room: float | None = None) -> bool:
    """Return whether two figures agree, by default two times; never where one is not a number."""
    return bool(abs(a - b) <= (TIME_TOLERANCE if room is None else room))
