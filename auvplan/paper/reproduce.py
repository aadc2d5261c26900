"""Run everything that the claims of section 4 rest on, draw the figures, judge the claims."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import xarray as xr

from auvplan.paper.calls import call_times, process_apart
from auvplan.paper.claims import Claim, Evidence, as_json, as_markdown, judge
from auvplan.paper.figures import draw_paper
from auvplan.paper.legs import Legs, changed, execute_legs, legs_dataset
from auvplan.runtime.files import output_folder, write_atomically, write_dataset
from auvplan.study import Design, run_study
from auvplan.study.store import is_unfinished

#: Words for what is done, and the share of the whole that is done.
Progress = Callable[[str, float], None]

#: Where the missions take place.
MISSIONS = "whitsunday"

#: Calls of `done` in `execute_legs`, and shares of the whole that all legs and a preset's missions take.
_LEG_STEPS, _LEGS, _MISSIONS = 10, 0.25, 0.25

PRESETS = "paper", "default"


@dataclass(frozen=True)
class Effort:
    """How much is run.

    Attributes:
        missions: of each preset.
        seeds: of each of the three scenarios.
        rate_seeds: of scenario-1 at each update rate.
        seed: the first one.
    """

    missions: int = 100
    seeds: int = 10
    rate_seeds: int = 40
    seed: int = 0

    @property
    def mission_seeds(self) -> range:
        """Seeds of the missions."""
        return range(self.seed, self.seed + self.missions)

    @classmethod
    def quick(cls, seed: int = 0) -> "Effort":
        """Return a few of each, for a first look; shares and intervals are coarse."""
        return cls(6, 3, 8, seed)


def reproduce(
    out: str | Path, effort: Effort, progress: Progress = lambda words, share: None
) -> tuple[list[Claim], list[Path]]:
    """Reproduce the paper's figures and judge its claims under the presets "paper" and "default".

    Writes the figures, `claims.json`, `claims.md`, `legs-PRESET.nc`, `calls-PRESET.nc` and the studies
    `missions-PRESET`. A study that was broken off is continued.

    Args:
        out: folder, created if needed.
        effort: how much is run.
        progress: called as the work goes on.

    Returns:
        The claims, and the paths of the pictures.

    Raises:
        StudyError: the folder holds an unfinished study of another effort.
        OutputError: a file cannot be written.
    """
    folder = output_folder(out)
    scenarios = [changed(MISSIONS, preset) for preset in PRESETS]
    with process_apart() as call:  # programs of both presets compile side by side
        others = call(_legs_alone, folder, "default", effort)
        legs, own = _legs(
            folder, "paper", effort, lambda words, share: progress(f"legs: {words}", _LEGS * share)
        )
        progress("legs of the default", _LEGS)
        figures = own, others.result()
    missions = []
    for preset, scenario, at in zip(PRESETS, scenarios, (_LEGS, _LEGS + _MISSIONS), strict=True):

        def missions_done(done: int, total: int, share: float, preset: str = preset, at: float = at) -> None:
            progress(f"{preset}: {done} of {total} missions", at + _MISSIONS * share)

        missions_done(0, effort.missions, 0.0)
        study, design = folder / f"missions-{preset}", Design(scenario, effort.missions, effort.seed)
        done = run_study(design, study, resume=is_unfinished(study), force=True, progress=missions_done)
        missions.append(done)
    progress("single calls", _LEGS + 2.0 * _MISSIONS)
    calls = call_times(scenarios, effort.mission_seeds)
    for preset, times in zip(PRESETS, calls, strict=True):
        write_dataset(times, folder / f"calls-{preset}.nc")
    progress("figures", 0.97)
    interval = scenarios[0].sensors.interval
    ours, theirs = (Evidence(*each, interval) for each in zip(figures, missions, calls, strict=True))
    pictures = draw_paper(legs, ours, scenarios[0], folder)
    claims = judge(ours, theirs)
    text = json.dumps(as_json(claims), indent=2, ensure_ascii=False) + "\n"
    write_atomically(folder / "claims.json", lambda path: path.write_text(text, encoding="utf-8"))
    table = as_markdown(claims)
    write_atomically(folder / "claims.md", lambda path: path.write_text(table, encoding="utf-8"))
    progress("done", 1.0)
    return claims, pictures


def _legs(folder: Path, preset: str, effort: Effort, progress: Progress) -> tuple[Legs, xr.Dataset]:
    """Run the legs of one preset, and write what the claims need of them; return both."""
    steps = 0

    def next_leg(words: str) -> None:
        nonlocal steps
        progress(words, steps / _LEG_STEPS)
        steps += 1

    seeds = range(effort.seed, effort.seed + effort.seeds)
    legs = execute_legs(preset, seeds, range(effort.seed, effort.seed + effort.rate_seeds), next_leg)
    dataset = legs_dataset(legs)
    write_dataset(dataset, folder / f"legs-{preset}.nc")
    return legs, dataset


def _legs_alone(folder: Path, preset: str, effort: Effort) -> xr.Dataset:
    """Run the legs of a preset that nobody draws, and return what the claims need of them."""
    return _legs(folder, preset, effort, lambda words, share: None)[1]
