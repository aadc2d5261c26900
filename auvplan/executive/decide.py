"""What is done next on a mission: one table of rules for simulated missions and for vehicles at sea.

`decide` sees facts alone: it looks at no clock, calls no planner and asks no vehicle. Its caller gathers the
facts, does what was decided, and asks again until nothing is left to do before the next look.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


class Phase(Enum):
    """What a mission's vehicle is asked to do at present."""

    READY = "ready"
    UNDER_WAY = "under way"
    HELD = "held"
    ARRIVED = "arrived"
    SURFACING = "surfacing"
    LEFT = "left alone"


class Act(Enum):
    """What may be decided."""

    GO_ON = "go on until the next look"
    ARRIVE = "see the end behaviour through"
    LEAVE = "leave the vehicle to whoever took it"
    SURFACE = "have it surface"
    START = "start the plan that was uploaded"
    HOLD = "hold it where it is"
    GIVE_WAY = "keep station, or escape"
    RESTART = "upload what it should have again, and start it"
    REPLAN_LEG = "plan from where it is"
    REPLAN_REST = "plan what comes after the present leg"
    DROP = "drop a plan that came too late"
    UPLOAD = "upload the plan that waits"


class Waiting(Enum):
    """What there is of a plan that is to replace the one in hand."""

    NONE = "none"
    MADE = "made"
    UPLOADED = "uploaded"


@dataclass(frozen=True)
class Facts:
    """What is known of a mission; as it stands, nothing is wrong and nothing is due.

    Reasons are words for people, empty where the fact is none.

    Attributes:
        phase: READY, UNDER_WAY or HELD; one that gives way is HELD.
        arrived: whether all legs are done.
        taken: how somebody else ended the mission.
        given_up: why the vehicle, or its own executor, cannot go on.
        overdue: that the time is over.
        heard: whether vehicle and place are heard of.
        idle: whether the vehicle has no plan.
        stuck: that it makes no way.
        astray: that it is off its track.
        hazard: that an obstacle is in the way of its present leg.
        approached: that an obstacle comes to where it stays, at a task or held.
        turns: why it is to leave its present leg, whose end is too late, for a way that is in time.
        due: why the rest is to be re-planned.
        window: whether its path is due to be looked at again.
        waiting: of a plan that is to replace the one in hand.
        missed: that this plan cannot be begun any more.
        busy: whether a task is under way or near, so that no plan is handed over.
        resting: whether something failed a moment ago, and is tried again later.
        uploads: whether paths are handed over to a vehicle, which is held meanwhile; one that is simulated
            here follows them at once.
        planner: whether there is a planner that has not tried yet.
    """

    phase: Phase = Phase.UNDER_WAY
    arrived: bool = False
    taken: str = ""
    given_up: str = ""
    overdue: str = ""
    heard: bool = True
    idle: bool = False
    stuck: str = ""
    astray: str = ""
    hazard: str = ""
    approached: str = ""
    turns: str = ""
    due: str = ""
    window: bool = False
    waiting: Waiting = Waiting.NONE
    missed: str = ""
    busy: bool = False
    resting: bool = False
    uploads: bool = True
    planner: bool = True

    @property
    def held(self) -> bool:
        """Whether it waits for a plan."""
        return self.phase is Phase.HELD


@dataclass(frozen=True)
class Rule:
    """What is done where something is so.

    Attributes:
        name: of it, a word or two.
        where: it applies, in words.
        act: what is done.
        applies: returns why, in words, or whether it applies.
    """

    name: str
    where: str
    act: Act
    applies: Callable[[Facts], str | bool]


@dataclass(frozen=True)
class Decision:
    """What is to be done, by which rule, and why, in words or empty."""

    act: Act
    rule: str
    why: str = ""


