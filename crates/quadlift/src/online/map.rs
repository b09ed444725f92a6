//! The object map: its interface.

use nalgebra::Point3;

use super::consistency::check_at_end;
use super::input::{Frame, ObserveError};
use super::kept_shape::MapShape;
use super::memory::Memory;
use super::merging::merge_by_force;
use super::observe::observe;
use super::options::OnlineOptions;
use super::poses::{PoseUpdate, update_poses};
use super::recent::recent_again;
use super::relocalize::{MapRelocalization, landmarks, relocalize};
use super::removal::remove_slot;
use super::scene::scene_and_views;
use super::tracked::{Presence, Tracked};
use super::update::{FrameUpdate, ObjectId, Removal};
use crate::association::AssociateError;
use crate::diagnosis::Diagnosis;
use crate::geometry::Ellipsoid;
use crate::relocalize::{LandmarkMap, LocateOptions, Query};
use crate::scene::{NewDetection, Scene};
use crate::sorting::StableSort;

/// A map of objects that is updated frame by frame.
///
/// ```
/// use nalgebra::Matrix3x4;
/// use quadlift::geometry::{BoundingBox, Projection};
/// use quadlift::online::{Frame, ObjectMap, OnlineOptions};
/// use quadlift::scene::NewDetection;
///
/// let mut map = ObjectMap::new(OnlineOptions::default())?;
/// // A camera moves to the right, 5 m before a cup.
/// for k in 0..12 {
///     let x = -1.5 + 0.25 * f64::from(k);
///     let p = Matrix3x4::new(500.0, 0.0, 320.0, -500.0 * x, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
///     let mut frame = Frame::new(format!("{k}.jpg"), f64::from(k) / 10.0, Projection::from_matrix(p)?);
///     frame.image_size = Some([640.0, 480.0].into());
///     let u = 320.0 - 100.0 * x;
///     let detection = NewDetection::from_box(BoundingBox::new([u - 50.0, 190.0, u + 50.0, 290.0])?);
///     let update = map.observe(&frame, &[detection])?;
///     println!("{}: {:?} {:?}", frame.id, update.objects, update.events);
/// }
/// let cup = map.objects().next().expect("the cup is in the map");
/// assert!((cup.ellipsoid.center.z - 5.0).abs() < 0.5, "{:?}", cup.ellipsoid);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(transparent))]
pub struct ObjectMap {
    pub(super) memory: Memory,
}

/// An object of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct MapObject {
    /// Its id.
    pub id: ObjectId,
    /// How certain the map is of it.
    pub presence: Presence,
    /// Probability that it exists and is still there: from its evidence, and from clear views without a detection.
    pub existence: f64,
    /// Evidence of its kept views against clutter (nats).
    pub evidence: f64,
    /// The quick fit of the association, world frame; [`crate::localize()`] of [`ObjectMap::to_averaged_scene`] gives better ones with
    /// covariances.
    pub ellipsoid: Ellipsoid,
    /// Share of its detections in each category, the most frequent first.
    pub categories: Vec<(Option<String>, f64)>,
    /// Number of its detections.
    pub detections: usize,
    /// Number of frames in which it should be detected if nothing hides it.
    pub expected_views: usize,
    /// Number of kept views.
    pub kept_views: usize,
    /// Time of its first detection, seconds.
    pub first_seen: f64,
    /// Time of its last detection, seconds.
    pub last_seen: f64,
}

