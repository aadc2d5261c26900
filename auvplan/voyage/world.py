"""Builds the truth of a mission from a scenario and a seed: chart, task graph, current, obstacles."""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.mission.graph import MissionGraph, random_graph
from auvplan.ocean.chart import Chart
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, random_vortices
from auvplan.ocean.whitsunday import whitsunday_chart
from auvplan.vehicle import Vehicle
from auvplan.voyage.scenario import ChartSettings, Scenario

#: Draws of waypoints before a scenario is declared too cramped.
_TRIES = 200

KINDS = ("static", "afloat", "self-motivated")


class ScenarioError(ValueError):
    """A scenario that cannot be built; the message is one line."""


@dataclass
class TrueObstacles:
    """True obstacles of one leg.

    Attributes:
        position: [M, 3] m, now.
        velocity: [M, 3] m/s, own velocity through the water.
        drift: [M], 1 where the current carries the obstacle.
        radius: [M] m.
        kinds: [M] names of `KINDS`.
    """

    position: NDArray[np.floating]
    velocity: NDArray[np.floating]
    drift: NDArray[np.floating]
    radius: NDArray[np.floating]
    kinds: list[str]

    @property
    def motion(self) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
        """Position, own velocity and drift, which say how they move."""
        return self.position, self.velocity, self.drift


def make_vehicle(scenario: Scenario) -> Vehicle:
    """The scenario's vehicle."""
    return Vehicle(**scenario.vehicle.model_dump())


@lru_cache(maxsize=4)
def _chart(settings: ChartSettings, folder: str) -> Chart | None:
    if settings.source == "none":
        return None
    if settings.source == "whitsunday":
        chart = whitsunday_chart()
    else:
        assert settings.image is not None
        chart = Chart.from_image(Path(folder) / settings.image, pixel_size=settings.pixel_size)
    if settings.window is not None:
        # The window counts rows from the north, the raster from the south.
        row, column, rows, columns = settings.window
        north = chart.shape[0]
        if (
            row < 0
            or column < 0
            or rows < 2
            or columns < 2
            or row + rows > north
            or column + columns > chart.shape[1]
        ):
            raise ScenarioError(
                f"chart.window {settings.window} does not fit a chart of {chart.shape} pixels"
            )
        chart = chart.crop(north - row - rows, column, rows, columns)
        chart = replace(chart, origin=jnp.zeros_like(chart.origin))  # local metres from the window's corner
    return chart


def make_chart(scenario: Scenario, folder: str | Path = ".") -> Chart | None:
    """The scenario's chart, or None for open water.

    Raises:
        ScenarioError: the area reaches beyond the chart.
        ChartError: the picture cannot be read.
    """
    chart = _chart(scenario.chart, str(folder))  # type: ignore[arg-type] - frozen models are hashable
    if chart is None:
        return None
    low, high = np.asarray(chart.lower), np.asarray(chart.upper)
    area = scenario.area
    if (np.asarray(area.lower[:2]) < low - 1e-3).any() or (np.asarray(area.upper[:2]) > high + 1e-3).any():
        raise ScenarioError(
            f"area {area.lower[:2]} to {area.upper[:2]} m reaches beyond the chart, which covers "
            f"{tuple(float(v) for v in low)} to {tuple(float(v) for v in high)} m"
        )
    return chart


