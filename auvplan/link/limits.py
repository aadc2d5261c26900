"""How long is waited, how often is tried again, and what vehicles take longer than planned."""

import math
from dataclasses import dataclass, fields

from auvplan.errors import AuvplanError

#: s between two looks at most: obstacles are looked for within the next three minutes.
_SELDOM = 60.0


@dataclass(frozen=True)
class Limits:
    """Limits of an execution; each ends in another try or in a safe end.

    Attributes:
        reply: s of wall-clock time that an answer is waited for.
        attempts: times that a message is sent before the vehicle counts as lost.
        uploads: times that an upload is restarted.
        connect: s of wall-clock time that the vehicle is looked for.
        silence: s of wall-clock time without a message after which the link counts as lost.
        outdated: s of wall-clock time after an upload in which progress is taken to be of the plan before.
        look: s of mission time between two looks at the vehicle.
        late: s of mission time that the vehicle may be off its plan before the rest is re-planned.
        idle: s of mission time that a vehicle may have no plan under way before it is started again.
        stall: s of mission time without `moved` m of way after which the vehicle counts as stopped.
        moved: m.
        corridor: m that the vehicle may be off its track.
        astray: s of mission time off its track after which it counts as drifting.
        tries: times in a row that a stop, a drift or a hazard is answered before the mission is given up.
        overdue: s of mission time after the time available at which the mission is given up.
        ending: s of mission time that the end behaviour is watched.
        away: m from the mission's start that the vehicle may be when it is connected to.

    Raises:
        AuvplanError: a limit is not positive, or looks are too far apart to see what comes.
    """

    reply: float = 1.0
    attempts: int = 8
    uploads: int = 3
    connect: float = 30.0
    silence: float = 10.0
    outdated: float = 1.0
    look: float = 2.0
    late: float = 120.0
    idle: float = 10.0
    stall: float = 120.0
    moved: float = 5.0
    corridor: float = 50.0
    astray: float = 30.0
    tries: int = 3
    overdue: float = 600.0
    ending: float = 300.0
    away: float = 1000.0

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                raise AuvplanError(f"limit {field.name}: must be positive, got {value}")
        if self.look > _SELDOM:
            raise AuvplanError(f"limit look: must be at most {_SELDOM:g} s, got {self.look:g}")


@dataclass(frozen=True)
class Allowance:
    """What a vehicle's own control takes longer than its paths at constant speed.

    Attributes:
        start: s before the first leg.
        dive: m/s at which it dives to the start of that; infinite where this is within `start`.
        stop: s at the end of every leg, to come to rest and to get under way again.
        by_speed: s more for every m/s of its speed.
        task: s more at the end of a leg that has a task.
        circle: m that it circles off the place of a task.
    """

    start: float = 0.0
    dive: float = math.inf
    stop: float = 0.0
    by_speed: float = 0.0
    task: float = 0.0
    circle: float = 0.0

    def begins(self, depth: float) -> float:
        """Return s, when the first leg begins at a depth, m."""
        return self.start + depth / self.dive

    def ends(self, speed: float) -> float:
        """Return s that the end of a leg takes at a speed, m/s."""
        return self.stop + self.by_speed * speed
