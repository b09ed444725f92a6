"""Depths and 3D boxes as arrays: the same as in scene files, NaN for none, errors by row."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from numpy.typing import NDArray

import quadlift
from conftest import Arrays, Program, made_scene, read_json
from quadlift import tables


@dataclass
class Cued:
    """A scene with depths and 3D boxes as a document and as arrays."""

    document: dict[str, Any]
    frames: dict[str, Any] = field(init=False)
    found: dict[str, Any] = field(init=False)

    def __post_init__(self) -> None:
        frames, detections = self.document["frames"], self.document["detections"]
        fx, fy, cx, cy = self.document["cameras"][0]["params"]
        self.frames = {
            "intrinsics": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
            "cam_from_world": np.array([frame["cam_from_world"] for frame in frames]),
            "image_sizes": [self.document["cameras"][0][side] for side in ("width", "height")],
            "up": self.document["up"],
        }
        place = {frame["id"]: k for k, frame in enumerate(frames)}
        boxes3d = [d["box3d"] for d in detections]
        self.found = {
            "frames": [place[d["frame"]] for d in detections],
            "objects": [d["object"] for d in detections],
            "boxes": np.array([d["box"] for d in detections]),
            "depths": {"median": np.array([d["depth"]["median"] for d in detections]), "source": "depth"},
            "boxes3d": {
                **{name: np.array([b[name] for b in boxes3d]) for name in ("center", "half_extents", "rotation")},
                "source": [b["source"] for b in boxes3d],
            },
        }

    def in_world(self) -> dict[str, Any]:
        """The 3D boxes in the world."""
        poses = self.frames["cam_from_world"][self.found["frames"]]
        turns, shifts = poses[:, :, :3], poses[:, :, 3]
        box3d = self.found["boxes3d"]
        centers = np.einsum("nji,nj->ni", turns, box3d["center"] - shifts)
        rotations = np.array([product(inverse(of(r)), q) for r, q in zip(turns, box3d["rotation"], strict=True)])
        return {**box3d, "center": centers, "rotation": rotations, "frame": "world"}


def of(r: NDArray[np.float64]) -> NDArray[np.float64]:
    """The quaternion of a rotation: the eigenvector of Bar-Itzhack's matrix, w first."""
    k = np.zeros((4, 4))
    k[1:, 1:] = r + r.T - np.trace(r) * np.eye(3)
    k[0, 0] = np.trace(r)
    k[0, 1:] = k[1:, 0] = [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]
    values, vectors = np.linalg.eigh(k)
    found: NDArray[np.float64] = vectors[:, np.argmax(values)]
    return found


def inverse(q: NDArray[np.float64]) -> NDArray[np.float64]:
    return q * [1.0, -1.0, -1.0, -1.0]


def product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:]))])


