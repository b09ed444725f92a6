"""The object map: the same as `quadlift stream`, bit by bit; arguments, errors, states, threads."""

from __future__ import annotations

import contextlib
import copy
import json
import pickle
import re
import threading
import warnings
import zlib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
import supervision

import quadlift
from conftest import Program, read_json

STREET = ["--trajectory", "street", "--objects", "14", "--views", "40", "--noise", "box:0.05", "--no-ids"]
DETECTOR = ["--misses", "0.2", "--duplicates", "0.1", "--seed", "3"]

Line = dict[str, Any]


@pytest.fixture(scope="module")
def lines(program: Program, tmp_path_factory: pytest.TempPathFactory) -> list[Line]:
    """Frames of a street as lines of a stream, each with its camera."""
    path = tmp_path_factory.mktemp("street") / "scene.json"
    program("synth", "-q", "-o", path, *STREET, *DETECTOR)
    document = read_json(path)
    cameras = {camera.pop("id"): camera for camera in document["cameras"]}
    lines = []
    for k, frame in enumerate(document["frames"]):
        found = [d for d in document["detections"] if d["frame"] == frame["id"]]
        names = ("cup", "mug")
        detections = [
            {"box": d["box"], "category": names[n % 2], "score": 0.5 + 0.01 * n, "object": f"t{n}"}
            for n, d in enumerate(found)
        ]
        line = {"frame": frame["id"], "time": 0.1 * k, "detections": detections}
        if "projection" in frame:
            line |= {name: frame[name] for name in ("projection", "width", "height")}
        else:
            line |= {"camera": cameras[frame["camera"]], "cam_from_world": frame["cam_from_world"]}
        lines.append(line)
    assert len(lines) == 40
    return lines


def arguments(line: Line) -> dict[str, Any]:
    """The arguments of `observe`."""
    found = line["detections"]
    given: dict[str, Any] = {
        "time": line["time"],
        "boxes": np.array([d["box"] for d in found]).reshape(-1, 4),
        "categories": [d["category"] for d in found],
        "scores": np.array([d["score"] for d in found]),
        "objects": np.array([d["object"] for d in found], dtype=object),
    }
    if "projection" in line:
        return given | {"projection": line["projection"], "image_size": (line["width"], line["height"])}
    camera = line["camera"]
    fx, fy, cx, cy = camera["params"]
    given["image_size"] = (camera["width"], camera["height"])
    given["intrinsics"] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return given | {"cam_from_world": np.array(line["cam_from_world"])}


def observed(lines: list[Line], made: quadlift.ObjectMap) -> list[quadlift.FrameUpdate]:
    return [made.observe(line["frame"], **arguments(line)) for line in lines]


def streamed(program: Program, folder: Path, lines: list[Line], *options: str, code: int = 0) -> list[Line]:
    """The lines that the program writes; its map and state are `map.json` and `state.json` of the folder."""
    path = folder / "frames.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    files = ("--map", folder / "map.json", "--state", folder / "state.json")
    text = program("stream", "-q", path, *files, *options, code=code)
    return [json.loads(line) for line in text.splitlines()]


OPTIONS: dict[str, tuple[list[str], dict[str, Any]]] = {
    "default": ([], {}),
    "all": (
        ["--ids", "trust", "--min-views", "4", "--min-score", "0.51", "--edge-noise-px", "3", "--max-views", "8"],
        {"ids": "trust", "min_views": 4, "min_score": 0.51, "edge_noise_px": 3, "max_views": 8},
    ),
    "poses": (["--pose-noise", "0.003,0.1", "--max-objects", "6"], {"pose_noise": (0.003, 0.1), "max_objects": 6}),
}


