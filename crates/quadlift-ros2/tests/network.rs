//! Two processes in a network of their own: the node, and a robot that sends a synthetic drive and looks at what comes back. Nothing
//! leaves the network namespace; where none can be had, the test says so.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod common;

use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use common::{FRAMES, drive, log_of, map_of_stream, messages};
use quadlift_io::mcap::{CdrWriter, definition, message_to_json};
use quadlift_ros2::bytes::Bytes;
use quadlift_ros2::query::{Query, read_answer};
use ros2_client::qos::{Durability, History, WhenFull};
use ros2_client::service::Client;
use ros2_client::{
    Context, MessageTypeName, Name, Node, NodeName, NodeOptions, Publisher, QosProfile, ServiceMapping,
    ServiceTypeName, Subscription,
};
use serde_json::Value;

/// Brings up a network that has the loopback interface alone, and sends multicast there.
const NETWORK: &str = "ip link set lo up && ip route add 224.0.0.0/4 dev lo";
/// Tells the robot that it is in that network.
const INSIDE: &str = "QUADLIFT_IN_NAMESPACE";

fn in_namespace(script: &str) -> Command {
    let mut command = Command::new("unshare");
    command.args(["--user", "--map-root-user", "--net", "sh", "-c", &format!("{NETWORK} && {script}"), "sh"]);
    command
}

#[test]
fn a_robot_gets_the_map_of_quadlift_stream() {
    let can_have_one = in_namespace("true").stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !can_have_one.is_ok_and(|status| status.success()) {
        println!("skipped: this system gives no network namespace (unshare, ip); tests/recorded.rs needs none");
        assert!(std::env::var_os("QUADLIFT_REQUIRE_NAMESPACE").is_none(), "a network namespace is required here");
        return;
    }
    let program = std::env::current_exe().unwrap();
    let mut robot = in_namespace("exec \"$@\"");
    robot.arg(program).args(["--exact", "robot", "--ignored", "--nocapture"]).env(INSIDE, "1");
    assert!(robot.status().unwrap().success());
}

/// What a subscription has given, in its order.
struct Received(Receiver<Bytes>);

impl Received {
    /// The next message that fulfils a condition, within half a minute.
    fn next(&self, what: &str, is_wanted: impl Fn(&Value) -> bool, json: impl Fn(&Bytes) -> Value) -> Value {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(30) {
            if let Ok(message) = self.0.recv_timeout(Duration::from_millis(100)) {
                let json = json(&message);
                if is_wanted(&json) {
                    return json;
                }
            }
        }
        panic!("there is no {what} within 30 s");
    }
}

struct Robot {
    node: Node,
}

fn name(name: &str) -> Name {
    let (namespace, base) = name.rsplit_once('/').unwrap();
    Name::new(if namespace.is_empty() { "/" } else { namespace }, base).unwrap()
}

fn qos(durability: Durability) -> QosProfile {
    let when_full = WhenFull::Wait(Duration::from_secs(5));
    QosProfile::publisher_default()
        .reliability_reliable(when_full)
        .durability(durability)
        .history(History::KeepLast { depth: 1000 })
}

impl Robot {
    fn new() -> Self {
        let context = Context::new().unwrap();
        let mut node = context.new_node(NodeName::new("/", "robot").unwrap(), NodeOptions::new()).unwrap();
        let spinner = node.spinner().unwrap();
        std::thread::spawn(move || futures::executor::block_on(spinner.spin()));
        Self { node }
    }

    fn publisher(&mut self, topic: &str, kind: &str) -> Publisher<Bytes> {
        let (package, kind) = kind.split_once("/msg/").unwrap();
        let qos = qos(Durability::Volatile);
        let topic = self.node.create_topic(&name(topic), MessageTypeName::new(package, kind), &qos).unwrap();
        self.node.create_publisher(&topic, Some(qos)).unwrap()
    }

    fn subscription(&mut self, topic: &str, kind: &str, durability: Durability) -> Received {
        let (package, kind) = kind.split_once('/').unwrap();
        let qos = qos(durability);
        let topic = self.node.create_topic(&name(topic), MessageTypeName::new(package, kind), &qos).unwrap();
        let subscription: Subscription<Bytes> = self.node.create_subscription(&topic, Some(qos)).unwrap();
        let (sender, receiver) = channel();
        std::thread::spawn(move || {
            while let Ok((message, _)) = futures::executor::block_on(subscription.async_take()) {
                if sender.send(message).is_err() {
                    return;
                }
            }
        });
        Received(receiver)
    }

