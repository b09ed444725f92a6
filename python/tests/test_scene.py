"""Files, and what other packages give."""

from __future__ import annotations

import json
import pickle
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import quadlift
from conftest import ROOT, Arrays, made_scene
from quadlift._fiftyone import euler_angles

COLMAP = ROOT / "docs/data/tutorial-colmap-yolo"


@pytest.fixture
def cameras(made: Arrays) -> quadlift.Scene:
    return quadlift.Scene.from_arrays(
        projections=made.projections, image_sizes=(640, 480), frame_ids=[f"images/{k:03}.jpg" for k in range(6)]
    )


def test_arrays_survive_the_file(made: Arrays, cameras: quadlift.Scene, tmp_path: Path) -> None:
    names = np.array(["a", "b", "", "d"], dtype=object)[made.objects]
    scene = cameras.with_detections(
        frames=made.frames,
        boxes=made.boxes,
        objects=names,
        scores=np.linspace(0, 1, 24),
        categories=["cup"] * 24,
        source="y",
    )
    scene.write(tmp_path / "scene.json")
    back = quadlift.Scene.read(tmp_path / "scene.json")
    assert back.to_dict() == scene.to_dict()
    assert quadlift.Scene.from_dict(scene.to_dict()).to_dict() == scene.to_dict()
    assert (len(back), back.object_ids, back.frame_ids[1]) == (24, ["a", "b", "d"], "images/001.jpg")
    first, third = scene.to_dict()["detections"][0], scene.to_dict()["detections"][2]
    assert first == {
        "frame": "images/000.jpg",
        "object": "a",
        "category": "cup",
        "source": "y",
        "score": 0.0,
        "box": made.boxes[0].tolist(),
    }
    assert "object" not in third
    # The scene that was extended is as it was.
    assert len(cameras) == 0
    assert repr(back) == "<quadlift.Scene: 6 frames, 24 detections, 0 objects>"


def test_pages(made: Arrays, cameras: quadlift.Scene, tmp_path: Path) -> None:
    scene = cameras.with_detections(frames=made.frames, boxes=made.boxes, objects=made.objects)
    estimates = scene.localize()
    scene.report(tmp_path / "scene.html")
    estimates.report(tmp_path / "estimates.html", title="Cups <&>")
    for name in ("scene.html", "estimates.html"):
        assert "report-data" in (tmp_path / name).read_text()
    cell = estimates._repr_html_()
    assert cell.startswith("<iframe srcdoc=")
    assert cell.count('"') == 8 + cell.split("srcdoc=")[0].count('"')
    assert "<script" not in cell


def detections_of(made: Arrays, frame: int, **more: Any) -> Any:
    rows = made.frames == frame
    count = int(rows.sum())
    fields = {
        "xyxy": made.boxes[rows],
        "mask": None,
        "confidence": np.full(count, 0.5, np.float32),
        "class_id": np.zeros(count, int),
        "tracker_id": made.objects[rows],
        "data": {"class_name": np.array(["cup"] * count)},
    }
    return SimpleNamespace(**{**fields, **more})


def test_supervision(made: Arrays, cameras: quadlift.Scene) -> None:
    detections = [detections_of(made, k) for k in range(6)]
    scene = quadlift.Scene.from_supervision(detections, cameras)
    assert scene.object_ids == ["t0", "t1", "t2", "t3"]
    assert {d["category"] for d in scene.to_dict()["detections"]} == {"cup"}
    expected = quadlift.localize(**made.arguments())
    np.testing.assert_array_equal(scene.localize().centers, expected.centers)
    by_name = dict(zip(cameras.frame_ids[:4], detections, strict=False))
    assert len(quadlift.Scene.from_supervision(by_name, cameras)) == 16
    # Empty frames, no tracks, no classes, masks.
    empty = detections_of(made, 99, tracker_id=None, class_id=None, data={}, confidence=None)
    assert len(quadlift.Scene.from_supervision([empty] * 6, cameras)) == 0
    plain = detections_of(made, 0, tracker_id=None, data={}, mask=np.ones((4, 480, 640), bool))
    found = quadlift.Scene.from_supervision({cameras.frame_ids[0]: plain}, cameras).to_dict()["detections"]
    assert found[0]["category"] == "0"
    assert found[0]["mask"]["rle"] == {"size": [480, 640], "counts": [0, 480 * 640]}
    with pytest.raises(quadlift.QuadliftError, match="there are 2 detections; expected 6"):
        quadlift.Scene.from_supervision(detections[:2], cameras)
    turned = detections_of(made, 0, xyxy=made.boxes[made.frames == 0][:, :3])
    with pytest.raises(quadlift.QuadliftError, match=r'xyxy of frame "images/000\.jpg" has the shape \(4, 3\); exp'):
        quadlift.Scene.from_supervision({cameras.frame_ids[0]: turned}, cameras)
    with pytest.raises(quadlift.QuadliftError, match='unknown frame "x"'):
        quadlift.Scene.from_supervision({"x": plain}, cameras)


