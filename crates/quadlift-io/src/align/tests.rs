//! Scene files that are moved, compared and merged.

use nalgebra::{Matrix3, Point3, Rotation3, SMatrix, Vector3};
use quadlift::align::{AlignStatus, MapTransform, align};
use quadlift::geometry::{Ellipsoid, Projection, Similarity, project_bounding_box, vech3};
use serde_json::json;

use super::{Contradiction, MapScale, align_checked, alignment_record, merge, options_of};
use crate::scene_file::{SceneFile, parse_scene_file};

/// A map of seven balls of different categories at given places, of which the camera `cam` sees two in the frame `f0`.
fn map(places: &[(&str, [f64; 3])]) -> SceneFile {
    let objects: Vec<_> = places
        .iter()
        .map(|(id, center)| {
            json!({
                "id": id, "category": id.trim_start_matches("b:"), "status": "ok", "center": center, "center_sd": 0.01,
                "body": {"kind": "ellipsoid", "center": center, "half_extents": [0.3, 0.2, 0.1], "rotation": [1, 0, 0, 0]},
                "half_extents_sd": [0.03, 0.02, 0.01],
                "covariance": {"coordinates": "center_vech_shape", "matrix": covariance()},
                "view_residuals_px": [{"frame": "f0", "inlier": true}],
            })
        })
        .collect();
    let text = json!({
        "format": "quadlift.scene", "version": 1, "up": [0, 0, 1], "length_unit": "m",
        "cameras": [
            {"id": "cam", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 510, 320, 240]},
            {"id": "other", "model": "PINHOLE", "width": 640, "height": 480, "params": [600, 600, 320, 240]}
        ],
        "frames": [
            {"id": "f0", "camera": "cam", "cam_from_world": [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 5]],
             "depth": {"path": "d.png", "scale": 0.001}, "given_cam_from_world": [[1, 0, 0, 0], [0, 0, -1, 1], [0, 1, 0, 5]],
             "pose_covariance": (0..6).map(|i| (0..6).map(|j| if i == j { 0.01 } else { 0.0 }).collect::<Vec<_>>()).collect::<Vec<_>>(),
             "location": {"status": "ok"}},
            {"id": "f1", "projection": [[500, 320, 0, 1600], [0, 240, -510, 1710], [0, 1, 0, 5]], "observed_points": [1]}
        ],
        "points": [[0, 0, 0], [1, 2, 3]],
        "detections": [
            {"frame": "f0", "object": places[0].0, "box": [0, 0, 10, 10], "depth": {"median": 4, "sd": 0.1}},
            {"frame": "f1", "object": "unknown", "box": [0, 0, 10, 10],
             "box3d": {"center": [1, 2, 3], "half_extents": [1, 2, 3], "frame": "world"}}
        ],
        "objects": objects,
    });
    parse_scene_file("map.json".as_ref(), text.to_string().as_bytes()).unwrap()
}

/// A covariance of center and shape that is no multiple of anything.
fn covariance() -> Vec<Vec<f64>> {
    let factor =
        SMatrix::<f64, 9, 9>::from_fn(|i, j| if i >= j { 0.002 + 0.001 * ((i * 3 + j * 5) % 7) as f64 } else { 0.0 });
    let matrix = factor * factor.transpose() + SMatrix::<f64, 9, 9>::identity() * 1e-6;
    (0..9).map(|i| matrix.row(i).iter().copied().collect()).collect()
}

const PLACES: [(&str, [f64; 3]); 7] = [
    ("p", [0.0, 0.0, 0.4]),
    ("q", [3.0, 0.4, 0.3]),
    ("r", [-2.2, 1.3, 1.2]),
    ("s", [0.6, -2.8, 0.5]),
    ("t", [-1.4, -1.1, 0.9]),
    ("u", [2.1, 2.5, 1.6]),
    ("v", [-0.3, 2.2, 0.2]),
];

fn similarity(scale: f64) -> Similarity {
    Similarity {
        scale,
        rotation: Rotation3::from_euler_angles(0.3, -0.8, 2.0),
        translation: Vector3::new(4.0, -1.0, 7.0),
    }
}

