//! The consistency check through the built program: each mistake is named, its option mends it, and the exit code is 3 until it
//! is mended or accepted.

use crate::common::Folder;
use crate::common::mistakes::{Mistake, inverse, mistakes, opengl, right_scene, with_boxes, with_frames, with_poses};
use serde_json::{Value, json};

#[test]
fn mistakes_are_named_and_mended_by_their_options() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    let mistakes = mistakes(&right);
    folder.succeed("localize right.json -o right_result.json");
    let right = folder.json("right_result.json");
    assert_eq!(right["localization"]["diagnosis"]["consistent"], true);
    assert_eq!(right["localization"]["diagnosis"]["causes"], json!([]));
    for Mistake { words, name, scene, .. } in mistakes {
        folder.write_json("wrong.json", &scene);
        let run = folder.run("localize wrong.json -o out.json");
        assert_eq!(run.code, 3, "{name}: {}{}", run.stdout, run.stderr);
        assert!(run.stderr.contains(words), "{name}: {}", run.stderr);
        let result = folder.json("out.json");
        assert!(result["objects"].as_array().unwrap().iter().all(|o| o["status"] != "ok"), "{name}");
        let diagnosis = &result["localization"]["diagnosis"];
        let cause = &diagnosis["causes"][0];
        assert_eq!((&diagnosis["consistent"], &cause["name"]), (&json!(false), &json!(name)));
        let [before, after] = ["before", "after"].map(|key| cause[key].as_f64().unwrap());
        assert!(after < 0.5 * before, "{name}: {cause}");
        let document: Value = serde_json::from_str(&folder.run("localize wrong.json --json").stdout).unwrap();
        assert_eq!(document["scenes"][0]["diagnosis"], *diagnosis);

        // `info` says the same, and is no judge.
        let info = folder.succeed("info wrong.json");
        assert!(info.contains(words), "{name}: {info}");

        // Accepted, the scene is localized as it is.
        let run = folder.run("localize wrong.json -o accepted.json --allow-inconsistent");
        assert!(run.code != 3, "{name}: {}", run.stderr);

        // The option that is proposed mends it, and so does --fix.
        let option = cause["option"].as_str().unwrap();
        assert!(run.stderr.contains(option) && option.starts_with("--"), "{name}: {option}: {}", run.stderr);
        for (file, option) in [("mended.json", option), ("fixed.json", "--fix")] {
            let text = folder.succeed(&format!("localize wrong.json -o {file} {option}"));
            assert!(text.contains("corrected: "), "{name} {option}: {text}");
            let mended = folder.json(file);
            assert_eq!(mended["localization"]["diagnosis"]["consistent"], true, "{name} {option}");
            assert!(!mended["localization"]["corrections"].as_array().unwrap().is_empty());
            for object in mended["objects"].as_array().unwrap() {
                let same = right["objects"].as_array().unwrap().iter().find(|o| o["id"] == object["id"]).unwrap();
                let distance = (0..3)
                    .map(|k| (object["center"][k].as_f64().unwrap() - same["center"][k].as_f64().unwrap()).powi(2));
                let distance = distance.sum::<f64>().sqrt();
                assert!(object["status"] == "ok" && distance < 0.5, "{name} {option}: {distance} {object}");
            }
        }
    }
}

/// The commands that write scenes tell it too; what was mended is in the scenes that they write.
#[test]
fn scenes_that_are_written_are_mended() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    let wrong = mistakes(&right).into_iter().find(|mistake| mistake.name == "camera_to_world").unwrap();
    folder.write_json("wrong.json", &wrong.scene);
    let run = folder.run("associate wrong.json -o out.json --ids trust");
    assert!(run.code == 3 && run.stderr.contains("camera-to-world"), "{}", run.stderr);
    folder.succeed("associate wrong.json -o out.json --ids trust --fix");
    let mended = folder.json("out.json");
    for (a, b) in mended["frames"].as_array().unwrap().iter().zip(right["frames"].as_array().unwrap()) {
        for (i, j) in (0..3).flat_map(|i| (0..4).map(move |j| (i, j))) {
            let [a, b] = [a, b].map(|frame| frame["cam_from_world"][i][j].as_f64().unwrap());
            assert!((a - b).abs() < 1e-9, "{a} {b}");
        }
    }
    folder.succeed("localize out.json -o result.json");
    assert_eq!(folder.run("localize wrong.json right.json -o results").code, 3);
    assert!(folder.json("results/right.json")["objects"][0]["status"] == "ok");
    folder.write("broken.json", "{");
    assert_eq!(folder.run("localize wrong.json broken.json -o results").code, 1);
}

