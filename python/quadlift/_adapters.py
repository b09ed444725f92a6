"""Scenes from other packages.

None of the packages is imported: only attributes of their types are used.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _checks, _core, _fiftyone, _formats, _found
from ._core import QuadliftError
from ._formats import CameraOptions, DetectionOptions
from ._scene_data import SceneData

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

    from ._checks import Path


class FromOtherPackages(SceneData):
    """Constructors of `Scene` from objects of other packages."""

    @classmethod
    def from_cameras(
        cls,
        source: Path | Any,
        *,
        format: str | None = None,
        images: Path | None = None,
        **options: Unpack[CameraOptions],
    ) -> Self:
        """Cameras and poses of another program, like ``quadlift import``.

        The formats are those of the program (docs/formats/cameras.md): COLMAP, nerfstudio, OpenSfM, ARKit, TUM, KITTI,
        nuScenes, BOP, MCAP. Axes, transforms, quaternions, pixel origins and units become those of quadlift.

        Parameters
        ----------
        source : path-like or pycolmap.Reconstruction
            File or folder, or a reconstruction in memory.
        format : str, optional
            The format, by its name in ``quadlift import``; recognized by default.
        images : path-like, optional
            Folder of the images; the default is that of the format, if it has one.
        **options : CameraOptions
            What the files lack; `quadlift.CameraOptions` lists them.

        Raises
        ------
        QuadliftError
            Names the file, the place in it, what was found and what was expected.

        Warns
        -----
        UserWarning
            For what was left out because it cannot be used.
        """
        texts = _formats.texts(options, CameraOptions, "Scene.from_cameras")
        format = _checks.optional(_checks.text, "format", format)
        if isinstance(source, str | os.PathLike):
            scene, lost = _core.Scene.read_cameras(source, format, images, texts)
        elif hasattr(source, "write"):
            with tempfile.TemporaryDirectory() as folder:
                source.write(folder)
                scene, lost = _core.Scene.read_cameras(folder, "colmap", images, texts)
        else:
            raise QuadliftError(f"source is a {type(source).__name__}; expected a path or a pycolmap.Reconstruction")
        for words in lost:
            warnings.warn(words, stacklevel=2)
        return cls(scene)

    @classmethod
    def from_detections(
        cls,
        path: Path,
        cameras: Self,
        *,
        format: str | None = None,
        source: str | None = None,
        min_score: float | None = None,
        match: Literal["auto", "name", "stem", "index", "time"] = "auto",
        assume: str = "",
        replace: bool = False,
        **options: Unpack[DetectionOptions],
    ) -> Self:
        """Cameras with the detections of a file of another program, like ``quadlift import --into``.

        The formats are those of the program (docs/formats/detections.md): COCO, Ultralytics YOLO and others. Images are
        matched to frames by name, number or time. Track ids become object ids.

        Parameters
        ----------
        path : path-like
            File or folder.
        cameras : Scene
            The frames; existing detections are kept.
        format : str, optional
            The format, by its name in ``quadlift import``; recognized by default.
        source : str, optional
            Name of the detector; the default is the format.
        min_score : float, optional
            Skip detections with a lower score.
        match : {"auto", "name", "stem", "index", "time"}
            How images are matched to frames; a stem is a name without extension.
        assume : str
            What the detections really are, as in `Scene.corrected`: ``"image_size=640x640"`` (that of the images on
            which the detector ran), ``"orientation=6"``, ``"frame_offset=1"`` (the number that they give to frame
            number 0; by default inferred from format and names).
        replace : bool
            Remove the detections that `cameras` has.
        **options : DetectionOptions
            What the files lack; `quadlift.DetectionOptions` lists them.

        Raises
        ------
        QuadliftError
            Names the file and the problem; also raised if none of its images is a frame.

        Warns
        -----
        UserWarning
            For skipped detections: images without a frame, boxes without width or height.
        """
        keywords = {
            "source": _checks.optional(_checks.text, "source", source),
            "min_score": _checks.optional(_checks.number, "min_score", min_score),
            "match": _checks.text("match", match),
            "assume": _checks.text("assume", assume),
            "replace": _checks.flag("replace", replace),
        }
        scene, lost = _checks.scene("cameras", cameras).with_detections_of(
            path,
            _checks.optional(_checks.text, "format", format),
            keywords,
            _formats.texts(options, DetectionOptions, "Scene.from_detections"),
        )
        for words in lost:
            warnings.warn(words, stacklevel=2)
        return cls(scene)

    @classmethod
    def from_supervision(
        cls,
        detections: Sequence[Any] | Mapping[str, Any],
        cameras: Self,
        *,
        frame_ids: Sequence[str] | None = None,
        source: str = "supervision",
    ) -> Self:
        """Cameras with the detections of `supervision.Detections`.

        Parameters
        ----------
        detections : sequence or mapping of supervision.Detections
            One per frame, in their order (or that of `frame_ids`), or by frame id. Tracker ids become object ids
            (``t7`` for 7), class names (or numbers) become categories.
        cameras : Scene
            The frames.
        frame_ids : sequence of str, optional
            Ids of the frames of a sequence of detections.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        table = _Table(cameras)
        for frame, found in _by_frame(detections, frame_ids, cameras.frame_ids):
            table.add(frame, _found.of_supervision(found))
        return cameras.with_detections(**table.arrays(), source=source)

    @classmethod
    def from_ultralytics(
        cls,
        results: Iterable[Any],
        cameras: Self,
        *,
        frame_ids: Sequence[str] | None = None,
        source: str = "yolo",
    ) -> Self:
        """Cameras with the boxes of Ultralytics results, the outlines of segmentation and oriented boxes of OBB.

        Parameters
        ----------
        results : iterable of ultralytics.engine.results.Results
            One per image; matched to frame ids and images by file name.
        cameras : Scene
            The frames.
        frame_ids : sequence of str, optional
            Frame ids of the results, instead of matching names.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        # A stream of results can be read once.
        results, known = list(results), cameras.frame_ids
        paths = _paths("results", results, "path", "Ultralytics' Results")
        names = _frames_of_paths(paths, known) if frame_ids is None else list(frame_ids)
        table = _Table(cameras)
        for frame, result in _by_frame(results, names, known):
            table.add(frame, _found.of_ultralytics(result, f'the result of frame "{known[frame]}"'))
        return cameras.with_detections(**table.arrays(), source=source)

    @classmethod
    def from_fiftyone(
        cls,
        samples: Iterable[Any],
        cameras: Self,
        *,
        field: str = "predictions",
        frame_ids: Sequence[str] | None = None,
        source: str = "fiftyone",
    ) -> Self:
        """Cameras with the 2D detections of FiftyOne samples.

        Boxes of FiftyOne are shares of the image: its size is that of the sample's metadata, otherwise of the camera.
        Labels become categories, confidences scores, and indices object ids (``t7`` for 7). Masks are not read.

        Parameters
        ----------
        samples : iterable of fiftyone.Sample
            A dataset, a view or a list of samples; matched to frame ids by the names of their files.
        cameras : Scene
            The frames.
        field : str
            The field of the samples with `fiftyone.Detections`.
        frame_ids : sequence of str, optional
            Frame ids of the samples, instead of matching names.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        _checks.text("field", field)
        samples, known = list(samples), cameras.frame_ids
        paths = _paths("samples", samples, "filepath", "a fiftyone.Sample")
        names = _frames_of_paths(paths, known) if frame_ids is None else list(frame_ids)
        sizes = _fiftyone.image_sizes(cameras.to_dict())
        table = _Table(cameras)
        for frame, sample in _by_frame(samples, names, known):
            table.add(frame, _fiftyone.of_sample(sample, field, sizes.get(known[frame])))
        return cameras.with_detections(**table.arrays(), source=source)


