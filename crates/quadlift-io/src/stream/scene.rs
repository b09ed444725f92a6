//! What is known of the scene of a stream: cameras and the frames that the map keeps, as they were given.

use std::collections::{BTreeMap, BTreeSet};

use quadlift::geometry::OrientedBox;
use quadlift::online::{Frame, MapShape, ObjectMap, PoseUpdate};
use quadlift::scene::{self, Cues, NewDetection};

use super::line::{AboutRecord, CameraOfFrame, FrameLine, PoseRecord};
use crate::error::EntryError;
use crate::scene_file::{
    CameraRecord, CueSourceRecord, DetectionRecord, FrameRecord, OrientedBoxRecord, SceneFile, known_names,
};

/// Cameras with an id, at most; others can be given in their frames.
const MAX_CAMERAS: usize = 10_000;

/// Frames beyond twice the number that the map keeps, before those that it has forgotten are forgotten here.
const SLACK: usize = 256;

/// Name, unit, direction and cameras of the scene, and the frames that the map keeps.
#[derive(Debug, Clone, Default)]
pub struct StreamedScene {
    /// Without the cameras.
    about: AboutRecord,
    /// Cameras with an id.
    cameras: BTreeMap<String, CameraRecord>,
    /// Cameras that were given in their frames without an id, by the ids that they have in the map file.
    unnamed: BTreeMap<String, CameraRecord>,
    frames: BTreeMap<String, FrameRecord>,
    /// Checksums of these frames as they were given, with their detections.
    given: BTreeMap<String, u32>,
}

/// A frame that is right.
#[derive(Debug, Clone)]
pub struct CheckedFrame {
    /// The frame.
    pub frame: Frame,
    /// The frame as it is kept.
    record: FrameRecord,
    /// Checksum of the frame as it was given.
    given: u32,
    /// Its camera, where it was given in the frame, and whether it has an id of its own.
    camera: Option<(CameraRecord, bool)>,
    detections: Vec<DetectionRecord>,
    /// Depths and 3D boxes in the frame of the camera; `None` where a detection has none.
    cues: Vec<Option<Box<Cues>>>,
}

impl CheckedFrame {
    /// Path of the image, if it is known.
    pub fn image(&self) -> Option<&str> {
        self.record.image.as_deref()
    }

    /// The detections, in their order.
    pub fn detections(&self) -> Vec<NewDetection<'_>> {
        let all = self.detections.iter().zip(&self.cues);
        // Checked already.
        let named = all.map(|(record, cues)| NewDetection {
            cues: cues.as_deref().copied().unwrap_or_default(),
            ..record.detection(str::to_owned).unwrap_or_default()
        });
        named.collect()
    }
}

impl StreamedScene {
    /// The scene of a stored state.
    pub(super) fn from_parts(
        mut about: AboutRecord,
        frames: Vec<FrameRecord>,
        given: BTreeMap<String, u32>,
        unnamed: Vec<CameraRecord>,
    ) -> Result<Self, EntryError> {
        let by_id = |camera: CameraRecord| (camera.id.clone(), camera);
        let cameras = std::mem::take(&mut about.cameras).into_iter().map(by_id).collect();
        let unnamed = unnamed.into_iter().map(by_id).collect();
        let scene = Self { about, cameras, unnamed, given, frames: BTreeMap::new() };
        for (index, frame) in frames.iter().enumerate() {
            let error = |error: EntryError| EntryError::new(format!("frames[{index}].{}", error.entry), error.problem);
            scene.scene_of(frame, None, &[]).map_err(error)?;
        }
        Ok(Self { frames: frames.into_iter().map(|frame| (frame.id.clone(), frame)).collect(), ..scene })
    }

    /// What a state holds: name, unit, direction and cameras, the frames that the map keeps with their checksums, and the cameras
    /// without an id that made them.
    pub(super) fn to_parts(
        &self,
        map: &ObjectMap,
    ) -> (AboutRecord, Vec<FrameRecord>, BTreeMap<String, u32>, Vec<CameraRecord>) {
        let kept = map.kept_frames().filter_map(|frame| self.frames.get(&frame.id));
        let frames: Vec<FrameRecord> = kept.cloned().collect();
        let used: BTreeSet<&str> = frames.iter().filter_map(|frame| frame.camera.as_deref()).collect();
        let unnamed = self.unnamed.values().filter(|camera| used.contains(camera.id.as_str())).cloned().collect();
        let about = AboutRecord { cameras: self.cameras.values().cloned().collect(), ..self.about.clone() };
        let given = frames.iter().filter_map(|frame| Some((frame.id.clone(), *self.given.get(&frame.id)?))).collect();
        (about, frames, given, unnamed)
    }

