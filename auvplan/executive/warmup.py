"""Compiles what missions will need while the first of them is begun."""

import logging
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from threading import Thread

from auvplan.executive.clock import Clock
from auvplan.executive.context import Mission, MissionContext
from auvplan.executive.legs import advance, begin_legs
from auvplan.executive.path_calls import plan_legs
from auvplan.records import LegRecord
from auvplan.runtime import cache, cores
from auvplan.runtime.compiled import compiling_ahead

log = logging.getLogger(__name__)

#: Scenarios, JSON.
_warmed_up: set[str] = set()


def warm_up(context: MissionContext, start_mission: Callable[[MissionContext], Mission]) -> None:
    """Let a mission that nobody waits for begin a leg, in a thread of its own, where a core is free for that.

    Args:
        context: what it shares with the missions to come. A scenario is begun so once, in one process.
        start_mission: makes the mission, given what it shares with others.
    """
    if cores.count() == 1 or not cache.enabled():
        return
    scenario = context.scenario.fingerprint
    if scenario in _warmed_up:
        return
    _warmed_up.add(scenario)
    mark = cache.key_of(__name__, scenario, repr(context.simulated))
    if cache.holds(__name__, mark):  # what this would compile is on disk
        return
    cache.store(__name__, mark, True)
    own = replace(context, clock=Clock())
    Thread(target=begin_a_leg, args=(partial(start_mission, own),), daemon=True).start()


def begin_a_leg(start_mission: Callable[[], Mission]) -> None:
    """Plan and simulate the beginning of a leg with zeros for results, which compiles what it needs."""
    try:
        mission = start_mission()
        start = mission.here
        goal = int(mission.graph.adjacency[start].argmax())
        with compiling_ahead():
            begin_legs([mission], [LegRecord(start, goal, 0.0, 0.0, 0.0)])
            plan_legs([mission], "window")
            advance([mission])
    except Exception as error:  # what is wrong shows where it matters
        log.info("programs are not compiled side by side: %s", error)
