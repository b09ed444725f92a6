//! A line of the input as records. What the records say is checked by [`super::StreamedScene`].

use std::collections::BTreeMap;
use std::fmt;

use quadlift::scene::Scene;
use quadlift::solve::PoseNoise;
use serde::de::value::MapAccessDeserializer;
use serde::de::{MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};

use crate::error::{EntryError, ReadError, escape};
use crate::numbers;
use crate::scene_file::{
    Box3dRecord, CameraRecord, CueSourceRecord, DepthRecord, DetectionRecord, FrameRecord, OrientedBoxRecord,
    SceneFile, parse_json_line,
};
use crate::time_steps::time_steps;

/// What a line says.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Line {
    /// Name, unit, direction and cameras, as in scene files. They hold from this line on.
    pub about: AboutRecord,
    /// Frames of one time step, in the order of the line.
    pub frames: Vec<FrameLine>,
    /// New poses of earlier frames.
    pub poses: Option<Vec<PoseRecord>>,
    /// Whether the frames stand in a list, so that errors must say which one it is.
    pub is_list: bool,
}

/// What a line can say of the scene.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct AboutRecord {
    /// Name of the scene.
    pub name: Option<String>,
    /// World unit ("m" for meters).
    pub length_unit: Option<String>,
    /// World direction against gravity, of any length.
    #[serde(default, deserialize_with = "numbers::optional_list")]
    pub up: Option<[f64; 3]>,
    /// Cameras that frames name.
    #[serde(default)]
    pub cameras: Vec<CameraRecord>,
    /// What is known of sources of depths, by name.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cue_sources: BTreeMap<String, CueSourceRecord>,
}

/// A frame with its detections.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameLine {
    /// The frame as scene files have it, except for a camera that is given in place.
    pub record: FrameRecord,
    /// Its camera, where it is not named.
    pub camera: Option<CameraOfFrame>,
    /// The detections.
    pub detections: Vec<DetectionRecord>,
    /// Standard deviations of the pose.
    pub pose_noise: Option<PoseNoise>,
}

impl FrameLine {
    /// Of the frame with its pose, and of the boxes: by it a stream that goes on knows its own frames.
    pub(super) fn checksum(&self) -> u32 {
        let boxes: Vec<_> = self.detections.iter().map(|detection| detection.bounding_box).collect();
        // Records of numbers and text are always written.
        serde_json::to_vec(&(&self.record, boxes)).map_or(0, |text| crc32fast::hash(&text))
    }
}

/// A camera that is given in the frame that it made. It can have an `id`, by which other frames name it.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
pub struct CameraOfFrame {
    /// Id that frames name.
    pub id: Option<String>,
    /// COLMAP's name of the model.
    pub model: String,
    /// Image width in pixels.
    pub width: Option<f64>,
    /// Image height in pixels.
    pub height: Option<f64>,
    /// Parameters in COLMAP's order.
    pub params: Vec<f64>,
}

/// The new pose of a frame.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct PoseRecord {
    /// Id of the frame.
    pub frame: String,
    /// `[R | t]` by rows, for a frame that has a camera.
    #[serde(default, deserialize_with = "numbers::optional_matrix")]
    pub cam_from_world: Option<[[f64; 4]; 3]>,
    /// 3x4 projection by rows, for a frame that was given one.
    #[serde(default, deserialize_with = "numbers::optional_matrix")]
    pub projection: Option<[[f64; 4]; 3]>,
}

/// What is wrong with a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineError {
    /// Id of the frame, where it is known.
    pub frame: Option<String>,
    /// Column in bytes, from 1, where it is known.
    pub column: Option<usize>,
    /// What was found and what was expected, with the entry.
    pub message: String,
}

impl LineError {
    /// A problem with a whole line.
    pub fn new(message: impl fmt::Display) -> Self {
        Self { frame: None, column: None, message: escape(&message.to_string()) }
    }

