//! `quadlift localize --cross-validate` from end to end.

use crate::common::Folder;
use serde_json::{Value, json};

/// A scene with a false box in its fourth frame.
fn scene_with_a_false_box(folder: &Folder) {
    folder.succeed("synth -o true.json --objects 3 --views 12 --seed 4 --noise box:0.01 --trajectory orbit");
    let mut scene = folder.json("true.json");
    scene.as_object_mut().unwrap().remove("objects");
    let frame = scene["frames"][3]["id"].clone();
    let detections = scene["detections"].as_array_mut().unwrap();
    let wrong = detections.iter_mut().find(|d| d["frame"] == frame && d["object"] == "object_001").unwrap();
    let b: Vec<f64> = wrong["box"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
    let (w, h) = (b[2] - b[0], b[3] - b[1]);
    wrong["box"] = json!([b[0] + 0.8 * w, b[1] - 0.5 * h, b[2] + 1.2 * w, b[3] - 0.1 * h]);
    folder.write_json("scene.json", &scene);
}

#[test]
fn every_object_has_its_figure_and_the_odd_view_is_named() {
    let folder = Folder::new();
    scene_with_a_false_box(&folder);
    let shown = folder.succeed("localize scene.json -o result.json --cross-validate");
    insta::assert_snapshot!("cross_validate", shown);
    let result = folder.json("result.json");
    let scene_wide = &result["localization"]["cross_validation"];
    assert_eq!((&scene_wide["extent"], &scene_wide["views"]), (&json!("all"), &json!(36)));
    let objects = result["objects"].as_array().unwrap();
    let iou = |k: usize| objects[k]["cross_validation"]["iou"].as_f64().unwrap();
    assert!(iou(0) > 0.95 && iou(2) > 0.95 && iou(1) < 0.95, "{} {} {}", iou(0), iou(1), iou(2));
    assert_eq!(objects[1]["cross_validation"]["suspect_view"], result["frames"][3]["id"]);
    assert!(objects[0]["cross_validation"]["suspect_view"].is_null());
    let of_views = objects[1]["view_residuals_px"].as_array().unwrap();
    assert!(of_views[3]["predicted_iou"].as_f64().unwrap() < 0.2);
    // The same on standard output, and the file can be read again.
    let printed: Value = serde_json::from_str(&folder.succeed("localize scene.json --cross-validate --json")).unwrap();
    assert_eq!(&printed["scenes"][0]["cross_validation"], scene_wide);
    assert_eq!(printed["scenes"][0]["objects"][1]["cross_validation"], objects[1]["cross_validation"]);
    folder.succeed("evaluate result.json true.json");
}

#[test]
fn without_the_option_a_sample_is_told_of_the_scene_only() {
    let folder = Folder::new();
    scene_with_a_false_box(&folder);
    let shown = folder.succeed("localize scene.json -o result.json");
    assert!(shown.contains("boxes predicted from the other views: IoU"), "{shown}");
    let result = folder.json("result.json");
    assert_eq!(result["localization"]["cross_validation"]["extent"], "sample");
    assert!(result["objects"].as_array().unwrap().iter().all(|object| object["cross_validation"].is_null()));
    // What is estimated does not depend on it.
    folder.succeed("localize scene.json -o all.json --cross-validate");
    let bodies = |name: &str| -> Vec<Value> {
        folder.json(name)["objects"].as_array().unwrap().iter().map(|object| object["body"].clone()).collect()
    };
    assert_eq!(bodies("result.json"), bodies("all.json"));
}

#[test]
fn two_views_predict_nothing() {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 2 --views 2 --seed 4 --trajectory orbit");
    folder.succeed("localize scene.json -o result.json --cross-validate");
    assert!(folder.json("result.json")["localization"]["cross_validation"].is_null());
}
