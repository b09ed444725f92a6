"""Arrays in, arrays out: what comes out, and that shapes and types make no difference."""

from __future__ import annotations

import itertools
import math
import signal
import threading
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import quadlift
from conftest import Arrays, Program, made_scene, made_truth
from quadlift import _core
from quadlift._arrays import FrameArrays


def test_each_object_has_a_kind_of_body(made: Arrays) -> None:
    cuboids = quadlift.localize(**made.arguments(), body="cuboid")
    assert (cuboids.body, cuboids.kinds) == ("cuboid", ["cuboid"] * 4)
    chosen = quadlift.localize(**made.arguments())
    kinds = set(chosen.kinds)
    assert chosen.body == (kinds.pop() if len(kinds) == 1 else "mixed")


def test_exact_boxes_give_the_true_bodies(made: Arrays) -> None:
    estimates = quadlift.localize(**made.arguments(), body="ellipsoid")
    centers, semi_axes = made_truth()
    assert len(estimates) == 4
    assert estimates.ok.all()
    np.testing.assert_allclose(estimates.centers, centers, atol=0.02)
    np.testing.assert_allclose(np.sort(estimates.half_extents), semi_axes, atol=0.05)
    for quaternion, rotation in zip(estimates.quaternions, estimates.rotations, strict=True):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        w, x, y, z = quaternion
        assert rotation[1, 0] == pytest.approx(2.0 * (x * y + w * z), abs=1e-12)
    assert estimates.covariances.shape == (4, 9, 9)
    np.testing.assert_array_equal(estimates.covariances, np.swapaxes(estimates.covariances, 1, 2))
    np.testing.assert_allclose(estimates.closest_ellipsoids(), estimates.half_extents)
    assert (estimates.half_extents_sd < 0.05).all()
    # The boxes are exact: bounds are those of the body.
    np.testing.assert_allclose(estimates.bounds_centers, estimates.centers, atol=0.01)
    np.testing.assert_allclose(estimates.bounds_half_extents, estimates.half_extents, atol=0.01)
    table = estimates.to_pandas()
    np.testing.assert_array_equal(table["bounds_half_extent_3"], estimates.bounds_half_extents[:, 2])
    np.testing.assert_array_equal(estimates[1].bounds_quaternion, estimates.bounds_quaternions[1])
    # So is the enclosing ellipsoid. Only asked for it is there.
    assert not any("enclosing" in record for record in estimates.to_scene().to_dict()["objects"])
    enclosed = quadlift.localize(**made.arguments(), body="ellipsoid", enclosing=True).to_scene().to_dict()["objects"]
    enclosing = np.array([record["enclosing"]["half_extents"] for record in enclosed])
    np.testing.assert_allclose(np.sort(enclosing), np.sort(estimates.half_extents), rtol=0.02, atol=0.005)
    assert estimates.views_used.tolist() == [6] * 4
    assert estimates.object_indices.tolist() == made.objects.tolist()
    assert estimates.inliers.all()
    assert (estimates.residuals < 1.0).all()


def test_a_wrong_box_is_an_outlier() -> None:
    made = made_scene(objects=3, views=12)
    made.boxes[5] += [150.0, 100.0, 180.0, 120.0]
    estimates = quadlift.localize(**made.arguments())
    assert np.flatnonzero(~estimates.inliers).tolist() == [5]


def test_objects_come_in_ascending_order(made: Arrays) -> None:
    arguments = made.arguments()
    expected = quadlift.localize(**arguments)
    relabelled = np.array([30, 10, 20, 5])[made.objects]
    found = quadlift.localize(**{**arguments, "objects": relabelled})
    assert found.object_ids.tolist() == [5, 10, 20, 30]
    np.testing.assert_array_equal(found.centers, expected.centers[[3, 1, 2, 0]])
    np.testing.assert_array_equal(found.object_ids[found.object_indices], relabelled)
    words = quadlift.localize(**{**arguments, "objects": np.array(["d", "b", "c", "a"])[made.objects]})
    assert words.object_ids.tolist() == ["a", "b", "c", "d"]
    np.testing.assert_array_equal(words.centers, found.centers)


