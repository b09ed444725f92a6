//! The state of a map as plain numbers, to store it and go on later.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Matrix3x4, SMatrix, Vector2, Vector3};

use super::input::Frame;
use super::keyframes::{Keyframe, Keyframes};
use super::map::ObjectMap;
use super::names::{Categories, InputIds};
use super::options::OnlineOptions;
use super::running::{MAX_COUNT, Running};
use super::tracked::{Presence, Tracked};
use super::update::ObjectId;
use super::views::{KeptView, RecentFrame};
use super::windows::Windows;
use crate::association::AssociateError;
use crate::association::score::input_ids::IdTally;
use crate::association::score::object::Object;
use crate::diagnosis::Diagnosis;
use crate::geometry::{Camera, CameraModel, Projection, rotation_defect};
use crate::scene::Cues;
use crate::solve::PoseNoise;

/// The state of an [`ObjectMap`] without its options. The feature `serde` makes it serialisable; [`ObjectMap::from_state`]
/// checks it.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct MapState {
    /// Version of the format.
    version: u32,
    next_key: u32,
    next_id: u64,
    last: Option<(f64, String)>,
    origin: [f64; 3],
    categories: Vec<Option<String>>,
    /// Names of the sources of depths and 3D boxes.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    cue_sources: Vec<String>,
    /// Those whose depths have another scale in each frame.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "BTreeSet::is_empty"))]
    scaled_by_frame: BTreeSet<u32>,
    input_ids: InputIds,
    tally: IdTally,
    running: Running,
    keyframes: Vec<(u32, KeyframeState)>,
    recent: Vec<RecentFrame>,
    slots: Vec<Option<TrackedState>>,
    free_slots: Vec<u32>,
    aliases: Vec<(ObjectId, ObjectId)>,
    indexed_range: f64,
    disagreeing: u32,
    tried_pairs: Vec<((u64, u64), (usize, usize))>,
    windows: Windows,
    diagnosis: Diagnosis,
}

/// Version of the format that is written and read.
const VERSION: u32 = 2;

#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct KeyframeState {
    id: String,
    time: f64,
    /// By rows.
    projection: [[f64; 4]; 3],
    image_size: Option<[f64; 2]>,
    /// Name and parameters of the camera with a lens.
    lens: Option<(String, Vec<f64>)>,
    pose_noise: Option<[f64; 2]>,
    /// The image size, or its replacement.
    extent: [f64; 2],
    shift: [f64; 2],
    references: u32,
}

#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct TrackedState {
    id: ObjectId,
    center: [f64; 3],
    /// By columns.
    root: [[f64; 3]; 3],
    radius: f64,
    cost: f64,
    log_det_hessian: f64,
    /// By columns.
    covariance: Vec<f64>,
    category: usize,
    forgotten: usize,
    visible: usize,
    views: Vec<KeptView>,
    fitted_views: usize,
    #[cfg_attr(feature = "serde", serde(default))]
    repeated: u32,
    categories: Vec<(u16, u32)>,
    input_ids: Vec<(u32, u32)>,
    presence: Presence,
    log_odds: f64,
    clear: [u32; 2],
    times: [f64; 2],
    last_keyframe: u32,
}