    /// What lines said of the scene, without its cameras.
    pub fn about(&self) -> &AboutRecord {
        &self.about
    }

    /// Takes in what a line says of the scene. Cameras of the same id must be the same.
    ///
    /// # Errors
    /// [`EntryError`] names the entry that is wrong; then nothing is taken in.
    pub fn take_in(&mut self, about: &AboutRecord) -> Result<(), EntryError> {
        let up = about.up.or(self.about.up);
        let mut new: BTreeMap<&str, &CameraRecord> = BTreeMap::new();
        for (index, camera) in about.cameras.iter().enumerate() {
            let entry = || format!("cameras[{index}]");
            match self.camera(&camera.id).or(new.get(camera.id.as_str()).copied()) {
                Some(known) if known != camera => return Err(other_camera(entry(), &camera.id)),
                Some(_) => {}
                None if self.cameras.len() + new.len() >= MAX_CAMERAS => {
                    let problem = format!("there are {MAX_CAMERAS} cameras already; give others in their frames");
                    return Err(EntryError::new(entry(), problem));
                }
                None => drop(new.insert(&camera.id, camera)),
            }
        }
        // Where all are new the places are those of the line.
        let (cameras, cue_sources) = (new.values().map(|&camera| camera.clone()).collect(), about.cue_sources.clone());
        SceneFile { up, cameras, cue_sources, ..SceneFile::default() }.to_scene().map_err(|error| {
            let is_placed = error.entry == "up" || error.entry.starts_with("cue_sources");
            match new.len() == about.cameras.len() && new.len() == 1 || is_placed {
                true => error,
                false => EntryError::new("cameras", error.problem),
            }
        })?;
        self.cameras.extend(new.into_iter().map(|(id, camera)| (id.to_owned(), camera.clone())));
        self.about.cue_sources.extend(about.cue_sources.clone());
        self.about.up = up;
        self.about.name = about.name.clone().or(self.about.name.take());
        self.about.length_unit = about.length_unit.clone().or(self.about.length_unit.take());
        Ok(())
    }

    /// Whether a frame is the one of its id that was observed, whose pose may have been corrected since; `None` where that one was
    /// forgotten.
    pub fn is_as_given(&self, line: &FrameLine) -> Option<bool> {
        self.given.get(&line.record.id).map(|given| *given == line.checksum())
    }

    /// The camera with an id.
    pub fn camera(&self, id: &str) -> Option<&CameraRecord> {
        self.cameras.get(id).or_else(|| self.unnamed.get(id))
    }

    /// Checks a frame and its detections.
    ///
    /// # Errors
    /// [`EntryError`] names the entry that is wrong.
    pub fn check(&self, line: FrameLine, map: &ObjectMap) -> Result<CheckedFrame, EntryError> {
        let given = line.checksum();
        let FrameLine { mut record, camera, detections, pose_noise } = line;
        // A frame that the map has forgotten may come again; in one file both would have the same id.
        if self.frames.contains_key(&record.id) && map.kept_frames().any(|frame| frame.id == record.id) {
            return Err(EntryError::new("", format!("frame {:?} was observed before", record.id)));
        }
        let camera = camera.map(|camera| self.named(camera)).transpose()?;
        if let Some((camera, _)) = &camera {
            record.camera = Some(camera.id.clone());
        }
        let scene = self.scene_of(&record, camera.as_ref().map(|(camera, _)| camera), &detections)?;
        let cues = scene.detections.iter().map(|detection| detection.cues.clone()).collect();
        for (index, record) in detections.iter().enumerate() {
            let entry = |field: &str| format!("detections[{index}]{field}");
            let problem = "there is no \"box\"; expected [x0, y0, x1, y1], an \"outline\" or an \"oriented_box\"";
            record.detection(entry)?.box_or_around().ok_or_else(|| EntryError::new(entry(""), problem))?;
        }
        let time = record.time.unwrap_or_default();
        let mut frame = match scene.frames.first() {
            Some(frame) => Frame::of_scene(&scene, frame, time),
            None => return Err(EntryError::new("frame", "there is no frame")),
        };
        if let Some(noise) = pose_noise {
            let is_positive = |x: f64| x > 0.0 && x.is_finite();
            if !is_positive(noise.rotation_sd) || !is_positive(noise.translation_sd) {
                let problem = "expected two numbers above 0, \"rotation_sd\" and \"translation_sd\"";
                return Err(EntryError::new("pose_noise", problem));
            }
            frame.pose_noise = Some(noise);
        }
        Ok(CheckedFrame { frame, record, given, camera, detections, cues })
    }

