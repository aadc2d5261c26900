"""Compiles what missions will need while the first of them is begun."""

import logging
from collections.abc import Callable
from dataclasses import replace
from threading import Thread

from auvplan import cache, cores
from auvplan.compiled import compiling_ahead
from auvplan.records import LegRecord
from auvplan.voyage.clock import Clock
from auvplan.voyage.context import Mission, SimulationContext
from auvplan.voyage.legs import begin_legs, sail_on
from auvplan.voyage.path_calls import plan_legs

log = logging.getLogger(__name__)

#: Scenarios, JSON.
_warmed_up: set[str] = set()


def warm_up(context: SimulationContext, embark: Callable[[], Mission]) -> None:
    """Let a mission that nobody waits for begin a leg, in a thread of its own, where a core is free for that.

    Args:
        context: what it shares with those that are to be sailed. A scenario is begun so once, in one process.
        embark: makes the mission.
    """
    if cores.count() == 1 or not cache.enabled():
        return
    scenario = context.scenario.model_dump_json()
    if scenario in _warmed_up:
        return
    _warmed_up.add(scenario)
    mark = cache.key_of(__name__, scenario, repr(context.simulated))
    if cache.holds(__name__, mark):  # what this would compile is on disk
        return
    cache.store(__name__, mark, True)
    Thread(target=_begin_a_leg, args=(replace(context, clock=Clock()), embark), daemon=True).start()


def _begin_a_leg(context: SimulationContext, embark: Callable[[], Mission]) -> None:
    try:
        mission = embark()
        start = mission.here
        goal = int(mission.graph.adjacency[start].argmax())
        with compiling_ahead():
            begin_legs(context, [mission], [LegRecord(start, goal, 0.0, 0.0, 0.0)])
            plan_legs(context, [mission], ["window"])
            sail_on(context, [mission])
    except Exception as error:  # what is wrong shows where it matters
        log.info("programs are not compiled side by side: %s", error)
