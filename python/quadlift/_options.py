"""The options of localisation, segmentation and association: those of the program, checked for the core."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypedDict

import numpy as np

from . import _checks, _core
from ._checks import Path
from ._core import QuadliftError

if TYPE_CHECKING:
    from ._scene_data import SceneData

Progress = Callable[[int, int], object]
Ids = Literal["trust", "evidence", "ignore"]
Segmenter = Literal["graphcut", "sca", "masks"]


class Result(Protocol):
    """The result of a localisation: `Estimates`."""

    def to_scene(self) -> SceneData:
        """The scene with the estimates as objects."""
        ...


class Prior(TypedDict, total=False):
    """Prior on the objects of a category."""

    size: tuple[float, float, float]
    """Length, width, height: full extents in world units; with `size_sd`."""
    size_sd: tuple[float, float, float]
    """Their standard deviations."""
    upright_sd: float
    """Standard deviation of the angle between the vertical axis and the scene's `up`, radians."""
    on_ground: bool
    """Whether the objects stand on a common ground plane."""


class Options(TypedDict, total=False):
    """Options of `localize` and `Scene.localize`; the defaults are those of the program."""

    method: Literal["map", "planes", "lfd", "pfd", "reg"]
    """Estimator: `map` (refinement, the best; the default), `planes`, `lfd` and `pfd` (closed forms), `reg`."""
    body: str
    """`ellipsoid`, `cuboid`, `cylinder`, `superellipsoid:Q` (Q from 1, cuboid, to 2, ellipsoid) or `auto` (default)."""
    source: str | None
    """Use only the detections of this source; required if the scene has several."""
    observations: Literal["auto", "box", "ellipse", "box+ellipse", "mask"]
    """Measurements to use (`auto`: what a detection has)."""
    associate: Literal["auto", "never", "always"]
    """Associate detections first: if any lack an id (`auto`), never or always."""
    ids: Ids | None
    """How far to trust existing ids (`trust`; with `associate="always"`: `evidence`)."""
    priors: Path | Mapping[str, Prior] | None
    """Priors on categories: "builtin" (for scenes in meters), a TOML file or a mapping."""
    learn_sizes: bool
    """Learn the size of each category from its other objects; `priors` win where they have a size."""
    cross_validate: bool
    """Leave out each view of each object and predict it from the others: a measure of quality without ground truth.
    Takes several times as long; without it a sample of the views is checked, for `Estimates.cross_validation`."""
    min_views: int
    """Minimum number of views of an object; every method needs at least two or three."""
    max_occluded: float | None
    """Skip detections that are more occluded (KITTI levels)."""
    max_truncated: float | None
    """Skip detections that are more truncated."""
    upright: bool
    """Detect which objects stand upright, with an axis along the scene's `up`; the default."""
    ground_plane: bool
    """All objects stand on a common ground plane; needs the scene's `up`."""
    camera_height: float | None
    """Height of the cameras above the ground plane, world units."""
    refine_poses: Literal["auto", "independent", "slow"] | None
    """Correct the poses together with the objects: errors of frames are independent, or slow (GPS, drifting odometry);
    "auto" decides by the boxes.
    `Estimates.to_scene` has the corrected poses."""
    fixed_extrinsics: bool
    """Take the places of cameras in their rig as exact; `refine_poses` then corrects the pose of the rig alone."""
    pose_noise: tuple[float, float] | None
    """Correct the poses: standard deviations of the rotation (radians) and shift (world units) of each frame."""
    sigmas: Mapping[str, float] | None
    """Noise levels, such as `Estimates.noise` of other detections of the same detector, instead of estimating them from
    all objects of the call. The estimate of an object then depends on its own views only."""
    calibration: Sequence[tuple[SceneData | Result, SceneData]]
    """Results of the same detector, options and kind of scenes, each with a scene with the ground truth:
    `Estimates.calibration` then has calibrated confidence regions."""
    accept_inconsistent: bool
    """Whether objects may be ``"ok"`` in a scene that is inconsistent (see `Estimates.diagnosis`)."""
    reg_weight: float | None
    """Weight of the regulariser of `method="reg"` (default 1e16)."""
    seed: int
    """Seed of the random numbers."""
    threads: int | None
    """Number of threads (default: one per core); the result does not depend on it."""
    progress: Progress | None
    """Called with the number of objects done and their total, a few times a second."""


