//! Detections without identities, through the built program.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod common;

use common::Folder;
use serde_json::Value;

/// A scene of six objects whose detections name none, and the true name of each.
fn scene_without_ids(folder: &Folder) -> Vec<String> {
    folder.succeed("synth -q -o truth.json --objects 6 --views 10 --seed 2 --noise box:0.03");
    let mut scene = folder.json("truth.json");
    let detections = scene["detections"].as_array_mut().unwrap();
    let names = detections
        .iter_mut()
        .map(|d| d.as_object_mut().unwrap().remove("object").unwrap().as_str().unwrap().to_owned());
    let names = names.collect();
    scene.as_object_mut().unwrap().remove("objects");
    folder.write_json("scene.json", &scene);
    names
}

#[test]
fn detections_get_the_objects_that_they_show() {
    let folder = Folder::new();
    let names = scene_without_ids(&folder);
    insta::assert_snapshot!("associate", folder.succeed("associate scene.json -o associated.json"));
    let found = folder.json("associated.json");
    let found: Vec<&str> =
        found["detections"].as_array().unwrap().iter().map(|d| d["object"].as_str().unwrap_or("none")).collect();
    for i in 0..names.len() {
        for j in 0..i {
            assert_eq!(names[i] == names[j], found[i] == found[j], "detections {i} and {j}");
        }
    }
}

#[test]
fn localize_finds_the_objects_by_itself() {
    let folder = Folder::new();
    scene_without_ids(&folder);
    let report: Value = serde_json::from_str(&folder.succeed("localize scene.json -o found.json --json")).unwrap();
    assert_eq!(report["scenes"][0]["localised"], 6);
    assert_eq!(report["scenes"][0]["association"]["clutter"], 0);
    folder.succeed("associate -q scene.json -o associated.json");
    folder.succeed("localize -q associated.json -o in_two_steps.json");
    assert_eq!(folder.read("found.json"), folder.read("in_two_steps.json"));
}

#[test]
fn what_cannot_be_associated_is_said() {
    let folder = Folder::new();
    scene_without_ids(&folder);
    let refused = folder.run("localize scene.json --associate never");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("name no object (--associate always"), "{}", refused.stderr);
    let mut scene = folder.json("scene.json");
    scene["detections"].as_array_mut().unwrap().truncate(2);
    folder.write_json("few.json", &scene);
    let refused = folder.run("associate few.json -o out.json");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("no object was found: the detections are in fewer frames"), "{}", refused.stderr);
    assert!(!folder.path("out.json").exists());
}
