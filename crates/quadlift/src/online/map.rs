//! The object map.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::{Point3, Vector3};

use super::input::Frame;
use super::keyframes::Keyframes;
use super::names::{Categories, InputIds};
use super::options::OnlineOptions;
use super::running::Running;
use super::tracked::{Presence, Tracked};
use super::update::ObjectId;
use super::views::{KeptView, RecentFrame, from_bits};
use super::visibility::VisibilityIndex;
use super::windows::Windows;
use crate::association::input::observations::{Camera, Observations};
use crate::association::score::fit::{Start, fit};
use crate::association::score::input_ids::IdTally;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::statistics::DetectionRate;
use crate::association::{AssociateError, IdPolicy};
use crate::diagnosis::Diagnosis;
use crate::geometry::Ellipsoid;
use crate::sorting::StableSort;

/// Initial slack of edges, pixels.
const FIRST_PIXEL_SD: f64 = 2.0;

/// Share of wrong ids if ids are trusted. It is not zero, so that a mistake can be undone.
const TRUSTED_WRONG_SHARE: f64 = 1e-3;

/// Number of views up to which the probability of detections is tabulated.
const RATE_VIEWS: usize = 1024;

/// Margin of the range within which an object may be visible.
const RANGE_MARGIN: f64 = 1.2 * 1.3;

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
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(remote = "Self"))]
pub struct ObjectMap {
    #[cfg_attr(feature = "serde", serde(skip))]
    pub(super) options: OnlineOptions,
    /// Key of the next frame.
    pub(super) next_key: u32,
    /// Time and id of the last frame.
    pub(super) last: Option<(f64, String)>,
    /// Origin of the internal coordinates: the center of the first camera.
    pub(super) origin: Vector3<f64>,
    pub(super) categories: Categories,
    /// Names of the sources of depths and 3D boxes.
    pub(super) cue_sources: Vec<String>,
    /// Those whose depths have another scale in each frame.
    pub(super) scaled_by_frame: BTreeSet<u32>,
    pub(super) input_ids: InputIds,
    pub(super) tally: IdTally,
    pub(super) running: Running,
    pub(super) keyframes: Keyframes,
    /// The last frames, whose boxes may still be reassigned.
    pub(super) recent: VecDeque<RecentFrame>,
    /// Objects by slot; slots are reused.
    pub(super) slots: Vec<Option<Box<Tracked>>>,
    pub(super) free_slots: Vec<u32>,
    #[cfg_attr(feature = "serde", serde(skip))]
    pub(super) slot_of_id: BTreeMap<ObjectId, u32>,
    /// Merged objects and what they were merged into.
    pub(super) aliases: BTreeMap<ObjectId, ObjectId>,
    #[cfg_attr(feature = "serde", serde(skip))]
    pub(super) visibility: VisibilityIndex,
    /// Visibility range of an object of unit size for which the index was built.
    pub(super) indexed_range: f64,
    pub(super) next_id: u64,
    /// Number of consecutive frames that contradicted the map.
    pub(super) disagreeing: u32,
    /// Pairs of objects whose merge was refused, with their numbers of views at that time.
    #[cfg_attr(feature = "serde", serde(with = "super::pairs"))]
    pub(super) tried_pairs: BTreeMap<(u64, u64), (usize, usize)>,
    #[cfg_attr(feature = "serde", serde(skip, default = "detection_rate"))]
    pub(super) rate: DetectionRate,
    /// Frames for the consistency check, and what it has found so far.
    pub(super) windows: Windows,
    pub(super) diagnosis: Diagnosis,
}

