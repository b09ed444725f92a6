//! Messages of a running robot: calibrations, transforms and 2D detections, each as it arrives, become frames in the order of their
//! times. It is the second reading of a log ([`super::Frames`]) without the first one: cameras and transforms come up on the way.
//!
//! Bounded: transforms of the last seconds, and detections that wait for theirs. Nothing here has a clock; the caller tells the time.

use std::collections::{BTreeMap, VecDeque};

use super::cdr;
use super::container::Problem;
use super::definitions::definition;
use super::frames::{JUMP_BACK, Next, posed_frame};
use super::messages::{self, CameraOptions, Transform};
use super::scan::{LogCamera, camera_of};
use super::schema::{Definitions, parse_ros2msg};
use super::tree::{Limits, Seconds, Tree, duration};
use super::value::Value;
use crate::read::PixelCenters;
use crate::scene_file::DetectionRecord;
use crate::stream::CameraOfFrame;

/// How messages become frames.
#[derive(Debug, Clone, PartialEq)]
pub struct LiveOptions {
    /// The frame in which objects are located.
    pub world_frame: String,
    /// Number of topics of calibrations: detections wait until the camera that they name is known.
    pub cameras: usize,
    /// Whether the boxes were measured in the rectified image.
    pub rectified: bool,
    /// Origin of the pixel coordinates of calibrations.
    pub pixel_centers: PixelCenters,
    /// Largest time in seconds between an image and the nearest transform where there is none on the other side.
    pub time_tolerance: f64,
    /// Longest time in seconds between two transforms that is interpolated.
    pub longest_gap: f64,
    /// How long detections wait for transforms and calibrations, in seconds.
    pub longest_wait: f64,
    /// How long detections wait for earlier ones of other topics, in seconds.
    pub reorder: f64,
    /// How long transforms are kept, in seconds.
    pub kept: f64,
    /// Messages of detections that wait, at most.
    pub most_waiting: usize,
}

impl Default for LiveOptions {
    fn default() -> Self {
        Self {
            world_frame: "map".to_owned(),
            cameras: 1,
            rectified: false,
            pixel_centers: PixelCenters::Half,
            time_tolerance: 0.02,
            longest_gap: 1.0,
            longest_wait: 1.0,
            reorder: 0.0,
            kept: 10.0,
            most_waiting: 100,
        }
    }
}

/// The frames of a running robot. Messages are in CDR, as ROS 2 sends them, with the four bytes that name the encoding.
#[derive(Debug)]
pub struct LiveFrames {
    options: LiveOptions,
    limits: Limits,
    definitions: [Definitions; 3],
    cameras: Vec<LogCamera>,
    tree: Tree,
    /// By time and topic.
    waiting: BTreeMap<(i64, String), Waiting>,
    next: VecDeque<Next>,
}

#[derive(Debug)]
struct Waiting {
    since: f64,
    /// The frame of the camera, as the message names it.
    frame: String,
    detections: Vec<DetectionRecord>,
}

/// Places in the list of definitions.
const TRANSFORMS: usize = 0;
const CALIBRATION: usize = 1;
const DETECTIONS: usize = 2;