DEFAULTS: dict[str, Any] = {
    "method": "map",
    "body": "auto",
    "source": None,
    "observations": "auto",
    "associate": "auto",
    "ids": None,
    "priors": None,
    "learn_sizes": False,
    "cross_validate": False,
    "min_views": 0,
    "max_occluded": None,
    "max_truncated": None,
    "upright": True,
    "ground_plane": False,
    "camera_height": None,
    "refine_poses": None,
    "fixed_extrinsics": False,
    "pose_noise": None,
    "sigmas": None,
    "calibration": (),
    "accept_inconsistent": False,
    "reg_weight": None,
    "seed": 0,
}


def split(options: Options, function: str) -> tuple[dict[str, Any], int | None, Progress | None]:
    """Keywords of the core for localisation, the number of threads and the progress callback."""
    given: dict[str, Any] = dict(options)
    threads, progress = threads_and_progress(given.pop("threads", None), given.pop("progress", None))
    for name in given:
        if name not in DEFAULTS:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")
    keywords = {**DEFAULTS, **given}
    for name in ("method", "body", "observations", "associate"):
        _checks.text(name, keywords[name])
    for name in ("source", "ids", "refine_poses"):
        _checks.optional(_checks.text, name, keywords[name])
    for name in ("max_occluded", "max_truncated", "camera_height", "reg_weight"):
        keywords[name] = _checks.optional(_checks.number, name, keywords[name])
    if keywords["pose_noise"] is not None:
        keywords["pose_noise"] = _checks.array("pose_noise", keywords["pose_noise"], (2,)).tolist()
    if keywords["sigmas"] is not None:
        keywords["sigmas"] = _sigmas(keywords["sigmas"])
    keywords["calibration"] = _calibration(keywords["calibration"])
    for name in (
        "cross_validate",
        "learn_sizes",
        "upright",
        "ground_plane",
        "fixed_extrinsics",
        "accept_inconsistent",
    ):
        keywords[name] = _checks.flag(name, keywords[name])
    keywords["min_views"] = _checks.whole("min_views", keywords["min_views"], 0, 2**32)
    keywords["seed"] = _checks.whole("seed", keywords["seed"], 0, 2**64 - 1)
    keywords["priors"], keywords["priors_text"] = _priors(keywords["priors"])
    return keywords, threads, progress


def of_segmentation(method: str, source: str | None, out_masks: Path | None, seed: int) -> dict[str, Any]:
    """The core's keywords of a segmentation."""
    return {
        "method": _checks.text("method", method),
        "source": _checks.optional(_checks.text, "source", source),
        "out_masks": None if out_masks is None else os.fspath(out_masks),
        "seed": _checks.whole("seed", seed, 0, 2**64 - 1),
    }


def of_association(
    *,
    ids: str,
    source: str | None,
    thorough: bool,
    min_views: int,
    min_score: float | None,
    max_overlap: float | None,
    pixel_sd: float | None,
    priors: Path | Mapping[str, Prior] | None,
) -> dict[str, Any]:
    """The core's keywords of an association."""
    name, text = _priors(priors)
    return {
        "ids": _checks.text("ids", ids),
        "source": _checks.optional(_checks.text, "source", source),
        "thorough": _checks.flag("thorough", thorough),
        "min_views": _checks.whole("min_views", min_views, 2, 2**32),
        "min_score": _checks.optional(_checks.number, "min_score", min_score),
        "max_overlap": _checks.optional(_checks.number, "max_overlap", max_overlap),
        "pixel_sd": _checks.optional(_checks.number, "pixel_sd", pixel_sd),
        "priors": name,
        "priors_text": text,
    }


def of_map(
    *,
    name: str | None,
    up: Any,
    length_unit: str | None,
    ids: str,
    min_views: int,
    min_score: float | None,
    pixel_sd: float | None,
    priors: Path | Mapping[str, Prior] | None,
    max_views: int,
    max_objects: int,
    pose_noise: tuple[float, float] | None,
) -> dict[str, Any]:
    """The core's keywords of an object map."""
    path, text = _priors(priors)
    return {
        "name": _checks.optional(_checks.text, "name", name),
        "up": None if up is None else _checks.array("up", up, (3,)).tolist(),
        "length_unit": _checks.optional(_checks.text, "length_unit", length_unit),
        "ids": _checks.text("ids", ids),
        "min_views": _checks.whole("min_views", min_views, 2, 2**32),
        "min_score": _checks.optional(_checks.number, "min_score", min_score),
        "pixel_sd": _checks.optional(_checks.number, "pixel_sd", pixel_sd),
        "priors": path,
        "priors_text": text,
        "max_views": _checks.whole("max_views", max_views, 4, 2**32),
        "max_objects": _checks.whole("max_objects", max_objects, 1, 2**32),
        "pose_noise": None if pose_noise is None else _checks.array("pose_noise", pose_noise, (2,)).tolist(),
    }


