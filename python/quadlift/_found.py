"""The detections of one frame as arrays, also from objects of other packages.

None of the packages is imported: only attributes of their types are used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from . import _outlines
from ._core import QuadliftError


@dataclass
class Found:
    """M detections of a frame, unchecked."""

    boxes: Any
    """(M, 4)."""
    scores: Any = None
    categories: Any = None
    objects: Any = None
    """Object ids: whole numbers or texts."""
    masks: Any = None
    outlines: Any = None
    oriented_boxes: Any = None
    """(M, 5)."""
    depths: Any = None
    boxes3d: Any = None


def of_supervision(found: Any) -> Found:
    """`supervision.Detections`; tracker ids are ``t7`` for 7."""
    data = getattr(found, "data", None) or {}
    classes = data.get("class_name", found.class_id)
    boxes, turned = found.xyxy, None
    if data.get("xyxyxyxy") is not None:
        # Oriented boxes: their bounding boxes say nothing more.
        turned = _outlines.of_corners(data["xyxyxyxy"])
        boxes = np.full((len(turned), 4), np.nan)
    return Found(boxes, found.confidence, classes, _tracks(found.tracker_id), found.mask, oriented_boxes=turned)


def of_ultralytics(result: Any, name: str) -> Found:
    """`ultralytics.engine.results.Results`; track ids are ``t7`` for 7. `name` is the argument, for messages."""
    turned, masks = getattr(result, "obb", None), getattr(result, "masks", None)
    boxes = result.boxes if turned is None else turned
    if boxes is None:
        raise QuadliftError(f"{name} has no boxes; expected those of detection, segmentation, OBB or tracking")
    classes = [result.names[int(k)] for k in _numpy(boxes.cls)]
    tracks = None if boxes.id is None else _numpy(boxes.id).astype(np.int64)
    found = Found(None, _numpy(boxes.conf), classes, _tracks(tracks))
    if turned is None:
        found.boxes = _numpy(boxes.xyxy)
    else:
        # Center, width, height, angle; the boxes around say nothing more.
        found.oriented_boxes = _numpy(turned.xywhr).astype(np.float64)
        found.boxes = np.full((len(found.oriented_boxes), 4), np.nan)
    if masks is not None:
        found.outlines = [_polygon(_numpy(polygon)) for polygon in masks.xy]
    return found


def of_any(detections: Any) -> Found:
    """Detections of either package."""
    if hasattr(detections, "xyxy") and hasattr(detections, "tracker_id"):
        return of_supervision(detections)
    if hasattr(detections, "boxes") and hasattr(detections, "names"):
        return of_ultralytics(detections, "detections")
    raise QuadliftError(
        f"detections is a {type(detections).__name__}; expected supervision.Detections or Ultralytics' Results of one "
        "frame (boxes=... takes arrays)"
    )


def _numpy(tensor: Any) -> Any:
    """Converts a tensor on any device to an array."""
    tensor = tensor.cpu() if hasattr(tensor, "cpu") else tensor
    return np.asarray(tensor)


def _polygon(corners: Any) -> Any:
    """The outline of a mask; None for less than a triangle: a mask that is empty or a line."""
    spread = corners - corners[:1]
    is_flat = len(corners) < 3 or np.linalg.matrix_rank(spread) < 2
    return None if is_flat else corners


def _tracks(numbers: Any) -> list[str | None] | None:
    """The object ids of tracks; None and -1 mean no track."""
    if numbers is None:
        return None
    return [None if number is None or number < 0 else f"t{int(number)}" for number in numbers]
