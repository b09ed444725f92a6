//! The node without a network, on recorded messages.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod common;

use std::path::Path;

use common::{FRAMES, drive, log_of, map_of_stream, messages, options};
use quadlift_io::mcap::{RecordedMessage, definition, message_to_json};
use quadlift_ros2::Session;
use quadlift_ros2::arguments::Level;
use quadlift_ros2::bytes::Bytes;
use quadlift_ros2::query::{Query, read_answer};
use quadlift_ros2::session::{Action, Output};
use serde_json::Value;

/// What a session has done.
#[derive(Default)]
struct Done {
    log: Vec<String>,
    events: Vec<Value>,
    /// The last messages.
    map: Option<Bytes>,
    markers: Option<Bytes>,
    json: Option<Bytes>,
    status: Option<Bytes>,
}

/// A session with a clock.
struct Robot {
    session: Session,
    now: f64,
    done: Done,
}

impl Robot {
    fn new(more: &[&str]) -> Self {
        Self { session: Session::new(options(more)).unwrap(), now: 0.0, done: Done::default() }
    }

    fn send(&mut self, message: &RecordedMessage) {
        let bytes = Bytes(message.data.clone());
        match message.kind.as_str() {
            "tf2_msgs/msg/TFMessage" => self.session.transforms(&message.topic, &bytes, false),
            "sensor_msgs/msg/CameraInfo" => self.session.calibration(&message.topic, &bytes),
            "vision_msgs/msg/Detection2DArray" => self.session.detections(&message.topic, &bytes, self.now),
            other => panic!("{other}"),
        }
        self.now += 0.001;
        self.work();
    }

    fn work(&mut self) {
        let actions: Vec<Action> = self.session.work(self.now).collect();
        for action in actions {
            match action {
                Action::Log(Level::Debug, _) => {}
                Action::Log(_, text) => self.done.log.push(text),
                Action::Estimate(snapshot) => {
                    let estimate = snapshot.estimate(self.session.options());
                    self.session.estimated(estimate);
                    self.work();
                }
                Action::Publish(Output::Map, message) => self.done.map = Some(message),
                Action::Publish(Output::Markers, message) => self.done.markers = Some(message),
                Action::Publish(Output::ObjectsJson, message) => self.done.json = Some(message),
                Action::Publish(Output::Diagnostics, message) => self.done.status = Some(message),
                Action::Publish(Output::Events, message) => {
                    self.done.events.push(serde_json::from_str(&text(&message)).unwrap());
                }
            }
        }
    }

    /// Lets the time between two estimates go by.
    fn pause(&mut self) {
        self.now += 2.0;
        self.work();
    }

    fn saved(&mut self, folder: &Path) -> String {
        self.session.save().unwrap();
        std::fs::read_to_string(folder.join("map.json")).unwrap()
    }

    /// Ids of the objects that match.
    fn query(&self, query: &Query) -> Vec<String> {
        let answer = read_answer(&self.session.query(&query.write()).0).unwrap();
        assert_eq!(answer["success"], 1, "{answer}");
        ids(&answer["objects"])
    }
}

fn text(message: &Bytes) -> String {
    let json = message_to_json("std_msgs/String", "string data\n", &message.0).unwrap();
    json["data"].as_str().unwrap().to_owned()
}

fn json(kind: &str, message: &Option<Bytes>) -> Value {
    message_to_json(kind, &definition(kind), &message.as_ref().unwrap().0).unwrap()
}

fn ids(array: &Value) -> Vec<String> {
    array["detections"].as_array().unwrap().iter().map(|object| object["id"].as_str().unwrap().to_owned()).collect()
}

fn files(folder: &Path) -> [String; 2] {
    let name = |file: &str| folder.join(file).display().to_string();
    [format!("state_file:={}", name("map.state")), format!("map_file:={}", name("map.json"))]
}

#[test]
fn the_map_is_that_of_quadlift_stream() {
    let folder = tempfile::tempdir().unwrap();
    let log = log_of(&drive());
    let expected = map_of_stream(&log, folder.path());
    let [state, map] = files(folder.path());
    let mut robot = Robot::new(&[&state, &map]);
    messages(&log).iter().for_each(|message| robot.send(message));
    assert_eq!(robot.done.log, [""; 0]);
    assert_eq!(robot.done.events.len(), FRAMES);
    assert!(robot.saved(folder.path()) == expected);
    // Transforms that come late.
    let mut late = Robot::new(&[&state, &map]);
    let mut all = messages(&log);
    all.sort_by_key(|message| {
        (message.log_time + if message.topic == "/tf" { 300_000_000 } else { 0 }, message.topic.clone())
    });
    all.iter().for_each(|message| late.send(message));
    assert_eq!(late.done.log, [""; 0]);
    assert!(late.saved(folder.path()) == expected);
}

