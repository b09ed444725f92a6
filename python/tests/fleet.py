"""Scenes of the program as tables: what the tests of tables share."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

import quadlift
from conftest import ROOT, Program, read_json


@dataclass
class Fleet:
    """Scenes whose objects have the same ids, as files and as tables."""

    files: dict[str, Path]
    detections: pa.Table
    cameras: pa.Table
    up: list[float]

    def shuffled(self) -> pa.Table:
        """The detections in another order."""
        return self.detections.take(pa.array(np.random.default_rng(1).permutation(len(self.detections))))

    def expected(self, **options: Any) -> pa.Table:
        """What `Scene.localize` gives, scene by scene, without what objects of a scene share."""
        found = []
        if options.get("method", "posterior") == "posterior":
            options = {"upright": False, **options}
        for name, path in self.files.items():
            table = quadlift.Scene.read(path).localize(**options).to_arrow()
            found.append(table.add_column(0, "scene", pa.array([name] * len(table))))
        return comparable(pa.concat_tables(found))


def made_fleet(program: Program, folder: Path, count: int = 3) -> Fleet:
    files, detections, cameras = {}, [], []
    up: list[float] = []
    for seed in range(count):
        name, path = f"drive {seed}", folder / f"{seed}.json"
        options = ["--objects", "7", "--views", "11", "--noise", "box:0.04", "--outliers", "0.03", "--cube", "30"]
        program("synth", "-q", "-o", path, *options, "--seed", str(seed))
        document = read_json(path)
        # Without the truth, and with fewer views of some objects than of others.
        del document["objects"]
        document["detections"] = [d for k, d in enumerate(document["detections"]) if (k * 7) % 23 > 3]
        for d in document["detections"]:
            d["category"] = "car" if d["object"] < "object_003" else "bus"
        quadlift.Scene.from_dict(document).write(path)
        files[name], up = path, document["up"]
        of_id = {camera["id"]: camera for camera in document["cameras"]}
        for frame in document["frames"]:
            camera = of_id[frame["camera"]]
            cameras.append(
                {
                    "scene": name,
                    "frame": frame["id"],
                    "intrinsics": camera["params"],
                    "cam_from_world": np.ravel(frame["cam_from_world"]).tolist(),
                    "width": camera["width"],
                    "height": camera["height"],
                }
            )
        for d in document["detections"]:
            box = dict(zip(("x0", "y0", "x1", "y1"), d["box"], strict=True))
            detections.append({"scene": name, **{k: d[k] for k in ("frame", "object", "category")}, **box})
    return Fleet(files, pa.Table.from_pylist(detections), pa.Table.from_pylist(cameras), up)


def comparable(table: pa.Table) -> pa.Table:
    """Sorted by scene and object, without the column that `Estimates` do not have."""
    keys = [name for name in ("scene", "object") if name in table.column_names]
    table = table.drop_columns([name for name in ("problem",) if name in table.column_names])
    return table.sort_by([(key, "ascending") for key in keys]).combine_chunks()


def assert_same(found: pa.Table, expected: pa.Table) -> None:
    """Bit by bit."""
    found, expected = comparable(found), comparable(expected)
    assert found.column_names == expected.column_names
    for name in expected.column_names:
        mine, theirs = found[name].to_pylist(), expected[name].to_pylist()
        assert mine == theirs, name


def statuses(table: pa.Table) -> dict[Any, tuple[str, str | None]]:
    """Status and problem by object."""
    rows = table.select(["object", "status", "problem"]).to_pylist()
    return {row["object"]: (row["status"], row["problem"]) for row in rows}


def count_ok(table: pa.Table) -> int:
    return int(pc.sum(pc.equal(table["status"], "ok")).as_py())


def recipes() -> dict[str, str]:
    """The Python code of docs/scale-out.md by heading."""
    code: dict[str, str] = {}
    heading = ""
    text = (ROOT / "docs/scale-out.md").read_text()
    for found in re.finditer(r"^#+ ([^\n]*)$|^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        heading = found[1] or heading
        code[heading] = code.get(heading, "") + (found[2] or "")
    return {name: text for name, text in code.items() if text}
