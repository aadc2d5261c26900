"""The itinerary of a mission that was planned and sailed."""

import json

import numpy as np

from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, Track, itinerary_of_parts
from auvplan.ocean.chart import Chart
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.ocean.seabed import Seabed
from auvplan.records import LegRecord, MissionRun, PlanRecord
from auvplan.site import Site


def itinerary_of(
    run: MissionRun,
    site: Site | None = None,
    *,
    tolerance: float = 0.02,
    margin: float = 10.0,
) -> Itinerary:
    """Return the itinerary of a run: of each leg that was sailed to its end the path that it was begun with.

    Each leg's path was planned when the leg was begun, in the sea as it was then: where a leg before was late
    or early, the planned times of both do not join.

    Args:
        run: as sailed.
        site: where its local coordinates are; the run's own if absent.
        tolerance, margin: of the thinning, see `thin`.

    Raises:
        ExportError: no leg was sailed to its end, or nothing tells where on Earth the run is.
    """
    site = site or run.site
    if site is None:
        raise ExportError("the scenario has no section site: add one to export geographic formats")
    done = run.done
    # What is waited for the way on is waited where the vehicle is.
    onward = [leg.t_hold for leg in done[1:]] + [0.0]
    holds = [leg.t_wait + leg.t_task + hold for leg, hold in zip(done, onward, strict=False)]
    legs = []
    for number, leg in enumerate(done, 1):
        plan = leg.plans[leg.followed]
        whole = PlannedLeg.of(
            number, leg.start, leg.goal, plan.positions, plan.times,
            names=run.names, hold=holds[number - 1], priority=leg.priority, motion=plan.motion,
        )  # fmt: skip
        env = _environment(leg, plan, run.chart, run.seabed)
        legs.append(whole.thinned(env, run.vehicle, tolerance, margin))
    sailed = run.legs if run.simulated else []
    still = [
        ((*obstacle.position, obstacle.depth_min), obstacle.radius, obstacle.name)
        for obstacle in run.obstacles
        if not obstacle.moves
    ]
    return itinerary_of_parts(
        str(run.scenario.get("name") or "mission"),
        site,
        float(np.asarray(run.vehicle.speed)),
        legs,
        [Track(leg.times, leg.positions, leg.motion) for leg in sailed if len(leg.times) > 1],
        chart=run.chart,
        obstacles=still,
        notes=_notes(run),
        seed=run.seed,
        configuration=json.dumps(run.scenario),
        end=run.safety.end,
    )


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
    return notes


def _environment(leg: LegRecord, plan: PlanRecord, chart: Chart | None, seabed: Seabed | None) -> Environment:
    """Return the sea when a plan was made; obstacles move on as they did on the whole."""
    low, high = plan.positions.min(axis=0), plan.positions.max(axis=0)
    obstacles = None
    if len(leg.obstacle_radii):
        tracks, passed = np.asarray(leg.obstacle_positions, float), float(leg.times[-1] - leg.times[0])
        obstacles = Obstacles.create(
            tracks[0], leg.obstacle_radii, velocity=(tracks[-1] - tracks[0]) / max(passed, 1.0),
            observed_at=float(leg.times[0]),
        )  # fmt: skip
    return Environment(plan.current, chart, obstacles, low, high, seabed=seabed)  # type: ignore[arg-type]