/// A message of the node, as tools show it.
fn status_of(message: &Option<Bytes>) -> Value {
    const DEFINITION: &str = "std_msgs/Header header\nDiagnosticStatus[] status\n\
        ================================================================================\nMSG: std_msgs/Header\n\
        builtin_interfaces/Time stamp\nstring frame_id\n\
        ================================================================================\nMSG: builtin_interfaces/Time\n\
        int32 sec\nuint32 nanosec\n\
        ================================================================================\nMSG: diagnostic_msgs/DiagnosticStatus\n\
        byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values\n\
        ================================================================================\nMSG: diagnostic_msgs/KeyValue\n\
        string key\nstring value\n";
    message_to_json("diagnostic_msgs/DiagnosticArray", DEFINITION, &message.as_ref().unwrap().0).unwrap()["status"][0]
        .clone()
}

#[test]
fn a_status_says_whether_poses_and_boxes_agree() {
    let all = messages(&log_of(&drive()));
    let mut robot = Robot::new(&[]);
    robot.work();
    let status = status_of(&robot.done.status);
    assert_eq!((&status["level"], &status["name"]), (&0.into(), &"quadlift: consistency".into()));
    assert!(status["message"].as_str().unwrap().starts_with("not checked"), "{status}");
    all.iter().for_each(|message| robot.send(message));
    robot.pause();
    let status = status_of(&robot.done.status);
    assert_eq!((&status["level"], &status["values"][0]["value"]), (&0.into(), &FRAMES.to_string().into()), "{status}");
    assert_eq!(status["message"], "poses, cameras and boxes are consistent");
}

#[test]
fn a_state_is_saved_and_loaded() {
    let folder = tempfile::tempdir().unwrap();
    let log = log_of(&drive());
    let expected = map_of_stream(&log, folder.path());
    let [state, map] = files(folder.path());
    let all = messages(&log);
    let (first, second) = all.split_at(all.len() / 2);
    let mut robot = Robot::new(&[&state, &map]);
    first.iter().for_each(|message| robot.send(message));
    assert!(robot.session.save().unwrap().contains("map.state and "));
    let mut next = Robot::new(&[&state, &map, "resume:=true"]);
    next.work();
    assert!(next.done.log[0].starts_with("goes on from "), "{:?}", next.done.log);
    // Cameras and transforms are not in the state.
    all.iter().filter(|message| message.topic == "/front/camera_info").take(1).for_each(|message| next.send(message));
    second.iter().for_each(|message| next.send(message));
    assert!(next.saved(folder.path()) == expected);
    assert_eq!(next.session.reset().unwrap(), "the map is empty");
    next.pause();
    assert_eq!(ids(&json("vision_msgs/Detection3DArray", &next.done.map)), [""; 0]);
    assert!(next.session.load().unwrap().contains("60 frames"));
    next.pause();
    assert!(!ids(&json("vision_msgs/Detection3DArray", &next.done.map)).is_empty());
    assert!(Robot::new(&[]).session.save().unwrap_err().contains("state_file and map_file are empty"));
    let mut other = Robot::new(&[&state, "min_views:=4"]);
    assert!(other.session.load().unwrap_err().contains("--min-views 3, and now it is 4"));
    std::fs::write(folder.path().join("map.state"), "{").unwrap();
    assert!(next.session.load().unwrap_err().contains("map.state"));
}

#[test]
fn what_is_published_has_all_objects() {
    let mut robot = Robot::new(&[]);
    messages(&log_of(&drive())).iter().for_each(|message| robot.send(message));
    robot.pause();
    let map = json("vision_msgs/Detection3DArray", &robot.done.map);
    let found = ids(&map);
    assert!(found.len() > 20, "{found:?}");
    assert_eq!(map["header"]["frame_id"], "map");
    assert_eq!(
        (&map["header"]["stamp"]["sec"], &map["header"]["stamp"]["nanosec"]),
        (&1_700_000_007.into(), &375_000_000.into())
    );
    let covariance = map["detections"][0]["results"][0]["pose"]["covariance"].as_array().unwrap();
    assert!(covariance[0].as_f64().unwrap() > 0.0);
    let markers = json("visualization_msgs/MarkerArray", &robot.done.markers);
    let markers = markers["markers"].as_array().unwrap();
    assert_eq!((markers.len(), &markers[0]["action"]), (1 + 2 * found.len(), &3.into()));
    let objects: Value = serde_json::from_str(&text(robot.done.json.as_ref().unwrap())).unwrap();
    assert_eq!(objects["format"], "quadlift.scene");
    let of_json: Vec<&str> =
        objects["objects"].as_array().unwrap().iter().map(|object| object["id"].as_str().unwrap()).collect();
    assert!(found.iter().all(|id| of_json.contains(&id.as_str())));
}

