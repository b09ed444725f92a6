"""Tables of objects in, tables of estimates out: functions for Spark, Ray Data, Daft and similar engines.

A distributed engine groups detections to one row per object (or, without object ids, to one row per scene), and calls
these functions on batches of rows. Columns with one entry per view are lists. Results do not depend on how the rows are
split into batches.

Needs pyarrow. `quadlift.spark` implements all of it on Spark.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import _checks, _outlines
from .._arrow import pa, pc
from .._core import QuadliftError
from .._estimates import EstimateArrays
from . import _tables
from ._cameras import Cameras
from ._detections import (
    EDGES,
    OF_OBJECTS,
    OF_SCENES,
    Detections,
    Settings,
    check_boxes,
    no_object,
    objects_of,
    read,
)
from ._grouping import group, ungroup, with_occluded_edges

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Cameras",
    "group",
    "localize_objects",
    "localize_scenes",
    "noise",
    "sample",
    "schema",
    "ungroup",
    "with_occluded_edges",
]

_log = logging.getLogger("quadlift")


def schema(object_type: Any = None, scene_type: Any = None) -> Any:
    """The columns of the estimates.

    Parameters
    ----------
    object_type : pyarrow.DataType, optional
        The type of `object`; the default is string.
    scene_type : pyarrow.DataType, optional
        The type of `scene`; without it there is no such column.

    Returns
    -------
    pyarrow.Schema
        `scene`, then the columns of `Estimates.to_arrow`, then `problem` (string): the reason if `status` is
        ``"invalid"`` or ``"failed"``.
    """
    vector = pa.list_(pa.float64())
    fields = [] if scene_type is None else [("scene", scene_type)]
    fields += [
        ("object", object_type or pa.string()),
        ("category", pa.string()),
        ("status", pa.string()),
        ("center", vector),
        ("semi_axes", vector),
        ("quaternion", vector),
        ("enclosing_semi_axes", vector),
        ("enclosing_center", vector),
        ("enclosing_quaternion", vector),
        ("covariance", vector),
        ("center_sd", pa.float64()),
        ("views_used", pa.int64()),
        ("rms_residual_px", pa.float64()),
        ("problem", pa.string()),
    ]
    return pa.schema(fields)


# Objects


def localize_objects(
    rows: Any,
    cameras: Cameras | Any | None = None,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Any,
) -> Any:
    """Localizes objects, one per row.

    Parameters
    ----------
    rows : pyarrow.Table or pyarrow.RecordBatch
        One row per object, with the columns

        - `scene` (optional) and `object`: whole numbers or texts; null, "" and negative numbers mean no object,
        - `frame`, `x0`, `y0`, `x1`, `y1`: lists of equal length with one entry per view: its frame (whole numbers or
          texts) and the box in pixels,
        - `category` (texts), `occluded_edges` and `occluded_lines` (see `with_occluded_edges`), optional: lists of
          the same length,
        - outlines and turned boxes, optional: lists of the same length `outline` (lists of x and y of the corners in
          turn) and `oriented_box_x`, `oriented_box_y`, `oriented_box_width`, `oriented_box_height`,
          `oriented_box_angle`; a box of nulls is the one around them,
        - depths and 3D boxes, optional: lists of the same length `depth_median`, `depth_sd`, `depth_source`,
          `box3d_center`, `box3d_half_extents`, `box3d_rotation` (lists of 3, 3 and 4 numbers), `box3d_frame`,
          `box3d_sd_distance`, `box3d_sd_direction`, `box3d_sd_size`, `box3d_sd_rotation`, `box3d_covariance` (81
          numbers), `box3d_source`, as in `Scene.with_detections` and in the tables of `quadlift export parquet`,
        - `cameras`, if not given as an argument: lists of structs with the columns of `Cameras`.

        The order of the views does not matter: see `Cameras`.
    cameras : Cameras or pyarrow.Table, optional
        The cameras of all frames.
    up : str or array_like, shape (3,), optional
        World direction against gravity: an axis such as ``"-y"``, or a direction.
    length_unit : str, optional
        World unit.
    **options
        `noise_model` and `body` (both are needed with `method="posterior"`, see `noise`), `method`, `priors`,
        `min_views`, `reg_weight`, `seed`, as in `quadlift.localize`.

    Returns
    -------
    pyarrow.Table
        One row per input row, in the same order, with the columns of `schema`. The status is ``"invalid"`` if the
        detections or cameras of an object are invalid, with the reason in `problem`, and ``"failed"`` after an internal
        error; other objects are not affected.

    Raises
    ------
    QuadliftError
        If an option or a whole column is invalid.

    Notes
    -----
    With given `noise_model` the scales of depths and 3D boxes are not estimated: divide the depths of a source by its
    factor first (`Estimates.cue_scales` of a sample).
    """
    settings = Settings.of(options, OF_OBJECTS, up, length_unit)
    if not settings.is_complete():
        raise QuadliftError(
            'noise_model and a body other than "auto" are needed, because what a batch tells of them depends on how '
            "the rows are cut into batches; take both from quadlift.batches.noise"
        )
    table = _tables.table(rows, "rows")
    cameras, detections, problems = objects_of(table, cameras)
    names = _texts(table, "object")
    found, numbers, failed = _estimates(cameras, detections, names, settings)
    place = np.full(len(table), -1)
    place[numbers] = np.arange(len(numbers))
    texts = {row: problem.text for row, problem in problems.items()} | failed
    status = {row: "invalid" for row in problems} | dict.fromkeys(failed, "failed")
    columns = {name: _tables.column(table, name) for name in ("scene", "object") if name in table.column_names}
    estimates = found.take(pa.array(place, mask=place < 0))
    for name in estimates.column_names:
        columns.setdefault(name, estimates.column(name))
    columns["status"] = pc.coalesce(_sparse(status, len(table)), estimates.column("status"))
    columns["problem"] = _sparse(texts, len(table))
    types = {name: values.type for name, values in columns.items()}
    return pa.table(columns, schema=schema(types["object"], types.get("scene")))


def noise(
    rows: Any,
    cameras: Cameras | Any | None = None,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Any,
) -> tuple[dict[str, float], str]:
    """Estimates the noise levels and the kind of body from a sample of objects, for `localize_objects`.

    Parameters
    ----------
    rows, cameras, up, length_unit, **options
        As in `localize_objects`; given `noise_model` or `body` are kept. A few hundred objects are enough; beyond 2000
        only every second, third, ... is used. Invalid objects are skipped.

    Returns
    -------
    noise_model : dict
        See `Estimates.noise`; empty without objects, and for methods other than `map`.
    body : str
        See `Estimates.body`; ``"ellipsoid"`` if the objects of the sample are of several kinds.
    """
    settings = Settings.of(options, OF_OBJECTS, up, length_unit)
    table = _tables.table(rows, "rows")
    cameras, detections, _ = objects_of(table, cameras)
    noise_model, body = settings.run.get("noise_model"), settings.run.get("body", "auto")
    if not len(detections.row):
        return dict(noise_model or {}), "ellipsoid" if body == "auto" else body
    estimates = _localized(cameras, detections, _texts(table, "object"), settings)
    if estimates.body == "mixed":
        return noise(rows, cameras, up=up, length_unit=length_unit, **{**options, "body": "ellipsoid"})
    return (estimates.noise if noise_model is None else dict(noise_model)), estimates.body


def sample(rows: Any, count: int = 2000) -> Any:
    """The rows of some objects, for `noise`: those whose ids have the smallest hashes, in their order.

    Sampling the concatenated samples of the parts of a table gives the sample of the table, for any partition.

    Parameters
    ----------
    rows : pyarrow.Table or pyarrow.RecordBatch
        One row per object, with the column `object`, and optionally `scene`.
    count : int
        Maximum number of rows.

    Returns
    -------
    pyarrow.Table
        These rows, with all columns; rows without an object are excluded.
    """
    count = _checks.whole("count", count, 0)
    table = _tables.table(rows, "rows")
    _tables.require(table.column_names, ["object"], "rows")
    objects = _tables.ids(_tables.column(table, "object"), "object")
    table = table.filter(pc.invert(no_object(objects)))
    names = _texts(table, "object")
    scenes = _texts(table, "scene") if "scene" in table.column_names else [""] * len(names)
    hashes = [hashlib.sha256(f"{scene}\n{name}".encode()).digest() for scene, name in zip(scenes, names, strict=True)]
    order = sorted(range(len(hashes)), key=hashes.__getitem__)
    return table.take(pa.array(order[:count], pa.int64()))


def _texts(table: Any, name: str) -> list[str]:
    """Ids as texts, "" for null."""
    texts: list[str] = _tables.ids(_tables.column(table, name), name).cast(pa.string()).fill_null("").to_pylist()
    return texts


def _sparse(texts: Mapping[int, str], count: int) -> Any:
    """Texts of some rows, null elsewhere."""
    values = np.full(count, None, dtype=object)
    for row, text in texts.items():
        values[row] = text
    return pa.array(values, pa.string())


def _localized(cameras: Cameras, detections: Detections, names: list[str], settings: Settings) -> EstimateArrays:
    """The estimates of objects, whose names may repeat, in their order."""
    used, frame = np.unique(detections.camera, return_inverse=True)
    # Edges that are not marked count as visible: other boxes of the frame may be in other batches.
    hidden = np.zeros_like(detections.boxes, dtype=np.bool_)
    if detections.hidden is not None:
        hidden = (detections.hidden[:, np.newaxis] & EDGES) != 0
    of_core = detections.dictionary(frame.astype(np.int64), names, hidden)
    return EstimateArrays._of(settings.localized(cameras.frames(used), of_core))


def _estimates(
    cameras: Cameras, detections: Detections, names: list[str], settings: Settings
) -> tuple[Any, NDArray[np.int64], dict[int, str]]:
    """A table of estimates, the rows of its objects, and rows with internal errors."""
    rows = np.unique(detections.row)
    nothing = schema().empty_table().drop_columns(["problem"])
    if not len(rows):
        return nothing, rows, {}
    try:
        return _localized(cameras, detections, names, settings).to_arrow(), rows, {}
    except QuadliftError as error:
        # Options and detections have been checked, so this should never happen. It is reported; the others continue.
        _log.warning("a batch of %d objects failed and is tried one by one: %s", len(rows), error)
    found, good, failed = [nothing], [], {}
    for row in rows.tolist():
        try:
            found.append(_localized(cameras, detections.take(detections.row == row), names, settings).to_arrow())
            good.append(row)
        except QuadliftError as error:
            failed[row] = str(error)
            _log.error("object %r failed: %s", names[row], error)
    return pa.concat_tables(found), np.array(good, dtype=np.int64), failed


# Scenes


def localize_scenes(
    rows: Any,
    cameras: Cameras | Any | None = None,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    **options: Any,
) -> Any:
    """Associates detections scene by scene and localizes the objects.

    Parameters
    ----------
    rows : pyarrow.Table or pyarrow.RecordBatch
        One row per scene: `scene` (without it there may be only one row), and lists of equal length `frame`, `x0`,
        `y0`, `x1`, `y1` with one entry per detection, optionally `category` and `score`. Also `cameras`, outlines,
        turned boxes, depths and 3D boxes, as in `localize_objects`.
    cameras : Cameras or pyarrow.Table, optional
        The cameras of all frames, including those without detections.
    up : str or array_like, shape (3,), optional
        World direction against gravity: an axis such as ``"-y"``, or a direction.
    length_unit : str, optional
        World unit.
    **options
        As in `localize_objects`, and `associate`, `ids`, `upright`, `ground_plane`, `camera_height`,
        `pose_noise`, `allow_inconsistent`. Without `noise_model` the noise levels are estimated per scene.
        The objects of an inconsistent scene have the status ``"inconsistent"``.

    Returns
    -------
    pyarrow.Table
        Zero or more rows per scene, with the columns of `schema`. Invalid detections are skipped and reported in a row
        with the status ``"invalid"`` and no object.

    Notes
    -----
    Detections are processed in the order of their frames and numbers, independent of the order in the lists.
    """
    settings = Settings.of(options, OF_SCENES, up, length_unit)
    table = _tables.table(rows, "rows")
    if "scene" not in table.column_names and len(table) > 1:
        raise QuadliftError(f"there are {len(table)} rows without a column 'scene'; expected one")
    has_own = cameras is None
    cameras, detections, problems = read(table, cameras)
    codes = detections.category[0]
    ties = [x for x in (codes, detections.scores) if x is not None]
    if detections.outlines is not None:
        ties += list(_outlines.around(detections.outlines).T[::-1])
    order = np.lexsort((*ties, *detections.boxes.T[::-1], detections.camera, detections.row))
    kept = check_boxes(cameras, detections, order[~np.isin(order, list(problems.of_detection))], problems)
    scenes = _tables.column(table, "scene") if "scene" in table.column_names else None
    keys = pa.array(np.arange(len(table)))
    if not has_own:
        keys = pa.array([0]) if scenes is None else _tables.ids(scenes, "scene")
    pieces, of_row = [schema().empty_table()], []
    wrong = problems.by_row(detections.row)
    for row in range(len(table)):
        told = [("invalid", text) for text in wrong.get(row, [])]
        try:
            piece = _scene(cameras, cameras.of_scene(keys[row]), kept.take(kept.row == row), settings)
        except QuadliftError as error:
            # Options and detections have been checked, so this should never happen. It is reported; others continue.
            name = "the scene" if scenes is None else f"scene {scenes[row].as_py()!r}"
            _log.error("%s failed: %s", name, error)
            piece, told = schema().empty_table(), [*told, ("failed", str(error))]
        blank = pa.Table.from_pylist([{"status": status, "problem": text} for status, text in told], schema=schema())
        pieces += [blank, piece]
        of_row += [row] * (len(blank) + len(piece))
    found = pa.concat_tables(pieces).combine_chunks()
    if scenes is None:
        return found
    return found.add_column(0, "scene", scenes.take(pa.array(of_row, pa.int64())))


def _scene(cameras: Cameras, used: NDArray[np.int64], detections: Detections, settings: Settings) -> Any:
    """The estimates of a scene with these cameras."""
    if not len(detections.row):
        return schema().empty_table()
    of_core = detections.dictionary(np.searchsorted(used, detections.camera), None, None)
    estimates = EstimateArrays._of(settings.localized(cameras.frames(used), of_core)).to_arrow()
    return estimates.append_column("problem", pa.nulls(len(estimates), pa.string()))
