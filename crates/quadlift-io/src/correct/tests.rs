//! Every mistake of the library's list, made in the records of a scene file, is undone by its option.

use nalgebra::{Matrix3x4, Rotation3, Vector2, Vector3};
use quadlift::diagnosis::{BoxFormat, Correction, Mistake};
use quadlift::geometry::{BoundingBox, Intrinsics, OrientedBox};
use serde_json::Value;

use super::assume::{POSES, option_of};
use super::poses::{matrix, rows};
use super::{Assumption, RecordCorrection, correct};
use crate::scene_file::{CameraRecord, DetectionRecord, FrameRecord, SceneFile};

const SIZE: [f64; 2] = [1280.0, 720.0];

/// Twelve frames, named by numbers without leading zeros, with two boxes each.
fn scene() -> SceneFile {
    let mut file = SceneFile {
        cameras: vec![CameraRecord {
            id: "camera".to_owned(),
            model: "PINHOLE".to_owned(),
            width: Some(SIZE[0]),
            height: Some(SIZE[1]),
            params: vec![900.0, 910.0, 640.0, 360.0],
            ..Default::default()
        }],
        points: vec![[0.5, -2.0, 1.5], [3.0, 4.0, -1.0]],
        ..Default::default()
    };
    for index in 0..12 {
        let k = f64::from(index);
        let rotation = Rotation3::from_euler_angles(0.3 + 0.1 * k, 0.2 * k - 1.0, 0.05 * k);
        let mut pose = Matrix3x4::zeros();
        pose.fixed_columns_mut::<3>(0).copy_from(rotation.matrix());
        pose.set_column(3, &Vector3::new(0.1 * k, -0.2 * k, 3.0 + k));
        let id = (index + 1).to_string();
        file.detections.extend([100.0, 500.0].map(|x| DetectionRecord {
            frame: id.as_str().into(),
            bounding_box: Some([x, 60.0 + 10.0 * k, x + 80.0 + k, 200.0 + 11.0 * k]),
            ..Default::default()
        }));
        file.frames.push(FrameRecord {
            id,
            camera: Some("camera".to_owned()),
            cam_from_world: Some(rows(&pose)),
            ..Default::default()
        });
    }
    file
}

/// The scene as somebody writes it who makes the mistake.
fn with_mistake(mistake: &Mistake) -> SceneFile {
    let mut file = scene();
    let size = Some(Vector2::from(SIZE));
    let p = file.cameras[0].params.clone();
    let intrinsics = Intrinsics::new(p[0], p[1], p[2], p[3]).unwrap();
    let ids: Vec<String> = file.frames.iter().map(|frame| frame.id.clone()).collect();
    let ids: Vec<&str> = ids.iter().map(String::as_str).collect();
    let frames = mistake.frames(&ids);
    // The points are those of the world in which the poses are written: mirrored where it is left-handed.
    if matches!(mistake.0, Correction::LeftHandedAxes | Correction::InvertLeftHandedPoses) {
        file.points.iter_mut().for_each(|point| point[1] = -point[1]);
    }
    for frame in &mut file.frames {
        let pose = matrix(&frame.cam_from_world.unwrap());
        let (r, t) = mistake.pose(&pose.fixed_columns::<3>(0).into_owned(), &pose.column(3).into_owned());
        let mut pose = Matrix3x4::zeros();
        pose.fixed_columns_mut::<3>(0).copy_from(&r);
        pose.set_column(3, &t);
        frame.cam_from_world = Some(rows(&pose));
    }
    let k = mistake.intrinsics(&intrinsics, size).unwrap();
    file.cameras[0].params = vec![k.fx, k.fy, k.cx, k.cy];
    file.detections.retain_mut(|detection| {
        let given = BoundingBox::new(detection.bounding_box.unwrap()).unwrap();
        let lens = matches!(mistake.0, Correction::RadialDistortion(_));
        if !lens {
            detection.bounding_box = Some(mistake.bounding_box(&given, &intrinsics, size).unwrap().edges());
        }
        let from = ids.iter().position(|id| *id == &*detection.frame).unwrap();
        let Some(to) = frames.as_ref().map_or(Some(from), |frames| frames[from]) else { return false };
        detection.frame = ids[to].into();
        true
    });
    file
}

/// The corrections of an option in the form of the command line.
fn read(option: &str) -> Vec<RecordCorrection> {
    match option.split_once(' ').unwrap() {
        ("--up", value) => vec![RecordCorrection::Known(Correction::Up(super::assume::up(value).unwrap()))],
        (_, value) => Assumption::corrections(&[value.parse().unwrap()]).unwrap(),
    }
}

/// Corrects a file as the option says.
fn corrected(mut file: SceneFile, option: &str) -> SceneFile {
    correct(&mut file, &read(option)).unwrap();
    file
}

fn json(file: &SceneFile) -> Value {
    let mut bytes = Vec::new();
    crate::scene_file::write_scene(file, &mut bytes).unwrap();
    serde_json::from_slice(&bytes).unwrap()
}