@pytest.mark.parametrize("name", list(OPTIONS))
def test_the_same_as_the_program(name: str, program: Program, tmp_path: Path, lines: list[Line]) -> None:
    options, keywords = OPTIONS[name]
    # The ids are numbers of boxes in their frames: trusted, they are wrong.
    wrong = keywords.get("ids") == "trust"
    theirs = streamed(program, tmp_path, lines, *options, code=3 if wrong else 0)
    made = quadlift.ObjectMap(**keywords)
    with pytest.warns(quadlift.InconsistentSceneWarning, match="ids switch") if wrong else contextlib.nullcontext():
        ours = observed(lines, made)
    assert made.consistent is not wrong
    assert [update.objects for update in ours] == [line["objects"] for line in theirs[:40]]
    assert [update.events for update in ours] == [line["events"] for line in theirs[:40]]
    assert {event["type"] for update in ours for event in update.events} >= {"new", "confirmed", "reassigned"}
    # The program goes on from an unsettled state.
    made.save(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "state.json").read_bytes()
    update = made.settle()
    assert update.objects == []
    assert update.events == next((line["events"] for line in theirs if "end" in line), [])
    made.to_scene().write(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "map.json").read_bytes()

    objects = read_json(tmp_path / "map.json")["objects"]
    assert len(made) == len(objects) > 3
    assert made.objects.object_ids.tolist() == [o["id"] for o in objects]
    np.testing.assert_array_equal(made.objects.centers, [o.get("center", [np.nan] * 3) for o in objects])
    memory = made.memory()
    assert memory.ids.tolist() == [o["id"] for o in objects]
    for row, record in enumerate(o["memory"] for o in objects):
        found = memory[row]
        assert found.existence == pytest.approx(record.pop("existence"), rel=1e-5)
        shares = {c["category"]: c["share"] for c in record.pop("categories")}
        assert found.categories == pytest.approx(shares, rel=1e-5)
        assert found.category == next(iter(shares))
        assert {key: getattr(found, key) for key in record} == record


def test_a_camera_with_a_name_and_a_lens(program: Program, tmp_path: Path, lines: list[Line]) -> None:
    lens: dict[str, Any] = {
        "model": "OPENCV",
        "width": 640,
        "height": 480,
        "params": [500, 500, 320, 240, 0.01, 1e-3, 1e-4, 2e-4],
    }
    pose = [[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
    frames = []
    for k in range(12):
        x = 1.5 - 0.25 * k
        u = 320 + 100 * x
        detections = [{"box": [u - 50, 190, u + 50, 290], "category": "chair", "score": 0.9, "object": "7"}]
        frame: Line = {"frame": str(k), "time": 0.1 * k, "camera": "left", "cam_from_world": copy.deepcopy(pose)}
        frame["cam_from_world"][0][3] = x
        frames.append(frame | {"detections": detections})
    frames[0]["camera"] = {"id": "left", **lens}
    about: dict[str, Any] = {"name": "chairs", "length_unit": "m", "up": [0, -1, 0]}
    theirs = streamed(program, tmp_path, [about, *frames], "--priors", "builtin")
    assert theirs[11]["objects"] == ["object_0001"]
    states = set()
    for kind in ("mapping", "pycolmap", "distortion"):
        made = quadlift.ObjectMap(**about, priors="builtin")
        for k, frame in enumerate(frames):
            given = {name: frame[name] for name in ("time", "camera", "cam_from_world")}
            if kind == "pycolmap":
                given["camera"] = pycolmap.Camera(**lens)
            if kind == "distortion":
                given |= {"intrinsics": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "camera": None}
                given |= {"distortion": np.array([lens["params"][4:]]), "image_size": (640, 480)}
            detection = frame["detections"][0]
            found: dict[str, Any] = {
                "boxes": [detection["box"]],
                "categories": ["chair"],
                "scores": [0.9],
                "objects": [7],
            }
            assert made.observe(k, **given, **found).objects == theirs[k]["objects"]
        made.save(tmp_path / "ours.json")
        states.add((tmp_path / "ours.json").read_bytes())
        if kind == "mapping":
            assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "state.json").read_bytes()
            made.settle()
            made.to_scene().write(tmp_path / "ours.json")
            assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "map.json").read_bytes()
    # A camera without a name has one that comes from its numbers.
    assert len(states) == 2
    assert made.length_unit == "m"


