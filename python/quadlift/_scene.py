"""Scenes: posed frames, detections and objects; files and other packages' types."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _adapters, _checks, _core, _estimates, _options, _rerun
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Unpack

    Path = str | os.PathLike[str]


@dataclass(frozen=True)
class AssociatedObject:
    """An object that association has found."""

    id: str
    """Its id."""
    evidence: float | None
    """How much better its detections are explained by it than by clutter (nats)."""
    doubtful: str | None
    """Why it may not be one standing object."""


class Scene:
    """Posed frames, detections in them, and objects (the truth, or estimates). A scene never changes.

    Make one with `read`, `from_arrays`, `from_colmap`, `from_coco`, `from_detections`, `from_supervision` or
    `from_ultralytics`.
    """

    def __init__(self, core: _core.Scene) -> None:
        self._core = core

    # Files

    @classmethod
    def read(cls, path: Path) -> Scene:
        """Reads a scene file.

        Parameters
        ----------
        path : path-like
            The file, JSON of the format ``quadlift.scene``.

        Raises
        ------
        QuadliftError
            Names the file, the place in it, what was found and what was expected.
        """
        return cls(_core.Scene.read(path))

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Scene:
        """The scene of a document as in a scene file."""
        return cls(_core.Scene.parse(json.dumps(document).encode()))

    def to_dict(self) -> dict[str, Any]:
        """The document of the scene file."""
        document: dict[str, Any] = json.loads(self._core.to_json())
        return document

    def write(self, path: Path) -> None:
        """Writes a scene file; paths of images become absolute where it goes to another folder.

        Parameters
        ----------
        path : path-like
            The file. One that exists is replaced when the new one is complete.
        """
        self._core.write(path)

    # Arrays and other packages

    @classmethod
    def from_arrays(
        cls,
        *,
        projections: ArrayLike | None = None,
        intrinsics: ArrayLike | None = None,
        cam_from_world: ArrayLike | None = None,
        image_sizes: ArrayLike | None = None,
        frame_ids: Sequence[str] | None = None,
        images: Sequence[str] | None = None,
        name: str | None = None,
        up: ArrayLike | None = None,
        length_unit: str | None = None,
    ) -> Scene:
        """Posed frames; `with_detections` adds detections.

        Parameters
        ----------
        projections : array_like, shape (F, 3, 4)
            World to pixels. Either these, or `intrinsics` and `cam_from_world`.
        intrinsics : array_like, shape (3, 3) or (F, 3, 3)
            Pinhole cameras in pixels, one for all frames or one for each.
        cam_from_world : array_like, shape (F, 3, 4) or (F, 4, 4)
            Poses, world to camera, OpenCV's axes.
        image_sizes : array_like, shape (2,) or (F, 2), optional
            Width and height in pixels.
        frame_ids : sequence of str, length F, optional
            Names of the frames; "0", "1", ... without it.
        images : sequence of str, length F, optional
            Paths of the images, for `segment` and for pages.
        name : str, optional
            Name of the scene.
        up : array_like, shape (3,), optional
            World direction against gravity.
        length_unit : str, optional
            World unit, such as "m".
        """
        rows: NDArray[np.float64]
        cameras = None
        if projections is not None:
            if intrinsics is not None or cam_from_world is not None:
                raise QuadliftError("expected either projections, or intrinsics and cam_from_world; found both")
            rows = _checks.array("projections", projections, ("F", 3, 4))
        elif intrinsics is not None and cam_from_world is not None:
            rows = _poses(cam_from_world)
            cameras = _checks.array("intrinsics", intrinsics, (3, 3) if np.ndim(intrinsics) == 2 else ("F", 3, 3))
            if cameras.ndim == 2:
                cameras = cameras[np.newaxis]
            else:
                _checks.rows("intrinsics", len(cameras), "cam_from_world", len(rows))
        else:
            found = [k for k, v in (("intrinsics", intrinsics), ("cam_from_world", cam_from_world)) if v is not None]
            words = " and ".join(found) or "none of them"
            raise QuadliftError(f"expected projections, or intrinsics and cam_from_world; found {words}")
        count = len(rows)
        sizes = None
        if image_sizes is not None:
            sizes = _checks.array("image_sizes", image_sizes, (2,) if np.ndim(image_sizes) == 1 else ("F", 2))
            if sizes.ndim == 1:
                sizes = np.broadcast_to(sizes, (count, 2))
            _checks.rows("image_sizes", len(sizes), "there are frames", count)
            if (sizes <= 0.0).any():
                raise QuadliftError("image_sizes holds a number that is not positive; expected pixels")
        frames = {
            "projections": rows if cameras is None else None,
            "intrinsics": cameras,
            "cam_from_world": None if cameras is None else rows,
            "image_sizes": sizes,
            "frame_ids": [str(k) for k in range(count)]
            if frame_ids is None
            else _checks.texts("frame_ids", frame_ids, count),
            "images": None if images is None else _checks.texts("images", images, count),
            "name": None if name is None else _checks.text("name", name),
            "length_unit": None if length_unit is None else _checks.text("length_unit", length_unit),
            "up": None if up is None else _checks.array("up", up, (3,)).tolist(),
        }
        return cls(_core.Scene.from_frames(frames))

    def with_detections(
        self,
        *,
        frame: ArrayLike,
        boxes: ArrayLike | None = None,
        ellipses: ArrayLike | None = None,
        masks: Sequence[Any] | None = None,
        object: ArrayLike | None = None,
        scores: ArrayLike | None = None,
        categories: ArrayLike | None = None,
        source: str | None = None,
    ) -> Scene:
        """The scene with M more detections.

        Parameters
        ----------
        frame : array_like of int, shape (M,)
            Indices of the frames.
        boxes : array_like, shape (M, 4), optional
            ``[x0, y0, x1, y1]`` in pixels; a row of NaN stands for none.
        ellipses : array_like, shape (M, 5), optional
            Centre x and y, two semi-axes, angle of the first (radians); a row of NaN stands for none.
        masks : sequence of (H, W) arrays or None, length M, optional
            Non-zero where the object is.
        object : array_like of int or str, shape (M,), optional
            The objects; negative numbers, None and "" stand for unknown.
        scores : array_like, shape (M,), optional
            Scores; NaN stands for none.
        categories : array_like of int or str, shape (M,), optional
            Categories.
        source : str, optional
            The detector.
        """
        frames = _checks.indices("frame", frame)
        count = len(frames)
        if boxes is None and ellipses is None:
            raise QuadliftError("expected boxes or ellipses; found none of them")
        edges = None if boxes is None else _checks.array("boxes", boxes, ("M", 4), nan=True)
        numbers = None if ellipses is None else _checks.array("ellipses", ellipses, ("M", 5), nan=True)
        values = None if scores is None else _checks.array("scores", scores, ("M",), nan=True)
        for name, found in (("boxes", edges), ("ellipses", numbers), ("scores", values)):
            if found is not None:
                _checks.rows(name, len(found), "frame", count)
        detections = {
            "frame": frames,
            "boxes": edges,
            "ellipses": numbers,
            "masks": None if masks is None else _adapters.runs_of_masks(masks, count),
            "object": _checks.names("object", object, count, "frame"),
            "category": _checks.names("categories", categories, count, "frame"),
            "scores": values,
            "source": None if source is None else _checks.text("source", source),
            "hidden_edges": None,
        }
        return Scene(self._core.with_detections(detections))

    @classmethod
    def from_colmap(cls, model: Path | Any) -> Scene:
        """The cameras of a COLMAP model.

        Parameters
        ----------
        model : path-like or pycolmap.Reconstruction
            The folder of the model (binary or text), or the reconstruction itself.
        """
        if isinstance(model, str | os.PathLike):
            return cls(_core.Scene.read_colmap(model)[0])
        if not hasattr(model, "write"):
            raise QuadliftError(f"model is a {type(model).__name__}; expected a path or a pycolmap.Reconstruction")
        with tempfile.TemporaryDirectory() as folder:
            model.write(folder)
            return cls(_core.Scene.read_colmap(folder)[0])

    @classmethod
    def from_detections(
        cls,
        path: Path,
        cameras: Scene,
        *,
        names: Path | None = None,
        frame_column: str | None = None,
        source: str | None = None,
        min_score: float | None = None,
        image_size: tuple[float, float] | None = None,
    ) -> Scene:
        """Cameras with the detections of a file of another program, whose format is recognised.

        COCO, MOTChallenge, Ultralytics YOLO, KITTI labels, CSV tables, supervision's sinks and LabelMe are; their
        images are matched with the frames by name, number or time, as in the program. Track ids become objects.

        Parameters
        ----------
        path : path-like
            File or folder.
        cameras : Scene
            The frames; detections that it has stay.
        names : path-like, optional
            Names of the classes, for YOLO, MOTChallenge and tables.
        frame_column : str, optional
            The column of a table that names the image.
        source : str, optional
            Name of the detector; that of the format without it.
        min_score : float, optional
            Leave out detections with a lower score.
        image_size : (float, float), optional
            Width and height of images of which nothing else says it, pixels.
        """
        scene, _notes = cameras._core.with_detections_of(
            path,
            names=names,
            frame_column=frame_column,
            source=source,
            min_score=None if min_score is None else _checks.number("min_score", min_score),
            image_size=image_size,
        )
        return cls(scene)

    @classmethod
    def from_coco(cls, path: Path, cameras: Scene) -> Scene:
        """Cameras with the boxes and masks of a COCO file; see `from_detections`."""
        return cls.from_detections(path, cameras, source="coco")

    @classmethod
    def from_supervision(
        cls,
        detections: Sequence[Any] | Mapping[str, Any],
        cameras: Scene,
        *,
        frames: Sequence[str] | None = None,
        source: str = "supervision",
    ) -> Scene:
        """Cameras with the detections of `supervision.Detections`.

        Parameters
        ----------
        detections : sequence or mapping of supervision.Detections
            One for each frame, in their order (or that of `frames`), or by the ids of the frames. Tracker ids become
            objects (``t7`` for 7), class names (or numbers) become categories.
        cameras : Scene
            The frames.
        frames : sequence of str, optional
            Ids of the frames of a sequence of detections.
        source : str
            Name of the detector.
        """
        known = cameras._core.frame_ids
        table = _adapters.supervision(_adapters.by_frame(detections, frames, known))
        return cameras.with_detections(**table, source=source)

    @classmethod
    def from_ultralytics(
        cls,
        results: Sequence[Any],
        cameras: Scene,
        *,
        frames: Sequence[str] | None = None,
        source: str = "yolo",
    ) -> Scene:
        """Cameras with the boxes of Ultralytics' results.

        Parameters
        ----------
        results : sequence of ultralytics.engine.results.Results
            One for each image; matched by the name of its file with the frames' ids and images.
        cameras : Scene
            The frames.
        frames : sequence of str, optional
            Ids of the results' frames, instead of matching names.
        source : str
            Name of the detector.
        """
        ids = cameras._core.frame_ids
        if frames is None:
            frames = _adapters.frames_of_paths([str(result.path) for result in results], ids)
        table = _adapters.ultralytics(_adapters.by_frame(results, frames, ids))
        return cameras.with_detections(**table, source=source)

    # What it holds

    def __len__(self) -> int:
        """Number of detections."""
        return len(self._core)

    def __repr__(self) -> str:
        name = f" {self.name!r}" if self.name else ""
        counts = f"{len(self.frame_ids)} frames, {len(self)} detections, {self.objects} objects"
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
        """Ids of the objects that the detections name."""
        return self._core.object_ids

    @property
    def objects(self) -> int:
        """Number of objects in the file: the truth, or estimates."""
        return self._core.objects

    # What to do with it

    def localize(self, **options: Unpack[_options.Options]) -> _estimates.Estimates:
        """Localises the objects, as the program does; see `quadlift.localize` for the options.

        Returns
        -------
        Estimates
            In the order of the objects' first detections.
        """
        keywords, threads, progress = _options.split(options, "Scene.localize")
        return _estimates.Estimates._of(self._core.localize(keywords, threads, progress))

    def segment(
        self,
        *,
        method: Literal["sca+cut", "sca", "graphcut", "masks", "box"] = "sca+cut",
        source: str | None = None,
        out_masks: Path | None = None,
        seed: int = 0,
        threads: int | None = None,
        progress: _options.Progress | None = None,
    ) -> Scene:
        """Finds the masks of the detections in the images, and the ellipses of the masks, as the program does.

        The crops of one object in all of its frames are segmented together. A mask that cannot be trusted is given up
        for the ellipse in the box. `localize` takes the ellipses from there, or the masks with
        ``observations="mask"``.

        Parameters
        ----------
        method : {"sca+cut", "sca", "graphcut", "masks", "box"}
            Stels finished by graph cuts, stels alone, graph cuts alone, the masks that the detections have already, or
            the ellipse in each box (for comparison).
        source : str, optional
            Take the detections of this source only; needed when the scene has several.
        out_masks : path-like, optional
            A folder for the masks as label images (PNG), one for each frame; without it the scene itself holds them.
        seed : int
            Seed of everything that is drawn at random.
        threads : int, optional
            Number of threads; the result does not depend on it.
        progress : callable, optional
            Called with the number of images done and their total, then with those of the objects.

        Returns
        -------
        Scene
            The scene whose detections have ellipses, masks, and a note on how far these can be trusted.

        Raises
        ------
        QuadliftError
            Where no detection could be segmented.

        Warns
        -----
        UserWarning
            Names what went wrong with single detections (an image that cannot be read).
        """
        threads, progress = _options.threads_and_progress(threads, progress)
        keywords = {
            "method": _checks.text("method", method),
            "source": None if source is None else _checks.text("source", source),
            "out_masks": None if out_masks is None else os.fspath(out_masks),
            "seed": _checks.whole("seed", seed, 0, 2**64 - 1),
        }
        scene, problems = self._core.segment(keywords, threads, progress)
        for problem in problems:
            warnings.warn(problem, stacklevel=2)
        return Scene(scene)

    def associate(
        self,
        *,
        ids: _options.Ids = "evidence",
        source: str | None = None,
        thorough: bool = False,
        min_views: int = 3,
        min_score: float | None = None,
        max_overlap: float | None = None,
        pixel_sd: float = 2.0,
        priors: str | os.PathLike[str] | Mapping[str, _options.Prior] | None = None,
        threads: int | None = None,
        progress: _options.Progress | None = None,
    ) -> tuple[Scene, list[AssociatedObject]]:
        """Finds out which detections show the same object.

        Parameters
        ----------
        ids : {"evidence", "trust", "ignore"}
            What ids that detections have are worth.
        source : str, optional
            Take the detections of this source only.
        thorough : bool
            Search from several starts: about eight times as long, better with few views or many misses.
        min_views : int
            Objects with fewer views are not reported.
        min_score : float, optional
            Leave out detections with a lower score.
        max_overlap : float, optional
            Leave out detections that overlap a better one of the same frame and category by more (intersection over
            union).
        pixel_sd : float
            Error of box edges that does not depend on the size of the box, pixels: 2 suits photos, 3 to 4 a moving car.
        priors : str, path-like or mapping, optional
            Sizes of categories: "builtin" (for scenes in metres), a TOML file, or a mapping, as in `localize`.
        threads : int, optional
            Number of threads.
        progress : callable, optional
            Called with the steps done and their total.

        Returns
        -------
        scene : Scene
            The scene whose detections name these objects.
        objects : list of AssociatedObject
            The objects, in the order of their first detections.
        """
        threads, progress = _options.threads_and_progress(threads, progress)
        name, text = _options.priors_of(priors)
        keywords = {
            "ids": _checks.text("ids", ids),
            "source": None if source is None else _checks.text("source", source),
            "thorough": _checks.flag("thorough", thorough),
            "min_views": _checks.whole("min_views", min_views, 2, 2**32),
            "min_score": None if min_score is None else _checks.number("min_score", min_score),
            "max_overlap": None if max_overlap is None else _checks.number("max_overlap", max_overlap),
            "pixel_sd": _checks.number("pixel_sd", pixel_sd),
            "priors": name,
            "priors_text": text,
        }
        scene, objects = self._core.associate(keywords, threads, progress)
        return Scene(scene), [AssociatedObject(*found) for found in objects]

    def evaluate(
        self, truth: Scene, *, match: Literal["auto", "ids", "overlap"] = "auto", source: str | None = None
    ) -> _estimates.Evaluation:
        """Scores the objects of this scene (a result, see `Estimates.to_scene`) against true ones.

        Where both scenes have detections and those of the truth name objects, it is scored too how the detections were
        divided into objects; without objects in both that alone.

        Parameters
        ----------
        truth : Scene
            A scene with objects, or with detections that name objects.
        match : {"auto", "ids", "overlap"}
            How estimates and true objects are paired; by their ids where any is common, else by overlap (``"auto"``).
        source : str, optional
            Score the identities of the detections of this source only.

        Raises
        ------
        QuadliftError
            Where there is nothing to compare.
        """
        source = None if source is None else _checks.text("source", source)
        scores = self._core.evaluate(truth._core, _checks.text("match", match), source)
        return _estimates.Evaluation(**json.loads(scores))

    def report(self, path: Path, *, title: str | None = None) -> None:
        """Writes a page that shows the scene in any browser.

        Parameters
        ----------
        path : path-like
            The page, an HTML file.
        title : str, optional
            Its title; the name of the scene without it.
        """
        _core.write_text(path, self._core.report(title or self.name or "quadlift"))

    def to_rerun(self, path: Path | None = None) -> None:
        """Logs frames, detections and objects with Rerun (https://rerun.io); needs ``quadlift[rerun]``.

        Parameters
        ----------
        path : path-like, optional
            A recording to write (``.rrd``); without it the current recording of Rerun gets them (``rerun.init``).
        """
        _rerun.log_recorded(self._core.recording(self.name or "quadlift"), self._core, path)

    def _repr_html_(self) -> str:
        return _estimates.frame(self._core.report(self.name or "quadlift"))


def _poses(cam_from_world: ArrayLike) -> NDArray[np.float64]:
    """(F, 3, 4) of (F, 3, 4) or (F, 4, 4)."""
    if np.shape(cam_from_world)[1:] != (4, 4):
        return _checks.array("cam_from_world", cam_from_world, ("F", 3, 4))
    poses = _checks.array("cam_from_world", cam_from_world, ("F", 4, 4))
    wrong = np.flatnonzero((poses[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1))
    if wrong.size:
        raise QuadliftError(f"the last row of cam_from_world[{wrong[0]}] is no [0, 0, 0, 1]")
    return poses[:, :3]
