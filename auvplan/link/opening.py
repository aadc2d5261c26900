"""Addresses of vehicles, as the command takes them."""

import re
import socket

from auvplan.errors import AuvplanError
from auvplan.link.limits import OVER_GROUND, Limits
from auvplan.link.vehicle import LinkError, VehicleLink
from auvplan.site import Site

#: What stands before the address of a vehicle.
SIMULATOR = "sim"
MAVLINK, IMC = "mavlink:", "imc:"


def check_address(address: str, link_loss: str = "") -> None:
    """Check an address before anything is planned, and what the vehicle is to do without a link.

    Raises:
        AuvplanError: it is none that `open_link` knows, or its library is not installed; one line.
    """
    if link_loss and not address.startswith(MAVLINK):
        raise AuvplanError(f"--link-loss: is for --link mavlink:ADDRESS, where ArduSub is, not {address}")
    if address == SIMULATOR:
        return
    if address.startswith(MAVLINK):
        rest = address.removeprefix(MAVLINK)
        serial = re.fullmatch(r"/dev/\S+|COM\d+(,\d+)?", rest)
        if not serial and not re.fullmatch(r"(udpin|udpout|udp|tcp|tcpin):[^:]+:\d+", rest):
            raise AuvplanError(
                f"--link {address}: a MAVLink address is such as mavlink:udpin:0.0.0.0:14550, "
                "mavlink:tcp:HOST:PORT or mavlink:/dev/ttyUSB0"
            )
        if not serial:
            _check_host(address)
        _require("pymavlink")
        if serial:
            _require("serial", "pyserial")
    elif address.startswith(IMC):
        if not re.fullmatch(r"tcp:[^:?]+:\d+|[^:?]+:\d+(\?local=\d+)?", address.removeprefix(IMC)):
            raise AuvplanError(
                f"--link {address}: an IMC address is such as imc:10.0.10.80:6002, "
                "imc:10.0.10.80:6002?local=6011 or imc:tcp:10.0.10.80:6006"
            )
        _check_host(address.partition("?")[0])
        _require("imcpy")
    else:
        raise AuvplanError(f"--link {address}: must be sim, mavlink:ADDRESS or imc:HOST:PORT")


def open_link(
    address: str,
    site: Site,
    limits: Limits | None = None,
    scale: float = 1.0,
    link_loss: str = "",
    over_ground: bool | None = None,
) -> VehicleLink:
    """Open a link to a vehicle outside of this process.

    Args:
        address: mavlink:ADDRESS, imc:HOST:PORT, with `?local=PORT` for a port of ours, or imc:tcp:HOST:PORT.
        site: that local coordinates count from.
        limits: of replies and tries.
        scale: s of mission time in one of wall-clock time, for vehicles that are simulated.
        link_loss: what ArduSub is set to do without a link, "continue" or "surface"; empty: as it is set.
        over_ground: whether the vehicle holds a speed over ground, not through the water; None: as such
            vehicles do (`auvplan.link.limits`).

    Raises:
        AuvplanError: the address is none, its library is missing, or it cannot be opened; one line.
    """
    check_address(address, link_loss)
    try:
        if address.startswith(MAVLINK):
            from auvplan.link.mavlink import MavlinkVehicle

            held = OVER_GROUND["mavlink"] if over_ground is None else over_ground
            return MavlinkVehicle(address.removeprefix(MAVLINK), site, limits, scale, link_loss, held)
        from auvplan.link.imc import ImcVehicle

        held = OVER_GROUND["imc"] if over_ground is None else over_ground
        return ImcVehicle(address.removeprefix(IMC), site, limits, scale, held)
    except LinkError as error:
        raise AuvplanError(f"--link {error}") from None


def _check_host(address: str) -> None:
    """Check the host and the port at the end of an address.

    Raises:
        AuvplanError: the host is not known, or the port is none.
    """
    host, port = address.split(":")[-2:]
    if not 0 < int(port) < 65_536:
        raise AuvplanError(f"--link {address}: a port is from 1 to 65535")
    try:
        socket.gethostbyname(host)
    except OSError as error:
        raise AuvplanError(f"--link {address}: host {host}: {error.strerror or error}") from None


def _require(library: str, package: str = "'auvplan[link]'") -> None:
    try:
        __import__(library)
    except ImportError:
        raise AuvplanError(f"--link needs {library}: pip install {package}") from None