/// Why a state cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StateError {
    /// Its format has another version.
    #[error("the state has format {found}; expected {VERSION}")]
    Version {
        /// The format found.
        found: u32,
    },
    /// It contradicts itself.
    #[error("the state is damaged: {0}")]
    Damaged(&'static str),
    /// The options are wrong.
    #[error(transparent)]
    Options(#[from] AssociateError),
}

impl ObjectMap {
    /// The state of the map. With it and the same options, [`ObjectMap::from_state`] gives a map that behaves exactly like this one.
    pub fn to_state(&self) -> MapState {
        MapState {
            version: VERSION,
            next_key: self.next_key,
            next_id: self.next_id,
            last: self.last.clone(),
            origin: self.origin.into(),
            categories: self.categories.names().to_vec(),
            cue_sources: self.cue_sources.clone(),
            scaled_by_frame: self.scaled_by_frame.clone(),
            input_ids: self.input_ids.clone(),
            tally: self.tally.clone(),
            running: self.running.clone(),
            keyframes: self.keyframes.iter().map(|(key, keyframe)| (key, KeyframeState::of(keyframe))).collect(),
            recent: self.recent.iter().cloned().collect(),
            slots: self.slots.iter().map(|slot| slot.as_deref().map(TrackedState::of)).collect(),
            free_slots: self.free_slots.clone(),
            aliases: self.aliases.iter().map(|(&alias, &id)| (alias, id)).collect(),
            indexed_range: self.indexed_range,
            disagreeing: self.disagreeing,
            tried_pairs: self.tried_pairs.iter().map(|(&pair, &views)| (pair, views)).collect(),
            windows: self.windows.clone(),
            diagnosis: self.diagnosis.clone(),
        }
    }

    /// The map of a state.
    ///
    /// # Errors
    /// [`StateError`] if the version differs, the state is damaged, or an option is outside of its range.
    pub fn from_state(options: OnlineOptions, state: MapState) -> Result<Self, StateError> {
        if state.version != VERSION {
            return Err(StateError::Version { found: state.version });
        }
        state.check()?;
        let mut map = Self::new(options)?;
        map.next_key = state.next_key;
        map.next_id = state.next_id;
        map.last = state.last;
        map.origin = Vector3::from(state.origin);
        map.categories = Categories::new(state.categories);
        map.cue_sources = state.cue_sources;
        map.scaled_by_frame = state.scaled_by_frame;
        map.input_ids = state.input_ids;
        map.tally = state.tally;
        map.running = state.running;
        let mut keyframes = Keyframes::default();
        for (key, keyframe) in state.keyframes {
            keyframes.insert(key, keyframe.into_keyframe(&map.origin)?);
        }
        map.keyframes = keyframes;
        map.recent = state.recent.into();
        map.slots = state.slots.into_iter().map(|slot| slot.map(TrackedState::into_tracked).map(Box::new)).collect();
        map.free_slots = state.free_slots;
        map.aliases = state.aliases.into_iter().collect();
        map.indexed_range = state.indexed_range;
        map.disagreeing = state.disagreeing;
        map.tried_pairs = state.tried_pairs.into_iter().collect();
        map.windows = state.windows;
        map.diagnosis = state.diagnosis;
        for slot in 0..map.slots.len() as u32 {
            if let Some(id) = map.slot(slot).map(|tracked| tracked.id) {
                map.slot_of_id.insert(id, slot);
            }
            map.index(slot);
        }
        Ok(map)
    }
}

impl MapState {
    /// Checks all references and ranges.
    fn check(&self) -> Result<(), StateError> {
        let hold = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(StateError::Damaged(what)) };
        hold(self.categories.len() <= super::MAX_CATEGORIES, "too many categories")?;
        hold(self.cue_sources.len() <= super::MAX_CUE_SOURCES, "too many sources of depths and 3D boxes")?;
        let is_source = |source: &u32| (*source as usize) < self.cue_sources.len();
        hold(self.scaled_by_frame.iter().all(is_source), "an unknown source of depths")?;
        let distinct: BTreeSet<&Option<String>> = self.categories.iter().collect();
        hold(distinct.len() == self.categories.len(), "a category is there twice")?;
        hold(self.running.has_categories(self.categories.len()), "statistics of other categories")?;
        hold(self.running.is_countable() && self.next_id < MAX_COUNT, "a count is out of range")?;
        hold(self.keyframes.windows(2).all(|w| w[0].0 < w[1].0), "frames are not in order")?;
        hold(self.keyframes.iter().all(|(key, _)| *key < self.next_key), "a frame of the future")?;
        hold(self.recent.windows(2).all(|w| w[0].key < w[1].key), "recent frames are not in order")?;
        let is_known = |key: u32| self.keyframes.binary_search_by_key(&key, |(key, _)| *key).is_ok();
        let is_view = |view: &KeptView| {
            let [x0, y0, x1, y1] = view.edges;
            is_known(view.keyframe)
                && usize::from(view.category) < self.categories.len()
                && x0 < x1
                && y0 < y1
                && view.edges.iter().all(|e| e.is_finite())
                && view.absorbed.as_ref().is_none_or(|a| a.is_valid())
                && view.shape.as_ref().is_none_or(|shape| shape.is_valid())
                && view.cues.as_ref().is_none_or(|cues| are_valid(cues, self.cue_sources.len()))
        };
        for frames in [&self.windows.frames, &self.windows.suspect] {
            hold(frames.windows(2).all(|w| w[0].key < w[1].key), "checked frames are not in order")?;
        }
        for frame in self.recent.iter().chain(self.windows.all()) {
            hold(is_known(frame.key), "a recent frame is missing")?;
            hold(frame.boxes.iter().all(|b| is_view(&b.view) && b.view.keyframe == frame.key), "a box is wrong")?;
        }
        let mut ids = BTreeMap::new();
        for tracked in self.slots.iter().flatten() {
            hold(tracked.covariance.len() == 81, "a covariance has the wrong size")?;
            hold(tracked.category < self.categories.len(), "an object has an unknown category")?;
            let known = tracked.categories.iter().all(|(c, _)| usize::from(*c) < self.categories.len());
            hold(known, "an object has an unknown category")?;
            hold(tracked.views.iter().all(is_view) && tracked.views.len() >= 2, "a view of an object is wrong")?;
            hold(tracked.views.windows(2).all(|w| w[0].keyframe < w[1].keyframe), "views are not in order")?;
            hold(tracked.id.0 < self.next_id && ids.insert(tracked.id, ()).is_none(), "an id is used twice")?;
            let counts = [tracked.visible, tracked.forgotten, tracked.fitted_views];
            let is_small = |n: u64| n < u64::from(u32::MAX / 2);
            let countable =
                counts.iter().all(|&n| is_small(n as u64)) && tracked.clear.iter().all(|&n| is_small(n.into()));
            hold(countable, "a count of an object is out of range")?;
            let numbers = [&tracked.center[..], tracked.root.as_flattened(), &tracked.covariance, &tracked.times];
            hold(numbers.iter().all(|n| n.iter().all(|x| x.is_finite())), "an object is not finite")?;
            hold(tracked.radius > 0.0 && tracked.radius.is_finite(), "an object has no size")?;
        }
        let is_free = |slot: &u32| matches!(self.slots.get(*slot as usize), Some(None));
        let mut free = self.free_slots.clone();
        free.sort_unstable();
        free.dedup();
        hold(free.len() == self.free_slots.len() && free.iter().all(is_free), "a free slot is taken")?;
        // Aliases lead to older objects, so that following them ends.
        hold(self.aliases.iter().all(|(alias, id)| id < alias), "an alias leads to a younger object")
    }
}