fn assert_close(found: &Value, expected: &Value, what: &str) {
    match (found, expected) {
        (Value::Number(a), Value::Number(b)) => {
            let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
            assert!((a - b).abs() <= 1e-9 * b.abs().max(1.0), "{what}: {a} instead of {b}");
        }
        (Value::Array(a), Value::Array(b)) => {
            assert_eq!(a.len(), b.len(), "{what}");
            a.iter().zip(b).for_each(|(a, b)| assert_close(a, b, what));
        }
        (Value::Object(a), Value::Object(b)) => {
            assert!(a.keys().eq(b.keys()), "{what}");
            a.iter().for_each(|(key, value)| assert_close(value, &b[key], &format!("{what} {key}")));
        }
        (a, b) => assert_eq!(a, b, "{what}"),
    }
}

fn corrections() -> Vec<Correction> {
    let mut corrections: Vec<Correction> = POSES.iter().map(|(_, correction)| *correction).collect();
    corrections.extend([
        Correction::FocalFactor(0.5),
        Correction::NormalizedIntrinsics,
        Correction::CenteredPrincipalPoint,
        Correction::ImageScale(2.0),
        Correction::ImageScale(0.5),
        Correction::Letterbox(640.0),
        Correction::NormalizedLetterbox,
        Correction::NormalizedBoxes,
        Correction::TurnedPictures { orientation: 6, fractions: false },
        Correction::TurnedPictures { orientation: 7, fractions: true },
        Correction::Boxes(BoxFormat::CornersReadAsSize),
        Correction::Boxes(BoxFormat::CenterReadAsCorner),
        Correction::Boxes(BoxFormat::CornerReadAsCenter),
        Correction::Boxes(BoxFormat::CornersReadAsCenter),
        Correction::Boxes(BoxFormat::SwappedAxes),
        Correction::AlphabeticalFrames,
        Correction::NumericFrames,
        Correction::ReversedFrames,
    ]);
    corrections
}

#[test]
fn every_option_undoes_its_mistake() {
    for correction in corrections() {
        let wrong = with_mistake(&Mistake(correction));
        let option = option_of(&correction, Some(SIZE), 0);
        assert!(json(&wrong) != json(&scene()), "{option}: no mistake");
        assert_close(&json(&corrected(wrong, &option)), &json(&scene()), &option);
    }
}

/// A point of the world is seen where it was: corrections that move the world move its points with the cameras.
#[test]
fn points_move_with_the_world() {
    let seen = |file: &SceneFile| -> Vec<[f64; 3]> {
        let pose = matrix(&file.frames[3].cam_from_world.unwrap());
        file.points.iter().map(|p| (pose * nalgebra::Vector4::new(p[0], p[1], p[2], 1.0)).into()).collect()
    };
    let before = seen(&scene());
    for (option, expected) in [
        ("--assume poses=left-handed", before.iter().map(|p| [p[0], -p[1], p[2]]).collect::<Vec<_>>()),
        ("--assume poses=opengl", before.iter().map(|p| [p[0], -p[1], -p[2]]).collect()),
        ("--assume pose_unit=cm", before.iter().map(|p| p.map(|x| 0.01 * x)).collect()),
    ] {
        for (a, b) in seen(&corrected(scene(), option)).iter().flatten().zip(expected.iter().flatten()) {
            assert!((a - b).abs() < 1e-12, "{option}: {a} {b}");
        }
    }
}

/// What leaves the first or the last frames without detections.
#[test]
fn moved_frames_come_back_but_for_those_that_were_lost() {
    for n in [1, -2] {
        let correction = Correction::FrameOffset(n);
        let mut expected = scene();
        let lost = |frame: usize| if n > 0 { frame < n as usize } else { frame >= 12 - n.unsigned_abs() as usize };
        let ids: Vec<String> = expected.frames.iter().map(|frame| frame.id.clone()).collect();
        expected.detections.retain(|d| !lost(ids.iter().position(|id| *id == *d.frame).unwrap()));
        let found = corrected(with_mistake(&Mistake(correction)), &option_of(&correction, None, 0));
        assert_close(&json(&found), &json(&expected), "frame offset");
    }
}

/// Numbers that are no box in the wrong order, which the library's types cannot hold.
#[test]
fn boxes_of_other_formats_are_read_as_they_are_meant() {
    for (format, numbers) in [
        ("xywh", [100.0, 60.0, 80.0, 140.0]),
        ("cxcywh", [140.0, 130.0, 80.0, 140.0]),
        ("yxyx", [60.0, 100.0, 200.0, 180.0]),
    ] {
        let mut file = scene();
        file.detections[0].bounding_box = Some(numbers);
        file.detections.truncate(1);
        let found = corrected(file, &format!("--assume boxes={format}"));
        assert_eq!(found.detections[0].bounding_box, Some([100.0, 60.0, 180.0, 200.0]), "{format}");
    }
}

