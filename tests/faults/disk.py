"""A disk without room, as far as this process can tell."""

import resource
from contextlib import contextmanager


@contextmanager
def full_disk(room: int = 100):
    """No file can grow beyond so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
