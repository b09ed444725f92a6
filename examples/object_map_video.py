#!/usr/bin/env python3
"""Objects of a video, frame by frame: Ultralytics tracks boxes, quadlift keeps the map of objects.

    pip install quadlift ultralytics
    python3 object_map_video.py video.mp4 poses.npz -o map.json

poses.npz has `intrinsics` (3, 3) in pixels and `cam_from_world` (F, 4, 4), a pose for each frame of the video; frames
whose pose is NaN are skipped. map.json is a scene file with the objects: `quadlift view map.json` shows it. With --rerun
the viewer of Rerun (`pip install rerun-sdk`) shows every frame as it comes.
"""

import argparse

import numpy as np
import quadlift
from ultralytics import YOLO

parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
parser.add_argument("video")
parser.add_argument("poses")
parser.add_argument("-o", "--output", required=True, metavar="MAP.json")
parser.add_argument("--model", default="yolo11n.pt")
parser.add_argument("--fps", type=float, default=30.0)
parser.add_argument("--rerun", action="store_true")
args = parser.parse_args()
if args.rerun:
    import rerun

    rerun.init("quadlift", spawn=True)
poses = np.load(args.poses)
object_map = quadlift.ObjectMap()
results = YOLO(args.model).track(args.video, stream=True, verbose=False)
for k, (result, pose) in enumerate(zip(results, poses["cam_from_world"])):
    if np.isnan(pose).any():
        continue
    camera = {"intrinsics": poses["intrinsics"], "cam_from_world": pose, "image_size": result.orig_shape[::-1]}
    update = object_map.observe(k, result, time=k / args.fps, **camera)
    for event in update.events:
        print(k, event["type"], event.get("object"))
    if args.rerun:
        object_map.log_rerun(result.orig_img[..., ::-1])
object_map.settle()
object_map.to_scene().write(args.output)
print(object_map)
