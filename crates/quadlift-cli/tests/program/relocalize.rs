//! `quadlift relocalize`, through the built program.

use crate::common::Folder;
use serde_json::{Value, json};

/// A map from the even frames of a synthetic scene (`map.json`), and the odd frames without poses and ids (`query.json`); the
/// poses that were taken away, by frame.
fn map_and_query(folder: &Folder) -> Vec<(String, Value)> {
    map_and_query_of(folder, "--objects 12 --views 10 --seed 5 --noise box:0.03", 0)
}

/// `categories`: number of categories, 0 for none.
fn map_and_query_of(folder: &Folder, synth: &str, categories: usize) -> Vec<(String, Value)> {
    folder.succeed(&format!("synth -q -o scene.json {synth}"));
    let mut scene = folder.json("scene.json");
    let objects: Vec<Value> = scene["objects"].as_array().unwrap().iter().map(|object| object["id"].clone()).collect();
    for detection in scene["detections"].as_array_mut().unwrap().iter_mut().filter(|_| categories > 0) {
        let place = objects.iter().position(|id| *id == detection["object"]).unwrap();
        detection["category"] = format!("kind {}", place % categories).into();
    }
    let frames = scene["frames"].as_array().unwrap();
    let ids: Vec<&str> = frames.iter().map(|frame| frame["id"].as_str().unwrap()).collect();
    let half = |odd: bool| {
        let is_of_half = |id: &Value| ids.iter().position(|name| id == name).unwrap() % 2 == usize::from(odd);
        let mut half = scene.clone();
        half["frames"].as_array_mut().unwrap().retain(|frame| is_of_half(&frame["id"]));
        half["detections"].as_array_mut().unwrap().retain(|detection| is_of_half(&detection["frame"]));
        half.as_object_mut().unwrap().remove("objects");
        half
    };
    folder.write_json("half.json", &half(false));
    folder.succeed("localize -q half.json -o map.json");
    let mut query = half(true);
    let taken = query["frames"].as_array_mut().unwrap().iter_mut().map(|frame| {
        let pose = frame.as_object_mut().unwrap().remove("cam_from_world").unwrap();
        (frame["id"].as_str().unwrap().to_owned(), pose)
    });
    let taken = taken.collect();
    for detection in query["detections"].as_array_mut().unwrap() {
        detection.as_object_mut().unwrap().remove("object");
    }
    folder.write_json("query.json", &query);
    taken
}

