//! The first reading of a log: which topics there are, the cameras, and how the frames hang together. Images are passed over, and
//! detections after the first of each topic.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{self, Read, Seek};

use nalgebra::Isometry3;

use super::McapOptions;
use super::container::{Item, LogReader, Message, Problem};
use super::decode::{Decoder, Decoders};
use super::messages::{self, CameraOptions, Kind, Transform, kind_of};
use super::tree::Tree;
use crate::scene_file::CameraRecord;
use crate::wording::{count, some_of};

/// Calibrations of one topic that differ, at most.
const MAX_CALIBRATIONS: usize = 10_000;
/// Problems that are kept, at most.
const MAX_PROBLEMS: usize = 1000;

/// What the first reading has found.
#[derive(Debug)]
pub struct Overview {
    /// Topics that are used, with what they give and their numbers of messages.
    pub topics: BTreeMap<String, (Kind, u64)>,
    /// Topics with something that could be used, and is not.
    pub unused: BTreeMap<String, (Kind, u64)>,
    /// The cameras, by their topics.
    pub cameras: Vec<LogCamera>,
    /// Topics of detections that are used, with the frame that their first message names.
    pub detection_frames: BTreeMap<String, String>,
    /// The frame in which objects are located.
    pub world_frame: String,
    /// Transforms that hold at every time.
    pub fixed: Vec<Transform>,
    /// The topic of poses that is used, and the frame whose poses they are.
    pub pose_topic: Option<(String, String)>,
    /// Whether the definitions are those of ROS, in which z is up.
    pub is_ros: bool,
    /// Conversions and assumptions.
    pub notes: Vec<String>,
    /// What is not told by the second reading.
    pub problems: Vec<Problem>,
}

impl Overview {
    /// The camera of a message ([`camera_of`]).
    pub fn camera(&self, topic: &str, frame: &str) -> Result<(usize, bool), String> {
        let calibrations = self.topics.values().filter(|(kind, _)| *kind == Kind::Calibration).count();
        camera_of(&self.cameras, calibrations, topic, frame)
    }

    /// Topics of detections that are of the same camera: several sources, of which one must be chosen.
    pub(crate) fn rivals(&self) -> Vec<&str> {
        let mut of_camera: BTreeMap<usize, Vec<&str>> = BTreeMap::new();
        for (topic, frame) in &self.detection_frames {
            if let Ok((camera, _)) = self.camera(topic, frame) {
                of_camera.entry(camera).or_default().push(topic);
            }
        }
        of_camera.into_values().find(|topics| topics.len() > 1).unwrap_or_default()
    }
}

/// The camera of a message: by its frame, and where that is not enough by the name of the topic; and whether its frame tells.
/// `calibrations` is the number of topics of calibrations that are used.
pub(super) fn camera_of(
    cameras: &[LogCamera],
    calibrations: usize,
    topic: &str,
    frame: &str,
) -> Result<(usize, bool), String> {
    let of_frame: Vec<usize> = (0..cameras.len()).filter(|&index| cameras[index].frame == frame).collect();
    let candidates = match of_frame.as_slice() {
        [camera] => return Ok((*camera, true)),
        // The only one of the log, so that no other can be meant.
        [] if cameras.len() == 1 && (frame.is_empty() || calibrations == 1) => return Ok((0, false)),
        [] => (0..cameras.len()).collect(),
        _ => of_frame,
    };
    let common = |index: &usize| {
        let name = cameras[*index].topic.split('/');
        name.zip(topic.split('/')).take_while(|(a, b)| a == b).count()
    };
    let most = candidates.iter().map(common).max().unwrap_or_default();
    let mut nearest = candidates.into_iter().filter(|index| common(index) == most);
    match (nearest.next(), nearest.next()) {
        // A name in common, not only the first slash.
        (Some(camera), None) if most >= 2 => Ok((camera, false)),
        _ => Err(format!(
            "no calibrated camera has the frame \"{frame}\", and the name of the topic does not tell it either"
        )),
    }
}

/// A camera of a log.
#[derive(Debug, Clone)]
pub struct LogCamera {
    /// Id, made of the topic.
    pub id: String,
    /// The topic of its calibrations.
    pub topic: String,
    /// Its frame.
    pub frame: String,
    /// Different calibrations, with the times from which they hold.
    pub calibrations: Vec<LogCalibration>,
}

impl LogCamera {
    /// The camera of a topic, by its first calibration, which is not taken in.
    pub fn new(topic: &str, first: &messages::Calibration) -> Self {
        Self { id: camera_id(topic), topic: topic.to_owned(), frame: first.frame.clone(), calibrations: Vec::new() }
    }

