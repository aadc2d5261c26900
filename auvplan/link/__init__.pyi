from .execution import execute as execute
from .limits import Limits as Limits
from .opening import open_link as open_link
from .record import ExecutionRecord as ExecutionRecord
from .vehicle import LinkError as LinkError
from .vehicle import Lost as Lost
from .vehicle import Refused as Refused
from .vehicle import Report as Report
from .vehicle import State as State
from .vehicle import Step as Step
from .vehicle import Upload as Upload
from .vehicle import VehicleLink as VehicleLink

__all__ = [
    "ExecutionRecord",
    "Limits",
    "LinkError",
    "Lost",
    "Refused",
    "Report",
    "State",
    "Step",
    "Upload",
    "VehicleLink",
    "execute",
    "open_link",
]
