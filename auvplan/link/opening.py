"""Addresses of vehicles, as the command takes them."""

import re

from auvplan.errors import AuvplanError
from auvplan.link.limits import Limits
from auvplan.link.vehicle import LinkError, VehicleLink
from auvplan.site import Site

#: What stands before the address of a vehicle.
SIMULATOR = "sim"
MAVLINK, IMC = "mavlink:", "imc:"


def check_address(address: str) -> None:
    """Check an address before anything is planned.

    Raises:
        AuvplanError: it is none that `open_link` knows, or its library is not installed; one line.
    """
    if address == SIMULATOR:
        return
    if address.startswith(MAVLINK):
        forms = r"(udpin|udpout|udp|tcp|tcpin):[^:]+:\d+|/dev/\S+|COM\d+(,\d+)?"
        if not re.fullmatch(forms, address.removeprefix(MAVLINK)):
            raise AuvplanError(
                f"--link {address}: a MAVLink address is such as mavlink:udpin:0.0.0.0:14550, "
                "mavlink:tcp:HOST:PORT or mavlink:/dev/ttyUSB0"
            )
        _require("pymavlink")
    elif address.startswith(IMC):
        if not re.fullmatch(r"[^:]+:\d+", address.removeprefix(IMC)):
            raise AuvplanError(f"--link {address}: an IMC address is such as imc:10.0.10.80:6002")
        _require("imcpy")
    else:
        raise AuvplanError(f"--link {address}: must be sim, mavlink:ADDRESS or imc:HOST:PORT")


def open_link(address: str, site: Site, limits: Limits | None = None, scale: float = 1.0) -> VehicleLink:
    """Open a link to a vehicle outside of this process.

    Args:
        address: mavlink:ADDRESS or imc:HOST:PORT.
        site: that local coordinates count from.
        limits: of replies and tries.
        scale: s of mission time in one of wall-clock time, for vehicles that are simulated.

    Raises:
        AuvplanError: the address is none, its library is missing, or it cannot be opened; one line.
    """
    check_address(address)
    try:
        if address.startswith(MAVLINK):
            from auvplan.link.mavlink import MavlinkVehicle

            return MavlinkVehicle(address.removeprefix(MAVLINK), site, limits, scale)
        from auvplan.link.imc import ImcVehicle

        return ImcVehicle(address.removeprefix(IMC), site, limits, scale)
    except LinkError as error:
        raise AuvplanError(f"--link {error}") from None


def _require(library: str) -> None:
    try:
        __import__(library)
    except ImportError:
        raise AuvplanError(f"--link needs {library}: pip install 'auvplan[link]'") from None
