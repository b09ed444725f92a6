"""Writes the files of the tutorial "from COLMAP and YOLO to objects": a COLMAP model as text with sparse points, and YOLO's
label files.

Six objects on a table, 24 images on an arc around it. The boxes have an error of 1.5 pixels, one in ten is missing and
one in twenty is of nothing. Run in this folder with Python and numpy.
"""

import pathlib

import numpy as np

WIDTH, HEIGHT, FOCAL = 960, 720, 820.0
CLASSES = ["cup", "bottle", "book"]
# Class, center and semi-axes in meters (z up), turn about z in degrees.
OBJECTS = [
    ("cup", (0.25, 0.10, 0.05), (0.045, 0.040, 0.05), 20),
    ("cup", (-0.30, 0.22, 0.05), (0.045, 0.040, 0.05), 110),
    ("bottle", (0.05, -0.25, 0.13), (0.035, 0.035, 0.13), 0),
    ("bottle", (-0.10, 0.05, 0.12), (0.040, 0.040, 0.12), 0),
    ("book", (-0.28, -0.20, 0.02), (0.120, 0.085, 0.02), 35),
    ("book", (0.30, -0.15, 0.015), (0.110, 0.075, 0.015), -50),
]

rng = np.random.default_rng(5)
here = pathlib.Path("tutorial-colmap-yolo")
(here / "sparse/0").mkdir(parents=True, exist_ok=True)
(here / "labels").mkdir(exist_ok=True)


def quaternion(r):
    """w, x, y, z of a rotation, by the largest of them."""
    w, x, y, z = (0.5 * np.sqrt(max(0.0, 1 + s)) for s in (
        r[0, 0] + r[1, 1] + r[2, 2], r[0, 0] - r[1, 1] - r[2, 2], r[1, 1] - r[0, 0] - r[2, 2], r[2, 2] - r[0, 0] - r[1, 1]))
    return w, np.copysign(x, r[2, 1] - r[1, 2]), np.copysign(y, r[0, 2] - r[2, 0]), np.copysign(z, r[1, 0] - r[0, 1])


def dual_quadric(center, semi_axes, turn):
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    pose = np.eye(4)
    pose[:2, :2] = [[c, -s], [s, c]]
    pose[:3, 3] = center
    return pose @ np.diag([*np.square(semi_axes), -1.0]) @ pose.T


# Sparse points on the objects and the table, with an error of a millimetre, each seen in three images.
of_points = np.random.default_rng(6)
points = []
for _, center, semi_axes, turn in OBJECTS:
    c, s = np.cos(np.radians(turn)), np.sin(np.radians(turn))
    directions = of_points.normal(size=(25, 3))
    directions[:, 2] = abs(directions[:, 2])
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points.append(directions * semi_axes @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + center)
table = of_points.uniform([-0.55, -0.5, 0], [0.55, 0.5, 0], (150, 3))
points = np.vstack([*points, table])
points += of_points.normal(0, 0.001, points.shape)
tracks = [sorted(of_points.choice(24, 3, replace=False)) for _ in points]

images = []
for number in range(24):
    azimuth, height = np.radians(-100 + 200 * number / 23), 0.55 + 0.15 * np.sin(number)
    center = np.array([1.25 * np.cos(azimuth), 1.25 * np.sin(azimuth), height])
    forward = np.array([0.0, 0.0, 0.05]) - center
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0, 0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.array([right, np.cross(forward, right), forward])
    translation = -rotation @ center
    name = f"IMG_{4021 + 3 * number}"
    numbers = " ".join(f"{x:.9f}" for x in [*quaternion(rotation), *translation])
    intrinsics = np.array([[FOCAL, 0, WIDTH / 2], [0, FOCAL, HEIGHT / 2], [0, 0, 1]])
    projection = intrinsics @ np.hstack([rotation, translation[:, None]])
    seen = []
    for index, track in enumerate(tracks):
        if number in track:
            x, y, depth = projection @ [*points[index], 1]
            seen.append(f"{x / depth:.2f} {y / depth:.2f} {index + 1}")
            # The place in the list of the image, which the points name.
            track[track.index(number)] = f"{number + 1} {len(seen) - 1}"
    images.append(f"{number + 1} {numbers} 1 {name}.jpg\n{' '.join(seen)}\n")
    boxes = []
    for kind, *body in OBJECTS:
        conic = projection @ dual_quadric(*body) @ projection.T
        # The tight box of a dual conic: x^2 w - 2 x b + a = 0.
        edges = np.empty(4)
        for axis in (0, 1):
            middle = conic[axis, 2] / conic[2, 2]
            half = np.sqrt(middle**2 - conic[axis, axis] / conic[2, 2])
            edges[[axis, axis + 2]] = middle - half, middle + half
        if rng.uniform() < 0.9:
            boxes.append((kind, edges + rng.normal(0, 1.5, 4), rng.uniform(0.6, 0.98)))
    if rng.uniform() < 0.3:
        corner = rng.uniform([100, 100], [700, 500])
        boxes.append((CLASSES[rng.integers(3)], np.hstack([corner, corner + rng.uniform(30, 160, 2)]), rng.uniform(0.3, 0.6)))
    lines = []
    for kind, (x0, y0, x1, y1), score in boxes:
        x0, x1 = np.clip([x0, x1], 0, WIDTH)
        y0, y1 = np.clip([y0, y1], 0, HEIGHT)
        values = [(x0 + x1) / 2 / WIDTH, (y0 + y1) / 2 / HEIGHT, (x1 - x0) / WIDTH, (y1 - y0) / HEIGHT, score]
        # As Ultralytics writes them.
        lines.append(" ".join(["%g"] * 6) % (CLASSES.index(kind), *values) + "\n")
    (here / f"labels/{name}.txt").write_text("".join(lines))

(here / "sparse/0/cameras.txt").write_text(
    "# Camera list with one line of data per camera:\n#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n"
    f"1 PINHOLE {WIDTH} {HEIGHT} {FOCAL} {FOCAL} {WIDTH / 2} {HEIGHT / 2}\n"
)
(here / "sparse/0/images.txt").write_text(
    "# Image list with two lines of data per image:\n"
    "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n#   POINTS2D[] as (X, Y, POINT3D_ID)\n" + "".join(images)
)
(here / "sparse/0/points3D.txt").write_text(
    "# 3D point list with one line of data per point:\n"
    "#   POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n"
    + "".join(
        f"{index + 1} {x:.5f} {y:.5f} {z:.5f} 128 128 128 {of_points.uniform(0.2, 1.2):.3f} {' '.join(track)}\n"
        for index, ((x, y, z), track) in enumerate(zip(points, tracks))
    )
)
(here / "data.yaml").write_text("path: ../table\ntrain: images\nnames:\n" + "".join(f"  {i}: {n}\n" for i, n in enumerate(CLASSES)))
