"""What Python costs, and quadlift beside a plain NumPy port of the closed form LfD.

    OPENBLAS_NUM_THREADS=1 python bench/python/python_overhead.py

Needs the package (a release build) and NumPy. The first table compares the time of `quadlift.localize` with that of the
library in it, on 10,000 objects in 10 views. The second one has 1,000 objects in 20 views, with exact and noisy boxes:
milliseconds per object with one thread (OPENBLAS_NUM_THREADS=1), and the mean volume IoU with the truth (O3D), in
which a failure counts as 0.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import quadlift

Floats = NDArray[np.float64]
IMAGE = np.array([1280.0, 960.0])
CALIBRATION = np.array([[2000.0, 0.0, 640.0], [0.0, 2000.0, 480.0], [0.0, 0.0, 1.0]])
# Entries of a symmetric matrix that count.
UPPER4, UPPER3 = np.triu_indices(4), np.triu_indices(3)


class Data:
    """Random ellipsoids in a cube, and their boxes in views from all around."""

    def __init__(self, objects: int, views: int, noise: float, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.centers = rng.uniform(-10.0, 10.0, (objects, 3))
        self.semi_axes = rng.uniform(0.5, 2.0, (objects, 3))
        self.rotations = np.linalg.qr(rng.normal(size=(objects, 3, 3)))[0]
        self.rotations[:, :, 0] *= np.linalg.det(self.rotations)[:, np.newaxis]
        self.projections = np.array([projection(2.0 * np.pi * k / views, 15.0 + 10.0 * (k % 3)) for k in range(views)])
        shape = np.einsum("nij,nj,nkj->nik", self.rotations, self.semi_axes**2, self.rotations)
        dual = np.zeros((objects, 4, 4))
        dual[:, :3, :3] = shape
        ones = np.column_stack([self.centers, np.ones(objects)])
        dual -= np.einsum("ni,nj->nij", ones, ones)
        conics = np.einsum("fij,njk,flk->nfil", self.projections, dual, self.projections)
        conics /= conics[..., 2:, 2:]
        center = conics[..., :2, 2]
        half = np.sqrt(center**2 - np.stack([conics[..., 0, 0], conics[..., 1, 1]], axis=-1))
        boxes = np.concatenate([center - half, center + half], axis=-1)
        boxes += noise * half.mean(axis=-1)[..., np.newaxis] * rng.normal(size=boxes.shape)
        self.boxes = boxes.reshape(-1, 4)
        self.frames = np.tile(np.arange(views), objects)
        self.objects = np.repeat(np.arange(objects), views)

    def localize(self, **options: Any) -> quadlift.Estimates:
        """The estimates of quadlift."""
        return quadlift.localize(
            projections=self.projections,
            image_sizes=IMAGE,
            frames=self.frames,
            boxes=self.boxes,
            objects=self.objects,
            **options,
        )

    def o3d(self, ellipsoids: list[tuple[Floats, Floats, Floats] | None]) -> float:
        """Mean volume IoU of estimates (center, semi-axes, quaternion) with the truth."""
        truth = zip(self.centers, self.semi_axes, map(quaternion, self.rotations), strict=True)
        scores = scene_of(list(ellipsoids), "ok").evaluate(scene_of(list(truth), None))
        mean = scores.mean["iou3d"]
        assert mean is not None
        return mean


def projection(azimuth: float, elevation: float) -> Floats:
    """A camera 100 units away that looks at the origin."""
    up = np.radians(elevation)
    eye = 100.0 * np.array([np.cos(azimuth) * np.cos(up), np.sin(azimuth) * np.cos(up), np.sin(up)])
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix: Floats = CALIBRATION @ np.column_stack([rotation, -rotation @ eye])
    return matrix


def scene_of(ellipsoids: list[tuple[Floats, Floats, Floats] | None], status: str | None) -> quadlift.Scene:
    """A scene that holds these bodies only."""
    objects = []
    for index, body in enumerate(ellipsoids):
        record: dict[str, Any] = {"id": str(index)}
        if status is not None:
            record["status"] = status if body is not None else "not_an_ellipsoid"
        if body is not None:
            center, semi_axes, rotation = body
            record["ellipsoid"] = {
                "center": center.tolist(),
                "semi_axes": semi_axes.tolist(),
                "rotation": rotation.tolist(),
            }
        objects.append(record)
    return quadlift.Scene.from_dict({"format": "quadlift.scene", "version": 1, "objects": objects})


def quaternion(rotation: Floats) -> Floats:
    """The unit quaternion of a rotation, w first: the eigenvector of Bar-Itzhack's matrix."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0.0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0.0, 0.0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0.0, 0.0, 0.0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    vector: Floats = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return vector


def on_vech(p: Floats) -> Floats:
    """G with vech(P Q P^T) = G vech(Q)."""
    g = np.empty((6, 10))
    for column, (i, j) in enumerate(zip(*UPPER4, strict=True)):
        unit = np.zeros((4, 4))
        unit[i, j] = unit[j, i] = 1.0
        g[:, column] = (p @ unit @ p.T)[UPPER3]
    return g


