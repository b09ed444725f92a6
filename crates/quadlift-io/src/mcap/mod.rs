//! Logs of robots in MCAP: calibrations, transforms and 2D detections of ROS 2 and Foxglove become frames (docs/formats/mcap.md).
//!
//! A log is read twice, and never as a whole in memory. The first reading finds the topics, the cameras and how the frames hang
//! together ([`McapLog::open`]), the second one gives the frames in the order of their times ([`McapLog::frames`]).

mod container;
mod definitions;
mod schema;
mod value;
mod cdr;
mod messages;
mod protobuf;
mod decode;
mod recorded;
mod tree;
mod scan;
mod frames;
mod live;
mod writer;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

pub use cdr::Writer as CdrWriter;
pub use container::{Place, Problem};
pub use definitions::definition;
pub use frames::{Frames, Next};
pub use live::{LiveFrames, LiveOptions};
pub use recorded::{RecordedMessage, message_to_json, recorded_messages};
pub(crate) use writer::LogWriter;

use self::messages::Kind;
use self::scan::{Overview, ScanError, scan};
use crate::error::ReadError;
use crate::guard::note_read;
use crate::input::{check_readable, read_error};
use crate::read::{Format, Import, PixelCenters, PoseFormat, Probe, ReadOptions};
use crate::scene_file::{DetectionRecord, SceneFile};
use crate::stream::AboutRecord;
use crate::wording::count;

/// Problems that a result lists, at most.
const MAX_PROBLEMS: usize = 1000;

/// How a log is read.
#[derive(Debug, Clone, PartialEq)]
pub struct McapOptions {
    /// Topics that are used in place of all others of their kinds; empty: all.
    pub topics: Vec<String>,
    /// The frame in which objects are located; by default the root of the tree in which the camera is.
    pub world_frame: Option<String>,
    /// The frame of the camera; by default that of its calibration.
    pub camera_frame: Option<String>,
    /// Largest time in seconds between an image and the nearest transform where there is none on the other side.
    pub time_tolerance: f64,
    /// Longest time in seconds between two transforms that is interpolated.
    pub longest_gap: f64,
    /// Whether the boxes were measured in the rectified image.
    pub rectified: bool,
    /// Origin of the pixel coordinates of calibrations.
    pub pixel_centers: PixelCenters,
    /// Whether what cannot be used is left out; otherwise it is an error.
    pub skip_errors: bool,
    /// Whether topics of detections are not used, so that frames are made of the calibration messages.
    pub without_detections: bool,
    /// Folder into which compressed images are written.
    pub image_folder: Option<PathBuf>,
}

impl Default for McapOptions {
    fn default() -> Self {
        Self {
            topics: Vec::new(),
            world_frame: None,
            camera_frame: None,
            time_tolerance: 0.02,
            longest_gap: 1.0,
            rectified: false,
            pixel_centers: PixelCenters::Half,
            skip_errors: false,
            without_detections: false,
            image_folder: None,
        }
    }
}

/// The bytes at the beginning of a log.
const START: &[u8] = b"\x89MCAP";

/// The row of this format.
pub const FORMAT: PoseFormat = Format {
    name: "mcap",
    title: "a log in MCAP",
    about: "A log in MCAP, of ROS 2 or Foxglove: cameras, transforms and 2D detections",
    looks: "logs in MCAP",
    options: &[
        "topics",
        "world_frame",
        "camera_frame",
        "max_gap",
        "rectified",
        "skip_errors",
        "time_tolerance",
        "write_images",
        "pixel_centers",
    ],
    finds: |probe| probe.when(probe.begins_with(START)),
    read: |path, options| read_mcap(path, McapOptions::from(options)),
};

/// Whether a file begins as logs in MCAP do.
pub fn is_mcap(path: &Path) -> bool {
    Probe::new(path).begins_with(START)
}

impl From<&ReadOptions> for McapOptions {
    fn from(options: &ReadOptions) -> Self {
        let default = Self::default();
        Self {
            topics: options.topics.clone(),
            world_frame: options.world_frame.clone(),
            camera_frame: options.camera_frame.clone(),
            time_tolerance: options.time_tolerance.unwrap_or(default.time_tolerance),
            longest_gap: options.max_gap.unwrap_or(default.longest_gap),
            rectified: options.rectified,
            pixel_centers: options.pixel_centers,
            skip_errors: options.skip_errors,
            without_detections: options.detections.is_some(),
            image_folder: options.write_images.clone(),
        }
    }
}

/// A log whose topics are known.
#[derive(Debug)]
pub struct McapLog<S> {
    path: PathBuf,
    source: S,
    options: McapOptions,
    overview: Overview,
}

/// What a log is read from, twice.
pub trait Source {
    /// Where bytes come from.
    type Input: Read + Seek;

