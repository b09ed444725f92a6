"""Two maps of one place, brought together by their objects."""

import numpy as np
import pytest
from numpy.typing import NDArray

import quadlift

INTRINSICS = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
FRAMES = 10


def half(first_angle: float, ids: list[str], scale: float, shift: list[float]) -> quadlift.Scene:
    """A map of eight balls, seen from one half of a circle around them, in another unit and elsewhere."""
    rng = np.random.default_rng(3)
    centers = rng.uniform([-1.0, -1.0, 0.0], [1.0, 1.0, 0.6], size=(8, 3))
    radii = np.linspace(0.08, 0.12, 8)
    angles = first_angle + np.linspace(0.0, np.pi, FRAMES, endpoint=False)
    eyes = np.stack([4.0 * np.cos(angles), 4.0 * np.sin(angles), np.full(FRAMES, 1.5)], axis=1)
    forward = -eyes / np.linalg.norm(eyes, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotations = np.stack([right, np.cross(forward, right), forward], axis=1)
    camera = np.einsum("fij,ofj->ofi", rotations, centers[:, None, :] - eyes[None, :, :])
    middle = camera[..., :2] / camera[..., 2:] * 600.0 + [320.0, 240.0]
    size = 600.0 * radii[:, None, None] / np.sqrt(camera[..., 2:] ** 2 - radii[:, None, None] ** 2)
    boxes = np.concatenate([middle - size, middle + size], axis=2)
    boxes += np.random.default_rng(int(10 * first_angle)).normal(scale=0.3, size=boxes.shape)
    moved = scale * eyes + np.array(shift)
    poses: NDArray[np.float64] = np.concatenate([rotations, -rotations @ moved[:, :, None]], axis=2)
    estimates = quadlift.localize(
        intrinsics=INTRINSICS,
        cam_from_world=poses,
        image_sizes=(640, 480),
        frames=np.tile(np.arange(FRAMES), 8),
        boxes=boxes.reshape(-1, 4),
        objects=np.repeat(ids, FRAMES),
        categories=np.repeat(["ball", "cup"] * 4, FRAMES),
    )
    return estimates.to_scene()


def test_maps_from_two_sides_are_aligned_and_merged() -> None:
    names = [f"a{k}" for k in range(8)]
    a = half(0.0, names, 1.0, [0.0, 0.0, 0.0])
    b = half(np.pi, [f"b{k}" for k in range(8)], 0.5, [3.0, -1.0, 2.0])
    alignment = a.align(b)
    assert alignment.ok
    assert alignment.status == "ok"
    assert alignment.reason is None
    assert alignment.contradiction is None
    assert alignment.matches == [(f"a{k}", f"b{k}") for k in range(8)]
    best = alignment.transforms[0]
    assert best.scale == pytest.approx(2.0, rel=0.01)
    assert alignment.a_from_b is not None
    assert np.allclose(alignment.a_from_b[:3, 3], [-6.0, 2.0, -4.0], atol=0.1)
    assert np.allclose(alignment.a_from_b[:3, :3], 2.0 * np.eye(3), atol=0.03)
    assert best.covariance.shape == (7, 7)
    assert 0 < best.rotation_sd < 0.05
    assert 0 < best.position_sd < 0.05
    assert 0 < best.log_scale_sd < 0.05
    assert alignment.merged is not None
    assert alignment.merged.object_count == 8
    assert len(alignment.merged.frame_ids) == 2 * FRAMES
    # With the detections of both, under the ids of the merged objects.
    assert len(alignment.merged) == 2 * 8 * FRAMES
    assert alignment.merged.object_ids == names
    found = alignment.merged.localize()
    assert found.ok.all()
    assert found.views_used.tolist() == [2 * FRAMES] * 8


def test_a_mirrored_map_is_told() -> None:
    names = [f"a{k}" for k in range(8)]
    a = half(0.0, names, 1.0, [0.0, 0.0, 0.0])
    document = half(np.pi, names, 1.0, [3.0, -1.0, 2.0]).to_dict()
    del document["frames"], document["detections"]
    for thing in document["objects"]:
        (w, x, y, z), center = thing["body"]["rotation"], thing["body"]["center"]
        thing["body"]["rotation"] = [w, x, -y, -z]
        thing["body"]["center"] = thing["center"] = [-center[0], *center[1:]]
    with pytest.warns(quadlift.InconsistentSceneWarning, match="the mirror image of the other one fits clearly better"):
        alignment = a.align(quadlift.Scene.from_dict(document))
    assert alignment.contradiction == "mirrored"


def test_maps_that_are_not_aligned_say_why() -> None:
    names = [f"a{k}" for k in range(8)]
    a = half(0.0, names, 1.0, [0.0, 0.0, 0.0])
    b = half(np.pi, names, 0.5, [3.0, -1.0, 2.0])
    with pytest.warns(quadlift.InconsistentSceneWarning, match="units contradict the objects"):
        rigid = a.align(b, scale="rigid")
    assert not rigid.ok
    assert not rigid.consistent
    assert rigid.contradiction == "scale"
    assert rigid.a_from_b is None
    assert rigid.matches is None
    assert rigid.merged is None


def test_wrong_arguments_are_named() -> None:
    a = half(0.0, [f"a{k}" for k in range(8)], 1.0, [0.0, 0.0, 0.0])
    with pytest.raises(quadlift.QuadliftError, match='scale is "large"'):
        a.align(a, scale="large")  # type: ignore[arg-type]
    with pytest.raises(quadlift.QuadliftError, match="up_sd_deg is 0"):
        a.align(a, up_sd_deg=0)
    with pytest.raises(quadlift.QuadliftError, match="other"):
        a.align(3)  # type: ignore[arg-type]
