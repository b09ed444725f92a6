//! Building a [`Scene`]: ids become indices, numbers are checked.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use nalgebra::{Unit, Vector2, Vector3};

use super::Scene;
use super::cues::Cues;
use super::error::SceneError;
use super::outlines::{Outlines, Shape, check_outline};
use super::parts::{Detection, Frame, RigCamera, SceneParts, Undistorted};
use super::points::{PointObservation, TrackedPoint, check_points};
use super::views::DepthScale;
use crate::geometry::{BoundingBox, CamFromWorld, Camera, Ellipse, OrientedBox, Projection};
use crate::sorting::StableSort;

/// A detection by names, unchecked, measured in the image as it is: what [`SceneBuilder::add_detection`] and
/// [`crate::online::ObjectMap::observe`] take.
#[derive(Debug, Clone, Copy, Default)]
pub struct NewDetection<'a> {
    /// Id of the frame, which must have been added before; an object map does not use it.
    pub frame: &'a str,
    /// Id of the object, if known.
    pub object: Option<&'a str>,
    /// Category.
    pub category: Option<&'a str>,
    /// Source (detector).
    pub source: Option<&'a str>,
    /// Score of the detector.
    pub score: Option<f64>,
    /// Box in pixels.
    pub bounding_box: Option<BoundingBox>,
    /// Ellipse in pixels.
    pub ellipse: Option<Ellipse>,
    /// Corners of the outline in pixels, a polygon in either direction. Parts outside of the image are cut off.
    pub outline: Option<&'a [[f64; 2]]>,
    /// Oriented box in pixels; an outline comes first.
    pub oriented_box: Option<OrientedBox>,
    /// Whether the ellipse may be of a part of the object: the border of the image or another object cuts it.
    pub partial: bool,
    /// Occlusion level.
    pub occluded: Option<f64>,
    /// Truncation level.
    pub truncated: Option<f64>,
    /// Depth and 3D box; their sources are indices that [`SceneBuilder::cue_source`] gives, or into [`crate::online::Frame::cue_sources`].
    pub cues: Cues,
}

impl NewDetection<'_> {
    /// A detection with a box only.
    pub fn from_box(bounding_box: BoundingBox) -> Self {
        Self { bounding_box: Some(bounding_box), ..Self::default() }
    }

    /// Its outline and its oriented box.
    pub fn shape(&self) -> Shape<'_> {
        Shape { outline: self.outline, oriented_box: self.oriented_box, occluded_lines: None }
    }

    /// The box; without one that around the ellipse, the outline or the oriented box.
    pub fn box_or_around(&self) -> Option<BoundingBox> {
        let of_ellipse = || self.ellipse.as_ref().map(|ellipse| ellipse.bounding_box());
        self.bounding_box.or_else(of_ellipse).or_else(|| self.shape().bounding_box())
    }
}

/// Builds and validates a [`Scene`].
#[derive(Debug, Default)]
pub struct SceneBuilder {
    scene: SceneParts,
    frames: HashMap<String, u32>,
    objects: HashMap<String, u32>,
    categories: HashMap<String, u32>,
    sources: HashMap<String, u32>,
    cue_sources: HashMap<String, u32>,
    seen: HashMap<(u32, u32, Option<u32>), u32>,
    outlines: Outlines,
}

impl SceneBuilder {
    /// An empty scene with a name.
    pub fn new(name: &str) -> Self {
        let mut builder = Self::default();
        builder.scene.name = name.to_owned();
        builder
    }

    /// Makes room for so many frames and detections; without it a large scene takes longer.
    pub fn reserve(&mut self, frames: usize, detections: usize) {
        self.scene.frames.reserve(frames);
        self.frames.reserve(frames);
        self.scene.detections.reserve(detections);
        self.seen.reserve(detections);
    }

    /// Names the world unit ("m" for meters).
    pub fn length_unit(&mut self, unit: &str) {
        self.scene.length_unit = Some(unit.to_owned());
    }

    /// Sets the world direction against gravity (any length).
    ///
    /// # Errors
    /// [`SceneError::Up`] when it is zero or not finite.
    pub fn up(&mut self, direction: [f64; 3]) -> Result<(), SceneError> {
        let unit = Unit::try_new(Vector3::from(direction), 1e-12).filter(|u| u.iter().all(|x| x.is_finite()));
        self.scene.up = Some(unit.ok_or(SceneError::Up(direction))?);
        Ok(())
    }