    /// The bytes from their beginning.
    ///
    /// # Errors
    /// What the system says.
    fn open(&self) -> io::Result<Self::Input>;
}

/// A file.
impl Source for PathBuf {
    type Input = BufReader<File>;

    fn open(&self) -> io::Result<Self::Input> {
        File::open(self).map(|file| BufReader::with_capacity(1 << 16, file))
    }
}

/// Bytes in memory.
impl Source for Vec<u8> {
    type Input = io::Cursor<Vec<u8>>;

    fn open(&self) -> io::Result<Self::Input> {
        Ok(io::Cursor::new(self.clone()))
    }
}

impl McapLog<PathBuf> {
    /// Reads a log for the first time.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read, if it is no MCAP file, if it has no calibrated camera with poses, and, unless
    /// the options accept that, if a part of it cannot be used.
    pub fn open(path: &Path, options: McapOptions) -> Result<Self, ReadError> {
        check_readable(path)?;
        note_read(path);
        Self::of(path, path.to_owned(), options)
    }
}

impl<S: Source> McapLog<S> {
    /// As [`McapLog::open`], from any source; the path is used in messages.
    ///
    /// # Errors
    /// As [`McapLog::open`].
    pub fn of(path: &Path, source: S, options: McapOptions) -> Result<Self, ReadError> {
        let overview = source.open().map_err(ScanError::Io).and_then(|input| scan(input, &options));
        match overview {
            Ok(overview) => Ok(Self { path: path.to_owned(), source, options, overview }),
            Err(ScanError::Io(error)) => Err(read_error(path, &error)),
            Err(ScanError::Problem(problem)) => Err(strict_error(path, &problem)),
            Err(ScanError::Unusable(text)) => Err(ReadError::new(path, text)),
        }
    }

    /// What is used, and how.
    pub fn notes(&self) -> Vec<String> {
        let Overview { topics, unused, cameras, world_frame, notes, .. } = &self.overview;
        let listed = |topics: &BTreeMap<String, (Kind, u64)>| {
            let listed: Vec<String> = topics
                .iter()
                .map(|(topic, (kind, n))| {
                    format!("{topic} ({}, {})", kind_in_words(*kind), count(*n as usize, "message"))
                })
                .collect();
            listed.join(", ")
        };
        let mut all = vec![format!("topics that are used: {}", listed(topics))];
        if !unused.is_empty() {
            all.push(format!("topics that are not used: {}", listed(unused)));
        }
        let mut frames: Vec<&str> = cameras.iter().map(|camera| camera.frame.as_str()).collect();
        frames.dedup();
        all.push(format!("the world is the frame \"{world_frame}\", the camera \"{}\"", frames.join("\", \"")));
        all.push(match self.options.rectified {
            true => "boxes are taken as measured in the rectified image (P and R of the calibration)".to_owned(),
            false => {
                "boxes are taken as measured in the raw image (K and D of the calibration; --rectified: P)".to_owned()
            }
        });
        all.push(self.options.pixel_centers.note());
        all.extend(notes.iter().cloned());
        if !self.has_detections() {
            all.push(
                "there are no topics of 2D detections: the frames are those of the calibration messages".to_owned(),
            );
        }
        all
    }

    /// Whether there are topics of 2D detections.
    pub fn has_detections(&self) -> bool {
        self.overview.topics.values().any(|(kind, _)| matches!(kind, Kind::Detections | Kind::Annotations))
    }

    /// Topics of 2D detections of the same camera, of which one must be chosen; empty if no camera has several.
    pub fn rival_topics(&self) -> Vec<&str> {
        self.overview.rivals()
    }

    /// Unit, direction and cameras of the scene.
    pub fn about(&self) -> AboutRecord {
        let calibrations = self.overview.cameras.iter().flat_map(|camera| &camera.calibrations);
        AboutRecord {
            length_unit: Some("m".to_owned()),
            // REP 103: frames of robots and maps have z up, those of cameras do not.
            up: (self.overview.is_ros && !self.overview.world_frame.contains("optical")).then_some([0.0, 0.0, 1.0]),
            cameras: calibrations.map(|calibration| calibration.camera.clone()).collect(),
            ..AboutRecord::default()
        }
    }

    /// Reads the log again, frame by frame.
    ///
    /// # Errors
    /// [`ReadError`] if the file cannot be read again.
    pub fn frames(self) -> Result<Frames<S::Input>, ReadError> {
        let Self { path, source, options, overview } = self;
        let failed = |error: io::Error| read_error(&path, &error);
        let input = source.open().map_err(failed)?;
        Frames::new(input, overview, &options).map_err(failed)?.map_err(|text| ReadError::new(&path, text))
    }
}

/// A problem where none is accepted.
pub(crate) fn strict_error(path: &Path, problem: &Problem) -> ReadError {
    let error = ReadError::new(
        path,
        match &problem.topic {
            Some(topic) => format!("{topic}: {}; --skip-errors uses the rest", problem.text),
            None => format!("{}; --skip-errors uses the rest", problem.text),
        },
    );
    match &problem.place {
        Some(place) => error.in_entry(place.to_string()),
        None => error,
    }
}

