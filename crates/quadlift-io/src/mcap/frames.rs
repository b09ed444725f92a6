//! The second reading of a log: its frames in the order of their times, each as soon as the transforms around it are known.
//!
//! What is kept are the frames that wait (ten seconds of the log at most, [`MAX_WAITING`] at most) and the transforms of the last
//! half minute: the memory does not grow with the log.

use std::collections::{BTreeMap, VecDeque};
use std::io::{self, Read, Seek};
use std::path::PathBuf;

use super::McapOptions;
use super::container::{Channel, Item, LogReader, Message, Problem};
use super::decode::Decoders;
use super::messages::{self, Kind, kind_of};
use super::scan::{LogCamera, Overview, is_static};
use super::tree::{How, Limits, Pose, SECOND, Seconds, Tree, duration};
use crate::file_names::file_names;
use crate::scene_file::{DetectionRecord, FrameRecord};
use crate::stream::FrameLine;
use crate::wording::count;

/// Frames that wait for transforms, at most.
const MAX_WAITING: usize = 1000;
/// Time of the log after which a frame is made, so that those of slower detectors can be put before it.
const REORDER: u64 = SECOND as u64;
/// Time of the log after which no more transforms are waited for.
const MAX_WAIT: u64 = 10 * SECOND as u64;
/// A clock that goes back by more than this has jumped.
pub(super) const JUMP_BACK: i64 = SECOND;
/// A clock that goes forward by more than this has jumped.
const JUMP_FORWARD: i64 = 3600 * SECOND;

/// The frames of a log.
pub struct Frames<R> {
    reader: LogReader<R>,
    decoders: Decoders,
    overview: Overview,
    tree: Tree,
    limits: Limits,
    /// By time and camera.
    waiting: BTreeMap<(i64, usize), Waiting>,
    /// The newest time of each topic of detections.
    newest: BTreeMap<String, i64>,
    log_time: u64,
    is_over: bool,
    /// What comes next.
    next: VecDeque<Next>,
    has_several_sources: bool,
    image_folder: Option<PathBuf>,
    images: BTreeMap<String, String>,
    statistics: Statistics,
}

/// What comes next in a log.
#[derive(Debug, Clone, PartialEq)]
pub enum Next {
    /// A frame with its detections.
    Frame(Box<FrameLine>),
    /// Something that cannot be used.
    Problem(Problem),
    /// An image that has no pose because it is before the first transform of a link, or after the last one.
    Outside(Problem),
}

/// How the poses of the frames were found.
#[derive(Debug, Clone, Copy, Default)]
struct Statistics {
    exact: usize,
    between: usize,
    largest_gap: i64,
    nearest: usize,
    farthest: i64,
    jumps_forward: usize,
    without_camera: usize,
}

/// A frame whose pose is not known yet.
struct Waiting {
    log_time: u64,
    topic: String,
    place: super::container::Place,
    detections: Vec<DetectionRecord>,
    topics: Vec<String>,
}

impl<R: Read + Seek> Frames<R> {
    /// Reads the log of an overview again. The error is a text if this is no MCAP file.
    pub fn new(input: R, overview: Overview, options: &McapOptions) -> io::Result<Result<Self, String>> {
        let of_calibrations =
            !overview.topics.values().any(|(kind, _)| matches!(kind, Kind::Detections | Kind::Annotations));
        let topics = overview.topics.clone();
        let is_wanted = move |channel: &Channel| match topics.get(&channel.topic) {
            Some((Kind::Calibration, _)) => of_calibrations,
            Some((Kind::Transforms, _)) => !is_static(&channel.topic),
            used => used.is_some(),
        };
        let reader = match LogReader::new(input, Box::new(is_wanted))? {
            Ok(reader) => reader,
            Err(text) => return Ok(Err(text)),
        };
        let mut tree = Tree::default();
        for transform in &overview.fixed {
            // A second parent was told by the first reading.
            let _ = tree.insert(transform.clone(), true);
        }
        let nanoseconds = |seconds: f64| (seconds * 1e9).round() as i64;
        let limits =
            Limits { tolerance: nanoseconds(options.time_tolerance), longest_gap: nanoseconds(options.longest_gap) };
        Ok(Ok(Self {
            has_several_sources: !overview.rivals().is_empty(),
            next: overview.problems.iter().cloned().map(Next::Problem).collect(),
            reader,
            decoders: Decoders::default(),
            overview,
            tree,
            limits,
            waiting: BTreeMap::new(),
            newest: BTreeMap::new(),
            log_time: 0,
            is_over: false,
            image_folder: options.image_folder.clone(),
            images: BTreeMap::new(),
            statistics: Statistics::default(),
        }))
    }

