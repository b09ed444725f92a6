"""Writes logs in MCAP with the packages that people use for them, reads them with quadlift, and the other way round.

    python scripts/check_mcap.py path/to/quadlift

Needs check_exports_requirements.txt. With --seeds it only writes the seeds of the fuzz target. The logs are those of a synthetic drive: a camera calibration, a tree of three moving and
fixed transforms, and 2D detections. quadlift must find in them the objects of the scene file.
"""

import json
import os
import subprocess
import sys
import tempfile
import time as time_module
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as RawWriter
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import Reader as BagReader
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

START = 1_700_000_000_123_456_789
PERIOD = 100_000_000
CAMERA = "camera_optical"

# Fields of vision_msgs, which rosbags does not have: version 4, and version 2 of ROS 2 Foxy.
HYPOTHESIS_WITH_POSE = "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
VISION_4 = {
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": HYPOTHESIS_WITH_POSE,
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nstring id\n",
    "Detection2DArray": "std_msgs/Header header\nDetection2D[] detections\n",
    "Detection3D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id\n",
    "Detection3DArray": "std_msgs/Header header\nDetection3D[] detections\n",
}
VISION_2 = {
    "BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "ObjectHypothesisWithPose": "string id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose\n",
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\n"
    "sensor_msgs/Image source_img\nbool is_tracking\nstring tracking_id\n",
    "Detection2DArray": VISION_4["Detection2DArray"],
}


def run(*arguments, code=0):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    assert done.returncode == code, (arguments, done.returncode, done.stdout, done.stderr)
    return done.stdout + done.stderr


