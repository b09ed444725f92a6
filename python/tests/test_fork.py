"""Work in a process that a fork has made, as multiprocessing does on Linux."""

from __future__ import annotations

import multiprocessing
import sys
import warnings
from pathlib import Path
from queue import Empty
from typing import Any

import numpy as np
import pytest

import quadlift
from conftest import Arrays

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there is no fork on Windows")

SECONDS = 120
"""How long the child may take; before it was mended it never ended."""


def in_child(work: Any) -> Any:
    """What `work` gives in a forked process."""
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    with warnings.catch_warnings():
        # Python 3.12 warns of forks where there are threads.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = context.Process(target=lambda: queue.put(work()))
        child.start()
    try:
        return queue.get(timeout=SECONDS)
    except Empty:
        pytest.fail("the forked process hangs")
    finally:
        child.kill()
        child.join()


def observe(object_map: quadlift.ObjectMap, made: Arrays, first: int = 0) -> None:
    for k, projection in enumerate(made.projections):
        found = {"projection": projection, "image_size": (640, 480), "boxes": made.boxes[made.frames == k]}
        object_map.observe(first + k, time=first + k, **found)


def test_everything_works_in_forked_children(made: Arrays, tmp_path: Path) -> None:
    cameras = quadlift.Scene.from_arrays(projections=made.projections, image_sizes=(640, 480))
    scene = cameras.with_detections(frames=made.frames, boxes=made.boxes, objects=made.objects)
    # Starts the threads of this process, which its children do not have.
    here = scene.localize()
    _, objects = scene.associate(ids="ignore")
    object_map = quadlift.ObjectMap()
    observe(object_map, made)

    def everything() -> Any:
        localized = scene.localize()
        _, again = scene.associate(ids="ignore")
        scene.diagnose()
        localized.to_scene().evaluate(localized.to_scene())
        localized.report(tmp_path / "page.html")
        # The parent's map goes on.
        observe(object_map, made, len(made.projections))
        assert len(object_map.objects) > 0
        grandchild = in_child(lambda: scene.localize().centers)
        return localized.centers, localized.covariances, len(again), grandchild

    centers, covariances, found, grandchild = in_child(everything)
    np.testing.assert_array_equal(centers, here.centers)
    np.testing.assert_array_equal(covariances, here.covariances)
    np.testing.assert_array_equal(grandchild, here.centers)
    assert found == len(objects)
