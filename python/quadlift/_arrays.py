"""Converts arrays to frames and detections for the core. Arrays are checked and only copied if necessary."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, TypedDict

import numpy as np

from . import _checks, _cues, _outlines
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._found import Found

Names = tuple["NDArray[np.int64] | None", list[str]]
"""Indices into a list of texts, shape (M,), -1 for none; None if no row has one."""
Runs = tuple[list[int], list[int]]
"""Height and width of a mask, and COCO's runs (down the columns, starting outside the object)."""


# Arguments of `localize`, `Scene.from_arrays` and `Scene.with_detections`.


class FrameFields(TypedDict, total=False):
    """F frames, beside `intrinsics` and `cam_from_world`."""

    projections: ArrayLike | None
    """World to pixels, in the place of `intrinsics` and `cam_from_world`, shape (F, 3, 4)."""
    distortion: ArrayLike | None
    """OpenCV's coefficients of the lenses, with `intrinsics`: k1, k2, p1, p2, optionally k3, or k3, k4, k5, k6; shape
    (N,) or (F, N). Detections are then in pixels of the images as they are, with the distortion."""
    image_sizes: ArrayLike | None
    """Width and height in pixels, shape (2,) or (F, 2). Without them box edges at the image border are not treated as
    cut off."""
    frame_ids: Sequence[str] | None
    """Names of the frames, length F; "0", "1", ... without it."""
    images: Sequence[str] | None
    """Paths of the images, length F, for `segment` and for reports."""
    name: str | None
    """Name of the scene."""
    up: ArrayLike | None
    """World direction against gravity: an axis such as ``"-y"``, or a direction, shape (3,)."""
    length_unit: str | None
    """World unit; ``"m"`` is required for ``priors="builtin"``."""


class DetectionFields(TypedDict, total=False):
    """M detections, beside `boxes`, `frames` and `objects`."""

    ellipses: ArrayLike | None
    """Center x and y, two semi-axes, and the angle of the first (radians, from x towards y), shape (M, 5); pixels. A
    row of NaN means none. Each detection needs a box, an ellipse, an outline or an oriented box."""
    masks: Sequence[Any] | None
    """Arrays (H, W) or None, length M: non-zero pixels are the object; for ``measurement="mask"``."""
    outlines: Sequence[ArrayLike | None] | None
    """Corners of the outlines (K, 2) in pixels, polygons, or None; length M. A detection without a box has the box
    around its outline."""
    oriented_boxes: ArrayLike | None
    """Center x and y, width, height, and the angle of the width (radians, from x towards y), shape (M, 5); pixels. A
    row of NaN means none. With an outline it is not used."""
    scores: ArrayLike | None
    """Scores of the detector, shape (M,); NaN means none."""
    categories: ArrayLike | None
    """Categories, by number or name, shape (M,); unknown values as for objects."""
    depths: _cues.Depths | ArrayLike | None
    """Median depth of the visible surface along the optical axis, world units, shape (M,); NaN means none. As a mapping
    with `median`, and `sd` and `source` if known."""
    boxes3d: _cues.Boxes3d | None
    """3D boxes from single images: a mapping with any of `center`, `half_extents` and `rotation`, and `frame`, `sd`,
    `covariance`, `source`. With a center a detection needs neither a box nor an ellipse."""
    orientation: int | str | None
    """EXIF orientation of the pictures that the detector saw, 1 to 8, if the cameras are those of the pictures as
    stored: 6 for a phone held upright. ``"6-fractions"`` if the boxes were fractions of the turned pictures, multiplied
    by width and height of the cameras' images."""


class SceneFields(FrameFields, DetectionFields, total=False):
    """Frames and detections."""


# Inputs of the core, as read by `crates/quadlift-py`; missing keys mean none.


class FrameArrays(TypedDict, total=False):
    """F frames; `frame_ids` and either projections, or intrinsics and poses."""

    frame_ids: list[str]
    projections: NDArray[np.float64] | None
    """(F, 3, 4)."""
    intrinsics: NDArray[np.float64] | None
    """(1, 3, 3) or (F, 3, 3)."""
    distortion: NDArray[np.float64] | None
    """(1, 8) or (F, 8)."""
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

    frames: NDArray[np.int64]
    """(M,); any of an object map."""
    boxes: NDArray[np.float64] | None
    """(M, 4)."""
    ellipses: NDArray[np.float64] | None
    """(M, 5)."""
    masks: list[Runs | None] | None
    objects: Names
    categories: Names
    scores: NDArray[np.float64] | None
    """(M,)."""
    source: str | None
    occluded_edges: NDArray[np.bool_] | None
    """(M, 4)."""
    outlines: _outlines.OutlineArrays | None
    cues: _cues.CueArrays | None