    /// Adds a posed image; `image_size` is width and height in pixels. Returns its index.
    ///
    /// # Errors
    /// [`SceneError::DuplicateFrame`], [`SceneError::ImageSize`].
    pub fn add_frame(
        &mut self,
        id: &str,
        projection: Projection,
        image_size: Option<[f64; 2]>,
    ) -> Result<usize, SceneError> {
        if let Some([width, height]) = image_size
            && !(width > 0.0 && height > 0.0 && width.is_finite() && height.is_finite())
        {
            return Err(SceneError::ImageSize { width, height });
        }
        let image_size = image_size.map(Vector2::from);
        self.push_frame(Frame { id: id.to_owned(), projection, image_size, lens: None, rig: None })
    }

    /// Adds an image of a camera of any model; the detections in it will be undistorted. Returns its index.
    ///
    /// # Errors
    /// [`SceneError::DuplicateFrame`], [`SceneError::ImageSize`].
    pub fn add_frame_of_camera(
        &mut self,
        id: &str,
        camera: &Camera,
        cam_from_world: &CamFromWorld,
        image_size: Option<[f64; 2]>,
    ) -> Result<usize, SceneError> {
        let index = self.add_frame(id, Projection::from_camera(&camera.pinhole(), cam_from_world), image_size)?;
        self.scene.frames[index].lens = (!camera.is_pinhole()).then_some(*camera);
        Ok(index)
    }

    /// Says when and by which camera of a rig a frame was taken; nothing for an index that [`Self::add_frame`] did not return.
    pub fn taken_by_rig(&mut self, frame_index: usize, rig: RigCamera) {
        if let Some(frame) = self.scene.frames.get_mut(frame_index) {
            frame.rig = Some(rig);
        }
    }

    fn push_frame(&mut self, frame: Frame) -> Result<usize, SceneError> {
        let index = self.scene.frames.len();
        let next = u32::try_from(index).map_err(|_| SceneError::TooLarge)?;
        // The first frame of an id keeps it, also when the caller goes on after the error.
        match self.frames.entry(frame.id.clone()) {
            Entry::Occupied(_) => return Err(SceneError::DuplicateFrame(frame.id)),
            Entry::Vacant(free) => free.insert(next),
        };
        self.scene.frames.push(frame);
        Ok(index)
    }

    /// The index of a source of cues (a depth network, a LiDAR, a 3D detector), which is added when it is new.
    ///
    /// # Errors
    /// [`SceneError::TooLarge`].
    pub fn cue_source(&mut self, name: &str) -> Result<u32, SceneError> {
        u32::try_from(self.scene.cue_sources.len()).map_err(|_| SceneError::TooLarge)?;
        intern(Some(name), &mut self.cue_sources, &mut self.scene.cue_sources).ok_or(SceneError::TooLarge)
    }

    /// Which depths of a source share a scale; `source` is an index that [`Self::cue_source`] gave.
    pub fn set_depth_scale(&mut self, source: u32, scale: DepthScale) {
        let (by_frame, known) = (scale == DepthScale::Frame, scale == DepthScale::Known);
        self.scene.scaled_by_frame.extend(by_frame.then_some(source));
        self.scene.scale_known.extend(known.then_some(source));
    }

