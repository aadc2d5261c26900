"""The paper's figures 1 and 8 to 15, and the claims of its section 4 judged, by both presets.

`python -m benchmarks.paper --out DIR [--quick]` writes the figures, `claims.json`, `claims.md`,
`legs-PRESET.nc`, `calls-PRESET.nc` and the studies `missions-PRESET`. A study that was broken off is
continued.
"""

from dataclasses import asdict, replace
from pathlib import Path

from benchmarks.harness import launch, screen, show
from benchmarks.paper.reproduce import QUICK, Effort, reproduce

_COLUMNS = {
    "claim": "{claim}", "where": "{where}", "paper's preset": "{paper}", "default": "{default}",
    "verdict": "{verdict}",
}  # fmt: skip


@launch(
    out=(Path("out/paper"), "folder for results; created if needed"),
    quick=(False, "6 missions and 3 seeds of each scenario: minutes, not hours"),
    seed=(0, "first seed"),
)
def main(out: Path, quick: bool, seed: int) -> None:
    effort = replace(QUICK if quick else Effort(), seed=seed)
    claims, pictures = reproduce(out, effort)
    show("Claims of section 4", map(asdict, claims), _COLUMNS, names=5, overflow="fold")
    screen.print(f"claims: {out / 'claims.md'}, {out / 'claims.json'}; {len(pictures)} pictures beside them")
