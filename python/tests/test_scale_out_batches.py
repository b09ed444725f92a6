"""Tables of objects and of scenes, without an engine."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import quadlift
from conftest import Arrays, Program, made_scene
from fleet import Fleet, assert_same, comparable, count_ok, made_fleet, statuses
from quadlift import batches
from quadlift.batches import _detections

NOISE_MODEL = {"edge_noise": 0.02, "edge_noise_px": 0.3, "occluded_edge_noise": 0.05, "edge_correlation": 0.2}
KEYS = ["scene", "object"]


@pytest.fixture(scope="module")
def fleet(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    return made_fleet(program, tmp_path_factory.mktemp("fleet"))


def of_objects(detections: pa.Table) -> pa.Table:
    """Rows of objects, with occluded edges."""
    frames = batches.with_occluded_edges(batches.group(detections, ["scene", "frame"]))
    return batches.group(batches.ungroup(frames), KEYS)


def tables(made: Arrays) -> tuple[pa.Table, pa.Table]:
    """Rows of objects and cameras of a scene without a name, whose ids are numbers."""
    boxes = dict(zip(("x0", "y0", "x1", "y1"), made.boxes.T, strict=True))
    detections = pa.table({"object": made.objects, "frame": made.frames, **boxes})
    projections = pa.array(made.projections.reshape(-1, 12).tolist())
    width, height = made.image_sizes.T
    frames = np.arange(len(projections))
    cameras = pa.table({"frame": frames, "projection": projections, "width": width, "height": height})
    return batches.group(detections, ["object"]), cameras


# The same numbers


@pytest.mark.parametrize("body", ["ellipsoid", "cuboid", "superellipsoid:1.5"])
def test_same_as_scenes(fleet: Fleet, body: str) -> None:
    rows = of_objects(fleet.shuffled())
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": body, "seed": 5}
    found = batches.localize_objects(rows, fleet.cameras, up=fleet.up, **options)
    assert found.schema == batches.schema(pa.string(), pa.string())
    assert_same(found, fleet.expected(**options))
    assert count_ok(found) >= 18
    # One row at a time.
    single = [
        batches.localize_objects(rows.slice(k, 1), fleet.cameras, up=fleet.up, **options) for k in range(len(rows))
    ]
    assert pa.concat_tables(single).equals(found)


def test_priors(fleet: Fleet) -> None:
    """Sizes of categories and upright stance, which each object has for itself."""
    prior: dict[str, Any] = {"size": (6.0, 6.0, 6.0), "size_sd": (1.0, 1.0, 1.0), "upright_sd": 0.1}
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid", "priors": {"car": prior}}
    rows = of_objects(fleet.shuffled())
    found = batches.localize_objects(rows, fleet.cameras, up=fleet.up, **options)
    assert_same(found, fleet.expected(**options))
    without = batches.localize_objects(rows, fleet.cameras, up=fleet.up, noise_model=NOISE_MODEL, body="ellipsoid")
    changed = [a != b for a, b in zip(found["center"].to_pylist(), without["center"].to_pylist(), strict=True)]
    assert changed == [kind == "car" for kind in found["category"].to_pylist()]


def test_occluded_edges_count(fleet: Fleet) -> None:
    rows = of_objects(fleet.detections)
    masks = np.concatenate(rows["occluded_edges"].to_pylist())
    assert set(masks) == {0, 1, 4, 5}
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    found = batches.localize_objects(rows.drop_columns("occluded_edges"), fleet.cameras, **options)
    assert not comparable(found).equals(fleet.expected(**options))


def test_closed_form(fleet: Fleet) -> None:
    found = batches.localize_objects(of_objects(fleet.detections), fleet.cameras, method="planes")
    assert_same(found, fleet.expected(method="planes"))


def test_noise_is_that_of_a_scene(made: Arrays) -> None:
    rows, cameras = tables(made)
    frames = batches.with_occluded_edges(batches.group(batches.ungroup(rows), ["frame"]))
    with_edges = batches.group(batches.ungroup(frames), ["object"])
    whole = quadlift.localize(**made.arguments())
    noise_model, body = batches.noise(with_edges, cameras)
    assert (noise_model, body) == (whole.noise, whole.body)
    # What is given stays.
    assert batches.noise(rows, cameras, noise_model=NOISE_MODEL, body="cuboid") == (NOISE_MODEL, "cuboid")
    found = batches.localize_objects(rows, cameras, noise_model=noise_model, body=body)
    assert found["object"].to_pylist() == whole.object_ids.tolist()


def test_own_cameras(fleet: Fleet) -> None:
    """Rows that bring their cameras give the same bits."""
    rows = of_objects(fleet.detections)
    of_frame = {(c["scene"], c["frame"]): c for c in fleet.cameras.to_pylist()}
    own = []
    for scene, frames in zip(rows["scene"].to_pylist(), rows["frame"].to_pylist(), strict=True):
        own.append([{k: v for k, v in of_frame[scene, frame].items() if k != "scene"} for frame in reversed(frames)])
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    expected = batches.localize_objects(rows, fleet.cameras, **options)
    assert batches.localize_objects(rows.append_column("cameras", pa.array(own)), **options).equals(expected)


def test_ids_may_be_numbers() -> None:
    """Numbers and texts in the same order give the same."""
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    made = made_scene(objects=3, views=12)
    rows, cameras = tables(made)
    found = batches.localize_objects(rows, cameras, **options)
    assert found.schema.field("object").type == pa.int64()

    named = [[f"{frame:03}" for frame in frames] for frames in rows["frame"].to_pylist()]
    texts = rows.set_column(1, "frame", pa.array(named, pa.large_list(pa.large_string())))
    names = pa.array([f"{frame:03}" for frame in cameras["frame"].to_pylist()]).dictionary_encode()
    assert batches.localize_objects(texts, cameras.set_column(0, "frame", names), **options).equals(found)
    views = quadlift.localize(**made.arguments(), **options)
    np.testing.assert_array_equal(found["center"].to_pylist(), views.centers)


def test_texts_are_in_the_order_of_texts() -> None:
    made = made_scene(objects=3, views=12)
    rows, cameras = tables(made)
    options: dict[str, Any] = {"noise_model": {**NOISE_MODEL, "edge_correlation": 0.8}, "body": "ellipsoid"}
    named = [[str(frame) for frame in frames] for frames in rows["frame"].to_pylist()]
    names = [str(frame) for frame in cameras["frame"].to_pylist()]
    found = batches.localize_objects(
        rows.set_column(1, "frame", pa.array(named)), cameras.set_column(0, "frame", pa.array(names)), **options
    )
    order = sorted(range(12), key=str)
    expected = quadlift.localize(
        projections=made.projections[order],
        image_sizes=made.image_sizes,
        frames=[order.index(frame) for frame in made.frames],
        boxes=made.boxes,
        objects=made.objects,
        **options,
    )
    np.testing.assert_array_equal(found["covariance"].to_pylist(), expected.covariances.reshape(-1, 81))
    assert not found.equals(batches.localize_objects(rows, cameras, **options))


# What is wrong with rows


def wrong(rows: pa.Table, row: int, **columns: Any) -> pa.Table:
    """The table with other entries in a row."""
    entries = rows.to_pylist()
    entries[row] |= columns
    return pa.Table.from_pylist(entries, schema=rows.schema)


NAN = float("nan")
POISON: dict[str, tuple[str, Any, str]] = {
    "box of NaN": ("x0", [NAN, *[0.0] * 5], "frame 0: the box ["),
    "reversed box": ("x0", [1e6, *[0.0] * 5], "is empty or reversed"),
    "infinite box": ("y1", [float("inf"), *[1e4] * 5], "not finite"),
    "no number": ("x1", [None, *[1e4] * 5], "frame 0: the box ["),
    "no frame": ("frame", [0, 1, 2, 3, 4, None], "a detection has no frame"),
    "unknown frame": ("frame", [0, 1, 2, 3, 4, 99], "frame 99: there is no such camera"),
    "frame twice": ("frame", [0, 1, 2, 3, 4, 4], "frame 4: the object is in it twice"),
    "short list": ("y0", [0.0] * 5, "lists of different lengths: 6 frame, 6 x0, 5 y0, 6 x1, 6 y1"),
    "no list": ("y0", None, "lists of different lengths"),
    "no object": ("object", None, "these detections have no object id"),
    "negative object": ("object", -1, "these detections have no object id"),
}


@pytest.mark.parametrize("name", list(POISON))
def test_poison(made: Arrays, name: str) -> None:
    column, value, text = POISON[name]
    rows, cameras = tables(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = batches.localize_objects(rows, cameras, **options)
    found = batches.localize_objects(wrong(rows, 2, **{column: value}), cameras, **options)
    others = pa.array([True, True, False, True])
    assert found.filter(others).equals(good.filter(others))
    row = found.to_pylist()[2]
    assert row["status"] == "invalid"
    assert text in row["problem"]
    assert all(row[name] is None for name in row if name not in ("object", "status", "problem"))
    # A sample leaves it out.
    noise_model, _ = batches.noise(wrong(rows, 2, **{column: value}), cameras, body="ellipsoid")
    assert noise_model == batches.noise(rows.filter(others), cameras, body="ellipsoid")[0]


def test_empty_rows(made: Arrays) -> None:
    rows, cameras = tables(made)
    empty = wrong(rows, 1, **{name: [] for name in ("frame", "x0", "y0", "x1", "y1")})
    found = batches.localize_objects(empty, cameras, noise_model=NOISE_MODEL, body="ellipsoid")
    assert statuses(found)[1] == ("invalid", "there are no detections")
    nothing = batches.localize_objects(rows.slice(0, 0), cameras, noise_model=NOISE_MODEL, body="ellipsoid")
    assert nothing.schema == found.schema
    assert len(nothing) == 0
    assert batches.noise(rows.slice(0, 0), cameras) == ({}, "ellipsoid")


BROKEN: dict[str, tuple[str, Any, str]] = {
    "NaN": ("projection", [NAN] * 12, "frame 3: the projection "),
    "short": ("projection", [1.0] * 11, "frame 3: projection does not have 12 numbers"),
    "none": ("projection", None, "frame 3: projection does not have 12 numbers"),
    "zeros": ("projection", [0.0] * 12, "frame 3: the left 3x3 block of the projection is singular"),
    "no size": ("width", None, "frame 3: width and height are not positive numbers"),
    "negative size": ("height", -1.0, "frame 3: width and height are not positive numbers"),
}


@pytest.mark.parametrize("name", list(BROKEN))
def test_broken_cameras(made: Arrays, name: str) -> None:
    column, value, text = BROKEN[name]
    rows, cameras = tables(made)
    # The first object is not seen in that frame.
    lists = {n: rows[n][0].as_py()[:3] + rows[n][0].as_py()[4:] for n in ("frame", "x0", "y0", "x1", "y1")}
    rows = wrong(rows, 0, **lists)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = batches.localize_objects(rows, cameras, **options)
    found = batches.localize_objects(rows, wrong(cameras, 3, **{column: value}), **options)
    assert found.slice(0, 1).equals(good.slice(0, 1))
    for status, problem in list(statuses(found).values())[1:]:
        assert status == "invalid"
        assert problem is not None
        assert problem.startswith(text)


def test_cameras_twice(made: Arrays) -> None:
    rows, cameras = tables(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = batches.localize_objects(rows, cameras, **options)
    assert batches.localize_objects(rows, pa.concat_tables([cameras, cameras]), **options).equals(good)
    other = wrong(cameras.slice(0, 1), 0, width=641.0)
    found = batches.localize_objects(rows, pa.concat_tables([cameras, other]), **options)
    assert set(statuses(found).values()) == {("invalid", "frame 0: it has several cameras, which differ")}


def test_order_of_detections_does_not_matter(made: Arrays) -> None:
    """Neither for what is wrong nor for what is found."""
    rows, cameras = tables(made)
    rows = wrong(rows, 1, frame=[5, 99, 77, 2, 1, 0])
    backwards = [{k: v[::-1] if isinstance(v, list) else v for k, v in row.items()} for row in rows.to_pylist()]
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    found = batches.localize_objects(rows, cameras, **options)
    assert statuses(found)[1] == ("invalid", "frame 77: there is no such camera")
    assert batches.localize_objects(pa.Table.from_pylist(backwards, schema=rows.schema), cameras, **options).equals(
        found
    )


def test_a_failure_inside_stays_with_its_object(
    made: Arrays, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rows, cameras = tables(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = batches.localize_objects(rows, cameras, **options)
    real = batches._localized

    def failing(cameras: Any, detections: _detections.Detections, *others: Any) -> Any:
        if 2 in detections.row:
            raise quadlift.QuadliftError("quadlift failed inside")
        return real(cameras, detections, *others)

    monkeypatch.setattr(batches, "_localized", failing)
    found = batches.localize_objects(rows, cameras, **options)
    others = pa.array([True, True, False, True])
    assert found.filter(others).equals(good.filter(others))
    assert statuses(found)[2] == ("failed", "quadlift failed inside")
    assert "object '2' failed" in caplog.text


# Scenes without ids


def test_scenes(fleet: Fleet, tmp_path: Path) -> None:
    columns = ["scene", "frame", "x0", "y0", "x1", "y1", "category"]
    rows = batches.group(fleet.shuffled().select(columns), ["scene"])
    found = batches.localize_scenes(rows, fleet.cameras, up=fleet.up)
    expected = []
    for name, path in fleet.files.items():
        document = quadlift.Scene.read(path).to_dict()
        document["detections"].sort(key=lambda d: (d["frame"], d["box"]))
        for d in document["detections"]:
            del d["object"]
        table = quadlift.Scene.from_dict(document).localize().to_arrow()
        expected.append(table.add_column(0, "scene", pa.array([name] * len(table))))
    assert_same(found, pa.concat_tables(expected))
    assert count_ok(found) >= 15
    single = [batches.localize_scenes(rows.slice(k, 1), fleet.cameras, up=fleet.up) for k in range(3)]
    assert pa.concat_tables(single).equals(found)


def test_poisoned_scene(made: Arrays) -> None:
    rows, cameras = tables(made)
    flat = batches.ungroup(rows.drop_columns("object"))
    scene = batches.group(flat.append_column("scene", pa.array([7] * len(flat))), ["scene"])
    cameras = cameras.append_column("scene", pa.array([7] * len(cameras)))
    good = batches.localize_scenes(scene, cameras)
    lists = {name: scene[name][0].as_py() for name in ("frame", "x0", "y0", "x1", "y1")}
    more = {"frame": [3, 99, None, 3], "x0": [0.0, 0.0, 0.0, NAN], "y0": [0.0] * 4, "x1": [-1.0] * 4, "y1": [9.0] * 4}
    poisoned = wrong(scene, 0, **{name: values + more[name] for name, values in lists.items()})
    found = batches.localize_scenes(poisoned, cameras)
    assert found.slice(1).equals(good)
    first = found.to_pylist()[0]
    assert (first["scene"], first["object"], first["status"]) == (7, None, "invalid")
    assert first["problem"] == "4 detections take no part: a detection has no frame"
    short = batches.localize_scenes(wrong(scene, 0, y1=[1.0]), cameras).to_pylist()
    assert [row["status"] for row in short] == ["invalid"]
    assert "lists of different lengths" in short[0]["problem"]
    assert len(batches.localize_scenes(scene.slice(0, 0), cameras)) == 0


# Grouping


def test_group_and_ungroup() -> None:
    table = pa.table({"a": [2, None, 1, 2], "b": ["x", "y", "x", "x"], "c": [1.0, 2.0, 3.0, 4.0]})
    rows = batches.group(table, ["b", "a"])
    assert rows.select(["a", "b"]).to_pylist() == [{"a": 1, "b": "x"}, {"a": 2, "b": "x"}, {"a": None, "b": "y"}]
    assert rows["c"].to_pylist() == [[3.0], [1.0, 4.0], [2.0]]
    assert sorted(batches.ungroup(rows)["c"].to_pylist()) == [1.0, 2.0, 3.0, 4.0]
    assert batches.ungroup(rows).to_pylist()[2] == {"a": 2, "b": "x", "c": 4.0}


def test_what_cannot_be_grouped() -> None:
    table = pa.table({"a": [1, 2], "b": ["x", "y"]})
    wrong: Any
    for wrong in ("a", []):
        with pytest.raises(quadlift.QuadliftError, match=r"by is .*; expected a list of at least one column"):
            batches.group(table, wrong)
    with pytest.raises(quadlift.QuadliftError, match="table has no column 'c'; found a, b"):
        batches.group(table, ["c"])
    with pytest.raises(quadlift.QuadliftError, match="rows has no column of lists; found a, b"):
        batches.ungroup(table)
    ragged = pa.table({"a": [[1], [1, 2]], "b": [[1], [1]]})
    with pytest.raises(quadlift.QuadliftError, match="row 1 has lists of different lengths: 2 a, 1 b"):
        batches.ungroup(ragged)


def test_a_sample_does_not_depend_on_parts() -> None:
    """The sample of the samples of parts is that of the whole; what is no object is never in it."""
    scenes = np.repeat(["s", "t"], 50)
    rows = pa.table({"scene": scenes, "object": np.tile(np.arange(50) - 5, 2), "views": np.arange(100)})
    found = batches.sample(rows, 20)
    assert (len(found), found.column_names) == (20, rows.column_names)
    assert min(found["object"].to_pylist()) >= 0
    assert set(found["scene"].to_pylist()) == {"s", "t"}
    parts = [batches.sample(rows.slice(k, 30), 20) for k in (60, 0, 90, 30)]
    assert batches.sample(pa.concat_tables(parts), 20).equals(found)
    assert len(batches.sample(rows)) == 90
    with pytest.raises(quadlift.QuadliftError, match="count is -1; expected a whole number of at least 0"):
        batches.sample(rows, -1)


def test_cameras_can_be_sent(fleet: Fleet) -> None:
    cameras = batches.Cameras(fleet.cameras)
    assert len(cameras) == 33
    again = pickle.loads(pickle.dumps(cameras))
    rows = of_objects(fleet.detections)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    assert batches.localize_objects(rows, again, **options).equals(batches.localize_objects(rows, cameras, **options))


# Arguments


def refusals(made: Arrays) -> dict[str, tuple[Any, str]]:
    rows, cameras = tables(made)
    good: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}

    def objects(rows: pa.Table = rows, cameras: Any = cameras, **options: Any) -> Any:
        return lambda: batches.localize_objects(rows, cameras, **{**good, **options})

    named = cameras.append_column("scene", pa.array(["s"] * len(cameras)))
    texts = cameras.set_column(0, "frame", cameras["frame"].cast(pa.string()))
    return {
        "no noise_model": (objects(noise_model=None), "noise_model and a body"),
        "auto": (objects(body="auto"), "noise_model and a body"),
        "wrong body": (objects(body="sphere"), 'body is "sphere"'),
        "ground": (objects(ground_plane=True), "ground_plane is an option of whole scenes"),
        "height": (objects(camera_height=1.0), "camera_height is an option of whole scenes"),
        "poses": (objects(pose_noise=(0.1, 0.1)), "pose_noise is an option of whole scenes"),
        "priors": (objects(priors={"car": {"on_ground": True}}, up=(0, 0, 1)), "on_ground=True"),
        "learned sizes": (objects(learn_sizes=True), "learn_sizes is an option of whole scenes"),
        "builtin": (objects(priors="builtin", length_unit="m", up=(0, 0, 1)), "on_ground=True"),
        "threads": (objects(threads=2), "there is no option 'threads' here"),
        "object": (objects(rows.drop_columns("object")), "rows has no column 'object'"),
        "box": (objects(rows.drop_columns("y0")), "rows has no column 'y0'"),
        "no lists": (objects(batches.ungroup(rows)), "frame has the type int64; expected lists"),
        "cameras": (objects(cameras=None), "has no column 'cameras'"),
        "frame": (objects(cameras=cameras.drop_columns("frame")), "cameras has no column 'frame'"),
        "projection": (objects(cameras=cameras.drop_columns("projection")), "cameras has no column 'intrinsics'"),
        "height alone": (
            objects(cameras=cameras.drop_columns("width")),
            "or none of them; found height alone",
        ),
        "scene": (objects(cameras=named), "the cameras have a column 'scene'"),
        "types": (objects(cameras=texts), "frame is int64 in the detections and string in the cameras"),
        "table": (objects(rows.to_pylist()), "rows is a list; expected a pyarrow.Table"),
        "frames of floats": (objects(wrong_type(rows)), "frame has the type double; expected whole numbers or texts"),
    }


def test_priors_that_could_share_a_ground_are_taken_where_up_is_not_known(made: Arrays) -> None:
    rows, cameras = tables(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid", "priors": "builtin", "length_unit": "m"}
    found = batches.localize_objects(rows, cameras, **options)
    halves = [batches.localize_objects(rows.slice(start, 2), cameras, **options) for start in (0, 2)]
    assert pa.concat_tables(halves).equals(found)
    # The objects have no categories.
    assert found.equals(batches.localize_objects(rows, cameras, noise_model=NOISE_MODEL, body="ellipsoid"))


def wrong_type(rows: pa.Table) -> pa.Table:
    return rows.set_column(1, "frame", rows["frame"].cast(pa.list_(pa.float64())))


@pytest.mark.parametrize("name", list(refusals(made_scene())))
def test_refusals(made: Arrays, name: str) -> None:
    call, text = refusals(made)[name]
    with pytest.raises(quadlift.QuadliftError) as refused:
        call()
    assert text in str(refused.value)
