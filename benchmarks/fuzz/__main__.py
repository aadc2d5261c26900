"""Every reader of files is given changed real ones: ``python -m benchmarks.fuzz [--minutes 10]``.

Each copy has to be read, or refused by one line. All else is a failure: another error, more than 10 s of
processor time, more than 2 GiB beyond what was loaded, a dead process, a file opened that neither the call
nor the file names, a program started, a connection made, an object unpickled. Failures are kept in a folder
with the reader, the seed and the number of the case; the same seed makes the same cases.
"""

import tempfile
from pathlib import Path
from typing import Any

from benchmarks.fuzz.cases import BYTES, SECONDS, Cases, fuzz, write_outside
from benchmarks.fuzz.readers import READERS, write_sources
from benchmarks.harness import launch, screen, show, track


@launch(
    minutes=(10.0, "for each reader"),
    cases=(10**9, "of each reader, at most"),
    first=(0, "number of the first case"),
    only=("", "part of the names of readers"),
    seed=(0, "of the cases"),
    keep=(Path, "folder for failures; a temporary one if absent"),
)
def main(
    minutes: float, cases: int, first: int, only: str, seed: int, keep: Path | None
) -> tuple[dict[str, Any], bool]:
    keep = keep or Path(tempfile.mkdtemp(prefix="auvplan-fuzz-"))
    rows = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        outside = write_outside(folder)
        write_sources(folder / "sources")
        for reader in track([name for name in READERS if only in name], "readers"):
            place = folder / "readers" / f"{len(rows)}"
            seeds = tuple(READERS[reader].write(place, folder / "sources"))
            rows.append(fuzz(Cases(reader, seeds, place, outside, seed), minutes, cases, keep, first))
            for failure in {one["found"][:60]: one for one in rows[-1]["failed"][::-1]}.values():
                line = "{case}, {change}: {found}".format(**failure)
                screen.print(f"{reader}, case {line}", markup=False, highlight=False)
    columns = {name: f"{{{name}}}" for name in ("reader", "cases", "read", "refused", "failures")}
    show("changed files", rows, columns | {"most memory, MiB": "{memory}"})
    failed = any(row["failures"] for row in rows)
    screen.print(f"memory of a case: at most {BYTES >> 30} GiB beyond what is loaded; time: {SECONDS} s")
    if failed:
        screen.print(f"failures are kept in {keep}", markup=False)
    return {"fuzz": rows}, failed