def test_fiftyone(made: Arrays, cameras: quadlift.Scene) -> None:
    """With stand-ins for `fiftyone.Sample` and its labels: the package brings a database."""

    class Sample(SimpleNamespace):
        def __getitem__(self, field: str) -> Any:
            return getattr(self, field)

    def sample(frame: int, **more: Any) -> Sample:
        rows = made.frames == frame
        shares = made.boxes[rows] / [640, 480, 640, 480]
        shares[:, 2:] -= shares[:, :2]
        labels = [
            SimpleNamespace(label="cup", bounding_box=share.tolist(), confidence=0.5, index=int(number))
            for share, number in zip(shares, made.objects[rows], strict=True)
        ]
        fields = {"filepath": f"/data/{frame:03}.jpg", "metadata": None, "yolo": SimpleNamespace(detections=labels)}
        return Sample(**{**fields, **more})

    samples = [sample(k) for k in reversed(range(6))]
    scene = quadlift.Scene.from_fiftyone(iter(samples), cameras, field="yolo")
    estimates = scene.localize()
    expected = quadlift.localize(**made.arguments())
    order = np.argsort(estimates.object_ids)
    np.testing.assert_allclose(estimates.centers[order], expected.centers, atol=1e-9)
    assert estimates.categories == ["cup"] * 4
    assert scene.to_dict()["detections"][0]["score"] == 0.5
    # What a sample lacks.
    empty = quadlift.Scene.from_fiftyone([sample(0, yolo=None)], cameras, field="yolo")
    assert len(empty) == 0
    half = sample(0, metadata=SimpleNamespace(width=320, height=240))
    boxes = quadlift.Scene.from_fiftyone([half], cameras, field="yolo").to_dict()["detections"]
    np.testing.assert_allclose([d["box"] for d in boxes], made.boxes[made.frames == 0] / 2)
    with pytest.raises(quadlift.QuadliftError, match='has no field "predictions"'):
        quadlift.Scene.from_fiftyone([sample(0)], cameras)
    with pytest.raises(quadlift.QuadliftError, match=r"expected a fiftyone\.Sample"):
        quadlift.Scene.from_fiftyone([1], cameras)
    solid = SimpleNamespace(label="cup", bounding_box=[], confidence=None, index=None)
    with pytest.raises(quadlift.QuadliftError, match=r'yolo.detections\[0\] has no "bounding_box"'):
        quadlift.Scene.from_fiftyone([sample(0, yolo=SimpleNamespace(detections=[solid]))], cameras, field="yolo")


def test_objects_for_fiftyone(made: Arrays, monkeypatch: pytest.MonkeyPatch) -> None:
    package = SimpleNamespace(
        Detection=lambda **fields: SimpleNamespace(**fields), Detections=lambda detections: detections
    )
    monkeypatch.setitem(sys.modules, "fiftyone", package)
    estimates = quadlift.localize(**made.arguments())
    found = estimates.to_fiftyone()
    assert [one.object_id for one in found] == ["0", "1", "2", "3"]
    for row, one in enumerate(found):
        assert (one.label, one.status, one.views_used) == ("object", "ok", 6)
        np.testing.assert_array_equal(one.location, estimates.centers[row])
        np.testing.assert_array_equal(one.dimensions, 2 * estimates.half_extents[row])
        x, y, z = (rotation_about(axis, angle) for axis, angle in enumerate(one.rotation))
        np.testing.assert_allclose(x @ y @ z, estimates.rotations[row], atol=1e-12)
    monkeypatch.setitem(sys.modules, "fiftyone", None)
    with pytest.raises(ImportError, match="pip install fiftyone"):
        estimates.to_fiftyone()


