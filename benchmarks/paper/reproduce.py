"""Run everything that the claims of section 4 rest on, draw the figures, judge the claims."""

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import xarray as xr

from auvplan.executive import run_mission, seed_keys
from auvplan.runtime.files import output_folder, write_atomically, write_dataset
from auvplan.study import Design, run_study
from auvplan.study.store import is_unfinished
from benchmarks.harness import screen
from benchmarks.paper.calls import call_times, process_apart
from benchmarks.paper.claims import Claim, Evidence, as_markdown, judge
from benchmarks.paper.legs import Legs, changed, execute_legs, legs_dataset
from benchmarks.paper.plots import draw_paper

#: Where the missions take place.
MISSIONS = "whitsunday"

PRESETS = "paper", "default"


@dataclass(frozen=True)
class Effort:
    missions: int = 100  # of each preset
    seeds: int = 10  # of each of the three scenarios
    rate_seeds: int = 40  # of scenario-1 at each update rate
    seed: int = 0  # the first one

    def first(self, count: int) -> range:
        """Return so many seeds, from the first one on."""
        return range(self.seed, self.seed + count)


#: A few of each, for a first look; shares and intervals are coarse.
QUICK = Effort(6, 3, 8)


def reproduce(out: Path, effort: Effort) -> tuple[list[Claim], list[Path]]:
    """Reproduce the figures and judge the claims; return these, and the paths of the pictures.

    Raises:
        StudyError: the folder holds an unfinished study of another effort.
        OutputError: a file cannot be written.
    """
    folder = output_folder(out)
    scenarios = [changed(MISSIONS, preset) for preset in PRESETS]
    screen.print("single legs under both presets ...")
    with process_apart() as beside:  # programs of both presets compile side by side
        others = beside.submit(_figures_of_legs, folder, "default", effort)
        legs, own = _legs(folder, "paper", effort)
        figures = own, others.result()
    missions = []
    for preset, scenario in zip(PRESETS, scenarios, strict=True):
        screen.print(f"{effort.missions} missions, preset {preset} ...")
        study, design = folder / f"missions-{preset}", Design(scenario, effort.missions, effort.seed)
        missions.append(run_study(design, study, resume=is_unfinished(study), force=True))
    screen.print("single calls, figures ...")
    calls = call_times(scenarios, effort.first(effort.missions))
    for preset, times in zip(PRESETS, calls, strict=True):
        write_dataset(times, folder / f"calls-{preset}.nc")
    interval = scenarios[0].sensors.interval
    ours, theirs = (Evidence(*each, interval) for each in zip(figures, missions, calls, strict=True))
    pictures = draw_paper(
        legs, ours, lambda seed: run_mission(scenarios[0], seed_keys([seed])[0], seed), folder
    )
    claims = judge(ours, theirs)
    plain = json.dumps(list(map(asdict, claims)), indent=2, ensure_ascii=False) + "\n"
    for name, text in (("claims.json", plain), ("claims.md", as_markdown(claims))):
        write_atomically(folder / name, partial(Path.write_text, data=text, encoding="utf-8"))
    return claims, pictures


def _legs(folder: Path, preset: str, effort: Effort) -> tuple[Legs, xr.Dataset]:
    """Run the legs of one preset, and write what the claims need of them; return both."""
    legs = execute_legs(preset, effort.first(effort.seeds), effort.first(effort.rate_seeds))
    dataset = legs_dataset(legs)
    write_dataset(dataset, folder / f"legs-{preset}.nc")
    return legs, dataset


def _figures_of_legs(folder: Path, preset: str, effort: Effort) -> xr.Dataset:
    """Run the legs of a preset that nobody draws."""
    return _legs(folder, preset, effort)[1]
