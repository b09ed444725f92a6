//! Maps and queries of scene files.

use quadlift::geometry::BodyKind;
use quadlift::nalgebra::Vector3;
use quadlift::relocalize::LocateOptions;

use crate::scene_file::{DetectionRecord, FrameRecord, SceneFile, parse_scene_file};

const QUERY: &str = r#"{
  "format": "quadlift.scene", "version": 1,
  "cameras": [
    {"id": "phone", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 510, 320, 240]},
    {"id": "wide", "model": "SIMPLE_RADIAL", "width": 640, "height": 480, "params": [500, 320, 240, -0.1]}
  ],
  "frames": [
    {"id": "a", "camera": "phone", "up_in_camera": [0, -2, 0]},
    {"id": "b", "camera": "wide"},
    {"id": "c", "camera": "phone", "cam_from_world": [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0]]}
  ],
  "detections": [
    {"frame": "b", "category": "cup", "box": [1, 10, 60, 50], "object": "1"},
    {"frame": "a", "category": "cup", "box": [10, 10, 60, 50], "score": 0.4},
    {"frame": "a", "category": "tin", "ellipse": {"center": [100, 100], "semi_axes": [20, 10], "angle": 0}},
    {"frame": "c", "box": [10, 10, 60, 50]}
  ]
}"#;

fn query() -> SceneFile {
    parse_scene_file("query.json".as_ref(), QUERY.as_bytes()).unwrap()
}

#[test]
fn frames_without_a_pose_become_queries() {
    let scene = query().to_queries(false).unwrap();
    assert_eq!(scene.posed(), 1);
    let frames = scene.queries(None, None).unwrap();
    assert_eq!(
        frames.iter().map(|f| (f.frame_index, f.detections.clone())).collect::<Vec<_>>(),
        [(0, vec![1, 2]), (1, vec![0])]
    );
    assert_eq!(frames[0].up_in_camera.unwrap().into_inner(), -Vector3::y());
    let query = &frames[0].query;
    assert!(
        (query.intrinsics.matrix() - quadlift::geometry::Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap().matrix())
            .norm()
            < 1e-9
    );
    assert_eq!(query.boxes[1].bounding_box.edges(), [80.0, 90.0, 120.0, 110.0]);
    assert_eq!(query.boxes[1].category.as_deref(), Some("tin"));
    // Of a lens: without its distortion, and where the border cuts it.
    let bent = &frames[1].query.boxes[0];
    assert_eq!(bent.box_in_image.unwrap().edges(), [1.0, 10.0, 60.0, 50.0]);
    assert!(bent.bounding_box.x0() < 0.0, "{bent:?}");
    let scored = scene.queries(None, Some(0.5)).unwrap();
    assert_eq!(scored[0].detections, [2]);
    assert_eq!(query_of_all(), 3);
}

fn query_of_all() -> usize {
    query().to_queries(true).unwrap().queries(None, None).unwrap().len()
}

#[test]
fn sources_are_chosen_and_wrong_entries_are_named() {
    let mut file = query();
    file.detections[0].source = Some("yolo".into());
    let scene = file.to_queries(false).unwrap();
    assert!(scene.queries(None, None).unwrap_err().to_string().contains("yolo"));
    assert_eq!(scene.queries(Some("yolo"), None).unwrap()[0].detections.len(), 0);
    let mut file = query();
    file.detections.push(DetectionRecord {
        frame: "d".into(),
        bounding_box: Some([0.0, 0.0, 1.0, 1.0]),
        ..Default::default()
    });
    assert_eq!(file.to_queries(false).unwrap_err().entry, "detections[4].frame");
    let mut file = query();
    file.frames.push(FrameRecord { id: "d".into(), ..Default::default() });
    assert_eq!(
        file.to_queries(false).unwrap_err().to_string(),
        "frames[3]: there is no \"camera\"; a frame without a pose needs one"
    );
}

#[test]
fn objects_that_were_localized_become_landmarks() {
    let text = r#"{"format": "quadlift.scene", "version": 1, "objects": [
        {"id": "a", "status": "ok", "category": "cup", "ellipsoid": {"center": [1, 2, 3], "semi_axes": [1, 1, 2], "rotation": [1, 0, 0, 0]}},
        {"id": "b", "status": "degenerate", "center": [0, 0, 0]},
        {"id": "c", "cuboid": {"center": [1, 2, 3], "half_extents": [1, 1, 1], "rotation": [1, 0, 0, 0]}},
        {"id": "d", "ellipsoid": {"center": [1, 2, 3], "semi_axes": [1, 1, 2], "rotation": [1, 0, 0, 0]}, "memory": {"presence": "gone"}}
    ], "localization": {"noise": {"edge_noise": 0.03, "edge_noise_px": 2, "edge_common": 0.75}}}"#;
    let file = parse_scene_file("map.json".as_ref(), text.as_bytes()).unwrap();
    let map = file.to_landmarks().unwrap();
    assert_eq!((map.ids, map.left_out), (vec!["a".to_owned(), "c".to_owned()], 2));
    let body = |k: usize| (map.landmarks[k].body.kind, map.landmarks[k].body.half_extents);
    assert_eq!(body(0), (BodyKind::Ellipsoid, Vector3::new(1.0, 1.0, 2.0)));
    assert_eq!(body(1), (BodyKind::Cuboid, Vector3::repeat(1.0)));
    let options = LocateOptions::with_noise(&file.noise_levels().unwrap(), &map.landmarks);
    assert!(options.edge_noise == 0.03 && options.edge_noise_px == 2.0);
    assert!((options.common_share - 0.36).abs() < 1e-12);
}

/// A ball in four images, whose boxes are a fifth larger than the body.
const MAP: &str = r#"{"format": "quadlift.scene", "version": 1,
    "cameras": [{"id": "c", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
    "frames": [
        {"id": "a", "camera": "c", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 10]]},
        {"id": "b", "camera": "c", "cam_from_world": [[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 10]]},
        {"id": "c", "camera": "c", "cam_from_world": [[-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -1, 10]]},
        {"id": "d", "camera": "c"}
    ],
    "detections": [
        {"frame": "a", "object": "ball", "box": [260, 180, 380, 300]},
        {"frame": "b", "object": "ball", "box": [260, 180, 380, 300]},
        {"frame": "c", "object": "ball", "box": [260, 180, 380, 300]}
    ],
    "objects": [{"id": "ball", "status": "ok", "ellipsoid": {"center": [0, 0, 0], "semi_axes": [1, 1, 1], "rotation": [1, 0, 0, 0]}}]}"#;

#[test]
fn estimates_are_corrected_by_the_detections_that_they_rest_on() {
    let file = || parse_scene_file("map.json".as_ref(), MAP.as_bytes()).unwrap();
    let is_corrected = |file: &SceneFile| file.to_landmarks().unwrap().landmarks[0].correction.is_some();
    assert!(is_corrected(&file()));
    let mut truth = file();
    truth.objects[0].status = None;
    assert!(!is_corrected(&truth), "a true body has no residuals");
    let mut rejected = file();
    rejected.objects[0].views_rejected = ["a", "b", "c"].map(str::to_owned).to_vec();
    assert!(!is_corrected(&rejected));
    let mut other = file();
    other.localization = Some(serde_json::json!({"settings": {"source": "yolo"}}));
    assert!(!is_corrected(&other), "its detections have no source");
}
