"""Results of localization, association and evaluation."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from . import _core

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from numpy.typing import NDArray
    from typing_extensions import Self

_SHAPES = {
    "centers": (3,),
    "half_extents": (3,),
    "half_extents_sd": (3,),
    "bounds_centers": (3,),
    "bounds_half_extents": (3,),
    "bounds_half_extents_sd": (3,),
    "bounds_quaternions": (4,),
    "rotation_sd_deg": (2,),
    "quaternions": (4,),
    "rotations": (3, 3),
    "covariances": (9, 9),
}


def read_diagnosis(record: dict[str, Any]) -> dict[str, Any]:
    """The consistency check, where nothing is consistent that was not checked."""
    return {**record, "consistent": None} if record["score"] is None else record


def warn_if_inconsistent(diagnosis: dict[str, Any], words: str | None, stacklevel: int) -> None:
    """Warns of a scene that is inconsistent, with the message of the core, which names the call that corrects it."""
    if diagnosis["consistent"] is False and words is not None:
        text = f"the scene is inconsistent: {words}"
        warnings.warn(text, InconsistentSceneWarning, stacklevel=stacklevel + 1)


class InconsistentSceneWarning(UserWarning):
    """The scene is inconsistent: its poses, cameras and boxes do not fit together.

    No object is ``"ok"``; `Estimates.diagnosis` has the cause, `Estimates.corrected` or `Scene.corrected` corrects it.
    """


@dataclass(frozen=True, eq=False)
class Alternative:
    """Another body that fits the views of an object about as well as the reported one.

    Attributes
    ----------
    kind : str
        Its kind.
    center : ndarray, shape (3,)
        Its center in the world.
    half_extents : ndarray, shape (3,)
        Its half extents.
    quaternion : ndarray, shape (4,)
        Its rotation, world from object: a unit quaternion, w first.
    log_odds : float
        Log odds against the reported body (natural logarithm): -2 means e^2 = 7.4 times less probable.
    """

    kind: str
    center: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    log_odds: float


@dataclass(frozen=True, eq=False, repr=False)
class Estimate:
    """The estimate of one object: a row of `Estimates`, which documents the fields.

    Attributes
    ----------
    id : int or str
        The object, as given.
    category : str or None
    status : str
    kind : str or None
    center, half_extents, half_extents_sd : ndarray, shape (3,)
    quaternion : ndarray, shape (4,)
    rotation : ndarray, shape (3, 3)
    rotation_sd_deg : ndarray, shape (2,)
    yaw_deg : float
    bounds_center, bounds_half_extents, bounds_half_extents_sd : ndarray, shape (3,)
    bounds_quaternion : ndarray, shape (4,)
    covariance : ndarray, shape (9, 9)
    covariance_coordinates : str or None
    center_sd : float
    views_used : int
    rms_residual, relative_residual, normalized_residual, predicted_iou : float
    alternatives : list of Alternative
    suspect_view : str or None
    warnings : list of str
    uncertain : str or None
    """

    id: int | str
    category: str | None
    status: str
    kind: str | None
    center: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    half_extents_sd: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    rotation: NDArray[np.float64]
    rotation_sd_deg: NDArray[np.float64]
    yaw_deg: float
    bounds_center: NDArray[np.float64]
    bounds_half_extents: NDArray[np.float64]
    bounds_half_extents_sd: NDArray[np.float64]
    bounds_quaternion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    covariance_coordinates: str | None
    center_sd: float
    views_used: int
    rms_residual: float
    relative_residual: float
    normalized_residual: float
    alternatives: list[Alternative]
    predicted_iou: float
    suspect_view: str | None
    warnings: list[str]
    uncertain: str | None

    @property
    def ok(self) -> bool:
        """Whether the object is localized: the status is ``"ok"``."""
        return self.status == "ok"

    def __repr__(self) -> str:
        category = f" ({self.category})" if self.category else ""
        if not np.isfinite(self.center).all():
            return f"<quadlift.Estimate {self.id!r}{category}: {self.status}>"
        x, y, z = self.center
        place = f"center {x:.4g}, {y:.4g}, {z:.4g}, sd {self.center_sd:.2g}, {self.views_used} views"
        return f"<quadlift.Estimate {self.id!r}{category}: {self.status}, {place}>"


@dataclass(frozen=True, eq=False, repr=False)
class EstimateArrays:
    """The arrays of `Estimates`, which documents them."""

    object_ids: NDArray[Any]
    categories: list[str | None]
    status: NDArray[np.str_]
    kinds: list[str | None]
    centers: NDArray[np.float64]
    half_extents: NDArray[np.float64]
    half_extents_sd: NDArray[np.float64]
    quaternions: NDArray[np.float64]
    rotations: NDArray[np.float64]
    rotation_sd_deg: NDArray[np.float64]
    yaw_deg: NDArray[np.float64]
    bounds_centers: NDArray[np.float64]
    bounds_half_extents: NDArray[np.float64]
    bounds_half_extents_sd: NDArray[np.float64]
    bounds_quaternions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    covariance_coordinates: list[str | None]
    center_sd: NDArray[np.float64]
    views_used: NDArray[np.int64]
    rms_residuals: NDArray[np.float64]
    relative_residuals: NDArray[np.float64]
    normalized_residuals: NDArray[np.float64]
    alternatives: list[list[Alternative]]
    predicted_ious: NDArray[np.float64]
    suspect_views: list[str | None]
    warnings: list[list[str]]
    uncertain: list[str | None]
    object_indices: NDArray[np.int64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    rejection_reason: list[str | None]
    body: str
    noise: dict[str, float]
    cue_scales: list[dict[str, Any]]
    cross_validation: dict[str, Any] | None
    coverage: dict[str, Any] | None
    skipped: dict[str, int]
    diagnosis: dict[str, Any]
    association: dict[str, Any] | None
    problems: list[str]
    seconds: float
    _localized: _core.Localized

    @classmethod
    def _of(cls, localized: _core.Localized, ids: str = "found") -> Self:
        """The arrays of a result; `ids` is "numbers", "texts" or "map" (all sorted) or "found"."""
        found = localized.arrays()
        names: list[str] = found["object_ids"]
        object_ids: NDArray[Any] = np.array(names, dtype=np.int64 if ids == "numbers" else np.str_)
        order = np.arange(len(names))
        if ids != "found":
            # Those of a map end with their numbers, which have four digits or more.
            keys = [int(name.rpartition("_")[2]) for name in names] if ids == "map" else object_ids
            order = np.argsort(np.asarray(keys), kind="stable").astype(np.int64)
        in_order = bool((order[1:] > order[:-1]).all())
        places = np.empty(len(names) + 1, dtype=np.int64)
        places[order], places[-1] = np.arange(len(names)), -1

        def rows(name: str) -> NDArray[Any]:
            values: NDArray[Any] = found[name]
            shaped = values.reshape(len(names), *_SHAPES.get(name, ()))
            return shaped if in_order else shaped[order]

        def items(name: str) -> list[Any]:
            values: list[Any] = found[name]
            return values if in_order else [values[k] for k in order]

        record: dict[str, Any] = json.loads(localized.record_json)
        return cls(
            object_ids=object_ids[order],
            categories=items("categories"),
            status=np.array(items("status"), dtype=np.str_),
            kinds=items("kinds"),
            centers=rows("centers"),
            half_extents=rows("half_extents"),
            half_extents_sd=rows("half_extents_sd"),
            quaternions=rows("quaternions"),
            rotations=rows("rotations"),
            rotation_sd_deg=rows("rotation_sd_deg"),
            yaw_deg=rows("yaw_deg"),
            bounds_centers=rows("bounds_centers"),
            bounds_half_extents=rows("bounds_half_extents"),
            bounds_half_extents_sd=rows("bounds_half_extents_sd"),
            bounds_quaternions=rows("bounds_quaternions"),
            covariances=rows("covariances"),
            covariance_coordinates=items("covariance_coordinates"),
            center_sd=rows("center_sd"),
            views_used=rows("views_used"),
            rms_residuals=rows("residuals_px"),
            relative_residuals=rows("relative_residuals"),
            normalized_residuals=rows("normalized_residuals"),
            alternatives=[[_alternative(*figures) for figures in others] for others in items("alternatives")],
            predicted_ious=rows("predicted_ious"),
            suspect_views=items("suspect_views"),
            warnings=items("warnings"),
            uncertain=items("uncertain"),
            object_indices=places[found["object_indices"]],
            inliers=found["inliers"],
            residuals=found["detection_residuals_px"],
            rejection_reason=found["rejection_reason"],
            body=record["body"],
            noise=record["noise"],
            cue_scales=record.get("cue_scales", []),
            cross_validation=record["cross_validation"],
            coverage=record.get("coverage"),
            skipped=record["skipped"],
            diagnosis=read_diagnosis(record["diagnosis"]),
            association=record.get("association"),
            problems=localized.problems,
            seconds=localized.seconds,
            _localized=localized,
        )._read_only()

    def _read_only(self) -> Self:
        """The estimates, with read-only arrays: changes would not reach result files."""
        for value in vars(self).values():
            if isinstance(value, np.ndarray):
                value.setflags(write=False)
        return self

    def _warned(self, stacklevel: int) -> Self:
        """The estimates, after a warning if the scene is inconsistent."""
        warn_if_inconsistent(self.diagnosis, self._localized.problem, stacklevel + 1)
        return self

    def __len__(self) -> int:
        """Number of objects."""
        return len(self.object_ids)

    def __iter__(self) -> Iterator[Estimate]:
        """The objects, in the order of the rows."""
        return (self._estimate(row) for row in range(len(self)))

    def __contains__(self, id: Any) -> bool:
        """Whether there is an object with this id."""
        return str(id) in self._rows

    @overload
    def __getitem__(self, key: int | str) -> Estimate: ...
    @overload
    def __getitem__(self, key: slice) -> list[Estimate]: ...
    def __getitem__(self, key: int | str | slice) -> Estimate | list[Estimate]:
        """The object of a row, of an id (a text), or the objects of a slice of rows."""
        if isinstance(key, slice):
            return [self._estimate(row) for row in range(*key.indices(len(self)))]
        if isinstance(key, str):
            if key not in self._rows:
                some = ", ".join(list(self._rows)[:5]) or "none"
                raise KeyError(f"there is no object {key!r}; there are {len(self)}: {some}")
            return self._estimate(self._rows[key])
        if not isinstance(key, int | np.integer) or isinstance(key, bool):
            raise TypeError(f"the index is {key!r}; expected the number of a row, the id of an object or a slice")
        if not -len(self) <= key < len(self):
            raise IndexError(f"the index is {key}; there are {len(self)} objects")
        return self._estimate(int(key) % len(self))

    @cached_property
    def _rows(self) -> dict[str, int]:
        """The rows of the objects, by their ids as texts."""
        return {str(name): row for row, name in enumerate(self.object_ids.tolist())}

    def _estimate(self, row: int) -> Estimate:
        return Estimate(
            id=self.object_ids[row].item(),
            category=self.categories[row],
            status=str(self.status[row]),
            kind=self.kinds[row],
            center=self.centers[row],
            half_extents=self.half_extents[row],
            half_extents_sd=self.half_extents_sd[row],
            quaternion=self.quaternions[row],
            rotation=self.rotations[row],
            rotation_sd_deg=self.rotation_sd_deg[row],
            yaw_deg=float(self.yaw_deg[row]),
            bounds_center=self.bounds_centers[row],
            bounds_half_extents=self.bounds_half_extents[row],
            bounds_half_extents_sd=self.bounds_half_extents_sd[row],
            bounds_quaternion=self.bounds_quaternions[row],
            covariance=self.covariances[row],
            covariance_coordinates=self.covariance_coordinates[row],
            center_sd=float(self.center_sd[row]),
            views_used=int(self.views_used[row]),
            rms_residual=float(self.rms_residuals[row]),
            relative_residual=float(self.relative_residuals[row]),
            normalized_residual=float(self.normalized_residuals[row]),
            alternatives=self.alternatives[row],
            predicted_iou=float(self.predicted_ious[row]),
            suspect_view=self.suspect_views[row],
            warnings=self.warnings[row],
            uncertain=self.uncertain[row],
        )

    def __repr__(self) -> str:
        return f"<quadlift.Estimates: {int(self.ok.sum())} of {len(self)} objects localized, {self.body}>"

    @property
    def ok(self) -> NDArray[np.bool_]:
        """Localized objects, shape (N,): those with the status ``"ok"``."""
        ok: NDArray[np.bool_] = self.status == "ok"
        return ok

    def __reduce__(self) -> Any:
        raise TypeError("estimates cannot be pickled; hand over to_arrow(), to_pandas(), to_scene() or their arrays")

    def closest_ellipsoids(self) -> NDArray[np.float64]:
        """Semi-axes of the ellipsoids that reach about as far as the bodies in all directions, shape (N, 3).

        Center and rotation are those of the body; an ellipsoid is its own closest one.
        """
        ids, semi_axes = self._localized.closest_ellipsoids()
        places = {name: row for row, name in enumerate(ids)}
        return semi_axes.reshape(len(self), 3)[[places[str(name)] for name in self.object_ids.tolist()]]

    def to_pandas(self) -> pandas.DataFrame:
        """A table with one row per object; needs pandas.

        Returns
        -------
        pandas.DataFrame
            Columns `object`, `category`, `kind`, `center_x` to `center_z`, `half_extent_1` to `_3`,
            `half_extent_1_sd` to `_3_sd`, `bounds_half_extent_1` to `_3`, `yaw_deg`, `yaw_sd_deg`, `center_sd`,
            `views`, `status` and `warnings` (one text). Yaws are about the scene's ``up``, NaN without it.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise ImportError("to_pandas needs pandas: pip install pandas") from error
        columns: dict[str, Any] = {"object": self.object_ids, "category": self.categories, "kind": self.kinds}
        columns |= {f"center_{name}": self.centers[:, k] for k, name in enumerate("xyz")}
        columns |= {f"half_extent_{k + 1}": self.half_extents[:, k] for k in range(3)}
        columns |= {f"half_extent_{k + 1}_sd": self.half_extents_sd[:, k] for k in range(3)}
        columns |= {f"bounds_half_extent_{k + 1}": self.bounds_half_extents[:, k] for k in range(3)}
        columns |= {
            "yaw_deg": self.yaw_deg,
            "yaw_sd_deg": np.where(np.isnan(self.yaw_deg), np.nan, self.rotation_sd_deg[:, 0]),
            "center_sd": self.center_sd,
            "views": self.views_used,
            "status": self.status,
            "warnings": ["; ".join(texts) for texts in self.warnings],
        }
        return pd.DataFrame(columns)

    def to_arrow(self) -> pyarrow.Table:
        """A table with one row per object; needs pyarrow.

        Returns
        -------
        pyarrow.Table
            Columns `object`, `category`, `status`, `kind`, `center`, `half_extents`, `half_extents_sd`, `quaternion`,
            `bounds_center`, `bounds_half_extents`, `bounds_half_extents_sd`, `bounds_quaternion` and `covariance`
            (lists of 3, 3, 3, 4, 3, 3, 3, 4 and 81 numbers; null for none), `center_sd`, `views_used`,
            `rms_residual_px`.
        """
        from ._arrow import pa

        def lists(values: NDArray[np.float64]) -> Any:
            flat = values.reshape(len(self), int(np.prod(values.shape[1:])))
            none = pa.array(np.isnan(flat).all(axis=1))
            fixed = pa.FixedSizeListArray.from_arrays(pa.array(flat.reshape(-1)), flat.shape[1], mask=none)
            # Fixed-size lists with nulls can be written to Parquet, but not read from it.
            return fixed.cast(pa.list_(pa.float64()))

        def numbers(values: NDArray[np.float64]) -> Any:
            return pa.array(values, from_pandas=True)

        return pa.table(
            {
                "object": pa.array(self.object_ids),
                "category": pa.array(self.categories, pa.string()),
                "status": pa.array(self.status, pa.string()),
                "kind": pa.array(self.kinds, pa.string()),
                "center": lists(self.centers),
                "half_extents": lists(self.half_extents),
                "half_extents_sd": lists(self.half_extents_sd),
                "quaternion": lists(self.quaternions),
                "bounds_center": lists(self.bounds_centers),
                "bounds_half_extents": lists(self.bounds_half_extents),
                "bounds_half_extents_sd": lists(self.bounds_half_extents_sd),
                "bounds_quaternion": lists(self.bounds_quaternions),
                "covariance": lists(self.covariances),
                "center_sd": numbers(self.center_sd),
                "views_used": pa.array(self.views_used),
                "rms_residual_px": numbers(self.rms_residuals),
            }
        )


