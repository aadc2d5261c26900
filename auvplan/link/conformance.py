"""What the executor relies on of a link, tried on a vehicle: for links of one's own.

Example:
    >>> from auvplan.link.conformance import failures
    >>> failures(my_link, upload)  # doctest: +SKIP
    ['holds: 55 m away 60 s later']
"""

from collections.abc import Iterator

import numpy as np

from auvplan.link.vehicle import LinkError, State, Upload, VehicleLink

#: s of mission time after which a vehicle does what it was asked to, and between two looks.
_SOON, _LOOK = 120.0, 5.0

#: s of mission time for which it is looked at while it holds; m by which it may move meanwhile.
_STAYS, _ROUND = 60.0, 30.0

#: Factor on the planned times of a plan after which a step of it counts as not reached.
_SLOW = 3.0


def failures(link: VehicleLink, plan: Upload) -> list[str]:
    """Take a vehicle through all that a link is asked for, and say where it does not keep to `VehicleLink`.

    The vehicle connects, goes to the plan's first steps, holds, is given the rest, goes on and surfaces. What
    follows on a failure is not tried.

    Args:
        link: to a vehicle at the beginning of the plan that does nothing; it is closed at the end.
        plan: of two steps or more.

    Returns:
        One line each, beginning with what was asked; empty where all is well.
    """
    found: list[str] = []
    try:
        for stage in (_connects, _takes_a_plan, _follows, _holds, _goes_on, _surfaces):
            asked = stage.__name__.strip("_").replace("_", " ")
            try:
                found += [f"{asked}: {why}" for why in stage(link, plan)]
            except LinkError as error:
                found.append(f"{asked}: {type(error).__name__}: {error}")
            if found:
                break
    finally:
        link.close()
    return found


def _connects(link: VehicleLink, plan: Upload) -> Iterator[str]:
    if not all(isinstance(note, str) for note in link.connect()):
        yield "notes are not text"
    report = link.report(0.0)
    if report.position is None:
        yield "its place is not known"
    if report.state is State.EXECUTING:
        yield "it executes a plan"
    if link.now != 0.0:
        yield f"mission time is {link.now:g} s before the start"


def _takes_a_plan(link: VehicleLink, plan: Upload) -> Iterator[str]:
    link.upload(plan)
    report = link.report(0.0)
    if report.state is State.EXECUTING:
        yield "an upload starts it"
    if report.done:
        yield f"{report.done} steps are done before the start"
    link.start()
    yield from _comes_to(link, State.EXECUTING)


def _follows(link: VehicleLink, plan: Upload) -> Iterator[str]:
    before, begin = link.report(0.0), link.now
    link.report(_LOOK)
    if link.now < begin + 0.9 * _LOOK:
        yield f"waiting for {_LOOK:g} s takes {link.now - begin:g} s of mission time"
    lasts = _SLOW * (plan.steps[-1].time - plan.steps[0].time) + _SOON
    first = next(number for number, step in enumerate(plan.steps, 1) if step.ends_leg or not link.by_legs)
    least = min(first, len(plan.steps) - 1)
    while before.done < least and link.now < begin + lasts:
        report = link.report(_LOOK)
        if report.done < before.done:
            yield f"{report.done} steps are done after {before.done} were"
        before = report
    if before.done < least:
        yield f"{before.done} steps are done after {lasts:.0f} s"
    if before.done > len(plan.steps):
        yield f"{before.done} steps are done of {len(plan.steps)}"


def _holds(link: VehicleLink, plan: Upload) -> Iterator[str]:
    link.hold()
    yield from _comes_to(link, State.HOLDING)
    link.report(_STAYS)
    places = [link.report(seconds).position for seconds in (0.0, _STAYS)]
    if places[0] is None or places[1] is None:
        yield "its place is not known"
    elif (away := float(np.linalg.norm(places[1] - places[0]))) > _ROUND:
        yield f"{away:.0f} m away {_STAYS:g} s later"


def _goes_on(link: VehicleLink, plan: Upload) -> Iterator[str]:
    done = link.report(0.0).done
    rest = plan.without(min(done, len(plan.steps) - 1))
    link.upload(rest)
    if (now := link.report(0.0).done) != done:
        yield f"{now} steps are done once another plan is uploaded, {done} were: it is not started yet"
    link.start()
    yield from _comes_to(link, State.EXECUTING)
    if (now := link.report(0.0).done) >= len(rest.steps):
        yield f"{now} of {len(rest.steps)} steps are done just after the start"


def _surfaces(link: VehicleLink, plan: Upload) -> Iterator[str]:
    link.surface()
    yield from _comes_to(link, State.SURFACING, 10.0 * _SOON, top=1.0)


def _comes_to(link: VehicleLink, state: State, seconds: float = _SOON, top: float = -np.inf) -> Iterator[str]:
    """Look at a vehicle until it is in a state, or less deep than `top`, m; say where it is in another."""
    begin, report = link.now, link.report(0.0)
    while report.state is not state and (report.position is None or report.position[2] >= top):
        if link.now > begin + seconds:
            yield f"it is {report.state.value} after {seconds:g} s"
            return
        report = link.report(_LOOK)
