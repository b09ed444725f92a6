//! Messages of a robot in the orders in which they arrive.

use super::super::CdrWriter;
use super::super::tree::SECOND;
use super::*;
use crate::stream::FrameLine;

const START: i64 = 1_700_000_000 * SECOND;

fn header<'a>(message: &'a mut CdrWriter, stamp: i64, frame: &str) -> &'a mut CdrWriter {
    message.i32((stamp / SECOND) as i32).u32((stamp % SECOND) as u32).text(frame)
}

fn transform(parent: &str, child: &str, stamp: i64, x: f64) -> Vec<u8> {
    let mut message = CdrWriter::default();
    header(message.u32(1), stamp, parent).text(child).f64s([x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
    message.finish()
}

fn info(frame: &str) -> Vec<u8> {
    let mut message = CdrWriter::default();
    header(&mut message, START, frame).u32(480).u32(640).text("plumb_bob").u32(0);
    message.f64s([500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0]).f64s([0.0; 21]);
    message.u32(0).u32(0).u32(0).u32(0).u32(0).u32(0).u8(0);
    message.finish()
}

fn boxes(frame: &str, stamp: i64) -> Vec<u8> {
    let mut message = CdrWriter::default();
    header(&mut message, stamp, frame).u32(1);
    header(&mut message, stamp, frame).u32(1).text("cup").f64(0.9).f64s([0.0; 43]);
    message.f64s([320.0, 240.0, 0.0, 40.0, 20.0]).text("7");
    message.finish()
}

fn live() -> LiveFrames {
    let mut live = LiveFrames::new(LiveOptions::default()).unwrap();
    live.transforms("/tf_static", &transform("base", "cam", 0, 0.1), true);
    live
}

fn frame(next: Option<Next>) -> FrameLine {
    match next {
        Some(Next::Frame(frame)) => *frame,
        other => panic!("{other:?}"),
    }
}

fn problem(next: Option<Next>) -> String {
    match next {
        Some(Next::Problem(problem)) => problem.to_string(),
        other => panic!("{other:?}"),
    }
}

#[test]
fn detections_wait_for_cameras_and_transforms() {
    let mut live = live();
    live.detections("/boxes", &boxes("cam", START + SECOND / 2), 5.0);
    assert_eq!((live.next_frame(5.0), live.waiting()), (None, 1));
    live.calibration("/front/camera_info", &info("cam"));
    live.transforms("/tf", &transform("map", "base", START, 1.0), false);
    assert_eq!(live.next_frame(5.1), None, "a later transform is better than the nearest one");
    live.transforms("/tf", &transform("map", "base", START + SECOND, 2.0), false);
    let frame = frame(live.next_frame(5.2));
    assert_eq!(frame.record.id, "1700000000.500000000");
    assert_eq!(frame.camera.unwrap().id.as_deref(), Some("front"));
    assert!((frame.record.cam_from_world.unwrap()[0][3] + 1.6).abs() < 1e-12);
    assert_eq!(frame.detections[0].bounding_box, Some([300.0, 230.0, 340.0, 250.0]));
    assert_eq!(frame.detections[0].object.as_deref(), Some("t7"));
    assert_eq!((live.next_frame(9.0), live.waiting()), (None, 0));
}

#[test]
fn what_is_dropped_is_told() {
    let mut live = live();
    live.detections("/boxes", &boxes("cam", START), 5.0);
    assert_eq!(
        problem(live.next_frame(6.0)),
        "/boxes: the detections of the time 1700000000.000000000 are dropped: no calibration has come"
    );
    live.calibration("/camera_info", &info("cam"));
    live.detections("/boxes", &boxes("cam", START), 7.0);
    assert!(problem(live.next_frame(8.0)).ends_with("no transforms lead from the frame \"map\" to \"cam\""));
    live.transforms("/tf", &transform("map", "base", START, 1.0), false);
    live.detections("/boxes", &boxes("cam", START + SECOND), 8.0);
    live.detections("/boxes", &boxes("cam", START + SECOND), 8.0);
    assert!(problem(live.next_frame(8.0)).contains("two messages for the time 1700000001.000000000"));
    assert_eq!(live.next_frame(8.5), None);
    assert!(problem(live.next_frame(9.0)).contains("1 s after the last transform map -> base"));
    live.detections("/boxes", &boxes("other", START), 10.0);
    assert_eq!(frame(live.next_frame(10.0)).record.id, "1700000000.000000000", "the only camera there is");
}

#[test]
fn a_full_queue_gives_way() {
    let mut live = LiveFrames::new(LiveOptions { most_waiting: 2, ..LiveOptions::default() }).unwrap();
    for k in 0..3 {
        live.detections("/boxes", &boxes("cam", START + k), 0.0);
    }
    assert!(problem(live.next_frame(0.0)).ends_with("no calibration has come; more than 2 messages wait"));
    assert_eq!((live.next_frame(0.0), live.waiting()), (None, 2));
}

#[test]
fn several_cameras_are_put_into_the_order_of_their_times() {
    let options = LiveOptions { cameras: 2, reorder: 0.1, ..LiveOptions::default() };
    let mut live = LiveFrames::new(options).unwrap();
    for camera in ["left", "right"] {
        live.transforms("/tf_static", &transform("map", camera, 0, 0.1), true);
    }
    live.calibration("/left/camera_info", &info("left"));
    live.detections("/right/boxes", &boxes("right", START), 0.0);
    assert_eq!(live.next_frame(0.5), None, "it is not the left camera");
    live.calibration("/right/camera_info", &info("right"));
    live.detections("/left/boxes", &boxes("left", START - 1), 0.45);
    assert_eq!(live.next_frame(0.5), None);
    let ids = [0.56, 0.56].map(|now| frame(live.next_frame(now)).record.id);
    assert_eq!(ids, ["left/1699999999.999999999", "right/1700000000.000000000"]);
}

#[test]
fn a_clock_that_jumps_back_and_bad_bytes_are_told() {
    let mut live = live();
    live.calibration("/camera_info", &info("cam"));
    live.transforms("/tf", &transform("map", "base", START + 60 * SECOND, 1.0), false);
    live.transforms("/tf", &transform("map", "base", START, 3.0), false);
    assert!(problem(live.next_frame(0.0)).starts_with("/tf: the clock jumps back by 60 s"));
    live.detections("/boxes", &boxes("cam", START), 0.0);
    assert!((frame(live.next_frame(0.0)).record.cam_from_world.unwrap()[0][3] + 3.1).abs() < 1e-12);
    live.detections("/boxes", &boxes("cam", START)[..30], 0.0);
    assert!(problem(live.next_frame(0.0)).contains("ends too early"));
    live.transforms("/tf", &[], false);
    assert!(problem(live.next_frame(0.0)).contains("has 0 bytes"));
    live.transforms("/tf", &transform("other", "base", START, 3.0), false);
    assert!(problem(live.next_frame(0.0)).contains("has the parents \"map\" and \"other\""));
}

#[test]
fn both_byte_orders_are_read() {
    let mut live = live();
    // A transform by hand: one entry, its header, names and numbers.
    let mut big = vec![0, 0, 0, 0, 0, 0, 0, 1];
    big.extend(1_700_000_000_i32.to_be_bytes());
    big.extend([0, 0, 0, 0, 0, 0, 0, 4, b'm', b'a', b'p', 0, 0, 0, 0, 5, b'b', b'a', b's', b'e', 0, 0, 0, 0]);
    big.resize(4 + (big.len() - 4).next_multiple_of(8), 0);
    for x in [2.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0] {
        big.extend(x.to_be_bytes());
    }
    live.transforms("/tf", &big, false);
    live.calibration("/camera_info", &info("cam"));
    live.detections("/boxes", &boxes("cam", START), 0.0);
    assert!((frame(live.next_frame(0.0)).record.cam_from_world.unwrap()[0][3] + 2.1).abs() < 1e-12);
}

#[test]
fn old_transforms_are_forgotten() {
    let mut live = live();
    for k in 0..1000 {
        live.transforms("/tf", &transform("map", "base", START + k * SECOND / 10, 1.0), false);
    }
    assert!(live.tree.transforms() < 110, "{}", live.tree.transforms());
}

#[test]
fn options_out_of_range_are_named() {
    let error = |options| LiveFrames::new(options).unwrap_err();
    assert!(error(LiveOptions { longest_gap: -1.0, ..LiveOptions::default() }).starts_with("the longest gap is -1"));
    assert!(error(LiveOptions { world_frame: String::new(), ..LiveOptions::default() }).contains("world frame"));
}

/// The seed of the fuzz target `live`: messages of a short drive. `QUADLIFT_WRITE_SEEDS=1` writes it.
#[test]
fn the_seed_of_the_fuzz_target_is_that_of_this_file() {
    let mut messages = vec![(b's', transform("base", "cam", 0, 0.1)), (b'c', info("cam"))];
    for k in 0..4 {
        messages.push((b'd', boxes("cam", START + k * SECOND / 4)));
        messages.push((b't', transform("map", "base", START + k * SECOND / 4, 0.3 * k as f64)));
    }
    let messages: Vec<Vec<u8>> = messages.into_iter().map(|(kind, data)| [&[kind], data.as_slice()].concat()).collect();
    let seed = messages.join(&b"=====\n"[..]);
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds/live/drive.bin");
    if std::env::var_os("QUADLIFT_WRITE_SEEDS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, &seed).unwrap();
    }
    assert!(std::fs::read(&path).unwrap() == seed);
}
