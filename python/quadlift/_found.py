"""The detections of one frame as arrays, also from objects of other packages.

None of the packages is imported: only attributes of their types are used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ._core import QuadliftError


@dataclass
class Found:
    """M detections of a frame, unchecked."""

    boxes: Any
    """(M, 4)."""
    scores: Any = None
    categories: Any = None
    object: Any = None
    """Object ids: whole numbers or texts."""
    masks: Any = None
    depth: Any = None
    box3d: Any = None


def of_supervision(found: Any) -> Found:
    """`supervision.Detections`; tracker ids are ``t7`` for 7."""
    data = getattr(found, "data", None) or {}
    classes = data.get("class_name", found.class_id)
    return Found(found.xyxy, found.confidence, classes, _tracks(found.tracker_id), found.mask)


def of_ultralytics(result: Any, name: str) -> Found:
    """`ultralytics.engine.results.Results`; track ids are ``t7`` for 7. `name` is the argument, for messages."""
    boxes = result.boxes
    if boxes is None:
        raise QuadliftError(f"{name} has no boxes; expected those of detection, segmentation or tracking")
    classes = [result.names[int(k)] for k in _numpy(boxes.cls)]
    tracks = None if boxes.id is None else _numpy(boxes.id).astype(np.int64)
    return Found(_numpy(boxes.xyxy), _numpy(boxes.conf), classes, _tracks(tracks))


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


def _tracks(numbers: Any) -> list[str | None] | None:
    """The object ids of tracks; None and -1 mean no track."""
    if numbers is None:
        return None
    return [None if number is None or number < 0 else f"t{int(number)}" for number in numbers]
