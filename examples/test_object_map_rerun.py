"""Shows object maps of Python in Rerun with `ObjectMap.log_rerun` and reads the recordings back. Run by
scripts/test_rerun.sh, as test_to_rerun.py is."""

import runpy
import sys
import tempfile
import types
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import quadlift as package
import rerun as rr
from PIL import Image
from test_stream_rerun import lines, rows, stream, text
from test_to_rerun import content, verified

INTRINSICS = [[500, 0, 320], [0, 500, 240], [0, 0, 1]]


class Shown:
    """A recording of what is logged inside."""

    def __init__(self, path):
        self.path = path

    def __enter__(self):
        self.stream = rr.RecordingStream("mine")
        self.stream.__enter__()
        self.stream.save(self.path)
        return self

    def __exit__(self, *error):
        self.stream.flush()
        self.stream.__exit__(*error)
        self.stream.disconnect()
        if error[0] is None:
            self.chunks = verified(self.path)


def observe(object_map, line, **more):
    boxes = [d["box"] for d in line["detections"]]
    camera = {"intrinsics": INTRINSICS, "cam_from_world": line["cam_from_world"], "image_size": (640, 480)}
    categories = ["cup"] * len(boxes)
    return object_map.observe(line["frame"], time=line["time"], boxes=boxes, categories=categories, **{**camera, **more})


