"""A study on the workers of a Dask cluster, on one machine or many."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from auvplan.study.design import StudyError
from auvplan.study.worker import Job, Report, run_whole_job

#: Missions that a worker is handed at a time, which are lost when it dies.
CHUNK = 16

#: How long a scheduler is waited for.
PATIENCE = "10s"


@contextmanager
def connected(address: str) -> Iterator[Any]:
    """A client of a scheduler, by its address, such as "tcp://host:8786", or the path of its file.

    Raises:
        StudyError: Dask is not installed, or the scheduler cannot be reached.
    """
    try:
        from distributed import Client
    except ImportError:
        raise StudyError("--dask needs the extra auvplan[dask]: pip install 'auvplan[dask]'") from None
    place: dict[str, Any] = {"scheduler_file": address} if Path(address).is_file() else {"address": address}
    try:
        client = Client(**place, timeout=PATIENCE, set_as_default=False)
    # A scheduler file without an address ends in an assertion.
    except (OSError, ValueError, AssertionError) as error:
        line = " ".join(str(error).split()) or "no address"
        raise StudyError(f"Dask scheduler {address} cannot be reached: {line}") from None
    with client:
        yield client


def run_on_cluster(
    client: Any,
    tasks: list[tuple[int, int]],
    job: Callable[[list[tuple[int, int]]], Job],
    take: Callable[[Report, Any], None],
    chunk: int = CHUNK,
) -> None:
    """Hand chunks of missions to a cluster's workers; those of a lost worker go to another one."""
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    chunks = [tasks[first : first + chunk] for first in range(0, len(tasks), chunk)]
    futures = [client.submit(run_whole_job, job(part), pure=False) for part in chunks]
    for future in as_completed(futures, loop=client.loop):
        try:
            reports = future.result()
        except KilledWorker:
            raise StudyError(
                "the cluster's workers died over the same missions (out of memory?); "
                "continue the study with --resume"
            ) from None
        for report in reports:
            take(report, future.key)
        future.release()
