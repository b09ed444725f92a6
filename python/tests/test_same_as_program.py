"""The same numbers from Python and from the program, bit by bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quadlift
from conftest import Program, read_json

# What `synth` makes, and the options of the localisation in both spellings.
SCENES: dict[str, tuple[list[str], list[str], dict[str, Any]]] = {
    "boxes": (["--objects", "6", "--views", "10", "--noise", "box:0.05", "--outliers", "0.05"], [], {}),
    "cuboids": (
        ["--objects", "5", "--views", "8", "--body", "cuboid", "--trajectory", "orbit", "--noise", "box:0.02"],
        ["--body", "cuboid", "--seed", "7", "--threads", "1"],
        {"body": "cuboid", "seed": 7, "threads": 1},
    ),
    "ellipses": (
        ["--objects", "5", "--views", "9", "--observations", "ellipses", "--noise", "se:0.3"],
        ["--observations", "ellipse", "--min-views", "3"],
        {"observations": "ellipse", "min_views": 3},
    ),
    "poses": (
        ["--objects", "12", "--views", "8", "--pose-noise", "0.2", "--noise", "box:0.02"],
        ["--pose-noise", "0.003,0.1", "--body", "superellipsoid:1.5"],
        {"pose_noise": (0.003, 0.1), "body": "superellipsoid:1.5"},
    ),
    "sigmas": (
        ["--objects", "6", "--views", "10", "--noise", "box:0.03", "--outliers", "0.1"],
        ["--sigmas", "edge_relative=0.02,edge_px=1.5,edge_correlation=0.25", "--body", "cuboid"],
        {"sigmas": {"edge_px": 1.5, "edge_relative": 0.02, "edge_correlation": 0.25}, "body": "cuboid"},
    ),
    "closed form": (["--objects", "7", "--views", "12", "--noise", "box:0.1"], ["--method", "lfd"], {"method": "lfd"}),
}


def same(found: Any, expected: list[Any]) -> None:
    """Equal bit by bit; absent entries are NaN."""
    for row, wanted in zip(found, expected, strict=True):
        np.testing.assert_array_equal(row, np.full_like(row, np.nan) if wanted is None else np.asarray(wanted))


def compare(estimates: quadlift.Estimates, objects: list[dict[str, Any]]) -> None:
    def of(name: str, field: str) -> list[Any]:
        return [o.get(name, {}).get(field) for o in objects]

    assert list(estimates.status) == [o["status"] for o in objects]
    same(estimates.centers, [o.get("center") for o in objects])
    same(estimates.semi_axes, of("ellipsoid", "semi_axes"))
    same(estimates.quaternions, of("ellipsoid", "rotation"))
    same(estimates.enclosing_semi_axes, of("enclosing_ellipsoid", "semi_axes"))
    same(estimates.covariances, of("covariance", "matrix"))
    same(estimates.center_sd, [o.get("center_sd") for o in objects])
    same(estimates.rms_residuals, [o.get("residual_px") for o in objects])
    assert estimates.views_used.tolist() == [o["views_used"] for o in objects]


@pytest.mark.parametrize("name", list(SCENES))
def test_scenes(name: str, program: Program, tmp_path: Path) -> None:
    synth, options, keywords = SCENES[name]
    scene, result, ours = tmp_path / "scene.json", tmp_path / "result.json", tmp_path / "ours.json"
    program("synth", "-q", "-o", scene, *synth)
    program("localize", "-q", scene, "-o", result, *options)
    estimates = quadlift.Scene.read(scene).localize(**keywords)
    # The whole file: settings, counts, noise levels, residuals of the views.
    estimates.to_scene().write(ours)
    assert ours.read_bytes() == result.read_bytes()
    objects = read_json(result)["objects"]
    assert estimates.object_ids.tolist() == [o["id"] for o in objects]
    assert any(o["status"] == "ok" for o in objects)
    compare(estimates, objects)

    # From arrays, with whole numbers for the objects.
    document = read_json(scene)
    frame_index = {frame["id"]: k for k, frame in enumerate(document["frames"])}
    detections = document["detections"]
    names = list(dict.fromkeys(d["object"] for d in detections))
    ellipses = [
        [*e["center"], *e["semi_axes"], e["angle"]] if (e := d.get("ellipse")) else [np.nan] * 5 for d in detections
    ]
    cameras = {c["id"]: c for c in document["cameras"]}
    frames: dict[str, Any]
    if "projection" in document["frames"][0]:
        frames = {
            "projections": np.array([f["projection"] for f in document["frames"]]),
            "image_sizes": np.array([[f["width"], f["height"]] for f in document["frames"]]),
        }
    else:
        of_frame = [cameras[f["camera"]] for f in document["frames"]]
        frames = {
            "intrinsics": np.array(
                [[[fx, 0, cx], [0, fy, cy], [0, 0, 1]] for fx, fy, cx, cy in (c["params"] for c in of_frame)]
            ),
            "cam_from_world": np.array([f["cam_from_world"] for f in document["frames"]]),
        }
        if "width" in of_frame[0]:
            frames["image_sizes"] = np.array([[c["width"], c["height"]] for c in of_frame])
    of_arrays = quadlift.localize(
        **frames,
        frame=[frame_index[d["frame"]] for d in detections],
        boxes=np.array([d.get("box", [np.nan] * 4) for d in detections]),
        ellipses=np.array(ellipses),
        object=np.array([names.index(d["object"]) for d in detections]),
        up=document.get("up"),
        length_unit=document.get("length_unit"),
        **keywords,
    )
    assert of_arrays.object_ids.tolist() == list(range(len(names)))
    compare(of_arrays, objects)


def test_association(program: Program, tmp_path: Path) -> None:
    scene, result = tmp_path / "scene.json", tmp_path / "result.json"
    options = ["--no-ids", "--trajectory", "orbit", "--objects", "5", "--views", "12", "--noise", "box:0.02"]
    program("synth", "-q", "-o", scene, *options, "--truth", tmp_path / "truth.json")
    program("localize", "-q", scene, "-o", result)
    loaded = quadlift.Scene.read(scene)
    assert loaded.object_ids == []
    estimates = loaded.localize()
    document = read_json(result)
    assert estimates.object_ids.tolist() == [o["id"] for o in document["objects"]]
    compare(estimates, document["objects"])
    found = [estimates.object_ids[k] if k >= 0 else None for k in estimates.object_indices]
    assert found == [d.get("object") for d in document["detections"]]
    assert estimates.to_scene().to_dict()["detections"] == document["detections"]
    associated, objects = loaded.associate()
    assert [o.id for o in objects] == associated.object_ids == estimates.object_ids.tolist()


def test_evaluation(program: Program, tmp_path: Path) -> None:
    scene = tmp_path / "scene.json"
    program("synth", "-q", "-o", scene, "--objects", "4", "--views", "10", "--noise", "box:0.02")
    truth = quadlift.Scene.read(scene)
    scores = truth.localize().to_scene().evaluate(truth)
    assert (len(scores.objects), scores.failures, scores.matched_by) == (4, 0, "ids")
    assert scores.mean["iou3d"] == pytest.approx(np.mean([o["iou3d"] for o in scores.objects]))
    assert scores.mean["iou3d"] is not None
    assert scores.mean["iou3d"] > 0.7


def test_masks(program: Program, tmp_path: Path) -> None:
    scene, result, ours = tmp_path / "scene.json", tmp_path / "result.json", tmp_path / "ours.json"
    program("synth", "-q", "-o", scene, "--render", "--objects", "2", "--views", "5")
    program("localize", "-q", scene, "-o", result, "--observations", "mask")
    loaded = quadlift.Scene.read(scene)
    estimates = loaded.localize(observations="mask")
    estimates.to_scene().write(ours)
    assert ours.read_bytes() == result.read_bytes()
    # Elsewhere the paths of the images are absolute.
    (tmp_path / "other").mkdir()
    loaded.write(tmp_path / "other" / "scene.json")
    moved = quadlift.Scene.read(tmp_path / "other" / "scene.json").localize(observations="mask")
    np.testing.assert_array_equal(moved.centers, estimates.centers)
