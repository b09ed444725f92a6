use super::*;

const CALIB: &str = "\
P2: 700 0 600 42 0 700 180 0 0 0 1 0
R_rect 1 0 0 0 1 0 0 0 1
Tr_velo_cam 0 -1 0 0 0 0 -1 0 1 0 0 0
Tr_imu_velo 1 0 0 0 0 1 0 0 0 0 1 0
";

/// Two lines of GPS/IMU data, the second `north` meters ahead.
fn oxts(north: f64) -> String {
    let rest = " 0".repeat(24);
    // One meter north is 1 / 111319.49 degrees on KITTI's sphere. The IMU looks north (yaw is counted from east).
    let yaw = std::f64::consts::FRAC_PI_2;
    format!("0 8 100 0 0 {yaw}{rest}\n{} 8 100 0 0 {yaw}{rest}\n", north / 111_319.490_793)
}

fn parse(calib: &str, oxts: &str, labels: Option<&str>, options: &ReadOptions) -> Result<Import, ReadError> {
    let files = KittiFiles {
        calib: (Path::new("calib.txt"), calib.as_bytes()),
        oxts: (Path::new("oxts.txt"), oxts.as_bytes()),
        labels: labels.map(|text| (Path::new("label.txt"), text.as_bytes())),
    };
    parse_kitti(files, "0001", options)
}

#[test]
fn a_car_that_drives_ahead_moves_the_world_backwards() {
    let scene = parse(CALIB, &oxts(5.0), None, &ReadOptions::default()).unwrap().scene;
    let [first, second] = [0, 1].map(|i| scene.frames[i].cam_from_world.unwrap());
    // The camera lies 42 / 700 to the left of the reference (x is 0.06 more in its frame).
    assert!((first[0][3] - 0.06).abs() < 1e-12 && first[2][3].abs() < 1e-9, "{first:?}");
    assert!((second[2][3] + 5.0).abs() < 1e-6 && second[1][3].abs() < 1e-9, "{second:?}");
    assert_eq!((scene.cameras[0].width, scene.up), (None, Some([0.0, -1.0, 0.0])));
    let sized = ReadOptions {
        image_size: Some([1242.0, 375.0]),
        pixel_centers: PixelCenters::Integer,
        ..ReadOptions::default()
    };
    let scene = parse(CALIB, &oxts(5.0), None, &sized).unwrap().scene;
    assert_eq!((scene.cameras[0].width, scene.cameras[0].params[2]), (Some(1242.0), 600.5));
}

#[test]
fn meters_are_meters_at_any_latitude() {
    // The Mercator projection stretches by 1 / cos(latitude): twice at 60 degrees.
    let rest = " 0".repeat(24);
    let line = |latitude: f64| format!("{latitude} 8 100 0 0 {}{rest}\n", std::f64::consts::FRAC_PI_2);
    let oxts = format!("{}{}", line(60.0), line(60.0 + 5.0 / 111_319.490_793));
    let scene = parse(CALIB, &oxts, None, &ReadOptions::default()).unwrap().scene;
    let second = scene.frames[1].cam_from_world.unwrap();
    assert!((second[2][3] + 5.0).abs() < 1e-4, "{second:?}");
}

#[test]
fn label_boxes_move_with_the_pixel_centers() {
    let label = "0 3 Car 0 1 0 500 100 600.5 200 1.5 1.6 4.0 0 1.75 20 1.5707963267948966\n";
    let boxes = |pixel_centers| {
        let scene = parse(CALIB, &oxts(5.0), Some(label), &ReadOptions { pixel_centers, ..ReadOptions::default() })
            .unwrap()
            .scene;
        scene.detections[0].bounding_box.unwrap()
    };
    assert_eq!(boxes(PixelCenters::Half), [500.0, 100.0, 600.5, 200.0]);
    assert_eq!(boxes(PixelCenters::Integer), [500.5, 100.5, 601.0, 200.5]);
}

