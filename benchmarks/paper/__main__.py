"""The paper's figures 1 and 8 to 15, and the claims of its section 4 judged, by both presets.

`python -m benchmarks.paper --out DIR [--quick]` writes the figures, `claims.json`, `claims.md`,
`legs-PRESET.nc`, `calls-PRESET.nc` and the studies `missions-PRESET`. A study that was broken off is
continued.
"""

from dataclasses import asdict
from pathlib import Path

from auvplan.errors import AuvplanError
from benchmarks.harness import launch, screen, show
from benchmarks.paper.reproduce import QUICK, Effort, reproduce

_COLUMNS = {
    "claim": "{claim}", "where": "{where}", "paper's preset": "{paper}", "default": "{default}",
    "verdict": "{verdict}",
}  # fmt: skip


def main(out: Path, quick: bool, missions: int | None, seed: int) -> None:
    if missions is not None and missions < 2:
        raise AuvplanError("--missions: two or more, for intervals")
    least = QUICK if quick else Effort()
    effort = Effort(missions or least.missions, least.seeds, least.rate_seeds, seed)
    claims, pictures = reproduce(out, effort)
    show("Claims of section 4", map(asdict, claims), _COLUMNS, names=5, overflow="fold")
    screen.print(f"claims: {out / 'claims.md'}, {out / 'claims.json'}; {len(pictures)} pictures beside them")


if __name__ == "__main__":
    launch(
        main,
        out=(Path("out/paper"), "folder for results; created if needed"),
        quick=(False, "6 missions and 3 seeds of each scenario: minutes, not hours"),
        missions=(int, "missions of each preset, two or more; 100 if absent, quick 6"),
        seed=(0, "first seed"),
    )
