"""The object map: objects from frames that arrive one after another."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _arrays, _checks, _core, _found, _options, _rerun
from ._core import QuadliftError
from ._estimates import InconsistentSceneWarning
from ._relocalize import Location, Relocalizes
from ._scene import Estimates, Scene
from ._scene_data import frame_id as frame_id_of

if TYPE_CHECKING:
    import pandas
    from numpy.typing import ArrayLike, NDArray
    from typing_extensions import Unpack

    from ._checks import Path
    from ._cues import Boxes3d, Depths


@dataclass(frozen=True)
class FrameUpdate:
    """What a frame, or new poses, have changed in an `ObjectMap`.

    Attributes
    ----------
    objects : list of str or None
        For each detection of the frame the id of its object, such as ``"object_0001"``; None if it belongs to none so
        far.
    events : list of dict
        What happened, in this order, with the names of the stream's events (docs/formats/stream.md): ``"type"`` is
        ``"new"``, ``"confirmed"``, ``"reassigned"``, ``"merged"``, ``"removed"``, ``"returned"``, ``"disagrees"`` or
        ``"inconsistent"``; most have an ``"object"``.
    """

    objects: list[str | None]
    events: list[dict[str, Any]]


@dataclass(frozen=True, eq=False)
class MapObject:
    """An object of an `ObjectMap`.

    Attributes
    ----------
    id : str
        Its id, such as ``"object_0001"``.
    presence : str
        ``"tentative"``, ``"confirmed"`` or ``"gone"``.
    existence : float
        Probability that it exists and is where it is.
    evidence : float
        Evidence of its kept views against clutter (nats).
    center, half_extents : ndarray, shape (3,)
        Center and half extents of the map's quick fit, an ellipsoid, world units; `ObjectMap.objects` has better
        estimates with kinds and covariances.
    quaternion : ndarray, shape (4,)
        Its rotation, world from object: a unit quaternion, w first.
    first_seen, last_seen : float
        Times of its first and last detection, seconds.
    detections, expected_views, kept_views : int
        Number of its detections, of frames in which it should be visible, and of views that the map keeps.
    categories : dict
        Share of its detections in each category (None: without one), the most frequent first.
    """

    id: str
    presence: str
    existence: float
    evidence: float
    center: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    first_seen: float
    last_seen: float
    detections: int
    expected_views: int
    kept_views: int
    categories: dict[str | None, float]

    @property
    def category(self) -> str | None:
        """The most frequent category of its detections."""
        return next(iter(self.categories), None)


@dataclass(frozen=True, eq=False, repr=False)
class MapObjects:
    """N objects of an `ObjectMap` as arrays, whose rows are described in `MapObject`.

    Attributes
    ----------
    ids : ndarray of str, shape (N,)
        In ascending order.
    presence : ndarray of str, shape (N,)
    existence, evidence : ndarray, shape (N,)
    centers, half_extents : ndarray, shape (N, 3)
    quaternions : ndarray, shape (N, 4)
    first_seen, last_seen : ndarray, shape (N,)
    detections, expected_views, kept_views : ndarray of int, shape (N,)
    categories : list of dict, length N
    """

    ids: NDArray[np.str_]
    presence: NDArray[np.str_]
    existence: NDArray[np.float64]
    evidence: NDArray[np.float64]
    centers: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    quaternions: NDArray[np.float64]
    first_seen: NDArray[np.float64]
    last_seen: NDArray[np.float64]
    detections: NDArray[np.int64]
    expected_views: NDArray[np.int64]
    kept_views: NDArray[np.int64]
    categories: list[dict[str | None, float]]

    @classmethod
    def _of(cls, found: dict[str, Any]) -> MapObjects:
        shapes = {"centers": 3, "half_extents": 3, "quaternions": 4}
        for name, width in shapes.items():
            found[name] = found[name].reshape(-1, width)
        found["ids"] = np.array(found.pop("object_ids"), dtype=np.str_)
        found["presence"] = np.array(found["presence"], dtype=np.str_)
        found["categories"] = [dict(categories) for categories in found["categories"]]
        return cls(**found)

    def __len__(self) -> int:
        """Number of objects."""
        return len(self.ids)

    def __repr__(self) -> str:
        return f"<quadlift.MapObjects: {len(self)} objects>"

    def __iter__(self) -> Iterator[MapObject]:
        """The objects."""
        return (self[row] for row in range(len(self)))

    def __getitem__(self, row: int) -> MapObject:
        """The object of a row."""
        return MapObject(
            id=str(self.ids[row]),
            presence=str(self.presence[row]),
            existence=float(self.existence[row]),
            evidence=float(self.evidence[row]),
            center=self.centers[row],
            half_extents=self.half_extents[row],
            quaternion=self.quaternions[row],
            first_seen=float(self.first_seen[row]),
            last_seen=float(self.last_seen[row]),
            detections=int(self.detections[row]),
            expected_views=int(self.expected_views[row]),
            kept_views=int(self.kept_views[row]),
            categories=self.categories[row],
        )

    def to_pandas(self) -> pandas.DataFrame:
        """A table with one row per object; needs pandas.

        Returns
        -------
        pandas.DataFrame
            Columns `object`, `category` (the most frequent one), `presence`, `existence`, `evidence`, `center_x` to
            `center_z`, `half_extent_1` to `_3`, `qw`, `qx`, `qy`, `qz`, `first_seen`, `last_seen`, `detections`,
            `expected_views`, `kept_views`.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError("to_pandas needs pandas: pip install pandas") from error
        categories = [next(iter(shares), None) for shares in self.categories]
        columns: dict[str, Any] = {"object": self.ids, "category": categories}
        columns |= {name: getattr(self, name) for name in ("presence", "existence", "evidence")}
        columns |= {f"center_{name}": self.centers[:, k] for k, name in enumerate("xyz")}
        columns |= {f"half_extent_{k + 1}": self.half_extents[:, k] for k in range(3)}
        columns |= {name: self.quaternions[:, k] for k, name in enumerate(("qw", "qx", "qy", "qz"))}
        names = ("first_seen", "last_seen", "detections", "expected_views", "kept_views")
        columns |= {name: getattr(self, name) for name in names}
        return pd.DataFrame(columns)


