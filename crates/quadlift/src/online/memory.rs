//! What an object map knows.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::Vector3;

use super::keyframes::Keyframes;
use super::names::{Categories, InputIds};
use super::objects::Objects;
use super::options::OnlineOptions;
use super::recent_frames::RecentFrame;
use super::running::Running;
use super::tracked::Tracked;
use super::views::{KeptView, from_bits};
use super::windows::Windows;
use crate::association::input::observations::{Camera, Observations};
use crate::association::score::evidence::evidence;
use crate::association::score::fit::{Start, fit};
use crate::association::score::input_ids::IdTally;
use crate::association::score::object::Object;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::statistics::DetectionRate;
use crate::association::{AssociateError, IdPolicy};
use crate::diagnosis::Diagnosis;

/// Initial slack of edges, pixels.
const FIRST_PIXEL_SD: f64 = 2.0;

/// Share of wrong ids if ids are trusted. It is not zero, so that a mistake can be undone.
const TRUSTED_WRONG_SHARE: f64 = 1e-3;

/// Number of views up to which the probability of detections is tabulated.
const RATE_VIEWS: usize = 1024;

/// What an object map knows: the parts that its steps use.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(remote = "Self"))]
pub(super) struct Memory {
    #[cfg_attr(feature = "serde", serde(skip))]
    pub options: OnlineOptions,
    /// Key of the next frame.
    pub next_key: u32,
    /// Time and id of the last frame.
    pub last: Option<(f64, String)>,
    /// Origin of the internal coordinates: the center of the first camera.
    pub origin: Vector3<f64>,
    pub categories: Categories,
    /// Names of the sources of depths and 3D boxes.
    pub cue_sources: Vec<String>,
    /// Those whose depths have another scale in each frame.
    pub scaled_by_frame: BTreeSet<u32>,
    pub input_ids: InputIds,
    pub running: Running,
    pub keyframes: Keyframes,
    /// The last frames, whose boxes may still be reassigned.
    pub recent: VecDeque<RecentFrame>,
    pub objects: Objects,
    /// Number of consecutive frames that contradicted the map.
    pub disagreeing: u32,
    /// Pairs of objects whose merge was refused, with their numbers of views at that time.
    #[cfg_attr(feature = "serde", serde(with = "super::pairs"))]
    pub tried_pairs: BTreeMap<(u64, u64), (usize, usize)>,
    #[cfg_attr(feature = "serde", serde(skip, default = "detection_rate"))]
    pub rate: DetectionRate,
    /// Frames for the consistency check, and what it has found so far.
    pub windows: Windows,
    pub diagnosis: Diagnosis,
}

fn detection_rate() -> DetectionRate {
    DetectionRate::new(RATE_VIEWS)
}

impl Memory {
    /// That of an empty map.
    ///
    /// # Errors
    /// [`AssociateError::OutOfRange`] names the first option that is outside of its range.
    pub(super) fn new(options: OnlineOptions) -> Result<Self, AssociateError> {
        options.validate()?;
        let running = Running::new(options.edge_noise_px.unwrap_or(FIRST_PIXEL_SD));
        let tally = IdTally::new(match options.ids {
            IdPolicy::Trust => options.wrong_id_share.min(TRUSTED_WRONG_SHARE),
            IdPolicy::Evidence | IdPolicy::Ignore => options.wrong_id_share,
        });
        Ok(Self {
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
            objects: Objects::new(tally),
            disagreeing: 0,
            tried_pairs: BTreeMap::new(),
            rate: detection_rate(),
            windows: Windows::default(),
            diagnosis: Diagnosis::default(),
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

    /// Evidence of an object's kept views against clutter, nats.
    pub(super) fn evidence_of(&self, tracked: &Tracked) -> f64 {
        let (observations, statistics) = self.gather(&tracked.views);
        evidence(&self.rate, &observations, &statistics, &tracked.object)
    }
}