def solve(projections: Floats, conics: Floats, target_from_world: Floats) -> Floats | None:
    """The dual quadric in the world from dual conics that are centered and scaled, in the target's frame."""
    world_from_target = np.linalg.inv(target_from_world)
    count = len(projections)
    system = np.zeros((6 * count, 10 + count))
    for view, (p, conic) in enumerate(zip(projections, conics, strict=True)):
        center, scale = conic[:2], np.hypot(conic[2], conic[3])
        image = np.array([[1.0 / scale, 0.0, -center[0] / scale], [0.0, 1.0 / scale, -center[1] / scale], [0, 0, 1.0]])
        matrix = image @ p @ world_from_target
        g = on_vech(matrix / np.linalg.norm(matrix))
        c = np.diag([(conic[2] / scale) ** 2, (conic[3] / scale) ** 2, -1.0])
        system[6 * view : 6 * view + 6, :10] = g
        system[6 * view : 6 * view + 6, 10 + view] = -c[UPPER3]
    solution = np.linalg.svd(system, full_matrices=False)[2][-1, :10]
    dual = np.zeros((4, 4))
    dual[UPPER4] = solution
    dual = dual + dual.T - np.diag(np.diag(dual))
    if dual[3, 3] == 0.0:
        return None
    result: Floats = world_from_target @ (dual / -dual[3, 3]) @ world_from_target.T
    return result


def lfd(projections: Floats, boxes: Floats) -> tuple[Floats, Floats, Floats] | None:
    """LfD (Rubino et al., TPAMI 2017): conditioned ellipses, twice; the second time with the origin at the object."""
    conics = np.column_stack([(boxes[:, :2] + boxes[:, 2:]) / 2.0, (boxes[:, 2:] - boxes[:, :2]) / 2.0])
    dual = solve(projections, conics, np.eye(4))
    if dual is None:
        return None
    target = np.eye(4)
    target[:3, 3] = dual[:3, 3]  # minus the center: the last entry is -1
    dual = solve(projections, conics, target)
    if dual is None:
        return None
    center = -dual[:3, 3]
    values, vectors = np.linalg.eigh(dual[:3, :3] + np.outer(center, center))
    if values[0] <= 0.0:
        return None
    vectors[:, 0] *= np.linalg.det(vectors)
    return center, np.sqrt(values), quaternion(vectors)


def bodies(estimates: quadlift.Estimates) -> list[tuple[Floats, Floats, Floats] | None]:
    """Center, semi-axes and quaternion of each object."""
    rows = zip(estimates.ok, estimates.centers, estimates.closest_ellipsoids(), estimates.quaternions, strict=True)
    return [(center, axes, rotation) if ok else None for ok, center, axes, rotation in rows]


def timed(work: Callable[..., Any], *arguments: Any, **options: Any) -> tuple[float, Any]:
    """Seconds, and what the work gives."""
    start = time.perf_counter()
    result = work(*arguments, **options)
    return time.perf_counter() - start, result


def overhead() -> None:
    """The first table."""
    data = Data(objects=10_000, views=10, noise=0.05)
    print(f"quadlift {quadlift.__version__}, NumPy {np.__version__}\n\n10,000 objects x 10 views, medians of 5\n")
    print("| method | Python, s | library, s | ratio |\n| --- | --- | --- | --- |")
    for options in ({}, {"threads": 1}, {"method": "planes"}):
        data.localize(**options)
        runs = [timed(data.localize, **options) for _ in range(5)]
        whole = statistics.median(seconds for seconds, _ in runs)
        inside = statistics.median(estimates.seconds for _, estimates in runs)
        ratio = statistics.median(seconds / estimates.seconds for seconds, estimates in runs)
        name = ", ".join(f"{key}={value}" for key, value in options.items()) or "posterior"
        print(f"| {name} | {whole:.3f} | {inside:.3f} | {ratio:.3f} |")


def side_by_side() -> None:
    """The second table."""
    print("\n1,000 objects x 20 views, one thread\n")
    print("| | exact: ms per object | O3D | noise 5 %: ms per object | O3D |\n| --- | --- | --- | --- | --- |")
    data = [Data(objects=1_000, views=20, noise=noise) for noise in (0.0, 0.05)]

    def port(d: Data) -> list[tuple[Floats, Floats, Floats] | None]:
        return [lfd(d.projections, boxes) for boxes in d.boxes.reshape(1_000, 20, 4)]

    def ours(method: str) -> Callable[[Data], list[tuple[Floats, Floats, Floats] | None]]:
        return lambda d: bodies(d.localize(method=method, threads=1))

    rows: dict[str, Callable[[Data], list[tuple[Floats, Floats, Floats] | None]]] = {
        "NumPy port of LfD": port,
        "quadlift `lfd`": ours("lfd"),
        "quadlift `planes`": ours("planes"),
        "quadlift `posterior`": ours("posterior"),
    }
    for name, work in rows.items():
        cells = []
        for d in data:
            seconds, found = timed(work, d)
            # 1,000 objects: seconds are milliseconds for each.
            cells.append(f"{seconds:.3f} | {d.o3d(found):.3f}")
        print(f"| {name} | {' | '.join(cells)} |")


if __name__ == "__main__":
    overhead()
    side_by_side()