    /// Keeps a frame that was observed.
    pub fn keep(&mut self, frame: CheckedFrame, map: &ObjectMap) {
        if let Some((camera, has_id)) = frame.camera {
            let cameras = if has_id { &mut self.cameras } else { &mut self.unnamed };
            cameras.insert(camera.id.clone(), camera);
        }
        self.given.insert(frame.record.id.clone(), frame.given);
        self.frames.insert(frame.record.id.clone(), frame.record);
        if self.frames.len() > 2 * map.keyframes() + SLACK {
            let kept: BTreeSet<&str> = map.kept_frames().map(|frame| frame.id.as_str()).collect();
            self.frames.retain(|id, _| kept.contains(id.as_str()));
            self.given.retain(|id, _| kept.contains(id.as_str()));
            let used: BTreeSet<&str> = self.frames.values().filter_map(|frame| frame.camera.as_deref()).collect();
            self.unnamed.retain(|id, _| used.contains(id.as_str()));
        }
    }

    /// Checks new poses and takes them in. Frames that are not known, or forgotten, are passed over.
    ///
    /// # Errors
    /// [`EntryError`] names the entry that is wrong; then nothing is taken in.
    pub fn take_in_poses(&mut self, poses: &[PoseRecord]) -> Result<Vec<PoseUpdate>, EntryError> {
        let mut updates = Vec::with_capacity(poses.len());
        let mut records = Vec::with_capacity(poses.len());
        for (index, pose) in poses.iter().enumerate() {
            let entry = |error: EntryError| {
                let field = if error.entry.is_empty() { String::new() } else { format!(".{}", error.entry) };
                EntryError::new(format!("poses[{index}]{field}"), error.problem)
            };
            let Some(known) = self.frames.get(&pose.frame) else { continue };
            let record = match (pose.cam_from_world, pose.projection) {
                (Some(_), None) if known.cam_from_world.is_some() => {
                    FrameRecord { cam_from_world: pose.cam_from_world, ..known.clone() }
                }
                (None, Some(_)) if known.projection.is_some() => {
                    FrameRecord { projection: pose.projection, ..known.clone() }
                }
                _ => {
                    let expected = if known.projection.is_some() { "projection" } else { "cam_from_world" };
                    let problem = format!("expected the \"{expected}\" of frame {:?} and nothing else", pose.frame);
                    return Err(entry(EntryError::new("", problem)));
                }
            };
            let scene = self.scene_of(&record, None, &[]).map_err(entry)?;
            let projection = scene.frames.first().map(|frame| frame.projection);
            updates.extend(projection.map(|projection| PoseUpdate { frame: pose.frame.clone(), projection }));
            records.push(record);
        }
        for record in records {
            self.frames.insert(record.id.clone(), record);
        }
        Ok(updates)
    }

    /// The kept views of the map's objects as a scene file: cameras, frames and detections with their objects. Estimates are
    /// added by a run ([`crate::run::FileRun::result`]).
    pub fn to_file(&self, map: &ObjectMap) -> SceneFile {
        self.file_of(&map.to_scene(), &map.shapes_of_scene())
    }

    /// The same with the boxes from which the objects are estimated ([`ObjectMap::to_averaged_scene`]).
    pub(crate) fn to_averaged_file(&self, map: &ObjectMap) -> SceneFile {
        self.file_of(&map.to_averaged_scene(), &map.shapes_of_scene())
    }

    /// `shapes` are those of the detections.
    fn file_of(&self, scene: &scene::Scene, shapes: &[Option<&MapShape>]) -> SceneFile {
        let frames: Vec<FrameRecord> = scene.frames.iter().map(|frame| self.record_of(frame)).collect();
        let used: BTreeSet<&str> = frames.iter().filter_map(|frame| frame.camera.as_deref()).collect();
        let all = self.cameras.values().chain(self.unnamed.values());
        let cameras = all.filter(|camera| used.contains(camera.id.as_str())).cloned().collect();
        let short = |[x, y]: [f64; 2]| [shortest(x), shortest(y)];
        let detections = scene.detections.iter().zip(shapes).map(|(detection, shape)| DetectionRecord {
            outline: shape.and_then(|s| Some(s.outline()?.into_iter().map(short).collect())),
            oriented_box: shape.and_then(|s| s.oriented_box()).map(|turned| Box::new(short_turned(turned))),
            score: detection.score.map(shortest),
            // Not the box around an outline alone.
            bounding_box: (detection.box_in_image.or(detection.bounding_box))
                .filter(|_| shape.is_none_or(|s| s.has_box()))
                .map(|found| found.edges().map(shortest)),
            ..DetectionRecord::of_scene(scene, detection)
        });
        let mut seen = BTreeSet::new();
        SceneFile {
            name: self.about.name.clone(),
            length_unit: self.about.length_unit.clone(),
            up: self.about.up,
            cue_sources: scene
                .scaled_by_frame
                .iter()
                .filter_map(|&source| {
                    let record = CueSourceRecord { scale: Some("frame".into()), ..Default::default() };
                    Some((scene.cue_sources.get(source as usize)?.clone(), record))
                })
                .collect(),
            cameras,
            // Objects that were merged may have two views of one frame; a scene has one.
            detections: detections
                .zip(&scene.detections)
                .filter(|(_, detection)| seen.insert((detection.frame_index, detection.object_index)))
                .map(|(record, _)| record)
                .collect(),
            frames,
            ..SceneFile::default()
        }
    }

