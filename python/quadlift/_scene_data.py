"""Posed frames, detections and objects as data: files, arrays, reports."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _arrays, _checks, _core, _formats, _notebook, _rerun
from ._arrays import DetectionFields, FrameFields, SceneFields
from ._core import QuadliftError
from ._formats import ExportOptions

if TYPE_CHECKING:
    import pyarrow
    from numpy.typing import ArrayLike
    from typing_extensions import Self, Unpack

    from ._checks import Path


class SceneData:
    """The data of a `Scene`; immutable."""

    def __init__(self, core: _core.Scene) -> None:
        self._core = core

    # Files

    @classmethod
    def read(cls, path: Path, *, assume: str = "") -> Self:
        """Reads a scene file.

        Parameters
        ----------
        path : path-like
            The file, JSON of the format ``quadlift.scene``.
        assume : str
            What the file really holds, as in `Scene.corrected`: ``"boxes=xywh"``.

        Raises
        ------
        QuadliftError
            Names the file, the place in it, what was found and what was expected.
        """
        return cls(_core.Scene.read(path, _checks.text("assume", assume)))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any], *, assume: str = "") -> Self:
        """Makes a scene from a document in the format of scene files; NumPy numbers and arrays are accepted.

        What the document really holds is `assume`, as in `read`.
        """
        try:
            text = json.dumps(document, default=_plain)
        except (TypeError, ValueError, RecursionError) as error:
            raise QuadliftError(f"the document is no JSON: {error}") from error
        return cls(_core.Scene.parse(text.encode(), "", _checks.text("assume", assume)))

    def to_dict(self) -> dict[str, Any]:
        """The document of the scene file."""
        document: dict[str, Any] = json.loads(self._core.to_json())
        return document

    def write(self, path: Path) -> None:
        """Writes a scene file; paths of images and masks become absolute if it is written to another folder.

        Parameters
        ----------
        path : path-like
            The file. An existing file is replaced once the new one is complete.

        Raises
        ------
        QuadliftError
            If the file is an image or mask of the scene; or if this scene is the result of a localized scene and the
            file is that scene.
        """
        self._core.write(path)

    # Arrays

    @classmethod
    def from_arrays(
        cls,
        intrinsics: ArrayLike | None = None,
        cam_from_world: ArrayLike | None = None,
        boxes: ArrayLike | None = None,
        frames: ArrayLike | None = None,
        objects: ArrayLike | None = None,
        **fields: Unpack[SceneFields],
    ) -> Self:
        """Posed frames with detections, if there are any: the arrays of `quadlift.localize`.

        Parameters
        ----------
        intrinsics : array_like, shape (3, 3) or (F, 3, 3)
            Pinhole cameras in pixels, one for all frames or one for each.
        cam_from_world : array_like, shape (F, 3, 4) or (F, 4, 4)
            Poses, world to camera, OpenCV's axes.
        boxes, frames, objects : array_like, optional
            Detections, as in `with_detections`, which adds more, and those of other sources.
        **fields : SceneFields
            Frames, see `quadlift.FrameFields`: ``projections``, ``distortion``, ``image_sizes``, ``frame_ids``,
            ``images``, ``name``, ``up``, ``length_unit``. Detections, see `quadlift.DetectionFields`.
        """
        given: dict[str, Any] = {**fields}
        of_frames = {name: given.pop(name) for name in FrameFields.__annotations__ if name in given}
        for name in given:
            if name not in DetectionFields.__annotations__:
                raise TypeError(f"from_arrays() got an unexpected keyword argument {name!r}")
        scene = cls(_core.Scene.from_frames(_arrays.from_arrays(intrinsics, cam_from_world, **of_frames)))
        if all(value is None for value in (boxes, frames, objects, *given.values())):
            return scene
        return scene.with_detections(boxes, frames, objects, **given)

    def with_detections(
        self,
        boxes: ArrayLike | None = None,
        frames: ArrayLike | None = None,
        objects: ArrayLike | None = None,
        *,
        source: str | None = None,
        **fields: Unpack[DetectionFields],
    ) -> Self:
        """Returns the scene with M more detections.

        Parameters
        ----------
        boxes : array_like, shape (M, 4), optional
            ``[x0, y0, x1, y1]`` in pixels; a row of NaN means none.
        frames : array_like of int or str, shape (M,)
            The frames: indices, 0 to F - 1, or ids.
        objects : array_like of int or str, shape (M,), optional
            The objects; negative numbers, None and "" mean unknown. A source detects each at most once per frame.
        source : str, optional
            Name of the detector.
        **fields : DetectionFields
            ``ellipses``, ``masks``, ``outlines``, ``oriented_boxes``, ``scores``, ``categories``, ``depths``,
            ``boxes3d``, ``orientation``: `quadlift.DetectionFields` describes them.
        """
        arrays = _arrays.with_detections(boxes, frames, objects, self.frame_ids, source=source, **fields)
        return type(self)(self._core.with_detections(*arrays))

    def to_arrow(self) -> tuple[pyarrow.Table, pyarrow.Table]:
        """Detections and frames as tables, as `quadlift.tables` takes them; needs pyarrow.

        Returns
        -------
        detections : pyarrow.Table
            One row per detection, without its mask; the columns of docs/scale-out.md.
        frames : pyarrow.Table
            One row per frame, with its camera: `frame`, `camera`, `model`, `params`, `intrinsics` (of pinhole cameras),
            `cam_from_world` or `projection`, `width`, `height`, `time`, `image`.
        """
        from ._scene_tables import tables

        return tables(self.to_dict())

    # Contents

    def __reduce__(self) -> Any:
        return _read_again, (type(self), self._core.to_json(), self._core.path)

    def __len__(self) -> int:
        """Number of detections."""
        return len(self._core)

    def __repr__(self) -> str:
        name = f" {self.name!r}" if self.name else ""
        counts = f"{len(self.frame_ids)} frames, {len(self)} detections, {self.object_count} objects"
        return f"<quadlift.Scene{name}: {counts}>"

    @property
    def name(self) -> str | None:
        """Name of the scene."""
        return self._core.name

    @property
    def length_unit(self) -> str | None:
        """World unit."""
        return self._core.length_unit

    @property
    def frame_ids(self) -> list[str]:
        """Ids of the frames."""
        return self._core.frame_ids

    @property
    def object_ids(self) -> list[str]:
        """Object ids of the detections."""
        return self._core.object_ids

    @property
    def object_count(self) -> int:
        """Number of objects in the file: ground truth or estimates."""
        return self._core.object_count

    # Reports

    def report(self, path: Path, *, title: str | None = None) -> None:
        """Writes an HTML report of the scene.

        Parameters
        ----------
        path : path-like
            The HTML file; not the scene file, nor one of its images or masks.
        title : str, optional
            Title of the report; the default is the name of the scene.
        """
        self._core.check_output(path)
        _core.write_text(path, self._core.report(_checks.text("title", title or self.name or "quadlift")))

    def render(self, frame: str | int, path: Path, *, labels: bool = False, source: str | None = None) -> None:
        """Draws a frame with its detections and the outlines of the objects, like ``quadlift render``.

        Parameters
        ----------
        frame : str or int
            Id of the frame.
        path : path-like
            The picture; its name ends in ``.png`` or ``.svg``.
        labels : bool
            Whether the labels of the objects (*cup 3*) are written beside their boxes.
        source : str, optional
            Draw only the detections of this source.
        """
        frame, source = frame_id("frame", frame), _checks.optional(_checks.text, "source", source)
        self._core.render(frame, path, _checks.flag("labels", labels), source)

    def export(self, format: str, path: Path, **options: Unpack[ExportOptions]) -> list[str]:
        """Writes the objects or cameras in a format of another program, like ``quadlift export``.

        Parameters
        ----------
        format : str
            Objects: ``"ply"``, ``"glb"``, ``"kitti"``, ``"bop"``, ``"coco"``, ``"geojson"``, ``"mcap"`` or
            ``"csv"``; cameras: ``"tum"`` or ``"colmap"`` (docs/formats/exports.md).
            `to_arrow` makes tables, `to_rerun` recordings of Rerun.
        path : path-like
            The file; for ``"colmap"`` a folder.
        **options : ExportOptions
            Options of the format; `quadlift.ExportOptions` lists them.

        Returns
        -------
        list of str
            What was converted, assumed and left out.

        Raises
        ------
        QuadliftError
            If there is nothing to write, or if the file is an image or mask of the scene.
        """
        texts = _formats.texts(options, ExportOptions, "export")
        return self._core.export(_checks.text("format", format), path, texts)

    def to_rerun(self, path: Path | None = None) -> None:
        """Logs frames, detections and objects to Rerun (https://rerun.io); needs its SDK.

        Parameters
        ----------
        path : path-like, optional
            A recording file to write (``.rrd``); without it, logs to the current recording (``rerun.init``).
        """
        if path is not None:
            self._core.check_output(path)
        _rerun.log_recorded(self._core.recording(self.name or "quadlift"), self._core, path)

    def _repr_html_(self) -> str:
        return _notebook.in_notebook(self._core.report(self.name or "quadlift"))


def frame_id(name: str, value: Any) -> str:
    """A text, or a whole number as text."""
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return str(int(value))
    if not isinstance(value, str):
        raise QuadliftError(f"{name} is {value!r}; expected a text or a whole number")
    return _checks.text(name, value)


def _read_again(cls: type[SceneData], text: str, path: Path) -> SceneData:
    """A scene that was pickled."""
    return cls(_core.Scene.parse(text.encode(), path, ""))


def _plain(value: Any) -> Any:
    """Converts NumPy numbers and arrays to plain ones."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"found a {type(value).__name__}")