def test_angles_about_the_axes() -> None:
    angles = np.array([[0.1, -0.7, 2.0], [3.0, 1.5, -3.0], [0.4, np.pi / 2, 0.3], [0.4, -np.pi / 2, 0.3]])

    def matrices(angles: Any) -> Any:
        return np.array([rotation_about(0, x) @ rotation_about(1, y) @ rotation_about(2, z) for x, y, z in angles])

    found = euler_angles(matrices(angles))
    np.testing.assert_allclose(found[:2], angles[:2], atol=1e-12)
    np.testing.assert_allclose(matrices(found), matrices(angles), atol=1e-12)


def rotation_about(axis: int, angle: float) -> Any:
    """The rotation about x, y or z."""
    turned = np.zeros((3, 3))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    turned[axis, axis] = 1.0
    turned[a, a] = turned[b, b] = np.cos(angle)
    turned[a, b], turned[b, a] = -np.sin(angle), np.sin(angle)
    return turned


def test_ultralytics(made: Arrays, cameras: quadlift.Scene) -> None:
    def result(frame: int, path: str) -> Any:
        rows = made.frames == frame
        boxes = SimpleNamespace(
            xyxy=made.boxes[rows], conf=np.full(4, 0.9), cls=np.zeros(4), id=made.objects[rows].astype(float)
        )
        return SimpleNamespace(path=path, names={0: "cup"}, boxes=boxes)

    # In any order: the names of the files tell which frame it is.
    results = [result(k, f"/data/{k:03}.png") for k in reversed(range(6))]
    scene = quadlift.Scene.from_ultralytics(results, cameras)
    assert sorted(scene.object_ids) == ["t0", "t1", "t2", "t3"]
    assert scene.to_dict()["detections"][0]["frame"] == "images/005.jpg"
    # A stream, and frames that are named.
    stream = quadlift.Scene.from_ultralytics((result(k, f"{k:03}.png") for k in reversed(range(6))), cameras)
    assert stream.to_dict() == scene.to_dict()
    named = quadlift.Scene.from_ultralytics([result(0, "9.jpg")], cameras, frame_ids=["images/003.jpg"], source="v11")
    assert {(d["frame"], d["source"]) for d in named.to_dict()["detections"]} == {("images/003.jpg", "v11")}
    with pytest.raises(quadlift.QuadliftError, match=r"no single frame has the name of the image 9\.jpg"):
        quadlift.Scene.from_ultralytics([result(0, "9.jpg")], cameras)
    # Structure from motion seldom registers all images.
    with pytest.warns(UserWarning, match=r"images without a frame are skipped: 9\.jpg \(1 of 7\)"):
        registered = quadlift.Scene.from_ultralytics([result(0, "9.jpg"), *results], cameras)
    assert registered.to_dict() == scene.to_dict()
    without = SimpleNamespace(path="002.png", names={}, boxes=None)
    with pytest.raises(quadlift.QuadliftError, match=r'the result of frame "images/002\.jpg" has no boxes; expected'):
        quadlift.Scene.from_ultralytics([without], cameras)


def test_colmap_and_files_of_detectors(tmp_path: Path) -> None:
    models = list(COLMAP.rglob("cameras.txt")) + list(COLMAP.rglob("cameras.bin"))
    assert models
    model = models[0].parent
    cameras = quadlift.Scene.from_cameras(model)
    assert cameras.frame_ids
    labels = next(COLMAP.rglob("labels"))
    scene = quadlift.Scene.from_detections(labels, cameras)
    assert len(scene) > 0
    assert scene.localize().ok.any()

    # A reconstruction that can write itself.
    class Reconstruction:
        def write(self, folder: str) -> None:
            for name in ("cameras", "images", "points3D"):
                for source in model.glob(f"{name}.*"):
                    (Path(folder) / source.name).write_bytes(source.read_bytes())

    assert quadlift.Scene.from_cameras(Reconstruction()).to_dict() == cameras.to_dict()
    with pytest.raises(quadlift.QuadliftError, match=r"expected a path or a pycolmap\.Reconstruction"):
        quadlift.Scene.from_cameras(3)
    with pytest.raises(quadlift.QuadliftError, match="labels: unknown camera format"):
        quadlift.Scene.from_cameras(labels)
    scene.write(tmp_path / "scene.json")
    assert quadlift.Scene.from_cameras(tmp_path / "scene.json").object_ids == scene.object_ids