fn kind_in_words(kind: Kind) -> &'static str {
    match kind {
        Kind::Calibration => "calibration",
        Kind::Transforms => "transforms",
        Kind::Odometry => "odometry",
        Kind::Pose => "poses",
        Kind::Detections => "2D detections",
        Kind::Annotations => "image annotations",
        Kind::CompressedImage => "compressed images",
        Kind::Bodies => "3D bodies, which are no measurements in images",
    }
}

/// Reads a log into a scene: a frame for each image with detections, or for each calibration message if the log has no
/// detections. Frames are in the order of their times.
///
/// # Errors
/// As [`McapLog::open`], and if the scene is not valid.
pub(crate) fn read_mcap(path: &Path, options: McapOptions) -> Result<Import, ReadError> {
    to_scene(path, McapLog::open(path, options)?)
}

/// The scene in the bytes of a log; the path is used in messages.
///
/// # Errors
/// [`ReadError`] if the bytes are no log, and if the scene is not valid.
pub fn parse_mcap(path: &Path, bytes: Vec<u8>, options: McapOptions) -> Result<Import, ReadError> {
    to_scene(path, McapLog::of(path, bytes, options)?)
}

fn to_scene<S: Source>(path: &Path, log: McapLog<S>) -> Result<Import, ReadError> {
    let (mut notes, about, skip_errors) = (log.notes(), log.about(), log.options.skip_errors);
    let image_folder = log.options.image_folder.clone();
    let mut scene =
        SceneFile { length_unit: about.length_unit, up: about.up, cameras: about.cameras, ..SceneFile::default() };
    let mut frames = log.frames()?;
    let (mut problems, mut problem_count) = (Vec::new(), 0);
    let (mut outside, mut first_outside) = (0, None);
    let mut known = std::collections::HashSet::new();
    let mut problem = |problem: Problem| {
        if !skip_errors {
            return Err(strict_error(path, &problem));
        }
        problem_count += 1;
        if problems.len() < MAX_PROBLEMS {
            problems.push(format!("{}: {problem}", path.display()));
        }
        Ok(())
    };
    while let Some(next) = frames.next_frame().map_err(|error| read_error(path, &error))? {
        match next {
            Next::Problem(found) => problem(found)?,
            // At both ends of a log this is usual.
            Next::Outside(found) => {
                outside += 1;
                first_outside.get_or_insert(found);
            }
            Next::Frame(frame) if !known.insert(frame.record.id.clone()) => {
                let text = format!("the frame {} comes twice; the second one is left out", frame.record.id);
                problem(Problem { place: None, topic: None, text })?;
            }
            Next::Frame(mut frame) => {
                scene.detections.append(&mut without_repeated_ids(frame.detections, &mut problem)?);
                frame.record.image = None;
                scene.frames.push(frame.record);
            }
        }
    }
    let time = |time: Option<f64>| time.unwrap_or_default();
    scene.frames.sort_by(|a, b| time(a.time).total_cmp(&time(b.time)));
    if image_folder.is_some() {
        let images = frames.images();
        for frame in &mut scene.frames {
            frame.image = images.get(&frame.id).cloned();
        }
        let named = scene.frames.iter().filter(|frame| frame.image.is_some()).count();
        notes.push(format!("{} written, {named} of frames", count(images.len(), "image")));
    }
    notes.extend(frames.notes());
    if let Some(first) = first_outside {
        if scene.frames.is_empty() {
            let text = format!("none of {} has a pose; the first one: {first}", count(outside, "image"));
            return Err(ReadError::new(path, text));
        }
        notes.push(format!("{} without a pose are skipped; the first one: {first}", count(outside, "image")));
    }
    if problem_count > 0 {
        notes.push(format!("{} left out", count(problem_count, "problem")));
    }
    Import { scene, image_folder, notes, problems, problem_count, ..Import::default() }.checked(path)
}

/// The detections of a frame; an id that two of them have is a problem, and the second one loses it.
fn without_repeated_ids(
    mut detections: Vec<DetectionRecord>,
    problem: &mut impl FnMut(Problem) -> Result<(), ReadError>,
) -> Result<Vec<DetectionRecord>, ReadError> {
    let mut known = std::collections::HashSet::new();
    for detection in &mut detections {
        let Some(id) = detection.object.clone() else { continue };
        if !known.insert((id.clone(), detection.source.clone())) {
            let text = format!("two detections of the frame {} have the id \"{id}\"; one loses it", detection.frame);
            problem(Problem { place: None, topic: detection.source.as_deref().map(str::to_owned), text })?;
            detection.object = None;
        }
    }
    Ok(detections)
}