    /// A problem with an entry of the line.
    pub fn of_entry(error: &EntryError) -> Self {
        let entry = if error.entry.is_empty() { String::new() } else { format!("{}: ", error.entry) };
        // In one line and of limited length, as errors of files are.
        Self::new(ReadError::new("".as_ref(), format!("{entry}{}", error.problem)).problem)
    }

    /// The same problem, with the id of the frame.
    #[must_use]
    pub fn in_frame(self, id: &str) -> Self {
        Self { frame: Some(id.to_owned()), ..self }
    }
}

/// The members of a line, or of a frame in its list, in any combination; [`Line`] has those that make sense together.
#[derive(Deserialize)]
#[serde(expecting = "an object {...}")]
struct Members {
    name: Option<String>,
    length_unit: Option<String>,
    #[serde(default, deserialize_with = "numbers::optional_list")]
    up: Option<[f64; 3]>,
    #[serde(default)]
    cameras: Vec<CameraRecord>,
    #[serde(default)]
    cue_sources: BTreeMap<String, CueSourceRecord>,
    frame: Option<String>,
    time: Option<f64>,
    camera: Option<CameraMember>,
    #[serde(default, deserialize_with = "numbers::optional_matrix")]
    cam_from_world: Option<[[f64; 4]; 3]>,
    #[serde(default, deserialize_with = "numbers::optional_matrix")]
    projection: Option<[[f64; 4]; 3]>,
    width: Option<f64>,
    height: Option<f64>,
    image: Option<String>,
    detections: Option<Vec<DetectionMember>>,
    pose_noise: Option<PoseNoiseMember>,
    frames: Option<Vec<Members>>,
    poses: Option<Vec<PoseRecord>>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object {...}")]
struct DetectionMember {
    #[serde(rename = "box", default, deserialize_with = "numbers::optional_list")]
    bounding_box: Option<[f64; 4]>,
    #[serde(default, deserialize_with = "numbers::optional_lists")]
    outline: Option<Box<[[f64; 2]]>>,
    oriented_box: Option<Box<OrientedBoxRecord>>,
    category: Option<Box<str>>,
    score: Option<f64>,
    object: Option<Box<str>>,
    depth: Option<Box<DepthRecord>>,
    box3d: Option<Box<Box3dRecord>>,
}

#[derive(Deserialize)]
#[serde(expecting = "an object {...}")]
struct PoseNoiseMember {
    rotation_sd: f64,
    translation_sd: f64,
}

/// The id of a camera, or a camera.
enum CameraMember {
    Id(String),
    Camera(CameraOfFrame),
}

impl<'de> Deserialize<'de> for CameraMember {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(CameraVisitor)
    }
}

struct CameraVisitor;

