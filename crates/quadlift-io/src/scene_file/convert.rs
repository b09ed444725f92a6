//! Converts a scene file to the library's scene: resolves cameras, checks every number and id. And detections back.

use std::cell::OnceCell;
use std::collections::HashMap;

use nalgebra::Vector2;
use quadlift::geometry::{BoundingBox, BoundingBoxError, CamFromWorld, Camera, CameraModel, Ellipse, Projection};
use quadlift::scene::{Detection, NewDetection, RigCamera, Scene, SceneBuilder, SceneError};

use super::frame_pose::{matrix, pose_of};
use super::records::{
    CameraRecord, DetectionRecord, FrameRecord, OrientedBoxRecord, RIG_FRAME, SceneFile, SegmentationRecord,
};
use super::suggest::known_names;
use crate::error::EntryError;

/// A checked camera with its image size.
struct CheckedCamera {
    /// Its index in the file.
    number: u32,
    camera: Camera,
    image_size: Option<[f64; 2]>,
}

/// How a frame maps the world to pixels.
enum Posed<'a> {
    Camera(&'a Camera, CamFromWorld),
    Projection(Projection),
}

impl SceneFile {
    /// The scene: frames and detections of all sources. The objects of the file are ignored.
    ///
    /// # Errors
    /// [`EntryError`] names the first invalid entry: unknown or duplicate ids, unknown camera models, singular
    /// cameras, poses that are not rotations, empty boxes, ellipses without positive axes.
    pub fn to_scene(&self) -> Result<Scene, EntryError> {
        let mut builder = SceneBuilder::new(self.name.as_deref().unwrap_or_default());
        builder.reserve(self.frames.len(), self.detections.len());
        if let Some(unit) = &self.length_unit {
            builder.length_unit(unit);
        }
        if let Some(up) = self.up {
            let error = |_| {
                EntryError::new(
                    "up",
                    format!("{up:?} is not a direction; expected the world direction against gravity"),
                )
            };
            builder.up(up).map_err(error)?;
        }
        let cameras = self.checked_cameras()?;
        for (index, frame) in self.frames.iter().enumerate() {
            let entry = |field: &str| format!("frames[{index}]{field}");
            let (posed, image_size) = self.posed(frame, &cameras, entry)?;
            frame.depth.as_deref().map_or(Ok(()), |depth| depth.check(|field| entry(&format!(".depth{field}"))))?;
            frame.check_points(self.points.len(), entry)?;
            let added = match posed {
                Posed::Camera(camera, pose) => builder.add_frame_of_camera(&frame.id, camera, &pose, image_size),
                Posed::Projection(projection) => builder.add_frame(&frame.id, projection, image_size),
            };
            let added = added.map_err(|error| EntryError::new(entry(""), error))?;
            if let Some(time_step) = frame.extra.get(RIG_FRAME).and_then(serde_json::Value::as_u64) {
                let camera = frame.camera.as_deref().and_then(|id| cameras.get(id)).map(|camera| camera.number);
                builder.taken_by_rig(added, RigCamera { time_step, camera });
            }
        }
        self.add_tracked_points(&mut builder)?;
        if let Some(cloud) = self.point_cloud.as_deref() {
            cloud.check(true, |field| format!("point_cloud{field}"))?;
        }
        self.cue_sources.iter().try_for_each(|(name, source)| source.add_to(name, &mut builder))?;
        let frames = OnceCell::new();
        for (index, detection) in self.detections.iter().enumerate() {
            let entry = |field: &str| format!("detections[{index}]{field}");
            let pose = || pose_of(frames.get_or_init(|| self.frames_by_id()).get(&*detection.frame)?);
            let cues = detection.cues(|name| builder.cue_source(name), pose, entry)?;
            let input = NewDetection { cues, ..detection.detection(entry)? };
            builder.add_detection(&input).map_err(|error| match error {
                SceneError::Outline(error) => EntryError::new(entry(".outline"), error),
                SceneError::UnknownFrame(id) => {
                    let hint = known_names(&id, self.frames.iter().map(|frame| frame.id.as_str()), "frames");
                    EntryError::new(entry(".frame"), format!("unknown frame \"{id}\"; {hint}"))
                }
                error => EntryError::new(entry(""), error),
            })?;
        }
        Ok(builder.build())
    }

    /// The frames by id.
    fn frames_by_id(&self) -> HashMap<&str, &FrameRecord> {
        self.frames.iter().map(|frame| (&*frame.id, frame)).collect()
    }

    /// The cameras by id.
    fn checked_cameras(&self) -> Result<HashMap<&str, CheckedCamera>, EntryError> {
        let mut cameras = HashMap::with_capacity(self.cameras.len());
        for (index, record) in self.cameras.iter().enumerate() {
            let entry = |field: &str| format!("cameras[{index}]{field}");
            let camera = camera(record, entry)?;
            let image_size = image_size(record.width, record.height, entry)?;
            let number = u32::try_from(index).unwrap_or(u32::MAX);
            if cameras.insert(record.id.as_str(), CheckedCamera { number, camera, image_size }).is_some() {
                return Err(EntryError::new(entry(""), format!("the camera id \"{}\" is used twice", record.id)));
            }
        }
        Ok(cameras)
    }

