//! Logs in MCAP from end to end, as far as they can be made without other programs; see `scripts/check_mcap.py`.

use crate::common::Folder;
use serde_json::{Value, json};

/// A street in meters, its result with given noise levels, and its log.
fn street() -> (Folder, Value) {
    let folder = Folder::new();
    folder.succeed("synth -o scene.json --objects 12 --views 40 --trajectory street --noise box:0.02");
    let mut scene = folder.json("scene.json");
    scene["length_unit"] = json!("m");
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["category"] = json!("car");
        detection["score"] = json!(0.75);
    }
    folder.write_json("scene.json", &scene);
    folder.succeed(&format!("localize scene.json -o expected.json {GIVEN}"));
    folder.succeed("export mcap scene.json -o log.mcap");
    (folder, scene)
}

/// The record after the last message.
const END_OF_DATA: u8 = 0x0F;

/// With given levels an object depends on its own views alone.
const GIVEN: &str = "--body ellipsoid --noise-model edge_noise=0.02,edge_noise_px=1";

/// The largest difference of the centers, relative to their distances from the origin.
fn difference(folder: &Folder, found: &str) -> f64 {
    let objects = |name: &str| folder.json(name)["objects"].as_array().unwrap().clone();
    let (found, expected) = (objects(found), objects("expected.json"));
    assert_eq!(found.len(), expected.len());
    let center = |object: &Value, k: usize| object["body"]["center"][k].as_f64().unwrap();
    let mut largest: f64 = 0.0;
    for (a, b) in found.iter().zip(&expected) {
        assert_eq!((&a["id"], &a["category"]), (&b["id"], &b["category"]));
        let length = (0..3).map(|k| center(b, k).powi(2)).sum::<f64>().sqrt();
        largest = (0..3).map(|k| (center(a, k) - center(b, k)).abs() / length).fold(largest, f64::max);
    }
    largest
}

#[test]
fn oriented_boxes_keep_their_angles_in_a_log() {
    let folder = Folder::new();
    folder.succeed("synth -q -o made.json --objects 4 --views 5 --seed 1 --cues outline,oriented_box");
    let mut scene = folder.json("made.json");
    scene["length_unit"] = json!("m");
    // An oriented box, a box, or an outline alone, of which the box around is written.
    for (k, detection) in scene["detections"].as_array_mut().unwrap().iter_mut().enumerate() {
        let dropped = [["box", "outline"], ["outline", "oriented_box"], ["box", "oriented_box"]][k % 3];
        dropped.iter().for_each(|name| drop(detection.as_object_mut().unwrap().remove(*name)));
    }
    folder.write_json("scene.json", &scene);
    let run = folder.run("export mcap scene.json -o log.mcap");
    let said = format!("{}{}", run.stdout, run.stderr);
    assert!(said.contains("masks, outlines and ellipses of "), "{said}");
    folder.succeed("import mcap log.mcap -o again.json");
    let (again, given) = (folder.json("again.json"), scene);
    // A log has them by the times of their frames.
    let list = |scene: &Value| {
        let mut list = scene["detections"].as_array().unwrap().clone();
        list.sort_by_key(|d| ["frame", "object"].map(|name| d[name].as_str().unwrap().to_owned()));
        list
    };
    assert_eq!(list(&again).len(), list(&given).len());
    let number = |value: &Value| value.as_f64().unwrap();
    for (found, given) in list(&again).iter().zip(list(&given)) {
        let turned = |d: &Value| {
            let d = &d["oriented_box"];
            [&d["center"][0], &d["center"][1], &d["size"][0], &d["size"][1], &d["angle"]].map(number)
        };
        assert_eq!(found["oriented_box"].is_null(), given["oriented_box"].is_null());
        if !given["oriented_box"].is_null() {
            assert!(found["box"].is_null());
            assert_eq!(turned(found), turned(&given));
        } else if !given["box"].is_null() {
            let edges = |d: &Value| [0, 1, 2, 3].map(|k| number(&d["box"][k]));
            assert!(edges(found).iter().zip(edges(&given)).all(|(a, b)| (a - b).abs() < 1e-9));
        } else {
            assert!(!found["box"].is_null());
        }
    }
}

