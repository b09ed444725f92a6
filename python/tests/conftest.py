"""What the tests share: the program, and synthetic scenes that it makes."""

from __future__ import annotations

import json
import os
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

ROOT = Path(__file__).parents[2]
# Two objects in eight rendered images, with true masks and bodies.
RENDERED = ROOT / "crates/quadlift-cli/tests/fixtures/rendered"


class Program:
    """The program `quadlift`."""

    def __init__(self) -> None:
        self.path = Path(os.environ.get("QUADLIFT", ROOT / "target/debug/quadlift"))
        assert self.path.is_file(), f"{self.path}: build the program first, or name it with QUADLIFT"

    def __call__(self, *arguments: str | Path, code: int = 0) -> str:
        done = subprocess.run([self.path, *arguments], capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        return done.stdout

    def json(self, *arguments: str | Path) -> dict[str, Any]:
        document: dict[str, Any] = json.loads(self(*arguments, "--json"))
        return document


@pytest.fixture(scope="session")
def program() -> Program:
    return Program()


@dataclass
class Arrays:
    """A scene of projections as arrays."""

    projections: NDArray[np.float64]
    image_sizes: NDArray[np.float64]
    frames: NDArray[np.int64]
    boxes: NDArray[np.float64]
    objects: NDArray[np.int64]

    def arguments(self) -> dict[str, Any]:
        return dict(vars(self))


def made_scene(objects: int = 4, views: int = 6) -> Arrays:
    """Exact boxes of axis-parallel ellipsoids, computed here: nothing of quadlift is used."""
    rng = np.random.default_rng(0)
    centers = rng.uniform(-2.0, 2.0, (objects, 3))
    semi_axes = rng.uniform(0.3, 0.8, (objects, 3))
    focal, size = 600.0, np.array([640.0, 480.0])
    k = np.array([[focal, 0.0, 320.0], [0.0, focal, 240.0], [0.0, 0.0, 1.0]])
    projections, frame, boxes, names = [], [], [], []
    for view in range(views):
        angle, height = 2.0 * np.pi * view / views, 3.0 + view % 2
        eye = np.array([12.0 * np.cos(angle), 12.0 * np.sin(angle), height])
        forward = -eye / np.linalg.norm(eye)
        right = np.cross(forward, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        p = k @ np.column_stack([rotation, -rotation @ eye])
        projections.append(p)
        for name, (center, axes) in enumerate(zip(centers, semi_axes, strict=True)):
            # The dual quadric, its dual conic, and the tangents of that along the axes of the image.
            dual = np.diag([*axes**2, 0.0]) - np.outer([*center, 1.0], [*center, 1.0])
            conic = p @ dual @ p.T
            conic /= conic[2, 2]
            x, y = conic[0, 2], conic[1, 2]
            half = np.sqrt([x * x - conic[0, 0], y * y - conic[1, 1]])
            frame.append(view)
            boxes.append([x - half[0], y - half[1], x + half[0], y + half[1]])
            names.append(name)
    return Arrays(np.array(projections), np.tile(size, (views, 1)), np.array(frame), np.array(boxes), np.array(names))


def made_truth(objects: int = 4) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centers and sorted semi-axes of the objects of `made_scene`."""
    rng = np.random.default_rng(0)
    return rng.uniform(-2.0, 2.0, (objects, 3)), np.sort(rng.uniform(0.3, 0.8, (objects, 3)))


@pytest.fixture(scope="session")
def made() -> Arrays:
    return made_scene()


def page_data(path: Path) -> dict[str, Any]:
    """What a page shows."""
    data: dict[str, Any] = json.loads(path.read_text().split('id="report-data">')[1].split("</script>")[0])
    return data


def as_written(values: Any, digits: int) -> Any:
    """Numbers as result files have them, with so many significant digits: figures 6, covariances 9."""
    return np.vectorize(lambda x: float(f"{x:.{digits - 1}e}"), otypes=[float])(values)


def read_json(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text())
    return document