def test_poses_that_change(program: Program, tmp_path: Path, lines: list[Line]) -> None:
    moved = []
    for line in lines[10:30]:
        name = "projection" if "projection" in line else "cam_from_world"
        matrix = np.array(line[name])
        # The world moves sideways.
        matrix[:, 3] += matrix[:, :3] @ [0.3, 0.0, 0.0]
        moved.append({"frame": line["frame"], name: matrix.tolist()})
    theirs = streamed(program, tmp_path, [*lines, {"poses": moved}])
    made = quadlift.ObjectMap()
    observed(lines, made)
    assert set(made.kept_frames) <= {line["frame"] for line in lines}
    matrices = np.array([pose[name] for pose in moved])
    arguments = {"projections" if name == "projection" else name: matrices}
    update = made.update_poses([pose["frame"] for pose in moved], **arguments)
    assert update.events == theirs[40]["events"]
    made.save(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == (tmp_path / "state.json").read_bytes()
    assert made.update_poses(["unknown"], **{key: value[:1] for key, value in arguments.items()}).events == []


# The packages


def ultralytics(line: Line) -> Any:
    """As Ultralytics' results: tensors that must come to the CPU, a tracker that has not found everything."""
    found = line["detections"]

    class Tensor(np.ndarray):
        def cpu(self) -> Any:
            return np.asarray(self)

    def tensor(values: Any) -> Any:
        return np.array(values, dtype=np.float64).view(Tensor)

    names = {0: "cup", 1: "mug"}
    boxes = SimpleNamespace(
        xyxy=tensor([d["box"] for d in found]).reshape(-1, 4),
        cls=tensor([list(names.values()).index(d["category"]) for d in found]),
        conf=tensor([d["score"] for d in found]),
        id=tensor([int(d["object"][1:]) for d in found]) if found else None,
    )
    return SimpleNamespace(boxes=boxes, names=names, path="video.mp4")


def supervised(line: Line) -> supervision.Detections:
    found = line["detections"]
    if not found:
        return supervision.Detections.empty()
    return supervision.Detections(
        xyxy=np.array([d["box"] for d in found]),
        confidence=np.array([d["score"] for d in found]),
        class_id=np.arange(len(found)) % 2,
        tracker_id=np.array([int(d["object"][1:]) for d in found]),
        data={"class_name": np.array([d["category"] for d in found])},
    )


@pytest.mark.parametrize("package", [ultralytics, supervised])
def test_detections_of_packages(package: Any, lines: list[Line]) -> None:
    expected, made = quadlift.ObjectMap(), quadlift.ObjectMap()
    empty = {"frame": "empty", "time": 3.9, "detections": []}
    for line in [*lines[:25], lines[25] | empty, *lines[26:]]:
        given = arguments(line | {"time": line["time"]})
        update = expected.observe(line["frame"], **given)
        cameras = {key: given[key] for key in given if key not in ("boxes", "categories", "scores", "objects")}
        assert made.observe(line["frame"], package(line), **cameras) == update
        if line["frame"] == "empty":
            break
    assert made.__reduce__()[1] == expected.__reduce__()[1]


# Errors

CAMERA: dict[str, Any] = {"intrinsics": [[500, 0, 320], [0, 500, 240], [0, 0, 1]], "cam_from_world": np.eye(4)}
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({"boxes": None}, 'frame "9": expected detections or boxes; found none of them (boxes=[]'),
    "both": (
        {"detections": supervision.Detections.empty()},
        "expected either detections or arrays; found detections and",
    ),
    "a list": ({"detections": [1], "boxes": None}, "detections is a list; expected supervision.Detections or Ultr"),
    "no boxes": (
        {"detections": SimpleNamespace(boxes=None, names={}), "boxes": None},
        'frame "9": detections has no boxes; expected those of',
    ),
    "NaN": ({"boxes": [[0, 0, 1, 1], [0, np.nan, 1, 1]]}, 'frame "9": boxes[1, 1] is nan; expected a finite number'),
    "infinity": ({"boxes": [[0, 0, np.inf, 1]]}, 'frame "9": boxes[0, 2] is inf; expected a finite number'),
    "an empty box": ({"boxes": [[0, 0, 1, 1], [5, 0, 5, 1]]}, 'frame "9": boxes[1]: '),
    "a wrong shape": ({"boxes": [[0, 0, 1]]}, 'frame "9": boxes has the shape (1, 3); expected (M, 4)'),
    "scores": ({"scores": [0.5, 0.5]}, 'frame "9": scores has the shape (2,); expected (1,), as many rows as boxes'),
    "a score": ({"scores": [np.inf]}, 'frame "9": scores[0] is inf; expected a finite number'),
    "categories": ({"categories": [0.5]}, 'frame "9": categories has the dtype float64; expected whole numbers or'),
    "no camera": (
        {"intrinsics": None},
        "expected projection, or cam_from_world with intrinsics or camera; found cam_from",
    ),
    "no pose": (
        {"cam_from_world": None},
        "expected projection, or cam_from_world with intrinsics or camera; found intr",
    ),
    "two cameras": ({"camera": "left"}, 'frame "9": expected either intrinsics or camera; found both'),
    "a projection too": (
        {"projection": np.eye(3, 4)},
        "expected either projection, or a camera and cam_from_world; found",
    ),
    "an unknown camera": ({"intrinsics": None, "camera": "left"}, 'frame "9": camera: unknown camera "left"'),
    "a camera": ({"intrinsics": None, "camera": {"model": "X"}}, 'frame "9": camera is a dict; expected the id of'),
    "a field": (
        {"intrinsics": None, "camera": {"fx": 1}},
        "frame \"9\": camera has the field 'fx'; expected 'id', 'mo",
    ),
    "a model": ({"intrinsics": None, "camera": {"model": "X", "params": [1.0]}}, 'frame "9": camera'),
    "a lens": ({"distortion": [1, 2, 3]}, 'frame "9": distortion has 3 numbers; expected 4, 5 or 8 of OpenCV\'s'),
    "skew": ({"intrinsics": np.ones((3, 3))}, "expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"),
    "a focal length": ({"intrinsics": np.diag([-1, 5, 1])}, 'frame "9": intrinsics has the focal lengths (-1, 5); exp'),
    "a mirror": ({"cam_from_world": np.diag([1, 1, -1, 1])}, 'frame "9": cam_from_world: '),
    "a last row": (
        {"cam_from_world": np.ones((4, 4))},
        "the last row of cam_from_world is [1.0, 1.0, 1.0, 1.0]; expected",
    ),
    "a size": ({"image_size": (640, 0)}, 'frame "9": image_size is (640.0, 0.0); expected two positive numbers'),
    "noise": ({"pose_noise": (0.1, 0.0)}, 'frame "9": pose_noise: expected two numbers above 0'),
    "no time": ({"time": np.nan}, 'frame "9": time is nan; expected a finite number'),
    "a time": ({"time": "now"}, "frame \"9\": time is 'now'; expected a finite number"),
    "going back": ({"time": 0.5}, 'frame "9" is of time 0.5, but the frame before it is of time 1; expected frames in'),
}


