"""The frames, cameras and detections of a scene as tables."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._arrow import pa
from ._columns import BOX, BOX3D, DEVIATIONS, ORIENTED_BOX

_VECTOR = pa.list_(pa.float64())
_FRAMES: dict[str, Any] = {
    **dict.fromkeys(("frame", "camera", "model"), pa.string()),
    **dict.fromkeys(("params", "intrinsics", "cam_from_world", "projection"), _VECTOR),
    **dict.fromkeys(("width", "height", "time"), pa.float64()),
    "image": pa.string(),
}
_DETECTIONS: dict[str, Any] = {
    **dict.fromkeys(("frame", "object", "category", "source"), pa.string()),
    **dict.fromkeys(("score", *BOX), pa.float64()),
    **dict.fromkeys(("ellipse", "outline"), _VECTOR),
    **dict.fromkeys((*ORIENTED_BOX, "depth_median", "depth_sd"), pa.float64()),
    "depth_source": pa.string(),
    **{f"box3d_{name}": _VECTOR for name in BOX3D},
    **{f"box3d_sd_{name}": pa.float64() for name in DEVIATIONS},
    **dict.fromkeys(("box3d_frame", "box3d_source"), pa.string()),
    **dict.fromkeys(("occluded", "truncated", "visible_fraction"), pa.float64()),
}


def tables(document: dict[str, Any]) -> tuple[Any, Any]:
    """Detections and frames of the document of a scene file."""
    cameras = {camera["id"]: camera for camera in document.get("cameras", [])}
    frames = [_frame(frame, cameras.get(frame.get("camera"), {})) for frame in document.get("frames", [])]
    detections = [_detection(detection) for detection in document.get("detections", [])]
    return _table(detections, _DETECTIONS), _table(frames, _FRAMES)


def _table(rows: list[dict[str, Any]], columns: dict[str, Any]) -> Any:
    return pa.table({name: pa.array([row.get(name) for row in rows], kind) for name, kind in columns.items()})


def _flat(value: Any) -> list[float] | None:
    return None if value is None else np.ravel(value).tolist()


def _frame(frame: dict[str, Any], camera: dict[str, Any]) -> dict[str, Any]:
    model, params = camera.get("model"), camera.get("params")
    pinhole = {"PINHOLE": params, "SIMPLE_PINHOLE": params and [params[0], *params[:3]]}.get(model or "")
    return {
        **frame,
        "frame": frame["id"],
        **{name: _flat(frame.get(name)) for name in ("cam_from_world", "projection")},
        **{"model": model, "params": params, "intrinsics": pinhole},
        **{name: frame.get(name, camera.get(name)) for name in ("width", "height")},
    }


def _detection(detection: dict[str, Any]) -> dict[str, Any]:
    ellipse, turned = detection.get("ellipse"), detection.get("oriented_box")
    box3d, depth = detection.get("box3d", {}), detection.get("depth", {})
    oriented_box = [*turned["center"], *turned["size"], turned["angle"]] if turned else [None] * 5
    return {
        **detection,
        **dict(zip(BOX, detection.get("box") or [None] * 4, strict=True)),
        "ellipse": ellipse and [*ellipse["center"], *ellipse["semi_axes"], ellipse["angle"]],
        "outline": _flat(detection.get("outline")),
        **dict(zip(ORIENTED_BOX, oriented_box, strict=True)),
        **{f"depth_{name}": value for name, value in depth.items()},
        **{f"box3d_{name}": _flat(box3d.get(name)) for name in BOX3D},
        **{f"box3d_{name}": box3d.get(name) for name in ("frame", "source")},
        **{f"box3d_sd_{name}": box3d.get("sd", {}).get(name) for name in DEVIATIONS},
    }
