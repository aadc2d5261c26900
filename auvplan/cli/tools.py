"""Commands that look at charts and results."""

from pathlib import Path
from typing import Annotated

import typer

from auvplan.cli.shared import OutOption, QuietOption, console


def chart(
    image: Annotated[Path, typer.Argument(help="A chart-like picture: PNG, JPEG or GeoTIFF.")],
    out: OutOption = Path("out/chart"),
    pixel_size: Annotated[float, typer.Option(min=1e-3, help="Metres per pixel.")] = 10.0,
    quiet: QuietOption = False,
) -> None:
    """Cluster a picture into coast, uncertain area and water, and draw the result."""
    from auvplan.io import output_folder
    from auvplan.ocean.chart import Chart
    from auvplan.plot import draw_chart

    made = Chart.from_image(image, pixel_size=pixel_size)
    output_folder(out)
    picture = draw_chart(made, image, out)
    if not quiet:
        shares = made.shares()
        console.print(
            f"coast {shares['coast']:.1%}, uncertain {shares['uncertain']:.1%}, water {shares['water']:.1%}",
            highlight=False,
        )
        console.print(f"picture: {picture}", soft_wrap=True)


def check(
    folder: Annotated[Path, typer.Argument(help="Folder of a result.")], quiet: QuietOption = False
) -> None:
    """Check a result independently: walk every sailed metre, re-add every second."""
    from auvplan.io.check import check_run

    report = check_run(folder)
    if not quiet:
        console.print(str(report), highlight=False, soft_wrap=True)
    if not report.ok:
        raise typer.Exit(1)
