"""Scenes from other packages.

None of the packages is imported: only attributes of their types are used.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _checks, _core, _fiftyone, _found
from ._core import QuadliftError
from ._scene_data import SceneData

if TYPE_CHECKING:
    from typing_extensions import Self

    from ._checks import Path


class FromOtherPackages(SceneData):
    """Constructors of `Scene` from objects of other packages."""

    @classmethod
    def from_colmap(cls, model: Path | Any) -> Self:
        """The cameras of a COLMAP model.

        Parameters
        ----------
        model : path-like or pycolmap.Reconstruction
            The folder of the model (binary or text), or the reconstruction itself.

        Raises
        ------
        QuadliftError
            Names the file and the problem.
        """
        if isinstance(model, str | os.PathLike):
            return cls(_core.Scene.read_colmap(model))
        if not hasattr(model, "write"):
            raise QuadliftError(f"model is a {type(model).__name__}; expected a path or a pycolmap.Reconstruction")
        with tempfile.TemporaryDirectory() as folder:
            model.write(folder)
            return cls(_core.Scene.read_colmap(folder))

    @classmethod
    def from_detections(
        cls,
        path: Path,
        cameras: Self,
        *,
        names: Path | None = None,
        frame_column: str | None = None,
        source: str | None = None,
        min_score: float | None = None,
        image_size: tuple[float, float] | None = None,
    ) -> Self:
        """Cameras with the detections of a file of another program, whose format is detected.

        The formats are those of the program (docs/formats/detections.md): COCO, Ultralytics YOLO and others. Images are
        matched to frames by name, number or time. Track ids become object ids.

        Parameters
        ----------
        path : path-like
            File or folder.
        cameras : Scene
            The frames; existing detections are kept.
        names : path-like, optional
            Class names, for YOLO, MOTChallenge and tables.
        frame_column : str, optional
            The column of a table that identifies the image.
        source : str, optional
            Name of the detector; the default is the format.
        min_score : float, optional
            Skip detections with a lower score.
        image_size : (float, float), optional
            Width and height in pixels of the images on which the detector ran, if they differ from the cameras or are
            unknown.

        Raises
        ------
        QuadliftError
            Names the file and the problem; also raised if none of its images is a frame.

        Warns
        -----
        UserWarning
            For skipped detections: images without a frame, boxes without width or height.
        """
        size = None if image_size is None else _checks.array("image_size", image_size, (2,))
        scene, lost = _checks.scene("cameras", cameras).with_detections_of(
            path,
            names=names,
            frame_column=_checks.optional(_checks.text, "frame_column", frame_column),
            source=_checks.optional(_checks.text, "source", source),
            min_score=_checks.optional(_checks.number, "min_score", min_score),
            image_size=None if size is None else (float(size[0]), float(size[1])),
        )
        for words in lost:
            warnings.warn(words, stacklevel=2)
        return cls(scene)

    @classmethod
    def from_coco(cls, path: Path, cameras: Self) -> Self:
        """Cameras with the boxes and masks of a COCO file; see `from_detections`."""
        return cls.from_detections(path, cameras, source="coco")

    @classmethod
    def from_supervision(
        cls,
        detections: Sequence[Any] | Mapping[str, Any],
        cameras: Self,
        *,
        frames: Sequence[str] | None = None,
        source: str = "supervision",
    ) -> Self:
        """Cameras with the detections of `supervision.Detections`.

        Parameters
        ----------
        detections : sequence or mapping of supervision.Detections
            One per frame, in their order (or that of `frames`), or by frame id. Tracker ids become object ids (``t7``
            for 7), class names (or numbers) become categories.
        cameras : Scene
            The frames.
        frames : sequence of str, optional
            Ids of the frames of a sequence of detections.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        table = _Table(cameras)
        for frame, found in _by_frame(detections, frames, cameras.frame_ids):
            table.add(frame, _found.of_supervision(found))
        return cameras.with_detections(**table.arrays(), source=source)

    @classmethod
    def from_ultralytics(
        cls,
        results: Iterable[Any],
        cameras: Self,
        *,
        frames: Sequence[str] | None = None,
        source: str = "yolo",
    ) -> Self:
        """Cameras with the boxes of Ultralytics results, the outlines of segmentation and turned boxes of OBB.

        Parameters
        ----------
        results : iterable of ultralytics.engine.results.Results
            One per image; matched to frame ids and images by file name.
        cameras : Scene
            The frames.
        frames : sequence of str, optional
            Frame ids of the results, instead of matching names.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        # A stream of results can be read once.
        results, known = list(results), cameras.frame_ids
        paths = _paths("results", results, "path", "Ultralytics' Results")
        if frames is None:
            frames = _frames_of_paths(paths, known)
        table = _Table(cameras)
        for frame, result in _by_frame(results, frames, known):
            table.add(frame, _found.of_ultralytics(result, f'the result of frame "{known[frame]}"'))
        return cameras.with_detections(**table.arrays(), source=source)

    @classmethod
    def from_fiftyone(
        cls,
        samples: Iterable[Any],
        cameras: Self,
        *,
        field: str = "predictions",
        frames: Sequence[str] | None = None,
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
        frames : sequence of str, optional
            Frame ids of the samples, instead of matching names.
        source : str
            Name of the detector.
        """
        _checks.scene("cameras", cameras)
        _checks.text("field", field)
        samples, known = list(samples), cameras.frame_ids
        paths = _paths("samples", samples, "filepath", "a fiftyone.Sample")
        if frames is None:
            frames = _frames_of_paths(paths, known)
        sizes = _fiftyone.image_sizes(cameras.to_dict())
        table = _Table(cameras)
        for frame, sample in _by_frame(samples, frames, known):
            table.add(frame, _fiftyone.of_sample(sample, field, sizes.get(known[frame])))
        return cameras.with_detections(**table.arrays(), source=source)


