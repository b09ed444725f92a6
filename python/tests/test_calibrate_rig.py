"""Fixed cameras from people who walk by, as arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import quadlift

K = np.array([[800.0, 0, 640], [0, 800, 360], [0, 0, 1]])
RNG = np.random.default_rng(4)


def look(eye: np.ndarray) -> np.ndarray:
    """The pose of a camera that looks at the middle of the hall."""
    z = np.array([0.0, 0.0, 1.0]) - eye
    z /= np.linalg.norm(z)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    return np.column_stack([rotation, -rotation @ eye])


POSES = np.stack([look(np.array(eye)) for eye in ([5.0, 1.0, 2.7], [-1.0, 4.0, 2.5], [-5.0, -2.0, 3.0])])


def box(pose: np.ndarray, center: np.ndarray) -> list[float]:
    """The box of a person 1.8 m high: that of an ellipsoid."""
    projection = K @ pose
    shape = np.diag([0.3**2, 0.3**2, 0.9**2, 0.0])
    homogeneous = np.append(center, 1.0)
    conic = projection @ (shape - np.outer(homogeneous, homogeneous)) @ projection.T
    edges = []
    for sign in (1, -1):
        for axis in (0, 1):
            root = np.sqrt(conic[axis, 2] ** 2 - conic[axis, axis] * conic[2, 2])
            edges.append((conic[axis, 2] + sign * root) / conic[2, 2])
    return edges


def walk(count: int = 60) -> dict[str, Any]:
    """A person in many places, seen by all cameras."""
    places = np.column_stack([RNG.uniform(-2.5, 2.5, count), RNG.uniform(-2, 2, count), np.full(count, 0.9)])
    rows = [(camera, time_step) for camera in range(3) for time_step in range(count)]
    return {
        "boxes": np.array([box(POSES[camera], places[time_step]) for camera, time_step in rows]),
        "cameras": np.array([camera for camera, _ in rows]),
        "time_steps": np.array([time_step for _, time_step in rows]),
        "intrinsics": np.stack([K] * 3),
    }


def centers(poses: np.ndarray) -> np.ndarray:
    return np.stack([-pose[:, :3].T @ pose[:, 3] for pose in poses])


@pytest.mark.parametrize("with_ids", [True, False])
def test_cameras_are_found_from_a_person_who_walks_by(with_ids: bool) -> None:
    arrays = walk()
    count = len(arrays["boxes"])
    truth = centers(POSES)
    found = quadlift.calibrate_rig(
        **arrays,
        objects=["anna"] * count if with_ids else None,
        categories=["person"] * count,
        baselines=[(0, 1, float(np.linalg.norm(truth[0] - truth[1])))],
    )
    assert found.ok
    assert [camera.status for camera in found.cameras] == ["ok"] * 3
    assert found.scale == "baselines"
    poses = np.stack([camera.cam_from_world for camera in found.cameras])  # type: ignore[misc]
    off = centers(poses)
    for first, second in [(0, 1), (0, 2), (1, 2)]:
        expected = np.linalg.norm(truth[first] - truth[second])
        assert np.linalg.norm(off[first] - off[second]) == pytest.approx(expected, abs=0.03)
    assert found.up is not None
    assert np.allclose(found.up, [0, 0, 1])
    assert found.cameras[found.reference or 0].position_sd is not None or found.reference == 0
    assert found.cameras[1].covariance is not None
    assert found.cameras[1].covariance.shape == (6, 6)


def test_known_poses_are_kept() -> None:
    arrays = walk()
    known = POSES.copy()
    known[2] = np.nan
    found = quadlift.calibrate_rig(**arrays, cam_from_world=known)
    assert [camera.status for camera in found.cameras] == ["given", "given", "ok"]
    poses = [camera.cam_from_world for camera in found.cameras]
    assert poses[0] is not None
    assert poses[2] is not None
    assert np.array_equal(poses[0], POSES[0])
    assert np.allclose(poses[2], POSES[2], atol=0.05)


def test_what_cannot_be_told_has_no_pose() -> None:
    arrays = walk(3)
    found = quadlift.calibrate_rig(**arrays)
    assert not found.ok
    assert all(camera.cam_from_world is None and not camera.ok for camera in found.cameras)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"boxes": np.zeros((180, 3))}, "boxes"),
        ({"cameras": [0, 1]}, "cameras"),
        ({"cameras": np.full(180, 7)}, "cameras[0] is 7; there are 3 cameras"),
        ({"intrinsics": np.stack([np.eye(3) * 2] * 3)}, "intrinsics[0]"),
        ({"baselines": [(0, 0, 1.0)]}, "baselines[0]"),
        ({"baselines": [(0, 1, 0.0)]}, "baselines[0]"),
        ({"sizes": "meters"}, "sizes"),
        ({"objects": ["anna"]}, "objects"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(quadlift.QuadliftError) as error:
        quadlift.calibrate_rig(**{**walk(), **arguments})
    assert message in str(error.value)


def test_a_camera_that_the_others_contradict_is_named() -> None:
    arrays = walk()
    of_other = arrays["cameras"] == 1
    arrays["boxes"][of_other] = arrays["boxes"][of_other][:, [2, 1, 0, 3]] * [-1, 1, -1, 1] + [1280, 0, 1280, 0]
    with pytest.warns(quadlift.InconsistentSceneWarning, match="camera 1: .*mirrored"):
        rig = quadlift.calibrate_rig(**arrays, categories=["person"] * len(arrays["boxes"]))
    assert not rig.consistent
    assert [camera.contradiction for camera in rig.cameras] == [None, "mirrored", None]
    assert [camera.status for camera in rig.cameras] == ["ok", "inconsistent", "ok"]
