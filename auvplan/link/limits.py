"""How long is waited, and how often is tried again."""

from dataclasses import dataclass, fields

from auvplan.errors import AuvplanError


@dataclass(frozen=True)
class Limits:
    """Limits of an execution; each ends in another try or in a safe end.

    Attributes:
        reply: s of wall-clock time that an answer is waited for.
        attempts: times that a message is sent before the vehicle counts as lost.
        uploads: times that an upload is begun anew.
        connect: s of wall-clock time that the vehicle is looked for.
        silence: s of wall-clock time without a message after which the link counts as lost.
        outdated: s of wall-clock time after an upload in which progress is taken to be of the plan before.
        look: s of mission time between two looks at the vehicle.
        late: s of mission time that the vehicle may be off its plan before the rest is planned anew.
        idle: s of mission time that a vehicle may have no plan under way before it is started again.
        stall: s of mission time without `moved` m of way after which the vehicle counts as stopped.
        moved: m.
        corridor: m that the vehicle may be off its track.
        astray: s of mission time off its track after which it counts as drifting.
        tries: times in a row that a stop, a drift or a hazard is answered before the mission is aborted.
        overdue: s of mission time after the time available at which the mission is given up.
        ending: s of mission time that the end behaviour is watched.
        away: m from the mission's start that the vehicle may be when it is connected to.

    Raises:
        AuvplanError: a limit is not positive.
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
