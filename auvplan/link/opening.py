"""Addresses of vehicles, as the command takes them."""

import re
import socket
from importlib import import_module

from auvplan.errors import AuvplanError
from auvplan.link.limits import Limits
from auvplan.link.vehicle import LinkError, VehicleLink
from auvplan.site import Site

#: What stands for the simulator.
SIMULATOR = "sim"

#: A serial port, as MAVLink addresses have it.
_SERIAL = r"/dev/\S+|COM\d+(,\d+)?"

#: By what addresses begin with: their form, what they are like, and the library that they need.
_FORMS = {
    "mavlink": (
        rf"{_SERIAL}|(udpin|udpout|udp|tcp|tcpin):[^:]+:\d+",
        "a MAVLink address is such as mavlink:udpin:0.0.0.0:14550, mavlink:tcp:HOST:PORT or "
        "mavlink:/dev/ttyUSB0",
        "pymavlink",
    ),
    "imc": (
        r"tcp:[^:?]+:\d+|[^:?]+:\d+(\?local=\d+)?",
        "an IMC address is such as imc:10.0.10.80:6002, imc:10.0.10.80:6002?local=6011 or "
        "imc:tcp:10.0.10.80:6006",
        "imcpy",
    ),
}


def check_address(address: str, link_loss: str = "") -> None:
    """Check an address before anything is planned, and what the vehicle is to do without a link.

    Raises:
        AuvplanError: it is none that `open_link` knows, or its library is not installed; one line.
    """
    if link_loss and not address.startswith("mavlink:"):
        raise AuvplanError(f"--link-loss: is for --link mavlink:ADDRESS, where ArduSub is, not {address}")
    if address == SIMULATOR:
        return
    kind, colon, rest = address.partition(":")
    if not colon or kind not in _FORMS:
        raise AuvplanError(f"--link {address}: must be sim, mavlink:ADDRESS or imc:HOST:PORT")
    form, example, library = _FORMS[kind]
    if not re.fullmatch(form, rest):
        raise AuvplanError(f"--link {address}: {example}")
    serial = kind == "mavlink" and bool(re.fullmatch(_SERIAL, rest))
    if not serial:
        address = address.partition("?")[0]
        host, port = address.split(":")[-2:]
        if not 0 < int(port) < 65_536:
            raise AuvplanError(f"--link {address}: a port is from 1 to 65535")
        try:
            socket.gethostbyname(host)
        except OSError as error:
            raise AuvplanError(f"--link {address}: host {host}: {error.strerror or error}") from None
    for needed, package in ((library, "'auvplan[link]'"), *[("serial", "pyserial")] * serial):
        try:
            import_module(needed)
        except ImportError:
            raise AuvplanError(f"--link needs {needed}: pip install {package}") from None


def open_link(
    address: str,
    site: Site,
    limits: Limits | None = None,
    scale: float = 1.0,
    link_loss: str = "",
    over_ground: bool = True,
) -> VehicleLink:
    """Open a link to a vehicle outside of this process.

    Args:
        address: mavlink:ADDRESS, imc:HOST:PORT, with `?local=PORT` for a port of ours, or imc:tcp:HOST:PORT.
        site: that local coordinates count from.
        limits: of replies and tries.
        scale: s of mission time in one of wall-clock time, for vehicles that are simulated.
        link_loss: what ArduSub is set to do without a link, "continue" or "surface"; empty: as it is set.
        over_ground: whether the vehicle holds a speed over ground, not through the water. ArduSub does by its
            position (AC_WPNav), DUNE by its Doppler log while that has the bottom (Control/AUV/Speed,
            Navigation/AUV/Navigation); without it DUNE's is through the water.

    Raises:
        AuvplanError: the address is none, its library is missing, or it cannot be opened; one line.
    """
    check_address(address, link_loss)
    kind, _, rest = address.partition(":")
    try:
        if kind == "mavlink":
            from auvplan.link.mavlink import MavlinkVehicle

            return MavlinkVehicle(rest, site, limits, scale, link_loss, over_ground)
        from auvplan.link.imc import ImcVehicle

        return ImcVehicle(rest, site, limits, scale, over_ground)
    except LinkError as error:
        raise AuvplanError(f"--link {error}") from None
