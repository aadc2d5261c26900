"""A study on disk: missions one by one as they end, then one dataset and its summary."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from auvplan.errors import StudyError
from auvplan.runtime import files
from auvplan.runtime.formatting import counted
from auvplan.scenario.provenance import changed_source, source_digests
from auvplan.study.design import Design
from auvplan.study.table import VARIABLES, Row, rows_of

#: Names in the folder of a study: its missions while it runs, its results.
PIECES, DATASET, SUMMARY = "missions", "missions.nc", "summary.json"

#: Variables that neither summaries nor pictures need.
_UNSHOWN = ("revisits", "length", "leg_revisit", "leg_line_covered")

#: Folder in that of a study for whole results of its missions, one each, where they are saved.
RUNS = "runs"


class Store:
    """The folder of one study.

    Attributes:
        folder: with everything in it.
        design: what is run.
    """

    def __init__(
        self,
        folder: str | Path,
        design: Design,
        resume: bool = False,
        force: bool = False,
        home: str | Path | None = None,
        save_runs: bool = False,
    ):
        """Open a new study, with `resume` the same again or one of more missions; `force` replaces it.

        Args:
            folder, design: as the attributes.
            resume, force: which of these.
            home: folder that relative paths in the scenario start from; that of its file if absent.
            save_runs: whether a whole result of each mission is kept in `RUNS`.

        Raises:
            StudyError: the folder holds a study that is not to be replaced, or to resume another one or none,
                or one of whose missions some are done and not kept whole, as `save_runs` asks.
            OutputError: the folder cannot be written.
        """
        self.folder, self.design = Path(folder), design
        self._home = design.scenario.folder if home is None else home
        # As it comes back from JSON: tuples are lists there.
        plain = json.loads(json.dumps(design.plain()))
        if resume:
            self._resume(plain, save_runs)
            return
        files.require_kind(folder, "study")
        if not force:
            require_room(folder)
        # In this order: whenever it is broken off, the folder can be resumed or begun again.
        files.output_folder(self.folder)
        self._drop_results()
        for name in (PIECES, RUNS):
            shutil.rmtree(self.folder / name, ignore_errors=True)
        files.write_json(self.folder / files.DESIGN, plain | {"sources": self._sources()})
        files.output_folder(self.folder / PIECES)

    def _resume(self, plain: dict[str, Any], save_runs: bool) -> None:
        """Continue the study, whose missions become pieces again where it is finished and more are wanted.

        Its steps are in an order that can be broken off anywhere, and the folder resumed.
        """
        known = _same(self.folder / files.DESIGN, plain)
        kept = int(known["count"])
        for case in self.design.cases if "sources" in known else ():
            if changed := changed_source(known["sources"], case.model_dump(mode="json"), self._home):
                raise StudyError(f"{self.folder / files.DESIGN}: {changed}; run it in another folder")
        done = replace(self.design, count=kept)
        pieces = [self._piece(*task) for task in done.tasks]
        lost = [piece for piece in pieces if not (self.folder / RUNS / piece.stem).is_dir()]
        if save_runs and (without := sum(self.finished or piece.is_file() for piece in lost)):
            raise StudyError(
                f"{self.folder}: {counted(without, 'finished mission')} without a saved run: "
                "resume it without --save-runs, or run all again with --force"
            )
        if self.finished:
            shutil.rmtree(self.folder / PIECES, ignore_errors=True)  # broken off while it cleaned up
        if kept == plain["count"]:
            return
        if self.finished:
            for task, row in zip(done.tasks, rows_of(load_study(self.folder)), strict=True):
                self.add(*task, row)
            self._drop_results()
        files.write_json(self.folder / files.DESIGN, known | plain)

    def _sources(self) -> list[dict[str, Any]]:
        """Return digests of the files that the scenarios of all cases name."""
        found: list[dict[str, Any]] = []
        for case in self.design.cases:
            rows = source_digests(case.model_dump(mode="json"), self._home)
            found += [row for row in rows if row not in found]
        return found

    def _drop_results(self) -> None:
        for name in (SUMMARY, DATASET, files.REHEARSAL, files.REPORT):
            (self.folder / name).unlink(missing_ok=True)

    @property
    def finished(self) -> bool:
        """Whether the dataset is written."""
        return _is_finished(self.folder)

    def missing(self) -> list[tuple[int, int]]:
        """Case and seed of the missions that are not on disk yet."""
        if self.finished:
            return []
        return [task for task in self.design.tasks if not self._piece(*task).is_file()]

    def add(self, case: int, seed: int, row: Row) -> None:
        """Write one mission."""
        files.output_folder(self.folder / PIECES)
        files.write_atomically(self._piece(case, seed), lambda path: np.savez_compressed(path, **row))  # type: ignore[arg-type]

    def rows(self) -> list[Row]:
        """Return all missions, in the order of `Design.tasks`.

        Raises:
            ResultError: a mission's file is damaged; one line that names it.
        """
        return [_read(self._piece(*task)) for task in self.design.tasks]

    def finish(self, dataset: xr.Dataset, summary: dict[str, Any]) -> None:
        """Write the results in place of the missions one by one."""
        files.write_dataset(dataset, self.folder / DATASET)
        files.write_json(self.folder / SUMMARY, summary)
        shutil.rmtree(self.folder / PIECES, ignore_errors=True)

    def _piece(self, case: int, seed: int) -> Path:
        return self.folder / PIECES / f"{case:04d}-{seed:08d}.npz"


def require_room(folder: str | Path) -> None:
    """Refuse to replace a study.

    Raises:
        StudyError: the folder holds one; one line that says what would do.
    """
    folder, instead = Path(folder), "replace it with --force, or choose another folder with --out"
    if _is_finished(folder):
        count = counted(load_study(folder)["success"].size, "mission")
        raise StudyError(
            f"{folder} holds a finished study of {count}: "
            f"extend it with --resume and a larger --missions, {instead}"
        )
    if is_unfinished(folder):
        done = len(list((folder / PIECES).glob("[0-9]*.npz")))
        raise StudyError(
            f"{folder} holds an unfinished study, {counted(done, 'mission')} done: "
            f"continue it with --resume, {instead}"
        )


def _is_finished(folder: Path) -> bool:
    return (folder / DATASET).is_file() and (folder / SUMMARY).is_file()


def is_unfinished(folder: str | Path) -> bool:
    """Return whether a folder holds a study that was broken off, which can be resumed."""
    return (Path(folder) / PIECES).is_dir()


def load_study(folder: str | Path) -> xr.Dataset:
    """Return the dataset of a finished study, in memory.

    Raises:
        ResultError: one line that names the file and what is wrong with it.
    """
    dataset = files.read_dataset(folder, DATASET)
    lead = dataset["success"].dims if "success" in dataset else ("mission",)
    wanted = {name: (*lead, *variable.dims) for name, variable in VARIABLES.items()} | {"seed": ("mission",)}
    for name, dims in wanted.items():
        if name not in dataset and name in _UNSHOWN:
            continue
        if name not in dataset:
            raise files.ResultError(f"{Path(folder) / DATASET}: variable {name} is missing")
        there, kind = dataset[name].dims, dataset[name].dtype.kind
        if there != dims or "mission" not in there:
            raise files.ResultError(f"{Path(folder) / DATASET}: variable {name} has dimensions {there}")
        if name != "reason" and kind not in "iufb":
            raise files.ResultError(f"{Path(folder) / DATASET}: variable {name} holds no numbers")
    return dataset


def saved_runs(folder: str | Path) -> list[Path]:
    """List the folders of a study's saved missions, by case and seed.

    Raises:
        StudyError: there are none; one line that says how to save them.
    """
    runs = Path(folder) / RUNS
    found = sorted(path for path in runs.iterdir() if path.is_dir()) if runs.is_dir() else []
    if not found:
        raise StudyError(f"{folder}: the study has no saved runs; run it with --save-runs to check them")
    return found


def _same(path: Path, plain: dict[str, Any]) -> dict[str, Any]:
    """Return the design of the study so far; refuse to continue what is not there or is another study."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise StudyError(f"{path}: no study to resume") from None
    except (ValueError, RecursionError):
        raise StudyError(f"{path}: not valid JSON") from None
    for name, value in plain.items():
        there = kept.get(name) if isinstance(kept, dict) else None
        fewer = name == "count" and isinstance(there, int) and there < value
        # The order of sweeps numbers the cases.
        if not fewer and json.dumps(there) != json.dumps(value):
            inner: list[str] = []
            if isinstance(value, dict) and isinstance(there, dict):
                inner = [key for key in value if there.get(key) != value[key]]
            field = ".".join([name, *inner[:1]])
            raise StudyError(f"{path}: {field} differs from the study asked for; run it in another folder")
    return kept


def _read(path: Path) -> Row:
    try:
        # NumPy leaves a damaged file open that it has opened itself.
        with path.open("rb") as file, np.load(file) as piece:
            return {name: piece[name] for name in VARIABLES}
    except Exception as error:
        line = " ".join(str(error).split()) or type(error).__name__
        raise files.ResultError(
            f"{path}: not a readable mission ({line}); remove it and use --resume"
        ) from None