NOT_OF_MAP = ("associate", "ids", "source", "priors", "pose_noise")
"""Options of a localisation that an object map has, or that mean nothing there."""


def split_of_map(options: Options, of_map: dict[str, Any]) -> tuple[dict[str, Any], int | None, Progress | None]:
    """As `split`, for the objects of a map with these options (by the names of the program)."""
    for name in NOT_OF_MAP:
        if name in options:
            raise TypeError(f"ObjectMap.localize() got an unexpected keyword argument {name!r}")
    keywords, threads, progress = split(options, "ObjectMap.localize")
    keywords["associate"] = "never"
    if keywords["method"] == "map":
        # Options that are not given may be left out.
        priors = of_map.get("priors")
        text = priors["text"] if isinstance(priors, dict) else None
        keywords["priors"], keywords["priors_text"] = (priors, None) if text is None else (None, text)
        keywords["pose_noise"] = of_map.get("pose_noise")
    return keywords, threads, progress


def threads_and_progress(threads: Any, progress: Any) -> tuple[int | None, Progress | None]:
    """The number of threads and the progress callback, checked."""
    if threads is not None:
        threads = _checks.whole("threads", threads, 1, 1024)
    if progress is not None and not callable(progress):
        raise QuadliftError(f"progress is {progress!r}; expected a function of two numbers")
    return threads, progress


def _sigmas(sigmas: Any) -> dict[str, float]:
    """Numbers by names."""
    if not isinstance(sigmas, Mapping):
        raise QuadliftError(f"sigmas is a {type(sigmas).__name__}; expected a mapping of names to numbers")
    names = [_checks.text("a name in sigmas", name) for name in sigmas]
    return {name: _checks.number(f"sigmas[{name!r}]", sigmas[name]) for name in names}


def _calibration(pairs: Any) -> list[tuple[_core.Scene, _core.Scene]]:
    """Pairs of a result and its ground truth, for the core."""
    if isinstance(pairs, str | Mapping) or not isinstance(pairs, Sequence):
        raise QuadliftError(f"calibration is a {type(pairs).__name__}; expected a list of pairs (result, truth)")
    scenes = []
    for k, pair in enumerate(pairs):
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise QuadliftError(f"calibration[{k}] is {pair!r}; expected a pair (result, truth)")
        result, truth = pair
        if hasattr(result, "to_scene"):
            result = result.to_scene()
        result, truth = _checks.scene(f"calibration[{k}][0]", result), _checks.scene(f"calibration[{k}][1]", truth)
        scenes.append((result, truth))
    return scenes


def _priors(priors: Any) -> tuple[str | None, str | None]:
    """A path or "builtin", or the text of a TOML file."""
    if priors is None:
        return None, None
    if isinstance(priors, str | os.PathLike):
        return os.fspath(priors), None
    if not isinstance(priors, Mapping):
        raise QuadliftError(f'priors is a {type(priors).__name__}; expected "builtin", a path or a mapping')
    lines = []
    for category, prior in priors.items():
        # JSON lists and strings are also valid TOML.
        lines.append(f"[{json.dumps(_checks.text('a category of priors', category))}]")
        if not isinstance(prior, Mapping):
            raise QuadliftError(f"priors[{category!r}] is a {type(prior).__name__}; expected a mapping")
        for key, value in prior.items():
            place = f"priors[{category!r}][{key!r}]"
            if isinstance(value, bool):
                value = json.dumps(value)
            elif np.ndim(value) == 1:
                value = json.dumps(_checks.array(place, value, (3,)).tolist())
            else:
                value = repr(_checks.number(place, value))
            lines.append(f"{json.dumps(key)} = {value}")
    return None, "\n".join(lines)


def up(value: Any) -> str | None:
    """The value of `up` for the core: an axis, or three numbers."""
    if value is None or isinstance(value, str):
        return value
    return ",".join(repr(x) for x in _checks.array("up", value, (3,)).tolist())


def option_as_call(option: str) -> str:
    """An option of the program, such as ``--assume poses=opengl``, as a call."""
    words = option.split()
    if words[0] == "--assume":
        return f"Scene.corrected({words[1]!r})"
    keywords = ", ".join(f"{name[2:].replace('-', '_')}={value!r}" for name, value in zip(words[::2], words[1::2], strict=True))
    return f"Scene.corrected({keywords})" if words[0] == "--up" else f"localize({keywords})"
