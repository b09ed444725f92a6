//! `quadlift import` of detections and `localize --cameras --detections` from end to end: real data where they are at hand,
//! the files of the tutorial, wrong usage.

use std::path::{Path, PathBuf};

use crate::common::{Folder, real_scenes};
use serde_json::{Value, json};

/// A file or folder of the real data, if they are there.
fn real(name: &str) -> Option<PathBuf> {
    Some(real_scenes()?.parent()?.join(name))
}

fn succeed(folder: &Folder, arguments: &[&str]) -> String {
    let run = folder.run_list(arguments);
    assert_eq!(run.code, 0, "quadlift {arguments:?}\n{}{}", run.stdout, run.stderr);
    run.stdout
}

fn parse(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn mean(scores: &Value, name: &str) -> f64 {
    scores["mean"][name]["value"].as_f64().unwrap_or_else(|| panic!("no {name} in {scores:#}"))
}

/// The detections of a source.
fn of_source<'a>(scene: &'a Value, source: &str) -> Vec<&'a Value> {
    let detections = scene["detections"].as_array().unwrap().iter();
    detections.filter(|detection| detection["source"] == source).collect()
}

fn boxes_agree(a: &Value, b: &Value, tolerance: f64) -> bool {
    let edges = |detection: &Value| serde_json::from_value::<[f64; 4]>(detection["box"].clone()).unwrap();
    edges(a).iter().zip(&edges(b)).all(|(a, b)| (a - b).abs() <= tolerance)
}

#[test]
fn detections_of_kitti_are_those_of_the_ready_scene() {
    let Some(kitti) = real("kitti_tracking") else { return };
    let ready = parse(&std::fs::read_to_string(real("scenes/kitti_S09_oxts.json").unwrap()).unwrap());
    let path = |name: &str| kitti.join(name).to_str().unwrap().to_owned();
    let folder = Folder::new();
    let part = ["--sequence", "0001", "--frames", "90-106"];
    succeed(&folder, &[&["import", "kitti", &path(""), "-o", "scene.json"], &part[..]].concat());
    // The detector's table, without names of columns.
    let rrc = ["import", "csv", &path("det_rrc/0001.txt"), "--into", "scene.json", "-o", "scene.json", "--json"];
    let report = parse(&succeed(&folder, &[&rrc[..], &["--source", "rrc"]].concat()));
    assert_eq!((&report["matched_images"], &report["matched_by"]), (&json!(17), &json!("index")), "{report:#}");
    let scene = folder.json("scene.json");
    let (found, expected) = (of_source(&scene, "rrc"), of_source(&ready, "rrc"));
    assert!(found.len() >= expected.len() && !expected.is_empty(), "{} {}", found.len(), expected.len());
    for expected in expected {
        let same = |d: &&&Value| d["frame"] == expected["frame"] && boxes_agree(d, expected, 0.006);
        assert!(found.iter().find(same).is_some(), "{expected}");
    }
    // The labels are those that `import kitti` brings along.
    let labels =
        ["import", "kitti-labels", &path("label_02/0001.txt"), "--into", "scene.json", "-o", "both.json", "--json"];
    succeed(&folder, &labels);
    let both = folder.json("both.json");
    let (kitti_labels, label) = (of_source(&both, "kitti-labels"), of_source(&both, "label"));
    assert_eq!(kitti_labels.len(), label.len());
    for (a, b) in kitti_labels.iter().zip(&label) {
        let fields = ["frame", "object", "category", "box", "occluded", "truncated"];
        assert!(fields.iter().all(|field| a[field] == b[field]), "{a} {b}");
    }
    // Straight from the files; the sequence is that of the labels.
    let cameras = path("");
    let localize = [
        "localize",
        "--cameras",
        &cameras,
        "--detections",
        &path("label_02/0001.txt"),
        "--frames",
        "90-106",
        "-o",
        "cars.json",
        "--body",
        "cuboid",
        "--max-occluded",
        "1",
        "--max-truncated",
        "0",
    ];
    let report = succeed(&folder, &localize);
    assert!(report.contains(": kitti, 17 frames") && report.contains("(by index)"), "{report}");
    let scores = parse(&folder.succeed("evaluate cars.json scene.json --json"));
    println!("kitti: {:#}", scores["mean"]);
    assert!(mean(&scores, "center_error") < 1.5, "{scores:#}");
}

