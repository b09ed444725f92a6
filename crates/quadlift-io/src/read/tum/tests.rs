use super::*;
use crate::read::PixelCenters;
use nalgebra::{Rotation3, UnitQuaternion, Vector4};

fn options() -> ReadOptions {
    ReadOptions { image_size: Some([640.0, 480.0]), ..ReadOptions::default() }
}

fn parse(trajectory: &str, calib: &str, images: Option<&str>) -> Result<Import, ReadError> {
    let options = ReadOptions { image_list: images.map(|_| "rgb.txt".into()), ..options() };
    let trajectory = (Path::new("traj.txt"), trajectory.as_bytes());
    parse_tum(trajectory, (Path::new("calib.txt"), calib.as_bytes()), images.map(str::as_bytes), &options)
}

#[test]
fn poses_are_inverted_and_quaternions_end_with_w() {
    let rotation = Rotation3::from_euler_angles(0.3, -0.8, 1.2);
    let q = UnitQuaternion::from_rotation_matrix(&rotation);
    let text = format!("# timestamp tx ty tz qx qy qz qw\n1305031102.1758 1 2 3 {} {} {} {}\n", q.i, q.j, q.k, q.w);
    let scene = parse(&text, "500 501 319.5 239.5", None).unwrap().scene;
    let frame = &scene.frames[0];
    assert_eq!((frame.id.as_str(), frame.time), ("1305031102.1758", Some(1_305_031_102.175_8)));
    let cam_from_world = super::super::poses::from_rows(&frame.cam_from_world.unwrap());
    // The camera stands at (1, 2, 3) and looks along the third column of the rotation.
    let ahead = rotation * Vector3::z() * 2.0 + Vector3::new(1.0, 2.0, 3.0);
    let seen = cam_from_world * Vector4::new(ahead.x, ahead.y, ahead.z, 1.0);
    assert!((seen.xyz() - Vector3::new(0.0, 0.0, 2.0)).norm() < 1e-12, "{seen}");
    assert_eq!(scene.cameras[0].params, [500.0, 501.0, 319.5, 239.5]);
}

#[test]
fn images_get_the_pose_that_is_nearest_in_time() {
    let trajectory = "2.00 2 0 0 0 0 0 1\n1.00 1 0 0 0 0 0 1\n1.03 5 0 0 0 0 0 1\n";
    let images = "# time name\n0.99 rgb/a.png\n1.02 rgb/b c.png\n1.5 rgb/c.png\n2.01 rgb/d.png\n";
    let import = parse(trajectory, "500 501 320 240", Some(images)).unwrap();
    let found: Vec<(&str, f64)> =
        import.scene.frames.iter().map(|f| (f.id.as_str(), -f.cam_from_world.unwrap()[0][3])).collect();
    assert_eq!(found, [("rgb/a.png", 1.0), ("rgb/b c.png", 5.0), ("rgb/d.png", 2.0)]);
    assert!(import.notes.iter().any(|note| note.contains("1 have none and were skipped")), "{:?}", import.notes);
}

#[test]
fn times_in_nanoseconds_are_those_in_seconds() {
    let poses = ["1403636579763555584 1 0 0 0 0 0 1", "1403636579813555456 2 0 0 0 0 0 1"].join("\n");
    let images = "1403636579.7635 a.png\n1403636579.8135 b.png\n";
    let found = |images| {
        let scene = parse(&poses, "500 501 320 240", images).unwrap().scene;
        scene.frames.into_iter().map(|f| (f.id, f.time.unwrap(), -f.cam_from_world.unwrap()[0][3])).collect::<Vec<_>>()
    };
    let [a, b] = [1_403_636_579.763_5, 1_403_636_579.813_5];
    assert_eq!(found(Some(images)), [("a.png".to_owned(), a, 1.0), ("b.png".to_owned(), b, 2.0)]);
    let alone = found(None);
    assert!((alone[0].1 - a).abs() < 1e-3 && alone[0].0 == "1403636579763555584", "{alone:?}");
}

