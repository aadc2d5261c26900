"""Builds the truth of a mission from a scenario and a seed: current, obstacles, vehicle; seas like it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from auvplan.errors import ScenarioError
from auvplan.ocean.currents import Current, partition
from auvplan.ocean.ensemble import changing_vortices, random_fields
from auvplan.ocean.known import Spheres
from auvplan.ocean.vortices import CurrentUpdate, LambVortices, random_vortices
from auvplan.runtime import prng
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.scenario.settings import TransitAltitude
from auvplan.scenario.vehicles import navigation_settings, power_model
from auvplan.simulation.sea import ModelSea, Sea, VortexSea
from auvplan.vehicle import Vehicle

KINDS = ("static", "afloat", "self-motivated")
#: Kind of the obstacles that are known before the mission.
KNOWN = "known"


@dataclass
class TrueObstacles:
    """True obstacles of one leg.

    Attributes:
        position: [M, 3] m, now.
        velocity: [M, 3] m/s, own velocity through the water.
        drift: [M], 1 where the current carries the obstacle.
        radius: [M] m.
        kinds: [M] names of `KINDS`, or `KNOWN`.
    """

    position: NDArray[np.floating]
    velocity: NDArray[np.floating]
    drift: NDArray[np.floating]
    radius: NDArray[np.floating]
    kinds: list[str]

    @classmethod
    def known(cls, found: Spheres) -> "TrueObstacles":
        """Obstacles of which all is known."""
        count = len(found.radius)
        return cls(found.position, found.velocity, np.zeros(count), found.radius, [KNOWN] * count)

    def __add__(self, other: "TrueObstacles") -> "TrueObstacles":
        return TrueObstacles(
            np.concatenate([self.position, other.position]),
            np.concatenate([self.velocity, other.velocity]),
            np.concatenate([self.drift, other.drift]),
            np.concatenate([self.radius, other.radius]),
            self.kinds + other.kinds,
        )

    @property
    def motion(self) -> tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]:
        """Position, own velocity and drift, which say how they move."""
        return self.position, self.velocity, self.drift


def make_vehicle(scenario: Scenario, folder: str | Path | None = None) -> Vehicle:
    """Return the scenario's vehicle; `folder` is what relative paths start from, its own if absent.

    Raises:
        ScenarioError: its power or its navigation is not known.
    """
    apart = {"depth_min", "depth_max", "transit_depth", "power", "saw_tooth", "speed_range", "navigation"}
    stated: dict[str, Any] = scenario.vehicle.model_dump(exclude=apart)
    home, power = scenario.folder if folder is None else folder, scenario.vehicle.power
    fastest = (scenario.vehicle.speed_range or (scenario.vehicle.speed,))[-1]
    stated["power"] = model = power_model(power, home, fastest)
    if model is not None and model.pump and scenario.vehicle.saw_tooth is None:
        raise ScenarioError("has a pump, which goes with vehicle.saw_tooth alone", field="vehicle.power")
    if (known := navigation_settings(scenario.vehicle.navigation, home)) is not None:
        stated["navigation"] = known.made(scenario.safety.confidence)
    stated["pitch_max"] = scenario.pitch_max
    transit = scenario.vehicle.transit_depth
    if isinstance(transit, TransitAltitude):
        stated["transit_altitude"] = transit.altitude
    else:
        stated["transit_depth"] = transit
    return Vehicle(**stated)


def make_sea(
    scenario: Scenario, area: OperatingArea, field_key: jax.Array, sea_key: jax.Array, simulated: bool = True
) -> Sea:
    """Return the true current of a mission and its forecasts.

    The forecast for both where none is simulated.
    """
    settings = scenario.current
    if area.truth is None or area.forecast is None:
        field, update = make_current(scenario, field_key), current_update(scenario)
        by_window = scenario.planning.resolved.current_updates == "window"
        interval = None if by_window else settings.update_interval
        return VortexSea(sea_key, field, update, interval, settings.forecast_error if simulated else 0.0)
    if not simulated:
        return ModelSea(area.forecast, area.forecast)
    if settings.forecast_error == 0.0:
        return ModelSea(area.truth, area.forecast)
    low, high = (np.asarray(corner) for corner in scenario.box)
    error = random_vortices(
        field_key,
        low,
        high,
        count=settings.vortices,
        radius=settings.radius,
        peak_speed=settings.forecast_error * area.forecast.fastest,
    )
    return ModelSea(area.truth, area.forecast, error)


def make_current(scenario: Scenario, key: jax.Array) -> LambVortices:
    """Return the true current at the start."""
    settings, area = scenario.current, scenario.area
    uniform = jax.device_put(np.asarray(settings.uniform, float))
    if settings.vortices == 0:
        empty = jnp.zeros((1, 0))
        return LambVortices(jnp.zeros((1, 0, 2)), empty, empty, jnp.zeros(1), 0.0, uniform)
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
    return replace(field, uniform=uniform)


def current_update(scenario: Scenario) -> CurrentUpdate:
    """Return the steps of Eq. 2."""
    settings = scenario.current
    return CurrentUpdate(
        settings.update_rate, settings.center_std, settings.radius_std, settings.strength_std
    )


def drawn_seas(
    scenario: Scenario,
    area: OperatingArea,
    forecast: Current,
    key: jax.Array,
    count: int,
    begins: float,
    ends: float,
) -> Iterator[tuple[Current | None, Current | None, int]]:
    """Yield `count` seas that may be the true one, those of one member together.

    It is what they have in common, or None; what each has of its own, leaves with a leading axis, None where
    they do not differ; and how many they are.

    Vortices differ from their forecast by its stated error, and change at every update by Eq. 2. Other
    currents are each of the members, the forecast among them, with a random error of the stated size. Where
    nothing is stated, all are the forecast.

    Args:
        scenario: settings.
        area: what its files contain.
        forecast: that plans are made in.
        key: PRNG key, consumed.
        count: of seas, at least one of each member.
        begins, ends: s since the epoch, that they are asked for.

    Raises:
        ScenarioError: the current changes at windows of legs, and not in time.
    """
    settings = scenario.current
    if isinstance(forecast, LambVortices):
        if scenario.planning.resolved.current_updates == "window":
            reason = "needs vortices that change in time: planning.current_updates 'interval'"
            raise ScenarioError(reason, field="planning.promise")
        interval = settings.update_interval
        first = np.floor(begins / interval)
        steps = max(int(np.floor(ends / interval) - first), 0)
        own = changing_vortices(
            key,
            forecast,
            settings.forecast_error,
            (interval, first * interval),
            update=current_update(scenario),
            steps=steps,
            count=count,
        )
        yield None, own, count
        return
    known, _ = partition(forecast)
    assert known is not None
    members, errs = (known, *area.members), settings.members
    shares = np.diff(np.linspace(0, max(count, len(members)), len(members) + 1).round().astype(int))
    for member, share, part in zip(members, shares.tolist(), prng.parts(key, len(members)), strict=True):
        own = None
        if errs is not None and errs.error > 0.0:
            own = random_fields(part, share, errs.error, errs.length, errs.duration)
        yield member, own, share


def draw_obstacles(
    scenario: Scenario, start: np.ndarray, goal: np.ndarray, rng: np.random.Generator
) -> TrueObstacles:
    """True obstacles of one leg, on the line between its waypoints and scattered by sigma^2 = Theta_r.

    They keep off the two waypoints, where the vehicle has to be. On a leg too short for that there are none
    near: the obstacle is moved far away, so that all legs share one shape.

    Differences from the paper:
        Its N(0, sigma^2) bounded to the two waypoints is read as a scatter about the middle 70 % of the line
        between them. Numbers, sizes and speeds of obstacles are chosen here.
    """
    settings = scenario.simulation.obstacles
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
