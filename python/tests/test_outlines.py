"""Outlines and oriented boxes as arrays and tables: the same as in scene files, errors by row."""

from __future__ import annotations

import types
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest
import supervision

import quadlift
from conftest import Program, read_json
from quadlift import tables

SHAPES = ("outlines", "oriented_boxes")


class Shaped:
    """A scene with an outline, an oriented box, or an outline beside a box, in turn: as a document and as arrays."""

    def __init__(self, document: dict[str, Any]) -> None:
        self.document = document
        detections = document["detections"]
        for k, detection in enumerate(detections):
            for name in (("box", "oriented_box"), ("box", "outline"), ("oriented_box",))[k % 3]:
                del detection[name]
        fx, fy, cx, cy = document["cameras"][0]["params"]
        frames = document["frames"]
        self.frames: dict[str, Any] = {
            "intrinsics": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            "cam_from_world": np.array([frame["cam_from_world"] for frame in frames]),
            "image_sizes": [document["cameras"][0][side] for side in ("width", "height")],
            "up": document["up"],
        }
        place = {frame["id"]: k for k, frame in enumerate(frames)}
        none = [np.nan] * 4
        self.found: dict[str, Any] = {
            "frames": [place[d["frame"]] for d in detections],
            "objects": [d["object"] for d in detections],
            "boxes": [d.get("box", none) for d in detections],
            "outlines": [d.get("outline") for d in detections],
            "oriented_boxes": [numbers(d.get("oriented_box")) for d in detections],
        }

    def table(self) -> Any:
        """The detections with the columns of `docs/scale-out.md`."""
        turned = np.array(self.found["oriented_boxes"])
        boxes = np.array(self.found["boxes"])
        flat = [None if corners is None else np.ravel(corners).tolist() for corners in self.found["outlines"]]
        columns = {name: pa.array(boxes[:, k], from_pandas=True) for k, name in enumerate(("x0", "y0", "x1", "y1"))}
        for k, name in enumerate(("x", "y", "width", "height", "angle")):
            columns[f"oriented_box_{name}"] = pa.array(turned[:, k], from_pandas=True)
        frame, object_ids = pa.array(self.found["frames"]), pa.array(self.found["objects"])
        outline = pa.array(flat, pa.list_(pa.float64()))
        return pa.table({"frame": frame, "object": object_ids, **columns, "outline": outline})

    def cameras(self) -> Any:
        poses = self.frames["cam_from_world"]
        projections = np.array(self.frames["intrinsics"]) @ poses
        width, height = self.frames["image_sizes"]
        return pa.table(
            {
                "frame": np.arange(len(poses)),
                "projection": pa.array(projections.reshape(-1, 12).tolist()),
                "width": [float(width)] * len(poses),
                "height": [float(height)] * len(poses),
            }
        )


def numbers(turned: dict[str, Any] | None) -> list[float]:
    return [np.nan] * 5 if turned is None else [*turned["center"], *turned["size"], turned["angle"]]