#[test]
fn intrinsics_come_in_several_forms() {
    let pose = "1 0 0 0 0 0 0 1\n";
    let camera = |calib: &str| parse(pose, calib, None).unwrap().scene.cameras[0].clone();
    assert_eq!(camera("1 2 3 4 .1 .2 .3 .4").model, "OPENCV");
    let full = camera("1 2 3 4 .1 .2 .3 .4 .5");
    assert_eq!((full.model.as_str(), full.params[8], full.params.len()), ("FULL_OPENCV", 0.5, 12));
    for line in ["7 SIMPLE_RADIAL 100 80 50 50 40 0.1", "SIMPLE_RADIAL 100 80 50 50 40 0.1"] {
        let colmap = camera(line);
        assert_eq!(
            (colmap.model.as_str(), colmap.params.as_slice()),
            ("SIMPLE_RADIAL", [50.0, 50.0, 40.0, 0.1].as_slice())
        );
    }
    let shifted = ReadOptions { pixel_centers: PixelCenters::Integer, ..options() };
    let import = parse_tum((Path::new("t"), pose.as_bytes()), (Path::new("c"), b"1 2 3 4"), None, &shifted).unwrap();
    assert_eq!(import.scene.cameras[0].params, [1.0, 2.0, 3.5, 4.5]);
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
    let good = "1 0 0 0 0 0 0 1\n";
    let message =
        |trajectory: &str, calib: &str, images: Option<&str>| parse(trajectory, calib, images).unwrap_err().to_string();
    insta::assert_snapshot!(message("1 0 0 0 0 0 1\n", "1 1 1 1", None), @"traj.txt:1: the line ends after 7 fields; expected a quaternion qx qy qz qw");
    insta::assert_snapshot!(message("1 0 0 0 0 0 0 0\n", "1 1 1 1", None), @"traj.txt:1: the quaternion 0 0 0 0 is not a rotation");
    insta::assert_snapshot!(message("# c\n1 0 0 nan 0 0 0 1\n", "1 1 1 1", None), @r#"traj.txt:2: field 4 is "nan"; expected a translation tx ty tz"#);
    insta::assert_snapshot!(message("1 0 0 0 0 0 0 1 9\n", "1 1 1 1", None), @"traj.txt:1: expected 8 numbers; found more: 9");
    insta::assert_snapshot!(message(good, "1 1 1", None), @"calib.txt:1: found 3 numbers; expected one line: fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS as in COLMAP");
    insta::assert_snapshot!(message(good, "1 1 1 1\n1 1 1 1\n", None), @"calib.txt:2: found a second line; expected one line: fx fy cx cy [k1 k2 p1 p2 [k3]], or MODEL WIDTH HEIGHT PARAMS as in COLMAP");
    insta::assert_snapshot!(message(good, "0 1 1 1", None), @"calib.txt:1: focal lengths are (0, 1); expected two positive numbers (the intrinsics are singular)");
    insta::assert_snapshot!(message(good, "NEW_MODEL 1 1 1 1", None), @r#"calib.txt:1: found the camera model "NEW_MODEL"; known are SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, OPENCV_FISHEYE, FULL_OPENCV, FOV, SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, THIN_PRISM_FISHEYE, RAD_TAN_THIN_PRISM_FISHEYE, SIMPLE_DIVISION, DIVISION, SIMPLE_FISHEYE, FISHEYE, EUCM, EQUIRECTANGULAR"#);
    insta::assert_snapshot!(message(good, "1 1 1 1", Some("1.0\n")), @"rgb.txt:1: the line ends after 1 field; expected the name of an image");
    insta::assert_snapshot!(message(&good.repeat(2), "1 1 1 1", None), @r#"traj.txt: the scene made of this file is not valid: frames[1]: the frame id "1" is used twice"#);
}
