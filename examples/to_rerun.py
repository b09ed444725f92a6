#!/usr/bin/env python3
"""Logs scene files as a recording for Rerun (https://rerun.io).

    pip install rerun-sdk
    python3 to_rerun.py scene.json estimate.json truth.json -o recording.rrd
    rerun recording.rrd

Takes any number of files of one scene, in any order, as `quadlift view` does: frames and detections come from the first
file with detections (or with frames), objects with a status are estimates, objects without one are the truth.

What is logged, on the timelines "frame" and, where the frames have times, "time":

    world/estimate/ellipsoids, world/estimate/cuboids   estimated bodies (a superellipsoid as its ellipsoid)
    world/truth/ellipsoids, world/truth/cuboids         true bodies
    world/path                                          the cameras' centres
    world/camera                                        pose of the frame's camera
    world/camera/image                                  its pinhole camera and its image
    world/camera/image/boxes                            detected boxes
    world/camera/image/ellipses                         detected ellipses, as line strips
    world/camera/image/outlines                         outlines of the estimated ellipsoids, as line strips

Images are logged as they are; of a camera with lens distortion the outlines are those of its pinhole camera.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import rerun as rr

# Paul Tol's bright scheme with two more, as in the reports.
PALETTE = [0x4477AA, 0xEE6677, 0x228833, 0xCCBB44, 0x66CCEE, 0xAA3377, 0xEE8866, 0x888888]
TRUTH = 0xB0B0B0

# COLMAP's models that have one focal length; the others begin with fx, fy, cx, cy.
ONE_FOCAL_LENGTH = {
    "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "SIMPLE_RADIAL_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_FISHEYE",
    "SIMPLE_DIVISION",
}


def rgb(color):
    return [color >> 16, color >> 8 & 255, color & 255]


def rotation(quaternion):
    """Matrix of a unit quaternion, w first."""
    w, x, y, z = quaternion
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def intrinsics(camera):
    """The matrix K of a camera, without its lens."""
    p = camera["params"]
    if camera["model"] == "EQUIRECTANGULAR":
        width, height = p
        fx, fy, cx, cy = width / (2 * np.pi), height / np.pi, width / 2, height / 2
    elif camera["model"] in ONE_FOCAL_LENGTH:
        fx, fy, cx, cy = p[0], p[0], p[1], p[2]
    else:
        fx, fy, cx, cy = p[:4]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


def split_projection(projection):
    """K, R and t of a 3x4 projection: an RQ decomposition of its left block, by QR of the reversed rows."""
    m = projection[:, :3]
    projection = projection * np.sign(np.linalg.det(m))
    q, r = np.linalg.qr(projection[::-1, :3].T)
    k, rot = r.T[::-1, ::-1], q.T[::-1]
    signs = np.sign(np.diag(k))
    k, rot = k * signs, signs[:, None] * rot
    t = np.linalg.solve(k, projection[:, 3])
    return k / k[2, 2], rot, t


class Frame:
    """A posed image: K, R, t (world to camera) and its size where it is known."""

    def __init__(self, record, cameras):
        self.id, self.image, self.time = record["id"], record.get("image"), record.get("time")
        camera = cameras.get(record.get("camera"), {})
        if "projection" in record:
            self.k, self.r, self.t = split_projection(np.array(record["projection"], dtype=float))
        else:
            pose = np.array(record["cam_from_world"], dtype=float)
            self.k, self.r, self.t = intrinsics(camera), pose[:, :3], pose[:, 3]
        size = [record.get(side) or camera.get(side) for side in ("width", "height")]
        self.size = size if all(size) else None

    @property
    def projection(self):
        return self.k @ np.column_stack([self.r, self.t])

    @property
    def center(self):
        return -self.r.T @ self.t


def ellipse_points(center, factor):
    """48 points on the image of the unit circle under `factor` (2x2), closed."""
    angles = np.linspace(0, 2 * np.pi, 49)
    return np.asarray(center) + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ np.asarray(factor).T


def outline(projection, ellipsoid):
    """The outline of an ellipsoid in an image: the dual conic P Q* P^T; None when it is not wholly in front."""
    axes = rotation(ellipsoid["rotation"]) * np.array(ellipsoid["semi_axes"])
    m = projection[:, :3]
    h = m @ np.array(ellipsoid["center"]) + projection[:, 3]
    conic = m @ axes @ axes.T @ m.T - np.outer(h, h)
    if not conic[2, 2] < 0 or not h[2] > 0:
        return None
    conic = conic / -conic[2, 2]
    center = -conic[:2, 2]
    shape = conic[:2, :2] + np.outer(center, center)
    return ellipse_points(center, np.linalg.cholesky((shape + shape.T) / 2))


def detected_ellipse(ellipse):
    c, s = np.cos(ellipse["angle"]), np.sin(ellipse["angle"])
    return ellipse_points(ellipse["center"], np.array([[c, -s], [s, c]]) * np.array(ellipse["semi_axes"]))


def xyzw(quaternion):
    w, x, y, z = quaternion
    return [x, y, z, w]


def log_bodies(path, objects, color):
    """Logs cuboids, and the ellipsoids of all objects without one."""
    cuboids = [o for o in objects if o.get("cuboid")]
    ellipsoids = [o for o in objects if not o.get("cuboid") and o.get("ellipsoid")]
    if ellipsoids:
        bodies = [o["ellipsoid"] for o in ellipsoids]
        rr.log(f"{path}/ellipsoids", rr.Ellipsoids3D(
            centers=[b["center"] for b in bodies],
            half_sizes=[b["semi_axes"] for b in bodies],
            quaternions=[xyzw(b["rotation"]) for b in bodies],
            colors=[rgb(color(o)) for o in ellipsoids],
            labels=[o["id"] for o in ellipsoids],
        ), static=True)
    if cuboids:
        bodies = [o["cuboid"] for o in cuboids]
        rr.log(f"{path}/cuboids", rr.Boxes3D(
            centers=[b["center"] for b in bodies],
            half_sizes=[b["half_extents"] for b in bodies],
            quaternions=[xyzw(b["rotation"]) for b in bodies],
            colors=[rgb(color(o)) for o in cuboids],
            labels=[o["id"] for o in cuboids],
        ), static=True)


def log_strips(path, strips, colors, labels):
    """Logs line strips, or that there are none in this frame."""
    if strips:
        rr.log(path, rr.LineStrips2D(strips, colors=[rgb(c) for c in colors], labels=labels))
    else:
        rr.log(path, rr.Clear(recursive=False))


def log_frame(frame, folder, detections, objects, color):
    rr.log("world/camera", rr.Transform3D(translation=frame.center, mat3x3=frame.r.T))
    size = frame.size or [2 * frame.k[0, 2], 2 * frame.k[1, 2]]
    path = "world/camera/image"
    rr.log(path, rr.Pinhole(image_from_camera=frame.k, resolution=size, camera_xyz=rr.ViewCoordinates.RDF))
    image = folder / frame.image if frame.image else None
    if image is not None and image.is_file():
        rr.log(path, rr.EncodedImage(path=image))
    boxes = [d for d in detections if d.get("box")]
    name = lambda d: d.get("object") or d.get("category") or ""
    if boxes:
        rr.log(f"{path}/boxes", rr.Boxes2D(
            array=[d["box"] for d in boxes], array_format=rr.Box2DFormat.XYXY,
            colors=[rgb(color(d)) for d in boxes], labels=[name(d) for d in boxes],
        ))
    else:
        rr.log(f"{path}/boxes", rr.Clear(recursive=False))
    ellipses = [d for d in detections if d.get("ellipse")]
    log_strips(f"{path}/ellipses", [detected_ellipse(d["ellipse"]) for d in ellipses], map(color, ellipses),
               [name(d) for d in ellipses])
    outlines = [(o, outline(frame.projection, o["ellipsoid"])) for o in objects if o.get("ellipsoid")]
    outlines = [(o, points) for o, points in outlines if points is not None]
    log_strips(f"{path}/outlines", [points for _, points in outlines], [color(o) for o, _ in outlines],
               [o["id"] for o, _ in outlines])


def make_colors(objects, detections):
    """A colour for each category, or for each object where there are fewer than two categories."""
    categories = list(dict.fromkeys(e["category"] for e in objects + detections if e.get("category")))
    ids = list(dict.fromkeys([o["id"] for o in objects] + [d["object"] for d in detections if d.get("object")]))
    of_object = {o["id"]: o.get("category") for o in objects}
    places = {name: k for k, name in enumerate(categories if len(categories) > 1 else ids)}

    def color(entry):
        identity = entry.get("id") or entry.get("object")
        key = (entry.get("category") or of_object.get(identity)) if len(categories) > 1 else identity
        return PALETTE[places[key] % len(PALETTE)] if key in places else 0x888888

    return color


def view_coordinates(up):
    """How Rerun calls a world whose up direction is along an axis; None for any other."""
    names = {(2, 1): "Z_UP", (2, -1): "Z_DOWN", (1, 1): "Y_UP", (1, -1): "Y_DOWN", (0, 1): "X_UP", (0, -1): "X_DOWN"}
    up = np.array(up, dtype=float) / np.linalg.norm(up)
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < 0.999:
        return None
    return getattr(rr.ViewCoordinates, f"RIGHT_HAND_{names[axis, int(np.sign(up[axis]))]}", None)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("files", nargs="+", type=Path, metavar="SCENE.json")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.rrd")
    args = parser.parse_args()
    scenes = []
    for path in args.files:
        scene = json.loads(path.read_text(encoding="utf-8"))
        if scene.get("format") != "quadlift.scene" or scene.get("version") != 1:
            parser.error(f"{path} is no scene file of version 1")
        scenes.append((path, scene))
    first = lambda fits: next(((path, scene) for path, scene in scenes if fits(scene)), None)
    is_estimate = lambda s: "localization" in s or any("status" in o for o in s.get("objects", []))
    path, scene = first(lambda s: s.get("detections")) or first(lambda s: s.get("frames")) or scenes[0]
    _, estimate = first(is_estimate) or (None, {})
    _, truth = first(lambda s: s.get("objects") and not is_estimate(s)) or (None, {})
    objects, true_objects = estimate.get("objects", []), truth.get("objects", [])
    detections = scene.get("detections", [])
    source = (estimate.get("localization") or {}).get("settings", {}).get("source")
    if source is not None:
        detections = [d for d in detections if d.get("source") == source]
    color = make_colors(objects, detections)

    rr.init("quadlift", recording_id=scene.get("name") or path.stem)
    rr.save(args.output)
    coordinates = view_coordinates(scene["up"]) if scene.get("up") else None
    if coordinates is not None:
        rr.log("world", coordinates, static=True)
    log_bodies("world/estimate", objects, color)
    log_bodies("world/truth", true_objects, lambda _: TRUTH)
    cameras = {camera["id"]: camera for camera in scene.get("cameras", [])}
    frames = [Frame(record, cameras) for record in scene.get("frames", [])]
    if frames:
        rr.log("world/path", rr.LineStrips3D([[frame.center for frame in frames]]), static=True)
    by_frame = {}
    for detection in detections:
        by_frame.setdefault(detection["frame"], []).append(detection)
    for index, frame in enumerate(frames):
        rr.set_time("frame", sequence=index)
        if frame.time is not None:
            rr.set_time("time", duration=frame.time)
        log_frame(frame, path.parent, by_frame.get(frame.id, []), objects, color)
    print(f"{args.output}: {len(frames)} frames, {len(detections)} detections, {len(objects)} estimates, "
          f"{len(true_objects)} true objects")


if __name__ == "__main__":
    main()