/// Detections that name no object: they are associated first, and that tells as well.
#[test]
fn mistakes_are_named_without_ids() {
    let folder = Folder::new();
    folder.succeed("synth -o right.json --objects 12 --views 16 --seed 5 --noise box:0.02 --trajectory arc:120");
    let mut right = folder.json("right.json");
    let new_id = |old: &Value| json!(format!("{}.jpg", old.as_str().unwrap().parse::<u32>().unwrap() + 1));
    right["frames"].as_array_mut().unwrap().iter_mut().for_each(|frame| frame["id"] = new_id(&frame["id"]));
    right.as_object_mut().unwrap().remove("objects");
    for detection in right["detections"].as_array_mut().unwrap() {
        detection["frame"] = new_id(&detection["frame"]);
        detection.as_object_mut().unwrap().remove("object");
    }
    folder.write_json("nameless.json", &right);
    folder.succeed("localize nameless.json");
    let (mut wrong, mut named, mut mended) = (0, 0, 0);
    for Mistake { words, name, scene, .. } in mistakes(&right) {
        folder.write_json("wrong.json", &scene);
        let run = folder.run("localize wrong.json --json");
        let document: Value = serde_json::from_str(&run.stdout).unwrap();
        let diagnosis = &document["scenes"][0]["diagnosis"];
        let fixed = folder.run("localize wrong.json --fix").code;
        println!("{name}: {} {} {fixed} {}", run.code, diagnosis["causes"][0]["name"], run.stderr);
        wrong += usize::from(run.code == 3);
        named += usize::from(diagnosis["causes"][0]["name"] == name && run.stderr.contains(words));
        mended += usize::from(fixed == 0);
    }
    assert!(wrong >= 10 && named >= 9 && mended >= 8, "{wrong} {named} {mended}");
}

/// Two mistakes at once: one after the other where each is seen behind the other, together where only both explain it.
#[test]
fn two_mistakes_at_once_are_mended() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    folder.succeed("localize right.json -o right_result.json");
    let truth = folder.json("right_result.json");
    let [w, h] = ["width", "height"].map(|name| right["cameras"][0][name].as_f64().unwrap());
    let half = |scene: &Value| with_boxes(scene, |b| b.map(|x| x * 0.5));
    let shares = |scene: &Value| with_boxes(scene, |b| [b[0] / w, b[1] / h, b[2] / w, b[3] / h]);
    let late = |scene: &Value| with_frames(scene, |k| Some(k + 1));
    let cases = [
        ("inverted and half", with_poses(&half(&right), inverse), Some(["camera_to_world", "image_size"])),
        ("inverted and shares", with_poses(&shares(&right), inverse), Some(["camera_to_world", "normalized_boxes"])),
        ("OpenGL and half", with_poses(&half(&right), opengl), Some(["opengl_axes", "image_size"])),
        ("inverted and late", with_poses(&late(&right), inverse), None),
        ("half and late", half(&late(&right)), None),
    ];
    for (case, scene, together) in cases {
        folder.write_json("wrong.json", &scene);
        let run = folder.run("localize wrong.json --json");
        assert_eq!(run.code, 3, "{case}: {}", run.stderr);
        let document: Value = serde_json::from_str(&run.stdout).unwrap();
        let diagnosis = &document["scenes"][0]["diagnosis"];
        if let Some(names) = together {
            assert_eq!(diagnosis["causes"], json!([]), "{case}");
            let found = diagnosis["together"].as_array().unwrap();
            assert_eq!(found.iter().map(|cause| cause["name"].as_str().unwrap()).collect::<Vec<_>>(), names, "{case}");
            let info = folder.succeed("info wrong.json");
            for cause in found {
                let option = cause["option"].as_str().unwrap();
                assert!(run.stderr.contains("two mistakes:") && run.stderr.contains(option), "{}", run.stderr);
                assert!(info.contains(option), "{info}");
            }
        }
        let text = folder.succeed("localize wrong.json -o fixed.json --fix");
        assert_eq!(text.matches("corrected: ").count(), 2, "{case}: {text}");
        let fixed = folder.json("fixed.json");
        for (object, same) in fixed["objects"].as_array().unwrap().iter().zip(truth["objects"].as_array().unwrap()) {
            let distance: f64 = (0..3)
                .map(|k| (object["center"][k].as_f64().unwrap() - same["center"][k].as_f64().unwrap()).powi(2))
                .sum();
            assert!(object["status"] == "ok" && distance.sqrt() < 0.5, "{case}: {distance} {object}");
        }
    }
}

