"""quadlift on Spark: the same numbers, however it is spread, and whatever happens on the way."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

pytest.importorskip("pyspark")

from pyspark.sql import DataFrame, SparkSession
from pyspark.sql import functions as F  # noqa: N812

import quadlift.spark
from conftest import Program, as_written, read_json
from fleet import Fleet, assert_same, count_ok, made_fleet, statuses
from quadlift import batches

pytestmark = pytest.mark.scale_out

NOISE_MODEL = {"edge_noise": 0.02, "edge_noise_px": 0.3, "occluded_edge_noise": 0.05, "edge_correlation": 0.2}
GIVEN: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}


def session(master: str) -> SparkSession:
    os.environ["PYSPARK_PYTHON"] = sys.executable
    settings: dict[str, Any] = {
        "spark.ui.enabled": "false",
        "spark.sql.shuffle.partitions": "3",
        "spark.driver.host": "127.0.0.1",
        "spark.driver.bindAddress": "127.0.0.1",
        "spark.log.level": "ERROR",
    }
    return SparkSession.builder.master(master).config(map=settings).getOrCreate()


@pytest.fixture(scope="module")
def spark() -> Iterator[SparkSession]:
    # A task may fail three times.
    found = session("local[2,4]")
    yield found
    found.stop()


@pytest.fixture(scope="module")
def fleet(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    return made_fleet(program, tmp_path_factory.mktemp("fleet"))


@pytest.fixture
def detections(spark: SparkSession, fleet: Fleet) -> DataFrame:
    return spark.createDataFrame(fleet.shuffled())


@pytest.fixture
def cameras(spark: SparkSession, fleet: Fleet) -> DataFrame:
    return spark.createDataFrame(fleet.cameras)


# The same numbers


@pytest.mark.parametrize("limit", [100_000, 32, 0])
@pytest.mark.parametrize("parts", [1, 7])
def test_same_as_localize(fleet: Fleet, detections: DataFrame, cameras: DataFrame, parts: int, limit: int) -> None:
    found = quadlift.spark.localize(detections.repartition(parts), cameras, broadcast_cameras=limit, **GIVEN).toArrow()
    assert_same(found, fleet.expected(**GIVEN))
    assert count_ok(found) >= 18
    kinds = dict(zip(found["object"].to_pylist(), found["category"].to_pylist(), strict=True))
    assert kinds["object_001"] == "car"
    assert kinds["object_005"] == "bus"


def test_depths_and_3d_boxes(fleet: Fleet, spark: SparkSession, cameras: DataFrame) -> None:
    table = fleet.shuffled()
    count, rng = len(table), np.random.default_rng(3)
    depths = [None if k % 7 == 0 else float(x) for k, x in enumerate(rng.uniform(5.0, 50.0, count))]
    centers = [None if k % 5 == 0 else [0.1, -0.2, float(x)] for k, x in enumerate(rng.uniform(5.0, 50.0, count))]
    table = table.append_column("depth_median", pa.array(depths, pa.float64()))
    table = table.append_column("depth_source", pa.array(["net"] * count))
    table = table.append_column("box3d_center", pa.array(centers, pa.list_(pa.float64())))
    table = table.append_column("box3d_sd_distance", pa.array([0.2] * count))
    found = quadlift.spark.localize(spark.createDataFrame(table), cameras, **GIVEN).toArrow()
    frames = batches.with_occluded_edges(batches.group(table, ["scene", "frame"]))
    rows = batches.group(batches.ungroup(frames), ["scene", "object"])
    assert_same(found, batches.localize_objects(rows, fleet.cameras, **GIVEN))
    assert found["center"].to_pylist() != fleet.expected(**GIVEN)["center"].to_pylist()
    wrong = spark.createDataFrame(table.drop_columns("box3d_center").append_column("box3d_center", pa.array(depths)))
    with pytest.raises(quadlift.QuadliftError, match="the column 'box3d_center' of detections is double"):
        quadlift.spark.localize(wrong, cameras, **GIVEN)


def test_partitions_can_be_chosen(fleet: Fleet, detections: DataFrame, cameras: DataFrame) -> None:
    found = quadlift.spark.localize(detections, cameras, partitions=5, **GIVEN)
    assert found.rdd.getNumPartitions() == 5
    assert_same(found.toArrow(), fleet.expected(**GIVEN))


def test_same_as_the_program(
    program: Program, fleet: Fleet, detections: DataFrame, cameras: DataFrame, tmp_path: Path
) -> None:
    levels = ",".join(f"{name}={value}" for name, value in NOISE_MODEL.items())
    rows = quadlift.spark.localize(detections, cameras, **GIVEN).toArrow().to_pylist()
    compared = 0
    for name, path in fleet.files.items():
        given = ["--noise-model", levels, "--body", "ellipsoid", "--no-upright"]
        program("localize", "-q", path, "-o", tmp_path / "result.json", *given)
        of_id = {o["id"]: o for o in read_json(tmp_path / "result.json")["objects"]}
        mine = [row for row in rows if row["scene"] == name]
        assert sorted(row["object"] for row in mine) == sorted(of_id)
        for row in mine:
            theirs = of_id[row["object"]]
            assert (row["status"], row["views_used"]) == (theirs["status"], theirs["views_used"])
            assert row["center"] == theirs.get("center")
            if theirs["status"] == "ok":
                assert row["semi_axes"] == theirs["ellipsoid"]["semi_axes"]
                assert row["quaternion"] == theirs["ellipsoid"]["rotation"]
                assert row["enclosing_semi_axes"] == theirs["enclosing_ellipsoid"]["semi_axes"]
                assert as_written(row["covariance"], 9).tolist() == np.ravel(theirs["covariance"]["matrix"]).tolist()
                assert as_written(row["center_sd"], 6) == theirs["center_sd"]
                compared += 1
    assert compared >= 18


def test_noise_from_a_sample(fleet: Fleet, detections: DataFrame, cameras: DataFrame) -> None:
    """It depends on ids only: not on partitions, not on where the cameras come from, not on the engine."""
    frames = batches.with_occluded_edges(batches.group(fleet.detections, ["scene", "frame"]))
    rows = batches.group(batches.ungroup(frames), ["scene", "object"])
    noise_model, body = batches.noise(batches.sample(rows, 9), fleet.cameras)
    expected = batches.localize_objects(rows, fleet.cameras, noise_model=noise_model, body=body)
    for parts, limit in ((1, 1000), (5, 0)):
        some = detections.repartition(parts)
        found = quadlift.spark.localize(some, cameras, sample_objects=9, broadcast_cameras=limit)
        assert_same(found.toArrow(), expected)
    # Found apart, to be kept.
    assert quadlift.spark.noise(detections, cameras, sample_objects=9) == (noise_model, body)
    # One of the two may be given.
    cuboids = batches.noise(batches.sample(rows, 9), fleet.cameras, body="cuboid")[0]
    expected = batches.localize_objects(rows, fleet.cameras, noise_model=cuboids, body="cuboid")
    found = quadlift.spark.localize(detections, cameras, sample_objects=9, body="cuboid")
    assert_same(found.toArrow(), expected)


def test_without_occluded_edges(fleet: Fleet, detections: DataFrame, cameras: DataFrame) -> None:
    rows = batches.group(fleet.detections, ["scene", "object"])
    expected = batches.localize_objects(rows, fleet.cameras, **GIVEN)
    assert_same(quadlift.spark.localize(detections, cameras, occluded_edges=False, **GIVEN).toArrow(), expected)
    # The closed forms do not look at them.
    expected = batches.localize_objects(rows, fleet.cameras, method="lfd")
    assert_same(quadlift.spark.localize(detections, cameras, method="lfd").toArrow(), expected)


def test_other_columns(fleet: Fleet, spark: SparkSession) -> None:
    """One scene without a name, whole numbers as ids, boxes as arrays, projections."""
    name = next(iter(fleet.files))
    mine = [row for row in fleet.detections.to_pylist() if row["scene"] == name]
    rows = [
        (int(row["object"][-3:]), int(row["frame"]), [row[edge] for edge in ("x0", "y0", "x1", "y1")]) for row in mine
    ]
    cameras = []
    for camera in fleet.cameras.to_pylist():
        if camera["scene"] == name:
            fx, fy, cx, cy = camera["intrinsics"]
            pose = np.reshape(camera["cam_from_world"], (3, 4))
            matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]) @ pose
            cameras.append((int(camera["frame"]), matrix.ravel().tolist(), 1280.0, 960.0))
    detections = spark.createDataFrame(rows, "object int, frame short, box array<double>")
    table = spark.createDataFrame(cameras, "frame long, projection array<double>, width double, height double")
    found = quadlift.spark.localize(detections, table, **GIVEN)
    assert found.schema["object"].dataType.simpleString() == "int"
    order = np.argsort([camera[0] for camera in cameras])
    number = {cameras[k][0]: place for place, k in enumerate(order)}
    expected = quadlift.localize(
        projections=[np.reshape(cameras[k][1], (3, 4)) for k in order],
        image_sizes=[cameras[k][2:] for k in order],
        frames=[number[row[1]] for row in rows],
        boxes=[row[2] for row in rows],
        objects=[row[0] for row in rows],
        **GIVEN,
    )
    assert_same(found.toArrow(), expected.to_arrow().set_column(0, "object", pa.array(expected.object_ids, pa.int32())))


def test_scenes_without_ids(fleet: Fleet, detections: DataFrame, cameras: DataFrame) -> None:
    columns = ["scene", "frame", "x0", "y0", "x1", "y1", "category"]
    expected = batches.localize_scenes(batches.group(fleet.detections.select(columns), ["scene"]), fleet.cameras)
    assert count_ok(expected) >= 15
    for limit in (1000, 0):
        found = quadlift.spark.localize(detections.drop("object"), cameras, broadcast_cameras=limit)
        assert_same(found.toArrow(), expected)
    # A scene without a name.
    one = detections.filter(F.col("scene") == "drive 1").drop("object", "scene")
    of_one = cameras.filter(F.col("scene") == "drive 1").drop("scene")
    expected = expected.filter(pa.compute.equal(expected["scene"], "drive 1")).drop_columns("scene")
    for limit in (1000, 0):
        assert_same(quadlift.spark.localize(one, of_one, broadcast_cameras=limit).toArrow(), expected)
    nothing = quadlift.spark.localize(one.limit(0), of_one)
    assert nothing.columns == batches.schema().names
    assert nothing.count() == 0


# What is wrong with rows


@pytest.mark.parametrize("limit", [1000, 0])
def test_poison(fleet: Fleet, spark: SparkSession, cameras: DataFrame, limit: int) -> None:
    scene = next(iter(fleet.files))
    frame = fleet.cameras["frame"][0].as_py()
    box = {"x0": 1.0, "y0": 1.0, "x1": 9.0, "y1": 9.0}
    bad: dict[str, dict[str, Any]] = {
        "NaN": {"x0": float("nan")},
        "reversed": {"x0": 10.0},
        "null": {"y1": None},
        "no frame": {"frame": None},
        "unknown frame": {"frame": "nowhere"},
        "unknown scene": {"scene": "nowhere"},
        "broken camera": {"frame": "broken"},
        "two cameras": {"frame": "two"},
    }
    rows = [
        {"scene": scene, "frame": frame, "object": name, **box, "category": None, **what} for name, what in bad.items()
    ]
    rows += [{"scene": scene, "frame": frame, "object": "twice", **box, "category": None}] * 2
    rows += [{"scene": scene, "frame": frame, "object": None, **box, "category": None, "y0": 8.0}] * 3
    camera = fleet.cameras.to_pylist()[0]
    more = [{**camera, "frame": "broken", "cam_from_world": [0.0] * 12}, {**camera, "frame": "two"}]
    more.append({**camera, "frame": "two", "width": 5.0})
    of_poison = spark.createDataFrame(pa.Table.from_pylist(more, schema=fleet.cameras.schema))
    poisoned = pa.concat_tables([fleet.shuffled(), pa.Table.from_pylist(rows, schema=fleet.detections.schema)])
    detections, cameras = spark.createDataFrame(poisoned), cameras.union(of_poison)
    found = quadlift.spark.localize(detections, cameras, broadcast_cameras=limit, **GIVEN).toArrow()
    is_good = pa.compute.starts_with(found["object"], "object_").fill_null(False)
    # Small boxes in the corner hide nothing.
    assert_same(found.filter(is_good), fleet.expected(**GIVEN))
    told = statuses(found.filter(pa.compute.invert(is_good)))
    texts = {
        "NaN": f'frame "{frame}": ',
        "reversed": "empty or reversed",
        "null": f'frame "{frame}": ',
        "no frame": "a detection has no frame",
        "unknown frame": 'frame "nowhere": there is no such camera',
        "unknown scene": f'frame "{frame}": there is no such camera',
        "broken camera": 'frame "broken": ',
        "two cameras": 'frame "two": it has several cameras, which differ',
        "twice": f'frame "{frame}": the object is in it twice',
        None: "these detections have no object id",
    }
    assert told.keys() == texts.keys()
    for name, text in texts.items():
        status, problem = told[name]
        assert status == "invalid"
        assert problem is not None
        assert text in problem
    # The first pass does not mind either.
    again = quadlift.spark.localize(detections, cameras, broadcast_cameras=limit).toArrow()
    frames = batches.with_occluded_edges(batches.group(poisoned, ["scene", "frame"]))
    objects = batches.group(batches.ungroup(frames), ["scene", "object"])
    of_all = batches.Cameras(cameras.toArrow())
    noise_model, body = batches.noise(batches.sample(objects), of_all)
    assert_same(again, batches.localize_objects(objects, of_all, noise_model=noise_model, body=body))


def test_empty(detections: DataFrame, cameras: DataFrame) -> None:
    nothing = quadlift.spark.localize(detections.limit(0), cameras)
    assert nothing.columns == batches.schema(scene_type=pa.string()).names
    assert nothing.count() == 0
    lost = quadlift.spark.localize(detections, cameras.limit(0)).toArrow()
    assert set(lost["status"].to_pylist()) == {"invalid"}


def test_refusals(detections: DataFrame, cameras: DataFrame) -> None:
    def localize(d: Any = detections, c: Any = cameras, **options: Any) -> Any:
        return lambda: quadlift.spark.localize(d, c, **options)

    texts = {
        "detections has no column 'frame'": localize(detections.drop("frame")),
        "detections, without a column 'box', has no column 'x0'": localize(detections.drop("x0")),
        "cameras has no column 'scene'": localize(c=cameras.drop("scene")),
        "cameras has a column 'scene', detections has none": localize(detections.drop("scene")),
        "cameras has no column 'intrinsics'": localize(c=cameras.drop("intrinsics")),
        "the column 'object' of detections is double": localize(detections.withColumn("object", F.lit(1.0))),
        "the column 'x1' of detections is string": localize(detections.withColumn("x1", F.lit("9"))),
        "the column 'frame' is int in cameras and string": localize(c=cameras.withColumn("frame", F.lit(1))),
        "the column 'box' of detections is string": localize(
            detections.drop("x0", "y0", "x1", "y1").withColumn("box", F.lit("1 2 3 4"))
        ),
        "detections has the columns 'box' and 'x0'; expected one or the other": localize(
            detections.withColumn("box", F.array("x0", "y0", "x1", "y1"))
        ),
        "detections is a pyarrow.lib.Table; expected a Spark DataFrame": localize(detections.toArrow()),
        "cameras is a builtins.NoneType; expected a Spark DataFrame": localize(c=None),
        "ground_plane is an option of whole scenes": localize(ground_plane=True),
        "there is no option 'threads' here": localize(threads=3),
        'body is "sphere"': localize(body="sphere"),
        "broadcast_cameras is -1": localize(broadcast_cameras=-1),
        "partitions is 0": localize(partitions=0),
    }
    for text, call in texts.items():
        with pytest.raises(quadlift.QuadliftError) as refused:
            call()
        assert text in str(refused.value)


def test_a_column_that_may_have_been_meant_is_named(
    detections: DataFrame, cameras: DataFrame, caplog: pytest.LogCaptureFixture
) -> None:
    quadlift.spark.localize(detections.withColumnRenamed("object", "track_id"), cameras)
    assert (
        "detections has no column 'object', so detections are associated scene by scene; ignored columns: track_id"
        in (caplog.messages)
    )
    caplog.clear()
    quadlift.spark.localize(detections.drop("object"), cameras)
    assert not caplog.messages
    with pytest.raises(quadlift.QuadliftError, match="detections has no column 'object'"):
        quadlift.spark.noise(detections.drop("object"), cameras)


# Workers that die


def die_once(marker: str, executor: bool) -> Any:
    """A step behind the localization, in the same task, whose first worker (or the executor above it) is killed."""

    def step(found: Iterator[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
        for batch in found:
            try:
                os.close(os.open(marker, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                yield batch
                continue
            if executor:
                # The worker was forked by a daemon, which the executor has started.
                status = Path(f"/proc/{os.getppid()}/status").read_text()
                os.kill(int(status.split("PPid:")[1].split()[0]), signal.SIGKILL)
            os._exit(1)

    return step


def test_a_worker_dies(fleet: Fleet, detections: DataFrame, cameras: DataFrame, tmp_path: Path) -> None:
    found = quadlift.spark.localize(detections, cameras, **GIVEN)
    marker = tmp_path / "killed"
    assert_same(found.mapInArrow(die_once(str(marker), False), found.schema).toArrow(), fleet.expected(**GIVEN))
    assert marker.exists()


def test_an_executor_dies(fleet: Fleet, spark: SparkSession, tmp_path: Path) -> None:
    """On a cluster of two executors, which are processes of their own."""
    spark.stop()
    cluster = session("local-cluster[2,1,1024]")
    try:
        tables = [cluster.createDataFrame(table) for table in (fleet.shuffled(), fleet.cameras)]
        found = quadlift.spark.localize(*tables, **GIVEN)
        marker = tmp_path / "killed"
        assert_same(found.mapInArrow(die_once(str(marker), True), found.schema).toArrow(), fleet.expected(**GIVEN))
        assert marker.exists()
    finally:
        cluster.stop()