def test_options_of_files(made: Arrays, cameras: quadlift.Scene, tmp_path: Path) -> None:
    """A table with a column of its own for the images, numbers for classes, and a name for each of them."""
    lines = ["photo,x0,y0,x1,y1,score,class"]
    for k, (frame, (x0, y0, x1, y1)) in enumerate(zip(made.frames, made.boxes, strict=True)):
        lines.append(f"{frame:03}.jpg,{x0},{y0},{x1},{y1},{0.5 if k % 2 else 0.9},{k % 4}")
    path, names = tmp_path / "boxes.csv", tmp_path / "names.txt"
    path.write_text("\n".join(lines) + "\n")
    names.write_text("cup\nmug\njar\npot\n")
    found = quadlift.Scene.from_detections(
        path,
        cameras,
        frame_column="photo",
        class_names=names,
        source="mine",
        min_score=0.7,
        assume="image_size=640x480",
    )
    detections = found.to_dict()["detections"]
    assert {(d["source"], d["score"]) for d in detections} == {("mine", 0.9)}
    assert [d["category"] for d in detections] == ["cup", "jar"] * 6
    assert len(quadlift.Scene.from_detections(path, cameras, frame_column="photo")) == 24
    wrong: dict[str, tuple[Any, str]] = {
        "frame_column": (3, "frame_column is 3; expected a text"),
        "source": (3, "source is 3; expected a text"),
        "min_score": ("a", "min_score is 'a'; expected a finite number"),
        "assume": (640, "assume is 640; expected a text"),
    }
    for name, (value, message) in wrong.items():
        with pytest.raises(quadlift.QuadliftError, match=message):
            quadlift.Scene.from_detections(path, cameras, **{name: value})


def test_directions_are_axes_or_numbers(made: Arrays) -> None:
    for text, numbers in {"z": [0, 0, 1], "-y": [0, -1, 0]}.items():
        scene = quadlift.Scene.from_arrays(projections=made.projections, up=text)
        assert scene.to_dict()["up"] == numbers
        assert scene.corrected(up=text).to_dict() == scene.to_dict() == scene.corrected(up=numbers).to_dict()
        assert quadlift.ObjectMap(up=text).to_scene().to_dict()["up"] == numbers


def test_what_a_scene_tells(made: Arrays) -> None:
    images = [f"{k}.png" for k in range(6)]
    scene = quadlift.Scene.from_arrays(
        projections=made.projections, image_sizes=(640, 480), images=images, name="table", length_unit="m", up=(0, 0, 2)
    )
    assert (scene.name, scene.length_unit, scene.object_count, scene.object_ids) == ("table", "m", 0, [])
    assert scene.frame_ids == ["0", "1", "2", "3", "4", "5"]
    assert repr(scene) == "<quadlift.Scene 'table': 6 frames, 0 detections, 0 objects>"
    document = scene.to_dict()
    assert [frame["image"] for frame in document["frames"]] == images
    assert (document["up"], document["frames"][0]["width"]) == ([0, 0, 2], 640)


def test_images_that_cannot_be_logged(made: Arrays, monkeypatch: pytest.MonkeyPatch) -> None:
    """The warning is that of the line here; a stand-in for Rerun takes what is logged."""
    monkeypatch.setitem(sys.modules, "rerun", MagicMock())
    images = [f"missing{k}.png" for k in range(6)]
    scene = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480), images=images)
    scene = scene.with_detections(frames=made.frames, boxes=made.boxes, objects=made.objects)
    for log in (scene.to_rerun, scene.localize().to_rerun):
        with pytest.warns(UserWarning, match=r"missing\d\.png: there is no such file") as told:
            log()
        assert {warning.filename for warning in told} == {__file__}


def test_coco(made: Arrays, cameras: quadlift.Scene, tmp_path: Path) -> None:
    images = [{"id": k, "file_name": f"{k:03}.jpg", "width": 640, "height": 480} for k in range(6)]
    annotations = [
        {"id": k, "image_id": int(f), "category_id": 1, "bbox": [b[0], b[1], b[2] - b[0], b[3] - b[1]]}
        for k, (f, b) in enumerate(zip(made.frames, made.boxes.tolist(), strict=True))
    ]
    document = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "cup"}]}
    path = tmp_path / "coco.json"
    path.write_text(json.dumps(document))
    scene = quadlift.Scene.from_detections(path, cameras)
    assert len(scene) == 24
    assert len(scene.localize()) == 4


