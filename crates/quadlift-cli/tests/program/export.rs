//! `quadlift export` from end to end: every format of a result, and what is said about it.

use crate::common::Folder;
use serde_json::{Value, json};

/// A folder with `objects.json`: three estimated cuboids, and an object without a body.
fn result() -> Folder {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 12 --seed 2 --body cuboid --noise box:0.01");
    folder.succeed("localize scene.json -o objects.json --body cuboid --enclosing");
    let mut objects = folder.json("objects.json");
    objects["objects"].as_array_mut().unwrap().push(json!({"id": "lost", "status": "not_an_ellipsoid"}));
    folder.write_json("objects.json", &objects);
    folder
}

#[test]
fn every_format_is_written_and_reported() {
    let folder = result();
    let mut report = String::new();
    for (format, options) in [
        ("ply", ""),
        ("glb", "--enclosing --frusta 2"),
        ("csv", "--views out.views"),
        ("kitti", "--only-detected"),
        ("bop", "--scene-id 3"),
        ("coco", "--enclosing"),
    ] {
        report.push_str(&folder.succeed(&format!("export {format} objects.json -o out.{format} {options}")));
    }
    insta::assert_snapshot!(report);
    let bytes = |name: &str| std::fs::read(folder.path(name)).unwrap();
    assert!(bytes("out.ply").starts_with(b"ply\n") && bytes("out.glb").starts_with(b"glTF\x02"));
    let lines = |name: &str| folder.read(name).lines().count();
    assert_eq!((lines("out.csv"), lines("out.views")), (5, 1 + 3 * 12), "with a header, and the lost object");
    assert_eq!((lines("out.kitti"), lines("out.bop")), (3 * 12, 1 + 3 * 12));
    assert!(folder.read("out.bop").lines().nth(1).unwrap().starts_with("3,0,"));
    assert_eq!(folder.json("out.coco")["annotations"].as_array().unwrap().len(), 3 * 12);
    // The same input gives the same bytes.
    for format in ["ply", "glb", "coco"] {
        folder.succeed(&format!("export {format} scene.json -o one"));
        folder.succeed(&format!("export {format} scene.json -o two"));
        assert_eq!(bytes("one"), bytes("two"));
    }
}

#[test]
fn boxes_in_the_images_are_those_that_were_measured() {
    let folder = result();
    folder.succeed("export coco objects.json -o coco.json");
    let (coco, scene) = (folder.json("coco.json"), folder.json("scene.json"));
    let frame = |id: &Value| &coco["images"].as_array().unwrap().iter().find(|i| i["id"] == *id).unwrap()["frame"];
    let mut compared = 0;
    for annotation in coco["annotations"].as_array().unwrap() {
        let measured = scene["detections"].as_array().unwrap().iter();
        let mut measured =
            measured.filter(|d| d["object"] == annotation["object"] && d["frame"] == *frame(&annotation["image_id"]));
        let [x0, y0, x1, y1]: [f64; 4] = serde_json::from_value(measured.next().unwrap()["box"].clone()).unwrap();
        let [x, y, w, h]: [f64; 4] = serde_json::from_value(annotation["bbox"].clone()).unwrap();
        // Noise is one percent of the half size; the tangent body follows the boxes.
        for difference in [x - x0, y - y0, x + w - x1, y + h - y1] {
            assert!(difference.abs() < 0.05 * (w + h), "{annotation} {x0} {y0} {x1} {y1}");
        }
        compared += 1;
    }
    assert_eq!(compared, 36);
}

#[test]
fn json_tells_counts_and_what_was_left_out() {
    let folder = result();
    let report: Value = serde_json::from_str(&folder.succeed("export ply objects.json -o a.ply --json")).unwrap();
    let expected = json!({
        "files": [{"output": "a.ply", "counts": {"object": 3, "camera": 12}, "notes": []}],
        "without_body": ["lost"],
    });
    assert_eq!(report, expected);
    assert_eq!(folder.succeed("export ply objects.json -o a.ply -q"), "");
}