@pytest.mark.parametrize("name", list(WRONG))
def test_wrong_frames_change_nothing(name: str) -> None:
    made = quadlift.ObjectMap()
    good: dict[str, Any] = {**CAMERA, "time": 1.0, "boxes": [[10, 10, 20, 20]]}
    made.observe(8, **good)
    before = made.__reduce__()
    changed, words = WRONG[name]
    with pytest.raises(quadlift.QuadliftError, match=re.escape(words)):
        made.observe(9, **{**good, **changed})
    assert made.__reduce__() == before
    made.observe(9, **good)
    with pytest.raises(quadlift.QuadliftError, match='frame "9" was observed before'):
        made.observe("9", **good)


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"ids": "maybe"}, 'ids is "maybe"; expected one of trust, evidence, ignore'),
        ({"min_views": 1}, "min_views is 1; expected a whole number of at least 2"),
        ({"max_views": 3}, "max_views is 3; expected a whole number of at least 4"),
        ({"max_objects": 0}, "max_objects is 0; expected a whole number of at least 1"),
        ({"edge_noise_px": -1}, "edge_noise_px is -1; expected a number above 0"),
        ({"pose_noise": (0.1, 0)}, "pose_noise is (0.1, 0); expected two numbers above 0"),
        ({"up": (0, 0, 0)}, "up: "),
        ({"priors": "builtin"}, "meters"),
        ({"priors": "no.toml"}, "no.toml: there is no such file"),
    ],
)
def test_wrong_options(keywords: dict[str, Any], words: str) -> None:
    with pytest.raises(quadlift.QuadliftError, match=re.escape(words)):
        quadlift.ObjectMap(**keywords)


