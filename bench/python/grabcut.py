#!/usr/bin/env python3
"""Times and scores OpenCV's GrabCut, frame by frame, beside `quadlift segment` on the same rendered scenes.

    python3 -m venv target/venv && target/venv/bin/pip install numpy pillow opencv-python-headless
    cargo build --release -p quadlift-cli -p quadlift-bench
    for seed in 0 1 2 3 4 5; do
        target/release/quadlift-bench render target/rendered/$seed --box-noise 0.1 --seed $seed
    done
    target/venv/bin/python bench/python/grabcut.py target/release/quadlift target/rendered/*/scene.json

Scores are means over the detections of which at least 70 % is visible: IoU with the true mask, and of the ellipses with
the masks' second moments. Times are of the processor, not of the clock, so that they can be compared on a machine that
does other things; both programs run on one thread. That of `quadlift segment` is for the whole program: it reads the
scene and the images and writes the result. That of GrabCut is for its crops only.
"""
import json
import os
import resource
import subprocess
import sys
import tempfile
import time

import cv2
import numpy as np
from PIL import Image

MIN_VISIBLE = 0.7
# GrabCut: the box, enlarged by a quarter for the certain background, at most so many pixels wide or high.
MARGIN, LARGEST_SIDE, ROUNDS = 0.25, 240, 5


