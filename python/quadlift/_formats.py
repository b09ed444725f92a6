"""Options of the formats of other programs: those of `quadlift import` and `quadlift export`."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypedDict

import numpy as np

from . import _checks
from ._checks import Path
from ._core import QuadliftError


class CameraOptions(TypedDict, total=False):
    """Options of `Scene.from_cameras`: what the files of some formats lack."""

    points: int
    """COLMAP, OpenSfM: maximum number of sparse points to keep, evenly spread; 0 for none. Default: 5000."""
    image_size: tuple[float, float]
    """Width and height of the images in pixels, if the files do not contain them."""
    pixel_centers: Literal["integer", "half"]
    """Position of the center of the first pixel: at 0 or at 0.5. Default: "half"."""
    intrinsics: Path
    """TUM: a file with a line fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS."""
    image_list: Path
    """TUM: a file with lines `time image`; each image gets the pose nearest in time."""
    time_tolerance: float
    """TUM, logs: maximum difference of the times of an image and its pose, seconds. Default: 0.02."""
    sequence: str
    """KITTI: the sequence, such as "0001"; nuScenes: the scene, such as "scene-0061"."""
    frames: tuple[int, int]
    """KITTI: first and last frame."""
    camera: int
    """KITTI raw: number of the camera. Default: 2."""
    calibration_folder: Path
    """KITTI raw: folder of the calibration. Default: above the drive."""
    channels: Sequence[str]
    """nuScenes: cameras, such as ["CAM_FRONT"]. Default: all."""
    sweeps: bool
    """nuScenes: also read the images between the key frames."""
    world_object: int
    """BOP: number of the object whose model frame becomes the world frame."""
    models: Path
    """BOP: models_info.json. Default: in `models` of the parent folders."""
    topics: Sequence[str]
    """Logs: topics to use instead of all others of their kinds."""
    world_frame: str
    """Logs: the frame in which objects are located. Default: root of the transforms."""
    camera_frame: str
    """Logs: the frame of the camera. Default: the frame_id of its calibration."""
    max_gap: float
    """Logs: longest time between two transforms that is interpolated, seconds. Default: 1."""
    rectified: bool
    """Logs: the boxes were measured in the rectified image."""
    skip_errors: bool
    """Logs: leave out what is damaged or cannot be read."""
    write_images: Path
    """Logs: folder for the compressed images."""


class DetectionOptions(TypedDict, total=False):
    """Options of `Scene.from_detections`: what the files of some formats lack."""

    class_names: Path
    """YOLO, MOTChallenge, tables: a file of class names, one per line, or the `names` of a .yaml file."""
    annotations: Path
    """COCO results: the data set that names images and categories."""
    frame_column: str
    """Tables: the column that identifies the image. Default: by name."""
    columns: str
    """Columns after the box. MOTChallenge: "det", "gt" or "class"; YOLO: "none", "score", "track" or "score+track"."""
    kind: Literal["auto", "box", "polygon", "obb"]
    """YOLO: what follows the class."""
    box_origin: Literal[0, 1]
    """MOTChallenge: coordinate of the left edge of the first pixel. Default: 1."""
    pixel_centers: Literal["integer", "half"]
    """Tables: position of the center of the first pixel, at 0 or at 0.5. Default: "half"."""
    time_tolerance: float
    """Maximum difference of the times of an image and its frame, seconds. Default: 0.02."""


class ExportOptions(TypedDict, total=False):
    """Options of `Scene.export`."""

    enclosing: bool
    """Export the ellipsoids around the objects (of localize with enclosing) instead of the bodies."""
    frusta: float
    """PLY, glTF: depth of the camera frusta, world units; 0 for none. Default: a tenth of the objects' distance."""
    only_detected: bool
    """BOP, COCO, KITTI: only frames in which the object was detected, instead of all in which it is visible."""
    calib: Path
    """KITTI: calibration file of the sequence; locations are then in the axes of camera 0."""
    scene_id: int
    """BOP: value of the column scene_id. Default: 0."""
    origin: tuple[float, float, float]
    """GeoJSON: the world's origin, latitude and longitude in degrees (WGS84) and meters above the ellipsoid."""
    crs: str
    """GeoJSON: coordinates of the world in place of an origin, such as "EPSG:32633" (UTM) or "EPSG:4978"."""
    length_unit: str
    """BOP, GeoJSON, glTF, KITTI, MCAP: unit of the lengths, such as "m", if the scene does not say it."""
    north: tuple[float, float, float]
    """GeoJSON: world direction whose horizontal part is north. Default: (0, 1, 0)."""
    frame_id: str
    """MCAP: name of the world frame. Default: "map"."""
    views: Path
    """CSV: a second table with the residual of each view of each object."""
    camera: str
    """TUM: id of the camera, if frames have several."""


FLAGS = frozenset({"sweeps", "rectified", "skip_errors", "enclosing", "only_detected"})
_TEXTS = frozenset(
    {
        "frame_column",
        "columns",
        "kind",
        "pixel_centers",
        "sequence",
        "world_frame",
        "camera_frame",
        "frame_id",
        "crs",
        "length_unit",
    }
)
_SEPARATORS = {"image_size": "x", "frames": "-"}


def texts(options: Mapping[str, Any], known: type, function: str) -> list[tuple[str, str]]:
    """Options with their values as the program takes them."""
    for name in options:
        if name not in known.__annotations__:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")
    given = {name: value for name, value in options.items() if value is not None}
    flags = [name for name, value in given.items() if name in FLAGS and _checks.flag(name, value)]
    return [(name, "") for name in flags] + [(n, _text(n, value)) for n, value in given.items() if n not in FLAGS]


def _text(name: str, value: Any) -> str:
    if name in _TEXTS:
        return _checks.text(name, value)
    if isinstance(value, str | os.PathLike):
        return os.fspath(value)
    if isinstance(value, int | float | np.number) and not isinstance(value, bool):
        return str(value)
    if isinstance(value, Sequence | np.ndarray):
        return _SEPARATORS.get(name, ",").join(_text(name, item) for item in value)
    raise QuadliftError(f"{name} is {value!r}; expected a text, a number or a sequence of them")
