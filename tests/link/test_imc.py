"""IMC on loopback with a peer of imcpy's messages, through a link that loses packets."""

import time
from functools import partial

import pytest

from auvplan.export.imc import plan_specification
from auvplan.link import Limits, Lost, Refused, State, open_link

imcpy = pytest.importorskip("imcpy", reason="needs imcpy: pip install 'auvplan[link]'")

from auvplan.link.imc import as_message  # noqa: E402
from tests.link.held import held_as_planned  # noqa: E402
from tests.link.joining import followed  # noqa: E402
from tests.link.proxy import CLEAN, Faults  # noqa: E402

LIMITS = Limits(reply=0.1, attempts=20, connect=5.0)


@pytest.fixture
def join(join_vehicle):
    return partial(join_vehicle, kind="imc", limits=LIMITS)


def test_a_plan_file_is_the_message_that_imcpy_makes(upload):
    plan = as_message(plan_specification(upload.itinerary))
    again = imcpy.Packet.deserialize(imcpy.Packet.serialize(plan))
    assert again.serialize_fields() == plan.serialize_fields()
    assert [type(step.data).__name__ for step in again.maneuvers] == [
        "Goto", "FollowPath", "Loiter", "Goto", "StationKeeping",
    ]  # fmt: skip
    (path,) = (step.data for step in again.maneuvers if step.maneuver_id == "leg1")
    first, _ = upload.itinerary.legs
    assert len(list(path.points)) == len(first.kept)
    assert path.speed == pytest.approx(1.75)
    assert [move.dest_man for move in again.transitions] == ["leg1", "task1", "leg2", "end"]


@pytest.mark.parametrize("faults", [CLEAN, Faults()])
def test_a_plan_arrives_as_planned_and_is_executed(upload, join, faults):
    link, peer, _ = join(faults)
    assert link.upload(upload) == []
    assert held_as_planned("imc", peer, upload)
    link.start()
    report = followed(link, len(upload.steps))
    assert report.state is State.FINISHED
    assert len(peer.tasks) == len(peer.started) == 1


def test_a_later_step_is_a_shorter_plan(upload, join):
    link, peer, _ = join()
    link.upload(upload)
    link.start(3)
    assert len(peer.stored) == 2
    assert link.wait(1.0).done == 3


def test_hold_and_surface(upload, join):
    link, peer, _ = join()
    link.upload(upload)
    link.start()
    link.wait(100.0)
    link.hold()
    link.wait(20.0)
    place = link.wait(20.0).position
    assert link.wait(60.0).position == pytest.approx(place, abs=0.1)
    link.abort()
    assert link.wait(100.0).state is State.SURFACING
    assert peer.body.depth == 0.0


def test_a_vehicle_that_refuses_is_told_of(upload, join):
    link, peer, _ = join()
    peer.refuse = True
    with pytest.raises(Refused, match="refuses the plan"):
        link.upload(upload)


def test_a_dead_link_ends_in_time(upload, join):
    link, _, proxy = join()
    link.upload(upload)
    proxy.dead = True
    begin = time.monotonic()
    with pytest.raises(Lost, match="no answer to the start"):
        link.start()
    assert time.monotonic() - begin < 10.0


def test_nobody_there(upload):
    link = open_link("imc:127.0.0.1:9", upload.itinerary.site, Limits(connect=0.3))
    with pytest.raises(Lost, match="no EstimatedState within"):
        link.connect()
    link.close()


class Tell:
    """Sends messages to the client of a peer, as a vehicle of some identifier."""

    def __init__(self, peer, source):
        self.peer, self.source = peer, source

    def __call__(self, message):
        message.src, message.dst = self.source, 0x4001
        self.peer._socket.sendto(imcpy.Packet.serialize(message), self.peer._client)


def test_another_vehicle_and_damaged_packets_change_nothing(upload, join):
    link, peer, _ = join()
    link.upload(upload)
    link.start()
    before, tell = link.wait(1.0), Tell(peer, 0x77)
    for _ in range(10):
        elsewhere, other = imcpy.EstimatedState(), imcpy.PlanControl()
        elsewhere.lat = elsewhere.lon = 0.1
        other.type, other.op = other.TypeEnum.FAILURE, other.OperationEnum.START
        tell(elsewhere)
        tell(other)
        peer._socket.sendto(b"\x54\xfe" + bytes(40), peer._client)
    time.sleep(0.1)
    after = link.wait(0.0)
    assert max(abs(after.position - before.position)) < 1000.0
    assert after.state is State.EXECUTING


@pytest.mark.parametrize("latitude", [float("nan"), 4.0])
def test_a_place_that_is_none_is_left_out(upload, join, latitude):
    link, peer, _ = join()
    state = imcpy.EstimatedState()
    state.lat = latitude
    Tell(peer, 0x1C)(state)
    time.sleep(0.05)
    assert link.wait(0.0).position is not None


def test_odd_names_of_manoeuvres_and_plans_are_no_progress(upload, join):
    link, peer, _ = join()
    peer.body.stuck = True
    link.upload(upload)
    link.start()
    for plan, manoeuvre in ((peer.started[-1], "legs"), (peer.started[-1], "leg-1"), ("lawnmower", "end")):
        control = imcpy.PlanControlState()
        control.state, control.plan_id, control.man_id = control.StateEnum.EXECUTING, plan, manoeuvre
        link._take(_from(control))
        assert link.wait(0.0).done == 0
    link._take(_from(control))
    assert link._state() is State.IDLE, "it executes somebody else's plan"


def _from(message):
    message.src, message.dst = 0x1C, 0x4001
    return message