/// Distance of the centers of two cameras.
fn apart(a: &Value, b: &Value) -> f64 {
    let number = |pose: &Value, i: usize, j: usize| pose[i][j].as_f64().unwrap();
    let center =
        |pose: &Value| [0, 1, 2].map(|j| -(0..3).map(|i| number(pose, i, j) * number(pose, i, 3)).sum::<f64>());
    let (a, b) = (center(a), center(b));
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn frames_get_their_poses_and_detections_the_ids_of_the_map() {
    let folder = Folder::new();
    let taken = map_and_query(&folder);
    let text = folder.succeed("relocalize map.json query.json -o located.json");
    assert!(text.contains("query.json: located 5 of 5 frames in 12 objects"), "{text}");
    let located = folder.json("located.json");
    for (frame, (id, truth)) in located["frames"].as_array().unwrap().iter().zip(&taken) {
        assert_eq!((frame["id"].as_str(), &frame["location"]["status"]), (Some(id.as_str()), &json!("ok")));
        let sd = frame["location"]["position_sd"].as_f64().unwrap();
        assert!(apart(&frame["cam_from_world"], truth) < 5.0 * sd, "{frame}");
        assert!(frame["location"]["inliers"].as_array().unwrap().len() >= 10);
    }
    // The ids are those of the map, which are those of the scene.
    let scene = folder.json("scene.json");
    let true_id = |detection: &Value| {
        let all = scene["detections"].as_array().unwrap();
        all.iter().find(|d| d["frame"] == detection["frame"] && d["box"] == detection["box"]).unwrap()["object"].clone()
    };
    let detections = located["detections"].as_array().unwrap();
    let named: Vec<&Value> = detections.iter().filter(|d| !d["object"].is_null()).collect();
    assert!(named.len() >= 50 && named.iter().all(|d| d["object"] == true_id(d)));
    assert_eq!(located["objects"], folder.json("map.json")["objects"]);
    // Other commands read it, and the same input gives the same bytes.
    folder.succeed("localize -q located.json -o again.json");
    folder.succeed("relocalize -q map.json query.json -o second.json --threads 1");
    assert_eq!(folder.read("located.json"), folder.read("second.json"));
}

#[test]
fn known_gravity_needs_two_boxes_and_frames_without_a_pose_can_be_left_out() {
    let folder = Folder::new();
    let taken = map_and_query(&folder);
    let mut query = folder.json("query.json");
    let frames: Vec<Value> = query["frames"].as_array().unwrap().iter().map(|frame| frame["id"].clone()).collect();
    // Two boxes in the first frame, none in the second one; the given ids of the map are wrong.
    let mut kept = 0;
    query["detections"].as_array_mut().unwrap().retain_mut(|detection| {
        detection["object"] = json!(format!("track {kept}"));
        if detection["frame"] == frames[0] {
            kept += 1;
        }
        (detection["frame"] != frames[0] || kept <= 2) && detection["frame"] != frames[1]
    });
    // Up is the third axis of the world.
    let up: Vec<f64> = (0..3).map(|row| taken[0].1[row][2].as_f64().unwrap()).collect();
    query["frames"][0]["up_in_camera"] = json!(up);
    folder.write_json("query.json", &query);
    let report: Value =
        serde_json::from_str(&folder.succeed("relocalize map.json query.json -o out.json --drop-unposed --json"))
            .unwrap();
    let status: Vec<&str> =
        report["frames"].as_array().unwrap().iter().map(|f| f["status"].as_str().unwrap()).collect();
    assert_eq!(status, ["ok", "too_few_objects", "ok", "ok", "ok"]);
    let of_two = &report["frames"][0];
    assert_eq!(of_two["inliers"].as_array().unwrap().len(), 2);
    assert!(apart(&of_two["cam_from_world"], &taken[0].1) < 5.0 * of_two["position_sd"].as_f64().unwrap(), "{of_two}");
    let out = folder.json("out.json");
    assert_eq!(out["frames"].as_array().unwrap().len(), 4);
    let detections = out["detections"].as_array().unwrap();
    assert!(
        detections.iter().all(|d| d["frame"] != frames[1] && d["given_object"].as_str().unwrap().starts_with("track"))
    );
    assert!(detections.iter().filter(|d| d["frame"] == frames[0]).count() == 2);
    // Without the option the frames stay, without poses.
    folder.succeed("relocalize -q map.json query.json -o out.json");
    let out = folder.json("out.json");
    assert!(out["frames"].as_array().unwrap().len() == 5 && out["frames"][1]["cam_from_world"].is_null());
}

#[test]
fn poses_that_are_known_are_kept_unless_all_are_asked_for() {
    let folder = Folder::new();
    map_and_query(&folder);
    let refused = folder.run("relocalize map.json scene.json -o out.json");
    assert!(
        refused.code == 1 && refused.stderr.contains("all 10 frames have a pose (--include-posed"),
        "{}",
        refused.stderr
    );
    let text = folder.succeed("relocalize map.json scene.json -o out.json --include-posed");
    assert!(text.contains("located 10 of 10 frames"), "{text}");
    let (scene, out) = (folder.json("scene.json"), folder.json("out.json"));
    let changed = |k: usize| scene["frames"][k]["cam_from_world"] != out["frames"][k]["cam_from_world"];
    assert!((0..10).all(changed));
    // True objects are not overwritten by those of the map.
    assert_eq!(scene["objects"], out["objects"]);
}

#[test]
fn hostile_maps_and_images_are_answered() {
    let folder = Folder::new();
    map_and_query_of(&folder, "--objects 8 --views 10 --seed 5 --noise box:0.03", 0);
    let map = folder.json("map.json");
    let with_objects = |name: &str, change: &dyn Fn(&mut Vec<Value>)| {
        let mut changed = map.clone();
        change(changed["objects"].as_array_mut().unwrap());
        folder.write_json(name, &changed);
    };
    let statuses = |arguments: &str| -> Vec<String> {
        let run = folder.run(&format!("relocalize {arguments} -o out.json --json"));
        let document: Value =
            serde_json::from_str(&run.stdout).unwrap_or_else(|_| panic!("{} {}", run.stdout, run.stderr));
        document["frames"].as_array().unwrap().iter().map(|f| f["status"].as_str().unwrap().to_owned()).collect()
    };
    with_objects("empty.json", &|objects| objects.clear());
    let refused = folder.run("relocalize empty.json query.json -o out.json");
    assert!(refused.code == 1 && refused.stderr.contains("empty.json: there are no objects"), "{}", refused.stderr);
    with_objects("two.json", &|objects| objects.truncate(2));
    // Two of the boxes may show them, and a third one agrees with no pose.
    assert_eq!(statuses("two.json query.json"), ["no_pose"; 5]);
    // All alike, in one row: a turn about the row changes no box, and each object may be any other one.
    with_objects("row.json", &|objects| {
        for (k, object) in objects.iter_mut().enumerate() {
            let center = json!([2.0 * k as f64, 0.0, 0.0]);
            let ball = json!({"center": center, "semi_axes": [0.5, 0.5, 0.5], "rotation": [1, 0, 0, 0]});
            *object = json!({"id": k.to_string(), "ellipsoid": ball});
        }
    });
    let of_row = statuses("row.json query.json");
    assert!(of_row.iter().all(|status| status != "ok"), "{of_row:?}");
    // Millimeters: the same poses in the unit of the map.
    with_objects("mm.json", &|objects| {
        for object in objects.iter_mut() {
            let body = object["body"].clone();
            let scaled = |field: &str| {
                body[field].as_array().unwrap().iter().map(|x| 1e3 * x.as_f64().unwrap()).collect::<Vec<_>>()
            };
            let (center, semi_axes) = (scaled("center"), scaled("half_extents"));
            let ellipsoid = json!({"center": center, "semi_axes": semi_axes, "rotation": body["rotation"]});
            *object = json!({"id": object["id"], "ellipsoid": ellipsoid});
        }
    });
    assert_eq!(statuses("mm.json query.json"), ["ok"; 5]);
    // Categories that the map has not.
    with_objects("named.json", &|objects| objects.iter_mut().for_each(|object| object["category"] = json!("cup")));
    let mut query = folder.json("query.json");
    query["detections"].as_array_mut().unwrap().iter_mut().for_each(|d| d["category"] = json!("chair"));
    folder.write_json("chairs.json", &query);
    let run = folder.run("relocalize named.json chairs.json -o out.json");
    assert!(run.code == 1 && run.stderr.contains("no object of the map has the category chair"), "{}", run.stderr);
    // Wrong records and options.
    for (change, expected) in [
        (json!({"id": "a"}), "frames[0]: there is no \"camera\"; a frame without a pose needs one"),
        (json!({"id": "a", "camera": "none"}), "unknown camera \"none\""),
        (
            json!({"id": "a", "camera": query["frames"][0]["camera"], "up_in_camera": [0, 0, 0]}),
            "frames[0].up_in_camera: [0,0,0] is not a direction",
        ),
    ] {
        query["frames"][0] = change;
        folder.write_json("wrong.json", &query);
        let run = folder.run("relocalize map.json wrong.json -o out.json");
        assert!(run.code == 1 && run.stderr.contains(expected), "{}", run.stderr);
    }
    assert_eq!(folder.run("relocalize map.json query.json -o out.json --up-in-camera 0,0,0").code, 2);
    assert_eq!(folder.run("relocalize map.json query.json -o out.json --camera-height 1").code, 2);
    assert_eq!(folder.run("relocalize map.json query.json -o map.json").code, 2);
}

#[test]
fn images_of_another_size_do_not_fit_the_map() {
    let folder = Folder::new();
    // Cameras among the objects: far away a smaller image is one from a larger distance.
    map_and_query_of(&folder, "--objects 16 --views 10 --seed 5 --noise box:0.03 --trajectory random --cube 60", 4);
    let mut query = folder.json("query.json");
    for detection in query["detections"].as_array_mut().unwrap() {
        detection["box"].as_array_mut().unwrap().iter_mut().for_each(|x| *x = (0.5 * x.as_f64().unwrap()).into());
    }
    folder.write_json("query.json", &query);
    let run = folder.run("relocalize map.json query.json -o located.json");
    let words = "the boxes were measured at another image size: multiply their coordinates by 2.0";
    assert!(run.code == 3 && run.stderr.contains(words), "{} {}", run.code, run.stderr);
    let frames = |folder: &Folder| folder.json("located.json")["frames"].as_array().unwrap().clone();
    assert!(frames(&folder).iter().all(|frame| frame.get("cam_from_world").is_none()));
    assert!(frames(&folder).iter().all(|frame| frame["location"]["status"] != "ok"));
    let run = folder.run("relocalize map.json query.json -o located.json --allow-inconsistent --json");
    let told: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!((run.code, &told["mistake"]["name"]), (0, &json!("image_size")));
}

/// A map of cuboids and cylinders predicts their boxes, not those of the ellipsoids closest to them.
#[test]
fn images_of_rooms_of_boxes_and_cans_are_located() {
    let folder = Folder::new();
    folder.succeed("synth -q -o room.json --objects 15 --views 12 --noise box:0.03 --body cuboid,cuboid,cylinder");
    folder.succeed("localize -q room.json -o map.json");
    let kinds = |kind: &str| {
        let map = folder.json("map.json");
        map["objects"].as_array().unwrap().iter().filter(|object| object["body"]["kind"] == kind).count()
    };
    assert!(kinds("cuboid") > 4 && kinds("cylinder") > 2);
    folder.succeed("relocalize -q map.json room.json --include-posed -o located.json");
    let (located, truth) = (folder.json("located.json"), folder.json("room.json"));
    for (frame, given) in located["frames"].as_array().unwrap().iter().zip(truth["frames"].as_array().unwrap()) {
        assert_eq!(frame["location"]["status"], "ok", "{frame}");
        // 2 % of their distance from the middle.
        let off = apart(&frame["cam_from_world"], &given["cam_from_world"]);
        assert!(off < 4.0, "{}: {off}", frame["id"]);
    }
}
