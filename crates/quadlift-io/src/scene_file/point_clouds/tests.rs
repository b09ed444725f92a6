//! Depths of points: which points count for which detection, and where.

use serde::Serialize;
use serde_json::{Value, json};

use super::*;

/// Two cameras at the origin and 1 to the right, looking along z; one detection of an object in each, 10 away and 2 wide.
fn file() -> Value {
    json!({
        "format": "quadlift.scene", "version": 1,
        "cameras": [{"id": "c", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
        "frames": [
            {"id": "a", "camera": "c", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]},
            {"id": "b", "camera": "c", "cam_from_world": [[1, 0, 0, -1], [0, 1, 0, 0], [0, 0, 1, 0]]},
        ],
        "detections": [
            {"frame": "a", "object": "o", "box": [270, 190, 370, 290]},
            {"frame": "b", "object": "o", "box": [220, 190, 320, 290]},
        ],
    })
}

/// What is found, with the depths of the two detections and whether no scale is estimated.
fn depths(value: Value, folder: &Path) -> (DepthsFound, Vec<Option<f64>>, bool) {
    let file: SceneFile = serde_json::from_value(value).unwrap();
    let mut scene = file.to_scene().unwrap();
    let found = file
        .add_depths_of_points(&folder.join("scene.json"), &mut scene, None, &|_, _| std::ops::ControlFlow::Continue(()))
        .unwrap();
    let depth = |d: &quadlift::scene::Detection| Some(d.cues.as_deref()?.depth?.median);
    (found, scene.detections.iter().map(depth).collect(), !scene.scale_known.is_empty())
}

#[test]
fn the_points_that_a_frame_observed_give_its_detection_a_depth_once() {
    let mut value = file();
    // Seven on the near side, one far behind.
    let near: Vec<[f64; 3]> = (0..7).map(|k| [0.1 * f64::from(k) - 0.3, 0.05, 9.0 + 0.01 * f64::from(k)]).collect();
    value["points"] = json!(near.iter().chain(&[[0.0, 0.0, 30.0]]).collect::<Vec<_>>());
    // Nobody says who saw them: they are drawn only.
    let plain: SceneFile = serde_json::from_value(value.clone()).unwrap();
    assert!(!plain.has_points_of_frames());
    value["frames"][0]["observed_points"] = json!([0, 1, 2, 7]);
    value["frames"][1]["observed_points"] = json!([3, 4, 5, 6]);
    let none = Path::new("");
    // The view with more points keeps its depth.
    let (found, each, known) = depths(value.clone(), none);
    assert_eq!((found.detections, found.without, found.repeated), (1, 0, 1));
    assert_eq!((each, known), (vec![None, Some(9.05)], true));
    // Of as many the first one, or the one with points that others have, too.
    value["frames"][0]["observed_points"] = json!([0, 1, 2, 3]);
    assert_eq!(depths(value.clone(), none).1, [Some(9.02), None]);
    let mut third = value.clone();
    for (list, id) in [("frames", "id"), ("detections", "frame")] {
        let mut again = third[list][1].clone();
        again[id] = json!("c");
        third[list].as_array_mut().unwrap().push(again);
    }
    third["frames"][2]["observed_points"] = json!([4, 5, 6]);
    assert_eq!(depths(third, none).1, [None, Some(9.05), None]);
    // Other objects have a depth of their own.
    value["detections"][0]["object"] = json!("p");
    assert_eq!(depths(value.clone(), none).0.detections, 2);
    // A depth of its own stays, and a source of that name may have a scale.
    value["detections"][0]["depth"] = json!({"median": 5.0});
    value["cue_sources"] = json!({"points": {"scale": "scene"}});
    let (found, each, known) = depths(value.clone(), none);
    assert_eq!((found.detections, each[0], known), (1, Some(5.0), false));
    value["frames"][1]["observed_points"] = json!([8]);
    let refused = |value: &Value| {
        let file: SceneFile = serde_json::from_value(value.clone()).unwrap();
        let error = file.to_scene().unwrap_err();
        (error.entry, error.problem)
    };
    let (entry, problem) = refused(&value);
    assert_eq!(entry, "frames[1].observed_points[0]");
    assert_eq!(problem, "found 8; expected the number of a point from 0, of the scene's 8");
    value["frames"][1]["observed_points"] = json!([3, 4]);
    value["frames"][1]["observed_pixels"] = json!([[1.0, 2.0]]);
    let (entry, problem) = refused(&value);
    assert_eq!(entry, "frames[1].observed_pixels");
    assert_eq!(problem, "found 1 pixel; expected one for each of the 2 points in \"observed_points\"");
    value["frames"][1].as_object_mut().unwrap().remove("observed_points");
    assert_eq!(refused(&value).1, "found 1 pixel; expected one for each of the 0 points in \"observed_points\"");
}

#[test]
fn clouds_are_mapped_to_the_camera_or_the_world() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, points: &[[f64; 3]]| {
        let lines: Vec<String> = points.iter().map(|p| format!("{} {} {}", p[0], p[1], p[2])).collect();
        std::fs::write(folder.path().join(name), lines.join("\n")).unwrap();
    };
    let grid = |z: f64| (0..64).map(move |k| [0.2 * f64::from(k % 8) - 0.7, 0.2 * f64::from(k / 8) - 0.7, z]);
    write("near.xyz", &grid(9.0).collect::<Vec<_>>());
    // Axes of a LiDAR: x forwards, y to the left, z up, half as large.
    write("lidar.xyz", &grid(9.0).map(|[x, y, z]| [z / 2.0, -x / 2.0, -y / 2.0]).collect::<Vec<_>>());
    write("right.xyz", &grid(9.0).map(|[x, y, z]| [x + 1.0, y, z]).collect::<Vec<_>>());
    write("through.xyz", &grid(9.0).chain(grid(9.5)).chain(grid(30.0)).collect::<Vec<_>>());
    let of_frame = |cloud: Value| {
        let mut value = file();
        // Where the camera of frame b is, the object is in the middle of the image.
        value["detections"][1]["box"] = json!([270, 190, 370, 290]);
        value["frames"][1]["point_cloud"] = cloud;
        let (found, each, known) = depths(value, folder.path());
        assert!(!known && found.problems.is_empty(), "{:?}", found.problems);
        each[1]
    };
    let rows = json!([[0, -2, 0, 0], [0, 0, -2, 0], [2, 0, 0, 0]]);
    assert_eq!(of_frame(json!({"path": "near.xyz"})), Some(9.0));
    assert_eq!(of_frame(json!({"path": "lidar.xyz", "transform": rows})), Some(9.0));
    assert_eq!(of_frame(json!({"path": "lidar.xyz"})), None);
    assert_eq!(of_frame(json!({"path": "right.xyz", "frame": "world"})), Some(9.0));
    let moved = json!([[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]]);
    assert_eq!(of_frame(json!({"path": "near.xyz", "frame": "world", "transform": moved})), Some(9.0));
    // A cloud of the scene has points that no frame sees.
    let mut value = file();
    value["point_cloud"] = json!({"path": "through.xyz"});
    let (found, each, known) = depths(value, folder.path());
    assert_eq!((found.detections, found.repeated, known), (1, 1, true));
    assert_eq!(each.into_iter().flatten().collect::<Vec<_>>(), [9.0]);
    let mut value = file();
    value["point_cloud"] = json!({"path": "none.ply"});
    let (found, ..) = depths(value, folder.path());
    assert_eq!((found.without, found.problems.len()), (2, 1), "the problem is told once");
}