def _by_frame(
    detections: Sequence[Any] | Mapping[str, Any], frames: Sequence[str] | None, known: list[str]
) -> list[tuple[int, Any]]:
    """Detections with the indices of their frames."""
    index = {name: k for k, name in enumerate(known)}
    if isinstance(detections, Mapping):
        pairs = list(detections.items())
    else:
        names = known if frames is None else list(frames)
        if len(detections) != len(names):
            like = "the scene has frames" if frames is None else "frames"
            raise QuadliftError(f"there are {len(detections)} detections; expected {len(names)}, as many as {like}")
        pairs = list(zip(names, detections, strict=True))
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


def _frames_of_paths(paths: list[str], known: list[str]) -> list[str]:
    """The frames whose ids match these file names, with or without folders and extensions."""
    for part in ("name", "stem"):
        frames: dict[str, list[str]] = {}
        for name in known:
            frames.setdefault(getattr(PurePath(name), part), []).append(name)
        found = [frames.get(getattr(PurePath(path), part), []) for path in paths]
        if all(len(names) == 1 for names in found):
            return [names[0] for names in found]
    missing = next(path for path, names in zip(paths, found, strict=True) if len(names) != 1)
    some = ", ".join(known[:5])
    raise QuadliftError(
        f"no single frame has the name of the image {PurePath(missing).name}; the scene has {len(known)} frames: "
        f"{some} (frames=[...] names them)"
    )


class _Table:
    """Detections, gathered frame by frame, as arguments of `Scene.with_detections`."""

    def __init__(self, cameras: SceneData) -> None:
        self.frame_ids = cameras.frame_ids
        self.frame: list[int] = []
        self.boxes: list[Any] = []
        self.scores: list[float] = []
        self.categories: list[str | None] = []
        self.object: list[str | None] = []
        self.masks: list[Any] = []
        self.outline: list[Any] = []
        self.oriented_box: list[Any] = []

    def add(self, frame: int, found: _found.Found) -> None:
        turned = found.oriented_box
        edges = _checks.array(f'xyxy of frame "{self.frame_ids[frame]}"', found.boxes, ("M", 4), nan=turned is not None)
        scores, classes, tracks, masks = found.scores, found.categories, found.object, found.masks
        for row in range(len(edges)):
            self.frame.append(frame)
            self.boxes.append(edges[row])
            self.scores.append(float("nan") if scores is None else float(scores[row]))
            self.categories.append(None if classes is None else str(classes[row]))
            self.object.append(None if tracks is None else tracks[row])
            self.masks.append(None if masks is None else masks[row])
            self.outline.append(None if found.outline is None else found.outline[row])
            self.oriented_box.append(np.full(5, np.nan) if turned is None else turned[row])

    def arrays(self) -> dict[str, Any]:
        turned = np.array(self.oriented_box, dtype=np.float64).reshape(-1, 5)
        return {
            "frame": np.array(self.frame, dtype=np.int64),
            "boxes": np.array(self.boxes, dtype=np.float64).reshape(-1, 4),
            "scores": np.array(self.scores, dtype=np.float64),
            "categories": np.array(self.categories, dtype=object),
            "object": np.array(self.object, dtype=object),
            "masks": self.masks if any(mask is not None for mask in self.masks) else None,
            "outline": self.outline if any(outline is not None for outline in self.outline) else None,
            "oriented_box": turned if np.isfinite(turned).any() else None,
        }
