"""The options of localization, segmentation and association: those of the program, checked for the core."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypedDict, cast

import numpy as np

from . import _checks, _core
from ._checks import Path
from ._core import QuadliftError
from ._run_options import (
    ASSOCIATION_KINDS,
    MAP_KINDS,
    RUN_KINDS,
    SEGMENTATION_KINDS,
    AssociationOptions,
    MapOptions,
    RunOptions,
    SegmentationOptions,
)

if TYPE_CHECKING:
    from ._scene_data import SceneData

Progress = Callable[[int, int], object]


class Result(Protocol):
    """The result of a localization: `Estimates`."""

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


class Running(TypedDict, total=False):
    """How a function runs."""

    threads: int | None
    """Number of threads (default: one per core); the result does not depend on it."""
    progress: Progress | None
    """Called with the numbers of finished and of all steps, such as objects, a few times a second."""


class Options(RunOptions, Running, total=False):
    """Options of `localize` and `Scene.localize`; the defaults are those of the program."""

    priors: Path | Mapping[str, Prior] | None
    """Priors on categories: "builtin" (for scenes in meters), a TOML file or a mapping."""
    coverage: Sequence[tuple[SceneData | Result, SceneData]]
    """Results of the same detector, options and kind of scenes, each with a scene with the ground truth:
    `Estimates.coverage` then has calibrated confidence regions."""


class AssociateOptions(AssociationOptions, Running, total=False):
    """Options of `Scene.associate`; the defaults are those of the program."""

    priors: Path | Mapping[str, Prior] | None
    """Sizes of categories: "builtin" (for scenes in meters), a TOML file or a mapping, as in `localize`."""


class ObjectMapOptions(MapOptions, total=False):
    """Options of an `ObjectMap`; the defaults are those of the program."""

    name: str | None
    """Name of the scene."""
    up: Any
    """World direction against gravity: an axis such as ``"-y"``, or a direction, shape (3,)."""
    length_unit: str | None
    """World unit; ``"m"`` is required for ``priors="builtin"``."""
    priors: Path | Mapping[str, Prior] | None
    """Sizes of categories: "builtin" (for scenes in meters), a TOML file, or a mapping, as in `localize`."""
    pose_noise: tuple[float, float] | None
    """The poses may be wrong: standard deviations of the rotation (radians) and shift (world units) of each frame."""


class SegmentOptions(SegmentationOptions, Running, total=False):
    """Options of `Scene.segment`; the defaults are those of the program."""

    out_masks: Path | None
    """A folder for the masks as label images (PNG), one per frame; without it they are stored in the scene."""


def split(options: Options, function: str) -> tuple[dict[str, Any], int | None, Progress | None]:
    """Keywords of the core for localization, the number of threads and the progress callback."""
    given, threads, progress = _running(options)
    priors, text = _priors(given.pop("priors", None))
    keywords: dict[str, Any] = {
        "priors": priors,
        "priors_text": text,
        "coverage": _coverage(given.pop("coverage", ())),
    }
    keywords["run"] = _chosen(given, RUN_KINDS, function)
    return keywords, threads, progress


def _running(options: Running) -> tuple[dict[str, Any], int | None, Progress | None]:
    """The other options, the number of threads and the progress callback."""
    given: dict[str, Any] = dict(options)
    threads, progress = threads_and_progress(given.pop("threads", None), given.pop("progress", None))
    return given, threads, progress


def _chosen(given: dict[str, Any], kinds: Mapping[str, str], function: str) -> dict[str, Any]:
    """The given options of a table with these kinds, for the core."""
    for name in given:
        if name not in kinds:
            raise TypeError(f"{function}() got an unexpected keyword argument {name!r}")
    return {name: _checked(name, value, kinds[name]) for name, value in given.items()}


def _checked(name: str, value: Any, kind: str) -> Any:
    """The value of an option of this kind, for the core."""
    if kind == "flag":
        return _checks.flag(name, value)
    if kind == "whole":
        return _checks.whole(name, value, 0, 2**64 - 1)
    if value is None:
        return None
    if kind == "number":
        return _checks.number(name, value)
    if kind == "numbers":
        return _checks.array(name, value, ("N",)).tolist()
    return _noise_model(value) if kind == "levels" else _checks.text(name, value)


def split_of_segmentation(options: SegmentOptions) -> tuple[dict[str, Any], int | None, Progress | None]:
    """As `split`, for a segmentation."""
    given, threads, progress = _running(options)
    folder = given.pop("out_masks", None)
    out_masks = None if folder is None else os.fspath(folder)
    return {"chosen": _chosen(given, SEGMENTATION_KINDS, "segment"), "out_masks": out_masks}, threads, progress


def split_of_association(options: AssociateOptions) -> tuple[dict[str, Any], int | None, Progress | None]:
    """As `split`, for an association."""
    given, threads, progress = _running(options)
    priors, text = _priors(given.pop("priors", None))
    chosen = _chosen(given, ASSOCIATION_KINDS, "associate")
    return {"chosen": chosen, "priors": priors, "priors_text": text}, threads, progress


def of_map(options: ObjectMapOptions) -> dict[str, Any]:
    """The core's keywords of an object map."""
    given: dict[str, Any] = dict(options)
    path, text = _priors(given.pop("priors", None))
    pose_noise = given.pop("pose_noise", None)
    return {
        "name": _checks.optional(_checks.text, "name", given.pop("name", None)),
        "up": _checks.optional(_checks.direction, "up", given.pop("up", None)),
        "length_unit": _checks.optional(_checks.text, "length_unit", given.pop("length_unit", None)),
        "priors": path,
        "priors_text": text,
        "pose_noise": None if pose_noise is None else _checks.array("pose_noise", pose_noise, (2,)).tolist(),
        "chosen": _chosen(given, MAP_KINDS, "ObjectMap"),
    }


