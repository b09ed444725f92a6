"""Writes cameras with the packages that people use for them, which quadlift must read with the same poses.

    python scripts/check_cameras.py path/to/quadlift

Needs check_cameras_requirements.txt. COLMAP models with rigs are written by pycolmap; tables of nuScenes are written by hand
and read by nuscenes-devkit.
"""

import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pycolmap
from nuscenes.nuscenes import NuScenes
from nuscenes.utils.geometry_utils import BoxVisibility


def run(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    assert done.returncode == 0, (arguments, done.returncode, done.stdout, done.stderr)
    return done.stdout


def read_scene(quadlift, scene, *arguments):
    """The scene file of an import, and what the program said."""
    text = run(quadlift, "import", *arguments, "-o", scene)
    return json.loads(scene.read_text()), text


def rigid(rng, extent):
    axis = rng.normal(size=3)
    rotation = pycolmap.Rotation3d(axis / np.linalg.norm(axis) * rng.uniform(0.1, 2.0))
    return pycolmap.Rigid3d(rotation, extent * rng.normal(size=3))


def colmap_model(rng):
    """Two rigs of three cameras and of one; in some frames of the first one an image is missing."""
    model = pycolmap.Reconstruction()
    for number in range(1, 5):
        model.add_camera(pycolmap.Camera.create_from_model_name(number, "OPENCV", 500 + number, 640, 480))
    for rig_id, cameras in ((1, (1, 2, 3)), (2, (4,))):
        rig = pycolmap.Rig(rig_id=rig_id)
        for number in cameras:
            sensor = pycolmap.sensor_t(type=pycolmap.SensorType.CAMERA, id=number)
            if number == cameras[0]:
                rig.add_ref_sensor(sensor)
            else:
                rig.add_sensor(sensor, rigid(rng, 0.3))
        model.add_rig(rig)
    image_id = 0
    for number in range(6):
        rig_id, cameras = (2, [4]) if number == 5 else (1, [1, 2, 3][: 3 - number % 2])
        frame = pycolmap.Frame(frame_id=3 * number + 1, rig_id=rig_id)
        frame.rig_from_world = rigid(rng, 5.0)
        images = []
        for camera in cameras:
            image_id += 1
            image = pycolmap.Image(name=f"rig{rig_id}/{camera}/{number}.png", camera_id=camera, image_id=image_id)
            image.frame_id = frame.frame_id
            frame.add_data_id(image.data_id)
            images.append(image)
        model.add_frame(frame)
        for image in images:
            model.add_image(image)
        model.register_frame(frame.frame_id)
    return model


def check_rigs(quadlift, folder, seed):
    model = colmap_model(np.random.default_rng(seed))
    largest = 0.0
    for form, write in (("text", model.write_text), ("binary", model.write_binary)):
        path = folder / f"{form}{seed}"
        path.mkdir()
        write(path)
        expected = {image.name: image for image in model.images.values()}
        if form == "text":
            # Without the poses of the images those of frames and rigs are left; so COLMAP reads them too.
            lines = (path / "images.txt").read_text().splitlines()
            fields = [line.split() for line in lines]
            without = [" ".join([f[0], *["0"] * 7, *f[8:]]) if len(f) == 10 and f[0] != "#" else "" for f in fields]
            (path / "images.txt").write_text("\n".join(without) + "\n")
            expected = {image.name: image for image in pycolmap.Reconstruction(path).images.values()}
        scene, text = read_scene(quadlift, folder / "scene.json", "colmap", path)
        assert len(scene["frames"]) == len(expected) == 14, len(scene["frames"])
        for frame in scene["frames"]:
            image = expected[frame["id"]]
            assert frame["rig_frame"] == image.frame_id, frame
            difference = np.abs(np.array(frame["cam_from_world"]) - image.cam_from_world().matrix()).max()
            largest = max(largest, difference)
        assert "inconsistent" not in text, text
        assert ("computed from the frames and rigs" in text) == (form == "text"), text
    # The scene as a model again, which has no rigs.
    run(quadlift, "export", "colmap", folder / "scene.json", "-o", folder / f"exported{seed}")
    exported = pycolmap.Reconstruction(folder / f"exported{seed}")
    assert len(exported.cameras) == len(scene["cameras"]) and len(exported.images) == 14, exported
    for image in exported.images.values():
        frame = next(frame for frame in scene["frames"] if frame["id"] == image.name)
        largest = max(largest, np.abs(np.array(frame["cam_from_world"]) - image.cam_from_world().matrix()).max())
    assert largest < 1e-12, largest
    return largest


def write_nuscenes(folder, rng):
    """The tables of a drive with three cameras and a box that does not move."""
    turn = lambda angle: [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]
    tables = {name: [] for name in "attribute log map".split()}
    tables["category"] = [{"token": "c", "name": "car", "description": ""}]
    tables["visibility"] = [{"token": "4", "level": "v80-100", "description": ""}]
    tables["instance"] = [
        {"token": "i", "category_token": "c", "nbr_annotations": 1, "first_annotation_token": "a0", "last_annotation_token": "a0"}
    ]
    tables["map"] = [{"token": "m", "log_tokens": ["l"], "category": "semantic_prior", "filename": "maps/m.png"}]
    tables["log"] = [{"token": "l", "logfile": "", "vehicle": "", "date_captured": "", "location": ""}]
    channels = ["CAM_FRONT", "CAM_BACK_LEFT", "CAM_BACK_RIGHT"]
    tables["sensor"] = [{"token": name, "channel": name, "modality": "camera"} for name in channels]
    tables["calibrated_sensor"] = [
        {
            "token": f"calibrated {name}",
            "sensor_token": name,
            "translation": list(rng.normal(size=3)),
            "rotation": list(rng.normal(size=4)),
            "camera_intrinsic": [[1266.4, 0.0, 816.3 + k], [0.0, 1266.4, 491.5], [0.0, 0.0, 1.0]],
        }
        for k, name in enumerate(channels)
    ]
    for sensor in tables["calibrated_sensor"]:
        sensor["rotation"] = list(np.array(sensor["rotation"]) / np.linalg.norm(sensor["rotation"]))
    count = 5
    tables["scene"] = [
        {"token": "s", "log_token": "l", "nbr_samples": count, "first_sample_token": "0", "last_sample_token": str(count - 1),
         "name": "scene-0061", "description": ""}
    ]
    tables["sample"], tables["sample_data"], tables["ego_pose"], tables["sample_annotation"] = [], [], [], []
    for k in range(count):
        time = 1532402927647951 + 500000 * k
        after, before = str(k + 1) if k + 1 < count else "", str(k - 1) if k else ""
        tables["sample"].append({"token": str(k), "timestamp": time, "prev": before, "next": after, "scene_token": "s"})
        tables["sample_annotation"].append(
            {"token": f"a{k}", "sample_token": str(k), "instance_token": "i", "visibility_token": "4", "attribute_tokens": [],
             "translation": [400.0, 1165.0, 1.0], "size": [1.9, 4.5, 1.6], "rotation": turn(0.7), "prev": "", "next": "",
             "num_lidar_pts": 1, "num_radar_pts": 0}
        )
        for j, name in enumerate(channels):
            token = f"{name}{k}"
            tables["ego_pose"].append(
                {"token": token, "timestamp": time + 1000 * j, "rotation": turn(0.2 * k + 0.01 * j),
                 "translation": [411.3 + 3 * k + 0.1 * j, 1180.9 - k, 0.0]}
            )
            tables["sample_data"].append(
                {"token": token, "sample_token": str(k), "ego_pose_token": token, "calibrated_sensor_token": f"calibrated {name}",
                 "timestamp": time + 1000 * j, "fileformat": "jpg", "is_key_frame": True, "height": 900, "width": 1600,
                 "filename": f"samples/{name}/{k}.jpg", "prev": "", "next": ""}
            )
    version = folder / "v1.0-mini"
    version.mkdir(parents=True)
    # nuscenes-devkit only checks that there is a map.
    (folder / "maps").mkdir()
    (folder / "maps/m.png").touch()
    for name, rows in tables.items():
        (version / f"{name}.json").write_text(json.dumps(rows))


def check_nuscenes(quadlift, folder):
    root = folder / "nuscenes"
    write_nuscenes(root, np.random.default_rng(5))
    scene, _ = read_scene(quadlift, folder / "nuscenes.json", "nuscenes", root, "--sequence", "scene-0061")
    devkit = NuScenes("v1.0-mini", str(root), verbose=False)
    assert len(scene["frames"]) == len(devkit.sample_data) == 15
    cameras = {camera["id"]: camera for camera in scene["cameras"]}
    frames = {frame["id"]: frame for frame in scene["frames"]}
    largest = 0.0
    for row in devkit.sample_data:
        frame = frames[row["filename"]]
        _, [box], intrinsic = devkit.get_sample_data(row["token"], box_vis_level=BoxVisibility.NONE)
        pose = np.array(frame["cam_from_world"])
        found = pose[:, :3] @ np.array([400.0, 1165.0, 1.0]) + pose[:, 3]
        largest = max(largest, np.abs(found - box.center).max())
        assert abs(frame["time"] - row["timestamp"] / 1e6) < 1e-6
        fx, fy, cx, cy = cameras[frame["camera"]]["params"]
        assert [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] == intrinsic.tolist(), intrinsic
    assert largest < 1e-9, largest
    return largest


def main():
    quadlift = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        largest = max(check_rigs(quadlift, folder, seed) for seed in range(5))
        print(f"COLMAP rigs: poses differ from pycolmap's by at most {largest:.1e}")
        print(f"nuScenes: a box differs from nuscenes-devkit's by at most {check_nuscenes(quadlift, folder):.1e} m")


main()