#[test]
fn a_recording_has_what_the_files_of_a_scene_hold() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    folder.succeed("localize scene.json -o objects.json -q");
    let mut scene = folder.json("scene.json");
    scene["frames"][1]["time"] = json!(2.5);
    let camera = scene["cameras"][0].clone();
    folder.write_json("scene.json", &scene);
    std::fs::remove_file(folder.path("images/000002.png")).unwrap();
    let report = folder.succeed("export rerun objects.json scene.json -o out");
    assert!(report.starts_with("wrote out: 2 objects, 3 frames, 2 images, "), "{report}");
    assert!(report.contains("\n- 1 of 3 images could not be read: ") && report.contains("000002.png"), "{report}");
    let recording = folder.json("out/recording.json");
    assert_eq!((&recording["format"], &recording["version"]), (&json!("quadlift.recording"), &json!(1)));
    let frames = recording["frames"].as_array().unwrap();
    let values = |key: &str| frames.iter().map(|frame| frame[key].clone()).collect::<Vec<_>>();
    assert_eq!(values("time"), [json!(null), json!(2.5), json!(null)]);
    assert_eq!(values("image"), [json!("images/000000.jpg"), json!("images/000001.jpg"), json!(null)]);
    assert_eq!(values("size"), [json!([240.0, 180.0]), json!([240.0, 180.0]), json!([240.0, 180.0])]);
    let numbers = |value: &Value| -> Vec<f64> {
        let rows = value.as_array().unwrap().iter();
        rows.flat_map(|row| serde_json::from_value::<Vec<f64>>(row.clone()).unwrap()).collect()
    };
    let close = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
    let [fx, fy, cx, cy]: [f64; 4] = serde_json::from_value(camera["params"].clone()).unwrap();
    for (frame, record) in frames.iter().zip(scene["frames"].as_array().unwrap()) {
        let found = &frame["camera"];
        assert!(close(&numbers(&found["intrinsics"]), &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]), "{found}");
        assert!(close(&numbers(&found["cam_from_world"]), &numbers(&record["cam_from_world"])), "{found}");
        let boxes: Vec<&Value> = frame["boxes"].as_array().unwrap().iter().map(|b| &b["edges"]).collect();
        let measured = scene["detections"].as_array().unwrap().iter().filter(|d| d["frame"] == frame["id"]);
        assert_eq!(boxes, measured.map(|d| &d["box"]).collect::<Vec<_>>());
        assert!(frame["boxes"][0]["inlier"].is_boolean() && frame["boxes"][0]["object"].is_string());
    }
    let estimates = folder.json("objects.json");
    for (found, object) in recording["objects"].as_array().unwrap().iter().zip(estimates["objects"].as_array().unwrap())
    {
        let (body, [w, x, y, z]): (_, [Value; 4]) =
            (&object["body"], serde_json::from_value(object["body"]["rotation"].clone()).unwrap());
        assert_eq!((&found["id"], &found["status"]), (&object["id"], &object["status"]));
        if found["estimate"]["kind"] == "ellipsoid" {
            assert_eq!(found["estimate"]["half_sizes"], body["half_extents"]);
            assert!(close(&numbers(&json!([found["estimate"]["quaternion_xyzw"]])), &numbers(&json!([[x, y, z, w]]))));
        }
        assert!(found["truth"].is_object(), "{found}");
    }
    // A folder with files is left alone; the same input gives the same bytes.
    let run = folder.run("export rerun objects.json -o out");
    assert_eq!((run.code, run.stderr.contains("the folder is not empty")), (1, true), "{}", run.stderr);
    folder.succeed("export rerun objects.json scene.json -o again");
    for name in ["recording.json", "images/000000.jpg"] {
        let bytes = |of: &str| std::fs::read(folder.path(of).join(name)).unwrap();
        assert!(bytes("out") == bytes("again"), "{name}");
    }
}

