"""Scenes and results as recordings for Rerun (https://rerun.io).

All values are computed beforehand (see docs/formats/exports.md); `_rerun_log` says which entities they become.
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

from . import _core, _rerun_log
from ._core import QuadliftError

JPEG_QUALITY = 90
"""Of images that are given as pixels: a video would fill the viewer's memory otherwise."""


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
    log_folder(folder, path)


def log_folder(folder: str | os.PathLike[str], path: str | os.PathLike[str] | None, *, sdk: Any = None) -> None:
    """As `log_recording`; `sdk` stands for the module ``rerun``."""
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
    rr = sdk or rerun_sdk()

    def image(index: int) -> Any:
        name = recording["frames"][index]["image"]
        return rr.EncodedImage(path=file.parent / name) if name else None

    _log(rr, recording, image, path, recording["name"])


def log_recorded(
    recorded: tuple[str, list[int]], scene: _core.Scene, path: str | os.PathLike[str] | None, *, sdk: Any = None
) -> None:
    """Logs a recording of the core, with the images of its scene; `sdk` stands for the module ``rerun``."""
    recording, frames = json.loads(recorded[0]), recorded[1]
    rr = sdk or rerun_sdk()

    def image(index: int) -> Any:
        try:
            found = scene.jpeg(frames[index])
        except QuadliftError as error:
            # Attributed to the line that calls `to_rerun`.
            warnings.warn(str(error), stacklevel=6)
            return None
        if found is None:
            return None
        recording["frames"][index]["size"] = found[1]
        return rr.EncodedImage(contents=found[0], media_type="image/jpeg")

    _log(rr, recording, image, path, scene.name)


def log_map(core: _core.ObjectMap, image: Any) -> None:
    """Logs what has changed in an object map, and the image of its last frame."""
    rr = rerun_sdk()
    if rr.get_data_recording() is None:
        raise QuadliftError("there is no recording; call rerun.init first")
    shown = None if image is None else _image(rr, image)
    _rerun_log.log_live(rr, json.loads(core.live()))
    if shown is not None:
        rr.log("world/camera/image", shown)


def _image(rr: Any, image: Any) -> Any:
    """An image as Rerun has it: of pixels, a file, or what is one already."""
    if hasattr(image, "as_component_batches"):
        return image
    if isinstance(image, str | os.PathLike):
        return rr.EncodedImage(path=image)
    pixels = np.asarray(image)
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3):
        raise QuadliftError(
            f"image has the shape {pixels.shape} and the dtype {pixels.dtype}; expected (H, W) or (H, W, 3), uint8"
        )
    return rr.Image(pixels).compress(jpeg_quality=JPEG_QUALITY)


def rerun_sdk() -> Any:
    """Rerun's SDK."""
    try:
        import rerun
    except ImportError as error:
        raise ImportError("recordings need Rerun's SDK: pip install rerun-sdk") from error
    return rerun


def _log(
    rr: Any,
    recording: _rerun_log.Record,
    image: Callable[[int], Any],
    path: str | os.PathLike[str] | None,
    name: str | None,
) -> None:
    """Logs a recording; `image` returns the images of its frames, and recordings of the same name belong together."""
    stream: Any = contextlib.nullcontext()
    if path is not None:
        stream = rr.RecordingStream("quadlift", recording_id=name)
        stream.save(path)
    elif rr.get_data_recording() is None:
        raise QuadliftError("there is no recording; call rerun.init first, or give the path of a file to write")
    with stream:
        _rerun_log.log_recording(rr, recording, image)
    if path is not None:
        stream.flush()
        stream.disconnect()
