"""A UDP proxy that loses, delays, doubles and reorders packets, by a seed."""

import heapq
import random
import select
import socket
import threading
import time
from dataclasses import dataclass


@dataclass(frozen=True)
class Faults:
    """Shares of packets, and how long the late ones are.

    Attributes:
        lost, doubled, late: shares of all packets.
        delay: s, longest delay of late packets; others overtake them.
    """

    lost: float = 0.05
    doubled: float = 0.05
    late: float = 0.1
    delay: float = 0.05


CLEAN = Faults(0.0, 0.0, 0.0)


class FaultyProxy:
    """Carries packets between whoever writes to `port` and a server, both ways.

    Attributes:
        port: on loopback, that clients write to.
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
        copies = 1
        if draw.random() < faults.doubled:
            copies, self.counts["doubled"] = 2, self.counts["doubled"] + 1
        for _ in range(copies):
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
