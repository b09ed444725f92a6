"""The notebook of the manual runs, and is committed without outputs."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import nbclient
import nbformat
import pytest

from conftest import ROOT, page_data

NOTEBOOKS = sorted((ROOT / "docs").glob("*.ipynb"))


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]


def test_there_is_one() -> None:
    assert [path.name for path in NOTEBOOKS] == ["tutorial-python.ipynb"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_outputs_are_stripped(path: Path) -> None:
    notebook = read(path)
    nbformat.validate(notebook)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            assert cell.outputs == [], cell.id
            assert cell.execution_count is None, cell.id
    # Nothing of the machine on which it was written.
    assert set(notebook.metadata) == {"kernelspec", "language_info"}
    assert path.stat().st_size < 40_000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_links_lead_somewhere(path: Path) -> None:
    text = "".join(c.source for c in read(path).cells if c.cell_type == "markdown")
    links = [part.split(")")[0] for part in text.split("](")[1:]]
    assert links
    assert all((path.parent / link).is_file() for link in links), links


def test_tutorial(tmp_path: Path) -> None:
    shutil.copy(ROOT / "docs/tutorial-python.ipynb", tmp_path)
    shutil.copytree(ROOT / "docs/data/tutorial-python", tmp_path / "data/tutorial-python")
    notebook = read(tmp_path / "tutorial-python.ipynb")
    # A cell that raises, as its asserts do, fails here.
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    shown = [output.data for cell in notebook.cells for output in cell.get("outputs", []) if "data" in output]
    assert sum("image/png" in data for data in shown) == 2
    assert sum("<iframe srcdoc=" in data.get("text/html", "") for data in shown) == 2
    assert len(page_data(tmp_path / "objects.html")["scores"]["rows"]) == 20