def test_with_a_noise_model_objects_are_apart(made: Arrays) -> None:
    arguments = made.arguments()
    first = quadlift.localize(**arguments)
    options: dict[str, Any] = {"noise_model": first.noise, "body": first.body}
    whole = quadlift.localize(**arguments, **options)
    assert whole.noise == first.noise
    np.testing.assert_allclose(whole.centers, first.centers, atol=1e-4)
    rows = made.objects == 2
    alone = quadlift.localize(
        projections=made.projections,
        image_sizes=made.image_sizes,
        frames=made.frames[rows],
        boxes=made.boxes[rows],
        objects=["any name"] * int(rows.sum()),
        **options,
    )
    hidden = _core.occluded_edges(made.frames, made.boxes)
    assert not hidden[rows].any(), "nothing else is before it"
    np.testing.assert_array_equal(alone.centers[0], whole.centers[2])
    np.testing.assert_array_equal(alone.covariances[0], whole.covariances[2])


def test_occluded_edges() -> None:
    boxes = [[100, 50, 200, 100], [180, 40, 300, 150], [np.nan] * 4, [100, 50, 200, 100]]
    hidden = _core.occluded_edges(np.array([7, 7, 7, 8]), np.array(boxes, float))
    assert hidden.tolist() == [[False, False, True, False], [False] * 4, [False] * 4, [False] * 4]


def test_bad_rows_are_listed(made: Arrays) -> None:
    scene = quadlift.Scene.from_arrays(projections=made.projections)
    boxes = made.boxes.copy()
    boxes[3] = np.nan
    boxes[5] = boxes[5, [2, 1, 0, 3]]
    frame = made.frames.copy()
    frame[8] = 77
    frame[9] = frame[5] = 0
    problems = dict(scene._core.detection_problems({"frames": frame, "boxes": boxes}))
    assert sorted(problems) == [3, 5, 8]
    frames: FrameArrays = {
        "projections": made.projections * np.array([1.0, 0.0, 1.0, 1.0, 1.0, 1.0])[:, None, None],
        "frame_ids": list("abcdef"),
    }
    assert [row for row, _ in _core.frame_problems(frames)] == [1]


def test_repeated_detections_are_refused_by_row(made: Arrays) -> None:
    scene = quadlift.Scene.from_arrays(projections=made.projections)
    twice = 'the object "a" is detected twice in frame'
    with pytest.raises(quadlift.QuadliftError, match=rf'^row 2: {twice} "0" \(first in row 0\)$'):
        scene.with_detections(frames=[0, 1, 0], boxes=made.boxes[:3], objects=["a", "a", "a"])
    scene = scene.with_detections(frames=[0, 1], boxes=made.boxes[:2], objects=["a", "a"])
    with pytest.raises(
        quadlift.QuadliftError, match=rf'^row 1: {twice} "1" \(first by a detection that the scene has\)$'
    ):
        scene.with_detections(frames=[2, 1], boxes=made.boxes[:2], objects=["a", "a"])


def test_without_objects_they_are_found(made: Arrays) -> None:
    estimates = quadlift.localize(**{**made.arguments(), "objects": None})
    assert len(estimates) == 4
    nearest = [np.linalg.norm(made_truth()[0] - c, axis=1).min() for c in estimates.centers]
    assert max(nearest) < 0.1
    # Ids that some detections have are kept.
    partly = made.objects.copy()
    partly[::5] = -1
    kept = quadlift.localize(**{**made.arguments(), "objects": partly})
    assert sorted(kept.object_ids.tolist()) == ["0", "1", "2", "3"]
    never = quadlift.localize(**{**made.arguments(), "objects": partly}, associate="never")
    assert never.object_ids.tolist() == [0, 1, 2, 3]
    assert never.skipped["without_object"] == 5
    assert (never.object_indices[::5] == -1).all()


@settings(max_examples=25, deadline=None)
@given(
    dtype=st.sampled_from([np.float64, np.float32, ">f8", np.float16]),
    index=st.sampled_from([np.int64, np.int32, np.uint8, np.uint64, np.int16]),
    layout=st.sampled_from(["C", "F", "strided", "reversed", "list"]),
)
def test_types_and_layouts_make_no_difference(dtype: Any, index: Any, layout: str) -> None:
    made = made_scene(objects=2, views=4)
    # Numbers that every type holds exactly.
    boxes = np.round(made.boxes).astype(np.float16).astype(np.float64)

    def laid_out(values: Any) -> Any:
        if layout == "list":
            return values.tolist()
        if layout == "strided":
            wide = np.zeros((2 * values.shape[0], *values.shape[1:]), values.dtype)
            wide[::2] = values
            return wide[::2]
        if layout == "reversed":
            return np.ascontiguousarray(values[::-1])[::-1]
        return np.array(values, order="F" if layout == "F" else "C")

    expected = quadlift.localize(**{**made.arguments(), "boxes": boxes}, method="planes")
    found = quadlift.localize(
        projections=laid_out(made.projections),
        image_sizes=laid_out(made.image_sizes),
        frames=laid_out(made.frames.astype(index)),
        boxes=laid_out(boxes.astype(dtype)),
        objects=laid_out(made.objects.astype(index)),
        method="planes",
    )
    np.testing.assert_array_equal(found.centers, expected.centers)
    np.testing.assert_array_equal(found.half_extents, expected.half_extents)


