"""Messages name the argument, what was found and what was expected."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quadlift
from conftest import Arrays, made_scene

NAN = float("nan")


def changed(values: Any, place: Any, value: float) -> Any:
    copy = np.array(values, dtype=np.float64)
    copy[place] = value
    return copy


MADE = made_scene(objects=2, views=5)
# Arguments that replace the right ones, and the message.
CASES: dict[str, tuple[dict[str, Any], str]] = {
    "shape of boxes": ({"boxes": np.zeros((10, 3))}, "boxes has the shape (10, 3); expected (M, 4)"),
    "rows of boxes": (
        {"boxes": MADE.boxes[:7]},
        "boxes has the shape (7, 4); expected (10, 4), as many rows as frames",
    ),
    "dtype of boxes": ({"boxes": np.full((10, 4), "a")}, "boxes has the dtype <U1; expected real numbers"),
    "complex": ({"boxes": np.zeros((10, 4), complex)}, "boxes has the dtype complex128; expected real numbers"),
    "ragged": ({"boxes": [[1, 2], [3]]}, "boxes is not an array:"),
    "nan in projections": (
        {"projections": changed(MADE.projections, (1, 2, 3), NAN)},
        "projections[1, 2, 3] is nan; expected a finite number",
    ),
    "part of a box": ({"boxes": changed(MADE.boxes, (3, 0), NAN)}, "boxes[3]: the box"),
    "infinite box": (
        {"boxes": changed(MADE.boxes, (3, 0), np.inf)},
        "boxes[3, 0] is inf; expected a finite number",
    ),
    "reversed box": ({"boxes": MADE.boxes[:, [2, 1, 0, 3]]}, "boxes[0]: the box"),
    "no box": ({"boxes": changed(MADE.boxes, 4, NAN)}, "row 4 has neither a box nor an ellipse"),
    "frames": ({"frames": None}, "expected frames, the frame of each detection by index or id, of shape (M,)"),
    "nothing measured": ({"boxes": None}, "expected boxes or ellipses; found none of them"),
    "frame": ({"frames": np.arange(10)}, "frames[5] is 5; expected 0 to 4: there are 5 frames"),
    "negative frame": ({"frames": -np.ones(10, int)}, "frames[0] is -1; expected 0 to 4: there are 5 frames"),
    "frame, half": ({"frames": MADE.frames + 0.5}, "frames[0] is 0.5; expected a whole number"),
    "frame, gap": (
        {"frames": np.where(MADE.frames == 1, NAN, MADE.frames)},
        "frames[2] is nan; expected a whole number",
    ),
    "name of frame": (
        {"frames": ["4"] * 9 + ["a"]},
        'frames[9]: unknown frame "a"; the scene has 5 frames: 0, 1, 2, 3, 4',
    ),
    "dtype of frame": ({"frames": [True] * 10}, "frames has the dtype bool; expected whole numbers"),
    "lens without a camera": ({"distortion": np.zeros(5)}, "distortion goes with intrinsics; found it without them"),
    "lenses": (
        {
            "projections": None,
            "intrinsics": np.eye(3),
            "cam_from_world": np.tile(np.eye(3, 4), (5, 1, 1)),
            "distortion": np.zeros((4, 5)),
        },
        "distortion has the shape (4, 5); expected (5, 5), as many rows as cam_from_world",
    ),
    "shape of intrinsics": (
        {"projections": None, "intrinsics": np.eye(4), "cam_from_world": np.zeros((5, 3, 4))},
        "intrinsics has the shape (4, 4); expected (F, 3, 3) or (3, 3)",
    ),
    "shape of sizes": ({"image_sizes": 640}, "image_sizes has the shape (); expected (F, 2) or (2,)"),
    "no frames": (
        {"projections": np.zeros((0, 3, 4)), "image_sizes": None},
        "frames[0] is 0; there are no frames",
    ),
    "twice": (
        {"objects": np.zeros(10, int)},
        'row 1: the object "0" is detected twice in frame "0" (first in row 0)',
    ),
    "object": ({"objects": np.linspace(0, 1, 10)}, "objects has the dtype float64; expected whole numbers or texts"),
    "rows of object": ({"objects": [1]}, "objects has the shape (1,); expected (10,), as many rows as frames"),
    "objects": ({"objects": [()] * 10}, "objects has the shape (10, 0); expected (M,)"),
    "singular": ({"projections": np.zeros((5, 3, 4))}, "projections[0]: the left 3x3 block"),
    "no cameras": ({"projections": None}, "expected projections, or intrinsics and cam_from_world; found none of them"),
    "half a camera": (
        {"projections": None, "intrinsics": np.eye(3)},
        "expected projections, or intrinsics and cam_from_world; found intrinsics",
    ),
    "two cameras": ({"intrinsics": np.eye(3)}, "expected either projections, or intrinsics and cam_from_world"),
    "skew": (
        {"projections": None, "intrinsics": np.ones((3, 3)), "cam_from_world": np.zeros((5, 3, 4))},
        "intrinsics[0]: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]",
    ),
    "no rotation": (
        {"projections": None, "intrinsics": np.eye(3), "cam_from_world": np.ones((5, 3, 4))},
        "the 3x3 part of cam_from_world is not a rotation",
    ),
    "last row": (
        {"projections": None, "intrinsics": np.eye(3), "cam_from_world": np.ones((5, 4, 4))},
        "the last row of cam_from_world[0] is [1.0, 1.0, 1.0, 1.0]; expected [0, 0, 0, 1]",
    ),
    "image sizes": ({"image_sizes": (0, 480)}, "image_sizes holds 0.0; expected positive numbers of pixels"),
    "ellipses": ({"ellipses": np.zeros((10, 5))}, "ellipses[0]: the conic is not an ellipse"),
    "masks": ({"masks": [np.zeros(3)] * 10}, "masks[0] has the shape (3,)"),
    "priors, width": (
        {"priors": {"cup": {"size": (1, 2), "size_sd": (1, 1, 1)}}},
        "priors['cup']['size'] has the shape (2,); expected (3,)",
    ),
    "up, axis": ({"up": "north"}, "up is 'north'; expected x, y, z, -x, -y, -z or three numbers"),
    "up": ({"up": [0, 0, 0]}, "up: [0.0, 0.0, 0.0] is not a direction"),
    "empty": ({"frames": [], "boxes": np.zeros((0, 4)), "objects": []}, "there is nothing to localize"),
    "no objects": ({"objects": -np.ones(10, int), "associate": "never"}, "10 detections have no object id"),
    "method": ({"method": "magic"}, 'method is "magic"; expected one of posterior, planes'),
    "body": ({"body": "ball"}, 'body is "ball"; expected one of auto, ellipsoid'),
    "not fitted": ({"body": "superellipsoid:1.5"}, 'body is "superellipsoid:1.5"; expected'),
    "method of a body": ({"method": "lfd", "body": "cuboid"}, 'body is an option of method="posterior" only'),
    "learned sizes": ({"learn_sizes": "yes"}, "learn_sizes is "),
    "method of learned sizes": (
        {"method": "lfd", "learn_sizes": True},
        'learn_sizes is an option of method="posterior" only',
    ),
    "method of priors": ({"method": "lfd", "priors": "builtin"}, 'priors is an option of method="posterior" only'),
    "lambda": ({"reg_weight": 1.0}, 'reg_weight is an option of method="reg" only'),
    "threads": ({"threads": 0}, "threads is 0; expected a whole number from 1 to 1024"),
    "min_views": ({"min_views": 2.5}, "min_views is 2.5; expected a whole number from 0 to"),
    "pose_noise": ({"pose_noise": (0.0, 1.0)}, "pose_noise is [0.0, 1.0]; expected 2 positive numbers"),
    "noise_model, names": (
        {"noise_model": {"edge": 0.1}},
        'noise_model is edge=0.1; "edge" is not a noise level; expected one of edge_noise',
    ),
    "noise_model, range": (
        {"noise_model": {"shape": 0.0}},
        "noise_model is shape=0; shape is 0; expected a finite number above 0",
    ),
    "noise_model, number": ({"noise_model": {"shape": "a"}}, "noise_model['shape'] is 'a'; expected a finite number"),
    "noise_model, type": ({"noise_model": [0.1]}, "noise_model is a list; expected a mapping of names to numbers"),
    "noise_model, method": (
        {"noise_model": {}, "method": "lfd"},
        'noise_model is an option of method="posterior" only',
    ),
    "pose_noise, shape": ({"pose_noise": 1.0}, "pose_noise has the shape ()"),
    "ground": ({"ground_plane": True}, 'the ground plane needs an "up" direction'),
    "priors without unit": ({"priors": "builtin"}, "the length unit of the scene is not given"),
    "priors": ({"priors": {"cup": {"size": (1, 2, 3)}}}, "size without size_sd"),
    "priors, key": ({"priors": {"cup": {"sizes": (1, 2, 3)}}}, "sizes"),
    "progress": ({"progress": 3}, "progress is 3; expected a function of two numbers"),
    "source": ({"source": "yolo"}, 'there are no detections of the source "yolo"'),
}


@pytest.mark.parametrize("name", list(CASES))
def test_wrong_arguments(name: str) -> None:
    arguments, message = CASES[name]
    with pytest.raises(quadlift.QuadliftError) as caught:
        quadlift.localize(**{**MADE.arguments(), **arguments})
    text = str(caught.value)
    assert message in text
    assert "panic" not in text
    assert isinstance(caught.value, ValueError)


def test_unknown_keywords(made: Arrays) -> None:
    wrong: dict[str, Any] = {"lamda": 3}
    with pytest.raises(TypeError, match=r"localize\(\) got an unexpected keyword argument 'lamda'"):
        quadlift.localize(**made.arguments(), **wrong)
    # Also if it takes the place of one that is missing.
    given = made.arguments()
    wrong = {**given, "frame": given.pop("frames")}
    with pytest.raises(TypeError, match="unexpected keyword argument 'frame'"):
        quadlift.localize(**{**wrong, "frames": None})


def test_what_is_no_scene() -> None:
    scene = quadlift.Scene.from_arrays(projections=MADE.projections)
    estimates: Any = quadlift.localize(**MADE.arguments())
    number: Any = 3
    with pytest.raises(
        quadlift.QuadliftError, match=r"truth is a Estimates; expected a quadlift\.Scene \(its to_scene"
    ):
        scene.evaluate(estimates)
    with pytest.raises(quadlift.QuadliftError, match=r"truth is a int; expected a quadlift\.Scene$"):
        estimates.report("no.html", truth=number)
    with pytest.raises(quadlift.QuadliftError, match=r"cameras is a int; expected a quadlift\.Scene"):
        quadlift.Scene.from_supervision([], number)
    with pytest.raises(quadlift.QuadliftError, match=r"results\[0\] is a int; expected Ultralytics' Results"):
        quadlift.Scene.from_ultralytics([1], scene)
    with pytest.raises(quadlift.QuadliftError, match=r"the document: this is not a scene file: it has no .format"):
        quadlift.Scene.from_dict({})


def test_files(tmp_path: Path) -> None:
    with pytest.raises(quadlift.QuadliftError, match="no such file"):
        quadlift.Scene.read(tmp_path / "missing.json")
    path = tmp_path / "scene.json"
    path.write_text('{"format": "quadlift.scene", "version": 1,\n "frames": [{"id": 3}]}')
    with pytest.raises(quadlift.QuadliftError, match=r"scene\.json:2:.*frames\[0\]\.id"):
        quadlift.Scene.read(path)
    with pytest.raises(quadlift.QuadliftError, match="cannot write"):
        quadlift.Scene.from_arrays(projections=MADE.projections).write(tmp_path / "no" / "scene.json")
    with pytest.raises(quadlift.QuadliftError, match=r"recording\.json: there is no such file; expected the output"):
        quadlift.log_recording(tmp_path)
    recording = tmp_path / "recording.json"
    for text, message in (
        ("{", "is not a recording: "),
        ("[]", "found a list; expected the format 'quadlift.recording', version 1"),
        ('{"format": "quadlift.scene", "version": 2}', "found the format 'quadlift.scene', version 2; expected"),
    ):
        recording.write_text(text)
        with pytest.raises(quadlift.QuadliftError, match=message):
            quadlift.log_recording(tmp_path)
    scene = quadlift.Scene.from_arrays(projections=MADE.projections)
    with pytest.raises(quadlift.QuadliftError, match='the truth: the file holds no "objects"'):
        scene.evaluate(scene)


def test_wrong_options_of_association() -> None:
    scene = quadlift.Scene.from_arrays(projections=MADE.projections).with_detections(
        frames=MADE.frames, boxes=MADE.boxes
    )
    wrong: dict[str, tuple[dict[str, Any], str]] = {
        "edge_noise_px": ({"edge_noise_px": -1}, "-1"),
        "max_overlap": ({"max_overlap": 2.0}, "2"),
        "thorough": ({"thorough": "yes"}, "thorough is 'yes'; expected True or False"),
        "ids": ({"ids": "none"}, 'ids is "none"; expected one of trust, evidence, ignore'),
        "min_views": ({"min_views": 1}, "min_views is 1; expected a whole number of at least 2"),
        "priors": ({"priors": "builtin"}, "the length unit of the scene is not given"),
        "source": ({"source": "yolo"}, 'there are no detections of the source "yolo"'),
    }
    for arguments, message in wrong.values():
        with pytest.raises(quadlift.QuadliftError) as caught:
            scene.associate(**arguments)
        assert message in str(caught.value)


def test_missing_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    scene = quadlift.Scene.from_arrays(projections=MADE.projections)
    with pytest.raises(ImportError, match="pip install rerun-sdk"):
        scene.to_rerun()
    estimates = quadlift.localize(**MADE.arguments())
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(ImportError, match="pip install pandas"):
        estimates.to_pandas()
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    for name in ("_arrow", "tables"):
        monkeypatch.delitem(sys.modules, f"quadlift.{name}", raising=False)
    with pytest.raises(ImportError, match="pip install pyarrow"):
        estimates.to_arrow()
    with pytest.raises(ImportError, match="pip install pyarrow"):
        importlib.import_module("quadlift.tables")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frame_ids": 3}, "frame_ids is 3; expected 5 texts, one for each frame"),
        ({"frame_ids": "abcde"}, "frame_ids is 'abcde'; expected 5 texts, one for each frame"),
        ({"images": ["a.jpg"]}, "images: found 1 of them; expected 5 texts, one for each frame"),
        ({"images": ["a", "b", 3, "d", "e"]}, r"images\[2\] is 3; expected a text"),
        ({"name": 3}, "name is 3; expected a text"),
        ({"frame_ids": ["a", "a", "b", "c", "d"]}, r'frames\[1\]: the frame id "a" is used twice'),
    ],
)
def test_wrong_frames(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(quadlift.QuadliftError, match=message):
        quadlift.Scene.from_arrays(projections=MADE.projections, **arguments)


def test_odd_ids_and_numbers_are_refused_in_words(made: Arrays) -> None:
    cameras = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480))
    whole: dict[str, Any] = {"frames": made.frames, "boxes": made.boxes}
    for ids in [made.objects.astype(np.uint64) + np.uint64(2**64 - 4), np.array(["\ud800"] * 24), ["\udfff"] * 24]:
        with pytest.raises(quadlift.QuadliftError, match="object"):
            cameras.with_detections(**whole, objects=ids)
        with pytest.raises(quadlift.QuadliftError, match="object"):
            quadlift.localize(**{**made.arguments(), "objects": ids})
    for name in ["frame_ids", "images"]:
        texts = {name: [f"\ud800{k}" for k in range(6)]}
        with pytest.raises(quadlift.QuadliftError, match="not Unicode"):
            quadlift.Scene.from_arrays(projections=made.projections, **texts)  # type: ignore[arg-type]
    document = cameras.with_detections(**whole, objects=made.objects).to_dict()
    document["detections"][0]["score"] = np.float32(0.5)
    document["up"] = np.array([0, 0, 1], dtype=np.int64)
    document["length_unit"] = "\ud800"
    with pytest.raises(quadlift.QuadliftError):
        quadlift.Scene.from_dict(document)
    document["length_unit"] = "m"
    assert quadlift.Scene.from_dict(document).to_dict()["up"] == [0, 0, 1]
    with pytest.raises(quadlift.QuadliftError, match="found a object"):
        quadlift.Scene.from_dict({**document, "notes": object()})


def test_arrays_of_estimates_cannot_be_changed(made: Arrays) -> None:
    estimates = quadlift.localize(**made.arguments())
    for name in ["centers", "covariances", "object_ids", "status", "inliers", "object_indices"]:
        with pytest.raises(ValueError, match="read-only"):
            getattr(estimates, name)[...] = 0
    changed = estimates.centers.copy()
    changed[0] = 0.0


def test_limits_of_pixels_are_checked() -> None:
    with pytest.raises(quadlift.QuadliftError, match="pixels"):
        quadlift.set_max_pixels(0)
    quadlift.set_max_pixels(160_000_000)
