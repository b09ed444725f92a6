"""Makes recordings with `quadlift export rerun` and to_rerun.py, and from Python, and reads them back. Run by
scripts/test_rerun.sh, which names the program in QUADLIFT and installs the package. Every check is against the scene files, not against the folder between the two."""

import io
import json
import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import quadlift as package
import rerun as rr
from PIL import Image
from rerun.chunk import RrdReader

QUADLIFT = os.environ["QUADLIFT"]
RENDERED = Path(__file__).parents[1] / "crates/quadlift-cli/tests/fixtures/rendered"
IMPORTER = Path(sys.executable).with_name("rerun-importer-quadlift")


class Recording:
    """A recording that has been written, verified and read."""

    def __init__(self, folder, *files):
        path = folder / "recording.rrd"
        script = Path(__file__).with_name("to_rerun.py")
        quadlift(folder, "export", "rerun", *files, "-o", "folder")
        subprocess.run([sys.executable, script, "folder", "-o", path], cwd=folder, check=True)
        self.chunks = verified(path)

    def entities(self):
        return {chunk.entity_path for chunk in self.chunks}

    def values(self, entity, component):
        """Frame number (None for static data) and value of every row."""
        rows = []
        for chunk in self.chunks:
            batch = chunk.to_record_batch() if chunk.entity_path == entity else None
            if batch is None or component not in batch.schema.names:
                continue
            column = batch.column(component).to_pylist()
            frames = [None] * len(column) if chunk.is_static else batch.column("frame").to_pylist()
            rows += zip(frames, column)
        assert rows, f"{entity} has no {component}: {self.entities()}"
        return sorted((row for row in rows if row[1]), key=lambda row: -1 if row[0] is None else row[0])


def verified(path):
    """The chunks of a recording."""
    subprocess.run([sys.executable, "-m", "rerun", "rrd", "verify", path], check=True)
    return RrdReader(str(path)).stream().to_chunks()


def content(chunks):
    """What a recording holds, by entity: the frames and all columns but the rows' ids and the wall clock."""
    found = {}
    for chunk in chunks:
        # The recording's own name and start are no entity of the world.
        if not str(chunk.entity_path).startswith("/world"):
            continue
        batch = chunk.to_record_batch()
        names = [name for name in batch.schema.names if not name.startswith(("rerun.", "log_"))]
        for row in zip(*(batch.column(name).to_pylist() for name in names)):
            found.setdefault(chunk.entity_path, []).append(repr(sorted(zip(names, row))))
    return {entity: sorted(rows) for entity, rows in found.items()}


def quadlift(folder, *args):
    subprocess.run([QUADLIFT, "-q", *args], cwd=folder, check=True, stdout=subprocess.DEVNULL)


def block_means(image):
    """Mean colors of the image's blocks of 8 x 8 pixels."""
    height, width = image.height // 8, image.width // 8
    pixels = np.asarray(image.convert("RGB"), dtype=float)[:8 * height, :8 * width]
    return pixels.reshape(height, 8, width, 8, 3).mean(axis=(1, 3))


def read(path):
    return json.loads(path.read_text())


