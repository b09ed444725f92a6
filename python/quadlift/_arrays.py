"""Converts arrays to frames and detections for the core. Arrays are checked and only copied if necessary."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from . import _checks
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Names = tuple["NDArray[np.int64] | None", list[str]]
"""Indices into a list of texts, shape (M,), -1 for none; None if no row has one."""
Runs = tuple[list[int], list[int]]
"""Height and width of a mask, and COCO's runs (down the columns, starting outside the object)."""


# Inputs of the core, as read by `crates/quadlift-py`; missing keys mean none.


class FrameArrays(TypedDict, total=False):
    """F frames; `frame_ids` and either projections, or intrinsics and poses."""

    frame_ids: list[str]
    projections: NDArray[np.float64] | None
    """(F, 3, 4)."""
    intrinsics: NDArray[np.float64] | None
    """(1, 3, 3) or (F, 3, 3)."""
    cam_from_world: NDArray[np.float64] | None
    """(F, 3, 4)."""
    image_sizes: NDArray[np.float64] | None
    """(F, 2)."""
    images: list[str] | None
    name: str | None
    up: list[float] | None
    length_unit: str | None


class DetectionArrays(TypedDict, total=False):
    """M detections; NaN for none."""

    frame: NDArray[np.int64]
    """(M,)."""
    boxes: NDArray[np.float64] | None
    """(M, 4)."""
    ellipses: NDArray[np.float64] | None
    """(M, 5)."""
    masks: list[Runs | None] | None
    object: Names
    category: Names
    scores: NDArray[np.float64] | None
    """(M,)."""
    source: str | None
    hidden_edges: NDArray[np.bool_] | None
    """(M, 4)."""


# From arguments


def frames(
    *,
    projections: ArrayLike | None,
    intrinsics: ArrayLike | None,
    cam_from_world: ArrayLike | None,
    image_sizes: ArrayLike | None,
    frame_ids: Sequence[str] | None,
    images: Sequence[str] | None,
    name: str | None,
    up: ArrayLike | None,
    length_unit: str | None,
) -> FrameArrays:
    """Frames of the arguments of `Scene.from_arrays`."""
    like, count, matrices = _matrices(projections, intrinsics, cam_from_world)
    numbers = [str(k) for k in range(count)]
    return {
        **matrices,
        "frame_ids": numbers if frame_ids is None else _checks.texts("frame_ids", frame_ids, count),
        "image_sizes": None if image_sizes is None else _sizes(image_sizes, like, count),
        "images": None if images is None else _checks.texts("images", images, count),
        "name": _checks.optional(_checks.text, "name", name),
        "up": None if up is None else _checks.array("up", up, (3,)).tolist(),
        "length_unit": _checks.optional(_checks.text, "length_unit", length_unit),
    }


def _matrices(
    projections: ArrayLike | None, intrinsics: ArrayLike | None, cam_from_world: ArrayLike | None
) -> tuple[str, int, FrameArrays]:
    """The name of the argument with one row per frame, its number of rows, and the arguments for the core."""
    if projections is not None:
        if intrinsics is not None or cam_from_world is not None:
            raise QuadliftError("expected either projections, or intrinsics and cam_from_world; found both")
        matrices = _checks.array("projections", projections, ("F", 3, 4))
        return "projections", len(matrices), {"projections": matrices}
    if intrinsics is None or cam_from_world is None:
        found = [k for k, v in (("intrinsics", intrinsics), ("cam_from_world", cam_from_world)) if v is not None]
        words = " and ".join(found) or "none of them"
        raise QuadliftError(f"expected projections, or intrinsics and cam_from_world; found {words}")
    poses = _poses(cam_from_world)
    cameras = _checks.array("intrinsics", intrinsics, ("F", 3, 3), (3, 3))
    if cameras.ndim == 2:
        cameras = cameras[np.newaxis]
    else:
        _checks.rows("intrinsics", len(cameras), "cam_from_world", len(poses))
    return "cam_from_world", len(poses), {"cam_from_world": poses, "intrinsics": cameras}


def _poses(cam_from_world: ArrayLike) -> NDArray[np.float64]:
    """(F, 3, 4) of (F, 3, 4) or (F, 4, 4)."""
    poses = _checks.array("cam_from_world", cam_from_world, ("F", 3, 4), ("F", 4, 4))
    if poses.shape[1] == 3:
        return poses
    wrong = np.flatnonzero((poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1))
    if wrong.size:
        row = poses[wrong[0], 3].tolist()
        raise QuadliftError(f"the last row of cam_from_world[{wrong[0]}] is {row}; expected [0, 0, 0, 1]")
    return poses[:, :3]


def _sizes(image_sizes: ArrayLike, like: str, count: int) -> NDArray[np.float64]:
    """(F, 2) of (2,) or (F, 2), pixels."""
    sizes = _checks.array("image_sizes", image_sizes, ("F", 2), (2,))
    if sizes.ndim == 1:
        sizes = np.broadcast_to(sizes, (count, 2))
    _checks.rows("image_sizes", len(sizes), like, count)
    if (sizes <= 0.0).any():
        raise QuadliftError(f"image_sizes holds {sizes[sizes <= 0.0][0]}; expected positive numbers of pixels")
    return sizes


def detections(
    *,
    frame: ArrayLike,
    boxes: ArrayLike | None,
    ellipses: ArrayLike | None,
    masks: Sequence[Any] | None,
    object: ArrayLike | None,
    scores: ArrayLike | None,
    categories: ArrayLike | None,
    source: str | None,
) -> DetectionArrays:
    """Detections of the arguments of `Scene.with_detections`."""
    indices = _checks.indices("frame", frame)
    count = len(indices)
    if boxes is None and ellipses is None:
        raise QuadliftError("expected boxes or ellipses; found none of them")

    def rows(name: str, value: ArrayLike | None, *width: int) -> NDArray[np.float64] | None:
        if value is None:
            return None
        numbers = _checks.array(name, value, ("M", *width), nan=True)
        _checks.rows(name, len(numbers), "frame", count)
        return numbers

    return {
        "frame": indices,
        "boxes": rows("boxes", boxes, 4),
        "ellipses": rows("ellipses", ellipses, 5),
        "scores": rows("scores", scores),
        "masks": None if masks is None else _masks(masks, count),
        "object": _checks.names("object", object, count, "frame"),
        "category": _checks.names("categories", categories, count, "frame"),
        "source": _checks.optional(_checks.text, "source", source),
    }


def _masks(masks: Sequence[Any], count: int) -> list[Runs | None]:
    _checks.rows("masks", len(masks), "frame", count)
    return [None if mask is None else _runs(f"masks[{k}]", mask) for k, mask in enumerate(masks)]


def _runs(name: str, mask: Any) -> Runs:
    pixels = np.asarray(mask)
    if pixels.ndim != 2 or pixels.dtype.kind not in "biuf":
        raise QuadliftError(
            f"{name} has the shape {pixels.shape} and the dtype {pixels.dtype}; expected (H, W), numbers"
        )
    column = (pixels != 0).T.reshape(-1)
    changes = np.flatnonzero(np.diff(column, prepend=False)) if column.size else np.zeros(0, dtype=np.int64)
    lengths = np.diff(np.concatenate([[0], changes, [column.size]]))
    return list(pixels.shape), [int(length) for length in lengths]
