"""Cameras from the boxes of one image and a map of objects."""

import numpy as np
import pytest
from numpy.typing import NDArray

import quadlift

INTRINSICS = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
FRAMES = 12


def balls() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Six balls on a table, seen from around it: centers, radii, poses, boxes (object, frame)."""
    rng = np.random.default_rng(1)
    angles = np.linspace(0.0, 2.0 * np.pi, FRAMES, endpoint=False)
    eyes = np.stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), np.full(FRAMES, 1.0)], axis=1)
    forward = -eyes / np.linalg.norm(eyes, axis=1, keepdims=True)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    rotations = np.stack([right, np.cross(forward, right), forward], axis=1)
    poses = np.concatenate([rotations, -rotations @ eyes[:, :, None]], axis=2)
    centers = rng.uniform([-0.5, -0.5, 0.0], [0.5, 0.5, 0.3], size=(6, 3))
    radii = np.linspace(0.05, 0.1, 6)
    camera = np.einsum("fij,oj->ofi", rotations, centers) + poses[None, :, :, 3]
    middle = camera[..., :2] / camera[..., 2:] * 600.0 + [320.0, 240.0]
    half = 600.0 * radii[:, None, None] / np.sqrt(camera[..., 2:] ** 2 - radii[:, None, None] ** 2)
    boxes = np.concatenate([middle - half, middle + half], axis=2)
    return centers, radii, poses, boxes + rng.normal(scale=0.5, size=boxes.shape)


def map_without_first_frame() -> quadlift.Estimates:
    _, _, poses, boxes = balls()
    return quadlift.localize(
        intrinsics=INTRINSICS,
        cam_from_world=poses[1:],
        image_sizes=(640, 480),
        frames=np.tile(np.arange(FRAMES - 1), 6),
        boxes=boxes[:, 1:].reshape(-1, 4),
        objects=np.repeat([60, 50, 40, 30, 20, 10], FRAMES - 1),
        categories=np.repeat(["ball", "ball", "ball", "marble", "marble", "marble"], FRAMES - 1),
    )


def test_a_camera_is_found_in_a_map_of_estimates() -> None:
    _, _, poses, boxes = balls()
    estimates = map_without_first_frame()
    categories = ["ball"] * 3 + ["marble"] * 3
    location = estimates.relocalize(boxes[:, 0], INTRINSICS, categories=categories, image_size=(640, 480))
    assert location.ok
    assert location.status == "ok"
    assert location.objects == [60, 50, 40, 30, 20, 10]
    assert location.cam_from_world is not None
    assert location.cam_from_world.shape == (3, 4)
    assert np.allclose(location.cam_from_world, poses[0], atol=0.03)
    assert location.covariance is not None
    assert location.covariance.shape == (6, 6)
    best = location.poses[0]
    assert 0 < best.rotation_sd < 0.05
    assert 0 < best.position_sd < 0.1
    assert best.evidence > 5
    up = poses[0, :, :3] @ [0.0, 0.0, 1.0]
    known = estimates.relocalize(
        boxes[:, 0], INTRINSICS, up=[0, 0, 1], up_in_camera=up, up_sd_deg=0.1, height=(1.0, 0.001)
    )
    assert known.ok
    assert known.poses[0].position_sd < best.position_sd


def test_what_cannot_be_told_has_no_pose() -> None:
    _, _, _, boxes = balls()
    estimates = map_without_first_frame()
    location = estimates.relocalize(boxes[:2, 0], INTRINSICS)
    assert location.status == "too_few_objects"
    assert not location.ok
    assert location.cam_from_world is None
    assert location.covariance is None
    assert location.objects is None
    assert estimates.relocalize(np.zeros((0, 4)), INTRINSICS).status == "too_few_objects"
    others = estimates.relocalize(boxes[:, 0], INTRINSICS, categories=["cup"] * 6)
    assert others.status == "too_few_objects"


def test_a_camera_is_found_in_an_object_map() -> None:
    _, _, poses, boxes = balls()
    object_map = quadlift.ObjectMap()
    for k in range(1, FRAMES):
        update = object_map.observe(
            k, time=k, intrinsics=INTRINSICS, cam_from_world=poses[k], image_size=(640, 480), boxes=boxes[:, k]
        )
    location = object_map.relocalize(boxes[:, 0], INTRINSICS, image_size=(640, 480))
    assert location.ok
    assert location.objects == update.objects
    assert np.allclose(location.poses[0].cam_from_world, poses[0], atol=0.05)
    assert object_map.frame_count == FRAMES - 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"boxes": [[5, 0, 1, 1]]}, "boxes[0]"),
        ({"boxes": [[0, 0, 1]]}, "boxes"),
        ({"intrinsics": np.eye(4)}, "intrinsics"),
        ({"intrinsics": [[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]}, "intrinsics"),
        ({"image_size": (0, 480)}, "image_size"),
        ({"edge_noise": 0}, "edge_noise"),
        ({"up_in_camera": [0, -1, 0]}, "up_in_camera needs up"),
        ({"up": [0, 0, 0]}, "up is [0.0, 0.0, 0.0]; expected a direction"),
        ({"height": (1.0, 0.1)}, "height needs up"),
        ({"height": (1.0, 0.0), "up": [0, 0, 1]}, "height"),
        ({"categories": ["ball"]}, "categories"),
    ],
)
def test_wrong_arguments_are_named(arguments: dict[str, object], message: str) -> None:
    _, _, _, boxes = balls()
    given: dict[str, object] = {"boxes": boxes[:, 0], "intrinsics": INTRINSICS, **arguments}
    with pytest.raises(quadlift.QuadliftError) as error:
        map_without_first_frame().relocalize(**given)  # type: ignore[arg-type]
    assert message in str(error.value)
