"""The itinerary of a mission that was planned and sailed."""

import json
from collections.abc import Sequence

import numpy as np
import shapely

from auvplan.export.itinerary import ExportError, Itinerary, PlannedLeg, Track, itinerary_of_parts
from auvplan.ocean.chart import Chart
from auvplan.ocean.environment import Environment
from auvplan.ocean.obstacles import Obstacles
from auvplan.site import Site
from auvplan.voyage.records import LegRecord, MissionRun, PlanRecord


def itinerary_of(
    run: MissionRun,
    site: Site,
    *,
    names: Sequence[str] = (),
    tolerance: float = 0.02,
    margin: float = 10.0,
) -> Itinerary:
    """The itinerary of a run: of each leg that was sailed to its end the path that it was begun with.

    Each leg's path was planned when the leg was begun, in the sea as it was then: where a leg before was late
    or early, the planned times of both do not join.

    Args:
        run: as sailed.
        site: where its local coordinates are.
        names: of the waypoints, by index.
        tolerance, margin: of the thinning, see `thin`.

    Raises:
        ExportError: no leg was sailed to its end.
    """
    done = run.done
    legs = []
    for number, leg in enumerate(done, 1):
        plan = followed_first(leg)
        whole = PlannedLeg.of(
            number, leg.start, leg.goal, plan.positions, plan.times,
            names=names, hold=leg.t_task, priority=leg.priority,
        )  # fmt: skip
        env = _environment(leg, plan, run.chart)
        legs.append(whole.thinned(env, run.vehicle, tolerance, margin))
    still = [
        (leg.obstacle_positions[0, m], float(radius))
        for leg in run.legs
        if len(leg.times)
        for m, (radius, kind) in enumerate(zip(leg.obstacle_radii, leg.obstacle_kinds, strict=True))
        if kind == "static"
    ]
    return itinerary_of_parts(
        str(run.scenario.get("name") or "mission"),
        site,
        float(np.asarray(run.vehicle.speed)),
        legs,
        [Track(leg.times, leg.positions) for leg in run.legs if len(leg.times) > 1],
        chart=run.chart,
        obstacles=still,
        seed=run.seed,
        configuration=json.dumps(run.scenario),
    )


def followed_first(leg: LegRecord) -> PlanRecord:
    """The plan that a leg was begun with.

    Before a leg begins several paths may be planned, the last not always the best: of those it is the one
    on which the vehicle was until it planned anew on the way.

    Raises:
        ExportError: the leg has no plan.
    """
    made = [plan for plan in leg.plans if plan.cause == "leg"]
    if not made:
        raise ExportError(f"leg from waypoint {leg.start} to {leg.goal}: no path plan to export")
    until = min((plan.made_at for plan in leg.plans if plan.cause != "leg"), default=np.inf)
    begun = np.asarray(leg.positions)[leg.times <= until][:, :2]
    if len(made) == 1 or len(begun) < 2:
        return made[-1]
    # The latest first: of equals it is the one that was followed.
    latest = made[::-1]
    off = [_off(plan, begun) for plan in latest]
    return latest[int(np.argmin(off))]


def _environment(leg: LegRecord, plan: PlanRecord, chart: Chart | None) -> Environment:
    """The sea when a plan was made; obstacles move on as they did on the whole."""
    low, high = plan.positions.min(axis=0), plan.positions.max(axis=0)
    if not len(leg.obstacle_radii):
        return Environment(plan.vortices, chart, None, low, high)  # type: ignore[arg-type]
    tracks, passed = np.asarray(leg.obstacle_positions, float), float(leg.times[-1] - leg.times[0])
    obstacles = Obstacles.create(
        tracks[0], leg.obstacle_radii, velocity=(tracks[-1] - tracks[0]) / max(passed, 1.0),
        observed_at=float(leg.times[0]),
    )  # fmt: skip
    return Environment(plan.vortices, chart, obstacles, low, high)  # type: ignore[arg-type]


def _off(plan: PlanRecord, places: np.ndarray) -> float:
    """How far the farthest of places [n, 2] is from a plan, m, seen from above."""
    line = shapely.LineString(np.asarray(plan.positions)[:, :2])
    return float(np.max(shapely.distance(line, shapely.points(places))))