@pytest.fixture(scope="module")
def shaped(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Shaped:
    path = tmp_path_factory.mktemp("outlines") / "scene.json"
    # Crowded, so that outlines touch each other.
    options = ["--objects", "20", "--views", "5", "--noise", "box:0.03", "--cube", "12", "--seed", "4"]
    program("synth", "-q", "-o", path, *options, "--cues", "outline,oriented_box")
    return Shaped(read_json(path))


def test_arrays_give_what_the_file_gives(shaped: Shaped) -> None:
    of_file = quadlift.Scene.from_dict(shaped.document).localize()
    of_arrays = quadlift.localize(**shaped.frames, **shaped.found)
    rows = [list(of_file.object_ids).index(name) for name in of_arrays.object_ids]
    np.testing.assert_array_equal(of_arrays.centers, of_file.centers[rows])
    np.testing.assert_array_equal(of_arrays.covariances, of_file.covariances[rows])
    # Boxes around them tell less.
    around = [d.get("box") for d in quadlift.Scene.from_dict(shaped.document).to_dict()["detections"]]
    assert around.count(None) == 67
    boxes = quadlift.localize(**shaped.frames, **shaped.found, measurement="box")
    assert np.nanmax(np.abs(boxes.half_extents - of_arrays.half_extents)) > 0.05


def test_scenes_keep_them(shaped: Shaped, tmp_path: Path) -> None:
    scene = quadlift.Scene.from_arrays(**shaped.frames, frame_ids=[f["id"] for f in shaped.document["frames"]])
    scene = scene.with_detections(**shaped.found)
    scene.write(tmp_path / "scene.json")
    for found in (scene.to_dict(), read_json(tmp_path / "scene.json")):
        for detection, expected in zip(found["detections"], shaped.document["detections"], strict=True):
            assert {k: detection.get(k) for k in ("box", *SHAPES)} == {k: expected.get(k) for k in ("box", *SHAPES)}
    again = quadlift.Scene.read(tmp_path / "scene.json").localize()
    np.testing.assert_array_equal(again.centers, scene.localize().centers)


def test_tables_give_what_arrays_give(shaped: Shaped) -> None:
    table, cameras = shaped.table(), shaped.cameras()
    # The projections of the table, to the last bit.
    projections = np.array(cameras.column("projection").to_pylist()).reshape(-1, 3, 4)
    frames = {"projections": projections, **{name: shaped.frames[name] for name in ("image_sizes", "up")}}
    noise_model = quadlift.localize(**frames, **shaped.found, body="ellipsoid").noise
    expected = quadlift.localize(**frames, **shaped.found, body="ellipsoid", noise_model=noise_model, upright=False)
    options: dict[str, Any] = {"up": shaped.frames["up"], "body": "ellipsoid", "noise_model": noise_model}
    rows = tables.occluded_edges(table)
    assert 0 < np.count_nonzero(rows["occluded_lines"]) < len(table)
    some = rows.filter(pc.is_in(rows["object"], pc.unique(rows["object"]).slice(3, 5)))
    for part in (rows, some):
        found = tables.localize(part, cameras, **options)
        ids = found["object"].to_pylist()
        at = [list(expected.object_ids).index(name) for name in ids]
        assert found["problem"].to_pylist() == [None] * len(ids)
        np.testing.assert_array_equal(np.array(found["center"].to_pylist()), expected.centers[at])
        np.testing.assert_array_equal(
            np.array(found["covariance"].to_pylist()), expected.covariances[at].reshape(len(ids), 81)
        )
    # A whole scene, in any order of its detections.
    shuffled = table.take(pa.array(np.random.default_rng(0).permutation(len(table))))
    found, again = (tables.localize(rows.drop_columns("object"), cameras) for rows in (table, shuffled))
    assert found.num_rows >= 15
    assert found.equals(again)


def test_scenes_give_their_tables(shaped: Shaped) -> None:
    found, frames = quadlift.Scene.from_dict(shaped.document).to_arrow()
    expected = shaped.table()
    for name in expected.column_names:
        if name != "frame":
            assert found[name].to_pylist() == expected[name].to_pylist(), name
    assert len(frames) == len(shaped.document["frames"])
    assert frames["params"].to_pylist() == frames["intrinsics"].to_pylist()


def test_wrong_columns_are_named(shaped: Shaped) -> None:
    table = shaped.table()
    with pytest.raises(quadlift.QuadliftError, match="there is no column 'oriented_box_angle'; expected all of"):
        tables.localize(table.drop_columns("oriented_box_angle"), shaped.cameras(), method="planes")
    odd = pa.array([[1.0, 2.0, 3.0]] * len(table), pa.list_(pa.float64()))
    without = table.drop_columns("outline")
    with pytest.raises(quadlift.QuadliftError, match="outline has a list of 3 numbers; expected x and y of each"):
        tables.localize(without.append_column("outline", odd), shaped.cameras(), method="planes")
    flat = pa.array([[1.0, 2.0, 3.0, 4.0]] * len(table), pa.list_(pa.float64()))
    found = tables.localize(without.append_column("outline", flat), shaped.cameras(), method="planes")
    assert set(found["status"].to_pylist()) == {"invalid"}
    assert all("the outline has 2 points" in text for text in found["problem"].to_pylist())


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"outlines": [None]}, r"outlines has the shape \(1,\); expected \(100,\), as many rows as frames"),
        ({"outlines": "abc"}, "outlines is a str; expected a sequence of"),
        ({"outlines": [[[1.0, 2.0, 3.0]]] * 100}, r"outlines\[0\] has the shape \(1, 3\)"),
        ({"outlines": [[[1.0, 2.0], [3.0, 4.0]]] * 100}, r"outlines\[0\]: the outline has 2 points; expected three"),
        ({"oriented_boxes": np.zeros((100, 4))}, r"oriented_boxes has the shape \(100, 4\)"),
        ({"oriented_boxes": np.ones((99, 5))}, r"oriented_boxes has the shape \(99, 5\); expected \(100, 5\)"),
        ({"oriented_boxes": np.zeros((100, 5))}, r"oriented_boxes\[0\]: the size of the oriented box is 0 x 0"),
        (
            {"outlines": [None] * 100, "oriented_boxes": np.full((100, 5), np.nan), "boxes": np.full((100, 4), np.nan)},
            "row 0 has neither a box nor an ellipse nor an outline nor an oriented box",
        ),
    ],
)
def test_wrong_arguments_are_named(shaped: Shaped, changed: dict[str, Any], message: str) -> None:
    with pytest.raises(quadlift.QuadliftError, match=message):
        quadlift.localize(**shaped.frames, **{**shaped.found, **changed})


