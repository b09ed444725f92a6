//! Whole logs, made with the writers of this crate; logs of other programs are read by scripts/check_mcap.py.

use std::path::Path;

use super::*;
use crate::write::{BodyChoice, CheckedScene, mcap::mcap, test_scene};

fn log_of(file: &SceneFile) -> Vec<u8> {
    mcap(&CheckedScene::new(file, BodyChoice::Body).unwrap(), "map").content
}

fn scene() -> SceneFile {
    let mut file = test_scene::three_bodies();
    for (frame, time) in file.frames.iter_mut().zip([1_700_000_000.25, 1_700_000_000.5]) {
        frame.time = Some(time);
    }
    file
}

fn read(bytes: &[u8], options: McapOptions) -> Result<Import, ReadError> {
    parse_mcap(Path::new("log.mcap"), bytes.to_vec(), options)
}

fn skip_errors() -> McapOptions {
    McapOptions { skip_errors: true, ..McapOptions::default() }
}

#[test]
fn an_exported_scene_is_read_again() {
    let file = scene();
    let found = read(&log_of(&file), McapOptions::default()).unwrap();
    let again = &found.scene;
    assert_eq!(again.cameras[0].params, file.cameras[0].params);
    assert_eq!((again.up, again.length_unit.as_deref()), (Some([0.0, 0.0, 1.0]), Some("m")));
    assert_eq!(again.frames[1].id, "1700000000.500000000");
    for (a, b) in again.frames.iter().zip(&file.frames) {
        let (a_rows, b_rows) = (a.cam_from_world.unwrap(), b.cam_from_world.unwrap());
        let difference = a_rows.iter().flatten().zip(b_rows.iter().flatten()).map(|(a, b)| (a - b).abs());
        assert!(difference.fold(0.0, f64::max) < 1e-14, "{a_rows:?} {b_rows:?}");
        assert_eq!(a.time, b.time);
    }
    assert_eq!(again.detections.len(), file.detections.len());
    for (a, b) in again.detections.iter().zip(&file.detections) {
        assert_eq!((a.bounding_box, &a.category), (b.bounding_box, &b.category));
    }
    assert_eq!(
        found.notes,
        [
            "topics that are used: /cam/camera_info (calibration, 2 messages), /cam/detections (2D detections, 2 messages), \
             /tf (transforms, 2 messages)",
            "topics that are not used: /quadlift/map (3D bodies, which are no measurements in images, 1 message), \
             /quadlift/objects (3D bodies, which are no measurements in images, 2 messages)",
            "the world is the frame \"map\", the camera \"cam_optical_frame\"",
            "boxes are taken as measured in the raw image (K and D of the calibration; --rectified: P)",
            "pixel centers at halves: the principal points are as in the file",
            "poses of frames: 2 at the time of their transforms",
        ]
    );
}

/// Offsets of the top-level records with this opcode.
fn records(bytes: &[u8], wanted: u8) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while let Some(length) = bytes.get(at + 1..at + 9) {
        if bytes[at] == wanted {
            found.push(at);
        }
        at += 9 + u64::from_le_bytes(length.try_into().unwrap()) as usize;
    }
    found
}

