"""How the records of a recording (docs/formats/exports.md) become entities of Rerun.

Needs Rerun's SDK alone: the program ``quadlift`` contains this file and runs it for ``quadlift stream --rerun``
(``serve``), and the Python package imports it as ``quadlift._rerun_log``, a link to this file.

Entities, on the timelines "frame" and, if the frames have times, "time":

    world/estimate/ellipsoids, world/estimate/cuboids   estimated bodies (cylinders and
                                                        rounded bodies as their ellipsoids)
    world/truth/ellipsoids, world/truth/cuboids         true bodies
    world/boxes3d                                       3D boxes of the frame's detections
    world/path                                          the cameras' centers
    world/camera                                        pose of the frame's camera
    world/camera/image                                  its pinhole camera and its image
    world/camera/image/boxes                            detected boxes, red if rejected by the estimator
    world/camera/image/ellipses                         detected ellipses, as line strips
    world/camera/image/detected_outlines                detected outlines and oriented boxes, as line strips
    world/camera/image/outlines                         outlines of the estimated bodies, as line strips
    world/camera/image/true_outlines                    outlines of the true bodies

3D boxes and detected outlines are logged if there are any in the recording. A live map has these instead of the bodies
and the path:

    world/map/<id>                                      ellipsoid of an object; cleared when it is gone or removed
    events                                              what happened, as text

All values are computed beforehand; this module only logs them.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import sys
import time
from collections.abc import Callable
from typing import IO, Any
from urllib.parse import urlsplit

import numpy as np

TRUTH = [0xB0, 0xB0, 0xB0]
REJECTED = [0xE0, 0x10, 0x10]
BOX3D = [0xF0, 0xC0, 0x40]

# A viewer that takes nothing for so many seconds is gone; how often that is checked.
PATIENCE = 10.0
CHECK_EVERY = 1.0

# The oldest version of the SDK that `serve` is tested with.
OLDEST = (0, 32)

# The port of the local viewer.
PORT = 9876

Record = dict[str, Any]


def log_recording(rr: Any, recording: Record, image: Callable[[int], Any]) -> None:
    """Logs a recording to the current one of Rerun; `image` returns the images of its frames."""
    if recording["up"]:
        log_up(rr, recording["up"])
    for key in ("estimate", "truth"):
        _log_bodies(rr, recording["objects"], key)
    if recording["path"]:
        rr.log("world/path", rr.LineStrips3D([recording["path"]]), static=True)
    cues = [key for key in CUES if any(frame.get(key) for frame in recording["frames"])]
    for index, frame in enumerate(recording["frames"]):
        rr.reset_time()
        _set_time(rr, index, frame["time"])
        _log_frame(rr, frame, image(index))
        for key in cues:
            CUES[key](rr, frame[key])
    rr.reset_time()


def log_live(rr: Any, record: Record) -> None:
    """Logs what has changed in an object map to the current recording of Rerun."""
    if record["up"]:
        log_up(rr, record["up"])
    _set_time(rr, record["index"], record["time"])
    if record["frame"]:
        _log_camera(rr, record["frame"])
        image = record["frame"]["image"]
        # A stream goes on without an image.
        shown = image and image.lower().endswith((".jpg", ".jpeg", ".png")) and os.path.isfile(image)
        rr.log("world/camera/image", rr.EncodedImage(path=image) if shown else rr.EncodedImage.cleared())
        _log_boxes(rr, record["frame"]["boxes"])
        for key, log_cue in CUES.items():
            log_cue(rr, record["frame"].get(key, []))
    for mapped in record["objects"]:
        rr.log(f"world/map/{mapped['id']}", _bodies(rr.Ellipsoids3D, [mapped], "estimate", _name(mapped)))
    for gone in record["gone"]:
        rr.log(f"world/map/{gone}", rr.Clear(recursive=False))
    for event in record["events"]:
        rr.log("events", rr.TextLog(event["text"], level=event["level"]))


def log_up(rr: Any, up: list[float]) -> None:
    """Logs the direction against gravity, where it is an axis."""
    coordinates = _view_coordinates(rr, up)
    if coordinates is not None:
        rr.log("world", coordinates, static=True)


def _set_time(rr: Any, index: int, seconds: float | None) -> None:
    rr.set_time("frame", sequence=index)
    if seconds is not None:
        rr.set_time("time", duration=seconds)


def _log_bodies(rr: Any, objects: list[Record], key: str) -> None:
    """Logs the bodies `key` ("estimate" or "truth") of the objects that have them."""
    for shape, archetype in (("ellipsoid", rr.Ellipsoids3D), ("cuboid", rr.Boxes3D)):
        shown = [o for o in objects if o[key] and o[key]["shape"] == shape]
        if shown:
            names = [o["id"] for o in shown]
            rr.log(f"world/{key}/{shape}s", _bodies(archetype, shown, key, names), static=True)


def _bodies(archetype: Any, shown: list[Record], key: str, labels: list[str]) -> Any:
    return archetype(
        centers=[o[key]["center"] for o in shown],
        half_sizes=[o[key]["half_sizes"] for o in shown],
        quaternions=[o[key]["quaternion_xyzw"] for o in shown],
        colors=[o["color"] if key == "estimate" else TRUTH for o in shown],
        labels=labels,
    )


def _name(shown: Record) -> list[str]:
    return [f"{shown['id']} {shown['category']}" if shown["category"] else shown["id"]]


def _log_frame(rr: Any, frame: Record, image: Any) -> None:
    """Logs camera, image, boxes and outlines of a frame at the time that is set."""
    path = "world/camera/image"
    _log_camera(rr, frame)
    rr.log(path, image if image is not None else rr.EncodedImage.cleared())
    _log_boxes(rr, frame["boxes"])
    _log_lines(rr, f"{path}/ellipses", frame["ellipses"], _measured_color)
    _log_lines(rr, f"{path}/outlines", frame["outlines"], lambda o: o["color"])
    _log_lines(rr, f"{path}/true_outlines", frame["true_outlines"], lambda _: TRUTH)


def _log_camera(rr: Any, frame: Record) -> None:
    if frame["camera"]:
        pose = np.array(frame["camera"]["cam_from_world"])
        child = rr.TransformRelation.ChildFromParent
        rr.log("world/camera", rr.Transform3D(translation=pose[:, 3], mat3x3=pose[:, :3], relation=child))
        pinhole = rr.Pinhole(
            image_from_camera=frame["camera"]["intrinsics"],
            resolution=frame["size"],
            camera_xyz=rr.ViewCoordinates.RDF,
        )
        rr.log("world/camera/image", pinhole)


def _log_boxes(rr: Any, boxes: list[Record]) -> None:
    path = "world/camera/image/boxes"
    if boxes:
        found = rr.Boxes2D(
            array=[b["edges"] for b in boxes],
            array_format=rr.Box2DFormat.XYXY,
            colors=[_measured_color(b) for b in boxes],
            labels=[_label(b) for b in boxes],
        )
        rr.log(path, found)
    else:
        rr.log(path, rr.Clear(recursive=False))


def _log_boxes3d(rr: Any, boxes: list[Record]) -> None:
    """Logs the 3D boxes of detections beside the estimates, in a color of their own."""
    path = "world/boxes3d"
    if not boxes:
        rr.log(path, rr.Clear(recursive=False))
        return
    found = rr.Boxes3D(
        centers=[b["body"]["center"] for b in boxes],
        half_sizes=[b["body"]["half_sizes"] for b in boxes],
        quaternions=[b["body"]["quaternion_xyzw"] for b in boxes],
        colors=[REJECTED if b["inlier"] is False else BOX3D for b in boxes],
        labels=[_label(b) for b in boxes],
        show_labels=False,
    )
    rr.log(path, found)


def _log_detected_outlines(rr: Any, outlines: list[Record]) -> None:
    _log_lines(rr, "world/camera/image/detected_outlines", outlines, _measured_color)


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


# What detections may carry, by its key in a frame.
CUES: dict[str, Callable[[Any, list[Record]], None]] = {
    "detected_outlines": _log_detected_outlines,
    "boxes3d": _log_boxes3d,
}


def _view_coordinates(rr: Any, up: list[float]) -> Any:
    """Rerun's name for a world with this up axis; None for other directions."""
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < 0.999:
        return None
    return getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}")