NOT_OF_MAP = ("associate", "ids", "source", "priors", "pose_noise")
"""Options of a localization that an object map has, or that mean nothing there."""


def split_of_map(options: Options, of_map: dict[str, Any]) -> tuple[dict[str, Any], int | None, Progress | None]:
    """As `split`, for the objects of a map with these options (by the names of the program)."""
    for name in NOT_OF_MAP:
        if name in options:
            raise TypeError(f"ObjectMap.localize() got an unexpected keyword argument {name!r}")
    given: dict[str, Any] = {**options, "associate": "never"}
    is_map = options.get("method", "posterior") == "posterior"
    if is_map:
        # Options that are not given may be left out.
        given["pose_noise"] = of_map.get("pose_noise")
    keywords, threads, progress = split(cast("Options", given), "ObjectMap.localize")
    if is_map:
        priors = of_map.get("priors")
        text = priors["text"] if isinstance(priors, dict) else None
        keywords["priors"], keywords["priors_text"] = (priors, None) if text is None else (None, text)
    return keywords, threads, progress


def threads_and_progress(threads: Any, progress: Any) -> tuple[int | None, Progress | None]:
    """The number of threads and the progress callback, checked."""
    if threads is not None:
        threads = _checks.whole("threads", threads, 1, 1024)
    if progress is not None and not callable(progress):
        raise QuadliftError(f"progress is {progress!r}; expected a function of two numbers")
    return threads, progress


def _noise_model(noise_model: Any) -> dict[str, float]:
    """Numbers by names."""
    if not isinstance(noise_model, Mapping):
        raise QuadliftError(f"noise_model is a {type(noise_model).__name__}; expected a mapping of names to numbers")
    names = [_checks.text("a name in noise_model", name) for name in noise_model]
    return {name: _checks.number(f"noise_model[{name!r}]", noise_model[name]) for name in names}


def _coverage(pairs: Any) -> list[tuple[_core.Scene, _core.Scene]]:
    """Pairs of a result and its ground truth, for the core."""
    if isinstance(pairs, str | Mapping) or not isinstance(pairs, Sequence):
        raise QuadliftError(f"coverage is a {type(pairs).__name__}; expected a list of pairs (result, truth)")
    scenes = []
    for k, pair in enumerate(pairs):
        if not isinstance(pair, Sequence) or len(pair) != 2:
            raise QuadliftError(f"coverage[{k}] is {pair!r}; expected a pair (result, truth)")
        result, truth = pair
        if hasattr(result, "to_scene"):
            result = result.to_scene()
        result, truth = _checks.scene(f"coverage[{k}][0]", result), _checks.scene(f"coverage[{k}][1]", truth)
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
    """The value of `up` for the core."""
    return None if value is None else ",".join(map(repr, _checks.direction("up", value)))