    /// Adds a detection, measured in the image as it is; if the frame's camera has a lens model, it is undistorted.
    /// Detections without pinhole pixels (see [`Camera::undistort_point`]) have neither box nor ellipse. Returns its
    /// index.
    ///
    /// # Errors
    /// [`SceneError::UnknownFrame`], [`SceneError::NothingMeasured`], [`SceneError::Cue`],
    /// [`SceneError::DuplicateDetection`].
    pub fn add_detection(&mut self, input: &NewDetection) -> Result<usize, SceneError> {
        let index = self.scene.detections.len();
        let next = u32::try_from(index).map_err(|_| SceneError::TooLarge)?;
        let frame_index =
            *self.frames.get(input.frame).ok_or_else(|| SceneError::UnknownFrame(input.frame.to_owned()))?;
        let measured = input.bounding_box.is_some() || input.ellipse.is_some() || input.cues.have_center();
        if !measured && input.outline.is_none() && input.oriented_box.is_none() {
            return Err(SceneError::NothingMeasured);
        }
        input.cues.check()?;
        input.outline.map(check_outline).transpose()?;
        // A rejected detection adds no names. One with a new name is not a duplicate.
        let known = |name: Option<&str>, names: &HashMap<String, u32>| match name {
            Some(name) => names.get(name).copied().map(Some),
            None => Some(None),
        };
        if let Some(Some(object)) = known(input.object, &self.objects)
            && let Some(source) = known(input.source, &self.sources)
            && let Some(&first) = self.seen.get(&(object, frame_index, source))
        {
            return Err(SceneError::DuplicateDetection {
                object: input.object.unwrap_or_default().to_owned(),
                frame: input.frame.to_owned(),
                first: first as usize,
                second: next as usize,
            });
        }
        let object_index = intern(input.object, &mut self.objects, &mut self.scene.object_ids);
        let source_index = intern(input.source, &mut self.sources, &mut self.scene.sources);
        let category_index = intern(input.category, &mut self.categories, &mut self.scene.categories);
        if let Some(object) = object_index {
            self.seen.insert((object, frame_index, source_index), next);
        }
        let frame = &self.scene.frames[frame_index as usize];
        let Undistorted { bounding_box, ellipse, box_in_image } = frame.undistorted(input.bounding_box, input.ellipse);
        let mut detection = Detection {
            frame_index,
            object_index,
            category_index,
            source_index,
            score: input.score,
            bounding_box,
            ellipse,
            tangent_lines: None,
            partial: input.partial,
            box_in_image,
            occluded_edges: None,
            occluded: input.occluded,
            truncated: input.truncated,
            cues: (!input.cues.is_empty()).then(|| Box::new(input.cues)),
        };
        self.outlines.add(index, &mut detection, input.bounding_box.is_some(), frame, &input.shape())?;
        self.scene.detections.push(detection);
        Ok(index)
    }

    /// Adds a point of structure from motion with the pixels in which frames observed it, given by their indices: pixels of the images as
    /// they are. Those without pinhole pixels (see [`Camera::undistort_point`]) are passed over, and of several in one frame all but the
    /// first.
    ///
    /// # Errors
    /// [`SceneError::Point`].
    pub fn add_point(&mut self, position: [f64; 3], observed: &[(usize, [f64; 2])]) -> Result<(), SceneError> {
        let (point, frames) = (self.scene.points.len(), self.scene.frames.len());
        let mut observations = Vec::with_capacity(observed.len());
        for &(index, pixel) in observed {
            let frame = self.scene.frames.get(index);
            let refuse = |problem: String| SceneError::Point { point, problem };
            let frame = frame.ok_or_else(|| refuse(format!("it was observed in frame {index}, of {frames}")))?;
            if !pixel.iter().all(|x| x.is_finite()) {
                return Err(refuse(format!("its pixel in frame {index} is not finite")));
            }
            observations.extend(PointObservation::in_image(index as u32, frame.lens.as_ref(), pixel.into()));
        }
        // Stable: of several in a frame the first one stays.
        observations.stable_sort_by_key(|seen| seen.frame_index);
        observations.dedup_by_key(|seen| seen.frame_index);
        let added = TrackedPoint { position: position.into(), observations };
        check_points(std::slice::from_ref(&added), frames).map_err(|error| match error {
            SceneError::Point { problem, .. } => SceneError::Point { point, problem },
            error => error,
        })?;
        self.scene.points.push(added);
        Ok(())
    }

    /// The finished scene.
    pub fn build(mut self) -> Scene {
        self.outlines.hide(&mut self.scene.detections);
        Scene(self.scene)
    }
}