def serve(lines: IO[bytes], status: IO[str]) -> None:
    """Logs the lines of ``quadlift stream --rerun``: the target, then records.

    Says on `status` when it is ready and when it is done, or what is wrong.
    """
    # Ctrl-C ends the program, which ends the lines.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    target = json.loads(lines.readline())
    try:
        import rerun as rr

        if tuple(map(int, rr.__version__.split(".")[:2])) < OLDEST:
            raise ImportError(f"found rerun-sdk {rr.__version__}; expected {OLDEST[0]}.{OLDEST[1]} or later")
        # Leaving `with stream` would wait for the viewer without end.
        stream = rr.RecordingStream("quadlift", make_thread_default=True)
        _open(rr, stream, target)
    except Exception as error:
        print("error:", " ".join(str(error).split()), file=status, flush=True)
        return
    print("ready", file=status, flush=True)
    checked = time.monotonic()
    try:
        for line in lines:
            log_live(rr, json.loads(line))
            if time.monotonic() > checked + CHECK_EVERY:
                stream.flush(timeout_sec=PATIENCE)
                checked = time.monotonic()
        stream.flush(timeout_sec=PATIENCE)
    except RuntimeError as error:
        # The viewer has gone. The program goes on without it.
        print("error:", " ".join(str(error).split()), file=status, flush=True)
    else:
        stream.disconnect()
        print("done", file=status, flush=True)


def _open(rr: Any, stream: Any, target: Record) -> None:
    """Connects a recording with a file, the viewer of an address, or the local one, which it starts if needed."""
    if target["name"]:
        stream.send_recording_name(target["name"])
    if target["file"]:
        stream.save(target["file"])
    elif target["address"]:
        address = urlsplit(target["address"])
        # The SDK would try for ever.
        _check_viewer(address.hostname or "", address.port or 0)
        stream.connect_grpc(target["address"])
    else:
        # That of this interpreter, or else of the PATH.
        viewer = shutil.which("rerun", path=os.path.dirname(sys.executable))
        rr.spawn(port=PORT, executable_path=viewer, recording=stream)
        # The SDK goes on without a viewer, if it does not start.
        _check_viewer("127.0.0.1", PORT)


def _check_viewer(host: str, port: int) -> None:
    try:
        socket.create_connection((host, port), timeout=PATIENCE).close()
    except OSError as error:
        raise OSError(f"there is no viewer at {host}:{port} ({error.strerror or error})") from error