def test_wrong_calls(lines: list[Line]) -> None:
    made = quadlift.ObjectMap()
    observed(lines, made)
    before = made.__reduce__()
    first, second = made.memory().ids[:2].tolist()
    wrong: Any = 1.5
    calls: list[tuple[Any, str]] = [
        (lambda: made.observe(wrong, time=0), "frame_id is 1.5; expected a text or a whole number"),
        (lambda: made.object("object_9999"), 'there is no object "object_9999" in the map'),
        (lambda: made.object("object_1"), 'there is no object "object_1" in the map'),
        (lambda: made.remove("cup"), 'there is no object "cup" in the map'),
        (lambda: made.merge(first, "cup"), 'there is no object "cup" in the map'),
        (lambda: made.merge(first, first), "are the same object already"),
        (lambda: made.update_poses("a", projections=[]), "frame_ids is 'a'; expected a list of frames"),
        (lambda: made.update_poses(["a"]), "expected either cam_from_world or projections; found none of them"),
        (
            lambda: made.update_poses(["a"], projections=[]),
            "projections has the shape (0, 3, 4); expected (1, 3, 4), as many rows as frame_ids",
        ),
        (
            lambda: made.update_poses([made.kept_frames[0]], projections=np.zeros((1, 3, 4))),
            f'frame "{made.kept_frames[0]}": ',
        ),
    ]
    for call, words in calls:
        with pytest.raises(quadlift.QuadliftError, match=re.escape(words)):
            call()
    with pytest.raises(TypeError, match="unexpected keyword argument 'associate'"):
        made.localize(associate="never")
    with pytest.raises(TypeError, match="unexpected keyword argument 'color'"):
        made.localize(color="red")  # type: ignore[call-arg]
    assert made.__reduce__() == before
    assert second in made


# States


def test_a_loaded_map_goes_on_to_the_same_bytes(tmp_path: Path, lines: list[Line]) -> None:
    unbroken = quadlift.ObjectMap(min_score=0.1, priors={"cup": {"size": (1, 1, 1), "size_sd": (1, 1, 1)}})
    made = unbroken.copy()
    updates = observed(lines, unbroken)

    def stored() -> quadlift.ObjectMap:
        made.save(tmp_path / "state.json")
        return quadlift.ObjectMap.load(tmp_path / "state.json")

    ways: list[Any] = [
        stored,
        lambda: pickle.loads(pickle.dumps(made)),
        lambda: copy.copy(made),
        lambda: copy.deepcopy(made),
    ]
    for k, line in enumerate(lines):
        made = ways[k % len(ways)]()
        assert observed([line], made) == [updates[k]]
    assert made.__reduce__() == unbroken.__reduce__()
    # A copy is a map of its own.
    before = made.__reduce__()
    observed([lines[-1] | {"frame": "more"}], made.copy())
    assert made.__reduce__() == before


def test_the_program_goes_on_from_python_and_back(program: Program, tmp_path: Path, lines: list[Line]) -> None:
    streamed(program, tmp_path, lines)
    expected = (tmp_path / "state.json").read_bytes()
    made = quadlift.ObjectMap()
    observed(lines[:15], made)
    made.save(tmp_path / "state.json")
    streamed(program, tmp_path, lines[:30], "--resume")
    made = quadlift.ObjectMap.load(tmp_path / "state.json")
    observed(lines[30:], made)
    made.save(tmp_path / "ours.json")
    assert (tmp_path / "ours.json").read_bytes() == expected
    # Priors that the program cannot have.
    quadlift.ObjectMap(priors={}).save(tmp_path / "state.json")
    with pytest.raises(AssertionError, match="the state was made with --priors"):
        streamed(program, tmp_path, lines, "--resume")