impl ObjectMap {
    /// An empty map.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub fn new(options: OnlineOptions) -> Result<Self, AssociateError> {
        Ok(Self { memory: Memory::new(options)? })
    }

    /// The map with other options: of one that was stored, those that it had.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub fn with_options(self, options: OnlineOptions) -> Result<Self, AssociateError> {
        options.validate()?;
        Ok(Self { memory: Memory { options, ..self.memory } })
    }

    /// The options of the map.
    pub fn options(&self) -> &OnlineOptions {
        &self.memory.options
    }

    /// Observes a frame: returns the object of each detection and what has changed.
    ///
    /// The time depends on what the camera sees, not on the size of the map.
    ///
    /// # Errors
    /// [`ObserveError`] says why the frame was refused; the map is unchanged.
    pub fn observe(&mut self, frame: &Frame, detections: &[NewDetection]) -> Result<FrameUpdate, ObserveError> {
        observe(&mut self.memory, frame, detections)
    }

    /// Assigns the boxes of all recent frames again and checks them, for the end of a stream. It takes about as long as observing that
    /// many frames.
    pub fn settle(&mut self) -> FrameUpdate {
        let mut update = FrameUpdate::default();
        recent_again(&mut self.memory, &mut update);
        check_at_end(&mut self.memory, &mut update);
        update
    }

    /// Moves frames and the objects that they show. Objects that then coincide are merged.
    ///
    /// Objects are refitted to their kept views; no old detection is needed. Frames that the map does not keep are skipped. The
    /// update names merged objects.
    pub fn update_poses(&mut self, poses: &[PoseUpdate]) -> FrameUpdate {
        update_poses(&mut self.memory, poses)
    }

    /// Merges two objects that are known to be one. Returns the id that stays, the older one, or `None` if that is impossible.
    pub fn merge(&mut self, first: ObjectId, second: ObjectId) -> Option<ObjectId> {
        let objects = &self.memory.objects;
        let (first, second) = (objects.resolve(first), objects.resolve(second));
        let (a, b) = (objects.slot_of(first)?, objects.slot_of(second)?);
        (a != b && merge_by_force(&mut self.memory, a, b)).then_some(first.min(second))
    }

    /// Removes an object from the map.
    ///
    /// Its id is not used again. Returns false if there is no such object.
    pub fn remove(&mut self, id: ObjectId) -> bool {
        let Some(slot) = self.memory.objects.slot_of(self.resolve(id)) else { return false };
        remove_slot(&mut self.memory, slot, Removal::User, &mut FrameUpdate::default());
        true
    }

    /// Number of observed frames.
    pub fn frames(&self) -> u64 {
        self.memory.running.frames
    }

    /// Id and time of the last frame.
    pub fn last_frame(&self) -> Option<(&str, f64)> {
        self.memory.last.as_ref().map(|(time, id)| (id.as_str(), *time))
    }

    /// Number of kept frames: those of kept views, the recent ones, and those for the consistency check.
    pub fn keyframes(&self) -> usize {
        self.memory.keyframes.len()
    }

    /// The frames that the map keeps, in the order in which they were observed.
    pub fn kept_frames(&self) -> impl Iterator<Item = &Frame> + '_ {
        self.memory.keyframes.iter().map(|(_, keyframe)| &keyframe.frame)
    }

    /// Objects of the map, confirmed and gone, in the order of their ids.
    pub fn objects(&self) -> impl Iterator<Item = MapObject> + '_ {
        let tracked = self.memory.objects.tracked().filter(|t| t.presence != Presence::Tentative);
        tracked.filter_map(|t| describe(&self.memory, t))
    }

    /// Tentative objects, in the order of their ids.
    pub fn tentative_objects(&self) -> impl Iterator<Item = MapObject> + '_ {
        let tracked = self.memory.objects.tracked().filter(|t| t.presence == Presence::Tentative);
        tracked.filter_map(|t| describe(&self.memory, t))
    }

    /// An object by its id, or by the id of an object that was merged into it.
    pub fn object(&self, id: ObjectId) -> Option<MapObject> {
        describe(&self.memory, self.memory.objects.by_id(self.resolve(id))?)
    }

    /// The object that an object was merged into, or the object itself.
    pub fn resolve(&self, id: ObjectId) -> ObjectId {
        self.memory.objects.resolve(id)
    }

    /// Whether poses, cameras and boxes are consistent; `None` while there are too few frames and boxes to know.
    pub fn consistent(&self) -> Option<bool> {
        self.memory.windows.consistent
    }

    /// The consistency check of the last frames that were inconsistent; that of nothing while [`Self::consistent`] is not `false`.
    pub fn diagnosis(&self) -> &Diagnosis {
        &self.memory.diagnosis
    }

    /// The confirmed objects as landmarks, with their ids: quick fits with their covariances, and the most frequent category. For many
    /// images at once, or for the better fits of [`crate::localize()`], make a [`LandmarkMap`] once.
    pub fn landmarks(&self) -> (Vec<ObjectId>, LandmarkMap) {
        landmarks(&self.memory)
    }

    /// The options of [`ObjectMap::relocalize`] with the noise of boxes that the map has learned.
    pub fn locate_options(&self) -> LocateOptions {
        LocateOptions { edge_noise: self.memory.running.statistics.edge_noise, ..Default::default() }
    }

    /// The camera of an image, from its boxes: the map is not changed. A frame that was located can be observed with its pose. In a map
    /// that is not [consistent](ObjectMap::consistent) no pose is [`Ok`](crate::relocalize::LocateStatus::Ok).
    ///
    /// See docs/method.md, section 20.
    pub fn relocalize(&self, query: &Query, options: &LocateOptions) -> MapRelocalization {
        relocalize(&self.memory, query, options)
    }

    /// The kept views as a scene. Its object ids are those of the map, in their order; tentative objects are left out. The map does
    /// not know the vertical, the unit of length and the rigs of cameras: the scene has none.
    pub fn to_scene(&self) -> Scene {
        scene_and_views(&self.memory, &|_, edges| edges).0
    }

    /// The scene from which to estimate the objects ([`crate::localize()`]): that of [`ObjectMap::to_scene`], where each box is the mean
    /// of those of the forgotten views that it stands for and its own.
    pub fn to_averaged_scene(&self) -> Scene {
        scene_and_views(&self.memory, &|view, edges| view.averaged(edges)).0
    }

    /// Outlines and oriented boxes of the detections of [`ObjectMap::to_scene`], in their order.
    pub fn shapes_of_scene(&self) -> Vec<Option<&MapShape>> {
        let (_, views) = scene_and_views(&self.memory, &|_, edges| edges);
        views.into_iter().map(|view| view.shape.as_deref()).collect()
    }
}

fn describe(memory: &Memory, tracked: &Tracked) -> Option<MapObject> {
    let object = &tracked.object;
    let center = Point3::from(object.center + memory.origin);
    let ellipsoid = Ellipsoid::from_shape(center, &(object.root * object.root.transpose())).ok()?;
    let total: u32 = tracked.categories.iter().map(|&(_, count)| count).sum();
    let mut categories: Vec<(Option<String>, f64)> = tracked
        .categories
        .iter()
        .map(|&(category, n)| {
            (memory.categories.names()[usize::from(category)].clone(), f64::from(n) / f64::from(total.max(1)))
        })
        .collect();
    categories.stable_sort_by(|a, b| b.1.total_cmp(&a.1));
    let evidence = memory.evidence_of(tracked);
    let here = match tracked.presence {
        Presence::Tentative => evidence,
        Presence::Confirmed | Presence::Gone => evidence.min(tracked.log_odds),
    };
    Some(MapObject {
        id: tracked.id,
        presence: tracked.presence,
        existence: 1.0 / (1.0 + (-here).exp()),
        evidence,
        ellipsoid,
        categories,
        detections: object.views() + tracked.repeated as usize,
        expected_views: object.visible.max(object.views()) + tracked.repeated as usize,
        kept_views: tracked.views.len(),
        first_seen: tracked.first_time,
        last_seen: tracked.last_time,
    })
}