    /// A frame of the map as it was given.
    fn record_of(&self, frame: &scene::Frame) -> FrameRecord {
        if let Some(record) = self.frames.get(&frame.id) {
            return record.clone();
        }
        let matrix = frame.projection.matrix();
        let size = frame.image_size;
        FrameRecord {
            id: frame.id.clone(),
            projection: Some([0, 1, 2].map(|i| [0, 1, 2, 3].map(|j| matrix[(i, j)]))),
            width: size.map(|size| size.x),
            height: size.map(|size| size.y),
            ..Default::default()
        }
    }

    /// A camera that was given in its frame, and whether it has an id; where it has none, one is made of its numbers.
    fn named(&self, camera: CameraOfFrame) -> Result<(CameraRecord, bool), EntryError> {
        let CameraOfFrame { id, model, width, height, params } = camera;
        let mut record = CameraRecord { model, width, height, params, ..Default::default() };
        let Some(id) = id else {
            let numbers = serde_json::to_vec(&record).unwrap_or_default();
            record.id = format!("camera_{:016x}", fnv_1a(&numbers));
            return Ok((record, false));
        };
        record.id = id;
        match self.camera(&record.id) {
            Some(known) if *known != record => Err(other_camera("camera".to_owned(), &record.id)),
            None if self.cameras.len() >= MAX_CAMERAS => {
                let problem = format!("there are {MAX_CAMERAS} cameras already; leave the \"id\" out");
                Err(EntryError::new("camera.id", problem))
            }
            _ => Ok((record, true)),
        }
    }

    /// A scene of one frame, which checks it.
    fn scene_of(
        &self,
        record: &FrameRecord,
        own_camera: Option<&CameraRecord>,
        detections: &[DetectionRecord],
    ) -> Result<scene::Scene, EntryError> {
        let known = record.camera.as_deref().and_then(|id| self.camera(id));
        if let (Some(id), None, None) = (&record.camera, known, own_camera) {
            let hint = known_names(id, self.cameras.keys().map(String::as_str), "cameras");
            return Err(EntryError::new("camera", format!("unknown camera \"{id}\"; {hint}")));
        }
        // Ids of a tracker are evidence only: that one stands twice is no error.
        let detections = detections.iter().map(|detection| DetectionRecord { object: None, ..detection.clone() });
        let file = SceneFile {
            cameras: own_camera.or(known).cloned().into_iter().collect(),
            frames: vec![record.clone()],
            detections: detections.collect(),
            cue_sources: self.about.cue_sources.clone(),
            ..SceneFile::default()
        };
        file.to_scene().map_err(|error| {
            let entry = error.entry.strip_prefix("frames[0]").map(|field| field.trim_start_matches('.').to_owned());
            let entry = entry.or_else(|| Some(format!("camera{}", error.entry.strip_prefix("cameras[0]")?)));
            // Options of other commands do not help here.
            let problem = error.problem.split(" (if the numbers are").next().unwrap_or_default().to_owned();
            EntryError::new(entry.unwrap_or(error.entry), problem)
        })
    }
}

/// The shortest number that is the same in single precision, in which the map keeps boxes and scores.
fn shortest(x: f64) -> f64 {
    (x as f32).to_string().parse().unwrap_or(x)
}

/// An oriented box in such numbers.
fn short_turned(turned: OrientedBox) -> OrientedBoxRecord {
    let record = OrientedBoxRecord::from(turned);
    let (center, size) = (record.center.map(shortest), record.size.map(shortest));
    OrientedBoxRecord { center, size, angle: shortest(record.angle), ..record }
}

/// The hash FNV-1a, which is the same in every version.
fn fnv_1a(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// An id of two cameras.
fn other_camera(entry: String, id: &str) -> EntryError {
    EntryError::new(entry, format!("the camera \"{id}\" was given before with other numbers"))
}