def make_graph(scenario: Scenario, chart: Chart | None, rng: np.random.Generator) -> MissionGraph:
    """Waypoints in the water and the edges between them whose straight line is clear of the coast.

    Waypoint 0 is the start, the last one the destination.

    Raises:
        ScenarioError: a given start or goal lies on land, or no connected set of waypoints was found.
    """
    settings, area = scenario.mission, scenario.area
    lower, upper = np.asarray(area.lower), np.asarray(area.upper)
    ends = {0: settings.start, settings.waypoints - 1: settings.goal}
    for name, point in (("start", settings.start), ("goal", settings.goal)):
        if point is not None and chart is not None and not bool(chart.is_water(point[0], point[1])):
            raise ScenarioError(f"mission.{name} {point} lies on land")
    margin = min(scenario.chart.clearance, 0.05 * float((upper - lower)[:2].min()))
    inset = np.array([margin, margin, 0.0])
    for _ in range(_TRIES):
        positions = np.empty((0, 3))
        while len(positions) < settings.waypoints:
            drawn = rng.uniform(lower + inset, upper - inset, (512, 3))
            if chart is not None:
                drawn = drawn[np.asarray(chart.distance(drawn[:, 0], drawn[:, 1])) > scenario.chart.clearance]
            if not len(drawn):
                break
            positions = np.concatenate([positions, drawn])[: settings.waypoints]
        if len(positions) < settings.waypoints:
            raise ScenarioError("chart.clearance leaves no water for waypoints")
        for index, point in ends.items():
            if point is not None:
                positions[index] = point
        sailable = _lines_clear(positions, chart, scenario)
        try:
            return random_graph(
                rng, positions, settings.neighbours, settings.priority, settings.duration, sailable
            )
        except ValueError:
            continue
    raise ScenarioError(
        f"no connected set of {settings.waypoints} waypoints was found in {_TRIES} draws: "
        "lower chart.clearance or move mission.start and mission.goal"
    )


def _lines_clear(positions: np.ndarray, chart: Chart | None, scenario: Scenario) -> np.ndarray:
    """[N, N] bool: whether the straight line between two waypoints keeps clear of the coast."""
    size = len(positions)
    if chart is None or size == 2:  # two waypoints are a single leg: the path planner finds the way round
        return np.ones((size, size), bool)
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    x = positions[:, 0, None] * (1 - share) + positions[None, :, 0] * share
    y = positions[:, 1, None] * (1 - share) + positions[None, :, 1] * share
    least = np.asarray(chart.distance(x, y)).min(axis=0)
    return np.minimum(least, least.T) > 0.3 * scenario.chart.clearance


def make_current(scenario: Scenario, key: jax.Array) -> LambVortices:
    """The true current at the start."""
    settings, area = scenario.current, scenario.area
    if settings.vortices == 0:
        empty = jnp.zeros((1, 0))
        return LambVortices(jnp.zeros((1, 0, 2)), empty, empty, jnp.zeros(1), 0.0, _uniform(scenario))
    field = random_vortices(
        key,
        np.asarray(area.lower),
        np.asarray(area.upper),
        count=settings.vortices,
        layers=settings.layers if area.upper[2] > area.lower[2] else 1,
        radius=settings.radius,
        peak_speed=settings.peak_speed,
        vertical_scale=settings.vertical_scale,
    )
    return replace(field, uniform=_uniform(scenario))


def _uniform(scenario: Scenario) -> jax.Array:
    return jnp.asarray(scenario.current.uniform, float)


def current_update(scenario: Scenario) -> CurrentUpdate:
    """The steps of Eq. 2."""
    settings = scenario.current
    return CurrentUpdate(
        settings.update_rate, settings.center_std, settings.radius_std, settings.strength_std
    )


def draw_obstacles(
    scenario: Scenario, start: np.ndarray, goal: np.ndarray, rng: np.random.Generator
) -> TrueObstacles:
    """True obstacles of one leg, on the line between its waypoints and scattered by sigma^2 = Theta_r.

    They keep off the two waypoints, where the vehicle has to be. On a leg too short for that there are none
    near: the obstacle is moved far away, so that all legs share one shape.
    """
    settings = scenario.obstacles
    count = settings.total
    radius = rng.uniform(*settings.radius, count)
    share = rng.uniform(0.15, 0.85, count)[:, None]
    position = start + (goal - start) * share + rng.normal(size=(count, 3)) * np.sqrt(radius)[:, None]
    room = np.minimum(np.linalg.norm(position - start, axis=1), np.linalg.norm(position - goal, axis=1))
    position[room < radius + 150.0] += 1e6
    kinds = [KINDS[0]] * settings.static + [KINDS[1]] * settings.afloat + [KINDS[2]] * settings.self_motivated
    heading = rng.uniform(0.0, 2.0 * np.pi, count)
    own = settings.speed * np.asarray([kind == KINDS[2] for kind in kinds], float)
    velocity = np.stack([own * np.cos(heading), own * np.sin(heading), np.zeros(count)], axis=1)
    drift = np.asarray([kind != KINDS[0] for kind in kinds], float)
    return TrueObstacles(position, velocity, drift, radius, kinds)
