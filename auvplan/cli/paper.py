"""The command that reproduces the paper's figures and judges its claims."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from auvplan.cli.shared import OutOption, QuietOption, SeedOption, console, list_files, progress_bar

if TYPE_CHECKING:
    from auvplan.paper import Claim

_COLOURS = {"confirmed": "green", "partly": "yellow", "not confirmed": "red"}


def paper(
    out: OutOption = Path("out/paper"),
    quick: Annotated[
        bool, typer.Option("--quick", help="6 missions and 3 seeds of each scenario: minutes, not hours.")
    ] = False,
    missions: Annotated[
        int | None, typer.Option("--missions", min=2, help="Missions of each preset; 100 if absent, quick 6.")
    ] = None,
    seed: SeedOption = 0,
    quiet: QuietOption = False,
) -> None:
    """Reproduce the paper's figures (1, 8 to 15) and judge the claims of its section 4."""
    from auvplan.paper import Effort, reproduce

    effort = Effort.quick(seed) if quick else Effort(seed=seed)
    if missions is not None:
        effort = replace(effort, missions=missions)
    with progress_bar("compiling", quiet) as move:
        claims, pictures = reproduce(out, effort, lambda words, share: move(share, words))
    if not quiet:
        console.print(table(claims))
        console.print(f"claims: {out / 'claims.md'}, {out / 'claims.json'}", soft_wrap=True)
        list_files("pictures", pictures)


def table(claims: "list[Claim]") -> Table:
    """Return the claims with the figures of both presets."""
    shown = Table(title="Claims of section 4", show_lines=True)
    for name in ("claim", "where", "paper's preset", "default"):
        shown.add_column(name, ratio=3 if name != "where" else 1)
    shown.add_column("verdict", min_width=9)
    for claim in claims:
        verdict = f"[{_COLOURS[claim.verdict]}]{claim.verdict}[/]"
        shown.add_row(claim.claim, claim.where, claim.paper, claim.default, verdict)
    return shown