#[test]
fn labels_become_detections_and_objects_in_the_world() {
    // A car 20 m ahead, 1 m below; in the second frame 15 m ahead. A region that is not labeled; a car that drives.
    let labels = "\
0 3 Car 0 1 0 500 100 600 200 1.5 1.6 4.0 0 1.75 20 1.5707963267948966
1 3 Car 0.25 1 0 490 100 610 210 1.5 1.6 4.0 0 1.75 15 1.5707963267948966
0 -1 DontCare -1 -1 -10 1 2 3 4 -1000 -1000 -1000 -10 -1 -1 -1
0 4 Van 0 0 0 700 100 800 200 2 2 5 3 1.75 20 0
1 4 Van 0 0 0 700 100 800 200 2 2 5 3 1.75 30 0 0.5
";
    let import = parse(CALIB, &oxts(5.0), Some(labels), &ReadOptions::default()).unwrap();
    let scene = &import.scene;
    assert_eq!((scene.detections.len(), scene.objects.len()), (4, 1));
    let detection = &scene.detections[1];
    assert_eq!((&*detection.frame, detection.object.as_deref()), ("000001", Some("t3")));
    assert_eq!((detection.truncated, detection.occluded, detection.score), (Some(0.25), Some(1.0), None));
    assert_eq!(scene.detections[3].score, Some(0.5));
    let cuboid = scene.objects[0].cuboid.as_ref().unwrap();
    let expected = [0.0, 1.0, 20.0];
    assert!((0..3).all(|i| (cuboid.center[i] - expected[i]).abs() < 1e-6), "{cuboid:?}");
    assert_eq!(cuboid.half_extents, [2.0, 0.75, 0.8]);
    // Only the frames that are asked for.
    let second = ReadOptions { frames: Some(1..=1), ..ReadOptions::default() };
    let scene = parse(CALIB, &oxts(5.0), Some(labels), &second).unwrap().scene;
    assert_eq!((scene.frames.len(), scene.detections.len()), (1, 2));
    assert!((scene.objects[0].cuboid.as_ref().unwrap().center[2] - 15.0).abs() < 1e-9);
}

#[test]
fn what_is_wrong_is_named_with_its_line() {
    let oxts = oxts(5.0);
    let message = |calib: &str, oxts: &str, labels: &str| {
        parse(calib, oxts, Some(labels), &ReadOptions::default()).unwrap_err().to_string()
    };
    let label = "0 3 Car 0 1 0 500 100 600 200 1.5 1.6 4.0 0 1.75 20 1.57\n";
    insta::assert_snapshot!(message(&CALIB.replace("P2", "P1"), &oxts, label), @r#"calib.txt: there is no "P2""#);
    insta::assert_snapshot!(message(&CALIB.replace(" 42 ", " 42 1 "), &oxts, label), @r#"calib.txt:1: "P2" has 13 numbers; expected 12"#);
    insta::assert_snapshot!(message(&CALIB.replace("700 0 600", "700 1 600"), &oxts, label), @r#"calib.txt: "P2": expected K [I | b] with K = [fx 0 cx; 0 fy cy; 0 0 1]"#);
    insta::assert_snapshot!(message(&CALIB.replace("Tr_imu_velo 1", "Tr_imu_velo 2"), &oxts, label), @r#"calib.txt: the 3x3 part of "Tr_imu_to_velo" or "Tr_imu_velo" is not a rotation (|R R^T - I| is 3.000e0, at most 1e-3 is accepted)"#);
    insta::assert_snapshot!(message(CALIB, "1 2 3\n", label), @"oxts.txt:1: found 3 numbers; expected 30");
    insta::assert_snapshot!(message(CALIB, &oxts.replace(" 8 100", " east 100"), label), @r#"oxts.txt:1: field 2 is "east"; expected a number"#);
    insta::assert_snapshot!(message(CALIB, &oxts, "0 3 Car 0 1 0 500\n"), @"label.txt:1: the line ends after 7 fields; expected a box left, top, right, bottom");
    insta::assert_snapshot!(message(CALIB, &oxts, &label.replace("0 3", "0.5 3")), @r#"label.txt:1: field 1 is "0.5"; expected the number of a frame"#);
    insta::assert_snapshot!(message(CALIB, &oxts, &label.replace("1.57", "1.57 1 2")), @"label.txt:1: expected 17 or 18 fields; found more: 2");
    let many = ReadOptions { frames: Some(1..=7), ..ReadOptions::default() };
    insta::assert_snapshot!(parse(CALIB, &oxts, None, &many).unwrap_err(), @"oxts.txt: the sequence has 2 frames; requested were 1 to 7");
}