#[test]
fn a_file_that_is_moved_shows_the_same() {
    let file = map(&PLACES);
    let to = similarity(2.5);
    let mut moved = file.clone();
    moved.move_by(&to).unwrap();
    // Boxes of the objects in the images, by both kinds of frames.
    let seen = |file: &SceneFile| -> Vec<[f64; 4]> {
        let scene = file.to_scene().unwrap();
        let objects = file.to_map_objects().unwrap().objects;
        let of_frame = |projection: &Projection| {
            let boxes = objects.iter().filter_map(|object| project_bounding_box(projection, &object.ellipsoid).ok());
            boxes.map(|b| [b.x0(), b.y0(), b.x1(), b.y1()]).collect::<Vec<_>>()
        };
        scene.frames.iter().flat_map(|frame| of_frame(&frame.projection)).collect()
    };
    let (before, after) = (seen(&file), seen(&moved));
    assert!(before.len() == 14 && after.len() == 14);
    for (x, y) in before.iter().flatten().zip(after.iter().flatten()) {
        assert!((x - y).abs() < 1e-6, "{x} {y}");
    }
    assert!((Vector3::from(moved.up.unwrap()) - to.rotation * Vector3::z()).norm() < 1e-12);
    assert!((Point3::from(moved.points[1]) - to.point(&Point3::new(1.0, 2.0, 3.0))).norm() < 1e-12);
    let frame = &moved.frames[0];
    assert_eq!(frame.depth.as_ref().unwrap().scale, 0.0025);
    let given: [[f64; 4]; 3] = serde_json::from_value(frame.extra["given_cam_from_world"].clone()).unwrap();
    assert!(
        given.iter().flatten().zip(frame.cam_from_world.unwrap().iter().flatten()).all(|(x, y)| (x - y).abs() < 1e-12)
    );
    assert!(!frame.extra.contains_key("location"));
    let covariance: [[f64; 6]; 6] = serde_json::from_value(frame.extra["pose_covariance"].clone()).unwrap();
    assert!((covariance[0][0] - 0.01).abs() < 1e-12 && (covariance[4][4] - 0.0625).abs() < 1e-12);
    let depth = moved.detections[0].depth.as_ref().unwrap();
    assert_eq!((depth.median, depth.sd), (10.0, Some(0.25)));
    let box3d = moved.detections[1].box3d.as_ref().unwrap();
    assert!((Point3::from(box3d.center.unwrap()) - to.point(&Point3::new(1.0, 2.0, 3.0))).norm() < 1e-12);
    assert_eq!(box3d.half_extents, Some([2.5, 5.0, 7.5]));
    // There and back.
    moved.move_by(&to.inverse()).unwrap();
    let (p, q) = (&file.objects[1], &moved.objects[1]);
    assert!((Point3::from(p.center.unwrap()) - Point3::from(q.center.unwrap())).norm() < 1e-12);
    assert!((p.center_sd.unwrap() - q.center_sd.unwrap()).abs() < 1e-12);
}

#[test]
fn the_covariance_of_a_moved_object_is_that_of_its_moved_errors() {
    let file = map(&PLACES[..1]);
    let to = similarity(1.7);
    let mut moved = file.clone();
    moved.move_by(&to).unwrap();
    let [before, after] = [&file, &moved].map(|file| file.to_objects().unwrap().remove(0));
    let body = before.ellipsoid().unwrap();
    // A small error of center and shape, in both frames.
    let coordinates = |body: &Ellipsoid| {
        let mut all = SMatrix::<f64, 9, 1>::zeros();
        all.fixed_rows_mut::<3>(0).copy_from(&body.center.coords);
        all.fixed_rows_mut::<6>(3).copy_from(&vech3(&body.shape()));
        all
    };
    let mut shape = body.shape();
    shape[(0, 0)] += 1e-5;
    shape[(1, 0)] += 2e-5;
    shape[(0, 1)] += 2e-5;
    shape[(2, 2)] -= 1e-5;
    let wrong = Ellipsoid::from_shape(body.center + Vector3::new(1e-4, -2e-4, 1e-4), &shape).unwrap();
    let squared = |wrong: &Ellipsoid, body: &Ellipsoid, covariance: &SMatrix<f64, 9, 9>| {
        let error = coordinates(wrong) - coordinates(body);
        error.dot(&covariance.lu().solve(&error).unwrap())
    };
    let there = squared(&wrong, &body, &before.covariance.unwrap().matrix);
    let here = squared(&to.ellipsoid(&wrong), &after.ellipsoid().unwrap(), &after.covariance.unwrap().matrix);
    assert!((there - here).abs() < 1e-6 * there, "{there} {here}");
}

/// Map A, and a map B that lacks two of its objects, has another one, and lies elsewhere.
fn two_maps(scale: f64) -> [SceneFile; 2] {
    let mut places = PLACES[..5].to_vec();
    places.push(("w", [1.0, 1.5, 0.7]));
    let named: Vec<(String, [f64; 3])> = places.iter().map(|(id, center)| (format!("b:{id}"), *center)).collect();
    let named: Vec<(&str, [f64; 3])> = named.iter().map(|(id, center)| (id.as_str(), *center)).collect();
    let mut b = map(&named);
    b.move_by(&similarity(scale)).unwrap();
    [map(&PLACES), b]
}

