"""Scenes and results as recordings for Rerun (https://rerun.io).

Entities, on the timelines "frame" and, if the frames have times, "time":

    world/estimate/ellipsoids, world/estimate/cuboids   estimated bodies (cylinders and
                                                        superellipsoids as their ellipsoids)
    world/truth/ellipsoids, world/truth/cuboids         true bodies
    world/path                                          the cameras' centres
    world/camera                                        pose of the frame's camera
    world/camera/image                                  its pinhole camera and its image
    world/camera/image/boxes                            detected boxes, red if rejected by the estimator
    world/camera/image/ellipses                         detected ellipses, as line strips
    world/camera/image/outlines                         outlines of the estimated bodies, as line strips
    world/camera/image/true_outlines                    outlines of the true bodies

All values are computed beforehand (see docs/formats/rerun.md); this module only logs them.
"""

from __future__ import annotations

import contextlib
import json
import os
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from . import _core
from ._core import QuadliftError

TRUTH = [0xB0, 0xB0, 0xB0]
REJECTED = [0xE0, 0x10, 0x10]

Record = dict[str, Any]


def log_recording(folder: str | os.PathLike[str], path: str | os.PathLike[str] | None = None) -> None:
    """Logs the output of ``quadlift export rerun``; needs the SDK of Rerun.

    Parameters
    ----------
    folder : path-like
        The folder.
    path : path-like, optional
        A recording file to write (``.rrd``); without it, logs to the current recording (``rerun.init``).

    Raises
    ------
    QuadliftError
        If the folder contains no recording, or if Rerun has none and no path is given.
    """
    file = Path(folder) / "recording.json"
    try:
        recording = json.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise QuadliftError(f"{file}: there is no such file; expected the output of `quadlift export rerun`") from error
    except (OSError, ValueError) as error:
        raise QuadliftError(f"{file} is not a recording: {error}") from error
    found = (recording.get("format"), recording.get("version")) if isinstance(recording, dict) else None
    if found != ("quadlift.recording", 1):
        words = f"the format {found[0]!r}, version {found[1]!r}" if found else f"a {type(recording).__name__}"
        raise QuadliftError(f"{file}: found {words}; expected the format 'quadlift.recording', version 1")
    rr = _rerun()

    def image(index: int) -> Any:
        name = recording["frames"][index]["image"]
        return rr.EncodedImage(path=file.parent / name) if name else None

    _log(rr, recording, image, path, recording["name"])


def log_recorded(recorded: tuple[str, list[int]], scene: _core.Scene, path: str | os.PathLike[str] | None) -> None:
    """Logs a recording of the core, with the images of its scene."""
    recording, frames = json.loads(recorded[0]), recorded[1]
    rr = _rerun()

    def image(index: int) -> Any:
        try:
            found = scene.jpeg(frames[index])
        except QuadliftError as error:
            # Attributed to the line that calls `to_rerun`.
            warnings.warn(str(error), stacklevel=5)
            return None
        if found is None:
            return None
        recording["frames"][index]["size"] = found[1]
        return rr.EncodedImage(contents=found[0], media_type="image/jpeg")

    _log(rr, recording, image, path, scene.name)


def _rerun() -> Any:
    """Rerun's SDK."""
    try:
        import rerun
    except ImportError as error:
        raise ImportError("recordings need Rerun's SDK: pip install rerun-sdk") from error
    return rerun


