"""Inputs of other packages, with the packages themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pycolmap
import pytest
import supervision
from supervision.detection.compact_mask import CompactMask

import quadlift
from conftest import ROOT, Arrays

COLMAP = ROOT / "docs/data/tutorial-colmap-yolo/sparse/0"


@pytest.fixture
def cameras(made: Arrays) -> quadlift.Scene:
    return quadlift.Scene.from_arrays(
        projections=made.projections, image_sizes=(640, 480), frame_ids=[f"images/{k:03}.jpg" for k in range(6)]
    )


def supervised(made: Arrays, frame: int, **more: Any) -> supervision.Detections:
    rows = made.frames == frame
    fields = {
        "xyxy": made.boxes[rows],
        "confidence": np.full(4, 0.5, np.float32),
        "class_id": np.array([0, 0, 1, 1]),
        "tracker_id": made.objects[rows],
        "data": {"class_name": np.array(["cup", "cup", "mug", "mug"])},
    }
    return supervision.Detections(**{**fields, **more})


def test_supervision(made: Arrays, cameras: quadlift.Scene) -> None:
    detections = [supervised(made, k) for k in range(6)]
    scene = quadlift.Scene.from_supervision(detections, cameras)
    expected = quadlift.localize(**made.arguments())
    found = scene.localize()
    np.testing.assert_array_equal(found.centers, expected.centers)
    assert found.object_ids.tolist() == ["t0", "t1", "t2", "t3"]
    assert found.categories == ["cup", "cup", "mug", "mug"]
    # Frames in which nothing was seen; filtered detections; a sequence or a mapping.
    detections[2] = supervision.Detections.empty()
    mugs = detections[3][detections[3].class_id == 1]
    assert isinstance(mugs, supervision.Detections)
    detections[3] = mugs
    assert len(quadlift.Scene.from_supervision(detections, cameras)) == 18
    by_frame = dict(zip(cameras.frame_ids, detections, strict=True))
    assert quadlift.Scene.from_supervision(by_frame, cameras).to_dict()["detections"][-1]["object"] == "t3"


def test_supervision_without_tracks(made: Arrays, cameras: quadlift.Scene) -> None:
    plain = quadlift.Scene.from_supervision([supervised(made, k, tracker_id=None, data={}) for k in range(6)], cameras)
    assert plain.object_ids == []
    assert {d["category"] for d in plain.to_dict()["detections"]} == {"0", "1"}
    # Trackers give -1 to what has no track yet: that is no object.
    young = [supervised(made, k, tracker_id=np.array([7, -1, -1, 8])) for k in range(6)]
    assert quadlift.Scene.from_supervision(young, cameras).object_ids == ["t7", "t8"]


def test_supervision_with_masks(made: Arrays, cameras: quadlift.Scene) -> None:
    masks = np.zeros((4, 480, 640), bool)
    edges = made.boxes[made.frames == 0].round().astype(int)
    for mask, (x0, y0, x1, y1) in zip(masks, edges, strict=True):
        mask[y0:y1, x0:x1] = True
    compact = CompactMask.from_dense(masks, edges.astype(float), (480, 640))
    written = [
        quadlift.Scene.from_supervision({cameras.frame_ids[0]: supervised(made, 0, mask=mask)}, cameras).to_dict()
        for mask in (masks, compact)
    ]
    assert written[0] == written[1]
    rle = written[0]["detections"][1]["mask"]["rle"]
    assert sum(rle["counts"][1::2]) == masks[1].sum()
    assert rle["counts"][0] == edges[1][0] * 480 + edges[1][1]


def reconstruction() -> pycolmap.Reconstruction:
    """The tutorial's photographs, with a lens that distorts, as pycolmap holds them."""
    made = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="OPENCV",
        width=1440,
        height=1080,
        params=[1100.0, 1090.0, 715.0, 545.0, -0.05, 0.01, 0.001, -0.002],
        camera_id=3,
    )
    made.add_camera_with_trivial_rig(camera)
    # Every second line has the points of the image before it.
    lines = [line for line in (COLMAP / "images.txt").read_text().splitlines() if not line.startswith("#")]
    for line in lines[::2]:
        number, qw, qx, qy, qz, *translation, _, name = line.split()
        rotation = pycolmap.Rotation3d(np.array([float(q) for q in (qx, qy, qz, qw)]))
        pose = pycolmap.Rigid3d(rotation, np.array([float(t) for t in translation]))
        image = pycolmap.Image(name=name, camera_id=3, image_id=int(number))
        made.add_image_with_trivial_frame(image, pose)
    return made