@settings(max_examples=60, deadline=None)
@example(shape=[0, 3, 4], name="projections")
@given(
    shape=st.lists(st.integers(0, 6), max_size=4), name=st.sampled_from(["boxes", "projections", "scores", "frames"])
)
def test_wrong_shapes_are_named(shape: list[int], name: str) -> None:
    made = made_scene(objects=2, views=5)
    right = {"boxes": (10, 4), "projections": (5, 3, 4), "scores": (10,), "frames": (10,)}[name]
    value = np.zeros(shape, dtype=np.int64)
    if tuple(shape) == right:
        return
    with pytest.raises(quadlift.QuadliftError, match=name):
        quadlift.localize(**{**made.arguments(), name: value})


def test_intrinsics_and_poses_are_projections(made: Arrays) -> None:
    k = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    poses = np.linalg.inv(k) @ made.projections
    arguments = made.arguments()
    del arguments["projections"]
    expected = quadlift.localize(**made.arguments())
    below = np.tile([0.0, 0.0, 0.0, 1.0], (6, 1, 1))
    for intrinsics, rows in ((k, poses), (np.tile(k, (6, 1, 1)), poses), (k, np.concatenate([poses, below], axis=1))):
        found = quadlift.localize(**arguments, intrinsics=intrinsics, cam_from_world=rows)
        np.testing.assert_allclose(found.centers, expected.centers, atol=1e-6)


def test_ellipses_and_masks(made: Arrays) -> None:
    x0, y0, x1, y1 = made.boxes.T
    center, half = np.column_stack([x0 + x1, y0 + y1]) / 2, np.column_stack([x1 - x0, y1 - y0]) / 2
    arguments = made.arguments()
    ellipses = np.column_stack([center, half, np.zeros(len(half))])
    found = quadlift.localize(**{**arguments, "boxes": None}, ellipses=ellipses)
    assert found.ok.all()
    rows, columns = np.mgrid[:480, :640] + 0.5
    masks = [
        ((columns - c[0]) / h[0]) ** 2 + ((rows - c[1]) / h[1]) ** 2 <= 1.0 for c, h in zip(center, half, strict=True)
    ]
    masked = quadlift.localize(**arguments, masks=masks, measurement="mask")
    np.testing.assert_allclose(masked.centers, found.centers, atol=0.1)


def test_tables(made: Arrays) -> None:
    pytest.importorskip("pandas")
    pa = pytest.importorskip("pyarrow")
    # The last object has a single view, and no body.
    keep = (made.objects < 3) | (made.frames == 0)
    arguments = {
        **made.arguments(),
        "frames": made.frames[keep],
        "boxes": made.boxes[keep],
        "objects": made.objects[keep],
    }
    estimates = quadlift.localize(**arguments, categories=["cup"] * int(keep.sum()))
    assert estimates.status.tolist() == ["ok", "ok", "ok", "too_few_views"]
    frame = estimates.to_pandas()
    assert frame["object"].tolist() == [0, 1, 2, 3]
    assert frame["category"].tolist() == ["cup"] * 4
    np.testing.assert_array_equal(frame[["center_x", "center_y", "center_z"]].to_numpy(), estimates.centers)
    sizes = frame[[f"half_extent_{k}" for k in (1, 2, 3)]].to_numpy()
    np.testing.assert_array_equal(sizes, estimates.half_extents)
    assert frame["kind"].isna().tolist() == [False] * 3 + [True]
    assert frame["yaw_deg"].isna().all(), "there is no up"
    table = estimates.to_arrow()
    assert table["half_extents"].to_pylist() == [*estimates.half_extents[:3].tolist(), None]
    assert table["covariance"].type == pa.list_(pa.float64())
    assert table["rms_residual_px"].null_count == 1