    /// Takes in a calibration; one that is like the last one changes nothing.
    ///
    /// # Errors
    /// A text if it is of another frame, or if there are too many.
    pub fn take_in(&mut self, found: messages::Calibration) -> Result<(), String> {
        if self.frame != found.frame {
            return Err(format!(
                "the calibration is of the frame \"{}\", and those before it are of \"{}\"; it is left out",
                found.frame, self.frame
            ));
        }
        let last = self.calibrations.last();
        if last.is_some_and(|last| last.cam_from_frame == found.cam_from_frame && is_same(&last.camera, &found.camera))
        {
            return Ok(());
        }
        if self.calibrations.len() >= MAX_CALIBRATIONS {
            return Err(format!("there are more than {MAX_CALIBRATIONS} different calibrations; this one is left out"));
        }
        let id = match self.calibrations.len() {
            0 => self.id.clone(),
            n => format!("{}#{}", self.id, n + 1),
        };
        self.calibrations.push(LogCalibration {
            from: found.stamp,
            camera: CameraRecord { id, ..found.camera },
            cam_from_frame: found.cam_from_frame,
        });
        Ok(())
    }

    /// The calibration that holds at a time: the last one before it, or the first one; there is one.
    pub(crate) fn calibration_at(&self, stamp: i64) -> &LogCalibration {
        let before = self.calibrations.iter().rev().find(|calibration| calibration.from <= stamp);
        before.unwrap_or(&self.calibrations[0])
    }
}

/// A calibration of a camera.
#[derive(Debug, Clone)]
pub struct LogCalibration {
    /// Nanoseconds.
    pub from: i64,
    /// With the id that frames name.
    pub camera: CameraRecord,
    /// Where the camera is in its frame.
    pub cam_from_frame: Isometry3<f64>,
}

/// Why a log cannot be used.
pub(super) enum ScanError {
    /// What the system says.
    Io(io::Error),
    /// The first problem, if none is accepted.
    Problem(Problem),
    /// The log as a whole, or an option, is of no use.
    Unusable(String),
}

impl From<io::Error> for ScanError {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// What is found on the way.
#[derive(Default)]
struct Scan {
    cameras: BTreeMap<String, LogCamera>,
    tree: Tree,
    fixed: BTreeMap<String, Transform>,
    /// Links of Foxglove, with their first transform if they have no other.
    constant: BTreeMap<String, Option<Transform>>,
    /// Frames that move relative to their parents.
    moving: BTreeSet<String>,
    pose_sources: BTreeMap<String, Transform>,
    /// Topics of detections with the frame of their first message.
    detection_frames: BTreeMap<String, String>,
    /// What is wrong with the calibrations of a topic, the first one.
    left_out: BTreeMap<String, Problem>,
    notes: BTreeSet<String>,
    problems: Vec<Problem>,
    is_ros: bool,
}

/// Reads a log for the first time.
pub(super) fn scan<R: Read + Seek>(input: R, options: &McapOptions) -> Result<Overview, ScanError> {
    let is_wanted = |channel: &super::container::Channel| {
        let kind = channel.schema.as_ref().and_then(|schema| kind_of(&schema.name));
        kind.is_some_and(|kind| !matches!(kind, Kind::CompressedImage | Kind::Bodies))
    };
    let mut reader = LogReader::new(input, Box::new(is_wanted))?.map_err(ScanError::Unusable)?;
    let mut scan = Scan::default();
    let mut decoders = Decoders::default();
    while let Some(item) = reader.next_item()? {
        let message = match item {
            // Told by the second reading.
            Item::Problem(problem) if options.skip_errors => {
                drop(problem);
                continue;
            }
            Item::Problem(problem) => return Err(ScanError::Problem(problem)),
            Item::Message(message) => message,
        };
        let Some(kind) = message.channel.schema.as_ref().and_then(|schema| kind_of(&schema.name)) else { continue };
        if let Err(text) = scan.message(kind, &message, &mut decoders, options) {
            let (place, topic) = (Some(message.place), message.channel.topic.clone());
            let problem = Problem { place, topic: Some(topic.clone()), text };
            // A camera that is not calibrated may not be needed.
            match kind {
                Kind::Calibration => drop(scan.left_out.entry(topic).or_insert(problem)),
                _ => scan.keep(problem, options)?,
            }
        }
    }
    let mut all: BTreeMap<String, (Kind, u64)> = BTreeMap::new();
    let mut unreadable = Vec::new();
    for (channel, messages) in reader.channels() {
        let schema = channel.schema.as_ref().map_or("", |schema| schema.name.as_str());
        let Some(kind) = kind_of(schema) else {
            let name = schema.to_lowercase();
            if ["detect", "boundingbox", "bounding_box", "yolo"].iter().any(|word| name.contains(word)) {
                let topic = &channel.topic;
                scan.notes.insert(format!(
                    "{topic} is not read: its type is {schema}, expected vision_msgs/msg/Detection2DArray"
                ));
            }
            continue;
        };
        all.entry(channel.topic.clone()).or_insert((kind, 0)).1 += messages;
        if let Err(text) = Decoder::new(channel) {
            unreadable.push(Problem { place: None, topic: Some(channel.topic.clone()), text });
        }
    }
    scan.finish(all, unreadable, options)
}

impl Scan {
    fn keep(&mut self, problem: Problem, options: &McapOptions) -> Result<(), ScanError> {
        if !options.skip_errors {
            return Err(ScanError::Problem(problem));
        }
        if self.problems.len() < MAX_PROBLEMS {
            self.problems.push(problem);
        }
        Ok(())
    }