class MapFrame(TypedDict):
    """A frame of an object map; a projection, or a pose with a camera."""

    id: str
    time: float
    camera: str | None
    """Id of a camera that was given before."""
    new_camera: tuple[str | None, str, list[float]] | None
    """Id, COLMAP's name of the model, parameters."""
    cam_from_world: list[list[float]] | None
    """(3, 4)."""
    projection: list[list[float]] | None
    """(3, 4)."""
    image_size: list[float] | None
    image: str | None
    pose_noise: list[float] | None


class LocateQuery(TypedDict):
    """The boxes of an image whose camera is sought."""

    boxes: NDArray[np.float64]
    """(M, 4)."""
    categories: Names
    intrinsics: list[float]
    """fx, fy, cx, cy."""
    image_size: list[float] | None
    edge_noise: float | None
    up: list[float] | None
    up_in_camera: list[float] | None
    up_sd: float
    """Radians."""
    height: list[float] | None


class RigArrays(TypedDict):
    """The boxes of C fixed cameras."""

    boxes: NDArray[np.float64]
    """(M, 4)."""
    cameras: NDArray[np.int64]
    """(M,)."""
    time_steps: NDArray[np.int64]
    """(M,)."""
    objects: Names
    categories: Names
    intrinsics: NDArray[np.float64]
    """(C, 3, 3)."""
    image_sizes: NDArray[np.float64] | None
    """(C, 2)."""
    cam_from_world: NDArray[np.float64] | None
    """(C, 3, 4); NaN for cameras that are sought."""
    baselines: list[tuple[int, int, float]]
    builtin_sizes: bool
    upright: list[str]
    still: list[str]
    seed: int


# From arguments


# The names of functions are those in messages about unknown arguments.


