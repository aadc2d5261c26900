"""A synthetic study: missions among random waypoints, with or without a sweep over settings."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import xarray as xr

from auvplan.study.table import VARIABLES

AVAILABLE = 14400.0
SPEED = 2.5
WAYPOINTS = 20
#: Room for legs, path plans, routes and stops of a route.
SIZES = {"leg": 14, "plan": 80, "route": 9, "stop": 14, "waypoint": WAYPOINTS, "axis": 3}


def make_study(
    missions: int = 8,
    sweep: Mapping[str, Sequence] | None = None,
    chart: bool = True,
    failed: Sequence[int] = (2,),
    first_seed: int = 0,
) -> xr.Dataset:
    """A study whose missions lose time and re-plan more often the higher the index of a swept value.

    Args:
        missions: of seeds from `first_seed` on.
        sweep: name of the setting, with dots, to its values.
        chart: with a coast in the north.
        failed: indices of missions that run out of time.
        first_seed: of the first mission.
    """
    sweep = dict(sweep or {})
    dims = [name.replace(".", "_") for name in sweep]
    shape = (*(len(values) for values in sweep.values()), missions)
    arrays = _empty(shape)
    for index in np.ndindex(shape):
        row = {name: values[(*index, ...)] for name, values in arrays.items()}
        _execute(row, np.random.default_rng(first_seed + index[-1]), sum(index[:-1]))
        if index[-1] in failed:  # too late: the last leg was not finished
            row["leg_arrived"][int((row["leg_arrived"] == 1).sum()) - 1] = 0
            _fill(row, t_mission=AVAILABLE + 350.0, t_residual=-350.0, success=0)
            row["reason"][...] = "destination reached too late"
    lead = [*dims, "mission"]
    dataset = xr.Dataset({name: ((*lead, *VARIABLES[name].dims), values) for name, values in arrays.items()})
    dataset["route_cause"].attrs |= {
        "flag_values": np.arange(5, dtype=np.int8), "flag_meanings": "none start late early refused"
    }  # fmt: skip
    dataset = dataset.assign_coords(seed=("mission", np.arange(first_seed, first_seed + missions)))
    for dim, (field, values) in zip(dims, sweep.items(), strict=True):
        dataset = dataset.assign_coords({dim: (dim, list(values), {"field": field, "long_name": field})})
    if chart:
        centres = np.arange(50.0, 10000.0, 100.0)
        passability = np.ones((100, 100))
        passability[80:, 30:60], passability[85:, 35:55] = 0.2, 0.0
        dataset["passability"] = (("chart_x", "chart_y"), passability)
        dataset = dataset.assign_coords(chart_x=centres, chart_y=centres)
    title = f"Monte Carlo study of scenario sample, {missions} missions"
    return dataset.assign_attrs(title=title, scenario="{}", sweep=",".join(dims))


def without_legs(study: xr.Dataset) -> xr.Dataset:
    """The same study, but no leg was executed, no path planned and no route made."""
    empty = _empty(study["t_mission"].shape)
    kept = [name for name in empty if name.startswith(("leg", "plan", "route"))]
    return study.assign({name: study[name].copy(data=empty[name]) for name in kept})


def _empty(shape: tuple[int, ...]) -> dict[str, np.ndarray]:
    """Variables of a study in which nothing was done yet."""
    found = {}
    for name, variable in VARIABLES.items():
        kind = np.int8 if variable.meanings else {-1: np.int32, "": object}.get(variable.fill, float)
        found[name] = np.full((*shape, *(SIZES[dim] for dim in variable.dims)), variable.fill, kind)
    found["success"][...], found["waypoint_position"][...] = 1, 0.0
    found["reason"][...] = "destination reached in time"
    return found


def _fill(row: dict[str, np.ndarray], at: int | type(...) = ..., prefix: str = "", **values: float) -> None:
    for name, value in values.items():
        row[prefix + name][at] = value


def _execute(row: dict[str, np.ndarray], rng: np.random.Generator, harm: int) -> None:
    """Fill one mission's arrays; `harm` makes paths longer and re-plans more frequent."""
    places = rng.uniform([300, 300, 5], [7800, 9700, 90], (WAYPOINTS, 3))
    row["waypoint_position"][:] = places
    rest = [0, *rng.permutation(np.arange(1, WAYPOINTS - 1))[:7].tolist(), WAYPOINTS - 1]
    now, plans, routes, cause = 0.0, 0, 0, 1
    tasks, weights = rng.uniform(30, 300, WAYPOINTS), rng.integers(1, 6, WAYPOINTS)
    for leg in range(8):
        if cause:
            row["route_nodes"][routes, : len(rest)] = rest
            takes = sum(np.linalg.norm(places[i] - places[j]) / SPEED + tasks[j] for i, j in pairwise(rest))
            worth = weights[rest[1:]].sum()
            made = {"made_at": now, "time": takes, "priority": worth, "cpu": rng.uniform(0.2, 0.4)}
            _fill(row, routes, "route_", **made, cause=cause)
            routes += 1
        i, j = rest[0], rest[1]
        distance = float(np.linalg.norm(places[i] - places[j]))
        executed = distance / SPEED * rng.normal(1.02 + 0.03 * harm, 0.05)
        replans = int(rng.poisson(0.6 + 0.5 * harm))
        for k in range(replans + 1):
            cost = {"cpu": rng.lognormal(-1.6, 0.5), "cost": executed * 1.01 / (k + 1)}
            _fill(row, plans, "plan_", **cost, leg=leg, cause=1 + min(k, 1))
            plans += 1
        times = {"t_expected": distance / SPEED + tasks[j], "t_path": executed, "t_task": tasks[j]}
        counts = {"from": i, "to": j, "path_replans": replans, "arrived": 1, "cpu": 0.2 * (replans + 1)}
        _fill(row, leg, "leg_", **times, **counts, priority=weights[j], distance=distance)
        now += float(executed + tasks[j])
        rest = rest[1:]
        cause = 2 if executed > 1.06 * distance / SPEED else 0
        if cause and len(rest) > 3 and routes < SIZES["route"]:
            rest = [rest[0], *rng.permutation(rest[1:-1])[: len(rest) - 3].tolist(), rest[-1]]
        cause = cause if routes < SIZES["route"] else 0
        if len(rest) < 2:
            break
    used = min(AVAILABLE - rng.gamma(2.0, 150.0), AVAILABLE - 1.0)
    done = row["leg_arrived"] == 1
    total, again = row["leg_priority"][done].sum(), np.nansum(row["route_cpu"][1:])
    weighed = AVAILABLE - used + (100.0 / row["leg_priority"][done]).sum()
    _fill(
        row, t_available=AVAILABLE, t_mission=used, t_residual=AVAILABLE - used, tasks=done.sum(),
        total_priority=total, priority_bound=1.0 + 1.25 * total, path_calls=done.sum(),
        path_replans=plans - done.sum(), mission_replans=routes - 1, collisions=0, faults=0,
        path_cpu=np.nansum(row["plan_cpu"]), mission_cpu=np.nansum(row["route_cpu"]),
        mission_replan_cpu=again, travel_time_cpu=rng.uniform(0.5, 1.0), cost_mission=weighed,
        cost_total=weighed + again, coast_clearance=np.inf, obstacle_clearance=rng.uniform(1.0, 30.0),
        seabed_altitude=rng.uniform(5.0, 40.0),
    )  # fmt: skip
