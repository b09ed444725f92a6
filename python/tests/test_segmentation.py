"""Masks and ellipses from images, as the program finds them."""

from __future__ import annotations

import shutil
import signal
import threading
from pathlib import Path

import numpy as np
import pytest

import quadlift
from conftest import RENDERED, Program, read_json


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copytree(RENDERED, tmp_path_factory.mktemp("scene") / "rendered"))


# Options in both spellings.
CASES = {
    "default": ([], {}),
    "seed, one thread": (["--method", "sca", "--seed", "5"], {"method": "sca", "seed": 5, "threads": 1}),
    "given masks": (["--method", "masks"], {"method": "masks"}),
}


@pytest.mark.parametrize("name", list(CASES))
def test_same_file_as_the_program(name: str, folder: Path, program: Program) -> None:
    options, keywords = CASES[name]
    program("segment", "-q", folder / "scene.json", "-o", folder / "segmented.json", *options)
    scene = quadlift.Scene.read(folder / "scene.json")
    segmented = scene.segment(**keywords)  # type: ignore[arg-type]
    segmented.write(folder / "ours.json")
    assert (folder / "ours.json").read_bytes() == (folder / "segmented.json").read_bytes()
    # The scene that was segmented is as it was.
    assert scene.to_dict() == read_json(folder / "scene.json")
    assert all("ellipse" in detection for detection in segmented.to_dict()["detections"])


def test_masks_as_images(folder: Path, program: Program) -> None:
    program("segment", "-q", folder / "scene.json", "-o", folder / "segmented.json", "--out-masks", folder / "theirs")
    shutil.move(folder / "theirs", folder / "expected")
    scene = quadlift.Scene.read(folder / "scene.json")
    segmented = scene.segment(out_masks=folder / "theirs")
    segmented.write(folder / "ours.json")
    assert (folder / "ours.json").read_bytes() == (folder / "segmented.json").read_bytes()
    expected = sorted((folder / "expected").iterdir())
    assert {path.name[:6] for path in expected} == {f"{k:06}" for k in range(8)}
    assert len(list((folder / "theirs").iterdir())) == len(expected)
    for path in expected:
        assert (folder / "theirs" / path.name).read_bytes() == path.read_bytes()
    # A folder that the scene itself uses.
    with pytest.raises(quadlift.QuadliftError, match=r"out_masks is the folder of .*which could be overwritten"):
        scene.segment(out_masks=folder / "images")


def test_from_images_to_objects(folder: Path) -> None:
    scene = quadlift.Scene.read(folder / "scene.json")
    told: list[tuple[int, int]] = []
    segmented = scene.segment(progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (2, 2)
    estimates = segmented.localize(measurement="mask")
    scores = estimates.to_scene().evaluate(scene)
    assert scores.mean["iou3d"] is not None
    assert scores.mean["iou3d"] > 0.6


def test_what_goes_wrong_is_told(tmp_path: Path) -> None:
    shutil.copytree(RENDERED, tmp_path, dirs_exist_ok=True)
    first = sorted((tmp_path / "images").iterdir())[0]
    first.unlink()
    scene = quadlift.Scene.read(tmp_path / "scene.json")
    with pytest.warns(UserWarning, match=rf"{first.name}: there is no such file; affects detections\[0\]"):
        segmented = scene.segment()
    # All others are done.
    found = [d["segmentation"]["status"] for d in segmented.to_dict()["detections"]]
    in_first = [d["frame"] == first.stem for d in scene.to_dict()["detections"]]
    assert [status == "failed" for status in found] == in_first
    shutil.rmtree(tmp_path / "images")
    with pytest.raises(quadlift.QuadliftError, match=r"none of the 8 images that the frames name exists"):
        scene.segment()


def test_wrong_arguments() -> None:
    scene = quadlift.Scene.from_arrays(projections=np.eye(3, 4)[None])
    with pytest.raises(quadlift.QuadliftError, match="the scene has no detections"):
        scene.segment()
    boxes = scene.with_detections(frames=[0], boxes=[[0, 0, 9, 9]], source="a")
    with pytest.raises(quadlift.QuadliftError, match='no frame has an "image"'):
        boxes.segment()
    with pytest.raises(quadlift.QuadliftError, match='no detection has a "mask"'):
        boxes.segment(method="masks")
    with pytest.raises(quadlift.QuadliftError, match='method is "gmm"; expected one of graphcut, sca, masks'):
        boxes.segment(method="gmm")  # type: ignore[arg-type]
    two = boxes.with_detections(frames=[0], boxes=[[0, 0, 9, 9]], source="b")
    with pytest.raises(quadlift.QuadliftError, match=r"several sources \(a, b\).*\(source=\.\.\.\)"):
        two.segment()


def test_interruption(folder: Path) -> None:
    scene = quadlift.Scene.read(folder / "scene.json")
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        timer = threading.Timer(0.02, lambda: signal.raise_signal(signal.SIGINT))
        timer.start()
        with pytest.raises(KeyboardInterrupt):
            scene.segment(threads=1)
        timer.join()
    finally:
        signal.signal(signal.SIGINT, before)
