"""Scenes and what is done with them: above all, estimates."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from . import _checks, _core, _estimates, _notebook, _options, _rerun
from ._adapters import FromOtherPackages
from ._estimates import EstimateArrays

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from ._checks import Path


class Scene(FromOtherPackages):
    """Posed frames, detections in them, and objects (the truth, or estimates). A scene never changes.

    Make one with `read`, `from_arrays`, `from_colmap`, `from_coco`, `from_detections`, `from_supervision` or
    `from_ultralytics`. What is wrong with an argument or a file is a `QuadliftError`, which names it, what was found
    and what was expected.
    """

    # What to do with it

    def localize(self, **options: Unpack[_options.Options]) -> Estimates:
        """Localises the objects, as the program does; see `quadlift.localize` for the options.

        Returns
        -------
        Estimates
            In the order of the objects' first detections.
        """
        keywords, threads, progress = _options.split(options, "Scene.localize")
        return Estimates._of(self._core.localize(keywords, threads, progress))._warned(2)

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


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(EstimateArrays):
    """Estimates of N objects from M detections.

    What an object does not have is NaN. There is a body where the status is ``"ok"`` or ``"inconsistent"``.

    Attributes
    ----------
    object_ids : ndarray, shape (N,)
        The objects: whole numbers or texts, as they were given. In ascending order where they were given as an array;
        in the order of their first detections otherwise.
    categories : list of str or None, length N
        The category of most of the object's detections.
    status : ndarray of str, shape (N,)
        ``"ok"``, ``"inconsistent"``, ``"not_an_ellipsoid"``, ``"too_few_views"``, ``"degenerate"`` or ``"diverged"``.
    centers : ndarray, shape (N, 3)
        Centres in the world, whenever there is one.
    semi_axes : ndarray, shape (N, 3)
        Semi-axes of the ellipsoid that is tangent to the measurements, world units.
    quaternions : ndarray, shape (N, 4)
        Rotations of the objects, world from object: unit quaternions, w first.
    rotations : ndarray, shape (N, 3, 3)
        The same as matrices, whose columns are the axes in the order of ``semi_axes``.
    enclosing_semi_axes, enclosing_centers : ndarray, shape (N, 3)
        Semi-axes and centre of the larger ellipsoid that holds the real object. It is fitted on its own: its centre and
        rotation are not those of the tangent one.
    enclosing_quaternions : ndarray, shape (N, 4)
        Its rotation, world from object: a unit quaternion, w first.
    body_kinds : list of str or None, length N
        The kind of body of each object: ``"ellipsoid"``, ``"cuboid"``, ``"cylinder"`` or ``"superellipsoid:Q"``.
    body_axes, enclosing_body_axes : ndarray, shape (N, 3)
        Those of the body itself, where it is no ellipsoid: half extents of a cuboid, semi-axes of a
        superellipsoid, the two radii and half the height of a cylinder (its axis is the third one); and of the larger
        body of the same kind that holds the real object.
    covariances : ndarray, shape (N, 9, 9)
        Covariances, in ``covariance_coordinates``.
    covariance_coordinates : list of str or None, length N
        ``"center_vech_shape"`` (centre, and vech of the shape matrix) for ellipsoids, else
        ``"center_rotation_log_axes"``.
    center_sd : ndarray, shape (N,)
        Standard deviations of the centres per coordinate, world units.
    views_used : ndarray of int, shape (N,)
        Numbers of views that the estimates rest on.
    rms_residuals : ndarray, shape (N,)
        Root mean square residuals of the used views, pixels.
    misfits : ndarray, shape (N,)
        Root mean square residuals of the used views per degree of freedom, relative to half the size of the boxes; NaN
        for other methods than ``"map"``.
    misfit_deviations : ndarray, shape (N,)
        The same in standard deviations of the scene's noise: about 1 where the object's boxes err like the others.
    alternatives : list of list of Alternative, length N
        Other bodies that fit the views about as well, the most probable first; sought for cuboids only. The covariance
        holds the spread between the answers, and a warning says ``ambiguous``.
    predicted_ious : ndarray, shape (N,)
        With ``cross_validate=True``: how well the other views of an object predict the box of each of its views, the
        mean IoU with the measured boxes; NaN where the others determine no body, as with two views.
    odd_views : list of str or None, length N
        With ``cross_validate=True``: the frame whose detection the other views contradict.
    warnings : list of list of str, length N
        What makes an estimate weak.
    doubtful : list of str or None, length N
        Where identities were found: why an object may not be one standing object.
    object_indices : ndarray of int, shape (M,)
        For each detection the row of its object, -1 where it shows none.
    inliers : ndarray of bool, shape (M,)
        Which detections count for their object; the others are outliers or took no part.
    residuals : ndarray, shape (M,)
        Root mean square distances between measured and predicted edges, pixels.
    rejected_because : list of str or None, length M
        Why a detection is an outlier: ``"residual"`` (it is farther from the body than the noise explains) or
        ``"behind_camera"`` (the body does not lie wholly in front of the camera). None for all others.
    body : str
        The kind of body that was fitted, ``"mixed"`` where objects differ (see ``body_kinds``).
    noise : dict
        Noise levels that the residuals show, by name; empty for other methods than ``"map"``. Standard deviations:
        ``edge_relative`` and ``hidden_edge_relative`` as shares of half the box's size, ``edge_px`` in pixels, those of
        ellipses as shares of the mean semi-axis or of logarithms of axes. ``edge_correlation`` and
        ``ellipse_correlation`` are correlations between views that follow each other. ``edge_common`` and others that
        end so are errors that the views of an object have in common, in units of the noise; ``residual_level`` and
        ``residual_spread`` tell how much objects differ. These enter covariances only.
    cross_validation : dict or None
        How well left-out views are predicted, over the scene: `iou` (mean, of the predicted and the measured boxes),
        `edge_error` (median, relative to half the box's size), the numbers of `views` and `objects`, and the `extent`:
        ``"sample"``, or ``"all"`` with ``cross_validate=True``. None where no view can be left out.
    calibration : dict or None
        With ``calibration=...``: the number of `objects` with a known truth, the `results` and `truths`, and
        `squared_distance`: for the ``"center"``, the ``"extents"`` and the whole ``"body"`` the squared distance, in
        units of the covariance, that holds the truth with a probability of ``"0.5"``, ``"0.9"``, ``"0.95"`` and
        ``"0.99"``; None where the objects are too few. The centre is that of the reported body.
    skipped : dict
        Numbers of detections that took no part: `without_object`, `occluded_or_truncated`, `beyond_lens` (they lie
        where the lens cannot be undistorted), `without_measurement` (they lack what `measurements` asks for).
    diagnosis : dict
        Whether the scene agrees with itself: `consistent`, `score` (by how much of their half size boxes typically miss
        their object; None where no object has two boxes) and `causes`, the usual mistakes that explain it, the best
        first: `name`, `value`, `before` and `after` (the score, and the one with the mistake undone), `option` of the
        program that mends it (a keyword of `Scene.corrected` too).
    association : dict or None
        What was found about identities, where they were: `objects` (`id`, `views`, `expected_views`, `evidence` in
        nats, `doubtful`), the numbers of detections `associated`, of `clutter` (they belong to no object) and
        `skipped` (by reason), `edge_sd` (error of box edges relative to the box), `pixel_sd` and `frame_shift_sd_px`.
    problems : list of str
        Masks that could not be read.
    seconds : float
        The time that the library took, without the conversion of arrays.
    """

    def to_scene(self) -> Scene:
        """The cameras and frames with the estimates as objects, as the program writes it.

        Returns
        -------
        Scene
            Without detections, unless their identities were found.
        """
        return Scene(self._localized.to_scene())

    def report(self, path: Path, truth: Scene | None = None, *, title: str = "quadlift") -> None:
        """Writes a page that shows the result in any browser.

        Parameters
        ----------
        path : path-like
            The page, an HTML file.
        truth : Scene, optional
            A scene whose objects are the truth, shown beside the estimates, with their scores.
        title : str
            Title of the page.
        """
        of_truth = _checks.optional(_checks.scene, "truth", truth)
        self._check_output(path, of_truth)
        page = self._localized.report(_checks.text("title", title), of_truth)
        _core.write_text(path, page)

    def to_rerun(self, path: Path | None = None, *, truth: Scene | None = None) -> None:
        """Logs frames, detections and estimates with Rerun (https://rerun.io); needs its SDK.

        Parameters
        ----------
        path : path-like, optional
            A recording to write (``.rrd``); without it the current recording of Rerun gets them (``rerun.init``).
        truth : Scene, optional
            A scene whose objects are the truth, logged beside the estimates.
        """
        given = self._localized.given
        of_truth = _checks.optional(_checks.scene, "truth", truth)
        if path is not None:
            self._check_output(path, of_truth)
        recorded = self._localized.recording(given.name or "quadlift", of_truth)
        _rerun.log_recorded(recorded, given, path)

    def _check_output(self, path: Path, truth: _core.Scene | None) -> None:
        """Refuses to write over what was read."""
        for scene in (self._localized.given, truth):
            if scene is not None:
                scene.check_output(path)

    def _repr_html_(self) -> str:
        return _notebook.in_notebook(self._localized.report("quadlift", None))