    /// Camera and pose, or projection, and image size of a frame.
    fn posed<'a>(
        &self,
        frame: &FrameRecord,
        cameras: &'a HashMap<&str, CheckedCamera>,
        entry: impl Fn(&str) -> String,
    ) -> Result<(Posed<'a>, Option<[f64; 2]>), EntryError> {
        let own_size = image_size(frame.width, frame.height, &entry)?;
        match (&frame.camera, &frame.cam_from_world, &frame.projection) {
            (None, None, Some(rows)) => {
                let projection = Projection::from_matrix(matrix(rows));
                let projection = projection.map_err(|error| EntryError::new(entry(".projection"), error))?;
                Ok((Posed::Projection(projection), own_size))
            }
            (Some(id), Some(rows), None) => {
                let camera = cameras.get(id.as_str()).ok_or_else(|| {
                    let hint = known_names(id, self.cameras.iter().map(|camera| camera.id.as_str()), "cameras");
                    EntryError::new(entry(".camera"), format!("unknown camera \"{id}\"; {hint}"))
                })?;
                let pose = CamFromWorld::new(matrix(rows));
                let pose = pose.map_err(|error| EntryError::new(entry(".cam_from_world"), error))?;
                Ok((Posed::Camera(&camera.camera, pose), own_size.or(camera.image_size)))
            }
            (camera, pose, projection) => {
                let given: Vec<&str> = [
                    camera.as_ref().map(|_| "\"camera\""),
                    pose.map(|_| "\"cam_from_world\""),
                    projection.map(|_| "\"projection\""),
                ]
                .into_iter()
                .flatten()
                .collect();
                let given = if given.is_empty() { "none of them".to_owned() } else { given.join(" and ") };
                let hint = match (camera, pose, projection) {
                    (Some(_), None, None) => {
                        "; `quadlift relocalize` finds the poses of images in a map of objects, `quadlift calibrate-rig` those of fixed cameras"
                    }
                    _ => "",
                };
                let problem =
                    format!("expected \"camera\" and \"cam_from_world\", or \"projection\" alone; found {given}{hint}");
                Err(EntryError::new(entry(""), problem))
            }
        }
    }
}

impl DetectionRecord {
    /// A detection of a scene with its names, box, ellipse and cues, as they are in the scene.
    pub fn of_scene(scene: &Scene, detection: &Detection) -> Self {
        let name = |index: Option<u32>, names: &[String]| index.map(|index| names[index as usize].as_str().into());
        let record = Self {
            frame: scene.frames[detection.frame_index as usize].id.as_str().into(),
            object: name(detection.object_index, &scene.object_ids),
            category: name(detection.category_index, &scene.categories),
            source: name(detection.source_index, &scene.sources),
            score: detection.score,
            bounding_box: detection.bounding_box.map(|b| b.edges()),
            ellipse: detection.ellipse.map(|ellipse| Box::new(ellipse.into())),
            ..Default::default()
        };
        let cues = detection.cues.as_deref().copied().unwrap_or_default();
        record.with_cues(&cues, |index| name(index, &scene.cue_sources))
    }

    /// The detection with checked geometry, without its cues.
    pub(crate) fn detection(&self, entry: impl Fn(&str) -> String) -> Result<NewDetection<'_>, EntryError> {
        let bounding_box = self.bounding_box.map(BoundingBox::new).transpose().map_err(|error| {
            let hint = match error {
                BoundingBoxError::Empty(_) => {
                    " (if the numbers are x, y, width, height: --assume boxes=xywh; center and size: --assume boxes=cxcywh)"
                }
                _ => "",
            };
            EntryError::new(entry(".box"), format!("{error}{hint}"))
        })?;
        let ellipse = self.ellipse.as_deref().map(|e| {
            Ellipse::new(Vector2::from(e.center), Vector2::from(e.semi_axes), e.angle).map_err(|error| {
                EntryError::new(entry(".ellipse"), format!("{error}; \"semi_axes\" is {:?}", e.semi_axes))
            })
        });
        let oriented_box = self.oriented_box.as_deref().map(OrientedBoxRecord::oriented_box).transpose();
        let segmentation = self.segmentation.as_deref();
        // Without a reliable mask the ellipse has no more information than the box.
        let of_box = bounding_box.is_some() && segmentation.is_some_and(SegmentationRecord::fallback);
        Ok(NewDetection {
            frame: &self.frame,
            object: self.object.as_deref(),
            category: self.category.as_deref(),
            source: self.source.as_deref(),
            score: self.score,
            bounding_box,
            ellipse: ellipse.transpose()?.filter(|_| !of_box),
            outline: self.outline.as_deref(),
            oriented_box: oriented_box.map_err(|error| EntryError::new(entry(".oriented_box"), error))?,
            partial: segmentation.is_some_and(SegmentationRecord::is_partial),
            occluded: self.occluded,
            truncated: self.truncated,
            ..Default::default()
        })
    }
}

/// A camera of any of COLMAP's models.
fn camera(record: &CameraRecord, entry: impl Fn(&str) -> String) -> Result<Camera, EntryError> {
    let model = CameraModel::from_name(&record.model).ok_or_else(|| {
        let hint = known_names(&record.model, CameraModel::all().map(CameraModel::name), "camera models");
        EntryError::new(entry(".model"), format!("unknown camera model \"{}\"; {hint}", record.model))
    })?;
    Camera::new(model, &record.params).map_err(|error| EntryError::new(entry(".params"), error))
}

/// Width and height, where both are given.
fn image_size(
    width: Option<f64>,
    height: Option<f64>,
    entry: impl Fn(&str) -> String,
) -> Result<Option<[f64; 2]>, EntryError> {
    match (width, height) {
        (Some(width), Some(height)) if width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite() => {
            Ok(Some([width, height]))
        }
        (Some(width), Some(height)) => Err(EntryError::new(entry(""), SceneError::ImageSize { width, height })),
        (None, None) => Ok(None),
        (Some(_), None) => Err(EntryError::new(entry(""), "there is a \"width\" but no \"height\"")),
        (None, Some(_)) => Err(EntryError::new(entry(""), "there is a \"height\" but no \"width\"")),
    }
}