fn best(a: &SceneFile, b: &SceneFile) -> MapTransform {
    let [of_a, of_b] = [a, b].map(|file| file.to_map_objects().unwrap());
    let found = align(&of_a.objects, &of_b.objects, &options_of(a, b, MapScale::Rigid, Some(0.03)));
    assert_eq!(found.status, AlignStatus::Ok);
    found.transforms.into_iter().next().unwrap()
}

#[test]
fn merged_maps_have_matched_objects_once_and_no_id_twice() {
    let [mut a, mut b] = two_maps(1.0);
    // The second camera of B is another one, and so is its object "r", whose id is taken; its estimate of "q" is better.
    b.cameras[1].params[0] = 700.0;
    b.frames[1] =
        crate::scene_file::FrameRecord { camera: Some("other".into()), projection: None, ..b.frames[0].clone() };
    b.frames[1].id = "f1".into();
    b.frames[1].observed_points = Some(Box::new([1]));
    b.objects[5].id = "r".into();
    b.detections[1].object = Some("r".into());
    b.detections[1].box3d = None;
    for row in &mut b.objects[1].covariance.as_mut().unwrap().matrix {
        row.iter_mut().for_each(|x| *x *= 0.25);
    }
    a.extra.insert("mine".to_owned(), json!(1));
    let [of_a, of_b] = [&a, &b].map(|file| file.to_map_objects().unwrap());
    let transform = best(&a, &b);
    assert_eq!(transform.matches, (0..5).map(|k| (k, k)).collect::<Vec<_>>());
    let merged = merge(&a, &b, [&of_a, &of_b], &transform).unwrap();
    let ids = |file: &SceneFile| file.objects.iter().map(|object| object.id.clone()).collect::<Vec<_>>();
    assert_eq!(ids(&merged.file), ["p", "q", "r", "s", "t", "u", "v", "b/r"]);
    assert_eq!(merged.renamed_objects, [("r".to_owned(), "b/r".to_owned())]);
    let frames: Vec<_> = merged.file.frames.iter().map(|frame| (frame.id.as_str(), frame.camera.as_deref())).collect();
    assert_eq!(frames, [("f0", Some("cam")), ("f1", None), ("b/f0", Some("cam")), ("b/f1", Some("b/other"))]);
    assert_eq!(merged.renamed_frames.len(), 2);
    let cameras: Vec<_> = merged.file.cameras.iter().map(|camera| camera.id.as_str()).collect();
    assert_eq!(cameras, ["cam", "other", "b/other"]);
    let detections: Vec<_> = merged.file.detections.iter().map(|d| (&*d.frame, d.object.as_deref().unwrap())).collect();
    assert_eq!(detections, [("f0", "p"), ("f1", "unknown"), ("b/f0", "p"), ("b/f1", "b/r")]);
    assert_eq!(merged.file.frames[3].observed_points.as_deref(), Some(&[3][..]));
    assert_eq!(merged.file.points.len(), 4);
    assert_eq!(merged.file.extra["mine"], 1);
    assert!(merged.has_detections);
    // The better estimate of "q" is that of B, in the frame of A; its views are those of the renamed frame.
    assert_eq!(merged.file.objects[1].view_residuals_px[0].frame, "b/f0");
    assert_eq!(merged.file.objects[0].view_residuals_px[0].frame, "f0");
    let center = Point3::from(merged.file.objects[1].center.unwrap());
    assert!((center - Point3::from(PLACES[1].1)).norm() < 1e-6, "{center}");
    let placed = Point3::from(merged.file.objects[7].center.unwrap());
    assert!((placed - Point3::new(1.0, 1.5, 0.7)).norm() < 1e-6, "{placed}");
    merged.file.to_scene().unwrap();
    assert_eq!(merged.at_one_place().unwrap(), Vec::<[String; 2]>::new());
    // An object of A that is there twice is told.
    let mut twice = merged;
    let mut again = twice.file.objects[2].clone();
    again.id = "again".into();
    twice.file.objects.push(again);
    assert_eq!(twice.at_one_place().unwrap(), [["r".to_owned(), "again".to_owned()]]);
}