    fn message(
        &mut self,
        kind: Kind,
        message: &Message,
        decoders: &mut Decoders,
        options: &McapOptions,
    ) -> Result<(), String> {
        let topic = &message.channel.topic;
        if self.detection_frames.contains_key(topic) {
            return Ok(());
        }
        // Told for the channel.
        let (Ok(decoder), _) = decoders.of(&message.channel) else { return Ok(()) };
        let decoded = decoder.decode(&message.data);
        match kind {
            Kind::Calibration => {
                let camera_options =
                    CameraOptions { rectified: options.rectified, pixel_centers: options.pixel_centers };
                let calibration = messages::calibration(&decoded?, camera_options)?;
                self.calibration(topic, calibration)
            }
            Kind::Transforms => {
                // What is wrong is told by the second reading, except for what it does not read.
                let is_static = is_static(topic);
                let found = match (decoded.and_then(|value| messages::transforms(&value)), is_static) {
                    (Ok(found), _) => found,
                    (Err(problem), true) => return Err(problem),
                    (Err(_), false) => return Ok(()),
                };
                let schema = message.channel.schema.as_ref();
                let is_ros = schema.is_some_and(|schema| schema.name.starts_with("tf"));
                self.is_ros |= is_ros;
                for transform in found {
                    match transform {
                        Ok(transform) => self.transform(transform, is_static, is_ros)?,
                        Err(problem) if is_static => return Err(problem),
                        Err(_) => {}
                    }
                }
                Ok(())
            }
            Kind::Odometry | Kind::Pose => {
                let schema = message.channel.schema.as_ref();
                self.is_ros |= schema.is_some_and(|schema| !schema.name.contains("foxglove"));
                if let Ok(pose) = decoded.and_then(|value| messages::pose(&value)) {
                    self.pose_sources.entry(topic.clone()).or_insert(pose);
                }
                Ok(())
            }
            // Annotations name no frame. What is wrong is told by the second reading.
            Kind::Detections | Kind::Annotations => {
                let found = decoded.and_then(|value| messages::detections(&value));
                let frame = found.map(|found| found.frame).unwrap_or_default();
                self.detection_frames.insert(topic.clone(), frame);
                Ok(())
            }
            Kind::CompressedImage | Kind::Bodies => Ok(()),
        }
    }

    fn calibration(&mut self, topic: &str, found: messages::Calibration) -> Result<(), String> {
        let camera = self.cameras.entry(topic.to_owned()).or_insert_with(|| LogCamera::new(topic, &found));
        camera.take_in(found)
    }

    fn transform(&mut self, transform: Transform, is_static: bool, is_ros: bool) -> Result<(), String> {
        if is_static {
            let known = self.fixed.insert(transform.child.clone(), transform.clone());
            if known.is_some_and(|known| known.parent_from_child != transform.parent_from_child) {
                let text = format!(
                    "the static transform {} -> {} changes; the last one is used at all times",
                    transform.parent, transform.child
                );
                self.notes.insert(text);
            }
        } else if !is_ros {
            let known = self.constant.entry(transform.child.clone()).or_insert_with(|| Some(transform.clone()));
            let is_other = known.as_ref().is_some_and(|known| {
                known.parent != transform.parent || known.parent_from_child != transform.parent_from_child
            });
            if is_other {
                *known = None;
                self.moving.insert(transform.child.clone());
            }
        } else {
            self.moving.insert(transform.child.clone());
        }
        self.tree.insert(transform, true)
    }