    fn client(&mut self, service: &str, package: &str, kind: &str) -> Client<Bytes, Bytes> {
        let qos = qos(Durability::Volatile);
        let kind = ServiceTypeName::new(package, kind);
        let client =
            self.node.create_client(ServiceMapping::Enhanced, &name(service), &kind, qos.clone(), qos).unwrap();
        futures::executor::block_on(client.wait_for_service(&self.node));
        client
    }
}

fn call(client: &Client<Bytes, Bytes>, request: Bytes) -> Bytes {
    let id = client.send_request(request).unwrap();
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(30) {
        match client.receive_response().unwrap() {
            Some((known, response)) if known == id => return response,
            _ => std::thread::sleep(Duration::from_millis(10)),
        }
    }
    panic!("there is no answer within 30 s");
}

/// Calls `std_srvs/Trigger`.
fn trigger(client: &Client<Bytes, Bytes>) -> (bool, String) {
    // A request without fields has one byte.
    let answer = call(client, Bytes(vec![0, 1, 0, 0, 0]));
    let json = message_to_json("std_srvs/Trigger_Response", "bool success\nstring message\n", &answer.0).unwrap();
    (json["success"] == 1, json["message"].as_str().unwrap().to_owned())
}

/// A request that sets a text.
fn set_parameter(name: &str, text: &str) -> Bytes {
    let mut message = CdrWriter::default();
    // A text has the type 4; no truth value, whole number, number; no lists.
    message.u32(1).text(name).u8(4).u8(0).f64(0.0).f64(0.0).text(text).u32(0).u32(0).u32(0).u32(0).u32(0);
    Bytes(message.finish())
}

fn detections_3d(message: &Bytes) -> Value {
    let kind = "vision_msgs/Detection3DArray";
    message_to_json(kind, &definition(kind), &message.0).unwrap()
}

fn text(message: &Bytes) -> Value {
    let json = message_to_json("std_msgs/String", "string data\n", &message.0).unwrap();
    serde_json::from_str(json["data"].as_str().unwrap()).unwrap()
}

fn ids(array: &Value) -> Vec<&str> {
    array["detections"].as_array().unwrap().iter().map(|object| object["id"].as_str().unwrap()).collect()
}

/// The node; ends with the test.
struct Program(Child);

impl Program {
    fn start(parameters: &[String]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_quadlift-ros2"));
        command.args(["--ros-args", "-r", "detections:=/front/detections", "-r", "camera_info:=/front/camera_info"]);
        command.args(["-p", "publish_period:=0.2", "-p", "transform_timeout:=10.0"]);
        Self(command.args(parameters.iter().flat_map(|set| ["-p", set])).spawn().unwrap())
    }

