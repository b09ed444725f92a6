//! `quadlift export` from end to end: every format of a result, and what is said about it.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod common;

use common::Folder;
use serde_json::{Value, json};

/// A folder with `objects.json`: three estimated cuboids, and an object without a body.
fn result() -> Folder {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 3 --views 12 --seed 2 --body cuboid --noise box:0.01");
    folder.succeed("localize scene.json -o objects.json --body cuboid");
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
        ("ros", "--frame-id hall"),
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
    let ros = folder.json("out.ros");
    assert_eq!((&ros["header"]["frame_id"], ros["detections"].as_array().unwrap().len()), (&json!("hall"), 3));
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

#[cfg(feature = "parquet")]
#[test]
fn a_result_comes_back_from_parquet() {
    let folder = result();
    // As quadlift writes it.
    folder.succeed("export parquet objects.json -o first");
    folder.succeed("import parquet first -o once.json");
    folder.succeed("export parquet once.json -o second");
    let report = folder.succeed("import parquet second -o twice.json");
    assert_eq!(report, "wrote twice.json: 1 camera, 12 frames, 0 detections, 4 objects\n");
    assert_eq!(folder.json("once.json"), folder.json("objects.json"));
    assert_eq!(folder.read("once.json"), folder.read("twice.json"));
    let run = folder.run("export parquet objects.json -o first");
    assert_eq!((run.code, run.stderr.contains("the folder is not empty")), (1, true), "{}", run.stderr);
    // A file that is damaged is told in one line.
    let mut bytes = std::fs::read(folder.path("first/objects.parquet")).unwrap();
    bytes[20..400].fill(0xFF);
    folder.write("first/objects.parquet", bytes);
    let run = folder.run("import parquet first -o no.json");
    assert_eq!((run.code, run.stderr.lines().count()), (1, 1), "{}", run.stderr);
    assert!(run.stderr.contains("cannot read the table"), "{}", run.stderr);
}
