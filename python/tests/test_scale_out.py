"""The recipes of docs/scale-out.md run as shown, and give the same answers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pytest

from conftest import Program
from fleet import assert_same, count_ok, made_fleet, recipes
from quadlift import tables

pytestmark = pytest.mark.scale_out


@pytest.mark.parametrize("engine", ["Spark", "Ray", "Daft"])
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
    rows = tables.occluded_edges(fleet.detections)
    noise_model, body = tables.noise(rows, fleet.cameras)
    expected = tables.localize(rows, fleet.cameras, noise_model=noise_model, body=body)
    parts = [pq.read_table(path) for path in sorted((tmp_path / "objects").glob("*.parquet"))]
    found = pa.concat_tables(parts).select(expected.column_names)
    assert_same(found, expected)
    assert count_ok(found) >= 18