class ObjectMapRerun(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def test_the_same_as_the_stream(self):
        records = list(lines(60, lambda k, cup: cup == 0 or k < 20))
        run = stream(self.folder, "--rerun=theirs.rrd", given=text(records))
        self.assertEqual(run.returncode, 0, run.stderr)
        object_map = package.ObjectMap(name="cups", up=(0, -2, 0))
        with Shown(self.folder / "ours.rrd") as shown:
            for line in records[1:]:
                observe(object_map, line)
                object_map.log_rerun()
            object_map.settle()
            object_map.log_rerun()
        ours, theirs = content(shown.chunks), content(verified(self.folder / "theirs.rrd"))
        self.assertEqual(set(ours), set(theirs))
        for entity in ours:
            self.assertEqual(ours[entity], theirs[entity], entity)
        events = [value for _, [value] in rows(shown.chunks, "/events", "TextLog:text")]
        self.assertEqual(sum(value.startswith("confirmed") for value in events), 2)
        self.assertIn("gone", "".join(events))

    def test_images_and_frames_that_are_not_logged(self):
        records = list(lines(60, lambda k, cup: cup == 0 or k < 20))[1:]
        object_map, every = package.ObjectMap(), package.ObjectMap()
        for line in records[:15]:
            observe(object_map, line)
        # A map that is shown later, and not in every frame; it ends with the same.
        with Shown(self.folder / "some.rrd") as some:
            for k, line in enumerate(records[15:]):
                observe(object_map, line)
                if k % 9 == 0:
                    object_map.log_rerun(np.full((480, 640, 3), k, np.uint8))
            object_map.log_rerun(rr.Image(np.zeros((480, 640), np.uint8)))
            Image.new("RGB", (640, 480)).save(self.folder / "61.png")
            observe(object_map, {**records[-1], "frame": "more"}, image=str(self.folder / "61.png"))
            object_map.log_rerun()
        with Shown(self.folder / "every.rrd") as each:
            for line in [*records, {**records[-1], "frame": "more"}]:
                observe(every, line)
                every.log_rerun()
        [gone] = [found.id for found in object_map.memory() if found.presence == "gone"]
        for name in object_map.memory().ids:
            entity = f"/world/map/{name}"
            last = [rows(shown.chunks, entity, "Ellipsoids3D:centers")[-1][1] for shown in (some, each)]
            self.assertEqual(last[0], last[1])
            cleared = [bool(rows(shown.chunks, entity, "Clear:is_recursive")) for shown in (some, each)]
            self.assertEqual(cleared, [name == gone] * 2)
        texts = [[value for _, [value] in rows(shown.chunks, "/events", "TextLog:text")] for shown in (some, each)]
        self.assertEqual(texts[0], texts[1][-len(texts[0]):])
        self.assertIn(f"removed {gone} (cup): gone", texts[0])
        images = rows(some.chunks, "/world/camera/image", "EncodedImage:blob")
        self.assertEqual([frame for frame, _ in images], [15, 24, 33, 42, 51, 60])
        self.assertEqual(len(rows(some.chunks, "/world/camera/image", "Image:buffer")), 1)

    def test_changes_between_frames(self):
        records = list(lines(20, lambda *_: True))[1:]
        object_map = package.ObjectMap()
        with Shown(self.folder / "changed.rrd") as shown:
            for line in records:
                observe(object_map, line)
            object_map.log_rerun()
            first, second = object_map.memory().ids.tolist()
            object_map.remove(first)
            kept = object_map.kept_frames
            poses = {line["frame"]: np.array(line["cam_from_world"], float) for line in records}
            moved = np.stack([poses[name] for name in kept])
            # The world moves by a meter.
            moved[:, 0, 3] -= 1.0
            object_map.update_poses(kept, cam_from_world=moved)
            object_map.log_rerun()
            object_map.log_rerun()
        self.assertEqual(len(rows(shown.chunks, f"/world/map/{first}", "Clear:is_recursive")), 1)
        before, after = (np.array(value) for _, value in rows(shown.chunks, f"/world/map/{second}", "Ellipsoids3D:centers"))
        np.testing.assert_allclose(after - before, [[1, 0, 0]], atol=0.05)

    def test_boxes_are_those_of_the_image(self):
        object_map = package.ObjectMap()
        box = [500, 300, 600, 400]
        with Shown(self.folder / "lens.rrd") as shown:
            observe(object_map, {**next(iter(list(lines(1, lambda *_: True))[1:])), "detections": [{"box": box}]},
                    distortion=[-0.2, 0, 0, 0])
            object_map.log_rerun()
        [(_, [center])] = rows(shown.chunks, "/world/camera/image/boxes", "Boxes2D:centers")
        self.assertEqual(center, [550, 350])

    def test_what_cannot_be_logged(self):
        object_map = package.ObjectMap()
        with self.assertRaisesRegex(package.QuadliftError, "there is no recording; call rerun.init first"):
            object_map.log_rerun()
        with Shown(self.folder / "empty.rrd"):
            object_map.log_rerun()
            with self.assertRaisesRegex(package.QuadliftError, r"image has the shape \(2, 2\) and the dtype float64; expected"):
                object_map.log_rerun(np.zeros((2, 2)))

    def test_the_example(self):
        folder = self.folder
        records = list(lines(30, lambda *_: True))[1:]
        np.savez(folder / "poses.npz", intrinsics=INTRINSICS, cam_from_world=[r["cam_from_world"] for r in records])

        def result(record):
            boxes = types.SimpleNamespace(xyxy=np.array([d["box"] for d in record["detections"]]), cls=np.zeros(2),
                                          conf=np.full(2, 0.9), id=np.array([4.0, 5.0]))
            image = np.full((480, 640, 3), (255, 0, 0), np.uint8)
            return types.SimpleNamespace(boxes=boxes, names={0: "cup"}, orig_shape=(480, 640), orig_img=image)

        class Yolo:
            def __init__(self, model):
                pass

            def track(self, video, stream, verbose):
                return map(result, records)

        stub = types.SimpleNamespace(YOLO=Yolo)
        arguments = ["object_map_video.py", "video.mp4", str(folder / "poses.npz"), "-o", str(folder / "map.json"), "--rerun"]
        example = Path(__file__).with_name("object_map_video.py")
        # Without a viewer's window.
        with Shown(folder / "video.rrd") as shown, mock.patch.dict(sys.modules, {"ultralytics": stub}), \
                mock.patch.object(sys, "argv", arguments), mock.patch.object(rr, "init") as init:
            runpy.run_path(str(example))
        init.assert_called_once_with("quadlift", spawn=True)
        self.assertEqual(len(rows(shown.chunks, "/world/camera/image", "EncodedImage:blob")), 30)
        shown_ids = {chunk.entity_path for chunk in shown.chunks}
        self.assertLessEqual({"/world/map/object_0001", "/world/map/object_0002"}, shown_ids)
        self.assertEqual(package.Scene.read(folder / "map.json").object_count, 2)


if __name__ == "__main__":
    unittest.main()