/// Another convention in a part of the frames has no option: the frames are named, and nothing is corrected.
#[test]
fn frames_that_differ_are_named_and_stay() {
    let folder = Folder::new();
    let mut mixed = right_scene(&folder);
    let wrong = with_poses(&mixed, opengl);
    let names: Vec<Value> = mixed["frames"].as_array().unwrap().iter().map(|frame| frame["id"].clone()).collect();
    for k in (1..names.len()).step_by(2) {
        mixed["frames"][k] = wrong["frames"][k].clone();
    }
    folder.write_json("mixed.json", &mixed);
    for options in ["", "--fix", "--ids ignore --associate always"] {
        let run = folder.run(&format!("localize mixed.json -o out.json --json {options}"));
        assert!(run.code == 3 && run.stderr.contains("(2.jpg, 4.jpg, 6.jpg, 8.jpg, 10.jpg, 12.jpg)"), "{}", run.stderr);
        assert!(run.stderr.contains("OpenGL axes"), "{}", run.stderr);
        let document: Value = serde_json::from_str(&run.stdout).unwrap();
        let cause = &document["scenes"][0]["diagnosis"]["causes"][0];
        let named: Vec<Value> = names.iter().skip(1).step_by(2).cloned().collect();
        assert_eq!((&cause["name"], &cause["frames"]), (&json!("opengl_axes"), &json!(named)));
        assert_eq!((&cause["option"], &cause["value"]), (&Value::Null, &json!(0.5)));
    }
}

/// Boxes that only edges of half their size explain are not explained.
#[test]
fn what_no_object_explains_is_inconsistent() {
    let folder = Folder::new();
    folder.succeed("synth -o right.json --objects 8 --views 1 --cues box3d --trajectory random --noise box:0.02");
    folder.succeed("localize right.json");
    let mut wrong = folder.json("right.json");
    // 3D boxes in OpenGL's axes but for z: on the other side of the image.
    for detection in wrong["detections"].as_array_mut().unwrap() {
        for k in 0..2 {
            detection["box3d"]["center"][k] = json!(-detection["box3d"]["center"][k].as_f64().unwrap());
        }
    }
    folder.write_json("wrong.json", &wrong);
    let run = folder.run("localize wrong.json -o out.json");
    assert!(run.code == 3 && run.stderr.contains("do not explain the boxes"), "{}{}", run.stdout, run.stderr);
    assert!(folder.json("out.json")["objects"].as_array().unwrap().iter().all(|object| object["status"] != "ok"));
}

/// Outlines that contradict right boxes are left out, and named.
#[test]
fn outlines_that_contradict_the_boxes_are_left_out() {
    let folder = Folder::new();
    folder.succeed("synth -o right.json --objects 8 --views 8 --cues outline --noise box:0.02");
    folder.succeed("localize right.json -o right_result.json");
    let right = folder.json("right.json");
    for change in [|[x, y]: [f64; 2]| [y, x], |[x, y]: [f64; 2]| [0.5 * x, 0.5 * y]] {
        let mut wrong = right.clone();
        for detection in wrong["detections"].as_array_mut().unwrap() {
            let outline: Vec<[f64; 2]> = serde_json::from_value(detection["outline"].clone()).unwrap();
            detection["outline"] = json!(outline.into_iter().map(change).collect::<Vec<_>>());
        }
        folder.write_json("wrong.json", &wrong);
        let run = folder.run("localize wrong.json -o out.json");
        assert!(
            run.code == 0 && run.stderr.contains("the outlines contradict the boxes"),
            "{}{}",
            run.stdout,
            run.stderr
        );
        let [found, expected] = ["out.json", "right_result.json"].map(|name| folder.json(name)["objects"].clone());
        for (object, same) in found.as_array().unwrap().iter().zip(expected.as_array().unwrap()) {
            let square =
                |k: usize| (object["center"][k].as_f64().unwrap() - same["center"][k].as_f64().unwrap()).powi(2);
            let distance = (0..3).map(square).sum::<f64>().sqrt();
            assert!(object["status"] == "ok" && distance < 0.5, "{distance} {object}");
        }
    }
}

/// What was mended is not mended again.
#[test]
fn fixing_twice_changes_nothing() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    for mistake in mistakes(&right).into_iter().filter(|m| ["camera_to_world", "image_size"].contains(&m.name)) {
        folder.write_json("wrong.json", &mistake.scene);
        let text = folder.succeed("associate wrong.json -o once.json --ids trust --fix");
        assert!(text.contains("by --fix"), "{text}");
        let text = folder.succeed("associate once.json -o twice.json --ids trust --fix");
        assert!(!text.contains("corrected"), "{text}");
        for part in ["cameras", "frames", "detections"] {
            assert_eq!(folder.json("once.json")[part], folder.json("twice.json")[part], "{}", mistake.name);
        }
    }
}

