"""Run everything that the claims of section 4 rest on, draw the figures, judge the claims."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from auvplan.files import output_folder, write_atomically, write_dataset
from auvplan.paper.calls import call_times
from auvplan.paper.claims import Claim, Evidence, as_json, as_markdown, judge
from auvplan.paper.figures import draw_paper
from auvplan.paper.legs import Legs, changed, execute_legs, legs_dataset
from auvplan.study import Design, run_study
from auvplan.study.store import is_unfinished

#: Words for what is done, and the share of the whole that is done.
Progress = Callable[[str, float], None]

#: Where the missions take place.
MISSIONS = "whitsunday"

#: Calls of `done` in `execute_legs`, and shares of the whole that a preset's legs, missions and calls take.
_LEG_STEPS, _LEGS, _MISSIONS, _CALLS = 10, 0.2, 0.25, 0.03


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
    found: dict[str, tuple[Legs, Evidence]] = {}
    for number, preset in enumerate(("paper", "default")):
        begin = number * (_LEGS + _MISSIONS + _CALLS)
        found[preset] = _gather(folder, preset, effort, begin, progress)
    progress("figures", 0.97)
    legs, evidence = found["paper"]
    pictures = draw_paper(legs, evidence, changed(MISSIONS, "paper"), folder)
    claims = judge(evidence, found["default"][1])
    text = json.dumps(as_json(claims), indent=2, ensure_ascii=False) + "\n"
    write_atomically(folder / "claims.json", lambda path: path.write_text(text, encoding="utf-8"))
    table = as_markdown(claims)
    write_atomically(folder / "claims.md", lambda path: path.write_text(table, encoding="utf-8"))
    progress("done", 1.0)
    return claims, pictures


def _gather(
    folder: Path, preset: str, effort: Effort, begin: float, progress: Progress
) -> tuple[Legs, Evidence]:
    """Run legs, missions and single calls of one preset."""
    steps = 0

    def next_leg(words: str) -> None:
        nonlocal steps
        progress(f"{preset}: {words}", begin + _LEGS * steps / _LEG_STEPS)
        steps += 1

    seeds = range(effort.seed, effort.seed + effort.seeds)
    legs = execute_legs(preset, seeds, range(effort.seed, effort.seed + effort.rate_seeds), next_leg)
    figures = legs_dataset(legs)
    write_dataset(figures, folder / f"legs-{preset}.nc")

    def missions_done(done: int, total: int, share: float) -> None:
        progress(f"{preset}: {done} of {total} missions", begin + _LEGS + _MISSIONS * share)

    scenario, study = changed(MISSIONS, preset), folder / f"missions-{preset}"
    missions_done(0, effort.missions, 0.0)
    missions = run_study(
        Design(scenario, effort.missions, effort.seed),
        study,
        resume=is_unfinished(study),
        force=True,
        progress=missions_done,
    )
    progress(f"{preset}: single calls", begin + _LEGS + _MISSIONS)
    calls = call_times(scenario, range(effort.seed, effort.seed + effort.missions))
    write_dataset(calls, folder / f"calls-{preset}.nc")
    return legs, Evidence(figures, missions, calls, scenario.sensors.interval)