def _by_frame(
    detections: Sequence[Any] | Mapping[str, Any], frame_ids: Sequence[str | None] | None, known: list[str]
) -> list[tuple[int, Any]]:
    """Detections with the indices of their frames."""
    index = {name: k for k, name in enumerate(known)}
    if isinstance(detections, Mapping):
        pairs = list(detections.items())
    else:
        names = known if frame_ids is None else list(frame_ids)
        if len(detections) != len(names):
            like = "the scene has frames" if frame_ids is None else "frame_ids"
            raise QuadliftError(f"there are {len(detections)} detections; expected {len(names)}, as many as {like}")
        pairs = [(name, found) for name, found in zip(names, detections, strict=True) if name is not None]
    for name, _ in pairs:
        if name not in index:
            some = ", ".join(known[:5])
            raise QuadliftError(f'unknown frame "{name}"; the scene has {len(known)} frames: {some}')
    return [(index[name], found) for name, found in pairs]


def _paths(name: str, items: list[Any], attribute: str, expected: str) -> list[str]:
    """The paths of the images of results of another package."""
    for k, item in enumerate(items):
        if not hasattr(item, attribute):
            raise QuadliftError(f"{name}[{k}] is a {type(item).__name__}; expected {expected}")
    return [str(getattr(item, attribute)) for item in items]


