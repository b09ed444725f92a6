//! The frames of a scene file that have no pose, as queries.

use quadlift::nalgebra::{Unit, Vector3};
use quadlift::relocalize::{Query, QueryBox};
use quadlift::scene::{Scene, SourceError};

use crate::error::EntryError;
use crate::scene_file::{DetectionRecord, SceneFile};

/// The field of frames with the direction against gravity in the frame of the camera.
pub const UP_IN_CAMERA: &str = "up_in_camera";

/// A pose for frames that have none, so that their boxes can be read as those of a scene: any one does.
pub(crate) const ANY_POSE: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A scene some of whose cameras are sought, checked.
#[derive(Debug, Clone)]
pub struct QueryScene {
    /// Frames and detections without objects; poses that are sought mean nothing.
    scene: Scene,
    /// The frames whose poses are sought, with the direction upwards in their cameras where it is known.
    sought: Vec<(usize, Option<Unit<Vector3<f64>>>)>,
}

/// A frame whose pose is sought.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameQuery {
    /// Its index in the file.
    pub frame_index: usize,
    /// Indices of its detections in the file, in the order of the boxes of `query`.
    pub detections: Vec<usize>,
    /// The camera and the boxes.
    pub query: Query,
    /// The direction against gravity in the frame of the camera, where the file has it.
    pub up_in_camera: Option<Unit<Vector3<f64>>>,
}

impl SceneFile {
    /// The frames that have no pose, with their detections; with `all`, also those that have a camera and a pose.
    ///
    /// # Errors
    /// [`EntryError`], as of [`SceneFile::to_scene`], names the first invalid entry; also a frame without a camera.
    pub fn to_queries(&self, all: bool) -> Result<QueryScene, EntryError> {
        let mut posed = Self {
            name: self.name.clone(),
            cameras: self.cameras.clone(),
            frames: self.frames.clone(),
            ..Self::default()
        };
        let mut sought = Vec::new();
        for (index, frame) in posed.frames.iter_mut().enumerate() {
            let has_pose = frame.cam_from_world.is_some() || frame.projection.is_some();
            if has_pose && !(all && frame.camera.is_some()) {
                continue;
            }
            let entry = |field: &str| format!("frames[{index}]{field}");
            if frame.camera.is_none() {
                let problem = "there is no \"camera\"; a frame without a pose needs one";
                return Err(EntryError::new(entry(""), problem));
            }
            let up = frame.extra.get(UP_IN_CAMERA).map(|value| {
                let direction = serde_json::from_value::<[f64; 3]>(value.clone()).ok().map(Vector3::from);
                direction.and_then(|d| Unit::try_new(d, 1e-9)).ok_or_else(|| {
                    let problem =
                        format!("{value} is not a direction; expected three numbers in the frame of the camera");
                    EntryError::new(entry(".up_in_camera"), problem)
                })
            });
            sought.push((index, up.transpose()?));
            frame.cam_from_world.get_or_insert(ANY_POSE);
        }
        posed.detections = self.detections.iter().map(box_alone).collect();
        Ok(QueryScene { scene: posed.to_scene()?, sought })
    }
}

/// What is needed of a detection whose object is sought.
pub(crate) fn box_alone(detection: &DetectionRecord) -> DetectionRecord {
    DetectionRecord {
        frame: detection.frame.clone(),
        category: detection.category.clone(),
        source: detection.source.clone(),
        score: detection.score,
        bounding_box: detection.bounding_box,
        ellipse: detection.ellipse.clone(),
        outline: detection.outline.clone(),
        oriented_box: detection.oriented_box.clone(),
        ..Default::default()
    }
}

impl QueryScene {
    /// Number of frames whose poses are known.
    pub fn posed(&self) -> usize {
        self.scene.frames.len() - self.sought.len()
    }

    /// The frames whose poses are sought, in the order of the file, with the detections of a source that have at least a score
    /// (those without a score count).
    ///
    /// # Errors
    /// [`SourceError`] if the source does not exist, or if none is chosen of several.
    pub fn queries(&self, source: Option<&str>, min_score: Option<f64>) -> Result<Vec<FrameQuery>, SourceError> {
        let source = self.scene.source_index(source)?;
        let mut of_frame: Vec<Vec<usize>> = vec![Vec::new(); self.scene.frames.len()];
        for (index, detection) in self.scene.detections.iter().enumerate() {
            let is_chosen = source.is_none() || detection.source_index == source;
            let is_scored = min_score.is_none_or(|least| detection.score.is_none_or(|score| score >= least));
            if is_chosen && is_scored {
                of_frame[detection.frame_index as usize].push(index);
            }
        }
        let query = |&(frame_index, up_in_camera): &(usize, _)| {
            let frame = &self.scene.frames[frame_index];
            let mut found = FrameQuery {
                frame_index,
                detections: Vec::new(),
                query: Query {
                    intrinsics: frame.projection.intrinsics()?,
                    image_size: frame.image_size,
                    boxes: Vec::new(),
                },
                up_in_camera,
            };
            for &index in &of_frame[frame_index] {
                let detection = &self.scene.detections[index];
                let view = self.scene.view(detection);
                let Some(bounding_box) = view.measured_box() else { continue };
                let category =
                    detection.category_index.map(|category| self.scene.categories[category as usize].clone());
                found.query.boxes.push(QueryBox { bounding_box, box_in_image: view.box_in_image, category });
                found.detections.push(index);
            }
            Some(found)
        };
        Ok(self.sought.iter().filter_map(query).collect())
    }
}
