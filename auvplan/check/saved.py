"""A saved run as the checker reads it: its figures and variables, its legs."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from auvplan.runtime.files import MISSION, SUMMARY, ResultError

Array = NDArray[np.floating]

#: Times may differ by so much where they should agree, s: far above rounding, far below a time step.
TIME_TOLERANCE = 0.01
#: A leg begins and ends within this distance of its waypoints and of the leg before, m.
PLACE_TOLERANCE = 2.0

_SUMMARY_FIELDS = ("t_available", "t_mission", "t_residual", "success", "tasks", "total_priority")
_LEG_FIELDS = ("from", "to", "t_expected", "t_path", "t_task", "priority", "arrived")
_VARIABLES = {
    "time": ("obs",), "x": ("obs",), "y": ("obs",), "depth": ("obs",), "leg_index": ("obs",),
    "row_size": ("leg",), "leg_from": ("leg",), "leg_to": ("leg",), "leg_t_path": ("leg",),
    "leg_t_expected": ("leg",), "leg_t_task": ("leg",), "leg_priority": ("leg",), "leg_arrived": ("leg",),
    "waypoint_position": ("waypoint", "axis"), "adjacency": ("waypoint", "waypoint_to"),
    "task_priority": ("waypoint", "waypoint_to"), "task_duration": ("waypoint", "waypoint_to"),
    "waypoint_priority": ("waypoint",), "waypoint_duration": ("waypoint",),
} | dict.fromkeys(("course", "yaw", "pitch", "surge", "sway", "heave"), ("obs",))  # fmt: skip
#: Variables of which a run has all or none.
_TOGETHER: tuple[dict[str, tuple[str, ...]], ...] = (
    {"obstacle_position": ("obs", "obstacle", "axis"), "obstacle_radius": ("leg", "obstacle")},
    {"passability": ("chart_x", "chart_y"), "chart_origin": ("horizontal",), "chart_pixel_size": ()},
    {"seabed_depth": ("seabed_x", "seabed_y"), "seabed_origin": ("horizontal",), "seabed_pixel_size": ()},
)
_ATTRIBUTES = (
    "vehicle_speed", "t_available", "t_mission", "start", "goal", "arrived", "charged_compute", "scenario",
    "scenario_folder",
)  # fmt: skip


@dataclass(frozen=True)
class Leg:
    """One leg as the file has it: n observations (none where it was refused), M obstacles."""

    number: int
    start: int
    goal: int
    t_path: float
    t_task: float
    priority: float
    arrived: bool
    times: Array  # [n] s
    positions: Array  # [n, 3] m
    obstacles: Array  # [n, M, 3] m
    radii: Array  # [M] m
    t_hold: float = 0.0
    t_wait: float = 0.0
    missed: bool = False
    t_expected: float = np.nan
    speed: float = np.nan  # m/s through the water that it is said to be gone at
    rows: slice = field(default_factory=lambda: slice(0))  # of the observations in the file
    t_fix: float = 0.0  # s of t_hold that it surfaced

    def __str__(self) -> str:
        return f"leg {self.number} ({self.start} to {self.goal})"

    @property
    def begins(self) -> float:
        """When it is begun, s; NaN where it was refused."""
        return float(self.times[0]) if len(self.times) else np.nan

    @property
    def executed(self) -> bool:
        """Whether the leg has a track."""
        return len(self.times) > 0


def require(summary: dict[str, Any], dataset: xr.Dataset, folder: Path) -> None:
    """Raise on what is not there, so that nothing passes for want of data.

    Raises:
        ResultError: a field, variable or attribute is missing or of the wrong kind; one line that names it.
    """

    def need(fine: Any, file: str, reason: str) -> None:
        if not fine:
            raise ResultError(f"{folder / file}: {reason}")

    def need_fields(table: Any, names: tuple[str, ...], prefix: str = "", kind: Any = int | float) -> None:
        for name in names:
            need(isinstance(table, Mapping) and name in table, SUMMARY, f"{prefix}{name} is missing")
            what = "number" if kind == int | float else "table"
            need(isinstance(table[name], kind), SUMMARY, f"{prefix}{name} is not a {what}")

    need_fields(summary, _SUMMARY_FIELDS)
    need_fields(summary, ("legs", "cpu"), kind=list | Mapping)
    for k, row in enumerate(summary["legs"] if isinstance(summary["legs"], list) else ()):
        need_fields(row, _LEG_FIELDS, f"legs[{k}].")
    need_fields(summary["cpu"], ("charged_s",), "cpu.")
    needed = dict(_VARIABLES)
    for group in _TOGETHER:
        if any(name in dataset for name in group):
            needed |= group
    for name, dims in needed.items():
        need(name in dataset, MISSION, f"variable {name} is missing")
        there = dataset[name].dims
        need(there == dims, MISSION, f"variable {name} has dimensions {there}, not {dims}")
    for name in (*_ATTRIBUTES, *(("seabed_clearance",) if "seabed_depth" in dataset else ())):
        need(name in dataset.attrs, MISSION, f"attribute {name} is missing")
    rows = dataset["row_size"]
    whole = (rows >= 0).all() and rows.sum() == dataset.sizes["obs"]
    need(whole, MISSION, "row_size does not add up to the number of observations")


def read_legs(dataset: xr.Dataset) -> Iterator[Leg]:
    """Yield the legs in the order of the file."""
    table = {name: dataset[name].values for name in dataset.variables}
    place = np.stack([table["x"], table["y"], table["depth"]], axis=1).astype(float)
    obstacles = np.asarray(table.get("obstacle_position", np.zeros((len(place), 0, 3))), float)
    radii = np.asarray(table.get("obstacle_radius", np.zeros((len(table["row_size"]), 0))), float)
    ends, still = np.cumsum(table["row_size"]), np.zeros(len(table["row_size"]))
    holds, waits = table.get("leg_t_hold", still), table.get("leg_t_wait", still)
    missed, expected = table.get("leg_missed", still), table["leg_t_expected"]
    speeds = np.asarray(table.get("leg_speed", np.full(len(still), np.nan)), float)
    speeds = np.where(np.isnan(speeds), float(dataset.attrs["vehicle_speed"]), speeds)
    rises = np.nan_to_num(np.asarray(table.get("leg_t_fix", still), float))
    for k, end in enumerate(ends):
        part = slice(int(end - table["row_size"][k]), int(end))
        real = np.isfinite(radii[k])
        yield Leg(
            k, int(table["leg_from"][k]), int(table["leg_to"][k]),
            float(table["leg_t_path"][k]), float(table["leg_t_task"][k]), float(table["leg_priority"][k]),
            bool(table["leg_arrived"][k]), np.asarray(table["time"][part], float), place[part],
            obstacles[part][:, real], radii[k][real], float(holds[k]), float(waits[k]),
            bool(missed[k]), float(expected[k]), float(speeds[k]), part, float(rises[k]),
        )  # fmt: skip


def near(a: Array, b: Array) -> bool:
    """Return whether two places [3] m are one, up to `PLACE_TOLERANCE`."""
    return bool(np.linalg.norm(a - b) <= PLACE_TOLERANCE)


@dataclass(frozen=True)
class Saved:
    """A saved run, and what is read from it."""

    summary: dict[str, Any]
    data: xr.Dataset  # of its file
    legs: list[Leg]
    notes: list[str] = field(default_factory=list)  # what could not be looked at

    def __contains__(self, name: str) -> bool:
        return name in self.data

    def __getitem__(self, name: str) -> NDArray[Any]:
        """Return the values of a variable of the file."""
        return self.data[name].values

    def get(self, name: str, default: Any) -> NDArray[Any]:
        """Return the values of a variable of the file; something else where it has none."""
        return self.data[name].values if name in self.data else default

    def number(self, attribute: str) -> float:
        """Return an attribute of the file."""
        return float(self.data.attrs[attribute])

    def stated(self, attribute: str) -> Any:
        """Return an attribute of the file that is JSON; None where it has none."""
        return json.loads(str(self.data.attrs.get(attribute, "null")))

    @cached_property
    def settings(self) -> dict[str, Any]:
        """Its scenario, as plain data."""
        return self.stated("scenario")

    def section(self, name: str) -> dict[str, Any]:
        """Return a section of its scenario."""
        return self.settings.get(name) or {}

    @cached_property
    def names(self) -> list[str]:
        """Names of its waypoints; empty where they have none."""
        return self.stated("waypoint_names") or []

    @cached_property
    def places(self) -> Array:
        """[N, 3] m, its waypoints."""
        return self["waypoint_position"].astype(float)

    @cached_property
    def adjacency(self) -> NDArray[np.bool_]:
        """[N, N] whether there is an edge."""
        return self["adjacency"].astype(bool)

    @property
    def speed_range(self) -> tuple[float, float]:
        """Least and greatest speed through the water, m/s, that the scenario lets a leg be gone at."""
        own = self.number("vehicle_speed")
        least, most = self.section("vehicle").get("speed_range") or (own, own)
        return float(least), float(most)

    @property
    def simulated(self) -> bool:
        """Whether it was executed, and not only planned."""
        return bool(self.data.attrs.get("simulated", 1))
