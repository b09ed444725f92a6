//! `quadlift align`, through the built program.

use std::collections::BTreeMap;

use crate::common::Folder;
use serde_json::{Value, json};

/// Maps of 16 objects from two trajectories (`a.json`, `b.json`), of which the second one is in a world that is half as large and elsewhere.
fn two_maps(folder: &Folder, options: &str) {
    let common = format!("synth -q --objects 16 --views 14 --seed 7 --cube 60 --noise box:0.03 {options}");
    folder.succeed(&format!("{common} -o north.json"));
    folder.succeed(&format!("{common} -o south.json --trajectory arc:90 --scale 0.5 --offset 30,4,0"));
    folder.succeed("localize -q north.json -o a.json");
    folder.succeed("localize -q south.json -o b.json");
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

/// Leaves out objects of a map, and gives the others new ids.
fn change(folder: &Folder, name: &str, kept: std::ops::Range<usize>, id: impl Fn(usize) -> String) {
    let mut map = folder.json(name);
    let objects = map["objects"].as_array_mut().unwrap();
    *objects = objects[kept].to_vec();
    let mut names = BTreeMap::new();
    for (k, object) in objects.iter_mut().enumerate() {
        names.insert(object["id"].as_str().unwrap().to_owned(), id(k));
        object["id"] = id(k).into();
    }
    let detections = map["detections"].as_array_mut().unwrap();
    detections.retain(|detection| names.contains_key(detection["object"].as_str().unwrap()));
    detections.iter_mut().for_each(|detection| {
        detection["object"] = names[detection["object"].as_str().unwrap()].as_str().into();
    });
    folder.write_json(name, &map);
}

#[test]
fn maps_are_aligned_and_merged() {
    let folder = Folder::new();
    two_maps(&folder, "");
    // Ten objects are in both: 0 to 12 of A, 3 to 15 of B, whose ids begin anew.
    change(&folder, "a.json", 0..13, |k| format!("object {k}"));
    change(&folder, "b.json", 3..16, |k| format!("object {k}"));
    let text = folder.succeed("align a.json b.json -o merged.json");
    assert!(text.contains("aligned by 10 objects of 13 and 13"), "{text}");
    assert!(text.contains("assumed: the scale is estimated"), "{text}");
    assert!(text.contains("renamed in B, because their ids are taken in A: 14 frames and 3 objects"), "{text}");
    assert!(text.contains("wrote merged.json: 28 frames, 16 objects"), "{text}");
    let merged = folder.json("merged.json");
    let found = &merged["alignment"];
    assert_eq!(found["status"], "ok");
    assert!((found["a_from_b"]["scale"].as_f64().unwrap() - 2.0).abs() < 0.03, "{found}");
    let off: Vec<f64> =
        numbers(&found["a_from_b"]["translation"]).iter().zip([-60.0, -8.0, 0.0]).map(|(x, y)| x - y).collect();
    assert!(off.iter().all(|x| x.abs() < 1.5), "{off:?}");
    let matches = found["matches"].as_array().unwrap();
    let expected =
        |(k, found): (usize, &Value)| found["a"] == format!("object {}", k + 3) && found["b"] == format!("object {k}");
    assert!(matches.len() == 10 && matches.iter().enumerate().all(expected), "{found}");
    let ids: Vec<&str> = merged["objects"].as_array().unwrap().iter().map(|o| o["id"].as_str().unwrap()).collect();
    assert_eq!(ids[12..], ["object 12", "b/object 10", "b/object 11", "b/object 12"]);
    // The objects of B are where they truly are in A.
    let truth = folder.json("north.json");
    for (k, place) in [(13, 13), (14, 14), (15, 15)] {
        let [x, y] =
            [&merged["objects"][k]["body"], &truth["objects"][place]["ellipsoid"]].map(|body| numbers(&body["center"]));
        assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() < 1.5), "{x:?} {y:?}");
    }
    // Other commands read the result, and the same input gives the same bytes.
    folder.succeed("info merged.json");
    folder.succeed("align -q a.json b.json -o second.json --threads 1");
    assert_eq!(folder.read("merged.json"), folder.read("second.json"));
    // Without an output nothing is written.
    let before = folder.names();
    let report: Value = serde_json::from_str(&folder.succeed("align a.json b.json --json")).unwrap();
    assert_eq!(report["alignment"]["matches"], found["matches"]);
    assert_eq!(before, folder.names());
}

#[test]
fn objects_are_localized_from_the_detections_of_both_maps() {
    let folder = Folder::new();
    two_maps(&folder, "--no-ids --misses 0.1");
    let text = folder.succeed("align a.json b.json -o merged.json");
    assert!(text.contains("localized 16 of 16 objects from the detections of both maps"), "{text}");
    let merged = folder.json("merged.json");
    let frames = |id: &Value| {
        let of_object = merged["detections"].as_array().unwrap().iter().filter(|d| &d["object"] == id);
        let (b, a): (Vec<&str>, Vec<&str>) =
            of_object.map(|d| d["frame"].as_str().unwrap()).partition(|frame| frame.starts_with("b/"));
        (a.len(), b.len())
    };
    for object in merged["objects"].as_array().unwrap() {
        let (of_a, of_b) = frames(&object["id"]);
        assert!(of_a >= 8 && of_b >= 8, "{object}");
        assert!(object["views_used"].as_u64().unwrap() as usize >= of_a.max(of_b) + 4, "{object}");
    }
    assert_eq!(merged["localization"]["diagnosis"]["consistent"], true);
    assert_eq!(merged["alignment"]["localized_together"], true);
}

