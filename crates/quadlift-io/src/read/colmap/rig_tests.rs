use std::path::{Path, PathBuf};

use super::super::super::poses::from_rows;
use super::super::{parse_text as parse_model, read_colmap};
use crate::read::Import;

/// A model with a rig of two cameras and a camera of its own, written by pycolmap.
fn fixture(form: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/colmap").join(form)
}

/// The text model after a replacement in one of its files, which must be there.
fn changed(file: &str, from: &str, to: &str) -> Result<Import, String> {
    let names = ["cameras.txt", "images.txt", "rigs.txt", "frames.txt"];
    let texts = names.map(|name| {
        let text = std::fs::read_to_string(fixture("rig_text").join(name)).unwrap();
        assert!(name != file || text.contains(from), "{name}: {text}");
        if name == file { text.replace(from, to) } else { text }
    });
    let [cameras, images, rigs, frames] = [0, 1, 2, 3].map(|k| (Path::new(names[k]), texts[k].as_bytes()));
    let points = (Path::new("points3D.txt"), &b""[..]);
    parse_model([cameras, images, points], Some([rigs, frames]), 0).map_err(|error| error.to_string())
}

fn message(file: &str, from: &str, to: &str) -> String {
    changed(file, from, to).unwrap_err()
}

const FIRST_IMAGE: &str = "1 0.99843790685865852 0.049973962402041015 0 0.024986981201020508 0 0 4 1 camera1/0.png";

#[test]
fn images_of_one_time_step_have_the_frame_of_their_rig() {
    for form in ["rig_text", "rig_binary"] {
        let import = read_colmap(&fixture(form), 0).unwrap();
        let frames: Vec<(&str, u64)> =
            import.scene.frames.iter().map(|f| (f.id.as_str(), f.extra["rig_frame"].as_u64().unwrap())).collect();
        let expected = [
            ("camera1/0.png", 10),
            ("camera1/1.png", 11),
            ("camera1/2.png", 12),
            ("camera2/0.png", 10),
            ("camera2/1.png", 11),
            ("camera2/2.png", 12),
            ("camera3/3.png", 13),
        ];
        assert_eq!(frames, expected);
        assert_eq!(
            import.notes[2],
            "1 rig with several sensors, 3 frames with several images, which have one rig_frame"
        );
        assert_eq!(import.notes.len(), 3);
    }
    // Each camera alone, as in models without rigs.
    let import = read_colmap(&fixture("text"), 0).unwrap();
    assert!(import.scene.frames.iter().all(|frame| frame.extra.is_empty()));
}

#[test]
fn images_without_poses_get_those_of_their_frames_and_rigs() {
    let images = std::fs::read_to_string(fixture("rig_text").join("images.txt")).unwrap();
    let without: String = images
        .lines()
        .map(|line| match line.split_whitespace().collect::<Vec<_>>()[..] {
            [id, .., camera, name] if !line.starts_with('#') => format!("{id} 0 0 0 0 0 0 0 {camera} {name}\n"),
            _ => format!("{line}\n"),
        })
        .collect();
    let computed = changed("images.txt", &images, &without).unwrap();
    assert_eq!(computed.notes[3], "the poses of 7 images were computed from the frames and rigs");
    // COLMAP's own poses, which it computes from the same rig.
    let expected = read_colmap(&fixture("rig_text"), 0).unwrap();
    let mut largest: f64 = 0.0;
    for (frame, other) in computed.scene.frames.iter().zip(&expected.scene.frames) {
        let pose = |frame: &crate::scene_file::FrameRecord| from_rows(&frame.cam_from_world.unwrap());
        assert_eq!(frame.id, other.id);
        largest = largest.max((pose(frame) - pose(other)).amax());
    }
    assert!(largest < 1e-14, "{largest}");
}

