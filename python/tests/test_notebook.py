"""The notebook of the manual runs, and is committed with the outputs of this run.

``QUADLIFT_UPDATE_DOCS=1 scripts/test_python.sh python/tests/test_notebook.py`` writes them.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import nbclient
import nbformat

from conftest import ROOT, page_data

NOTEBOOKS = sorted((ROOT / "docs").glob("*.ipynb"))
TUTORIAL = ROOT / "docs/tutorial-python.ipynb"


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


def without_pages(notebook: Any) -> Any:
    """The notebook without the embedded pages, which are large and are not shown on GitHub, and without times."""
    for cell in notebook.cells:
        cell.metadata = {}
        for output in cell.get("outputs", []):
            if "<iframe srcdoc=" in output.get("data", {}).get("text/html", ""):
                del output.data["text/html"]
    notebook.metadata.language_info = {"name": "python"}
    return notebook


def texts(notebook: Any) -> list[list[Any]]:
    """What cells print and show, and where there is a picture."""

    def shown(output: Any) -> Any:
        data = output.get("data", {})
        return output.get("text"), data.get("text/plain"), data.get("text/html"), "image/png" in data

    return [[shown(output) for output in cell.get("outputs", [])] for cell in notebook.cells]


def test_there_is_one() -> None:
    assert NOTEBOOKS == [TUTORIAL]


def test_it_is_valid_and_small() -> None:
    notebook = read(TUTORIAL)
    nbformat.validate(notebook)
    # Nothing of the machine on which it was written.
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert "/work/" not in TUTORIAL.read_text()
    assert TUTORIAL.stat().st_size < 200_000


def test_links_lead_somewhere() -> None:
    text = "".join(c.source for c in read(TUTORIAL).cells if c.cell_type == "markdown")
    links = [part.split(")")[0] for part in text.split("](")[1:]]
    assert links
    assert all((TUTORIAL.parent / link).is_file() for link in links), links


def test_tutorial(tmp_path: Path) -> None:
    shutil.copy(TUTORIAL, tmp_path)
    shutil.copytree(ROOT / "docs/data/tutorial-python", tmp_path / "data/tutorial-python")
    notebook = read(tmp_path / "tutorial-python.ipynb")
    # A cell that raises, as its asserts do, fails here.
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output.data for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    assert sum("image/png" in data for data in shown) == 2
    assert sum("<iframe srcdoc=" in data.get("text/html", "") for data in shown) == 2
    assert len(page_data(tmp_path / "objects.html")["scores"]["rows"]) == 20
    executed = without_pages(notebook)
    if os.environ.get("QUADLIFT_UPDATE_DOCS"):
        nbformat.write(executed, TUTORIAL)  # type: ignore[no-untyped-call]
    assert texts(executed) == texts(read(TUTORIAL)), "the outputs are those of another version"