def test_tables_survive_parquet(made: Arrays, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    one = made.frames == 0
    arguments = {**made.arguments(), "frames": made.frames[one], "boxes": made.boxes[one], "objects": made.objects[one]}
    table = quadlift.localize(**arguments).to_arrow()
    assert table["center"].null_count == len(table)
    parquet.write_table(table, tmp_path / "estimates.parquet")
    assert parquet.read_table(tmp_path / "estimates.parquet").equals(table)


def test_an_empty_list_is_no_detection(made: Arrays) -> None:
    cameras = quadlift.Scene.from_arrays(projections=made.projections)
    assert len(cameras.with_detections(frames=[], boxes=[])) == 0
    # Numbers with a point, as tables make of whole ones.
    arguments = {**made.arguments(), "frames": made.frames * 1.0}
    expected = quadlift.localize(**made.arguments())
    np.testing.assert_array_equal(quadlift.localize(**arguments).centers, expected.centers)


def test_positional_arguments(made: Arrays) -> None:
    """Cameras, poses, boxes, frames and objects, as their names tell."""
    intrinsics = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    poses = np.linalg.inv(intrinsics) @ made.projections
    expected = quadlift.localize(**made.arguments())
    found = quadlift.localize(intrinsics, poses, made.boxes, made.frames, made.objects, image_sizes=(640, 480))
    np.testing.assert_allclose(found.centers, expected.centers, atol=1e-9)
    scene = quadlift.Scene.from_arrays(intrinsics, poses, image_sizes=(640, 480))
    scene = scene.with_detections(made.boxes, made.frames, made.objects)
    np.testing.assert_array_equal(scene.localize().centers, found.centers)


def test_scenes_take_the_arrays_of_localize(made: Arrays) -> None:
    extent = made.boxes[:, 2:] - made.boxes[:, :2]
    arrays: dict[str, Any] = {
        **made.arguments(),
        "frame_ids": list("abcdef"),
        "images": [f"{k}.jpg" for k in range(6)],
        "name": "table",
        "up": "z",
        "length_unit": "m",
        "scores": np.linspace(0.5, 1.0, len(made.boxes)),
        "categories": ["cup"] * len(made.boxes),
        "ellipses": np.column_stack([(made.boxes[:, :2] + made.boxes[:, 2:]) / 2, extent / 2, extent[:, 0] * 0]),
        "orientation": 1,
    }
    # All of the fields but projections, for which there are cameras and lenses, and those that stand for boxes.
    left_out = {"distortion", "masks", "outlines", "oriented_boxes", "depths", "boxes3d"}
    fields = {**quadlift.FrameFields.__annotations__, **quadlift.DetectionFields.__annotations__}
    assert set(fields) - set(arrays) == left_out
    scene = quadlift.Scene.from_arrays(**arrays)
    expected = quadlift.localize(**arrays)
    np.testing.assert_array_equal(scene.localize().centers, expected.centers)
    assert scene.to_dict()["detections"][0]["frame"] == "a"
    by_id = {**arrays, "frames": np.array(list("abcdef"))[made.frames]}
    assert quadlift.Scene.from_arrays(**by_id).to_dict() == scene.to_dict()
    np.testing.assert_array_equal(quadlift.localize(**by_id).centers, expected.centers)
    cameras = quadlift.Scene.from_arrays(projections=made.projections, frame_ids=list("abcdef"))
    assert len(cameras) == 0
    added = cameras.with_detections(made.boxes, by_id["frames"].tolist(), made.objects)
    assert added.to_dict() == cameras.with_detections(made.boxes, made.frames, made.objects).to_dict()
    wrong: dict[str, Any] = {"lamda": 3}
    with pytest.raises(TypeError, match=r"from_arrays\(\) got an unexpected keyword argument 'lamda'"):
        quadlift.Scene.from_arrays(**arrays, **wrong)


def test_boxes_of_images_with_a_lens(made: Arrays) -> None:
    """The boxes around distorted outlines, computed here."""
    k1, k2, p1, p2, k3 = coefficients = np.array([-0.6, 0.2, 0.01, -0.02, -0.01])
    intrinsics = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    poses = np.linalg.inv(intrinsics) @ made.projections
    rng = np.random.default_rng(0)
    centers, half = rng.uniform(-2.0, 2.0, (4, 3)), rng.uniform(0.3, 0.8, (4, 3))
    directions = np.random.default_rng(1).normal(size=(20000, 3))
    surface = centers[:, None] + half[:, None] * (directions / np.linalg.norm(directions, axis=1, keepdims=True))
    boxes = []
    for pose in poses:
        points = surface @ pose[:, :3].T + pose[:, 3]
        x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
        square = x * x + y * y
        radial = 1 + k1 * square + k2 * square**2 + k3 * square**3
        u = 600.0 * (x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x)) + 320.0
        v = 600.0 * (y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y) + 240.0
        boxes.append(np.stack([u.min(1), v.min(1), u.max(1), v.max(1)], axis=1))
    arrays: dict[str, Any] = {"boxes": np.concatenate(boxes), "frames": made.frames, "objects": made.objects}
    cameras: dict[str, Any] = {"intrinsics": intrinsics, "cam_from_world": poses, "image_sizes": (640, 480)}
    found = quadlift.localize(**cameras, **arrays, distortion=coefficients)
    np.testing.assert_allclose(found.centers, centers, atol=0.02)
    straight = quadlift.localize(**cameras, **arrays)
    assert np.linalg.norm(straight.centers - centers, axis=1).max() > 0.06
    scene = quadlift.Scene.from_arrays(**cameras, **arrays, distortion=coefficients[np.newaxis])
    np.testing.assert_array_equal(scene.localize().centers, found.centers)
    [camera] = scene.to_dict()["cameras"]
    assert camera["model"] == "FULL_OPENCV"
    assert camera["params"] == [600.0, 600.0, 320.0, 240.0, *coefficients, 0.0, 0.0, 0.0]
    # One for each frame, of which some have no lens.
    each = np.zeros((6, 4))
    each[0] = coefficients[:4]
    models = [c["model"] for c in quadlift.Scene.from_arrays(**cameras, distortion=each).to_dict()["cameras"]]
    assert models == ["OPENCV"] + ["PINHOLE"] * 5