fn detection_rate() -> DetectionRate {
    DetectionRate::new(RATE_VIEWS)
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
        options.validate()?;
        let running = Running::new(options.edge_noise_px.unwrap_or(FIRST_PIXEL_SD));
        Ok(Self {
            tally: IdTally::new(match options.ids {
                IdPolicy::Trust => options.wrong_id_share.min(TRUSTED_WRONG_SHARE),
                IdPolicy::Evidence | IdPolicy::Ignore => options.wrong_id_share,
            }),
            options,
            next_key: 0,
            last: None,
            origin: Vector3::zeros(),
            categories: Categories::default(),
            cue_sources: Vec::new(),
            scaled_by_frame: BTreeSet::new(),
            input_ids: InputIds::default(),
            running,
            keyframes: Keyframes::default(),
            recent: VecDeque::new(),
            slots: Vec::new(),
            free_slots: Vec::new(),
            slot_of_id: BTreeMap::new(),
            aliases: BTreeMap::new(),
            visibility: VisibilityIndex::default(),
            indexed_range: 0.0,
            next_id: 1,
            disagreeing: 0,
            tried_pairs: BTreeMap::new(),
            rate: detection_rate(),
            windows: Windows::default(),
            diagnosis: Diagnosis::default(),
        })
    }

    /// The map with other options: of one that was stored, those that it had.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub fn with_options(self, options: OnlineOptions) -> Result<Self, AssociateError> {
        options.validate()?;
        Ok(Self { options, ..self })
    }

    /// The options of the map.
    pub fn options(&self) -> &OnlineOptions {
        &self.options
    }

    /// Number of observed frames.
    pub fn frames(&self) -> u64 {
        self.running.frames
    }

    /// Id and time of the last frame.
    pub fn last_frame(&self) -> Option<(&str, f64)> {
        self.last.as_ref().map(|(time, id)| (id.as_str(), *time))
    }

    /// Number of kept frames: those of kept views, the recent ones, and those for the consistency check.
    pub fn keyframes(&self) -> usize {
        self.keyframes.len()
    }

    /// The frames that the map keeps, in the order in which they were observed.
    pub fn kept_frames(&self) -> impl Iterator<Item = &Frame> + '_ {
        self.keyframes.iter().map(|(_, keyframe)| &keyframe.frame)
    }

    /// Objects of the map, confirmed and gone, in the order of their ids.
    pub fn objects(&self) -> impl Iterator<Item = MapObject> + '_ {
        self.tracked().filter(|t| t.presence != Presence::Tentative).filter_map(|t| self.describe(t))
    }

    /// Tentative objects, in the order of their ids.
    pub fn tentative_objects(&self) -> impl Iterator<Item = MapObject> + '_ {
        self.tracked().filter(|t| t.presence == Presence::Tentative).filter_map(|t| self.describe(t))
    }

    /// An object by its id, or by the id of an object that was merged into it.
    pub fn object(&self, id: ObjectId) -> Option<MapObject> {
        self.slot_of_id.get(&self.resolve(id)).and_then(|&slot| self.slot(slot)).and_then(|t| self.describe(t))
    }

    /// The object that an object was merged into, or the object itself.
    pub fn resolve(&self, id: ObjectId) -> ObjectId {
        let mut id = id;
        while let Some(&older) = self.aliases.get(&id) {
            id = older;
        }
        id
    }

    pub(super) fn tracked(&self) -> impl Iterator<Item = &Tracked> + '_ {
        self.slot_of_id.values().filter_map(|&slot| self.slot(slot))
    }

    pub(super) fn slot(&self, slot: u32) -> Option<&Tracked> {
        self.slots.get(slot as usize).and_then(Option::as_deref)
    }

    pub(super) fn slot_mut(&mut self, slot: u32) -> Option<&mut Tracked> {
        self.slots.get_mut(slot as usize).and_then(Option::as_deref_mut)
    }

    fn describe(&self, tracked: &Tracked) -> Option<MapObject> {
        let object = &tracked.object;
        let center = Point3::from(object.center + self.origin);
        let ellipsoid = Ellipsoid::from_shape(center, &(object.root * object.root.transpose())).ok()?;
        let total: u32 = tracked.categories.iter().map(|&(_, count)| count).sum();
        let mut categories: Vec<(Option<String>, f64)> = tracked
            .categories
            .iter()
            .map(|&(category, n)| {
                (self.categories.names()[usize::from(category)].clone(), f64::from(n) / f64::from(total.max(1)))
            })
            .collect();
        categories.stable_sort_by(|a, b| b.1.total_cmp(&a.1));
        let evidence = self.evidence_of(tracked);
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

    /// Cameras and boxes of views in the form that association uses, and the statistics with their occluded edges.
    pub(super) fn gather<'a>(&self, views: impl IntoIterator<Item = &'a KeptView>) -> (Observations, SceneStatistics) {
        let mut observations = self.no_observations();
        let mut statistics = self.running.statistics.clone();
        for view in views {
            let Some(keyframe) = self.keyframes.get(view.keyframe) else { continue };
            let place = observations.cameras.len();
            observations.cameras.push(Camera { boxes: place..place + 1, ..keyframe.camera.clone() });
            observations.boxes.push(view.observation(place, &keyframe.shift));
            statistics.hidden.push(from_bits(view.hidden));
        }
        (observations, statistics)
    }

    /// The fit of an object to its views, from the best of some starts; `None` if no start can be followed.
    pub(super) fn fit_views(&self, tracked: &Tracked, starts: &[Start]) -> Option<Object> {
        let (observations, statistics) = self.gather(&tracked.views);
        fit(&observations, &statistics, tracked.object.boxes.clone(), starts)
    }

    /// Observations of this map without any box.
    pub(super) fn no_observations(&self) -> Observations {
        Observations {
            cameras: Vec::new(),
            boxes: Vec::new(),
            categories: vec![None; self.categories.names().len()],
            least_half_size: self.running.least_half_size(),
            origin: self.origin,
            sizes: self.running.box_sizes(),
            category_share: self.running.category_share(),
        }
    }

    /// Whether ids of detections are evidence.
    pub(super) fn weighs_ids(&self) -> bool {
        self.options.ids != IdPolicy::Ignore && self.input_ids.is_used()
    }

    /// Updates the place of an object in the visibility index.
    pub(super) fn index(&mut self, slot: u32) {
        let Some(tracked) = self.slots[slot as usize].as_ref() else { return };
        let range = RANGE_MARGIN * self.indexed_range * tracked.object.longest_semi_axis();
        self.visibility.put(slot, &tracked.object.center, range);
    }

    /// Rebuilds the visibility index if objects may be visible from farther away than it allows for.
    pub(super) fn check_index(&mut self) {
        let range = self.running.longest_focal / self.running.least_half_size().max(1e-9);
        if range <= self.indexed_range && range > 0.25 * self.indexed_range {
            return;
        }
        self.indexed_range = 1.1 * range;
        for slot in 0..self.slots.len() as u32 {
            self.index(slot);
        }
    }
}