@pytest.fixture(scope="module")
def cued(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Cued:
    path = tmp_path_factory.mktemp("cues") / "scene.json"
    options = ["--objects", "12", "--views", "4", "--noise", "box:0.03", "--cues", "depth,box3d", "--seed", "4"]
    program("synth", "-q", "-o", path, *options)
    return Cued(read_json(path))


def test_arrays_give_what_the_file_gives(cued: Cued) -> None:
    of_file = quadlift.Scene.from_dict(cued.document).localize()
    of_arrays = quadlift.localize(**cued.frames, **cued.found)
    rows = [list(of_file.object_ids).index(name) for name in of_arrays.object_ids]
    np.testing.assert_array_equal(of_arrays.centers, of_file.centers[rows])
    np.testing.assert_array_equal(of_arrays.covariances, of_file.covariances[rows])
    assert of_arrays.cue_scales == of_file.cue_scales
    (depth,) = [scale for scale in of_arrays.cue_scales if scale["quantity"] == "depth"]
    assert depth["source"] == "depth"
    assert depth["factor"] == pytest.approx(1.1, abs=0.05)
    without = quadlift.localize(**cued.frames, **{**cued.found, "depths": None, "boxes3d": None})
    assert without.cue_scales == []
    assert np.abs(without.half_extents - of_arrays.half_extents).max() > 0.1


def test_boxes_of_the_world_are_those_of_the_cameras(cued: Cued) -> None:
    of_cameras = quadlift.localize(**cued.frames, **cued.found)
    of_world = quadlift.localize(**cued.frames, **{**cued.found, "boxes3d": cued.in_world()})
    np.testing.assert_allclose(of_world.centers, of_cameras.centers, atol=1e-6)
    np.testing.assert_allclose(of_world.half_extents, of_cameras.half_extents, atol=1e-6)
    # One frame of reference for each box.
    mixed = {**cued.found["boxes3d"], "frame": ["camera"] * len(cued.found["frames"])}
    mixed["frame"][0] = "world"
    world = cued.in_world()
    for name in ("center", "rotation"):
        mixed[name] = np.array([world[name][0], *mixed[name][1:]])
    of_both = quadlift.localize(**cued.frames, **{**cued.found, "boxes3d": mixed})
    np.testing.assert_allclose(of_both.centers, of_cameras.centers, atol=1e-6)


def test_scenes_keep_them(cued: Cued, tmp_path: Path) -> None:
    scene = quadlift.Scene.from_arrays(**cued.frames, frame_ids=[f["id"] for f in cued.document["frames"]])
    detections = {name: value for name, value in cued.found.items() if name != "objects"}
    scene = scene.with_detections(**detections, objects=cued.found["objects"])
    scene.write(tmp_path / "scene.json")
    for found in (scene.to_dict(), read_json(tmp_path / "scene.json")):
        for detection, expected in zip(found["detections"], cued.document["detections"], strict=True):
            assert detection["depth"] == expected["depth"]
            np.testing.assert_allclose(detection["box3d"]["rotation"], expected["box3d"]["rotation"], atol=1e-12)
            assert detection["box3d"]["center"] == expected["box3d"]["center"]
    again = quadlift.Scene.read(tmp_path / "scene.json").localize()
    np.testing.assert_allclose(again.centers, scene.localize().centers, atol=1e-9)


def one_view() -> tuple[Arrays, NDArray[np.float64]]:
    """The first view of a scene, and the true depths of the centers."""
    made = made_scene(views=6)
    centers = np.random.default_rng(0).uniform(-2.0, 2.0, (4, 3))
    depths = (made.projections[0] @ np.column_stack([centers, np.ones(4)]).T)[2]
    return Arrays(made.projections[:1], made.image_sizes[:1], made.frames[:4], made.boxes[:4], made.objects[:4]), depths


def test_one_view_with_a_depth_is_enough_and_nan_is_none() -> None:
    made, depths = one_view()
    without = quadlift.localize(**made.arguments())
    assert set(without.status) == {"too_few_views"}
    median = depths.copy()
    median[2] = np.nan
    estimates = quadlift.localize(**made.arguments(), depths=median, body="ellipsoid")
    assert estimates.status.tolist() == ["ok", "ok", "too_few_views", "ok"]
    assert all("only one view" in " ".join(told) for told in (estimates.warnings[k] for k in (0, 1, 3)))
    # Standard deviations weight depths against each other, of one source by its name or as one for each.
    depths_of_sources: list[quadlift.Depths] = [
        {"median": median, "sd": 0.1},
        {"median": median.tolist(), "sd": np.full(4, 0.1), "source": np.array(["a", None, "a", "b"])},
    ]
    for depth in depths_of_sources:
        assert quadlift.localize(**made.arguments(), depths=depth).ok.tolist() == [True, True, False, True]


def test_a_3d_box_needs_no_box(cued: Cued) -> None:
    found = {**cued.found, "boxes": None, "depths": None}
    estimates = quadlift.localize(**cued.frames, **found)
    assert estimates.ok.all()
    truth = {o["id"]: o["ellipsoid"]["center"] for o in cued.document["objects"]}
    expected = np.array([truth[name] for name in estimates.object_ids])
    assert np.median(np.linalg.norm(estimates.centers - expected, axis=1)) < 20.0


def test_deviations_and_covariances_are_those_of_files(cued: Cued) -> None:
    count = len(cued.found["frames"])
    distance = np.linspace(0.02, 0.2, count)
    distance[1] = np.nan
    root = np.random.default_rng(1).normal(size=(count, 9, 9)) * 0.1
    covariance = root @ np.swapaxes(root, 1, 2) + np.eye(9) * 0.01
    document = json.loads(json.dumps(cued.document))
    for k, detection in enumerate(document["detections"]):
        if k % 2:
            detection["box3d"]["covariance"] = covariance[k].tolist()
            covariance[k - 1] = np.nan
        detection["box3d"]["sd"] = {"size": 0.1, **({} if k == 1 else {"distance": distance[k]})}
    box3d = {**cued.found["boxes3d"], "sd": {"distance": distance, "size": 0.1}, "covariance": covariance}
    of_arrays = quadlift.localize(**cued.frames, **{**cued.found, "boxes3d": box3d})
    of_file = quadlift.Scene.from_dict(document).localize()
    rows = [list(of_file.object_ids).index(name) for name in of_arrays.object_ids]
    np.testing.assert_array_equal(of_arrays.centers, of_file.centers[rows])
    plain = quadlift.localize(**cued.frames, **cued.found)
    assert np.abs(of_arrays.centers - plain.centers).max() > 1e-4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"depths": [1.0, 2.0]}, "depths has the shape (2,); expected (4,), as many rows as frames"),
        ({"depths": [5.0, -1.0, 5.0, 5.0]}, "depths[1]: the depth is -1"),
        ({"depths": {"sd": 1.0}}, 'depths has no "median"'),
        ({"depths": {"median": [5.0] * 4, "sd": [1.0, 1.0, 0.0, 1.0]}}, "depths[2]: the standard deviation is 0"),
        (
            {"depths": {"median": [5.0] * 4, "scale": 2.0}},
            "depths has the field 'scale'; expected 'median', 'sd', 'source'",
        ),
        ({"depths": {"median": [5.0] * 4, "source": [1.5] * 4}}, 'depths["source"] has the dtype float64'),
        ({"boxes3d": np.zeros((4, 7))}, "boxes3d is a ndarray; expected a mapping"),
        ({"boxes3d": {"source": "net"}}, "boxes3d has neither center nor half_extents nor rotation"),
        ({"boxes3d": {"center": np.ones((4, 2))}}, 'boxes3d["center"] has the shape (4, 2); expected (M, 3)'),
        (
            {"boxes3d": {"center": -np.ones((4, 3))}},
            "boxes3d[0]: the center [-1.0, -1.0, -1.0] is not in front of the camera",
        ),
        (
            {"boxes3d": {"rotation": np.ones((4, 4))}},
            'boxes3d["rotation"][0]: [1.0, 1.0, 1.0, 1.0] is not a unit quaternion',
        ),
        ({"boxes3d": {"half_extents": [[1.0, 1.0, 0.0]] * 4}}, "boxes3d[0]: the half extents are [1.0, 1.0, 0.0]"),
        ({"boxes3d": {"half_extents": np.ones((4, 3)), "frame": "lidar"}}, "boxes3d[\"frame\"] has 'lidar'"),
        ({"boxes3d": {"half_extents": np.ones((4, 3)), "sd": 0.1}}, 'boxes3d["sd"] is a float; expected a mapping'),
        ({"boxes3d": {"half_extents": np.ones((4, 3)), "sd": {"yaw": 1.0}}}, "boxes3d[\"sd\"] has the field 'yaw'"),
        ({"boxes": np.full((4, 4), np.nan), "boxes3d": {"half_extents": np.ones((4, 3))}}, "row 0 has neither a box"),
    ],
)
def test_what_is_wrong_is_named(arguments: dict[str, Any], message: str) -> None:
    made, _ = one_view()
    with pytest.raises(quadlift.QuadliftError) as error:
        quadlift.localize(**{**made.arguments(), **arguments})
    assert message in str(error.value)


