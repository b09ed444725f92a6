"""The consistency check: wrong scenes are told, and mended."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import quadlift
from conftest import made_scene

INTRINSICS = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])


def with_inverted_poses(projections: NDArray[np.float64]) -> NDArray[np.float64]:
    poses = np.linalg.inv(INTRINSICS) @ projections
    rotations = np.swapaxes(poses[:, :, :3], 1, 2)
    inverse: NDArray[np.float64] = INTRINSICS @ np.concatenate([rotations, -rotations @ poses[:, :, 3:]], axis=2)
    return inverse


def test_a_right_scene_gives_no_warning() -> None:
    made = made_scene(objects=6, views=12)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        estimates = quadlift.localize(**made.arguments())
    assert estimates.diagnosis["consistent"]
    assert estimates.diagnosis["causes"] == []
    assert estimates.diagnosis["score"] < 0.1


def test_inverted_poses_are_told_and_mended() -> None:
    made = made_scene(objects=6, views=12)
    given = dict(made.arguments())
    wrong = {**given, "projections": with_inverted_poses(given["projections"])}
    with pytest.warns(quadlift.InconsistentSceneWarning, match="camera-to-world") as told:
        estimates = quadlift.localize(**wrong)
    assert 'after correction (corrected("poses=world-from-camera"))' in str(told[0].message)
    assert told[0].filename == __file__
    assert not estimates.ok.any()
    cause = estimates.diagnosis["causes"][0]
    assert cause["name"] == "camera_to_world"
    assert cause["after"] < 0.1 < cause["before"]
    with pytest.warns(quadlift.InconsistentSceneWarning):
        quadlift.localize(**wrong, allow_inconsistent=True)

    scene = quadlift.Scene.from_arrays(**wrong)
    assert scene.diagnose() == estimates.diagnosis
    mended = scene.corrected("poses=world-from-camera")
    assert mended.diagnose()["consistent"] is True
    assert mended.diagnose()["score"] < 0.1
    np.testing.assert_allclose(mended.localize().centers, quadlift.localize(**given).centers, atol=1e-6)


def test_what_a_message_proposes_works_on_all_that_is_at_hand(tmp_path: Path) -> None:
    given = made_scene(objects=6, views=12).arguments()
    wrong = {**given, "projections": with_inverted_poses(given["projections"])}
    expected = quadlift.localize(**given).centers
    scene = quadlift.Scene.from_arrays(**wrong)
    with pytest.warns(quadlift.InconsistentSceneWarning, match="camera-to-world"):
        estimates = scene.localize()
    scene.write(tmp_path / "scene.json")
    estimates.to_scene().write(tmp_path / "result.json")
    at_hand: dict[str, quadlift.Scene | quadlift.Estimates] = {
        "scene": scene,
        "estimates": estimates,
        "result": estimates.to_scene(),
        "file of the scene": quadlift.Scene.read(tmp_path / "scene.json"),
        "file of the result": quadlift.Scene.read(tmp_path / "result.json"),
    }
    for name, one in at_hand.items():
        mended = one.corrected("poses=world-from-camera").localize()
        assert mended.diagnosis["consistent"], name
        np.testing.assert_allclose(mended.centers, expected, atol=1e-6, err_msg=name)
        assert one.corrected(fix=True).to_dict() == one.corrected("poses=world-from-camera").to_dict(), name


@pytest.mark.parametrize("views", [3, 12])
def test_inconsistent_scenes_warn_without_ids_too(views: int) -> None:
    given = made_scene(objects=6, views=views).arguments()
    del given["objects"]
    wrong = {**given, "projections": with_inverted_poses(given["projections"])}
    with pytest.warns(quadlift.InconsistentSceneWarning, match="camera-to-world") as told:
        estimates = quadlift.localize(**wrong)
    assert 'corrected("poses=world-from-camera")' in str(told[0].message)
    assert told[0].filename == __file__
    assert not estimates.ok.any()
    assert estimates.diagnosis["causes"][0]["name"] == "camera_to_world"
    mended = estimates.corrected("poses=world-from-camera").localize()
    np.testing.assert_allclose(mended.centers, quadlift.localize(**given).centers, atol=1e-6)
    with pytest.warns(quadlift.InconsistentSceneWarning, match="camera-to-world"):
        assert not quadlift.Scene.from_arrays(**wrong).localize().ok.any()


def test_ids_that_change_are_told_with_the_keywords_that_mend_them() -> None:
    given = made_scene(objects=6, views=12).arguments()
    # In every other frame two objects each have the ids of each other.
    given["objects"] = np.where(given["frames"] % 2 == 1, given["objects"] ^ 1, given["objects"])
    with pytest.warns(quadlift.InconsistentSceneWarning) as told:
        quadlift.localize(**given)
    assert "the object ids switch between objects" in str(told[0].message)
    assert '(associate="always", ids="ignore")' in str(told[0].message)
    assert quadlift.localize(**given, associate="always", ids="ignore").ok.tolist() == [True] * 6


def test_scenes_without_ids_are_associated_for_the_check() -> None:
    made = made_scene(objects=6, views=12)
    given = dict(made.arguments())
    del given["objects"]
    diagnosis = quadlift.Scene.from_arrays(**given).diagnose()
    assert diagnosis["consistent"] is True
    assert diagnosis["score"] < 0.1
    given["projections"] = with_inverted_poses(given["projections"])
    diagnosis = quadlift.Scene.from_arrays(**given).diagnose()
    assert diagnosis["consistent"] is False
    assert diagnosis["causes"][0]["name"] == "camera_to_world"


def test_nothing_is_consistent_that_was_not_checked() -> None:
    made = made_scene(objects=2, views=2)
    scene = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480))
    one_view = scene.with_detections(made.boxes[:1], made.frames[:1], made.objects[:1])
    assert one_view.diagnose()["consistent"] is None
    # Too many to be associated for a check.
    many = scene.with_detections(np.tile(made.boxes[:2], (2501, 1)), np.tile(made.frames[:2], 2501))
    diagnosis = many.diagnose()
    assert (diagnosis["consistent"], diagnosis["score"], diagnosis["causes"]) == (None, None, [])


def test_corrections_have_the_programs_names_and_values() -> None:
    scene = quadlift.Scene.from_arrays(
        intrinsics=[[500, 0, 320], [0, 500, 240], [0, 0, 1]],
        cam_from_world=np.tile(np.eye(3, 4), (2, 1, 1)),
        image_sizes=(640, 480),
    ).with_detections(frames=[0], boxes=[[10.0, 20.0, 30.0, 50.0]])

    def box(scene: quadlift.Scene) -> list[float]:
        numbers: list[float] = scene.to_dict()["detections"][0]["box"]
        return numbers

    assert box(scene.corrected("image_size=320x240")) == [20.0, 40.0, 60.0, 100.0]
    assert box(scene.corrected("letterbox=640x640")) == [10.0, -60.0, 30.0, -30.0]
    assert box(scene.corrected("boxes=xywh")) == [10.0, 20.0, 40.0, 70.0]
    assert scene.corrected("frame_offset=-1").to_dict()["detections"][0]["frame"] == "1"
    assert scene.corrected("focal=2", up="-y").to_dict()["up"] == [0.0, -1.0, 0.0]
    assert scene.corrected().to_dict() == scene.to_dict()
    with pytest.raises(quadlift.QuadliftError, match='assume is "poses=unity"; expected one of world-from-camera'):
        scene.corrected("poses=unity")
