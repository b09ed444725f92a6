"""Exports a scene in every format and reads the files with the packages that people use for them.

    python scripts/check_exports.py path/to/quadlift

Needs check_exports_requirements.txt.
"""

import csv
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import trimesh
from pycocotools.coco import COCO

ROUNDED_VERTICES = 6 * 12 * 12 + 2


def run(*arguments):
    return subprocess.run(arguments, check=True, capture_output=True, text=True).stdout


def rotation(wxyz):
    w, x, y, z = wxyz
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def bounds(ellipsoid, turn=np.eye(3)):
    """The box around an ellipsoid after a turn of the world, by its shape matrix."""
    axes = turn @ rotation(ellipsoid["rotation"]) * ellipsoid["half_extents"]
    reach = np.linalg.norm(axes, axis=1)
    center = turn @ np.array(ellipsoid["center"])
    return np.array([center - reach, center + reach])


def close_to(found, expected, sizes):
    """Meshes lie inside of the bodies, by at most 2 percent of their size."""
    assert np.all(np.abs(found - expected) <= 0.02 * np.max(sizes)), (found, expected)


def check_ply(path, objects):
    mesh = trimesh.load(path, process=False)
    assert isinstance(mesh, trimesh.Trimesh), type(mesh)
    assert mesh.vertices.shape == (ROUNDED_VERTICES * len(objects), 3), mesh.vertices.shape
    assert mesh.visual.vertex_colors.shape == (len(mesh.vertices), 4)
    all_bounds = np.array([bounds(o["body"]) for o in objects])
    expected = np.array([all_bounds[:, 0].min(axis=0), all_bounds[:, 1].max(axis=0)])
    close_to(mesh.bounds, expected, all_bounds[:, 1] - all_bounds[:, 0])
    # Closed bodies whose faces look outwards.
    volume = sum(4 / 3 * np.pi * np.prod(o["body"]["half_extents"]) for o in objects)
    assert mesh.is_watertight and 0.97 * volume < mesh.volume < volume, (mesh.volume, volume)
    print(f"PLY: {len(mesh.vertices)} vertices, bounds {mesh.bounds.tolist()}")


def check_glb(path, objects, turn):
    scene = trimesh.load(path)
    for o in objects:
        transform, name = scene.graph.get(o["id"])
        mesh = scene.geometry[name]
        points = trimesh.transform_points(mesh.vertices, transform)
        assert len(points) == ROUNDED_VERTICES, len(points)
        expected = bounds(o["body"], turn)
        close_to(np.array([points.min(axis=0), points.max(axis=0)]), expected, expected[1] - expected[0])
        assert mesh.visual.material.alphaMode == "BLEND"
    # trimesh keeps no `extras` of nodes: the JSON of the file has them.
    content = path.read_bytes()
    length = int.from_bytes(content[12:16], "little")
    nodes = {node["name"]: node for node in json.loads(content[20 : 20 + length])["nodes"]}
    for o in objects:
        assert nodes[o["id"]]["extras"] == {"id": o["id"], "category": o.get("category")}, nodes[o["id"]]
    print(f"glTF: {len(scene.geometry)} meshes, bounds {scene.bounds.tolist()}")


def check_coco(path, scene, estimate):
    coco = COCO(path)
    assert len(coco.getImgIds()) == len(scene["frames"])
    annotations = coco.loadAnns(coco.getAnnIds())
    assert len(annotations) == len(scene["frames"]) * len(estimate["objects"])
    frame_of = {image["id"]: image["frame"] for image in coco.loadImgs(coco.getImgIds())}
    # The result has the detections with the objects that were found; a few belong to none.
    measured = {(d["frame"], d["object"]): d["box"] for d in estimate["detections"] if "object" in d}
    assert len(measured) > 0.9 * len(annotations)
    differences = []
    for annotation in annotations:
        detected = measured.get((frame_of[annotation["image_id"]], annotation["object"]))
        if detected is None:
            continue
        x, y, w, h = annotation["bbox"]
        x0, y0, x1, y1 = detected
        differences.append(np.abs([x - x0, y - y0, x + w - x1, y + h - y1]).max() / (w + h))
    # The noise of the boxes is 5 percent of their half size, and some are quite wrong.
    assert np.median(differences) < 0.05, np.median(differences)
    print(f"COCO: {len(differences)} of {len(annotations)} boxes were detected, median difference to the measured ones {np.median(differences):.3f} of w + h")


def check_kitti(path, scene, estimate):
    lines = [line.split(" ") for line in path.read_text().splitlines()]
    assert len(lines) == len(scene["frames"]) * len(estimate["objects"])
    for fields in lines:
        assert len(fields) == 17, fields
        int(fields[0]), int(fields[1])
        left, top, right, bottom, h, w, length, x, y, z, turn = map(float, fields[6:])
        # The middle of the upright box is seen in the middle of its outline, as far as perspective allows.
        fx, fy, cx, cy = scene["cameras"][0]["params"]
        u, v = fx * x / z + cx, fy * (y - h / 2) / z + cy
        assert left < u < right and top < v < bottom and min(h, w, length) > 0 and abs(turn) <= np.pi, fields
    print(f"KITTI: {len(lines)} labels")


