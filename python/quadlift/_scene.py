"""Scenes and their estimates."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from . import _checks, _core, _estimates, _fiftyone, _notebook, _options, _rerun
from ._adapters import FromOtherPackages
from ._align import Alignment
from ._estimates import EstimateArrays
from ._formats import ExportOptions
from ._relocalize import Location, Relocalizes
from ._scene_data import frame_id

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from typing_extensions import Unpack

    from ._arrays import LocateQuery
    from ._checks import Path


class Scene(FromOtherPackages):
    """Posed frames with detections and objects (ground truth or estimates). Immutable.

    Make one with `read`, `from_arrays`, `from_cameras`, `from_detections`, `from_supervision`, `from_ultralytics` or
    `from_fiftyone`. Invalid arguments and files raise `QuadliftError`, which names the argument
    or file, what was found and what was expected.
    """

    # Operations

    def localize(self, **options: Unpack[_options.Options]) -> Estimates:
        """Localizes the objects like the program; see `quadlift.localize` for the options.

        Returns
        -------
        Estimates
            In the order of the objects' first detections.
        """
        keywords, threads, progress = _options.split(options, "Scene.localize")
        return Estimates._of(self._core.localize(keywords, threads, progress))._warned(2)

    def diagnose(self, *, source: str | None = None) -> dict[str, Any]:
        """Checks whether poses, cameras and boxes are consistent, and if not, which common mistake explains it.

        If most detections have no object id, they are associated for it (up to 5000 of them; beyond that, check
        ``associate()[0]``).

        Parameters
        ----------
        source : str, optional
            Use only the detections of this source; required if the scene has several.

        Returns
        -------
        dict
            As `Estimates.diagnosis`. `consistent` is None if nothing was checked: no object has two boxes.
        """
        text = self._core.diagnosis(_checks.optional(_checks.text, "source", source))
        return _estimates.read_diagnosis(json.loads(text))

    def corrected(self, assume: str = "", *, up: str | ArrayLike | None = None, fix: bool = False) -> Scene:
        """The scene with corrections of common mistakes applied.

        Parameters
        ----------
        assume : str
            What the inputs really are, as with the program's ``--assume``: ``"poses=opengl,boxes=xywh"``. `docs/cli.md`
            lists the keys and their values.
        up : str or array_like, shape (3,), optional
            World direction against gravity: an axis such as ``"-y"``, or a direction.
        fix : bool
            Whether what `diagnose` finds is corrected then, too, until the scene is consistent (3 times at most).

        Returns
        -------
        Scene
            Without detections that no longer belong to a frame.
        """
        return Scene(self._core.corrected(_checks.text("assume", assume), _options.up(up), _checks.flag("fix", fix)))

    def segment(self, **options: Unpack[_options.SegmentOptions]) -> Scene:
        """Segments the detections in the images and fits ellipses to the masks, like the program.

        The crops of an object from all its frames are segmented jointly. An unreliable mask is replaced by the ellipse
        in the box. `localize` uses the ellipses, or the masks with ``measurement="mask"``.

        Parameters
        ----------
        **options
            ``method`` ("graphcut": graph cuts; "sca": Stel Component Analysis, the paper's method; "masks": the
            existing masks of the detections), ``source``, ``seed``, ``out_masks``, ``threads``,
            ``progress``: `SegmentOptions`.

        Returns
        -------
        Scene
            The scene with ellipses, masks and their confidence in the detections.

        Raises
        ------
        QuadliftError
            If no detection could be segmented.

        Warns
        -----
        UserWarning
            For problems of single detections (such as an image that cannot be read).
        """
        keywords, threads, progress = _options.split_of_segmentation(options)
        scene, problems = self._core.segment(keywords, threads, progress)
        for problem in problems:
            warnings.warn(problem, stacklevel=2)
        return Scene(scene)

    def associate(
        self, **options: Unpack[_options.AssociateOptions]
    ) -> tuple[Scene, list[_estimates.AssociatedObject]]:
        """Associates detections that show the same object.

        Parameters
        ----------
        **options
            ``ids`` ("evidence", "trust" or "ignore"), ``source``, ``thorough``, ``min_views``, ``min_score``,
            ``max_overlap``, ``edge_noise_px``, ``priors``, ``threads``, ``progress``: `AssociateOptions`.

        Returns
        -------
        scene : Scene
            The scene with the ids of these objects in the detections.
        objects : list of AssociatedObject
            The objects, in the order of their first detections.

        Raises
        ------
        QuadliftError
            If no object was found, with the reason, or if an option is invalid.
        """
        keywords, threads, progress = _options.split_of_association(options)
        scene, objects = self._core.associate(keywords, threads, progress)
        return Scene(scene), [_estimates.AssociatedObject(*found) for found in objects]

    def evaluate(
        self, truth: Scene, *, match: Literal["auto", "ids", "overlap"] = "auto", source: str | None = None
    ) -> _estimates.Evaluation:
        """Scores the objects of this scene (a result, see `Estimates.to_scene`) against ground truth.

        If both scenes have detections and those of the truth have object ids, the association is scored too; without
        objects in both scenes only the association is scored.

        Parameters
        ----------
        truth : Scene
            A scene with objects, or with object ids of its detections.
        match : {"auto", "ids", "overlap"}
            How to pair estimates with true objects; ``"auto"``: by ids if any are shared, otherwise by overlap.
        source : str, optional
            Score the association of this source only.

        Raises
        ------
        QuadliftError
            If there is nothing to compare.
        """
        source = _checks.optional(_checks.text, "source", source)
        scores = self._core.evaluate(_checks.scene("truth", truth), _checks.text("match", match), source)
        return _estimates.Evaluation(**json.loads(scores))

    def align(
        self,
        other: Scene,
        *,
        scale: Literal["auto", "rigid", "estimated"] = "auto",
        use_up: bool = True,
        up_sd_deg: float = 2.0,
    ) -> Alignment:
        """Where another map lies in this one, from the objects of both alone, like `quadlift align`.

        Categories, sizes and distances of objects are compared; ids, images and appearance are not used.

        Parameters
        ----------
        other : Scene
            The map that is moved: a scene with objects, such as `Estimates.to_scene()`.
        scale : {"auto", "rigid", "estimated"}
            ``"auto"``: from the units of the scenes where both have a known `length_unit`, otherwise estimated;
            ``"rigid"``: from the units, otherwise 1.
        use_up : bool
            Whether `up` of the scenes is used where both have it.
        up_sd_deg : float
            Standard deviation of the angle between the two, degrees.

        Returns
        -------
        Alignment
            With the merged map, whose objects `localize` finds again from the detections of both, if they have any.

        Warns
        -----
        InconsistentSceneWarning
            Units or `up` of the maps contradict their objects, or one of them is mirrored.

        Raises
        ------
        QuadliftError
            If an object is invalid.
        """
        up_sd = math.radians(_checks.number("up_sd_deg", up_sd_deg))
        if up_sd <= 0:
            raise _core.QuadliftError(f"up_sd_deg is {up_sd_deg}; expected a number above 0")
        up = up_sd if _checks.flag("use_up", use_up) else None
        found, merged = self._core.align(_checks.scene("other", other), _checks.text("scale", scale), up)
        alignment = Alignment._of(json.loads(found), None if merged is None else Scene(merged))
        if not alignment.consistent:
            why = {
                "scale": "their units contradict the objects",
                "up": "their `up` contradict the objects",
                "mirrored": "the mirror image of the other one fits clearly better",
            }[alignment.contradiction or "scale"]
            text = f"the maps are inconsistent: {why}"
            warnings.warn(text, _estimates.InconsistentSceneWarning, stacklevel=2)
        return alignment


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(EstimateArrays, Relocalizes):
    """Estimates of N objects from M detections.

    Arrays with a row for each object; also a sequence of `Estimate`: ``estimates[0]``, ``estimates[-3:]``, or by the id
    of the object as text, ``estimates["cup_1"]``. Missing values are NaN. There is a body if the status is ``"ok"`` or
    ``"inconsistent"``.

    Attributes
    ----------
    object_ids : ndarray, shape (N,)
        The objects: whole numbers or texts, as given. In ascending order if given as an array; otherwise in the order
        of their first detections.
    categories : list of str or None, length N
        The most frequent category of the object's detections.
    status : ndarray of str, shape (N,)
        ``"ok"``, ``"inconsistent"``, ``"undetermined"``, ``"not_an_ellipsoid"``, ``"too_few_views"``, ``"degenerate"``
        or ``"diverged"``.
    centers : ndarray, shape (N, 3)
        Centers in the world, if known.
    kinds : list of str or None, length N
        The kind of body of each object: ``"ellipsoid"``, ``"cuboid"``, ``"cylinder"`` or ``"rounded:R"`` (R from 0,
        cuboid, to 1, ellipsoid).
    half_extents : ndarray, shape (N, 3)
        Half the extents of the bodies along their axes, world units: the semi-axes of an ellipsoid or rounded body;
        the two radii and half the height of a cylinder, whose axis is the third.
    half_extents_sd : ndarray, shape (N, 3)
        Their standard deviations.
    quaternions : ndarray, shape (N, 4)
        Rotations of the objects, world from object: unit quaternions, w first.
    rotations : ndarray, shape (N, 3, 3)
        The same as matrices, whose columns are the axes in the order of ``half_extents``.
    rotation_sd_deg : ndarray, shape (N, 2)
        Standard deviations of the rotations, degrees: about the vertical, and away from it (each way). Without ``up``
        both are the root mean square over all axes.
    yaw_deg : ndarray, shape (N,)
        Angles about ``up`` from the x axis of the world (z, where x is steep) to the longer horizontal axes, degrees in
        (-90, 90]; NaN without ``up``.
    bounds_centers, bounds_half_extents, bounds_half_extents_sd : ndarray, shape (N, 3)
        The boxes around the objects: centers, half the extents along the axes, and their standard deviations. Parts of
        an object may lie outside of its body, and inside of its bounds.
    bounds_quaternions : ndarray, shape (N, 4)
        Their rotations: upright with ``up`` where objects stand; else, and of cuboids and cylinders, those of the
        bodies.
    covariances : ndarray, shape (N, 9, 9)
        Covariances, in ``covariance_coordinates``.
    covariance_coordinates : list of str or None, length N
        ``"center_vech_shape"`` (center, and vech of the shape matrix) for ellipsoids, otherwise
        ``"center_rotation_log_axes"``.
    center_sd : ndarray, shape (N,)
        Standard deviations of the centers per coordinate, world units.
    views_used : ndarray of int, shape (N,)
        Numbers of used views.
    rms_residuals : ndarray, shape (N,)
        Root mean square residuals of the used views, pixels.
    relative_residuals : ndarray, shape (N,)
        Root mean square residuals of the used views per degree of freedom, relative to half the size of the boxes; NaN
        for other methods than ``"posterior"``.
    normalized_residuals : ndarray, shape (N,)
        The same in standard deviations of the scene's noise: about 1 for objects with typical noise.
    alternatives : list of list of Alternative, length N
        Other bodies that fit the views about as well, the most probable first; for cuboids only. The covariance
        includes the spread between them, and there is a warning ``ambiguous``.
    predicted_ious : ndarray, shape (N,)
        With ``cross_validate=True``: the mean IoU between measured boxes and those predicted from the other views of
        the object; NaN if the other views determine no body, as with two views.
    suspect_views : list of str or None, length N
        With ``cross_validate=True``: the frame whose detection the other views contradict.
    warnings : list of list of str, length N
        Reasons why an estimate is weak.
    uncertain : list of str or None, length N
        After association: why an object may be moving or be several objects.
    object_indices : ndarray of int, shape (M,)
        For each detection the row of its object, -1 if it has none.
    inliers : ndarray of bool, shape (M,)
        Which detections are used; the others are outliers or were skipped.
    residuals : ndarray, shape (M,)
        Root mean square distances between measured and predicted edges, pixels.
    rejection_reason : list of str or None, length M
        Why a detection is an outlier: ``"residual"`` (its residual is much larger than the noise) or
        ``"behind_camera"`` (the body is not entirely in front of the camera). None for all others.
    body : str
        The fitted kind of body, ``"mixed"`` if objects differ (see ``kinds``).
    noise : dict
        Estimated noise levels by name; empty for methods other than ``"posterior"``. Standard deviations:
        ``edge_noise`` and ``occluded_edge_noise`` relative to half the size of the box, ``edge_noise_px`` in pixels,
        those of ellipses relative to the mean semi-axis or of logarithms of axes. ``edge_correlation`` and
        ``ellipse_correlation`` are correlations between consecutive views. ``edge_common`` and others with this
        ending are errors common to the views of an object, in units of the noise; ``residual_level`` and
        ``residual_spread`` describe differences between objects. These affect covariances only. Of scenes of boxes
        there are also ``opposite_edge_correlation`` (1 where boxes are shifted, -1 where they are scaled), shares
        (``wrong_box_share``, ``cuboid_share``, ``upright_share``, ...) and the levels of systematic errors
        (``direction_error``, ``side_error``, ``drift_error``, relative to half the size of the box).
    cue_scales : list of dict
        What the sources of depths and 3D boxes are wrong by: ``source`` (None: unnamed), ``quantity`` (``"depth"``,
        ``"box3d_distance"``, ``"box3d_length"``, ``"box3d_width"``, ``"box3d_height"``, the last three with a
        ``category``), ``factor`` of measured to true and ``log_sd``, the standard deviation of its logarithm. Depths
        may have ``shift`` and ``shift_sd``, in the lengths of the source: measured = factor * true + shift. Empty
        without cues and with given `noise_model`.
    cross_validation : dict or None
        How well left-out views are predicted, over the scene: `iou` (mean, between predicted and measured boxes),
        `edge_error` (median, relative to half the size of the box), the numbers of `views` and `objects`, and the
        `extent`: ``"sample"``, or ``"all"`` with ``cross_validate=True``. None if no view can be left out.
    coverage : dict or None
        With ``coverage=...``: the number of `objects` with ground truth, the `results` and `truths`, and
        `squared_distance`: for the ``"center"``, the ``"extents"`` and the whole ``"body"`` the squared Mahalanobis
        distance that contains the truth with a probability of ``"0.5"``, ``"0.9"``, ``"0.95"`` and ``"0.99"``; None if
        there are too few objects. The center is that of the reported body.
    skipped : dict
        Numbers of skipped detections: `without_object`, `occluded_or_truncated`, `beyond_lens` (where the lens cannot
        be undistorted), `without_measurement` (without the measurement that `measurement` selects).
    diagnosis : dict
        The consistency check: `consistent` (None if it was not checked, as no object has two boxes), `score` (the
        typical distance by which boxes miss their object, in half sizes; None if not checked) and `causes`, the common
        mistakes that explain an inconsistency, the best first: `name`, `value`, `before` and `after` (the score before
        and after correction), `option` of the program that corrects it (the warning names the call).
    association : dict or None
        The result of association, if it was run: `objects` (`id`, `views`, `expected_views`, `evidence` in nats,
        `uncertain`), the numbers of detections `associated`, of `clutter` (unassigned) and `skipped` (by reason),
        `edge_noise` (error of box edges relative to the box), `edge_noise_px` and `frame_shift_sd_px`.
    problems : list of str
        Masks that could not be read.
    seconds : float
        Run time of the library, without the conversion of arrays.
    """

    def _relocalized(self, query: LocateQuery) -> Location:
        found, ids = self._localized.relocalize(query)
        of_text = {str(object_id): object_id for object_id in self.object_ids}
        return Location._of(found, lambda row: of_text[ids[row]])

    def corrected(self, assume: str = "", *, up: str | ArrayLike | None = None, fix: bool = False) -> Scene:
        """The scene that was localized with corrections, for another `localize`: see `Scene.corrected`."""
        return Scene(self._localized.given).corrected(assume, up=up, fix=fix)

    def to_scene(self) -> Scene:
        """A scene with cameras, frames, the used detections, and the estimates as objects, as written by the program.

        Detections are those of the used source, without masks, with the ids of their objects.
        """
        return Scene(self._localized.to_scene())

    def report(self, path: Path, truth: Scene | None = None, *, title: str = "quadlift") -> None:
        """Writes an HTML report of the result.

        Parameters
        ----------
        path : path-like
            The HTML file.
        truth : Scene, optional
            A scene with the true objects, shown with the estimates and scores.
        title : str
            Title of the report.
        """
        of_truth = _checks.optional(_checks.scene, "truth", truth)
        self._check_output(path, of_truth)
        page = self._localized.report(_checks.text("title", title), of_truth)
        _core.write_text(path, page)

    def render(
        self,
        frame: str | int,
        path: Path,
        *,
        labels: bool = False,
        source: str | None = None,
        truth: Scene | None = None,
    ) -> None:
        """Draws a frame with its detections and the outlines of the estimates, like ``quadlift render``.

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
        truth : Scene, optional
            A scene with the true objects, drawn as dotted outlines.
        """
        frame, source = frame_id("frame", frame), _checks.optional(_checks.text, "source", source)
        of_truth = _checks.optional(_checks.scene, "truth", truth)
        self._localized.render(frame, path, _checks.flag("labels", labels), source, of_truth)

    def export(self, format: str, path: Path, **options: Unpack[ExportOptions]) -> list[str]:
        """Writes the estimates in a format of another program; see `Scene.export`."""
        return self.to_scene().export(format, path, **options)

    def to_rerun(self, path: Path | None = None, *, truth: Scene | None = None) -> None:
        """Logs frames, detections and estimates to Rerun (https://rerun.io); needs its SDK.

        Parameters
        ----------
        path : path-like, optional
            A recording file to write (``.rrd``); without it, logs to the current recording (``rerun.init``).
        truth : Scene, optional
            A scene with the true objects, logged with the estimates.
        """
        given = self._localized.given
        of_truth = _checks.optional(_checks.scene, "truth", truth)
        if path is not None:
            self._check_output(path, of_truth)
        recorded = self._localized.recording(given.name or "quadlift", of_truth)
        _rerun.log_recorded(recorded, given, path)

    def to_fiftyone(self) -> Any:
        """The objects as 3D detections of FiftyOne (https://docs.voxel51.com), for a 3D sample; needs its package.

        Each object with a body is a `fiftyone.Detection` with `label` (the category, or ``"object"``), `location` (the
        center), `dimensions` (twice the half extents) and `rotation` (angles in radians about x, y and z,
        applied in this order to the axes of the object), in world coordinates; further attributes are `object_id`,
        `status`, `center_sd` and `views_used`.

        Returns
        -------
        fiftyone.Detections
        """
        with_body = np.flatnonzero(np.isfinite(self.centers).all(axis=1) & np.isfinite(self.half_extents).all(axis=1))
        angles = _fiftyone.euler_angles(self.rotations[with_body])
        return _fiftyone.detections(
            {
                "label": self.categories[row] or "object",
                "location": self.centers[row].tolist(),
                "dimensions": (2.0 * self.half_extents[row]).tolist(),
                "rotation": angle.tolist(),
                "object_id": str(self.object_ids[row]),
                "status": str(self.status[row]),
                "center_sd": float(self.center_sd[row]) if np.isfinite(self.center_sd[row]) else None,
                "views_used": int(self.views_used[row]),
            }
            for row, angle in zip(with_body, angles, strict=True)
        )

    def _check_output(self, path: Path, truth: _core.Scene | None) -> None:
        """Raises an error if an input would be overwritten."""
        for scene in (self._localized.given, truth):
            if scene is not None:
                scene.check_output(path)

    def _repr_html_(self) -> str:
        return _notebook.in_notebook(self._localized.report("quadlift", None))
