"""From other packages' types to arrays. None of the packages is imported: their attributes are enough."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any

import numpy as np

from . import _checks
from ._core import QuadliftError

Table = dict[str, Any]


def runs_of_masks(masks: Sequence[Any], count: int) -> list[tuple[list[int], list[int]] | None]:
    """Height and width and COCO's runs (down the columns, the first one outside of the object) of each mask."""
    _checks.rows("masks", len(masks), "frame", count)
    return [None if mask is None else _runs(f"masks[{k}]", mask) for k, mask in enumerate(masks)]


def _runs(name: str, mask: Any) -> tuple[list[int], list[int]]:
    pixels = np.asarray(mask)
    if pixels.ndim != 2 or pixels.dtype.kind not in "biuf":
        raise QuadliftError(
            f"{name} has the shape {pixels.shape} and the dtype {pixels.dtype}; expected (H, W), numbers"
        )
    column = (pixels != 0).T.reshape(-1)
    changes = np.flatnonzero(np.diff(column, prepend=False)) if column.size else np.zeros(0, dtype=np.int64)
    lengths = np.diff(np.concatenate([[0], changes, [column.size]]))
    return list(pixels.shape), [int(length) for length in lengths]


def by_frame(
    detections: Sequence[Any] | Mapping[str, Any], frames: Sequence[str] | None, known: list[str]
) -> list[tuple[int, Any]]:
    """Detections with the indices of their frames."""
    index = {name: k for k, name in enumerate(known)}
    if isinstance(detections, Mapping):
        pairs = list(detections.items())
    else:
        names = known if frames is None else list(frames)
        if len(detections) != len(names):
            like = "the scene has frames" if frames is None else "frames"
            raise QuadliftError(f"there are {len(detections)} detections; expected {len(names)}, as many as {like}")
        pairs = list(zip(names, detections, strict=True))
    for name, _ in pairs:
        if name not in index:
            some = ", ".join(known[:5])
            raise QuadliftError(f'unknown frame "{name}"; the scene has {len(known)} frames: {some}')
    return [(index[name], found) for name, found in pairs]


def frames_of_paths(paths: list[str], known: list[str]) -> list[str]:
    """The frames whose ids are the names of these files, with or without folders and extensions."""
    for part in ("name", "stem"):
        frames: dict[str, list[str]] = {}
        for name in known:
            frames.setdefault(getattr(PurePath(name), part), []).append(name)
        found = [frames.get(getattr(PurePath(path), part), []) for path in paths]
        if all(len(names) == 1 for names in found):
            return [names[0] for names in found]
    missing = next(path for path, names in zip(paths, found, strict=True) if len(names) != 1)
    some = ", ".join(known[:5])
    raise QuadliftError(
        f"no single frame has the name of the image {PurePath(missing).name}; the scene has {len(known)} frames: "
        f"{some} (frames=[...] names them)"
    )


def supervision(detections: list[tuple[int, Any]]) -> Table:
    """The table of `supervision.Detections`."""
    table = _Table()
    for frame, found in detections:
        data = getattr(found, "data", None) or {}
        classes = data.get("class_name", found.class_id)
        table.add(frame, found.xyxy, found.confidence, classes, found.tracker_id, found.mask)
    return table.arrays()


def ultralytics(results: list[tuple[int, Any]]) -> Table:
    """The table of Ultralytics' results."""
    table = _Table()
    for frame, result in results:
        boxes = result.boxes
        if boxes is None:
            raise QuadliftError("a result has no boxes; expected those of detection, segmentation or tracking")
        classes = [result.names[int(k)] for k in _numpy(boxes.cls)]
        ids = None if boxes.id is None else _numpy(boxes.id).astype(np.int64)
        table.add(frame, _numpy(boxes.xyxy), _numpy(boxes.conf), classes, ids, None)
    return table.arrays()


def _numpy(tensor: Any) -> Any:
    """An array of a tensor, wherever it is."""
    tensor = tensor.cpu() if hasattr(tensor, "cpu") else tensor
    return np.asarray(tensor)


def _track(number: Any) -> str | None:
    """The object of a track; trackers say None or -1 where there is none yet."""
    return None if number is None or number < 0 else f"t{int(number)}"


class _Table:
    """Detections, gathered frame by frame."""

    def __init__(self) -> None:
        self.frame: list[int] = []
        self.boxes: list[Any] = []
        self.scores: list[float] = []
        self.categories: list[str | None] = []
        self.object: list[str | None] = []
        self.masks: list[Any] = []

    def add(self, frame: int, boxes: Any, scores: Any, classes: Any, tracks: Any, masks: Any) -> None:
        edges = _checks.array("xyxy", boxes, ("M", 4))
        for row in range(len(edges)):
            self.frame.append(frame)
            self.boxes.append(edges[row])
            self.scores.append(float("nan") if scores is None else float(scores[row]))
            self.categories.append(None if classes is None else str(classes[row]))
            self.object.append(None if tracks is None else _track(tracks[row]))
            self.masks.append(None if masks is None else masks[row])

    def arrays(self) -> Table:
        return {
            "frame": np.array(self.frame, dtype=np.int64),
            "boxes": np.array(self.boxes, dtype=np.float64).reshape(-1, 4),
            "scores": np.array(self.scores, dtype=np.float64),
            "categories": np.array(self.categories, dtype=object),
            "object": np.array(self.object, dtype=object),
            "masks": self.masks if any(mask is not None for mask in self.masks) else None,
        }
