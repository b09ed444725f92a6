"""Files of other programs are read and written as by `quadlift import`, `export` and `render`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quadlift
from conftest import Arrays, Program
from quadlift import _core

FORMATS: dict[str, dict[str, Any]] = {
    "ply": {"frusta": 0.5},
    "glb": {"enclosing": True},
    "kitti": {"only_detected": True},
    "bop": {"scene_id": 3},
    "coco": {},
    "geojson": {"origin": (48.2, 16.37, 170.0), "north": [1, 0, 0]},
    "mcap": {"frame_id": "world", "enclosing": False},
    "csv": {},
    "tum": {},
}


def test_all_options_of_the_program_are_keywords() -> None:
    read, write = _core.format_options()
    cameras, detections = quadlift.CameraOptions.__annotations__, quadlift.DetectionOptions.__annotations__
    assert set(read) == set(cameras) | set(detections)
    assert set(write) == set(quadlift.ExportOptions.__annotations__)


@pytest.fixture(scope="module")
def result(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("formats")
    program("synth", "-q", "-o", folder / "scene.json", "--objects", "4", "--views", "8", "--noise", "box:0.02")
    # Places on Earth need meters.
    document = {**quadlift.Scene.read(folder / "scene.json").to_dict(), "length_unit": "m"}
    quadlift.Scene.from_dict(document).write(folder / "scene.json")
    program("localize", "-q", folder / "scene.json", "-o", folder / "objects.json", "--enclosing")
    return folder / "objects.json"


@pytest.mark.parametrize("name", list(FORMATS))
def test_exports_are_those_of_the_program(name: str, result: Path, program: Program, tmp_path: Path) -> None:
    scene, options = quadlift.Scene.read(result), FORMATS[name]
    texts = []
    for key, value in options.items():
        text = ",".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
        texts += [f"--{key.replace('_', '-')}"] if value is True else [f"--{key.replace('_', '-')}={text}"]
    texts = [text for text in texts if not text.endswith("=False")]
    program("export", name, result, "-o", tmp_path / "theirs", *texts)
    notes = scene.export(name, tmp_path / "ours", **options)
    assert (tmp_path / "ours").read_bytes() == (tmp_path / "theirs").read_bytes()
    assert all(isinstance(note, str) for note in notes)


def test_exports_of_estimates_tables_and_folders(result: Path, tmp_path: Path) -> None:
    estimates = quadlift.Scene.read(result.with_name("scene.json")).localize()
    estimates.export("ply", tmp_path / "objects.ply")
    estimates.export("csv", tmp_path / "objects.csv", views=tmp_path / "views.csv")
    assert len((tmp_path / "objects.csv").read_text().splitlines()) == 5
    assert len((tmp_path / "views.csv").read_text().splitlines()) == 33
    estimates.export("colmap", tmp_path / "sparse")
    assert len(quadlift.Scene.from_cameras(tmp_path / "sparse").frame_ids) == 8


def test_what_cannot_be_exported(result: Path, tmp_path: Path, made: Arrays) -> None:
    scene = quadlift.Scene.read(result)
    wrong: dict[str, tuple[str, dict[str, Any], str]] = {
        "format": ("obj", {}, 'format is "obj"; expected one of "ply", "glb"'),
        "option": ("ply", {"origin": (1, 2, 3)}, 'origin is not an option of the format "ply", which has enclosing'),
        "flag": ("ply", {"enclosing": 1}, "enclosing is 1; expected True or False"),
        "number": ("ply", {"frusta": -1.0}, r"frusta is -1\.0; expected a non-negative number"),
        "type": ("ply", {"frusta": {}}, "frusta is {}; expected a text, a number or a sequence"),
    }
    for format, options, message in wrong.values():
        with pytest.raises(quadlift.QuadliftError, match=message):
            scene.export(format, tmp_path / "out", **options)
    unknown: dict[str, Any] = {"frustum": 1.0}
    with pytest.raises(TypeError, match=r"export\(\) got an unexpected keyword argument 'frustum'"):
        scene.export("ply", tmp_path / "out", **unknown)
    with pytest.raises(quadlift.QuadliftError, match="the scene has no objects: there is nothing to export"):
        quadlift.Scene.from_arrays(projections=made.projections).export("ply", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_cameras_of_other_programs(tmp_path: Path, program: Program) -> None:
    """Poses of a TUM file, which lacks intrinsics and image sizes."""
    (tmp_path / "poses.txt").write_text("".join(f"{k}.0 {k} 0 0 0 0 0 1\n" for k in range(3)))
    (tmp_path / "camera.txt").write_text("600 610 320 240\n")
    given: dict[str, Any] = {"intrinsics": tmp_path / "camera.txt", "image_size": (640, 480)}
    scene = quadlift.Scene.from_cameras(tmp_path / "poses.txt", **given)
    out = tmp_path / "scene.json"
    program(
        "import", "tum", tmp_path / "poses.txt", "-o", out, "--intrinsics", given["intrinsics"], "--image-size=640x480"
    )
    assert scene.to_dict()["frames"] == quadlift.Scene.read(out).to_dict()["frames"]
    assert scene.to_dict()["cameras"] == quadlift.Scene.read(out).to_dict()["cameras"]
    assert scene.to_dict()["notes"].startswith("Imported from a TUM trajectory: ")
    named = quadlift.Scene.from_cameras(tmp_path / "poses.txt", format="tum", **given)
    assert named.to_dict() == scene.to_dict()


def test_a_nerfstudio_file_and_a_folder_of_images(tmp_path: Path) -> None:
    frames = [{"file_path": f"images/{k}.png", "transform_matrix": np.eye(4).tolist()} for k in range(2)]
    document = {"fl_x": 600.0, "fl_y": 600.0, "cx": 320.0, "cy": 240.0, "w": 640, "h": 480, "frames": frames}
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    scene = quadlift.Scene.from_cameras(tmp_path / "transforms.json", pixel_centers="integer")
    assert scene.to_dict()["cameras"][0]["params"][2:4] == [320.5, 240.5]
    assert [frame["image"] for frame in scene.to_dict()["frames"]] == ["images/0.png", "images/1.png"]
    moved = quadlift.Scene.from_cameras(tmp_path / "transforms.json", images=tmp_path / "other")
    assert moved.to_dict()["frames"][0]["image"] == str(tmp_path / "other/images/0.png")
    wrong: dict[str, tuple[dict[str, Any], str]] = {
        "format": ({"format": "obj"}, 'format is "obj"; expected one of .*"colmap"'),
        "option": ({"sequence": "1"}, 'sequence is not an option of the format "nerfstudio", which has pixel_centers'),
        "value": ({"pixel_centers": "0.5"}, r"pixel_centers is 0\.5; expected one of integer, half"),
    }
    for options, message in wrong.values():
        with pytest.raises(quadlift.QuadliftError, match=message):
            quadlift.Scene.from_cameras(tmp_path / "transforms.json", **options)
    unknown: dict[str, Any] = {"names": "x"}
    with pytest.raises(TypeError, match=r"Scene\.from_cameras\(\) got an unexpected keyword argument 'names'"):
        quadlift.Scene.from_cameras(tmp_path / "transforms.json", **unknown)


def write_table(path: Path, made: Arrays, frames: list[str]) -> None:
    lines = ["frame,x0,y0,x1,y1,track_id"]
    for frame, box, name in zip(made.frames, made.boxes.tolist(), made.objects, strict=True):
        lines.append(",".join([frames[frame], *map(str, box), str(name)]))
    path.write_text("\n".join(lines) + "\n")


def test_how_detections_meet_frames(made: Arrays, tmp_path: Path) -> None:
    cameras = quadlift.Scene.from_arrays(
        projections=made.projections, image_sizes=(640, 480), frame_ids=[f"{k}.png" for k in range(6)]
    )
    write_table(tmp_path / "boxes.csv", made, [f"{k + 1}.png" for k in range(6)])
    # The last image has no frame, or the numbers begin at one.
    with pytest.warns(UserWarning, match="4 detections are skipped: 1 images have no frame"):
        by_name = quadlift.Scene.from_detections(tmp_path / "boxes.csv", cameras, match="name", source="csv")
    assert len(by_name) == 20
    by_number = quadlift.Scene.from_detections(
        tmp_path / "boxes.csv", by_name, match="index", assume="frame_offset=1", replace=True, format="csv"
    )
    assert len(by_number) == 24
    np.testing.assert_allclose(by_number.localize().centers, quadlift.localize(**made.arguments()).centers, atol=1e-9)
    with pytest.raises(quadlift.QuadliftError, match=r"source=.* or replace all \(replace=True\)"):
        quadlift.Scene.from_detections(tmp_path / "boxes.csv", by_name)
    with pytest.raises(quadlift.QuadliftError, match='match is "number"; expected one of "auto", "name"'):
        quadlift.Scene.from_detections(tmp_path / "boxes.csv", cameras, match="number")  # type: ignore[arg-type]


def shown_at_6(boxes: Any) -> Any:
    """Boxes of images of 640 x 480 pixels in pictures that are turned by 90 degrees clockwise, 480 x 640 pixels."""
    x0, y0, x1, y1 = np.asarray(boxes).T
    return np.column_stack([480 - y1, x0, 480 - y0, x1])


def test_turned_pictures(made: Arrays, program: Program, tmp_path: Path) -> None:
    """The boxes of pictures with an EXIF orientation, which the cameras do not follow."""
    given = {**made.arguments(), "boxes": shown_at_6(made.boxes)}
    expected = quadlift.localize(**made.arguments()).centers
    np.testing.assert_allclose(quadlift.localize(**given, orientation=6).centers, expected, atol=1e-9)
    cameras = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480))
    scene = cameras.with_detections(given["boxes"], made.frames, made.objects, orientation="6")
    np.testing.assert_allclose([detection["box"] for detection in scene.to_dict()["detections"]], made.boxes, atol=1e-9)
    # As the program does it, also for fractions that were multiplied by the sides of the camera's images.
    wrong = cameras.with_detections(given["boxes"], made.frames, made.objects)
    assert scene.to_dict() == wrong.corrected("orientation=6").to_dict()
    fractions = given["boxes"] / [480, 640, 480, 640] * [640, 480, 640, 480]
    scene = cameras.with_detections(fractions, made.frames, made.objects, orientation="6-fractions")
    np.testing.assert_allclose(scene.localize().centers, expected, atol=1e-9)
    wrong.write(tmp_path / "wrong.json")
    program("localize", "-q", tmp_path / "wrong.json", "--assume", "orientation=6", "-o", tmp_path / "objects.json")
    found = [o["center"] for o in quadlift.Scene.read(tmp_path / "objects.json").to_dict()["objects"]]
    np.testing.assert_allclose(found, expected, atol=1e-4)
    # Detections of before stay as they are; so do those of a file.
    both = cameras.with_detections(made.boxes[:4], made.frames[:4], source="a").with_detections(
        given["boxes"][:4], made.frames[:4], source="b", orientation=6
    )
    boxes = np.array([detection["box"] for detection in both.to_dict()["detections"]])
    np.testing.assert_allclose(boxes[4:], boxes[:4], atol=1e-9)
    made.boxes, straight = given["boxes"], made.boxes
    write_table(tmp_path / "boxes.csv", made, [str(k) for k in range(6)])
    made.boxes = straight
    with_both = quadlift.Scene.from_detections(tmp_path / "boxes.csv", both, assume="orientation=6")
    boxes = np.array([detection["box"] for detection in with_both.to_dict()["detections"]])
    np.testing.assert_allclose(boxes, [*made.boxes[:4], *made.boxes[:4], *made.boxes], atol=1e-9)


@pytest.mark.parametrize("value", [0, 9, 2.5, "sideways"])
def test_wrong_orientations(value: Any, made: Arrays) -> None:
    with pytest.raises(quadlift.QuadliftError, match=r"orientation is .*; expected"):
        quadlift.localize(**made.arguments(), orientation=value)


def test_orientation_needs_the_size_of_the_images(made: Arrays) -> None:
    arguments = {**made.arguments(), "image_sizes": None}
    with pytest.raises(quadlift.QuadliftError, match="the image size is needed but unknown"):
        quadlift.localize(**arguments, orientation=6)


@pytest.mark.parametrize("name", ["frame.png", "frame.svg"])
def test_pictures_are_those_of_the_program(name: str, result: Path, program: Program, tmp_path: Path) -> None:
    scene = quadlift.Scene.read(result.with_name("scene.json"))
    frame = scene.frame_ids[2]
    (tmp_path / "ours").mkdir()
    (tmp_path / "theirs").mkdir()
    scene.render(frame, tmp_path / "ours" / name, labels=True)
    program("render", result.with_name("scene.json"), "--frame", frame, "--labels", "-o", tmp_path / "theirs" / name)
    assert (tmp_path / "ours" / name).read_bytes() == (tmp_path / "theirs" / name).read_bytes()
    with_estimates = tmp_path / f"estimates-{name}"
    scene.localize().render(frame, with_estimates, truth=scene)
    assert with_estimates.stat().st_size > 0
    assert with_estimates.read_bytes() != (tmp_path / "ours" / name).read_bytes()


def test_wrong_pictures(made: Arrays, tmp_path: Path) -> None:
    scene = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480))
    wrong: dict[str, tuple[tuple[Any, ...], dict[str, Any], str]] = {
        "frame": ((7, tmp_path / "a.png"), {}, 'frame is "7"; expected one of 6 frames: 0, 1, 2, 3, 4'),
        "type": ((0.5, tmp_path / "a.png"), {}, "frame is 0.5; expected a text or a whole number"),
        "ending": ((0, tmp_path / "a.jpg"), {}, r"a\.jpg; expected a name that ends in \.png or \.svg"),
        "source": ((0, tmp_path / "a.png"), {"source": "yolo"}, 'there are no detections of the source "yolo"'),
        "labels": ((0, tmp_path / "a.png"), {"labels": "yes"}, "labels is 'yes'; expected True or False"),
    }
    for arguments, options, message in wrong.values():
        with pytest.raises(quadlift.QuadliftError, match=message):
            scene.render(*arguments, **options)
    scene.render(0, tmp_path / "a.png")
    assert (tmp_path / "a.png").is_file()


def test_messages_name_keywords_that_work(made: Arrays, tmp_path: Path) -> None:
    """What the messages of the program name as options, Python names as what it has."""
    expected = quadlift.localize(**made.arguments()).centers
    scene = quadlift.Scene.from_arrays(**made.arguments())
    document = scene.to_dict()
    for detection in document["detections"]:
        x0, y0, x1, y1 = detection["box"]
        detection["box"] = [x0, y0, x1 - x0, y1 - y0]
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(document))
    told = r'if the numbers are x, y, width, height: assume="boxes=xywh"; center and size: assume="boxes=cxcywh"\)'
    with pytest.raises(quadlift.QuadliftError, match=told):
        quadlift.Scene.read(path)
    with pytest.raises(quadlift.QuadliftError, match=told):
        quadlift.Scene.from_dict(document)
    for read in (
        quadlift.Scene.read(path, assume="boxes=xywh"),
        quadlift.Scene.from_dict(document, assume="boxes=xywh"),
    ):
        np.testing.assert_allclose(read.localize().centers, expected, atol=1e-6)
    with pytest.raises(quadlift.QuadliftError, match='assume is "boxes=ltrb"; expected one of xyxy'):
        quadlift.Scene.read(path, assume="boxes=ltrb")

    # A detector that ran on images of half the size.
    cameras = quadlift.Scene.from_arrays(
        projections=made.projections, image_sizes=(640, 480), frame_ids=[f"{k}.png" for k in range(6)]
    )
    images = [{"id": k, "file_name": f"{k}.png", "width": 320, "height": 240} for k in range(6)]
    annotations = [
        {"image_id": int(f), "category_id": 1, "track_id": int(o), "bbox": [b[0], b[1], b[2] - b[0], b[3] - b[1]]}
        for f, o, b in zip(made.frames, made.objects, made.boxes / 2, strict=True)
    ]
    coco = {"images": images, "annotations": annotations, "categories": [{"id": 1, "name": "cup"}]}
    (tmp_path / "boxes.json").write_text(json.dumps(coco))
    with pytest.raises(quadlift.QuadliftError, match=r'size \(assume="image_size=320x240" scales them\)'):
        quadlift.Scene.from_detections(tmp_path / "boxes.json", cameras)
    scaled = quadlift.Scene.from_detections(tmp_path / "boxes.json", cameras, assume="image_size=320x240")
    np.testing.assert_allclose(scaled.localize().centers, expected, atol=1e-6)

    estimates = scene.localize()
    with pytest.raises(quadlift.QuadliftError, match=r"localize\(enclosing=True\) adds them"):
        estimates.export("ply", tmp_path / "objects.ply", enclosing=True)
    scene.localize(enclosing=True).export("ply", tmp_path / "objects.ply", enclosing=True)
    with pytest.raises(quadlift.QuadliftError, match=r"origin=\(LAT, LON, ALT\) sets the place"):
        estimates.export("geojson", tmp_path / "objects.geojson")
    with pytest.raises(quadlift.QuadliftError, match=r"`Scene\.from_cameras\(\.\.\., images=\.\.\.\)` names"):
        scene.segment()
    (tmp_path / "poses.txt").write_text("0.0 0 0 0 0 0 0 1\n")
    with pytest.raises(quadlift.QuadliftError, match=r"set their file with intrinsics=\.\.\."):
        quadlift.Scene.from_cameras(tmp_path / "poses.txt", format="tum")
    (tmp_path / "notes.txt").write_text("A table.\n")
    with pytest.raises(quadlift.QuadliftError, match=r"unknown .*; `format=\.\.\.` reads a given format"):
        quadlift.Scene.from_cameras(tmp_path / "notes.txt")
