"""Worker processes that are killed; they load little, and begin at once."""

import os
import struct
from multiprocessing.connection import Connection


def work_and_die(job, core, settings, pipe: Connection) -> None:
    """A worker process that is killed."""
    os._exit(1)


def work_and_die_speaking(job, core, settings, pipe: Connection) -> None:
    """A worker process that is killed in the middle of a report."""
    os.write(pipe.fileno(), struct.pack("!i", 1000) + b"a report")
    os._exit(1)
