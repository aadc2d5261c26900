"""IMC on loopback with a peer of imcpy's messages, through a link that loses packets."""

import time
from dataclasses import replace
from functools import partial

import pytest

from auvplan.errors import AuvplanError
from auvplan.export.imc import plan_specification
from auvplan.link import Limits, Refused, State, Upload, open_link

imcpy = pytest.importorskip("imcpy", reason="needs imcpy: pip install 'auvplan[link]'")

from auvplan.link.imc import as_message  # noqa: E402
from tests.export.sample import at_speeds, in_current, make_itinerary  # noqa: E402
from tests.link.conftest import FAST, SCALE  # noqa: E402
from tests.link.joining import CLEAN, Faults, body_at, followed, free_port, held_as_planned  # noqa: E402
from tests.link.peers import ImcPeer  # noqa: E402

LIMITS = Limits(reply=0.1, attempts=20, connect=5.0)


@pytest.fixture
def join(join_vehicle):
    return partial(join_vehicle, kind="imc", limits=LIMITS)


@pytest.fixture
def begun(join, upload):
    """Makes a link to a vehicle that was started with the upload."""

    def make(faults=CLEAN, stuck=False):
        link, peer, _ = join(faults)
        peer.body.stuck = stuck
        link.upload(upload)
        link.start()
        return link, peer

    return make


@pytest.fixture
def beside(opened):
    """Makes a vehicle at the first place of a plan, and a link to it without a proxy."""

    def make(plan, address="imc:{0.host}:{0.port}", scale=SCALE, stream=(0.0, 0.0), limits=LIMITS, **given):
        site, (north, east, depth) = plan.itinerary.site, plan.steps[0].position
        peer = ImcPeer(replace(body_at(site, north, east, depth), stream=stream), scale)
        opened.append(peer)
        opened.append(open_link(address.format(peer), site, limits, scale, **given))
        return opened[-1], peer

    return make


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


@pytest.mark.parametrize("faults", [pytest.param(CLEAN, marks=pytest.mark.slow), Faults()])
def test_a_plan_arrives_as_planned_and_is_executed(upload, join, faults):
    link, peer, _ = join(faults, scale=FAST)
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
    assert link.report(1.0).done == 3


@pytest.mark.slow
def test_a_leg_at_several_speeds_is_followed_part_by_part(join):
    link, peer, _ = join()
    plan = Upload(make_itinerary(over_ground=True))
    link.upload(plan)
    assert held_as_planned("imc", peer, plan)
    names = [move.maneuver_id for move in peer.stored[next(iter(peer.stored))].maneuvers]
    assert sum(name.startswith("leg1") for name in names) > 1
    link.start()
    seen, report = set(), link.report(1.0)
    begin = time.monotonic()
    while report.done < len(plan.steps) and time.monotonic() - begin < 20.0:
        seen.add(report.done)
        report = link.report(20.0)
    assert report.done == len(plan.steps)
    parts = {len(plan.steps) - 1 - int(name.split("_last")[1]) for name in names if "_last" in name}
    assert parts <= seen, "where a part begins the waypoints before it are passed"
    assert len(peer.tasks) == 1


@pytest.mark.slow
@pytest.mark.parametrize("make", [in_current, at_speeds])
def test_a_vehicle_that_sees_its_hull_over_ground_keeps_the_planned_times_in_a_current(beside, make):
    stream = (-0.2, 0.25, 0.0)
    plan = Upload(make(stream))
    link, _ = beside(plan, stream=stream[:2])
    link.connect()
    link.upload(plan)
    link.start()
    begin, report = link.now, link.report(1.0)
    while report.done < len(plan.steps) and link.now < 4000.0:
        report = link.report(5.0)
    planned = plan.steps[-1].time - plan.steps[0].time
    assert link.now - begin == pytest.approx(planned, rel=0.02)