#[test]
fn a_log_gives_the_objects_of_its_scene() {
    let (folder, scene) = street();
    let said = folder.succeed(&format!("localize log.mcap -o found.json {GIVEN}"));
    assert!(said.contains("- poses of frames: 40 at the time of their transforms\n"), "{said}");
    let largest = difference(&folder, "found.json");
    assert!(largest < 1e-9, "{largest:e}");
    // With the scene file in between, and into a folder.
    folder.succeed("import mcap log.mcap -o again.json");
    folder.succeed(&format!("localize again.json log.mcap -o results {GIVEN}"));
    assert!(difference(&folder, "results/again.json") < 1e-9 && folder.path("results/log.json").exists());
    // Detections of another file, by the ids of the frames.
    let mut table = "image,x0,y0,x1,y1,track,class,score\n".to_owned();
    for d in scene["detections"].as_array().unwrap() {
        let frame: usize = d["frame"].as_str().unwrap().parse().unwrap();
        let b = d["box"].as_array().unwrap();
        table.push_str(&format!("{frame}.000000000,{},{},{},{},{},car,0.75\n", b[0], b[1], b[2], b[3], d["object"]));
    }
    folder.write("boxes.csv", table);
    folder.succeed(&format!("localize --cameras log.mcap --detections boxes.csv -o other.json {GIVEN}"));
    assert!(difference(&folder, "other.json") < 1e-9);
}

#[test]
fn a_stream_reads_a_log_frame_by_frame() {
    let (folder, scene) = street();
    let run = folder.run("stream log.mcap --map map.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("/camera/detections (2D detections, 40 messages)"), "{}", run.stderr);
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let frames: Vec<&Value> = lines.iter().filter(|line| line.get("frame").is_some()).collect();
    assert_eq!((frames.len(), &frames[7]["frame"]), (40, &json!("7.000000000")));
    let boxes: usize = frames.iter().map(|frame| frame["objects"].as_array().unwrap().len()).sum();
    assert_eq!(boxes, scene["detections"].as_array().unwrap().len());
    assert_eq!(folder.json("map.json")["length_unit"], "m");
    // The rest of a log that is cut off is an event, or the end with --strict.
    let log = std::fs::read(folder.path("log.mcap")).unwrap();
    let mut end = 8;
    while log[end] != END_OF_DATA {
        end += 9 + u64::from_le_bytes(log[end + 1..end + 9].try_into().unwrap()) as usize;
    }
    folder.write("cut.mcap", &log[..end]);
    let run = folder.run("stream cut.mcap");
    assert!(run.code == 0 && run.stdout.contains("\"type\":\"error\""), "{} {}", run.stdout, run.stderr);
    let run = folder.run("stream cut.mcap --strict");
    assert!(run.code == 1 && run.stderr.contains("error: "), "{}", run.stderr);
    // A stored state goes on in the same world.
    folder.succeed("stream log.mcap --state state --world-frame map");
    let run = folder.run("stream log.mcap --state state --resume");
    assert!(run.code == 1 && run.stderr.contains("go on with the same options"), "{}", run.stderr);
}

#[test]
fn an_exported_log_has_times_scores_and_ids() {
    let (folder, mut scene) = street();
    for (k, frame) in scene["frames"].as_array_mut().unwrap().iter_mut().enumerate() {
        frame["id"] = json!(format!("17000000{k:02}.123456789"));
        frame["time"] = json!(1_700_000_000.123_456_7 + k as f64);
    }
    for detection in scene["detections"].as_array_mut().unwrap() {
        let frame: usize = detection["frame"].as_str().unwrap().parse().unwrap();
        detection["frame"] = json!(format!("17000000{frame:02}.123456789"));
    }
    folder.write_json("timed.json", &scene);
    let said = folder.succeed("export mcap timed.json -o timed.mcap --frame-id world");
    assert!(said.starts_with("wrote timed.mcap: 12 objects, 40 frames, "), "{said}");
    folder.succeed("import mcap timed.mcap -o again.json");
    let again = folder.json("again.json");
    let ids = |scene: &Value| -> Vec<Value> {
        scene["frames"].as_array().unwrap().iter().map(|frame| frame["id"].clone()).collect()
    };
    assert_eq!(ids(&again), ids(&scene));
    assert_eq!(again["detections"][0]["score"], 0.75);
    assert_eq!(folder.run("export mcap timed.json -o timed.mcap").code, 0, "it is written again");
}
