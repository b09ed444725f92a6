"""Tables of detections in, tables of estimates out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pytest

import quadlift
from conftest import Arrays, Program, as_written, made_scene, read_json
from fleet import Fleet, assert_same, comparable, count_ok, made_fleet, recipes, statuses
from quadlift import tables

NOISE_MODEL = {"edge_noise": 0.02, "edge_noise_px": 0.3, "occluded_edge_noise": 0.05, "edge_correlation": 0.2}


@pytest.fixture(scope="module")
def fleet(program: Program, tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    return made_fleet(program, tmp_path_factory.mktemp("fleet"))


def with_edges(fleet: Fleet) -> pa.Table:
    return tables.occluded_edges(fleet.shuffled())


def tables_of(made: Arrays) -> tuple[pa.Table, pa.Table]:
    """Detections and cameras of a scene without a name, whose ids are numbers."""
    boxes = dict(zip(("x0", "y0", "x1", "y1"), made.boxes.T, strict=True))
    detections = pa.table({"object": made.objects, "frame": made.frames, **boxes})
    projections = pa.array(made.projections.reshape(-1, 12).tolist())
    width, height = made.image_sizes.T
    frames = np.arange(len(projections))
    cameras = pa.table({"frame": frames, "projection": projections, "width": width, "height": height})
    return detections, cameras


def changed(rows: pa.Table, row: int, **entries: Any) -> pa.Table:
    """The table with other entries in a row."""
    found = rows.to_pylist()
    found[row] |= entries
    return pa.Table.from_pylist(found, schema=rows.schema)


def at(rows: pa.Table, frame: int, name: int) -> int:
    """The row of an object in a frame."""
    return [(row["frame"], row["object"]) for row in rows.to_pylist()].index((frame, name))


# The same numbers


@pytest.mark.parametrize("body", ["ellipsoid", "cuboid", "rounded"])
def test_same_as_scenes(fleet: Fleet, body: str) -> None:
    rows = with_edges(fleet)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": body, "up": fleet.up}
    found = tables.localize(rows, fleet.cameras, **options)
    assert_same(found, fleet.expected(noise_model=NOISE_MODEL, body=body))
    assert count_ok(found) >= 18
    assert found["problem"].null_count == len(found)
    # Object by object.
    single = [
        tables.localize(
            rows.filter(pc.and_(pc.equal(rows["scene"], scene), pc.equal(rows["object"], name))),
            fleet.cameras,
            **options,
        )
        for scene, name in zip(found["scene"].to_pylist(), found["object"].to_pylist(), strict=True)
    ]
    assert pa.concat_tables(single).equals(found)
    # The same in pandas.
    of_pandas = tables.localize(
        tables.occluded_edges(fleet.shuffled().to_pandas()), fleet.cameras.to_pandas(), **options
    )
    np.testing.assert_array_equal(np.stack(of_pandas["center"]), np.array(found["center"].to_pylist()))
    assert of_pandas.columns.tolist() == found.column_names


def test_same_as_the_program(fleet: Fleet, program: Program, tmp_path: Path) -> None:
    """Bit by bit what `quadlift localize` writes."""
    levels = ",".join(f"{name}={value}" for name, value in NOISE_MODEL.items())
    found = tables.localize(with_edges(fleet), fleet.cameras, noise_model=NOISE_MODEL, body="cuboid", up=fleet.up)
    by_id = {(row["scene"], row["object"]): row for row in found.to_pylist()}
    compared = 0
    for name, path in fleet.files.items():
        options = ["--body", "cuboid", "--noise-model", levels, "--no-upright", "--allow-inconsistent"]
        program("localize", "-q", path, "-o", tmp_path / "result.json", *options)
        for written in read_json(tmp_path / "result.json")["objects"]:
            row = by_id.pop((name, written["id"]))
            assert row["status"] == written["status"]
            if row["status"] == "ok":
                assert row["center"] == written["body"]["center"]
                assert row["views_used"] == written["views_used"]
                np.testing.assert_array_equal(
                    as_written(row["covariance"], 9), np.ravel(written["covariance"]["matrix"])
                )
                compared += 1
    assert not by_id
    assert compared >= 18


def test_scenes_give_their_tables(fleet: Fleet) -> None:
    """`Scene.to_arrow` gives what the functions take."""
    for name, path in fleet.files.items():
        detections, cameras = quadlift.Scene.read(path).to_arrow()
        options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid", "up": fleet.up}
        found = tables.localize(tables.occluded_edges(detections), cameras, **options)
        of_fleet = tables.localize(with_edges(fleet), fleet.cameras, **options)
        assert_same(found, of_fleet.filter(pc.equal(of_fleet["scene"], name)).drop_columns("scene"))


def test_the_code_of_the_page(fleet: Fleet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """That of the engines is run by `test_scale_out.py`."""
    code = recipes()
    assert code.keys() == {"Three functions", "Spark", "Ray", "Daft"}
    assert all(len(code[name].splitlines()) <= 33 for name in code)
    path = next(iter(fleet.files.values()))
    (tmp_path / "scene.json").write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    found: dict[str, Any] = {}
    exec(code["Three functions"], found)
    options: dict[str, Any] = {"noise_model": found["noise_model"], "body": found["body"], "upright": False}
    assert_same(found["objects"], quadlift.Scene.read(path).localize(**options).to_arrow())


def test_priors(fleet: Fleet) -> None:
    """Sizes of categories and upright stance, which each object has for itself."""
    prior: dict[str, Any] = {"size": (6.0, 6.0, 6.0), "size_sd": (1.0, 1.0, 1.0), "upright_sd": 0.1}
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid", "priors": {"car": prior}}
    rows = with_edges(fleet)
    found = tables.localize(rows, fleet.cameras, up=fleet.up, **options)
    assert_same(found, fleet.expected(**options))
    without = tables.localize(rows, fleet.cameras, up=fleet.up, noise_model=NOISE_MODEL, body="ellipsoid")
    differ = [a != b for a, b in zip(found["center"].to_pylist(), without["center"].to_pylist(), strict=True)]
    assert differ == [kind == "car" for kind in found["category"].to_pylist()]


def test_occluded_edges_count(fleet: Fleet) -> None:
    rows = with_edges(fleet)
    assert set(rows["occluded_edges"].to_pylist()) == {0, 1, 4, 5}
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    found = tables.localize(rows.drop_columns("occluded_edges"), fleet.cameras, **options)
    assert not comparable(found).equals(fleet.expected(**options))
    # Frame by frame.
    of_frames = [
        tables.occluded_edges(fleet.detections.filter(pc.equal(fleet.detections["frame"], frame)))
        for frame in pc.unique(fleet.detections["frame"])
    ]
    keys = [(name, "ascending") for name in ("scene", "frame", "object")]
    assert pa.concat_tables(of_frames).sort_by(keys).equals(rows.sort_by(keys))
    # Found again, not twice.
    assert tables.occluded_edges(rows).equals(rows)


def test_closed_form(fleet: Fleet) -> None:
    found = tables.localize(fleet.detections, fleet.cameras, method="planes", up=fleet.up)
    assert_same(found, fleet.expected(method="planes"))


def test_noise_is_that_of_a_scene(made: Arrays) -> None:
    rows, cameras = tables_of(made)
    rows = tables.occluded_edges(rows)
    whole = quadlift.localize(**made.arguments())
    noise_model, body = tables.noise(rows, cameras)
    assert (noise_model, body) == (whole.noise, whole.body)
    # What is given stays.
    assert tables.noise(rows, cameras, noise_model=NOISE_MODEL, body="cuboid") == (NOISE_MODEL, "cuboid")
    found = tables.localize(rows, cameras, noise_model=noise_model, body=body)
    assert found["object"].to_pylist() == whole.object_ids.tolist()


def test_own_cameras(fleet: Fleet) -> None:
    """Rows that bring their cameras give the same bits."""
    rows = with_edges(fleet)
    of_frame = {(c["scene"], c["frame"]): c for c in fleet.cameras.to_pylist()}
    joined = pa.Table.from_pylist([row | of_frame[row["scene"], row["frame"]] for row in rows.to_pylist()])
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    assert tables.localize(joined, **options).equals(tables.localize(rows, fleet.cameras, **options))


def test_ids_may_be_numbers() -> None:
    """Numbers and texts in the same order give the same."""
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    made = made_scene(objects=3, views=12)
    rows, cameras = tables_of(made)
    found = tables.localize(rows, cameras, **options)
    assert found.schema.field("object").type == pa.int64()
    named = pa.array([f"{frame:03}" for frame in rows["frame"].to_pylist()], pa.large_string())
    names = pa.array([f"{frame:03}" for frame in cameras["frame"].to_pylist()]).dictionary_encode()
    texts = rows.set_column(1, "frame", named)
    assert tables.localize(texts, cameras.set_column(0, "frame", names), **options).equals(found)
    views = quadlift.localize(**made.arguments(), **options)
    np.testing.assert_array_equal(found["center"].to_pylist(), views.centers)
    # Whole numbers of which one is missing are floating point in pandas.
    frame = rows.to_pandas()
    frame.loc[len(frame)] = [np.nan, 0, 1.0, 1.0, 9.0, 9.0]
    of_pandas = tables.localize(frame, cameras, **options)
    np.testing.assert_array_equal(np.stack(of_pandas["center"]), views.centers)


def test_texts_are_in_the_order_of_texts() -> None:
    made = made_scene(objects=3, views=12)
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": {**NOISE_MODEL, "edge_correlation": 0.8}, "body": "ellipsoid"}
    named = rows.set_column(1, "frame", rows["frame"].cast(pa.string()))
    found = tables.localize(named, cameras.set_column(0, "frame", cameras["frame"].cast(pa.string())), **options)
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
    assert not found.equals(tables.localize(rows, cameras, **options))


# What is wrong with rows

NAN = float("nan")
POISON: dict[str, tuple[dict[str, Any], str]] = {
    "box of NaN": ({"x0": NAN}, "frame 4: the box ["),
    "reversed box": ({"x0": 1e6}, "is empty or reversed"),
    "infinite box": ({"y1": float("inf")}, "not finite"),
    "no number": ({"x1": None}, "frame 4: the box ["),
    "no box": (dict.fromkeys(("x0", "y0", "x1", "y1")), "frame 4: there is no box"),
    "no frame": ({"frame": None}, "a detection has no frame"),
    "unknown frame": ({"frame": 99}, "frame 99: there is no such camera"),
    "frame twice": ({"frame": 3}, "frame 3: the object is in it twice"),
}


@pytest.mark.parametrize("name", list(POISON))
def test_poison(made: Arrays, name: str) -> None:
    entries, text = POISON[name]
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = tables.localize(rows, cameras, **options)
    wrong = changed(rows, at(rows, 4, 2), **entries)
    found = tables.localize(wrong, cameras, **options)
    others = pa.array([True, True, False, True])
    assert found.filter(others).equals(good.filter(others))
    row = found.to_pylist()[2]
    assert (row["object"], row["status"]) == (2, "invalid")
    assert text in row["problem"]
    assert all(row[name] is None for name in row if name not in ("object", "status", "problem"))
    # A sample leaves it out.
    noise_model, _ = tables.noise(wrong, cameras, body="ellipsoid")
    without = rows.filter(pc.not_equal(rows["object"], 2))
    assert noise_model == tables.noise(without, cameras, body="ellipsoid")[0]


@pytest.mark.parametrize("unknown", [None, -1])
def test_detections_of_no_object_are_skipped(made: Arrays, unknown: int | None) -> None:
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    found = tables.localize(changed(rows, at(rows, 4, 2), object=unknown), cameras, **options)
    expected = rows.filter(pa.array([k != at(rows, 4, 2) for k in range(len(rows))]))
    assert found.equals(tables.localize(expected, cameras, **options))


def test_empty_tables(made: Arrays) -> None:
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    nothing = tables.localize(rows.slice(0, 0), cameras, **options)
    assert len(nothing) == 0
    assert nothing.schema == tables.localize(rows, cameras, **options).schema
    assert tables.noise(rows.slice(0, 0), cameras) == ({}, "ellipsoid")
    assert len(tables.occluded_edges(rows.slice(0, 0))) == 0
    without = rows.drop_columns("object")
    assert tables.localize(without.slice(0, 0), cameras).schema == tables.localize(without, cameras).schema


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
    rows, cameras = tables_of(made)
    # The first object is not seen in that frame.
    rows = rows.filter(pa.array([k != at(rows, 3, 0) for k in range(len(rows))]))
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = tables.localize(rows, cameras, **options)
    found = tables.localize(rows, changed(cameras, 3, **{column: value}), **options)
    assert found.slice(0, 1).equals(good.slice(0, 1))
    for status, problem in list(statuses(found).values())[1:]:
        assert status == "invalid"
        assert problem is not None
        assert problem.startswith(text)


def test_cameras_twice(made: Arrays) -> None:
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = tables.localize(rows, cameras, **options)
    assert tables.localize(rows, pa.concat_tables([cameras, cameras]), **options).equals(good)
    other = changed(cameras.slice(0, 1), 0, width=641.0)
    found = tables.localize(rows, pa.concat_tables([cameras, other]), **options)
    assert set(statuses(found).values()) == {("invalid", "frame 0: it has several cameras, which differ")}


def test_order_of_detections_does_not_matter(made: Arrays) -> None:
    """Neither for what is wrong nor for what is found."""
    rows, cameras = tables_of(made)
    rows = changed(changed(rows, at(rows, 1, 1), frame=99), at(rows, 2, 1), frame=77)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    found = tables.localize(rows, cameras, **options)
    assert statuses(found)[1] == ("invalid", "frame 77: there is no such camera")
    backwards = rows.take(pa.array(np.arange(len(rows))[::-1]))
    assert tables.localize(backwards, cameras, **options).equals(found)


def test_a_failure_inside_stays_with_its_object(
    made: Arrays, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}
    good = tables.localize(rows, cameras, **options)
    real = tables._Run.of_groups

    def failing(run: Any, read: Any, groups: Any) -> Any:
        if 2 in groups:
            raise quadlift.QuadliftError("quadlift failed inside")
        return real(run, read, groups)

    monkeypatch.setattr(tables._Run, "of_groups", failing)
    found = tables.localize(rows, cameras, **options)
    others = pa.array([True, True, False, True])
    assert found.filter(others).equals(good.filter(others))
    assert statuses(found)[2] == ("failed", "quadlift failed inside")
    assert "object '2' failed" in caplog.text


# Scenes without ids


def test_scenes(fleet: Fleet) -> None:
    rows = fleet.shuffled().drop_columns("object")
    found = tables.localize(rows, fleet.cameras, up=fleet.up)
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
    names = sorted(fleet.files)
    single = [tables.localize(rows.filter(pc.equal(rows["scene"], n)), fleet.cameras, up=fleet.up) for n in names]
    assert pa.concat_tables(single).equals(found)


def test_scenes_have_measurements_of_the_table(fleet: Fleet) -> None:
    """Options that select detections are not those of tables, which are filtered instead."""
    rows = fleet.detections.drop_columns("object")
    for name in ("measurement", "source", "max_occluded", "max_truncated", "cross_validate"):
        with pytest.raises(quadlift.QuadliftError, match=f"there is no option '{name}' here"):
            tables.localize(rows, fleet.cameras, **{name: "box"})


def test_poisoned_scene(made: Arrays) -> None:
    rows, cameras = tables_of(made)
    scene = rows.drop_columns("object").append_column("scene", pa.array([7] * len(rows)))
    cameras = cameras.append_column("scene", pa.array([7] * len(cameras)))
    good = tables.localize(scene, cameras)
    box: dict[str, Any] = {"y0": 0.0, "x1": -1.0, "y1": 9.0, "scene": 7}
    more: list[dict[str, Any]] = [
        {"frame": 3, "x0": 0.0},
        {"frame": 99, "x0": 0.0},
        {"frame": None, "x0": 0.0},
        {"frame": 3, "x0": NAN},
    ]
    poisoned = pa.Table.from_pylist([*scene.to_pylist(), *({**box, **entry} for entry in more)], schema=scene.schema)
    found = tables.localize(poisoned, cameras)
    assert found.slice(1).equals(good)
    first = found.to_pylist()[0]
    assert (first["scene"], first["object"], first["status"]) == (7, None, "invalid")
    assert first["problem"] == "4 detections take no part: a detection has no frame"


# Arguments


def refusals(made: Arrays) -> dict[str, tuple[Any, str]]:
    rows, cameras = tables_of(made)
    good: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid"}

    def objects(rows: Any = rows, cameras: Any = cameras, **options: Any) -> Any:
        return lambda: tables.localize(rows, cameras, **{**good, **options})

    named = cameras.append_column("scene", pa.array(["s"] * len(cameras)))
    texts = cameras.set_column(0, "frame", cameras["frame"].cast(pa.string()))
    halves = rows.set_column(1, "frame", pc.add(rows["frame"].cast(pa.float64()), 0.5))
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
        "no object": (lambda: tables.noise(rows.drop_columns("object"), cameras), "detections has no column 'object'"),
        "box": (objects(rows.drop_columns("y0")), "detections has no column 'y0'"),
        "text": (objects(rows.set_column(2, "x0", rows["x0"].cast(pa.string()))), "x0 has the type string"),
        "no cameras": (objects(cameras=None), "cameras: expected projection, or intrinsics and cam_from_world"),
        "frame": (objects(cameras=cameras.drop_columns("frame")), "cameras has no column 'frame'"),
        "projection": (objects(cameras=cameras.drop_columns("projection")), "'intrinsics' is missing"),
        "scene": (objects(cameras=named), "the cameras have a column 'scene'"),
        "types": (objects(cameras=texts), "frame is int64 in the detections and string in the cameras"),
        "table": (objects(rows.to_pylist()), "detections is a list; expected a table of pyarrow or pandas"),
        "halves of frames": (objects(halves), "expected whole numbers or texts"),
        "frames of lists": (
            objects(rows.set_column(1, "frame", pa.array([[1]] * len(rows)))),
            "frame has the type list",
        ),
    }


@pytest.mark.parametrize("name", list(refusals(made_scene())))
def test_refusals(made: Arrays, name: str) -> None:
    call, text = refusals(made)[name]
    with pytest.raises(quadlift.QuadliftError) as refused:
        call()
    assert text in str(refused.value)


def test_priors_that_could_share_a_ground_are_taken_where_up_is_not_known(made: Arrays) -> None:
    rows, cameras = tables_of(made)
    options: dict[str, Any] = {"noise_model": NOISE_MODEL, "body": "ellipsoid", "priors": "builtin", "length_unit": "m"}
    found = tables.localize(rows, cameras, **options)
    halves = [
        tables.localize(rows.filter(pc.is_in(rows["object"], pa.array(k))), cameras, **options)
        for k in ([0, 1], [2, 3])
    ]
    assert pa.concat_tables(halves).equals(found)
    # The objects have no categories.
    assert found.equals(tables.localize(rows, cameras, noise_model=NOISE_MODEL, body="ellipsoid"))
