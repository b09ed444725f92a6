"""Scenes: posed frames, detections and objects, and what is done with them."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _adapters, _arrays, _checks, _core, _estimates, _options, _rerun
from ._core import QuadliftError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from ._options import Path


class Scene:
    """Posed frames, detections in them, and objects (the truth, or estimates). A scene never changes.

    Make one with `read`, `from_arrays`, `from_colmap`, `from_coco`, `from_detections`, `from_supervision` or
    `from_ultralytics`. What is wrong with an argument or a file is a `QuadliftError`, which names it, what was found
    and what was expected.
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
        """The scene of a document as in a scene file; NumPy's numbers and arrays may stand for plain ones."""
        try:
            text = json.dumps(document, default=_plain)
        except (TypeError, ValueError, RecursionError) as error:
            raise QuadliftError(f"the document is no JSON: {error}") from error
        return cls(_core.Scene.parse(text.encode(), ""))

    def to_dict(self) -> dict[str, Any]:
        """The document of the scene file."""
        document: dict[str, Any] = json.loads(self._core.to_json())
        return document

    def write(self, path: Path) -> None:
        """Writes a scene file; paths of images and masks become absolute where it goes to another folder.

        Parameters
        ----------
        path : path-like
            The file. One that exists is replaced when the new one is complete.

        Raises
        ------
        QuadliftError
            Where the file is an image or a mask of the scene; or the file of the scene that was localised, where this
            one holds its estimates, but not its detections.
        """
        self._core.write(path)

    # Arrays

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
        frames = _arrays.frames(
            projections=projections,
            intrinsics=intrinsics,
            cam_from_world=cam_from_world,
            image_sizes=image_sizes,
            frame_ids=frame_ids,
            images=images,
            name=name,
            up=up,
            length_unit=length_unit,
        )
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
            Indices of the frames, 0 to F - 1.
        boxes : array_like, shape (M, 4), optional
            ``[x0, y0, x1, y1]`` in pixels; a row of NaN stands for none.
        ellipses : array_like, shape (M, 5), optional
            Centre x and y, two semi-axes, and the angle of the first (radians, from x towards y); pixels. A row of NaN
            stands for none. Each detection needs a box or an ellipse.
        masks : sequence of (H, W) arrays or None, length M, optional
            Non-zero where the object is.
        object : array_like of int or str, shape (M,), optional
            The objects; negative numbers, None and "" stand for unknown. A source shows each once in a frame at most.
        scores : array_like, shape (M,), optional
            Scores; NaN stands for none.
        categories : array_like of int or str, shape (M,), optional
            Categories, by number or name; as for objects, some stand for unknown.
        source : str, optional
            Name of the detector.
        """
        detections = _arrays.detections(
            frame=frame,
            boxes=boxes,
            ellipses=ellipses,
            masks=masks,
            object=object,
            scores=scores,
            categories=categories,
            source=source,
        )
        return Scene(self._core.with_detections(detections))

    # From other packages: plain functions of `_adapters`, with their documentation

    from_colmap = classmethod(_adapters.from_colmap)
    from_detections = classmethod(_adapters.from_detections)
    from_coco = classmethod(_adapters.from_coco)
    from_supervision = classmethod(_adapters.from_supervision)
    from_ultralytics = classmethod(_adapters.from_ultralytics)

    # What it holds

    def __reduce__(self) -> Any:
        return _read_again, (self._core.to_json(), self._core.path)

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
        return _estimates.Estimates._of(self._core.localize(keywords, threads, progress))._warned(2)

    def diagnose(self, *, source: str | None = None) -> dict[str, Any]:
        """Whether poses, cameras and boxes fit together, and if not, which of the usual mistakes explains it.

        Parameters
        ----------
        source : str, optional
            Look at the detections of this source only; needed when the scene has several.

        Returns
        -------
        dict
            As `Estimates.diagnosis`.
        """
        text, _ = self._core.diagnosis(_checks.optional(_checks.text, "source", source))
        diagnosis: dict[str, Any] = json.loads(text)
        return diagnosis

    def corrected(
        self,
        *,
        pose_convention: str | None = None,
        pose_unit: str | None = None,
        up: str | ArrayLike | None = None,
        focal_factor: float | None = None,
        intrinsics_format: str | None = None,
        radial_distortion: float | None = None,
        box_format: str | None = None,
        normalized_boxes: bool = False,
        image_size: tuple[float, float] | None = None,
        box_scale: float | None = None,
        letterbox: float | tuple[float, float] | None = None,
        frame_offset: int | None = None,
        frame_order: str | None = None,
    ) -> Scene:
        """The scene with the usual mistakes undone: the corrections of the program, with the same names and values.

        Parameters
        ----------
        pose_convention : str, optional
            What the poses are instead of OpenCV's ``cam_from_world``: ``"world-from-camera"``, ``"opengl"``,
            ``"opengl-world-from-camera"``, ``"body"``, ``"left-handed"``, ``"camera-center"``, ...
        pose_unit : str, optional
            Unit of the poses' translations (``"mm"``); the scene is in metres then.
        up : str or array_like, shape (3,), optional
            World direction against gravity: an axis such as ``"-y"``, or a direction.
        focal_factor : float, optional
            Multiplies the focal lengths.
        intrinsics_format : {"normalized", "transposed"}, optional
            What the intrinsics are instead of pixels.
        radial_distortion : float, optional
            Radial coefficient of the lens that the cameras lack.
        box_format : str, optional
            What the numbers of boxes are: ``"xywh"``, ``"cxcywh"``, ``"yxyx"``, ...
        normalized_boxes : bool
            Whether boxes are shares of the image's width and height.
        image_size : (width, height), optional
            Pixels of the images in which the boxes were measured.
        box_scale : float, optional
            Multiplies the pixels of the boxes.
        letterbox : side or (width, height), optional
            The letterboxed square image in which the boxes were measured, pixels.
        frame_offset : int, optional
            Detections of frame number N belong to frame number 0, and so on.
        frame_order : {"alphabetical", "numeric", "reversed"}, optional
            The order in which detections were given to frames.

        Returns
        -------
        Scene
            Without the detections that belong to no frame any more.
        """
        given = {
            "pose_convention": pose_convention,
            "pose_unit": pose_unit,
            "up": up,
            "focal_factor": focal_factor,
            "intrinsics_format": intrinsics_format,
            "radial_distortion": radial_distortion,
            "box_format": box_format,
            "normalized_boxes": normalized_boxes,
            "image_size": image_size,
            "box_scale": box_scale,
            "letterbox": letterbox,
            "frame_offset": frame_offset,
            "frame_order": frame_order,
        }
        scene, _ = self._core.corrected(_options.corrections(given))
        return Scene(scene)

    def segment(
        self,
        *,
        method: _options.Segmenter = "sca+cut",
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
        keywords = _options.of_segmentation(method, source, out_masks, seed)
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
        pixel_sd: float | None = None,
        priors: Path | Mapping[str, _options.Prior] | None = None,
        threads: int | None = None,
        progress: _options.Progress | None = None,
    ) -> tuple[Scene, list[_estimates.AssociatedObject]]:
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
        pixel_sd : float, optional
            Error of box edges that does not depend on the size of the box, pixels. By default 2, 4 or 8, as much as
            costs little evidence.
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

        Raises
        ------
        QuadliftError
            Where no object was found, and why; where something is wrong with an option.
        """
        threads, progress = _options.threads_and_progress(threads, progress)
        keywords = _options.of_association(
            ids=ids,
            source=source,
            thorough=thorough,
            min_views=min_views,
            min_score=min_score,
            max_overlap=max_overlap,
            pixel_sd=pixel_sd,
            priors=priors,
        )
        scene, objects = self._core.associate(keywords, threads, progress)
        return Scene(scene), [_estimates.AssociatedObject(*found) for found in objects]

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
        source = _checks.optional(_checks.text, "source", source)
        scores = self._core.evaluate(_checks.scene("truth", truth), _checks.text("match", match), source)
        return _estimates.Evaluation(**json.loads(scores))

    def report(self, path: Path, *, title: str | None = None) -> None:
        """Writes a page that shows the scene in any browser.

        Parameters
        ----------
        path : path-like
            The page, an HTML file; not the file of the scene, nor one of its images or masks.
        title : str, optional
            Its title; the name of the scene without it.
        """
        self._core.check_output(path)
        _core.write_text(path, self._core.report(_checks.text("title", title or self.name or "quadlift")))

    def to_rerun(self, path: Path | None = None) -> None:
        """Logs frames, detections and objects with Rerun (https://rerun.io); needs its SDK.

        Parameters
        ----------
        path : path-like, optional
            A recording to write (``.rrd``); without it the current recording of Rerun gets them (``rerun.init``).
        """
        if path is not None:
            self._core.check_output(path)
        _rerun.log_recorded(self._core.recording(self.name or "quadlift"), self._core, path)

    def _repr_html_(self) -> str:
        return _estimates.in_notebook(self._core.report(self.name or "quadlift"))


def _read_again(text: str, path: Path) -> Scene:
    """A scene that was pickled."""
    return Scene(_core.Scene.parse(text.encode(), path))


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as plain ones."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    raise TypeError(f"found a {type(value).__name__}")