    /// The next frame or problem; `None` at the end.
    ///
    /// # Errors
    /// What the system says.
    pub fn next_frame(&mut self) -> io::Result<Option<Next>> {
        loop {
            if let Some(next) = self.next.pop_front() {
                return Ok(Some(next));
            }
            if self.is_over {
                return Ok(None);
            }
            match self.reader.next_item()? {
                None => {
                    self.is_over = true;
                    self.make_all();
                }
                Some(Item::Problem(problem)) => self.next.push_back(Next::Problem(problem)),
                Some(Item::Message(message)) => {
                    self.log_time = self.log_time.max(message.log_time);
                    if let Err(text) = self.message(&message) {
                        self.problem(&message, text);
                    }
                    self.make_ready();
                }
            }
        }
    }

    /// Names of images that were written, by the ids of their frames.
    pub(crate) fn images(&self) -> &BTreeMap<String, String> {
        &self.images
    }

    /// How the poses were found, so far.
    pub(crate) fn notes(&self) -> Vec<String> {
        let Statistics { exact, between, largest_gap, nearest, farthest, jumps_forward, without_camera } =
            self.statistics;
        let mut parts = Vec::new();
        if exact > 0 {
            parts.push(format!("{exact} at the time of their transforms"));
        }
        if between > 0 {
            parts.push(format!("{between} interpolated between transforms up to {} apart", duration(largest_gap)));
        }
        if nearest > 0 {
            parts.push(format!("{nearest} of the nearest transform, up to {} away", duration(farthest)));
        }
        let mut notes = Vec::new();
        if !parts.is_empty() {
            notes.push(format!("poses of frames: {}", parts.join(", ")));
        }
        if jumps_forward > 0 {
            notes.push(format!(
                "the clock goes forward by more than {} {}",
                duration(JUMP_FORWARD),
                times(jumps_forward)
            ));
        }
        if without_camera > 0 {
            let camera = &self.overview.cameras[0];
            let messages = count(without_camera, "message");
            notes
                .push(format!("{messages} of detections do not name the camera's frame: they are of {}", camera.topic));
        }
        notes
    }

    fn problem(&mut self, message: &Message, text: String) {
        let (place, topic) = (Some(message.place), Some(message.channel.topic.clone()));
        self.next.push_back(Next::Problem(Problem { place, topic, text }));
    }

    fn message(&mut self, message: &Message) -> Result<(), String> {
        let topic = &message.channel.topic;
        let Some(kind) = message.channel.schema.as_ref().and_then(|schema| kind_of(&schema.name)) else {
            return Ok(());
        };
        // Told by the first reading.
        let (Ok(decoder), _) = self.decoders.of(&message.channel) else { return Ok(()) };
        let value = decoder.decode(&message.data)?;
        match kind {
            Kind::Transforms => {
                for transform in messages::transforms(&value)? {
                    match transform {
                        Ok(transform)
                            if self.overview.pose_topic.as_ref().is_some_and(|(_, c)| *c == transform.child) => {}
                        Ok(transform) => self.transform(message, transform)?,
                        Err(text) => self.problem(message, text),
                    }
                }
            }
            Kind::Odometry | Kind::Pose => {
                let mut pose = messages::pose(&value)?;
                if let Some((_, child)) = &self.overview.pose_topic {
                    pose.child.clone_from(child);
                }
                self.transform(message, pose)?;
            }
            Kind::Calibration => {
                let found = messages::calibration(&value, Default::default());
                // A calibration that cannot be used was told by the first reading.
                let Ok(found) = found else { return Ok(()) };
                let cameras = &self.overview.cameras;
                if let Some(camera) = cameras.iter().position(|camera| camera.topic == *topic) {
                    self.frame(message, found.stamp, camera, Vec::new())?;
                }
            }
            Kind::Detections | Kind::Annotations => {
                let found = match kind {
                    Kind::Detections => Some(messages::detections(&value)?),
                    _ => messages::annotations(&value)?,
                };
                let Some(found) = found else { return Ok(()) };
                found.problems.into_iter().for_each(|text| self.problem(message, text));
                let (camera, is_named) = self.overview.camera(topic, &found.frame)?;
                self.statistics.without_camera += usize::from(!is_named);
                self.frame(message, found.stamp, camera, found.detections)?;
            }
            Kind::CompressedImage => self.image(message, &value)?,
            Kind::Bodies => {}
        }
        Ok(())
    }