impl LiveFrames {
    /// No messages have come.
    ///
    /// # Errors
    /// A text that names an option that is out of its range.
    pub fn new(options: LiveOptions) -> Result<Self, String> {
        let times = [
            ("time tolerance", options.time_tolerance),
            ("longest gap", options.longest_gap),
            ("longest wait", options.longest_wait),
            ("wait for other topics", options.reorder),
            ("time that transforms are kept", options.kept),
        ];
        if let Some((name, value)) = times.into_iter().find(|(_, value)| !(0.0..=1e6).contains(value)) {
            return Err(format!("the {name} is {value}; expected seconds from 0 to 1000000"));
        }
        if options.world_frame.is_empty() {
            return Err("the world frame is empty; expected the name of a frame, such as map".to_owned());
        }
        let nanoseconds = |seconds: f64| (seconds * 1e9).round() as i64;
        let limits =
            Limits { tolerance: nanoseconds(options.time_tolerance), longest_gap: nanoseconds(options.longest_gap) };
        let parsed = |name: &str| parse_ros2msg(name, &definition(name));
        let definitions =
            [parsed("tf2_msgs/TFMessage")?, parsed("sensor_msgs/CameraInfo")?, parsed("vision_msgs/Detection2DArray")?];
        let tree = Tree::keeping(nanoseconds(options.kept));
        let (cameras, waiting, next) = (Vec::new(), BTreeMap::new(), VecDeque::new());
        Ok(Self { options, limits, definitions, cameras, tree, waiting, next })
    }

    /// Takes in a `tf2_msgs/TFMessage`; `is_fixed`: its transforms hold at every time.
    pub fn transforms(&mut self, topic: &str, data: &[u8], is_fixed: bool) {
        let decoded = self.decode(TRANSFORMS, data).and_then(|value| messages::transforms(&value));
        for transform in decoded.unwrap_or_else(|problem| vec![Err(problem)]) {
            let result = transform.and_then(|transform| self.transform(topic, transform, is_fixed));
            result.unwrap_or_else(|problem| self.problem(topic, problem));
        }
        let oldest = self.waiting.first_key_value().map_or(i64::MAX, |((stamp, _), _)| *stamp);
        self.tree.forget_before(oldest);
    }

    fn transform(&mut self, topic: &str, transform: Transform, is_fixed: bool) -> Result<(), String> {
        let Transform { stamp, parent, child, .. } = &transform;
        if !is_fixed
            && let Some(newest) = self.tree.newest(child)
            && newest - stamp > JUMP_BACK
        {
            let text = format!(
                "the clock jumps back by {}: the transforms {parent} -> {child} go from the time {} to {}",
                duration(newest - stamp),
                Seconds(newest),
                Seconds(*stamp)
            );
            self.make_all();
            self.tree.forget_moving();
            self.problem(topic, text);
        }
        self.tree.insert(transform, is_fixed)
    }

    /// Takes in a `sensor_msgs/CameraInfo`.
    pub fn calibration(&mut self, topic: &str, data: &[u8]) {
        let options = CameraOptions { rectified: self.options.rectified, pixel_centers: self.options.pixel_centers };
        let decoded = self.decode(CALIBRATION, data).and_then(|value| messages::calibration(&value, options));
        let result = decoded.and_then(|found| {
            let known = self.cameras.iter().position(|camera| camera.topic == topic);
            let index = known.unwrap_or_else(|| {
                self.cameras.push(LogCamera::new(topic, &found));
                self.cameras.len() - 1
            });
            self.cameras[index].take_in(found)
        });
        result.unwrap_or_else(|problem| self.problem(topic, problem));
    }

    /// Takes in a `vision_msgs/Detection2DArray` (of version 4) that arrived at `now`, in seconds from any origin.
    pub fn detections(&mut self, topic: &str, data: &[u8], now: f64) {
        let decoded = self.decode(DETECTIONS, data).and_then(|value| messages::detections(&value));
        match decoded {
            Ok(found) => {
                found.problems.into_iter().for_each(|problem| self.problem(topic, problem));
                let (frame, detections) = (found.frame, found.detections);
                let key = (found.stamp, topic.to_owned());
                if self.waiting.contains_key(&key) {
                    let time = Seconds(found.stamp);
                    self.problem(topic, format!("there are two messages for the time {time}; this one is left out"));
                    return;
                }
                self.waiting.insert(key, Waiting { since: now, frame, detections });
            }
            Err(problem) => self.problem(topic, problem),
        }
    }

    /// The next frame or problem; `None` if there is nothing, or if the next one waits.
    pub fn next_frame(&mut self, now: f64) -> Option<Next> {
        while self.next.is_empty() && self.make_next(now) {}
        self.next.pop_front()
    }

