//! A synthetic drive as a log of a robot, and the map that `quadlift stream` makes of it.

#![allow(dead_code)]

use std::path::Path;
use std::process::Command;

use quadlift::geometry::BodyKind;
use quadlift::online::ObjectMap;
use quadlift::synthetic::{Detector, Noise, Observations, SyntheticIds, SyntheticOptions, Trajectory, generate};
use quadlift_io::SceneFile;
use quadlift_io::mcap::{McapOptions, RecordedMessage, parse_mcap, recorded_messages};
use quadlift_io::scene_file::{CameraRecord, DetectionRecord, FrameRecord, write_scene};
use quadlift_io::stream::{StreamState, scene_to_frames};
use quadlift_io::write::mcap::mcap;
use quadlift_io::write::{BodyChoice, CheckedScene};
use quadlift_ros2::Options;
use quadlift_ros2::arguments::{Arguments, Wish};
use quadlift_ros2::estimation::Snapshot;

/// Frames of the drive.
pub const FRAMES: usize = 60;

/// A drive along parked cars: misses, false boxes, no ids. Every other car is a van.
pub fn drive() -> SceneFile {
    let options = SyntheticOptions {
        seed: 7,
        objects: FRAMES / 3 + 17,
        views: FRAMES,
        body: BodyKind::Cuboid,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        detector: Detector { misses: 0.1, false_boxes: 0.05, ..Detector::default() },
        ids: SyntheticIds::Absent,
        ..SyntheticOptions::default()
    };
    let synthetic = generate(&options).unwrap();
    let first = &synthetic.frames[0];
    let intrinsics = first.intrinsics;
    let mut file = SceneFile { length_unit: Some("m".into()), up: Some([0.0, 0.0, 1.0]), ..SceneFile::default() };
    file.cameras.push(CameraRecord {
        id: "front".into(),
        model: "PINHOLE".into(),
        width: Some(first.width.into()),
        height: Some(first.height.into()),
        params: vec![intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy],
        ..CameraRecord::default()
    });
    for (index, frame) in synthetic.frames.iter().enumerate() {
        let pose = frame.cam_from_world.matrix();
        file.frames.push(FrameRecord {
            id: frame.id.clone(),
            camera: Some("front".into()),
            cam_from_world: Some(std::array::from_fn(|i| std::array::from_fn(|j| pose[(i, j)]))),
            time: Some(1_700_000_000.0 + 0.125 * index as f64),
            ..FrameRecord::default()
        });
    }
    for (detection, object) in synthetic.scene.detections.iter().zip(&synthetic.true_objects) {
        let category = if object.is_some_and(|index| index % 2 == 1) { "van" } else { "car" };
        file.detections.push(DetectionRecord {
            frame: synthetic.frames[detection.frame_index as usize].id.as_str().into(),
            category: Some(category.into()),
            score: Some(0.9),
            bounding_box: detection.bounding_box.map(|b| b.edges()),
            ..DetectionRecord::default()
        });
    }
    file
}

/// The log of a scene.
pub fn log_of(file: &SceneFile) -> Vec<u8> {
    mcap(&CheckedScene::new(file, BodyChoice::Body).unwrap(), "map").content
}

/// The messages of a log that a robot sends.
pub fn messages(log: &[u8]) -> Vec<RecordedMessage> {
    let all = recorded_messages("log.mcap".as_ref(), log).unwrap();
    all.into_iter().filter(|message| !message.topic.starts_with("/quadlift")).collect()
}

/// Options of the node for the drive, and more parameters.
pub fn options(more: &[&str]) -> Options {
    let topics = ["detections_topics:=[/front/detections]", "camera_info_topics:=[/front/camera_info]"];
    let words = topics.iter().chain(more).flat_map(|set| ["-p".to_owned(), (*set).to_owned()]);
    match Arguments::read(["--ros-args".to_owned()].into_iter().chain(words)).unwrap() {
        Wish::Run(arguments) => Options::new(&arguments).unwrap(),
        Wish::Print(text) => panic!("{text}"),
    }
}

/// The result file of `quadlift stream LOG --map`: of the program that the environment variable names, or of the library.
pub fn map_of_stream(log: &[u8], folder: &Path) -> String {
    let Ok(program) = std::env::var("QUADLIFT_PROGRAM") else {
        return text_of(&Snapshot::new(&stream_of(log)).result(&options(&[])).unwrap());
    };
    let (input, map) = (folder.join("log.mcap"), folder.join("stream.json"));
    std::fs::write(&input, log).unwrap();
    let run = Command::new(program).arg("stream").arg(&input).arg("--map").arg(&map).output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
    std::fs::read_to_string(map).unwrap()
}

/// The map of a log, frame by frame.
fn stream_of(log: &[u8]) -> StreamState {
    let file = parse_mcap("log.mcap".as_ref(), log.to_vec(), McapOptions::default()).unwrap().scene;
    let scene = file.to_scene().unwrap();
    let (about, frames) = scene_to_frames(file, &scene, None);
    let map = ObjectMap::new(options(&[]).map).unwrap();
    let mut stream = StreamState { map, scene: Default::default(), poses_since: 0 };
    stream.scene.take_in(&about).unwrap();
    for frame in frames {
        let checked = stream.scene.check(frame, &stream.map).unwrap();
        stream.map.observe(&checked.frame, &checked.detections()).unwrap();
        stream.scene.keep(checked, &stream.map);
    }
    stream
}

/// A file as text.
pub fn text_of(file: &SceneFile) -> String {
    let mut bytes = Vec::new();
    write_scene(file, &mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}
