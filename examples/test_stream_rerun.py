"""Shows streams in Rerun with `quadlift stream --rerun` and reads the recordings back. Run by scripts/test_rerun.sh, as
test_to_rerun.py is."""

import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader
from test_to_rerun import QUADLIFT, RENDERED, quadlift, read, verified

ENVIRONMENT = {**os.environ, "QUADLIFT_PYTHON": sys.executable}


def lines(frames, shown):
    """The lines of a camera that moves to and fro before two cups; `shown(frame, cup)` says whether a cup is detected."""
    camera = {"id": "left", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}
    yield {"name": "cups", "up": [0, -2, 0], "cameras": [camera]}
    for k in range(frames):
        x = 0.5 * np.cos(0.15 * k)
        boxes = [[220 - 100 * x, 190, 320 - 100 * x, 290], [370 - 100 * x, 190, 470 - 100 * x, 290]]
        detections = [{"box": box, "category": "cup"} for cup, box in enumerate(boxes) if shown(k, cup)]
        pose = [[1, 0, 0, -x], [0, 1, 0, 0], [0, 0, 1, 0]]
        yield {"frame": f"{k}.jpg", "time": k / 10, "camera": "left", "cam_from_world": pose, "detections": detections}


def text(records):
    return "".join(json.dumps(record) + "\n" for record in records)


def stream(folder, *args, given=None, environment=ENVIRONMENT):
    command = [QUADLIFT, "stream", *args]
    return subprocess.run(command, cwd=folder, env=environment, input=given, capture_output=True, text=True, timeout=120)


def rows(chunks, entity, column):
    """The frame and the value of each row of an entity that has this column, in their order; of one frame, the last."""
    found = []
    for chunk in chunks:
        batch = chunk.to_record_batch() if chunk.entity_path == entity else None
        if batch is None or column not in batch.schema.names:
            continue
        frames = [None] * batch.num_rows if chunk.is_static else batch.column("frame").to_pylist()
        found += zip(frames, batch.column("rerun.controls.RowId").to_pylist(), batch.column(column).to_pylist())
    return [(frame, value) for frame, _, value in sorted(found, key=lambda row: (row[0] or 0, row[1])) if value]


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Server:
    """A server of Rerun without a window, which may write what it gets into a recording."""

    def __init__(self, *args):
        self.port = free_port()
        command = [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", "--port", str(self.port), *args]
        self.process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
        for _ in range(300):
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.1)
        raise AssertionError("the server does not answer")

    def end(self, signal=9):
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal)
            try:
                self.process.wait(timeout=60)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, 9)
                self.process.wait()