def _frames_of_paths(paths: list[str], known: list[str]) -> list[str | None]:
    """The frames whose ids match these file names, with or without folders and extensions; None without one."""
    best: list[list[str]] = [[]] * len(paths)
    for part in ("name", "stem"):
        frames: dict[str, list[str]] = {}
        for name in known:
            frames.setdefault(getattr(PurePath(name), part), []).append(name)
        found = [frames.get(getattr(PurePath(path), part), []) for path in paths]
        if sum(len(names) == 1 for names in found) > sum(len(names) == 1 for names in best):
            best = found
    missing = [PurePath(path).name for path, names in zip(paths, best, strict=True) if len(names) != 1]
    # Structure from motion seldom registers all images.
    if len(missing) < len(paths) and all(len(names) <= 1 for names in best):
        if missing:
            some = ", ".join(missing[:5])
            warnings.warn(f"images without a frame are skipped: {some} ({len(missing)} of {len(paths)})", stacklevel=3)
        return [names[0] if names else None for names in best]
    some = ", ".join(known[:5])
    raise QuadliftError(
        f"no single frame has the name of the image {missing[0]}; the scene has {len(known)} frames: "
        f"{some} (frame_ids=[...] names them)"
    )


class _Table:
    """Detections, gathered frame by frame, as arguments of `Scene.with_detections`."""

    def __init__(self, cameras: SceneData) -> None:
        self.frame_ids = cameras.frame_ids
        self.frames: list[int] = []
        self.boxes: list[Any] = []
        self.scores: list[float] = []
        self.categories: list[str | None] = []
        self.objects: list[str | None] = []
        self.masks: list[Any] = []
        self.outlines: list[Any] = []
        self.oriented_boxes: list[Any] = []

    def add(self, frame: int, found: _found.Found) -> None:
        turned = found.oriented_boxes
        edges = _checks.array(f'xyxy of frame "{self.frame_ids[frame]}"', found.boxes, ("M", 4), nan=turned is not None)
        scores, classes, tracks, masks = found.scores, found.categories, found.objects, found.masks
        for row in range(len(edges)):
            self.frames.append(frame)
            self.boxes.append(edges[row])
            self.scores.append(float("nan") if scores is None else float(scores[row]))
            self.categories.append(None if classes is None else str(classes[row]))
            self.objects.append(None if tracks is None else tracks[row])
            self.masks.append(None if masks is None else masks[row])
            self.outlines.append(None if found.outlines is None else found.outlines[row])
            self.oriented_boxes.append(np.full(5, np.nan) if turned is None else turned[row])

    def arrays(self) -> dict[str, Any]:
        turned = np.array(self.oriented_boxes, dtype=np.float64).reshape(-1, 5)
        return {
            "frames": np.array(self.frames, dtype=np.int64),
            "boxes": np.array(self.boxes, dtype=np.float64).reshape(-1, 4),
            "scores": np.array(self.scores, dtype=np.float64),
            "categories": np.array(self.categories, dtype=object),
            "objects": np.array(self.objects, dtype=object),
            "masks": self.masks if any(mask is not None for mask in self.masks) else None,
            "outlines": self.outlines if any(outline is not None for outline in self.outlines) else None,
            "oriented_boxes": turned if np.isfinite(turned).any() else None,
        }