def test_results_carry_the_detections_that_were_used(made: Arrays) -> None:
    masks = [np.ones((480, 640))] * 24
    marked = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480)).with_detections(
        made.boxes, made.frames, made.objects, source="yolo", masks=masks, scores=np.full(24, 0.5)
    )
    marked = marked.with_detections(made.boxes[:5], made.frames[:5], source="other")
    estimates = marked.localize(source="yolo")
    assert estimates.association is None
    result = estimates.to_scene()
    kept = [{k: v for k, v in d.items() if k != "mask"} for d in marked.to_dict()["detections"][:24]]
    assert result.to_dict()["detections"] == kept
    # They are all that is needed to localize again.
    np.testing.assert_array_equal(result.localize().centers, estimates.centers)


@pytest.mark.parametrize("body", ["ellipsoid", "cuboid", "cylinder"])
def test_sizes_in_pandas_are_those_of_the_truth(body: str, program: Program, tmp_path: Path) -> None:
    pytest.importorskip("pandas")
    relative, inside = [], []
    for seed in ("11", "12", "13"):
        options = ["--objects", "20", "--views", "20", "--noise", "box:0.03", "--body", body, "--seed", seed]
        program("synth", "-q", "-o", tmp_path / "scene.json", *options)
        scene = quadlift.Scene.read(tmp_path / "scene.json")
        estimates = scene.localize()
        table = estimates.to_pandas().set_index("object")
        assert (table["kind"] == body).mean() >= 0.8
        for truth in scene.to_dict()["objects"]:
            row = table.loc[truth["id"]]
            if row["kind"] != body:
                continue
            true = truth[body]
            half = true.get("semi_axes") or true.get("half_extents") or [*true["radii"], true["half_height"]]
            # The axes of both bodies may have other names.
            w, x, y, z = true["rotation"]
            axes = np.array([[w, -z, y], [z, w, -x], [-y, x, w]])
            axes = axes @ axes + np.outer([x, y, z], [x, y, z])
            cosines = np.abs(estimates[truth["id"]].rotation.T @ axes)
            order = max(itertools.permutations(range(3)), key=lambda names: cosines[range(3), names].sum())
            found = row[[f"half_extent_{k}" for k in (1, 2, 3)]].to_numpy(float)
            sd = row[[f"half_extent_{k}_sd" for k in (1, 2, 3)]].to_numpy(float)
            error = np.abs(found - np.array(half)[list(order)])
            relative.extend(error / found)
            inside.extend(error <= 1.96 * sd)
    assert np.median(relative) < 0.05
    assert np.mean(inside) >= 0.85