def grabcut(image, box):
    """The mask of the object in the box, of the image's size."""
    height, width = image.shape[:2]
    x0, y0, x1, y1 = box
    margin = MARGIN * np.array([x1 - x0, y1 - y0])
    left, top = np.maximum(np.floor([x0, y0] - margin), 0).astype(int)
    right, bottom = np.minimum(np.ceil([x1, y1] + margin), [width, height]).astype(int)
    crop = np.ascontiguousarray(image[top:bottom, left:right])
    labels = np.full(crop.shape[:2], cv2.GC_BGD, np.uint8)
    inner = [round(max(x0 - left, 0)), round(max(y0 - top, 0)), round(min(x1, width) - left), round(min(y1, height) - top)]
    labels[inner[1] : inner[3], inner[0] : inner[2]] = cv2.GC_PR_FGD
    scale = LARGEST_SIDE / max(crop.shape[:2])
    small, small_labels = crop, labels
    if scale < 1:
        size = [max(8, round(side * scale)) for side in crop.shape[1::-1]]
        small = cv2.resize(crop, size, interpolation=cv2.INTER_AREA)
        small_labels = cv2.resize(labels, size, interpolation=cv2.INTER_NEAREST)
    cv2.setRNGSeed(0)
    try:
        models = np.zeros((1, 65)), np.zeros((1, 65))
        cv2.grabCut(small, small_labels, None, *models, ROUNDS, cv2.GC_INIT_WITH_MASK)
    except cv2.error:
        pass  # No pixel of one kind is left: the labels stay.
    inside = largest_parts((small_labels == cv2.GC_FGD) | (small_labels == cv2.GC_PR_FGD))
    if scale < 1:
        inside = cv2.resize(inside.astype(np.float32), crop.shape[1::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    mask = np.zeros((height, width), bool)
    mask[top:bottom, left:right] = inside
    return mask


def largest_parts(inside):
    """Without parts of less than a fifth of the largest one, and without holes: as `quadlift segment` cleans its masks."""
    count, parts, stats, _ = cv2.connectedComponentsWithStats(inside.astype(np.uint8), connectivity=8)
    if count < 2:
        return inside
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0
    kept = np.isin(parts, np.flatnonzero(areas >= 0.2 * areas.max())).astype(np.uint8)
    outlines, _ = cv2.findContours(kept, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(kept, outlines, -1, 1, cv2.FILLED)
    return kept.astype(bool)


def ellipse_of(mask, box):
    """Center and shape (4 times the covariance) of the ellipse with the mask's moments; that in the box without any."""
    y, x = np.nonzero(mask)
    if len(x) < 4:
        return np.add(box[:2], box[2:]) / 2, np.diag(((np.array(box[2:]) - box[:2]) / 2) ** 2)
    points = np.stack([x + 0.5, y + 0.5])
    return points.mean(1), 4 * np.cov(points, bias=True)


def ellipse_of_record(record):
    """The same from the scene file."""
    sin, cos = np.sin(record["angle"]), np.cos(record["angle"])
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.array(record["center"]), turn @ np.diag(np.square(record["semi_axes"])) @ turn.T


def iou(a, b):
    union = (a | b).sum()
    return (a & b).sum() / union if union else 0.0


def ellipse_iou(first, second, steps=200):
    """By counting points of a grid."""
    reach = [np.sqrt(np.diag(shape)) for _, shape in (first, second)]
    low = np.minimum(first[0] - reach[0], second[0] - reach[1])
    high = np.maximum(first[0] + reach[0], second[0] + reach[1])
    axis = (np.arange(steps) + 0.5) / steps
    grid = np.stack(np.meshgrid(*(low[k] + axis * (high[k] - low[k]) for k in (0, 1))), -1)

    def inside(ellipse):
        center, shape = ellipse
        offset = grid - center
        return np.einsum("ijk,kl,ijl->ij", offset, np.linalg.pinv(shape), offset) <= 1

    return iou(inside(first), inside(second))


def read_mask(folder, record):
    # OpenCV would give the colors of the palette instead of the values.
    labels = np.array(Image.open(os.path.join(folder, record["path"])))
    return labels == record["value"]


def run_quadlift(program, scene, method):
    """The detections as `quadlift segment` leaves them, with their masks, and the seconds that it worked."""
    with tempfile.TemporaryDirectory() as folder:
        output = os.path.join(folder, "out.json")
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run(
            [program, "segment", "-q", scene, "-o", output, "--method", method, "--threads", "1"]
            + ["--out-masks", os.path.join(folder, "masks")],
            check=True,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        with open(output) as file:
            detections = json.load(file)["detections"]
        found = [(read_mask(folder, d["mask"]), ellipse_of_record(d["ellipse"])) for d in detections]
        return found, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_grabcut(images, detections):
    start = time.process_time()
    masks = [grabcut(images[d["frame"]], d["box"]) for d in detections]
    seconds = time.process_time() - start
    return [(mask, ellipse_of(mask, d["box"])) for mask, d in zip(masks, detections)], seconds


def main():
    if len(sys.argv) < 3:
        sys.exit("usage: grabcut.py PROGRAM SCENE.json...")
    program, scenes = os.path.abspath(sys.argv[1]), sys.argv[2:]
    cv2.setNumThreads(1)
    scores, seconds, count = {}, {}, 0
    for path in scenes:
        folder = os.path.dirname(path)
        with open(path) as file:
            scene = json.load(file)
        detections = scene["detections"]
        images = {frame["id"]: cv2.imread(os.path.join(folder, frame["image"])) for frame in scene["frames"]}
        truth = [read_mask(folder, d["mask"]) for d in detections]
        count += len(detections)
        results = {"GrabCut, each frame alone": run_grabcut(images, detections)}
        for method in ("sca", "graphcut"):
            results[f"quadlift segment --method {method}"] = run_quadlift(program, path, method)
        for name, (found, spent) in results.items():
            seconds[name] = seconds.get(name, 0.0) + spent
            for (mask, ellipse), true_mask, d in zip(found, truth, detections):
                if d["visible_fraction"] >= MIN_VISIBLE:
                    score = iou(mask, true_mask), ellipse_iou(ellipse, ellipse_of(true_mask, d["box"]))
                    scores.setdefault(name, []).append(score)
    print(f"OpenCV {cv2.__version__}, {len(scenes)} scenes, {count} detections\n")
    print(f"{'':34}{'mask IoU':>10}{'ellipse IoU':>13}{'ms per frame and object':>25}{'ratio':>8}")
    slowest = seconds["GrabCut, each frame alone"]
    for name, values in scores.items():
        masks, ellipses = np.mean(values, axis=0)
        spent = seconds[name]
        print(f"{name:34}{masks:10.3f}{ellipses:13.3f}{1e3 * spent / count:25.1f}{slowest / spent:8.1f}")


if __name__ == "__main__":
    main()