#[test]
fn images_of_a_recording_are_those_of_the_pinhole_camera() {
    let folder = Folder::new();
    folder.rendered_scene("scene.json", 3);
    let mut scene = folder.json("scene.json");
    let [f, _, cx, cy]: [f64; 4] = serde_json::from_value(scene["cameras"][0]["params"].clone()).unwrap();
    scene["cameras"][0]["model"] = json!("SIMPLE_RADIAL");
    scene["cameras"][0]["params"] = json!([f, cx, cy, -0.3]);
    folder.write_json("lens.json", &scene);
    // A disc where the lens shows the pinhole pixel (202.5, cy): at r (1 + k r^2) of the center.
    let r = (202.5 - cx) / f;
    let place = cx + f * r * (1.0 - 0.3 * r * r);
    assert!(place < 201.0, "{place}");
    let disc = image::RgbImage::from_fn(240, 180, |x, y| {
        let distance = (f64::from(x) + 0.5 - place).hypot(f64::from(y) + 0.5 - cy);
        image::Rgb([if distance < 5.0 { 255 } else { 0 }; 3])
    });
    quadlift_io::write_png(&folder.path("images/000000.png"), &disc).unwrap();
    folder.succeed("export rerun lens.json -o out");
    let shown = quadlift_io::read_image(&folder.path("out/images/000000.jpg")).unwrap();
    let (mut sum, mut light) = ([0.0; 2], 0.0);
    // JPEG leaves a little light in the dark.
    for (x, y, color) in shown.enumerate_pixels().filter(|(_, _, color)| color[0] > 30) {
        let weight = f64::from(color[0]);
        sum = [sum[0] + weight * (f64::from(x) + 0.5), sum[1] + weight * (f64::from(y) + 0.5)];
        light += weight;
    }
    let middle = sum.map(|x| x / light);
    assert!((middle[0] - 202.5).abs() < 0.3 && (middle[1] - cy).abs() < 0.3, "{middle:?} {place}");
    // The camera is the pinhole camera.
    let recording = folder.json("out/recording.json");
    let k = |i: usize, j: usize| recording["frames"][0]["camera"]["intrinsics"][i][j].as_f64().unwrap();
    assert!((k(0, 0) - f).abs() < 1e-9 && (k(1, 2) - cy).abs() < 1e-9, "{recording:.200}");
}

#[test]
fn objects_have_places_on_earth() {
    let folder = result();
    let mut scene = folder.json("scene.json");
    scene["length_unit"] = json!("m");
    scene["up"] = json!([0, 0, 1]);
    folder.write_json("meters.json", &scene);
    scene["reference_lla"] = json!({"latitude": -33.9, "longitude": 151.2, "altitude": 10.5});
    folder.write_json("placed.json", &scene);
    for name in ["meters", "placed"] {
        folder.succeed(&format!("localize {name}.json -o {name}.result.json --body cuboid"));
    }
    // The result keeps the place.
    insta::assert_snapshot!(folder.succeed("export geojson placed.result.json -o placed.geojson"), @r"
    wrote placed.geojson: 3 objects, 3 ellipses
    - north is the horizontal part of the world's (0, 1, 0)
    - the origin is the reference_lla of the scene
    ");
    folder.succeed("export geojson meters.result.json -o meters.geojson --origin -33.9,151.2,10.5");
    let (placed, meters) = (folder.json("placed.geojson"), folder.json("meters.geojson"));
    assert_eq!(placed, meters);
    let features = placed["features"].as_array().unwrap();
    assert_eq!((placed["type"].as_str(), features.len()), (Some("FeatureCollection"), 6));
    // Another north turns the points about the origin.
    folder.succeed("export geojson placed.result.json -o turned.geojson --north 0,-1,0");
    let offset = |value: &Value, index: usize, k: usize, origin: f64| {
        value["features"][index]["geometry"]["coordinates"][k].as_f64().unwrap() - origin
    };
    let turned = folder.json("turned.geojson");
    for index in [0, 2, 4] {
        for (k, origin) in [(0, 151.2), (1, -33.9)] {
            let (one, other) = (offset(&placed, index, k, origin), offset(&turned, index, k, origin));
            assert!((one + other).abs() < 1e-3 * one.abs() + 1e-8, "{one} {other}");
        }
    }
}