def from_arrays(
    intrinsics: ArrayLike | None,
    cam_from_world: ArrayLike | None,
    *,
    projections: ArrayLike | None = None,
    distortion: ArrayLike | None = None,
    image_sizes: ArrayLike | None = None,
    frame_ids: Sequence[str] | None = None,
    images: Sequence[str] | None = None,
    name: str | None = None,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
) -> FrameArrays:
    """Frames of the arguments of `Scene.from_arrays`."""
    like, count, matrices = _matrices(projections, intrinsics, cam_from_world)
    numbers = [str(k) for k in range(count)]
    return {
        **matrices,
        "distortion": None if distortion is None else _lenses(distortion, intrinsics, count),
        "frame_ids": numbers if frame_ids is None else _checks.texts("frame_ids", frame_ids, count),
        "image_sizes": None if image_sizes is None else _sizes(image_sizes, like, count),
        "images": None if images is None else _checks.texts("images", images, count),
        "name": _checks.optional(_checks.text, "name", name),
        "up": _checks.optional(_checks.direction, "up", up),
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
        _checks.rows("intrinsics", cameras, "cam_from_world", len(poses))
    return "cam_from_world", len(poses), {"cam_from_world": poses, "intrinsics": cameras}


def _poses(cam_from_world: ArrayLike, of_one: bool = False) -> NDArray[np.float64]:
    """(F, 3, 4) of (F, 3, 4) or (F, 4, 4); `of_one`: the argument is a single pose."""
    poses = _checks.array("cam_from_world", cam_from_world, ("F", 3, 4), ("F", 4, 4))
    if poses.shape[1] == 3:
        return poses
    wrong = np.flatnonzero((poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1))
    if wrong.size:
        row, place = poses[wrong[0], 3].tolist(), "" if of_one else f"[{wrong[0]}]"
        raise QuadliftError(f"the last row of cam_from_world{place} is {row}; expected [0, 0, 0, 1]")
    return poses[:, :3]


def _sizes(image_sizes: ArrayLike, like: str, count: int) -> NDArray[np.float64]:
    """(F, 2) of (2,) or (F, 2), pixels."""
    sizes = _checks.array("image_sizes", image_sizes, ("F", 2), (2,))
    if sizes.ndim == 1:
        sizes = np.broadcast_to(sizes, (count, 2))
    _checks.rows("image_sizes", sizes, like, count)
    if (sizes <= 0.0).any():
        raise QuadliftError(f"image_sizes holds {sizes[sizes <= 0.0][0]}; expected positive numbers of pixels")
    return sizes


def map_frame(
    frame_id: str,
    *,
    time: Any,
    intrinsics: ArrayLike | None,
    distortion: ArrayLike | None,
    cam_from_world: ArrayLike | None,
    projection: ArrayLike | None,
    camera: Any,
    image_size: ArrayLike | None,
    image: str | None,
    pose_noise: ArrayLike | None,
) -> MapFrame:
    """A frame of the arguments of `ObjectMap.observe`."""
    matrix, pose, name, model = None, None, None, None
    size = None if image_size is None else _size(image_size)
    if projection is not None:
        others = {"intrinsics": intrinsics, "cam_from_world": cam_from_world, "camera": camera}
        found = [k for k, value in others.items() if value is not None]
        if found:
            raise QuadliftError(f"expected either projection, or a camera and cam_from_world; found {found[0]} too")
        matrix = _checks.array("projection", projection, (3, 4))
    else:
        given = {"intrinsics": intrinsics, "camera": camera}
        found = [k for k, value in given.items() if value is not None]
        if len(found) == 2:
            raise QuadliftError("expected either intrinsics or camera; found both")
        if cam_from_world is None or not found:
            found += ["cam_from_world"] if cam_from_world is not None else []
            words = " and ".join(found) or "none of them"
            raise QuadliftError(f"expected projection, or cam_from_world with intrinsics or camera; found {words}")
        pose = _poses(_checks.array("cam_from_world", cam_from_world, (3, 4), (4, 4))[np.newaxis], of_one=True)[0]
        if isinstance(camera, str):
            name = camera
        elif camera is not None:
            model, size = _camera(camera, size)
        else:
            model = (None, *_lens(intrinsics, distortion))
    if distortion is not None and intrinsics is None:
        raise QuadliftError(_LENS_ALONE)
    return {
        "id": frame_id,
        "time": _checks.number("time", time),
        "camera": name,
        "new_camera": model,
        "cam_from_world": None if pose is None else pose.tolist(),
        "projection": None if matrix is None else matrix.tolist(),
        "image_size": size,
        "image": _checks.optional(_checks.text, "image", image),
        "pose_noise": None if pose_noise is None else _checks.array("pose_noise", pose_noise, (2,)).tolist(),
    }


def _size(image_size: ArrayLike) -> list[float]:
    size: list[float] = _checks.array("image_size", image_size, (2,)).tolist()
    if min(size) <= 0.0:
        raise QuadliftError(f"image_size is {tuple(size)}; expected two positive numbers of pixels")
    return size


def _lens(intrinsics: ArrayLike | None, distortion: ArrayLike | None) -> tuple[str, list[float]]:
    """COLMAP's model and parameters of a matrix and of OpenCV's coefficients."""
    k = _checks.array("intrinsics", intrinsics, (3, 3))
    if [k[0, 1], k[1, 0], k[2, 0], k[2, 1], k[2, 2]] != [0.0, 0.0, 0.0, 0.0, 1.0]:
        raise QuadliftError(f"intrinsics is {k.tolist()}; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]")
    if k[0, 0] <= 0.0 or k[1, 1] <= 0.0:
        raise QuadliftError(f"intrinsics has the focal lengths ({k[0, 0]:g}, {k[1, 1]:g}); expected positive numbers")
    pinhole = [k[0, 0].item(), k[1, 1].item(), k[0, 2].item(), k[1, 2].item()]
    if distortion is None:
        return "PINHOLE", pinhole
    coefficients: list[float] = _lenses(distortion, intrinsics, 1)[0].tolist()
    if any(coefficients[4:]):
        return "FULL_OPENCV", pinhole + coefficients
    return ("OPENCV", pinhole + coefficients[:4]) if any(coefficients) else ("PINHOLE", pinhole)


_LENS_ALONE = "distortion goes with intrinsics; found it without them"


def _lenses(distortion: ArrayLike, intrinsics: ArrayLike | None, count: int) -> NDArray[np.float64]:
    """OpenCV's coefficients, (1, 8) or (F, 8), of `count` frames."""
    if intrinsics is None:
        raise QuadliftError(_LENS_ALONE)
    found = _checks.array("distortion", distortion, ("N",), ("F", "N"))
    if found.ndim == 1 or found.shape[1] == 1:
        found = found.reshape(1, -1)
    if len(found) > 1:
        _checks.rows("distortion", found, "cam_from_world", count)
    if found.shape[1] not in (4, 5, 8, 12, 14) or found[:, 8:].any():
        raise QuadliftError(
            f"distortion has {found.shape[1]} numbers; expected 4, 5 or 8 of OpenCV's coefficients k1, k2, p1, p2, k3, "
            "k4, k5, k6 (Scene.from_dict and camera=... of ObjectMap.observe take other lenses)"
        )
    return np.pad(found[:, :8], ((0, 0), (0, 8 - min(8, found.shape[1]))))


def _camera(camera: Any, size: list[float] | None) -> tuple[tuple[str | None, str, list[float]], list[float] | None]:
    """A camera of a mapping with the fields of scene files, or of pycolmap; and the size of its images."""
    fields = ("id", "model", "params", "width", "height")
    if isinstance(camera, Mapping):
        found = {name: camera.get(name) for name in fields}
        unknown = [name for name in camera if name not in fields]
        if unknown:
            raise QuadliftError(f"camera has the field {unknown[0]!r}; expected {', '.join(map(repr, fields))}")
    else:
        found = {name: getattr(camera, name, None) for name in fields[1:]}
        # An enum of pycolmap.
        found["model"] = getattr(found["model"], "name", found["model"])
    if found["model"] is None or found["params"] is None:
        raise QuadliftError(
            f"camera is a {type(camera).__name__}; expected the id of a camera that was given before, a mapping with "
            '"model" and "params", or a pycolmap.Camera'
        )
    of_camera = [found["width"], found["height"]]
    if of_camera != [None, None]:
        size = _size([_checks.number(f"camera.{name}", found[name]) for name in ("width", "height")])
    name = _checks.optional(_checks.text, "camera.id", found.get("id"))
    params = _checks.array("camera.params", found["params"], ("N",)).tolist()
    return (name, _checks.text("camera.model", found["model"]), params), size


def map_detections(found: Found) -> DetectionArrays:
    """The detections of a frame of an object map."""
    shaped = found.outlines is not None or found.oriented_boxes is not None
    boxes = _checks.array("boxes", found.boxes, ("M", 4), nan=shaped)
    count, scores = len(boxes), found.scores
    if scores is not None:
        scores = _checks.array("scores", scores, ("M",), nan=True)
        _checks.rows("scores", scores, "boxes", count)
    return {
        "frames": np.zeros(count, dtype=np.int64),
        "boxes": boxes,
        "objects": _checks.names("objects", found.objects, count, "boxes"),
        "categories": _checks.names("categories", found.categories, count, "boxes"),
        "scores": scores,
        "outlines": _outlines.outlines(found.outlines, found.oriented_boxes, count, "boxes"),
        "cues": _cues.cues(found.depths, found.boxes3d, count, "boxes"),
    }


def map_poses(
    frame_ids: list[str], cam_from_world: ArrayLike | None, projections: ArrayLike | None
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64] | None]:
    """The arguments of `ObjectMap.update_poses`."""
    if (cam_from_world is None) == (projections is None):
        words = "none of them" if projections is None else "both"
        raise QuadliftError(f"expected either cam_from_world or projections; found {words}")
    if cam_from_world is not None:
        poses = _poses(cam_from_world)
        _checks.rows("cam_from_world", poses, "frame_ids", len(frame_ids))
        return poses, None
    matrices = _checks.array("projections", projections, ("F", 3, 4))
    _checks.rows("projections", matrices, "frame_ids", len(frame_ids))
    return None, matrices


