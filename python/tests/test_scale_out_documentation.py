"""The recipes of docs/scale-out.md run as shown, and give the same answers."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pytest

from conftest import ROOT, Program
from fleet import assert_same, count_ok, made_fleet
from quadlift import batches

pytestmark = pytest.mark.scale_out


def recipes() -> dict[str, str]:
    """The code under each heading."""
    code: dict[str, str] = {}
    heading = ""
    text = (ROOT / "docs/scale-out.md").read_text()
    for found in re.finditer(r"^#+ ([^\n]*)$|^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        heading = found[1] or heading
        # What is under smaller headings goes on from the code above it.
        name = "Spark" if heading.startswith("Noise levels") else heading
        code[name] = code.get(name, "") + (found[2] or "")
    return {name: text for name, text in code.items() if text}


@pytest.mark.parametrize("engine", ["Spark", "Ray Data", "Daft"])
def test_recipe(program: Program, engine: str, tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    fleet = made_fleet(program, tmp_path)
    pq.write_table(fleet.shuffled(), tmp_path / "detections.parquet", row_group_size=50)
    pq.write_table(fleet.cameras, tmp_path / "cameras.parquet")
    done = subprocess.run(
        [sys.executable, "-c", recipes()[engine]],
        cwd=tmp_path,
        env={**os.environ, "PYSPARK_PYTHON": sys.executable},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    frames = batches.with_occluded_edges(batches.group(fleet.detections, ["scene", "frame"]))
    rows = batches.group(batches.ungroup(frames), ["scene", "object"])
    noise_model, body = batches.noise(batches.sample(rows), fleet.cameras)
    expected = batches.localize_objects(rows, fleet.cameras, noise_model=noise_model, body=body)
    parts = [pq.read_table(path) for path in sorted((tmp_path / "objects").glob("*.parquet"))]
    found = pa.concat_tables(parts).select(expected.column_names)
    assert_same(found, expected)
    assert count_ok(found) >= 18


def test_all_recipes_are_tested() -> None:
    assert recipes().keys() == {"Spark", "Ray Data", "Daft"}
