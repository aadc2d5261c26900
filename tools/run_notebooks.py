"""Run the notebooks and save what they show, small and without traces of the machine.

`python tools/run_notebooks.py [NOTEBOOK ...]` runs those named, or all of `notebooks/`, in place. The picture
of the cell with the tag "gallery" becomes `docs/gallery/NAME.png`, which the notebook opens with and the
gallery shows.
"""

import argparse
import base64
import io
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
GALLERY = ROOT / "docs" / "gallery"

#: Dots an inch of pictures, and the colours that they are reduced to.
_DPI, _COLOURS = 76, 256

#: Pixels, the greatest width of a picture.
_WIDTH = 860

_SETUP = f"%config InlineBackend.print_figure_kwargs = {{'dpi': {_DPI}, 'bbox_inches': 'tight'}}"


def main() -> None:
    """Run the notebooks that the command line names."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("notebooks", nargs="*", type=Path)
    given = parser.parse_args().notebooks
    for path in given or sorted((ROOT / "notebooks").glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        run(notebook, path.resolve().parent)
        clean(notebook)
        nbformat.write(notebook, path)
        print(f"{path}: {path.stat().st_size / 1e3:,.0f} kB")
        for picture in pictures(notebook, "gallery"):
            GALLERY.mkdir(exist_ok=True)
            (GALLERY / f"{path.stem}.png").write_bytes(picture)


def run(notebook: nbformat.NotebookNode, folder: Path) -> None:
    """Run all cells; the kernel starts in a folder.

    Raises:
        CellExecutionError: a cell fails.
        RuntimeError: a cell writes to standard error, such as a warning.
    """
    client = NotebookClient(notebook, timeout=600, resources={"metadata": {"path": str(folder)}})
    with client.setup_kernel():
        assert client.kc is not None
        client.kc.execute(_SETUP, silent=True)
        for index, cell in enumerate(notebook.cells):
            client.execute_cell(cell, index)
            for output in cell.get("outputs", []):
                if output.get("name") == "stderr":
                    raise RuntimeError(f"cell {index} writes to standard error: {output.text}")


def clean(notebook: nbformat.NotebookNode) -> None:
    """Remove times, identities and versions, and make pictures small."""
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    notebook.metadata = {"kernelspec": kernel, "language_info": {"name": "python"}}
    for index, cell in enumerate(notebook.cells):
        cell.id = f"cell-{index:02d}"
        cell.metadata = {"tags": cell.metadata["tags"]} if "tags" in cell.metadata else {}
        for output in cell.get("outputs", []):
            if png := output.get("data", {}).get("image/png"):
                output.data = {"image/png": base64.b64encode(_small(base64.b64decode(png))).decode()}
                output.metadata = {}


def pictures(notebook: nbformat.NotebookNode, tag: str) -> list[bytes]:
    """Pictures of the cells with a tag, PNG."""
    outputs = (
        output
        for cell in notebook.cells
        if tag in cell.metadata.get("tags", ())
        for output in cell.get("outputs", [])
    )
    found = (output.get("data", {}).get("image/png") for output in outputs)
    return [base64.b64decode(png) for png in found if png]


def _small(png: bytes) -> bytes:
    """Reduce a picture to few colours, and to the width of a page."""
    picture, out = Image.open(io.BytesIO(png)).convert("RGB"), io.BytesIO()
    picture.thumbnail((_WIDTH, 4 * _WIDTH))
    few = picture.quantize(_COLOURS, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE)
    few.save(out, "PNG", optimize=True)
    return out.getvalue()


if __name__ == "__main__":
    main()