/// Letterboxes need not be square: Ultralytics pads to multiples of 32.
#[test]
fn a_letterbox_may_be_of_any_shape() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    let [w, h] = ["width", "height"].map(|name| right["cameras"][0][name].as_f64().unwrap());
    for [width, height] in [[640.0, 384.0], [640.0, 640.0], [256.0, 480.0]] {
        let gain = f64::min(width / w, height / h);
        let margin = [0.5 * (width - gain * w), 0.5 * (height - gain * h)];
        let scene = with_boxes(&right, |b| [0, 1, 2, 3].map(|k| b[k] * gain + margin[k % 2]));
        folder.write_json("wrong.json", &scene);
        folder.succeed(&format!("associate wrong.json -o mended.json --ids trust --assume letterbox={width}x{height}"));
        let mended = folder.json("mended.json");
        for (a, b) in mended["detections"].as_array().unwrap().iter().zip(right["detections"].as_array().unwrap()) {
            for k in 0..4 {
                let [a, b] = [a, b].map(|detection| detection["box"][k].as_f64().unwrap());
                assert!((a - b).abs() < 1e-6, "{width}x{height}: {a} {b}");
            }
        }
    }
}

/// Boxes that are x, y, width, height make reversed corners: the message names the option, which mends them.
#[test]
fn reversed_boxes_point_to_the_box_format() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    folder.write_json("wrong.json", &with_boxes(&right, |b| [b[0], b[1], b[2] - b[0], b[3] - b[1]]));
    let run = folder.run("localize wrong.json");
    assert!(run.code == 1 && run.stderr.contains("--assume boxes=xywh"), "{}", run.stderr);
    assert!(folder.succeed("localize wrong.json --assume boxes=xywh").contains("8 of 8 objects localized"));
}

/// Mistakes that no convention explains: in `up`, the ids, the poses, the unit of lengths.
#[test]
fn mistakes_without_a_convention_are_named() {
    let folder = Folder::new();
    let right = right_scene(&folder);
    let check = |name: &str, scene: &Value, options: &str, words: &str, option: Option<&str>| {
        folder.write_json("wrong.json", scene);
        let run = folder.run(&format!("localize wrong.json -o out.json {options}"));
        assert!(run.code == 3 && run.stderr.contains(words), "{name}: {} {}", run.code, run.stderr);
        let result = folder.json("out.json");
        assert!(result["objects"].as_array().unwrap().iter().all(|o| o["status"] != "ok"), "{name}");
        let cause = &result["localization"]["diagnosis"]["causes"][0];
        assert_eq!((cause["name"].as_str(), cause["option"].as_str()), (Some(name), option));
        let Some(option) = option else { return };
        let mended = folder.run(&format!("localize wrong.json -o mended.json {options} {option}"));
        assert_eq!(mended.code, 0, "{name}: {}", mended.stderr);
        assert_eq!(folder.json("mended.json")["localization"]["diagnosis"]["consistent"], true, "{name}");
    };
    let mut scene = right.clone();
    scene["up"] = json!([0.0, 1.0, 0.0]);
    check("up", &scene, "", "\"up\" is not the direction", Some("--up z"));

    // Numbered anew in each frame.
    let mut scene = right.clone();
    let mut next = std::collections::BTreeMap::new();
    scene["detections"].as_array_mut().unwrap().sort_by(|a, b| {
        let x = |d: &Value| d["box"][0].as_f64().unwrap();
        x(a).total_cmp(&x(b))
    });
    for detection in scene["detections"].as_array_mut().unwrap() {
        let number = next.entry(detection["frame"].to_string()).or_insert(0);
        detection["object"] = json!(number.to_string());
        *number += 1;
    }
    scene.as_object_mut().unwrap().remove("objects");
    check("object_ids", &scene, "", "ids switch between", Some("--associate always --ids ignore"));

    // The last pose is held.
    let mut scene = right.clone();
    for frame in 7..12 {
        scene["frames"][frame]["cam_from_world"] = right["frames"][7]["cam_from_world"].clone();
    }
    check("duplicate_poses", &scene, "", "33 % of the frames repeat the pose of another frame", None);

    // Millimeters beside priors in meters.
    let mut scene = with_poses(&right, |pose| pose.map(|[a, b, c, t]| [a, b, c, 1000.0 * t]));
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["category"] = json!("thing");
    }
    let size = |k: usize| -> f64 {
        let objects = right["objects"].as_array().unwrap();
        objects.iter().map(|o| 2.0 * o["ellipsoid"]["semi_axes"][k].as_f64().unwrap()).sum::<f64>()
            / objects.len() as f64
    };
    let mean = [0, 1, 2].map(size);
    folder.write("priors.toml", format!("[thing]\nsize = {mean:?}\nsize_sd = {:?}\n", mean.map(|x| 0.3 * x)));
    check(
        "length_unit",
        &scene,
        "--priors priors.toml",
        "contradict the known object sizes",
        Some("--assume pose_unit=mm"),
    );
}
