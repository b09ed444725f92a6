use serde_json::Value;

use super::*;
use crate::read::PixelCenters;
use std::path::PathBuf;

/// A small drive with invented numbers; pykitti gives its poses.
fn fixture() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/kitti_raw")
}

fn drive() -> PathBuf {
    fixture().join("2030_01_02/2030_01_02_drive_0007_sync")
}

#[test]
fn a_drive_has_the_poses_that_pykitti_gives_it() {
    let import = read_kitti_raw(&drive(), &ReadOptions::default()).unwrap();
    let scene = &import.scene;
    let expected: Value = serde_json::from_slice(&std::fs::read(fixture().join("expected.json")).unwrap()).unwrap();
    assert_eq!((scene.frames.len(), scene.frames[4].id.as_str()), (5, "000004"));
    for (frame, expected) in scene.frames.iter().zip(expected["cam_from_world"].as_array().unwrap()) {
        let found = frame.cam_from_world.unwrap();
        for i in 0..3 {
            for j in 0..4 {
                assert!((found[i][j] - expected[i][j].as_f64().unwrap()).abs() < 1e-8, "{found:?} {expected}");
            }
        }
    }
    let camera = &scene.cameras[0];
    assert_eq!((camera.params.as_slice(), camera.width), ([700.0, 700.0, 600.0, 180.0].as_slice(), Some(1200.0)));
    assert_eq!((scene.frames[0].time, scene.frames[2].time), (Some(0.0), Some(0.2072)));
    // The parked car is a true object, the driving van is none.
    assert_eq!(scene.objects.len(), 1);
    let cuboid = scene.objects[0].cuboid.as_ref().unwrap();
    let center = expected["car_center"].as_array().unwrap();
    for i in 0..3 {
        assert!((cuboid.center[i] - center[i].as_f64().unwrap()).abs() < 2e-3, "{cuboid:?}");
    }
    assert_eq!(cuboid.half_extents, [2.1, 0.8, 0.75]);
    assert!(import.notes[2].starts_with("1 static tracklets"), "{:?}", import.notes);
}

#[test]
fn a_part_of_a_drive_begins_at_its_own_first_frame() {
    let part = ReadOptions { frames: Some(2..=3), pixel_centers: PixelCenters::Integer, ..ReadOptions::default() };
    let scene = read_kitti_raw(&drive(), &part).unwrap().scene;
    assert_eq!(scene.frames.iter().map(|frame| frame.id.as_str()).collect::<Vec<_>>(), ["000002", "000003"]);
    assert_eq!((scene.frames[0].time, scene.cameras[0].params[2]), (Some(0.0), 600.5));
    let first = scene.frames[0].cam_from_world.unwrap();
    assert!((first[0][0] - 1.0).abs() < 1e-12 && (first[0][3] - 0.06).abs() < 1e-9, "{first:?}");
    let none = ReadOptions { frames: Some(9..=12), ..ReadOptions::default() };
    assert!(read_kitti_raw(&drive(), &none).unwrap_err().problem.contains("none of the requested"));
}

#[test]
fn elements_with_many_attributes_are_refused_before_they_are_parsed() {
    let attributes: String = (0..2000).map(|k| format!(" a{k}=''")).collect();
    for (text, line) in [
        (format!("<?xml version='1.0'?>\n<!-- a < b = c = d -->\n<boost{attributes}></boost>"), 3),
        (format!("<!DOCTYPE a [<!ENTITY e \"<b{attributes}/>\">]>\n<a>&e;</a>"), 1),
    ] {
        let error = parse_tracklets(Path::new("a.xml"), text.as_bytes()).unwrap_err();
        assert!(error.problem.contains("more than 1000 attributes") && error.line == Some(line), "{error}");
    }
    // What looks like attributes in comments and texts is none.
    let good = std::fs::read_to_string(drive().join("tracklet_labels.xml")).unwrap();
    let many = format!("<!-- <a {} -->", "x='' ".repeat(2000));
    let with_comment =
        good.replacen("<tracklets", &format!("{many}<![CDATA[<a {}]]><tracklets", "x= ".repeat(2000)), 1);
    assert!(parse_tracklets(Path::new("a.xml"), with_comment.as_bytes()).is_ok());
}

#[test]
fn wrong_tracklets_are_named_with_their_line() {
    let good = std::fs::read_to_string(drive().join("tracklet_labels.xml")).unwrap();
    let message = |text: &str| parse_tracklets(Path::new("t.xml"), text.as_bytes()).unwrap_err().to_string();
    assert_eq!(parse_tracklets(Path::new("t.xml"), good.as_bytes()).unwrap().len(), 2);
    insta::assert_snapshot!(message(&good.replacen("<h>1.5</h>", "<h>tall</h>", 1)), @r#"t.xml:5:48: <h> is "tall"; expected a number"#);
    insta::assert_snapshot!(message(&good.replacen("<w>1.6</w>", "", 1)), @"t.xml:5:1: there is no <w> in <item>");
    insta::assert_snapshot!(message(&good.replacen("<first_frame>1<", "<first_frame>-1<", 1)), @r#"t.xml:5:78: <first_frame> is "-1"; expected a whole number"#);
    insta::assert_snapshot!(message(&good[..600]), @"t.xml:1:1: this is not valid XML: unexpected end of stream");
    insta::assert_snapshot!(message("<a/>"), @"t.xml:1:1: there is no <tracklets> in <a>");
}
