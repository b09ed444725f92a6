"""The examples of the Python package run; a stub takes the place of Ultralytics, which needs torch."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

import quadlift
from conftest import ROOT, read_json

VIDEO = ROOT / "examples/object_map_video.py"

STUB = '''
"""Ultralytics, as far as the example needs it: the video is an array of boxes, frame by frame."""
from types import SimpleNamespace

import numpy as np


class YOLO:
    def __init__(self, model):
        assert model == "yolo11n.pt"

    def track(self, video, *, stream, verbose):
        assert stream and not verbose
        for boxes in np.load(video):
            tracks = np.array([3.0, 8.0])
            found = SimpleNamespace(xyxy=boxes, cls=np.full(2, 41.0), conf=np.full(2, 0.9), id=tracks)
            image = np.zeros((480, 640, 3), np.uint8)
            yield SimpleNamespace(boxes=found, names={41: "cup"}, orig_shape=(480, 640), orig_img=image, path=video)
'''


def test_a_video(tmp_path: Path) -> None:
    (tmp_path / "ultralytics.py").write_text(STUB)
    # A camera that moves to the right before two cups; the pose of a frame is not known.
    x = np.linspace(-1.5, 1.5, 30)
    poses = np.tile(np.eye(4), (30, 1, 1))
    poses[:, 0, 3] = -x
    poses[7] = np.nan
    intrinsics = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    left, right = (320 + 100 * (center - x) for center in (-0.75, 0.75))
    middle = np.stack([left, right], axis=1)
    boxes = np.stack([middle - 50, np.full_like(middle, 190), middle + 50, np.full_like(middle, 290)], axis=2)
    np.save(tmp_path / "video.npy", boxes)
    np.savez(tmp_path / "poses.npz", intrinsics=intrinsics, cam_from_world=poses)
    done = subprocess.run(
        [sys.executable, VIDEO, "video.npy", "poses.npz", "-o", "map.json"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    printed = done.stdout.splitlines()
    assert printed[-1] == "<quadlift.ObjectMap: 2 objects after 29 frames>"
    assert {line.split(maxsplit=1)[1] for line in printed[:-1]} >= {"confirmed object_0001", "confirmed object_0002"}
    objects = read_json(tmp_path / "map.json")["objects"]
    assert [(o["category"], o["memory"]["detections"]) for o in objects] == [("cup", 29)] * 2
    centers = np.array(sorted(o["center"] for o in objects))
    np.testing.assert_allclose(centers, [[-0.75, 0, 5], [0.75, 0, 5]], atol=0.3)
    assert quadlift.Scene.read(tmp_path / "map.json").object_count == 2


def test_it_is_short() -> None:
    """At most 30 lines of code."""
    text = VIDEO.read_text()
    documentation = ast.parse(text).body[0]
    lines = text.splitlines()[documentation.end_lineno or 0 :]
    assert sum(bool(line.strip()) for line in lines) <= 30
