"""The itinerary of a mission that was planned and executed."""

import json
from dataclasses import replace
from itertools import zip_longest

import numpy as np

from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, Track, itinerary_of_parts
from auvplan.export.speeds import SLOW, track_notes
from auvplan.export.thin import thin, thin_between
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.path.saw_tooth import turns
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.scenario.provenance import source_files
from auvplan.site import Site


def itinerary_of(run: MissionRun, site: Site | None = None, *, slow: float = SLOW) -> Itinerary:
    """Return the itinerary of a run: of each leg that was finished the path it was begun with.

    Each leg's path was planned when the leg was begun, in the conditions of that time: where a leg before was
    late or early, the planned times of both do not join. Straight lines keep the distances of its `safety`,
    or the path's where those are less.

    Args:
        run: as executed.
        site: where its local coordinates are; the run's own if absent.
        slow: share of the speed through the water below which a leg is noted as slow over ground.

    Raises:
        ExportError: no leg was executed to its end, or the run has no site on Earth.
    """
    site = site or run.site
    if site is None:
        raise ExportError("the scenario has no section site: add one to export geographic formats")
    legs, energy, margin = [], run.energy, (run.safety.coast, run.safety.obstacles)
    metered = energy is not None and energy.power.battery is not None
    for number, (leg, later) in enumerate(zip_longest(run.done, run.done[1:]), 1):
        # The wait before the next leg is spent where the vehicle is.
        onward, rise = (0.0, 0.0) if later is None else (later.t_hold, later.t_fix or 0.0)
        plan, hold = leg.plans[leg.followed], leg.t_wait + leg.t_task + onward
        whole = PlannedLeg.of(
            number, leg.start, leg.goal, plan.positions, plan.times,
            names=run.names, hold=hold, priority=leg.priority, motion=plan.motion,
        )  # fmt: skip
        path = plan.positions, plan.times, _environment(leg, plan, run), run.vehicle_on(leg)
        if run.dives:
            few = thin_between(turns(plan.positions), *path, margin=margin)
        else:
            few = thin(*path, margin=margin, line=leg.line)
        legs.append(replace(
            whole, kept=few.indices, kept_times=few.times, time_change=few.time_change,
            clearance=few.clearance, speed=leg.speed, rise=rise,
            wait=leg.t_wait, onward=onward,
            fix=max(rise - sum(run.vehicle.vertical_times(float(plan.positions[-1, 2]))), 0.0),
            charge=energy.charge_at(whole.times) if energy is not None and metered else None,
        ))  # fmt: skip
    executed = run.legs if run.simulated else []
    still = [
        ((*obstacle.position, obstacle.depth_min), obstacle.radius, obstacle.name)
        for obstacle in run.obstacles
        if not obstacle.moves
    ]
    speed = float(np.asarray(run.vehicle.speed))
    found = itinerary_of_parts(
        str(run.scenario.get("name") or "mission"),
        site,
        speed,
        legs,
        [Track(leg.times, leg.positions, leg.motion) for leg in executed if len(leg.times) > 1],
        chart=run.chart,
        obstacles=still,
        notes=_notes(run),
        seed=run.seed,
        configuration=json.dumps(run.scenario),
        end=run.safety.end,
    )
    pitch = run.vehicle.pitch_max
    turn, most = float(np.asarray(run.vehicle.turn_rate_max)), None if pitch is None else float(pitch)  # type: ignore[arg-type]
    warnings = track_notes(legs, speed, turn, slow, most)
    ways = () if run.promise is None else run.promise.turns
    return replace(found, sources=_sources(run), warnings=tuple(warnings), assumed=run.assumed, turns=ways)


def _sources(run: MissionRun) -> tuple[str, ...]:
    """Return the files of the forecast by name, run and hash, a line each."""
    files = [file for file in source_files(run.scenario, run.folder) if file.field == "current.files"]
    return tuple(
        f"forecast {file.name}" + (f", {file.fetched}" if file.fetched else "")
        + (f", SHA-256 {file.sha256[:16]}" if file.sha256 else f", {file.size} bytes")
        for file in files
    )  # fmt: skip


def _notes(run: MissionRun) -> list[str]:
    """Return what whoever opens the files should know."""
    notes = []
    if run.simulated:
        notes.append(
            "the paths are those of one simulated mission, planned past obstacles that the simulator drew: "
            "`auvplan plan` makes the plan for a vehicle"
        )
    if moving := [obstacle.name for obstacle in run.obstacles if obstacle.moves]:
        notes.append(f"obstacles that move have no fence: {', '.join(moving)}")
    if closed := [closure.name for closure in run.closures]:
        notes.append(f"areas that are closed at some hours have no fence: {', '.join(closed)}")
    stated = run.scenario.get("vehicle") or {}
    limits = [
        f"{name} {float(limit):g} {unit}"  # type: ignore[arg-type]
        for name, unit in (("pitch_max", "rad"), ("climb_rate_max", "m/s"), ("dive_rate_max", "m/s"))
        if (limit := getattr(run.vehicle, name)) is not None and stated.get(name) is not None
    ]
    if run.promise is not None and run.promise.turns:
        notes.append("of the ways from stops that are left too late GeoJSON alone has the lines")
    if limits:
        notes.append(f"no file carries {', '.join(limits)}: the paths keep them, the vehicle must be set to")
    return notes


def _environment(leg: LegRecord, plan: PlanRecord, run: MissionRun) -> Environment:
    """Return the environment when a plan was made; obstacles move at their mean velocity."""
    low, high = plan.positions.min(axis=0), plan.positions.max(axis=0)
    obstacles = None
    if len(leg.obstacle_radii):
        tracks, passed = np.asarray(leg.obstacle_positions, float), float(leg.times[-1] - leg.times[0])
        obstacles = Obstacles.create(
            tracks[0], leg.obstacle_radii, velocity=(tracks[-1] - tracks[0]) / max(passed, 1.0),
            observed_at=float(leg.times[0]),
        )  # fmt: skip
    rasters = {"seabed": run.seabed, "closures": run.closures}
    return Environment(plan.current, run.chart, obstacles, low, high, **rasters)  # type: ignore[arg-type]
