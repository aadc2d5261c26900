"""Links to peers through a UDP proxy that loses, delays, doubles and reorders packets, by a seed."""

import heapq
import math
import random
import select
import socket
import threading
import time
from dataclasses import dataclass, replace

from auvplan.export.imc import plan_specification
from auvplan.export.qgroundcontrol import qgc_plan
from auvplan.link import Limits, Report, open_link
from auvplan.link.imc import as_message
from auvplan.site import Site
from tests.link.peers import Body, ImcPeer, MavsdkPeer


@dataclass(frozen=True)
class Faults:
    """Shares of packets that are lost, doubled or late, by up to `delay` s, in which others overtake them."""

    lost: float = 0.05
    doubled: float = 0.05
    late: float = 0.1
    delay: float = 0.05


CLEAN = Faults(0.0, 0.0, 0.0)


class FaultyProxy:
    """Carries packets between whoever writes to `port`, on loopback, and a server, both ways.

    Attributes:
        back: address that the server is written to from, and may answer to.
        dead: whether nothing passes at all.
        counts: packets by what became of them.
    """

    def __init__(self, server: int, faults: Faults, seed: int, host: str = "127.0.0.1") -> None:
        self._front, self._back = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self._front.bind((host, 0))
        self._back.bind(("127.0.0.1", 0))
        self.port = int(self._front.getsockname()[1])
        self.back = self._back.getsockname()
        self._server, self._client = (host, server), None
        self._faults, self._random = faults, random.Random(seed)
        self._late: list[tuple[float, int, bytes, bool]] = []
        self.dead = False
        self.counts = {"passed": 0, "lost": 0, "doubled": 0, "late": 0}
        self._number, self._closed = 0, threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self) -> None:
        while not self._closed.is_set():
            wait = max(min(self._late[0][0] - time.monotonic(), 0.05), 0.0) if self._late else 0.05
            for end in select.select([self._front, self._back], [], [], wait)[0]:
                try:
                    data, source = end.recvfrom(65_535)
                except OSError:
                    continue
                if end is self._front:
                    self._client = source
                self._meet(data, end is self._front)
            while self._late and self._late[0][0] <= time.monotonic():
                _, _, data, forth = heapq.heappop(self._late)
                self._pass(data, forth)

    def _meet(self, data: bytes, forth: bool) -> None:
        draw, faults = self._random, self._faults
        if self.dead or draw.random() < faults.lost:
            self.counts["lost"] += 1
            return
        doubled = draw.random() < faults.doubled
        self.counts["doubled"] += doubled
        for _ in range(1 + doubled):
            if draw.random() < faults.late:
                self.counts["late"] += 1
                self._number += 1
                due = time.monotonic() + draw.uniform(0.0, faults.delay)
                heapq.heappush(self._late, (due, self._number, data, forth))
            else:
                self._pass(data, forth)

    def _pass(self, data: bytes, forth: bool) -> None:
        target = self._server if forth else self._client
        if target is None:
            return
        try:
            (self._back if forth else self._front).sendto(data, target)
            self.counts["passed"] += 1
        except OSError:
            self.counts["lost"] += 1

    def close(self) -> None:
        self._closed.set()
        self._thread.join(timeout=2.0)
        self._front.close()
        self._back.close()


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def body_at(site: Site, north: float, east: float, depth: float, pace: float = 1.0) -> Body:
    """A body at a local place, m."""
    longitude, latitude = site.to_geographic(north, east)
    return Body(float(latitude), float(longitude), float(depth), pace)


def joined(kind: str, site: Site, body: Body, scale: float, faults: Faults, seed: int, limits: Limits):
    """A link, the peer at its other end and the proxy between them."""
    if kind == "mavlink":
        port = free_port()
        link = open_link(f"mavlink:udpin:127.0.0.1:{port}", site, limits, scale)
        proxy = FaultyProxy(port, faults, seed)
        return link, MavsdkPeer(proxy.port, body, scale), proxy
    peer = ImcPeer(body, scale)
    proxy = FaultyProxy(peer.port, faults, seed, peer.host)
    peer.through = proxy.back
    return open_link(f"imc:{peer.host}:{proxy.port}", site, limits, scale), peer, proxy


def followed(link, steps: int) -> Report:
    """What is reported when so many steps are done; on the way their number never falls."""
    report, begin = link.report(1.0), time.monotonic()
    while report.done < steps and time.monotonic() - begin < 20.0:
        before, report = report, link.report(20.0)
        assert report.done >= before.done
    assert report.done == steps
    return report


def held_as_planned(kind: str, peer, upload) -> bool:
    """Whether the peer holds what was planned: every field of every item of the vehicle file.

    MAVSDK hands an upload to its application a moment after it has acknowledged it.
    """
    end = time.monotonic() + 2.0
    while not (held := _held(kind, peer, upload)) and time.monotonic() < end:
        time.sleep(0.01)
    return held


def _held(kind: str, peer, upload) -> bool:
    if kind == "imc":
        wanted = as_message(plan_specification(replace(upload.itinerary, name=upload.name)))
        held = peer.stored.get(wanted.plan_id)
        return held is not None and held.serialize_fields() == wanted.serialize_fields()
    plan = qgc_plan(upload.itinerary)
    fence = plan["geoFence"]
    corners = sum(len(area["polygon"]) for area in fence["polygons"]) + len(fence["circles"])
    if corners and (not peer.fences or len(peer.fences[-1]) != corners):
        return False
    items, held = plan["mission"]["items"], peer.missions[-1] if peer.missions else []
    return len(items) == len(held) and all(map(_same, items, held))


def _same(item: dict, held) -> bool:
    """Whether an item of a `.plan` file is one that MAVSDK took."""
    wanted = [math.nan if part is None else float(part) for part in item["params"]]
    found = [held.param1, held.param2, held.param3, held.param4, held.x * 1e-7, held.y * 1e-7, held.z]
    close = (1e-3, 1e-3, 1e-3, 1e-3, 1.1e-7, 1.1e-7, 1e-3)
    return (item["command"], item["frame"]) == (held.command, held.frame) and all(
        math.isnan(a) or abs(a - b) <= least for a, b, least in zip(wanted, found, close, strict=True)
    )
