use super::*;
use serde_json::{Value, json};

const K: [f64; 9] = [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0];

fn object(id: u64, t: [f64; 3]) -> Value {
    json!({"obj_id": id, "cam_R_m2c": [1, 0, 0, 0, 1, 0, 0, 0, 1], "cam_t_m2c": t})
}

/// Two frames; object 5 is the world, object 7 stands beside it (twice), object 8 moves.
fn scene() -> [Value; 4] {
    let camera = json!({"10": {"cam_K": K, "depth_scale": 1.0}, "2": {"cam_K": K}});
    let poses = json!({
        "2": [object(5, [0.0, 0.0, 1000.0]), object(7, [100.0, 0.0, 1000.0]), object(7, [-100.0, 0.0, 1000.0]),
              object(8, [0.0, 0.0, 900.0])],
        "10": [object(5, [50.0, 0.0, 800.0]), object(7, [150.0, 0.0, 800.0]), object(7, [-50.0, 0.0, 800.0]),
               object(8, [500.0, 0.0, 800.0])],
    });
    let entry = |x: i32| json!({"bbox_obj": [x, 20, 30, 40], "bbox_visib": [-1, -1, -1, -1], "visib_fract": 0.25});
    let info = json!({"2": [entry(1), entry(2), entry(3), entry(4)], "10": [entry(1), entry(2), entry(3), entry(4)]});
    let model = json!({"min_x": -10, "min_y": -20, "min_z": 0, "size_x": 20, "size_y": 40, "size_z": 60});
    let models = json!({"5": model, "7": model, "8": model, "9": model});
    [camera, poses, info, models]
}

fn parse(scene: &[Value; 4], world_object: Option<u64>) -> Result<Import, ReadError> {
    let texts = scene.clone().map(|value| value.to_string());
    let file = |name: &'static str, index: usize| (Path::new(name), texts[index].as_bytes());
    let files = BopFiles {
        camera: file("scene_camera.json", 0),
        ground_truth: Some(file("scene_gt.json", 1)),
        info: Some(file("scene_gt_info.json", 2)),
        models: Some(file("models_info.json", 3)),
    };
    parse_bop(files, world_object, Some([640.0, 480.0]))
}

#[test]
fn an_object_is_the_world() {
    let import = parse(&scene(), Some(5)).unwrap();
    let scene = &import.scene;
    assert_eq!(scene.frames.iter().map(|frame| frame.id.as_str()).collect::<Vec<_>>(), ["000002", "000010"]);
    assert_eq!(scene.cameras.len(), 1);
    assert_eq!(scene.cameras[0].params, [500.0, 501.0, 320.5, 240.5]);
    let pose = scene.frames[1].cam_from_world.unwrap();
    assert_eq!([pose[0][3], pose[1][3], pose[2][3]], [0.05, 0.0, 0.8]);
    // The models' boxes begin at z = 0: their centers are 30 mm above.
    let objects: Vec<_> = scene.objects.iter().map(|o| (o.id.as_str(), o.cuboid.as_ref().unwrap())).collect();
    assert_eq!(objects.iter().map(|o| o.0).collect::<Vec<_>>(), ["obj_000005", "obj_000007_1", "obj_000007_2"]);
    for (object, expected) in objects.iter().zip([[0.0, 0.0, 0.03], [0.1, 0.0, 0.03], [-0.1, 0.0, 0.03]]) {
        assert!((0..3).all(|i| (object.1.center[i] - expected[i]).abs() < 1e-12), "{object:?}");
        assert_eq!(object.1.half_extents, [0.01, 0.02, 0.03]);
    }
    assert!(
        import.notes.iter().any(|note| note.contains("1 objects move in the world") && note.contains("obj_000008"))
    );
    // Boxes from the first to the last pixel; the invisible ones are left out.
    assert_eq!(scene.detections.len(), 8);
    let detection = &scene.detections[1];
    assert_eq!(detection.bounding_box, Some([2.0, 20.0, 33.0, 61.0]));
    assert_eq!((detection.object.as_deref(), detection.source.as_deref()), (Some("obj_000007_1"), Some("bbox_obj")));
    assert_eq!(detection.mask.as_ref().unwrap().path.as_deref(), Some("mask/000002_000001.png"));
    assert_eq!(detection.visible_fraction, Some(0.25));
}

#[test]
fn poses_of_the_camera_file_are_the_world() {
    let mut scene = scene();
    for frame in ["2", "10"] {
        scene[0][frame]["cam_R_w2c"] = json!([1, 0, 0, 0, 1, 0, 0, 0, 1]);
        scene[0][frame]["cam_t_w2c"] = json!([0, 0, 2000]);
    }
    let scene = parse(&scene, None).unwrap().scene;
    assert_eq!(scene.frames[0].cam_from_world.unwrap()[2][3], 2.0);
}

#[test]
fn frames_without_the_world_object_are_left_out() {
    let mut scene = scene();
    scene[1]["2"] = json!([object(7, [0.0, 0.0, 500.0])]);
    let import = parse(&scene, Some(5)).unwrap();
    assert_eq!(import.scene.frames.len(), 1);
    assert!(import.notes.contains(&"1 frame without the world object was skipped".to_owned()));
}

#[test]
fn what_is_wrong_is_named_with_its_entry() {
    let message = |change: &dyn Fn(&mut [Value; 4]), world| {
        let mut scene = scene();
        change(&mut scene);
        parse(&scene, world).unwrap_err().to_string()
    };
    insta::assert_snapshot!(message(&|_| {}, None), @r#"scene_camera.json: 2: there is no world pose ("cam_R_w2c"); choose the object whose model frame is the world (--world-object ID): 5, 7, 8"#);
    insta::assert_snapshot!(message(&|_| {}, Some(6)), @"scene_gt.json: no frame has a pose of object 6; there are poses of 5, 7, 8");
    insta::assert_snapshot!(message(&|_| {}, Some(7)), @"scene_gt.json: object 7 appears several times in frame 2; the world frame must be unique");
    insta::assert_snapshot!(message(&|s| s[0]["2"]["cam_K"] = json!([1, 2]), Some(5)), @"scene_camera.json: 2.cam_K: found a list of 2, expected a list of 9 numbers");
    insta::assert_snapshot!(message(&|s| s[0]["2"]["cam_K"][1] = json!(3), Some(5)), @"scene_camera.json: 2.cam_K: expected [fx, 0, cx, 0, fy, cy, 0, 0, 1]");
    insta::assert_snapshot!(message(&|s| s[0]["x"] = json!(3), Some(5)), @r#"scene_camera.json: found the key "x", expected a number"#);
    insta::assert_snapshot!(message(&|s| s[1]["2"][1]["obj_id"] = json!("7"), Some(5)), @r#"scene_gt.json: 2[1].obj_id: found the text "7", expected a whole number"#);
    insta::assert_snapshot!(message(&|s| s[1]["2"][1]["cam_R_m2c"][0] = json!(2), Some(5)), @"scene_gt.json: 2[1]: the 3x3 part of cam_R_m2c is not a rotation (|R R^T - I| is 3.000e0, at most 1e-3 is accepted)");
    insta::assert_snapshot!(message(&|s| s[2]["2"] = json!([]), Some(5)), @"scene_gt_info.json: 2: found 0 entries, and scene_gt.json has 4");
    insta::assert_snapshot!(message(&|s| s[3]["5"]["size_y"] = json!(null), Some(5)), @r#"models_info.json: 5: there is no "size_y""#);
}