def _alternative(kind: str, center: list[float], half: list[float], turn: list[float], log_odds: float) -> Alternative:
    return Alternative(kind, np.array(center), np.array(half), np.array(turn), log_odds)


@dataclass(frozen=True)
class AssociatedObject:
    """An object found by association."""

    id: str
    """Its id."""
    evidence: float | None
    """Log Bayes factor of the object against its detections being clutter (nats)."""
    uncertain: str | None
    """Why it may be moving or be several objects."""


@dataclass(frozen=True)
class Evaluation:
    """Scores of estimates against ground truth.

    Angles are in radians, lengths in world units, fractions from 0 to 1. A failed estimate has an overlap of 0.

    Attributes
    ----------
    objects : list of dict
        For each true object: `id`, `estimate`, `status`, `has_body`, and the scores `iou3d`, `iou3d_enclosing`,
        `cuboid_iou3d`, `axis_error`, `theta_err`, `rotation_error`, `center_error`,
        `size_error`, `ellipse_reprojection_iou`, `box_reprojection_iou`; None if there is nothing to compare.
    mean : dict
        Means of these scores over the objects that have them; empty if only the association is scored.
    failures : int
        Number of true objects without an estimated body.
    unmatched : list of str
        Estimates that are not paired with any true object.
    matched_by : str or None
        ``"ids"`` or ``"overlap"``; None if only the association is scored.
    found : dict or None
        Number of true objects that an estimate overlaps, ignoring ids: `least_iou3d`, `true_objects`, `estimates`,
        `matched`, `precision`, `recall`, `mean_iou3d`.
    identities : dict or None
        Scores of the association: `detections` (in both), `only_in_estimate`, `only_in_truth`; over pairs of detections
        `precision`, `recall` and `f1`; `adjusted_rand_index`, `duplicates` (objects that repeat a true one). None if
        the detections of either scene have no object ids.
    notes : list of str
        Why the association was not scored.
    """

    objects: list[dict[str, Any]]
    mean: dict[str, float | None]
    failures: int
    unmatched: list[str]
    matched_by: str | None
    found: dict[str, Any] | None
    identities: dict[str, Any] | None
    notes: list[str]
