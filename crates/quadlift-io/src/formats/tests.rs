//! Each format is recognized by its files and folders.

use super::*;

fn name_of(path: &Path) -> Result<&'static str, ReadError> {
    find_detections(path).map(|format| format.name)
}

#[test]
fn cameras_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let make = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    for name in ["c/sparse/0/cameras.txt", "n/transforms.json", "b/scene_camera.json", "r/oxts/data/0.txt"] {
        make(name, "x");
    }
    make("k/oxts/0000.txt", "x");
    make("k/calib/0000.txt", "x");
    make("t.json", r#"{"frames": [{"transform_matrix": [], "file_path": "a"}]}"#);
    make("p.json", r#"[{"id": "a", "projection": [1, 2]}]"#);
    make("o/reconstruction.json", "x");
    make("d/opensfm/reconstruction.json", "x");
    make("o.json", r#"[{"cameras": {}, "shots": {"a.jpg": {}}}]"#);
    make("a/keyframes/cameras/1.json", r#"{"t_00": 1}"#);
    make("g/frame_00000.json", r#"{"cameraPoseARFrame": []}"#);
    make("m/metadata", r#"{"K": [], "poses": []}"#);
    for table in ["scene", "sample", "sensor", "calibrated_sensor", "sample_data", "ego_pose"] {
        make(&format!("v/v1.0-mini/{table}.json"), "[]");
    }
    make("p.csv", "id,p11,p12,p13,p14,p21,p22,p23,p24,p31,p32,p33,p34\n");
    make("t.txt", "# time\n\n1.5 0 0 0 0 0 0 1\n");
    make("s.json", r#"{"format": "quadlift.scene", "version": 1}"#);
    std::fs::write(folder.path().join("l.bag"), b"\x89MCAP0\r\n").unwrap();
    for (name, format) in [
        ("l.bag", "mcap"),
        ("c", "colmap"),
        ("o", "opensfm"),
        ("d", "opensfm"),
        ("o.json", "opensfm"),
        ("n", "nerfstudio"),
        ("v", "nuscenes"),
        ("v/v1.0-mini", "nuscenes"),
        ("a", "arkit"),
        ("g", "arkit"),
        ("m", "arkit"),
        ("m/metadata", "arkit"),
        ("b", "bop"),
        ("r", "kitti-raw"),
        ("k", "kitti"),
        ("t.json", "nerfstudio"),
        ("p.json", "projections"),
        ("p.csv", "projections"),
        ("t.txt", "tum"),
        ("s.json", "scene file"),
    ] {
        assert_eq!(find_cameras(&folder.path().join(name)).unwrap().0.name, format, "{name}");
    }
    let model = folder.path().join("c/sparse/0");
    assert_eq!(find_cameras(&model.join("cameras.txt")).unwrap().1, model);
    make("u.txt", "hello\n");
    let error = find_cameras(&folder.path().join("u.txt")).unwrap_err();
    assert!(error.problem.contains("looked for a scene file, logs in MCAP, a COLMAP model"), "{error}");
    assert!(find_cameras(&folder.path().join("no")).unwrap_err().problem.contains("no such file"));
    // Nothing tells what these are.
    let row = "1,2,3,4,5,6,7,8,9,10,11,12";
    for text in [
        format!("# mine\n{row}\n"),
        format!("a.png,{row},640,480,a.png\n"),
        row.replace(',', " "),
        format!("{{\"a\": [{row}]}}"),
        "[[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]]".to_owned(),
    ] {
        make("matrices", &text);
        let error = find_cameras(&folder.path().join("matrices")).unwrap_err();
        assert!(error.problem.contains("the intrinsics are missing"), "{text}: {error}");
    }
}

#[test]
fn programs_whose_files_are_not_read_are_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, text, program) in [
        ("r.csv", "#name,x,y,alt,heading,pitch,roll,f,px\na.jpg,1,2,3,4,5,6,7,8\n", "RealityCapture"),
        ("s.csv", "name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\n", "RealityCapture"),
        (
            "o.txt",
            "# Cameras (2)\n# PhotoID, X, Y, Z, Omega, Phi, Kappa, r11, r12, r13, r21, r22, r23, r31, r32, r33\n",
            "Metashape",
        ),
        ("p.txt", "imageName X Y Z Omega Phi Kappa\na.jpg 1 2 3 4 5 6\n", "Metashape or Pix4D"),
        ("odometry.csv", "timestamp, frame, x, y, z, qx, qy, qz, qw\n", "Stray Scanner"),
        ("d.csv", "image,latitude,longitude,altitude,yaw\n", "a drone"),
        ("e.csv", "filename,lat,lon,height\n", "a drone"),
        ("f.csv", "#Label;X/Longitude;Y/Latitude;Z/Altitude;Yaw;Pitch;Roll\n", "a drone"),
        ("v.json", r#"{"sfm_data_version": "0.3", "views": []}"#, "OpenMVG"),
        ("c.sfm", r#"{"version": [], "views": [], "intrinsics": [], "poses": []}"#, "Meshroom"),
        ("shots.geojson", r#"{"type": "FeatureCollection", "features": []}"#, "OpenDroneMap"),
        ("a.xml", "<?xml version=\"1.0\"?>\n<document version=\"2.0.0\"><chunk/></document>", "Metashape"),
        ("a.json", r#"[{"segmentation": {}, "area": 1, "predicted_iou": 0.9, "bbox": [1, 2, 3, 4]}]"#, "SAM"),
        ("b.json", r#"{"image": {"image_id": 1}, "annotations": []}"#, "SAM"),
        ("g.json", r#"[{"value": 0, "label": "background"}]"#, "Grounded-SAM"),
        ("h.json", r#"{"image_path": "a.jpg", "annotations": [], "box_format": "xyxy"}"#, "Grounded-SAM"),
        ("i.json", r#"[{"image": "a.jpg", "annotations": [{"label": "cup", "coordinates": {}}]}]"#, "CreateML"),
        ("j.json", r#"[{"name": "a.jpg", "labels": [{"category": "car", "box2d": {}}]}]"#, "BDD"),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        for error in [find_cameras(&path).unwrap_err(), find_detections(&path).unwrap_err()] {
            assert!(error.problem.starts_with(&format!("this is a file of {program}")), "{name}: {error}");
        }
    }
    assert!(find_cameras(folder.path()).unwrap_err().problem.contains("Stray Scanner"));
}

#[test]
fn detections_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let cases = [
        ("a.json", r#"{"images": [], "annotations": []}"#, Some("coco")),
        ("b.json", r#"[{"image_id": 1, "bbox": [1, 2, 3, 4]}, {"x"#, Some("coco")),
        ("f.json", r#"[{"id": 1, "annotations": [], "data": {"image": "a"}}]"#, Some("label-studio")),
        ("g.json", r#"[{"image": "a", "id": 1, "annotator": 1, "annotation_id": 2}]"#, Some("label-studio")),
        ("c.json", r#"[{"x_min": 1, "tracker_id": 4}]"#, Some("csv")),
        ("d.json", r#"{"version": "5", "shapes": []}"#, Some("labelme")),
        ("e.json", r#"{"format": "quadlift.scene"}"#, None),
        ("a.csv", "x_min,y_min,x_max,y_max,class_id\n", Some("csv")),
        ("b.csv", "image,x0,y0,x1,y1\n", Some("csv")),
        (
            "boxer_3dbbs.csv",
            "time_ns,tx_world_object,ty_world_object,tz_world_object,qw_world_object,qx_world_object,qy_world_object,\
             qz_world_object,scale_x,scale_y,scale_z,name,instance,sem_id,prob\n",
            Some("boxer"),
        ),
        ("c.csv", "0,296.02,160.17,452.29,288.37,0.529\n", Some("csv")),
        ("d.csv", "a.png,296.02,160.17,452.29,288.37\n", Some("csv")),
        ("e.csv", "1,2,296.02,160.17,452.29,288.37\n", None),
        ("a.txt", "1,-1,794.2,47.5,71.2,174.8,67.5,-1,-1,-1\n", Some("mot")),
        ("b.txt", "1 3 794.2 47.5 71.2 174.8 0.9 0 -1\n", Some("mot")),
        ("c.txt", "45 0.479492 0.688771 0.955609 0.5955 0.91 7\n", Some("yolo")),
        ("d.txt", "0 1 Car 0 0 -1.9 1 2 3 4 1 2 3 4 5 6 1\n", Some("kitti-labels")),
        ("e.txt", "Car 0 0 -1.9 1 2 3 4 1 2 3 4 5 6 1 0.9\n", Some("kitti-labels")),
        ("f.txt", "hello world\n", None),
        ("a.xml", "<?xml version=\"1.0\"?>\n<!-- a < b -->\n<annotation verified=\"yes\">", Some("voc")),
        ("b.xml", "<annotations><version>1.1</version>", Some("cvat")),
        ("c.xml", "<annotated/>", None),
    ];
    for (name, text, format) in cases {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        assert_eq!(name_of(&path).ok(), format, "{name}");
    }
    let path = folder.path().join("n.json");
    for (text, place) in [("{\"annotations\": [NaN]}", "1:18"), ("[{\"image_id\": 1,}]", "1:17"), ("{\n\"ima", "2:4")] {
        std::fs::write(&path, text).unwrap();
        let error = find_detections(&path).unwrap_err().to_string();
        assert!(error.contains(&format!("n.json:{place}: this is not valid JSON")), "{error}");
    }
    let make = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, text).unwrap();
        path.parent().unwrap().to_owned()
    };
    make("yolo/labels/a.txt", "");
    make("yolo/labels/classes.txt", "cup\n");
    make("yolo/labels/b.txt", "0 0.5 0.5 0.1 0.1\n");
    assert_eq!(name_of(&folder.path().join("yolo")), Ok("yolo"));
    make("roboflow/README.dataset.txt", "# cups\n");
    make("roboflow/README.roboflow.txt", "cups - v1\n\nThis dataset was exported via roboflow.com\n");
    make("roboflow/train/labels/a_jpg.rf.0123456789abcdef.txt", "0 0.5 0.5 0.1 0.1\n");
    assert_eq!(name_of(&folder.path().join("roboflow")), Ok("yolo"));
    make("coco/README.dataset.txt", "# cups\n");
    make("coco/valid/_annotations.coco.json", "{}");
    assert_eq!(name_of(&folder.path().join("coco")), Ok("coco"));
    let labelme = make("labelme/a.json", r#"{"shapes": []}"#);
    assert_eq!(name_of(&labelme), Ok("labelme"));
    let voc = make("voc/Annotations/a.xml", "<annotation/>");
    assert_eq!(name_of(&voc), Ok("voc"));
    let cvat = make("cvat/annotations.xml", "<annotations/>");
    assert_eq!(name_of(&cvat), Ok("cvat"));
    make("mot/det/det.txt", "");
    assert_eq!(name_of(&folder.path().join("mot")), Ok("mot"));
    let error = find_detections(&make("other/a.txt", "hello\n")).unwrap_err();
    assert!(error.problem.contains("looked for MOTChallenge"), "{error}");
}