def test_colmap() -> None:
    made = reconstruction()
    scene = quadlift.Scene.from_cameras(made)
    document = scene.to_dict()
    assert document["cameras"][0]["model"] == "OPENCV"
    np.testing.assert_array_equal(document["cameras"][0]["params"], made.cameras[3].params)
    assert len(document["frames"]) == made.num_reg_images() == 24
    for frame, image in zip(document["frames"], (made.images[k] for k in sorted(made.images)), strict=True):
        assert frame["id"] == image.name
        np.testing.assert_allclose(frame["cam_from_world"], image.cam_from_world().matrix(), atol=1e-12)
    labels = COLMAP.parents[1] / "labels"
    estimates = quadlift.Scene.from_detections(labels, scene).localize()
    assert estimates.ok.any()


def test_colmap_folders(tmp_path: Path) -> None:
    made = reconstruction()
    for write in (made.write_text, made.write_binary):
        write(tmp_path)
        cameras = quadlift.Scene.from_cameras(tmp_path)
        assert cameras.to_dict()["frames"] == quadlift.Scene.from_cameras(made).to_dict()["frames"]
        for path in tmp_path.iterdir():
            path.unlink()


def frame_of(made: Arrays) -> pd.DataFrame:
    """A table as people have it: numbers, texts and gaps, in any order."""
    table = pd.DataFrame(made.boxes, columns=["x0", "y0", "x1", "y1"])
    table["frame"], table["object"], table["score"], table["label"] = made.frames, made.objects, 0.5, "cup"
    return table.sample(frac=1.0, random_state=0)


@pytest.mark.parametrize("kind", ["numpy", "nullable", "arrow"])
def test_columns_of_pandas(made: Arrays, kind: str) -> None:
    table = frame_of(made)
    if kind == "nullable":
        table = table.convert_dtypes()
    if kind == "arrow":
        table = table.convert_dtypes(dtype_backend="pyarrow")
    cameras: dict[str, Any] = {"projections": made.projections, "image_sizes": (640, 480)}

    def localized(table: pd.DataFrame) -> quadlift.Estimates:
        return quadlift.localize(
            **cameras,
            frames=table["frame"],
            boxes=table[["x0", "y0", "x1", "y1"]],
            objects=table["object"],
            scores=table["score"],
            categories=table["label"],
        )

    found = localized(table)
    assert found.object_ids.tolist() == [0, 1, 2, 3]
    np.testing.assert_allclose(found.centers, quadlift.localize(**made.arguments()).centers, atol=1e-6)
    # The rows of the table, in their order.
    assert (found.object_indices == table["object"]).all()
    # Names and categories instead of numbers, and gaps.
    named = table.assign(object=table["object"].map({0: "a", 1: "b", 2: "c", 3: "d"}).astype("category"))
    assert localized(named).object_ids.tolist() == ["a", "b", "c", "d"]
    gaps = table.assign(score=table["score"].where(table["object"] > 0))
    gaps["label"] = gaps["label"].where(gaps["object"] > 0)
    assert localized(gaps).categories == [None, "cup", "cup", "cup"]
    with pytest.raises(quadlift.QuadliftError, match=r"boxes has the dtype object; expected real numbers"):
        localized(table.assign(x0="left"))


def test_columns_of_arrow(made: Arrays) -> None:
    table = pa.Table.from_pandas(frame_of(made), preserve_index=False)
    found = quadlift.localize(
        projections=made.projections,
        image_sizes=(640, 480),
        frames=table["frame"],
        boxes=np.column_stack([table[name] for name in ("x0", "y0", "x1", "y1")]),
        objects=table["object"],
        scores=table["score"],
        categories=table["label"],
    )
    np.testing.assert_allclose(found.centers, quadlift.localize(**made.arguments()).centers, atol=1e-6)


def test_a_tensor_that_cannot_be_read(made: Arrays) -> None:
    class Tensor:
        """As one of torch that takes part in a gradient."""

        def __array__(self, dtype: Any = None, copy: Any = None) -> Any:
            raise RuntimeError("Can't call numpy() on Tensor that requires grad. Use tensor.detach().numpy() instead.")

    with pytest.raises(quadlift.QuadliftError, match=r"boxes is not an array: .*tensor\.detach\(\)"):
        quadlift.localize(**{**made.arguments(), "boxes": Tensor()})