def typestore(vision):
    store = get_typestore(Stores.ROS2_JAZZY)
    types = {}
    for name, text in vision.items():
        types.update(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    store.register(types)
    return store


def rotation_of(xyzw):
    x, y, z, w = xyzw
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def quaternion_of(r):
    """The unit quaternion (x, y, z, w) of a rotation, as the eigenvector of a symmetric matrix."""
    a = np.array([
        [r[0, 0] - r[1, 1] - r[2, 2], r[1, 0] + r[0, 1], r[2, 0] + r[0, 2], r[2, 1] - r[1, 2]],
        [0, r[1, 1] - r[0, 0] - r[2, 2], r[2, 1] + r[1, 2], r[0, 2] - r[2, 0]],
        [0, 0, r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
        [0, 0, 0, r[0, 0] + r[1, 1] + r[2, 2]],
    ])
    return np.linalg.eigh(a, UPLO="U")[1][:, -1]


def pose(rotation=np.eye(3), translation=(0, 0, 0)):
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return matrix


def turn(axis, angle):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    return rotation_of([*(axis * np.sin(angle / 2)), np.cos(angle / 2)])


def between(a, b, share):
    """Between two poses: along a line, and about one axis."""
    p, q = quaternion_of(a[:3, :3]), quaternion_of(b[:3, :3])
    q = q if p @ q > 0 else -q
    angle = np.arccos(min(1.0, p @ q))
    mixed = p if angle < 1e-9 else (np.sin((1 - share) * angle) * p + np.sin(share * angle) * q) / np.sin(angle)
    return pose(rotation_of(mixed), (1 - share) * a[:3, 3] + share * b[:3, 3])


def odometry(time):
    """How odom drifts in the map, time in seconds."""
    return pose(turn([0.1, 0.2, 1], 0.05 * time), [0.3 * time, 0.1 * np.sin(time), 0.01 * time])


BASE_FROM_CAMERA = pose(rotation_of([-0.5, 0.5, -0.5, 0.5]), [0.4, -0.1, 1.2])


class Drive:
    """A scene as a drive: a frame every tenth of a second."""

    def __init__(self, scene):
        self.scene = scene
        self.stamps = [START + k * PERIOD for k in range(len(scene["frames"]))]
        self.poses = [np.linalg.inv(np.vstack([f["cam_from_world"], [0, 0, 0, 1]])) for f in scene["frames"]]

    def camera_pose(self, stamp):
        share = (stamp - START) / PERIOD
        k = min(max(int(share), 0), len(self.poses) - 2)
        return between(self.poses[k], self.poses[k + 1], share - k)

    def transforms(self, stamps):
        """The moving transforms: map to odom and odom to base_link."""
        for stamp in stamps:
            at_frame, rest = divmod(stamp - START, PERIOD)
            world_from_camera = self.poses[at_frame] if rest == 0 else self.camera_pose(stamp)
            map_from_odom = odometry((stamp - START) * 1e-9)
            odom_from_base = np.linalg.inv(map_from_odom) @ world_from_camera @ np.linalg.inv(BASE_FROM_CAMERA)
            yield stamp, [("map", "odom", map_from_odom), ("odom", "base_link", odom_from_base)]

    def detections(self, index):
        name = self.scene["frames"][index]["id"]
        return [d for d in self.scene["detections"] if d["frame"] == name]


def jittered(stamps, seed=7):
    """Times at about 50 Hz that are not those of the frames, from before the first one until after the last one."""
    rng = np.random.default_rng(seed)
    times = np.arange(stamps[0] - 40_000_000, stamps[-1] + 60_000_000, 20_000_000)
    return [int(t) + int(rng.integers(-6_000_000, 6_000_000)) for t in times]


# Messages as dictionaries of the names that both packages take.


def header(stamp, frame):
    return {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": frame}


def xyz(v):
    return {"x": float(v[0]), "y": float(v[1]), "z": float(v[2])}


def transform(stamp, parent, child, matrix):
    x, y, z, w = (float(q) for q in quaternion_of(matrix[:3, :3]))
    rotation = {"x": x, "y": y, "z": z, "w": w}
    inner = {"translation": xyz(matrix[:3, 3]), "rotation": rotation}
    return {"header": header(stamp, parent), "child_frame_id": child, "transform": inner}


def camera_info(stamp, camera, frame=CAMERA):
    fx, fy, cx, cy, *d = camera["params"]
    model, d = {
        "PINHOLE": ("plumb_bob", [0.0] * 5),
        "OPENCV": ("plumb_bob", [*d, 0.0]),
        "FULL_OPENCV": ("rational_polynomial", d),
        "OPENCV_FISHEYE": ("equidistant", d),
    }[camera["model"]]
    return {
        "header": header(stamp, frame),
        "height": int(camera["height"]),
        "width": int(camera["width"]),
        "distortion_model": model,
        "d": [float(x) for x in d],
        "k": [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0],
        "r": [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        "p": [fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }


IDENTITY = {
    "pose": {"position": xyz([0, 0, 0]), "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}},
    "covariance": [0.0] * 36,
}


def detection_array(stamp, detections, version=4, frame=CAMERA):
    found = []
    for d in detections:
        x0, y0, x1, y1 = d["box"]
        center = {"x": (x0 + x1) / 2, "y": (y0 + y1) / 2}
        size = {"size_x": x1 - x0, "size_y": y1 - y0}
        name, score, track = d.get("category", "thing"), d.get("score", 0.9), d.get("object", "")
        if version == 4:
            results = [{"hypothesis": {"class_id": name, "score": score}, "pose": IDENTITY}]
            box = {"center": {"position": center, "theta": 0.0}, **size}
            rest = {"id": track}
        else:
            results = [{"id": name, "score": score, "pose": IDENTITY}]
            box = {"center": {**center, "theta": 0.0}, **size}
            image = {"header": header(stamp, frame), "height": 0, "width": 0, "encoding": "", "is_bigendian": 0}
            rest = {"source_img": {**image, "step": 0, "data": []}, "is_tracking": track != "", "tracking_id": track}
        found.append({"header": header(stamp, frame), "results": results, "bbox": box, **rest})
    return {"header": header(stamp, frame), "detections": found}


def messages(drive, transform_stamps, version=4):
    """All messages of a drive with their topics and types, in the order of their times."""
    fixed = [transform(START, "base_link", CAMERA, BASE_FROM_CAMERA)]
    listed = [(0, "/tf_static", "tf2_msgs/msg/TFMessage", {"transforms": fixed})]
    for stamp, links in drive.transforms(transform_stamps):
        message = {"transforms": [transform(stamp, *link) for link in links]}
        listed.append((stamp, "/tf", "tf2_msgs/msg/TFMessage", message))
    for index, stamp in enumerate(drive.stamps):
        info = camera_info(stamp, drive.scene["cameras"][0])
        listed.append((stamp, "/camera/camera_info", "sensor_msgs/msg/CameraInfo", info))
        # The detector takes a while.
        array = detection_array(stamp, drive.detections(index), version)
        listed.append((stamp + 80_000_000, "/detector/boxes", "vision_msgs/msg/Detection2DArray", array))
    return sorted(listed, key=lambda entry: entry[0])


def from_dict(store, name, value):
    """A message of rosbags' classes."""
    from rosbags.interfaces import Nodetype

    fields = store.get_msgdef(name).fields

    def convert(kind, value):
        tag, inner = kind
        if tag == Nodetype.NAME:
            return from_dict(store, inner, value)
        if tag in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            element = inner[0]
            if element[0] == Nodetype.BASE and element[1][0] != "string":
                return np.array(value, dtype={"octet": "uint8"}.get(element[1][0], element[1][0]))
            return [convert(element, item) for item in value]
        return value

    return store.types[name](**{field: convert(kind, value[field]) for field, kind in fields})


def write_with_rosbags(path, drive, transform_stamps, vision=VISION_4, version=4):
    """Writes with rosbags; returns the file in the folder of the bag."""
    store = typestore(vision)
    with BagWriter(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for time, topic, name, value in messages(drive, transform_stamps, version):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            writer.write(connections[topic], max(time, START), store.serialize_cdr(from_dict(store, name, value), name))
    return next(path.glob("*.mcap"))


def write_with_mcap(path, drive, transform_stamps, compression=CompressionType.LZ4, change=lambda listed: listed):
    """Writes with mcap-ros2-support, in small chunks."""
    store = typestore(VISION_4)
    schemas = {}
    with path.open("wb") as file:
        writer = Ros2Writer(file, chunk_size=20_000, compression=compression)
        for time, topic, name, value in change(messages(drive, transform_stamps)):
            if name not in schemas:
                text, _ = store.generate_msgdef(name, ros_version=2)
                schemas[name] = writer.register_msgdef(name, text)
            writer.write_message(topic, schemas[name], value, log_time=max(time, START), publish_time=max(time, START))
        writer.finish()
    return path


# The transforms' definition in IDL.
TRANSFORMS_IDL = '''#include "geometry_msgs/msg/TransformStamped.idl"
module tf2_msgs { module msg { struct TFMessage { sequence<geometry_msgs::msg::TransformStamped> transforms; }; }; };
================================================================================
IDL: geometry_msgs/msg/TransformStamped
module geometry_msgs { module msg {
@verbatim (language="comment", text="A transform.")
struct TransformStamped { std_msgs::msg::Header header; string child_frame_id; geometry_msgs::msg::Transform transform; };
struct Transform { geometry_msgs::msg::Vector3 translation; geometry_msgs::msg::Quaternion rotation; };
struct Vector3 { double x; double y; double z; };
struct Quaternion { @default (value=0.0) double x; double y; double z; double w; }; }; };
================================================================================
IDL: std_msgs/msg/Header
module std_msgs { module msg { struct Header { builtin_interfaces::msg::Time stamp; string frame_id; }; }; };
'''


def write_plain(path, listed, in_chunks, idl=False):
    """Writes without compression and checksums, which a fuzzer could not change."""
    store = typestore(VISION_4)
    with path.open("wb") as file:
        writer = RawWriter(file, use_chunking=in_chunks, enable_crcs=False, compression=CompressionType.NONE)
        writer.start()
        channels = {}
        for time, topic, name, value in listed:
            if topic not in channels:
                definition = "ros2msg", store.generate_msgdef(name, ros_version=2)[0]
                if idl and topic.startswith("/tf"):
                    definition = "ros2idl", TRANSFORMS_IDL
                schema = writer.register_schema(name, definition[0], definition[1].encode())
                channels[topic] = writer.register_channel(topic, "cdr", schema)
            data = bytes(store.serialize_cdr(from_dict(store, name, value), name))
            writer.add_message(channels[topic], log_time=max(time, START), publish_time=max(time, START), data=data)
        writer.finish()


def write_seeds(folder, scene):
    """Small logs for the fuzzer: the first three frames with detections, two boxes each."""
    seen = [f for f in scene["frames"] if any(d["frame"] == f["id"] for d in scene["detections"])][:3]
    boxes = [d for f in seen for d in [d for d in scene["detections"] if d["frame"] == f["id"]][:2]]
    drive = Drive({**scene, "frames": seen, "detections": boxes})
    stamps = sorted({*drive.stamps, START + 30_000_000, drive.stamps[-1] + 10_000_000})
    write_with_mcap(folder / "ros2_lz4.mcap", drive, stamps)
    write_with_mcap(folder / "ros2_zstd.mcap", drive, stamps, CompressionType.ZSTD)
    write_json(folder / "foxglove_json.mcap", drive, stamps)
    write_protobuf(folder / "foxglove_protobuf.mcap", drive, stamps)
    write_plain(folder / "ros2_messages.mcap", messages(drive, stamps), in_chunks=False)
    write_plain(folder / "ros2_chunks.mcap", with_odometry(messages(drive, stamps)), in_chunks=True)
    write_plain(folder / "ros2_idl.mcap", messages(drive, stamps), in_chunks=False, idl=True)


def bodies(path):
    objects = json.loads(Path(path).read_text())["objects"]
    return {o["id"]: o for o in objects}


def numbers(value):
    """All numbers of a document, in its order."""
    if isinstance(value, dict):
        return [x for key in sorted(value) for x in numbers(value[key])]
    if isinstance(value, list):
        return [x for item in value for x in numbers(item)]
    return [float(value)] if isinstance(value, (int, float)) and not isinstance(value, bool) else []


def largest_difference(found, expected):
    """The largest difference of centers and half extents, relative to the sizes of the objects and their distances."""
    assert found.keys() == expected.keys(), (found.keys(), expected.keys())
    largest = 0.0
    for name, o in expected.items():
        a, b = o["body"], found[name]["body"]
        center = np.linalg.norm(np.subtract(a["center"], b["center"])) / max(1.0, np.linalg.norm(a["center"]))
        axes = np.abs(np.sort(a["half_extents"]) - np.sort(b["half_extents"])).max() / max(a["half_extents"])
        largest = max(largest, center, axes)
    return largest


# Noise levels are given, so that the estimate of an object depends on its own views alone and not on the last digit of others.
NOISE_MODEL = ["--noise-model", "edge_noise=0.02,edge_noise_px=1", "--body", "ellipsoid"]


def check_import(quadlift, folder, drive, expected):
    exact = sorted({*drive.stamps, *jittered(drive.stamps)})
    logs = {
        "rosbags": write_with_rosbags(folder / "bag", drive, exact),
        "rosbags, vision_msgs 2": write_with_rosbags(folder / "bag2", drive, exact, VISION_2, 2),
        "mcap, lz4": write_with_mcap(folder / "lz4.mcap", drive, exact),
        "mcap, zstd": write_with_mcap(folder / "zstd.mcap", drive, exact, CompressionType.ZSTD),
        "mcap, none": write_with_mcap(folder / "none.mcap", drive, exact, CompressionType.NONE),
        "Foxglove, JSON": write_json(folder / "json.mcap", drive, exact),
        "Foxglove, protobuf": write_protobuf(folder / "protobuf.mcap", drive, exact),
    }
    out = folder / "out.json"
    for name, log in logs.items():
        up = ["--up", "z"] if "Foxglove" in name else []
        said = run(quadlift, "localize", log, "-o", out, *NOISE_MODEL, *up)
        # A message of annotations without a box has no time, and so is no frame.
        frames = {d["frame"] for d in drive.scene["detections"]} if "Foxglove" in name else drive.stamps
        assert f"poses of frames: {len(frames)} at the time of their transforms" in said, said
        difference = largest_difference(bodies(out), expected)
        assert difference < 1e-9, (name, difference)
        print(f"import, {name}: {len(expected)} objects, largest difference {difference:.1e}")
    # Where no transform has the time of an image.
    log = write_with_mcap(folder / "jitter.mcap", drive, jittered(drive.stamps))
    said = run(quadlift, "localize", log, "-o", out, *NOISE_MODEL)
    assert "interpolated between transforms up to 0.0" in said, said
    difference = largest_difference(bodies(out), expected)
    run(quadlift, "import", "mcap", log, "-o", folder / "scene.json")
    scene = json.loads((folder / "scene.json").read_text())
    errors = [
        np.abs(np.subtract(a["cam_from_world"], b["cam_from_world"])).max()
        for a, b in zip(scene["frames"], drive.scene["frames"], strict=True)
    ]
    print(f"import, interpolated at 50 Hz: poses differ by {max(errors):.1e}, objects by {difference:.1e}")
    assert 1e-9 < difference < 1e-2, difference
    # Images before the first transform and after the last one are skipped.
    late = [stamp for stamp in exact if drive.stamps[2] <= stamp <= drive.stamps[-4]]
    log = write_with_mcap(folder / "late.mcap", drive, late)
    said = run(quadlift, "import", "mcap", log, "-o", folder / "scene.json")
    assert "5 images without a pose are skipped" in said and "0.2 s before the first transform odom -> base_link" in said, said
    assert len(json.loads((folder / "scene.json").read_text())["frames"]) == len(drive.stamps) - 5
    # Poses of odometry instead of the moving transforms.
    log = write_with_mcap(folder / "odometry.mcap", drive, exact, change=with_odometry)
    said = run(quadlift, "localize", log, "-o", out, *NOISE_MODEL)
    assert 'the poses of /odom are those of the frame "base_link"' in said, said
    difference = largest_difference(bodies(out), expected)
    assert difference < 1e-9, difference
    print(f"import, odometry: largest difference {difference:.1e}")
    # The same with poses that do not name their frame: they are those of the root of the camera's tree.
    log = write_with_mcap(folder / "pose.mcap", drive, exact, change=lambda listed: with_odometry(listed, stamped=True))
    said = run(quadlift, "localize", log, "-o", out, *NOISE_MODEL)
    assert 'the poses of /pose are those of the frame "base_link"' in said, said
    assert largest_difference(bodies(out), expected) < 1e-9
    # Two cameras in turn, a third one that is not calibrated, and images.
    log = write_with_mcap(folder / "cameras.mcap", drive, exact, change=with_two_cameras)
    said = run(quadlift, "localize", log, "-o", out, *NOISE_MODEL)
    assert "/thermal/camera_info: K is zero: the camera is not calibrated" in said, said
    # Frames have other names and another order: the sphere that a fit starts from, about which its weak priors are, comes from other
    # pairs of views.
    difference = largest_difference(bodies(out), expected)
    print(f"import, two cameras: largest difference {difference:.1e}")
    assert difference < 2e-3, difference
    run(quadlift, "import", "mcap", log, "-o", folder / "scene.json", "--write-images", folder / "images")
    scene = json.loads((folder / "scene.json").read_text())
    assert [c["id"] for c in scene["cameras"]] == ["a", "b"], scene["cameras"]
    for frame, stamp in zip(scene["frames"], drive.stamps, strict=True):
        assert frame["id"] == f"{frame['camera']}/{stamp // 10**9}.{stamp % 10**9:09}", frame
        assert (folder / frame["image"]).read_bytes() == JPEG + frame["camera"].encode(), frame
    said = run(quadlift, "import", "mcap", log, "-o", folder / "scene.json", "--topics", "/a/boxes")
    assert len(json.loads((folder / "scene.json").read_text())["frames"]) == len(drive.stamps) // 2, said
    print(f"import, two cameras: {len(scene['frames'])} frames with images")
    # A stream sees the same frames.
    lines = run(quadlift, "stream", logs["mcap, lz4"], "--map", out).splitlines()
    frames = [json.loads(line) for line in lines if line.startswith("{")]
    seen = [frame for frame in frames if "frame" in frame]
    assert len(seen) == len(drive.stamps) and not any(e["type"] == "error" for f in frames for e in f["events"])
    assert sum(len(f["objects"]) for f in seen) == len(drive.scene["detections"])
    print(f"stream: {len(seen)} frames, {len(bodies(out))} objects in the map")


JPEG = b"\xff\xd8\xff\xe0 no picture of "


def with_two_cameras(listed):
    """Every other frame is of another camera in the same place; their images, and a camera that is not calibrated."""
    changed, last = [], None
    for time, topic, name, value in listed:
        if topic == "/tf_static":
            [fixed] = value["transforms"]
            value = {"transforms": [{**fixed, "child_frame_id": f"{c}_optical"} for c in "ab"]}
        elif topic != "/tf":
            stamp = value["header"]["stamp"]
            index = (stamp["sec"] * 10**9 + stamp["nanosec"] - START) // PERIOD
            camera = "ab"[index % 2]
            frame = {"stamp": stamp, "frame_id": f"{camera}_optical"}
            value = {**value, "header": frame}
            if topic == "/detector/boxes":
                # Some detectors leave the frame out; the topic tells it.
                value["header"] = {**frame, "frame_id": ""} if camera == "a" else frame
                value["detections"] = [{**d, "header": value["header"]} for d in value["detections"]]
                image = {"header": frame, "format": "jpeg", "data": JPEG + camera.encode()}
                changed.append((time, f"/{camera}/image/compressed", "sensor_msgs/msg/CompressedImage", image))
            elif last != index:
                last = index
                none = {**value, "header": {"stamp": stamp, "frame_id": "thermal"}, "k": [0.0] * 9}
                changed.append((time, "/thermal/camera_info", name, none))
            topic = f"/{camera}/{'boxes' if topic == '/detector/boxes' else 'camera_info'}"
        changed.append((time, topic, name, value))
    return changed


# vision_msgs of ROS 1.
VISION_1 = {
    "BoundingBox2D": "geometry_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "ObjectHypothesisWithPose": "int64 id\nfloat64 score\ngeometry_msgs/PoseWithCovariance pose\n",
    "Detection2D": "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox2D bbox\nsensor_msgs/Image source_img\n",
    "Detection2DArray": VISION_4["Detection2DArray"],
}


def check_ros1(quadlift, folder, drive):
    """A bag of ROS 1, converted as docs/formats/mcap.md says."""
    store = get_typestore(Stores.ROS1_NOETIC)
    types = get_types_from_msg("geometry_msgs/TransformStamped[] transforms\n", "tf2_msgs/msg/TFMessage")
    for name, text in VISION_1.items():
        types.update(get_types_from_msg(text, f"vision_msgs/msg/{name}"))
    store.register(types)

    def old(value):
        """With a number of the header, and matrices with capital letters; classes are numbers."""
        if isinstance(value, dict):
            value = {key.upper() if key in ("d", "k", "r", "p") else key: old(item) for key, item in value.items()}
            if value.keys() == {"stamp", "frame_id"}:
                value["seq"] = 0
            if "hypothesis" in value or "score" in value and "id" in value:
                value["id"] = 3
            return value
        return [old(item) for item in value] if isinstance(value, list) else value

    bag = folder / "drive.bag"
    with Ros1Writer(bag) as writer:
        connections = {}
        for time, topic, name, value in messages(drive, sorted({*drive.stamps, *jittered(drive.stamps)}), 2):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=store)
            message = from_dict(store, name, old(value))
            writer.write(connections[topic], max(time, START), store.serialize_ros1(message, name))
    said = run(quadlift, "import", "mcap", bag, "-o", folder / "scene.json", code=1)
    assert "rosbags-convert" in said, said
    convert = Path(sys.executable).parent / "rosbags-convert"
    run(convert, "--src", bag, "--dst", folder / "drive", "--dst-storage", "mcap")
    run(quadlift, "import", "mcap", folder / "drive" / "drive.mcap", "-o", folder / "scene.json")
    scene = json.loads((folder / "scene.json").read_text())
    found = sorted(d["box"] for d in scene["detections"])
    assert np.allclose(found, sorted(d["box"] for d in drive.scene["detections"]), rtol=1e-12)
    assert {d["category"] for d in scene["detections"]} == {"3"} and len(scene["frames"]) == len(drive.stamps)
    for a, b in zip(scene["frames"], drive.scene["frames"], strict=True):
        assert np.allclose(a["cam_from_world"], b["cam_from_world"], atol=1e-12)
    print(f"import, ROS 1 by rosbags-convert: {len(scene['frames'])} frames, {len(found)} detections")


def with_odometry(listed, stamped=False):
    """Odometry, or poses, in place of the moving transforms."""
    changed = []
    for time, topic, name, value in listed:
        if topic != "/tf":
            changed.append((time, topic, name, value))
            continue
        first, second = (t["transform"] for t in value["transforms"])
        matrices = []
        for t in (first, second):
            r, p = t["rotation"], t["translation"]
            matrices.append(pose(rotation_of([r[k] for k in "xyzw"]), [p[k] for k in "xyz"]))
        moved = transform(time, "map", "base_link", matrices[0] @ matrices[1])
        inner = {"position": moved["transform"]["translation"], "orientation": moved["transform"]["rotation"]}
        if stamped:
            changed.append((time, "/pose", "geometry_msgs/msg/PoseStamped", {"header": moved["header"], "pose": inner}))
            continue
        zero = {"linear": xyz([0, 0, 0]), "angular": xyz([0, 0, 0])}
        message = {
            "header": moved["header"],
            "child_frame_id": "base_link",
            "pose": {"pose": inner, "covariance": [0.0] * 36},
            "twist": {"twist": zero, "covariance": [0.0] * 36},
        }
        changed.append((time, "/odom", "nav_msgs/msg/Odometry", message))
    return changed


def foxglove_messages(drive, transform_stamps):
    """The drive in Foxglove's types, as JSON has them; times are those of JSON."""

    def time(stamp):
        return {"sec": stamp // 10**9, "nsec": stamp % 10**9}

    def frame_transform(stamp, parent, child, matrix):
        inner = transform(stamp, parent, child, matrix)["transform"]
        return {"timestamp": time(stamp), "parent_frame_id": parent, "child_frame_id": child, **inner}

    listed = [(START - 1, "/tf_mount", "FrameTransform", frame_transform(START, "base_link", CAMERA, BASE_FROM_CAMERA))]
    for stamp, links in drive.transforms(transform_stamps):
        message = {"transforms": [frame_transform(stamp, *link) for link in links]}
        listed.append((stamp, "/tf", "FrameTransforms", message))
    for index, stamp in enumerate(drive.stamps):
        info = camera_info(stamp, drive.scene["cameras"][0])
        calibration = {k: info[k] for k in ("width", "height", "distortion_model")}
        calibration.update(timestamp=time(stamp), frame_id=CAMERA, **{k.upper(): info[k] for k in "dkrp"})
        listed.append((stamp, "/camera/calibration", "CameraCalibration", calibration))
        points, texts = [], []
        for d in drive.detections(index):
            x0, y0, x1, y1 = d["box"]
            corners = [{"x": x, "y": y} for x, y in [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]]
            metadata = [{"key": "track_id", "value": d["object"]}, {"key": "score", "value": "0.75"}]
            points.append({"timestamp": time(stamp), "type": 2, "points": corners, "metadata": metadata})
            texts.append({"timestamp": time(stamp), "position": {"x": x0, "y": y0}, "text": d["category"]})
        listed.append((stamp, "/camera/annotations", "ImageAnnotations", {"points": points, "texts": texts}))
    return sorted(listed, key=lambda entry: entry[0])


def write_json(path, drive, transform_stamps):
    with path.open("wb") as file:
        writer = RawWriter(file)
        writer.start()
        channels = {}
        for time, topic, name, value in foxglove_messages(drive, transform_stamps):
            if topic not in channels:
                schema = writer.register_schema(f"foxglove.{name}", "jsonschema", b"{}")
                channels[topic] = writer.register_channel(topic, "json", schema)
            data = json.dumps(value).encode()
            writer.add_message(channels[topic], log_time=time, publish_time=time, data=data)
        writer.finish()
    return path


def write_protobuf(path, drive, transform_stamps):
    import importlib

    from google.protobuf.json_format import ParseDict

    def plain(value):
        """Times as protobuf's JSON has them; metadata came with newer schemas."""
        if isinstance(value, dict) and value.keys() == {"sec", "nsec"}:
            from google.protobuf.timestamp_pb2 import Timestamp

            return Timestamp(seconds=value["sec"], nanos=value["nsec"]).ToJsonString()
        if isinstance(value, dict):
            return {key: plain(item) for key, item in value.items()}
        return [plain(item) for item in value] if isinstance(value, list) else value

    with path.open("wb") as file:
        writer = ProtobufWriter(file)
        for time, topic, name, value in foxglove_messages(drive, transform_stamps):
            kind = getattr(importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2"), name)
            message = ParseDict(plain(value), kind(), ignore_unknown_fields=True)
            writer.write_message(topic=topic, message=message, log_time=time, publish_time=time)
        writer.finish()
    return path


def check_damage(quadlift, folder, drive):
    """Damaged, incomplete and odd logs: refused with the place, and what is right is used with --skip-errors."""
    exact = sorted({*drive.stamps, *jittered(drive.stamps)})
    good = write_with_mcap(folder / "good.mcap", drive, exact).read_bytes()
    log, scene = folder / "damaged.mcap", folder / "damaged.json"

    def frames(name, content, expected, least, arguments=()):
        if content is not None:
            log.write_bytes(content)
        said = run(quadlift, "import", "mcap", log, "-o", scene, *arguments, code=1)
        assert expected in said and "--skip-errors uses the rest" in said, (name, said)
        said = run(quadlift, "import", "mcap", log, "-o", scene, "--skip-errors", *arguments)
        assert "warning: " in said and expected in said, (name, said)
        found = len(json.loads(scene.read_text())["frames"])
        assert least <= found <= len(drive.stamps), (name, found)
        refused = said.split("warning: ")[1].splitlines()[0].split(": ", 1)[1]
        print(f"damage, {name}: {found} of {len(drive.stamps)} frames; {refused}")

    middle = bytearray(good)
    middle[len(good) // 2] ^= 0xFF
    frames("a byte in the middle", bytes(middle), "the chunk is damaged", 20)
    frames("a log that is cut off", good[: len(good) * 2 // 3], "the file was cut off", 15)

    def changed(change):
        write_with_mcap(log, drive, exact, change=change)

    def back(listed):
        """After the second half the clock jumps back by ten seconds: stamps, not the time of the log."""
        half = START + len(drive.stamps) // 2 * PERIOD
        text = [(t, topic, name, json.loads(json.dumps(value))) for t, topic, name, value in listed]

        def shift(value):
            if isinstance(value, dict):
                for key, item in value.items():
                    if key == "stamp":
                        item["sec"] -= 10
                    else:
                        shift(item)
            elif isinstance(value, list):
                for item in value:
                    shift(item)

        for time, topic, _, value in text:
            if time > half and topic != "/tf_static":
                shift(value)
        return text

    changed(back)
    frames("a clock that jumps back", None, "the clock jumps back by", 35)
    hole = (START + 10 * PERIOD, START + 22 * PERIOD)
    changed(lambda listed: [e for e in listed if e[1] != "/tf" or not hole[0] < e[0] < hole[1]])
    frames("a gap in the transforms", None, "have a gap of 1.2 s", 28)
    # A schema that is missing, and an encoding that nobody knows.
    for name, encoding, schema_id, expected in [
        ("a schema that is missing", "cdr", 77, "its schema, number 77, is missing in the file"),
        ("an unknown encoding", "cbor", None, 'its messages have the encoding "cbor"'),
    ]:
        with log.open("wb") as file:
            writer = RawWriter(file)
            writer.start()
            channels, store = {}, typestore(VISION_4)
            for time, topic, kind, value in messages(drive, exact):
                if topic not in channels:
                    text, _ = store.generate_msgdef(kind, ros_version=2)
                    schema = writer.register_schema(kind, "ros2msg", text.encode())
                    channels[topic] = writer.register_channel(topic, "cdr", schema)
                    if topic == "/detector/boxes":
                        odd = writer.register_channel("/odd", encoding, schema_id or schema)
                        writer.add_message(odd, log_time=START, publish_time=START, data=b"odd")
                data = bytes(store.serialize_cdr(from_dict(store, kind, value), kind))
                writer.add_message(channels[topic], log_time=max(time, START), publish_time=max(time, START), data=data)
            writer.finish()
        frames(name, None, expected, 40)


def check_export(quadlift, folder, scene, estimate_path):
    """The exported log, read by both packages: all numbers are those of the result."""
    estimate = json.loads(estimate_path.read_text())
    for frame, stamp in zip(estimate["frames"], (START + k * PERIOD for k in range(len(estimate["frames"])))):
        frame["time"] = stamp * 1e-9
    estimate["detections"] = scene["detections"]
    times = [int(f["time"] // 1) * 10**9 + round(f["time"] % 1 * 1e9) for f in estimate["frames"]]
    path, log = folder / "timed.json", folder / "objects.mcap"
    path.write_text(json.dumps(estimate))
    print(run(quadlift, "export", "mcap", path, "-o", log, "--frame-id", "world").splitlines()[0])
    objects = {o["id"]: o for o in estimate["objects"] if "body" in o}

    def plain(value):
        if hasattr(value, "__slots__") or hasattr(value, "__dataclass_fields__"):
            names = getattr(value, "__dataclass_fields__", None) or value.__slots__
            return {n: plain(getattr(value, n)) for n in names if not n.startswith("_")}
        if isinstance(value, (list, tuple, np.ndarray)):
            return [plain(item) for item in value]
        return value.item() if isinstance(value, np.generic) else value

    by_package = {"mcap-ros2-support": {}, "rosbags": {}}
    for found in read_ros2_messages(str(log)):
        entry = (found.log_time_ns, plain(found.ros_msg))
        by_package["mcap-ros2-support"].setdefault(found.channel.topic, []).append(entry)
    store = get_typestore(Stores.EMPTY)
    with BagReader(log) as reader:
        for connection in reader.connections:
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
        for connection, time, data in reader.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            by_package["rosbags"].setdefault(connection.topic, []).append((time, plain(message)))
    for package, topics in by_package.items():
        stamp = lambda header: header["stamp"]["sec"] * 10**9 + header["stamp"]["nanosec"]  # noqa: E731
        [(time, all_objects)] = topics["/quadlift/map"]
        assert time == max(times) == stamp(all_objects["header"]) and all_objects["header"]["frame_id"] == "world"
        assert [d["id"] for d in all_objects["detections"]] == list(objects)
        for d in all_objects["detections"]:
            body, bounds = (objects[d["id"]][name] for name in ("body", "bounds"))
            [result] = d["results"]
            for pose, of in ((result["pose"]["pose"], body), (d["bbox"]["center"], bounds)):
                assert [pose["position"][k] for k in "xyz"] == of["center"], (pose, of)
                assert np.allclose([pose["orientation"][k] for k in "wxyz"], of["rotation"], rtol=0, atol=1e-15)
            assert np.allclose([d["bbox"]["size"][k] for k in "xyz"], 2 * np.array(bounds["half_extents"]), rtol=1e-15)
            scores = [x["score"] for x in scene["detections"] if x.get("object") == d["id"]]
            assert np.isclose(result["hypothesis"]["score"], np.mean(scores), rtol=1e-12)
            covariance = np.array(result["pose"]["covariance"]).reshape(6, 6)
            matrix = np.array(objects[d["id"]]["covariance"]["matrix"])
            assert np.array_equal(covariance[:3, :3], matrix[:3, :3])
            assert np.allclose(covariance, covariance.T) and np.linalg.eigvalsh(covariance).min() > 0
        seen = {(time, d["id"]) for time, m in topics["/quadlift/objects"] for d in m["detections"]}
        index = {f["id"]: k for k, f in enumerate(estimate["frames"])}
        detected = {(times[index[d["frame"]]], d["object"]) for d in scene["detections"] if d.get("object") in objects}
        assert seen <= detected and len(seen) > 0.95 * len(detected), (len(seen), len(detected))
        [(time, markers)] = topics["/quadlift/markers"]
        spheres = [m for m in markers["markers"] if m["ns"] == "objects"]
        assert time == min(times) and [m["type"] for m in spheres] == [2] * len(objects)
        for marker, o in zip(spheres, objects.values(), strict=True):
            assert np.allclose([marker["scale"][k] for k in "xyz"], 2 * np.array(o["body"]["half_extents"]), rtol=1e-15)
            assert [marker["pose"]["position"][k] for k in "xyz"] == o["body"]["center"]
        boxes = [
            [b["center"]["position"]["x"], b["center"]["position"]["y"], b["size_x"], b["size_y"]]
            for _, m in topics["/camera/detections"]
            for b in (d["bbox"] for d in m["detections"])
        ]
        assert len(boxes) == len(scene["detections"]) and [t for t, _ in topics["/tf"]] == times
        print(f"export, {package}: {sum(map(len, topics.values()))} messages, {len(objects)} objects, all numbers equal")
    assert by_package["rosbags"].keys() == by_package["mcap-ros2-support"].keys()
    for topic, entries in by_package["rosbags"].items():
        other = by_package["mcap-ros2-support"][topic]
        assert [(t, numbers(m)) for t, m in entries] == [(t, numbers(m)) for t, m in other], topic
    # And back.
    run(quadlift, "import", "mcap", log, "-o", folder / "again.json")
    again = json.loads((folder / "again.json").read_text())
    assert len(again["detections"]) == len(scene["detections"])


def check_memory(quadlift, folder, drive, megabytes):
    """A long log with images between the frames: time and memory do not grow with it."""
    exact = sorted({*drive.stamps, *jittered(drive.stamps)})
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 256, 1 << 20, dtype=np.uint8).tobytes()
    log = folder / "long.mcap"
    listed = messages(drive, exact)
    per_message = megabytes // len(listed) + 1
    store, schemas = typestore(VISION_4), {}
    with log.open("wb") as file:
        writer = Ros2Writer(file, chunk_size=4 << 20, compression=CompressionType.LZ4)
        text, _ = store.generate_msgdef("sensor_msgs/msg/CompressedImage", ros_version=2)
        image_schema = writer.register_msgdef("sensor_msgs/msg/CompressedImage", text)
        for time, topic, name, value in listed:
            if name not in schemas:
                text, _ = store.generate_msgdef(name, ros_version=2)
                schemas[name] = writer.register_msgdef(name, text)
            at = max(time, START)
            writer.write_message(topic, schemas[name], value, log_time=at, publish_time=at)
            for _ in range(per_message):
                image = {"header": header(at, CAMERA), "format": "jpeg", "data": noise}
                writer.write_message("/camera/compressed", image_schema, image, log_time=at, publish_time=at)
        writer.finish()
    size = log.stat().st_size
    command = [str(quadlift), "import", "mcap", str(log), "-o", str(folder / "long.json")]
    before, most = os.times(), 0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        # The largest size so far, of the program alone: what wait4 tells has that of this script in it.
        while process.poll() is None:
            status = Path(f"/proc/{process.pid}/status")
            lines = status.read_text().splitlines() if status.exists() else []
            most = max([most, *(int(line.split()[1]) for line in lines if line.startswith("VmHWM"))])
            time_module.sleep(0.01)
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    assert process.returncode == 0
    assert len(json.loads((folder / "long.json").read_text())["frames"]) == len(drive.stamps)
    print(f"memory: {size / 1e6:.0f} MB read in {used:.1f} s of processor time, at most {most / 1e3:.0f} MB used")
    # Where the system does not tell it, it is zero.
    assert most < 60_000, most
    log.unlink()


def main():
    quadlift = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene_path = folder / "drive.json"
        options = ["--objects", "12", "--views", "40", "--trajectory", "street", "--noise", "box:0.02"]
        run(quadlift, "synth", "-o", scene_path, *options)
        scene = json.loads(scene_path.read_text())
        scene.update(length_unit="m", up=[0, 0, 1])
        scene.pop("objects")
        for detection in scene["detections"]:
            detection.update(score=0.75, category="cup")
        scene_path.write_text(json.dumps(scene))
        estimate = folder / "estimate.json"
        run(quadlift, "localize", scene_path, "-o", estimate, *NOISE_MODEL)
        drive, expected = Drive(scene), bodies(estimate)
        if "--seeds" in sys.argv:
            write_seeds(Path(__file__).parent.parent / "fuzz/seeds/mcap", scene)
            return
        assert len(expected) >= 8
        check_import(quadlift, folder, drive, expected)
        check_ros1(quadlift, folder, drive)
        check_damage(quadlift, folder, drive)
        check_export(quadlift, folder, scene, estimate)
        # 1000 for the figure of docs/performance.md.
        check_memory(quadlift, folder, drive, int(sys.argv[2]) if len(sys.argv) > 2 else 100)


if __name__ == "__main__":
    main()