impl<'de> Visitor<'de> for CameraVisitor {
    type Value = CameraMember;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("the id of a camera, or a camera {...}")
    }

    fn visit_str<E>(self, id: &str) -> Result<CameraMember, E> {
        Ok(CameraMember::Id(id.to_owned()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<CameraMember, A::Error> {
        CameraOfFrame::deserialize(MapAccessDeserializer::new(map)).map(CameraMember::Camera)
    }
}

/// Reads a line of the input.
///
/// # Errors
/// [`LineError`] when it is no UTF-8 text, no JSON object, when an entry has another shape than it should, or when what it
/// must have is missing.
pub fn parse_line(bytes: &[u8]) -> Result<Line, LineError> {
    let mut members: Members = parse_json_line(bytes).map_err(|error| {
        let problem = error.problem.replacen("the file ends too early", "the line ends too early", 1);
        let message = error.entry.map_or(problem.clone(), |entry| format!("{entry}: {problem}"));
        LineError { frame: None, column: error.column, message }
    })?;
    let about = AboutRecord {
        name: members.name.take(),
        length_unit: members.length_unit.take(),
        up: members.up.take(),
        cameras: std::mem::take(&mut members.cameras),
        cue_sources: std::mem::take(&mut members.cue_sources),
    };
    let poses = members.poses.take();
    let list = members.frames.take();
    let (is_list, is_frame, time) = (list.is_some(), members.frame.is_some(), members.time);
    let of_frame = members.detections.is_some() || members.cam_from_world.is_some() || members.projection.is_some();
    let frames = match list {
        Some(_) if is_frame => return Err(LineError::new("found \"frame\" and \"frames\"; expected one of them")),
        Some(list) => list,
        None if is_frame => vec![members],
        None if of_frame => return Err(LineError::new("there is no \"frame\"; expected the id of the frame")),
        None => Vec::new(),
    };
    if frames.is_empty() && !is_list && poses.is_none() && about == AboutRecord::default() {
        return Err(LineError::new("expected \"frame\", \"frames\", \"poses\" or \"cameras\"; found none of them"));
    }
    let place = |index: usize| if is_list { format!("frames[{index}]") } else { String::new() };
    let frames = frames.into_iter().enumerate().map(|(index, members)| {
        members.into_frame(time).map_err(|(id, problem)| {
            let error = LineError::of_entry(&EntryError::new(place(index), problem));
            id.iter().fold(error, |error, id| error.in_frame(id))
        })
    });
    Ok(Line { about, frames: frames.collect::<Result<_, _>>()?, poses, is_list })
}

impl Members {
    /// The frame, or what is missing, with the id where there is one.
    fn into_frame(self, time_of_line: Option<f64>) -> Result<FrameLine, (Option<String>, &'static str)> {
        let Some(id) = self.frame else { return Err((None, "there is no \"frame\"; expected the id of the frame")) };
        if self.frames.is_some() || self.poses.is_some() {
            return Err((Some(id), "found \"frames\" or \"poses\" in a frame; expected them in the line"));
        }
        let Some(time) = self.time.or(time_of_line) else {
            return Err((Some(id), "there is no \"time\"; expected seconds"));
        };
        let (name, camera) = match self.camera {
            None => (None, None),
            Some(CameraMember::Id(id)) => (Some(id), None),
            Some(CameraMember::Camera(camera)) => (None, Some(camera)),
        };
        let detection = |member: DetectionMember| DetectionRecord {
            frame: id.as_str().into(),
            object: member.object,
            category: member.category,
            score: member.score,
            bounding_box: member.bounding_box,
            outline: member.outline,
            oriented_box: member.oriented_box,
            depth: member.depth,
            box3d: member.box3d,
            ..Default::default()
        };
        let detections = self.detections.unwrap_or_default().into_iter().map(detection).collect();
        let record = FrameRecord {
            camera: name,
            cam_from_world: self.cam_from_world,
            projection: self.projection,
            width: self.width,
            height: self.height,
            image: self.image,
            time: Some(time),
            id,
            ..Default::default()
        };
        let pose_noise = self
            .pose_noise
            .map(|noise| PoseNoise { rotation_sd: noise.rotation_sd, translation_sd: noise.translation_sd });
        Ok(FrameLine { record, camera, detections, pose_noise })
    }
}

/// The frames of a scene with the detections of one source (all where it is `None`) that have a box, an outline, an oriented box or an ellipse, in the order of their times; frames of
/// the same time stay in the order of the file. Where not every frame has a time, it is the index of the frame, or of its rig's
/// frame. `scene` is that of the file.
pub fn scene_to_frames(file: SceneFile, scene: &Scene, source: Option<u32>) -> (AboutRecord, Vec<FrameLine>) {
    let SceneFile { name, length_unit, up, cameras, frames, detections, cue_sources, .. } = file;
    let has_times = frames.iter().all(|frame| frame.time.is_some_and(f64::is_finite));
    let time_steps = time_steps(&frames);
    let mut lines: Vec<FrameLine> = frames
        .into_iter()
        .zip(time_steps)
        .map(|(record, time_step)| {
            let time = record.time.filter(|_| has_times).or(Some(time_step as f64));
            FrameLine { record: FrameRecord { time, ..record }, ..Default::default() }
        })
        .collect();
    for (record, detection) in detections.into_iter().zip(&scene.detections) {
        // The map finds objects by their boxes.
        let has_shape = record.outline.is_some() || record.oriented_box.is_some();
        let has_box = record.bounding_box.is_some() || record.ellipse.is_some() || has_shape;
        if has_box && (source.is_none() || detection.source_index == source) {
            lines[detection.frame_index as usize].detections.push(record);
        }
    }
    lines.sort_by(|a, b| a.record.time.unwrap_or_default().total_cmp(&b.record.time.unwrap_or_default()));
    (AboutRecord { name, length_unit, up, cameras, cue_sources }, lines)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_of_the_line_holds_for_its_frames() {
        let text =
            br#"{"time": 2.5, "frames": [{"frame": "a"}, {"frame": "b", "time": 3, "camera": "left"}], "mine": 1}"#;
        let line = parse_line(text).unwrap();
        let times: Vec<Option<f64>> = line.frames.iter().map(|frame| frame.record.time).collect();
        assert_eq!((times, line.is_list), (vec![Some(2.5), Some(3.0)], true));
        assert_eq!(line.frames[1].record.camera.as_deref(), Some("left"));
    }

    #[test]
    fn frames_of_a_rig_without_times_are_of_one_time_step() {
        let pose = serde_json::json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
        let frame = |id: &str, rig_frame: u32| serde_json::json!({"id": id, "camera": "c", "cam_from_world": pose, "rig_frame": rig_frame});
        let text = serde_json::json!({
            "format": "quadlift.scene", "version": 1,
            "cameras": [{"id": "c", "model": "PINHOLE", "params": [1, 1, 0, 0]}],
            "frames": [frame("left/0", 4), frame("left/1", 9), frame("right/0", 4), frame("right/1", 9)],
        });
        let file = crate::scene_file::parse_scene_file("a.json".as_ref(), text.to_string().as_bytes()).unwrap();
        let scene = file.to_scene().unwrap();
        let (_, lines) = scene_to_frames(file, &scene, None);
        let found: Vec<(&str, f64)> =
            lines.iter().map(|line| (line.record.id.as_str(), line.record.time.unwrap())).collect();
        assert_eq!(found, [("left/0", 0.0), ("right/0", 0.0), ("left/1", 1.0), ("right/1", 1.0)]);
    }

    #[test]
    fn a_camera_is_named_or_given() {
        let text = br#"{"frame": "a", "time": 0, "camera": {"model": "PINHOLE", "params": [1, 1, 0, 0]}}"#;
        let frame = &parse_line(text).unwrap().frames[0];
        assert!(frame.record.camera.is_none());
        assert_eq!(frame.camera.as_ref().unwrap().params, [1.0, 1.0, 0.0, 0.0]);
        let error = parse_line(br#"{"frame": "a", "time": 0, "camera": 7}"#).unwrap_err();
        assert!(error.message.contains("expected the id of a camera, or a camera {...}"), "{error:?}");
    }

    #[test]
    fn what_is_missing_is_named() {
        let message = |text: &str| parse_line(text.as_bytes()).unwrap_err().message;
        assert_eq!(message(r#"{"frame": "a"}"#), "there is no \"time\"; expected seconds");
        assert_eq!(message(r#"{"time": 1, "detections": []}"#), "there is no \"frame\"; expected the id of the frame");
        assert_eq!(message(r#"{"frames": [{"frame": "a"}]}"#), "frames[0]: there is no \"time\"; expected seconds");
        assert!(message(r#"{"frame": "a", "frames": []}"#).starts_with("found \"frame\" and \"frames\""));
        assert!(message("{").starts_with("the line ends too early"));
        let error = parse_line(b"{\"frame\": \"a\", \"x\": \xff}").unwrap_err();
        assert!(error.message.contains("0xff is not UTF-8") && error.column == Some(21), "{error:?}");
    }
}