#[test]
fn inconsistent_rigs_are_named() {
    // The images of the second camera no longer fit to the rig.
    let moved = changed("rigs.txt", "-0.5 0.02 0.01", "-0.5 0.02 0.51").unwrap();
    assert_eq!(
        moved.notes[3],
        "the rigs are inconsistent with 3 images, such as \"camera2/0.png\" by 0 radians and 0.5 units: the poses of the file of \
         the images are used, COLMAP uses those of frames and rigs"
    );
    assert_eq!(moved.scene, read_colmap(&fixture("rig_text"), 0).unwrap().scene);
    let turned = changed("images.txt", FIRST_IMAGE, &FIRST_IMAGE.replace(" 0.0249", " 0.0349")).unwrap();
    assert!(turned.notes[3].starts_with("the rigs are inconsistent with 1 image, such as \"camera1/0.png\" by 0.01"));
    // A pose that is rounded to six digits is the same.
    let rounded = changed("images.txt", FIRST_IMAGE, "1 0.998438 0.049974 0 0.024987 0 0 4 1 camera1/0.png").unwrap();
    assert_eq!(rounded.notes.len(), 3);
    // Images that were removed by hand, and an image that is in no frame.
    assert_eq!(changed("images.txt", &format!("{FIRST_IMAGE}\n\n"), "").unwrap().scene.frames.len(), 6);
    let alone = changed("frames.txt", "4 2 CAMERA 1 1 CAMERA 2 2", "4 1 CAMERA 2 2").unwrap();
    assert_eq!(alone.notes[3], "1 image in no frame of the rigs, such as \"camera1/0.png\": their own poses are used");
    assert!(!alone.scene.frames[0].extra.contains_key("rig_frame"));
}

#[test]
fn a_sensor_without_a_pose_leaves_the_pose_to_the_image() {
    let without = |images: &str| {
        let rigs = "1 3 IMU 5 CAMERA 1 0 CAMERA 2 0\n2 1 CAMERA 3\n";
        let all = std::fs::read_to_string(fixture("rig_text").join("images.txt")).unwrap();
        let frames = std::fs::read(fixture("rig_text").join("frames.txt")).unwrap();
        let cameras = std::fs::read(fixture("rig_text").join("cameras.txt")).unwrap();
        let images = all.replace(FIRST_IMAGE, images);
        let file = |bytes| (Path::new("a.txt"), bytes);
        let model = [file(&cameras[..]), file(images.as_bytes()), file(&b""[..])];
        parse_model(model, Some([file(rigs.as_bytes()), file(&frames)]), 0).map_err(|error| error.to_string())
    };
    assert_eq!(without(FIRST_IMAGE).unwrap().notes.len(), 3);
    assert_eq!(
        without("1 0 0 0 0 0 0 0 1 camera1/0.png").unwrap_err(),
        "a.txt: image \"camera1/0.png\" has no pose, and its rig has none for the camera 1"
    );
}

#[test]
fn one_of_the_two_files_is_not_used() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["cameras.txt", "images.txt", "frames.txt"] {
        std::fs::copy(fixture("rig_text").join(name), folder.path().join(name)).unwrap();
    }
    let import = read_colmap(folder.path(), 0).unwrap();
    assert_eq!(import.notes[2], "frames.txt was not used: rigs.txt and frames.txt are needed together");
    assert!(import.scene.frames.iter().all(|frame| frame.extra.is_empty()));
}