class ToRerun(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def test_a_scene_with_images(self):
        folder = self.folder
        shutil.copytree(RENDERED, folder, dirs_exist_ok=True)
        quadlift(folder, "localize", "scene.json", "-o", "estimate.json", "--body", "ellipsoid")
        recording = Recording(folder, "scene.json", "estimate.json")
        scene, estimate = read(folder / "scene.json"), read(folder / "estimate.json")
        for entity in ["estimate/ellipsoids", "truth/ellipsoids", "path", "camera", "camera/image",
                       "camera/image/boxes", "camera/image/outlines", "camera/image/true_outlines"]:
            self.assertIn(f"/world/{entity}", recording.entities())

        objects = estimate["objects"]
        [(frame, axes)] = recording.values("/world/estimate/ellipsoids", "Ellipsoids3D:half_sizes")
        self.assertIsNone(frame)
        np.testing.assert_allclose(axes, [o["body"]["half_extents"] for o in objects], rtol=1e-6)
        [(_, quaternions)] = recording.values("/world/estimate/ellipsoids", "Ellipsoids3D:quaternions")
        w_last = [o["body"]["rotation"][1:] + o["body"]["rotation"][:1] for o in objects]
        np.testing.assert_allclose(quaternions, w_last, atol=1e-6)

        images = recording.values("/world/camera/image", "EncodedImage:blob")
        self.assertEqual([frame for frame, _ in images], list(range(8)))
        for (_, [blob]), frame in zip(images, scene["frames"]):
            shown, source = Image.open(io.BytesIO(bytes(blob))), Image.open(folder / frame["image"])
            self.assertEqual(shown.size, source.size)
            # JPEG of this quality loses the rendered noise, five levels of each pixel, but not the means of its blocks.
            np.testing.assert_allclose(block_means(shown), block_means(source), atol=3)
        [fx, fy, cx, cy] = scene["cameras"][0]["params"]
        (_, [pinhole]) = recording.values("/world/camera/image", "Pinhole:image_from_camera")[0]
        # Columns one after another. The matrix comes from a decomposition: zero up to rounding.
        np.testing.assert_allclose(pinhole, [fx, 0, 0, 0, fy, 0, cx, cy, 1], rtol=1e-6, atol=1e-9)
        # The camera as the child of the world: [R | t], columns one after another.
        for index, [translation] in recording.values("/world/camera", "Transform3D:translation"):
            np.testing.assert_allclose(translation, np.array(scene["frames"][index]["cam_from_world"])[:, 3], rtol=1e-5)
        for index, [matrix] in recording.values("/world/camera", "Transform3D:mat3x3"):
            rotation = np.array(scene["frames"][index]["cam_from_world"])[:, :3]
            np.testing.assert_allclose(np.reshape(matrix, (3, 3)).T, rotation, atol=1e-6)
        for _, relation in recording.values("/world/camera", "Transform3D:relation"):
            self.assertEqual(relation, [2])  # ChildFromParent

        edges = {(d["frame"], d["object"]): d["box"] for d in scene["detections"]}
        names = dict(recording.values("/world/camera/image/boxes", "Boxes2D:labels"))
        half_sizes = dict(recording.values("/world/camera/image/boxes", "Boxes2D:half_sizes"))
        for index, centers in recording.values("/world/camera/image/boxes", "Boxes2D:centers"):
            for name, center, half in zip(names[index], np.array(centers), np.array(half_sizes[index])):
                expected = edges.pop((scene["frames"][index]["id"], name))
                np.testing.assert_allclose(np.concatenate([center - half, center + half]), expected, atol=1e-3)
        self.assertEqual(edges, {})

        # The boxes of the outlines give the residuals that the program has computed.
        residuals = {(o["id"], v["frame"]): v["residual_px"] for o in objects for v in o["view_residuals_px"]}
        boxes = {(d["object"], d["frame"]): np.array(d["box"]) for d in scene["detections"]}
        strips = recording.values("/world/camera/image/outlines", "LineStrips2D:strips")
        labels = dict(recording.values("/world/camera/image/outlines", "LineStrips2D:labels"))
        compared = 0
        width, height = scene["cameras"][0]["width"], scene["cameras"][0]["height"]
        for index, outlines in strips:
            for name, points in zip(labels[index], outlines):
                key = (name, scene["frames"][index]["id"])
                box = boxes.get(key)
                # Edges at the border of the image do not count for the program.
                if box is None or box[:2].min() < 2 or box[2] > width - 2 or box[3] > height - 2:
                    continue
                points = np.array(points)
                edges = np.concatenate([points.min(axis=0), points.max(axis=0)])
                found = np.sqrt(np.mean((edges - box) ** 2))
                self.assertLess(abs(found - residuals[key]), 0.3, key)
                compared += 1
        self.assertGreater(compared, 5)

    def test_cuboids_and_projections(self):
        folder = self.folder
        quadlift(folder, "synth", "-o", "scene.json", "--objects", "3", "--views", "6", "--body", "cuboid")
        quadlift(folder, "localize", "scene.json", "-o", "estimate.json", "--body", "cuboid")
        scene = read(folder / "scene.json")
        [camera] = scene["cameras"]
        fx, fy, cx, cy = camera["params"]
        k = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
        poses = [np.array(record["cam_from_world"]) for record in scene["frames"]]
        for index, (record, pose) in enumerate(zip(scene["frames"], poses)):
            # Any scale, also a negative one.
            record["projection"] = (-0.01 * k @ pose).tolist()
            record["time"] = 0.5 * index
            del record["camera"], record["cam_from_world"]
        (folder / "projections.json").write_text(json.dumps(scene))
        recording = Recording(folder, "estimate.json", "projections.json")
        for _, [matrix] in recording.values("/world/camera/image", "Pinhole:image_from_camera"):
            np.testing.assert_allclose(np.reshape(matrix, (3, 3)).T, k, rtol=1e-5, atol=1e-3)
        for index, [translation] in recording.values("/world/camera", "Transform3D:translation"):
            np.testing.assert_allclose(translation, poses[index][:, 3], rtol=1e-5, atol=1e-5)
        [(_, sizes)] = recording.values("/world/estimate/cuboids", "Boxes3D:half_sizes")
        objects = read(folder / "estimate.json")["objects"]
        np.testing.assert_allclose(sizes, [o["body"]["half_extents"] for o in objects], rtol=1e-6)
        self.assertIn("/world/truth/cuboids", recording.entities())
        # The twelve edges of each cuboid.
        strips = recording.values("/world/camera/image/outlines", "LineStrips2D:strips")
        self.assertEqual([len(lines) for _, lines in strips], [36] * 6)
        times = [chunk.to_record_batch() for chunk in recording.chunks if chunk.entity_path == "/world/camera"]
        times = [t.total_seconds() for batch in times for t in batch.column("time").to_pylist()]
        self.assertEqual(sorted(set(times)), [0, 0.5, 1, 1.5, 2, 2.5])

    def test_a_rounded_body_is_logged_as_its_ellipsoid(self):
        folder = self.folder
        body = ["--body", "rounded:0.5", "--noise", "box:0.01"]
        quadlift(folder, "synth", "-o", "scene.json", "--objects", "4", "--views", "12", *body)
        quadlift(folder, "localize", "scene.json", "-o", "estimate.json", "--body", "rounded")
        recording = Recording(folder, "scene.json", "estimate.json")
        [(_, axes)] = recording.values("/world/estimate/ellipsoids", "Ellipsoids3D:half_sizes")
        estimates = package.Scene.read(folder / "scene.json").localize(body="rounded")
        np.testing.assert_allclose(axes, estimates.closest_ellipsoids(), rtol=1e-6)


    def test_from_python(self):
        folder = self.folder
        shutil.copytree(RENDERED, folder, dirs_exist_ok=True)
        quadlift(folder, "localize", "scene.json", "-o", "estimate.json", "--body", "ellipsoid")
        expected = content(Recording(folder, "scene.json", "estimate.json").chunks)
        self.assertIn("/world/camera/image/outlines", expected)
        scene = package.Scene.read(folder / "scene.json")
        estimates = scene.localize(body="ellipsoid")
        estimates.to_rerun(folder / "python.rrd", truth=scene)
        self.assertEqual(content(verified(folder / "python.rrd")), expected)
        # To the recording that there is.
        with rr.RecordingStream("mine") as mine:
            mine.save(folder / "mine.rrd")
            estimates.to_rerun(truth=scene)
            mine.flush()
            mine.disconnect()
        self.assertEqual(content(verified(folder / "mine.rrd")), expected)
        # A scene alone, some of whose images are gone.
        sorted((folder / "images").iterdir())[1].unlink()
        with self.assertWarnsRegex(UserWarning, "no such file"):
            scene.to_rerun(folder / "scene.rrd")
        found = content(verified(folder / "scene.rrd"))
        for entity in ("/world/camera", "/world/camera/image/boxes"):
            self.assertEqual(found[entity], expected[entity])

    def test_the_importer(self):
        folder = self.folder
        shutil.copytree(RENDERED, folder, dirs_exist_ok=True)
        quadlift(folder, "localize", "scene.json", "-o", "estimate.json")
        quadlift(folder, "stream", "scene.json", "--map", "map.json")
        quadlift(folder, "export", "rerun", "scene.json", "estimate.json", "-o", "recording")

        def imported(name, *args):
            command = [IMPORTER, name, "--application-id", "app", "--recording-id", "mine", *args]
            return subprocess.run(command, cwd=folder, capture_output=True)

        def entities(name, *args):
            run = imported(name, *args)
            self.assertEqual(run.returncode, 0, run.stderr)
            (folder / "imported.rrd").write_bytes(run.stdout)
            return content(verified(folder / "imported.rrd"))

        for name in ["scene.json", "estimate.json", "map.json"]:
            package.Scene.read(folder / name).to_rerun(folder / "expected.rrd")
            expected = content(verified(folder / "expected.rrd"))
            self.assertIn("/world/camera/image/boxes", expected)
            # Other arguments that Rerun passes, now or later, change nothing.
            self.assertEqual(entities(name, "--opened-recording-id", "a", "--time_sequence", "b=1", "--new"), expected)
        package.log_recording(folder / "recording", folder / "expected.rrd")
        expected = content(verified(folder / "expected.rrd"))
        for name in ["recording", "recording/recording.json"]:
            self.assertEqual(entities(name), expected)
        imported_below = imported("recording", "--entity-path-prefix", "/a/b")
        (folder / "below.rrd").write_bytes(imported_below.stdout)
        below = {chunk.entity_path for chunk in verified(folder / "below.rrd")}
        self.assertTrue({f"/a/b{path}" for path in expected} <= below, below)

        # As the viewer finds it.
        script = """if True:
            import rerun as rr
            with rr.RecordingStream("app", recording_id="mine") as stream:
                stream.save("logged.rrd")
                rr.log_file_from_path("recording/recording.json")
                stream.flush()
                stream.disconnect()"""
        path = os.pathsep.join([str(IMPORTER.parent), os.environ["PATH"]])
        subprocess.run([sys.executable, "-c", script], cwd=folder, env={**os.environ, "PATH": path}, check=True)
        self.assertEqual(content(verified(folder / "logged.rrd")), expected)

        # What is not ours.
        (folder / "other.json").write_text('{"format": "other", "version": 1}')
        (folder / "scene.txt").write_text((folder / "scene.json").read_text())
        for name in ["other.json", "scene.txt", "missing.json", "images", "recording/images"]:
            run = imported(name)
            self.assertEqual((run.returncode, run.stdout), (rr.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE, b""), name)
        (folder / "broken.json").write_text('{"format": "quadlift.scene", "version": 1, "frames": 7}')
        run = imported("broken.json")
        self.assertEqual((run.returncode, run.stdout), (1, b""))
        self.assertIn("broken.json:1:", run.stderr.decode())

    def test_without_recording(self):
        scene = package.Scene.from_arrays(projections=np.eye(3, 4)[None])
        with self.assertRaisesRegex(package.QuadliftError, "there is no recording; call rerun.init first"):
            scene.to_rerun()
        with self.assertRaisesRegex(package.QuadliftError, "recording.json: there is no such file; expected the output of"):
            package.log_recording(self.folder)


if __name__ == "__main__":
    unittest.main()