    fn transform(&mut self, message: &Message, transform: messages::Transform) -> Result<(), String> {
        if let Some(newest) = self.tree.newest(&transform.child) {
            let step = transform.stamp - newest;
            if step < -JUMP_BACK {
                let link = format!("{} -> {}", transform.parent, transform.child);
                self.jump(message, newest, transform.stamp, &format!("the transforms {link}"));
            } else if step > JUMP_FORWARD {
                self.statistics.jumps_forward += 1;
            }
        }
        self.tree.insert(transform, false)
    }

    /// The clock has gone back: frames that wait are made with what there is, and the transforms are forgotten.
    fn jump(&mut self, message: &Message, from: i64, to: i64, what: &str) {
        self.make_all();
        self.tree.forget_moving();
        self.newest.clear();
        let text = format!(
            "the clock jumps back by {}: {what} go from the time {} to {}",
            duration(from - to),
            Seconds(from),
            Seconds(to)
        );
        self.problem(message, text);
    }

    /// Takes in detections.
    fn frame(
        &mut self,
        message: &Message,
        stamp: i64,
        camera: usize,
        mut detections: Vec<DetectionRecord>,
    ) -> Result<(), String> {
        let topic = &message.channel.topic;
        match self.newest.get(topic) {
            Some(&newest) if stamp < newest - JUMP_BACK => self.jump(message, newest, stamp, "the messages"),
            _ => {}
        }
        let newest = self.newest.entry(topic.clone()).or_insert(stamp);
        *newest = stamp.max(*newest);
        if self.has_several_sources {
            detections.iter_mut().for_each(|detection| detection.source = Some(topic.as_str().into()));
        }
        let waiting = self.waiting.entry((stamp, camera)).or_insert_with(|| Waiting {
            log_time: message.log_time,
            topic: topic.clone(),
            place: message.place,
            detections: Vec::new(),
            topics: Vec::new(),
        });
        if waiting.topics.contains(topic) && stamp == 0 {
            return Err("the stamps of its messages are not set: they are 0; expected the time of the image".to_owned());
        }
        if waiting.topics.contains(topic) {
            return Err(format!("there are two messages for the time {}; this one is left out", Seconds(stamp)));
        }
        waiting.topics.push(topic.clone());
        waiting.detections.append(&mut detections);
        Ok(())
    }

    /// Makes the frames that need not wait any longer.
    fn make_ready(&mut self) {
        while let Some((&(stamp, camera), waiting)) = self.waiting.first_key_value() {
            let waited = self.log_time.saturating_sub(waiting.log_time);
            let is_final = waited >= MAX_WAIT || self.waiting.len() > MAX_WAITING;
            if waited < REORDER && !is_final || !self.make(stamp, camera, is_final) {
                return;
            }
        }
    }

    /// Makes all frames with the transforms that there are.
    fn make_all(&mut self) {
        while let Some((&(stamp, camera), _)) = self.waiting.first_key_value() {
            self.make(stamp, camera, true);
        }
    }

