"""Where and when a mission is: local metres and seconds to longitude, latitude and time of day, and back."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pyproj import Proj, Transformer

from auvplan.errors import AuvplanError
from auvplan.runtime.arguments import numbers
from auvplan.runtime.arrays import turned

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Site:
    """A place on the WGS 84 ellipsoid and a moment, from which local coordinates count.

    Local metres north and east come from the azimuthal equidistant projection about the place.

    Attributes:
        longitude: degrees east.
        latitude: degrees north.
        epoch: the moment of local time 0 s; None where missions have no date.
        origin: local north and east of the place, m.

    Raises:
        TypeError: degrees or metres are no numbers, or the epoch is no `datetime`.
        ValueError: the place is not on the Earth, or the origin not two finite numbers.

    Example:
        >>> site = Site(148.96, -20.34)
        >>> [round(float(metres)) for metres in site.to_local(148.97, -20.34)]
        [0, 1044]
    """

    longitude: float
    latitude: float
    epoch: datetime | None = None
    origin: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        longitude, latitude = numbers("site longitude and latitude", (self.longitude, self.latitude)).tolist()
        if not is_place(longitude, latitude):
            wanted = "site longitude must be in [-180, 360] and latitude in [-90, 90] degrees"
            raise ValueError(f"{wanted}, got {self.longitude} and {self.latitude}")
        origin = tuple(numbers("site origin", self.origin).tolist())
        if len(origin) != 2 or not np.isfinite(origin).all():
            raise ValueError(f"site origin must be two finite numbers, m north and east, got {self.origin}")
        if not isinstance(self.epoch, datetime | None):
            raise TypeError(f"site epoch must be a datetime or None, got {self.epoch!r:.80}")
        for name, value in (("longitude", longitude), ("latitude", latitude), ("origin", origin)):
            object.__setattr__(self, name, value)

    def to_local(self, longitude: ArrayLike, latitude: ArrayLike) -> tuple[Array, Array]:
        """Local north and east, m, of places by longitude (-180 to 180 or 0 to 360) and latitude, degrees."""
        east, north = _projection(self.longitude, self.latitude).transform(longitude, latitude)
        return np.asarray(north) + self.origin[0], np.asarray(east) + self.origin[1]

    def to_geographic(self, north: ArrayLike, east: ArrayLike) -> tuple[Array, Array]:
        """Longitude in [-180, 180] and latitude, degrees, of local north and east, m."""
        longitude, latitude = _projection(self.longitude, self.latitude).transform(
            np.asarray(east) - self.origin[1], np.asarray(north) - self.origin[0], direction="INVERSE"
        )
        return np.asarray(longitude), np.asarray(latitude)

    def true_north(self, longitude: ArrayLike, latitude: ArrayLike) -> Array:
        """Bearing of true north in the local frame, rad clockwise from local north; 0 at the site."""
        proj = _projection_of(self.longitude, self.latitude)
        convergence = proj.get_factors(np.asarray(longitude), np.asarray(latitude)).meridian_convergence
        return -np.deg2rad(np.asarray(convergence))  # it is where grid north points, seen from true north

    def local_vector(
        self, north: ArrayLike, east: ArrayLike, longitude: ArrayLike, latitude: ArrayLike
    ) -> tuple[Array, Array]:
        """Local north and east components of a vector, such as a velocity, by true north and east.

        Args:
            north, east: [..., n], its components in any unit.
            longitude, latitude: [n] degrees, where it is.
        """
        return turned(north, east, self.true_north(longitude, latitude))

    def utc(self, seconds: float) -> datetime | None:
        """Return the moment of a local time, or None where missions have no date."""
        return None if self.epoch is None else self.epoch + timedelta(seconds=float(seconds))

    def seconds(self, moment: datetime) -> float:
        """Local time, s, of a moment; one without a time zone is taken as UTC.

        Raises:
            ValueError: the site has no epoch.
        """
        if self.epoch is None:
            raise ValueError("the site has no epoch to count from")
        return (as_utc(moment) - as_utc(self.epoch)).total_seconds()


def as_utc(moment: datetime) -> datetime:
    """Return a moment in UTC; one without a time zone is taken as UTC."""
    return moment.replace(tzinfo=UTC) if moment.tzinfo is None else moment.astimezone(UTC)


def at_time(seconds: float, epoch: datetime | None, since: float | None = None) -> str:
    """Return a time in words: of day in UTC, or seconds where there is no epoch to count from.

    Args:
        seconds: the time.
        epoch: that it counts from; UTC where it has no time zone.
        since: a time whose date is known: it is not said again of the same day.
    """
    if epoch is None:
        return f"at {seconds:,.0f} s"
    then = as_utc(epoch) + timedelta(seconds=float(seconds))
    if since is not None and (as_utc(epoch) + timedelta(seconds=float(since))).date() == then.date():
        return f"{then:%H:%M} UTC"
    return f"{then:%Y-%m-%d %H:%M} UTC"


def _definition(longitude: float, latitude: float) -> str:
    return f"+proj=aeqd +lon_0={longitude!r} +lat_0={latitude!r} +datum=WGS84 +units=m"


@cache
def _projection_of(longitude: float, latitude: float) -> Proj:
    return Proj(_definition(longitude, latitude))


@cache
def _projection(longitude: float, latitude: float) -> Transformer:
    return Transformer.from_crs("EPSG:4326", _definition(longitude, latitude), always_xy=True)


def is_place(longitude: float, latitude: float) -> bool:
    """Return whether degrees are on the Earth."""
    return bool(-180.0 <= longitude <= 360.0 and -90.0 <= latitude <= 90.0)


def swapped(site: Site) -> Site | None:
    """Return the site with longitude and latitude the other way round; None where that is no place."""
    longitude, latitude = site.latitude, (site.longitude + 180.0) % 360.0 - 180.0
    return replace(site, longitude=longitude, latitude=latitude) if abs(latitude) < 89.0 else None


def swapped_hint(site: Site, fits: Callable[[Site], object]) -> str:
    """Return a hint after a colon where something fits the site with its coordinates swapped, else nothing.

    Args:
        site: as given.
        fits: called with the swapped site; false, or an `AuvplanError`, where it does not fit that either.
    """
    other = swapped(site)
    if other is None:
        return ""
    hint = ": with longitude and latitude of the site or of the file swapped it would fit"
    try:
        return hint if fits(other) else ""
    except AuvplanError:
        return ""
