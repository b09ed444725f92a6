//! Detections without identities, through the built program.

use crate::common::Folder;
use serde_json::{Value, json};

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
    assert_eq!(report["scenes"][0]["localized"], 6);
    assert_eq!(report["scenes"][0]["association"]["clutter"], 0);
    folder.succeed("associate -q scene.json -o associated.json");
    folder.succeed("localize -q associated.json -o in_two_steps.json");
    let (found, in_two_steps) = (folder.json("found.json"), folder.json("in_two_steps.json"));
    assert_eq!(found["objects"], in_two_steps["objects"]);
    // The result tells which detections show which object.
    assert_eq!(found["detections"], folder.json("associated.json")["detections"]);
    assert_eq!(in_two_steps["detections"], found["detections"]);
    assert_eq!(found["localization"]["association"]["objects"].as_array().unwrap().len(), 6);
}

#[test]
fn identities_are_scored_against_the_truth() {
    let folder = Folder::new();
    folder.succeed(
        "synth -q -o scene.json --ground-truth truth.json --no-ids --objects 12 --cube 30 --seed 4 --noise box:0.05 --misses 0.2 \
         --false-positives 0.15",
    );
    let (scene, truth) = (folder.json("scene.json"), folder.json("truth.json"));
    assert!(scene["objects"].is_null() && truth["objects"].as_array().unwrap().len() == 12);
    assert!(scene["detections"].as_array().unwrap().iter().all(|d| d["object"].is_null()));
    folder.succeed("localize -q scene.json -o estimate.json");
    folder.succeed("associate -q scene.json -o associated.json");
    insta::assert_snapshot!("evaluate_without_ids", folder.succeed("evaluate estimate.json truth.json"));
    let scores = |arguments: &str| -> Value { serde_json::from_str(&folder.succeed(arguments)).unwrap() };
    let swapped = folder.run("evaluate truth.json estimate.json");
    assert!(swapped.stderr.contains("truth.json has no estimates and estimate.json has"), "{}", swapped.stderr);
    let whole = scores("evaluate estimate.json truth.json --json");
    assert_eq!((&whole["matched_by"], &whole["failures"]), (&json!("overlap"), &json!(0)));
    assert_eq!((&whole["found"]["matched"], &whole["found"]["precision"]), (&json!(12), &json!(1.0)));
    assert!(whole["identities"]["f1"].as_f64().unwrap() > 0.98, "{whole}");
    assert_eq!(whole["identities"]["detections"].as_u64(), Some(scene["detections"].as_array().unwrap().len() as u64));
    // Detections alone can be compared, too.
    let detections = scores("evaluate associated.json truth.json --json");
    assert_eq!(detections["identities"], whole["identities"]);
    assert!(detections["objects"].is_null());
    // Half of one object under another name: a duplicate, and recall falls.
    let mut split = folder.json("associated.json");
    let name = split["detections"][0]["object"].clone();
    let of_first = split["detections"].as_array_mut().unwrap().iter_mut().filter(|d| d["object"] == name);
    of_first.skip(1).step_by(2).for_each(|d| d["object"] = json!("another"));
    folder.write_json("split.json", &split);
    let worse = &scores("evaluate split.json truth.json --json")["identities"];
    assert_eq!(worse["duplicates"], 1);
    assert!(worse["recall"].as_f64() < whole["identities"]["recall"].as_f64());
    assert_eq!(worse["precision"], whole["identities"]["precision"]);
    // By ids nothing is common.
    let refused = folder.run("evaluate estimate.json truth.json --match ids");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("(--match overlap pairs them"), "{}", refused.stderr);
}

#[test]
fn what_may_move_is_marked_in_the_result() {
    let folder = Folder::new();
    folder.succeed("synth -q -o street.json --trajectory street --views 40 --objects 31 --no-ids --noise box:0.03");
    let mut scene = folder.json("street.json");
    // A car ahead that drives as fast as the camera: always the same box.
    for frame in 0..40 {
        let moving = json!({"frame": format!("{frame:06}"), "box": [560.0, 180.0, 640.0, 240.0]});
        scene["detections"].as_array_mut().unwrap().push(moving);
    }
    folder.write_json("street.json", &scene);
    let text = folder.succeed("localize street.json -o out.json");
    let out = folder.json("out.json");
    let uncertain: Vec<&Value> = out["objects"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|o| o["warnings"].to_string().contains("uncertain: "))
        .map(|o| &o["id"])
        .collect();
    // All boxes of the car are uncertain or belong to nothing.
    let detections = out["detections"].as_array().unwrap();
    let trusted = detections[detections.len() - 40..].iter().filter(|d| {
        let object = &d["object"];
        !object.is_null() && !uncertain.contains(&object)
    });
    assert!(trusted.count() <= 10, "{text}");
    assert_eq!(text.contains("\nuncertain: "), !uncertain.is_empty(), "{text}");
}

#[test]
fn what_cannot_be_associated_is_said() {
    let folder = Folder::new();
    scene_without_ids(&folder);
    let refused = folder.run("localize scene.json --associate never");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("have no object id (--associate always"), "{}", refused.stderr);
    let mut scene = folder.json("scene.json");
    scene["detections"].as_array_mut().unwrap().truncate(2);
    folder.write_json("few.json", &scene);
    let refused = folder.run("associate few.json -o out.json");
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("no object was found: the detections are in fewer frames"), "{}", refused.stderr);
    assert!(!folder.path("out.json").exists());
}
