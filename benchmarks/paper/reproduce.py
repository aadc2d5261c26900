"""Run everything that the claims of section 4 rest on, draw the figures, judge the claims."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import xarray as xr

from auvplan.executive import run_mission, seed_keys
from auvplan.runtime.files import output_folder, write_atomically, write_dataset
from auvplan.study import Design, run_study
from auvplan.study.store import is_unfinished
from benchmarks.paper.calls import call_times, process_apart
from benchmarks.paper.claims import Claim, Evidence, as_markdown, judge
from benchmarks.paper.figures import draw_paper
from benchmarks.paper.legs import Legs, changed, execute_legs, legs_dataset

#: Words for what is done, and the share of the whole that is done.
Progress = Callable[[str, float], Any]

#: Where the missions take place.
MISSIONS = "whitsunday"

#: Steps of `execute_legs`, and shares of the whole that all legs and a preset's missions take.
_LEG_STEPS, _LEGS, _MISSIONS = 10, 0.25, 0.25

PRESETS = "paper", "default"


@dataclass(frozen=True)
class Effort:
    """How much is run."""

    missions: int = 100  # of each preset
    seeds: int = 10  # of each of the three scenarios
    rate_seeds: int = 40  # of scenario-1 at each update rate
    seed: int = 0  # the first one

    def first(self, count: int) -> range:
        """Return so many seeds, from the first one on."""
        return range(self.seed, self.seed + count)


#: A few of each, for a first look; shares and intervals are coarse.
QUICK = Effort(6, 3, 8)


def reproduce(
    out: Path, effort: Effort, progress: Progress = lambda words, share: None
) -> tuple[list[Claim], list[Path]]:
    """Reproduce the figures and judge the claims; return these, and the paths of the pictures.

    Raises:
        StudyError: the folder holds an unfinished study of another effort.
        OutputError: a file cannot be written.
    """
    folder = output_folder(out)
    scenarios = [changed(MISSIONS, preset) for preset in PRESETS]
    with process_apart() as beside:  # programs of both presets compile side by side
        others = beside.submit(_legs_alone, folder, "default", effort)
        legs, own = _legs(folder, "paper", effort, progress)
        progress("legs of the default", _LEGS)
        figures = own, others.result()
    missions = []
    for preset, scenario, at in zip(PRESETS, scenarios, (_LEGS, _LEGS + _MISSIONS), strict=True):

        def done(count: int, total: int, share: float, preset: str = preset, at: float = at) -> None:
            progress(f"{preset}: {count} of {total} missions", at + _MISSIONS * share)

        done(0, effort.missions, 0.0)
        study, design = folder / f"missions-{preset}", Design(scenario, effort.missions, effort.seed)
        missions.append(run_study(design, study, resume=is_unfinished(study), force=True, progress=done))
    progress("single calls", _LEGS + 2.0 * _MISSIONS)
    calls = call_times(scenarios, effort.first(effort.missions))
    for preset, times in zip(PRESETS, calls, strict=True):
        write_dataset(times, folder / f"calls-{preset}.nc")
    progress("figures", 0.97)
    interval = scenarios[0].sensors.interval
    ours, theirs = (Evidence(*each, interval) for each in zip(figures, missions, calls, strict=True))
    pictures = draw_paper(
        legs, ours, lambda seed: run_mission(scenarios[0], seed_keys([seed])[0], seed), folder
    )
    claims = judge(ours, theirs)
    plain = json.dumps(list(map(asdict, claims)), indent=2, ensure_ascii=False) + "\n"
    for name, text in (("claims.json", plain), ("claims.md", as_markdown(claims))):
        write_atomically(folder / name, partial(Path.write_text, data=text, encoding="utf-8"))
    progress("done", 1.0)
    return claims, pictures


def _legs(folder: Path, preset: str, effort: Effort, progress: Progress) -> tuple[Legs, xr.Dataset]:
    """Run the legs of one preset, and write what the claims need of them; return both."""
    steps = iter(range(_LEG_STEPS))

    def next_leg(words: str) -> None:
        progress(f"legs: {words}", _LEGS * next(steps) / _LEG_STEPS)

    legs = execute_legs(preset, effort.first(effort.seeds), effort.first(effort.rate_seeds), next_leg)
    dataset = legs_dataset(legs)
    write_dataset(dataset, folder / f"legs-{preset}.nc")
    return legs, dataset


def _legs_alone(folder: Path, preset: str, effort: Effort) -> xr.Dataset:
    """Run the legs of a preset that nobody draws, and return what the claims need of them."""
    return _legs(folder, preset, effort, lambda words, share: None)[1]
