"""The same numbers from Python and from the program, bit by bit; files have fewer digits of figures and covariances."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import quadlift
from conftest import RENDERED, Program, as_written, page_data, read_json

# What `synth` makes, and the options of the localization in both spellings.
SCENES: dict[str, tuple[list[str], list[str], dict[str, Any]]] = {
    "boxes": (["--objects", "6", "--views", "10", "--noise", "box:0.05", "--outliers", "0.05"], [], {}),
    "cuboids": (
        ["--objects", "5", "--views", "8", "--body", "cuboid", "--trajectory", "orbit", "--noise", "box:0.02"],
        ["--body", "cuboid", "--threads", "1"],
        {"body": "cuboid", "threads": 1},
    ),
    "ellipses": (
        ["--objects", "5", "--views", "9", "--measurement", "ellipses", "--noise", "se:0.3"],
        ["--measurement", "ellipse", "--min-views", "3"],
        {"measurement": "ellipse", "min_views": 3},
    ),
    "poses": (
        ["--objects", "12", "--views", "8", "--pose-noise", "0.2", "--noise", "box:0.02"],
        ["--pose-noise", "0.003,0.1", "--body", "rounded"],
        {"pose_noise": (0.003, 0.1), "body": "rounded"},
    ),
    "noise_model": (
        ["--objects", "6", "--views", "10", "--noise", "box:0.03", "--outliers", "0.1"],
        ["--noise-model", "edge_noise=0.02,edge_noise_px=1.5,edge_correlation=0.25", "--body", "cuboid"],
        {"noise_model": {"edge_noise_px": 1.5, "edge_noise": 0.02, "edge_correlation": 0.25}, "body": "cuboid"},
    ),
    "cross-validation": (
        ["--objects", "6", "--views", "12", "--noise", "box:0.02", "--outliers", "0.1", "--trajectory", "orbit"],
        ["--cross-validate"],
        {"cross_validate": True},
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
    same(estimates.half_extents, of("body", "half_extents"))
    same(estimates.quaternions, of("body", "rotation"))
    same(as_written(estimates.half_extents_sd, 6), [o.get("half_extents_sd") for o in objects])
    same(as_written(estimates.rotation_sd_deg, 6), [o.get("rotation_sd_deg") for o in objects])
    same(estimates.bounds_centers, of("bounds", "center"))
    same(estimates.bounds_half_extents, of("bounds", "half_extents"))
    same(estimates.bounds_quaternions, of("bounds", "rotation"))
    same(as_written(estimates.bounds_half_extents_sd, 6), of("bounds", "half_extents_sd"))
    assert [kind and kind.split(":")[0] for kind in estimates.kinds] == of("body", "kind")
    same(as_written(estimates.covariances, 9), of("covariance", "matrix"))
    same(as_written(estimates.center_sd, 6), [o.get("center_sd") for o in objects])
    same(as_written(estimates.rms_residuals, 6), [o.get("residual_px") for o in objects])
    assert estimates.views_used.tolist() == [o["views_used"] for o in objects]
    same(as_written(estimates.relative_residuals, 6), of("goodness_of_fit", "relative_residual"))
    same(as_written(estimates.normalized_residuals, 6), of("goodness_of_fit", "normalized_residual"))
    for others, expected in zip(estimates.alternatives, [o.get("alternatives", []) for o in objects], strict=True):
        for other, wanted in zip(others, expected, strict=True):
            assert other.log_odds == wanted["log_odds"]
            body = wanted["body"]
            assert other.kind.split(":")[0] == body["kind"]
            same([other.center, other.half_extents], [body["center"], body["half_extents"]])
            same([other.quaternion], [body["rotation"]])


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
    checked = [o.get("cross_validation", {}) for o in objects]
    same(estimates.predicted_ious, [c.get("iou") for c in checked])
    assert estimates.suspect_views == [c.get("suspect_view") for c in checked]
    assert any(checked) == keywords.get("cross_validate", False)
    assert estimates.cross_validation == read_json(result)["localization"]["cross_validation"]

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
        frames=[frame_index[d["frame"]] for d in detections],
        boxes=np.array([d.get("box", [np.nan] * 4) for d in detections]),
        ellipses=np.array(ellipses),
        objects=np.array([names.index(d["object"]) for d in detections]),
        up=document.get("up"),
        length_unit=document.get("length_unit"),
        **keywords,
    )
    assert of_arrays.object_ids.tolist() == list(range(len(names)))
    compare(of_arrays, objects)


# Objects on a street that a detector misses or sees twice; some of what is found is uncertain.
STREET = ["--trajectory", "street", "--objects", "14", "--views", "14", "--noise", "box:0.05", "--no-ids"]
DETECTOR = ["--misses", "0.3", "--duplicates", "0.2"]


def test_association(program: Program, tmp_path: Path) -> None:
    scene, truth, result = tmp_path / "scene.json", tmp_path / "truth.json", tmp_path / "result.json"
    program("synth", "-q", "-o", scene, *STREET, *DETECTOR, "--ground-truth", truth)
    program("localize", "-q", scene, "-o", result)
    loaded = quadlift.Scene.read(scene)
    assert loaded.object_ids == []
    estimates = loaded.localize()
    estimates.to_scene().write(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == result.read_bytes()
    document = read_json(result)
    assert estimates.object_ids.tolist() == [o["id"] for o in document["objects"]]
    compare(estimates, document["objects"])
    found = [estimates.object_ids[k] if k >= 0 else None for k in estimates.object_indices]
    assert found == [d.get("object") for d in document["detections"]]
    # What was found about identities.
    assert estimates.association is not None
    assert estimates.association == document["localization"]["association"]
    assert estimates.warnings == [o.get("warnings", []) for o in document["objects"]]
    doubts = {o["id"]: o.get("uncertain") for o in document["localization"]["association"]["objects"]}
    assert estimates.uncertain == [doubts[name] for name in estimates.object_ids]
    assert "may be moving, or be several" in next(doubt for doubt in estimates.uncertain if doubt)
    assert estimates.association["associated"] == sum(k >= 0 for k in estimates.object_indices)
    associated, objects = loaded.associate()
    assert [o.id for o in objects] == associated.object_ids == estimates.object_ids.tolist()
    assert [o.uncertain for o in objects] == estimates.uncertain
    # Nothing is found about identities that are given.
    given = associated.localize(associate="never")
    assert given.association is None
    assert set(given.uncertain) == {None}


ASSOCIATIONS: dict[str, tuple[list[str], dict[str, Any]]] = {
    "default": ([], {}),
    "trust": (["--ids", "trust", "--min-views", "4"], {"ids": "trust", "min_views": 4}),
    "skipped detections": (
        ["--max-overlap", "0.5", "--edge-noise-px", "3", "--thorough"],
        {"max_overlap": 0.5, "edge_noise_px": 3, "thorough": True},
    ),
    "scores": (["--min-score", "0.5"], {"min_score": 0.5}),
}


@pytest.mark.parametrize("name", list(ASSOCIATIONS))
def test_options_of_association(name: str, program: Program, tmp_path: Path) -> None:
    options, keywords = ASSOCIATIONS[name]
    scene = tmp_path / "scene.json"
    program("synth", "-q", "-o", scene, *STREET, *DETECTOR)
    # With a score for each detection, and objects that it does not keep.
    document = read_json(scene)
    for k, detection in enumerate(document["detections"]):
        detection["score"] = (k % 10) / 10
    quadlift.Scene.from_dict(document).write(scene)
    program("associate", "-q", scene, "-o", tmp_path / "theirs.json", *options)
    associated, _ = quadlift.Scene.read(scene).associate(**keywords)
    associated.write(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "theirs.json").read_bytes()
    assert associated.object_count == 0


def test_evaluation(program: Program, tmp_path: Path) -> None:
    scene, result = tmp_path / "scene.json", tmp_path / "result.json"
    program("synth", "-q", "-o", scene, "--objects", "4", "--views", "10", "--noise", "box:0.02")
    program("localize", "-q", scene, "-o", result)
    truth = quadlift.Scene.read(scene)
    estimates = truth.localize()
    scores = estimates.to_scene().evaluate(truth)
    same_scores(scores, program.json("evaluate", result, scene, "--report", tmp_path / "theirs.html"))
    assert (len(scores.objects), scores.failures, scores.matched_by) == (4, 0, "ids")
    assert scores.identities is None
    assert scores.mean["iou3d"] is not None
    assert scores.mean["iou3d"] > 0.7
    # The page shows the same scores.
    estimates.report(tmp_path / "ours.html", truth)
    shown = page_data(tmp_path / "ours.html")["scores"]
    assert shown == page_data(tmp_path / "theirs.html")["scores"]
    assert shown["mean"][0] == pytest.approx(scores.mean["iou3d"], abs=1e-3)
    # Without a truth, or with one of other objects, there are none.
    estimates.report(tmp_path / "ours.html")
    assert page_data(tmp_path / "ours.html").get("scores") is None


def same_scores(scores: quadlift.Evaluation, expected: dict[str, Any]) -> None:
    assert scores.objects == expected.get("objects", [])
    assert scores.mean == {name: m and m["value"] for name, m in expected.get("mean", {}).items()}
    for name in ("found", "identities", "matched_by"):
        assert getattr(scores, name) == expected.get(name)
    assert scores.unmatched == expected.get("unmatched", [])


def test_identities_are_scored(program: Program, tmp_path: Path) -> None:
    scene, truth, result = tmp_path / "scene.json", tmp_path / "truth.json", tmp_path / "result.json"
    program("synth", "-q", "-o", scene, *STREET, *DETECTOR, "--ground-truth", truth)
    program("localize", "-q", scene, "-o", result)
    loaded, true = quadlift.Scene.read(scene), quadlift.Scene.read(truth)
    estimates = loaded.localize().to_scene()
    scores = estimates.evaluate(true)
    same_scores(scores, program.json("evaluate", result, truth))
    assert scores.identities is not None
    assert 0.5 < scores.identities["f1"] < 1.0
    assert scores.matched_by == "overlap"
    same_scores(estimates.evaluate(true, match="overlap"), program.json("evaluate", result, truth))
    # Detections alone.
    program("associate", "-q", scene, "-o", tmp_path / "associated.json")
    associated, _ = loaded.associate()
    scores = associated.evaluate(true)
    same_scores(scores, program.json("evaluate", tmp_path / "associated.json", truth))
    assert (scores.objects, scores.mean, scores.matched_by) == ([], {}, None)
    with pytest.raises(quadlift.QuadliftError, match=r'no object of the estimate .*match="overlap" pairs them'):
        estimates.evaluate(true, match="ids")
    with pytest.raises(quadlift.QuadliftError, match='the truth: there are no detections of the source "yolo"'):
        estimates.with_detections(frames=[0], boxes=[[0, 0, 1, 1]], source="yolo").evaluate(true, source="yolo")
    with pytest.raises(quadlift.QuadliftError, match=r"several sources \(.*\): source=\.\.\. selects"):
        associated.with_detections(frames=[0], boxes=[[0, 0, 1, 1]], source="yolo").evaluate(true)
    # With objects to compare, that is a note.
    both = estimates.with_detections(frames=[0], boxes=[[0, 0, 1, 1]], source="yolo").evaluate(true)
    assert both.identities is None
    assert "several sources" in both.notes[0]
    assert both.objects


def test_masks(program: Program, tmp_path: Path) -> None:
    shutil.copytree(RENDERED, tmp_path, dirs_exist_ok=True)
    scene, result, ours = tmp_path / "scene.json", tmp_path / "result.json", tmp_path / "ours.json"
    program("localize", "-q", scene, "-o", result, "--measurement", "mask")
    loaded = quadlift.Scene.read(scene)
    estimates = loaded.localize(measurement="mask")
    estimates.to_scene().write(ours)
    assert ours.read_bytes() == result.read_bytes()
    # Elsewhere the paths of the images are absolute.
    (tmp_path / "other").mkdir()
    loaded.write(tmp_path / "other" / "scene.json")
    moved = quadlift.Scene.read(tmp_path / "other" / "scene.json").localize(measurement="mask")
    np.testing.assert_array_equal(moved.centers, estimates.centers)


def test_why_views_are_rejected(program: Program, tmp_path: Path) -> None:
    scene, result = tmp_path / "scene.json", tmp_path / "result.json"
    program("synth", "-q", "-o", scene, *SCENES["boxes"][0])
    program("localize", "-q", scene, "-o", result)
    estimates = quadlift.Scene.read(scene).localize()
    views = {(o["id"], view["frame"]): view for o in read_json(result)["objects"] for view in o["view_residuals_px"]}
    detections = read_json(scene)["detections"]
    expected = [views[d["object"], d["frame"]].get("rejection_reason") for d in detections]
    assert estimates.rejection_reason == expected
    assert "residual" in expected
    assert [why is None for why in expected] == estimates.inliers.tolist()


def test_other_bodies_that_fit_as_well(program: Program, tmp_path: Path) -> None:
    scene, result = tmp_path / "scene.json", tmp_path / "result.json"
    shape = ["--objects", "12", "--views", "4", "--body", "cuboid", "--trajectory", "arc:60", "--noise", "box:0.05"]
    program("synth", "-q", "-o", scene, *shape)
    program("localize", "-q", scene, "-o", result, "--body", "cuboid")
    estimates = quadlift.Scene.read(scene).localize(body="cuboid")
    compare(estimates, read_json(result)["objects"])
    assert any(estimates.alternatives)
    for others, warnings in zip(estimates.alternatives, estimates.warnings, strict=True):
        is_ambiguous = any(warning.startswith("ambiguous") for warning in warnings)
        assert is_ambiguous == bool(others and others[0].log_odds > -0.5)


def test_calibrated_regions(program: Program, tmp_path: Path) -> None:
    known, result, new, out = (tmp_path / f"{name}.json" for name in ("known", "result", "new", "out"))
    for path, seed in ((known, "1"), (new, "2")):
        program("synth", "-q", "-o", path, "--objects", "30", "--views", "10", "--noise", "box:0.05", "--seed", seed)
    program("localize", "-q", known, "-o", result, "--body", "ellipsoid")
    program("localize", "-q", new, "-o", out, "--body", "ellipsoid", "--coverage", result, known)
    scenes = {path: quadlift.Scene.read(path) for path in (known, result, new)}
    pair = (scenes[result], scenes[known])
    estimates = scenes[new].localize(body="ellipsoid", coverage=[pair])
    assert estimates.coverage is not None
    assert estimates.coverage == read_json(out)["localization"]["coverage"]
    assert estimates.coverage["objects"] == 30
    estimates.to_scene().write(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == out.read_bytes()
    # Estimates are results too; the region with the limit holds as many of the known objects as it promises.
    ours = scenes[known].localize(body="ellipsoid")
    assert ours.coverage is None
    again = scenes[new].localize(body="ellipsoid", coverage=[(ours, scenes[known])]).coverage
    assert again is not None
    assert again["squared_distance"] == estimates.coverage["squared_distance"]
    truths = {o["id"]: o["ellipsoid"]["center"] for o in read_json(known)["objects"]}
    errors = ours.centers - np.array([truths[name] for name in ours.object_ids])
    distances = np.sort(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(ours.covariances[:, :3, :3]), errors))
    # ceil(0.9 * 31) = 28 of 30.
    np.testing.assert_allclose(again["squared_distance"]["center"]["0.9"], distances[27], rtol=1e-6)
    with pytest.raises(quadlift.QuadliftError, match=r'coverage: .*no object that is "ok"'):
        scenes[new].localize(coverage=[(scenes[known], scenes[known])])
    with pytest.raises(quadlift.QuadliftError, match="coverage is an option of method"):
        scenes[new].localize(method="lfd", coverage=[pair])
    wrong: Any = [scenes[known]]
    with pytest.raises(quadlift.QuadliftError, match=r"coverage\[0\] is .*; expected a pair"):
        scenes[new].localize(coverage=wrong)
    wrong = [("result.json", scenes[known])]
    with pytest.raises(quadlift.QuadliftError, match=r"coverage\[0\]\[0\]"):
        scenes[new].localize(coverage=wrong)
