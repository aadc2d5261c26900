"""The page of a study of many missions, or of a rehearsal: what its scripts show."""

import json
from collections.abc import Sequence
from pathlib import PurePath
from typing import Any

import numpy as np
import xarray as xr

from auvplan.report.area import map_data
from auvplan.report.page import packed
from auvplan.scenario.file import shipped_scenarios
from auvplan.scenario.provenance import changed_settings, file_names
from auvplan.study import statistics
from auvplan.study.table import flag_names, study_chart
from auvplan.view.scene import window

#: Missions whose legs and routes a page holds at most; of all others it holds the figures.
_DETAILED = 1000
#: Figures of a mission by the names of their variables.
_FIGURES = (
    *("t_available", "t_mission", "t_residual", "tasks", "total_priority", "path_replans", "mission_replans"),
    *("cost_mission", "cost_total", "collisions", "faults"),
    *("coast_clearance", "obstacle_clearance", "seabed_altitude", "length"),
)


def study_data(
    dataset: xr.Dataset, rehearsal: dict[str, Any] | None = None, runs: Sequence[str] = ()
) -> dict[str, Any]:
    """Return what the page of a study shows, with the plan it rehearses and folders of saved missions."""
    dataset = dataset.sortby("seed")
    settings, cases = json.loads(dataset.attrs.get("scenario", "{}")), statistics.cases_of(dataset)
    sweeps = zip(cases[0][0], statistics.sweep_dims(dataset), strict=True)
    summary = statistics.summarise(dataset)
    room = max(_DETAILED // len(cases), 1)
    name, changes = _command(settings)
    waypoints = dataset["waypoint_position"].values.reshape(-1, 3)
    known = waypoints[np.isfinite(waypoints).all(axis=1)]
    chart = study_chart(dataset)
    ground = None
    if len(known):
        ground = map_data(*window(known, 0.07, chart, slender=0.55, least=200.0), chart, None, None)
    return {
        "kind": "rehearsal" if rehearsal else "study",
        "name": str(settings.get("name") or "study"),
        "description": str(settings.get("description") or ""),
        "sweeps": [{"field": field, "values": dataset[dim].values} for field, dim in sweeps],
        "described": list(statistics.DESCRIBED.items()),
        "seeds": dataset["seed"].values,
        "runs": list(runs),
        "scenario": name,
        "changes": changes,
        "map": ground,
        "cases": [
            {"setting": list(setting.values()), "summary": found} | _case(case, room)
            for (setting, case), found in zip(cases, summary.get("cases", [summary]), strict=True)
        ],
        "rehearsal": rehearsal,
        "provenance": {
            # A study keeps no hashes of the files; the page of one of its missions has them.
            "files": [
                {"field": field, "name": PurePath(name).name, "size": None, "sha256": ""}
                for field, name in file_names(settings)
            ],
            "seeds": f"{int(dataset['seed'].values[0])} to {int(dataset['seed'].values[-1])}",
            "versions": json.loads(dataset.attrs.get("versions", "{}")),
            "settings": changed_settings(settings),
        },
    }


def _case(case: xr.Dataset, room: int) -> dict[str, Any]:
    """Return the missions of one setting: figures of all, legs and routes of the first."""
    figures = {name: case[name].values.astype(float) for name in _FIGURES if name in case}
    figures |= {"use": statistics.use_of_time(case), "gap": statistics.priority_gap(case)}
    figures["planning"] = np.nan_to_num(statistics.planning_time(case))
    count = case.sizes["mission"]
    return {
        "success": case["success"].values == 1,
        "reason": [str(reason) for reason in case["reason"].values],
        "figures": {
            name: [_significant(value) for value in np.asarray(values)] for name, values in figures.items()
        },
        "legs": _legs(case),
        "calls": [list(map(_significant, row)) for row in np.stack(statistics.call_times(case), axis=-1)],
        "missions": [_mission(case.isel(mission=number)) for number in range(min(count, room))],
    }


def _significant(value: float) -> float | None:
    """Return a number with six digits; None of what is infinite or unknown."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _legs(case: xr.Dataset) -> dict[str, Any]:
    """Times of all legs that were executed to their end, without their tasks, and whose they are."""
    expected, executed = statistics.leg_times(case)
    both = np.isfinite(expected) & np.isfinite(executed)
    return {
        "mission": packed(np.nonzero(both)[0], "i32"),
        "expected": packed(expected[both]),
        "executed": packed(executed[both]),
    }


def _mission(one: xr.Dataset) -> dict[str, Any]:
    causes = flag_names(one["route_cause"])
    legs = np.flatnonzero(one["leg_from"].values >= 0)
    columns = ("leg_from", "leg_to", "leg_t_expected", "leg_t_path", "leg_t_task", "leg_priority")
    rows = np.stack([one[name].values[legs].astype(float) for name in columns], axis=1)
    rows[:, 2] -= rows[:, 4]
    whole = np.stack([one[name].values[legs] for name in ("leg_path_replans", "leg_arrived")], axis=1)
    routes = []
    for number, nodes in enumerate(one["route_nodes"].values):
        if (nodes >= 0).any():
            figures = (one[f"route_{name}"].values[number] for name in ("made_at", "time", "priority"))
            routes.append([causes[number], *map(_significant, figures), nodes[nodes >= 0]])
    places = one["waypoint_position"].values
    return {
        "legs": [[*map(_significant, row), *more] for row, more in zip(rows, whole.tolist(), strict=True)],
        "routes": routes,
        "waypoints": packed(np.round(places[np.isfinite(places).all(axis=1)], 1)),
    }


def _command(settings: dict[str, Any]) -> tuple[str, list[str]]:
    """Name of the scenario and what `--set` changes of it; an empty name where it is not a shipped one."""
    shipped = shipped_scenarios().get(str(settings.get("name", "")))
    if shipped is None:
        return "", []
    changed = changed_settings(settings, shipped.model_dump(mode="json"))
    return str(shipped.name), [f"{row['field']}={json.dumps(row['value'])}" for row in changed]