/// A log with three chunks, each with a transform, a calibration and a detection; the first one with the definitions, too.
fn in_three_chunks() -> Vec<u8> {
    let mut writer = LogWriter::new();
    let tf = writer.channel("/tf", "tf2_msgs/msg/TFMessage", &definition("tf2_msgs/TFMessage"), false);
    let info = "sensor_msgs/CameraInfo";
    let info = writer.channel("/camera_info", "sensor_msgs/msg/CameraInfo", &definition(info), false);
    let boxes = "vision_msgs/Detection2DArray";
    let boxes = writer.channel("/boxes", "vision_msgs/msg/Detection2DArray", &definition(boxes), false);
    for (index, seconds) in [10, 11, 12].into_iter().enumerate() {
        let time = seconds * 1_000_000_000_u64;
        let header = |message: &mut CdrWriter, frame: &str| {
            message.i32(seconds as i32).u32(0).text(frame);
        };
        let mut message = CdrWriter::default();
        message.u32(1);
        header(&mut message, "map");
        message.text("camera").f64s([index as f64, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        writer.message(tf, time, &message.finish());
        let mut message = CdrWriter::default();
        header(&mut message, "camera");
        message.u32(480).u32(640).text("plumb_bob").u32(0);
        message.f64s([500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]).f64s([0.0; 9]).f64s([0.0; 12]);
        message.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0);
        writer.message(info, time, &message.finish());
        let mut message = CdrWriter::default();
        header(&mut message, "camera");
        message.u32(1);
        header(&mut message, "camera");
        message.u32(1).text("cup").f64(0.5).f64s([0.0; 43]).f64s([100.0, 90.0, 0.0, 20.0, 10.0]).text("7");
        writer.message(boxes, time, &message.finish());
        writer.end_chunk();
    }
    writer.finish()
}

fn times(found: &Import) -> Vec<f64> {
    found.scene.frames.iter().map(|frame| frame.time.unwrap()).collect()
}

#[test]
fn damaged_parts_are_named_and_the_rest_is_used() {
    let good = in_three_chunks();
    let found = read(&good, McapOptions::default()).unwrap();
    assert_eq!(times(&found), [10.0, 11.0, 12.0]);
    assert_eq!(found.scene.detections[0].object.as_deref(), Some("t7"));
    let chunks = records(&good, 0x06);
    assert_eq!(chunks.len(), 3);
    let refused = |bytes: &[u8]| read(bytes, McapOptions::default()).unwrap_err().to_string();
    // A bit of the second chunk: either lz4 or the checksum tells.
    let mut damaged = good.clone();
    damaged[chunks[1] + 70] ^= 4;
    let message = refused(&damaged);
    assert!(message.starts_with(&format!("log.mcap: byte {}: the chunk ", chunks[1])), "{message}");
    assert!(message.ends_with("it is left out; --skip-errors uses the rest"), "{message}");
    let found = read(&damaged, skip_errors()).unwrap();
    assert_eq!((times(&found), found.problem_count), (vec![10.0, 12.0], 1));
    // A length that cannot be true: the index at the end knows where the next chunk is.
    let mut damaged = good.clone();
    damaged[chunks[1] + 7] = 1;
    let message = refused(&damaged);
    assert!(message.contains(&format!("reading goes on with the chunk at byte {}", chunks[2])), "{message}");
    assert_eq!(times(&read(&damaged, skip_errors()).unwrap()), [10.0, 12.0]);
    // Cut off in the third chunk, with the index.
    let cut = &good[..chunks[2] + 60];
    assert!(refused(cut).contains("was cut off or is damaged"), "{}", refused(cut));
    assert_eq!(times(&read(cut, skip_errors()).unwrap()), [10.0, 11.0]);
    // Cut off between two chunks.
    let cut = &good[..chunks[2]];
    assert!(refused(cut).contains("the file ends without an end record"), "{}", refused(cut));
    // No MCAP at all.
    assert_eq!(refused(b"#ROSBAG V2.0\n").split(';').next(), Some("log.mcap: this is a ROS 1 bag"));
    assert_eq!(refused(b""), "log.mcap: the file is empty");
    assert!(refused(b"text text").contains("this is no MCAP file"));
}

/// The log with a text of the uncompressed first chunk replaced by one of the same length.
fn replaced(from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let good = in_three_chunks();
    let mut bytes = MAGIC_OF_FILE.to_vec();
    for at in records(&good, 0x06) {
        let length = u64::from_le_bytes(good[at + 1..at + 9].try_into().unwrap()) as usize;
        let compressed = &good[at + 9 + 8 * 3 + 4 + 4 + 3 + 8..at + 9 + length];
        let mut records = Vec::new();
        std::io::Read::read_to_end(&mut lz4_flex::frame::FrameDecoder::new(compressed), &mut records).unwrap();
        if let Some(at) = records.windows(from.len()).position(|window| window == from.as_bytes()) {
            records[at..at + from.len()].copy_from_slice(to.as_bytes());
        }
        bytes.extend(records);
    }
    bytes.extend([0x0F, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    bytes.extend(MAGIC_OF_FILE);
    bytes
}

const MAGIC_OF_FILE: &[u8] = container::MAGIC;

#[test]
fn what_cannot_be_decoded_is_named() {
    let refused = |bytes: &[u8]| read(bytes, McapOptions::default()).unwrap_err().to_string();
    assert_eq!(times(&read(&replaced("none", "none"), McapOptions::default()).unwrap()).len(), 3);
    let encoding = replaced("/boxes\u{3}\0\0\0cdr", "/boxes\u{3}\0\0\0xyz");
    assert_eq!(
        refused(&encoding),
        "log.mcap: /boxes: its messages have the encoding \"xyz\" with a schema in \"ros2msg\", which is not supported; \
         expected cdr (ros2msg or ros2idl), json or protobuf; --skip-errors uses the rest"
    );
    let schema = replaced("vision_msgs/Detection2D[] detections", "vision_msgs/Detection2E[] detections");
    assert!(refused(&schema).contains("the schema does not define vision_msgs/Detection2E"), "{}", refused(&schema));
    // Another layout than the messages have.
    let layout = replaced("float64 size_y", "int32[] size_y");
    let message = refused(&layout);
    assert!(message.starts_with("log.mcap: byte ") && message.contains("/boxes: "), "{message}");
    let world = McapOptions { world_frame: Some("odom".into()), ..McapOptions::default() };
    assert_eq!(
        read(&in_three_chunks(), world).unwrap_err().problem,
        "no transforms lead from the camera's frame \"camera\" to \"odom\"; the trees begin at map (--world-frame, \
         --camera-frame)"
    );
    let topics = McapOptions { topics: vec!["/box".into()], ..McapOptions::default() };
    assert_eq!(
        read(&in_three_chunks(), topics).unwrap_err().problem,
        "there is no topic \"/box\" with messages that can be read (--topics); there are /boxes, /camera_info, /tf"
    );
}

#[test]
fn memory_is_bounded_by_what_waits() {
    // Ten minutes of transforms at 100 Hz and one frame in each second.
    let mut writer = LogWriter::new();
    let tf = writer.channel("/tf", "tf2_msgs/msg/TFMessage", &definition("tf2_msgs/TFMessage"), false);
    for k in 0..60_000_u64 {
        let time = k * 10_000_000;
        let mut message = CdrWriter::default();
        message.u32(1).i32((time / 1_000_000_000) as i32).u32((time % 1_000_000_000) as u32).text("map");
        message.text("camera").f64s([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        writer.message(tf, time, &message.finish());
    }
    let bytes = writer.finish();
    let mut tree = tree::Tree::default();
    let mut reader = container::LogReader::new(io::Cursor::new(bytes), Box::new(|_| true)).unwrap().unwrap();
    let mut decoders = decode::Decoders::default();
    let mut most = 0;
    while let Some(container::Item::Message(message)) = reader.next_item().unwrap() {
        let value = decoders.of(&message.channel).0.unwrap().decode(&message.data).unwrap();
        for transform in messages::transforms(&value).unwrap() {
            tree.insert(transform.unwrap(), false).unwrap();
        }
        tree.forget_before(message.log_time as i64);
        most = most.max(tree.transforms());
    }
    assert!((3000..3010).contains(&most), "{most}");
}