#[test]
fn what_is_wrong_in_text_is_named_with_its_line() {
    insta::assert_snapshot!(message("rigs.txt", "1 2 CAMERA 1", "1 2 LIDAR 1"), @r#"rigs.txt:4: found the sensor type "LIDAR"; expected CAMERA or IMU"#);
    insta::assert_snapshot!(message("rigs.txt", "1 2 CAMERA 1", "1 3 CAMERA 1"), @"rigs.txt:4: the line ends after 14 fields; expected a sensor type");
    insta::assert_snapshot!(message("rigs.txt", "1 2 CAMERA 1", "1 1 CAMERA 1"), @"rigs.txt:4: the rig has 1 sensor; found more: CAMERA 2 1 0.98000449432380665 0.0049666295199309145 0.19866518079723661 -0.009933259039861829 -0.5 0.02 0.01");
    insta::assert_snapshot!(message("rigs.txt", "CAMERA 2 1", "CAMERA 1 1"), @"rigs.txt:4: sensor CAMERA 1 is twice in the rig");
    insta::assert_snapshot!(message("rigs.txt", "2 1 CAMERA 3", "2 1 CAMERA 2"), @"rigs.txt:5: sensor CAMERA 2 is in the rigs 1 and 2; expected one rig for each sensor");
    insta::assert_snapshot!(message("rigs.txt", "2 1 CAMERA 3", "1 1 CAMERA 3"), @"rigs.txt:5: the rig id 1 is used twice");
    insta::assert_snapshot!(message("frames.txt", "13 2 0.89", "13 7 0.89"), @"frames.txt:7: frame 13 has the rig 7, which is not in the file of the rigs");
    insta::assert_snapshot!(message("frames.txt", "13 2 0.89", "12 2 0.89"), @"frames.txt:7: the frame id 12 is used twice");
    insta::assert_snapshot!(message("frames.txt", "1 CAMERA 3 7", "1 CAMERA 2 7"), @"frames.txt:7: frame 13 has data of sensor CAMERA 2, which is not in its rig 2");
    insta::assert_snapshot!(message("frames.txt", "1 CAMERA 3 7", "1 CAMERA 3 7 CAMERA 3 8"), @"frames.txt:7: the line has more than its data ids: CAMERA 3 8");
    insta::assert_snapshot!(message("frames.txt", "CAMERA 1 1 CAMERA 2 2", "CAMERA 1 2 CAMERA 2 1"), @r#"images.txt: image "camera1/0.png" has the camera 1, and in frame 10 the camera 2"#);
    insta::assert_snapshot!(message("frames.txt", "CAMERA 1 1 CAMERA 2 2", "CAMERA 1 3 CAMERA 2 2"), @"frames.txt:5: image 3 is in the frames 10 and 11");
    insta::assert_snapshot!(message("frames.txt", "CAMERA 1 1 CAMERA 2 2", "CAMERA 1 4294967296 CAMERA 2 2"), @"frames.txt:4: the image id 4294967296 has more than 32 bits");
    insta::assert_snapshot!(message("frames.txt", "0.99843790685865852 0.049973962402041015 0 0.024986981201020508", "0 0 0 0"), @"frames.txt:4: frame 10 has the quaternion [0.0, 0.0, 0.0, 0.0], which is not a rotation");
}

#[test]
fn damaged_bytes_are_named_with_their_place() {
    let folder = fixture("rig_binary");
    let names = ["cameras.bin", "images.bin", "points3D.bin", "rigs.bin", "frames.bin"];
    let bytes = names.map(|name| std::fs::read(folder.join(name)).unwrap_or_default());
    let parse = |rigs: &[u8], frames: &[u8]| {
        let file = |index: usize| (Path::new(names[index]), bytes[index].as_slice());
        let rigs = [(Path::new(names[3]), rigs), (Path::new(names[4]), frames)];
        super::super::parse_binary([file(0), file(1), file(2)], Some(rigs), 0)
    };
    let [.., rigs, frames] = &bytes;
    assert!(parse(rigs, frames).is_ok());
    for length in 0..rigs.len() {
        assert!(parse(&rigs[..length], frames).is_err());
    }
    for length in 0..frames.len() {
        assert!(parse(rigs, &frames[..length]).is_err());
    }
    let mut wrong = rigs.clone();
    wrong[16] = 9;
    insta::assert_snapshot!(parse(&wrong, frames).unwrap_err(), @"rigs.bin: byte 24: found the sensor type 9; expected 0 (CAMERA) or 1 (IMU)");
    insta::assert_snapshot!(parse(rigs, &frames[..100]).unwrap_err(), @"frames.bin: byte 100: the file ends 0 bytes after this; expected a data id, 8 bytes");
    insta::assert_snapshot!(parse(rigs, &[frames.as_slice(), b"x"].concat()).unwrap_err(), @"frames.bin: byte 392: expected the end of the file; found 1 more bytes");
}