#: The first that applies decides.
RULES = (
    Rule("arrived", "all legs are done", Act.ARRIVE, lambda f: f.arrived),
    Rule("taken", "somebody else has stopped or replaced the plan", Act.LEAVE, lambda f: f.taken),
    Rule(
        "given up",
        "it is in a state of fault, surfaces by itself, or was answered too often",
        Act.SURFACE,
        lambda f: f.given_up,
    ),
    Rule("overdue", "the time available has been over for long", Act.SURFACE, lambda f: f.overdue),
    Rule(
        "past",
        "a plan is uploaded, and the vehicle past its first leg",
        Act.HOLD,
        lambda f: f.waiting is Waiting.UPLOADED and f.missed,
    ),
    Rule("uploaded", "a plan is uploaded", Act.START, lambda f: f.waiting is Waiting.UPLOADED),
    Rule(
        "look",
        "simulated: an obstacle ahead, a window of the path, or no way on",
        Act.REPLAN_LEG,
        lambda f: not f.uploads and f.planner and (f.hazard or f.held or f.window),
    ),
    Rule(
        "no way",
        "simulated: no plan clears what is ahead",
        Act.GIVE_WAY,
        lambda f: not f.uploads and (f.hazard or f.held),
    ),
    Rule("not heard", "the vehicle or its place is not heard of", Act.GO_ON, lambda f: not f.heard),
    Rule(
        "approached",
        "an obstacle comes to where it stays, and no plan waits that leads on from there",
        Act.GIVE_WAY,
        lambda f: f.approached if not f.held or f.waiting is Waiting.NONE else "",
    ),
    Rule("stopped", "no way is made", Act.RESTART, lambda f: not f.held and f.stuck),
    Rule("no plan", "it has no plan, for a moment", Act.GO_ON, lambda f: not f.held and f.idle),
    Rule("resting", "something failed a moment ago", Act.GO_ON, lambda f: f.resting),
    Rule(
        "late plan",
        "a plan waits whose beginning is missed",
        Act.DROP,
        lambda f: f.waiting is Waiting.MADE and f.missed,
    ),
    Rule("drift", "it is off its track for long", Act.HOLD, lambda f: not f.held and f.astray),
    Rule("hazard", "an obstacle is on its track", Act.HOLD, lambda f: not f.held and f.hazard),
    Rule(
        "plan",
        "a plan waits, and it is held or no task is near",
        Act.UPLOAD,
        lambda f: f.waiting is Waiting.MADE and (f.held or not f.busy),
    ),
    Rule("held", "it is held", Act.REPLAN_LEG, lambda f: f.held and f.due),
    Rule(
        "leave leg",
        "what comes after its leg cannot be in time, and leaving the leg can",
        Act.HOLD,
        lambda f: not f.held and not f.busy and f.turns,
    ),
    Rule(
        "due",
        "late, early, a current or an obstacle of a later leg reported",
        Act.REPLAN_REST,
        lambda f: f.waiting is Waiting.NONE and f.due,
    ),
)

#: Phases that acts lead to when they are done, from those in which they may be.
NEXT: dict[tuple[Phase, Act], Phase] = {
    (Phase.READY, Act.START): Phase.UNDER_WAY,
    (Phase.UNDER_WAY, Act.HOLD): Phase.HELD,
    (Phase.UNDER_WAY, Act.GIVE_WAY): Phase.HELD,
    (Phase.HELD, Act.START): Phase.UNDER_WAY,
}
for _phase in (Phase.UNDER_WAY, Phase.HELD):
    NEXT[_phase, Act.ARRIVE], NEXT[_phase, Act.SURFACE] = Phase.ARRIVED, Phase.SURFACING
    NEXT[_phase, Act.LEAVE] = Phase.LEFT


def decide(facts: Facts) -> Decision:
    """Decide what is done next."""
    for rule in RULES:
        if why := rule.applies(facts):
            return Decision(rule.act, rule.name, why if isinstance(why, str) else "")
    return Decision(Act.GO_ON, "nothing")


def after(phase: Phase, act: Act) -> Phase:
    """Return the phase that an act leads to; most lead to none but the present one."""
    return NEXT.get((phase, act), phase)
