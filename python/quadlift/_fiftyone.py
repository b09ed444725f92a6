"""Detections and objects of FiftyOne (https://docs.voxel51.com).

The package is not needed to read its samples: only attributes of their types are used.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import _found
from ._core import QuadliftError

Sizes = dict[str, tuple[float, float]]
"""Width and height in pixels of the images of frames."""


def image_sizes(document: dict[str, Any]) -> Sizes:
    """The sizes that a scene knows, by frame id."""
    cameras = {camera["id"]: camera for camera in document.get("cameras", [])}
    sizes = {}
    for frame in document.get("frames", []):
        known = frame if frame.get("width") else cameras.get(frame.get("camera"), {})
        if known.get("width") and known.get("height"):
            sizes[frame["id"]] = (float(known["width"]), float(known["height"]))
    return sizes


def of_sample(sample: Any, field: str, size: tuple[float, float] | None) -> _found.Found:
    """The 2D detections of a sample; boxes are shares of the image, indices are ``t7`` for 7."""
    name = f"the sample {sample.filepath}"
    try:
        labels = sample[field]
    except (AttributeError, KeyError) as error:
        raise QuadliftError(f'{name} has no field "{field}" (field="..." names it)') from error
    if labels is None:
        return _found.Found(np.zeros((0, 4)))
    if not hasattr(labels, "detections"):
        raise QuadliftError(f'the field "{field}" of {name} is a {type(labels).__name__}; expected Detections')
    detections = list(labels.detections or [])
    metadata: Any = getattr(sample, "metadata", None)
    if getattr(metadata, "width", None) and getattr(metadata, "height", None):
        size = (float(metadata.width), float(metadata.height))
    if size is None and detections:
        raise QuadliftError(
            f"{name} has no metadata, and its camera no image size: boxes of FiftyOne are shares of the image "
            "(dataset.compute_metadata() adds sizes)"
        )
    for k, detection in enumerate(detections):
        if len(detection.bounding_box or []) != 4:
            raise QuadliftError(f'{name}: {field}.detections[{k}] has no "bounding_box"; expected a 2D detection')
    shares = np.array([detection.bounding_box for detection in detections], dtype=np.float64).reshape(-1, 4)
    corners = np.concatenate([shares[:, :2], shares[:, :2] + shares[:, 2:]], axis=1)
    boxes = corners * np.array([*(size or (1.0, 1.0))] * 2)
    scores = [float("nan") if d.confidence is None else d.confidence for d in detections]
    tracks = [None if d.index is None or d.index < 0 else f"t{int(d.index)}" for d in detections]
    return _found.Found(boxes, scores, [d.label for d in detections], tracks)


def euler_angles(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (N, 3) in radians about x, y and z of rotations (N, 3, 3): ``R = Rx @ Ry @ Rz``, as FiftyOne has them."""
    x = np.arctan2(-rotations[:, 1, 2], rotations[:, 2, 2])
    y = np.arctan2(rotations[:, 0, 2], np.hypot(rotations[:, 1, 2], rotations[:, 2, 2]))
    # With y near a right angle x is arbitrary: z is what remains after x is undone.
    second = np.cos(x)[:, None] * rotations[:, 1] + np.sin(x)[:, None] * rotations[:, 2]
    z = np.arctan2(second[:, 0], second[:, 1])
    return np.stack([x, y, z], axis=1)


def detections(rows: Iterable[dict[str, Any]]) -> Any:
    """`fiftyone.Detections` with these fields of each."""
    try:
        import fiftyone
    except ImportError as error:
        raise ImportError("to_fiftyone needs FiftyOne: pip install fiftyone") from error
    return fiftyone.Detections(detections=[fiftyone.Detection(**row) for row in rows])