def test_priors(made: Arrays) -> None:
    arguments = {**made_scene(objects=2, views=3).arguments(), "categories": ["my cup"] * 6, "up": (0, 0, 1)}
    plain = quadlift.localize(**arguments)
    prior: quadlift.Prior = {"size": (4.0, 4.0, 4.0), "size_sd": (0.01, 0.01, 0.01), "upright_sd": 0.1}
    pulled = quadlift.localize(**arguments, priors={"my cup": prior})
    assert (pulled.half_extents.mean(axis=1) > 1.05 * plain.half_extents.mean(axis=1)).all()
    builtin = quadlift.localize(**{**arguments, "categories": ["cup"] * 6}, length_unit="m", priors="builtin")
    assert not np.array_equal(builtin.half_extents, plain.half_extents)


def test_pickled_scenes(made: Arrays, tmp_path: Path) -> None:
    scene = quadlift.Scene.from_arrays(projections=made.projections, images=[f"{k}.png" for k in range(6)])
    scene = scene.with_detections(frames=made.frames, boxes=made.boxes, objects=made.objects)
    again = pickle.loads(pickle.dumps(scene))
    assert again.to_dict() == scene.to_dict()
    estimates = scene.localize()
    np.testing.assert_array_equal(again.localize().centers, estimates.centers)
    # Paths of images go on to mean the same.
    scene.write(tmp_path / "scene.json")
    read = pickle.loads(pickle.dumps(quadlift.Scene.read(tmp_path / "scene.json")))
    assert read._core.path == tmp_path / "scene.json"
    with pytest.raises(TypeError, match="estimates cannot be pickled; hand over to_arrow"):
        pickle.dumps(estimates)


def test_detections_that_are_left_out_are_told_of(made: Arrays, tmp_path: Path) -> None:
    cameras = quadlift.Scene.from_arrays(projections=made.projections, frame_ids=list("abcdef"))
    (tmp_path / "boxes.csv").write_text(
        "image,x0,y0,x1,y1\na.png,1,2,30,40\nb.png,5,5,5,9\nz.png,1,2,3,4\nz.png,1,2,3,9\n"
    )
    with pytest.warns(UserWarning, match="are skipped") as told:
        scene = quadlift.Scene.from_detections(tmp_path / "boxes.csv", cameras)
    assert [str(warning.message) for warning in told] == [
        '2 detections are skipped: 1 images have no frame, such as "z.png"',
        "1 detections are skipped: their boxes have no width or no height",
    ]
    assert len(scene) == 1
    assert told[0].filename == __file__


def test_what_was_read_is_not_overwritten(made: Arrays, tmp_path: Path) -> None:
    images = [str(tmp_path / f"images/{k:03}.jpg") for k in range(6)]
    cameras = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480), images=images)
    boxes = cameras.with_detections(frames=made.frames, boxes=made.boxes, objects=made.objects)
    boxes.write(tmp_path / "scene.json")
    photo = tmp_path / "images/001.jpg"
    photo.parent.mkdir()
    photo.write_bytes(b"a photo")
    scene = quadlift.Scene.read(tmp_path / "scene.json")
    before = (tmp_path / "scene.json").read_bytes()
    estimates = scene.localize()
    link = tmp_path / "link.html"
    link.hardlink_to(photo)
    writers: list[Any] = [scene.write, scene.report, estimates.report, estimates.to_scene().write]
    for write in writers:
        for path in [photo, link]:
            with pytest.raises(quadlift.QuadliftError, match="is an image or mask of the scene"):
                write(path)
    for write in writers[1:]:
        with pytest.raises(quadlift.QuadliftError, match="the scene was read from this file"):
            write(tmp_path / "scene.json")
    assert photo.read_bytes() == b"a photo"
    assert (tmp_path / "scene.json").read_bytes() == before
    # A scene may be written where it was read, and a result or a page over an older one.
    scene.write(tmp_path / "scene.json")
    for _ in range(2):
        estimates.to_scene().write(tmp_path / "result.json")
        scene.report(tmp_path / "page.html")