#[test]
fn a_missing_lens_is_added() {
    let found = corrected(scene(), "--assume distortion=-0.12");
    assert_eq!(found.cameras[0].model, "OPENCV");
    assert_eq!(found.cameras[0].params, [900.0, 910.0, 640.0, 360.0, -0.12, 0.0, 0.0, 0.0]);
    let mut twice = found;
    assert!(
        correct(&mut twice, &read("--assume distortion=0.1"))
            .unwrap_err()
            .problem
            .contains("already has a lens model (OPENCV)")
    );
}

#[test]
fn units_and_up_are_set_and_boxes_may_be_stretched() {
    let found = corrected(scene(), "--assume pose_unit=mm");
    assert_eq!(found.length_unit.as_deref(), Some("m"));
    assert_eq!(found.frames[0].cam_from_world.unwrap()[2][3], 0.003);
    assert_eq!(found.points, [[0.0005, -0.002, 0.0015], [0.003, 0.004, -0.001]]);
    assert_eq!(corrected(scene(), "--up -y").up, Some([0.0, -1.0, 0.0]));
    assert_eq!(corrected(scene(), "--up 0,0,2").up, Some([0.0, 0.0, 2.0]));
    // A photo of 1280 x 720 that was stretched to a square.
    let found = corrected(scene(), "--assume image_size=640x640");
    assert_eq!(found.detections[0].bounding_box, Some([200.0, 67.5, 360.0, 225.0]));
}

/// Cameras with one focal length, projections instead of poses, and cameras without a size.
#[test]
fn other_cameras_are_corrected_as_well() {
    let mut file = scene();
    file.cameras[0].model = "SIMPLE_RADIAL".to_owned();
    file.cameras[0].params = vec![0.7, 0.5, 0.5, -0.1];
    let found = corrected(file.clone(), "--assume intrinsics=normalized");
    assert_eq!(found.cameras[0].model, "OPENCV");
    assert_close(
        &json(&found)["cameras"][0]["params"],
        &serde_json::json!([896.0, 504.0, 640.0, 360.0, -0.1, 0.0, 0.0, 0.0]),
        "SIMPLE_RADIAL",
    );
    let found = corrected(file.clone(), "--assume focal=2");
    assert_eq!((found.cameras[0].model.as_str(), found.cameras[0].params[0]), ("SIMPLE_RADIAL", 1.4));
    (file.cameras[0].width, file.cameras[0].height) = (None, None);
    assert_eq!(correct(&mut file, &read("--assume intrinsics=normalized")).unwrap_err().entry, "cameras[0]");

    // The same scene with projections, corrected in both forms, has the same cameras.
    for option in ["--assume poses=opengl-world-from-camera", "--assume focal=0.5"] {
        let as_poses = corrected(scene(), option);
        let mut file = scene();
        let projections = |file: &SceneFile| -> Vec<Matrix3x4<f64>> {
            file.to_scene().unwrap().frames.iter().map(|frame| *frame.projection.matrix()).collect()
        };
        let given = projections(&file);
        for (frame, projection) in file.frames.iter_mut().zip(&given) {
            (frame.camera, frame.cam_from_world) = (None, None);
            frame.projection = Some(rows(projection));
        }
        for (a, b) in projections(&corrected(file, option)).iter().zip(projections(&as_poses)) {
            // A projection is known up to a factor.
            let (a, b) = (a / a.norm(), b / b.norm());
            assert!((a - b).norm() < 1e-9, "{option}: {a} {b}");
        }
    }
}

#[test]
fn outlines_and_oriented_boxes_are_corrected_like_boxes() {
    let mut file = scene();
    let turned = OrientedBox::new(Vector2::new(300.0, 200.0), Vector2::new(80.0, 30.0), 0.6).unwrap();
    let outline = [[100.0, 60.0], [180.0, 70.0], [140.0, 200.0]];
    file.detections.truncate(1);
    file.detections[0].bounding_box = Some([100.0, 60.0, 180.0, 200.0]);
    file.detections[0].outline = Some(Box::new(outline));
    file.detections[0].oriented_box = Some(Box::new(turned.into()));
    for (option, factor, shift) in [
        ("--assume image_size=640x360", 2.0, [0.0, 0.0]),
        ("--assume box_scale=0.5", 0.5, [0.0, 0.0]),
        ("--assume letterbox=640x640", 2.0, [0.0, -280.0]),
        ("--assume letterbox=640x400", 2.0, [0.0, -40.0]),
    ] {
        let changed = corrected(file.clone(), option);
        let detection = &changed.detections[0];
        let place = |p: [f64; 2]| [p[0] * factor + shift[0], p[1] * factor + shift[1]];
        let edges = detection.bounding_box.unwrap();
        assert_eq!([edges[0], edges[1]], place([100.0, 60.0]), "{option}");
        assert_eq!(**detection.outline.as_ref().unwrap(), outline.map(place), "{option}");
        let found = detection.oriented_box.as_ref().unwrap();
        let found = [found.center[0], found.center[1], found.size[0], found.size[1], found.angle];
        let [x, y] = place([300.0, 200.0]);
        for (a, b) in found.iter().zip([x, y, 80.0 * factor, 30.0 * factor, 0.6]) {
            assert!((a - b).abs() < 1e-9, "{option}: {found:?}");
        }
    }
}