#[test]
fn lenses_bend_points_as_they_bend_boxes() {
    let mut value = file();
    value["cameras"][0]["model"] = json!("SIMPLE_RADIAL");
    value["cameras"][0]["params"] = json!([500, 320, 240, -0.3]);
    value["points"] = json!([[4.0, 3.0, 10.0], [4.02, 3.015, 10.05], [4.04, 3.03, 10.1]]);
    value["frames"][0]["observed_points"] = json!([0, 1, 2]);
    // r = .5: the pinhole's pixel (520, 390) is drawn to the middle by .075.
    let at = |u: f64, v: f64| json!([u - 4.0, v - 4.0, u + 4.0, v + 4.0]);
    value["detections"] = json!([{"frame": "a", "object": "o", "box": at(505.0, 378.75)}]);
    assert_eq!(depths(value.clone(), Path::new("")).1, [Some(10.05)]);
    value["detections"][0]["box"] = at(520.0, 390.0);
    assert_eq!(depths(value, Path::new("")).1, [None]);
}

/// Points seen from a camera are where they were after a correction of the world.
#[test]
fn clouds_follow_corrections_of_the_world() {
    use crate::correct::{Assumption, correct};
    let folder = tempfile::tempdir().unwrap();
    let grid: Vec<String> =
        (0..36).map(|k| format!("{} {} 9", 0.2 * f64::from(k % 6) - 0.5, 0.2 * f64::from(k / 6) + 1.5)).collect();
    std::fs::write(folder.path().join("a.xyz"), grid.join("\n")).unwrap();
    for frame in ["camera", "world"] {
        let mut value = file();
        value["frames"][0]["point_cloud"] = json!({"path": "a.xyz", "frame": frame});
        value["point_cloud"] = json!({"path": "a.xyz"});
        value["detections"] = json!([{"frame": "a", "object": "o", "box": [290, 322, 350, 382]}]);
        let (_, given, _) = depths(value.clone(), folder.path());
        assert_eq!(given, [Some(9.0)]);
        let corrected = |assumed: &str, bounding_box: Value| {
            let mut value = value.clone();
            value["detections"][0]["box"] = bounding_box;
            let mut file: SceneFile = serde_json::from_value(value).unwrap();
            correct(&mut file, &Assumption::corrections(&[assumed.parse().unwrap()]).unwrap()).unwrap();
            depths(serde_json::to_value(Written(&file)).unwrap(), folder.path()).1[0].unwrap()
        };
        let seen = json!([290, 322, 350, 382]);
        assert!((corrected("pose_unit=cm", seen.clone()) - 0.09).abs() < 1e-12);
        // In the mirrored world the camera looks at the same points of its own frame, and at those of the world on the other side.
        let (mirrored, same) = (json!([290, 98, 350, 158]), frame == "camera");
        let found = corrected("poses=left-handed", if same { seen } else { mirrored });
        assert!((found - 9.0).abs() < 1e-12, "{frame} {found}");
    }
}

/// The records that a correction changes.
struct Written<'a>(&'a SceneFile);

impl Serialize for Written<'_> {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut bytes = Vec::new();
        crate::scene_file::write_scene(self.0, &mut bytes).map_err(serde::ser::Error::custom)?;
        let value: Value = serde_json::from_slice(&bytes).map_err(serde::ser::Error::custom)?;
        value.serialize(serializer)
    }
}
