"""Code blocks of the documentation: those that can run do, page by page, each in an empty folder.

What stands below a comment such as `<!-- not run: takes hours -->` has to be right as far as can be given
without running it.
"""

import contextlib
import io
import re
import shlex
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer.main
import yaml

import auvplan as ap
from auvplan import cli

ROOT = Path(__file__).parent.parent
BLOCK = re.compile(r"^(?:<!-- not run: (.+) -->\n)?```(\w.*?)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
#: For parts of scenarios, which are shown without it.
SOMEWHERE = {"longitude": 0.0, "latitude": 50.0}
#: Pages that tests of their own run.
ELSEWHERE = {"docs/first-plan.md", "docs/bbo.md"}
#: Pages that plan or simulate; the programs of each compile for some seconds.
SLOW = {
    "README.md",
    "docs/clock.md",
    "docs/energy.md",
    "docs/index.md",
    "docs/how-to/cluster.md",
    "docs/how-to/departure.md",
    "docs/how-to/jax.md",
    "docs/how-to/jobs.md",
    "docs/how-to/replan.md",
    "docs/how-to/vehicle.md",
    "docs/paths.md",
}


def pages():
    """Pages that have a block, the slow ones marked."""
    for path in sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]):
        name = path.relative_to(ROOT).as_posix()
        if name not in ELSEWHERE and BLOCK.search(path.read_text(encoding="utf-8")):
            yield pytest.param(name, marks=pytest.mark.slow if name in SLOW else ())


@pytest.mark.parametrize("page", pages())
@pytest.mark.usefixtures("light_search")
def test_blocks_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "__main__"}
    for why_not, info, body in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
        match info.split():
            case ["python"]:
                code = compile(body, page, "exec")
                if not why_not:
                    with contextlib.redirect_stdout(io.StringIO()):
                        exec(code, names)
            case ["sh"]:
                for line in body.replace("\\\n", " ").splitlines():
                    # The front page lists what there is; other pages run it.
                    if why_not or page == "README.md":
                        look_at(line)
                    else:
                        run(line, monkeypatch)
            case [("yaml" | "csv" | "json"), name]:
                Path(name).parent.mkdir(parents=True, exist_ok=True)
                Path(name).write_text(body, encoding="utf-8")
            case ["yaml"]:
                ap.Scenario.model_validate({"site": SOMEWHERE} | yaml.safe_load(body))
            case ["text" | "mermaid"]:
                pass
            case _:
                pytest.fail(f"{page}: a block of another kind: {info}")


def run(line, patch):
    words = shlex.split(line, comments=True)
    assert words[:1] == ["auvplan"], f"only the package's commands run: {line}"
    patch.setattr("sys.argv", words)
    with pytest.raises(SystemExit) as stop, contextlib.redirect_stdout(io.StringIO()):
        cli.main()
    assert stop.value.code in (0, None), line


def look_at(line):
    """Check that what a line calls exists, and that a command takes its options."""
    match shlex.split(line, comments=True):
        case ["auvplan", *words]:
            group = typer.main.get_command(cli.app)
            with group.make_context("auvplan", words, resilient_parsing=True) as context:
                name, command, rest = group.resolve_command(context, words)
                command.make_context(name, rest, parent=context)
        case ["make", target]:
            assert f"\n{target}:" in (ROOT / "Makefile").read_text(encoding="utf-8"), line
        case ["python", "-m", module, *_]:
            assert find_spec(module), line
        case ["pip" | "dask", *_] | []:
            pass
        case _:
            pytest.fail(f"what is this? {line}")


def test_links_lead_somewhere():
    """To files of the repository, from pages and notebooks' pages alike."""
    for path in [*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")]:
        for target in re.findall(r"\]\(([^)#:\s]+)(?:#[^)]*)?\)", path.read_text(encoding="utf-8")):
            if target.startswith(("notebooks/", "../notebooks/", "../contributing", "contributing")):
                made = target.removeprefix("../")
                source = ROOT / (
                    made.replace(".md", ".ipynb") if "/" in made else made.upper().replace(".MD", ".md")
                )
                assert source.is_file(), f"{path}: {target}"
            else:
                assert (path.parent / target).exists(), f"{path}: {target}"


def test_the_gallery_shows_every_notebook():
    page = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8")
    for notebook in (ROOT / "notebooks").glob("*.ipynb"):
        assert f"gallery/{notebook.stem}.png" in page
        assert f"notebooks/{notebook.stem}.md" in page
        assert (ROOT / "docs" / "gallery" / f"{notebook.stem}.png").is_file()
        assert f"](../docs/gallery/{notebook.stem}.png)" in notebook.read_text(encoding="utf-8")
