"""Seas that may be the true one, drawn from what a scenario says of the errors of its forecast."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import numpy as np

from auvplan.errors import ScenarioError
from auvplan.ocean.currents import Current, partition
from auvplan.ocean.ensemble import changing_vortices, random_fields
from auvplan.ocean.vortices import LambVortices
from auvplan.runtime import prng
from auvplan.scenario.area import OperatingArea
from auvplan.scenario.scenario import Scenario
from auvplan.simulation.world import current_update


class DrawnSeas(NamedTuple):
    """Seas of one forecast.

    Attributes:
        shared: what they have in common, or None.
        own: of each one; leaves have a leading axis. None where they do not differ.
        count: of seas.
    """

    shared: Current | None
    own: Current | None
    count: int


def drawn_seas(
    scenario: Scenario,
    area: OperatingArea,
    forecast: Current,
    key: jax.Array,
    count: int,
    begins: float,
    ends: float,
) -> Iterator[DrawnSeas]:
    """Yield `count` seas that may be the true one, those of one member together.

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
        yield DrawnSeas(None, own, count)
        return
    known, _ = partition(forecast)
    assert known is not None
    members, errs = (known, *area.members), settings.members
    shares = np.diff(np.linspace(0, max(count, len(members)), len(members) + 1).round().astype(int))
    for member, share, part in zip(members, shares.tolist(), prng.parts(key, len(members)), strict=True):
        own = None
        if errs is not None and errs.error > 0.0:
            own = random_fields(part, share, errs.error, errs.length, errs.duration)
        yield DrawnSeas(member, own, share)