#[test]
fn sources_of_depths_have_a_scale_of_their_own_where_the_scale_was_estimated() {
    let [a, b] = two_maps(2.0);
    let [of_a, of_b] = [&a, &b].map(|file| file.to_map_objects().unwrap());
    for (scale, expected) in [(None, Some("b/depth")), (Some(0.5), None)] {
        let found = align(&of_a.objects, &of_b.objects, &quadlift::align::AlignOptions { scale, up: None });
        assert_eq!(found.status, AlignStatus::Ok);
        let merged = merge(&a, &b, [&of_a, &of_b], &found.transforms[0]).unwrap().file;
        let depth = merged.detections[2].depth.as_ref().unwrap();
        assert!((depth.median - 4.0).abs() < 0.05, "{}", depth.median);
        assert_eq!(depth.source.as_deref(), expected);
        assert_eq!(merged.detections[0].depth.as_ref().unwrap().source, None);
    }
}

#[test]
fn units_decide_the_scale_and_objects_contradict_it() {
    let [a, mut b] = two_maps(1000.0);
    b.length_unit = Some("mm".to_owned());
    let scale = |b: &SceneFile, choice| options_of(&a, b, choice, None).scale;
    assert_eq!(scale(&b, MapScale::OfUnits), Some(0.001));
    assert_eq!(scale(&b, MapScale::Rigid), Some(0.001));
    assert_eq!(scale(&b, MapScale::Estimated), None);
    let maps = |b: &SceneFile| [&a, b].map(|file| file.to_map_objects().unwrap());
    let [of_a, of_b] = maps(&b);
    let (found, contradiction) = align_checked(&of_a, &of_b, &options_of(&a, &b, MapScale::OfUnits, Some(0.03)));
    assert_eq!((found.status, contradiction), (AlignStatus::Ok, None));
    let record = alignment_record(&found, [&of_a, &of_b]);
    assert_eq!((&record["status"], &record["matches"][0]["b"]), (&json!("ok"), &json!("b:p")));
    // A map that says meters and is in millimeters.
    b.length_unit = Some("m".to_owned());
    let (found, contradiction) = align_checked(&of_a, &of_b, &options_of(&a, &b, MapScale::OfUnits, Some(0.03)));
    assert_ne!(found.status, AlignStatus::Ok);
    assert!(matches!(contradiction, Some(Contradiction::Scale { found, .. }) if (found - 0.001).abs() < 1e-6));
    assert!(alignment_record(&found, [&of_a, &of_b]).get("a_from_b").is_none());
    b.length_unit = Some("parsec".to_owned());
    assert_eq!((scale(&b, MapScale::OfUnits), scale(&b, MapScale::Rigid)), (None, Some(1.0)));
    // Meters that are 6 % too long are not taken as meters.
    let [_, long] = two_maps(1.06);
    let [of_a, of_b] = maps(&long);
    let (found, contradiction) = align_checked(&of_a, &of_b, &options_of(&a, &long, MapScale::OfUnits, Some(0.03)));
    assert_eq!(found.status, AlignStatus::NoAlignment);
    assert!(matches!(contradiction, Some(Contradiction::Scale { .. })), "{contradiction:?}");
}

#[test]
fn a_wrong_vertical_is_told() {
    let [a, mut b] = two_maps(1.0);
    b.up = Some([1.0, 0.0, 0.0]);
    let [of_a, of_b] = [&a, &b].map(|file| file.to_map_objects().unwrap());
    let (found, contradiction) = align_checked(&of_a, &of_b, &options_of(&a, &b, MapScale::OfUnits, Some(0.03)));
    assert_ne!(found.status, AlignStatus::Ok);
    assert_eq!(contradiction, Some(Contradiction::Up));
    let (found, _) = align_checked(&of_a, &of_b, &options_of(&a, &b, MapScale::OfUnits, None));
    assert_eq!(found.status, AlignStatus::Ok);
}

#[test]
fn a_mirrored_map_is_told() {
    let [a, mut b] = two_maps(1.0);
    let [of_a, mut of_b] = [&a, &b].map(|file| file.to_map_objects().unwrap());
    b.up = b.up.map(|[x, y, z]| [x, -y, z]);
    let mirror = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0));
    for object in &mut of_b.objects {
        let center = Point3::from(mirror * object.ellipsoid.center.coords);
        object.ellipsoid = Ellipsoid::from_shape(center, &(mirror * object.ellipsoid.shape() * mirror)).unwrap();
        object.covariance = None;
    }
    for (scale, up) in [(MapScale::Rigid, None), (MapScale::Estimated, None), (MapScale::OfUnits, Some(0.03))] {
        let (found, contradiction) = align_checked(&of_a, &of_b, &options_of(&a, &b, scale, up));
        assert_eq!(
            (found.status, contradiction),
            (AlignStatus::NoAlignment, Some(Contradiction::Mirrored)),
            "{scale:?}"
        );
    }
}