/// The index of a name, which is added when it is new.
fn intern(name: Option<&str>, indices: &mut HashMap<String, u32>, names: &mut Vec<String>) -> Option<u32> {
    let name = name?;
    if let Some(&index) = indices.get(name) {
        return Some(index);
    }
    // Names are no more than detections, whose number is checked.
    let index = names.len() as u32;
    indices.insert(name.to_owned(), index);
    names.push(name.to_owned());
    Some(index)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::CameraModel;
    use nalgebra::Matrix3x4;

    fn builder() -> SceneBuilder {
        let mut builder = SceneBuilder::new("test");
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        builder.add_frame("a", projection, Some([640.0, 480.0])).unwrap();
        builder
    }

    fn detection(frame: &str) -> NewDetection<'_> {
        NewDetection {
            frame,
            object: Some("cup"),
            bounding_box: Some(BoundingBox { x0: 0.0, y0: 0.0, x1: 1.0, y1: 1.0 }),
            ..Default::default()
        }
    }

    #[test]
    fn every_mistake_is_named() {
        let mut b = builder();
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        assert_eq!(b.add_frame("a", projection, None), Err(SceneError::DuplicateFrame("a".into())));
        assert!(matches!(b.add_frame("b", projection, Some([0.0, 1.0])), Err(SceneError::ImageSize { .. })));
        assert_eq!(b.add_detection(&detection("z")), Err(SceneError::UnknownFrame("z".into())));
        let nothing = NewDetection { frame: "a", ..Default::default() };
        assert_eq!(b.add_detection(&nothing), Err(SceneError::NothingMeasured));
        b.add_detection(&detection("a")).unwrap();
        assert!(matches!(b.add_detection(&detection("a")), Err(SceneError::DuplicateDetection { first: 0, .. })));
        let again = NewDetection { category: Some("mug"), ..detection("a") };
        assert!(matches!(b.add_detection(&again), Err(SceneError::DuplicateDetection { first: 0, .. })));
        assert_eq!(b.scene.categories.len(), 0, "a refused detection leaves no names behind");
        // Another source may see the same object in the same frame.
        b.add_detection(&NewDetection { source: Some("yolo"), ..detection("a") }).unwrap();
        assert!(b.up([0.0; 3]).is_err());
        assert!(b.up([f64::INFINITY, 0.0, 0.0]).is_err());
        let scene = b.build();
        assert_eq!((scene.detections.len(), scene.object_ids.len(), scene.sources.len()), (2, 1, 1));
    }

    #[test]
    fn measurements_are_undistorted_and_keep_their_place_in_the_image() {
        let camera = Camera::new(CameraModel::SimpleFisheye, &[300.0, 320.0, 240.0]).unwrap();
        let pose = CamFromWorld::new(Matrix3x4::identity()).unwrap();
        let mut b = SceneBuilder::new("test");
        b.add_frame_of_camera("a", &camera, &pose, Some([640.0, 480.0])).unwrap();
        let middle = BoundingBox { x0: 310.0, y0: 230.0, x1: 330.0, y1: 250.0 };
        let at_the_left = BoundingBox { x0: 0.0, y0: 230.0, x1: 20.0, y1: 250.0 };
        let beyond = BoundingBox { x0: 740.0, y0: 240.0, x1: 760.0, y1: 260.0 };
        for bounding_box in [middle, at_the_left, beyond] {
            let bounding_box = Some(bounding_box);
            b.add_detection(&NewDetection { frame: "a", bounding_box, ..Default::default() }).unwrap();
        }
        let scene = b.build();
        let boxes: Vec<_> = scene.detections.iter().map(|d| d.bounding_box).collect();
        let half_width = boxes[0].unwrap().size().x * 0.5;
        assert!((half_width - 300.0 * (10.0f64 / 300.0).tan()).abs() < 1e-3, "{half_width}");
        // The principal point is 320 px from the border: 320 / 300 of the radius is 1.07 radians.
        assert!((boxes[1].unwrap().x0 - (320.0 - 300.0 * (320.0f64 / 300.0).tan())).abs() < 0.5, "{boxes:?}");
        let view = scene.view(&scene.detections[1]);
        assert_eq!(view.in_image(&boxes[1].unwrap()), at_the_left, "it touches the border of the image");
        assert!(boxes[2].is_none(), "420 px from the axis are 80 degrees");
        assert_eq!(scene.frames[0].lens, Some(camera));
        // A pinhole camera needs none of this.
        let mut b = SceneBuilder::new("test");
        let pinhole = Camera::new(CameraModel::SimplePinhole, &[300.0, 320.0, 240.0]).unwrap();
        b.add_frame_of_camera("a", &pinhole, &pose, None).unwrap();
        b.add_detection(&NewDetection { frame: "a", bounding_box: Some(middle), ..Default::default() }).unwrap();
        let scene = b.build();
        assert_eq!((scene.detections[0].bounding_box, scene.detections[0].box_in_image), (Some(middle), None));
        assert!(scene.frames[0].lens.is_none());
    }
}