def test_files_that_are_no_states(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    with pytest.raises(quadlift.QuadliftError, match=r"state\.json: there is no such file"):
        quadlift.ObjectMap.load(path)
    quadlift.ObjectMap().save(path)
    document = read_json(path)
    damages: list[tuple[Any, str]] = [
        ({"format": "quadlift.scene"}, "this is no state of a stream"),
        ({"version": 99}, "the state has version 99"),
        ({"options": {**document["options"], "max_views": "many"}}, 'max_views is "many"'),
        ({"options": {**document["options"], "priors": "gone.toml"}}, "gone.toml: there is no such file"),
        ({"map": {**document["map"], "next_key": -1}}, "the state is damaged"),
    ]
    for damage, words in damages:
        path.write_text(json.dumps(document | damage))
        with pytest.raises(quadlift.QuadliftError, match=re.escape(words)):
            quadlift.ObjectMap.load(path)
    with pytest.raises(quadlift.QuadliftError, match="it is a folder; expected the name of a file"):
        quadlift.ObjectMap().save(tmp_path)


# Contents


def test_contents(lines: list[Line], tmp_path: Path) -> None:
    made = quadlift.ObjectMap()
    assert (len(made), bool(made), len(made.objects), len(made.memory()), made.last_frame) == (0, True, 0, 0, None)
    assert repr(made) == "<quadlift.ObjectMap: 0 objects after 0 frames>"
    assert made.to_scene().object_count == 0
    assert "<iframe" in made._repr_html_()
    observed(lines, made)
    count = len(made)
    assert repr(made).startswith(f"<quadlift.ObjectMap: {count} objects after 40 frames>")
    assert made.last_frame == (lines[-1]["frame"], lines[-1]["time"])
    assert made.frame_count == 40
    assert "<iframe" in made._repr_html_()
    # Computed once, until the map changes.
    estimates = made.objects
    assert made.objects is estimates
    assert estimates.ok.sum() > count / 2
    assert set(made.localize(body="cuboid").kinds) == {"cuboid"}
    scene = estimates.to_scene()
    assert scene.object_count == count
    assert len(scene) > 3 * count
    scene.report(tmp_path / "map.html")
    memory = made.memory()
    table = memory.to_pandas()
    assert [found.id for found in memory] == memory.ids.tolist()
    assert table["object"].tolist() == memory.ids.tolist() == estimates.object_ids.tolist()
    assert len(made.memory(tentative=True)) >= count
    close = np.linalg.norm(memory.centers - estimates.centers, axis=1)
    assert np.median(close) < 0.3
    first, second = memory.ids[:2].tolist()
    assert first in made
    assert 7 not in made
    found = made.object(first)
    assert (found.id, found.presence, found.detections) == (first, "confirmed", memory.detections[0])
    np.testing.assert_array_equal(found.center, memory.centers[0])
    assert made.merge(second, first) == first
    assert made.resolve(second) == first
    assert made.object(second).id == first
    assert made.objects is not estimates
    assert len(made) == count - 1
    made.remove(first)
    assert first not in made
    assert second not in made
    assert len(made) == count - 2


def test_objects_are_in_the_order_of_their_numbers() -> None:
    made = quadlift.ObjectMap()
    state = json.loads(made._core.to_bytes())
    state["map"]["objects"]["given_ids"] = 9998
    del state["checksum"]
    rest = json.dumps(state)[1:]
    text = f'{{"checksum":"{zlib.crc32(rest.encode()):08x}",{rest}'
    made = quadlift.ObjectMap._of(quadlift._core.ObjectMap.parse(text.encode()))
    for k in range(12):
        x = -1.5 + 0.25 * k
        u, v = 320 - 100 * x, 320 - 62.5 * x
        boxes = [[u - 50, 190, u + 50, 290], [v - 30, 20, v + 30, 80], [v - 30, 400, v + 30, 460]]
        pose = np.eye(3, 4)
        pose[0, 3] = -x
        made.observe(k, time=k, intrinsics=CAMERA["intrinsics"], cam_from_world=pose, boxes=boxes)
    assert made.memory().ids.tolist() == ["object_9999", "object_10000", "object_10001"]
    assert made.objects.object_ids.tolist() == made.memory().ids.tolist()
    assert [o["id"] for o in made.to_scene().to_dict()["objects"]] == made.memory().ids.tolist()


def test_several_threads(lines: list[Line]) -> None:
    """Maps of several threads, and readers of one map, give what a single thread gives."""
    expected = quadlift.ObjectMap()
    observed(lines, expected)
    maps = [quadlift.ObjectMap() for _ in range(4)]
    failed: list[BaseException] = []
    is_over = threading.Event()

    def run(work: Any) -> None:
        try:
            work()
        except BaseException as error:
            failed.append(error)

    def read() -> None:
        while not is_over.is_set():
            assert len(maps[0]) <= 40
            assert len(maps[0].memory(tentative=True)) <= 80
            assert len(maps[0].objects) <= 40
            pickle.dumps(maps[0])

    readers = [threading.Thread(target=run, args=(read,)) for _ in range(2)]
    writers = [threading.Thread(target=run, args=(lambda made=made: observed(lines, made),)) for made in maps]
    for thread in [*readers, *writers]:
        thread.start()
    for thread in writers:
        thread.join()
    is_over.set()
    for thread in readers:
        thread.join()
    assert failed == []
    assert {made.__reduce__()[1] for made in maps} == {expected.__reduce__()[1]}
    np.testing.assert_array_equal(maps[0].objects.centers, expected.objects.centers)


def test_writers_of_one_map(lines: list[Line]) -> None:
    """Frames of one time may come in any order; none is lost."""
    made = quadlift.ObjectMap()
    halves = [[line | {"time": 0.0} for line in lines[k::2]] for k in range(2)]
    writers = [threading.Thread(target=observed, args=(half, made)) for half in halves]
    for thread in writers:
        thread.start()
    for thread in writers:
        thread.join()
    assert made.frame_count == 40
    assert len(made) > 3


def test_inconsistent_poses_are_told_once(program: Program, tmp_path: Path) -> None:
    path = tmp_path / "scene.json"
    made = ["--no-ids", "--trajectory", "orbit", "--cube", "40", "--objects", "12", "--noise", "box:0.05"]
    program("synth", "-q", "-o", path, *made, "--views", "60", "--seed", "1")
    document = read_json(path)
    camera = document["cameras"][0]

    def fed(opengl: bool) -> tuple[quadlift.ObjectMap, list[warnings.WarningMessage]]:
        object_map = quadlift.ObjectMap()
        assert object_map.consistent is None
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            for k, frame in enumerate(document["frames"]):
                pose = np.array(frame["cam_from_world"])
                pose[1:] *= -1 if opengl else 1
                boxes = [d["box"] for d in document["detections"] if d["frame"] == frame["id"]]
                object_map.observe(frame["id"], time=float(k), camera=camera, cam_from_world=pose, boxes=boxes)
        return object_map, told

    right, told = fed(opengl=False)
    assert right.consistent is True
    assert told == []
    wrong, told = fed(opengl=True)
    assert [warning.category for warning in told] == [quadlift.InconsistentSceneWarning]
    assert "OpenGL axes" in str(told[0].message)
    assert told[0].filename == __file__
    assert wrong.consistent is False
    assert wrong.copy().consistent is False
    with pytest.warns(quadlift.InconsistentSceneWarning, match="OpenGL axes") as found:
        assert not wrong.localize().ok.any()
    # A map has forgotten the frames in which nothing agrees: it cannot be corrected.
    assert "corrected" not in str(found[0].message)