/// Whether all numbers of cues are in their ranges, in a map of so many sources.
fn are_valid(cues: &Cues, sources: usize) -> bool {
    let rotation = cues.box3d.and_then(|box3d| box3d.rotation);
    cues.sources().all(|source| (source as usize) < sources)
        // As of poses.
        && rotation.is_none_or(|rotation| rotation_defect(rotation.matrix()) <= 1e-3)
        && cues.check().is_ok()
}

impl KeyframeState {
    fn of(keyframe: &Keyframe) -> Self {
        let frame = &keyframe.frame;
        let matrix = frame.projection.matrix();
        Self {
            id: frame.id.clone(),
            time: frame.time,
            projection: std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])),
            image_size: frame.image_size.map(Into::into),
            lens: frame.lens.map(|lens| (lens.model().name().to_owned(), lens.params().to_vec())),
            pose_noise: frame.pose_noise.map(|noise| [noise.rotation_sd, noise.translation_sd]),
            extent: keyframe.camera.size.into(),
            shift: keyframe.shift.into(),
            references: keyframe.references,
        }
    }

    fn into_keyframe(self, origin: &Vector3<f64>) -> Result<Keyframe, StateError> {
        let matrix = Matrix3x4::from_fn(|i, j| self.projection[i][j]);
        let projection = Projection::from_matrix(matrix).map_err(|_| StateError::Damaged("a camera is singular"))?;
        let lens = match self.lens {
            Some((model, params)) => {
                let model = CameraModel::from_name(&model).ok_or(StateError::Damaged("an unknown camera model"))?;
                Some(Camera::new(model, &params).map_err(|_| StateError::Damaged("a lens is wrong"))?)
            }
            None => None,
        };
        let noise = |[rotation_sd, translation_sd]: [f64; 2]| PoseNoise { rotation_sd, translation_sd };
        let frame = Frame {
            image_size: self.image_size.map(Vector2::from),
            lens,
            pose_noise: self.pose_noise.map(noise),
            ..Frame::new(self.id, self.time, projection)
        };
        let keyframe = Keyframe::new(frame, origin, Vector2::from(self.extent));
        Ok(Keyframe { shift: Vector2::from(self.shift), references: self.references, ..keyframe })
    }
}