def test_the_object_map_keeps_them(program: Program, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    program(
        "synth", "-q", "-o", path, "--objects", "6", "--views", "20", "--noise", "box:0.03", "--cues", "depth,box3d"
    )
    document = read_json(path)
    cameras = {camera.pop("id"): camera for camera in document["cameras"]}
    scene_map = quadlift.ObjectMap()
    for k, frame in enumerate(document["frames"]):
        found = [d for d in document["detections"] if d["frame"] == frame["id"]]
        scene_map.observe(
            frame["id"],
            time=k,
            camera=cameras[frame["camera"]],
            cam_from_world=frame["cam_from_world"],
            boxes=[d["box"] for d in found],
            depths={"median": [d["depth"]["median"] for d in found], "source": "depth"},
            boxes3d={"center": [d["box3d"]["center"] for d in found], "source": "box3d"},
        )
    kept = scene_map.to_scene().to_dict()["detections"]
    assert len(kept) > 100
    given = {d["depth"]["median"]: d for d in document["detections"]}
    for detection in kept:
        expected = given[detection["depth"]["median"]]
        assert detection["depth"] == expected["depth"]
        assert detection["box3d"] == {"center": expected["box3d"]["center"], "source": "box3d"}
    scales = {scale["quantity"]: scale["factor"] for scale in scene_map.objects.cue_scales}
    assert scales["depth"] == pytest.approx(1.1, abs=0.02)
    first = document["frames"][0]
    pose = {"camera": cameras[first["camera"]], "cam_from_world": first["cam_from_world"]}
    with pytest.raises(quadlift.QuadliftError, match=r'frame "x": .*the depth is -1'):
        scene_map.observe("x", time=99, **pose, boxes=[[1, 1, 9, 9]], depths=[-1.0])


# Tables


def tables_of(cued: Cued, box3d: dict[str, Any]) -> tuple[pa.Table, pa.Table]:
    """Detections with the columns of `docs/scale-out.md`, and cameras."""
    found = cued.found
    boxes = dict(zip(("x0", "y0", "x1", "y1"), found["boxes"].T, strict=True))
    columns = {
        **{"frame": found["frames"], "object": found["objects"], **boxes},
        "depth_median": found["depths"]["median"],
        "depth_source": ["depth"] * len(found["frames"]),
        **{f"box3d_{name}": box3d[name].tolist() for name in ("center", "half_extents", "rotation")},
        "box3d_frame": [box3d.get("frame", "camera")] * len(found["frames"]),
        "box3d_source": box3d["source"],
    }
    poses = cued.frames["cam_from_world"].reshape(-1, 12).tolist()
    params = [cued.document["cameras"][0]["params"]] * len(poses)
    width, height = ([side] * len(poses) for side in cued.frames["image_sizes"])
    cameras = {"frame": range(len(poses)), "intrinsics": params, "cam_from_world": poses}
    return pa.table(columns), pa.table({**cameras, "width": width, "height": height})


def test_tables_of_objects_and_of_scenes(cued: Cued) -> None:
    whole = quadlift.localize(**cued.frames, **cued.found)
    given: dict[str, Any] = {"noise_model": whole.noise, "body": "ellipsoid"}
    up = cued.frames["up"]
    expected = quadlift.localize(**cued.frames, **cued.found, **given, upright=False)
    detections, cameras = tables_of(cued, cued.found["boxes3d"])
    found = tables.localize(tables.occluded_edges(detections), cameras, up=up, **given)
    order = [list(expected.object_ids).index(name) for name in found["object"].to_pylist()]
    np.testing.assert_array_equal(np.array(found["center"].to_pylist()), expected.centers[order])
    # As the scene gives them, which normalizes quaternions.
    names = [f"{k:03}" for k in range(len(cameras))]
    scene = quadlift.Scene.from_arrays(**cued.frames, frame_ids=names).with_detections(**cued.found)
    named = cameras.set_column(0, "frame", pa.array(names))
    of_scene = tables.localize(tables.occluded_edges(scene.to_arrow()[0]), named, up=up, **given)
    np.testing.assert_allclose(of_scene["center"].to_pylist(), found["center"].to_pylist(), rtol=1e-11)
    in_world = tables.occluded_edges(tables_of(cued, cued.in_world())[0])
    of_world = tables.localize(in_world, cameras, up=up, **given)
    np.testing.assert_allclose(np.array(of_world["center"].to_pylist()), expected.centers[order], atol=1e-6)
    # Only depths and 3D boxes, no boxes.
    null = pa.nulls(len(detections), pa.float64())
    of_boxes3d = detections
    for name in ("x0", "y0", "x1", "y1"):
        of_boxes3d = of_boxes3d.set_column(of_boxes3d.column_names.index(name), name, null)
    assert set(tables.localize(of_boxes3d, cameras, up=up, **given)["status"].to_pylist()) == {"ok"}
    # A scene without ids.
    without = tables.localize(detections.drop_columns("object"), cameras)
    assert without["status"].to_pylist().count("ok") >= 8


def test_wrong_rows_of_tables_are_named(cued: Cued) -> None:
    detections, cameras = tables_of(cued, cued.found["boxes3d"])
    rows = detections.to_pylist()
    rows.sort(key=lambda row: row["frame"])
    assert len({row["object"] for row in rows[:4]}) == 4
    rows[0]["depth_median"] = -1.0
    rows[1]["box3d_center"] = [0.0, 0.0, -5.0]
    rows[2]["box3d_center"] = None
    rows[3]["depth_median"] = None
    given: dict[str, Any] = {"noise_model": {"edge_noise": 0.03}, "body": "ellipsoid"}
    found = tables.localize(pa.Table.from_pylist(rows, schema=detections.schema), cameras, **given)
    problems = dict(zip(found["object"].to_pylist(), found["problem"].to_pylist(), strict=True))
    assert problems.pop(rows[0]["object"]).endswith(
        "the depth is -1; expected a positive number (world units, along the optical axis)"
    )
    assert "is not in front of the camera" in problems.pop(rows[1]["object"])
    assert set(problems.values()) == {None}
    rows[1]["box3d_center"] = [0.0, 5.0]
    with pytest.raises(
        quadlift.QuadliftError, match="box3d_center has a list of 2 numbers; expected lists of 3 numbers"
    ):
        tables.localize(pa.Table.from_pylist(rows, schema=detections.schema), cameras, **given)


def test_documents_are_json(cued: Cued) -> None:
    """What a localized scene says of the scales, as a file has it."""
    estimates = quadlift.Scene.from_dict(cued.document).localize()
    written = estimates.to_scene().to_dict()["localization"]["cue_scales"]
    assert written == json.loads(json.dumps(estimates.cue_scales))