    /// Ends it as Ctrl-C does.
    fn interrupt(mut self) {
        assert!(Command::new("kill").args(["-INT", &self.0.id().to_string()]).status().unwrap().success());
        assert!(self.0.wait().unwrap().success());
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
#[ignore = "runs in the network of the other test"]
fn robot() {
    if std::env::var_os(INSIDE).is_none() {
        println!("skipped: this is not the network of the test");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let log = log_of(&drive());
    let expected = map_of_stream(&log, folder.path());
    let file = |name: &str| folder.path().join(name).display().to_string();
    let program = Program::start(&[format!("state_file:={}", file("map.state"))]);

    let mut robot = Robot::new();
    let map = robot.subscription("/quadlift/map", "vision_msgs/Detection3DArray", Durability::TransientLocal);
    let events = robot.subscription("/quadlift/events", "std_msgs/String", Durability::Volatile);
    let query = robot.client("/quadlift/query", "quadlift_msgs", "QueryObjects");
    let [save, load, reset] =
        ["save", "load", "reset"].map(|name| robot.client(&format!("/quadlift/{name}"), "std_srvs", "Trigger"));
    let parameters = robot.client("/quadlift/set_parameters", "rcl_interfaces", "SetParameters");

    let all = messages(&log);
    let mut publishers: Vec<(String, Publisher<Bytes>)> = Vec::new();
    for message in &all {
        if !publishers.iter().any(|(topic, _)| *topic == message.topic) {
            let publisher = robot.publisher(&message.topic, &message.kind);
            futures::executor::block_on(publisher.wait_for_subscription(&robot.node));
            publishers.push((message.topic.clone(), publisher));
        }
    }
    // What was matched on this side may not be on the other one.
    std::thread::sleep(Duration::from_secs(1));
    for message in &all {
        let (_, publisher) = publishers.iter().find(|(topic, _)| *topic == message.topic).unwrap();
        publisher.publish(Bytes(message.data.clone())).unwrap();
        std::thread::sleep(Duration::from_millis(5));
    }

    let last_frame = all.iter().map(|message| message.log_time).max().unwrap();
    let last_id = format!("{}.{:09}", last_frame / 1_000_000_000, last_frame % 1_000_000_000);
    let mut seen = 0;
    while seen < FRAMES {
        let event = events.next("event", |_| true, text);
        seen += 1;
        assert_eq!(event["frame"] == last_id.as_str(), seen == FRAMES, "{event}");
    }
    let is_last = |map: &Value| {
        let stamp = &map["header"]["stamp"];
        (stamp["sec"].as_u64(), stamp["nanosec"].as_u64())
            == (Some(last_frame / 1_000_000_000), Some(last_frame % 1_000_000_000))
    };
    let array = map.next("map of the last frame", is_last, detections_3d);
    assert!(ids(&array).len() > 20, "{:?}", ids(&array));

    // The map is that of the program, bit by bit.
    let answer = call(&parameters, set_parameter("map_file", &file("map.json")));
    let definition = "SetParametersResult[] results\n===\nMSG: t/SetParametersResult\nbool successful\nstring reason\n";
    let is_set = |answer: &Bytes| message_to_json("t/T", definition, &answer.0).unwrap()["results"][0].clone();
    assert_eq!(is_set(&answer)["successful"], 1);
    let refused = is_set(&call(&parameters, set_parameter("world_frame", "odom")));
    assert_eq!(refused["successful"], 0);
    assert!(refused["reason"].as_str().unwrap().contains("is read when the node starts"), "{refused}");
    let (is_saved, message) = trigger(&save);
    assert!(is_saved && message.contains("map.json (60 frames)"), "{message}");
    assert!(std::fs::read_to_string(file("map.json")).unwrap() == expected);

    let answer = read_answer(&call(&query, Query::default().write()).0).unwrap();
    assert_eq!((ids(&answer["objects"]), &answer["success"]), (ids(&array), &1.into()));
    let vans = Query { category: Some("van".into()), in_view: true, ..Query::default() };
    let answer = read_answer(&call(&query, vans.write()).0).unwrap();
    let found = ids(&answer["objects"]).len();
    assert!(found > 0 && found < ids(&array).len(), "{}", answer["message"]);

    // Who comes late gets the map, the markers and the objects.
    let late = robot.subscription("/quadlift/map", "vision_msgs/Detection3DArray", Durability::TransientLocal);
    assert_eq!(late.next("latched map", is_last, detections_3d), array);
    let late = robot.subscription("/quadlift/objects_json", "std_msgs/String", Durability::TransientLocal);
    let of_last = |objects: &Value| objects["localization"]["stream"]["last_frame"] == last_id.as_str();
    let objects = late.next("latched objects", of_last, text);
    assert_eq!(objects["objects"][0]["id"], ids(&array)[0]);
    let markers = robot.subscription("/quadlift/markers", "visualization_msgs/MarkerArray", Durability::TransientLocal);
    let kind = "visualization_msgs/MarkerArray";
    let of_markers = |message: &Bytes| message_to_json(kind, &quadlift_io::mcap::definition(kind), &message.0).unwrap();
    let has_all = |found: &Value| found["markers"].as_array().is_some_and(|all| all.len() == 1 + 2 * ids(&array).len());
    markers.next("latched markers", has_all, of_markers);

    assert_eq!(trigger(&reset), (true, "the map is empty".into()));
    map.next("empty map", |map| ids(map).is_empty(), detections_3d);
    let (is_loaded, message) = trigger(&load);
    assert!(is_loaded && message.ends_with("60 frames"), "{message}");
    assert_eq!(map.next("loaded map", is_last, detections_3d), array);

    // Another process goes on from the state that the first one leaves.
    std::fs::remove_file(file("map.state")).unwrap();
    program.interrupt();
    let next = Program::start(&[format!("state_file:={}", file("map.state")), "resume:=true".into()]);
    assert_eq!(map.next("map of the next process", is_last, detections_3d), array);
    next.interrupt();
}
