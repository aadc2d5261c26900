"""Detection of swapped longitude and latitude."""

from collections.abc import Callable
from dataclasses import replace

from auvplan.errors import AuvplanError
from auvplan.site import Site

#: What to say where it would.
HINT = "with longitude and latitude of the site or of the file swapped it would fit"


def swapped(site: Site) -> Site | None:
    """Return the site with longitude and latitude the other way round; None where that is no place."""
    longitude, latitude = site.latitude, (site.longitude + 180.0) % 360.0 - 180.0
    return replace(site, longitude=longitude, latitude=latitude) if abs(latitude) < 89.0 else None


def swapped_hint(site: Site, fits: Callable[[Site], object]) -> str:
    """`HINT` after a colon where something fits the swapped site, else an empty string.

    Args:
        site: as given.
        fits: called with the swapped site; false, or an `AuvplanError`, where it does not fit that either.
    """
    other = swapped(site)
    if other is None:
        return ""
    try:
        return f": {HINT}" if fits(other) else ""
    except AuvplanError:
        return ""
