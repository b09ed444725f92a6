"""Writes the files of the Python tutorial: a robot drives past things on the floor, and a tracker follows them.

Boxes have errors of 6 % of their half size and a pixel, things hide each other, one box in fifteen is missing,
and a few show nothing. Tracks break, and are exchanged where boxes overlap. Run in this folder with Python and numpy.
"""

import json
import pathlib

import numpy as np

WIDTH, HEIGHT, FOCAL = 960, 540, 700.0
FRAMES, OBJECTS = 40, 20
# Semi-axes in meters, on average.
KINDS = {"crate": (0.35, 0.25, 0.20), "bucket": (0.16, 0.16, 0.18), "bag": (0.28, 0.18, 0.14), "stool": (0.2, 0.2, 0.25)}

rng = np.random.default_rng(11)
here = pathlib.Path("tutorial-python")
here.mkdir(exist_ok=True)


def turn(yaw):
    """Rotation about z."""
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])


def overlap(a, b):
    """Area that two boxes share, and those of both."""
    size = np.clip(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0.0, None)
    area = [(x[2] - x[0]) * (x[3] - x[1]) for x in (a, b)]
    return size.prod(), area


objects = []
while len(objects) < OBJECTS:
    kind = list(KINDS)[rng.integers(len(KINDS))]
    semi_axes = np.array(KINDS[kind]) * rng.uniform(0.85, 1.15, 3)
    center = np.array([rng.uniform(0.5, 9.5), rng.uniform(1.8, 6.5), semi_axes[2]])
    if all(np.hypot(*(center - other["center"])[:2]) > 0.75 for other in objects):
        objects.append({"kind": kind, "center": center, "semi_axes": semi_axes, "yaw": rng.uniform(-np.pi, np.pi)})

intrinsics = np.array([[FOCAL, 0.0, WIDTH / 2], [0.0, FOCAL, HEIGHT / 2], [0.0, 0.0, 1.0]])
poses, rows = [], []
track_of, next_track = {}, 1
for frame in range(FRAMES):
    # Along the aisle, looking to the left, now a little ahead and now a little back, and slightly down.
    share = frame / (FRAMES - 1)
    eye = np.array([10.0 * share, 0.15 * np.sin(5.0 * share), 1.1])
    yaw, pitch = np.radians(90.0 + 25.0 * np.sin(14.0 * share)), np.radians(14.0)
    forward = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch)])
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    world_from_cam = np.column_stack([right, np.cross(forward, right), forward, eye])
    poses.append(world_from_cam)
    rotation = world_from_cam[:, :3].T
    projection = intrinsics @ np.column_stack([rotation, -rotation @ eye])

    seen = []
    for index, thing in enumerate(objects):
        depth = rotation[2] @ (thing["center"] - eye)
        if depth < 0.8:
            continue
        shape = turn(thing["yaw"]) * thing["semi_axes"]
        dual = np.zeros((4, 4))
        dual[:3, :3] = shape @ shape.T
        point = np.append(thing["center"], 1.0)
        conic = projection @ (dual - np.outer(point, point)) @ projection.T
        # The tight box of a dual conic.
        middle = conic[:2, 2] / conic[2, 2]
        half = np.sqrt(middle**2 - np.diag(conic)[:2] / conic[2, 2])
        seen.append((depth, index, np.concatenate([middle - half, middle + half])))
    boxes = []
    for depth, index, edges in sorted(seen, key=lambda item: item[0]):
        inside, (area, _) = overlap(edges, np.array([0, 0, WIDTH, HEIGHT]))
        hidden = max((overlap(edges, other)[0] / area for _, other in boxes), default=0.0)
        if inside > 0.4 * area and hidden < 0.4:
            boxes.append((index, edges))
    found = []
    for index, edges in boxes:
        size = 0.25 * (edges[2] - edges[0] + edges[3] - edges[1])
        edges = edges + rng.normal(0.0, 1.0, 4) * np.hypot(0.06 * size, 1.0)
        if rng.uniform() > 1 / 15:
            found.append((index, np.clip(edges, 0.0, [WIDTH, HEIGHT, WIDTH, HEIGHT])))
    # The tracker loses what it does not see, and loses its way in a crowd.
    track_of = {index: track for index, track in track_of.items() if any(index == other for other, _ in found)}
    for index, edges in found:
        if index not in track_of or rng.uniform() < 0.01:
            track_of[index] = next_track
            next_track += 1
    for (i, a) in found:
        for (j, b) in found:
            shared, areas = overlap(a, b)
            if i < j and shared > 0.1 * min(areas) and rng.uniform() < 0.12:
                track_of[i], track_of[j] = track_of[j], track_of[i]
    for index, edges in found:
        rows.append([frame, track_of[index], *edges, rng.uniform(0.5, 0.98), objects[index]["kind"], f"thing_{index:02}"])
    if rng.uniform() < 0.15:
        corner = rng.uniform([50.0, 150.0], [800.0, 400.0])
        edges = np.concatenate([corner, corner + rng.uniform(30.0, 120.0, 2)])
        rows.append([frame, next_track, *edges, rng.uniform(0.3, 0.6), list(KINDS)[rng.integers(len(KINDS))], ""])
        next_track += 1

np.savetxt(here / "poses.txt", np.reshape(poses, (-1, 12)), fmt="%.9g")
lines = ["frame,track,x0,y0,x1,y1,score,label,truth"]
lines += [",".join(f"{x:.2f}" if isinstance(x, float) else str(x) for x in row) for row in rows]
(here / "tracks.csv").write_text("\n".join(lines) + "\n")
truth = {
    "format": "quadlift.scene",
    "version": 1,
    "length_unit": "m",
    "objects": [
        {
            "id": f"thing_{index:02}",
            "category": thing["kind"],
            "ellipsoid": {
                "center": thing["center"].round(6).tolist(),
                "semi_axes": thing["semi_axes"].round(6).tolist(),
                "rotation": [np.cos(thing["yaw"] / 2), 0.0, 0.0, np.sin(thing["yaw"] / 2)],
            },
        }
        for index, thing in enumerate(objects)
    ],
}
(here / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")
