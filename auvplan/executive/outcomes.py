"""How a plan goes in many seas, each of which may be the true one.

The vehicle keeps the tracks of its legs, at its speed through the water: what changes is when it arrives.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from auvplan.energy.power import WATT_HOUR
from auvplan.executive.context import Mission
from auvplan.path.outlook import Chain, chain_times, leg_times
from auvplan.records import LegRecord, MissionRun
from auvplan.runtime import prng
from auvplan.runtime.intervals import wilson
from auvplan.simulation.draws import drawn_seas

Array = NDArray[np.floating]

#: Seas that a promise is judged in.
SEAS = 1000

#: Samples of a leg's path, legs and windows that programs are made for; of the latter two multiples.
_SAMPLES, _LEGS, _WINDOWS = 33, 8, 2


@dataclass(frozen=True)
class Outcomes:
    """How a plan goes in D seas.

    Attributes:
        ends: [D] s since the epoch, when the mission is over.
        stops: [D, L] s since the epoch, when each leg and its task are over, all of them done.
        done: [D, L] whether each task is in time for its window.
        used: [D] share of the time or of the energy available that it takes, whichever is more.
        members: [D], the number of the forecast's member that each was drawn from.
        home_travel, home_used: [D, K] s, and shares as `used`, where the vehicle goes straight to the
            destination from one of the first K stops; infinite where there is no way.
    """

    ends: Array
    stops: Array
    done: NDArray[np.bool_]
    used: Array
    members: NDArray[np.integer]
    home_travel: Array
    home_used: Array

    @property
    def home(self) -> NDArray[np.bool_]:
        """[D], whether the destination is reached in time, and with the energy that may be used."""
        return self.used <= 1.0

    @property
    def rest(self) -> Array:
        """[D, L] s, that the plan goes on for after each leg and its task."""
        return self.stops[:, -1:] - self.stops

    @property
    def share(self) -> float:
        """In which it is home in time."""
        return float(self.home.mean())

    @property
    def interval(self) -> tuple[float, float]:
        """Ends of the 95 % interval of that.

        Seas of one member are alike: they count as fewer the more of what differs between seas is the
        member's (the design effect of a cluster sample; Kish, Survey Sampling, 1965, section 5.4).
        """
        count, groups = len(self.home), int(self.members.max()) + 1
        alike = 0.0
        if groups > 1:
            means = np.bincount(self.members, self.used) / np.bincount(self.members)
            within = float(((self.used - means[self.members]) ** 2).sum()) / (count - groups)
            between = max(float(means.var(ddof=1)) - within * groups / count, 0.0)
            alike = between / (between + within) if between + within > 0.0 else 1.0
        low, high = wilson(self.share, count / (1.0 + (count / groups - 1.0) * alike))
        return float(low), float(high)


def outcomes(
    mission: Mission, legs: list[LegRecord], key: jax.Array, ways: Sequence[LegRecord | None] = ()
) -> Outcomes:
    """Follow the legs of a plan in seas that are drawn.

    Besides the currents the times of tasks scatter, by `mission.duration_error`, and each leg is delayed by
    obstacles that no plan knows of: exponentially, as long in the mean as `planning.detour` says of all of
    them.

    Args:
        mission: as it is before the first of the legs, in the forecast.
        legs: that are planned, in order.
        key: PRNG key, consumed.
        ways: to the destination from the first K stops; None where there is none.
    """
    context, run = mission.context, mission.run
    scenario, begins = context.scenario, mission.now
    own = float(np.asarray(context.vehicle.speed))
    chain, count = _chain(mission, legs, own), len(legs)
    home = _chain(mission, [legs[k] if way is None else way for k, way in enumerate(ways)], own)
    sea_key, chance = prng.parts(key, 2)
    rng = prng.generator(chance)
    detour = context.rules.detour * scenario.simulation.obstacles.total
    forecast = mission.sea.forecast()
    travels, overs, dones, members, homes = [], [], [], [], []
    common = context.vehicle.without_transit(), context.path_config.only()
    error = scenario.mission.duration_error
    until = max(run.t_available, legs[-1].ends) if legs else begins

    def delays(seas: int, size: int, count: int) -> Array:
        drawn = rng.standard_exponential((seas, size)) * (np.arange(size) < count)
        return (detour * drawn).astype(np.float32)

    for number, seas in enumerate(drawn_seas(scenario, context.area, forecast, sea_key, SEAS, begins, until)):
        size, sea = len(chain.task), (forecast, seas.shared, seas.own, common[0])
        factors = np.maximum(1.0 + error * rng.standard_normal((seas.count, size)), 0.0).astype(np.float32)
        late = delays(seas.count, size, count)
        found = chain_times(chain, factors, late, np.float32(begins), *sea, config=common[1])
        travel, end, done = (np.asarray(part, float) for part in jax.device_get(found))
        dones.append(done[:, :count].astype(bool))
        travels.append(travel[:, :count])
        overs.append(end[:, :count] if count else np.full((seas.count, 1), begins))
        members.append(np.full(seas.count, number))
        if ways:
            leaves = np.zeros((seas.count, len(home.task)), np.float32)
            leaves[:, : len(ways)] = end[:, : len(ways)]
            late = delays(seas.count, len(home.task), len(ways))
            back = leg_times(home, leaves, *sea, config=common[1])
            homes.append(np.asarray(jax.device_get(back), float)[:, : len(ways)] + late[:, : len(ways)])
    travel, stops = np.concatenate(travels), np.concatenate(overs)
    over, available = stops[:, -1], run.t_available - begins
    used = (over - begins) / available
    spent = _energy_used(run, own, legs, travel)
    used = used if spent is None else np.maximum(used, spent)
    home_travel, home_used = np.zeros((len(over), 0)), np.zeros((len(over), 0))
    if ways:
        home_travel = np.concatenate(homes)
        home_travel[:, [way is None for way in ways]] = np.inf
        home_used = (stops[:, : len(ways)] + home_travel - begins) / available
        for k, way in enumerate(ways):
            if way is not None:
                lasts = np.concatenate([travel[:, : k + 1], home_travel[:, k : k + 1]], axis=1)
                spent = _energy_used(run, own, [*legs[: k + 1], way], lasts)
                home_used[:, k] = home_used[:, k] if spent is None else np.maximum(home_used[:, k], spent)
    members = np.concatenate(members)
    return Outcomes(over, stops, np.concatenate(dones), used, members, home_travel, home_used)


def _energy_used(run: MissionRun, speed: float, legs: list[LegRecord], travel: Array) -> Array | None:
    """Return the share [D] of the energy that may be used which legs take, or None where it is not limited.

    Args:
        run: its power model and battery.
        speed: m/s through the water, where legs have none of their own.
        legs: L legs, as planned.
        travel: [D, L] s, that their paths take; the rest is as planned.
    """
    power = run.vehicle.power
    if power is None or power.battery is None or not legs:
        return None
    whole = replace(run, legs=legs).energy
    assert whole is not None
    watts = [float(power.power(speed if leg.speed is None else leg.speed)) for leg in legs]
    more = ((travel - np.asarray([leg.t_path for leg in legs])) * watts).sum(axis=1) / WATT_HOUR
    return (whole.total + more) / max(whole.total + whole.margin, 1e-9)


def _chain(mission: Mission, legs: list[LegRecord], speed: float) -> Chain:
    """Return planned legs for `chain_times`, padded by such as end where they begin."""
    more = -len(legs) % _LEGS
    places = np.linspace(0.0, 1.0, _SAMPLES)

    def thinned(leg: LegRecord) -> Array:
        along = np.linspace(0.0, 1.0, len(leg.positions))
        return np.stack([np.interp(places, along, axis) for axis in np.asarray(leg.positions, float).T], 1)

    table = mission.run.graph.timetable
    windows = 1 if table is None else max(table.opens.shape[-1], 1)
    opens = np.full((len(legs), -(-windows // _WINDOWS) * _WINDOWS), -np.inf)
    closes = np.full(opens.shape, np.inf)
    if table is not None and (count := table.opens.shape[-1]):
        closes[:, count:], opens[:, count:] = -np.inf, np.inf  # no windows of theirs
        for row, leg in enumerate(legs):
            opens[row, :count] = table.opens[leg.start, leg.goal]
            closes[row, :count] = table.closes[leg.start, leg.goal]
    rises = [leg.t_fix or 0.0 for leg in legs]
    waits = [leg.t_hold > rise for leg, rise in zip(legs, rises, strict=True)]
    rows: dict[str, Any] = {
        "positions": np.stack([thinned(leg) for leg in legs]) if legs else np.zeros((0, _SAMPLES, 3)),
        "departs": [float(leg.times[0]) for leg in legs],
        "takes": [leg.t_path for leg in legs],
        "speed": [speed if leg.speed is None else leg.speed for leg in legs],
        "rises": rises,
        "leaves": [float(leg.times[0]) if wait else -np.inf for leg, wait in zip(legs, waits, strict=True)],
        "opens": opens,
        "closes": closes,
        "task": [leg.t_task for leg in legs],
    }
    fill: dict[str, float] = {"speed": speed, "leaves": -np.inf, "opens": -np.inf, "closes": np.inf}
    padded: dict[str, Any] = {
        name: np.concatenate([values, np.full((more, *np.shape(values)[1:]), fill.get(name, 0.0))])
        for name, values in ((name, np.asarray(values, float)) for name, values in rows.items())
    }
    single: dict[str, Any] = {name: values.astype(np.float32) for name, values in padded.items()}
    return Chain(**single)
