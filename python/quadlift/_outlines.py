"""Outlines and oriented boxes of detections, as arguments and as arrays for the core."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from . import _checks
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import NDArray


class OutlineArrays(TypedDict):
    """The input of the core, as read by `crates/quadlift-py`."""

    corners: NDArray[np.float64] | None
    """(K, 2): the corners of all outlines, one after the other."""
    offsets: NDArray[np.int64] | None
    """(M + 1,): where the corners of each detection begin, 0 to K; a detection without an outline has none."""
    oriented_boxes: NDArray[np.float64] | None
    """(M, 5): center, width and height, angle; a row of NaN is no oriented box."""
    occluded_lines: NDArray[np.bool_] | None
    """(M, 8): supporting lines that another outline is known to hide."""


def outlines(outlines: Sequence[Any] | None, oriented_boxes: Any, count: int, like: str) -> OutlineArrays | None:
    """The outlines and oriented boxes of `count` detections, as many as the argument `like`; None without any."""
    if outlines is None and oriented_boxes is None:
        return None
    found: OutlineArrays = {"corners": None, "offsets": None, "oriented_boxes": None, "occluded_lines": None}
    if outlines is not None:
        if isinstance(outlines, str) or not hasattr(outlines, "__len__"):
            raise QuadliftError(
                f"outlines is a {type(outlines).__name__}; expected a sequence of (K, 2) arrays or None"
            )
        _checks.rows("outlines", outlines, like, count)
        polygons = [_corners(f"outlines[{k}]", corners) for k, corners in enumerate(outlines)]
        found["corners"] = np.concatenate([np.empty((0, 2)), *polygons])
        found["offsets"] = np.cumsum([0, *map(len, polygons)], dtype=np.int64)
    if oriented_boxes is not None:
        turned = _checks.array("oriented_boxes", oriented_boxes, ("M", 5), nan=True)
        _checks.rows("oriented_boxes", turned, like, count)
        found["oriented_boxes"] = turned
    return found


def _corners(name: str, corners: Any) -> NDArray[np.float64]:
    return np.empty((0, 2)) if corners is None else _checks.array(name, corners, ("K", 2))


def around(found: OutlineArrays) -> NDArray[np.float64]:
    """The boxes around outlines, or else around oriented boxes: (M, 4), NaN without either."""
    corners, offsets, turned = found["corners"], found["offsets"], found["oriented_boxes"]
    counts = None if offsets is None else np.diff(offsets)
    count = len(turned) if turned is not None else (0 if counts is None else len(counts))
    boxes = np.full((count, 4), np.nan)
    if turned is not None:
        x, y, width, height, angle = turned.T
        cos, sin = np.abs(np.cos(angle)), np.abs(np.sin(angle))
        half = 0.5 * np.column_stack([width * cos + height * sin, width * sin + height * cos])
        center = np.column_stack([x, y])
        boxes = np.column_stack([center - half, center + half])
    if corners is not None and offsets is not None and counts is not None and len(corners):
        given = counts > 0
        begins = offsets[:-1][given]
        low, high = np.minimum.reduceat(corners, begins), np.maximum.reduceat(corners, begins)
        boxes[given] = np.column_stack([low, high])
    return boxes


def of_corners(corners: Any) -> NDArray[np.float64]:
    """Oriented boxes from their corners in order, (M, 4, 2); as `OutlineArrays.oriented_boxes`."""
    a, b, c, d = np.asarray(corners, dtype=np.float64).reshape(-1, 4, 2).transpose(1, 0, 2)
    along, across = (b - a + c - d) / 2, (c - b + d - a) / 2
    size = np.column_stack([np.linalg.norm(along, axis=1), np.linalg.norm(across, axis=1)])
    return np.column_stack([(a + b + c + d) / 4, size, np.arctan2(along[:, 1], along[:, 0])])