class ObjectMap(Relocalizes):
    """A map of objects that is updated frame by frame, like that of ``quadlift stream``.

    Each frame has a pose and the detections of an image; object ids are not needed. The map answers which detection
    shows which object, which objects are new, certain, merged or gone, and where each object is. The same frames give
    the same map; time is that of the frames.

    Methods may be called from several threads; calls come one after another. They release the GIL.

    Parameters
    ----------
    **options : ObjectMapOptions
        ``name``, ``up``, ``length_unit``, ``ids``, ``min_views``, ``min_score``, ``edge_noise_px``, ``priors``,
        ``max_views``, ``max_objects``, ``pose_noise``: `quadlift.ObjectMapOptions` describes them.

    Raises
    ------
    QuadliftError
        Names the argument, what was found and what was expected.
    """

    def __init__(self, **options: Unpack[_options.ObjectMapOptions]) -> None:
        self._set_core(_core.ObjectMap(_options.of_map(options)))

    def _set_core(self, core: _core.ObjectMap) -> None:
        self._core = core
        self._changes = 0
        self._estimates: tuple[int, Estimates] | None = None

    @classmethod
    def _of(cls, core: _core.ObjectMap) -> ObjectMap:
        made = cls.__new__(cls)
        made._set_core(core)
        return made

    # Frames

    def observe(
        self,
        frame_id: str | int,
        detections: Any = None,
        *,
        time: float,
        intrinsics: ArrayLike | None = None,
        distortion: ArrayLike | None = None,
        cam_from_world: ArrayLike | None = None,
        projection: ArrayLike | None = None,
        camera: str | Mapping[str, Any] | Any = None,
        image_size: ArrayLike | None = None,
        image: str | None = None,
        pose_noise: tuple[float, float] | None = None,
        boxes: ArrayLike | None = None,
        categories: ArrayLike | None = None,
        scores: ArrayLike | None = None,
        objects: ArrayLike | None = None,
        outlines: Sequence[ArrayLike | None] | None = None,
        oriented_boxes: ArrayLike | None = None,
        depths: Depths | ArrayLike | None = None,
        boxes3d: Boxes3d | None = None,
    ) -> FrameUpdate:
        """Observes a frame: which detection shows which object, and what has changed.

        Parameters
        ----------
        frame_id : str or int
            Name of the frame, which differs from those of all frames that the map keeps.
        detections : supervision.Detections or ultralytics.engine.results.Results, optional
            The detections of the frame; boxes, classes, scores and track ids are used. Give either these or `boxes`.
        time : float
            Seconds from any origin. Times may repeat but never go back.
        intrinsics : array_like, shape (3, 3), optional
            Pinhole camera in pixels.
        distortion : array_like, optional
            OpenCV's coefficients of the lens: k1, k2, p1, p2, optionally k3, or k3, k4, k5, k6.
        cam_from_world : array_like, shape (3, 4) or (4, 4), optional
            Pose ``[R | t]``, world to camera, OpenCV's axes.
        projection : array_like, shape (3, 4), optional
            World to pixels, instead of camera and pose.
        camera : mapping, pycolmap.Camera or str, optional
            Instead of `intrinsics`: a camera as in scene files, ``{"model": "OPENCV_FISHEYE", "params": [...], "width":
            ..., "height": ...}``, or the ``"id"`` that such a camera had in an earlier frame.
        image_size : array_like, shape (2,), optional
            Width and height in pixels. Without it box edges at the image border are not treated as cut off.
        image : str, optional
            Path of the image, for reports.
        pose_noise : (float, float), optional
            Standard deviations of the pose of this frame: rotation (radians) and shift (world units).
        boxes : array_like, shape (M, 4), optional
            ``[x0, y0, x1, y1]`` in pixels of the image, with lens distortion; ``[]`` if nothing was detected.
        categories : array_like of int or str, shape (M,), optional
            Categories, by number or name; negative numbers, None and "" mean unknown.
        scores : array_like, shape (M,), optional
            Scores of the detector; NaN means none.
        objects : array_like of int or str, shape (M,), optional
            Ids of a tracker; unknown ones as for categories.
        outlines, oriented_boxes, depths, boxes3d : optional
            Outlines, oriented boxes, depths and 3D boxes of the M detections, as in `Scene.with_detections`. The map
            keeps them with its views, for `localize`. With an outline or an oriented box the row of `boxes` may be NaN,
            or all of `boxes` missing.

        Warns
        -----
        InconsistentSceneWarning
            Once, when the frames so far turn out to be inconsistent (see `consistent`).

        Raises
        ------
        QuadliftError
            Names the frame and the detection or argument, what was found and what was expected. The map is unchanged.
        """
        frame_id = frame_id_of("frame_id", frame_id)
        try:
            if detections is None and boxes is None and (outlines is not None or oriented_boxes is not None):
                boxes = np.full((len(np.asarray(oriented_boxes)) if outlines is None else len(outlines), 4), np.nan)
            found = _found_in_frame(detections, boxes, categories, scores, objects)
            frame = _arrays.map_frame(
                frame_id,
                time=time,
                intrinsics=intrinsics,
                distortion=distortion,
                cam_from_world=cam_from_world,
                projection=projection,
                camera=camera,
                image_size=image_size,
                image=image,
                pose_noise=pose_noise,
            )
            found.depths, found.boxes3d = depths, boxes3d
            found.outlines = found.outlines if outlines is None else outlines
            found.oriented_boxes = found.oriented_boxes if oriented_boxes is None else oriented_boxes
            arrays = _arrays.map_detections(found)
        except QuadliftError as error:
            raise QuadliftError(f'frame "{frame_id}": {error}') from error
        return self._changed(self._core.observe(frame, arrays))

    def _relocalized(self, query: _arrays.LocateQuery) -> Location:
        found, ids = self._core.relocalize(query)
        return Location._of(found, lambda row: ids[row])

    def update_poses(
        self,
        frame_ids: Sequence[str | int],
        *,
        cam_from_world: ArrayLike | None = None,
        projections: ArrayLike | None = None,
    ) -> FrameUpdate:
        """Moves frames, for example after a loop closure; objects follow the frames that show them.

        Objects that then coincide are merged. No old detection is needed.

        Parameters
        ----------
        frame_ids : sequence of str or int, length F
            The frames; those that the map no longer keeps (see `kept_frames`) are skipped.
        cam_from_world : array_like, shape (F, 3, 4) or (F, 4, 4), optional
            Their new poses.
        projections : array_like, shape (F, 3, 4), optional
            Their new projections, for frames that were given one.

        Returns
        -------
        FrameUpdate
            Without objects.
        """
        if isinstance(frame_ids, str):
            raise QuadliftError(f"frame_ids is {frame_ids!r}; expected a list of frames")
        ids = [frame_id_of(f"frame_ids[{k}]", name) for k, name in enumerate(frame_ids)]
        return self._changed(self._core.update_poses(ids, *_arrays.map_poses(ids, cam_from_world, projections)))

    def settle(self) -> FrameUpdate:
        """Assigns the boxes of the last 24 frames once more and checks them, for the end of a stream.

        ``quadlift stream`` does this before it writes the map. If frames may follow, settle a `copy`.

        Returns
        -------
        FrameUpdate
            Without objects; detections that changed their object are in the events.
        """
        return self._changed(self._core.settle())

    def _changed(self, line: str) -> FrameUpdate:
        """What a line of the stream's output says."""
        self._changes += 1
        record = json.loads(line)
        for event in record["events"]:
            if event["type"] == "inconsistent":
                # Attributed to the line that calls `observe`, `update_poses` or `settle`.
                text = f"the scene is inconsistent: {event['message']}"
                warnings.warn(text, InconsistentSceneWarning, stacklevel=3)
        return FrameUpdate(objects=record.get("objects", []), events=record["events"])

    # Objects

    @property
    def objects(self) -> Estimates:
        """Estimates of all confirmed and gone objects from their kept views, in the order of their ids.

        They are computed when they are asked for, and again after the map has changed; `localize` takes options.
        `memory` is quicker: the map's own fits.
        """
        changes = self._changes
        if self._estimates is None or self._estimates[0] != changes:
            self._estimates = (changes, self._localized({}))
        return self._estimates[1]

    def localize(self, **options: Unpack[_options.Options]) -> Estimates:
        """Localizes all confirmed and gone objects from their kept views, like ``quadlift stream --map``.

        Parameters
        ----------
        **options : Options
            As in `quadlift.localize`, but `associate`, `ids`, `source`, `priors` and `pose_noise`; the last two are
            those of the map.

        Returns
        -------
        Estimates
            In the order of their ids. `Estimates.to_scene` has the detections that the map keeps, too.
        """
        return self._localized(options)

    def _localized(self, options: _options.Options) -> Estimates:
        keywords, threads, progress = _options.split_of_map(options, json.loads(self._core.options_json))
        # Attributed to the line that calls `localize` or reads `objects`.
        return Estimates._of(self._core.localize(keywords, threads, progress), "map")._warned(3)

    def memory(self, *, tentative: bool = False) -> MapObjects:
        """What the map knows of its objects: presence, existence, when they were seen, categories, and quick fits.

        Parameters
        ----------
        tentative : bool
            Include objects that may still be clutter.
        """
        return MapObjects._of(self._core.memory(None, _checks.flag("tentative", tentative)))

    def object(self, id: str) -> MapObject:
        """What the map knows of an object, or of the one that it was merged into."""
        return MapObjects._of(self._core.memory([_checks.text("id", id)], True))[0]

    def resolve(self, id: str) -> str | None:
        """The id of the object that an object was merged into, or its own; None if the map has none."""
        return self._core.resolve(_checks.text("id", id))

    def merge(self, first: str, second: str) -> str:
        """Merges two objects that are known to be one.

        Returns
        -------
        str
            The id that stays, the older one; the other one becomes an alias of it.
        """
        kept = self._core.merge(_checks.text("first", first), _checks.text("second", second))
        self._changes += 1
        return kept

    def remove(self, id: str) -> None:
        """Removes an object. Its id is not used again."""
        self._core.remove(_checks.text("id", id))
        self._changes += 1

    def to_scene(self) -> Scene:
        """The objects with the frames and detections that the map keeps: the file of ``quadlift stream --map``."""
        return self.objects.to_scene()

    # Rerun

    def log_rerun(self, image: Any = None) -> None:
        """Logs the last frame, and what has changed since the last call, to the current recording of Rerun.

        Needs Rerun's SDK and a recording: ``rerun.init("video", spawn=True)`` opens the viewer, ``rerun.save`` writes a
        file. Shown are the camera, the boxes in the colors of their objects, the confirmed objects and the events;
        objects that are gone vanish. The entities are those of ``quadlift stream --rerun``; the timelines ``frame`` and
        ``time`` stay at the frame, for what else there is to log of it.

        Parameters
        ----------
        image : array_like of uint8, shape (H, W) or (H, W, 3), optional
            The image of the frame: gray, or red, green, blue; or its path, or what ``rerun.log`` takes. The default is
            the file that `observe` was given as `image`, if it is a PNG or JPEG file.

        Raises
        ------
        QuadliftError
            If Rerun has no recording, or if the image is none.
        """
        _rerun.log_map(self._core, image)

    # Files

    def save(self, path: Path) -> None:
        """Writes the whole state of the map, as ``quadlift stream --state`` does.

        An existing file is replaced once the new one is complete.
        """
        self._core.save(path)

    @classmethod
    def load(cls, path: Path) -> ObjectMap:
        """Reads the state of a map, which goes on exactly as the saved one would have.

        Parameters
        ----------
        path : path-like
            A file of `save` or of ``quadlift stream --state``. Options are in it; priors of a file are read again.

        Raises
        ------
        QuadliftError
            Names the file and the problem.
        """
        return cls._of(_core.ObjectMap.load(path))

    def copy(self) -> ObjectMap:
        """A map of its own with the same state."""
        return type(self)._of(self._core.copy())

    def __copy__(self) -> ObjectMap:
        return self.copy()

    def __deepcopy__(self, memo: Any) -> ObjectMap:
        return self.copy()

    def __reduce__(self) -> Any:
        return _read_again, (type(self), self._core.to_bytes())

    # Contents

    def __len__(self) -> int:
        """Number of objects, confirmed and gone."""
        confirmed, gone, _ = self._core.counts
        return confirmed + gone

    def __bool__(self) -> bool:
        # Also without objects.
        return True

    def __contains__(self, id: Any) -> bool:
        """Whether there is an object of this id, or one that it was merged into."""
        return isinstance(id, str) and self.resolve(id) is not None

    def __repr__(self) -> str:
        confirmed, gone, frames = self._core.counts
        lost = f" and {gone} gone ones" if gone else ""
        return f"<quadlift.ObjectMap: {confirmed} objects{lost} after {frames} frames>"

    def _repr_html_(self) -> str:
        return self.objects._repr_html_()

    @property
    def consistent(self) -> bool | None:
        """Whether poses, cameras and boxes are consistent; None if nothing could be checked so far.

        The last frames are checked from time to time (after 30 frames, then every 40) and by `settle`. When they turn
        out to be inconsistent, there is an ``"inconsistent"`` event and an `InconsistentSceneWarning` with the cause;
        no object of `localize` is ``"ok"`` then.
        """
        return self._core.consistent

    @property
    def frame_count(self) -> int:
        """Number of observed frames."""
        return self._core.counts[2]

    @property
    def last_frame(self) -> tuple[str, float] | None:
        """Id and time of the last frame."""
        return self._core.last_frame

    @property
    def kept_frames(self) -> list[str]:
        """Ids of the frames that the map keeps: those whose new poses `update_poses` needs."""
        return self._core.kept_frames

    @property
    def length_unit(self) -> str | None:
        """World unit."""
        return self._core.length_unit


def _read_again(cls: type[ObjectMap], state: bytes) -> ObjectMap:
    """A map that was pickled."""
    return cls._of(_core.ObjectMap.parse(state))


def _found_in_frame(
    detections: Any,
    boxes: ArrayLike | None,
    categories: ArrayLike | None,
    scores: ArrayLike | None,
    objects: ArrayLike | None,
) -> _found.Found:
    """The detections of either kind of arguments."""
    if detections is None:
        if boxes is None:
            raise QuadliftError("expected detections or boxes; found none of them (boxes=[] if nothing was detected)")
        return _found.Found(boxes, scores, categories, objects)
    arrays = {"boxes": boxes, "categories": categories, "scores": scores, "objects": objects}
    for name, value in arrays.items():
        if value is not None:
            raise QuadliftError(f"expected either detections or arrays; found detections and {name}")
    return _found.of_any(detections)