def test_one_without_a_bottom_lock_is_given_the_speed_through_the_water(beside):
    plan = Upload(make_itinerary(over_ground=True))
    link, peer = beside(plan, over_ground=False)
    link.connect()
    link.upload(plan)
    (held,) = peer.stored.values()
    assert {round(float(move.data.speed), 4) for move in held.maneuvers} == {1.75}
    link.upload(Upload(replace(at_speeds((0.2, -0.1, 0.0)), name="at others")))
    (held,) = [plan for plan in peer.stored.values() if plan.plan_id.startswith("at_others")]
    speeds = {move.maneuver_id: round(float(move.data.speed), 4) for move in held.maneuvers}
    assert speeds == {"start": 0.9, "leg1": 0.9, "task1": 1.2, "leg2": 1.2, "leg3": 1.5, "end": 1.2}


def test_a_vehicle_that_refuses_is_told_of(upload, join):
    link, peer, _ = join()
    peer.refuse = True
    with pytest.raises(Refused, match="refuses the plan"):
        link.upload(upload)


class Tell:
    """Sends messages to the client of a peer, as a vehicle of some identifier."""

    def __init__(self, peer, source):
        self.peer, self.source = peer, source

    def __call__(self, message):
        message.src = self.source
        self.peer._socket.sendto(imcpy.Packet.serialize(message), self.peer.clients[0])


def test_another_vehicle_and_damaged_packets_change_nothing(begun):
    link, peer = begun()
    before, tell = link.report(1.0), Tell(peer, 0x77)
    for _ in range(10):
        elsewhere, other = imcpy.EstimatedState(), imcpy.PlanControl()
        elsewhere.lat = elsewhere.lon = 0.1
        other.type, other.op = other.TypeEnum.FAILURE, other.OperationEnum.START
        tell(elsewhere)
        tell(other)
        peer._socket.sendto(b"\x54\xfe" + bytes(40), peer.clients[0])
    time.sleep(0.1)
    after = link.report(0.0)
    assert max(abs(after.position - before.position)) < 1000.0
    assert after.state is State.EXECUTING


@pytest.mark.parametrize("latitude", [float("nan"), 4.0])
def test_a_place_that_is_none_is_left_out(join, latitude):
    link, peer, _ = join()
    state = imcpy.EstimatedState()
    state.lat = latitude
    Tell(peer, 0x1C)(state)
    time.sleep(0.05)
    assert link.report(0.0).position is not None


def test_odd_names_of_manoeuvres_and_plans_are_no_progress(begun):
    link, peer = begun(stuck=True)
    for plan, manoeuvre in ((peer.started[-1], "legs"), (peer.started[-1], "leg-1"), ("lawnmower", "end")):
        control = imcpy.PlanControlState()
        control.state, control.plan_id, control.man_id = control.StateEnum.EXECUTING, plan, manoeuvre
        control.set_timestamp_now()
        control.src = 0x1C
        link._take(control)
        assert link.report(0.0).done == 0
    report = link.report(0.0)
    assert report.state is State.STOPPED
    assert report.message == "another plan was started, lawnmower"


def test_a_vehicle_answers_where_a_run_announced_itself_and_the_next_run_is_heard_too(upload, beside, opened):
    first, peer = beside(upload, scale=1.0)
    opened.remove(first)
    first.connect()
    for clients in (2, 2):
        opened.append(open_link(f"imc:{peer.host}:{peer.port}", upload.itinerary.site, LIMITS))
        opened[-1].connect()
        assert len(set(peer.clients)) == clients
        first.close()
    assert len(peer.clients) == 2, "it is the same station, at the same port"
    assert all(0x4000 <= source < 0x6000 for source in peer._nodes), "a control station among IMC's addresses"


def test_a_local_port_is_ours_or_refused(upload, opened):
    peer, port = ImcPeer(body_at(upload.itinerary.site, 0.0, 0.0, 5.0), 1.0), free_port()
    address = f"imc:{peer.host}:{peer.port}?local={port}"
    opened += [open_link(address, upload.itinerary.site, LIMITS), peer]
    opened[0].connect()
    assert peer.clients == [("127.0.0.1", port)]
    with pytest.raises(AuvplanError, match="in use"):
        open_link(address, upload.itinerary.site, LIMITS)