class StreamRerun(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def test_a_recording_of_a_scene(self):
        folder = self.folder
        quadlift(folder, "synth", "-o", "scene.json", "--ground-truth", "truth.json", "--no-ids", "--objects", "6", "--views", "20",
                 "--seed", "2", "--noise", "box:0.03")
        plain = stream(folder, "scene.json", "--map", "plain.json", "-q")
        shown = stream(folder, "scene.json", "--map", "shown.json", "--rerun=live.rrd")
        self.assertEqual((plain.returncode, shown.returncode), (0, 0), shown.stderr)
        self.assertIn("wrote live.rrd", shown.stderr)
        # What is shown changes neither events nor map.
        self.assertEqual(shown.stdout, plain.stdout)
        self.assertEqual((folder / "shown.json").read_bytes(), (folder / "plain.json").read_bytes())
        chunks = verified(folder / "live.rrd")
        events = [json.loads(line) for line in shown.stdout.splitlines()]
        scene, frames = read(folder / "scene.json"), [line for line in events if "frame" in line]

        colors = {}
        for number in range(1, 7):
            entity = f"/world/map/object_{number:04}"
            sizes, centers = rows(chunks, entity, "Ellipsoids3D:half_sizes"), rows(chunks, entity, "Ellipsoids3D:centers")
            self.assertTrue(1 < len(sizes) <= len(frames) + 1, f"{entity} is logged when it changes: {len(sizes)}")
            # Where the objects are in the end; the map file has better estimates of the same objects.
            expected = read(folder / "shown.json")["objects"][number - 1]["body"]["center"]
            np.testing.assert_allclose(centers[-1][1][0], expected, atol=0.3)
            (_, [label]), (_, [colors[f"object_{number:04}"]]) = (
                rows(chunks, entity, "Ellipsoids3D:labels")[-1], rows(chunks, entity, "Ellipsoids3D:colors")[-1])
            self.assertEqual(label.split()[0], f"object_{number:04}")
        self.assertEqual(len(set(colors.values())), 6)

        half_sizes = dict(rows(chunks, "/world/camera/image/boxes", "Boxes2D:half_sizes"))
        box_colors = dict(rows(chunks, "/world/camera/image/boxes", "Boxes2D:colors"))
        for index, line in enumerate(frames):
            boxes = [d["box"] for d in scene["detections"] if d["frame"] == line["frame"]]
            expected = [[(x1 - x0) / 2, (y1 - y0) / 2] for x0, y0, x1, y1 in boxes]
            np.testing.assert_allclose(half_sizes[index], expected, rtol=1e-5)
            for owner, color in zip(line["objects"], box_colors[index]):
                self.assertEqual(color, colors.get(owner, 0x888888FF))
        poses = dict(rows(chunks, "/world/camera", "Transform3D:translation"))
        for index, frame in enumerate(scene["frames"]):
            np.testing.assert_allclose(poses[index][0], np.array(frame["cam_from_world"])[:, 3], rtol=1e-5, atol=1e-9)
        texts = [value for _, [value] in rows(chunks, "/events", "TextLog:text")]
        self.assertEqual(len(texts), sum(len(line["events"]) for line in events))
        self.assertEqual(sum(value.startswith("confirmed") for value in texts), 6)

    def test_images(self):
        folder = self.folder
        shutil.copytree(RENDERED, folder, dirs_exist_ok=True)
        scene = read(folder / "scene.json")
        scene["frames"][3]["image"] = "images/none.jpg"
        (folder / "scene.json").write_text(json.dumps(scene))
        run = stream(folder, "scene.json", "--rerun=live.rrd")
        self.assertEqual(run.returncode, 0, run.stderr)
        blobs = rows(verified(folder / "live.rrd"), "/world/camera/image", "EncodedImage:blob")
        self.assertEqual([index for index, _ in blobs], [0, 1, 2, 4, 5, 6, 7])
        for index, [blob] in blobs:
            self.assertEqual(bytes(blob), (folder / scene["frames"][index]["image"]).read_bytes())

    def test_objects_that_are_gone_vanish_and_errors_are_events(self):
        given = text(lines(60, lambda k, cup: cup == 0 or k < 20)) + "nonsense\n"
        run = stream(self.folder, "--rerun=live.rrd", given=given)
        self.assertEqual(run.returncode, 0, run.stderr)
        [(index, gone)] = [(index, event["object"]) for index, line in enumerate(map(json.loads, run.stdout.splitlines()))
                           for event in line["events"] if event["type"] == "removed" and event["reason"] == "gone"]
        chunks = verified(self.folder / "live.rrd")
        cleared = rows(chunks, f"/world/map/{gone}", "Clear:is_recursive")
        self.assertEqual([frame for frame, _ in cleared], [index])
        last = [frame for frame, _ in rows(chunks, f"/world/map/{gone}", "Ellipsoids3D:centers")][-1]
        self.assertLess(last, index)
        confirmed = [value.split()[1] for _, [value] in rows(chunks, "/events", "TextLog:text") if value.startswith("confirmed")]
        [other] = {*confirmed} - {gone}
        self.assertEqual(rows(chunks, f"/world/map/{other}", "Clear:is_recursive"), [])
        texts = [value for _, [value] in rows(chunks, "/events", "TextLog:text")]
        self.assertIn(f"removed {gone} (cup): gone", texts)
        self.assertTrue(any(value.startswith("line 62: ") for value in texts), texts)
        self.assertEqual([value for _, value in rows(chunks, f"/world/map/{other}", "Ellipsoids3D:labels")][-1], [f"{other} cup"])
        # The world's direction against gravity, of any length.
        self.assertEqual(len(rows(chunks, "/world", "ViewCoordinates:xyz")), 1)

    def test_a_viewer(self):
        server = Server("--save", str(self.folder / "viewer.rrd"))
        self.addCleanup(server.end)
        run = stream(self.folder, f"--rerun=127.0.0.1:{server.port}", given=text(lines(30, lambda *_: True)))
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertNotIn("warning", run.stderr)
        time.sleep(1)
        server.end(2)
        # The server ends without a footer, which `rerun rrd verify` misses.
        chunks = RrdReader(str(self.folder / "viewer.rrd")).stream().to_chunks()
        confirmed = [event["object"] for line in map(json.loads, run.stdout.splitlines()) for event in line["events"]
                     if event["type"] == "confirmed"]
        self.assertEqual(len(confirmed), 2)
        shown = {chunk.entity_path for chunk in chunks}
        self.assertTrue({f"/world/map/{name}" for name in confirmed} <= shown, shown)

    def test_a_viewer_that_goes_away_does_not_end_the_stream(self):
        server = Server("--serve-grpc")
        self.addCleanup(server.end)
        command = [QUADLIFT, "stream", f"--rerun=rerun+http://127.0.0.1:{server.port}/proxy"]
        pipe = subprocess.PIPE
        run = subprocess.Popen(command, cwd=self.folder, env=ENVIRONMENT, stdin=pipe, stdout=pipe, stderr=pipe, text=True)
        records = list(lines(60, lambda *_: True))
        answers = []
        for index, record in enumerate(records):
            run.stdin.write(text([record]))
            run.stdin.flush()
            if index > 0:
                answers.append(json.loads(run.stdout.readline()))
            if index == 20:
                server.end()
            if index >= 20:
                time.sleep(0.1)
        rest, told = run.communicate(timeout=60)
        self.assertEqual(run.returncode, 0, told)
        self.assertIn("warning: Rerun shows no more of the stream, which goes on without it", told)
        plain = stream(self.folder, given=text(records))
        self.assertEqual([*answers, *map(json.loads, rest.splitlines())], list(map(json.loads, plain.stdout.splitlines())))

    def test_what_cannot_be_opened(self):
        port = free_port()
        run = stream(self.folder, f"--rerun=127.0.0.1:{port}", given="")
        self.assertEqual(run.returncode, 1)
        self.assertIn(f"error: --rerun: there is no viewer at 127.0.0.1:{port} (", run.stderr)
        python = self.folder / "python"
        python.write_text(f'#!/bin/sh\nexec {sys.executable} -S "$@"\n')
        python.chmod(0o755)
        run = stream(self.folder, "--rerun=out.rrd", given="", environment={**os.environ, "QUADLIFT_PYTHON": str(python)})
        self.assertEqual(run.returncode, 1)
        self.assertIn("-m pip install rerun-sdk", run.stderr)


if __name__ == "__main__":
    unittest.main()