impl TrackedState {
    fn of(tracked: &Tracked) -> Self {
        let object = &tracked.object;
        Self {
            id: tracked.id,
            center: object.center.into(),
            root: object.root.into(),
            radius: object.radius,
            cost: object.cost,
            log_det_hessian: object.log_det_hessian,
            covariance: object.covariance.as_slice().to_vec(),
            category: object.category,
            forgotten: object.forgotten,
            visible: object.visible,
            views: tracked.views.clone(),
            fitted_views: tracked.fitted_views,
            repeated: tracked.repeated,
            categories: tracked.categories.clone(),
            input_ids: tracked.input_ids.clone(),
            presence: tracked.presence,
            log_odds: tracked.log_odds,
            clear: [tracked.clear, tracked.clear_detected],
            times: [tracked.first_time, tracked.last_time],
            last_keyframe: tracked.last_keyframe,
        }
    }

    fn into_tracked(self) -> Tracked {
        let object = Object {
            boxes: (0..self.views.len() as u32).collect(),
            center: Vector3::from(self.center),
            root: Matrix3::from(self.root),
            radius: self.radius,
            cost: self.cost,
            log_det_hessian: self.log_det_hessian,
            // Checked to have 81 entries.
            covariance: SMatrix::from_iterator(self.covariance.iter().copied().chain(std::iter::repeat(0.0))),
            category: self.category,
            forgotten: self.forgotten,
            visible: self.visible,
            trusted_id: None,
        };
        let [clear, clear_detected] = self.clear;
        let [first_time, last_time] = self.times;
        Tracked {
            views: self.views,
            fitted_views: self.fitted_views,
            repeated: self.repeated,
            categories: self.categories,
            input_ids: self.input_ids,
            presence: self.presence,
            log_odds: self.log_odds,
            clear,
            clear_detected,
            last_keyframe: self.last_keyframe,
            ..Tracked::new(self.id, object, [first_time, last_time])
        }
    }
}

#[cfg(test)]
impl MapState {
    /// Panics if [`ObjectMap::from_state`] would refuse the state, or if reference counts are wrong.
    pub(super) fn assert_sound(&self) {
        assert_eq!(self.check(), Ok(()));
        let mut held: BTreeMap<u32, u32> = BTreeMap::new();
        for view in self.slots.iter().flatten().flat_map(|t| &t.views) {
            *held.entry(view.keyframe).or_default() += 1;
        }
        for frame in self.recent.iter().chain(self.windows.all()) {
            *held.entry(frame.key).or_default() += 1;
        }
        let references: BTreeMap<u32, u32> = self.keyframes.iter().map(|(key, k)| (*key, k.references)).collect();
        assert_eq!(held, references);
        let views: usize = self.slots.iter().flatten().map(|t| t.views.len() + t.forgotten).sum();
        assert_eq!(self.running.assigned, views as i64);
        let mut repeats: BTreeMap<ObjectId, u32> = BTreeMap::new();
        for found in self.recent.iter().flat_map(|frame| &frame.boxes) {
            found.owner.into_iter().for_each(|id| *repeats.entry(id).or_default() += found.repeats());
        }
        for tracked in self.slots.iter().flatten() {
            let known = repeats.get(&tracked.id).copied().unwrap_or(0);
            assert!(tracked.repeated >= known, "{} {known}", tracked.repeated);
        }
    }

    /// States with one error each.
    pub(super) fn damaged(&self) -> Vec<Self> {
        let with = |change: &dyn Fn(&mut Self)| {
            let mut state = self.clone();
            change(&mut state);
            state
        };
        let object = |state: &mut Self, change: &dyn Fn(&mut TrackedState)| {
            change(state.slots.iter_mut().flatten().next().unwrap());
        };
        vec![
            with(&|s| s.version = 99),
            with(&|s| s.keyframes.clear()),
            with(&|s| s.keyframes.reverse()),
            with(&|s| s.categories.clear()),
            with(&|s| s.free_slots.push(0)),
            with(&|s| s.free_slots.push(1_000_000)),
            with(&|s| s.aliases.push((ObjectId(1), ObjectId(1)))),
            with(&|s| s.next_key = 0),
            with(&|s| s.scaled_by_frame = [1_000_000].into()),
            with(&|s| s.next_id = 1),
            with(&|s| s.running.assigned = i64::MAX),
            with(&|s| object(s, &|t| t.covariance.clear())),
            with(&|s| object(s, &|t| t.root[0][0] = f64::NAN)),
            with(&|s| object(s, &|t| t.views.reverse())),
            with(&|s| object(s, &|t| t.views[0].edges = [3.0, 0.0, 1.0, 1.0])),
            with(&|s| object(s, &|t| t.views[0].category = 999)),
            with(&|s| object(s, &|t| t.visible = usize::MAX)),
            with(&|s| object(s, &|t| t.radius = 0.0)),
        ]
    }
}
