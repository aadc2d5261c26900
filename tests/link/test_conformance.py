"""The suite that every link has to pass, on all of ours, and on some that do not."""

import time
from dataclasses import replace

import numpy as np
import pytest

from auvplan.link import Limits, Lost, Refused, State, Upload, open_link
from auvplan.link.conformance import failures
from auvplan.link.simulated import SimulatedVehicle
from tests.executive.small import scenario
from tests.export.sample import make_itinerary
from tests.link.joining import free_port
from tests.link.scripted import Fails, ScriptedVehicle

LIMITS = Limits(reply=0.2, connect=5.0)


def scripted(**script):
    plan = Upload(make_itinerary())
    return ScriptedVehicle(plan.steps[0].position, **script), plan


def test_the_simulator_conforms():
    vehicle, plan = SimulatedVehicle(scenario(), 1), Upload(make_itinerary())
    vehicle._place = plan.steps[0].position
    assert failures(vehicle, plan) == []


@pytest.mark.parametrize("kind", ["imc", "mavlink"])
def test_links_conform(kind, upload, join_vehicle):
    pytest.importorskip("imcpy" if kind == "imc" else "mavsdk")
    link, peer, _ = join_vehicle(kind=kind, limits=LIMITS)
    link.connect = list  # it was connected to before
    assert failures(link, upload) == []
    time.sleep(0.3)
    assert peer.body.depth < 1.0


@pytest.mark.parametrize("kind", ["imc", "mavlink"])
def test_a_dead_link_ends_in_time(kind, upload, join_vehicle):
    pytest.importorskip("imcpy" if kind == "imc" else "mavsdk")
    link, _, proxy = join_vehicle(kind=kind, limits=Limits(reply=0.05, attempts=4, uploads=2, connect=5.0))
    link.upload(upload)
    proxy.dead = True
    begin = time.monotonic()
    for call in (link.start, lambda: link.upload(Upload(upload.itinerary, 2)), link.surface):
        with pytest.raises(Lost):
            call()
    assert time.monotonic() - begin < 10.0


@pytest.mark.parametrize(
    ("address", "library", "words"),
    [
        ("imc:127.0.0.1:9", "imcpy", "no EstimatedState within"),
        ("mavlink:udpin:127.0.0.1:", "pymavlink", "no heartbeat within"),
    ],
)
def test_nobody_there(address, library, words, upload, opened):
    pytest.importorskip(library)
    address += str(free_port()) if address.endswith(":") else ""
    opened.append(open_link(address, upload.itinerary.site, Limits(connect=0.3)))
    with pytest.raises(Lost, match=words):
        opened[0].connect()


def test_a_scripted_vehicle_conforms_and_is_let_go():
    vehicle, plan = scripted()
    assert failures(vehicle, plan) == []
    assert vehicle.closed


@pytest.mark.parametrize(
    ("script", "wrong"),
    [
        ({"fails": Fails("connect", Refused("not now"))}, "connects: Refused: not now"),
        ({"fails": Fails("upload", Refused("not now"))}, "takes a plan: Refused: not now"),
        ({"fails": Fails("start", Refused("not now"))}, "takes a plan: Refused: not now"),
        ({"fails": Fails("hold", Refused("not now"))}, "holds: Refused: not now"),
        ({"fails": Fails("surface", Refused("not now"))}, "surfaces: Refused: not now"),
        ({"stuck": (0.0, np.inf)}, "follows: 0 steps are done after"),
        ({"stopped": 1.0}, "holds: it is no longer on its plan after 120 s"),
        ({"now": 3.0}, "connects: mission time is 3 s before the start"),
        ({"notes": [3]}, "connects: notes are not text"),
        ({"silent": (0.0, 1e9)}, "connects: Lost"),
    ],
)
def test_what_does_not_conform_is_named(script, wrong):
    vehicle, plan = scripted(**script)
    (found,) = failures(vehicle, plan)[:1]
    assert found.startswith(wrong)
    assert vehicle.closed


def keeps_no_place(vehicle, report):
    return (
        replace(report, position=report.position + vehicle.now) if report.state is State.HOLDING else report
    )


@pytest.mark.parametrize(
    ("odd", "wrong"),
    [
        (lambda _, report: replace(report, position=None), "connects: its place is not known"),
        (lambda _, report: replace(report, state=State.EXECUTING), "connects: it executes a plan"),
        (lambda _, report: replace(report, done=report.done + 1), "takes a plan: 1 steps are done before"),
        (
            lambda link, report: replace(report, done=len(link.uploads)),
            "takes a plan: 1 steps are done before",
        ),
        (keeps_no_place, "holds: 104 m away 60 s later"),
        (
            lambda link, report: replace(report, done=0) if len(link.uploads) > 1 else report,
            "goes on: 0 steps are done once another plan is uploaded",
        ),
    ],
)
def test_reports_that_do_not_conform_are_named(odd, wrong):
    vehicle, plan = scripted(odd=odd)
    (found,) = failures(vehicle, plan)[:1]
    assert found.startswith(wrong)
