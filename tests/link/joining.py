"""Links to peers through a proxy that loses packets."""

import time

from auvplan.link import Limits, Report, open_link
from auvplan.site import Site
from tests.link.peers import Body, ImcPeer, MavsdkPeer
from tests.link.proxy import Faults, FaultyProxy, free_port


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