def with_detections(
    boxes: ArrayLike | None,
    frames: ArrayLike | None,
    objects: ArrayLike | None,
    frame_ids: list[str],
    *,
    source: str | None = None,
    ellipses: ArrayLike | None = None,
    masks: Sequence[Any] | None = None,
    outlines: Sequence[Any] | None = None,
    oriented_boxes: ArrayLike | None = None,
    scores: ArrayLike | None = None,
    categories: ArrayLike | None = None,
    depths: _cues.Depths | ArrayLike | None = None,
    boxes3d: _cues.Boxes3d | None = None,
    orientation: int | str | None = None,
) -> tuple[DetectionArrays, str | None]:
    """Detections of the arguments of `Scene.with_detections`, and the orientation as the program takes it."""
    if frames is None:
        raise QuadliftError("expected frames, the frame of each detection by index or id, of shape (M,); found None")
    indices = _checks.places("frames", frames, frame_ids)
    count = len(indices)
    if all(given is None for given in (boxes, ellipses, outlines, oriented_boxes, boxes3d)):
        raise QuadliftError("expected boxes or ellipses; found none of them")

    def rows(name: str, value: ArrayLike | None, *width: int) -> NDArray[np.float64] | None:
        if value is None:
            return None
        numbers = _checks.array(name, value, ("M", *width), nan=True)
        _checks.rows(name, numbers, "frames", count)
        return numbers

    arrays: DetectionArrays = {
        "frames": indices,
        "boxes": rows("boxes", boxes, 4),
        "ellipses": rows("ellipses", ellipses, 5),
        "scores": rows("scores", scores),
        "masks": None if masks is None else _masks(masks, count),
        "objects": _checks.names("objects", objects, count, "frames"),
        "categories": _checks.names("categories", categories, count, "frames"),
        "source": _checks.optional(_checks.text, "source", source),
        "outlines": _outlines.outlines(outlines, oriented_boxes, count, "frames"),
        "cues": _cues.cues(depths, boxes3d, count, "frames"),
    }
    if orientation is not None and not isinstance(orientation, str):
        orientation = str(_checks.whole("orientation", orientation, 1, 8))
    return arrays, orientation


def _masks(masks: Sequence[Any], count: int) -> list[Runs | None]:
    _checks.rows("masks", masks, "frames", count)
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
