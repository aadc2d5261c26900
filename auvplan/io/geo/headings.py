"""Headings and properties of a jobs file that mean nothing but look as if they should."""

import difflib
import re
from collections.abc import Iterable, Mapping

from auvplan.io.geo.error import GeoError

#: What operators and other programs call what jobs have.
_OTHER_WORDS = {
    "duration": "dwell dwell_time hold hold_time holdtime loiter loiter_time wait wait_time stay time "
    "time_on_site time_on_station service_time bottom_time seconds secs minutes hours",
    "priority": "weight importance value reward rank score rho profit urgency",
    "depth": "z down altitude alt elevation elev height level",
    "name": "id fid label title job job_name job_id task task_name waypoint wp site station",
    "from": "earliest start_time not_before begin after opens open",
    "to": "latest end_time not_after end before deadline due closes close",
    "windows": "time_window time_windows opening_hours",
    "line": "track transect survey line_id line_name lawnmower segment group",
    "lon": "lng x_deg long_deg",
    "lat": "y_deg",
    "north": "northing n y_local",
    "east": "easting e x_local",
}
#: What is asked of jobs elsewhere and has no counterpart here.
_UNHEEDED = "speed heading course yaw radius required mandatory enabled skip order sequence seq"
_MEANING = {
    "depth": "m, positive down",
    "duration": "s",
    "priority": "a number, 0 or more",
    "north": "m from the site",
    "east": "m from the site",
    "lon": "degrees east",
    "lat": "degrees north",
    "from": "a moment, a time of day or seconds",
    "to": "a moment, a time of day or seconds",
}
#: A unit or a remark after a name: "depth [m]", "duration_s", "prio.".
_UNIT = re.compile(
    r"[\s_]*[\[({].*|[\s_.]+(m|s|sec|secs|seconds|min|mins|minutes|h|hours|deg|degrees|metres|meters)?\.?$"
)


def check_headings(where: str, given: Iterable[str], known: Mapping[str, str]) -> dict[str, str]:
    """Refuse a name that is all but one that means something, and doubt one that may stand for it.

    Args:
        where: the file, as messages name it.
        given: names in the file, in lower case.
        known: names that mean something, each to what it tells.

    Returns:
        By name, what to warn of: it is another word for something that is not given, or asks for what jobs do
        not have; it is left unread.

    Raises:
        GeoError: a name differs from a known one by a slip of the pen, an abbreviation or a unit.
    """
    names = list(dict.fromkeys(given))
    stated = {known[name] for name in names if name in known}
    slips = [
        f"{where}: {name!r} means nothing here: {meant!r} does{_in_words(known[meant])}"
        for name in names
        if name not in known and (meant := slip_of(name, known))
    ]
    if slips:
        raise GeoError(*slips)
    doubts = {}
    for name in names:
        plain = _plain(name)
        meant = next(
            (kind for kind, words in _OTHER_WORDS.items() if plain in words.split() and kind in known), None
        )
        if name in known:
            continue
        if meant and meant not in stated:
            doubts[name] = f"{where}: {name!r} is left unread: is {meant!r} meant{_in_words(meant)}?"
        elif plain in _UNHEEDED.split():
            what = "jobs have a place, priority, duration, name and time windows alone"
            doubts[name] = f"{where}: {name!r} is left unread: {what}"
    return doubts


def slip_of(name: str, known: Mapping[str, str]) -> str:
    """Return the known name that a name all but is, or an empty string."""
    plain = _plain(name)
    if plain in known:
        return plain
    if len(plain) < 3 or any(plain in words.split() for words in _OTHER_WORDS.values()):
        return ""
    begun = [word for word in known if word.startswith(plain)]
    if len(plain) > 3:
        begun += difflib.get_close_matches(plain, [word for word in known if len(word) > 3], 1, cutoff=0.8)
    return begun[0] if begun else ""


def _plain(name: str) -> str:
    return _UNIT.sub("", name.strip()).replace(" ", "_").replace("-", "_")


def _in_words(kind: str) -> str:
    return f" ({_MEANING[kind]})" if kind in _MEANING else ""
