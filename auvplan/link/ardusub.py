"""ArduSub's own ways: its modes, what it keeps of a mission, and what it does when nobody talks to it.

Facts are those of ArduPilot's sources, the file in brackets.
"""

from collections.abc import Mapping

#: Modes (ArduSub/mode.h). That of holding the depth follows that of surfacing at the surface.
AUTO, POSHOLD, SURFACE, ALT_HOLD = 3, 16, 9, 2
_MODES = {
    0: "STABILIZE", 1: "ACRO", 2: "ALT_HOLD", 3: "AUTO", 4: "GUIDED", 7: "CIRCLE", 9: "SURFACE",
    16: "POSHOLD", 19: "MANUAL", 20: "MOTOR_DETECT", 21: "SURFTRAK",
}  # fmt: skip

#: Parameters of a mission item, from 0, that are kept, by command (libraries/AP_Mission/AP_Mission.cpp).
KEPT = {16: (0,), 17: (2,), 21: (0,), 178: (0, 1, 2)}

#: m by which a height that is held may be off: it is cut to whole centimetres (AP_Mission.cpp).
CENTIMETRE = 0.0101

#: Parameters that say what is done without a link, a pilot or a dry hull (ArduSub/Parameters.cpp).
FAILSAFES = ("FS_GCS_ENABLE", "FS_GCS_TIMEOUT", "FS_PILOT_INPUT", "FS_PILOT_TIMEOUT", "FS_LEAK_ENABLE")

#: What it does without a ground station, by FS_GCS_ENABLE; with 0 and 1 it goes on (ArduSub/failsafe.cpp).
_ALONE = {2: "stops its motors, under water too,", 3: "holds its depth and drifts", 4: "surfaces"}

#: Parameters that are set so that it goes on or surfaces. Nobody steers: a pilot's silence means nothing.
LINK_LOSS = {
    "continue": {"FS_GCS_ENABLE": 0.0, "FS_PILOT_INPUT": 0.0},
    "surface": {"FS_GCS_ENABLE": 4.0, "FS_PILOT_INPUT": 0.0},
}


def mode_name(number: int) -> str:
    """Return what a mode is called."""
    return _MODES.get(number, f"number {number}")


def left_alone(values: Mapping[str, float]) -> str:
    """Return what is done when the link is lost, in words; empty where the mission goes on.

    Args:
        values: of the parameters `FAILSAFES`, those that are known.
    """
    action = values.get("FS_GCS_ENABLE")
    if action is None:
        return "what it does without a link is not known (FS_GCS_ENABLE was not answered)"
    if action not in _ALONE:
        return ""
    after = values.get("FS_GCS_TIMEOUT")
    when = "some time" if after is None else f"{after:g} s"
    return f"it {_ALONE[int(action)]} {when} after the last heartbeat (FS_GCS_ENABLE is {action:g})"


def warnings(values: Mapping[str, float]) -> list[str]:
    """Return lines on what else it does by itself, or leaves undone.

    Args:
        values: of the parameters `FAILSAFES`, those that are known.
    """
    found = []
    if values.get("FS_PILOT_INPUT") == 2:
        after = values.get("FS_PILOT_TIMEOUT", 3.0)
        found.append(
            f"it stops its motors {after:g} s after the last input of a pilot's console, if there was one "
            "(FS_PILOT_INPUT is 2)"
        )
    if values.get("FS_LEAK_ENABLE") in (0, 1):
        found.append(
            f"a leak does not bring it up by itself (FS_LEAK_ENABLE is {values['FS_LEAK_ENABLE']:g})"
        )
    return found