#[test]
fn detections_of_linemod_are_those_of_the_ready_scene() {
    let Some(sequence) = real("linemod/sequences/09_duck_all.csv") else { return };
    let ready = parse(&std::fs::read_to_string(real("scenes/accv_duck.json").unwrap()).unwrap());
    // The columns of the box and the score under names that the reader knows; the other 13 are the pose.
    let mut table = "frame,x,y,w,h,score,object\n".to_owned();
    for line in std::fs::read_to_string(sequence).unwrap().lines().filter(|line| !line.starts_with('#')) {
        let fields: Vec<&str> = line.split(',').collect();
        table += &format!("{},{},obj_000009\n", fields[0], fields[13..18].join(","));
    }
    let folder = Folder::new();
    folder.write("duck.csv", table);
    let bop = real("linemod/bop/test/000009").unwrap();
    let bop = bop.to_str().unwrap();
    succeed(&folder, &["import", "bop", bop, "--world-object", "9", "-o", "scene.json"]);
    let import = "import csv duck.csv --into scene.json -o detected.json --source yolo --pixel-centers integer --json";
    let report = parse(&folder.succeed(import));
    assert_eq!(report["matched_images"], 100, "{report:#}");
    let scene = folder.json("detected.json");
    let (found, expected) = (of_source(&scene, "yolo"), of_source(&ready, "yolo"));
    assert_eq!(found.len(), 100);
    for expected in &expected {
        let same = |d: &&&Value| d["frame"] == expected["frame"] && boxes_agree(d, expected, 0.006);
        assert!(found.iter().find(same).is_some(), "{expected}");
    }
    let localize = [
        "localize",
        "--cameras",
        bop,
        "--world-object",
        "9",
        "--detections",
        "duck.csv",
        "--pixel-centers",
        "integer",
        "-o",
        "duck.json",
    ];
    let report = succeed(&folder, &localize);
    assert!(report.contains(": bop, 100 frames"), "{report}");
    let scores = parse(&folder.succeed("evaluate duck.json scene.json --json"));
    println!("duck: {:#}", scores["mean"]);
    assert_eq!(scores["failures"], 0);
    // The true body of the scene is the one inscribed in the model's box.
    assert!(mean(&scores, "iou3d") > 0.6, "{scores:#}");
}

/// The folder of the tutorial in a folder of its own.
fn tutorial() -> Folder {
    let folder = Folder::new();
    folder.copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/data/tutorial-colmap-yolo"));
    folder
}

#[test]
fn the_objects_of_the_tutorial_are_found_where_they_are() {
    let folder = tutorial();
    let report = folder.succeed("localize --cameras sparse/0 --detections labels -o objects.json");
    assert!(report.contains("sparse/0: colmap, 24 frames") && report.contains("labels: yolo"), "{report}");
    assert!(report.contains("each line has a class, a box and a score"), "{report}");
    let result = folder.json("objects.json");
    // As in make_tutorial_colmap_yolo.py.
    let truth = [
        ("cup", [0.25, 0.10, 0.05]),
        ("cup", [-0.30, 0.22, 0.05]),
        ("bottle", [0.05, -0.25, 0.13]),
        ("bottle", [-0.10, 0.05, 0.12]),
        ("book", [-0.28, -0.20, 0.02]),
        ("book", [0.30, -0.15, 0.015]),
    ];
    let objects: Vec<&Value> = result["objects"].as_array().unwrap().iter().filter(|o| o["status"] == "ok").collect();
    assert_eq!(objects.len(), truth.len(), "{report}");
    for (category, center) in truth {
        let near = |object: &&&Value| {
            let found: [f64; 3] = serde_json::from_value(object["body"]["center"].clone()).unwrap();
            let distance = found.iter().zip(&center).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            object["category"] == category && distance < 0.01
        };
        assert_eq!(objects.iter().filter(near).count(), 1, "{category} {center:?}\n{report}");
    }
    // The same input gives the same bytes; JSON tells what was read from where.
    let first = folder.read("objects.json");
    let json = parse(&folder.succeed("localize --cameras sparse/0 --detections labels -o objects.json --json"));
    assert_eq!(folder.read("objects.json"), first);
    assert_eq!((&json["scenes"][0]["cameras"], &json["scenes"][0]["localized"]), (&json!("sparse/0"), &json!(6)));
}

#[test]
fn detections_are_added_to_those_that_are_there() {
    let folder = tutorial();
    std::fs::create_dir(folder.path("images")).unwrap();
    folder.succeed("import colmap sparse/0 --images images -o scene.json");
    let report = folder.succeed("import yolo labels --into scene.json -o scene.json");
    assert!(report.contains("of the source yolo in 24 images matched to frames of the scene (by stem)"), "{report}");
    assert!(report.contains("no detection has a track id"), "{report}");
    let before = folder.json("scene.json")["detections"].as_array().unwrap().len();
    // One that the scene knows and one that it does not.
    folder.write("more.csv", "image,x,y,w,h,score,track_id\nIMG_4021.jpg,1,2,30,40,0.9,5\nIMG_1.jpg,1,2,30,40,0.9,5\n");
    std::fs::create_dir(folder.path("out")).unwrap();
    let more = parse(&folder.succeed("import csv more.csv --into scene.json -o out/more.json --json"));
    assert_eq!((&more["detections"], &more["images_without_frame"]), (&json!(1), &json!(["IMG_1.jpg"])), "{more:#}");
    assert_eq!(more["frames_without_image"].as_array().unwrap().len(), 23);
    let scene = folder.json("out/more.json");
    assert_eq!(scene["detections"].as_array().unwrap().len(), before + 1);
    assert_eq!(of_source(&scene, "csv")[0]["object"], "t5");
    assert_eq!(scene["frames"][0]["image"], "../images/IMG_4021.jpg");
    assert!(scene["notes"].as_str().unwrap().contains("Detections of the source csv from a CSV table"), "{scene}");
    folder.succeed("import csv more.csv --into scene.json -o replaced.json --replace --min-score 0.95");
    assert!(folder.json("replaced.json").get("detections").is_none());
    // A list of names instead of the one beside the labels.
    folder.write("classes.txt", "mug\nflask\nbrochure\n");
    folder.succeed("import yolo labels --into scene.json -o named.json --class-names classes.txt --source mine");
    assert_eq!(of_source(&folder.json("named.json"), "mine")[0]["category"], "mug");
}