    /// The number of messages of detections that wait.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Makes what waits, with the transforms that there are.
    pub fn make_all(&mut self) {
        while self.make_next(f64::INFINITY) {}
    }

    /// Makes the frame of the earliest detections, or tells why there is none; false if they wait.
    fn make_next(&mut self, now: f64) -> bool {
        let Some(((stamp, topic), waiting)) = self.waiting.first_key_value() else { return false };
        let (stamp, topic) = (*stamp, topic.clone());
        let waited = now - waiting.since;
        let is_full = self.waiting.len() > self.options.most_waiting;
        let is_final = is_full || waited >= self.options.longest_wait;
        if waited < self.options.reorder && !is_final {
            return false;
        }
        let camera = match self.camera(&topic, &waiting.frame) {
            Ok(camera) => camera,
            Err(_) if !is_final => return false,
            Err(problem) => {
                self.waiting.remove(&(stamp, topic.clone()));
                self.drop(&topic, stamp, &problem, is_full);
                return true;
            }
        };
        let log_camera = &self.cameras[camera];
        let found = self.tree.pose(&log_camera.frame, &self.options.world_frame, stamp, self.limits, is_final);
        if found.as_ref().is_err_and(|error| error.may_come) && !is_final {
            return false;
        }
        let id = match self.options.cameras {
            0 | 1 => Seconds(stamp).to_string(),
            _ => format!("{}/{}", log_camera.id, Seconds(stamp)),
        };
        let Some(waiting) = self.waiting.remove(&(stamp, topic.clone())) else { return false };
        match found {
            Ok(pose) => {
                let mut frame = posed_frame(id, log_camera, stamp, &pose, waiting.detections);
                let camera = log_camera.calibration_at(stamp).camera.clone();
                frame.record.camera = None;
                frame.camera = Some(CameraOfFrame {
                    id: Some(camera.id),
                    model: camera.model,
                    width: camera.width,
                    height: camera.height,
                    params: camera.params,
                });
                self.next.push_back(Next::Frame(Box::new(frame)));
            }
            Err(error) => self.drop(&topic, stamp, &error.problem, is_full),
        }
        true
    }

    /// The camera of a message, once it is certain.
    fn camera(&self, topic: &str, frame: &str) -> Result<usize, String> {
        if self.cameras.is_empty() {
            return Err("no calibration has come".to_owned());
        }
        let found = camera_of(&self.cameras, self.options.cameras, topic, frame);
        match found {
            Ok((_, false)) if self.cameras.len() < self.options.cameras => {
                Err(format!("no calibrated camera has the frame \"{frame}\" so far"))
            }
            found => found.map(|(camera, _)| camera),
        }
    }

    fn drop(&mut self, topic: &str, stamp: i64, why: &str, is_full: bool) {
        let full =
            if is_full { format!("; more than {} messages wait", self.options.most_waiting) } else { String::new() };
        self.problem(topic, format!("the detections of the time {} are dropped: {why}{full}", Seconds(stamp)));
    }

    fn problem(&mut self, topic: &str, text: String) {
        self.next.push_back(Next::Problem(Problem { place: None, topic: Some(topic.to_owned()), text }));
    }

    /// The content of a message. Senders of the other byte order are rare, and what carries the bytes does not say it: such a message
    /// does not fit its definition otherwise.
    fn decode(&self, index: usize, data: &[u8]) -> Result<Value, String> {
        let definitions = &self.definitions[index];
        cdr::decode(definitions, data).or_else(|problem| {
            let mut other = data.to_vec();
            if let Some(byte) = other.get_mut(1) {
                *byte ^= 1;
            }
            cdr::decode(definitions, &other).map_err(|_| problem)
        })
    }
}

#[cfg(test)]
#[path = "live_tests.rs"]
mod tests;
