"""quadlift on Spark: a table of detections and one of cameras in, a table of estimates out.

Needs pyspark 4 or later and pyarrow (the extra `spark`); the workers need quadlift too.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

try:
    import pyarrow as pa
    import pyspark.sql.functions as F  # noqa: N812
    import pyspark.sql.types as T  # noqa: N812
    from pyspark.sql import DataFrame
except ImportError as error:
    raise ImportError("quadlift.spark needs pyspark and pyarrow: pip install pyspark[sql] pyarrow") from error

from . import _checks, batches
from ._core import QuadliftError
from .batches import _tables
from .batches._cameras import CAMERA
from .batches._detections import OF_OBJECTS, OF_SCENES, Settings

if TYPE_CHECKING:
    from numpy.typing import ArrayLike
    from pyspark.sql import Column

__all__ = ["localize", "noise"]

_log = logging.getLogger("quadlift")


def localize(
    detections: DataFrame,
    cameras: DataFrame,
    *,
    noise_model: Mapping[str, float] | None = None,
    body: str = "auto",
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    occluded_edges: bool = True,
    broadcast_cameras: int = 100_000,
    sample_objects: int = 2000,
    partitions: int | None = None,
    **options: Any,
) -> DataFrame:
    """Localizes all objects of a table of detections.

    Parameters
    ----------
    detections : DataFrame
        One row per detection, with the columns `frame` and `object` (whole numbers or texts), `x0`, `y0`, `x1`, `y1`
        (pixels) or `box`, an array of these four, and optionally `scene` (whole numbers or texts), `category` (texts)
        and `score`, and the columns of outlines, turned boxes, depths and 3D boxes of
        `quadlift.batches.localize_objects`. Without the column `object`, detections are associated scene by scene.
    cameras : DataFrame
        One row per frame, with the columns of `quadlift.batches.Cameras`: `scene` if the detections have it, `frame`,
        `projection` or `intrinsics` and `cam_from_world`, optionally `width` and `height`.
    noise_model : mapping, optional
        Noise levels, as in `Estimates.noise`.
    body : str
        As in `quadlift.localize`. If `noise_model` is missing or this is ``"auto"``, they are estimated immediately,
        on the driver, from a sample of the objects that depends on their ids only. Without the column `object`, they
        are estimated for each scene separately.
    up : str or array_like, shape (3,), optional
        World direction against gravity: an axis such as ``"-y"``, or a direction.
    length_unit : str, optional
        World unit; ``"m"`` is required for ``priors="builtin"``.
    occluded_edges : bool
        Detect box edges that are probably hidden by another box of the frame, as the program does for
        ``method="posterior"``. It needs an additional shuffle; without it results differ for overlapping boxes.
    broadcast_cameras : int
        Up to this number of frames (150 bytes each) all cameras are broadcast to every task; beyond it they are joined
        to the detections. The results are the same.
    sample_objects : int
        Number of objects in the sample, at most 2000.
    partitions : int, optional
        Number of localization tasks. By default Spark chooses it by the size of the tables, which are small relative to
        the work: on a large cluster use a few per core.
    **options
        `method`, `priors`, `min_views`, `reg_weight`, `seed` as in `quadlift.localize`, and without the column `object`
        also `associate`, `ids`, `upright`, `ground_plane`, `camera_height`, `pose_noise`.

    Returns
    -------
    DataFrame
        One row per object: the columns of `quadlift.batches.schema`, lists as arrays. An object is ``"invalid"`` if one
        of its detections or cameras is invalid, and `problem` gives the reason; others are not affected.

    Raises
    ------
    QuadliftError
        If a column or an option is invalid.

    Notes
    -----
    The results do not depend on partitions and are bit-identical to those of the program and of `quadlift.localize`
    with the same `noise_model` and `body`. The order of frames is that of their ids, see `quadlift.batches.Cameras`.
    """
    flat = _flat(detections)
    cameras = _cameras(cameras, flat)
    has_objects = "object" in flat.columns
    given = {**options, "noise_model": noise_model, "body": body}
    world: dict[str, Any] = {"up": up, "length_unit": length_unit}
    settings = Settings.of(given, OF_OBJECTS if has_objects else OF_SCENES, up, length_unit)
    count = _checks.whole("sample_objects", sample_objects, 1, 2000)
    if partitions is not None:
        partitions = _checks.whole("partitions", partitions, 1)
    shared, joined = _shared_or_joined(cameras, broadcast_cameras)
    if not has_objects:
        work = partial(batches.localize_scenes, cameras=shared, **world, **given)
        return _map(_scenes(flat, joined, partitions), work, _schema(flat, T.StringType()))
    hide = occluded_edges and settings.is_map
    if not settings.is_complete():
        given["noise_model"], given["body"] = _noise(flat, shared, joined, count, hide, {**world, **given})
    rows = _objects(_with_occluded_edges(flat) if hide else flat, joined, partitions)
    work = partial(batches.localize_objects, cameras=shared, **world, **given)
    return _map(rows, work, _schema(flat, flat.schema["object"].dataType))


def noise(
    detections: DataFrame,
    cameras: DataFrame,
    *,
    up: ArrayLike | None = None,
    length_unit: str | None = None,
    occluded_edges: bool = True,
    broadcast_cameras: int = 100_000,
    sample_objects: int = 2000,
    **options: Any,
) -> tuple[dict[str, float], str]:
    """Estimates the noise levels and the kind of body from a sample of the objects, which is the first step of
    `localize`.

    Parameters
    ----------
    detections, cameras, up, length_unit, occluded_edges, broadcast_cameras, sample_objects, **options
        As in `localize`; the detections need the column `object`.

    Returns
    -------
    noise_model : dict
        For `localize`, here or on the detections of other days.
    body : str
        Likewise.
    """
    flat = _flat(detections)
    _tables.require(flat.columns, ["object"], "detections")
    settings = Settings.of(options, OF_OBJECTS, up, length_unit)
    count = _checks.whole("sample_objects", sample_objects, 1, 2000)
    shared, joined = _shared_or_joined(_cameras(cameras, flat), broadcast_cameras)
    hide = occluded_edges and settings.is_map
    return _noise(flat, shared, joined, count, hide, {**options, "up": up, "length_unit": length_unit})


def _noise(
    flat: DataFrame,
    shared: batches.Cameras | None,
    joined: DataFrame | None,
    count: int,
    hide: bool,
    options: Mapping[str, Any],
) -> tuple[dict[str, float], str]:
    """Noise levels and kind of body of a sample of the objects, brought to the driver."""
    sample = batches.sample(_objects(_sample(flat, count, hide), joined).toArrow(), count)
    return batches.noise(sample, shared, **options)


def _shared_or_joined(cameras: DataFrame, limit: int) -> tuple[batches.Cameras | None, DataFrame | None]:
    """The cameras for all tasks if they are few; otherwise their table, to be joined."""
    limit = _checks.whole("broadcast_cameras", limit, 0)
    few = cameras.limit(limit + 1).toArrow()
    return (batches.Cameras(few), None) if len(few) <= limit else (None, cameras)


def _map(rows: DataFrame, work: Any, schema: T.StructType) -> DataFrame:
    """Tables of rows in, tables out."""

    def on_batches(found: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for batch in found:
            yield from work(batch).to_batches()

    return rows.mapInArrow(on_batches, schema)


def _schema(flat: DataFrame, object_type: T.DataType) -> T.StructType:
    """The columns of `quadlift.batches.schema` as Spark columns, with the types of `scene` and `object`."""
    vector = T.ArrayType(T.DoubleType())
    types = {pa.string(): T.StringType(), pa.float64(): T.DoubleType(), pa.int64(): T.LongType()}
    fields = [T.StructField("scene", flat.schema["scene"].dataType)] if "scene" in flat.columns else []
    for field in batches.schema():
        fields.append(T.StructField(field.name, types.get(field.type, vector)))
    schema = T.StructType(fields)
    schema["object"].dataType = object_type
    return schema


# Columns

_OF_DETECTIONS = ("scene", "frame", "object", "box", *_tables.BOX, "category", "score", *_tables.SHAPES, *_tables.CUES)


def _keys(frame: DataFrame, *names: str) -> list[str]:
    """Columns of a key: the scene, if there is one, and others."""
    return [*(["scene"] if "scene" in frame.columns else []), *names]


def _flat(detections: DataFrame) -> DataFrame:
    """The columns of the detections, checked."""
    _is_table(detections, "detections")
    names = detections.columns
    _tables.require(names, ["frame"], "detections")
    for name in ("scene", "frame", "object"):
        if name in names:
            _is_id(detections, name, "detections")
    if "box" in names and (others := [name for name in _tables.BOX if name in names]):
        raise QuadliftError(f"detections has the columns 'box' and {others[0]!r}; expected one or the other")
    ignored = [name for name in names if name not in _OF_DETECTIONS]
    if "object" not in names and ignored:
        # These columns may be misnamed.
        _log.warning(
            "detections has no column 'object', so detections are associated scene by scene; ignored columns: %s",
            ", ".join(ignored),
        )
    if "box" in names:
        kind = detections.schema["box"].dataType
        if not (isinstance(kind, T.ArrayType) and isinstance(kind.elementType, T.NumericType)):
            raise QuadliftError(
                f"the column 'box' of detections is {kind.simpleString()}; expected an array of 4 numbers"
            )
        is_box = F.size("box") == 4
        edges = [F.when(is_box, F.get("box", F.lit(k))) for k in range(4)]
    else:
        _tables.require(names, _tables.BOX, "detections, without a column 'box',")
        edges = [_number(detections, name, "detections") for name in _tables.BOX]
    columns = [F.col(name) for name in ("scene", "object", "frame") if name in names]
    columns += [edge.cast("double").alias(name) for name, edge in zip(_tables.BOX, edges, strict=True)]
    if "category" in names:
        columns.append(F.col("category").cast("string"))
    if "score" in names:
        columns.append(_number(detections, "score", "detections").cast("double").alias("score"))
    columns += [_cue(detections, name) for name in (*_tables.SHAPES, *_tables.CUES) if name in names]
    return detections.select(*columns)


def _cue(detections: DataFrame, name: str) -> Column:
    """A column of outlines, turned boxes, depths and 3D boxes: texts, lists of numbers, or numbers."""
    if name.endswith(("_source", "_frame")):
        return F.col(name).cast("string")
    if name not in _tables.LISTS and name != "outline":
        return _number(detections, name, "detections").cast("double").alias(name)
    kind = detections.schema[name].dataType
    if not (isinstance(kind, T.ArrayType) and isinstance(kind.elementType, T.NumericType)):
        expected = f"an array of {_tables.LISTS[name]} numbers" if name in _tables.LISTS else "an array of numbers"
        raise QuadliftError(f"the column {name!r} of detections is {kind.simpleString()}; expected {expected}")
    return F.col(name).cast("array<double>").alias(name)


def _cameras(cameras: DataFrame, flat: DataFrame) -> DataFrame:
    """The columns of the cameras, checked."""
    _is_table(cameras, "cameras")
    names = cameras.columns
    if "scene" in names and "scene" not in flat.columns:
        raise QuadliftError("cameras has a column 'scene', detections has none")
    wanted = [*_keys(flat, "frame"), *(["projection"] if "projection" in names else ["intrinsics", "cam_from_world"])]
    _tables.require(names, wanted, "cameras")
    for name in _keys(flat, "frame"):
        _is_id(cameras, name, "cameras")
        found, expected = cameras.schema[name].dataType, flat.schema[name].dataType
        if isinstance(found, T.StringType) != isinstance(expected, T.StringType):
            raise QuadliftError(
                f"the column {name!r} is {found.simpleString()} in cameras and {expected.simpleString()} in detections"
            )
    return cameras.select(*_keys(flat, "frame"), *(name for name in CAMERA if name in names))


def _is_table(table: Any, name: str) -> None:
    if not isinstance(table, DataFrame):
        raise QuadliftError(f"{name} is a {type(table).__module__}.{type(table).__name__}; expected a Spark DataFrame")


def _is_id(frame: DataFrame, name: str, table: str) -> None:
    kind = frame.schema[name].dataType
    if not isinstance(kind, T.IntegralType | T.StringType):
        raise QuadliftError(f"the column {name!r} of {table} is {kind.simpleString()}; expected whole numbers or texts")


def _number(frame: DataFrame, name: str, table: str) -> Column:
    kind = frame.schema[name].dataType
    if not isinstance(kind, T.NumericType):
        raise QuadliftError(f"the column {name!r} of {table} is {kind.simpleString()}; expected numbers")
    return F.col(name)


def _is_known(flat: DataFrame) -> Column:
    """Whether a detection has an object id."""
    is_text = isinstance(flat.schema["object"].dataType, T.StringType)
    return F.col("object").isNotNull() & ((F.col("object") != "") if is_text else (F.col("object") >= 0))


# Grouping


def _lists(rows: DataFrame, keys: Sequence[str], names: Sequence[str]) -> DataFrame:
    """The fields of a column `views`, an array of structs, as columns of arrays."""
    kept = [name for name in rows.columns if name not in ("views", *keys)]
    return rows.select(*keys, *(F.col("views").getField(name).alias(name) for name in names), *kept)


def _with_occluded_edges(flat: DataFrame) -> DataFrame:
    """The detections with the column `occluded_edges` and, if there are outlines, `occluded_lines`."""
    keys = _keys(flat, "frame")
    names = [name for name in flat.columns if name not in keys]
    frames = flat.groupBy(*keys).agg(F.collect_list(F.struct(*names)).alias("views"))
    rows = _lists(frames, keys, names)
    hidden = [T.StructField("occluded_edges", T.ByteType())]
    if "outline" in names:
        hidden.append(T.StructField("occluded_lines", T.ShortType()))
    schema = T.StructType([*(flat.schema[name] for name in (*keys, *names)), *hidden])
    return _map(rows, _hide, schema)


def _hide(batch: pa.RecordBatch) -> pa.Table:
    return batches.ungroup(batches.with_occluded_edges(batch))


def _objects(flat: DataFrame, cameras: DataFrame | None, partitions: int | None = None) -> DataFrame:
    """One row per object, with its cameras if given. Detections without an object are excluded."""
    keys = _keys(flat, "object")
    names = [name for name in flat.columns if name not in keys]
    views = [F.collect_list(F.when(_is_known(flat), F.struct(*names))).alias("views")]
    if cameras is not None:
        # All cameras of a frame, in case there are several; frames without one have null, which is not collected.
        on = _keys(flat, "frame")
        of_frame = cameras.groupBy(*on).agg(_structs(cameras))
        flat = flat.join(of_frame, on, "left")
        views.append(F.flatten(F.collect_list(F.when(_is_known(flat), F.col("cameras")))).alias("cameras"))
    return _lists(_spread(flat, keys, partitions).groupBy(*keys).agg(*views), keys, names)


def _scenes(flat: DataFrame, cameras: DataFrame | None, partitions: int | None) -> DataFrame:
    """One row per scene, with its cameras if given."""
    keys = _keys(flat)
    names = [name for name in flat.columns if name not in keys]
    views = F.collect_list(F.struct(*names)).alias("views")
    rows = _lists(_spread(flat, keys, partitions).groupBy(*keys).agg(views), keys, names)
    # Without scenes there is one row, even if there are no detections.
    rows = rows.filter(F.size("frame") > 0)
    if cameras is None:
        return rows
    of_scene = cameras.groupBy(*keys).agg(_structs(cameras))
    return rows.join(of_scene, keys, "left") if keys else rows.crossJoin(of_scene)


def _spread(flat: DataFrame, keys: Sequence[str], partitions: int | None) -> DataFrame:
    """The detections repartitioned by the keys; the grouping keeps these partitions."""
    return flat.repartition(partitions, *keys) if keys and partitions is not None else flat


def _structs(cameras: DataFrame) -> Column:
    return F.collect_list(F.struct(*(name for name in cameras.columns if name != "scene"))).alias("cameras")


# The sample


def _hash(flat: DataFrame) -> Column:
    """The hash of `quadlift.batches.sample` as text; null without an object."""
    scene = F.coalesce(F.col("scene").cast("string"), F.lit("")) if "scene" in flat.columns else F.lit("")
    return F.when(_is_known(flat), F.sha2(F.concat_ws("\n", scene, F.col("object").cast("string")), 256))


def _sample(flat: DataFrame, count: int, hide: bool) -> DataFrame:
    """All detections of the objects with the smallest hashes."""
    hashes = flat.select(_hash(flat).alias("hash")).dropna().distinct().orderBy("hash").limit(count)
    last = hashes.agg(F.max("hash")).collect()[0][0]
    is_chosen = _hash(flat) <= F.lit(last).cast("string")
    if not hide:
        return flat.filter(is_chosen)
    # Only the frames of these objects are needed. Null is joined to nothing, but the chosen rows are kept.
    keys = _keys(flat, "frame")
    frames = flat.filter(is_chosen).select(*keys).distinct().withColumn("near", F.lit(True))
    near = flat.join(frames, keys, "left").filter(is_chosen | F.col("near")).select(*flat.columns)
    return _with_occluded_edges(near).filter(is_chosen)