def test_the_back_seat_takes_whoever_connects(upload, beside):
    link, peer = beside(upload, "imc:tcp:{0.host}:{0.back_seat}", FAST)
    link.connect()
    link.upload(upload)
    link.start()
    assert followed(link, len(upload.steps)).state is State.FINISHED
    assert not peer.clients


@pytest.mark.parametrize("how", ["abort", "stop"])
@pytest.mark.parametrize("faults", [CLEAN, Faults()])
def test_a_plan_that_anybody_ends_is_left_alone(upload, begun, how, faults):
    link, peer = begun(faults, stuck=True)
    link.start(1)  # which leaves a failure as the last outcome, and is none
    time.sleep(0.3)
    assert link.report(0.0).state is State.EXECUTING
    getattr(peer, how)()
    time.sleep(0.5)
    assert peer._plan is None
    report, started = link.report(0.0), list(peer.started)
    assert report.state is State.STOPPED
    assert ("got abort request from system" if how == "abort" else "it was stopped") in report.message
    for ask in (link.start, link.hold, lambda: link.upload(upload)):
        with pytest.raises(Refused, match="has left the plan"):
            ask()
    assert peer.started == started


@pytest.mark.parametrize("stopped_before", [False, True])
def test_a_fault_of_a_moment_is_reported_from_then_on(begun, stopped_before):
    link, peer = begun(stuck=True)
    time.sleep(0.3)
    if stopped_before:
        peer.stop()
        time.sleep(0.3)
    peer.fail("vehicle errors: Depth Sensor")
    time.sleep(0.6)
    assert peer._error < time.monotonic() - 0.2
    report = link.report(0.0)
    assert (report.state, report.message) == (State.FAULT, "vehicle errors: Depth Sensor")


def test_an_abort_that_comes_with_the_start_of_the_next_plan_is_repeated(begun):
    link, peer = begun(stuck=True)
    takes = peer._request

    def abort_before_it_starts(message):
        if isinstance(message, imcpy.PlanControl):
            peer.abort()
            time.sleep(0.3)
        takes(message)

    peer._request = abort_before_it_starts
    with pytest.raises(Refused, match="has left the plan: got abort"):
        link.start()
    time.sleep(0.2)
    assert peer._plan is None
    assert link.report(0.0).state in (State.STOPPED, State.SURFACING)


@pytest.mark.parametrize("how", ["halt", "restart"])
def test_a_vehicle_that_started_anew_is_idle_and_may_still_be_aborted(begun, how):
    link, peer = begun()
    getattr(peer, how)()
    time.sleep(0.2)
    assert link.report(0.0).state is State.IDLE
    peer._words, peer._worded = "got abort request from system ccu", time.time()
    time.sleep(0.2)
    report = link.report(0.0)
    assert (report.state, report.message) == (State.STOPPED, peer._words)


def test_an_outcome_of_the_run_before_is_none_of_this_one(upload, begun, opened):
    link, peer = begun()
    peer.abort()
    link.close()
    peer.through = None
    opened.append(open_link(f"imc:{peer.host}:{peer.port}", upload.itinerary.site, LIMITS, SCALE))
    again = opened[-1]
    again.connect()
    again.upload(upload)
    again.start()
    again.report(50.0)
    assert again.report(50.0).state in (State.EXECUTING, State.FINISHED)


def test_a_vehicle_that_is_not_ready_is_waited_for(upload, beside):
    link, peer = beside(upload, scale=1.0, limits=Limits(connect=1.0))
    peer._error, peer._words = time.monotonic() + 1.6, "vehicle errors: GPS"
    time.sleep(0.3)  # it may have said before that it is ready
    with pytest.raises(Refused, match="was not ready for a plan within 1 s: vehicle errors: GPS"):
        link.connect()
    link.connect()
