#!/usr/bin/env python3
"""Logs what `quadlift export rerun` has written as a recording for Rerun (https://rerun.io).

    pip install rerun-sdk
    quadlift export rerun scene.json estimate.json truth.json -o folder
    python3 to_rerun.py folder -o recording.rrd
    rerun recording.rrd

What is logged, on the timelines "frame" and, where the frames have times, "time":

    world/estimate/ellipsoids, world/estimate/cuboids   estimated bodies (a superellipsoid as its ellipsoid)
    world/truth/ellipsoids, world/truth/cuboids         true bodies
    world/path                                          the cameras' centres
    world/camera                                        pose of the frame's camera
    world/camera/image                                  its pinhole camera and its image
    world/camera/image/boxes                            detected boxes, red where the estimator has rejected them
    world/camera/image/ellipses                         detected ellipses, as line strips
    world/camera/image/outlines                         outlines of the estimated bodies, as line strips
    world/camera/image/true_outlines                    those of the true bodies

docs/formats/rerun.md describes the folder.
"""

import argparse
import json
from pathlib import Path

import numpy as np
import rerun as rr

TRUTH = [0xB0, 0xB0, 0xB0]
REJECTED = [0xE0, 0x10, 0x10]


def log_bodies(objects, key):
    """Logs the bodies `key` ("estimate" or "truth") of the objects that have them."""
    for shape, archetype in (("ellipsoid", rr.Ellipsoids3D), ("cuboid", rr.Boxes3D)):
        shown = [o for o in objects if o[key] and o[key]["shape"] == shape]
        if shown:
            rr.log(f"world/{key}/{shape}s", archetype(
                centers=[o[key]["center"] for o in shown],
                half_sizes=[o[key]["half_sizes"] for o in shown],
                quaternions=[o[key]["quaternion_xyzw"] for o in shown],
                colors=[o["color"] if key == "estimate" else TRUTH for o in shown],
                labels=[o["id"] for o in shown],
            ), static=True)


def label(owner):
    return owner["object"] or owner["category"] or ""


def measured_color(owner):
    return REJECTED if owner["inlier"] is False else owner["color"]


def log_lines(path, outlines, color):
    """Logs all lines of outlines, or that there are none in this frame."""
    lines = [(line, o) for o in outlines for line in o["lines"]]
    rr.log(path, rr.LineStrips2D(
        [line for line, _ in lines], colors=[color(o) for _, o in lines], labels=[label(o) for _, o in lines],
        show_labels=False,
    ) if lines else rr.Clear(recursive=False))


def log_frame(folder, frame):
    path = "world/camera/image"
    if frame["camera"]:
        pose = np.array(frame["camera"]["cam_from_world"])
        rr.log("world/camera", rr.Transform3D(
            translation=pose[:, 3], mat3x3=pose[:, :3], relation=rr.TransformRelation.ChildFromParent))
        rr.log(path, rr.Pinhole(image_from_camera=frame["camera"]["intrinsics"], resolution=frame["size"],
                                camera_xyz=rr.ViewCoordinates.RDF))
    rr.log(path, rr.EncodedImage(path=folder / frame["image"]) if frame["image"] else rr.EncodedImage.cleared())
    boxes = frame["boxes"]
    rr.log(f"{path}/boxes", rr.Boxes2D(
        array=[b["edges"] for b in boxes], array_format=rr.Box2DFormat.XYXY,
        colors=[measured_color(b) for b in boxes], labels=[label(b) for b in boxes],
    ) if boxes else rr.Clear(recursive=False))
    log_lines(f"{path}/ellipses", frame["ellipses"], measured_color)
    log_lines(f"{path}/outlines", frame["outlines"], lambda o: o["color"])
    log_lines(f"{path}/true_outlines", frame["true_outlines"], lambda _: TRUTH)


def view_coordinates(up):
    """How Rerun calls a world whose up direction is along an axis; None for any other."""
    axis = int(np.argmax(np.abs(up)))
    if abs(up[axis]) < 0.999:
        return None
    return getattr(rr.ViewCoordinates, f"RIGHT_HAND_{'XYZ'[axis]}_{'UP' if up[axis] > 0 else 'DOWN'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("folder", type=Path, help="what quadlift export rerun has written")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.rrd")
    args = parser.parse_args()
    recording = json.loads((args.folder / "recording.json").read_text(encoding="utf-8"))
    if (recording["format"], recording["version"]) != ("quadlift.recording", 1):
        parser.error(f"{args.folder} holds no recording of version 1")

    rr.init("quadlift", recording_id=recording["name"])
    rr.save(args.output)
    coordinates = view_coordinates(recording["up"]) if recording["up"] else None
    if coordinates is not None:
        rr.log("world", coordinates, static=True)
    log_bodies(recording["objects"], "estimate")
    log_bodies(recording["objects"], "truth")
    if recording["path"]:
        rr.log("world/path", rr.LineStrips3D([recording["path"]]), static=True)
    for index, frame in enumerate(recording["frames"]):
        rr.reset_time()
        rr.set_time("frame", sequence=index)
        if frame["time"] is not None:
            rr.set_time("time", duration=frame["time"])
        log_frame(args.folder, frame)
    print(f"{args.output}: {len(recording['frames'])} frames, {len(recording['objects'])} objects")


if __name__ == "__main__":
    main()