    /// Makes a frame, or reports why it has no pose; false if it waits for transforms.
    fn make(&mut self, stamp: i64, camera: usize, is_final: bool) -> bool {
        let log_camera = &self.overview.cameras[camera];
        let found = self.tree.pose(&log_camera.frame, &self.overview.world_frame, stamp, self.limits, is_final);
        if found.as_ref().is_err_and(|error| error.may_come) && !is_final {
            return false;
        }
        let Some(waiting) = self.waiting.remove(&(stamp, camera)) else { return true };
        let oldest = self.waiting.first_key_value().map_or(stamp, |((first, _), _)| *first.min(&stamp));
        self.tree.forget_before(oldest);
        let pose = match found {
            Ok(pose) => pose,
            Err(error) => {
                let text = format!("the image has no pose: {}", error.problem);
                let problem = Problem { place: Some(waiting.place), topic: Some(waiting.topic), text };
                self.next.push_back(if error.is_outside { Next::Outside(problem) } else { Next::Problem(problem) });
                return true;
            }
        };
        match pose.how {
            How::Exact => self.statistics.exact += 1,
            How::Between(gap) => {
                self.statistics.between += 1;
                self.statistics.largest_gap = self.statistics.largest_gap.max(gap);
            }
            How::Nearest(distance) => {
                self.statistics.nearest += 1;
                self.statistics.farthest = self.statistics.farthest.max(distance);
            }
        }
        let id = frame_id(&self.overview.cameras, camera, stamp);
        let frame = posed_frame(id, log_camera, stamp, &pose, waiting.detections);
        self.next.push_back(Next::Frame(Box::new(frame)));
        true
    }

    /// Writes an image.
    fn image(&mut self, message: &Message, value: &super::value::Value) -> Result<(), String> {
        let Some(folder) = self.image_folder.clone() else { return Ok(()) };
        let image = messages::compressed_image(value)?;
        let extension = match image.bytes {
            [0xFF, 0xD8, ..] => "jpg",
            [0x89, b'P', b'N', b'G', ..] => "png",
            _ => return Err(format!("the image is neither JPEG nor PNG (its format is \"{}\")", image.format)),
        };
        let (camera, _) = self.overview.camera(&message.channel.topic, &image.frame)?;
        let id = frame_id(&self.overview.cameras, camera, image.stamp);
        let name: String = file_names([id.as_str()]).iter().map(|name| format!("{name}.{extension}")).collect();
        let path = folder.join(&name);
        // Not synced one by one, for there may be thousands.
        std::fs::write(&path, image.bytes).map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        self.images.insert(id, name);
        Ok(())
    }
}

/// "once", "3 times".
fn times(n: usize) -> String {
    if n == 1 { "once".to_owned() } else { format!("{n} times") }
}

/// The id of a frame: its time, after the camera if there are several.
fn frame_id(cameras: &[LogCamera], camera: usize, stamp: i64) -> String {
    match cameras {
        [_] => Seconds(stamp).to_string(),
        _ => format!("{}/{}", cameras[camera].id, Seconds(stamp)),
    }
}

/// A frame with its pose in the frame of the world.
pub(super) fn posed_frame(
    id: String,
    camera: &LogCamera,
    stamp: i64,
    pose: &Pose,
    detections: Vec<DetectionRecord>,
) -> FrameLine {
    let calibration = camera.calibration_at(stamp);
    let cam_from_world = calibration.cam_from_frame * pose.target_from_source;
    let of_frame = |detection| DetectionRecord { frame: id.as_str().into(), ..detection };
    let detections = detections.into_iter().map(of_frame).collect();
    let record = FrameRecord {
        camera: Some(calibration.camera.id.clone()),
        cam_from_world: Some(rows(&cam_from_world)),
        time: Some(stamp.div_euclid(SECOND) as f64 + stamp.rem_euclid(SECOND) as f64 / 1e9),
        ..FrameRecord::default()
    };
    FrameLine { record: FrameRecord { id, ..record }, detections, ..FrameLine::default() }
}

/// A pose as files have it.
fn rows(pose: &nalgebra::Isometry3<f64>) -> [[f64; 4]; 3] {
    let matrix = pose.to_homogeneous();
    [0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)]))
}