def test_estimates_are_a_sequence_of_objects(made: Arrays) -> None:
    ids = np.array(["cup", "mug", "jar", "pot"])[made.objects]
    given = {**made.arguments(), "objects": ids, "categories": ["thing"] * len(ids)}
    estimates = quadlift.localize(**given)
    found = list(estimates)
    assert [one.id for one in found] == estimates.object_ids.tolist() == ["cup", "jar", "mug", "pot"]
    assert (len(found), estimates[0].id, estimates[-1].id, estimates[np.int64(1)].id) == (4, "cup", "pot", "jar")
    assert [one.id for one in estimates[1:3]] == ["jar", "mug"]
    jar = estimates["jar"]
    assert (jar.category, jar.status, jar.ok, jar.views_used) == ("thing", "ok", True, 6)
    np.testing.assert_array_equal(jar.center, estimates.centers[1])
    np.testing.assert_array_equal(jar.covariance, estimates.covariances[1])
    # Each array with a row for each object is a field of the object, in the singular.
    others = {"object_ids": "id", "categories": "category", "alternatives": "alternatives"}
    of_detections = {"object_indices", "inliers", "residuals", "rejection_reason", "problems", "cue_scales"}
    for name, value in vars(estimates).items():
        if isinstance(value, list | np.ndarray) and name not in of_detections:
            singular = others.get(name, name if hasattr(jar, name) else name.removesuffix("s"))
            np.testing.assert_array_equal(getattr(jar, singular), value[1], err_msg=name)
    assert repr(jar).startswith("<quadlift.Estimate 'jar' (thing): ok, center ")
    assert "jar" in estimates
    assert "lid" not in estimates
    with pytest.raises(KeyError, match="there is no object 'lid'; there are 4: cup, jar, mug, pot"):
        estimates["lid"]
    with pytest.raises(IndexError, match="the index is 4; there are 4 objects"):
        estimates[4]
    wrong: Any = 0.5
    with pytest.raises(TypeError, match=r"the index is 0\.5; expected the number of a row, the id of an object"):
        estimates[wrong]
    # Numbers are rows; an id that is a number is given as text.
    numbered = quadlift.localize(**{**made.arguments(), "objects": made.objects + 10})
    assert (numbered[0].id, numbered["13"].id, 12 in numbered) == (10, 13, True)


def test_progress_is_told_and_other_threads_go_on(made: Arrays) -> None:
    told: list[tuple[int, int]] = []
    quadlift.localize(**made.arguments(), progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (4, 4)
    assert told == sorted(told)


class _StopError(Exception):
    pass


def _large() -> dict[str, Any]:
    """Some seconds of work."""
    made = made_scene(objects=40, views=200)
    return made.arguments()


def test_an_exception_in_the_callback_ends_the_work() -> None:
    def stop(done: int, total: int) -> None:
        raise _StopError

    with pytest.raises(_StopError):
        quadlift.localize(**_large(), progress=stop, threads=1)


def test_ctrl_c_ends_the_work() -> None:
    arguments = _large()

    def work() -> None:
        for _ in range(100):
            quadlift.localize(**arguments, threads=1)

    # A process that a script has started in the background ignores the signal, and Python then leaves it so.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer = threading.Timer(0.02, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            work()
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)


def test_threads_do_not_change_the_result(made: Arrays) -> None:
    one, two = (quadlift.localize(**made.arguments(), threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.covariances, two.covariances)
    assert not math.isnan(one.seconds)


def test_the_order_of_the_detections_makes_no_difference() -> None:
    made = made_scene(objects=3, views=12)
    # With noise, so that every detection has a residual of its own.
    made.boxes += np.random.default_rng(1).normal(size=made.boxes.shape)
    made.boxes[5] += [150.0, 100.0, 180.0, 120.0]
    expected = quadlift.localize(**made.arguments())
    order = np.random.default_rng(3).permutation(len(made.frames))
    rows = {name: getattr(made, name)[order] for name in ("frames", "boxes", "objects")}
    found = quadlift.localize(**{**made.arguments(), **rows})
    np.testing.assert_array_equal(found.inliers, expected.inliers[order])
    np.testing.assert_allclose(found.residuals, expected.residuals[order], rtol=1e-3)
    assert not expected.inliers.all()