    /// Chooses topics, cameras, world and source of poses.
    fn finish(
        mut self,
        all: BTreeMap<String, (Kind, u64)>,
        unreadable: Vec<Problem>,
        options: &McapOptions,
    ) -> Result<Overview, ScanError> {
        let (mut topics, mut unused) = chosen_topics(all, options).map_err(ScanError::Unusable)?;
        for problem in unreadable {
            let kind = problem.topic.as_ref().and_then(|topic| topics.get(topic)).map(|(kind, _)| *kind);
            match (kind, &problem.topic) {
                (Some(Kind::Calibration), Some(topic)) => drop(self.left_out.entry(topic.clone()).or_insert(problem)),
                (Some(_), _) => self.keep(problem, options)?,
                (None, _) => {}
            }
        }
        let mut detection_frames = std::mem::take(&mut self.detection_frames);
        detection_frames.retain(|topic, _| topics.contains_key(topic));
        let Self {
            cameras, mut tree, mut fixed, constant, mut moving, pose_sources, left_out, problems, is_ros, ..
        } = self;
        let mut notes: Vec<String> = self.notes.into_iter().collect();
        let cameras = cameras.into_values().filter(|camera| topics.contains_key(&camera.topic)).collect();
        let left_out: Vec<Problem> = left_out
            .into_values()
            .filter(|p| p.topic.as_ref().is_some_and(|topic| topics.contains_key(topic)))
            .collect();
        notes.extend(left_out.iter().map(|problem| format!("calibrations are left out: {problem}")));
        let cameras = chosen_cameras(cameras, &left_out, options, &mut notes).map_err(ScanError::Unusable)?;
        // Links that Foxglove's logs give once, or always in the same way.
        fixed.extend(constant.into_iter().filter_map(|(child, transform)| Some((child, transform?))));
        let pose_topic =
            pose_topic(&cameras[0], &tree, &moving, &pose_sources, options).map_err(ScanError::Unusable)?;
        if let Some((topic, pose)) = &pose_topic {
            tree.replace(pose.clone());
            fixed.remove(&pose.child);
            moving.insert(pose.child.clone());
            topics.extend(unused.remove(topic).map(|what| (topic.clone(), what)));
            notes.push(format!("the poses of {topic} are those of the frame \"{}\"", pose.child));
        }
        let world_frame = world_frame(&cameras, &tree, options).map_err(ScanError::Unusable)?;
        let fixed = fixed.into_values().collect();
        let pose_topic = pose_topic.map(|(topic, pose)| (topic, pose.child));
        Ok(Overview {
            topics,
            unused,
            cameras,
            detection_frames,
            world_frame,
            fixed,
            pose_topic,
            is_ros,
            notes,
            problems,
        })
    }
}

/// Topics with what they give and their numbers of messages.
type Topics = BTreeMap<String, (Kind, u64)>;

/// The topics that are used, and the others. Where topics of a kind are chosen, no others of this kind are used.
fn chosen_topics(all: Topics, options: &McapOptions) -> Result<(Topics, Topics), String> {
    for topic in &options.topics {
        if !all.contains_key(topic) {
            let known: Vec<&String> = all.keys().collect();
            let known = if known.is_empty() { "none".to_owned() } else { some_of(&known) };
            return Err(format!(
                "there is no topic \"{topic}\" with messages that can be read (--topics); there are {known}"
            ));
        }
    }
    let is_chosen = |topic: &String| options.topics.contains(topic);
    let chosen: BTreeSet<Kind> = all.iter().filter(|(topic, _)| is_chosen(topic)).map(|(_, (kind, _))| *kind).collect();
    Ok(all.into_iter().partition(|(topic, (kind, _))| match kind {
        // Poses are added where they are needed.
        Kind::Bodies | Kind::Odometry | Kind::Pose => false,
        Kind::CompressedImage if options.image_folder.is_none() => false,
        Kind::Detections | Kind::Annotations if options.without_detections => false,
        // The boxes of annotations are often those of the detections.
        Kind::Annotations if chosen.contains(&Kind::Detections) => is_chosen(topic),
        Kind::Detections if chosen.contains(&Kind::Annotations) => is_chosen(topic),
        kind => is_chosen(topic) || !chosen.contains(kind),
    }))
}

/// The cameras that are used.
fn chosen_cameras(
    mut cameras: Vec<LogCamera>,
    left_out: &[Problem],
    options: &McapOptions,
    notes: &mut Vec<String>,
) -> Result<Vec<LogCamera>, String> {
    if cameras.is_empty() {
        let why = left_out.first().map_or(String::new(), |problem| format!("; {problem}"));
        return Err(format!(
            "there is no calibrated camera: expected messages of the type sensor_msgs/CameraInfo or \
             foxglove.CameraCalibration{why}"
        ));
    }
    if let Some(frame) = &options.camera_frame {
        if cameras.iter().any(|camera| camera.frame == *frame) {
            cameras.retain(|camera| camera.frame == *frame);
        } else if let [camera] = cameras.as_mut_slice() {
            let named = if camera.frame.is_empty() { "none".to_owned() } else { format!("\"{}\"", camera.frame) };
            notes.push(format!("the frame of the camera is \"{frame}\" (its calibration names {named})"));
            camera.frame.clone_from(frame);
        } else {
            let frames: Vec<&str> = cameras.iter().map(|camera| camera.frame.as_str()).collect();
            return Err(format!(
                "no camera has the frame \"{frame}\" (--camera-frame); there are {}",
                some_of(&frames)
            ));
        }
    }
    match cameras.iter().find(|camera| camera.frame.is_empty()) {
        Some(camera) => {
            Err(format!("{} does not name the frame of the camera: set it with --camera-frame NAME", camera.topic))
        }
        None => Ok(cameras),
    }
}

/// Whether the transforms of a topic hold at every time.
pub(super) fn is_static(topic: &str) -> bool {
    topic.ends_with("tf_static")
}

fn is_same(a: &CameraRecord, b: &CameraRecord) -> bool {
    a.model == b.model && a.params == b.params && (a.width, a.height) == (b.width, b.height)
}

/// `/front/camera_info` is the camera `front`.
fn camera_id(topic: &str) -> String {
    let name = topic.trim_matches('/');
    let last = name.rsplit('/').next().unwrap_or_default();
    let name = if ["camera_info", "calibration", "camera_calibration"].contains(&last) {
        name[..name.len() - last.len()].trim_matches('/')
    } else {
        name
    };
    if name.is_empty() { "camera".to_owned() } else { name.to_owned() }
}

/// The topic of poses that is used, with one of its poses: the one that is chosen, or the only one if the transforms do not say
/// how the camera moves.
fn pose_topic(
    camera: &LogCamera,
    tree: &Tree,
    moving: &BTreeSet<String>,
    sources: &BTreeMap<String, Transform>,
    options: &McapOptions,
) -> Result<Option<(String, Transform)>, String> {
    let is_known = match &options.world_frame {
        Some(world) => tree.is_connected(world, &camera.frame),
        None => tree.ancestors(&camera.frame).iter().any(|frame| moving.contains(*frame)),
    };
    let chosen: Vec<&String> = sources.keys().filter(|topic| options.topics.contains(topic)).collect();
    let candidates = if chosen.is_empty() && !is_known { sources.keys().collect() } else { chosen };
    let topic = match candidates.as_slice() {
        [] => return Ok(None),
        [topic] => *topic,
        several => {
            let count = count(several.len(), "topic");
            return Err(format!("there are {count} of poses ({}): choose one with --topics", some_of(several)));
        }
    };
    let mut pose = sources[topic].clone();
    if pose.child.is_empty() {
        pose.child = tree.root(&camera.frame).to_owned();
    }
    if tree.ancestors(&pose.parent).contains(&&*pose.child) || pose.parent == pose.child {
        return Err(format!(
            "the poses of {topic} are those of \"{}\" in \"{}\", which lies below it",
            pose.child, pose.parent
        ));
    }
    Ok(Some((topic.clone(), pose)))
}

/// The frame in which objects are located: the one that is chosen, or the root of the cameras' tree.
fn world_frame(cameras: &[LogCamera], tree: &Tree, options: &McapOptions) -> Result<String, String> {
    let first = &cameras[0].frame;
    let world = match &options.world_frame {
        Some(world) => world.clone(),
        None => tree.root(first).to_owned(),
    };
    for camera in cameras {
        let frame = &camera.frame;
        if world == *frame || !tree.is_connected(frame, &world) {
            let roots = tree.roots();
            let known = if roots.is_empty() {
                "there are no transforms".to_owned()
            } else {
                format!("the trees begin at {}", some_of(&roots))
            };
            return Err(if options.world_frame.is_some() || world != *frame {
                format!(
                    "no transforms lead from the camera's frame \"{frame}\" to \"{world}\"; {known} (--world-frame, --camera-frame)"
                )
            } else {
                format!(
                    "the camera's frame \"{frame}\" has no transforms: its poses are unknown; {known} (--camera-frame)"
                )
            });
        }
    }
    Ok(world)
}