def _log(
    rr: Any, recording: Record, image: Callable[[int], Any], path: str | os.PathLike[str] | None, name: str | None
) -> None:
    """Logs a recording; `image` returns the images of its frames, and recordings of the same name belong together."""
    stream: Any = contextlib.nullcontext()
    if path is not None:
        stream = rr.RecordingStream("quadlift", recording_id=name)
        stream.save(path)
    elif rr.get_data_recording() is None:
        raise QuadliftError("there is no recording; call rerun.init first, or give the path of a file to write")
    with stream:
        coordinates = _view_coordinates(rr, recording["up"]) if recording["up"] else None
        if coordinates is not None:
            rr.log("world", coordinates, static=True)
        for key in ("estimate", "truth"):
            _log_bodies(rr, recording["objects"], key)
        if recording["path"]:
            rr.log("world/path", rr.LineStrips3D([recording["path"]]), static=True)
        for index, frame in enumerate(recording["frames"]):
            rr.reset_time()
            rr.set_time("frame", sequence=index)
            if frame["time"] is not None:
                rr.set_time("time", duration=frame["time"])
            _log_frame(rr, frame, image(index))
        rr.reset_time()
    if path is not None:
        stream.flush()
        stream.disconnect()


def _log_bodies(rr: Any, objects: list[Record], key: str) -> None:
    """Logs the bodies `key` ("estimate" or "truth") of the objects that have them."""
    for shape, archetype in (("ellipsoid", rr.Ellipsoids3D), ("cuboid", rr.Boxes3D)):
        shown = [o for o in objects if o[key] and o[key]["shape"] == shape]
        if shown:
            bodies = archetype(
                centers=[o[key]["center"] for o in shown],
                half_sizes=[o[key]["half_sizes"] for o in shown],
                quaternions=[o[key]["quaternion_xyzw"] for o in shown],
                colors=[o["color"] if key == "estimate" else TRUTH for o in shown],
                labels=[o["id"] for o in shown],
            )
            rr.log(f"world/{key}/{shape}s", bodies, static=True)


def _log_frame(rr: Any, frame: Record, image: Any) -> None:
    """Logs camera, image, boxes and outlines of a frame at the time that is set."""
    path = "world/camera/image"
    if frame["camera"]:
        pose = np.array(frame["camera"]["cam_from_world"])
        child = rr.TransformRelation.ChildFromParent
        rr.log("world/camera", rr.Transform3D(translation=pose[:, 3], mat3x3=pose[:, :3], relation=child))
        pinhole = rr.Pinhole(
            image_from_camera=frame["camera"]["intrinsics"],
            resolution=frame["size"],
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        rr.log(path, pinhole)
    rr.log(path, image if image is not None else rr.EncodedImage.cleared())
    boxes = frame["boxes"]
    if boxes:
        found = rr.Boxes2D(
            array=[b["edges"] for b in boxes],
            array_format=rr.Box2DFormat.XYXY,
            colors=[_measured_color(b) for b in boxes],
            labels=[_label(b) for b in boxes],
        )
        rr.log(f"{path}/boxes", found)
    else:
        rr.log(f"{path}/boxes", rr.Clear(recursive=False))
    _log_lines(rr, f"{path}/ellipses", frame["ellipses"], _measured_color)
    _log_lines(rr, f"{path}/outlines", frame["outlines"], lambda o: o["color"])
    _log_lines(rr, f"{path}/true_outlines", frame["true_outlines"], lambda _: TRUTH)


def _log_lines(rr: Any, path: str, outlines: list[Record], color: Callable[[Record], Any]) -> None:
    """Logs all outlines, or clears them if there are none in this frame."""
    lines = [(line, o) for o in outlines for line in o["lines"]]
    if not lines:
        rr.log(path, rr.Clear(recursive=False))
        return
    strips = rr.LineStrips2D(
        [line for line, _ in lines],
        colors=[color(o) for _, o in lines],
        labels=[_label(o) for _, o in lines],
        show_labels=False,
    )
    rr.log(path, strips)


def _label(owner: Record) -> str:
    label: str = owner["object"] or owner["category"] or ""
    return label


def _measured_color(owner: Record) -> Any:
    return REJECTED if owner["inlier"] is False else owner["color"]


def _view_coordinates(rr: Any, up: list[float]) -> Any:
    """Rerun's name for a world with this up axis; None for other directions."""
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < 0.999:
        return None
    return getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}")