#[test]
fn maps_that_are_not_aligned_say_why_and_nothing_is_written() {
    let folder = Folder::new();
    two_maps(&folder, "");
    let refused = |arguments: &str, why: &str| {
        let run = folder.run(&format!("align {arguments} -o out.json"));
        // Units or verticals that contradict the objects are named.
        let code = if run.stderr.contains("check the units") || run.stderr.contains("check both `up`") { 3 } else { 1 };
        assert_eq!(run.code, code, "{arguments} {}", run.stderr);
        assert!(run.stderr.contains(why), "{arguments}: {}", run.stderr);
        assert!(run.stdout.contains("not aligned"), "{}", run.stdout);
        assert!(!folder.path("out.json").exists());
    };
    let with_objects = |name: &str, change: &dyn Fn(&mut Vec<Value>)| {
        let mut changed = folder.json("a.json");
        change(changed["objects"].as_array_mut().unwrap());
        folder.write_json(name, &changed);
    };
    // The maps differ by a factor of two.
    refused("a.json b.json --rigid", "by the objects a unit of B is ");
    let told = folder.run("align a.json b.json --rigid").stderr;
    let unit = told.split("a unit of B is ").nth(1).and_then(|rest| rest.split(' ').next()).unwrap();
    assert!((unit.parse::<f64>().unwrap() - 2.0).abs() < 0.01, "{told}");
    refused("a.json b.json --rigid", "not 1: check the units");
    with_objects("empty.json", &|objects| objects.clear());
    refused("a.json empty.json", "too few objects");
    with_objects("one.json", &|objects| objects.truncate(1));
    refused("one.json one.json", "too few objects");
    with_objects("two.json", &|objects| objects.truncate(2));
    refused("two.json two.json --rigid", "no transform explains the maps better than chance");
    refused("two.json two.json --no-up", "too few objects");
    let ball = |center: [f64; 3]| json!({"center": center, "semi_axes": [0.5, 0.5, 0.5], "rotation": [1, 0, 0, 0]});
    // All alike: on a grid, and in one row.
    with_objects("grid.json", &|objects| {
        for (k, object) in objects.iter_mut().enumerate() {
            *object =
                json!({"id": k.to_string(), "ellipsoid": ball([4.0 * (k % 4) as f64, 4.0 * (k / 4) as f64, 0.0])});
        }
    });
    refused("grid.json grid.json", "different transforms explain the maps about as well");
    with_objects("row.json", &|objects| {
        for (k, object) in objects.iter_mut().enumerate() {
            let x = 3.0 * k as f64 + (k * k) as f64;
            *object = json!({"id": k.to_string(), "category": k.to_string(), "ellipsoid": ball([x, 0.0, 0.0])});
        }
    });
    refused("row.json row.json --no-up --rigid", "ambiguous:");
    assert_eq!(folder.run("align row.json row.json").code, 0);
    // Units that are known, and wrong.
    for (name, unit) in [("a_m.json", "m"), ("b_m.json", "m"), ("b_half.json", "ft")] {
        let mut map = folder.json(&format!("{}.json", &name[..1]));
        map["length_unit"] = unit.into();
        folder.write_json(name, &map);
    }
    refused("a_m.json b_m.json", "by the objects a unit of B is ");
    refused("a_m.json b_half.json", "not 0.3048");
    let text = folder.succeed("align a_m.json b_m.json --similarity");
    assert!(text.contains("the scale is estimated (--similarity)"), "{text}");
    // A wrong vertical.
    let mut tilted = folder.json("b.json");
    tilted["up"] = json!([1, 0, 0]);
    folder.write_json("tilted.json", &tilted);
    refused("a.json tilted.json", "without `up` of the files they are aligned (--no-up)");
    folder.succeed("align a.json tilted.json --no-up");
}

#[test]
fn wrong_files_and_options_are_refused() {
    let folder = Folder::new();
    two_maps(&folder, "");
    folder.write("text.json", "no JSON");
    let run = folder.run("align a.json text.json");
    assert!(run.code == 1 && run.stderr.contains("text.json"), "{}", run.stderr);
    assert_eq!(folder.run("align a.json none.json").code, 1);
    let mut wrong = folder.json("b.json");
    wrong["objects"][2]["body"]["half_extents"][0] = json!(-1);
    folder.write_json("wrong.json", &wrong);
    let run = folder.run("align a.json wrong.json");
    assert!(run.code == 1 && run.stderr.contains("objects[2].body.half_extents"), "{}", run.stderr);
    for arguments in [
        "a.json b.json -o a.json",
        "a.json b.json -o b.json",
        "a.json b.json -o out.ply",
        "a.json b.json --rigid --similarity",
        "a.json b.json --up-sd 0",
        "a.json b.json --source x",
        "a.json",
    ] {
        let run = folder.run(&format!("align {arguments}"));
        assert_eq!(run.code, 2, "{arguments}: {}", run.stderr);
    }
}