def check_bop(path, scene, estimate):
    # As load_bop_results of the bop_toolkit.
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == "scene_id,im_id,obj_id,score,R,t,time".split(",")
    assert len(rows) == len(scene["frames"]) * len(estimate["objects"])
    for row, (frame, o) in zip(rows, ((f, o) for f in scene["frames"] for o in estimate["objects"])):
        r = np.array([float(x) for x in row["R"].split()]).reshape(3, 3)
        t = np.array([float(x) for x in row["t"].split()])
        pose = np.array(frame["cam_from_world"])
        assert np.allclose(r, pose[:, :3] @ rotation(o["body"]["rotation"]), atol=1e-9)
        assert np.allclose(t, 1000 * (pose @ [*o["body"]["center"], 1]), atol=1e-6)
    print(f"BOP: {len(rows)} poses")


def check_geojson(path, objects, origin):
    import geopandas
    import pyproj

    table = geopandas.read_file(path)
    assert table.crs == "EPSG:4326" and len(table) == 2 * len(objects)
    latitude, longitude, height = origin
    to_tangent = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lat_0={latitude} +lon_0={longitude} +h_0={height}"
    )
    points = table[table["kind"] == "object"].to_dict("records")
    ellipses = table[table["kind"] == "error_ellipse"].to_dict("records")
    for point, ellipse, o in zip(points, ellipses, objects, strict=True):
        assert point["id"] == ellipse["id"] == o["id"]
        covariance = np.array(o["covariance"]["matrix"])[:3, :3]
        found = np.array(to_tangent.transform(point["geometry"].x, point["geometry"].y, point["geometry"].z))
        # Coordinates are rounded to a tenth of a millimeter.
        assert np.abs(found - o["body"]["center"]).max() < 2e-4, (found, o["body"]["center"])
        assert np.allclose([point[f"sd_{axis}"] for axis in ("east", "north", "up")], np.sqrt(np.diag(covariance)), atol=1e-6)
        box = bounds(o["body"])
        assert abs(point["height"] - (box[1] - box[0])[2]) < 1e-4
        assert ellipse["geometry"].is_valid and ellipse["geometry"].exterior.is_ccw
        ring = np.array([to_tangent.transform(*corner) for corner in ellipse["geometry"].exterior.coords])[:, :2]
        offset = ring - found[:2]
        distances = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance[:2, :2]), offset)
        # 5.991 is the 95 % quantile of chi-square with two degrees of freedom. A tenth of a millimeter matters in small ellipses.
        slack = 4e-4 / np.sqrt(np.linalg.eigvalsh(covariance[:2, :2]).min())
        assert np.abs(np.sqrt(distances) - np.sqrt(5.991)).max() < slack + 1e-3, distances
    print(f"GeoJSON: {len(points)} points, {len(ellipses)} ellipses")


def main():
    quadlift = Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scene_path, estimate_path = folder / "scene.json", folder / "estimate.json"
        noise = ["--scale", "0.05", "--noise", "box:0.05", "--outliers", "0.05"]
        run(quadlift, "synth", "-o", scene_path, "--objects", "8", "--views", "20", *noise)
        scene = json.loads(scene_path.read_text())
        scene["length_unit"] = "m"
        scene.pop("objects")
        for detection in scene["detections"]:
            detection.pop("object", None)
        scene_path.write_text(json.dumps(scene))
        # The numbers of vertices below are those of ellipsoids.
        run(quadlift, "localize", scene_path, "-o", estimate_path, "--body", "ellipsoid")
        estimate = json.loads(estimate_path.read_text())
        objects = estimate["objects"]
        assert len(objects) == 8 and all(o["body"]["kind"] == "ellipsoid" for o in objects)

        def export(kind, *options):
            path = folder / f"out.{kind}"
            run(quadlift, "export", kind, estimate_path, "-o", path, *options)
            return path

        check_ply(export("ply", "--frusta", "0"), objects)
        with_cameras = trimesh.load(export("ply"), process=False)
        assert len(with_cameras.vertices) == ROUNDED_VERTICES * len(objects) + 5 * len(scene["frames"])
        # y up: a world with z up is turned by a quarter about x, one without "up" by its cameras.
        estimate["up"] = [0, 0, 1]
        upright = folder / "upright.json"
        upright.write_text(json.dumps(estimate))
        del estimate["up"]
        glb = folder / "upright.glb"
        run(quadlift, "export", "glb", upright, "-o", glb)
        check_glb(glb, objects, np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]))
        check_coco(export("coco"), scene, estimate)
        check_kitti(export("kitti"), scene, estimate)
        check_bop(export("bop"), scene, estimate)
        origin = (-33.9, 151.2, 10.5)
        geojson = folder / "upright.geojson"
        run(quadlift, "export", "geojson", upright, "-o", geojson, "--origin", ",".join(map(str, origin)))
        check_geojson(geojson, objects, origin)
        with export("csv").open() as file:
            rows = list(csv.DictReader(file))
        for row, o in zip(rows, objects, strict=True):
            half = [float(row[f"half_extent_{k}"]) for k in (1, 2, 3)]
            assert half == o["body"]["half_extents"] and row["object"] == o["id"], row
        print(f"CSV: {len(rows)} objects")


if __name__ == "__main__":
    main()
