"""MAVLink vehicles that misbehave, by a peer of pymavlink alone: calls end, with words, within limits."""

import time
from dataclasses import replace

import numpy as np
import pytest

from auvplan.link import Limits, LinkError, Lost, Refused, Upload, open_link
from tests.link.joining import free_port
from tests.link.mavlink_peer import Stranger, place_of

LIMITS = Limits(reply=0.15, attempts=5, uploads=2, connect=4.0, silence=1.0, outdated=0.1)


@pytest.fixture
def meet(upload, opened):
    """Makes a link and a stranger of a class."""

    def make(kind=Stranger, place=None, limits=LIMITS):
        port = free_port()
        link = open_link(f"mavlink:udpin:127.0.0.1:{port}", upload.itinerary.site, limits)
        opened.append(link)
        opened.append(kind(f"udpout:127.0.0.1:{port}", place or place_of(upload)))
        return link, opened[-1], port

    return make


class AsksBeyond(Stranger):
    def often(self, mav):
        for kind in (0, 1):
            self.ask(mav, 7000, kind)

    def mission_item_int(self, mav, message):
        pass


class AsksInTurn(Stranger):
    def mission_item_int(self, mav, message):
        self.ask(mav, 1 - message.seq, message.mission_type)


class AcknowledgesAlways(Stranger):
    def often(self, mav):
        for kind in (0, 1):
            mav.mission_ack_send(255, 190, 0, kind)

    def mission_count(self, mav, message):
        pass


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        pytest.param(AsksBeyond, "the fence broke off: 1 of 8 items were asked for", marks=pytest.mark.slow),
        pytest.param(AsksInTurn, "the fence broke off: 2 of 8 items were asked for", marks=pytest.mark.slow),
        (AcknowledgesAlways, "the fence broke off: nothing was asked for"),
    ],
)
def test_an_upload_that_gets_nowhere_ends(upload, meet, kind, words):
    link, *_ = meet(kind)
    link.connect()
    begin = time.monotonic()
    with pytest.raises(Lost, match=words):
        link.upload(upload)
    assert time.monotonic() - begin < 8.0


class OtherDepths(Stranger):
    def mission_item_int(self, mav, message):
        message.z -= 1.0
        super().mission_item_int(mav, message)


class AsksBackwards(Stranger):
    def ask(self, mav, number, kind):
        _, count, items = self.coming
        super().ask(mav, max(set(range(count)) - set(items)), kind)


class DisturbedByOthers(Stranger):
    """Refuses what another ground station sends, which is no answer to ours."""

    def mission_count(self, mav, message):
        for _ in range(3):
            mav.mission_ack_send(252, 1, 4, message.mission_type)
        super().mission_count(mav, message)


def test_what_a_vehicle_holds_otherwise_is_told_of(upload, meet):
    link, *_ = meet(OtherDepths)
    link.connect()
    with pytest.raises(Lost, match="holds another fence than was sent: 8 items, 0 of 8 as planned"):
        link.upload(upload)


@pytest.mark.parametrize("kind", [AsksBackwards, DisturbedByOthers])
def test_unusual_transfers_arrive(upload, meet, kind):
    link, peer, _ = meet(kind)
    link.connect()
    assert link.upload(upload) == []
    assert [len(peer.held[kind]) for kind in (0, 1)] == [7, 8]


def test_plan_and_fence_are_sent_again_to_a_vehicle_that_started_anew_and_taken_away_with_their_cause(
    upload, meet
):
    link, peer, _ = meet()
    link.connect()
    link.upload(upload)
    link.start()
    peer.held, peer.armed, peer.state = {0: [], 1: []}, False, 0
    time.sleep(1.0)  # until its other thread has said so
    link.upload(upload)
    link.start(1)
    assert [len(peer.held[kind]) for kind in (0, 1)] == [7, 8]
    assert peer.armed
    link.upload(Upload(replace(upload.itinerary, fences=()), 2))
    assert peer.held[1] == []


def test_two_vehicles_on_a_link_are_refused(upload, meet, opened):
    link, _, port = meet()
    opened.append(Stranger(f"udpout:127.0.0.1:{port}", place_of(upload), system=2))
    with pytest.raises(Refused, match="systems 1, 2 are on this link"):
        link.connect()


@pytest.mark.parametrize("place", [(0.0, 0.0), (210.0, 0.0)])
def test_a_place_that_is_none_is_no_place(meet, place):
    link, *_ = meet(place=place, limits=replace(LIMITS, connect=0.6))
    with pytest.raises(Lost, match="no GLOBAL_POSITION_INT"):
        link.connect()


@pytest.mark.slow
def test_a_place_that_is_not_told_any_more_is_not_known(meet):
    link, peer, _ = meet()
    link.connect()
    assert link.report(0.1).position is not None
    peer.located = False
    time.sleep(1.5)
    report = link.report(0.1)
    assert report.position is None
    assert report.heard < 1.0


class NotNow(Stranger):
    def command_long(self, mav, message):
        mav.statustext_send(3, b"PreArm:\x1b[31m\nno depth\xff")
        mav.command_ack_send(message.command, self.result)


@pytest.mark.parametrize(("result", "error"), [(1, Lost), (4, Refused)])
def test_refused_commands_have_the_vehicles_own_words(upload, meet, result, error):
    link, peer, _ = meet(NotNow)
    peer.result = result
    link.connect()
    link.upload(upload)
    begin = time.monotonic()
    with pytest.raises(error, match=r"PreArm:.*no depth") as told:
        link.start()
    assert str(told.value).isprintable()
    assert result != 1 or time.monotonic() - begin > 4 * LIMITS.reply


def test_damaged_packets_are_left_out(upload, meet):
    link, peer, port = meet()
    link.connect()
    draw = np.random.default_rng(0)
    for k in range(500):
        peer.port.port.sendto(b"\xfd" * (k % 2) + draw.bytes(1 + k % 300), ("127.0.0.1", port))
    link.upload(upload)
    assert len(peer.held[0]) == 7


def test_a_tcp_connection_is_made_again_and_prints_nothing(upload, opened, capfd):
    port = free_port()
    peer = Stranger(f"tcpin:127.0.0.1:{port}", place_of(upload))
    link = open_link(f"mavlink:tcp:127.0.0.1:{port}", upload.itinerary.site, LIMITS)
    opened.append(link)
    link.connect()
    peer.close()
    time.sleep(1.0)
    assert link.report(0.1).heard > 0.5
    opened.append(Stranger(f"tcpin:127.0.0.1:{port}", place_of(upload)))
    end = time.monotonic() + 15.0
    while link.report(0.1).heard > 0.5 and time.monotonic() < end:
        pass
    assert link.report(0.1).heard < 0.5
    assert capfd.readouterr().out == ""


def test_words_are_one_line():
    assert str(LinkError("a\x1b[2Jb\nc")) == "a [2Jb c"