def test_the_object_map_keeps_them(shaped: Shaped, tmp_path: Path) -> None:
    scene_map = quadlift.ObjectMap()
    for k, pose in enumerate(shaped.frames["cam_from_world"]):
        of_frame = [row for row, frame in enumerate(shaped.found["frames"]) if frame == k]
        arguments: dict[str, Any] = {
            name: [shaped.found[name][row] for row in of_frame] for name in ("boxes", *SHAPES, "objects")
        }
        intrinsics, size = shaped.frames["intrinsics"], shaped.frames["image_sizes"]
        scene_map.observe(k, time=k, intrinsics=intrinsics, cam_from_world=pose, image_size=size, **arguments)
    kept = scene_map.to_scene().to_dict()["detections"]
    assert sum("outline" in d for d in kept) > 30
    assert sum("oriented_box" in d for d in kept) > 15
    assert all(("box" in d) == ("outline" in d and "oriented_box" not in d and "box" in d) for d in kept)
    # Without boxes at all.
    other = quadlift.ObjectMap()
    update = other.observe(
        "a",
        time=0,
        intrinsics=shaped.frames["intrinsics"],
        cam_from_world=shaped.frames["cam_from_world"][0],
        oriented_boxes=[[100.0, 80.0, 40.0, 20.0, 0.3]],
    )
    assert len(update.objects) == 1


def result(**fields: Any) -> Any:
    return types.SimpleNamespace(names={0: "mug"}, path="a.jpg", **fields)


def test_ultralytics_gives_outlines_and_oriented_boxes(shaped: Shaped) -> None:
    cameras = quadlift.Scene.from_arrays(
        **{**shaped.frames, "cam_from_world": shaped.frames["cam_from_world"][:1]}, frame_ids=["a.jpg"]
    )
    of_boxes = types.SimpleNamespace(
        xyxy=np.array([[1.0, 2.0, 31.0, 42.0]] * 2), cls=np.zeros(2), conf=np.ones(2), id=np.array([3, 4])
    )
    polygon = np.array([[1.0, 2.0], [31.0, 12.0], [20.0, 42.0]], dtype=np.float32)
    masks = types.SimpleNamespace(xy=[polygon, np.zeros((0, 2))])
    scene = quadlift.Scene.from_ultralytics([result(boxes=of_boxes, masks=masks, obb=None)], cameras)
    first, second = scene.to_dict()["detections"]
    assert (first["outline"], first["box"]) == (polygon.tolist(), [1.0, 2.0, 31.0, 42.0])
    assert "outline" not in second
    turned = types.SimpleNamespace(
        xywhr=np.array([[50.0, 60.0, 40.0, 20.0, 0.5]]), cls=np.zeros(1), conf=np.ones(1), id=None
    )
    scene = quadlift.Scene.from_ultralytics([result(boxes=None, masks=None, obb=turned)], cameras)
    (detection,) = scene.to_dict()["detections"]
    assert detection["oriented_box"] == {"center": [50.0, 60.0], "size": [40.0, 20.0], "angle": 0.5}
    assert "box" not in detection
    with pytest.raises(quadlift.QuadliftError, match="has no boxes; expected those of detection, segmentation, OBB"):
        quadlift.Scene.from_ultralytics([result(boxes=None, masks=None, obb=None)], cameras)


def test_supervision_gives_oriented_boxes(shaped: Shaped) -> None:
    cameras = quadlift.Scene.from_arrays(
        **{**shaped.frames, "cam_from_world": shaped.frames["cam_from_world"][:1]}, frame_ids=["a"]
    )
    cos, sin = np.cos(0.4), np.sin(0.4)
    along, across = np.array([cos, sin]) * 20.0, np.array([-sin, cos]) * 10.0
    center = np.array([50.0, 60.0])
    corners = np.array(
        [center - along - across, center + along - across, center + along + across, center - along + across]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)
    found = supervision.Detections(
        xyxy=np.array([[*low, *high]]), class_id=np.array([0]), data={"xyxyxyxy": corners[np.newaxis]}
    )
    (detection,) = quadlift.Scene.from_supervision([found], cameras).to_dict()["detections"]
    turned = detection["oriented_box"]
    np.testing.assert_allclose([*turned["center"], *turned["size"], turned["angle"]], [50.0, 60.0, 40.0, 20.0, 0.4])
    assert "box" not in detection
