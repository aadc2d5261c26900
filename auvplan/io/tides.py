"""Tidal constituents from a small YAML file; astronomical arguments and nodal corrections are utide's."""

from collections.abc import Mapping
from datetime import UTC
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import AfterValidator, Field

from auvplan.errors import RuleError
from auvplan.ocean.gridded import CurrentError
from auvplan.ocean.tides import HarmonicCurrent
from auvplan.runtime.arrays import turned
from auvplan.scenario.fields import read_section
from auvplan.scenario.section import Finite, Section
from auvplan.site import Site

_DAY = 86_400.0
#: M/s; no tide is faster.
_Speed = Annotated[float, Field(ge=-100.0, le=100.0)]


def _known(name: str) -> str:
    from utide._ut_constants import ut_constants

    if name not in ut_constants.const.name:
        raise ValueError("is none that is known, such as M2, S2, N2, K1, O1")
    return name


class _Constituent(Section):
    """East and north, [amplitude m/s, Greenwich phase degrees], or the ellipse; see `read_tide`."""

    u: tuple[_Speed, Finite] | None = None
    v: tuple[_Speed, Finite] | None = None
    ellipse: tuple[_Speed, _Speed, Finite, Finite] | None = None

    def _check(self) -> None:
        if self.model_fields_set not in ({"u", "v"}, {"ellipse"}):
            raise ValueError("needs u and v, [m/s, degrees] each, or ellipse, and nothing else")

    @property
    def amplitudes(self) -> np.ndarray:
        """[2] complex, m/s north and east: times the cosine of the argument they are the velocity."""
        if self.u is not None and self.v is not None:
            return np.array([size * np.exp(-1j * np.radians(lag)) for size, lag in (self.v, self.u)])
        assert self.ellipse is not None
        major, minor, turn, lag = self.ellipse
        along, across = np.exp(-1j * np.radians(lag)) * np.array([major, -1j * minor])
        return np.array(turned(along, across, np.radians(turn))[::-1])


_Constituents = Mapping[Annotated[str, AfterValidator(_known)], _Constituent]


class _Place(Section):
    """Constituents and the mean, m/s east and north, at a place in degrees."""

    longitude: Finite
    latitude: Finite
    constituents: Annotated[_Constituents, Field(min_length=1)]
    mean: tuple[_Speed, _Speed] = (0.0, 0.0)


class _Tide(Section):
    """A whole file."""

    source: Any = None  # of the figures, for people
    constituents: _Constituents = Field(default={})
    mean: tuple[_Speed, _Speed] = (0.0, 0.0)
    places: tuple[_Place, ...] = ()
    depths: tuple[Finite, ...] = (0.0,)
    shares: tuple[Finite, ...] = (1.0,)

    def _check(self) -> None:
        if bool(self.constituents) == bool(self.places):
            reason = "must map names such as M2 to u and v, or to an ellipse; here or in places, not in both"
            raise RuleError(reason, field="constituents", concerns=("places",))
        if len(self.depths) != len(self.shares) or not (np.diff(self.depths) > 0.0).all():
            raise RuleError("must rise, and shares must be as many", field="depths", concerns=("shares",))


def read_tide(path: str | Path, site: Site, until: float, since: float = 0.0) -> HarmonicCurrent:
    """Read a tidal current from constituents at one place or at a few.

    The file holds `constituents`, each by its name with `u` and `v`, east and north, [amplitude m/s,
    Greenwich phase degrees], or with `ellipse`, [semi-major m/s, semi-minor m/s, inclination degrees,
    Greenwich phase degrees], as utide solves for. Beside it may stand `mean`, [u, v] m/s; or all of that
    under `places`, a list whose members have `longitude` and `latitude` too. `depths` m and `shares` give a
    profile.

    Nodal corrections are those of the middle of the time from `since` to `until`, s since the epoch: in a
    month they change by less than a hundredth.

    Raises:
        CurrentError: one line that names the file and the field.
    """
    from utide._ut_constants import ut_constants
    from utide.harmonics import FUV

    stated = read_section(path, _Tide, CurrentError)
    if site.epoch is None:
        raise CurrentError(
            f"{path}: tidal constituents need site.departure: the phase of the tide follows from it"
        )
    here: dict[str, Any] = {"longitude": site.longitude, "latitude": site.latitude, "mean": stated.mean}
    places = stated.places or (_Place(**here, constituents=stated.constituents),)
    known = list(ut_constants.const.name)
    names = list(dict.fromkeys(name for one in places for name in one.constituents))
    index = np.array([known.index(name) for name in names], int)
    rate = 2.0 * np.pi * ut_constants.const.freq[index] / 3600.0
    middle = 0.5 * (since + until)
    epoch = site.epoch.astimezone(UTC)
    seconds = epoch.hour * 3600.0 + epoch.minute * 60.0 + epoch.second
    days = epoch.toordinal() + seconds / _DAY + middle / _DAY
    shape = 2, len(places), len(names)
    in_phase, quadrature, mean = np.zeros(shape), np.zeros(shape), np.zeros(shape[:2])
    for p, one in enumerate(places):
        # None of its short cuts: corrections are exact at the moment that is asked for.
        factor, nodal, argument = FUV(np.array([days]), days, index, one.latitude, [False] * 4)
        phase = 2.0 * np.pi * (nodal[0] + argument[0]) - rate * middle
        for name, constituent in one.constituents.items():
            # The argument at the epoch turns the amplitudes, north and east.
            k = names.index(name)
            turned = factor[0, k] * constituent.amplitudes * np.exp(1j * phase[k])
            in_phase[:, p, k], quadrature[:, p, k] = turned.real, -turned.imag
        mean[:, p] = one.mean[::-1]
    where = np.asarray([(one.longitude, one.latitude) for one in places]).T
    in_phase, quadrature = (
        np.stack(site.local_vector(*part.transpose(0, 2, 1), *where)).transpose(0, 2, 1)
        for part in (in_phase, quadrature)
    )
    mean = site.local_vector(*mean, *where)
    local = np.stack(site.to_local(*where), axis=1)
    arrays = local, rate, in_phase, quadrature, mean, stated.depths, stated.shares
    return HarmonicCurrent(*(np.asarray(array, np.float32) for array in arrays))
