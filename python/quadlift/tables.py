"""Tables of detections in, tables of estimates out: pyarrow or pandas, on one machine or in the tasks of an engine.

`occluded_edges` needs all detections of a frame, `noise` those of a sample of the objects, `localize` all detections of
an object, or of a scene where ids are sought. Results do not depend on how objects are distributed over tables. Needs
pyarrow; docs/scale-out.md has the columns, and recipes for Spark, Ray and Daft.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar, cast

import numpy as np

from . import _checks, _columns, _core, _options, _outlines, _run_options
from ._arrow import pa, pc
from ._columns import Cameras
from ._core import QuadliftError
from ._estimates import EstimateArrays

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from ._arrays import DetectionArrays, FrameArrays, Names

__all__ = ["localize", "noise", "occluded_edges"]

Table = TypeVar("Table")

_log = logging.getLogger("quadlift")
_OF_OBJECTS = _run_options.OF_OBJECTS | {"priors"}
_OF_SCENES = frozenset(_run_options.RUN_KINDS) - {
    "source",
    "measurement",
    "max_occluded",
    "max_truncated",
    "cross_validate",
}
_OF_SCENES |= {"priors"}


def occluded_edges(detections: Table) -> Table:
    """Finds box edges that are probably hidden by another box of the frame; they have a separate noise level.

    Parameters
    ----------
    detections : pyarrow.Table or pandas.DataFrame
        All detections of some frames, of any object: `scene` (optional), `frame`, `x0`, `y0`, `x1`, `y1`, optionally
        outlines and oriented boxes. Invalid boxes neither hide nor are hidden.

    Returns
    -------
    pyarrow.Table or pandas.DataFrame
        The rows with one more column, `occluded_edges`: 1 for a hidden left edge plus 4 for a right one. With a column
        `outline` also `occluded_lines`, with a bit for each tangent line that another outline may hide.
    """
    rows = _columns.table(detections, "detections", ("frame", *_columns.BOX))
    frames, scenes = _columns.ids(rows, "frame"), _columns.ids(rows, "scene")
    known = _columns.known(frames)
    frame = _columns.places(scenes, _columns.known(scenes), "scene") * (len(known) + 1)
    frame += _columns.places(frames, known, "frame")
    boxes, outlines = _columns.boxes(rows), _columns.outlines(rows)
    if outlines is not None:
        boxes = np.where(np.isnan(boxes).all(axis=1, keepdims=True), _outlines.around(outlines), boxes)
    edges = _core.occluded_edges(frame, np.ascontiguousarray(boxes)) @ _columns.EDGES
    rows = _with_column(rows, "occluded_edges", edges.astype(np.int8))
    if outlines is not None and outlines["corners"] is not None:
        lines = _core.occluded_lines(frame, outlines) @ _columns.LINES
        rows = _with_column(rows, "occluded_lines", lines.astype(np.int16))
    return _like(detections, rows)


def noise(
    detections: Any,
    cameras: Any = None,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Any,
) -> tuple[dict[str, float], str]:
    """Estimates the noise levels and the kind of body from a sample of objects, for `localize`.

    Parameters
    ----------
    detections, cameras, up, length_unit, **options
        As in `localize`; given `noise_model` or `body` are kept. A few hundred objects are enough; beyond 2000 only
        every second, third, ... is used. Invalid objects are skipped.

    Returns
    -------
    noise_model : dict
        See `Estimates.noise`; empty without objects, and for other methods than ``"posterior"``.
    body : str
        See `Estimates.body`; ``"ellipsoid"`` if the objects of the sample are of several kinds.
    """
    run = _Run.of(options, _OF_OBJECTS, up, length_unit)
    read = _Detections(_columns.table(detections, "detections", ("object",)), cameras)
    noise_model, body = run.options.get("noise_model"), run.options.get("body", "auto")
    groups = np.setdiff1d(np.arange(len(read.names)), list(read.by_group()))
    if not len(groups):
        return dict(noise_model or {}), "ellipsoid" if body == "auto" else body
    estimates = run.of_groups(read, groups)
    if estimates.body == "mixed":
        return noise(detections, cameras, up=up, length_unit=length_unit, **{**options, "body": "ellipsoid"})
    return (estimates.noise if noise_model is None else dict(noise_model)), estimates.body


def localize(
    detections: Table,
    cameras: Any = None,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Any,
) -> Table:
    """Localizes the objects of a table of detections.

    Parameters
    ----------
    detections : pyarrow.Table or pandas.DataFrame
        One row per detection: `scene` (optional), `frame`, `object`, `x0`, `y0`, `x1`, `y1`, and optionally `category`,
        `score`, `occluded_edges` and `occluded_lines` (see `occluded_edges`), outlines, oriented boxes, depths and 3D
        boxes in the columns of docs/scale-out.md. Rows whose object is null, "" or negative are skipped. Without the
        column `object` each scene is associated.
    cameras : pyarrow.Table or pandas.DataFrame, optional
        One row per frame: `scene` if the detections have it, `frame`, `projection` or `intrinsics` and
        `cam_from_world`, optionally `width` and `height`. Without it these columns are those of the detections.
    up : str or array_like, shape (3,), optional
        World direction against gravity: an axis such as ``"-y"``, or a direction.
    length_unit : str, optional
        World unit; ``"m"`` is required for ``priors="builtin"``.
    **options
        `noise_model` and `body` (both are needed with objects and ``method="posterior"``, see `noise`), `method`,
        `priors`, `min_views`, `reg_weight`, as in `quadlift.localize`; without the column `object` also those
        of scenes.

    Returns
    -------
    pyarrow.Table or pandas.DataFrame
        One row per object, in the order of scenes and objects: `scene` and `object` as given, the columns of
        `Estimates.to_arrow`, and `problem`, the reason of the status ``"invalid"`` (an object with an invalid detection
        or camera) or ``"failed"`` (an internal error). Others are not affected. Invalid detections of a scene
        without ids are left out and counted in a row without an object.

    Raises
    ------
    QuadliftError
        If an option or a whole column is invalid.

    Notes
    -----
    The frames of a scene are in the order of their ids, numbers as numbers and texts as texts ("10" before "9"),
    because errors of neighboring views are correlated. Scales of depths and 3D boxes are not estimated with given
    `noise_model`: divide the depths of a source by its factor first (`Estimates.cue_scales`).
    """
    rows = _columns.table(detections, "detections")
    has_objects = "object" in rows.column_names
    run = _Run.of(options, _OF_OBJECTS if has_objects else _OF_SCENES, up, length_unit)
    if has_objects and not run.is_complete():
        raise QuadliftError(
            'noise_model and a body other than "auto" are needed, because what a table tells of them depends on which '
            "objects are in it; take both from quadlift.tables.noise"
        )
    return _like(detections, _results(_Detections(rows, cameras), run))


def _like(given: Table, found: Any) -> Table:
    """A table of pandas if that was given."""
    return cast("Table", found.to_pandas() if hasattr(given, "iloc") else found)


def _with_column(rows: Any, name: str, found: NDArray[Any]) -> Any:
    return (rows.drop_columns([name]) if name in rows.column_names else rows).append_column(name, pa.array(found))


# Options


@dataclass(frozen=True)
class _Run:
    """Checked options, and the world."""

    keywords: dict[str, Any]
    world: FrameArrays
    columns: Any
    """The schema of `Estimates.to_arrow`."""

    @classmethod
    def of(cls, given: Mapping[str, Any], known: frozenset[str], up: Any, length_unit: Any) -> _Run:
        for name in given:
            if name in _OF_SCENES - known:
                raise QuadliftError(
                    f"{name} is an option of whole scenes, whose objects share it; found a column 'object'"
                )
            if name not in known:
                raise QuadliftError(f"there is no option {name!r} here; expected one of {', '.join(sorted(known))}")
        # The consistency check and the detection of upright objects need whole scenes.
        always: dict[str, Any] = {"associate": "auto"}
        if known == _OF_OBJECTS:
            always = {"associate": "never", "allow_inconsistent": True}
            if given.get("method", "posterior") == "posterior":
                always["upright"] = False
            if up is not None and _may_share_ground(given.get("priors")):
                raise QuadliftError(
                    "priors: those with on_ground=True let objects share a ground where up is given; tables of objects "
                    "take a mapping of priors without on_ground, or no up"
                )
        keywords = _options.split(cast("_options.Options", {**always, **given}), "localize")[0]
        # Tables may be parts of scenes: there are no messages about scenes.
        keywords["run"]["cross_validate"] = None
        world: FrameArrays = {
            "up": _checks.optional(_checks.direction, "up", up),
            "length_unit": _checks.optional(_checks.text, "length_unit", length_unit),
        }
        # One valid detection: only the options can be invalid.
        one, box = np.zeros(1, dtype=np.int64), np.array([[0.0, 0.0, 1.0, 1.0]])
        frames: FrameArrays = {"frame_ids": ["0"], "projections": np.eye(3, 4)[np.newaxis]}
        probe = cls(keywords, world, None).estimates(frames, {"frames": one, "boxes": box, "objects": (one, ["probe"])})
        return cls(keywords, world, probe.to_arrow().schema)

    @property
    def options(self) -> dict[str, Any]:
        """The options of the run that are given."""
        found: dict[str, Any] = self.keywords["run"]
        return found

    def is_complete(self) -> bool:
        """Whether nothing has to be estimated from all objects together."""
        run = self.options
        is_given = run.get("noise_model") is not None and run.get("body", "auto") != "auto"
        return is_given or bool(run.get("method", "posterior") != "posterior")

    def estimates(self, frames: FrameArrays, detections: DetectionArrays) -> EstimateArrays:
        """The result of one scene."""
        scene = _core.Scene.from_frames({**frames, **self.world}).with_detections(detections, None)
        return EstimateArrays._of(scene.localize(self.keywords, 1, None))

    def of_groups(self, read: _Detections, groups: NDArray[np.int64]) -> EstimateArrays:
        """The estimates of objects, in their order; or of a scene."""
        rows = read.good()
        rows = rows[np.isin(read.group[rows], groups)]
        if read.has_objects:
            used = np.unique(read.camera[rows])
        else:
            used = read.cameras.of_scene(read.scenes.slice(groups[0], 1))
        return self.estimates(read.cameras.frames(used), read.arrays(rows, used))


def _may_share_ground(priors: Any) -> bool:
    if isinstance(priors, Mapping):
        return any(isinstance(prior, Mapping) and prior.get("on_ground") for prior in priors.values())
    return priors is not None


# Detections


class _Detections:
    """A table of detections in groups, which are objects or scenes; their cameras, and what is wrong with them."""

    def __init__(self, rows: Any, cameras: Any) -> None:
        rows = _columns.table(rows, "detections", ("frame", *_columns.BOX))
        own = rows if cameras is None else _columns.table(cameras, "cameras", ("frame",))
        if ("scene" in rows.column_names) != ("scene" in own.column_names):
            some, others = ("cameras", "detections") if "scene" in own.column_names else ("detections", "cameras")
            raise QuadliftError(f"the {some} have a column 'scene', the {others} have none")
        self.has_objects = "object" in rows.column_names
        self.cameras = Cameras(own)
        if self.has_objects:
            objects = _columns.ids(rows, "object")
            unknown = pc.equal(objects, "") if pa.types.is_string(objects.type) else pc.less(objects, 0)
            rows = rows.filter(pc.invert(unknown.fill_null(True))).combine_chunks()
        self.rows, self.camera, self._frame = rows, self.cameras.find(rows), _columns.ids(rows, "frame")
        keys = [_columns.ids(rows, name) for name in (("scene", "object") if self.has_objects else ("scene",))]
        codes = [_columns.places(key, _columns.known(key), "") for key in keys]
        _, first, group = np.unique(np.column_stack(codes), axis=0, return_index=True, return_inverse=True)
        self.group: NDArray[np.int64] = group.reshape(-1).astype(np.int64)
        """Of each row."""
        self.scenes = keys[0].take(pa.array(first))
        """Of each group."""
        self.names: list[str] = keys[-1].take(pa.array(first)).cast(pa.string()).fill_null("").to_pylist()
        self.ids = {
            name: _columns.values(rows, name).take(pa.array(first))
            for name in ("scene", "object")
            if name in rows.column_names
        }
        """As given."""
        self.problems: dict[int, tuple[Any, ...]] = {}
        """By row: the frame and a text. The smallest one of a group is reported, whatever the order of rows is."""
        missing = self._frame.is_null().to_numpy(zero_copy_only=False)
        self._add(np.flatnonzero(missing), "a detection has no frame")
        self._add(np.flatnonzero((self.camera < 0) & ~missing), "there is no such camera")
        for row in np.flatnonzero(np.isin(self.camera, list(self.cameras.broken))):
            self._add(np.array([row]), self.cameras.broken[int(self.camera[row])])
        outlines, around = _columns.outlines(rows), []
        if outlines is not None:
            around = list(_outlines.around(outlines).T[::-1])
        found = _columns.detections(rows, self.camera, (None, []), own=False)
        ties = [x for x in (found["categories"][0], found["scores"], *around) if x is not None]
        # In the order of groups, frames and numbers, whatever that of the table is.
        boxes = _columns.boxes(rows)
        self._order = np.lexsort((*ties, *boxes.T[::-1], self.camera, self.group))
        if self.has_objects:
            same = np.diff(np.column_stack([self.group, self.camera])[self._order], axis=0) == 0
            self._add(np.setdiff1d(self._order[1:][same.all(axis=1)], list(self.problems)), "the object is in it twice")
        absent = np.isnan(boxes).all(axis=1) & (np.isnan(around).any(axis=0) if around else True)
        cues = found["cues"]
        if cues is not None and cues["center"] is not None:
            absent &= np.isnan(cues["center"]).any(axis=1)
        self._add(np.flatnonzero(absent), "there is no box")
        good = self.good()
        used = np.unique(self.camera[good])
        if len(good):
            scene = _core.Scene.from_frames(self.cameras.frames(used))
            for at, text in scene.detection_problems(self.arrays(good, used)):
                self._add(good[[at]], _columns.without_place(text))

    def _add(self, rows: NDArray[np.int64], text: str) -> None:
        for row, name in zip(rows.tolist(), self._frame.take(pa.array(rows)).to_pylist(), strict=True):
            words = text if name is None else f"frame {json.dumps(name, ensure_ascii=False)}: {text}"
            self.problems.setdefault(row, (name is not None, name or 0, words))

    def by_group(self) -> dict[int, list[str]]:
        """The problems of each group, the first one in front."""
        found: dict[int, list[str]] = {}
        for row, problem in sorted(self.problems.items(), key=lambda item: item[1]):
            found.setdefault(int(self.group[row]), []).append(problem[-1])
        return found

    def good(self) -> NDArray[np.int64]:
        """Rows without a problem, in the order of groups and frames."""
        return self._order[~np.isin(self._order, list(self.problems))]

    def arrays(self, rows: NDArray[np.int64], used: NDArray[np.int64]) -> DetectionArrays:
        """Some detections for the core, and these cameras; names of objects may repeat."""
        objects: Names = (self.group[rows], self.names) if self.has_objects else (None, [])
        found = self.rows.take(pa.array(rows)).combine_chunks()
        return _columns.detections(found, np.searchsorted(used, self.camera[rows]), objects, own=self.has_objects)


def _estimated(
    read: _Detections, groups: NDArray[np.int64], run: _Run, failed: dict[int, str]
) -> list[tuple[NDArray[np.int64], Any]]:
    """Tables of estimates, with the group of each row; groups that fail are added to `failed`."""
    try:
        found = run.of_groups(read, groups).to_arrow()
        return [(groups if read.has_objects else np.repeat(groups, len(found)), found)]
    except QuadliftError as error:
        # Options and detections have been checked, so this should never happen. It is reported; the others continue.
        if len(groups) == 1:
            _log.error("%s %r failed: %s", "object" if read.has_objects else "scene", read.names[groups[0]], error)
            failed[int(groups[0])] = str(error)
            return []
    half = len(groups) // 2
    return [*_estimated(read, groups[:half], run, failed), *_estimated(read, groups[half:], run, failed)]


def _results(read: _Detections, run: _Run) -> Any:
    """The estimates of all groups, and rows that say what is wrong."""
    failed: dict[int, str] = {}
    problems = read.by_group()
    good = np.unique(read.group[read.good()])
    if read.has_objects:
        good = np.setdiff1d(good, list(problems))
        pieces = _estimated(read, good, run, failed) if len(good) else []
        told = [(group, "invalid", texts[0]) for group, texts in problems.items()]
    else:
        pieces = [piece for group in good for piece in _estimated(read, np.array([group]), run, failed)]
        count = {1: "1 detection takes"}
        told = [
            (group, "invalid", f"{count.get(len(texts), f'{len(texts)} detections take')} no part: {texts[0]}")
            for group, texts in problems.items()
        ]
    told += [(group, "failed", text) for group, text in failed.items()]
    columns = run.columns.append(pa.field("problem", pa.string()))
    blank = pa.Table.from_pylist([{"status": k, "problem": text} for _, k, text in told], schema=columns)
    found = pa.concat_tables([blank, *(p.append_column("problem", pa.nulls(len(p), pa.string())) for _, p in pieces)])
    group = np.concatenate([np.array([g for g, _, _ in told], dtype=np.int64), *(groups for groups, _ in pieces)])
    order = pa.array(np.argsort(group, kind="stable"))
    found = found.take(order).combine_chunks()
    given = {name: ids.take(pa.array(group).take(order)) for name, ids in read.ids.items()}
    return pa.table({**given, **{name: found[name] for name in found.column_names if name not in given}})