#[test]
fn objects_are_found_by_category_place_and_view() {
    let mut robot = Robot::new(&[]);
    let early = robot.session.query(&Query::default().write());
    assert_eq!(read_answer(&early.0).unwrap()["message"], "there is no estimate so far");
    messages(&log_of(&drive())).iter().for_each(|message| robot.send(message));
    robot.pause();
    let map = json("vision_msgs/Detection3DArray", &robot.done.map);
    let expected = |is_wanted: &dyn Fn(&Value) -> bool| -> Vec<String> {
        let wanted = map["detections"].as_array().unwrap().iter().filter(|object| is_wanted(object));
        wanted.map(|object| object["id"].as_str().unwrap().to_owned()).collect()
    };
    let all = robot.query(&Query::default());
    assert_eq!(all, ids(&map));
    let vans = robot.query(&Query { category: Some("van".into()), ..Query::default() });
    assert_eq!(vans, expected(&|object| object["results"][0]["hypothesis"]["class_id"] == "van"));
    assert!(!vans.is_empty() && vans.len() < all.len());
    let x = |object: &Value| object["results"][0]["pose"]["pose"]["position"]["x"].as_f64().unwrap();
    let mut xs: Vec<f64> = map["detections"].as_array().unwrap().iter().map(x).collect();
    xs.sort_by(f64::total_cmp);
    let middle = xs[xs.len() / 2];
    let corners = Some([[-1e6, -1e6, -1e6], [middle, 1e6, 1e6]]);
    assert_eq!(robot.query(&Query { corners, ..Query::default() }), expected(&|object| x(object) <= middle));
    let seen = robot.query(&Query { in_view: true, ..Query::default() });
    assert!(!seen.is_empty() && seen.len() < all.len(), "{} of {}", seen.len(), all.len());
    assert_eq!(robot.query(&Query { in_view: true, camera: Some("front".into()), ..Query::default() }), seen);
    let other = Query { in_view: true, camera: Some("rear".into()), ..Query::default() };
    let answer = read_answer(&robot.session.query(&other.write()).0).unwrap();
    assert_eq!(
        (&answer["success"], &answer["message"]),
        (&0.into(), &"there is no image of the camera \"rear\"".into())
    );
    let answer = read_answer(&robot.session.query(&Bytes(vec![0, 1, 0, 0, 1])).0).unwrap();
    assert_eq!(answer["success"], 0);
}

#[test]
fn bad_messages_are_told_and_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let log = log_of(&drive());
    let expected = map_of_stream(&log, folder.path());
    let [state, map] = files(folder.path());
    let mut robot = Robot::new(&[&state, &map]);
    for (index, message) in messages(&log).iter().enumerate() {
        // Cut off anywhere, and with any byte changed.
        let mut cut = message.clone();
        cut.data.truncate((index * 37) % message.data.len());
        robot.send(&cut);
        let mut bad = message.clone();
        bad.data.truncate(24);
        bad.data.extend([255; 40]);
        robot.send(&bad);
        robot.send(message);
    }
    assert!(robot.done.log.len() > FRAMES);
    assert!(robot.done.log.iter().all(|text| text.starts_with('/')), "{:?}", robot.done.log);
    assert!(robot.done.log.iter().any(|text| text.contains("ends too early")));
    assert!(robot.saved(folder.path()) == expected);
}

#[test]
fn another_calibration_of_a_loaded_map_has_another_id() {
    let folder = tempfile::tempdir().unwrap();
    let [state, map] = files(folder.path());
    let mut file = drive();
    let mut robot = Robot::new(&[&state, &map]);
    messages(&log_of(&file)).iter().for_each(|message| robot.send(message));
    robot.session.save().unwrap();
    file.cameras[0].params[0] += 1.0;
    file.frames.iter_mut().for_each(|frame| frame.time = frame.time.map(|time| time + 60.0));
    let mut next = Robot::new(&[&state, &map, "resume:=true"]);
    messages(&log_of(&file)).iter().for_each(|message| next.send(message));
    assert_eq!((next.done.log.len(), next.done.events.len()), (1, FRAMES), "{:?}", next.done.log);
    let saved: Value = serde_json::from_str(&next.saved(folder.path())).unwrap();
    let cameras: Vec<&str> =
        saved["cameras"].as_array().unwrap().iter().map(|camera| camera["id"].as_str().unwrap()).collect();
    assert_eq!(cameras, ["front", "front#2"]);
}
